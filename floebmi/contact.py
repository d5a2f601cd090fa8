"""Contact between floes: a new law goes here, and only here.

A contact law is made of parts, each a few numbers: elasticity, friction, bonds (in bonds.py), a dashpot.
A part that is `None` is not in the machine code, and what only it needs is not allocated.
"""

import math
from typing import NamedTuple

import numpy as np

from floebmi.bonds import TensileStrength, hold
from floebmi.errors import InputError
from floebmi.kernels import dispatched, jit
from floebmi.quantities import NonNegative, PoissonRatio, Positive, PositiveFraction


class Elastic(NamedTuple):
    """Linear normal elasticity, f_n = E h_min |δ| (eq. normal-elasticity).

    Parameters
    ----------
    youngs_modulus : E [Pa]
    """

    youngs_modulus: Positive = 2.0e7


class Coulomb(NamedTuple):
    """Tangential elasticity with history, limited by Coulomb friction (eq. coulomb-friction).

    Lever arms are the true distances from the centres to the contact point, so that angular momentum
    is conserved for unequal radii.

    Parameters
    ----------
    coefficient : friction coefficient μ [1]
    poisson_ratio : ν [1], sets k_t/k_n
    """

    coefficient: NonNegative = 0.3
    poisson_ratio: PoissonRatio = 0.185


class Damsgaard2018Coulomb(NamedTuple):
    """`Coulomb` as the paper ran it: both lever arms are R_ij, the harmonic mean radius."""

    coefficient: NonNegative = 0.3
    poisson_ratio: PoissonRatio = 0.185


class Restitution(NamedTuple):
    """A dashpot beside the spring, by the wanted coefficient of restitution (eq. dashpot).

    Parameters
    ----------
    coefficient : e [1], rebound speed over impact speed of two free floes
    """

    coefficient: PositiveFraction


class Dashpot(NamedTuple):
    """What `Restitution` becomes in the machine: c = 2 ζ √(k_n m_ij), m_ij the reduced mass."""

    damping_ratio: NonNegative


class Contact(NamedTuple):
    """A contact law in parts; `None` leaves a part out."""

    elastic: Elastic = Elastic()
    friction: Coulomb | Damsgaard2018Coulomb | None = None
    bonds: TensileStrength | None = None
    dashpot: Restitution | Dashpot | None = None


def frictional(
    friction: float = 0.3,
    youngs_modulus: float = 2.0e7,
    poisson_ratio: float = 0.185,
    restitution: float | None = None,
) -> Contact:
    """The paper's frictional model: elasticity, Coulomb friction, rotation; no bonds."""
    return Contact(
        Elastic(youngs_modulus),
        friction=Coulomb(friction, poisson_ratio),
        dashpot=None if restitution is None else Restitution(restitution),
    )


def cohesive(
    tensile_strength: float = 200e3,
    youngs_modulus: float = 2.0e7,
    restitution: float | None = None,
) -> Contact:
    """The paper's cohesive model: elasticity and bonds; no friction, no rotation."""
    return Contact(
        Elastic(youngs_modulus),
        bonds=TensileStrength(tensile_strength),
        dashpot=None if restitution is None else Restitution(restitution),
    )


def prepare(contact: Contact) -> Contact:
    """The law as the kernels take it: a wanted restitution becomes a damping ratio."""
    if isinstance(contact.dashpot, Restitution):
        return contact._replace(dashpot=Dashpot(damping_ratio(contact.dashpot.coefficient)))
    return contact


def damping_ratio(restitution: float) -> float:
    """ζ that gives a restitution e, when contact ends where its force vanishes, not where δ does.

    Schwager & Pöschel (2007), doi:10.1007/s10035-007-0065-z.
    """

    from scipy.optimize import brentq

    def excess(zeta: float) -> float:
        if zeta < 1.0:
            omega = math.sqrt(1.0 - zeta * zeta)
            duration = (math.pi - math.atan2(2 * zeta * omega, omega * omega - zeta * zeta)) / omega
        else:
            omega = math.sqrt(zeta * zeta - 1.0)
            duration = math.log((zeta + omega) / (zeta - omega)) / omega if omega else 2.0
        return math.exp(-zeta * duration) - restitution

    if restitution == 1.0:
        return 0.0
    highest = 1e3
    if excess(highest) > 0:
        raise InputError(f"Restitution.coefficient = {restitution}: too small; use at least 1e-6")
    return brentq(excess, 0.0, highest, xtol=1e-14)


# ---- the laws in the kernel -------------------------------------------------------------------------
# Geometry of a pair: n points from i to j, t is n turned left, gap δ < 0 is an overlap.
#
#        i ──── a_i ────┃──── a_j ──── j        d = |x_j − x_i| = a_i + a_j,  δ = d − (r_i + r_j)
#                  n →  ┃ t ↑
#
# f_n > 0 pushes the floes apart; f_t is the force on i along t; the force on i is −f_n n + f_t t,
# that on j its opposite, and both torques are f_t times the lever arm.


class PairForce(NamedTuple):
    """Force of one pair, what it remembers, and the energy [J] that it lost in this step."""

    f_n: float
    f_t: float
    slip: float
    bonded: float
    damped: float  # the dashpot's part of f_n
    blow_n: float  # impulse [N s] that ends the step beside half a step of f_n and f_t (eq. part-of-a-step)
    blow_t: float
    friction_loss: float
    dashpot_loss: float
    bond_loss: float


