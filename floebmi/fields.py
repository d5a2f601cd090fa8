"""Variables of CF files: search, meaning of their dimensions, and reading piece by piece.

A variable is found by the name that the user gave, else by its CF standard_name, else by a short
well-known name; two matches, or none, are an error that lists the variables.  Nothing is read until
`Field.read` requests a box of one record.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from numbers import Integral
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from floebmi.errors import InputError, check_text, choose
from floebmi.factors import LENGTHS

if TYPE_CHECKING:
    import xarray as xr


class File(NamedTuple):
    """An opened data set, and its name in errors."""

    label: str
    data: xr.Dataset


class Box(NamedTuple):
    """A block of a source's points, rows × columns."""

    rows: slice
    columns: slice

    @property
    def shape(self) -> tuple[int, int]:
        return self.rows.stop - self.rows.start, self.columns.stop - self.columns.start


class Field(NamedTuple):
    """A variable with the meaning of its dimensions.

    rows, columns : the horizontal dimensions, None if the variable is a series at one point
    time : the dimension of time, or None
    fixed : index along every other dimension (level, ensemble member …)
    """

    file: File
    array: xr.DataArray
    rows: str | None
    columns: str | None
    time: str | None
    fixed: dict[str, int]

    @property
    def name(self) -> str:
        return str(self.array.name)

    @property
    def label(self) -> str:
        return f"{self.file.label}: {self.name}"

    @property
    def dims(self) -> tuple[str, ...]:
        return tuple(d for d in (self.rows, self.columns) if d is not None)

    @property
    def shape(self) -> tuple[int, int]:
        """Sizes along rows and columns, (1, 1) for a point."""
        return tuple(self.array.sizes[d] for d in self.dims) if self.dims else (1, 1)

    def read(self, record: int, box: Box) -> np.ndarray:
        """The values of one record in a box, float64, in the units of the file (fill values: NaN)."""
        index = dict(self.fixed)
        if self.time is not None:
            index[self.time] = record
        if self.rows is not None:
            index |= {self.rows: box.rows, self.columns: box.columns}
        piece = self.array.isel(index).transpose(*self.dims)
        try:
            values = np.asarray(piece.values, float).reshape(box.shape if self.dims else (1, 1))
        except (RuntimeError, OSError) as error:  # raised by NetCDF if HDF5 cannot unpack the data
            raise InputError(
                f"{self.label}: cannot be read ({error}): is the file damaged?"
            ) from error
        return _valid(self.array, values)


def _valid(array: xr.DataArray, values: np.ndarray) -> np.ndarray:
    """The values, NaN where an attribute that xarray ignores marks them as missing.

    These are the valid range, and fill values of another type than the variable's: 1e20 as float32 is not 1e20.
    """
    low, high = _valid_range(array)
    missing = (values < low) | (values > high)
    if array.dtype == np.float32:
        told = array.encoding.get("missing_value", array.attrs.get("missing_value"))
        if np.asarray(told).dtype.kind == "f":
            missing |= np.isin(values, np.float32(told))
    return np.where(missing, np.nan, values) if missing.any() else values


def _valid_range(array: xr.DataArray) -> tuple[float, float]:
    """Lowest and highest valid value, ∓inf without attributes; integers are limits of packed values."""
    attrs, told = array.attrs, array.encoding
    step = float(told.get("scale_factor", 0.0))

    def limit(said: object, without: float) -> float:
        one = np.squeeze(np.asarray(said))
        if one.ndim or one.dtype.kind not in "iuf" or np.isnan(one):
            return without
        if one.dtype.kind == "f":
            return float(one)
        whole = int(one)
        if str(told.get("_Unsigned")).lower() == "true":
            whole %= 256**one.itemsize
        return whole * (step or 1.0) + float(told.get("add_offset", 0.0))

    both = np.ravel(attrs.get("valid_range", ()))
    said = both if both.size == 2 else (attrs.get("valid_min"), attrs.get("valid_max"))
    low, high = limit(said[0], -np.inf), limit(said[1], np.inf)
    if not low < high:
        return -np.inf, np.inf
    # packing rounds values; limits are rounded if their type differs from that of the values
    return low - 1e-6 * abs(low) - step / 2, high + 1e-6 * abs(high) + step / 2


