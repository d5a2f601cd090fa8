"""Exchange grids: the cells of the host model, and which of them are wet.

All four kinds of grid share one representation: every cell is a simple polygon with its corners
counter-clockwise, an exact area (shoelace formula) and a centroid.  They differ in how the cells around
a floe are found.  On rectilinear grids a look-up table along each axis gives the column; on the others a
raster of bins over the grid lists the cells that reach into each bin.  The cost of neither grows with the grid.

A point on an edge belongs to one cell only, the one to its east or north, so the east and north rims
of the grid are outside.  Fields are flat, in C order: shape (size,).
"""

from __future__ import annotations

import copy
import functools
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Literal, NamedTuple, final

import numpy as np

from floebmi.errors import InputError, in_line
from floebmi.kernels import jit
from floebmi.quantities import FARTHEST, is_number, two_numbers, unmasked

GridKind = Literal["uniform_rectilinear", "rectilinear", "curvilinear", "unstructured"]

MOST_CELLS = 2**31 - 1  # numbers of cells are int32
FLAT = 1e-12  # a cell whose area is below this times its diameter squared has no inside
IN_DEGREES = "(in degrees, longitudes must not jump from one count to another; a grid around a pole needs the metres of a plane)"
SLOTS_PER_COLUMN = 16  # upper bound on the table along an axis, for strongly stretched edges


class Axis(NamedTuple):
    """The grid lines across one axis of a rectilinear grid, with a look-up table for `column`."""

    edges: np.ndarray  # (columns + 1,) [m]
    first: np.ndarray  # column in which each of many equal slots begins; a slot is a column or less
    scale: float  # slots per metre


class Axes(NamedTuple):
    """Both axes of a rectilinear grid."""

    x: Axis
    y: Axis


class Bins(NamedTuple):
    """A raster of bins over the grid; bin b lists the cells cell[start[b]:start[b + 1]].

    numba_celltree is an alternative: it takes 5 ms to find the candidates of 10 000 discs among 40 000 cells,
    but compiles for 27 s at first use; these bins take 2.5 ms, and compile in 1 s.
    """

    origin: np.ndarray  # (2,) south-west corner of the raster [m]
    scale: np.ndarray  # (2,) bins per metre along x and y
    start: np.ndarray  # (bins + 1,), bins row after row
    cell: np.ndarray  # cells, bin after bin
    low: np.ndarray  # (size, 2) column and row of the first bin that a cell reaches
    box: np.ndarray  # (size, 4) west, east, south, north of each cell [m]
    raster: np.ndarray  # (2,) number of columns and rows


@jit
def column(axis, x):
    """Index i with edges[i] <= x < edges[i+1], for x inside the edges."""
    edges, first, scale = axis
    last = edges.size - 2
    i = first[min(max(int((x - edges[0]) * scale), 0), first.size - 1)]
    while i < last and x >= edges[i + 1]:
        i += 1
    while i > 0 and x < edges[i]:
        i -= 1
    return i


@jit
def bin_of(x, origin, scale, count):
    """Bin along one axis; it increases with x, so no point of a cell is in a bin before the cell's first."""
    return int(min(max((x - origin) * scale, 0.0), count - 1.0))


@jit
def contains(corner_x, corner_y, x, y):
    """Whether a polygon contains a point, by the parity of the edges east of it.

    Each edge is evaluated from its lower to its upper end, so that two cells that share it agree.
    """
    inside = False
    k = corner_x.size - 1
    for m in range(corner_x.size):
        low, high = (m, k) if corner_y[m] <= corner_y[k] else (k, m)
        if corner_y[low] <= y < corner_y[high]:
            ax, ay = corner_x[low], corner_y[low]
            if (corner_x[high] - ax) * (y - ay) > (x - ax) * (corner_y[high] - ay):
                inside = not inside
        k = m
    return inside


@jit
def _locate_polygons(origin, scale, start, cell, box, raster, corner_x, corner_y, x, y, found):
    for k in range(x.size):
        bx = bin_of(x[k], origin[0], scale[0], raster[0])
        by = bin_of(y[k], origin[1], scale[1], raster[1])
        b = by * raster[0] + bx
        for m in range(start[b], start[b + 1]):
            c = cell[m]
            near = box[c, 0] <= x[k] <= box[c, 1] and box[c, 2] <= y[k] <= box[c, 3]
            if near and contains(corner_x[c], corner_y[c], x[k], y[k]):
                found[k] = c
                break


