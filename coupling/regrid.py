"""Conservative regridding between the host's cells and the cells of the exchange grid.

One matrix serves both directions: S, the area of overlap of target cell i and source cell j [m²].  With
r_i = Σ_j S_ij (over wet source cells) and cell areas A_i (target), A_j (source),

    state   f_i = Σ_j S_ij f_j / r_i                      source → target, the mean is kept
    flux    F_j = Σ_i S_ij q_i (A_i / r_i) / A_j          target → source, the integral is kept
                                                                        (eq. regrid-state, eq. regrid-flux)

A target cell that is completely covered has r_i = A_i, and the flux is then Sᵀ q / A_j.  The two operators are
transposes of each other with respect to cell areas: Σ_j A_j F_j g_j = Σ_i A_i q_i (S g / r)_i for any g, so a stress
does the same work on both grids.  They scale S differently: what most regridders call "conservative" is the state,
and a flux regridded that way loses its integral.  For target cells that are only partly covered, `normalisation` is

    "fraction"           divide by r_i: the mean over the covered part; the flux delivers all of A_i q_i there
    "destination_area"   divide by A_i: the uncovered part counts as zero; its share of the flux is not delivered

Round-off in the overlaps affects neither property, since both operators use the row sums of the same S.

How overlaps are computed.  For two rectilinear grids: as the product of one-dimensional overlaps, exact and cheap.
For all others: with shapely's STRtree and polygon intersection, for any polygons, concave ones too (36 000 overlaps of
warped quadrilaterals in 0.6 s, rows exact to 1e-14).  numba_celltree computes the same areas in 0.05 s, but
compiles for 30 s at first use, takes convex cells only and returns no shapes, which are needed on the sphere; weights
are computed once and can be saved.  xugrid is a layer over it.  YAC could do it too, but needs an MPI library and ends
the process on an error; the tests compare with it (agreement 5e-13).

On the sphere (`surface="sphere"`) a grid's x and y are longitude and latitude [degrees].  Edges of rectilinear
grids are meridians and parallels, edges of all other grids are great circles.  For two rectilinear grids the overlaps
are again exact (in longitude and sine of latitude).  Otherwise the cells are drawn and intersected in the gnomonic
projection about the target's centre, where great circles are straight lines, and the pieces are measured on the
sphere.  So great-circle cells are exact to round-off, the poles need no special treatment, and longitudes may be
counted from any meridian.  In such a mixed pair a parallel is divided into 16 arcs (an error of half a metre for cells of
one degree), and cell areas are those of the cells drawn this way.  The target must lie within 60 degrees of
its centre; for global targets use a coupler.

For a host on the sphere and ice in a plane, `project` the host's cells into the plane and give `source_area` as the
host counts it, so that the force in newtons is conserved although the projection distorts areas.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Literal, final

import numpy as np
from scipy.sparse import csr_array, kron

from floebmi.arrays import digest
from floebmi.errors import InputError, check_word
from floebmi.files import attributes_of, check_target, in_one_go, new_file, path_of
from floebmi.grid import Grid, check_grid
from floebmi.projection import to_plane
from floebmi.quantities import flat, is_number, unmasked

Normalisation = Literal["fraction", "destination_area"]
Surface = Literal["plane", "sphere"]

EARTH_RADIUS = 6_371_000.0  # [m]
ARCS = 16  # great-circle pieces of a parallel, where it meets great-circle cells
CAP = np.cos(np.radians(60.0))  # how far from its middle the target may reach
HORIZON = np.cos(np.radians(82.0))  # source cells beyond this are left out …
LARGEST_CELL = np.cos(np.radians(20.0))  # … which is safe if none is larger than this
BLOCK = 100_000  # pairs of cells cut at a time: the pieces of all pairs of large grids need too much memory
ROUND_OFF = 1e-14  # overlaps below this share of both cells are round-off of touching edges
OVER = 1e-3  # a cell covered by more than this beyond its area is covered twice; corners in single precision do less
FORMAT = "floebmi overlap areas, version 1"
_READ = "overlap_area", "row", "col", "area_a", "area_b"  # what `from_netcdf` reads of a file


@final
class Regrid:
    """First-order conservative exchange between a source (host) and a target (exchange) grid.

    Parameters
    ----------
    source, target : grids; dry cells (`wet` False) take no part
    surface : "plane", x and y in metres in the same plane; or "sphere", longitude and latitude in degrees
    radius : radius of the sphere [m]
    source_area : (source.size,) the cell areas that the host uses [m²], if they differ from those of the
        grid as drawn here; they divide the flux.  Values on dry cells are ignored

    Attributes
    ----------
    overlap : S, sparse CSR (target.size, source.size) [m²], wet cells only
    source_area, target_area : cell areas [m²]
    covered : (target.size,) fraction of each target cell that wet source cells cover [1], 0 on dry cells
    uncovered : numbers of the wet target cells that no wet source cell touches

    Raises
    ------
    InputError
        for anything that is not a Grid, grids that do not overlap, a source whose wet cells together are smaller than a
        target cell that they overlap (units are then probably degrees or kilometres), wet cells that overlap each other
        (a halo), areas of a wrong size, latitudes beyond 90 degrees, a target that reaches more than 60 degrees from its
        centre, a source cell more than 20 degrees wide (two rectilinear grids may do both),
        and a radius that is not greater than 0.

    Examples
    --------
    >>> host = Grid.uniform(x=(0.0, 4.0), y=(0.0, 2.0), spacing=2.0)
    >>> ice = Grid.uniform(x=(0.0, 4.0), y=(0.0, 2.0), spacing=1.0)
    >>> regrid = Regrid(host, ice)
    >>> regrid
    Regrid(plane, 1 × 2 → 2 × 4 cells, 8 overlaps, all wet target cells covered)
    >>> regrid.state([1.0, 3.0])
    array([1., 1., 3., 3., 1., 1., 3., 3.])
    >>> regrid.flux([4.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    array([1., 0.])
    """

    def __init__(
        self,
        source: Grid,
        target: Grid,
        surface: Surface = "plane",
        radius: float = EARTH_RADIUS,
        source_area: np.ndarray | None = None,
    ) -> None:
        check_word("regrid: surface", surface, ("plane", "sphere"))
        check_grid("source", source)
        check_grid("target", target)
        overlap, drawn_area, target_area = (
            _overlaps_plane(source, target)
            if surface == "plane"
            else _overlaps_sphere(source, target, radius)
        )
        area = drawn_area if source_area is None else _areas(source_area, source, drawn_area)
        self._assemble(source, target, surface, overlap, area, target_area)
        if self.overlap.nnz == 0:
            raise InputError(
                f"regrid: no wet cell of {source!r} meets a wet cell of {target!r}:"
                " are both in the same plane and the same units?"
            )
        wet = drawn_area[source.wet]
        smallest = target_area[self.overlap.indptr[1:] > self.overlap.indptr[:-1]].min()
        if wet.size > 1 and target.wet.sum() > 1 and wet.sum() < smallest:
            raise InputError(
                f"regrid: all {wet.size} wet cells of {source!r} together are smaller than a cell of"
                f" {target!r}: are both in the same plane and the same units?"
            )
        _refuse_doubles("target", "source", self.covered)
        _refuse_doubles("source", "target", overlap.sum(axis=0) / drawn_area)

    def _assemble(
        self,
        source: Grid,
        target: Grid,
        surface: Surface,
        overlap: csr_array,
        source_area: np.ndarray,
        target_area: np.ndarray,
    ) -> None:
        self.source, self.target, self.surface = source, target, surface
        self.overlap, self.source_area, self.target_area = overlap, source_area, target_area
        self._row_sum = overlap.sum(axis=1)
        self._used = np.unique(overlap.indices)
        self.covered = self._row_sum / target_area
        self.uncovered = np.flatnonzero((self._row_sum == 0) & target.wet)

    @functools.cached_property
    def reverse(self) -> Regrid:
        """The regridding with source and target exchanged, from the same overlaps.

        Its `state` takes an ice field to the host (for the area fraction use normalisation "destination_area").
        """
        other = object.__new__(Regrid)
        other._assemble(
            self.target, self.source, self.surface, self.overlap.T.tocsr(),
            self.target_area, self.source_area,
        )  # fmt: skip
        return other

    def state(
        self, values: np.ndarray, normalisation: Normalisation = "fraction", empty: float = 0.0
    ) -> np.ndarray:
        """Regrid a state (velocity, tilt, temperature, concentration) from source to target, conserving the mean.

        Parameters
        ----------
        values : (source.size,); values on dry cells are ignored
        normalisation : "fraction", mean over the covered part; "destination_area", mean over the whole cell
        empty : value for target cells that are dry or not covered

        Returns
        -------
        (target.size,)

        Raises
        ------
        InputError
            for a wrong size, a value that is not finite on a wet cell that meets the target, or an `empty` that is
            not a single number.
        """
        values = self._check(values, self.source, self._used, "source")
        scale = self._scale(normalisation)
        if unmasked(empty).ndim:
            raise InputError(f"regrid: empty = {empty!r}: must be one number")
        return np.where(self._row_sum > 0, (self.overlap @ values) * scale, empty)

    def flux(self, values: np.ndarray, normalisation: Normalisation = "fraction") -> np.ndarray:
        """Regrid a flux per area (stress on the ocean, heat) from target back to source, conserving the integral.

        Parameters
        ----------
        values : (target.size,) per target cell area, for stress N m-2
        normalisation : the same as was used for the state, so that work is the same on both grids

        Returns
        -------
        (source.size,) per source cell area; Σ result × source_area = Σ values × target_area, less
        `undelivered`

        Raises
        ------
        InputError
            for a wrong size, or a value on a covered cell that is not finite.
        """
        covered = np.flatnonzero(self._row_sum)
        values = self._check(values, self.target, covered, "target")
        given = np.zeros(self.target.size)
        given[covered] = (values * self.target_area * self._scale(normalisation))[covered]
        return (self.overlap.T @ given) / self.source_area

    def undelivered(self, values: np.ndarray, normalisation: Normalisation = "fraction") -> float:
        """The part of Σ values × target_area that `flux` cannot deliver, because no wet source cell is there.

        For a stress [N m-2] it is a force [N].

        Raises
        ------
        InputError
            for a wrong size, or a value on a wet cell that is not finite.
        """
        values = self._check(values, self.target, np.flatnonzero(self.target.wet), "target")
        part = np.where(self._row_sum > 0, 0.0, 1.0)
        if _by_area(normalisation):
            part = 1.0 - self.covered
        lost = (values * self.target_area * part)[self.target.wet]
        return float(lost.sum())

    def _scale(self, normalisation: Normalisation) -> np.ndarray:
        if _by_area(normalisation):
            return 1.0 / self.target_area
        return 1.0 / np.where(self._row_sum > 0, self._row_sum, 1.0)

    @staticmethod
    def _check(values: np.ndarray, grid: Grid, used: np.ndarray, side: str) -> np.ndarray:
        values = unmasked(values)
        if values.size != grid.size:
            raise InputError(
                f"regrid: {values.size} values for {grid.size} cells of the {side} grid"
            )
        values = flat(f"regrid: field on the {side} grid", values, grid.shape)
        bad = used[~np.isfinite(values[used])]
        if bad.size:
            raise InputError(
                f"regrid: value {values[bad[0]]} on wet cell {bad[0]} of the {side} grid"
                f" ({bad.size} such cells): must be finite"
            )
        return values

    def to_netcdf(self, path: str | Path) -> None:
        """Save the overlaps as a file of regridding weights, so that the next run need not compute them.

        The file has the variables of ESMF and SCRIP weight files, which other regridders read: `S`, normalised by
        destination area; `row`, `col`, counted from 1; `area_a`, `mask_a`, `frac_a`, and centres and corners of the cells
        `xc_a` … `yv_a` for the source, `_b` for the target.  `from_netcdf` reads the overlaps, `overlap_area` [m²].

        Raises
        ------
        InputError
            if the folder does not exist, or the path is itself a folder.
        """
        rows = np.repeat(np.arange(self.target.size), np.diff(self.overlap.indptr))
        columns = self.overlap.indices
        by_source = np.bincount(columns, self.overlap.data, minlength=self.source.size)
        fields = {
            "col": (columns + 1, "n_s", "1", "source cell of each overlap, from 1"),
            "row": (rows + 1, "n_s", "1", "target cell of each overlap, from 1"),
            "S": (self.overlap.data / self.target_area[rows], "n_s", "1", "weight by target area"),
            "overlap_area": (self.overlap.data, "n_s", "m2", "area in common"),
            "area_a": (self.source_area, "n_a", "m2", "source cell area"),
            "area_b": (self.target_area, "n_b", "m2", "target cell area"),
            "mask_a": (self.source.wet.astype(np.int32), "n_a", "1", "1 on wet source cells"),
            "mask_b": (self.target.wet.astype(np.int32), "n_b", "1", "1 on wet target cells"),
            "frac_a": (by_source / self.source_area, "n_a", "1", "share that the target covers"),
            "frac_b": (self.covered, "n_b", "1", "share that the source covers"),
        }
        sizes = {"n_s": rows.size}
        unit = "m" if self.surface == "plane" else "degrees"
        for side, word, grid in (("a", "src", self.source), ("b", "dst", self.target)):
            cells, corners, rank = f"n_{side}", f"nv_{side}", f"{word}_grid_rank"
            sizes |= {cells: grid.size, corners: grid.corner_x.shape[1], rank: len(grid.shape)}
            for axis, centre, corner in (
                ("x", grid.x, grid.corner_x),
                ("y", grid.y, grid.corner_y),
            ):
                fields[f"{axis}c_{side}"] = centre, cells, unit, f"{axis} of the centres"
                fields[f"{axis}v_{side}"] = corner, f"{cells} {corners}", unit, f"{axis} of corners"
            shape = np.array(grid.shape[::-1], np.int32)  # as Fortran has it: x first
            fields[f"{word}_grid_dims"] = shape, rank, "1", "cells along each axis"
        path = path_of("path", path)
        check_target(path, overwrite=True)
        with in_one_go(path) as part, new_file(part) as file:
            told = attributes_of("weights of conservative regridding, laid out as those of ESMF")
            file.setncatts({name: told[name] for name in ("title", "source", "history")})  # no CF
            file.format = FORMAT
            file.map_method = "first-order conservative"
            file.normalization = "destarea"
            file.surface = self.surface
            file.source_checksum = checksum(self.source)
            file.target_checksum = checksum(self.target)
            file.weights_checksum = digest(*(fields[name][0] for name in _READ))
            for name, size in sizes.items():
                file.createDimension(name, size)
            for name, (values, dimensions, units, text) in fields.items():
                variable = file.createVariable(name, values.dtype, dimensions.split())
                variable.units, variable.long_name = units, text
                variable[:] = values

    @classmethod
    def from_netcdf(cls, path: str | Path, source: Grid, target: Grid) -> Regrid:
        """Read the overlaps that `to_netcdf` saved for the same grids.

        Raises
        ------
        InputError
            for a file that is missing, damaged or of another kind, and for one made for other grids or masks
            (their checksums are compared).
        """
        import netCDF4

        check_grid("source", source)
        check_grid("target", target)
        path = path_of("path", path)
        if not path.is_file():
            raise InputError(f"{path}: there is no such file")
        damaged = InputError(
            f"{path}: not a NetCDF file, or a damaged one; compute the weights again"
        )
        try:
            with netCDF4.Dataset(path) as file:
                file.set_auto_mask(False)
                told = {name: file.getncattr(name) for name in file.ncattrs()}
                if told.get("format") != FORMAT:
                    raise InputError(f"{path}: not a file of overlap weights ({FORMAT!r})")
                read = [file[name][:] for name in _READ]
                area, row, column, source_area, target_area = read
        except (OSError, RuntimeError, IndexError, AttributeError):
            raise damaged from None
        for side, grid in (("source", source), ("target", target)):
            if told.get(f"{side}_checksum") != checksum(grid):
                raise InputError(
                    f"{path}: made for another {side} grid than {grid!r}: cells or mask differ;"
                    " make the weights anew"
                )
        if told.get("weights_checksum") != digest(*read) or "surface" not in told:
            raise damaged
        overlap = csr_array((area, (row - 1, column - 1)), shape=(target.size, source.size))
        regrid = object.__new__(cls)
        regrid._assemble(source, target, told["surface"], overlap, source_area, target_area)
        return regrid

    def __repr__(self) -> str:
        cells = " → ".join(
            " × ".join(str(n) for n in grid.shape) for grid in (self.source, self.target)
        )
        partly = int(((self.covered > 0) & (self.covered < 1 - 1e-9)).sum())
        rest = f"{partly} wet target cells covered in part, {self.uncovered.size} not at all"
        if not partly and not self.uncovered.size:
            rest = "all wet target cells covered"
        return f"Regrid({self.surface}, {cells} cells, {self.overlap.nnz} overlaps, {rest})"


def checksum(grid: Grid) -> str:
    """SHA-256 of the corners of all cells and of the mask; equal for equal grids."""
    check_grid("grid", grid)
    return digest(np.array(grid.shape), grid.corner_x, grid.corner_y, grid.wet)


def project(grid: Grid, projection: str) -> Grid:
    """Project a longitude-latitude grid [degrees] to polygons in a plane [m], with straight edges between corners.

    Neighbouring cells still share their edges, so nothing is counted twice or left out, but edges are now straight
    in the plane.  The projection distorts areas: pass the host's own areas, or `sphere_area`, as
    `Regrid(source_area=…)`.  Cells with a side at latitude 90 become triangles if the pole is a point of the plane;
    the grid is then unstructured, with its cells in the same order.

    Parameters
    ----------
    grid : grid with x longitude, y latitude [degrees]
    projection : any projection that pyproj reads, "EPSG:3413" or "+proj=laea +lat_0=79 +lon_0=0"

    Returns
    -------
    Grid : the same cells in the same order, with the same mask

    Raises
    ------
    InputError
        for an unknown projection, or corners that it does not cover.
    """
    check_grid("grid", grid)
    x, y = to_plane(projection, grid.node_x, grid.node_y)
    outside = np.flatnonzero(~(np.isfinite(x) & np.isfinite(y)))
    if outside.size:
        k = outside[0]
        raise InputError(
            f"projection = {projection!r}: corner at longitude {grid.node_x[k]:g}, latitude"
            f" {grid.node_y[k]:g} is outside it; cut the grid first"
        )
    pole = np.zeros(x.size, bool)
    for latitude in (-90.0, 90.0):
        k = np.flatnonzero(grid.node_y == latitude)
        pole[k] = np.all(np.hypot(x[k] - x[k[:1]], y[k] - y[k[:1]]) < 1e-3)  # a line in some planes
    if grid.kind == "unstructured" or pole.any():
        return Grid.unstructured(x, y, _once_at_poles(grid.face_nodes, pole), grid.wet)
    ny, nx = grid.shape
    corners = x.reshape(ny + 1, nx + 1), y.reshape(ny + 1, nx + 1)
    return Grid.curvilinear(*corners, grid.wet)


def _once_at_poles(faces: np.ndarray, pole: np.ndarray) -> np.ndarray:
    """Faces padded with -1, with only the first of adjacent corners at a pole (bool for each node)."""
    here = (faces >= 0) & pole[faces]
    last = faces[np.arange(len(faces)), (faces >= 0).sum(axis=1) - 1]
    before = np.column_stack([pole[last], here[:, :-1]])
    kept = (faces >= 0) & ~(here & before)
    order = np.argsort(~kept, axis=1, kind="stable")
    return np.take_along_axis(np.where(kept, faces, -1), order, axis=1)


def sphere_area(grid: Grid, radius: float = EARTH_RADIUS) -> np.ndarray:
    """Areas of longitude-latitude cells [degrees] on the sphere [m²], (size,), with edges as in the module's text.

    Raises
    ------
    InputError
        for a radius [m] that is not greater than 0.
    """
    check_grid("grid", grid)
    _check_radius(radius)
    if grid.x_edges is not None and grid.y_edges is not None:
        height = _sine_difference(grid.y_edges[1:], grid.y_edges[:-1])
        return radius**2 * np.outer(height, np.diff(np.radians(grid.x_edges))).ravel()
    return radius**2 * _fans(_on_sphere(grid.corner_x, grid.corner_y))


def _check_radius(radius: float) -> None:
    if not (is_number(radius) and radius > 0):
        raise InputError(f"regrid: radius = {radius!r}: must be greater than 0 m")


def _by_area(normalisation: Normalisation) -> bool:
    """Whether the normalisation is by the whole target cell rather than by its covered part."""
    words = ("fraction", "destination_area")
    check_word("regrid: normalisation", normalisation, words)
    return normalisation == "destination_area"


def _areas(values: np.ndarray, source: Grid, drawn: np.ndarray) -> np.ndarray:
    """The host's areas; for dry cells, which take no part, those of the grid as drawn."""
    values, wet = unmasked(values), source.wet
    if values.size != wet.size:
        raise InputError(f"regrid: source_area has {values.size} values for {wet.size} cells")
    values = flat("regrid: source_area", values, source.shape)
    bad = np.flatnonzero(wet & ~((values > 0) & np.isfinite(values)))
    if bad.size:
        raise InputError(
            f"regrid: source_area[{bad[0]}] = {values[bad[0]]}: must be greater than 0"
        )
    return np.where(wet, values, drawn)


def _refuse_doubles(one: str, other: str, covered: np.ndarray) -> None:
    """Refuse a cell that is covered more than once: cells of the other grid overlap each other, as in a halo."""
    doubled = np.flatnonzero(covered > 1 + OVER)
    if doubled.size:
        k = doubled[0]
        raise InputError(
            f"regrid: cell {k} of the {one} is covered {covered[k]:.3g} times ({doubled.size} such cells): wet"
            f" cells of the {other} overlap each other; leave out the duplicates (a halo, longitudes over"
            " more than 360 degrees), or make them dry"
        )


def _wet_only(overlap: csr_array, source: Grid, target: Grid) -> csr_array:
    entries = overlap.tocoo()
    row, column = entries.coords
    kept = target.wet[row] & source.wet[column] & (entries.data > 0)
    return csr_array((entries.data[kept], (row[kept], column[kept])), shape=overlap.shape)


# ---- in the plane -----------------------------------------------------------------------------


def _overlaps_plane(source: Grid, target: Grid) -> tuple[csr_array, np.ndarray, np.ndarray]:
    import shapely

    if source.x_edges is not None and target.x_edges is not None:
        along_x = _overlaps_1d(source.x_edges, target.x_edges, np.subtract)
        along_y = _overlaps_1d(source.y_edges, target.y_edges, np.subtract)
        overlap = csr_array(kron(along_y, along_x, format="csr"))
        return _wet_only(overlap, source, target), source.area, target.area
    # Coordinates about the target's middle: large offsets would cost digits in the cuts.
    west, east, south, north = target.bounds
    middle = 0.5 * (west + east), 0.5 * (south + north)
    cells = [
        shapely.polygons(np.stack([grid.corner_x - middle[0], grid.corner_y - middle[1]], axis=-1))
        for grid in (source, target)
    ]
    overlap = _cut(*cells, source, target, source.area, target.area, shapely.area)
    return overlap, source.area, target.area


def _overlaps_1d(
    source_edges: np.ndarray, target_edges: np.ndarray, length: Callable[..., np.ndarray]
) -> csr_array:
    """Overlaps of intervals on an axis (target, source); the two sets of edges together cut the axis into pieces."""
    edges = np.union1d(source_edges, target_edges)
    west, east = edges[:-1], edges[1:]
    i = np.searchsorted(target_edges, west, side="right") - 1
    j = np.searchsorted(source_edges, west, side="right") - 1
    n_target, n_source = target_edges.size - 1, source_edges.size - 1
    both = (i >= 0) & (i < n_target) & (j >= 0) & (j < n_source)
    entries = length(east[both], west[both]), (i[both], j[both])
    return csr_array(entries, shape=(n_target, n_source))


def _cut(
    source_cells: np.ndarray,
    target_cells: np.ndarray,
    source: Grid,
    target: Grid,
    source_area: np.ndarray,
    target_area: np.ndarray,
    measure: Callable[[np.ndarray], np.ndarray],
) -> csr_array:
    """Areas of overlap of wet cells given as polygons; None stands for a cell that cannot overlap any."""
    import shapely

    wet_source = np.flatnonzero(source.wet & ~shapely.is_missing(source_cells))
    wet_target = np.flatnonzero(target.wet)
    pair = shapely.STRtree(source_cells[wet_source]).query(target_cells[wet_target])
    i, j = wet_target[pair[0]], wet_source[pair[1]]
    area = np.empty(len(i))
    for first in range(0, len(i), BLOCK):
        block = slice(first, first + BLOCK)
        area[block] = measure(shapely.intersection(target_cells[i[block]], source_cells[j[block]]))
    kept = area > ROUND_OFF * np.minimum(target_area[i], source_area[j])
    return csr_array((area[kept], (i[kept], j[kept])), shape=(target.size, source.size))


# ---- on the sphere ----------------------------------------------------------------------------


def _overlaps_sphere(
    source: Grid, target: Grid, radius: float
) -> tuple[csr_array, np.ndarray, np.ndarray]:
    import shapely

    _check_radius(radius)
    for side, grid in (("source", source), ("target", target)):
        beyond = np.flatnonzero(np.abs(grid.node_y) > 90.0)
        if beyond.size:
            raise InputError(
                f"regrid: latitude {grid.node_y[beyond[0]]:g} in the {side} grid: on the sphere y is"
                " latitude in degrees, -90 … 90"
            )
    if source.x_edges is not None and target.x_edges is not None:
        along_y = _overlaps_1d(source.y_edges, target.y_edges, _sine_difference)
        west, east = target.bounds[:2]
        turns = np.arange(
            np.floor((west - source.bounds[1]) / 360.0),
            np.ceil((east - source.bounds[0]) / 360.0) + 1,
        )
        along_x = sum(
            _overlaps_1d(source.x_edges + 360.0 * turn, target.x_edges, np.subtract)
            for turn in turns
        )
        overlap = csr_array(kron(along_y, np.radians(1.0) * along_x, format="csr")) * radius**2
        areas = sphere_area(source, radius), sphere_area(target, radius)
        return _wet_only(overlap, source, target), *areas

    rings = [_ring(grid) for grid in (source, target)]
    axes = _axes(rings[1])
    if (rings[1] @ axes[2]).min() < CAP:
        raise InputError(
            "regrid: the target reaches more than 60 degrees from its middle: exchange in parts, or use"
            " a coupler such as YAC"
        )
    large = np.flatnonzero(
        (np.einsum("cki,ci->ck", rings[0], rings[0][:, 0])).min(1) < LARGEST_CELL
    )
    if large.size:
        raise InputError(
            f"regrid: cell {large[0]} of the source is more than 20 degrees wide: too large to cut"
        )
    near = (rings[0] @ axes[2]).min(axis=1) > HORIZON
    source_cells = np.full(source.size, None, object)
    source_cells[near] = shapely.polygons(_gnomonic(rings[0][near], axes))
    target_cells = shapely.polygons(_gnomonic(rings[1], axes))
    areas = [radius**2 * _fans(ring) for ring in rings]

    def measure(pieces: np.ndarray) -> np.ndarray:
        return radius**2 * _areas_on_sphere(pieces, axes)

    return _cut(source_cells, target_cells, source, target, *areas, measure), *areas


def _sine_difference(north: np.ndarray, south: np.ndarray) -> np.ndarray:
    """sin north − sin south of latitudes in degrees, to full precision for thin bands."""
    north, south = np.radians(north), np.radians(south)
    return 2 * np.cos(0.5 * (north + south)) * np.sin(0.5 * (north - south))


def _on_sphere(longitude: np.ndarray, latitude: np.ndarray) -> np.ndarray:
    """Unit vectors (…, 3); a pole is one point whatever its longitude."""
    longitude = np.radians(longitude)
    cosine = np.where(np.abs(latitude) == 90.0, 0.0, np.cos(np.radians(latitude)))
    return np.stack(
        [cosine * np.cos(longitude), cosine * np.sin(longitude), np.sin(np.radians(latitude))],
        axis=-1,
    )


def _ring(grid: Grid) -> np.ndarray:
    """Corners of the cells as closed rings of unit vectors; parallels cut into arcs."""
    if grid.x_edges is None:
        longitude, latitude = grid.corner_x, grid.corner_y
    else:
        along = np.linspace(0.0, 1.0, ARCS + 1)
        west, east = grid.corner_x[:, :1], grid.corner_x[:, 1:2]
        south, north = grid.corner_y[:, :1], grid.corner_y[:, 2:3]
        eastward = west + (east - west) * along
        eastward[:, -1:] = east  # the neighbour's west, to the last bit
        longitude = np.concatenate([eastward, eastward[:, ::-1]], axis=1)
        ones = np.ones_like(eastward)
        latitude = np.concatenate([south * ones, north * ones], axis=1)
    ring = _on_sphere(longitude, latitude)
    return np.concatenate([ring, ring[:, :1]], axis=1)


def _axes(ring: np.ndarray) -> np.ndarray:
    """Two tangent axes and the centre of a set of points on the sphere, as rows."""
    middle = ring.reshape(-1, 3).mean(axis=0)
    middle /= np.linalg.norm(middle)
    least = np.eye(3)[np.argmin(np.abs(middle))]
    first = np.cross(least, middle)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(middle, first), middle])


