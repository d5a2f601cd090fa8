"""Packed floes, as the kernels see them: active ones only, sorted in space, in few cache lines.

All that a contact reads of a floe is one record of 64 bytes.  The laws determine which fields and arrays exist:
a spin only where floes rotate.  What is not needed is None, which the kernels compile to nothing.
"""

from typing import NamedTuple

import numpy as np

from floebmi.floes import FIXED_ROTATION, FIXED_X, FIXED_Y, LAND, Floes
from floebmi.kernels import as_records, dispatched, in_place
from floebmi.neighbours import sort_in_space
from floebmi.pairs import recall, remember
from floebmi.tiles import coast_last


def _record(*names: str) -> np.dtype:
    return np.dtype([(name, np.float64) for name in names])


# A floe is one cache line, in the order of `columns.gather`; w is 1/m, or 0 for a floe that no force moves.  Without
# rotation omega is not used: with a record of another kind, kernels that do not read it would be compiled twice.
FLOE = _record("x", "y", "u", "v", "r", "h", "omega", "w")
FORCE = _record("x", "y")
FORCE_AND_TORQUE = _record("x", "y", "torque", "unused")


def _lines(n: int, kind: np.dtype) -> np.ndarray:
    """n zero records, aligned to a cache line."""
    line = 64
    room = np.zeros(n * kind.itemsize + line, np.uint8)
    first = -room.ctypes.data % line
    return as_records(room[first : first + n * kind.itemsize].view(kind))


class Packed(NamedTuple):
    """The floes in a kernel's order: arrays of shape (n,), SI units."""

    floes: np.ndarray  # records of FLOE
    spinning: np.ndarray | None  # the same records, if floes rotate
    force: np.ndarray  # x, y (and torque), of contacts
    number: np.ndarray  # permanent number of the floe
    mass: np.ndarray  # m, 0 of coast
    inverse_x: np.ndarray  # 1/m, or 0 where motion along x is prescribed
    inverse_y: np.ndarray
    inertia: np.ndarray | None  # J = m r²/2
    inverse_spin: np.ndarray | None  # 1/J, or 0 where rotation is prescribed
    angle: np.ndarray | None  # by which the floe has rotated
    held: np.ndarray  # packed index of floes with a prescribed axis, without coast
    land: np.ndarray  # bool: a piece of coast
    first_x: np.ndarray  # position of the floe when it was packed
    first_y: np.ndarray
    previous: np.ndarray | None  # (n, 3) contact forces and torques of the last step, for `taylor`
    origin_x: float  # of the records' coordinates
    origin_y: float
    friction: np.ndarray | None  # μ and σ_c of each floe, where they differ
    tensile_strength: np.ndarray | None


def places(
    floes: Floes,
    number: np.ndarray,
    origin: tuple[float, float],
    remainder: np.ndarray | None,
) -> tuple[np.ndarray, np.ndarray]:
    """Positions of some floes, relative to the origin of the records [m].

    remainder : rounding error of the floes' x, y when they were unpacked, to be added (n, 2) [m], or None
    """
    x, y = np.empty((2, len(number)))
    _from_origin(floes.x, floes.y, number, *origin, x, y)
    return (x, y) if remainder is None else (x + remainder[number, 0], y + remainder[number, 1])


@in_place
def _from_origin(x, y, number, origin_x, origin_y, here_x, here_y):
    for k in range(number.size):
        floe = np.uintp(number[k])
        here_x[k], here_y[k] = x[floe] - origin_x, y[floe] - origin_y


