"""Agreement between a model and the state that it restarts from.

A state belongs to one scene: its fluid fields to the cells of one grid, the memory of its contacts to one kind of law,
its floes to one domain.  So these are stored with it, as named numbers, and a restart compares them.  A different
number in a law starts a branch of the run: the state is complete, and the change of its energy or mass is booked as an
edit.  It is reported, though, since it may be a mistake.  Forcing, the step and the output may differ.
"""

import json
import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from floebmi.arrays import digest
from floebmi.boundaries import Domain
from floebmi.errors import InputError
from floebmi.floes import LAND, Floes
from floebmi.forces import Coriolis, CoriolisField
from floebmi.grid import Grid
from floebmi.kept import Marks
from floebmi.pairs import wrap

if TYPE_CHECKING:
    from floebmi.model import Model

_SAME = 1e-9  # relative difference of numbers that rounding may cause on another machine
_SHOWN = 4  # most numbers of a row shown in a line: the bounds of a grid
_LAWS = "contact", "coriolis", "ice", "walls", "inflow"  # tables in which a number may differ

_OCEAN = {  # what a state holds of an ocean, and of its slope
    f"ocean_{name}"
    for name in (
        "u", "v", "tilt_x", "tilt_y", "coriolis", "impulse_x", "impulse_y", "last_x", "last_y", "magnitude", "coefficient",
        "undelivered",
    )
}  # fmt: skip
_UNCOUNTED = 2  # the last counters, which a restart file of an older floebmi lacks


def scene_of(model: "Model") -> str:
    """The properties of a model that must agree with those of a state, as JSON."""
    rows = [*_named("domain", model.domain), *_of_grid("grid", model.grid)]
    if model.atmosphere is not None:
        rows += _of_grid("atmosphere.grid", model.atmosphere.grid)
    rows += _named("contact", model.contact)
    for force in model.forces:
        if isinstance(force, Coriolis | CoriolisField):
            rows += _named("coriolis", force)
    rows.append(("ice.density", model.ice_density))
    for k, wall in enumerate(model.walls):
        rows += _named(f"walls.{k}", wall)
    for k, inflow in enumerate(model.inflow):
        for name in ("edge", "sizes", "thickness", "velocity", "span"):
            rows += _named(f"inflow.{k}.{name}", getattr(inflow, name))
    return json.dumps(dict(rows))


def refuse_unlike(mine: Mapping[str, Any], theirs: Mapping[str, Any]) -> list[str]:
    """InputError if a model in state `mine` cannot restart from `theirs`: another scene, or too old a floebmi.

    Returns in words which numbers of laws differ.
    """
    expected, branched = set(mine), []
    if "scene" in theirs:
        branched = _refuse_other_scene(json.loads(mine["scene"]), json.loads(str(theirs["scene"])))
    else:  # of an older floebmi
        expected.remove("scene")
    if expected - set(theirs) == {f"list_{name}" for name in Marks._fields}:
        raise InputError(
            "restart: does not say where neighbours were listed (list_x …): an older floebmi wrote it; "
            "run the scene again from its start"
        )
    odd = set(theirs) ^ expected
    if odd == {"previous"}:
        here, there = "the paper's", "verlet"
        if "previous" in theirs:
            here, there = there, here
        raise InputError(
            f"restart: [step] scheme is {here}, the restart's is {there}; must be verlet in both or in neither"
        )
    for table, field in (("ocean", "ocean_u"), ("tilt", "ocean_tilt_x")):
        if field in odd and odd <= _OCEAN:  # else a law of the user's own reads more of the ocean
            here, there = ("given", "none") if field in expected else ("none", "given")
            raise InputError(
                f"restart: [{table}] is {here}, the restart's is {there}; must be the same"
            )
    if odd:
        named = ", ".join(sorted(odd))
        raise InputError(f"restart: does not fit this scene (laws or fluids differ: {named})")
    for fluid in ("ocean", "atmosphere"):
        cells = f"{fluid}_u"
        if cells in mine and np.size(theirs[cells]) != np.size(mine[cells]):
            raise InputError(
                f"restart: {fluid} has {np.size(theirs[cells])} cells, the scene's grid "
                f"{np.size(mine[cells])}; must be the same grid"
            )
    if np.size(theirs["walls"]) != np.size(mine["walls"]):
        raise InputError(
            "restart: number of walls differs from the scene's, or an older floebmi wrote it"
        )
    have, need = np.size(theirs["counters"]), np.size(mine["counters"])
    if have not in (need, need - _UNCOUNTED):
        raise InputError(
            f"restart: counters: {have} of them; must be {need}, or {need - _UNCOUNTED} of an older floebmi"
        )
    return branched


