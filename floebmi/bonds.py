"""Bonds: floes that have touched freeze together and resist being pulled apart (eq. tensile-strength).

A bond may also heal (start weak and gain strength with age) and be a beam (resist shear and bending too).
Without these it has its full strength at once and resists tension only.
"""

from typing import NamedTuple

from floebmi.kernels import dispatched
from floebmi.quantities import NonNegative, PoissonRatio, Positive


class Healing(NamedTuple):
    """Healing of bonds: the strength grows with the age of the contact (eq. healing).

    Parameters
    ----------
    rate : rate λ at which the strength grows [Pa/s]
    initial : strength at the first touch [Pa]
    """

    rate: Positive
    initial: NonNegative = 0.0


class Beam(NamedTuple):
    """A bond as a beam of length and width R_ij and thickness h_min (eqs. bond-shear, bond-bending).

    Beams make the floes rotate: without rotation, a bonded pair that turns as a whole would be sheared.

    Parameters
    ----------
    shear_strength : shear strength τ_c [Pa]
    poisson_ratio : Poisson's ratio ν [1], which sets k_t/k_n; must equal that of friction, if there is friction
    """

    shear_strength: NonNegative
    poisson_ratio: PoissonRatio = 0.185


class TensileStrength(NamedTuple):
    """Bonds between floes that have touched; one breaks at the tension σ_c R_ij h_min and then loses all strength at once (eq. tensile-strength).

    Parameters
    ----------
    tensile_strength : tensile strength σ_c [Pa]
    spread : standard deviation of σ_c among the floes, relative to σ_c [1] (eq. spread); default: the same σ_c for all
    healing : growth of the strength with age; default: full strength from the first touch
    beam : resistance to shear and bending; default: none
    """

    tensile_strength: NonNegative = 200e3
    spread: Positive | None = None
    healing: Healing | None = None
    beam: Beam | None = None


@dispatched
def hold(bonds, strength, youngs_modulus, mean_radius, gap, shear, fibre, bonded, dt):
    """State of a bond after a step (eq. tensile-strength): its strength over its full strength, 1 without healing.

    0 : no bond.  −1 : a beam that broke while the floes still touch; they bond again at their next touch.
    strength : σ_c of the pair [Pa]; gap : δ [m]; shear : shear stress [Pa]; fibre : see `fibre_stress` [Pa]
    dt : 0 before the first step of an exchange, when what breaks could not be booked
    """
    raise TypeError(f"no bond law for {type(bonds).__name__}")


@hold.register
def _(bonds: None, strength, youngs_modulus, mean_radius, gap, shear, fibre, bonded, dt):
    return 0.0


@hold.register
def _(bonds: TensileStrength, strength, youngs_modulus, mean_radius, gap, shear, fibre, bonded, dt):
    share = grown(bonds.healing, strength, bonded, dt)
    # f_n = k_n δ < σ_c R_ij h_min, divided by h_min
    holds = youngs_modulus * gap < (share * strength - fibre) * mean_radius
    holds = holds and unsheared(bonds.beam, shear, share)
    holds = bonded > 0.0 and (holds or spared(bonds.beam, gap, dt))
    return share if holds or meets(bonds.beam, bonded, gap) else spent(bonds.beam, gap)


@dispatched
def grown(healing, strength, bonded, dt):
    """The fraction of its full strength that a bond has reached (eq. healing)."""
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
def spared(beam, gap, dt):
    """Whether no time passes, while floes touch: a beam too weak from their first touch breaks in the next step."""
    return dt == 0.0 and gap < 0.0


@spared.register
def _(beam: None, gap, dt):
    return False


@dispatched
def meets(beam, bonded, gap):
    """Whether two floes bond now: they touch, and have parted since their last beam broke."""
    return bonded == 0.0 and gap < 0.0


@meets.register
def _(beam: None, bonded, gap):
    return gap < 0.0


@dispatched
def spent(beam, gap):
    """State of a pair without a bond: −1 (its beam broke) as long as the floes touch, then 0."""
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
    """`held` for a pair that a beam holds, `free` for a pair that may slip."""
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
    """Tensile stress that bending adds in the outer fibre [Pa] (eq. bond-bending)."""
    return 6.0 * youngs_modulus * bending_ratio(beam) * abs(angle)


@fibre_stress.register
def _(beam: None, youngs_modulus, angle):
    return 0.0


@dispatched
def bending(beam, bonded, k_b, bent, turn_rate, dt):
    """Moment on i [N m], the bending angle that is kept [rad], and the energy lost [J] (eq. bond-bending)."""
    tried = bent + turn_rate * dt
    kept = tried if bonded > 0.0 else 0.0
    return k_b * kept, kept, 0.5 * k_b * (bent + kept) * (tried - kept)


@bending.register
def _(beam: None, bonded, k_b, bent, turn_rate, dt):
    return 0.0, 0.0, 0.0


def stretch(strength: float, youngs_modulus: float) -> float:
    """Largest gap that a bond of this strength can have, over the sum of the radii [1]; uses R_ij ≤ (r_i + r_j)/2."""
    return 0.5 * strength / youngs_modulus