def _gnomonic(points: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Gnomonic projection, from the sphere's centre onto the tangent plane: great circles become straight lines."""
    local = points @ axes.T
    return local[..., :2] / local[..., 2:]


def _triangles(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Signed areas of great-circle triangles on the unit sphere (van Oosterom & Strackee 1983).

    tan(E/2) = a·(b × c) / (1 + a·b + b·c + c·a), with differences first so that small triangles keep
    their digits; doi:10.1109/TBME.1983.325207.
    """
    a, b, c = np.broadcast_arrays(a, b, c)

    def dot(p: np.ndarray, q: np.ndarray) -> np.ndarray:
        return np.einsum("...i,...i", p, q)

    return 2 * np.arctan2(dot(a, np.cross(b - a, c - a)), 1 + dot(a, b) + dot(b, c) + dot(c, a))


def _fans(corner: np.ndarray) -> np.ndarray:
    """Areas of great-circle polygons (n, corners, 3) on the unit sphere, in triangles about the first corner: (n,)."""
    return np.abs(_triangles(corner[:, :1], corner[:, :-1], corner[:, 1:]).sum(axis=1))


def _areas_on_sphere(pieces: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Areas on the unit sphere of shapes drawn in the gnomonic plane: (n,)."""
    import shapely

    parts, piece = shapely.get_parts(pieces, return_index=True)
    solid = shapely.get_dimensions(parts) == 2  # cells that only touch leave points and lines
    parts, piece = parts[solid], piece[solid]
    # Cells have no holes, so neither has what two of them share: the outer ring is all.
    drawn, part = shapely.get_coordinates(shapely.get_exterior_ring(parts), return_index=True)
    points = np.concatenate([drawn, np.ones((len(drawn), 1))], axis=1) @ axes
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    first = points[np.searchsorted(part, part[:-1])]
    fan = np.where(part[1:] == part[:-1], _triangles(first, points[:-1], points[1:]), 0.0)
    of_part = np.abs(np.bincount(part[:-1], fan, minlength=len(parts)))
    return np.bincount(piece, of_part, minlength=len(pieces))
