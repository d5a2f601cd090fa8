"""Forces other than contacts: a new force goes here, and only here."""

from typing import NamedTuple

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
