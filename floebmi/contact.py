"""Contact between floes: a new law goes here, and only here.

A contact law is made of parts, each a few numbers: elasticity, friction, bonds (in bonds.py), a dashpot.
A part that is `None` is not in the machine code, and what only it needs is not allocated.
"""

from typing import NamedTuple

from floebmi.bonds import TensileStrength
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


class Contact(NamedTuple):
    """A contact law in parts; `None` leaves a part out."""

    elastic: Elastic = Elastic()
    friction: Coulomb | Damsgaard2018Coulomb | None = None
    bonds: TensileStrength | None = None
    dashpot: Restitution | None = None


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
