"""Where the points of a file are, seen from the plane of the floes.

Three kinds: two axes (longitude and latitude, or x and y of a projection), a curvilinear net of points, or a
single point whose series holds everywhere.  Each finds the source points around places in the plane
(`corners`), gives the places of a box of its points (`xy`), and says where east and its own x axis point
(`east`, `own`, angles from the plane's x axis in rad).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal, NamedTuple, final, get_args

import numpy as np

from floebmi.errors import InputError, check_word, warn
from floebmi.factors import IN_FILE, length_factor
from floebmi.fields import (
    COORDINATES,
    Box,
    File,
    coordinate,
    refuse_other_points,
    role,
    with_same_points,
)
from floebmi.interpolation import Corners, corners, half_cell_ends, holes, in_net, on_axis
from floebmi.projection import (
    axes_in_plane,
    centred_projection,
    check_projection,
    distance,
    east_in_plane,
    same_plane,
    to_lonlat,
    to_plane,
)

if TYPE_CHECKING:
    import xarray as xr

Position = Literal["auto", "mapping", "lonlat"]
# 2-D longitude and latitude [degrees], and their names
_LonLat = tuple[np.ndarray, np.ndarray, str]
_PROJ_STRINGS = ("crs_wkt", "spatial_ref", "proj4_string", "proj4", "proj4_params", "proj4text")
_SHAPES = (
    "earth_radius", "semi_major_axis", "semi_minor_axis", "inverse_flattening",
    "reference_ellipsoid_name", "horizontal_datum_name",
)  # fmt: skip


class Mapping(NamedTuple):
    """A file's own projection and the words that describe it."""

    projection: str
    text: str


@final
class Axes:
    """Points at all pairs of a row and a column coordinate: x, y [m], or longitude, latitude [degrees]."""

    def __init__(
        self,
        where: str,
        rows: np.ndarray,
        columns: np.ndarray,
        source: str | None,
        plane: str | None,
        geographic: bool,
        text: str,
    ) -> None:
        self.shape = rows.size, columns.size
        self.plane, self.text = plane, text
        self._source, self._geographic = source, geographic
        if geographic and not _monotonic(columns):
            columns = np.unwrap(columns, period=360)
        for name, axis in (("rows", rows), ("columns", columns)):
            if axis.size < 2 or not _monotonic(axis):
                raise InputError(
                    f"{where}: the coordinate along its {name} must have two values or more, all"
                    " growing or all falling"
                )
        self._rows, self._columns = rows, columns
        self._row_ends, self._column_ends = half_cell_ends(rows), half_cell_ends(columns)
        self.periodic = False
        if geographic:
            step = float(np.median(np.abs(np.diff(columns))))
            width = abs(columns[-1] - columns[0]) + step
            self.periodic = abs(width - 360) < step / 2
            if width > 360:
                low = columns.min()
                self._column_ends = low, low + 360
            # The last row of a global grid stands for the rest up to the pole.
            south, north = self._row_ends
            gap = 1.01 * np.abs(np.diff(rows)).max()
            self._row_ends = (
                -90.0 if rows.min() + 90 < gap else south,
                90.0 if 90 - rows.max() < gap else north,
            )

    def corners(self, x: np.ndarray, y: np.ndarray) -> Corners:
        """The four points around each place (x, y) (n,) [m] of the plane."""
        columns, (low, high) = self._columns, self._column_ends
        if self._geographic:
            x, y = to_lonlat(self.plane, x, y)
            if self.periodic:  # the first column again, after the last
                columns = np.append(columns, columns[0] + np.copysign(360, columns[1] - columns[0]))
                low, high = columns.min(), columns.max()
            x = low + (x - low) % 360
        elif not same_plane(self._source, self.plane):
            x, y = to_plane(self._source, *to_lonlat(self.plane, x, y))
        found = corners(
            on_axis(self._rows, y, *self._row_ends),
            on_axis(columns, x, low, high),
            (self.shape[0], columns.size),
        )
        return found._replace(column=found.column % self.shape[1])

    def _mesh(self, box: Box) -> tuple[np.ndarray, np.ndarray]:
        return np.meshgrid(self._columns[box.columns], self._rows[box.rows])

    def xy(self, box: Box) -> tuple[np.ndarray, np.ndarray]:
        """Places of a box of points in the plane [m]."""
        if self._geographic:
            return to_plane(self.plane, *self._mesh(box))
        if same_plane(self._source, self.plane):
            return self._mesh(box)
        return to_plane(self.plane, *to_lonlat(self._source, *self._mesh(box)))

    def lonlat(self, box: Box) -> tuple[np.ndarray, np.ndarray]:
        return self._mesh(box) if self._geographic else to_lonlat(self._source, *self._mesh(box))

    def east(self, box: Box) -> np.ndarray:
        """Angle from the plane's x axis to east [rad]."""
        return east_in_plane(self.plane, *self.lonlat(box))

    def own(self, box: Box) -> np.ndarray:
        """Angle from the plane's x axis to the source's x axis [rad]."""
        if self._geographic:
            return self.east(box)
        if same_plane(self._source, self.plane):
            return np.zeros(box.shape)
        return axes_in_plane(self._source, self.plane, *self._mesh(box))

    @property
    def knows_east(self) -> bool:
        return self._geographic or self._source is not None

    @property
    def east_is_x(self) -> bool:
        """True if the source's own axes are east and north."""
        return self._geographic

    def extent(self) -> str:
        """What the file covers, as text."""
        if self._geographic or self._source is None:
            names = ("lon", "lat") if self._geographic else ("x", "y")
            gaps = [
                f", nothing between {name} {axis[k]:.7g} and {axis[k + 1]:.7g}"
                for name, axis in zip(names, (self._columns, self._rows), strict=True)
                for k in holes(axis)
            ]
            return _extent(names, self._column_ends, self._row_ends) + "".join(gaps)
        rows, columns = np.linspace(*self._row_ends, 50), np.linspace(*self._column_ends, 50)
        return _lonlat_extent(*to_lonlat(self._source, *np.meshgrid(columns, rows)))


