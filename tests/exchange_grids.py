"""One exchange grid of each kind over the same square, with and without a mask, for the tests."""

import numpy as np

from floebmi.geometry import disc_south_west, disc_west
from floebmi.grid import Grid

SIDE = 12_000.0  # m
CELLS = 12  # along a side


def _warped_corners() -> tuple[np.ndarray, np.ndarray]:
    """Corners whose rim is straight, so that the grid fills the square and can be periodic."""
    x, y = np.meshgrid(np.linspace(0, SIDE, CELLS + 1), np.linspace(0, SIDE, CELLS + 1))
    bump = np.sin(np.pi * x / SIDE) * np.sin(np.pi * y / SIDE)
    twist = np.sin(2 * np.pi * x / SIDE) * np.sin(2 * np.pi * y / SIDE)
    return x + 700 * bump + 250 * twist, y - 500 * bump + 300 * twist


def _mixed_faces() -> list[list[int]]:
    """Blocks of 2 × 2 quadrilaterals, in turn whole, cut into triangles, or an L and a rest."""
    faces: list[list[int]] = []
    row = CELLS + 1
    for j in range(0, CELLS, 2):
        for i in range(0, CELLS, 2):
            node = [[(j + b) * row + i + a for a in range(3)] for b in range(3)]
            quads = [
                [node[b][a], node[b][a + 1], node[b + 1][a + 1], node[b + 1][a]]
                for b in range(2)
                for a in range(2)
            ]
            kind = (i // 2 + j) % 3
            if kind == 0:
                faces += quads
            elif kind == 1:
                for a, b, c, d in quads:
                    faces += [[a, b, c], [a, c, d]]
            else:  # the L keeps its middle node as a concave corner
                faces.append([node[0][0], node[0][1], node[0][2], node[1][2], node[1][1],
                              node[2][1], node[2][0], node[1][0]])  # fmt: skip
                faces.append(quads[3])
    return faces


def _all() -> dict[str, Grid]:
    x, y = _warped_corners()
    edges = SIDE * np.linspace(0, 1, CELLS + 1) ** 1.4
    return {
        "uniform": Grid.uniform((0, SIDE), (0, SIDE), shape=(CELLS, CELLS)),
        "rectilinear": Grid.rectilinear(edges, SIDE - edges[::-1]),
        "curvilinear": Grid.curvilinear(x, y),
        "unstructured": Grid.unstructured(x.ravel(), y.ravel(), _mixed_faces()),
    }


GRIDS = _all()


def masked(grid: Grid, seed: int) -> Grid:
    """The grid with a land mask: a coast along the south-west and scattered islands."""
    rng = np.random.default_rng(seed)
    coast = grid.x + grid.y > SIDE * rng.uniform(0.2, 0.7)
    return grid.with_wet(coast & (rng.random(grid.size) > 0.15))


def random_floes(
    seed: int, log_ratio: float, n: int = 40
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centres in and around the square, radii about 10**log_ratio of a cell."""
    rng = np.random.default_rng(seed)
    radius = SIDE / CELLS * 10**log_ratio * rng.uniform(0.5, 1.5, n)
    x, y = rng.uniform(-0.05 * SIDE, 1.05 * SIDE, (2, n))
    return x, y, radius


def disc_rectangle(west, east, south, north, x, y, r):
    """Area of a disc (x, y, r) in one rectangle, put together of its four corners as `sampling` does for many [m²]."""
    total = 0.0
    for px, sign_x in ((east - x, 1), (west - x, -1)):
        for py, sign_y in ((north - y, 1), (south - y, -1)):
            corner = disc_south_west(px, py, disc_west(px, r), disc_west(py, r), r)
            total += sign_x * sign_y * corner
    return max(total, 0.0)