@jit
def stiffness(elastic, thickness_i, thickness_j):
    """k_n = E h_min [N/m] (eq. normal-elasticity)."""
    return elastic.youngs_modulus * min(thickness_i, thickness_j)


@dispatched
def stiffness_ratio(friction):
    """k_t/k_n = 2 (1 − ν²)/((2 − ν)(1 + ν)) [1] (eq. tangential-stiffness)."""
    nu = friction.poisson_ratio
    return 2.0 * (1.0 - nu * nu) / ((2.0 - nu) * (1.0 + nu))


@stiffness_ratio.register
def _(friction: None):
    return 0.0


@dispatched
def lever_arm(friction, radius, other_radius, gap):
    """Distance from a floe's centre to the contact point [m]."""
    return radius + 0.5 * gap


@lever_arm.register
def _(friction: Damsgaard2018Coulomb, radius, other_radius, gap):
    return 2.0 * radius * other_radius / (radius + other_radius)


@dispatched
def tangential(friction, k_n, f_n, slip, slip_rate, dt):
    """Tangential force on i before and now, the slip remembered, the energy lost (eq. coulomb-friction)."""
    k_t = k_n * stiffness_ratio(friction)
    tried = slip + slip_rate * dt
    limit = friction.coefficient * max(f_n, 0.0) / k_t
    kept = min(max(tried, -limit), limit)
    # the force is formed from the slip that is kept, so that forming it again gives the same bits;
    # the loss is what the mean force of the step does along the part of the slip that slid
    return -k_t * slip, -k_t * kept, kept, 0.5 * k_t * (slip + kept) * (tried - kept)


@tangential.register
def _(friction: None, k_n, f_n, slip, slip_rate, dt):
    return 0.0, 0.0, 0.0, 0.0


@dispatched
def damping(dashpot, k_n, inverse_mass):
    """Dashpot coefficient c [N s/m] of a pair (eq. dashpot); inverse_mass = 1/m_i + 1/m_j.

    There is none between two floes that nothing moves: they have no mass that a restitution could be of.
    """
    mass = 1.0 / inverse_mass if inverse_mass > 0.0 else 0.0
    return 2.0 * dashpot.damping_ratio * np.sqrt(k_n * mass)


@damping.register
def _(dashpot: None, k_n, inverse_mass):
    return 0.0


@dispatched
def time_in_contact(friction, gap, opening, dt):
    """The part of a step [s] for which floes touched, their gap changing steadily (eq. part-of-a-step)."""
    since = gap / opening if opening != 0.0 else 0.0  # the gap was zero
    if gap < 0.0:
        return min(since, dt) if opening < 0.0 else dt
    return max(dt - since, 0.0) if opening > 0.0 else 0.0


@time_in_contact.register
def _(friction: Damsgaard2018Coulomb, gap, opening, dt):
    return dt


@jit
def pair_force(
    law, gap, opening, slip_rate, r_i, r_j, h_i, h_j, inverse_mass, slip, bonded, damped_before, dt
):
    """The contact law: gap δ [m] and its rate, slip rate [m/s], and what the pair remembers.

    A step gives half of its time to the force before it and half to the force after it.  Where floes
    touched for a part of the step only, the blow takes back what was too much of that one force; a bond
    holds to the end of the step in which it breaks.  Losses are what the same forces do along the way.
    """
    k_n = stiffness(law.elastic, h_i, h_j)
    mean_radius = 2.0 * r_i * r_j / (r_i + r_j)
    was_bonded = bonded > 0.0
    now_bonded = hold(law.bonds, gap, law.elastic.youngs_modulus, mean_radius, bonded)
    touching = gap < 0.0 or now_bonded > 0.0
    elastic = -k_n * gap if touching else 0.0
    both = elastic - damping(law.dashpot, k_n, inverse_mass) * opening
    # unless frozen together, floes do not pull each other as they part
    f_n = (both if now_bonded > 0.0 else max(both, 0.0)) if touching else 0.0
    damped = f_n - elastic
    part = dt if was_bonded else time_in_contact(law.friction, gap, opening, dt)
    f_t_before, f_t, kept, friction_loss = tangential(law.friction, k_n, f_n, slip, slip_rate, part)
    f_n_before = max(damped_before - k_n * (gap - opening * dt), 0.0)
    absent = 0.5 * (dt - part)
    blow_n = -absent * (f_n if touching else f_n_before)
    blow_t = -absent * (f_t if touching else f_t_before)
    met = touching and part < dt  # a dashpot acts at once, with all its force
    blow_n += 0.5 * part * damped if met else 0.0
    breaks = was_bonded and not touching
    blow_n = -0.5 * dt * k_n * gap if breaks else blow_n
    bond_loss = 0.5 * k_n * gap * gap if breaks else 0.0
    dashpot_loss = -0.5 * ((damped if met else damped_before) + damped) * opening * part
    return PairForce(
        f_n, f_t, kept, now_bonded, damped, blow_n, blow_t, friction_loss, dashpot_loss, bond_loss
    )