def _monotonic(axis: np.ndarray) -> bool:
    step = np.diff(axis)
    return bool((step > 0).all() or (step < 0).all())


@final
class Net:
    """Points with a place each [m], in rows and columns (a curvilinear grid).

    falls : whether the coordinates of rows and of columns fall, so that components are positive against them
    """

    knows_east = True
    east_is_x = False

    def __init__(
        self,
        where: str,
        x: np.ndarray,
        y: np.ndarray,
        plane: str,
        text: str,
        falls: tuple[bool, bool] = (False, False),
    ) -> None:
        if min(x.shape) < 2:
            raise InputError(f"{where}: {x.shape} points: two rows and two columns are the least")
        self.shape = x.shape
        self.plane, self.text = plane, text
        self.x, self.y, self.falls = x, y, falls
        self.periodic = _closes(x + 1j * y)
        self._where = where

    def corners(self, x: np.ndarray, y: np.ndarray) -> Corners:
        """The four points around each place (x, y) (n,) [m] of the plane."""
        net = self.x, self.y
        if self.periodic:  # the first column again, after the last
            net = tuple(np.hstack([points, points[:, :1]]) for points in net)
        found = corners(*in_net(*net, x, y), net[0].shape)
        return found._replace(column=found.column % self.shape[1])

    def xy(self, box: Box) -> tuple[np.ndarray, np.ndarray]:
        """Places of a box of points in the plane [m]."""
        return self.x[box], self.y[box]

    def east(self, box: Box) -> np.ndarray:
        """Angle from the plane's x axis to east [rad]."""
        return east_in_plane(self.plane, *to_lonlat(self.plane, *self.xy(box)))

    def own(self, box: Box) -> np.ndarray:
        """Angle from the plane's x axis to the columns' direction [rad], rows taken at right angles."""
        x, y = self.xy(box)
        across, along = (
            (-1 if falls else 1) * (np.gradient(x, axis=k) + 1j * np.gradient(y, axis=k))
            for k, falls in enumerate(self.falls)
        )
        if np.nanmedian((np.conj(along) * across).imag) < 0:
            raise InputError(
                f"{self._where}: rows run clockwise from columns, so the direction of its y components"
                " is unclear: turn the rows over, or give vectors = 'east-north' if they are that"
            )
        with np.errstate(invalid="ignore"):
            return np.angle(along / np.abs(along) - 1j * across / np.abs(across))

    def extent(self) -> str:
        """What the file covers, as text."""
        return _lonlat_extent(*to_lonlat(self.plane, self.x, self.y))


