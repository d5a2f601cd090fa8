"""Simple shear: how strong is a pack of floes under a normal stress?

    N ↓↓↓↓↓↓↓↓↓↓↓↓↓↓↓     frictionless wall, loaded with N
      driven floes →→→     u = speed, free along y
      ╎            ╎
      ╎    pack    ╎       periodic along x
      ╎            ╎
      fixed floes

Floes settle in water that flows towards −y, are pressed together by the wall, and are then sheared: those within
one floe size of the bottom are fixed, those within one floe size of the top are driven.  The shear stress τ is the
force along x on the driven floes over the area of the top, length × thickness.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from floebmi.boundaries import Domain, Wall
from floebmi.ensemble import Output
from floebmi.errors import InputError
from floebmi.experiments import books
from floebmi.experiments.laws import contact, step
from floebmi.experiments.parameters import Shear, make
from floebmi.floes import FIXED, FIXED_ROTATION, FIXED_X, Floes
from floebmi.forces import OceanDrag
from floebmi.model import Model
from floebmi.packing import scatter
from floebmi.sizes import PowerLaw

PACKED = 0.82  # of the settled pack, for the width that gives the wanted height
LAYERS = 24
ACCOUNTS = ("walls", "held floes and coast", "friction", "dashpots", "broken bonds", "edits by the user")  # fmt: skip
OUTPUTS = {
    "shear_stress": Output((), "Pa", "force along x on the driven floes over the top's area, steady mean"),
    "shear_stress_error": Output((), "Pa", "standard error of that mean, from ten blocks of time"),
    "normal_stress_met": Output((), "Pa", "normal stress of the pack on the wall, steady mean"),
    "inertia_number": Output((), "1", "shear rate × mean diameter × √(density/N)"),
    "shear_rate": Output((), "s-1", "speed over the height between fixed and driven floes"),
    "moving_floes": Output((), "1", "floes that are neither fixed nor driven"),
    "shear_stress_in_time": Output(("time",), "Pa", "shear stress"),
    "wall_position": Output(("time",), "m", "position of the wall"),
    "displacement": Output(("layer",), "1", "displacement along x over that of the driven floes, steady mean"),
    "floe_steps": Output((), "1", "floes times steps during shear"),
    **books.OUTPUTS,
}  # fmt: skip
COORDINATES = {
    "time": Output(("time",), "s", "time since the shear began"),
    "layer": Output(("layer",), "1", "height over that of the wall"),
    **books.COORDINATES,
}


class Cell(NamedTuple):
    """A consolidated pack, ready to be sheared."""

    model: Model
    driven: np.ndarray  # bool, shape (floes,)
    standing: np.ndarray
    length: float  # along x [m]


def settle(p: Shear, seed: int) -> tuple[Floes, float]:
    """Let loose floes come to rest at the bottom; returns them, and the length of the cell."""
    sizes = PowerLaw(p.radius_min, p.radius_max, exponent=p.exponent)
    area = p.floes * sizes.mean_area()
    length = area / (PACKED * p.height)
    if length < 4 * p.radius_max:
        raise InputError(
            f"Shear.floes = {p.floes:g}: the cell would be {length:.0f} m long, less than two of the "
            "largest floes; more floes, or less height"
        )
    loose = Domain((0.0, length), (0.0, p.height * PACKED / p.concentration), "periodic", "periodic", "closed", "closed")  # fmt: skip
    floes = scatter(loose, sizes, count=int(p.floes), thickness=p.thickness, seed=seed)
    model = Model(
        loose, floes, contact(p), [OceanDrag()], step=step(p), ice_density=p.ice_density, seed=seed
    )
    model.ocean.v[:] = -p.settling_speed
    model.advance(p.settling)
    return model.floes, length


def consolidate(p: Shear, seed: int) -> Cell:
    """Consolidate the settled floes under the loaded wall; then fix the lowest and drive the highest."""
    floes, length = settle(p, seed)
    at_rest(floes)
    top = float((floes.y + floes.radius).max())
    domain = Domain((0.0, length), (0.0, 1.2 * top), "periodic", "periodic", "closed")
    model = Model(
        domain, floes, contact(p),
        walls=[Wall("north", top, normal_stress=p.normal_stress, damping=p.wall_damping)],
        step=step(p), ice_density=p.ice_density, seed=seed,
    )  # fmt: skip
    model.advance(p.consolidation)
    floes, wall = model.floes, float(model.wall_positions[0])
    at_rest(floes)
    standing = floes.y - floes.radius < p.held
    driven = (floes.y + floes.radius > wall - p.held) & ~standing
    if not driven.any() or not standing.any() or (driven | standing).all():
        raise InputError(
            f"Shear.held = {p.held!r}: leaves no floes to shear; smaller, or more height"
        )
    floes.motion[standing] = FIXED
    floes.motion[driven] = FIXED_X | FIXED_ROTATION
    floes.u[driven] = p.speed
    return Cell(model, driven, standing, length)


def at_rest(floes: Floes) -> None:
    """Set all velocities to zero."""
    floes.u[:] = floes.v[:] = 0.0
    if floes.rotation:
        floes.angular_velocity[:] = 0.0


def force_on(cell: Cell) -> float:
    """Force of the pack on the driven floes along x [N]; negative, because it resists their motion."""
    c = cell.model.contacts()
    one, other = cell.driven[c.i], cell.driven[c.j]
    return float(c.fx[one & ~other].sum() - c.fx[other & ~one].sum())


def member(parameters: Mapping[str, Any], seed: int) -> dict[str, np.ndarray]:
    """One run; returns arrays with the names of `OUTPUTS` and `COORDINATES`."""
    p = make(Shear, parameters)
    cell = consolidate(p, seed)
    model, area = cell.model, cell.length * p.thickness
    floes, began, before = model.floes, model.time, model.counters.floe_steps
    n = max(20, round(p.duration / p.interval))
    time = p.duration * np.arange(1, n + 1) / n
    first = n - round(p.steady * n)
    shear, normal, position = np.zeros(n), np.zeros(n), np.zeros(n)
    way, seen = np.zeros(LAYERS), np.zeros(LAYERS)
    for k in range(n):
        x = floes.x.copy()
        model.advance(began + time[k] - model.time)
        shear[k] = -force_on(cell) / area
        normal[k] = model.wall_stress()[0]
        position[k] = model.wall_positions[0]
        if k >= first:
            moved = floes.x - x
            moved -= cell.length * np.rint(moved / cell.length)  # across the seam
            layer = np.clip((LAYERS * floes.y / position[k]).astype(int), 0, LAYERS - 1)
            way += np.bincount(layer, moved, LAYERS)
            seen += np.bincount(layer, minlength=LAYERS)
    steady = slice(first, None)
    blocks = [block.mean() for block in np.array_split(shear[steady], 10)]
    height = position[steady].mean() - 2 * p.held
    rate, diameter = p.speed / height, 2 * floes.radius.mean()
    with np.errstate(invalid="ignore"):
        displacement = way / seen / (p.speed * p.duration / n)
    return {
        "time": time,
        "layer": (np.arange(LAYERS) + 0.5) / LAYERS,
        "shear_stress": np.array(shear[steady].mean()),
        "shear_stress_error": np.array(np.std(blocks, ddof=1) / np.sqrt(len(blocks))),
        "normal_stress_met": np.array(normal[steady].mean()),
        "inertia_number": np.array(rate * diameter * np.sqrt(p.ice_density / p.normal_stress)),
        "shear_rate": np.array(rate),
        "moving_floes": np.array(float((~cell.driven & ~cell.standing).sum())),
        "shear_stress_in_time": shear,
        "wall_position": position,
        "displacement": displacement,
        "floe_steps": np.array(float(model.counters.floe_steps - before)),
        **books.books(model, ACCOUNTS),
    }
