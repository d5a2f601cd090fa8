"""Bonds: floes that have touched freeze together and resist being pulled apart (eq. tensile-strength).

A bond may also heal (it starts weak) and be a beam (it resists shear and bending too); without these it is
only as strong as it is, and only against being pulled apart.
"""

from typing import NamedTuple

from floebmi.kernels import dispatched
from floebmi.quantities import NonNegative, PoissonRatio, Positive


class Healing(NamedTuple):
    """A young bond is weak: its strength grows with the age of the contact (eq. healing).

    Parameters
    ----------
    rate : growth of the strength λ [Pa/s]
    initial : strength at the first touch [Pa]
    """

    rate: Positive
    initial: NonNegative = 0.0


class Beam(NamedTuple):
    """The bond is a beam as long and as wide as R_ij, h_min thick (eqs. bond-shear, bond-bending).

    It makes floes rotate: without rotation, a bonded pair that turns as a whole would be sheared.

    Parameters
    ----------
    shear_strength : shear strength τ_c [Pa]
    poisson_ratio : Poisson's ratio ν [1], sets k_t/k_n; the same as that of friction, if there is friction
    """

    shear_strength: NonNegative
    poisson_ratio: PoissonRatio = 0.185


class TensileStrength(NamedTuple):
    """A pair that has touched holds until it pulls with σ_c R_ij h_min, then loses all strength at once (eq. tensile-strength).

    Parameters
    ----------
    tensile_strength : tensile strength σ_c [Pa]
    spread : standard deviation of σ_c among floes, over σ_c [1] (eq. spread); else all are alike
    healing : how a bond gains its strength; else it has it from the first touch
    beam : resistance to shear and bending; else there is none
    """

    tensile_strength: NonNegative = 200e3
    spread: Positive | None = None
    healing: Healing | None = None
    beam: Beam | None = None


@dispatched
def hold(bonds, strength, youngs_modulus, mean_radius, gap, shear, bent, bonded, dt):
    """What is left of a bond (eq. tensile-strength): its share of its full strength, 1 without healing.

    0: none.  −1: broken (a beam can break in compression); it bonds again at the next touch.
    strength : σ_c of the pair [Pa]; gap δ [m]; shear : stress [Pa]; bent : stress of the outer fibre [Pa]
    """
    raise TypeError(f"no bond law for {type(bonds).__name__}")


@hold.register
def _(bonds: None, strength, youngs_modulus, mean_radius, gap, shear, bent, bonded, dt):
    return 0.0


@hold.register
def _(bonds: TensileStrength, strength, youngs_modulus, mean_radius, gap, shear, bent, bonded, dt):
    share = grown(bonds.healing, strength, bonded, dt)
    # f_n = k_n δ < σ_c R_ij h_min, divided by h_min
    holds = youngs_modulus * gap < (share * strength - bent) * mean_radius
    holds = holds and unsheared(bonds.beam, shear, share)
    holds = bonded > 0.0 and holds
    return share if holds or meets(bonds.beam, bonded, gap) else spent(bonds.beam, gap)


@dispatched
def grown(healing, strength, bonded, dt):
    """The share of its strength that a bond has reached by now (eq. healing)."""
    now = max(bonded * strength, healing.initial) + healing.rate * dt
    return now / strength if now < strength else 1.0


@grown.register
def _(healing: None, strength, bonded, dt):
    return 1.0


@dispatched
def unsheared(beam, shear, share):
    """Whether a bond withstands a shear stress [Pa] (eq. bond-shear)."""
    return shear < share * beam.shear_strength


@unsheared.register
def _(beam: None, shear, share):
    return True


@dispatched
def meets(beam, bonded, gap):
    """Whether two floes that touch may bond: not while their last beam lies broken between them."""
    return bonded == 0.0 and gap < 0.0


@meets.register
def _(beam: None, bonded, gap):
    return gap < 0.0


@dispatched
def spent(beam, gap):
    """What a pair without a bond remembers: that it broke, while it touches."""
    return -1.0 if gap < 0.0 else 0.0


@spent.register
def _(beam: None, gap):
    return 0.0


@dispatched
def beam_of(bonds):
    """The beam of a bond law, or None."""
    return bonds.beam


@beam_of.register
def _(bonds: None):
    return None


@dispatched
def tied(beam, bonded, held, free):
    """One value for a pair that a beam holds, the other for a pair that is free to slip."""
    return held if bonded > 0.0 else free


@tied.register
def _(beam: None, bonded, held, free):
    return free


@dispatched
def bending_ratio(beam):
    """k_b/(k_n R_ij²) = 1/12: k_b = E I/L with I = h_min R_ij³/12 and L = R_ij (eq. bond-bending)."""
    return 1.0 / 12.0


@bending_ratio.register
def _(beam: None):
    return 0.0


@dispatched
def fibre_stress(beam, youngs_modulus, angle):
    """What bending adds to the tension of the outer fibre [Pa] (eq. bond-bending)."""
    return 6.0 * youngs_modulus * bending_ratio(beam) * abs(angle)


@fibre_stress.register
def _(beam: None, youngs_modulus, angle):
    return 0.0


@dispatched
def bending(beam, bonded, k_b, bent, turn_rate, dt):
    """Moment on i [N m], the angle remembered [rad], the energy lost [J] (eq. bond-bending)."""
    tried = bent + turn_rate * dt
    kept = tried if bonded > 0.0 else 0.0
    return k_b * kept, kept, 0.5 * k_b * (bent + kept) * (tried - kept)


@bending.register
def _(beam: None, bonded, k_b, bent, turn_rate, dt):
    return 0.0, 0.0, 0.0


def stretch(strength: float, youngs_modulus: float) -> float:
    """Largest gap of a bond of that strength, over the sum of the radii [1]: R_ij ≤ (r_i + r_j)/2."""
    return 0.5 * strength / youngs_modulus
