"""Forces other than contacts: a new force goes here, and only here.

A force is a law (a few numbers), what it needs at each floe (`at_floes`), its acceleration with the exact
derivative in the velocity (`acceleration`), and a bound on its rate (`rate`).  All forces of a scene act
together in one linearly implicit step,

    (1 − Δt/2 Σ J) δu = Δt Σ a(u),        J = ∂a/∂u,

which is second order, gives the exact solution of quadratic drag, Δu/(1 + K|Δu|Δt), and stands still
exactly in equilibrium.  The impulse of each force in that step, m Δt (a + ½ J δu), is booked for each
floe: it is what the ocean and the air get back.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba.extending import overload

from floebmi.kernels import dispatched, jit
from floebmi.quantities import NonNegative, Positive


class OceanDrag(NamedTuple):
    """Quadratic drag of the ocean on a floe's bottom and side (eq. ocean-drag).

    Parameters
    ----------
    density : ρ_o [kg/m³]
    vertical : c_v,o [1], drag coefficient of the side, on 2 r D
    horizontal : c_h,o [1], drag coefficient of the bottom, on r²
    """

    density: Positive = 1000.0
    vertical: NonNegative = 0.14
    horizontal: NonNegative = 1.6e-4


class AirDrag(NamedTuple):
    """Quadratic drag of the wind on a floe's top and freeboard (eq. air-drag).

    Parameters
    ----------
    density : ρ_a [kg/m³]
    vertical : c_v,a [1], on 2 r (h − D)
    horizontal : c_h,a [1], on r²
    """

    density: Positive = 1.3
    vertical: NonNegative = 0.064
    horizontal: NonNegative = 8.0e-5


class Coriolis(NamedTuple):
    """Coriolis acceleration, f (v, −u) (eq. coriolis).

    Parameters
    ----------
    parameter : f [1/s], positive in the northern hemisphere
    """

    parameter: float


class CoriolisField(NamedTuple):
    """Coriolis acceleration with a parameter given on the ocean's grid (`model.ocean.coriolis`)."""


class Tilt(NamedTuple):
    """Sea-surface tilt, −g ∇ζ; the slope is given on the ocean's grid (eq. sea-surface-tilt).

    Parameters
    ----------
    gravity : g [m/s²]
    """

    gravity: Positive = 9.81


class BodyForce(NamedTuple):
    """A uniform acceleration [m/s²] (eq. body-force)."""

    x: float = 0.0
    y: float = 0.0


Force = OceanDrag | AirDrag | Coriolis | CoriolisField | Tilt | BodyForce

