"""Vectors between a host's staggered points and own axes, and the cell centres and axes of the ice.

*Points.*  Ocean models have velocity on the faces of their cells (C grid, each component on its own faces) or at
their corners (B grid), not at the centres (A grid), where the ice has its stress.  `Staggered` uses one matrix w for
both directions,

    flux    A_p τ_p = Σ_c w_pc A_c τ_c        stress, cells → points
    state   u_c = Σ_p w_pc u_p                velocity, points → cells            (eq. stagger)

with w_pc = 1/n for each of the n open points of cell c.  A point is open if all its cells are wet: there is no
flow through a coast, and a force on a closed point would be lost.

       dry  |   wet  |   wet                c: all of the force of the cell beside the coast goes to p
            q   c    p                      q: closed, gets no force, and is left out of the mean

Each column of w sums to 1, so the force is conserved, at coasts too; and since both directions use the same w, the work
at the points equals the work in the cells, Σ A_p τ_p u_p = Σ A_c τ_c u_c.  Simple averaging, τ_p = ½ (τ_1 + τ_2) on
open faces, would lose half of the force of each cell beside a coast to the wall.  Away from coasts the two agree on
uniform cells.  A cell without any open point cannot deliver its force; `undelivered` returns it.

On a curvilinear grid components are along the cell's own axes (`axis_angle`), and the sum of each component and
the work are conserved; the axes at a face differ slightly from those at the centre, and that rotation is left to the host.

*Axes.*  `turn` rotates components from one pair of axes to another, by the angle between them; rotating back by the
negative angle restores them to round-off.  A rotation preserves magnitudes, and u·τ if both are rotated.  Rotate on
the host's cells, and regrid the x and y components after that (before it, on the way back).
"""

from __future__ import annotations

from typing import Literal, final

import numpy as np
from scipy.sparse import csr_array

from floebmi.errors import InputError, check_word, in_line
from floebmi.grid import Grid, check_grid
from floebmi.quantities import flat, unmasked

Where = Literal["u", "v", "corners"]


def turn(
    along_first: np.ndarray, along_second: np.ndarray, angle: np.ndarray | float
) -> tuple[np.ndarray, np.ndarray]:
    """Rotate vector components from two perpendicular axes to x and y.

    Parameters
    ----------
    along_first, along_second : arrays of one shape, components along the axes (east and north; or i and j of a grid)
    angle : angle [rad] from x to the first axis, counter-clockwise, one number or an array of that shape, as from
        `projection.east_in_plane` or `axis_angle`; use −angle for the inverse

    Returns
    -------
    Two arrays of that shape, in the same unit: components along x and y

    Raises
    ------
    InputError
        for arrays of different shapes (they are not broadcast), and for values that are not real numbers.

    Examples
    --------
    >>> x, y = turn(np.array([1.0]), np.array([0.0]), np.pi / 2)
    >>> x.round(12), y.round(12)
    (array([0.]), array([1.]))
    """
    along_first, along_second, angle = map(unmasked, (along_first, along_second, angle))
    shapes = [values.shape for values in (along_first, along_second, angle)]
    if shapes[1] != shapes[0] or shapes[2] not in ((), shapes[0]):
        raise InputError(
            f"turn: components of shape {shapes[0]} and {shapes[1]}, angles of {shapes[2]}: must be of one shape,"
            " or one angle for all"
        )
    cosine, sine = np.cos(angle), np.sin(angle)
    return (
        along_first * cosine - along_second * sine,
        along_first * sine + along_second * cosine,
    )


def axis_angle(grid: Grid) -> np.ndarray:
    """Angle [rad] from x to the i axis of each cell of a structured grid, (size,).

    It is the rotation nearest to the cell's own axes: i from the middle of its west face to that of its
    east face, j from the middle of its south face to that of its north face.

    Raises
    ------
    InputError
        for a grid without rows and columns, or with j to the right of i (rows from north to south), whose axes no
        rotation can bring to x and y.
    """
    _structured(grid)
    if grid.face_nodes[0, 1] != grid.face_nodes[0, 0] + 1:
        raise InputError(
            f"{grid!r}: j is to the right of i, as where rows run from north to south: no rotation takes both axes to"
            " x and y; reverse the rows of the grid and of its fields"
        )
    x, y = grid.corner_x, grid.corner_y  # counter-clockwise from the south-west
    ix, iy = x[:, 1] + x[:, 2] - x[:, 0] - x[:, 3], y[:, 1] + y[:, 2] - y[:, 0] - y[:, 3]
    jx, jy = x[:, 2] + x[:, 3] - x[:, 0] - x[:, 1], y[:, 2] + y[:, 3] - y[:, 0] - y[:, 1]
    return np.arctan2(iy - jx, ix + jy)


