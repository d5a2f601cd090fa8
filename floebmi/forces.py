"""Forces other than contact forces; a new force is added here and nowhere else.

A force is a law (a few parameters), the fields that it reads at the floes (`READS`), and its acceleration with the exact
derivative with respect to velocity (`acceleration`).  All forces of a scene act together in one linearly implicit step,

    (1 − Δt/2 Σ J) δu = Δt Σ a(u),        J = ∂a/∂u,

which is second order, gives the exact solution for quadratic drag, Δu/(1 + K|Δu|Δt), and changes nothing
in equilibrium.  The impulse of each force in that step, m Δt (a + ½ J δu), is recorded for each
floe; its opposite acts on the ocean and the atmosphere.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba.extending import overload

from floebmi.kernels import BLOCK, IN_PLACE, dispatched, in_place, inner
from floebmi.quantities import NonNegative, Positive


class OceanDrag(NamedTuple):
    """Quadratic drag of the ocean on a floe's bottom and side (eq. ocean-drag).

    Parameters
    ----------
    density : density of the water ρ_o [kg/m³]
    vertical : drag coefficient of the side c_v,o [1], for the area 2 r D (D: draft)
    horizontal : drag coefficient of the bottom c_h,o [1], for the area r²
    """

    density: Positive = 1000.0
    vertical: NonNegative = 0.14
    horizontal: NonNegative = 1.6e-4


class AirDrag(NamedTuple):
    """Quadratic drag of the wind on a floe's top and freeboard (eq. air-drag).

    Parameters
    ----------
    density : density of the air ρ_a [kg/m³]
    vertical : drag coefficient of the freeboard c_v,a [1], for the area 2 r (h − D) (D: draft)
    horizontal : drag coefficient of the top c_h,a [1], for the area r²
    """

    density: Positive = 1.3
    vertical: NonNegative = 0.064
    horizontal: NonNegative = 8.0e-5


class Coriolis(NamedTuple):
    """Coriolis acceleration, f (v, −u) (eq. coriolis).

    Parameters
    ----------
    parameter : Coriolis parameter f [1/s], positive in the northern hemisphere
    """

    parameter: float


class CoriolisField(NamedTuple):
    """Coriolis acceleration with a parameter f [1/s] that varies over the ocean's grid (`model.ocean.coriolis`)."""


class Tilt(NamedTuple):
    """Acceleration −g ∇η by the tilt of the sea surface; the slope ∇η is given on the ocean's grid (eq. sea-surface-tilt).

    Parameters
    ----------
    gravity : gravitational acceleration g [m/s²]
    """

    gravity: Positive = 9.81


class GeostrophicTilt(NamedTuple):
    """Acceleration −g ∇η = f (−v_o, u_o) by the slope that is in balance with the ocean's velocity (eq. sea-surface-tilt).

    Parameters
    ----------
    parameter : Coriolis parameter f [1/s], that of `Coriolis`
    """

    parameter: float


class BodyForce(NamedTuple):
    """A uniform acceleration (eq. body-force).

    Parameters
    ----------
    x : acceleration along x [m/s²]
    y : acceleration along y [m/s²]
    """

    x: float = 0.0
    y: float = 0.0


Force = OceanDrag | AirDrag | Coriolis | CoriolisField | Tilt | GeostrophicTilt | BodyForce

ACCOUNTS: dict[type, str] = {  # name of each force's account in the ledger
    OceanDrag: "ocean drag",
    AirDrag: "wind",
    Coriolis: "Coriolis",
    CoriolisField: "Coriolis",
    Tilt: "sea-surface tilt",
    GeostrophicTilt: "sea-surface tilt",
    BodyForce: "body force",
}

# The data of a force at the floes is a table with a column for each floe and those of these rows that the force needs:
# impulse [N s] and work [J] given to the floe in this exchange; velocity of the fluid [m/s], or slope of
# the sea surface [1]; K/m [1/m] of drag; half the curl of the fluid [1/s] and K/J [1] of its torque.
X, Y, WORK, FLUID_U, FLUID_V, RATE, HALF_CURL, SPIN_RATE = range(8)
PARAMETER = 3  # the Coriolis parameter [1/s], instead of a fluid