# ---------------------------------------------------------------------------------------------- names


class Wanted(NamedTuple):
    """Names by which variables that belong together are recognised; the first match is taken.

    Each row of `standard` (standard names) and `short` (names) holds one name for each variable, and last a
    word about them, or None.
    """

    what: str
    standard: tuple[tuple[str | None, ...], ...]
    short: tuple[tuple[str | None, ...], ...]


class Found(NamedTuple):
    """Variables found, the word about them (None: unknown), and how they were found."""

    variables: tuple[tuple[File, str], ...]
    word: str | None
    how: str


def find(files: list[File], wanted: Wanted, given: Sequence[str] | None, option: str) -> Found:
    """Find the variables: by `given` names, else by standard_name, else by short names.

    Raises
    ------
    InputError
        if there is no match or more than one (the line lists the candidates and names `option`), or if a variable is in
        several files.
    """
    where = ", ".join(f.label for f in files)
    if given is not None:
        variables = tuple(_named(files, name, where, option) for name in given)
        standard = tuple(str(f.data[name].attrs.get("standard_name")) for f, name in variables)
        word = next((r[-1] for r in wanted.standard if r[:-1] == standard), None)
        word = word or next((r[-1] for r in wanted.short if r[:-1] == tuple(given)), None)
        return Found(variables, word, "as told")
    for row in wanted.standard:
        hits = [_with_standard_name(files, name) for name in row[:-1]]
        if not all(hits):
            continue
        for hit in hits:
            for name in dict.fromkeys(name for _, name in hit):
                _check_one([f for f, n in hit if n == name], name)
        if max(map(len, hits)) > 1:
            several = ", ".join(name for hit in hits for _, name in hit)
            raise InputError(
                f"{where}: {several} all have standard_name {' or '.join(map(str, row[:-1]))}:"
                f" choose with {option}"
            )
        return Found(tuple(hit[0] for hit in hits), row[-1], f"standard_name {row[0]}")
    rows = [r for r in wanted.short if all(_holding(files, n) for n in r[:-1])]
    if len(rows) > 1:
        several = " or ".join(", ".join(map(str, r[:-1])) for r in rows)
        raise InputError(f"{where}: {several} could be the {wanted.what}: choose with {option}")
    if rows:
        variables = tuple((_check_one(_holding(files, n), n), n) for n in rows[0][:-1])
        return Found(variables, rows[0][-1], "well-known name")
    have = ", ".join(_describe(f, n) for f in files for n in f.data.data_vars if f.data[n].ndim)
    polar = "_direction" in have and option == "variables"
    raise InputError(
        f"{where}: no {wanted.what} found by standard_name or well-known name; name it with"
        f" {option}; variables: {have or 'none'}"
        + ("; of speed and direction make u and v first" if polar else "")
    )


def holds(files: list[File], wanted: Wanted) -> bool:
    """Whether any variable has one of the standard or short names that are wanted."""
    standard = (name for row in wanted.standard for name in row[:-1])
    short = (name for row in wanted.short for name in row[:-1])
    return any(_with_standard_name(files, name) for name in standard) or any(
        _holding(files, name) for name in short
    )


def _named(files: list[File], name: str, where: str, option: str) -> tuple[File, str]:
    check_text(option, name)
    holding = _holding(files, name)
    if not holding:
        names = {str(n) for f in files for n in f.data.data_vars}
        raise InputError(
            f"{where}: {option} names {name!r}, not in the file; {choose(name, names)}"
        )
    return _check_one(holding, name), name


def _check_one(holding: list[File], name: str) -> File:
    """The one file that has a variable; InputError if several have it, as in a series split into files."""
    if len(holding) > 1:
        raise InputError(
            f"{name} is in both {holding[0].label} and {holding[1].label}: several files hold the parts u, v, positions,"
            " masks, not one stretch of time each: join them in one file first"
        )
    return holding[0]