def _named(name: str, value: object) -> Iterator[tuple[str, object]]:
    """Rows (dotted name, number or text) of a law or another named tuple."""
    if hasattr(value, "_asdict"):
        yield name, type(value).__name__
        for part, inner in value._asdict().items():
            yield from _named(f"{name}.{part}", inner)
    else:
        is_array = isinstance(value, tuple | np.ndarray | np.generic)
        yield name, np.asarray(value).tolist() if is_array else value


def _of_grid(name: str, grid: Grid) -> Iterator[tuple[str, object]]:
    """Rows of a grid: its shape, its bounds, and digests of its corners and of its wet cells."""
    west, east, south, north = (float(bound) for bound in grid.bounds)
    # integers, relative to the extent of the grid: not affected by rounding
    x, y = (grid.node_x - west) / (east - west), (grid.node_y - south) / (north - south)
    corners = [np.rint(2.0**24 * place).astype(np.int32) for place in (x, y)]
    yield f"{name}.shape", list(grid.shape)
    yield f"{name}.bounds", [west, east, south, north]
    yield f"{name}.corners", digest(*corners, grid.face_nodes)
    yield f"{name}.wet", digest(np.packbits(grid.wet))


def _refuse_other_scene(mine: Mapping[str, object], theirs: Mapping[str, object]) -> list[str]:
    """InputError with the table and key of the first row that differs; differing numbers of laws are returned, in words."""
    branched = []
    for name in dict.fromkeys([*mine, *theirs]):
        here, there = mine.get(name), theirs.get(name)
        if _alike(here, there):
            continue
        table, _, key = name.partition(".")
        digests = key in ("corners", "wet", "grid.corners", "grid.wet")
        if digests or _is_long(here) or _is_long(there):
            values = " are others than the restart's"
        else:
            values = f" = {_text(here)}, the restart's is {_text(there)}"
        number, _, of_one = key.partition(".")
        if number.isdecimal():  # of a list of tables
            words = f"[{table} number {int(number) + 1}]{of_one and f' {of_one}'}{values}"
        else:
            words = f"[{table}]{key and f' {key}'}{values}"
        places = key.endswith(".position")  # of a wall: its position is in the state
        if table in _LAWS and _is_number(here) and _is_number(there) and not places:
            branched.append(words)
        else:
            raise InputError(f"restart: {words}; must be the same")
    return branched


def refuse_other_coast(mine: Floes, theirs: Floes, domain: Domain) -> None:
    """InputError if the pieces of coast of two packs differ, up to shifts by a period."""
    here, there = (np.flatnonzero(floes.motion & LAND) for floes in (mine, theirs))
    if len(here) != len(there):
        raise InputError(
            f"restart: [coast] has {len(here)} pieces, the restart's {len(there)}; must be the same land and radius"
        )
    for name, length in zip(
        ("radius", "thickness", "x", "y"), (None, None, *domain.period), strict=True
    ):
        one, other = getattr(mine, name)[here], getattr(theirs, name)[there]
        apart = wrap(length, other - one)
        wrong = np.abs(apart) > 1e-6 * mine.radius[here] + _SAME * np.abs(one)
        if wrong.any():
            k = int(wrong.argmax())
            raise InputError(
                f"restart: [coast] has a piece of {name} {one[k]:g} m, the restart's is {other[k]:g} m; must be the same"
            )


def _alike(one: object, other: object) -> bool:
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(_alike, one, other))
    if isinstance(one, int | float) and isinstance(other, int | float):
        return math.isclose(one, other, rel_tol=_SAME) or (one != one and other != other)
    return one == other


def _is_number(value: object) -> bool:
    """Whether a value is a number, None, or a row of such, as measured radii."""
    if isinstance(value, list):
        return all(map(_is_number, value))
    return value is None or isinstance(value, int | float)


def _is_long(value: object) -> bool:
    return isinstance(value, list) and len(value) > _SHOWN


def _text(value: object) -> str:
    return "none" if value is None else value if isinstance(value, str) else repr(value)
