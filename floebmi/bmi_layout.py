"""Grids in terms of BMI: cell centres as nodes of a structured grid, or cells as faces of an unstructured one."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from floebmi.grid import Grid


class Layout(NamedTuple):
    """A grid in terms of BMI; None for what its grid type does not have.

    type, rank : as defined by BMI
    size : number of nodes
    values : number of values of a variable on this grid, which are at `location`
    """

    type: str
    rank: int
    size: int
    values: int
    location: str
    shape: np.ndarray | None = None  # (y, x)
    spacing: np.ndarray | None = None
    origin: np.ndarray | None = None
    x: np.ndarray | None = None
    y: np.ndarray | None = None
    edge_nodes: np.ndarray | None = None
    face_edges: np.ndarray | None = None
    face_nodes: np.ndarray | None = None
    nodes_per_face: np.ndarray | None = None


def layout_of(grid: "Grid", faces: bool) -> Layout:
    """The layout with cell centres as nodes, or cells as faces; always faces unless the grid is rectilinear."""
    if faces or grid.x_edges is None:
        return _faces(grid)
    shape = np.array(grid.shape)
    x, y = grid.x[: shape[1]], grid.y[:: shape[1]]
    structured = Layout(grid.kind, 2, grid.size, grid.size, "node", shape, x=x, y=y)
    if grid.kind == "rectilinear":
        return structured
    west, east, south, north = grid.bounds
    spacing = np.array([north - south, east - west]) / shape
    return structured._replace(spacing=spacing, origin=np.array([y[0], x[0]]))


def _faces(grid: "Grid") -> Layout:
    """The layout with cells as faces; edge k of a face leads from its node k to the next one."""
    from floebmi.grid import following_nodes

    real = grid.face_nodes >= 0
    count = real.sum(axis=1)
    begin, end = grid.face_nodes[real], following_nodes(grid.face_nodes)[real]
    edges, which = np.unique(
        np.stack([np.minimum(begin, end), np.maximum(begin, end)], axis=1),
        axis=0,
        return_inverse=True,
    )
    return Layout(
        "unstructured", 2, grid.node_x.size, grid.size, "face", x=grid.node_x, y=grid.node_y,
        edge_nodes=edges.ravel(), face_edges=which.ravel(), face_nodes=begin, nodes_per_face=count,
    )  # fmt: skip