def in_space(
    floes: Floes, origin: tuple[float, float], remainder: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Numbers of the active floes, sorted in space, coast last in its tile, and their positions; see `places`."""
    number = np.flatnonzero(floes.active)
    x, y = places(floes, number, origin, remainder)
    if not len(number):
        return number, x, y
    order = sort_in_space(x, y, floes.radius[number])
    land = floes.land[number[order]]
    if land.any():
        order = order[coast_last(land)]
    return number[order], x[order], y[order]


def pack(
    floes: Floes,
    number: np.ndarray,
    first_x: np.ndarray,
    first_y: np.ndarray,
    density: float,
    previous: np.ndarray | None,
    origin: tuple[float, float],
) -> Packed:
    """Copy floes into records, in the order of `number`, at the positions given.

    previous : forces [N] and torques [N m] (n, 3) of the last step, for the paper's schemes, or None
    origin : x, y of the origin of the records' coordinates [m]
    """
    n = len(number)
    rotation = floes.rotation
    records = _lines(n, FLOE)
    bits, mass, radius = floes.motion[number], floes.mass(density)[number], floes.radius[number]
    land = (bits & LAND) != 0
    inverse = 1.0 / mass
    inverse_x = np.where(bits & FIXED_X, 0.0, inverse)
    inverse_y = np.where(bits & FIXED_Y, 0.0, inverse)
    records["r"], records["h"] = radius, floes.thickness[number]
    records["w"] = np.maximum(inverse_x, inverse_y)
    inertia = inverse_spin = None
    if rotation:
        inertia = 0.5 * mass * radius**2
        inverse_spin = np.where(bits & FIXED_ROTATION, 0.0, 1.0 / inertia)
    mass[land] = 0.0
    packed = Packed(
        records,
        records if rotation else None,
        _lines(n, FORCE_AND_TORQUE if rotation else FORCE),
        number,
        mass,
        inverse_x,
        inverse_y,
        inertia,
        inverse_spin,
        None,
        np.flatnonzero((bits != 0) & ~land),
        land,
        first_x,
        first_y,
        None,
        *origin,
        None,
        None if floes.tensile_strength is None else floes.tensile_strength[number],
    )
    return pack_again(packed, floes, first_x, first_y, previous)


def pack_again(
    packed: Packed,
    floes: Floes,
    first_x: np.ndarray,
    first_y: np.ndarray,
    previous: np.ndarray | None,
) -> Packed:
    """The same floes in the same arrays, at the positions given and with their present velocities; see `pack`.

    Radius, thickness and prescribed motion stay as before; forces are not yet computed.
    """
    number = packed.number
    angle = None if packed.spinning is None else np.empty(len(number))
    _set_going(
        packed.floes, packed.spinning, angle, first_x, first_y, number, floes.u, floes.v,
        floes.angular_velocity, floes.angle,
    )  # fmt: skip
    return packed._replace(
        angle=angle,
        first_x=first_x,
        first_y=first_y,
        previous=None if previous is None else previous[number],
        friction=None if floes.friction is None else floes.friction[number],
    )


@in_place
def _set_going(records, spinning, angle, x, y, number, u, v, omega, all_angles):
    """Write records one after the other; column by column, each would be fetched many times."""
    for k in range(number.size):
        floe, record = np.uintp(number[k]), records[k]
        record.x, record.y, record.u, record.v = x[k], y[k], u[floe], v[floe]
        set_omega(spinning, k, recall(omega, floe))
        remember(angle, k, recall(all_angles, floe))


def unpack(
    packed: Packed, floes: Floes, previous: np.ndarray | None, remainder: np.ndarray | None
) -> None:
    """Copy positions and velocities back into the floes."""
    p, number = packed, packed.number
    _put_back(
        p.floes, p.spinning, p.angle, number, p.first_x, p.first_y, p.origin_x, p.origin_y,
        floes.x, floes.y, floes.u, floes.v, floes.angular_velocity, floes.angle,
    )  # fmt: skip
    if remainder is not None:
        # not in a kernel, whose fast-math would optimise the rounding error away
        for axis, (place, now, first, origin) in enumerate(
            (
                (floes.x, p.floes["x"], p.first_x, p.origin_x),
                (floes.y, p.floes["y"], p.first_y, p.origin_y),
            )
        ):
            moved = now != first
            of = number[moved]
            remainder[of, axis] = now[moved] - (place[of] - origin)
    if previous is not None:
        previous[number] = p.previous


@in_place
def _put_back(
    records, spinning, angle, number, first_x, first_y, origin_x, origin_y, x, y, u, v, omega, all_angles
):  # fmt: skip
    for k in range(number.size):
        floe, record = np.uintp(number[k]), records[k]
        if record.x != first_x[k]:  # a floe that did not move keeps its position to the bit
            x[floe] = record.x + origin_x
        if record.y != first_y[k]:
            y[floe] = record.y + origin_y
        u[floe], v[floe] = record.u, record.v
        remember(omega, floe, omega_of(spinning, k))
        remember(all_angles, floe, recall(angle, k))


@dispatched
def omega_of(spinning, k):
    """The angular velocity of a floe; 0 where floes do not rotate."""
    return spinning[k].omega


@omega_of.register
def _(spinning: None, k):
    return 0.0


@dispatched
def set_omega(spinning, k, omega):
    """Set the angular velocity of a floe, where floes rotate."""
    spinning[k].omega = omega


@set_omega.register
def _(spinning: None, k, omega):
    pass