def _holding(files: list[File], name: str) -> list[File]:
    return [f for f in files if name in f.data.variables]


def _with_standard_name(files: list[File], standard: str) -> list[tuple[File, str]]:
    return [
        (f, str(name))
        for f in files
        for name, a in f.data.data_vars.items()
        if str(a.attrs.get("standard_name")) == standard
    ]


def _describe(file: File, name: str) -> str:
    attrs = file.data[name].attrs
    more = [str(attrs[k]) for k in ("standard_name", "units") if attrs.get(k)]
    return f"{name} ({', '.join(more)})" if more else str(name)


# ----------------------------------------------------------------------------------------- dimensions

COORDINATES = {
    "lon": {"lon", "longitude", "nav_lon", "lon_rho", "glamt", "xc", "geolon", "tlong", "tlon",
            "xt_ocean"},
    "lat": {"lat", "latitude", "nav_lat", "lat_rho", "gphit", "yc", "geolat", "tlat", "yt_ocean"},
}  # fmt: skip
_TIME = {"time", "ocean_time", "time_counter", "t", "date", "valid_time", "mt"}
_VERTICAL = {
    "depth", "z", "lev", "level", "deptht", "depthu", "depthv", "s_rho", "height", "height0",
    "height1", "height2", "zc", "st_ocean", "z_t", "nav_lev",
}  # fmt: skip
_EAST = {"degrees_east", "degree_east", "degree_e", "degrees_e", "degreee", "degreese"}
_NORTH = {"degrees_north", "degree_north", "degree_n", "degrees_n", "degreen", "degreesn"}


def role(name: str, variable: xr.DataArray | xr.Variable) -> str | None:
    """The role of a coordinate: "lon", "lat", "x", "y", "time", "vertical", or None."""
    attrs, low = variable.attrs, str(name).lower()
    standard, axis = str(attrs.get("standard_name", "")), str(attrs.get("axis", ""))
    units = str(attrs.get("units", "")).lower()
    if standard in ("grid_longitude", "grid_latitude"):  # a rotated pole's own degrees
        return None
    for what, word, degrees in (("lon", "longitude", _EAST), ("lat", "latitude", _NORTH)):
        by_name = low in COORDINATES[what] and units[:3] in ("", "deg", "rad")
        if standard == word or units in degrees or by_name:
            return what
    if standard == "time" or axis == "T" or variable.dtype.kind == "M" or low in _TIME:
        return "time"
    if axis == "Z" or "positive" in attrs or low in _VERTICAL or standard in ("depth", "height"):
        return "vertical"
    plain = not units or units in LENGTHS
    for what in ("x", "y"):
        by_name = plain and (axis == what.upper() or low == what)
        if standard == f"projection_{what}_coordinate" or by_name:
            return what
    return None


def with_same_points(file: File, files: Sequence[File], dims: Sequence[str]) -> list[File]:
    """The file, followed by the others of `files` that have as many points along `dims`."""
    sizes = {d: file.data.sizes[d] for d in dims}
    others = (f for f in files if f is not file)
    return [file, *(f for f in others if sizes.items() <= dict(f.data.sizes).items())]


def refuse_other_points(file: File, other: File, dims: Sequence[str]) -> None:
    """InputError if the coordinates of another file along `dims` differ from those of the file."""
    for dim in dims if other is not file else ():
        if not (dim in file.data.variables and dim in other.data.variables):
            continue
        one, two = file.data[dim].values, other.data[dim].values
        if one.dtype.kind not in "iuf" or two.dtype.kind not in "iuf" or one.size < 2:
            continue
        if not np.allclose(one, two, rtol=0, atol=0.01 * float(np.abs(np.diff(one)).mean())):
            raise InputError(
                f"{file.label} and {other.label}: their {dim!r} differ, {one[0]:g} … {one[-1]:g} and {two[0]:g} … {two[-1]:g}:"
                " points of the same index must be of the same place"
            )


