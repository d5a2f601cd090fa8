"""Forcing: velocities that drive the floes, as constants, functions of place and time, or files.

A source has `fill(t, u, v)`, which writes the velocity [m/s] at the cells of a grid into two flat arrays, at t
seconds after the start of the run, along the x and y axes of the floes' plane; and `span`, the first and last
t that it covers, or None if it covers all.  The model does not depend on where its velocities come from: a host
model fills the same arrays.

For a file the geometry is computed only once.  With z = u + i v, the interpolation, rotations, averages over faces,
units and masks form one sparse complex matrix M, and each record costs one product, z_cells = M [u; v].
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Literal, Protocol, final, get_args

import numpy as np
from scipy import sparse

from floebmi import cgrid
from floebmi.cgrid import Stagger
from floebmi.clock import BeyondSpan, Calendar, Clock
from floebmi.errors import InputError, check_text, check_word, in_line, warn
from floebmi.factors import velocity_factor
from floebmi.fields import Box, Field, Wanted, field, find
from floebmi.grid import Grid, check_grid
from floebmi.masks import choose_mask, find_mask
from floebmi.opening import open_files
from floebmi.places import Net, Position
from floebmi.quantities import is_number, unmasked
from floebmi.remap import FillLand, around_cells, interpolate

if TYPE_CHECKING:
    from floebmi.clock import Date
    from floebmi.opening import Source

Velocity = Callable[[np.ndarray, np.ndarray, float], "np.ndarray | float"]
Medium = Literal["ocean", "wind"]
Vectors = Literal["auto", "east-north", "grid"]

# Components along east and north, or along the source's own axes; None: the name does not tell.
_EAST: Literal["east-north"] = "east-north"
_GRID: Literal["grid"] = "grid"
_VELOCITIES = {
    "ocean": Wanted(
        "surface current",
        standard=(
            ("surface_eastward_sea_water_velocity", "surface_northward_sea_water_velocity", _EAST),
            ("eastward_sea_water_velocity", "northward_sea_water_velocity", _EAST),
            ("surface_sea_water_x_velocity", "surface_sea_water_y_velocity", _GRID),
            ("sea_water_x_velocity", "sea_water_y_velocity", _GRID),
            ("x_sea_water_velocity", "y_sea_water_velocity", _GRID),
        ),
        short=(
            ("uo", "vo", None),
            ("u", "v", None),
            ("uoce", "voce", None),
            ("ssu", "ssv", None),
            ("uos", "vos", None),
            ("water_u", "water_v", _EAST),
            ("vozocrtx", "vomecrty", _GRID),
            ("sozocrtx", "somecrty", _GRID),
            ("UVEL", "VVEL", _GRID),
        ),
    ),
    "wind": Wanted(
        "wind",
        standard=(
            ("eastward_wind", "northward_wind", _EAST),
            ("x_wind", "y_wind", _GRID),
            ("grid_eastward_wind", "grid_northward_wind", _GRID),
        ),
        short=(
            ("u10", "v10", _EAST),
            ("uas", "vas", _EAST),
            ("U10M", "V10M", _EAST),
            ("U10", "V10", None),
            ("u10m", "v10m", _EAST),
            ("Uwind", "Vwind", None),
            ("uwind", "vwind", None),
            ("x_wind_10m", "y_wind_10m", _GRID),
        ),
    ),
}
USUAL_LEVEL = {"ocean": 0.0, "wind": 10.0}  # depth or height [m]
# Faster than any current or wind [m/s]: a wrong unit, or a fill value that the file does not declare.
_FASTEST = {"ocean": 20.0, "wind": 200.0}
# An `angle` this far from the direction of the columns is worth a warning [rad].
_WRONG_ANGLE = 0.1


__all__ = [
    "Constant", "Function", "VelocityFile", "VelocitySource", "FillLand", "Medium", "Vectors",
]  # fmt: skip


class VelocitySource(Protocol):
    """Interface of a forcing."""

    @property
    def span(self) -> tuple[float, float] | None:
        """First and last time [s] for which `fill` works; None: all times."""

    def fill(self, t: float, u: np.ndarray, v: np.ndarray) -> None:
        """Write the velocity [m/s] at t [s] into u, v (grid.size,)."""


@final
class Constant:
    """A velocity that is uniform in space and constant in time.

    Parameters
    ----------
    u, v : velocity along x and y [m/s]

    Raises
    ------
    InputError
        unless both are finite numbers.
    """

    span = None

    def __init__(self, u: float = 0.0, v: float = 0.0) -> None:
        if not (is_number(u) and is_number(v)):
            raise InputError(f"Constant velocity ({u!r}, {v!r}): must be two finite numbers [m/s]")
        self.u, self.v = float(u), float(v)

    def fill(self, t: float, u: np.ndarray, v: np.ndarray) -> None:
        """Write the velocity [m/s] into u, v (grid.size,)."""
        u[:], v[:] = self.u, self.v

    def __repr__(self) -> str:
        return f"Constant(u={self.u:g}, v={self.v:g} m/s)"


@final
class Function:
    """A velocity given by functions of (x, y, t), or by numbers, at the cells of a grid.

    Parameters
    ----------
    u, v : numbers [m/s], or functions of x, y (grid.size,) [m] and t [s] that return a number or an
        array (grid.size,) [m/s]
    grid : grid at whose cells the functions are evaluated

    Raises
    ------
    InputError
        if `grid` is not a Grid, or a function takes other arguments; from `fill`, if a function returns another shape or
        a value that is not finite.
    """

    span = None

    def __init__(self, u: Velocity | float, v: Velocity | float, grid: Grid) -> None:
        check_grid("grid", grid)
        for name, given in (("u", u), ("v", v)):
            if callable(given) and not _takes_three(given):
                raise InputError(
                    f"Function {name}{inspect.signature(given)}: must take x, y [m] and t [s]"
                )
        self.u, self.v, self.grid = u, v, grid

    def fill(self, t: float, u: np.ndarray, v: np.ndarray) -> None:
        """Write the velocity [m/s] at t [s] into u, v (grid.size,)."""
        x, y = self.grid.x, self.grid.y
        for name, given, out in (("u", self.u, u), ("v", self.v, v)):
            values = unmasked(given(x, y, t) if callable(given) else given)
            if values.shape not in ((), out.shape):
                raise InputError(
                    f"Function {name} at t = {t:g} s: shape {values.shape}; must be {out.shape}"
                )
            bad = np.flatnonzero(~np.isfinite(values))
            if bad.size:
                c = int(bad[0])
                raise InputError(
                    f"Function {name} at t = {t:g} s, cell {c} (x = {x[c]:g}, y = {y[c]:g} m):"
                    f" {values.flat[c]}; must be finite"
                )
            out[:] = values

    def __repr__(self) -> str:
        names = (getattr(f, "__name__", repr(f)) for f in (self.u, self.v))
        return f"Function({', '.join(names)})"


@final
class VelocityFile:
    """Ocean currents or wind from NetCDF or Zarr, interpolated to the cells of a grid in the floes' plane.

    Two records are held in memory, as values at the grid's cells; only the block of points around the grid is
    read from each record.

    Parameters
    ----------
    path : a file, several files that hold the parts (u, v, positions, masks), or an open xarray data set (for a
        series of files: `xarray.open_mfdataset`)
    grid : the cells to fill; only its wet cells need data
    kind : "ocean" (surface current) or "wind" (10 m)
    projection : map projection of grid.x, grid.y: PROJ string, EPSG code …; None if these are the file's own x, y
    variables : names (u, v); default: found by standard_name, else by well-known names
    start : date of t = 0; default: the first record
    vectors : "east-north" (components along east and north) or "grid" (along the source's own axes, positive towards
        increasing coordinates); "auto" decides by standard_name, a staggered grid, or a variable `angle`
    stagger : position of u and v on a C grid, see `floebmi.cgrid`
    depth : depth (for wind: height) [m]; the nearest level is read; default: the surface of the ocean, wind at 10 m
    select : index along a dimension that is neither time, level nor horizontal, {"member": 3}
    units : units of the components if the file states none or wrong ones
    mask : name of the land-sea mask at the cell centres; "auto" looks for one (kind "ocean"), "none" goes by NaN alone
    fill_land : what a wet cell gets if the source has no water around it: "error", the velocity of the
        "nearest" water, or 0 ("dry"; then mask the grid with `covered`)
    position, file_projection : see `floebmi.places.place_of`
    beyond_span : "error", "hold" or "repeat", see `floebmi.clock.Clock`
    calendar : CF calendar of the run, which the file's dates must have too; default: any

    Attributes
    ----------
    covered : (grid.size,) bool, True where there are data
    projection : the map projection, as given or the file's own; None if the file states none
    span : first and last time [s] with data, or None

    Notes
    -----
    A point of the source is used if the mask says water and its first record is not NaN.  A NaN in a later
    record is an error, not land.  Interpolation is bilinear between used points only, with weights scaled
    to sum to 1.

    Raises
    ------
    InputError
        if the file is ambiguous, or does not cover the wet cells.
    """

    def __init__(
        self,
        path: Source,
        grid: Grid,
        *,
        kind: Medium = "ocean",
        projection: str | None = None,
        variables: Sequence[str] | None = None,
        start: Date | None = None,
        vectors: Vectors = "auto",
        stagger: Stagger = "auto",
        depth: float | None = None,
        select: dict[str, int] | None = None,
        units: str | None = None,
        mask: str = "auto",
        fill_land: FillLand = "error",
        position: Position = "auto",
        file_projection: str | None = None,
        beyond_span: BeyondSpan = "error",
        calendar: Calendar | None = None,
    ) -> None:
        check_word("kind", kind, get_args(Medium))
        check_word("vectors", vectors, get_args(Vectors))
        check_word("stagger", stagger, get_args(Stagger))
        check_text("units", units)
        check_text("calendar", calendar)
        two = isinstance(variables, tuple | list) and len(variables) == 2
        if variables is not None and not two:
            raise InputError(f"variables = {in_line(variables)}: must be two names, of u and of v")
        check_grid("grid", grid)
        self.grid = grid
        files = open_files(path)
        found = find(files, _VELOCITIES[kind], variables, "variables")
        level = USUAL_LEVEL[kind] if depth is None else depth
        u, v = (field(f, name, level, select) for f, name in found.variables)
        self._kind, self._u, self._v = kind, u, v
        self._label = f"{u.file.label}: {u.name}, {v.name}"
        factors = [velocity_factor(units or f.array.attrs.get("units"), f.label) for f in (u, v)]
        self._clock = _common_clock(u, v, start, beyond_span, calendar)

        centres = cgrid.find_centres(files, u, v, stagger, projection, position, file_projection)
        self.projection = centres.place.plane
        around, box = around_cells(centres.place, grid, grid.wet, fill_land, self._label)
        # Wind blows over land, too: there only a mask that the user names counts.
        self._mask = choose_mask(mask, centres.file, files, centres.dims, auto=kind == "ocean")
        to_u, to_v, wet = self._to_centres(centres, box, factors)
        rows, self._note = interpolate(
            around, box, centres.place, grid, wet, fill_land, self._label
        )
        self.covered = np.diff(rows.indptr) > 0
        angle, axes = self._angle(centres, found.word, vectors, box)
        if np.isnan(angle.ravel()[rows.indices]).any():
            raise InputError(
                f"{self._label}: the direction of {axes} is not known at all points in use"
            )
        turn = sparse.diags(np.exp(1j * np.nan_to_num(angle.ravel())))
        turned = sparse.diags(grid.wet.astype(float)) @ rows @ turn
        self._matrix = sparse.hstack([turned @ to_u, 1j * turned @ to_v], format="csr")
        self._matrix.eliminate_zeros()  # closed faces: their values, NaN or not, are never touched
        sizes = [int(np.prod(b.shape)) for _, b in self._parts()]
        self._used = np.unique(self._matrix.indices)
        self._fastest = _FASTEST[kind] / np.abs(np.repeat(factors, sizes)[self._used])
        self._records: dict[int, np.ndarray] = {}
        said = dict.fromkeys(str(units or f.array.attrs.get("units")) for f in (u, v))
        self._text = (
            f"{self._label} by {found.how} [{' and '.join(said)}{_scaled_by(factors)}]"
            f"{', C grid' if centres.staggered else ''}{_levels(u)}; {centres.place.text};"
            f" {axes}{_turned_by(turned)}"
        )

    @property
    def span(self) -> tuple[float, float] | None:
        """First and last time [s] for which `fill` works; None: all times."""
        return self._clock.span

    @property
    def first_date(self) -> str | None:
        """The date of the first of several records; None for a single record that holds at all times, or times without dates."""
        return self._clock.first_date

    @property
    def calendar(self) -> str | None:
        """CF calendar of the file's dates; None if it has no dates."""
        return self._clock.calendar

    def fill(self, t: float, u: np.ndarray, v: np.ndarray) -> None:
        """Write the velocity [m/s] at t [s] into u, v (grid.size,), linear between records; 0 where not covered.

        Raises
        ------
        InputError
            outside the file's times, or for a value that cannot be a velocity, naming variable, index and date.
        """
        before, after, weight = self._clock.bracket(t)
        z = self._record(before)
        if weight:
            z = (1 - weight) * z + weight * self._record(after)
        u[:], v[:] = z.real, z.imag
        self._records = {k: self._records[k] for k in {before, after} & self._records.keys()}

    def _record(self, record: int) -> np.ndarray:
        """u + i v (grid.size,) [m/s] of one record, at the cells."""
        if record not in self._records:
            values = np.concatenate([f.read(record, b).ravel() for f, b in self._parts()])
            # Check each point separately: a mean that includes a fill value may look like a valid velocity.
            excess = np.abs(values[self._used]) / self._fastest
            if not (excess <= 1).all():  # NaN is bad, too
                worst = np.argmax(np.where(np.isnan(excess), np.inf, excess))
                raise InputError(self._what_is_bad(record, int(self._used[worst]), values))
            self._records[record] = self._matrix @ values
        return self._records[record]

    def _parts(self) -> tuple[tuple[Field, Box], tuple[Field, Box]]:
        return (self._u, self._u_box), (self._v, self._v_box)

    def _what_is_bad(self, record: int, point: int, values: np.ndarray) -> str:
        cell = int(self._matrix[:, [point]].nonzero()[0][0])
        n_u = int(np.prod(self._u_box.shape))
        part, box = self._parts()[int(point >= n_u)]
        j, i = np.unravel_index(point - n_u * (point >= n_u), box.shape)
        place = f"[{box.rows.start + j}, {box.columns.start + i}]" if part.dims else ""
        return (
            f"{part.label}{place} at {self._clock.date(record)}: {values[point]:g} on water beside grid"
            f" cell {cell}; must be a velocity below {_FASTEST[self._kind]:g} m/s (a fill value that is not its"
            " _FillValue, wrong units, or a hole in the data?)"
        )

    def _to_centres(
        self, centres: cgrid.Centres, box: Box, factors: list[float]
    ) -> tuple[sparse.csr_matrix, sparse.csr_matrix, np.ndarray]:
        """Matrices from each component's own points to a box of cell centres, in m/s, and the water mask there.

        Also sets the boxes of points to read.
        """
        (u, v), place = (self._u, self._v), centres.place
        along_u, u_columns = cgrid.mean_of_faces(
            u.shape[1], box.columns, centres.u_offsets, place.periodic
        )
        along_v, v_rows = cgrid.mean_of_faces(v.shape[0], box.rows, centres.v_offsets, False)
        self._u_box, self._v_box = Box(box.rows, u_columns), Box(v_rows, box.columns)
        mean_u = sparse.kron(sparse.identity(box.shape[0]), along_u, format="csr")
        mean_v = sparse.kron(along_v, sparse.identity(box.shape[1]), format="csr")
        water = None if self._mask is None else self._mask.read(box)
        open_u = self._where_open(u, self._u_box, mean_u, water, ("mask_u", "umask"))
        open_v = self._where_open(v, self._v_box, mean_v, water, ("mask_v", "vmask"))
        flow_u, flow_v = mean_u @ open_u > 0, mean_v @ open_v > 0
        wet = (flow_u | flow_v if centres.staggered else flow_u & flow_v).reshape(box.shape)
        if water is not None:
            wet &= water
        to_u = mean_u @ sparse.diags(factors[0] * open_u)
        to_v = mean_v @ sparse.diags(factors[1] * open_v)
        return to_u, to_v, wet

    def _where_open(
        self,
        part: Field,
        box: Box,
        mean: sparse.csr_matrix,
        water: np.ndarray | None,
        masks: tuple[str, ...],
    ) -> np.ndarray:
        """1.0 where a component has a value and is not blocked by the masks, else 0.0: (points of box,)."""
        is_open = np.isfinite(part.read(0, box)).ravel()
        if water is not None:
            own = find_mask(part.file, part.dims, masks)
            is_open &= cgrid.open_faces(mean, water) if own is None else own.read(box).ravel()
        return is_open.astype(float)

    def _angle(
        self, centres: cgrid.Centres, word: str | None, vectors: Vectors, box: Box
    ) -> tuple[np.ndarray, str]:
        """Angle [rad] from the plane's x axis to that of the components, in a box, and the name of that axis."""
        place, data = centres.place, centres.file.data
        angle = next(
            (n for n in ("angle", "ANGLE", "anglet")
             if n in data and centres.dims and set(data[n].dims) == set(centres.dims)),
            None,
        )  # fmt: skip
        if vectors == "auto":
            vectors = self._axes_meant(centres, word, angle is not None)
        if vectors == "east-north":
            if not place.knows_east:
                raise InputError(
                    f"{self._label}: vectors = 'east-north', but the file does not say where east is"
                )
            return place.east(box), "east, north"
        if angle is not None:
            return self._by_angle(centres, angle, box), f"grid axes by {angle}"
        return place.own(box), "east, north" if place.east_is_x else "grid axes"

    def _axes_meant(self, centres: cgrid.Centres, word: str | None, has_angle: bool) -> Vectors:
        """The axes of the components, as the file states them; an error if it does not."""
        place = centres.place
        if place.east_is_x or not place.knows_east:
            return "grid"
        if centres.staggered and word == _EAST:
            raise InputError(
                f"{self._label}: staggered, so along the grid's axes, yet their standard_name says east"
                " and north: say vectors = 'grid' or 'east-north'"
            )
        if centres.staggered:
            return "grid"
        if word is not None:
            return word
        if has_angle:
            return "grid"
        if not centres.dims:
            return "east-north"
        raise InputError(
            f"{self._label}: nothing says whether they point along east and north or along the grid's"
            " axes: say vectors = 'east-north' or 'grid'"
        )

    def _by_angle(self, centres: cgrid.Centres, name: str, box: Box) -> np.ndarray:
        """The angle from a file's own angle to east (ROMS), checked against the positions of its points."""
        place, array = centres.place, centres.file.data[name]
        own = np.asarray(array.transpose(*centres.dims)[tuple(box)].values, float)
        if str(array.attrs.get("units", "radians")).lower().startswith("deg"):
            own = np.radians(own)
        angle = place.east(box) + own
        if isinstance(place, Net):
            away = float(np.nanmedian(np.abs(np.angle(np.exp(1j * (angle - place.own(box)))))))
            if away > _WRONG_ANGLE:
                warn(
                    f"{centres.file.label}: {name} differs from the direction of its columns by"
                    f" {np.degrees(away):.1f}°; {name} is used"
                )
        return angle

    def __repr__(self) -> str:
        land = self._mask.name if self._mask is not None else "NaN"
        cells = f"{int(self.covered.sum())} of {self.covered.size} cells{self._note}"
        return f"VelocityFile({self._text}; land by {land}; {cells}; {self._clock})"


