"""Bilinear interpolation in a source's own index space, as a sparse matrix.

A source is an array of points (row, column).  Each target point gets a fractional index into it, found
on two axes or in a mesh of quadrilaterals, and four weights from that.  Dry points are left out and the other weights
scaled to sum to 1; a target with no wet point around it has an empty row.  The matrix is made once;
each record then costs one product.

    rows (j+1)   c ────── d        value = (1-s)(1-t) a + s (1-t) b + (1-s) t c + s t d
                 │    ·   │        s = column − i,  t = row − j
    row   j      a ────── b        outside the outermost points, up to half a spacing: the nearest of them
                 i      i+1
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

# A step of an axis this many times longer than both its neighbours is a gap, as after a selection of longitudes.
_HOLE = 3.0
# Tolerance, so that targets on the common edge of two quadrilaterals are not lost; smaller weights count as zero.
_EDGE = 1e-9
# Quadrilaterals tried for one target, nearest first; the second try is for very long ones.
_TRIES = (12, 80)


class Corners(NamedTuple):
    """Four points of the source around each target, and their weights.

    row, column : (n, 4) int64
    weight : (n, 4), sums to 1; NaN where the target is outside the source
    """

    row: np.ndarray
    column: np.ndarray
    weight: np.ndarray

    @property
    def outside(self) -> np.ndarray:
        """(n,) bool, True for targets outside the source."""
        return np.isnan(self.weight[:, 0])


def on_axis(axis: np.ndarray, x: np.ndarray, low: float, high: float) -> np.ndarray:
    """Fractional index of x on a monotonic axis, NaN outside low … high and in gaps of the axis (`holes`).

    Between an end of the axis and `low` or `high`, and up to half a step into a gap, the index is that of the end.
    """
    order = slice(None) if axis.size < 2 or axis[0] < axis[-1] else slice(None, None, -1)
    index = np.interp(x, axis[order], np.arange(axis.size, dtype=float)[order])
    for k in holes(axis):
        step, before, after = np.abs(np.diff(axis))[[k, k - 1, k + 1]]
        beyond, short = (index - k) * step, (k + 1 - index) * step
        inside = (beyond > 0) & (short > 0)
        index = np.where(inside, np.nan, index)
        index[inside & (beyond <= 0.5 * before)] = k
        index[inside & (short <= 0.5 * after)] = k + 1
    return np.where((x >= low) & (x <= high), index, np.nan)


def holes(axis: np.ndarray) -> np.ndarray:
    """Gaps of a monotonic axis: the indices of the points before them."""
    step = np.abs(np.diff(axis))
    return 1 + np.flatnonzero(step[1:-1] > _HOLE * np.maximum(step[:-2], step[2:]))


def half_cell_ends(axis: np.ndarray) -> tuple[float, float]:
    """Outer bounds of a monotonic axis of cell centres: half a spacing beyond the outermost centres.

    A millionth of the spacing is added, because positions at the very end carry the round-off of a projection.
    """
    half = 0.5 + 1e-6
    first = axis[0] - half * (axis[1] - axis[0])
    last = axis[-1] + half * (axis[-1] - axis[-2])
    return float(min(first, last)), float(max(first, last))


def corners(row: np.ndarray, column: np.ndarray, shape: tuple[int, int]) -> Corners:
    """The four points around fractional indices (n,), NaN where outside; `shape` is the source's."""
    outside = np.isnan(row) | np.isnan(column)
    row, column = np.where(outside, 0.0, row), np.where(outside, 0.0, column)
    j = np.clip(np.floor(row), 0, max(shape[0] - 2, 0)).astype(np.int64)
    i = np.clip(np.floor(column), 0, max(shape[1] - 2, 0)).astype(np.int64)
    t, s = row - j, column - i
    j1, i1 = np.minimum(j + 1, shape[0] - 1), np.minimum(i + 1, shape[1] - 1)
    weight = np.stack([(1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t], axis=1)
    weight[outside] = np.nan
    return Corners(np.stack([j, j, j1, j1], axis=1), np.stack([i, i1, i, i1], axis=1), weight)


def in_net(
    net_x: np.ndarray, net_y: np.ndarray, x: np.ndarray, y: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Fractional (row, column) of the points x, y (n,) in a mesh of points (ny, nx), NaN outside.

    The mesh ends half a spacing beyond its outermost points; there the index is that of the outermost point.
    Mesh points without a position (NaN) leave gaps, and so do torn quadrilaterals (`_torn`).
    """
    row = np.full(x.size, np.nan)
    column = np.full(x.size, np.nan)
    ny, nx = net_x.shape
    corner_x, corner_y = _four(_with_rim(net_x)), _four(_with_rim(net_y))
    near = _spans(corner_x, x) & _spans(corner_y, y)  # False with a NaN corner
    near &= ~_torn(_four(net_x), _four(net_y))
    rim = np.ones(near.shape, bool)
    rim[1:-1, 1:-1] = False
    # On a mesh that closes on itself the rim overlaps other quadrilaterals, which take precedence.
    for part in (near & ~rim, near & rim):
        j, i = np.nonzero(part)
        corner = np.stack(
            [[c[part] for c in corner_x], [c[part] for c in corner_y]], axis=-1
        ).swapaxes(0, 1)
        for tries in _TRIES:
            left = np.flatnonzero(np.isnan(row))
            if not (left.size and j.size):
                break
            quad, s, t = _containing(corner, x[left], y[left], tries)
            hit = quad >= 0
            found, at = left[hit], quad[hit]
            # Quadrilateral j lies between points j - 1 and j; the rim has the outermost points' index.
            row[found] = np.clip(j[at] - 1 + t[hit], 0, ny - 1)
            column[found] = np.clip(i[at] - 1 + s[hit], 0, nx - 1)
    return row, column


def _four(net: np.ndarray) -> tuple[np.ndarray, ...]:
    """The corners a, b, c, d of all quadrilaterals of a mesh, as views."""
    return net[:-1, :-1], net[:-1, 1:], net[1:, :-1], net[1:, 1:]


def _spans(corner: tuple[np.ndarray, ...], x: np.ndarray) -> np.ndarray:
    """True where a quadrilateral reaches into the interval spanned by the targets x."""
    low = np.minimum(np.minimum(corner[0], corner[1]), np.minimum(corner[2], corner[3]))
    high = np.maximum(np.maximum(corner[0], corner[1]), np.maximum(corner[2], corner[3]))
    with np.errstate(invalid="ignore"):
        return (low <= x.max()) & (high >= x.min())


def _torn(corner_x: tuple[np.ndarray, ...], corner_y: tuple[np.ndarray, ...]) -> np.ndarray:
    """True where the projection tears a quadrilateral of a mesh on the globe, rim included.

    Around the antipode of the projection's centre, and across its seam, corners that are neighbours on the globe are far
    apart in the plane; the quadrilateral between them covers other places, with the opposite orientation to most.
    A rim quadrilateral is torn if the one next to it is.
    """
    (ax, bx, cx, dx), (ay, by, cy, dy) = corner_x, corner_y
    area = (dx - ax) * (cy - by) - (dy - ay) * (cx - bx)  # twice, with its sign
    return np.pad(area * np.nansum(np.sign(area)) < 0, 1, mode="edge")


def _with_rim(net: np.ndarray) -> np.ndarray:
    """The mesh (ny, nx) with a rim of points half a spacing outside: (ny + 2, nx + 2)."""
    for _ in range(2):
        first, last = 1.5 * net[0] - 0.5 * net[1], 1.5 * net[-1] - 0.5 * net[-2]
        net = np.vstack([first, net, last]).T
    return net


def _containing(
    corner: np.ndarray, x: np.ndarray, y: np.ndarray, tries: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The quadrilateral (m, 4, 2) that contains each point, -1 if none, and the position (s, t) in it."""
    quad = np.full(x.size, -1)
    s, t = np.zeros(x.size), np.zeros(x.size)
    point = np.stack([x, y], axis=1)
    tries = min(tries, len(corner))
    _, near = cKDTree(corner.mean(axis=1)).query(point, k=tries)
    near = near.reshape(x.size, tries)
    for k in range(tries):
        left = np.flatnonzero(quad < 0)
        if not left.size:
            break
        candidate = near[left, k]
        cs, ct = _inverse_bilinear(corner[candidate], point[left])
        inside = (np.abs(cs - 0.5) <= 0.5 + _EDGE) & (np.abs(ct - 0.5) <= 0.5 + _EDGE)
        hit = left[inside]
        quad[hit] = candidate[inside]
        s[hit], t[hit] = np.clip(cs[inside], 0, 1), np.clip(ct[inside], 0, 1)
    return quad, s, t


def _inverse_bilinear(corner: np.ndarray, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(s, t) with a + s (b-a) + t (c-a) + s t (a-b-c+d) = point, by Newton's method from the centre."""
    a, b, c, d = (corner[:, k] for k in range(4))
    along, across, twist = b - a, c - a, a - b - c + d
    s = np.full(len(point), 0.5)
    t = np.full(len(point), 0.5)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for _ in range(8):
            miss = a + s[:, None] * along + t[:, None] * across + (s * t)[:, None] * twist - point
            ds, dt = along + t[:, None] * twist, across + s[:, None] * twist
            det = ds[:, 0] * dt[:, 1] - ds[:, 1] * dt[:, 0]
            s = s - (miss[:, 0] * dt[:, 1] - miss[:, 1] * dt[:, 0]) / det
            t = t - (ds[:, 0] * miss[:, 1] - ds[:, 1] * miss[:, 0]) / det
    return s, t  # NaN where it did not converge: no such point


def weights(around: Corners, wet: np.ndarray) -> sparse.csr_matrix:
    """The matrix (targets × source points) that interpolates from the wet points of the source.

    Parameters
    ----------
    around : corners with row, column counted within `wet`
    wet : (ny, nx) bool

    Returns
    -------
    csr matrix (n, ny nx); rows sum to 1, or are empty (outside, or no wet point around)
    """
    point = around.row * wet.shape[1] + around.column
    used = wet.ravel()[point] & (np.nan_to_num(around.weight) > _EDGE)
    weight = np.where(used, around.weight, 0.0)
    total = weight.sum(axis=1, keepdims=True)
    weight = np.divide(weight, total, out=np.zeros_like(weight), where=total > 0)
    target, k = np.nonzero(weight)
    shape = (len(weight), wet.size)
    return sparse.csr_matrix((weight[target, k], (target, point[target, k])), shape=shape)


def nearest(
    matrix: sparse.csr_matrix,
    rows: np.ndarray,
    target: tuple[np.ndarray, np.ndarray],
    source: tuple[np.ndarray, np.ndarray],
    wet: np.ndarray,
) -> tuple[sparse.csr_matrix, float]:
    """Fill the given empty rows of `matrix` with the nearest wet point; also returns the largest distance [m].

    Parameters
    ----------
    rows : (k,) the targets to fill
    target : x, y (n,) of the targets [m]
    source : x, y (ny, nx) of the source points [m]
    wet : (ny, nx) bool
    """
    points = np.flatnonzero(wet.ravel() & np.isfinite(source[0].ravel()))
    if not points.size:
        return matrix, 0.0
    tree = cKDTree(np.stack([source[0].ravel()[points], source[1].ravel()[points]], axis=1))
    away, k = tree.query(np.stack([target[0][rows], target[1][rows]], axis=1))
    more = sparse.csr_matrix((np.ones(rows.size), (rows, points[k])), shape=matrix.shape)
    return (matrix + more).tocsr(), float(away.max())