def coordinate(file: File, dim: str) -> tuple[str, xr.DataArray] | None:
    """The coordinate variable of a dimension, or None."""
    if dim in file.data.variables:
        return dim, file.data[dim]
    for name, variable in file.data.variables.items():
        if variable.dims == (dim,) and role(name, variable):
            return str(name), file.data[name]
    return None


def field(file: File, name: str, depth: float = 0.0, select: dict[str, int] | None = None) -> Field:
    """Determine the meaning of each dimension of a variable, and choose the level nearest to `depth` [m].

    Raises
    ------
    InputError
        for a dimension of unknown meaning (choose an index with `select`), or an unstructured mesh.
    """
    if not isinstance(select, Mapping | None):
        raise InputError(f"select = {select!r}: must be a dict such as {{'member': 3}}")
    array, select = file.data[name], dict(select or {})
    sizes = {str(d): n for d, n in array.sizes.items()}
    where = f"{file.label}: {name}({', '.join(sizes)})"
    for dim, index in select.items():
        if dim not in file.data.sizes:
            raise InputError(f"{where}: select {dim!r}: {choose(dim, map(str, file.data.sizes))}")
        if not isinstance(index, Integral):
            raise InputError(f"{where}: select {dim} = {index!r}: must be a whole number, an index")
        if dim in sizes and not -sizes[dim] <= index < sizes[dim]:
            raise InputError(f"{where}: select {dim} = {index}: it has {sizes[dim]} entries")
    fixed = {d: i for d, i in select.items() if d in sizes}
    roles = {}
    for dim in sizes:
        found = coordinate(file, dim)
        roles[dim] = role(*found) if found else "time" if dim.lower() in _TIME else None
    times = [d for d in sizes if roles[d] == "time" and d not in fixed]
    time = max(times, key=lambda d: sizes[d] > 1, default=None)  # not a forecast's single date
    for dim in sizes:
        if roles[dim] == "vertical" and dim not in fixed:
            fixed[dim] = _level(file, dim, depth, where)
    rest = [d for d in sizes if d not in fixed and d != time]
    if len(rest) != 2:
        fixed |= {d: 0 for d in rest if sizes[d] == 1 and roles[d] in (None, "time")}
        rest = [d for d in rest if d not in fixed]
    if all(sizes[d] == 1 for d in rest):  # a series at one point, with or without axes of size 1
        fixed |= dict.fromkeys(rest, 0)
        rest = []
    if len(rest) == 1:
        raise InputError(
            f"{where}: one horizontal dimension, {rest[0]!r} of {sizes[rest[0]]}: meshes and"
            " trajectories are not read; interpolate to rows and columns first"
        )
    if len(rest) > 2:
        more = next((d for d in rest if roles[d] not in ("lon", "lat", "x", "y")), rest[0])
        raise InputError(
            f"{where}: which of {', '.join(rest)} is meant? choose with select = {{ {more} = 0 }}, an index (-1: the last)"
        )
    if rest and roles[rest[0]] in ("lon", "x") and roles[rest[1]] in ("lat", "y"):
        rest.reverse()
    rows, columns = rest or (None, None)
    return Field(file, array, rows, columns, time, fixed)


def _level(file: File, dim: str, depth: float, where: str) -> int:
    found = coordinate(file, dim)
    if file.data.sizes[dim] == 1:
        return 0
    if found is None or found[1].dims != (dim,):
        raise InputError(
            f"{where}: levels {dim!r} have no depths: choose with select = {{ {dim} = 0 }}, an index (-1: the last)"
        )
    name, levels = found
    scale = LENGTHS.get(str(levels.attrs.get("units", "")).lower().strip())
    if scale is None and depth != 0:
        raise InputError(
            f"{where}: depth = {depth:g} m, but levels {name!r} are not in metres: choose with"
            f" select = {{ {dim} = 0 }}, an index (-1: the last)"
        )
    return int(np.argmin(np.abs(np.abs(levels.values.astype(float)) * (scale or 1.0) - depth)))