def _closes(z: np.ndarray) -> bool:
    """True if the first column of a net, places z = x + i y (ny, nx), follows its last as the next one would."""
    step = z[:, 0] - z[:, -1]
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.array([step / (z[:, k] - z[:, k - 1]) for k in (1, -1)]).real
    known = ratio[:, np.isfinite(ratio).all(axis=0)]
    return bool(known.size and (np.abs(np.median(known, axis=1) - 1) < 0.25).all())


@final
class Point:
    """One point; its series holds everywhere."""

    shape = (1, 1)
    periodic = False
    east_is_x = False

    def __init__(self, lon: float | None, lat: float | None, plane: str | None) -> None:
        self.lon, self.lat, self.plane = lon, lat, plane
        place = "" if lon is None else f" at lon {lon:g}, lat {lat:g}"
        self.text = f"one point{place}, the same everywhere"

    @property
    def knows_east(self) -> bool:
        return self.plane is None or self.lon is not None

    def corners(self, x: np.ndarray, y: np.ndarray) -> Corners:
        """The point, for every place."""
        zero = np.zeros((x.size, 4), np.int64)
        return Corners(zero, zero, np.broadcast_to([1.0, 0.0, 0.0, 0.0], (x.size, 4)))

    def xy(self, box: Box) -> tuple[np.ndarray, np.ndarray]:
        return np.zeros((1, 1)), np.zeros((1, 1))

    def east(self, box: Box) -> np.ndarray:
        """Angle to east [rad]; without a projection the plane's x axis is east at the point."""
        if self.plane is None:
            return np.zeros((1, 1))
        return east_in_plane(self.plane, [[self.lon]], [[self.lat]])

    def own(self, box: Box) -> np.ndarray:
        """Components along x and y of a single point are those of the plane."""
        return np.zeros((1, 1))

    def extent(self) -> str:
        return self.text


Place = Axes | Net | Point


