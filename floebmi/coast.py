"""Coasts: land as polygons, and its shore as a line of fixed floes that moving floes cannot cross.

The fixed floes obey the same contact law as all others, so landfast ice, friction along a shore and
arches in a strait need no separate law.  A disc of radius R that touches the coastline from the
land side has its centre on the coastline shifted inland by R.  Discs less than R apart on that line
form a shore whose envelope follows the coastline.  Capes and spits too narrow for R get discs
of R/2, R/4 and R/8; even narrower ones get discs of R/8 centred on the coastline itself, so the shore
extends beyond the coastline by R/8 at most.
"""

import itertools
import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from floebmi.errors import InputError, in_line, warn
from floebmi.files import path_of
from floebmi.floes import COAST, Floes
from floebmi.projection import check_projection, to_plane
from floebmi.quantities import FARTHEST, check_length, is_number, unmasked

if TYPE_CHECKING:
    import shapely

    from floebmi.boundaries import Domain

SPACING = 0.8  # of centres along the shore, in radii
LINED = 1.1  # a place on the coastline is lined by a centre nearer than this, in radii
LONGEST = 0.25  # edge of a polygon in longitude and latitude that is drawn straight in the plane [degrees]
FINE = 2  # points of a coastline per smallest radius; land of a finer one is shrunk step by step
SMALLEST = 3  # the narrowest capes get discs of radius / 2**SMALLEST


class Coast(NamedTuple):
    """Land and its shore, made by `from_land_fraction`, `from_polygons` or `from_geojson` of this module.

    Pass the shore to a model together with the ice, `Floes.concatenate([ice, coast.floes])`; `scatter` and
    `from_field` keep off the land given as `land=coast`.

    Attributes
    ----------
    floes : fixed floes that line the shore
    polygons : closed rings of shape (k, 2) [m]; a ring inside another is a lake, one in a lake an
        island
    """

    floes: Floes
    polygons: list[np.ndarray]


def from_land_fraction(
    x: ArrayLike,
    y: ArrayLike,
    fraction: ArrayLike,
    radius: float,
    thickness: float = 10.0,
    threshold: float = 0.5,
    period: tuple[float | None, float | None] = (None, None),
) -> Coast:
    """The coast where a gridded land fraction crosses a threshold.

    The outermost cells are extended outwards, so that the shore reaches the rim of the grid and
    one radius beyond it; no floes line the rim itself.  In a periodic direction the grid continues
    with the cells of the other side, so that land that ends at the seam has its shore there.

    Parameters
    ----------
    x, y : cell centres [m], as axes (nx,), (ny,), or as arrays (ny, nx) for a curvilinear grid; the
        axes may also be cell edges (nx + 1,), (ny + 1,)
    fraction : area fraction of land, 0 to 1, shape (ny, nx)
    radius : radius of the floes on the shore [m]
    thickness : thickness of these floes [m]; the contact stiffness depends on the thinner of the two
        floes, so it should be at least that of the thickest moving floe
    threshold : land fraction that defines the coastline [1]
    period : lengths of the period along x and y [m], None where not periodic; the grid spans one period

    Raises
    ------
    InputError
        for shapes that do not match and fractions that are not between 0 and 1.
    """
    import contourpy
    import shapely

    fraction = unmasked(fraction)
    if fraction.ndim != 2 or min(fraction.shape) < 2:
        raise InputError(
            f"land fraction has shape {fraction.shape}; must be (ny, nx), at least 2 x 2"
        )
    wrong = ~((fraction >= 0) & (fraction <= 1))
    if wrong.any():
        row, column = (int(k[0]) for k in np.nonzero(wrong))
        raise InputError(
            f"land fraction[{row}, {column}] = {fraction[row, column]}; must be between 0 and 1"
        )
    if not (is_number(threshold) and 0 < threshold < 1):
        raise InputError(f"threshold = {in_line(threshold)}; must be between 0 and 1")
    if not (isinstance(period, tuple | list) and len(period) == 2):
        raise InputError(f"period = {in_line(period)}: must be two lengths, or None for none")
    for length in period:
        if length is not None:
            check_length("period", length)
    _check_size(radius, thickness)
    centres = np.stack(_centres(x, y, fraction.shape), axis=-1)
    if any((np.diff(centres, axis=axis) == 0).all(axis=-1).any() for axis in (0, 1)):
        raise InputError("x, y: neighbouring cells have the same centre; must be apart")
    rim = _outline(_extended(centres, 0.0))
    x, y = np.moveaxis(_extended(centres, 4.0 * radius, period), -1, 0)
    for axis, length in enumerate(reversed(period)):
        sides = [(1, 1) if k == axis else (0, 0) for k in (0, 1)]
        fraction = np.pad(fraction, sides, mode="edge" if length is None else "wrap")
    generator = contourpy.contour_generator(x, y, fraction, fill_type="OuterOffset")
    outlines, offsets = generator.filled(threshold, np.inf)
    pieces = []
    for points, offset in zip(outlines, offsets, strict=True):
        rings = [points[a:b] for a, b in itertools.pairwise(offset)]
        pieces.append(shapely.Polygon(rings[0], rings[1:]))
    # a contour through a saddle touches itself in a point; buffer(0) parts it there and moves
    # nothing
    land = shapely.union_all(shapely.buffer(pieces, 0.0)) if pieces else shapely.MultiPolygon()
    return _coast(land, radius, thickness, only=shapely.Polygon(rim).buffer(radius))


