"""Floes of given radii find places that do not overlap, where ice is wanted.

*String*: the floes are laid, in random order, along a space-filling (Hilbert) curve through the
places where ice may be, each taking as much of the curve as its area asks for; so every part of the
domain has its share of ice from the start, and no ice has to travel far. Large floes are laid
first, and smaller ones around them.  *Press* and *swap*, which follow, are in pressing.py.
"""

from typing import NamedTuple

import numpy as np

from floebmi.barrier import Barrier, cell_at
from floebmi.errors import InputError
from floebmi.grid import Grid
from floebmi.kernels import jit
from floebmi.pressing import distances, pairs_to_press, press

ROUNDS = 6  # in which floes that found no room are laid elsewhere
FEW = 0.005  # share of the floes that is left out first, where a pack jams
CLASS = 4.0  # floes within this ratio of radii are laid together
EDGES_KEPT = ("closed", "inactive")  # edges that floes are laid inside of


class Ground(NamedTuple):
    """A raster over the domain; its cells are numbered along a Hilbert curve.

    shape, origin, step : rows and columns, south-west corner [m], sides of a cell along x and y [m]
    column, row : (n,) of each raster cell
    group : (n,) the grid cell that holds its centre, 0 without a grid; -1 where no ice may be
    ice : (n,) area of ice wanted there [m²]
    clear : (n,) distance to land [m]; None without land
    barrier : the domain and its land
    grid : of the ice, if it comes in a field
    """

    shape: tuple[int, int]
    origin: tuple[float, float]
    step: tuple[float, float]
    column: np.ndarray
    row: np.ndarray
    group: np.ndarray
    ice: np.ndarray
    clear: np.ndarray | None
    barrier: Barrier
    grid: Grid | None

    def group_of(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """The group of any points, -1 where no ice may be."""
        if self.grid is None:
            group = np.zeros(len(x), np.int64)
        else:
            group = cell_at(self.grid, x, y, self.barrier.domain)
        return np.where(self.barrier.holds(x, y), -1, group)

    def centres(self, k: np.ndarray) -> np.ndarray:
        """x, y of raster cells [m], shape (len(k), 2)."""
        corner = np.stack([self.column[k], self.row[k]], axis=1)
        return np.array(self.origin) + (corner + 0.5) * self.step


def ground_of(barrier: Barrier, n: int, grid: Grid | None = None) -> Ground:
    """The raster for n floes, with no ice wanted yet; `grid` is that of the ice, if it comes in a field."""
    from scipy import ndimage

    domain = barrier.domain
    cells = max(64, 2 * n)
    if grid is not None:  # fine enough to see the cells, as far as memory is no matter
        cells = max(cells, min(1_000_000, int(4 * domain.area / grid.area.min())))
    side = np.sqrt(domain.area / cells)
    long_x, long_y = domain.x[1] - domain.x[0], domain.y[1] - domain.y[0]
    nx, ny = max(1, round(long_x / side)), max(1, round(long_y / side))
    column, row = np.meshgrid(np.arange(nx), np.arange(ny))
    along = _hilbert(column.ravel(), row.ravel(), int(max(nx, ny) - 1).bit_length())
    order = np.argsort(along, kind="stable")
    column, row = column.ravel()[order], row.ravel()[order]
    step = long_x / nx, long_y / ny
    n = len(column)
    origin, no_group = (domain.x[0], domain.y[0]), np.zeros(n, np.int64)
    ground = Ground(
        (ny, nx), origin, step, column, row, no_group, np.zeros(n), None, barrier, grid
    )  # fmt: skip
    x, y = ground.centres(np.arange(n)).T.copy()
    clear, blocked = None, barrier.holds(x, y)
    if blocked.any():
        free = np.ones((ny, nx), bool)
        free[row[blocked], column[blocked]] = False
        clear = ndimage.distance_transform_edt(free, sampling=step[::-1])[row, column]
    ground = ground._replace(group=ground.group_of(x, y), clear=clear)
    if grid is None:
        return ground
    # the curve visits a grid cell once, so that a cell shares floes with two others only
    first = np.full(grid.size + 1, n)
    np.minimum.at(first, ground.group, np.arange(n))
    first[-1] = n  # -1: where no ice may be
    order = np.argsort(first[ground.group], kind="stable")
    along_curve = ("column", "row", "group", "ice") + (() if clear is None else ("clear",))
    return ground._replace(**{name: getattr(ground, name)[order] for name in along_curve})


def spread(ground: Ground, ice: np.ndarray) -> None:
    """Spread the ice of each cell of the ground's grid [m²] over its raster cells."""
    from scipy.spatial import cKDTree

    grid = ground.grid
    here = np.flatnonzero(ground.group >= 0)
    count = np.bincount(ground.group[here], minlength=grid.size)
    ground.ice[here] = (ice / np.maximum(count, 1))[ground.group[here]]
    missed = np.flatnonzero((count == 0) & (ice > 0))
    if not len(missed):
        return
    # cells smaller than the raster's give their ice to the nearest raster cell that has some
    some = here[ground.ice[here] > 0]
    if not len(some):
        raise InputError("area_fraction: the cells with ice are too small beside the domain")
    nearest = cKDTree(ground.centres(some)).query(
        np.stack([grid.x[missed], grid.y[missed]], axis=1)
    )
    np.add.at(ground.ice, some[nearest[1]], ice[missed])


@jit
def _hilbert(column, row, order):
    """Place along the Hilbert curve of a square of 2**order cells a side."""
    place = np.empty(column.size, np.int64)
    for k in range(column.size):
        x, y, d = column[k], row[k], 0
        for level in range(order - 1, -1, -1):
            s = 1 << level
            right, upper = (x >> level) & 1, (y >> level) & 1
            d += s * s * ((3 * right) ^ upper)
            x &= s - 1
            y &= s - 1
            if upper == 0:
                if right == 1:
                    x, y = s - 1 - x, s - 1 - y
                x, y = y, x
        place[k] = d
    return place


def settle(
    radius: np.ndarray, ground: Ground, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Lay the floes, press them apart, and lay those that find no room elsewhere nearby.

    Radii are swapped among the floes, in place.  Returns x and y [m], the grid cell that each floe was laid in first,
    and which floes find no room even so.
    """
    from scipy.spatial import cKDTree

    x, y, group = _pack(radius, ground, rng)
    left = _unplaced(x, y, radius, ground.barrier) > 0
    # of the places with room for a floe, by their number: where a larger floe has room, a smaller one has
    trees: dict[int, cKDTree] = {}
    for _ in range(ROUNDS):
        # many floes without room are no bad luck
        if not left.any() or np.count_nonzero(left) > max(10, 0.1 * len(left)):
            break
        for k in np.flatnonzero(left):
            clear = ground.ice > 0
            if ground.clear is not None:
                clear &= ground.clear >= radius[k]
            place = np.flatnonzero(clear)
            if not len(place):
                continue
            if len(place) not in trees:
                trees[len(place)] = cKDTree(ground.centres(place))
            tree = trees[len(place)]
            near = tree.query([x[k], y[k]], k=min(64, tree.n))[1]
            x[k], y[k] = tree.data[rng.choice(np.atleast_1d(near))]
        _press_all(x, y, radius, ground, rng)
        left = _unplaced(x, y, radius, ground.barrier) > 0
    return x, y, group, left


def thin_out(x: np.ndarray, y: np.ndarray, radius: np.ndarray, ground: Ground) -> np.ndarray:
    """Take floes away, the worst first, and press the others apart, in place; returns which are gone in the end.

    A few at first and more in each turn: in a jammed pack nearly all overlap a little, and a few less give way to the rest.
    """
    kept, share = np.arange(len(x)), FEW
    while True:
        here = x[kept], y[kept], radius[kept]
        bad = _unplaced(*here, ground.barrier)
        if not bad.any():
            gone = np.ones(len(x), bool)
            gone[kept] = False
            return gone
        few = max(1, int(share * len(kept)))
        kept = kept[bad < max(np.sort(bad)[::-1][:few][-1], np.median(bad[bad > 0]))]
        share *= 2.0
        if len(kept):
            here = x[kept], y[kept], radius[kept]
            _press_all(*here, ground)
            x[kept], y[kept] = here[:2]


def _press_all(
    x: np.ndarray,
    y: np.ndarray,
    radius: np.ndarray,
    ground: Ground,
    rng: np.random.Generator | None = None,
    sweeps: int | None = None,
) -> None:
    """`press` floes that are all free, inside the edges and off the land."""
    barrier, free = ground.barrier, np.ones(len(x), bool)
    idle = ground.grid is None
    press(x, y, radius, free, barrier.discs, barrier.domain, EDGES_KEPT, sweeps, rng, idle)


def _pack(
    radius: np.ndarray, ground: Ground, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places of floes, and the grid cell that each was laid in; radii are swapped in place."""
    n = len(radius)
    x, y, group = np.empty(n), np.empty(n), np.zeros(n, np.int64)
    if n == 0:
        return x, y, group
    size_class = np.floor(np.log(radius.max() / radius) / np.log(CLASS) + 1e-9).astype(int)
    laid = np.zeros(0, np.int64)
    classes = np.unique(size_class)
    for number in classes:
        new = np.flatnonzero(size_class == number)
        others = x[laid], y[laid], radius[laid]
        x[new], y[new], group[new] = _lay(radius[new], ground, others, rng)
        laid = np.concatenate([laid, new])
        here = x[laid], y[laid], radius[laid]
        if number != classes[-1]:
            _press_all(*here, ground, sweeps=100)
        else:
            _press_all(*here, ground, rng)
        x[laid], y[laid], radius[laid] = here
    return x, y, group


def _lay(
    radius: np.ndarray,
    ground: Ground,
    others: tuple[np.ndarray, np.ndarray, np.ndarray],
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """String floes along the curve, over the ice that the others (x, y, radius), laid before, have left."""
    taken = np.zeros(ground.shape, bool)
    periodic = (length is not None for length in ground.barrier.domain.period)
    x, y = ((others[k] - ground.origin[k]) / ground.step[k] for k in (0, 1))
    _cover(taken, x, y, others[2], *ground.step, *periodic)
    taken = taken[ground.row, ground.column]
    here = ground.group >= 0
    group = ground.group[here]
    ice = np.bincount(group, ground.ice[here])
    left = np.maximum(ice - np.bincount(group, taken[here] * np.prod(ground.step)), 0.0)
    open_ice = np.where(here & ~taken, ground.ice, 0.0)
    room = np.bincount(group, open_ice[here])
    # a cell that larger floes cover has none, whatever they leave of its ice: others get it
    share = np.divide(left, room, out=np.zeros(len(room)), where=room > 0)
    weight = np.zeros(len(taken))
    weight[here] = open_ice[here] * share[group]
    if ground.clear is not None:
        roomy = weight * (ground.clear >= np.median(radius))
        weight = roomy if roomy.any() else weight
    if not weight.any():
        weight = ground.ice
    reached = np.cumsum(weight)
    area = radius**2
    # the string begins anywhere on the curve, closed to a ring: of many seeds each place is met alike
    middle = ((np.cumsum(area) - area / 2) / area.sum() + rng.random()) % 1.0 * reached[-1]
    place = np.searchsorted(reached, middle, side="right")
    place = np.minimum(place, np.flatnonzero(weight)[-1])
    x, y = ground.centres(place).T.copy()
    moved = np.zeros(len(place), bool)
    for _ in range(4):  # off the raster's rows, but within the same cell and off the land
        off_x, off_y = 2.0 * rng.random((2, len(place))) - 1.0
        new_x, new_y = x + off_x * ground.step[0], y + off_y * ground.step[1]
        good = ~moved & (ground.group_of(new_x, new_y) == ground.group[place])
        x[good], y[good], moved[good] = new_x[good], new_y[good], True
    return x, y, np.maximum(ground.group[place], 0)


@jit
def _cover(taken, x, y, radius, step_x, step_y, periodic_x, periodic_y):
    """Mark raster cells whose centres lie in a disc; x and y in raster cells."""
    ny, nx = taken.shape
    for k in range(x.size):
        reach_x, reach_y = radius[k] / step_x, radius[k] / step_y
        for row in range(
            int(np.ceil(y[k] - reach_y - 0.5)), int(np.floor(y[k] + reach_y - 0.5)) + 1
        ):
            if not periodic_y and (row < 0 or row >= ny):
                continue
            dy = (row + 0.5 - y[k]) / reach_y
            half = reach_x * np.sqrt(max(0.0, 1.0 - dy * dy))
            for column in range(
                int(np.ceil(x[k] - half - 0.5)), int(np.floor(x[k] + half - 0.5)) + 1
            ):
                if periodic_x or (column >= 0 and column < nx):
                    taken[row % ny, column % nx] = True


def _unplaced(x: np.ndarray, y: np.ndarray, radius: np.ndarray, barrier: Barrier) -> np.ndarray:
    """How bad the place of each floe is, 0 for those that may stay.

    If the others are taken away, none of those that stay overlap or lie on land.  Of a pair it is
    the smaller floe that goes, the worst pair first; bad is the overlap over its radius, and
    infinite on land.
    """
    n, domain = len(x), barrier.domain
    if n == 0:
        return np.zeros(0)
    left = barrier.holds(x, y)
    all_x, all_y, size = (
        np.concatenate(pair) for pair in zip((x, y, radius), barrier.discs.T, strict=True)
    )
    for centre, (low, high), length in zip(
        (x, y), (domain.x, domain.y), domain.period, strict=True
    ):
        if length is None:
            left |= (centre - radius < low) | (centre + radius > high)
    bad = np.where(left, np.inf, 0.0)
    i, j = pairs_to_press(all_x, all_y, size, np.arange(len(size)) < n, domain)
    overlap = size[i] + size[j] - distances(all_x, all_y, i, j, domain)
    for k in np.argsort(-overlap, kind="stable"):
        if overlap[k] <= 0:
            break
        a, b = (i[k], j[k]) if size[i[k]] < size[j[k]] else (j[k], i[k])
        smaller, larger = (a, b) if a < n else (b, a)
        if bad[smaller] == 0 and (larger >= n or bad[larger] == 0):
            bad[smaller] = overlap[k] / size[smaller]
    return bad
