"""The cells of a grid, derived from what BMI says about its nodes; what BMI leaves open is not guessed (see `coupling.driver`)."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from bmipy import Bmi

from floebmi.errors import InputError
from floebmi.grid import Grid


def bmi_grid(model: Bmi, name: str) -> Grid:
    """The grid of cells [m] of a BMI variable, as far as BMI describes it (add a mask with `with_wet`).

    Raises
    ------
    InputError
        if the cells do not follow from the BMI description.
    """
    number, location = model.get_var_grid(name), model.get_var_location(name)
    return grid_of(told_of(model, number, location), number, location, name)


def told_of(model: Bmi, number: int, location: str) -> dict[str, Any]:
    """Everything in the BMI description of a grid from which its cells are derived."""
    kind = model.get_grid_type(number)
    told: dict[str, Any] = {"type": kind, "size": model.get_grid_size(number)}
    if kind in ("uniform_rectilinear", "rectilinear", "structured_quadrilateral"):
        rank = model.get_grid_rank(number)
        told["shape"] = model.get_grid_shape(number, np.empty(rank, np.int32)).copy()
    if kind == "uniform_rectilinear":
        told["spacing"] = model.get_grid_spacing(number, np.empty(rank)).copy()
        told["origin"] = model.get_grid_origin(number, np.empty(rank)).copy()
    elif kind == "rectilinear":
        ny, nx = told["shape"][-2:]
        told["x"] = model.get_grid_x(number, np.empty(nx)).copy()
        told["y"] = model.get_grid_y(number, np.empty(ny)).copy()
    elif kind == "structured_quadrilateral":
        nodes = int(np.prod(told["shape"]))
        told["x"] = model.get_grid_x(number, np.empty(nodes)).copy()
        told["y"] = model.get_grid_y(number, np.empty(nodes)).copy()
    elif kind == "unstructured" and location == "face":
        nodes = model.get_grid_node_count(number)
        faces = model.get_grid_face_count(number)
        told["x"] = model.get_grid_x(number, np.empty(nodes)).copy()
        told["y"] = model.get_grid_y(number, np.empty(nodes)).copy()
        per_face = model.get_grid_nodes_per_face(number, np.empty(faces, np.int32)).copy()
        told["nodes_per_face"] = per_face
        told["face_nodes"] = model.get_grid_face_nodes(
            number, np.empty(int(per_face.sum()), np.int32)
        ).copy()
    return told


def digest(told: Mapping[str, Any]) -> str:
    """Checksum of the BMI description of a grid."""
    found = hashlib.sha256()
    for name, value in told.items():
        found.update(name.encode())
        found.update(value.tobytes() if isinstance(value, np.ndarray) else str(value).encode())
    return found.hexdigest()


def grid_of(told: Mapping[str, Any], number: int, location: str, of: str) -> Grid:
    """Cells from the BMI description; refuses a grid that it does not determine."""
    kind = told["type"]
    unclear = (
        f"couple: grid {number} of {of} ({kind}, location {location}): BMI does not tell its cells;"
        " give a Grid in host_grids or floes_grids"
    )
    if kind == "unstructured" and location == "face":
        ends = np.cumsum(told["nodes_per_face"])
        faces = np.split(told["face_nodes"], ends[:-1])
        return Grid.unstructured(told["x"], told["y"], faces)
    if len(told.get("shape", ())) != 2 or location not in ("node", "face"):
        raise InputError(unclear)
    ny, nx = (int(n) for n in told["shape"])
    if kind == "uniform_rectilinear":
        (dy, dx), (y0, x0) = told["spacing"], told["origin"]
        if location == "face":  # the nodes are corners
            ny, nx = ny - 1, nx - 1
        else:
            x0, y0 = x0 - 0.5 * dx, y0 - 0.5 * dy
        x, y = (x0, x0 + nx * dx), (y0, y0 + ny * dy)
        if dx > 0 and dy > 0:
            return Grid.uniform(x, y, shape=(ny, nx))
        return _between(np.linspace(*x, nx + 1), np.linspace(*y, ny + 1))
    if location == "face":
        if kind == "rectilinear":
            return _between(told["x"], told["y"])
        return Grid.curvilinear(told["x"].reshape(ny, nx), told["y"].reshape(ny, nx))
    if kind == "rectilinear":
        edges = [_even_edges(told[axis]) for axis in ("x", "y")]
        if edges[0] is not None and edges[1] is not None:
            return _between(*edges)
    raise InputError(unclear)


def _between(x: np.ndarray, y: np.ndarray) -> Grid:
    """Cells between edges that may decrease, as for rows from north to south; the cells keep the host's order."""
    if x[0] < x[-1] and y[0] < y[-1]:
        return Grid.rectilinear(x, y)
    return Grid.curvilinear(*np.meshgrid(x, y))


def _even_edges(centres: np.ndarray) -> np.ndarray | None:
    """Edges around evenly spaced centres; None if the spacing is uneven, for then the edges are not determined."""
    if centres.size < 2:
        return None
    step = np.diff(centres)
    if np.ptp(step) > 1e-9 * abs(step[0]):
        return None
    return np.concatenate([centres - 0.5 * step[0], centres[-1:] + 0.5 * step[0]])