def from_polygons(polygons: Sequence[ArrayLike], radius: float, thickness: float = 10.0) -> Coast:
    """The coast of land given as polygons.

    Parameters
    ----------
    polygons : rings of shape (k, 2) [m], closed or not, in either direction; a ring inside another
        is a lake, one inside a lake an island; overlapping rings are merged
    radius, thickness : those of the floes on the shore [m], see `from_land_fraction`

    Raises
    ------
    InputError
        naming the polygon that crosses itself, has no area or is not a ring.
    """
    _check_size(radius, thickness)
    return _coast(land_geometry(polygons), radius, thickness)


def from_geojson(
    path: str | Path, radius: float, thickness: float = 10.0, projection: str | None = None
) -> Coast:
    """The coast of the Polygons and MultiPolygons in a GeoJSON file; other geometries are refused.

    Parameters
    ----------
    path : path of the file
    radius, thickness : those of the floes on the shore [m], see `from_land_fraction`
    projection : map projection of the domain, in any form that pyproj reads ("EPSG:3413"), for a file in
        longitude and latitude, where its edges are straight lines (RFC 7946); None for a file in metres.  A file in metres
        within 360 × 90 must name a plane in its `crs`, as GDAL and QGIS write it, to be told from one in degrees

    Raises
    ------
    InputError
        naming file and feature, for a geometry that cannot be used, or that seems to be in degrees
        although no projection is given.
    """
    import shapely

    _check_size(radius, thickness)
    features = read_features(path, projection)
    for name, geometry, _ in features:
        if geometry.geom_type not in ("Polygon", "MultiPolygon"):
            raise InputError(f"{name}: {geometry.geom_type}; must be Polygon or MultiPolygon")
    parts = [shapely.MultiPolygon(), *(geometry for _, geometry, _ in features)]
    while len(parts) > 1:  # two by two: one after the other would take the square of the time
        pairs = zip(parts[::2], parts[1::2], strict=False)
        parts = [one.union(other) for one, other in pairs] + parts[len(parts) // 2 * 2 :]
    return _coast(parts[0], radius, thickness)


def land_geometry(
    polygons: Sequence[ArrayLike], domain: "Domain | None" = None
) -> "shapely.Geometry":
    """One shapely geometry of rings as in `Coast.polygons`: the land without its lakes, with the islands in them.

    Parameters
    ----------
    polygons : rings as for `from_polygons`
    domain : land beyond one of its periodic edges is moved back across it, as floes are

    Raises
    ------
    InputError
        as `from_polygons`.
    """
    import shapely

    rings = []
    if not np.iterable(polygons):
        raise InputError(f"polygons = {polygons!r}; must be a list of rings (k, 2)")
    for number, polygon in enumerate(polygons):
        points = unmasked(polygon)
        if points.ndim != 2 or points.shape[1] != 2 or len(points) < 3:
            raise InputError(
                f"polygon {number} has shape {points.shape}; must be (k, 2) with at least 3 points"
            )
        if not np.isfinite(points).all():
            row = int(np.flatnonzero(~np.isfinite(points).all(axis=1))[0])
            raise InputError(f"polygon {number}, point {row} = {points[row]}; must be finite")
        if (far := np.abs(points).max()) > FARTHEST:
            raise InputError(
                f"polygon {number}: a coordinate of {far:g} m; must be within {FARTHEST:g} m"
            )
        ring = shapely.Polygon(points)
        if not ring.is_valid or ring.area == 0:
            raise InputError(
                f"polygon {number}: {shapely.is_valid_reason(ring)}; must not cross itself and "
                "must have an area"
            )
        rings.append(ring)
    land = shapely.MultiPolygon()
    if not rings:
        return land
    _, inner = shapely.STRtree(rings).query(rings, predicate="contains_properly")
    depth = np.bincount(inner, minlength=len(rings))
    for level in range(int(depth.max()) + 1):
        here = shapely.union_all([ring for ring, d in zip(rings, depth, strict=True) if d == level])
        land = land.difference(here) if level % 2 else land.union(here)
    return land if domain is None else _brought_back(land, domain)


def within(coast: Coast, domain: "Domain") -> Coast:
    """A coast with all its parts beyond a periodic edge of a domain moved to their images inside.

    Used to pack part of a domain, which has no periodic edges of its own.
    """
    floes = coast.floes.copy()
    floes.x[:], floes.y[:] = domain.brought_back(floes.x, floes.y)
    return Coast(floes, _rings(land_geometry(coast.polygons, domain)))


def on_land(
    polygons: Sequence[ArrayLike], x: ArrayLike, y: ArrayLike, domain: "Domain"
) -> np.ndarray:
    """Whether positions, or their images in a periodic domain, lie on land: bool, of the shape of x.

    Parameters
    ----------
    polygons, domain : as for `land_geometry`
    x, y : positions [m]
    """
    import shapely

    return shapely.contains_xy(land_geometry(polygons, domain), *domain.brought_back(x, y))


def _brought_back(land: "shapely.Geometry", domain: "Domain") -> "shapely.Geometry":
    """Land cut at the periodic edges of a domain, with the parts beyond moved to their images inside."""
    import shapely

    for axis, length in enumerate(domain.period):
        low, high = (domain.x, domain.y)[axis]
        box = np.reshape(land.bounds, (2, 2))  # (west, south), (east, north)
        if length is None or land.is_empty or (box[0, axis] >= low and box[1, axis] <= high):
            continue
        first = int(np.floor((low - box[1, axis]) / length)) + 1
        last = int(np.ceil((high - box[0, axis]) / length)) - 1
        pieces = []
        for turn in range(first, last + 1):
            window, by = box.copy(), np.zeros(2)
            by[axis] = turn * length
            window[:, axis] = np.array([low, high]) - by[axis]
            pieces.append(
                shapely.transform(land.intersection(shapely.box(*window.ravel())), by.__add__)
            )
        parts = shapely.get_parts(shapely.union_all(pieces))
        # parts that only touch the edge have no area and are dropped
        land = shapely.union_all(parts[shapely.area(parts) > 0])
    return land


def read_features(
    path: str | Path, projection: str | None = None
) -> list[tuple[str, "shapely.Geometry", dict]]:
    """Features of a GeoJSON file, each with its name for error messages, geometry [m] and properties.

    Parameters
    ----------
    path, projection : as for `from_geojson`

    Raises
    ------
    InputError
        if the file is not GeoJSON, its coordinates seem to be degrees but no projection is given, or a polygon crosses
        itself.
    """
    import shapely
    import shapely.geometry

    path = path_of("path", path)
    try:
        content = json.loads(path.read_text(encoding="utf-8-sig"))
        if content["type"] == "FeatureCollection":
            features = list(content["features"])
        else:
            features = [content if content["type"] == "Feature" else {"geometry": content}]
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    except (ValueError, KeyError, TypeError):
        raise InputError(
            f"{path}: must be GeoJSON: a FeatureCollection, Feature or geometry"
        ) from None
    found = []
    for number, feature in enumerate(features):
        name = f"{path}: feature {number}"
        try:
            geometry = shapely.geometry.shape(feature["geometry"])
            properties = dict(feature.get("properties") or {})
        except (AttributeError, KeyError, TypeError, ValueError, shapely.errors.ShapelyError):
            raise InputError(f"{name}: has no geometry that can be read") from None
        points = shapely.get_coordinates(geometry)
        if not len(points) or not np.isfinite(points).all():
            raise InputError(f"{name}: has no geometry that can be read")
        found.append((name, shapely.force_2d(geometry), properties))
    if not found:
        raise InputError(f"{path}: holds no features")
    points = shapely.get_coordinates([geometry for _, geometry, _ in found])
    if projection is not None:
        found = _projected(found, projection)
    elif (np.abs(points) <= (360, 90)).all() and not _names_a_plane(content):
        raise InputError(
            f"{path}: all coordinates are within 360 and 90, so they look like degrees; give the projection of the domain, "
            'or for metres the plane in the file: "crs": {"type": "name", "properties": {"name": "EPSG:3413"}}'
        )
    for name, geometry, _ in found:
        if (far := np.abs(shapely.get_coordinates(geometry)).max()) > FARTHEST:
            raise InputError(f"{name}: a coordinate of {far:g} m; must be within {FARTHEST:g} m")
        if not geometry.is_valid:
            reason = shapely.is_valid_reason(geometry)
            raise InputError(f"{name}: {reason}; must be a valid polygon")
    return found


def _names_a_plane(content: dict) -> bool:
    """Whether a GeoJSON file says that it is in metres, by the `crs` of GeoJSON 2008, which GDAL and QGIS still write."""
    try:
        check_projection(content["crs"]["properties"]["name"])
    except (KeyError, TypeError, InputError):
        return False
    return True


def _projected(
    features: list[tuple[str, "shapely.Geometry", dict]], projection: str
) -> list[tuple[str, "shapely.Geometry", dict]]:
    import shapely

    check_projection(projection)
    moved = []
    for name, geometry, properties in features:
        lon, lat = shapely.get_coordinates(geometry).T
        wrong = (np.abs(lon) > 540) | (np.abs(lat) > 90)
        if wrong.any():
            k = int(wrong.argmax())
            raise InputError(
                f"{name}: {lon[k]:g}, {lat[k]:g} are not longitude and latitude, as they must be if the domain has a"
                " projection"
            )
        for ring in shapely.get_rings(shapely.get_parts(geometry)):
            lon = shapely.get_coordinates(ring)[:, 0]
            west, far = lon.min(), np.abs(np.diff(lon)).max()
            if 180 < far < 360:
                warn(
                    f"{name}: an edge goes the long way round, over {far:g}° of longitude: to cross the date line write"
                    f" longitudes beyond 180, such as {west + 360:g} for {west:g}"
                )
                break
        geometry = shapely.segmentize(geometry, LONGEST)
        geometry = shapely.transform(
            geometry, lambda lon, lat: to_plane(projection, lon, lat), interleaved=False
        )
        if not np.isfinite(shapely.get_coordinates(geometry)).all():
            raise InputError(f"{name}: has points outside the projection {projection!r}")
        moved.append((name, geometry, properties))
    return moved


def _check_size(radius: float, thickness: float) -> None:
    check_length("coast radius", radius)
    check_length("coast thickness", thickness)


def _centres(x: ArrayLike, y: ArrayLike, shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Cell centres of shape (ny, nx), from axes of centres or edges, or from arrays of centres."""
    x, y = unmasked(x), unmasked(y)
    for name, values in (("x", x), ("y", y)):
        wrong = np.argwhere(~(np.abs(values) <= FARTHEST))  # NaN is wrong, too
        if wrong.size:
            place = tuple(int(k) for k in wrong[0])
            raise InputError(
                f"{name}{list(place)} = {values[place]}; must be finite, and within {FARTHEST:g} m"
            )
    if x.shape == y.shape == shape:
        return x, y
    rows = []
    for name, row, n in (("x", x, shape[1]), ("y", y, shape[0])):
        if row.shape == (n + 1,):
            row = (row[:-1] + row[1:]) / 2
        if row.shape != (n,):
            raise InputError(
                f"{name} has shape {row.shape}; must be ({n},) centres or ({n + 1},) edges for a "
                f"land fraction of shape {shape}"
            )
        rows.append(row)
    return tuple(np.meshgrid(*rows))


def _extended(
    points: np.ndarray, beyond: float, period: tuple[float | None, float | None] = (None, None)
) -> np.ndarray:
    """Points (ny, nx, 2) with one more line on each side, half a cell plus `beyond` [m] further out.

    Along a period that line is the image of the line on the other side.
    """
    for axis in (0, 1):
        points = np.moveaxis(points, axis, 0)
        along, sides = 1 - axis, []  # rows follow each other along y, columns along x
        for first, second in ((0, 1), (-1, -2)):
            if period[along] is None:
                step = points[first] - points[second]
                factor = 0.5 + beyond / np.hypot(*step.T)
                side = points[first] + factor[:, None] * step
            else:
                side = points[-1 - first].copy()
                side[:, along] += np.copysign(period[along], (points[first] - side)[:, along])
            sides.append(side)
        points = np.moveaxis(np.concatenate([sides[:1], points, sides[1:]]), 0, axis)
    return points


def _outline(points: np.ndarray) -> np.ndarray:
    """The outermost points of a grid of points (ny, nx, 2) as a ring, shape (k, 2)."""
    sides = points[0, :-1], points[:-1, -1], points[-1, :0:-1], points[:0:-1, 0]
    return np.concatenate(sides)


def _coast(
    land: "shapely.Geometry",
    radius: float,
    thickness: float,
    only: "shapely.Geometry | None" = None,
) -> Coast:
    """Line the shore of some land with floes; `only` restricts it to part of the plane."""
    import shapely
    from scipy.spatial import cKDTree

    smallest = radius / 2**SMALLEST
    shore = _along(land, smallest)
    if only is not None:
        shore = shore[shapely.contains_xy(only, shore)]
    lined = np.zeros(len(shore), bool)
    points, radii = [np.zeros((0, 2))], [np.zeros(0)]
    sizes = [radius / 2**level for level in range(SMALLEST + 1)]
    for size, inner in zip(sizes, _shrunk(land, sizes), strict=True):
        centres = _along(inner, SPACING * size)
        if not len(centres) or lined.all():
            continue
        far, _ = cKDTree(shore[~lined]).query(centres, distance_upper_bound=LINED * size)
        centres = centres[np.isfinite(far)]
        if not len(centres):
            continue
        near, _ = cKDTree(centres).query(shore, distance_upper_bound=LINED * size)
        lined |= np.isfinite(near)
        points.append(centres)
        radii.append(np.full(len(centres), size))
    # the remaining parts are narrower than the smallest disc: line them on the coastline itself
    tips = shore[~lined]
    points.append(tips)
    radii.append(np.full(len(tips), smallest))
    x, y = np.concatenate(points).T
    floes = Floes(x, y, np.concatenate(radii), thickness, motion=COAST)
    return Coast(floes, _rings(land))


def _shrunk(land: "shapely.Geometry", sizes: list[float]) -> "list[shapely.Geometry]":
    """Land without the places nearer to the shore than each of the sizes, which fall.

    Eighths of a quarter turn keep the corners of the inner lines within 0.5 % of the size.  A coastline much finer than
    the sizes is shrunk step by step, to lines as near to the true ones: a small step leaves few points for the next,
    while time and memory of a single large one grow with the square of the number of points.
    """
    import shapely

    step_by_step = shapely.get_num_coordinates(land) * sizes[-1] > FINE * land.length
    lands, done = [land], 0.0
    for size in reversed(sizes):
        start = lands[-1] if step_by_step else land
        lands.append(start.buffer((done if step_by_step else 0.0) - size, quad_segs=8))
        done = size
    return lands[:0:-1]


def _along(land: "shapely.Geometry", spacing: float) -> np.ndarray:
    """Evenly spaced points on the rings of some land, at most `spacing` apart, shape (k, 2)."""
    points = [np.zeros((0, 2))]
    for ring in _rings(land):
        reached = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(ring, axis=0).T))])
        count = int(np.ceil(reached[-1] / spacing))
        at = np.arange(count) * (reached[-1] / count)
        points.append(np.stack([np.interp(at, reached, column) for column in ring.T], axis=1))
    return np.concatenate(points)


def _rings(land: "shapely.Geometry") -> list[np.ndarray]:
    import shapely

    return [shapely.get_coordinates(ring) for ring in shapely.get_rings(shapely.get_parts(land))]