def place_of(
    file: File,
    array: xr.DataArray,
    dims: tuple[str, ...],
    projection: str | None,
    position: Position = "auto",
    file_projection: str | None = None,
    others: Sequence[File] = (),
    mappings: Sequence[File] = (),
) -> Place:
    """Where the points of a variable's horizontal dimensions (rows, columns) are.

    Parameters
    ----------
    dims : (rows, columns), or () for a series at one point
    projection : the plane of the floes; None takes the file's own x, y
    position : "mapping" takes x, y and the projection, "lonlat" the 2-D longitude and latitude, where a file
        has both; "auto" takes x, y and warns if the two differ by more than a quarter of a cell.  Where the axes are
        themselves longitude and latitude, but differ so from those in 2-D, they are nominal (a tripolar grid's):
        "mapping" takes the axes, "auto" those in 2-D, with a warning
    file_projection : the projection of the file's x, y, where the file does not say it (or says it wrong)
    others : files that may hold the places and the grid mapping, where `file` does not
    mappings : more files that may hold the grid mapping

    Raises
    ------
    InputError
        if the file does not say where the points are, or a projection is missing.
    """
    where = f"{file.label}: {array.name}({', '.join(dims)})"
    check_word("position", position, get_args(Position))
    if projection is not None:
        check_projection(projection)
    if not dims:
        return Point(*_point(file, array), projection)
    files = with_same_points(file, others, dims)
    found = [next(filter(None, (coordinate(f, d) for f in files)), None) for d in dims]
    roles = tuple(role(*f) if f else None for f in found)
    nets = ((f, _lonlat_net(f, array, dims)) for f in files)
    holder, net = next(((f, n) for f, n in nets if n is not None), (file, None))
    refuse_other_points(file, holder, dims)
    if roles == ("lat", "lon") and not _rotated(file, array):
        rows, columns = (_values(f[1]) for f in found)
        if position == "mapping" or not _nominal(file.label, rows, columns, net, position):
            names = (str(f[1].attrs.get("long_name", "")) for f in found)
            if net is None and position == "auto" and any("nominal" in n.lower() for n in names):
                warn(
                    f"{where}: its longitude and latitude are nominal by their long_name, which are no places on"
                    " a tripolar grid: give the file that has them in 2-D along with this one, or position ="
                    " 'mapping' if they are right"
                )
            plane = _needed(projection, where, columns, rows)
            text = f"{rows.size} × {columns.size} lat, lon"
            return Axes(where, rows, columns, None, plane, True, text)
    mapping = (
        _mapping([file, *others, *mappings], array, file_projection)
        if roles == ("y", "x")
        else None
    )
    if position == "mapping" and mapping is None:
        raise InputError(f"{where}: position = 'mapping', but it has no x, y with a projection")
    if position == "lonlat" and net is None:
        raise InputError(f"{where}: position = 'lonlat', but it has no 2-D longitude and latitude")
    if roles == ("y", "x") and (mapping or net is None or projection is None):
        rows, columns = (_metres(file, *f) for f in found)
        if mapping is None and projection is not None:
            raise InputError(
                f"{where}: its x, y have no grid mapping: give file_projection, the PROJ string of its"
                " x, y, or leave out projection if they are the plane of the floes"
            )
        if net and mapping and position == "auto":
            _compare(file.label, rows, columns, mapping, net)
        if position != "lonlat":
            source, text = mapping or (None, "x, y without a projection")
            text = f"{rows.size} × {columns.size} {found[0][0]}, {found[1][0]} ({text})"
            return Axes(where, rows, columns, source, projection or source, False, text)
    if net is None:
        raise InputError(
            f"{where}: where its points are is not said: it has neither longitude and latitude nor x"
            " and y along these dimensions that go by a standard_name, units (degrees_east) or a well-known name: set"
            " those in the file, or name the file that has them along with this one"
        )
    lon, lat, names = net
    plane = _needed(projection or (mapping.projection if mapping else None), where, lon, lat)
    shape = " × ".join(str(n) for n in lon.shape)
    falls = tuple(f is not None and _falls(f[1]) for f in found)
    return Net(where, *to_plane(plane, lon, lat), plane, f"{shape} curvilinear {names}", falls)


def _values(array: xr.DataArray) -> np.ndarray:
    """The values of a coordinate, in degrees where it is in radians."""
    values = np.asarray(array.values, float)
    return np.degrees(values) if str(array.attrs.get("units")).lower()[:3] == "rad" else values


def _falls(array: xr.DataArray) -> bool:
    return array.dtype.kind in "iuf" and bool((np.diff(_values(array)) < 0).all())


def _needed(projection: str | None, where: str, lon: np.ndarray, lat: np.ndarray) -> str:
    if projection is not None:
        return projection
    west, east = np.nanmin(lon), np.nanmax(lon)
    middle = centred_projection((west + east) / 2, (np.nanmin(lat) + np.nanmax(lat)) / 2)
    raise InputError(
        f"{where}: it is given in longitude and latitude, so a projection is needed; centred on the"
        f" file it would be projection = {middle!r}"
    )


def _metres(file: File, name: str, array: xr.DataArray) -> np.ndarray:
    units = array.attrs.get("units")
    factor = 1.0 if units is None else length_factor(units, f"{file.label}: {name}", IN_FILE)
    return _values(array) * factor


