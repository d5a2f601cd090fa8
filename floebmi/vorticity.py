"""Vorticity of a fluid on any exchange grid, which turns the floes (eqs. ocean-torque, air-torque).

The gradient in a wet cell is the weighted least-squares fit through the wet cells that share a corner with
it: exact for a field that is linear in space, on every kind of grid and beside every coast.
"""

import numpy as np
from scipy import sparse

from floebmi.grid import Grid


def gradient_operators(grid: Grid) -> tuple[sparse.csr_array, sparse.csr_array]:
    """Sparse matrices (size, size) that give ∂/∂x and ∂/∂y [1/m] at the cells; 0 on dry and lone cells."""
    corner = grid.face_nodes.astype(np.int32)  # half the bytes, of which a product reads millions
    cell = np.repeat(np.arange(grid.size, dtype=np.int32), corner.shape[1])[corner.ravel() >= 0]
    node = corner.ravel()[corner.ravel() >= 0]
    touches = sparse.csr_array(
        (np.ones(len(cell)), (cell, node)), shape=(grid.size, grid.node_x.size)
    )
    pairs = (touches @ touches.T).tocoo()
    near = (pairs.row != pairs.col) & grid.wet[pairs.row] & grid.wet[pairs.col]
    one, other = pairs.row[near], pairs.col[near]
    dx, dy = grid.x[other] - grid.x[one], grid.y[other] - grid.y[one]
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
        operator.data[values < 1e-13 * values.max(initial=0.0)] = 0.0  # only round-off is so small
        operator.eliminate_zeros()  # so that dry cells are not read
        operators.append(operator)
    return operators[0], operators[1]


class Vorticity:
    """Curl of a velocity on a grid; the operators are made once."""

    def __init__(self, grid: Grid) -> None:
        self.along_x, self.along_y = gradient_operators(grid)

    def __call__(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """∂v/∂x − ∂u/∂y [1/s], shape (size,), counter-clockwise positive; dry cells are not read."""
        return self.along_x @ v - self.along_y @ u