def blocks(
    first_x: np.ndarray, count_x: np.ndarray, first_y: np.ndarray, count_y: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """All (column, row) pairs of many blocks, one block after the other.

    Parameters
    ----------
    first_x, count_x, first_y, count_y : (n,) int, first column and row of each block, and their numbers

    Returns
    -------
    start (n + 1,), block, column, row : pairs start[k]:start[k + 1] are those of block k
    """
    pairs = count_x * count_y
    start = np.concatenate([[0], np.cumsum(pairs)])
    block = np.repeat(np.arange(pairs.size), pairs)
    along_row, across = np.arange(start[-1]) - start[block], np.maximum(count_x, 1)[block]
    return start, block, first_x[block] + along_row % across, first_y[block] + along_row // across


@final
@dataclass(frozen=True, eq=False, repr=False)
class Grid:
    """A grid of polygonal cells in the plane, each of them wet or dry.  Its arrays are read-only.

    Made by `Grid.uniform`, `Grid.rectilinear`, `Grid.curvilinear` or `Grid.unstructured`.

    Attributes
    ----------
    kind : "uniform_rectilinear", "rectilinear", "curvilinear" or "unstructured"
    shape : (ny, nx), or (n_cells,) if unstructured
    x, y : (size,) cell centres: the centroids [m]
    area : (size,) cell areas by the shoelace formula [m²]
    wet : (size,) bool, True for cells with fluid, False for land
    node_x, node_y : (n_nodes,) corners of the cells [m]
    face_nodes : (size, most corners) int64, nodes of each cell counter-clockwise, padded with -1
    x_edges, y_edges : (nx + 1,), (ny + 1,) cell edges [m] of rectilinear grids, None for the others
    """

    kind: GridKind
    shape: tuple[int, ...]
    x: np.ndarray
    y: np.ndarray
    area: np.ndarray
    wet: np.ndarray
    node_x: np.ndarray
    node_y: np.ndarray
    face_nodes: np.ndarray
    x_edges: np.ndarray | None = None
    y_edges: np.ndarray | None = None

    @classmethod
    def uniform(
        cls,
        x: tuple[float, float],
        y: tuple[float, float],
        spacing: float | tuple[float, float] | None = None,
        shape: tuple[int, int] | None = None,
        wet: np.ndarray | None = None,
    ) -> Grid:
        """A grid of equal rectangles that fill x = (west, east), y = (south, north) [m].

        Give either `spacing` [m], one number or (dx, dy), which must divide the sides, or `shape`
        (ny, nx).

        Raises
        ------
        InputError
            for an empty rectangle, a spacing that does not divide it, both or neither of spacing
            and shape, and more cells than int32 can count.
        """
        west, east = _interval("x", x)
        south, north = _interval("y", y)
        if (spacing is None) == (shape is None):
            raise InputError("give either spacing or shape")
        if shape is not None:
            ny, nx = _counts(shape)
        else:
            sides = (spacing, spacing) if is_number(spacing) else two_numbers(spacing)
            if sides is None:
                raise InputError(f"grid: spacing = {spacing!r}: must be a number, or two (dx, dy)")
            nx, ny = _divide("x", west, east, sides[0]), _divide("y", south, north, sides[1])
        _check_number(ny, nx)
        edges = np.linspace(west, east, nx + 1), np.linspace(south, north, ny + 1)
        return cls._from_edges("uniform_rectilinear", *edges, wet)

    @classmethod
    def rectilinear(
        cls, x_edges: Sequence[float], y_edges: Sequence[float], wet: np.ndarray | None = None
    ) -> Grid:
        """A grid of rectangles between edges [m] that increase from west to east and from south to north.

        Raises
        ------
        InputError
            for fewer than two edges, edges that do not increase, and more cells than int32 can count.
        """
        edges = _edges("x_edges", x_edges), _edges("y_edges", y_edges)
        _check_number(len(edges[1]) - 1, len(edges[0]) - 1)
        return cls._from_edges("rectilinear", *edges, wet)

    @classmethod
    def curvilinear(
        cls, x_corners: np.ndarray, y_corners: np.ndarray, wet: np.ndarray | None = None
    ) -> Grid:
        """A grid of quadrilaterals with corners [m] of shape (ny + 1, nx + 1).

        The rows may run in either direction: if all cells are clockwise, their corners are stored
        counter-clockwise; the order of the cells does not change.

        Raises
        ------
        InputError
            for a folded grid (cells of both orientations), a cell without area, and a cell whose edges cross.
        """
        x, y = _finite("x_corners", x_corners), _finite("y_corners", y_corners)
        if x.ndim != 2 or x.shape != y.shape or min(x.shape) < 2:
            raise InputError(
                f"grid: x_corners {x.shape}, y_corners {y.shape}: both must be (ny + 1, nx + 1)"
            )
        ny, nx = x.shape[0] - 1, x.shape[1] - 1
        faces = _quadrilaterals(ny, nx)
        area = _signed_area(x.ravel()[faces], y.ravel()[faces])
        if (area > 0).any() and (area < 0).any():
            turned = np.flatnonzero(area < 0 if (area > 0).sum() >= area.size / 2 else area > 0)
            raise InputError(
                f"grid: cell (row {turned[0] // nx}, column {turned[0] % nx}) is turned over:"
                f" the grid must not fold {IN_DEGREES}"
            )
        return cls._from_faces("curvilinear", (ny, nx), x.ravel(), y.ravel(), faces, wet)

    @classmethod
    def unstructured(
        cls,
        node_x: Sequence[float],
        node_y: Sequence[float],
        faces: np.ndarray | Sequence[Sequence[int]],
        wet: np.ndarray | None = None,
    ) -> Grid:
        """A grid of polygons, convex or concave, with corners at nodes [m]; adjacent cells share nodes.

        `faces` holds the node numbers (from 0) of each cell, as a list of lists or an integer array
        padded with -1 on the right, or masked there.  Either orientation is accepted: a clockwise face is stored
        counter-clockwise, with the same first node.

        Raises
        ------
        InputError
            for a face with fewer than three nodes, an unknown or repeated node, no area, edges that
            cross or touch, or an edge with two cells on the same side (they overlap).
        """
        x, y = _finite("node_x", node_x), _finite("node_y", node_y)
        if x.ndim != 1 or x.shape != y.shape:
            raise InputError(f"grid: node_x {x.shape}, node_y {y.shape}: both must be (n_nodes,)")
        table = _face_table(faces, x.size)
        grid = cls._from_faces("unstructured", (len(table),), x, y, table, wet)
        _check_edges_once(grid.face_nodes)
        return grid

    @classmethod
    def _from_edges(
        cls, kind: GridKind, x_edges: np.ndarray, y_edges: np.ndarray, wet: np.ndarray | None
    ) -> Grid:
        nx, ny = x_edges.size - 1, y_edges.size - 1
        y, x = np.meshgrid(_middles(y_edges), _middles(x_edges), indexing="ij")
        node_y, node_x = np.meshgrid(y_edges, x_edges, indexing="ij")
        grid = cls(
            kind=kind,
            shape=(ny, nx),
            x=x.ravel(),
            y=y.ravel(),
            area=np.outer(np.diff(y_edges), np.diff(x_edges)).ravel(),
            wet=_mask(wet, (ny, nx)),
            node_x=node_x.ravel(),
            node_y=node_y.ravel(),
            face_nodes=_quadrilaterals(ny, nx),
            x_edges=x_edges,
            y_edges=y_edges,
        )
        return grid._freeze()

    @classmethod
    def _from_faces(
        cls,
        kind: GridKind,
        shape: tuple[int, ...],
        node_x: np.ndarray,
        node_y: np.ndarray,
        faces: np.ndarray,
        wet: np.ndarray | None,
    ) -> Grid:
        corners = (faces >= 0).sum(axis=1)
        corner_x, corner_y = _corner(node_x, faces), _corner(node_y, faces)
        area = _signed_area(corner_x, corner_y)
        _check_simple(corner_x, corner_y, corners, area)
        for c in np.flatnonzero(area < 0):
            faces[c, 1 : corners[c]] = faces[c, 1 : corners[c]][::-1].copy()
        x, y = _centroids(corner_x, corner_y)
        grid = cls(
            kind=kind,
            shape=shape,
            x=x,
            y=y,
            area=np.abs(area),
            wet=_mask(wet, shape),
            node_x=node_x,
            node_y=node_y,
            face_nodes=faces,
        )
        return grid._freeze()

    def __setstate__(self, state: dict[str, object]) -> None:
        """Of a copy or a pickle, whose arrays NumPy would let be written to."""
        vars(self).update(state)
        self._freeze()

    def _freeze(self) -> Grid:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, np.ndarray):
                value.flags.writeable = False
        return self

    @property
    def size(self) -> int:
        """Number of cells."""
        return self.x.size

    @functools.cached_property
    def total_area(self) -> float:
        """Area of all cells [m²]."""
        return float(self.area.sum())

    @functools.cached_property
    def bounds(self) -> tuple[float, float, float, float]:
        """West, east, south, north of the grid [m]."""
        x, y = self.corner_x, self.corner_y
        return float(x.min()), float(x.max()), float(y.min()), float(y.max())

    @functools.cached_property
    def corner_x(self) -> np.ndarray:
        """(size, most corners) x of the corners [m], padded with the first corner."""
        return _corner(self.node_x, self.face_nodes)

    @functools.cached_property
    def corner_y(self) -> np.ndarray:
        """(size, most corners) y of the corners [m], padded with the first corner."""
        return _corner(self.node_y, self.face_nodes)

    @functools.cached_property
    def axes(self) -> Axes:
        """Grid lines with their look-up tables (rectilinear grids)."""
        if self.x_edges is None or self.y_edges is None:
            raise InputError(f"grid: kind {self.kind!r} has no edges; only rectilinear grids have")
        return Axes(_axis(self.x_edges), _axis(self.y_edges))

    @functools.cached_property
    def bins(self) -> Bins:
        """The raster of bins that finds cells, for all kinds."""
        x, y = self.corner_x, self.corner_y
        box = np.stack([x.min(1), x.max(1), y.min(1), y.max(1)], axis=1)
        west, east, south, north = self.bounds
        side = np.sqrt((east - west) * (north - south) / self.size)  # about one cell a bin
        raster = np.maximum(1, np.array([(east - west) / side, (north - south) / side]).astype(int))
        scale = raster / np.array([east - west, north - south])
        origin = np.array([west, south])
        # A hair wider than the cells, so that round-off in `bin_of` cannot lose a point on a rim.
        low = np.floor((box[:, [0, 2]] - origin) * scale - 1e-9).astype(np.int64)
        high = np.floor((box[:, [1, 3]] - origin) * scale + 1e-9).astype(np.int64)
        low, high = np.clip(low, 0, raster - 1), np.clip(high, 0, raster - 1)
        low = np.ascontiguousarray(low)  # as it is for a single cell: kernels are compiled once
        count = high - low + 1
        _, cell, bx, by = blocks(low[:, 0], count[:, 0], low[:, 1], count[:, 1])
        b = by * raster[0] + bx
        start = np.concatenate([[0], np.cumsum(np.bincount(b, minlength=raster.prod()))])
        return Bins(origin, scale, start, cell[np.argsort(b, kind="stable")], low, box, raster)

    def with_wet(self, mask: np.ndarray) -> Grid:
        """The same grid with another mask: bool (or 0 and 1), shape (size,) or `shape`, True = wet.

        Raises
        ------
        InputError
            for another shape or other values.
        """
        other = copy.copy(self)  # shares the geometry and the search structures
        object.__setattr__(other, "wet", _mask(mask, self.shape))
        other.wet.flags.writeable = False
        return other

    def locate(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """The number of the cell that contains each point, -1 outside the grid.

        Parameters
        ----------
        x, y : (n,) positions [m]; a point on an edge is in the cell to its east or north

        Returns
        -------
        (n,) int64
        """
        x, y = np.broadcast_arrays(np.atleast_1d(unmasked(x)), np.atleast_1d(unmasked(y)))
        west, east, south, north = self.bounds
        inside = (west <= x) & (x <= east) & (south <= y) & (y <= north)
        x, y = x[inside], y[inside]
        if self.x_edges is not None:
            i = np.searchsorted(self.x_edges, x, side="right") - 1
            j = np.searchsorted(self.y_edges, y, side="right") - 1
            ny, nx = self.shape
            cell = np.where((i < nx) & (j < ny), j * nx + i, -1)
        else:
            cell = np.full(x.size, -1)
            b = self.bins
            _locate_polygons(
                b.origin, b.scale, b.start, b.cell, b.box, b.raster,
                self.corner_x, self.corner_y, x, y, cell,
            )  # fmt: skip
        found = np.full(inside.shape, -1)
        found[inside] = cell
        return found

    def __repr__(self) -> str:
        west, east, south, north = self.bounds
        cells = " × ".join(str(n) for n in self.shape)
        return (
            f"Grid({self.kind}, {cells} cells, {int(self.wet.sum())} wet,"
            f" x {west:g} … {east:g} m, y {south:g} … {north:g} m)"
        )


def check_grid(name: str, grid: object) -> None:
    """Raise InputError for anything that is not a Grid."""
    if not isinstance(grid, Grid):
        raise InputError(f"{name} = {in_line(grid)}: must be a Grid")


def _interval(name: str, pair: tuple[float, float]) -> tuple[float, float]:
    ends = two_numbers(pair)
    if ends is None or not ends[1] > ends[0]:
        raise InputError(f"grid: {name} = {pair!r}: must be two numbers, the second larger")
    if max(map(abs, ends)) > FARTHEST:
        raise InputError(f"grid: {name} = {pair!r}: must be within {FARTHEST:g} m")
    return ends


def _counts(shape: tuple[int, int]) -> tuple[int, int]:
    counts = two_numbers(shape)
    if counts is None or any(int(n) != n or n < 1 for n in counts):
        raise InputError(f"grid: shape = {shape}: must be (ny, nx), whole numbers of 1 or more")
    return int(counts[0]), int(counts[1])


def _check_number(ny: int, nx: int) -> None:
    if nx * ny > MOST_CELLS:
        raise InputError(f"grid: {ny} × {nx} cells: must be at most {MOST_CELLS} in all")


def _divide(name: str, low: float, high: float, spacing: float) -> int:
    if not (is_number(spacing) and spacing > 0):
        raise InputError(f"grid: spacing along {name} = {spacing!r}: must be greater than 0")
    spacing = float(spacing)
    exact = (high - low) / spacing
    if exact > MOST_CELLS:
        raise InputError(
            f"grid: spacing along {name} = {spacing}: {exact:.3g} cells: must be at most {MOST_CELLS} in all"
        )
    cells = round(exact)
    if cells < 1 or abs(cells * spacing - (high - low)) > 1e-9 * (high - low):
        raise InputError(
            f"grid: spacing along {name} = {spacing} does not divide {high - low} m;"
            f" {(high - low) / max(cells, 1)} would"
        )
    return cells


def _finite(name: str, values: Sequence[float] | np.ndarray) -> np.ndarray:
    array = np.array(unmasked(values))
    wrong = ~(np.abs(array) <= FARTHEST)  # NaN is wrong, too
    if wrong.any():
        place = tuple(int(k) for k in np.argwhere(wrong)[0])
        right = f"within {FARTHEST:g} m" if np.isfinite(array[place]) else "finite"
        raise InputError(f"grid: {name}{list(place)} = {array[place]}: must be {right}")
    return array


def _edges(name: str, values: Sequence[float]) -> np.ndarray:
    edges = _finite(name, values)
    if edges.ndim != 1 or edges.size < 2:
        raise InputError(f"grid: {name} has shape {edges.shape}: must be two or more edges")
    falls = np.flatnonzero(np.diff(edges) <= 0)
    if falls.size:
        k = int(falls[0]) + 1
        raise InputError(f"grid: {name}[{k}] = {edges[k]}: must be larger than {edges[k - 1]}")
    return edges


def _mask(wet: np.ndarray | None, shape: tuple[int, ...]) -> np.ndarray:
    size = int(np.prod(shape))
    if wet is None:
        return np.ones(size, bool)
    try:
        mask = np.asarray(wet)
    except ValueError as error:  # rows of unlike lengths
        raise InputError(f"grid: wet: must be {shape} or ({size},) ({error})") from None
    if mask.shape not in (shape, (size,)):
        raise InputError(f"grid: wet has shape {mask.shape}: must be {shape} or ({size},)")
    if np.ma.is_masked(wet):
        place = tuple(int(k) for k in np.argwhere(np.ma.getmaskarray(wet))[0])
        raise InputError(
            f"grid: wet{list(place)} is masked: must be bool, or 0 or 1 (wet.filled(0) makes it dry)"
        )
    if mask.dtype != bool and (mask.dtype.kind == "V" or not np.isin(mask, (0, 1)).all()):
        raise InputError(f"grid: wet has type {mask.dtype}: must be bool, or hold only 0 and 1")
    return mask.astype(bool).ravel().copy()


def _face_table(faces: np.ndarray | Sequence[Sequence[int]], n_nodes: int) -> np.ndarray:
    """Faces as a fresh integer array padded with -1, its node numbers checked."""
    if isinstance(faces, list | tuple):
        rows = [np.asarray(face) for face in faces]
        for c, row in enumerate(rows):
            if row.ndim != 1 or (row.size and row.dtype.kind not in "iu"):
                raise InputError(f"grid: faces[{c}] = {faces[c]!r}: must be a row of integers")
        table = np.full((len(rows), max((row.size for row in rows), default=0)), -1, np.int64)
        for filled, row in zip(table, rows, strict=True):
            filled[: row.size] = row
    else:
        array = np.asanyarray(faces)
        if array.ndim != 2 or array.dtype.kind not in "iu":
            raise InputError(
                f"grid: faces is {array.dtype} of shape {array.shape}:"
                " must be integers (cells, corners)"
            )
        table = array.astype(np.int64)
        if isinstance(table, np.ma.MaskedArray):  # as netCDF4 gives faces of fewer corners
            table = table.filled(-1)
    if table.size == 0:
        raise InputError("grid: faces is empty: must hold one cell or more")
    corners = (table >= 0).sum(axis=1)
    padded = np.arange(table.shape[1]) >= corners[:, None]
    wrong = (table < -1) | (table >= n_nodes) | (padded != (table == -1))
    if wrong.any():
        c, k = np.argwhere(wrong)[0]
        raise InputError(
            f"grid: faces[{c}][{k}] = {table[c, k]}: must be 0 … {n_nodes - 1},"
            " with -1 only at the end"
        )
    for c in np.flatnonzero(corners < 3):
        raise InputError(f"grid: cell {c} has {corners[c]} nodes: must have three or more")
    ordered = np.sort(table, axis=1)
    for c in np.flatnonzero(((np.diff(ordered, axis=1) == 0) & (ordered[:, 1:] >= 0)).any(axis=1)):
        raise InputError(f"grid: cell {c} names a node twice: pad short faces with -1 instead")
    return table


def _check_edges_once(faces: np.ndarray) -> None:
    """Refuse overlapping cells: two cells that share an edge must run along it in opposite directions."""
    following, real = following_nodes(faces), faces >= 0
    cell = np.broadcast_to(np.arange(len(faces))[:, None], faces.shape)[real]
    directed = np.stack([faces[real], following[real]], axis=1)
    _, index, count = np.unique(directed, axis=0, return_index=True, return_counts=True)
    for k in np.flatnonzero(count > 1):
        a, b = directed[index[k]]
        pair = cell[(directed == (a, b)).all(axis=1)]
        raise InputError(
            f"grid: cells {pair[0]} and {pair[1]} lie on the same side of the edge from node {a} to"
            f" node {b}: cells must not overlap {IN_DEGREES}"
        )


def following_nodes(faces: np.ndarray) -> np.ndarray:
    """The next node around the face for each node of faces padded with -1, of the same shape; values at padding are arbitrary."""
    following = np.roll(faces, -1, axis=1)
    following[np.arange(len(faces)), (faces >= 0).sum(axis=1) - 1] = faces[:, 0]
    return following


def _check_simple(x: np.ndarray, y: np.ndarray, corners: np.ndarray, area: np.ndarray) -> None:
    """Refuse cells without area, or whose edges cross or touch (x, y padded as in `_corner`)."""
    reach = np.hypot(np.ptp(x, axis=1), np.ptp(y, axis=1))
    for cell in np.flatnonzero(np.abs(area) <= FLAT * reach**2):
        raise InputError(f"grid: cell {cell} has no area ({abs(area[cell]):g} m²)")
    convex = np.ones(len(x), bool)
    for k in range(x.shape[1]):
        here = k < corners
        ux, uy = _side(x, y, np.minimum(k, corners - 1), (k + 1) % corners)
        vx, vy = _side(x, y, (k + 1) % corners, (k + 2) % corners)
        turn, along = (ux * vy - uy * vx) * np.sign(area), ux * vx + uy * vy
        convex &= ~here | (turn > 0)
        for cell in np.flatnonzero(here & (np.abs(turn) <= FLAT * np.abs(along)) & (along < 0)):
            raise InputError(f"grid: cell {cell} turns back on itself: its edges must not touch")
    # Convex with four corners or fewer is simple; the rest is checked edge against edge.
    doubtful = np.flatnonzero(~convex | (corners > 4))
    x, y, corners = x[doubtful], y[doubtful], corners[doubtful]
    for k in range(x.shape[1] if doubtful.size else 0):
        for m in range(k + 2, x.shape[1]):
            pair = (m < corners) & ((m + 1) % np.maximum(corners, 1) != k)
            crossing = pair & _touch(x, y, k, (k + 1) % corners, m, (m + 1) % corners)
            for cell in np.flatnonzero(crossing):
                raise InputError(
                    f"grid: edges {k} and {m} of cell {doubtful[cell]} cross or touch:"
                    " a cell must be a simple polygon"
                )


def _side(
    x: np.ndarray, y: np.ndarray, a: np.ndarray, b: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    cells = np.arange(len(x))
    return x[cells, b] - x[cells, a], y[cells, b] - y[cells, a]


def _touch(
    x: np.ndarray, y: np.ndarray, a: int, b: np.ndarray, c: int, d: np.ndarray
) -> np.ndarray:
    """Whether edges ab and cd of each cell have a point in common (bounding boxes and sides)."""
    cells = np.arange(len(x))
    ax, ay, bx, by = x[:, a], y[:, a], x[cells, b], y[cells, b]
    cx, cy, dx, dy = x[:, c], y[:, c], x[cells, d], y[cells, d]

    def side(px, py, qx, qy, rx, ry):
        return (qx - px) * (ry - py) - (qy - py) * (rx - px)

    astride = (side(ax, ay, bx, by, cx, cy) * side(ax, ay, bx, by, dx, dy) <= 0) & (
        side(cx, cy, dx, dy, ax, ay) * side(cx, cy, dx, dy, bx, by) <= 0
    )
    near = (
        (np.maximum(ax, bx) >= np.minimum(cx, dx)) & (np.maximum(cx, dx) >= np.minimum(ax, bx))
        & (np.maximum(ay, by) >= np.minimum(cy, dy)) & (np.maximum(cy, dy) >= np.minimum(ay, by))
    )  # fmt: skip
    return astride & near


def _quadrilaterals(ny: int, nx: int) -> np.ndarray:
    """Corner numbers of ny × nx quadrilaterals, counter-clockwise where x and y grow."""
    south_west = (np.arange(ny)[:, None] * (nx + 1) + np.arange(nx)).ravel()
    return np.stack(
        [south_west, south_west + 1, south_west + nx + 2, south_west + nx + 1], axis=1
    ).astype(np.int64)


def _corner(node: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Coordinates (size, most corners); padding repeats the first corner: edges without length."""
    return node[np.where(faces >= 0, faces, faces[:, :1])]


def _signed_area(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Shoelace formula about the first corner, so that large coordinates do not cancel [m²]."""
    x, y = x - x[:, :1], y - y[:, :1]
    return 0.5 * (x[:, :-1] * y[:, 1:] - y[:, :-1] * x[:, 1:]).sum(axis=1)


def _centroids(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    x0, y0 = x[:, :1], y[:, :1]
    x, y = x - x0, y - y0
    cross = x[:, :-1] * y[:, 1:] - y[:, :-1] * x[:, 1:]
    six_areas = 3 * cross.sum(axis=1)
    return tuple(
        p0[:, 0] + ((p[:, :-1] + p[:, 1:]) * cross).sum(axis=1) / six_areas
        for p0, p in ((x0, x), (y0, y))
    )


def _middles(edges: np.ndarray) -> np.ndarray:
    return 0.5 * (edges[:-1] + edges[1:])


def _axis(edges: np.ndarray) -> Axis:
    columns = edges.size - 1
    span = edges[-1] - edges[0]
    count = min(round(span / np.diff(edges).min()), SLOTS_PER_COLUMN * columns)
    starts = edges[0] + span / count * np.arange(count)
    first = np.clip(np.searchsorted(edges, starts, side="right") - 1, 0, columns - 1)
    return Axis(edges, first, float(count / span))