ACCOUNTS: dict[type, str] = {  # of each force, its line in the ledger
    OceanDrag: "ocean drag",
    AirDrag: "wind",
    Coriolis: "Coriolis",
    CoriolisField: "Coriolis",
    Tilt: "sea-surface tilt",
    BodyForce: "body force",
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
    """Equivalent C_d [1] of a floe's area, f = ρ C_d π r² Δv|Δv|; side: draft or freeboard [m]."""
    return drag.vertical * 2 * side / radius + drag.horizontal


# ---- what a force needs at each floe ----------------------------------------------------------------


# A force at the floes is one record a floe (records, unlike tuples of arrays, cost a kernel nothing to hand on):
# x, y, work: what the force gave to the floe since the records were made [N s], [J]
# u, v: velocity of the fluid [m/s], or slope [1];  rate: K/m [1/m], or f [1/s]
# spin: half the curl [1/s];  spin_rate: K/J of the torque [1]
BOOKED = ("x", "y", "work")


def at_floes(
    force: Force,
    radius: np.ndarray,
    thickness: np.ndarray,
    draft: np.ndarray,
    ice_density: float,
    rotation: bool,
    land: np.ndarray,
) -> np.ndarray:
    """Allocate what a force needs at n floes, and nothing else; nothing drags on land.

    Returns
    -------
    Record array of shape (n,) with the fields x, y, work and those that the force reads.
    """
    drag = isinstance(force, OceanDrag | AirDrag)
    reads = {Tilt: ("u", "v"), CoriolisField: ("rate",)}.get(type(force), ())
    if drag:
        reads = ("u", "v", "rate", "spin", "spin_rate") if rotation else ("u", "v", "rate")
    names = (*BOOKED, *reads)
    at = np.zeros(len(radius), [(name, np.float64) for name in names]).view(np.recarray)
    if drag:
        side = draft if isinstance(force, OceanDrag) else thickness - draft
        mass_per_area = np.where(land, np.inf, ice_density * thickness)
        at.rate = force.density * bulk_coefficient(force, radius, side) / mass_per_area
        if rotation:  # eqs. ocean-torque, air-torque, over J = m r²/2
            arm = radius * force.horizontal / 5 + side * force.vertical
            at.spin_rate = 2 * force.density * arm / mass_per_area
    return at


def without_fluid(at: np.ndarray) -> np.ndarray:
    """The same floes before they have met a fluid: no drag until it is read at them."""
    for name in ("rate", "spin_rate"):
        if name in at.dtype.names:
            at[name] = 0.0
    return at


# ---- the laws in the kernel -------------------------------------------------------------------------


class Push(NamedTuple):
    """Acceleration [m/s²] and its derivative in the velocity [1/s]."""

    x: float
    y: float
    xx: float
    xy: float
    yx: float
    yy: float


@dispatched
def acceleration(force, at, k, u, v):
    """Acceleration of floe k at velocity (u, v)."""
    raise TypeError(f"no acceleration for {type(force).__name__}")


@jit
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
    return quadratic_drag(at[k].rate, at[k].u - u, at[k].v - v)


@acceleration.register
def _(force: AirDrag, at, k, u, v):
    return quadratic_drag(at[k].rate, at[k].u - u, at[k].v - v)


@acceleration.register
def _(force: Coriolis, at, k, u, v):
    f = force.parameter
    return Push(f * v, -f * u, 0.0, f, -f, 0.0)


@acceleration.register
def _(force: CoriolisField, at, k, u, v):
    f = at[k].rate
    return Push(f * v, -f * u, 0.0, f, -f, 0.0)


@acceleration.register
def _(force: Tilt, at, k, u, v):
    return Push(-force.gravity * at[k].u, -force.gravity * at[k].v, 0.0, 0.0, 0.0, 0.0)


@acceleration.register
def _(force: BodyForce, at, k, u, v):
    return Push(force.x, force.y, 0.0, 0.0, 0.0, 0.0)


@dispatched
def spin_up(force, at, k, omega):
    """Angular acceleration of floe k [1/s²] and its derivative [1/s]; none but from fluids."""
    return 0.0, 0.0


@jit
def quadratic_torque(spin_rate, slip):
    return spin_rate * slip * abs(slip), -2.0 * spin_rate * abs(slip)


@spin_up.register
def _(force: OceanDrag, at, k, omega):
    return quadratic_torque(at[k].spin_rate, at[k].spin - omega)


@spin_up.register
def _(force: AirDrag, at, k, omega):
    return quadratic_torque(at[k].spin_rate, at[k].spin - omega)


def speed_bound(forces: tuple[Force, ...], at: Sequence[np.ndarray], speed: float) -> float:
    """Bound on the speed [m/s] that floes moving at `speed` can reach: fluids drag them no faster."""
    water, wind, push = 0.0, 0.0, 0.0
    drag, wind_drag = 0.0, 0.0
    for force, here in zip(forces, at, strict=True):
        fastest = 0.0
        if "u" in here.dtype.names:
            fastest = float(np.sqrt((here.u**2 + here.v**2).max(initial=0.0)))
        if isinstance(force, OceanDrag):
            water, drag = fastest, here.rate[here.rate > 0].min(initial=np.inf)
        elif isinstance(force, AirDrag):
            wind, wind_drag = fastest, here.rate.max(initial=0.0)
        elif isinstance(force, Tilt):
            push += force.gravity * fastest
        elif isinstance(force, BodyForce):
            push += float(np.hypot(force.x, force.y))
    if drag > 0 and np.isfinite(drag):  # ocean drag balances wind and the rest
        driven = np.sqrt((wind_drag * wind**2 + push) / drag)
        return max(speed, water) + float(min(driven, wind) if not push else driven)
    return max(speed, wind)


def fastest_rate(force: Force, at: np.ndarray, speed: float, spin: float) -> float:
    """Bound on |J| [1/s] while floes move no faster than `speed` and spin no faster than `spin`."""
    if isinstance(force, OceanDrag | AirDrag):
        fluid = float(np.sqrt((at.u**2 + at.v**2).max(initial=0.0)))
        rate = 2 * (speed + fluid) * at.rate.max(initial=0.0)
        if "spin" in at.dtype.names:
            turning = spin + np.abs(at.spin).max(initial=0.0)
            rate = max(rate, 2 * turning * at.spin_rate.max(initial=0.0))
        return float(rate)
    if isinstance(force, Coriolis):
        return abs(force.parameter)
    if isinstance(force, CoriolisField):
        return float(np.abs(at.rate).max(initial=0.0))
    return 0.0


# ---- the sum over the forces that a scene lists: unrolled by the compiler, nothing for none ---------


def total_acceleration(forces, at, k, u, v):
    """Σ a and Σ J over the forces."""
    total = Push(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for force, here in zip(forces, at, strict=True):
        total = _plus(total, acceleration(force, here, k, u, v))
    return total


def total_spin_up(forces, at, k, omega):
    """Σ angular acceleration and its derivative over the forces."""
    total = 0.0, 0.0
    for force, here in zip(forces, at, strict=True):
        one = spin_up(force, here, k, omega)
        total = total[0] + one[0], total[1] + one[1]
    return total


def book(forces, at, k, u, v, du, dv, impulse):
    """Book the impulse and work of each force on floe k; impulse is m Δt [kg s]."""
    for force, here in zip(forces, at, strict=True):
        _book_one(force, here, k, u, v, du, dv, impulse)


def book_spin(forces, at, k, omega, change, impulse):
    """Book the work of each force's torque on floe k; impulse is J Δt [kg m² s]."""
    for force, here in zip(forces, at, strict=True):
        _book_one_spin(force, here, k, omega, change, impulse)


@jit
def _plus(a, b):
    return Push(a.x + b.x, a.y + b.y, a.xx + b.xx, a.xy + b.xy, a.yx + b.yx, a.yy + b.yy)


@jit
def _book_one(force, at, k, u, v, du, dv, impulse):
    a = acceleration(force, at, k, u, v)
    x = impulse * (a.x + 0.5 * (a.xx * du + a.xy * dv))
    y = impulse * (a.y + 0.5 * (a.yx * du + a.yy * dv))
    at[k].x += x
    at[k].y += y
    at[k].work += x * (u + 0.5 * du) + y * (v + 0.5 * dv)


@jit
def _book_one_spin(force, at, k, omega, change, impulse):
    alpha, slope = spin_up(force, at, k, omega)
    at[k].work += impulse * (alpha + 0.5 * slope * change) * (omega + 0.5 * change)


@overload(total_acceleration)
def _total_acceleration(forces, at, k, u, v):
    if len(forces) == 0:
        return lambda forces, at, k, u, v: Push(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    return lambda forces, at, k, u, v: _plus(
        acceleration(forces[0], at[0], k, u, v),
        total_acceleration(forces[1:], at[1:], k, u, v),
    )


@overload(total_spin_up)
def _total_spin_up(forces, at, k, omega):
    if len(forces) == 0:
        return lambda forces, at, k, omega: (0.0, 0.0)

    def total(forces, at, k, omega):
        one = spin_up(forces[0], at[0], k, omega)
        rest = total_spin_up(forces[1:], at[1:], k, omega)
        return one[0] + rest[0], one[1] + rest[1]

    return total


@overload(book)
def _book(forces, at, k, u, v, du, dv, impulse):
    if len(forces) == 0:
        return lambda forces, at, k, u, v, du, dv, impulse: None

    def each(forces, at, k, u, v, du, dv, impulse):
        _book_one(forces[0], at[0], k, u, v, du, dv, impulse)
        book(forces[1:], at[1:], k, u, v, du, dv, impulse)

    return each


@overload(book_spin)
def _book_spin(forces, at, k, omega, change, impulse):
    if len(forces) == 0:
        return lambda forces, at, k, omega, change, impulse: None

    def each(forces, at, k, omega, change, impulse):
        _book_one_spin(forces[0], at[0], k, omega, change, impulse)
        book_spin(forces[1:], at[1:], k, omega, change, impulse)

    return each