@final
class Staggered:
    """Transfer between the cell centres of a structured grid and the points where a host has velocities.

    Parameters
    ----------
    grid : rectilinear or curvilinear grid, with its mask
    where : position of the points: "u", faces across i, shape (ny, nx + 1), face i west of cell i; "v", faces across j,
        (ny + 1, nx); "corners", (ny + 1, nx + 1)
    periodic : (along i, along j): whether the last cell is a neighbour of the first; there are then as many points
        as cells in that direction
    open : (points,) bool, True for points where the host allows flow; default: those whose cells are all wet, none on the rim
    area : (points,) area that the host assigns to each point [m²]; default: half (corners: a quarter) of each of its cells

    Attributes
    ----------
    shape : shape of the array of points, (rows, columns); all arrays are flat, in C order
    weights : w, sparse CSR (points, cells)
    open, area : as above

    Raises
    ------
    InputError
        for a grid without rows and columns, an unknown `where`, a `periodic` that is not two bools, and arrays of a wrong size.

    Examples
    --------
    >>> row = Grid.uniform(x=(0.0, 3.0), y=(0.0, 1.0), shape=(1, 3), wet=[True, True, False])
    >>> faces = Staggered(row, "u")
    >>> faces.flux([1.0, 1.0, 1.0])
    array([0., 2., 0., 0.])
    >>> faces.state([9.0, 0.5, 9.0, 9.0])
    array([0.5, 0.5, 0. ])
    """

    def __init__(
        self,
        grid: Grid,
        where: Where,
        periodic: tuple[bool, bool] = (False, False),
        open: np.ndarray | None = None,
        area: np.ndarray | None = None,
    ) -> None:
        _structured(grid)
        check_word("where", where, ("u", "v", "corners"))
        flags = list(periodic) if isinstance(periodic, tuple | list) else []
        if len(flags) != 2 or not all(isinstance(flag, bool | np.bool_) for flag in flags):
            raise InputError(
                f"periodic = {in_line(periodic)}: must be two of True and False, (along i, along j)"
            )
        ny, nx = grid.shape
        across_i, across_j = where in ("u", "corners"), where in ("v", "corners")
        rows = ny + (across_j and not periodic[1])
        columns = nx + (across_i and not periodic[0])
        self.grid, self.where, self.shape = grid, where, (rows, columns)
        j, i = np.divmod(np.arange(grid.size), nx)
        cell, point = [], []
        for up in (0, 1) if across_j else (0,):
            for right in (0, 1) if across_i else (0,):
                cell.append(np.arange(grid.size))
                point.append((j + up) % rows * columns + (i + right) % columns)
        cells, points = np.concatenate(cell), np.concatenate(point)
        size, around = rows * columns, len(cell)
        if open is None:
            wet = np.bincount(points, weights=grid.wet[cells], minlength=size)
            self.open = wet == around
        else:
            which = _of_points("open", open, self.shape)
            if not np.isin(which, (0, 1)).all():
                k = int(np.argmin(np.isin(which, (0, 1))))
                raise InputError(f"open[{k}] = {which[k]}: must be bool, or 0 or 1")
            self.open = which.astype(bool)
        if area is None:
            self.area = np.bincount(points, weights=grid.area[cells] / around, minlength=size)
        else:
            self.area = _of_points("area", area, self.shape)
            wrong = self.open & ~(np.isfinite(self.area) & (self.area > 0))
            if wrong.any():
                k = int(np.argmax(wrong))
                raise InputError(f"area[{k}] = {self.area[k]}: must be greater than 0")
        kept = self.open[points] & grid.wet[cells]
        cells, points = cells[kept], points[kept]
        count = np.bincount(cells, minlength=grid.size)
        self.weights = csr_array(
            (1.0 / count[cells], (points, cells)), shape=(size, grid.size), dtype=float
        )
        self._alone = grid.wet & (count == 0)

    def flux(self, values: np.ndarray) -> np.ndarray:
        """Transfer a flux per area (stress) from cells to points (0 on closed ones), conserving the integral.

        Parameters
        ----------
        values : (grid.size,) per cell area, a stress averaged over time [N m-2], or an impulse [N s m-2]

        Returns
        -------
        (points,) per area of the point; Σ result × area = Σ values × grid.area over wet cells, less
        `undelivered`

        Raises
        ------
        InputError
            for a wrong size, or a value on a wet cell that is not finite.
        """
        given = self._on_cells(values) * self.grid.area
        return np.divide(
            self.weights @ given, self.area, out=np.zeros(self.area.size), where=self.open
        )

    def state(self, values: np.ndarray) -> np.ndarray:
        """Transfer a velocity from points to cells: the mean over the open points of each cell, 0 where there is none.

        Parameters
        ----------
        values : (points,); values on closed points are ignored

        Returns
        -------
        (grid.size,)

        Raises
        ------
        InputError
            for a wrong size, or a value on an open point that is not finite.
        """
        values = _of_points("values", values, self.shape)
        return self.weights.T @ _finite(f"{self.where} point", values, self.open, self.shape)

    def undelivered(self, values: np.ndarray) -> float:
        """The part of Σ values × grid.area on wet cells without any open point; for a stress [N m-2] a force [N].

        Raises
        ------
        InputError
            for a wrong size, or a value on a wet cell that is not finite.
        """
        return float((self._on_cells(values) * self.grid.area)[self._alone].sum())

    def _on_cells(self, values: np.ndarray) -> np.ndarray:
        values = unmasked(values)
        if values.size != self.grid.size:
            raise InputError(f"{values.size} values for {self.grid.size} cells")
        values = flat("field on the cells", values, self.grid.shape)
        return _finite("cell", values, self.grid.wet, self.grid.shape)

    def __repr__(self) -> str:
        kind = {"u": "faces across i", "v": "faces across j", "corners": "corners"}[self.where]
        rows, columns = self.shape
        return f"Staggered({rows} × {columns} {kind}, {int(self.open.sum())} open)"


def _structured(grid: Grid) -> None:
    check_grid("grid", grid)
    if len(grid.shape) != 2:
        raise InputError(f"{grid!r}: has no rows and columns; must be rectilinear or curvilinear")


def _of_points(name: str, values: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    values, size = unmasked(values), shape[0] * shape[1]
    if values.size != size:
        raise InputError(f"{name}: {values.size} values for {size} points")
    return flat(name, values, shape)


def _finite(place: str, values: np.ndarray, used: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """The values, with 0 where they are not used."""
    wrong = used & ~np.isfinite(values)
    if wrong.any():
        k = int(np.argmax(wrong))
        row, column = np.unravel_index(k, shape)
        raise InputError(
            f"value {values[k]} on open {place} {k}, row {row}, column {column}: must be finite"
        )
    return np.where(used, values, 0.0)
