"""Vorticity of a fluid on any exchange grid, which turns the floes (eqs. ocean-torque, air-torque).

The gradient in a wet cell is the weighted least-squares fit through the wet cells that share a corner with
it, also across the seam of a periodic domain: exact for a field that is linear in space, on every kind of grid and
beside every coast.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from floebmi.grid import Grid
from floebmi.kernels import in_place
from floebmi.sampling import Period

if TYPE_CHECKING:
    from scipy import sparse


def gradient_operators(
    grid: Grid, period: Period = (None, None)
) -> "tuple[sparse.csr_array, sparse.csr_array]":
    """Sparse matrices (size, size) that give ∂/∂x and ∂/∂y [1/m] at the cells; 0 on dry and lone cells.

    period : lengths along x and y [m]; cells on both sides of a seam are neighbours
    """
    from scipy import sparse  # slow to import, and not needed for floes that do not rotate

    corner = grid.face_nodes.astype(np.int32)  # half the memory traffic of int64
    cell = np.repeat(np.arange(grid.size, dtype=np.int32), corner.shape[1])[corner.ravel() >= 0]
    seams = [length if _has_seam(grid, axis) else None for axis, length in enumerate(period)]
    node = _across(grid, seams)[corner.ravel()[corner.ravel() >= 0]]
    touches = sparse.csr_array(
        (np.ones(len(cell)), (cell, node)), shape=(grid.size, grid.node_x.size)
    )
    pairs = (touches @ touches.T).tocoo()
    near = (pairs.row != pairs.col) & grid.wet[pairs.row] & grid.wet[pairs.col]
    one, other = pairs.row[near], pairs.col[near]
    dx, dy = (
        apart - length * np.rint(apart / length) if length else apart
        for apart, length in zip(
            (grid.x[other] - grid.x[one], grid.y[other] - grid.y[one]), seams, strict=True
        )
    )
    weight = 1.0 / (dx**2 + dy**2)

    def total(values: np.ndarray) -> np.ndarray:
        return np.bincount(one, weights=values, minlength=grid.size)

    xx, xy, yy = total(weight * dx * dx), total(weight * dx * dy), total(weight * dy * dy)
    determinant = xx * yy - xy * xy
    fit = determinant > 1e-9 * (xx + yy) ** 2  # else all partners lie on one line
    over = np.where(fit, 1.0 / np.where(fit, determinant, 1.0), 0.0)
    in_x = weight * over[one] * (yy[one] * dx - xy[one] * dy)
    in_y = weight * over[one] * (xx[one] * dy - xy[one] * dx)
    operators = []
    for weights in (in_x, in_y):
        away = sparse.csr_array((weights, (one, other)), shape=(grid.size, grid.size))
        operator = (away - sparse.diags_array(total(weights), dtype=np.float64)).tocsr()
        values = np.abs(operator.data)
        operator.data[values < 1e-13 * values.max(initial=0.0)] = 0.0  # round-off
        operator.eliminate_zeros()  # so that dry cells are not read
        operators.append(operator)
    return operators[0], operators[1]


def _has_seam(grid: Grid, axis: int) -> bool:
    """Whether a period can make neighbours along an axis: of two columns, each is on both sides of the other."""
    return len(grid.shape) == 1 or grid.shape[1 - axis] > 2


def _across(grid: Grid, lengths: Sequence[float | None]) -> np.ndarray:
    """The number of each node; of two that are a period apart, the same."""
    number = np.arange(grid.node_x.size, dtype=np.int32)
    for axis, length in enumerate(lengths):
        if length:
            from scipy.spatial import cKDTree  # slow to import, and needed for a seam only

            places = np.column_stack([grid.node_x, grid.node_y])
            there = places - length * np.eye(2)[axis]
            far, partner = cKDTree(places).query(there, distance_upper_bound=1e-6 * length)
            number[np.isfinite(far)] = number[partner[np.isfinite(far)]]
    return number


def _uniform(grid: Grid) -> np.ndarray:
    """Cells of a uniform grid whose eight neighbours all exist and are wet, (size,) bool."""
    inner = np.zeros(grid.shape, bool)
    if grid.kind == "uniform_rectilinear":
        wet = np.pad(grid.wet.reshape(grid.shape), 1)
        ny, nx = grid.shape
        inner = np.logical_and.reduce(
            [wet[j : j + ny, i : i + nx] for j in range(3) for i in range(3)]
        )
    return inner.ravel()


@in_place
def _differences(runs, nx, ax, bx, ay, by, u, v, out):
    """Curl where the fit is symmetric: weights a of the cells across an edge, b of those across a corner."""
    one = np.uintp(1)
    for run in range(runs.shape[0]):
        for cell in range(runs[run, 0], runs[run, 1]):
            c = np.uintp(cell)  # unsigned: no wrap-around of negative indices
            west, east, n, s = c - one, c + one, c + nx, c - nx
            v_x = ax * (v[east] - v[west]) + bx * (
                v[n + one] - v[n - one] + v[s + one] - v[s - one]
            )
            u_y = ay * (u[n] - u[s]) + by * (u[n + one] - u[s + one] + u[n - one] - u[s - one])
            out[c] = v_x - u_y


@in_place
def _rows(cells, along_x, along_y, u, v, out):
    """Curl in some cells, from their rows of the operators: (indptr, indices, data) of each."""
    for k in range(cells.size):
        total = 0.0
        for e in range(along_x[0][k], along_x[0][k + 1]):
            total += along_x[2][e] * v[along_x[1][e]]
        for e in range(along_y[0][k], along_y[0][k + 1]):
            total -= along_y[2][e] * u[along_y[1][e]]
        out[cells[k]] = total


class Vorticity:
    """Curl of a velocity on a grid; the operators are made once.

    Inside a uniform grid all rows of an operator have the same few numbers, which are not read from memory.
    """

    def __init__(self, grid: Grid, period: Period = (None, None)) -> None:
        along_x, along_y = gradient_operators(grid, period)
        inner = _uniform(grid)
        self.rest = np.flatnonzero(~inner)
        ends = np.flatnonzero(np.diff(inner.astype(np.int8), prepend=0, append=0))
        self.runs = ends.reshape(-1, 2)  # of consecutive cells: first, and one past the last
        self.along_x, self.along_y = (
            (rows.indptr, rows.indices, rows.data)
            for rows in (along_x[self.rest], along_y[self.rest])
        )
        if len(self.runs):
            c, nx = self.runs[0, 0], grid.shape[1]
            self.weights = (
                np.uintp(nx), along_x[c, c + 1], along_x[c, c + nx + 1], along_y[c, c + nx], along_y[c, c + nx + 1]
            )  # fmt: skip

    def __call__(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """∂v/∂x − ∂u/∂y [1/s], shape (size,), counter-clockwise positive; dry cells are not read."""
        out = np.empty(u.size)
        _rows(self.rest, self.along_x, self.along_y, u, v, out)
        if len(self.runs):
            _differences(self.runs, *self.weights, u, v, out)
        return out