def _point(file: File, array: xr.DataArray) -> tuple[float | None, float | None]:
    """Longitude and latitude of a file with one point, or None, None."""
    place = {}
    for name, variable in file.data.variables.items():
        what = role(str(name), variable)
        if what not in ("lon", "lat"):
            continue
        values = _values(file.data[name]).ravel()
        if values.size > 1 and len(variable.dims) == 1 and _is_time(file, str(variable.dims[0])):
            if np.nanmax(values) > np.nanmin(values):
                raise InputError(
                    f"{file.label}: {array.name}: its {name} changes with time: a trajectory is not read as wind or current"
                )
            values = values[:1]
        if values.size == 1:
            place[what] = float(values[0])
    return place.get("lon"), place.get("lat")


def _lonlat_net(file: File, array: xr.DataArray, dims: tuple[str, ...]) -> _LonLat | None:
    """2-D longitude and latitude along dims, and their names; None if there are none that make sense."""
    named = str(array.encoding.get("coordinates", array.attrs.get("coordinates", ""))).split()
    pairs: dict[str, list[str]] = {"lon": [], "lat": []}
    for name, variable in file.data.variables.items():
        what = role(str(name), variable)
        wide = [d for d in variable.dims if variable.sizes[d] > 1 or d in dims]
        # WRF writes them for each record
        plain = [d for d in wide if d in dims or not _is_time(file, str(d))]
        if what in pairs and sorted(plain) == sorted(dims):
            pairs[what].append(str(name))
    for what, names in pairs.items():  # those that the variable itself names come first
        names.sort(key=lambda name: (name not in named, name.lower() not in COORDINATES[what]))
    if not (pairs["lon"] and pairs["lat"]):
        return None
    lon, lat = (_flat_net(file.data[pairs[k][0]], dims) for k in ("lon", "lat"))
    places = np.isfinite(lon) & np.isfinite(lat) & (np.abs(lat) <= 90)
    # Files exist whose positions of staggered points are all zero.
    if not places.any() or (np.ptp(lon[places]) == 0 and np.ptp(lat[places]) == 0):
        return None
    lon, lat = np.where(places, lon, np.nan), np.where(places, lat, np.nan)
    return lon, lat, f"{pairs['lat'][0]}, {pairs['lon'][0]}"


def _is_time(file: File, dim: str) -> bool:
    found = coordinate(file, dim)
    return found is not None and role(*found) == "time"


def _flat_net(array: xr.DataArray, dims: tuple[str, ...]) -> np.ndarray:
    rest = [d for d in array.dims if d not in dims]
    first = _values(array.isel(dict.fromkeys(rest, 0)).transpose(*dims))
    if any(array.sizes[d] > 1 for d in rest):
        last = _values(array.isel(dict.fromkeys(rest, -1)).transpose(*dims))
        if not np.array_equal(first, last, equal_nan=True):
            raise InputError(
                f"{array.name}: changes with time: a grid that moves is not read; interpolate to one at rest first"
            )
    return first


def _mapping(files: Sequence[File], array: xr.DataArray, given: str | None) -> Mapping | None:
    """The projection of a variable's x, y: as given, or from its grid mapping in the first file that has it."""
    if given is not None:
        return Mapping(check_projection(given), "file_projection as told")
    import pyproj

    found = [(f, name) for f in files if (name := _mapping_name(f, array)) is not None]
    if not found:
        return None
    file, name = found[0]
    attrs = file.data[name].attrs
    key = next((k for k in _PROJ_STRINGS if attrs.get(k)), None)
    try:
        crs = pyproj.CRS.from_user_input(attrs[key]) if key else pyproj.CRS.from_cf(attrs)
    except (pyproj.exceptions.CRSError, KeyError) as error:
        raise InputError(
            f"{file.label}: grid mapping {name!r} is not understood ({str(error).splitlines()[0]}):"
            " give file_projection"
        ) from None
    if not crs.is_projected:
        return None
    text = f"{attrs.get('grid_mapping_name', name)} by {key or 'CF attributes'}"
    if key is None and not any(s in attrs for s in _SHAPES):
        text += ", WGS 84 taken for want of an earth shape"
    code = crs.to_epsg(min_confidence=100) if key and "wkt" in key else None
    projection = f"EPSG:{code}" if code else str(attrs[key]) if key else crs.to_wkt()
    return Mapping(projection, text)


