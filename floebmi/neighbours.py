"""Neighbour search: all pairs closer than the sum of their reaches, in O(n) for any size range.

A floe's reach is its radius, plus the distance over which a bond may hold it, plus half the skin, so the list
stays complete until some floe has moved half the skin.  Floes are sorted into levels of cells, each
twice as wide as the one below; a floe looks for partners in its own level and in the wider ones, so a
large floe among thousands of small ones costs no more than they do.  Coast is a level above all others: floes
look for it, but it looks for none.  Every pair is listed once, in rows (compressed by `start`) in floe order.

The memory of a contact (tangential displacement, bond) is in the slot of its pair.  Pairs of an old list with
non-zero memory are looked up in the rows of the new one: no hash, no fixed number of contacts.
"""

from typing import NamedTuple

import numpy as np

from floebmi.errors import InputError
from floebmi.kernels import in_place, jit

CELLS_PER_FLOE = 2.0  # a sparse level gets wider cells rather than more of them


class Pairs(NamedTuple):
    """Candidate pairs `i[p]`, `j[p]`, each once; row i is `start[i]:start[i + 1]`.

    Pairs of one level are in the row of the lower index, others in that of the smaller floe; rows of coast are empty.
    tested : number of distances computed to find them
    """

    start: np.ndarray
    i: np.ndarray
    j: np.ndarray
    tested: int


def find_pairs(
    x: np.ndarray,
    y: np.ndarray,
    reach: np.ndarray,
    period: tuple[float | None, float | None] = (None, None),
    land: np.ndarray | None = None,
) -> Pairs:
    """All pairs with distance < reach_i + reach_j.

    Parameters
    ----------
    x, y : centres [m], shape (n,)
    reach : [m], shape (n,), positive
    period : length of the period along x and y [m], or None
    land : bool, shape (n,): pieces of coast, which are not paired with each other

    Raises
    ------
    InputError
        if a period is so short that two floes could meet on both sides, or a floe could meet itself.
    """
    n = len(x)
    if not n:
        return Pairs(np.zeros(1, np.int64), np.zeros(0, np.int32), np.zeros(0, np.int32), 0)
    times, widest = 4 if n > 1 else 2, float(reach.max())
    for name, length in zip("xy", period, strict=True):
        if length is not None and length < times * widest:
            raise InputError(
                f"domain.{name}: period = {length:g} m; must be at least {times} times the reach of "
                f"the largest floe, {times * widest:g} m"
            )
    x, y = (_within(np.asarray(v, np.float64), p) for v, p in zip((x, y), period, strict=True))
    land = np.zeros(n, np.bool_) if land is None else land
    lengths = (np.inf if length is None else float(length) for length in period)
    return Pairs(*_find(x, y, reach, land, *lengths))


def _within(values: np.ndarray, period: float | None) -> np.ndarray:
    """Positions wrapped to within one period of the smallest, as the search needs them."""
    if period is not None:
        values = values - period * np.floor((values - values.min()) / period)
    return np.ascontiguousarray(values)


@jit
def _find(x, y, reach, land, period_x, period_y):
    level = np.empty(x.size, np.int32)
    smallest = reach.min()
    for k in range(x.size):
        level[k] = max(int(np.floor(np.log2(reach[k] / smallest))), 0)  # rounding may give −1
    level[land] = level.max() + 1
    grids, cell_start, items = _levels(x, y, reach, level, period_x, period_y)
    in_cells = x[items], y[items], reach[items]  # contiguous, in the order in which they are read
    start = np.empty(x.size + 1, np.int64)
    room = 4 * x.size + 64
    while True:
        i, j = np.empty(room, np.int32), np.empty(room, np.int32)
        found, tested = _search(
            x, y, reach, land, level, period_x, period_y, grids, cell_start, items, in_cells,
            start, i, j,
        )  # fmt: skip
        if found <= room:
            return start, i[:found], j[:found], tested
        room = found


@jit
def sort_in_space(x, y, reach):
    """A permutation that puts floes close in space close in memory: row by row of a cell grid."""
    west, south = x.min(), y.min()
    long_x, long_y = x.max() - west, y.max() - south
    nx, ny = _cell_counts(long_x, long_y, 2.0 * reach.mean(), x.size)
    cell = np.empty(x.size, np.int64)
    for k in range(x.size):
        cell[k] = nx * _clipped(y[k] - south, long_y / ny, ny) + _clipped(
            x[k] - west, long_x / nx, nx
        )
    return _counting_sort(cell, nx * ny)[1]


