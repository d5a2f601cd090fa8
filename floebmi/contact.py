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
    """Tangential force f_t on i, the slip remembered, the energy lost (eq. coulomb-friction)."""
    k_t = k_n * stiffness_ratio(friction)
    tried = slip + slip_rate * dt
    limit = friction.coefficient * max(f_n, 0.0) / k_t
    kept = min(max(tried, -limit), limit)
    # the force is formed from the slip that is kept, so that forming it again gives the same bits;
    # the loss is what the mean force of the step does along the part of the slip that slid
    return -k_t * kept, kept, 0.5 * k_t * (slip + kept) * (tried - kept)


@tangential.register
def _(friction: None, k_n, f_n, slip, slip_rate, dt):
    return 0.0, 0.0, 0.0


@dispatched
def damping(dashpot, k_n, inverse_mass):
    """Dashpot coefficient c [N s/m] of a pair (eq. dashpot); inverse_mass = 1/m_i + 1/m_j."""
    return 2.0 * dashpot.damping_ratio * np.sqrt(k_n / max(inverse_mass, 1e-300))


@damping.register
def _(dashpot: None, k_n, inverse_mass):
    return 0.0


@jit
def pair_force(
    law, gap, opening, slip_rate, r_i, r_j, h_i, h_j, inverse_mass, slip, bonded, damped_before, dt
):
    """The contact law: gap δ [m] and its rate, slip rate [m/s], and what the pair remembers.

    Losses are what the mean of the force before and now does along the way between them, which is what
    the two half kicks of a step do.
    """
    k_n = stiffness(law.elastic, h_i, h_j)
    mean_radius = 2.0 * r_i * r_j / (r_i + r_j)
    now_bonded = hold(law.bonds, gap, law.elastic.youngs_modulus, mean_radius, bonded)
    touching = gap < 0.0 or now_bonded > 0.0
    elastic = -k_n * gap if touching else 0.0
    c = damping(law.dashpot, k_n, inverse_mass)
    both = elastic - c * opening
    # unless frozen together, floes do not pull each other as they part
    f_n = (both if now_bonded > 0.0 else max(both, 0.0)) if touching else 0.0
    f_t, kept, friction_loss = tangential(law.friction, k_n, f_n, slip, slip_rate, dt)
    bond_loss = 0.5 * k_n * gap * gap if bonded > 0.0 and not touching else 0.0
    dashpot_loss = -0.5 * (damped_before + f_n - elastic) * opening * dt
    return PairForce(
        f_n, f_t, kept, now_bonded, f_n - elastic, friction_loss, dashpot_loss, bond_loss
    )
