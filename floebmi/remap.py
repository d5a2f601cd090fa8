"""From the points of a file to the cells of a grid: which points, which weights, and what if there are none.

A cell is bare if all the points around it are land in the file while the grid says water; `fill_land` says
what then: "error", take the "nearest" water of the file, or leave it "dry" (0, and reported).
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from scipy import sparse

from floebmi.errors import InputError, check_word
from floebmi.fields import Box
from floebmi.grid import Grid
from floebmi.interpolation import Corners, nearest, weights
from floebmi.places import Place
from floebmi.projection import to_lonlat

FillLand = Literal["error", "nearest", "dry"]
# How far around the grid "nearest" looks for water, in points of the source.
_NEAREST_MARGIN = 25


def around_cells(
    place: Place, grid: Grid, needed: np.ndarray, fill_land: FillLand, label: str
) -> tuple[Corners, Box]:
    """The source points around each cell, and the block that holds them; all `needed` cells must be inside."""
    check_word("fill_land", fill_land, get_args(FillLand))
    margin = _NEAREST_MARGIN if fill_land == "nearest" else 1
    around = place.corners(grid.x, grid.y)
    lost = np.flatnonzero(around.outside & needed)
    if lost.size:
        c = lost[0]
        at = f"x {grid.x[c]:.7g}, y {grid.y[c]:.7g} m"
        if place.plane is not None:
            lon, lat = to_lonlat(place.plane, grid.x[c], grid.y[c])
            at += f" = lon {float(lon):.2f}, lat {float(lat):.2f}"
        raise InputError(
            f"{label}: {lost.size} of {int(needed.sum())} cells that need data lie outside the file, the"
            f" first is cell {c} at {at}; the file covers {place.extent()}"
        )
    inside = ~around.outside
    if not inside.any():
        return around, Box(slice(0, min(2, place.shape[0])), slice(0, min(2, place.shape[1])))
    sides = []
    for index, n in zip((around.row, around.column), place.shape, strict=True):
        low, high = int(index[inside].min()) - margin, int(index[inside].max()) + 1 + margin
        sides.append(slice(max(low, 0), min(high, n)))
    return around, Box(*sides)


def interpolate(
    around: Corners,
    box: Box,
    place: Place,
    grid: Grid,
    wet: np.ndarray,
    fill_land: FillLand,
    label: str,
) -> tuple[sparse.csr_matrix, str]:
    """The matrix (cells × points of box) that interpolates from wet points, and a note for the report.

    Raises
    ------
    InputError
        if a wet cell has no water of the source around it, and `fill_land` is "error".
    """
    inside = ~around.outside[:, None]
    local = Corners(
        np.where(inside, around.row - box.rows.start, 0),
        np.where(inside, around.column - box.columns.start, 0),
        around.weight,
    )
    rows = weights(local, wet)
    bare = np.flatnonzero((np.diff(rows.indptr) == 0) & grid.wet & ~around.outside)
    if not bare.size or fill_land == "dry":
        return rows, f", {bare.size} wet cells have no data" if bare.size else ""
    if fill_land == "nearest":
        rows, away = nearest(rows, bare, (grid.x, grid.y), place.xy(box), wet)
        if not (np.diff(rows.indptr)[bare] == 0).any():
            return rows, f", {bare.size} of them from water up to {away / 1000:.1f} km away"
    c = bare[0]
    raise InputError(
        f"{label}: {bare.size} of {int(grid.wet.sum())} wet cells have only land of the file around them,"
        f" the first is cell {c} at x {grid.x[c]:.7g}, y {grid.y[c]:.7g} m: make them dry, as the land of a"
        " [coast] is, or take fill_land = 'nearest', the nearest water of the file, or 'dry', 0"
    )
