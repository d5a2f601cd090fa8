"""Map projections: from longitude and latitude to the plane of the floes, and back.

Floes move in a plane, in metres.  A projection defines the plane: a PROJ string, an EPSG code, WKT, or
anything else that pyproj understands.  Longitude and latitude are projected as they are, without a
change of datum, since 70 N is meant to be the same place in models on a sphere and on an ellipsoid.

The directions of east and north in the plane vary from place to place.  `east_in_plane` gives the direction
of east as an angle, so that (u + i v) exp(i angle) is the vector in the plane.  This rotation preserves the
speed; for a projection that is not conformal it is the rotation nearest to the true mapping.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from functools import lru_cache, partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from floebmi.errors import InputError, in_line
from floebmi.quantities import unmasked

if TYPE_CHECKING:
    from pyproj import Proj

# Half the length of the small step that measures a direction [m]; and a latitude short of the pole,
# where east and north still exist.
_STEP = 10.0
_EARTH_RADIUS = 6_371_000.0
_NEAR_POLE = 89.99
_MOST_TURNS = 1440.0  # longitudes beyond are none [degrees]


def _proj(projection: str) -> tuple[Proj, float]:
    """The projection, and the length of its unit [m]."""
    if not isinstance(projection, Hashable):
        raise InputError(f"projection = {in_line(projection)}: must be a text, such as 'EPSG:3413'")
    return _known(projection)


@lru_cache(maxsize=32)
def _known(projection: str) -> tuple[Proj, float]:
    import pyproj

    try:
        crs = pyproj.CRS.from_user_input(projection)
    except pyproj.exceptions.CRSError as error:
        reason = str(error).split(": (")[0].splitlines()[0]
        raise InputError(
            f"projection = {projection!r}: {reason}; give a PROJ string or a code such as 'EPSG:3413'"
        ) from None
    if not crs.is_projected:
        raise InputError(
            f"projection = {projection!r}: not a plane in metres; give a projected system such as"
            " 'EPSG:3413' or centred_projection(lon, lat)"
        )
    return pyproj.Proj(crs), crs.axis_info[0].unit_conversion_factor


def check_projection(projection: str) -> str:
    """Return `projection` if pyproj knows it and it is a plane, else raise `InputError`."""
    _proj(projection)
    return projection


def same_plane(one: str | None, other: str | None) -> bool:
    """True if both projections are the same plane (None: a plane without a position on Earth)."""
    if one is None or other is None or one == other:
        return one == other
    return bool(_proj(one)[0].crs.equals(_proj(other)[0].crs))


def to_plane(
    projection: str, lon: np.ndarray | float, lat: np.ndarray | float
) -> tuple[np.ndarray, np.ndarray]:
    """x and y in the plane [m] of longitude and latitude [degrees]; NaN for places that the projection does not cover.

    One of the two may be a single number and the other an array.

    Raises
    ------
    InputError
        for an unknown projection, or one that is not a plane, and for coordinates of different shapes.
    """
    proj, metre = _proj(projection)
    lon, lat = _places(("lon", lon), ("lat", lat))
    # pyproj has no place for longitudes of more than a turn and a half, which HYCOM counts on to
    on = (np.abs(lon) > 540) & (np.abs(lon) <= _MOST_TURNS)
    x, y = proj(np.where(on, lon % 360, lon), lat)
    return _or_nan(np.multiply(x, metre)), _or_nan(np.multiply(y, metre))


def to_lonlat(
    projection: str, x: np.ndarray | float, y: np.ndarray | float
) -> tuple[np.ndarray, np.ndarray]:
    """Longitude and latitude [degrees] of places in the plane [m]; NaN where there are none.  Raises as `to_plane`."""
    proj, metre = _proj(projection)
    x, y = _places(("x", x), ("y", y))
    lon, lat = proj(x / metre, y / metre, inverse=True)
    return _or_nan(lon), _or_nan(lat)


def _places(*named: tuple[str, ArrayLike]) -> tuple[np.ndarray, ...]:
    """Coordinates as arrays of one shape, without masked values; pyproj accepts any arrays of one size, and ignores masks."""
    values = [unmasked(coordinate) for _, coordinate in named]
    try:
        return np.broadcast_arrays(*values)
    except ValueError:
        shapes = " and ".join(
            f"{name} {v.shape}" for (name, _), v in zip(named, values, strict=True)
        )
        raise InputError(f"{shapes}: must have shapes that match") from None


def _or_nan(values: np.ndarray) -> np.ndarray:
    return np.where(np.isfinite(values), values, np.nan)


def east_in_plane(projection: str, lon: np.ndarray | float, lat: np.ndarray | float) -> np.ndarray:
    """Angle [rad] from the plane's x axis to east, counter-clockwise, at each longitude and latitude [degrees].

    NaN for places that the projection does not cover.  Raises as `to_plane`.
    """
    lon, lat = _places(("lon", lon), ("lat", lat))
    on_earth = np.where(np.abs(lat) <= 90.0, lat, np.nan)
    lat = np.clip(on_earth, -_NEAR_POLE, _NEAR_POLE)
    step = np.degrees(_STEP / _EARTH_RADIUS)
    plane = partial(to_plane, projection)
    return _turn(plane, lon, lat, step / np.cos(np.radians(lat)), step)


def axes_in_plane(source: str, projection: str, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Angle [rad] from the x axis of `projection` to the x axis of `source`, at places (x, y) of `source`."""

    def plane(x, y):
        return to_plane(projection, *to_lonlat(source, x, y))

    return _turn(plane, np.asarray(x, float), np.asarray(y, float), _STEP, _STEP)