# For each force: the fluid that it reads, and the row for each of its fields.
READS: dict[type, tuple[str, dict[str, int]]] = {
    OceanDrag: ("ocean", {"u": FLUID_U, "v": FLUID_V}),
    AirDrag: ("atmosphere", {"u": FLUID_U, "v": FLUID_V}),
    CoriolisField: ("ocean", {"coriolis": PARAMETER}),
    Tilt: ("ocean", {"tilt_x": FLUID_U, "tilt_y": FLUID_V}),
    GeostrophicTilt: ("ocean", {"u": FLUID_U, "v": FLUID_V}),
}

DRAG_PRESETS: dict[str, tuple[OceanDrag, AirDrag]] = {
    # as printed, Eqs 12 and 13
    "damsgaard2018": (OceanDrag(), AirDrag()),
    # f = ρ (½ 0.85 · 2 r D + C 4 r²) Δv|Δv|, divided by π
    "granular.jl-0.3.2": (
        OceanDrag(1000.0, 0.5 * 0.85 / np.pi, 4 * 5.0e-4 / np.pi),
        AirDrag(1.2754, 0.5 * 0.85 / np.pi, 4 * 2.5e-4 / np.pi),
    ),
    # f = ρ C_d π r² Δv|Δv|
    "constant-cd": (OceanDrag(1026.0, 0.0, 5.5e-3), AirDrag(1.3, 0.0, 1.2e-3)),
}


def bulk_coefficient(drag: OceanDrag | AirDrag, radius: np.ndarray, side: np.ndarray) -> np.ndarray:
    """Equivalent drag coefficient C_d [1] for a floe's area, f = ρ C_d π r² Δv|Δv|; side: draft or freeboard [m]."""
    return drag.vertical * 2 * side / radius + drag.horizontal


# ---- what a force needs at each floe ----------------------------------------------------------------


def at_floes(
    force: Force,
    radius: np.ndarray,
    thickness: np.ndarray,
    draft: np.ndarray,
    ice_density: float,
    rotation: bool,
    land: np.ndarray,
) -> np.ndarray:
    """Allocate the table of a force for n floes, with only the rows that it needs; there is no drag on land.

    Returns
    -------
    Array of shape (rows, n); the rows are X, Y, WORK and those that the force reads.
    """
    _, fields = READS.get(type(force), ("", {}))
    mass_per_area = np.where(land, np.inf, ice_density * thickness)
    known = each_floe(force, radius, thickness, draft, mass_per_area)[: 2 if rotation else 1]
    last = max(fields.values(), default=WORK)
    if known:
        last = SPIN_RATE if len(known) > 1 else RATE
    at = np.zeros((last + 1, len(radius)))
    for row_of, values in zip((RATE, SPIN_RATE), known, strict=False):
        at[row_of] = values
    return at


@dispatched
def each_floe(force, radius, thickness, draft, mass_per_area):
    """Constants of each floe, for the rows RATE and, where floes rotate, SPIN_RATE; for drag K/m [1/m] and K/J [1]."""
    return ()


@each_floe.register
def _(force: OceanDrag, radius, thickness, draft, mass_per_area):
    return _rates(force, radius, draft, mass_per_area)


@each_floe.register
def _(force: AirDrag, radius, thickness, draft, mass_per_area):
    return _rates(force, radius, thickness - draft, mass_per_area)


def _rates(force, radius, side, mass_per_area):
    arm = radius * force.horizontal / 5 + side * force.vertical
    return (
        force.density * bulk_coefficient(force, radius, side) / mass_per_area,
        2 * force.density * arm / mass_per_area,  # eqs. ocean-torque, air-torque, over J = m r²/2
    )


# ---- the laws in the kernel -------------------------------------------------------------------------


