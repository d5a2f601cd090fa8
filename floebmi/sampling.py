"""Exchange between grid and floes: the same weights read the current and return the force.

Row k of the weights holds the share of floe k in each cell.  The velocity that a floe feels is the
weighted mean over the cells (`gather`); the force on the floe is returned to the cells with the same
shares (`scatter`, the transpose).  Rows sum to one over *wet* cells, so momentum is conserved to
round-off for any kind of weights, and the work done by the fluid equals the work done on the floe:

    Σ_k F_k · (W u)_k = Σ_c u_c · (Wᵀ F)_c                                    (eq. work-identity)

There are two kinds of weights:

"overlap"  the exact area of the disc in each wet cell, over the disc's area in all wet cells.  The same
           areas (`coverage`) give the gridded concentration and thickness.
"centre"   weights at the floe's centre only.  On rectilinear grids bilinear between the four cell centres
           around it, without the dry ones; on the others, where four ordered neighbours need not
           exist, the cell that contains the centre, if it is wet.

A floe that touches no wet cell has an empty row: it reads 0, and the force that it would return is undelivered.
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np
from numba.extending import overload

from floebmi.errors import InputError, choose
from floebmi.geometry import disc_polygon, disc_south_west, disc_west
from floebmi.grid import Bins, Grid, bin_of, column
from floebmi.kernels import BLOCK, IN_PLACE, in_place, jit

Period = tuple[float | None, float | None]
TWICE = 1e-3  # fraction of a cell; smaller overlaps are round-off of corners in single precision

ROUND_OFF = 1e-14  # an overlap below this times the disc's area is round-off, not ice


class Weights(NamedTuple):
    """Shares of floes in cells; row k is entries start[k]:start[k+1].

    start : (n + 1,) int64
    cell : (m,) int32, cell of each entry; twice in a row if a floe reaches the cell from both sides of a seam
    amount : (m,) amounts to which the shares are proportional: areas of the floe in the cell [m²]
    over : (n,) one over the sum of each row's amounts
    size : number of cells of the grid
    """

    start: np.ndarray
    cell: np.ndarray
    amount: np.ndarray
    over: np.ndarray
    size: int

    @property
    def weight(self) -> np.ndarray:
        """The shares, (m,) [1]: each row sums to 1, or is empty if the floe touches no wet cell."""
        return self.amount * np.repeat(self.over, np.diff(self.start))


class Coverage(NamedTuple):
    """Areas of floes in cells, wet or dry; row k is entries start[k]:start[k+1].

    start : (n + 1,) int64
    cell : (m,) int32, cell of each entry; twice in a row if a floe reaches the cell from both sides of a seam
    area : (m,) area of the floe in the cell [m²]
    size : number of cells of the grid
    outside : (n,) area of each floe outside the grid [m²], to round-off of its whole area
    inside : (n,) area of each floe in the grid [m²]: the sum of its row
    """

    start: np.ndarray
    cell: np.ndarray
    area: np.ndarray
    size: int
    outside: np.ndarray
    inside: np.ndarray

    @property
    def in_cells(self) -> np.ndarray:
        """Area of all floes in each cell [m²], (size,); where floes overlap it may exceed the area of the cell."""
        return np.bincount(self.cell, weights=self.area, minlength=self.size)


class Polygons(NamedTuple):
    """Cells of any shape, with the raster of bins that finds them."""

    bins: Bins
    corner_x: np.ndarray  # (size, corners) [m], counter-clockwise
    corner_y: np.ndarray


PATCH = 3  # columns and rows of cells treated together for a disc; most reach no more
LINES = PATCH + 1  # grid lines that bound a patch
# Rows of the buffer of a block of discs: results are in lower rows than their inputs, as in columns.py.
AMOUNT, TOTAL = 0, PATCH**2 * BLOCK  # areas in cells, and their sum
CORNER = TOTAL + BLOCK  # areas south-west of corners
WEST = CORNER + LINES**2 * BLOCK  # H of the lines
SOUTH = WEST + LINES * BLOCK
X = SOUTH + LINES * BLOCK  # distances of the lines from the centre
Y = X + LINES * BLOCK
R = Y + LINES * BLOCK
DISC_BUFFER = R + BLOCK


@in_place
def _patches(axes, bounds, lengths, x, y, radius, of, floe, disc_x, disc_y, column_0, row_0):
    """List the discs and their images, each with every patch of cells that it reaches: floe, centre, first column and row.

    Returns their number, even if the arrays were too short.
    """
    west, east, south, north = bounds
    x_edges, y_edges, m = axes.x.edges, axes.y.edges, 0
    for k in range(x.size):
        r = radius[k]
        first_x, last_x = _repeats(x[k], r, west, east, lengths[0])
        first_y, last_y = _repeats(y[k], r, south, north, lengths[1])
        if not of[k]:
            last_y = first_y - 1
        for along_y in range(first_y, last_y + 1):
            for along_x in range(first_x, last_x + 1):
                cx, cy = x[k] + along_x * lengths[0], y[k] + along_y * lengths[1]
                i0, j, more_rows = column(axes.x, cx - r), column(axes.y, cy - r), True
                while more_rows:
                    i, more_columns = i0, True
                    while more_columns:
                        if m < floe.size:
                            e = np.uintp(m)
                            floe[e], disc_x[e], disc_y[e], column_0[e], row_0[e] = k, cx, cy, i, j
                        m += 1
                        i += PATCH
                        more_columns = i < x_edges.size - 1 and x_edges[np.uintp(i)] < cx + r
                    j += PATCH
                    more_rows = j < y_edges.size - 1 and y_edges[np.uintp(j)] < cy + r
    return m


@in_place
def _areas_in_patches(
    axes, radius, of, floe, disc_x, disc_y, column_0, row_0, lanes, start, outside, inside, cell, area
):  # fmt: skip
    """Areas of discs in the cells of their patches: fills start, outside, inside, cell, area.

    Works on a block of discs at a time, line by line and cell by cell, so that it vectorises and has no unpredictable
    branches.  A line beyond the grid repeats the last one, and a cell beyond the disc has none of its area.

    lanes : (DISC_BUFFER,) work space for a block, all entries positive
    """
    x_edges, y_edges, one = axes.x.edges, axes.y.edges, np.uintp(1)
    nx, ny = np.uintp(x_edges.size - 1), np.uintp(y_edges.size - 1)
    m = np.uintp(0)
    for block in range(0, floe.size, BLOCK):
        lanes_here = min(BLOCK, floe.size - block)
        for k in range(lanes_here):
            e = np.uintp(block + k)
            lanes[R + k] = radius[np.uintp(floe[e])]
            i, j = np.uintp(column_0[e]), np.uintp(row_0[e])
            for line in range(LINES):
                lanes[X + line * BLOCK + k] = x_edges[min(i + np.uintp(line), nx)] - disc_x[e]
                lanes[Y + line * BLOCK + k] = y_edges[min(j + np.uintp(line), ny)] - disc_y[e]
        for k in range(BLOCK):
            for line in range(2 * LINES):
                lanes[WEST + line * BLOCK + k] = disc_west(
                    lanes[X + line * BLOCK + k], lanes[R + k]
                )
        for row in range(LINES):
            for k in range(BLOCK):
                r, y = lanes[R + k], lanes[Y + row * BLOCK + k]
                south = lanes[SOUTH + row * BLOCK + k]
                for line in range(LINES):
                    x, west = lanes[X + line * BLOCK + k], lanes[WEST + line * BLOCK + k]
                    lanes[CORNER + (row * LINES + line) * BLOCK + k] = disc_south_west(
                        x, y, west, south, r
                    )
        for k in range(BLOCK):
            lanes[TOTAL + k] = 0.0
        for row in range(PATCH):
            for k in range(BLOCK):
                r, total = lanes[R + k], lanes[TOTAL + k]
                low, high = lanes[Y + row * BLOCK + k], lanes[Y + (row + 1) * BLOCK + k]
                for line in range(PATCH):
                    left, right = lanes[X + line * BLOCK + k], lanes[X + (line + 1) * BLOCK + k]
                    sw = CORNER + (row * LINES + line) * BLOCK + k
                    nw = sw + LINES * BLOCK
                    some = (lanes[nw + BLOCK] - lanes[nw]) - (lanes[sw + BLOCK] - lanes[sw])
                    far_x, far_y = max(right, -left), max(high, -low)
                    within = far_x * far_x + far_y * far_y < r * r  # the cell is in the disc
                    some = (right - left) * (high - low) if within else some
                    some = some if some > ROUND_OFF * math.pi * r * r else 0.0
                    lanes[AMOUNT + (row * PATCH + line) * BLOCK + k] = some
                    total += some
                lanes[TOTAL + k] = total
        for k in range(lanes_here):
            e = np.uintp(block + k)
            c = np.uintp(row_0[e]) * nx + np.uintp(column_0[e])
            for row in range(PATCH):
                for line in range(PATCH):
                    some = lanes[AMOUNT + (row * PATCH + line) * BLOCK + k]
                    cell[m], area[m] = c + np.uintp(line), some
                    m += np.uintp(some > 0.0)
                c += nx
            inside[np.uintp(floe[e])] += lanes[TOTAL + k]
            start[np.uintp(floe[e]) + one] = m
    for k in range(radius.size):
        start[k + 1] = max(start[k + 1], start[k])  # discs that are not listed have empty rows
        outside[k] = math.pi * radius[k] * radius[k] - inside[k] if of[k] else 0.0


@jit
def _reached(cells, x, y, r):
    """First and last column, first and last row of the raster that a disc may reach."""
    (x0, y0), (along_x, along_y), (nx, ny) = cells.bins.origin, cells.bins.scale, cells.bins.raster
    return (
        bin_of(x - r, x0, along_x, nx), bin_of(x + r, x0, along_x, nx),
        bin_of(y - r, y0, along_y, ny), bin_of(y + r, y0, along_y, ny),
    )  # fmt: skip


@jit
def _polygons_in_bins(cells, i0, i1, j0, j1):
    """Upper bound on the number of cells in a block of columns and rows."""
    start, nx, count = cells.bins.start, cells.bins.raster[0], 0
    for j in range(j0, j1 + 1):
        count += start[j * nx + i1 + 1] - start[j * nx + i0]
    return count


@jit
def _areas_in_bins(cells, i0, i1, j0, j1, cx, cy, r, cell, area, m):
    """Append the areas of a disc in the cells of a block after the first m entries; the new number of entries, and the sum."""
    bins, least, total = cells.bins, ROUND_OFF * math.pi * r * r, 0.0
    low, box = bins.low, bins.box
    for j in range(j0, j1 + 1):
        for i in range(i0, i1 + 1):
            b = j * bins.raster[0] + i
            for e in range(bins.start[b], bins.start[b + 1]):
                c = bins.cell[e]
                # A cell reaches several bins; it counts in the first one visited.
                if i != max(i0, low[c, 0]) or j != max(j0, low[c, 1]):
                    continue
                dx = max(box[c, 0] - cx, 0.0, cx - box[c, 1])
                dy = max(box[c, 2] - cy, 0.0, cy - box[c, 3])
                if dx * dx + dy * dy >= r * r:
                    continue
                amount = disc_polygon(cells.corner_x[c], cells.corner_y[c], cx, cy, r)
                if amount > least:
                    cell[m], area[m] = c, amount
                    total += amount
                    m += 1
    return m, total


@in_place
def _areas_in_polygons(
    cells, bounds, lengths, x, y, radius, of, first, start, outside, inside, cell, area
):  # fmt: skip
    """Areas of discs, and of their images, in cells, from the first disc on: fills start, outside, inside, cell, area.

    Returns the first disc for which `cell` and `area` have no room left, or the number of discs.
    """
    west, east, south, north = bounds
    m = start[first]
    for k in range(first, x.size):
        r, total = radius[k], 0.0
        first_x, last_x = _repeats(x[k], r, west, east, lengths[0])
        first_y, last_y = _repeats(y[k], r, south, north, lengths[1])
        if not of[k]:
            last_y = first_y - 1
        for along_y in range(first_y, last_y + 1):
            for along_x in range(first_x, last_x + 1):
                cx, cy = x[k] + along_x * lengths[0], y[k] + along_y * lengths[1]
                i0, i1, j0, j1 = _reached(cells, cx, cy, r)
                if m + _polygons_in_bins(cells, i0, i1, j0, j1) > cell.size:
                    return k
                m, amount = _areas_in_bins(cells, i0, i1, j0, j1, cx, cy, r, cell, area, m)
                total += amount
        start[k + 1], inside[k] = m, total
        outside[k] = math.pi * r * r - total if of[k] else 0.0
    return x.size


@in_place
def _in_wet(start, cell, area, wet, wet_start, wet_cell, wet_area, inside):
    """Fill the rows with the areas in wet cells, and `inside` with their sums; returns the number of entries."""
    m = 0
    for k in range(start.size - 1):
        inside[k] = 0.0
        for e in range(start[k], start[k + 1]):
            if wet[cell[e]]:
                wet_cell[m], wet_area[m] = cell[e], area[e]
                inside[k] += area[e]
                m += 1
        wet_start[k + 1] = m
    return m


@in_place
def _gather(start, cell, amount, over, field, out):
    for k in range(start.size - 1):
        for q in range(field.shape[1]):
            total = 0.0
            for m in range(start[k], start[k + 1]):
                total += amount[m] * field[cell[m], q]
            out[k, q] = over[k] * total


def _plus(sums: tuple[float, ...], amount: float, fields: tuple[np.ndarray, ...], c: int) -> tuple:
    """Sums, one for each field, plus an amount times the fields' values in cell c."""
    return tuple(total + amount * field[c] for total, field in zip(sums, fields, strict=True))


