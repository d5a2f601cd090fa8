"""Bonds: floes that have touched freeze together and resist being pulled apart (eq. tensile-strength)."""

from typing import NamedTuple

from floebmi.quantities import NonNegative


class TensileStrength(NamedTuple):
    """A pair that has touched holds until f_n = σ_c R_ij h_min, then loses all strength at once.

    Parameters
    ----------
    tensile_strength : σ_c [Pa]
    """

    tensile_strength: NonNegative = 200e3