def row(at, name, k):
    """Row `name` of a force's table for floe k; `at` is the table, or one block of a blocked table (k is then within it)."""
    return at[name, k] if at.ndim == 2 else at[name * BLOCK + k]


@overload(row, jit_options=IN_PLACE)
def _row(at, name, k):
    if at.ndim == 2:
        return lambda at, name, k: at[name, k]
    return lambda at, name, k: at[np.uintp(name * BLOCK + k)]  # unsigned: no wrap-around


class Push(NamedTuple):
    """Acceleration [m/s²] and its derivative with respect to velocity [1/s]."""

    x: float
    y: float
    xx: float
    xy: float
    yx: float
    yy: float


NONE = Push(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@dispatched
def acceleration(force, at, k, u, v):
    """Acceleration of floe k at velocity (u, v)."""
    raise TypeError(f"no acceleration for {type(force).__name__}")


@inner
def quadratic_drag(rate, du, dv):
    """K/m Δu|Δu| with its derivative −K/m (|Δu| 1 + Δu Δuᵀ/|Δu|)."""
    speed = np.sqrt(du * du + dv * dv)
    over = 1.0 / max(speed, 1e-300)
    return Push(
        rate * speed * du,
        rate * speed * dv,
        -rate * (speed + du * du * over),
        -rate * du * dv * over,
        -rate * du * dv * over,
        -rate * (speed + dv * dv * over),
    )


@acceleration.register
def _(force: OceanDrag, at, k, u, v):
    return quadratic_drag(row(at, RATE, k), row(at, FLUID_U, k) - u, row(at, FLUID_V, k) - v)


@acceleration.register
def _(force: AirDrag, at, k, u, v):
    return quadratic_drag(row(at, RATE, k), row(at, FLUID_U, k) - u, row(at, FLUID_V, k) - v)


@acceleration.register
def _(force: Coriolis, at, k, u, v):
    f = force.parameter
    return Push(f * v, -f * u, 0.0, f, -f, 0.0)


@acceleration.register
def _(force: CoriolisField, at, k, u, v):
    f = row(at, PARAMETER, k)
    return Push(f * v, -f * u, 0.0, f, -f, 0.0)


@acceleration.register
def _(force: Tilt, at, k, u, v):
    return Push(
        -force.gravity * row(at, FLUID_U, k),
        -force.gravity * row(at, FLUID_V, k),
        0.0,
        0.0,
        0.0,
        0.0,
    )


@acceleration.register
def _(force: GeostrophicTilt, at, k, u, v):
    f = force.parameter
    return Push(-f * row(at, FLUID_V, k), f * row(at, FLUID_U, k), 0.0, 0.0, 0.0, 0.0)


@acceleration.register
def _(force: BodyForce, at, k, u, v):
    return Push(force.x, force.y, 0.0, 0.0, 0.0, 0.0)


@dispatched
def spin_up(force, at, k, omega):
    """Angular acceleration of floe k [1/s²] and its derivative [1/s]; 0 except for drag by fluids."""
    return 0.0, 0.0


@inner
def quadratic_torque(spin_rate, slip):
    return spin_rate * slip * abs(slip), -2.0 * spin_rate * abs(slip)


@spin_up.register
def _(force: OceanDrag, at, k, omega):
    return quadratic_torque(row(at, SPIN_RATE, k), row(at, HALF_CURL, k) - omega)


@spin_up.register
def _(force: AirDrag, at, k, omega):
    return quadratic_torque(row(at, SPIN_RATE, k), row(at, HALF_CURL, k) - omega)


def speed_bound(forces: tuple[Force, ...], at: Sequence[np.ndarray], speed: float) -> float:
    """Upper bound on the speed [m/s] that floes moving at `speed` now can reach under these forces.

    In water it is the speed at which the ocean's drag balances the wind and the other forces, for the fastest floe.

    at : blocked tables
    """
    tables = {type(force): here for force, here in zip(forces, at, strict=True)}
    ocean, air = tables.get(OceanDrag), tables.get(AirDrag)
    wind = 0.0 if air is None else _fastest(air)
    push = 0.0
    for force in forces:
        if isinstance(force, Tilt):
            push += force.gravity * _fastest(tables[Tilt])
        elif isinstance(force, GeostrophicTilt):
            push += abs(force.parameter) * _fastest(tables[GeostrophicTilt])
        elif isinstance(force, BodyForce):
            push += float(np.hypot(force.x, force.y))
        elif type(force) not in _AT_REST:
            push += _largest_push(force, tables[type(force)])
    driven = -1.0 if ocean is None else _driven(ocean, air, push)
    if driven < 0.0:
        return max(speed, wind)
    return max(speed, _fastest(ocean)) + (driven if push else min(driven, wind))


# Forces that do not push floes at rest, or (drag) have bounds of their own.
_AT_REST = OceanDrag, AirDrag, Coriolis, CoriolisField


@in_place
def _largest_push(force, at):
    """Largest acceleration that a force gives to floes at rest [m/s²]."""
    largest2 = 0.0
    for block in range(at.shape[0]):
        for k in range(BLOCK):
            a = acceleration(force, at[block], k, 0.0, 0.0)
            largest2 = max(largest2, a.x * a.x + a.y * a.y)
    return np.sqrt(largest2)


@in_place
def _fastest(at):
    """Largest speed of a fluid, or largest slope, at the floes."""
    fastest2 = 0.0
    for block in range(at.shape[0]):
        here = at[block]
        for k in range(BLOCK):
            u, v = row(here, FLUID_U, k), row(here, FLUID_V, k)
            fastest2 = max(fastest2, u * u + v * v)
    return np.sqrt(fastest2)


@in_place
def _driven(ocean, air, push):
    """Largest speed through the water [m/s] at which its drag balances the wind and a push [m/s²]; −1 if no floe is in water."""
    driven2 = -1.0
    for block in range(ocean.shape[0]):
        water = ocean[block]
        for k in range(BLOCK):
            pull = push + drag_at_rest(air, block, k)
            rate = row(water, RATE, k)
            driven2 = max(driven2, pull / rate if rate > 0.0 else -1.0)
    return np.sqrt(driven2) if driven2 >= 0.0 else -1.0


@dispatched
def drag_at_rest(at, block, k):
    """Acceleration [m/s²] that the drag of a fluid would give to floe k of a block at rest; 0 without that fluid."""
    u, v = row(at[block], FLUID_U, k), row(at[block], FLUID_V, k)
    return row(at[block], RATE, k) * (u * u + v * v)


@drag_at_rest.register
def _(at: None, block, k):
    return 0.0


TURN = 16.0  # in one sub-step a floe then turns by a sixteenth of a radian at most, and is late by 3e-4 of that


def add_fastest_rate(
    force: Force, at: np.ndarray, speed: float, spin: float, rate: np.ndarray
) -> None:
    """Add an upper bound on |J| [1/s] for each floe while none moves faster than `speed` or spins faster than `spin`.

    The Coriolis rate counts `TURN` times: a step is exact for the drag of one fluid, but not for a rotation.
    at : blocked table; rate : (blocks, BLOCK)
    """
    if isinstance(force, OceanDrag | AirDrag):
        _add_fastest_drag(at, speed, spin, rate)
    elif isinstance(force, Coriolis):
        rate += TURN * abs(force.parameter)
    elif isinstance(force, CoriolisField):
        rate += TURN * np.abs(at[:, PARAMETER * BLOCK :])
    elif not isinstance(force, Tilt | GeostrophicTilt | BodyForce):
        _add_rate_at(force, at, speed, rate)


@in_place
def _add_rate_at(force, at, speed, rate):
    """Add the largest |J| of a force at this speed in four directions, along the axes."""
    for block in range(at.shape[0]):
        here, fastest = at[block], rate[block]
        for k in range(BLOCK):
            largest2 = 0.0
            for u, v in ((speed, 0.0), (-speed, 0.0), (0.0, speed), (0.0, -speed)):
                a = acceleration(force, here, k, u, v)
                largest2 = max(largest2, a.xx * a.xx + a.xy * a.xy + a.yx * a.yx + a.yy * a.yy)
            fastest[k] += np.sqrt(largest2)


@in_place
def _add_fastest_drag(at, speed, spin, rate):
    for block in range(at.shape[0]):
        here, fastest = at[block], rate[block]
        turns = here.size > SPIN_RATE * BLOCK
        for k in range(BLOCK):
            u, v = row(here, FLUID_U, k), row(here, FLUID_V, k)
            drag = 2.0 * (speed + np.sqrt(u * u + v * v)) * row(here, RATE, k)
            if turns:
                twist = 2.0 * (spin + abs(row(here, HALF_CURL, k))) * row(here, SPIN_RATE, k)
                drag = max(drag, twist)
            fastest[k] += drag


# ---- the sum over the forces that a scene lists: unrolled by the compiler, nothing for none ---------

U, V, OMEGA = (row * BLOCK for row in range(3))  # rows of the buffer of a block of floes
FORCE_BUFFER = 3 * BLOCK


def _blocks(floes: int, width: int) -> np.ndarray:
    """A zero table for so many floes: two blocks at least.

    The rows of a single block would be contiguous, and all that reads them compiled anew for them.
    """
    return np.zeros((max(-(-floes // BLOCK), 2), width))


def by_block(at: np.ndarray, number: np.ndarray) -> np.ndarray:
    """A table in the layout of the kernels: one row per block of the given floes, holding the rows of the table.

    Only constants of the floes (K/m, K/J) are filled in; impulse, work and the fields of a fluid are 0.
    """
    blocks = _blocks(len(number), len(at) * BLOCK)
    _into_blocks(at, number, blocks)
    return blocks


@in_place
def _into_blocks(at, number, blocks):
    for block in range(blocks.shape[0]):
        here, first = blocks[block], block * BLOCK
        for name in range(RATE, at.shape[0]):
            for k in range(min(BLOCK, number.size - first)):
                here[name * BLOCK + k] = at[name, np.uintp(number[first + k])]


def in_order(at: np.ndarray, place: np.ndarray) -> np.ndarray:
    """A blocked table of the floes at these places, in this order.

    place : −1 for a new floe, which has read no fluid yet and feels no drag
    """
    blocks = _blocks(len(place), at.shape[1])
    _in_order(at, place, blocks)
    return blocks


@in_place
def _in_order(at, place, blocks):
    for k in range(place.size):
        if place[k] >= 0:
            there, here = at[place[k] // BLOCK], blocks[k // BLOCK]
            for name in range(at.shape[1] // BLOCK):
                here[name * BLOCK + k % BLOCK] = there[name * BLOCK + place[k] % BLOCK]


def lanes(at: np.ndarray, name: int) -> np.ndarray:
    """One row of a blocked table, (blocks, BLOCK), as a view."""
    return at[:, name * BLOCK : (name + 1) * BLOCK]


@in_place
def given(at):
    """Impulse x, y [N s] and work [J] that a force gave to all floes, from its blocked table."""
    x, y, work = 0.0, 0.0, 0.0
    for block in range(at.shape[0]):
        here = at[block]
        for k in range(BLOCK):
            x += row(here, X, k)
            y += row(here, Y, k)
            work += row(here, WORK, k)
    return x, y, work


def accelerations(forces, at, block, k, u, v):
    """Acceleration a and derivative J of each force, for floe k of a block."""
    return tuple(
        acceleration(f, table[block], k, u, v) for f, table in zip(forces, at, strict=True)
    )


@overload(accelerations, jit_options=IN_PLACE)
def _accelerations(forces, at, block, k, u, v):
    if len(forces) == 0:
        return lambda forces, at, block, k, u, v: ()
    return lambda forces, at, block, k, u, v: (
        acceleration(forces[0], at[0][block], k, u, v),
        *accelerations(forces[1:], at[1:], block, k, u, v),
    )


def total(a):
    """The sum of a and of J over the forces."""
    return Push(*map(sum, zip(NONE, *a, strict=True)))


@overload(total, jit_options=IN_PLACE)
def _total(a):
    if len(a) == 0:
        return lambda a: NONE

    def unrolled(a):
        one, other = a[0], total(a[1:])
        return Push(
            one.x + other.x, one.y + other.y,
            one.xx + other.xx, one.xy + other.xy, one.yx + other.yx, one.yy + other.yy,
        )  # fmt: skip

    return unrolled


def book(a, at, block, k, u, v, du, dv, mass):
    """Book the impulse m Δt (a + ½ J δu) of each force on a floe, and its work; mass: m Δt [kg s]."""
    for one, table in zip(a, at, strict=True):
        book_one(one, table[block], k, u, v, du, dv, mass)


@overload(book, jit_options=IN_PLACE)
def _book(a, at, block, k, u, v, du, dv, mass):
    if len(a) == 0:
        return lambda a, at, block, k, u, v, du, dv, mass: None

    def unrolled(a, at, block, k, u, v, du, dv, mass):
        book_one(a[0], at[0][block], k, u, v, du, dv, mass)
        book(a[1:], at[1:], block, k, u, v, du, dv, mass)

    return unrolled


@inner
def book_one(a, at, k, u, v, du, dv, mass):
    x = mass * (a.x + 0.5 * (a.xx * du + a.xy * dv))
    y = mass * (a.y + 0.5 * (a.yx * du + a.yy * dv))
    at[np.uintp(X * BLOCK + k)] += x
    at[np.uintp(Y * BLOCK + k)] += y
    at[np.uintp(WORK * BLOCK + k)] += x * (u + 0.5 * du) + y * (v + 0.5 * dv)


def torques(forces, at, block, k, omega):
    """Angular acceleration by each force, and its derivative, for floe k of a block."""
    return tuple(spin_up(f, table[block], k, omega) for f, table in zip(forces, at, strict=True))


@overload(torques, jit_options=IN_PLACE)
def _torques(forces, at, block, k, omega):
    if len(forces) == 0:
        return lambda forces, at, block, k, omega: ()
    return lambda forces, at, block, k, omega: (
        spin_up(forces[0], at[0][block], k, omega),
        *torques(forces[1:], at[1:], block, k, omega),
    )


def total_spin(a):
    """The sum of the angular accelerations, and of their derivatives, over the forces."""
    return tuple(map(sum, zip((0.0, 0.0), *a, strict=True)))


@overload(total_spin, jit_options=IN_PLACE)
def _total_spin(a):
    if len(a) == 0:
        return lambda a: (0.0, 0.0)

    def unrolled(a):
        (alpha, slope), others = a[0], total_spin(a[1:])
        return alpha + others[0], slope + others[1]

    return unrolled


def book_spin(a, at, block, k, omega, change, inertia):
    """Book the work of each torque; inertia: J Δt [kg m² s]."""
    for (alpha, slope), table in zip(a, at, strict=True):
        book_torque(alpha, slope, table[block], k, omega, change, inertia)


@overload(book_spin, jit_options=IN_PLACE)
def _book_spin(a, at, block, k, omega, change, inertia):
    if len(a) == 0:
        return lambda a, at, block, k, omega, change, inertia: None

    def unrolled(a, at, block, k, omega, change, inertia):
        book_torque(a[0][0], a[0][1], at[0][block], k, omega, change, inertia)
        book_spin(a[1:], at[1:], block, k, omega, change, inertia)

    return unrolled


@inner
def book_torque(alpha, slope, at, k, omega, change, inertia):
    twist = inertia * (alpha + 0.5 * slope * change)
    at[np.uintp(WORK * BLOCK + k)] += twist * (omega + 0.5 * change)