def _takes_three(function: Callable) -> bool:
    """Whether it can be called with three arguments; True for callables without a signature, such as C functions."""
    try:
        inspect.signature(function).bind(None, None, None)
    except TypeError:
        return False
    except ValueError:
        return True
    return True


def _scaled_by(factors: list[float]) -> str:
    return "".join(f" × {f:.6g}" for f in dict.fromkeys(factors) if f != 1)


def _turned_by(turned: sparse.csr_matrix) -> str:
    """The range of angles by which components are rotated at the cells, as text."""
    axis = np.asarray(turned.sum(axis=1)).ravel()
    axis = axis[axis != 0]
    if not axis.size or not np.any(axis.imag):
        return " = x, y"
    middle = np.angle(axis.mean())
    angles = np.degrees(middle + np.angle(axis * np.exp(-1j * middle)))
    return f" turned by {angles.min():.1f} … {angles.max():.1f}°"


def _levels(part: Field) -> str:
    return "".join(f", {dim}[{i}]" for dim, i in part.fixed.items())


def _common_clock(
    u: Field,
    v: Field,
    start: Date | None,
    beyond_span: BeyondSpan,
    calendar: Calendar | None,
) -> Clock:
    clock = Clock(u, start, beyond_span, calendar)
    other = Clock(v, start, beyond_span, calendar)
    if not (np.array_equal(clock.seconds, other.seconds) and clock.date(0) == other.date(0)):
        raise InputError(f"{u.label} and {v.label}: their times differ: {clock}, and {other}")
    return clock