def _turn(
    plane: Callable, a: np.ndarray, b: np.ndarray, da: np.ndarray | float, db: np.ndarray | float
) -> np.ndarray:
    """The rotation nearest to the mapping's Jacobian: its columns are the images of the two unit steps."""
    (ax1, ay1), (ax0, ay0) = plane(a + da, b), plane(a - da, b)
    (bx1, by1), (bx0, by0) = plane(a, b + db), plane(a, b - db)
    return np.arctan2((ay1 - ay0) - (bx1 - bx0), (ax1 - ax0) + (by1 - by0))


def distance(lon1: np.ndarray, lat1: np.ndarray, lon2: np.ndarray, lat2: np.ndarray) -> np.ndarray:
    """Great-circle distance [m] between places in longitude and latitude [degrees] (haversine formula)."""
    phi1, phi2 = np.radians(lat1), np.radians(lat2)
    half = np.sin((phi2 - phi1) / 2) ** 2 + np.cos(phi1) * np.cos(phi2) * (
        np.sin(np.radians(np.asarray(lon2) - lon1) / 2) ** 2
    )
    return 2 * _EARTH_RADIUS * np.arcsin(np.sqrt(np.clip(half, 0, 1)))


def centred_projection(lon: float | tuple[float, float], lat: float | tuple[float, float]) -> str:
    """An equal-area projection centred on a place, or on the box (west, east) × (south, north) [degrees].

    It is Lambert's azimuthal equal-area projection: cells have their true area everywhere (in a standard polar
    stereographic plane the area is off by the map scale squared, 5 % at 79 N), and directions are correct to
    0.2 degrees within 1000 km of the centre.

    Raises
    ------
    InputError
        for anything but one or two finite numbers each, latitudes beyond 90 degrees, or latitudes in the order north, south.

    Examples
    --------
    >>> centred_projection(lon=(280, 320), lat=(46, 78))
    '+proj=laea +lat_0=62 +lon_0=-60 +datum=WGS84 +units=m +no_defs'
    """
    lon, lat = np.atleast_1d(unmasked(lon)), np.atleast_1d(unmasked(lat))
    if not all(v.shape in ((1,), (2,)) and np.isfinite(v).all() for v in (lon, lat)):
        raise InputError(
            f"centred_projection: lon = {lon}, lat = {lat}: give one number or two for each"
        )
    if np.abs(lat).max() > 90 or lat[0] > lat[-1]:
        raise InputError(
            f"centred_projection: lat = {lat}: must be (south, north) within -90 to 90 degrees"
        )
    width = (lon[-1] - lon[0]) % 360 or lon[-1] - lon[0]  # (170, -170) crosses the date line
    middle = (lon[0] + width / 2 + 180) % 360 - 180
    return f"+proj=laea +lat_0={lat.mean():.6g} +lon_0={middle:.6g} +datum=WGS84 +units=m +no_defs"
