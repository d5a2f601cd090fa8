"""Checks of the parts of a model: their types, laws that fit together, numbers within their bounds."""

from collections.abc import Iterable, Sequence
from numbers import Integral

import numpy as np

from floebmi.boundaries import Inflow, Wall, check_domain
from floebmi.contact import Contact, check_contact, own
from floebmi.dynamics import Step
from floebmi.errors import InputError, check_word
from floebmi.floes import Floes
from floebmi.forces import ACCOUNTS, Force, acceleration
from floebmi.grid import Grid
from floebmi.quantities import check, is_number


def check_kinds(
    domain: object,
    floes: object,
    grid: object,
    walls: object,
    inflow: object,
    step: object,
    atmosphere_grid: object,
) -> None:
    """InputError for a part of a model of the wrong type, such as one passed in another's place."""
    check_domain(domain)
    for name, part, kind in (("floes", floes, Floes), ("step", step, Step)):
        if not isinstance(part, kind):
            raise InputError(f"{name} = {part!r}: must be of the kind {kind.__name__}")
    for name, part in (("grid", grid), ("atmosphere_grid", atmosphere_grid)):
        if not isinstance(part, Grid | None):
            raise InputError(f"{name} = {part!r}: must be a Grid, or None")
    for name, parts, kind in (("walls", walls, Wall), ("inflow", inflow, Inflow)):
        several = [parts] if name == "inflow" and isinstance(parts, kind) else parts
        if not isinstance(several, Sequence) or not all(isinstance(p, kind) for p in several):
            raise InputError(f"{name} = {parts!r}: must be a list of {kind.__name__}")


def listed_forces(forces: Iterable[Force]) -> tuple[Force, ...]:
    """The forces of a model; InputError for one that is no force, has no code, is listed twice or excludes another."""
    if not np.iterable(forces):
        raise InputError(f"forces = {forces!r}: must be a list of forces, as [OceanDrag()]")
    forces = tuple(forces)
    for force in forces:
        if type(force) not in ACCOUNTS:
            names = ", ".join(kind.__name__ for kind in ACCOUNTS)
            raise InputError(f"forces: {force!r} is not a force; allowed: {names}")
        if type(force) not in acceleration.registry:
            raise InputError(
                f"forces: {force!r} has no acceleration; register one for {type(force).__name__}"
            )
    names = [type(force).__name__ for force in forces]
    for name in set(names):
        if names.count(name) > 1:
            raise InputError(f"forces: {name} is listed {names.count(name)} times; list it once")
    if "Coriolis" in names and "CoriolisField" in names:
        raise InputError("forces: Coriolis and CoriolisField exclude each other; list one")
    return forces


def check_laws(
    forces: tuple[Force, ...], contact: Contact | None, sampling: str, step: Step
) -> None:
    """InputError for numbers out of bounds, unknown words, and settings that exclude each other."""
    if contact is not None and not isinstance(contact, Contact):
        raise InputError(
            f"contact = {contact!r}: must be a Contact, as frictional() or cohesive() make"
        )
    check(forces)
    check([contact])
    check_contact(contact)
    check_word("sampling", sampling, ("overlap", "centre"))
    check_word("step.scheme", step.scheme, ("verlet", "taylor2", "taylor3"))
    if step.epsilon is not None and step.length is not None:
        raise InputError("step.epsilon and step.length exclude each other; give one")
    check([step])
    if step.drag_every == 1:
        return
    if step.scheme != "verlet":
        raise InputError(
            f"step.drag_every = {step.drag_every}: is of the scheme verlet; "
            f"{step.scheme} has drag in every step: leave it out"
        )
    if not forces:
        raise InputError(
            f"step.drag_every = {step.drag_every}: is of forces other than contacts, and there are none: "
            "list one, or leave it out"
        )


def check_numbers(
    ice_density: object, draft_fraction: object, seed: object, threads: object
) -> None:
    """InputError for invalid values of these numbers."""
    for name, value in (("ice_density", ice_density), ("draft_fraction", draft_fraction)):
        if not (is_number(value) and value > 0):
            raise InputError(f"{name} = {value!r}: must be greater than 0")
    for name, value, least in (("seed", seed, 0), ("threads", threads, 1)):
        if not (isinstance(value, Integral) and value >= least):
            raise InputError(f"{name} = {value!r}: must be a whole number, at least {least}")
    if draft_fraction > 1:
        raise InputError(f"draft_fraction = {draft_fraction!r}: must be at most 1")


def refuse_strangers(floes: Floes, contact: Contact | None) -> None:
    """InputError for floes of another model, with individual values of a number that this contact law does not spread."""
    for name, part in (("friction", "friction"), ("tensile_strength", "bonds")):
        if getattr(floes, name) is not None and name not in own(contact):
            raise InputError(
                f"floes.{name}: each floe has its own, but contact.{part} lists no spread; list it, "
                "or make new floes"
            )