@overload(_plus, jit_options=IN_PLACE)
def _unrolled_plus(sums, amount, fields, c):
    if len(fields) == 0:
        return lambda sums, amount, fields, c: ()
    return lambda sums, amount, fields, c: (
        sums[0] + amount * fields[0][c],
        *_plus(sums[1:], amount, fields[1:], c),
    )


@in_place
def _gather_each(start, cell, amount, over, number, fields, nothing, outs):
    for k in range(number.size):
        # unsigned: no wrap-around of negative indices, a third of the time
        floe, block, lane = np.uintp(number[k]), np.uintp(k // BLOCK), np.uintp(k % BLOCK)
        sums = nothing
        for m in range(np.uintp(start[floe]), np.uintp(start[floe + np.uintp(1)])):
            sums = _plus(sums, amount[m], fields, np.uintp(cell[m]))
        for q in range(len(outs)):
            outs[q][block, lane] = over[floe] * sums[q]


@in_place
def _scatter(start, cell, amount, over, values, out):
    for k in range(start.size - 1):
        for m in range(start[k], start[k + 1]):
            for q in range(values.shape[1]):
                out[cell[m], q] += amount[m] * (over[k] * values[k, q])


def check_discs(
    x: np.ndarray, y: np.ndarray, radius: np.ndarray | float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centres and radii [m] as float64 arrays of one shape (n,), finite, the radii positive."""
    arrays = x, y, radius
    if len({np.shape(values) for values in arrays}) > 1:
        try:
            arrays = np.broadcast_arrays(*arrays)
        except ValueError:
            shapes = ", ".join(str(np.shape(values)) for values in arrays)
            raise InputError(f"floes: x, y, radius are {shapes}: must be one shape (n,)") from None
    x, y, radius = (np.ascontiguousarray(values, np.float64) for values in arrays)
    if x.ndim != 1:
        raise InputError(f"floes: x has shape {x.shape}: must be (n,)")
    if _are_discs(x, y, radius):
        return x, y, radius
    for name, values in (("x", x), ("y", y), ("radius", radius)):
        for k in np.flatnonzero(~np.isfinite(values)):
            raise InputError(f"floe {k}: {name} = {values[k]}: must be finite")
    k = int(np.argmax(radius <= 0))
    raise InputError(f"floe {k}: radius = {radius[k]}: must be greater than 0")


@in_place
def _are_discs(x, y, radius):
    """Whether all centres and radii are finite, and the radii positive."""
    fine = True
    for k in range(x.size):
        fine &= (abs(x[k]) < np.inf) & (abs(y[k]) < np.inf)
        fine &= (radius[k] > 0.0) & (radius[k] < np.inf)
    return fine


def check_period(grid: Grid, period: Period) -> tuple[float, float]:
    """Lengths of the period [m], 0 where there is none; refuse a grid with more than one period."""
    if len(period) != 2:
        raise InputError(f"period = {period}: must be (Lx, Ly), each a length [m] or None")
    west, east, south, north = grid.bounds
    sides, wider = [1.0, 1.0], False
    for axis, (length, extent) in enumerate(zip(period, (east - west, north - south), strict=True)):
        if length is not None and not (math.isfinite(length) and length > 0):
            raise InputError(f"period = {period}: must be (Lx, Ly), each a length [m] or None")
        sides[axis] = extent if length is None else length
        wider |= extent > sides[axis] * (1 + 1e-9)
    if grid.x_edges is None:
        # By area, since the seam of a curvilinear or unstructured grid need not be straight; see `check_images`.
        wider = grid.total_area > sides[0] * sides[1] * (1 + 1e-9)
    if period != (None, None) and wider:
        raise InputError(
            f"period = {period} is shorter than the grid ({east - west:g} × {north - south:g} m):"
            " a floe would overlap two cells at one place"
        )
    return float(period[0] or 0.0), float(period[1] or 0.0)


def check_images(grid: Grid, period: Period) -> None:
    """Refuse a grid that overlaps its periodic image, even with a corner only: floes there would count twice.

    For cells of any shape this finds what `check_period` misses; it takes milliseconds, so it is done once per model.

    Raises
    ------
    InputError
        as `check_period`, and naming the first cell that the image of another one covers.
    """
    lengths = check_period(grid, period)
    if grid.x_edges is not None:
        return
    import shapely

    x, y = grid.corner_x, grid.corner_y
    west, east, south, north = grid.bounds
    for along_x, along_y in ((1, 0), (0, 1), (1, 1), (1, -1)):
        dx, dy = along_x * lengths[0], along_y * lengths[1]
        if (along_x and not lengths[0]) or (along_y and not lengths[1]):
            continue
        # cells where the image of the grid is, and the image of cells where the grid is
        here, there = (
            np.flatnonzero(
                (x.max(1) > west + ix) & (x.min(1) < east + ix)
                & (y.max(1) > south + iy) & (y.min(1) < north + iy)
            )
            for ix, iy in ((dx, dy), (-dx, -dy))
        )  # fmt: skip
        cells = shapely.polygons(np.stack([x[here], y[here]], axis=-1))
        moved = shapely.polygons(np.stack([x[there] + dx, y[there] + dy], axis=-1))
        one, other = shapely.STRtree(moved).query(cells)
        both = shapely.area(shapely.intersection(cells[one], moved[other]))
        for cell, pair in ((here, one), (there, other)):
            twice = np.bincount(pair, both, cell.size) > TWICE * grid.area[cell]
            if twice.any():
                raise InputError(
                    f"cell {cell[twice][0]} of {grid!r} lies on the grid's own image, a period = {period} away: a"
                    " floe would overlap two cells at one place"
                )


@jit
def _repeats(x, reach, low, high, length):
    """First and last multiple of the period that shift a thing of this reach into low … high."""
    # A grid whose seam is not straight is wider than its period: the image may meet what is inside, too.
    if x - reach > max(low, high - length) and x + reach < min(high, low + length):
        return 0, 0
    if length == 0.0:
        return 0, 0 if x + reach >= low and x - reach <= high else -1
    return math.ceil((low - reach - x) / length), math.floor((high + reach - x) / length)


@jit
def _images(x, y, reach_x, reach_y, bounds, length_x, length_y, thing, image_x, image_y):
    """Fill thing, image_x and image_y; returns the number of images, even if the arrays were too short."""
    west, east, south, north = bounds
    m = 0
    for k in range(x.size):
        first_x, last_x = _repeats(x[k], reach_x[k], west, east, length_x)
        first_y, last_y = _repeats(y[k], reach_y[k], south, north, length_y)
        for along_y in range(first_y, last_y + 1):
            for along_x in range(first_x, last_x + 1):
                if m < thing.size:
                    thing[m] = k
                    image_x[m], image_y[m] = x[k] + along_x * length_x, y[k] + along_y * length_y
                m += 1
    return m


def images(
    grid: Grid,
    x: np.ndarray,
    y: np.ndarray,
    reach_x: np.ndarray | float,
    reach_y: np.ndarray | float,
    period: Period,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The periodic images of things at (x, y) that, with their reach [m], meet the grid's bounding box.

    Returns
    -------
    thing (m,), x (m,), y (m,): images of the same thing follow each other; without periods, the thing itself or none
    """
    length_x, length_y = check_period(grid, period)
    # new arrays: a view that must not be written to is another kind, for which the kernel would be compiled anew
    reach_x, reach_y = (np.full(x.shape, reach, np.float64) for reach in (reach_x, reach_y))
    room = x.size + x.size // 4 + 16
    while True:
        filled = np.empty(room, np.int64), np.empty(room), np.empty(room)
        room = _images(x, y, reach_x, reach_y, grid.bounds, length_x, length_y, *filled)
        if room <= len(filled[0]):
            thing, image_x, image_y = filled
            return thing[:room], image_x[:room], image_y[:room]


def coverage(
    grid: Grid,
    x: np.ndarray,
    y: np.ndarray,
    radius: np.ndarray | float,
    period: Period = (None, None),
    of: np.ndarray | None = None,
) -> Coverage:
    """Exact area of each floe in each cell, wet or dry, and outside the grid.

    Parameters
    ----------
    x, y : (n,) floe centres [m]
    radius : (n,) floe radii [m]
    period : lengths (Lx, Ly) of a periodic domain [m], None where not periodic
    of : (n,) bool, True for floes to include; the others have empty rows.  Default: all

    Raises
    ------
    InputError
        for a centre or radius that is not finite, a radius ≤ 0, a period shorter than the grid.
    """
    x, y, radius = check_discs(x, y, radius)
    of = np.ones(x.size, bool) if of is None else of
    fill = _in_polygons if grid.x_edges is None else _in_rectangles
    return fill(grid, x, y, radius, of, check_period(grid, period))


def _in_rectangles(
    grid: Grid,
    x: np.ndarray,
    y: np.ndarray,
    radius: np.ndarray,
    of: np.ndarray,
    lengths: tuple[float, float],
) -> Coverage:
    """`coverage` on a rectilinear grid."""
    room = 2 * x.size + 16
    while True:
        patches = (
            np.empty(room, np.int64), *np.empty((2, room)), *np.empty((2, room), np.int32)
        )  # fmt: skip
        room = _patches(grid.axes, grid.bounds, lengths, x, y, radius, of, *patches)
        if room <= len(patches[0]):
            break
    patches = tuple(values[:room] for values in patches)
    start, outside, inside = np.zeros(x.size + 1, np.int64), np.empty(x.size), np.zeros(x.size)
    lanes = np.ones(DISC_BUFFER)
    cell, area = np.empty(room * PATCH**2, np.int32), np.empty(room * PATCH**2)
    _areas_in_patches(grid.axes, radius, of, *patches, lanes, start, outside, inside, cell, area)
    return Coverage(start, cell[: start[-1]], area[: start[-1]], grid.size, outside, inside)


def _in_polygons(
    grid: Grid,
    x: np.ndarray,
    y: np.ndarray,
    radius: np.ndarray,
    of: np.ndarray,
    lengths: tuple[float, float],
) -> Coverage:
    """`coverage` on a grid of cells of any shape."""
    n, done = x.size, 0
    cells = Polygons(grid.bins, grid.corner_x, grid.corner_y)
    start, outside, inside = np.zeros(n + 1, np.int64), np.empty(n), np.empty(n)
    cell, area = np.empty(12 * n, np.int32), np.empty(12 * n)
    while True:
        done = _areas_in_polygons(
            cells, grid.bounds, lengths, x, y, radius, of, done, start, outside, inside, cell, area
        )
        if done == n:
            break
        cell, area = (np.concatenate([values, np.empty_like(values)]) for values in (cell, area))
    return Coverage(start, cell[: start[-1]], area[: start[-1]], grid.size, outside, inside)


def shares(coverage: Coverage, wet: np.ndarray) -> Weights:
    """Weights "overlap": the areas in wet cells over their sum; wet is (grid.size,) bool."""
    start, cell, area, size, _, inside = coverage
    if not wet.all():
        start, cell, area, inside = map(np.zeros_like, (start, cell, area, inside))
        m = _in_wet(coverage.start, coverage.cell, coverage.area, wet, start, cell, area, inside)
        cell, area = cell[:m], area[:m]
    return Weights(start, cell, area, _over(inside), size)


def _over(total: np.ndarray) -> np.ndarray:
    """One over the sums of rows; 0 for empty rows."""
    over = np.empty_like(total)
    _invert(total, over)
    return over


@in_place
def _invert(total, over):
    for k in range(total.size):
        over[k] = 1.0 / total[k] if total[k] > 0.0 else 0.0


def _around(
    edges: np.ndarray, i: np.ndarray, x: np.ndarray, wraps: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Columns whose centres are left and right of x in column i, and the weight of the right one.

    Beyond the last centre there is only one column, unless the grid is periodic.
    """
    count = edges.size - 1
    centre = 0.5 * (edges[:-1] + edges[1:])
    span = edges[-1] - edges[0]
    centre = np.concatenate([centre[-1:] - span, centre, centre[:1] + span])  # column i at i + 1
    left = np.where(x < centre[i + 1], i - 1, i)
    share = (x - centre[left + 1]) / (centre[left + 2] - centre[left + 1])
    right = left + 1
    if wraps:
        return left % count, right % count, share
    return np.maximum(left, 0), np.minimum(right, count - 1), share


def _bilinear(
    grid: Grid, x: np.ndarray, y: np.ndarray, cell: np.ndarray, wraps: tuple[bool, bool]
) -> tuple[np.ndarray, np.ndarray]:
    """Four cells around each point, which lies in `cell`, and their bilinear weights: (n, 4) each."""
    nx = grid.shape[1]
    i0, i1, s = _around(grid.x_edges, cell % nx, x, wraps[0])
    j0, j1, t = _around(grid.y_edges, cell // nx, y, wraps[1])
    cells = np.stack([j0 * nx + i0, j0 * nx + i1, j1 * nx + i0, j1 * nx + i1], axis=1)
    weights = np.stack([(1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t], axis=1)
    return cells, weights


def _centre_weights(grid: Grid, x: np.ndarray, y: np.ndarray, period: Period) -> Weights:
    """Weights by the cells at floe centres, without dry cells."""
    west, east, south, north = grid.bounds
    floe, image_x, image_y = images(grid, x, y, 0.0, 0.0, period)
    # Here the far rim is inside, so that a centre that round-off puts on the seam is not lost.
    image_x = np.minimum(image_x, np.nextafter(east, west))
    image_y = np.minimum(image_y, np.nextafter(north, south))
    cell = grid.locate(image_x, image_y)
    held, first = np.unique(floe[cell >= 0], return_index=True)
    place = np.flatnonzero(cell >= 0)[first]  # one image of each floe, though two may touch the rim
    cells, weights = cell[place, None], np.ones((held.size, 1))
    if grid.x_edges is not None:
        wraps = tuple(
            length is not None and abs(extent - length) <= 1e-9 * extent
            for length, extent in zip(period, (east - west, north - south), strict=True)
        )
        cells, weights = _bilinear(grid, image_x[place], image_y[place], cell[place], wraps)
    keep = grid.wet[cells] & (weights > 0)
    entries = np.zeros(x.size, np.int64)
    entries[held] = keep.sum(axis=1)
    total = np.zeros(x.size)
    total[held] = weights.sum(axis=1, where=keep)
    start = np.concatenate([[0], np.cumsum(entries)])
    return Weights(start, cells[keep].astype(np.int32), weights[keep], _over(total), grid.size)


def floe_weights(
    grid: Grid,
    x: np.ndarray,
    y: np.ndarray,
    radius: np.ndarray | float,
    accuracy: Literal["overlap", "centre"] = "overlap",
    period: Period = (None, None),
) -> Weights:
    """Shares of floes in the wet cells of a grid; each row sums to 1, or is empty.

    Parameters
    ----------
    x, y : (n,) floe centres [m], in the grid's plane; they may lie outside the first period
    radius : (n,) floe radii [m]
    accuracy : "overlap", exact areas of the discs; or "centre", cells around the centre (see the module's text)
    period : lengths (Lx, Ly) of a periodic domain [m], None where not periodic; a floe across the
        seam has shares in cells at both ends.  The grid must not be wider than a period.

    Raises
    ------
    InputError
        for a centre or radius that is not finite, a radius ≤ 0, a period shorter than the grid.
    """
    if accuracy == "overlap":
        return shares(coverage(grid, x, y, radius, period), grid.wet)
    if accuracy != "centre":
        raise InputError(f"accuracy = {accuracy!r}: {choose(accuracy, ('overlap', 'centre'))}")
    x, y, radius = check_discs(x, y, radius)
    return _centre_weights(grid, x, y, period)


def gather(weights: Weights, field: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
    """Interpolate fields to the floes: out_k = Σ_c w_kc field_c; 0 where a row is empty.

    Parameters
    ----------
    field : (grid.size,) in any unit, or (grid.size, q) for q fields at once; dry cells are never read
    out : (n,) or (n, q) float64, filled in place if given

    Raises
    ------
    InputError
        for a field or an `out` of the wrong size.
    """
    field = np.ascontiguousarray(field, np.float64)
    _check_rows("field", field, weights.size, "cell")
    shape = (weights.start.size - 1, *field.shape[1:])
    if out is None:
        out = np.empty(shape)
    elif out.shape != shape:
        raise InputError(f"out has shape {out.shape}: must be {shape}, one row per floe")
    _gather(*weights[:-1], _columns(field), _columns(out))
    return out


def gather_each(
    weights: Weights,
    number: np.ndarray,
    fields: tuple[np.ndarray, ...],
    outs: tuple[np.ndarray, ...],
) -> None:
    """`gather` for several fields of shape (grid.size,), float64, and the floes of the given numbers.

    outs : one for each field, (blocks, BLOCK), filled in the order of the numbers; the weights are read once
    """
    _gather_each(*weights[:-1], number, fields, (0.0,) * len(fields), outs)


def scatter(weights: Weights, values: np.ndarray, out: np.ndarray) -> None:
    """Add floe values to the cells: out_c += Σ_k w_kc values_k, the transpose of `gather`.

    The values of floes with empty rows are not added to any cell; see `without_cell`.

    Parameters
    ----------
    values : (n,) an extensive quantity, such as an impulse [N s], or (n, q) for q of them at once
    out : (grid.size,) or (grid.size, q) float64, changed in place

    Raises
    ------
    InputError
        for values or an `out` of the wrong size.
    """
    values = np.ascontiguousarray(values, np.float64)
    _check_rows("values", values, weights.start.size - 1, "floe")
    shape = (weights.size, *values.shape[1:])
    if out.shape != shape:
        raise InputError(f"out has shape {out.shape}: must be {shape}, one row per cell")
    _scatter(*weights[:-1], _columns(values), _columns(out))


def _check_rows(name: str, values: np.ndarray, rows: int, of: str) -> None:
    if values.ndim not in (1, 2) or values.shape[0] != rows:
        raise InputError(
            f"{name} has shape {values.shape}: must be ({rows},) or ({rows}, q), one row per {of}"
        )


def _columns(values: np.ndarray) -> np.ndarray:
    return values if values.ndim == 2 else values[:, None]


def without_cell(weights: Weights) -> np.ndarray:
    """(n,) bool: True for floes that touch no wet cell, whose impulse is undelivered."""
    return weights.start[1:] == weights.start[:-1]
