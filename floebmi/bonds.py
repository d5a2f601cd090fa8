"""Bonds: floes that have touched freeze together and resist being pulled apart (eq. tensile-strength)."""

from typing import NamedTuple

from floebmi.kernels import dispatched
from floebmi.quantities import NonNegative


class TensileStrength(NamedTuple):
    """A pair that has touched holds until f_n = σ_c R_ij h_min, then loses all strength at once.

    Parameters
    ----------
    tensile_strength : σ_c [Pa]
    """

    tensile_strength: NonNegative = 200e3


@dispatched
def hold(bonds, gap, youngs_modulus, mean_radius, bonded):
    """1.0 if the pair is bonded at this gap δ [m], else 0.0 (eq. tensile-strength)."""
    raise TypeError(f"no bond law for {type(bonds).__name__}")


@hold.register
def _(bonds: None, gap, youngs_modulus, mean_radius, bonded):
    return 0.0


@hold.register
def _(bonds: TensileStrength, gap, youngs_modulus, mean_radius, bonded):
    # f_n = k_n δ < σ_c R_ij h_min, divided by h_min
    holds = youngs_modulus * gap < bonds.tensile_strength * mean_radius
    return 1.0 if gap < 0.0 or (bonded > 0.0 and holds) else 0.0


def stretch(bonds: TensileStrength | None, youngs_modulus: float) -> float:
    """Largest gap of a bonded pair, over the sum of the radii [1]: R_ij ≤ (r_i + r_j)/2."""
    return 0.0 if bonds is None else 0.5 * bonds.tensile_strength / youngs_modulus