@jit
def _cell_counts(length_x, length_y, width, n):
    most = CELLS_PER_FLOE * n + 16.0
    nx, ny = max(1.0, length_x // width), max(1.0, length_y // width)
    excess = nx * ny / most
    if excess > 1.0:
        nx, ny = max(1.0, nx // np.sqrt(excess)), max(1.0, ny // np.sqrt(excess))
        if nx * ny > 2.0 * most:  # a domain much longer than wide
            nx, ny = (min(nx, most), 1.0) if nx > ny else (1.0, min(ny, most))
    return int(nx), int(ny)


@jit
def _clipped(position, width, n):
    """The cell of n in which a position lies, or the closest one."""
    return min(max(int(np.floor(position / width)), 0), n - 1) if width > 0.0 else 0


@jit
def _levels(x, y, reach, level, period_x, period_y):
    """Cell grids of all levels in sequence: one row per level, starts of the cells, floes by cell.

    A row is: level, widest reach, west, south, two cell widths, two cell counts, first cell.
    """
    count, widest = np.zeros(level.max() + 1, np.int64), np.zeros(level.max() + 1)
    for k in range(x.size):
        count[level[k]] += 1
        widest[level[k]] = max(widest[level[k]], reach[k])
    west, south = x.min(), y.min()
    long_x = period_x if period_x < np.inf else x.max() - west
    long_y = period_y if period_y < np.inf else y.max() - south
    grids, grid, cells = np.empty((count.size, 9)), np.empty(count.size, np.int64), 0
    used = 0
    for number in range(count.size):
        if count[number] == 0:
            continue
        nx, ny = _cell_counts(long_x, long_y, 2.0 * widest[number], count[number])
        row = grids[used]
        row[0], row[1], row[2], row[3] = number, widest[number], west, south
        row[4], row[5] = long_x / nx or 1.0, long_y / ny or 1.0
        row[6], row[7], row[8] = nx, ny, cells
        grid[number], cells, used = used, cells + nx * ny, used + 1
    cell = np.empty(x.size, np.int64)
    for k in range(x.size):
        row = grids[grid[level[k]]]
        cx, cy = int(np.floor((x[k] - west) / row[4])), int(np.floor((y[k] - south) / row[5]))
        nx, ny = int(row[6]), int(row[7])
        cx = cx % nx if period_x < np.inf else min(max(cx, 0), nx - 1)
        cy = cy % ny if period_y < np.inf else min(max(cy, 0), ny - 1)
        cell[k] = int(row[8]) + cy * nx + cx
    start, items = _counting_sort(cell, cells)
    return grids[:used], start, items


@jit
def _counting_sort(cell, n_cells):
    start = np.zeros(n_cells + 1, np.int64)
    for k in range(cell.size):
        start[cell[k] + 1] += 1
    for c in range(n_cells):
        start[c + 1] += start[c]
    order = np.empty(cell.size, np.int64)
    fill = start[:-1].copy()
    for k in range(cell.size):
        order[fill[cell[k]]] = k
        fill[cell[k]] += 1
    return start, order


@jit
def _search(
    x, y, reach, land, level, period_x, period_y, grids, cell_start, items, in_cells, start, out_i,
    out_j,
):  # fmt: skip
    """Fill rows of pairs; returns the number of pairs, even if the arrays were too short, and the number tested."""
    found, tested, size = 0, 0, out_i.size
    item_x, item_y, item_reach = in_cells
    for i in range(x.size):
        start[i] = found
        if land[i]:
            continue
        here_x, here_y, own = x[i], y[i], reach[i]
        for g in range(grids.shape[0]):
            number = int(grids[g, 0])
            if number < level[i]:
                continue
            # a partner in a wider level is found only from here, one in the same level from the lower index
            after = i if number == level[i] else -1
            s = own + grids[g, 1]
            west, south, width_x, width_y = grids[g, 2], grids[g, 3], grids[g, 4], grids[g, 5]
            nx, ny, base = int(grids[g, 6]), int(grids[g, 7]), int(grids[g, 8])
            cx0, cx1 = _window(here_x - west, s, width_x, nx, period_x)
            cy0, cy1 = _window(here_y - south, s, width_y, ny, period_y)
            turn = 0  # periods from the window's first column to the grid
            while cx0 + turn < 0:
                turn += nx
            while cx0 + turn >= nx:
                turn -= nx
            for cy in range(cy0, cy1 + 1):
                row = base + nx * (cy + ny if cy < 0 else cy - ny if cy >= ny else cy)
                cx, shift = cx0, row + turn
                while cx <= cx1:  # all cells up to the seam at once: their floes are contiguous
                    end = min(cx1 + 1, row + nx - shift)
                    tested += cell_start[shift + end] - cell_start[shift + cx]
                    for q in range(cell_start[shift + cx], cell_start[shift + end]):
                        j = items[q]
                        dx = _nearest(item_x[q] - here_x, period_x)
                        dy = _nearest(item_y[q] - here_y, period_y)
                        near = own + item_reach[q]
                        if found < size:  # written in any case: avoids a branch
                            out_i[found] = i
                            out_j[found] = j
                        found += (j > after) & (dx * dx + dy * dy < near * near)
                    cx, shift = end, shift - nx
    start[x.size] = found
    return found, tested


@jit
def _nearest(d, period):
    """A coordinate difference of at most a period, to the nearest image."""
    if d > 0.5 * period:
        return d - period
    return d + period if d < -0.5 * period else d


@jit
def _window(position, s, width, n, period):
    """Cells within s of a position: clipped to the grid, or wrapped, with no cell twice."""
    low = int(np.floor((position - s) / width))
    high = int(np.floor((position + s) / width))
    if period < np.inf:
        return low, min(high, low + n - 1)
    return max(low, 0), min(high, n - 1)


@in_place
def carry(old_i, old_j, old_number, old_memory, place, start, seam, j, memory, sign):
    """Carry the memory of the pairs of an old list over to the same pairs of the new one.

    old_number, place : permanent number of a floe of the old list, and its row in the new one, −1 where it has none
    start, seam : rows of the new list, and of its pairs across seams
    sign : 1, or −1 for a quantity that changes sign when i and j are swapped
    """
    for q in range(old_j.size):
        if old_memory[q] == 0.0:
            continue
        a, b = place[old_number[old_i[q]]], place[old_number[old_j[q]]]
        if a < 0 or b < 0:
            continue
        for row, other, value in ((a, b, old_memory[q]), (b, a, sign * old_memory[q])):
            for p in range(start[row], start[row + 1]):
                if j[p] == other:
                    memory[p] = value
            for p in range(seam[row], seam[row + 1]):
                if j[p] == other:
                    memory[p] = value