def _mapping_name(file: File, array: xr.DataArray) -> str | None:
    """The variable that holds the grid mapping, None if there is none."""
    name = array.attrs.get("grid_mapping") or array.encoding.get("grid_mapping")
    if name is None:
        all_names = [n for n, v in file.data.variables.items() if "grid_mapping_name" in v.attrs]
        return str(all_names[0]) if len(all_names) == 1 else None
    name = str(name).split(":")[0].strip()
    return name if name in file.data.variables else None


def _rotated(file: File, array: xr.DataArray) -> bool:
    """True if the axes are degrees about a pole of the grid's own."""
    name = _mapping_name(file, array)
    kind = None if name is None else file.data[name].attrs.get("grid_mapping_name")
    return kind == "rotated_latitude_longitude"


def _nominal(
    label: str, rows: np.ndarray, columns: np.ndarray, net: _LonLat | None, position: Position
) -> bool:
    """Whether latitudes and longitudes along two axes are elsewhere than those in 2-D, and a warning if so."""
    if net is None or rows.size < 2:
        return False
    every = tuple(slice(None, None, max(1, n // 50)) for n in (rows.size, columns.size))
    lon, lat = np.meshgrid(columns[every[1]], rows[every[0]])
    away = float(np.nanmax(distance(lon, lat, net[0][every], net[1][every])))
    cell = float(distance(0.0, rows[0], 0.0, rows[-1])) / (rows.size - 1)
    if away > cell / 4 and position == "auto":
        warn(
            f"{label}: its axes of latitude and longitude and {net[2]} disagree by up to {away / 1000:.1f} km"
            f" ({away / cell:.1f} cells); {net[2]} are used: choose with position = 'mapping' (the axes) or 'lonlat'"
        )
    return away > cell / 4


def _compare(
    label: str, rows: np.ndarray, columns: np.ndarray, mapping: Mapping, net: _LonLat
) -> None:
    """Warn if x, y with the projection and 2-D longitude, latitude mean different places."""
    every = tuple(slice(None, None, max(1, n // 50)) for n in (rows.size, columns.size))
    lon, lat = to_lonlat(mapping.projection, *np.meshgrid(columns[every[1]], rows[every[0]]))
    away = float(np.nanmedian(distance(lon, lat, net[0][every], net[1][every])))
    cell = min(abs(np.diff(axis)).mean() for axis in (rows, columns) if axis.size > 1)
    if away > cell / 4:
        warn(
            f"{label}: x, y with the grid mapping and {net[2]} disagree by {away / 1000:.1f} km"
            f" ({away / cell:.1f} cells); x, y are used: choose with position = 'mapping' or 'lonlat'"
        )


def _extent(names: tuple[str, str], first: tuple[float, float], second: tuple[float, float]) -> str:
    digits, unit = (".7g", " m") if names[0] == "x" else (".1f", "")
    return ", ".join(
        f"{name} {low:{digits}} … {high:{digits}}{unit}"
        for name, (low, high) in zip(names, (first, second), strict=True)
    )


def _lonlat_extent(lon: np.ndarray, lat: np.ndarray) -> str:
    keep = np.isfinite(lon) & np.isfinite(lat)
    lon, lat = lon[keep], lat[keep]
    middle = np.degrees(np.angle(np.exp(1j * np.radians(lon)).mean()))
    lon = middle + (lon - middle + 180) % 360 - 180
    return _extent(("lon", "lat"), (lon.min(), lon.max()), (lat.min(), lat.max()))
