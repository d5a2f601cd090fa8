"""Land that floes are kept clear of while they are laid out: where it is, and discs that guard its shore."""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from floebmi.boundaries import Domain
from floebmi.coast import Coast, land_geometry
from floebmi.errors import InputError
from floebmi.floes import check_floes
from floebmi.grid import Grid, following_nodes
from floebmi.sampling import check_images

SHORE_STEP = 0.5  # distance of the points that guard a shore, in smallest radii

Land = Coast | Grid | Sequence[ArrayLike]


class Barrier(NamedTuple):
    """Land of a domain.

    area : of it in the domain [m²]
    discs : (k, 3) x, y, radius [m]: the coast's floes, and guards of the shore; who overlaps none of them is off the land
    geometry : shapely's, of a coast or rings; None without
    grid : its dry cells are land; None without
    """

    area: float
    discs: np.ndarray
    geometry: object
    grid: Grid | None
    domain: Domain

    def holds(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Whether points lie on land."""
        inside = np.zeros(len(x), bool)
        x, y = self.domain.brought_back(x, y)
        if self.geometry is not None:
            import shapely

            inside |= shapely.contains_xy(self.geometry, x, y)
        if self.grid is not None:
            cell = cell_at(self.grid, x, y, self.domain)
            inside |= (cell >= 0) & ~self.grid.wet[cell]
        return inside


def barrier_of(
    land: Land | None, domain: Domain, smallest: float, grid: Grid | None = None
) -> Barrier:
    """The land that floes of radius `smallest` [m] and more keep clear of; dry cells of `grid` are part of it.

    Raises
    ------
    InputError
        for rings that are none, a `land` that is a grid, too, or one that a period is shorter than.
    """
    area, geometry, segments = 0.0, None, []
    fixed = [np.zeros((0, 3))]
    if isinstance(land, Grid):
        if grid is not None:
            raise InputError(
                "land: the grid's own dry cells are land; give a Coast or rings beside it"
            )
        grid, land = land, None
        check_images(grid, domain.period)
    if grid is not None and grid.wet.all():
        grid = None
    if isinstance(land, Coast):
        floes, land = land
        check_floes(floes)
        fixed.append(np.stack([floes.x, floes.y, floes.radius], axis=1))
    if land is not None:
        import shapely

        geometry = land_geometry(land, domain)
        shapely.prepare(geometry)
        box = shapely.box(domain.x[0], domain.y[0], domain.x[1], domain.y[1])
        area += geometry.intersection(box).area
        for ring in shapely.get_rings(shapely.get_parts(geometry)):
            points = shapely.get_coordinates(ring)
            segments.append(np.concatenate([points[:-1], points[1:]], axis=1))
    if grid is not None:
        area += float(np.sum(area_inside(grid, domain)[~grid.wet]))
        segments.append(_dry_edges(grid))
    if segments:
        fixed.append(_guards(np.concatenate(segments), domain, smallest))
    return Barrier(area, np.concatenate(fixed), geometry, grid, domain)


def _guards(segments: np.ndarray, domain: Domain, smallest: float) -> np.ndarray:
    """Small discs along a shore such that a floe that overlaps none of them does not cross it.

    Between two points a distance 2q apart a disc of radius r could reach √(r² + q²) − r ≤ q²/2r
    across: that is the radius of the guards.
    """
    starts, ends = segments[:, :2], segments[:, 2:]
    low, high = np.transpose([domain.x, domain.y])
    margin = high - low  # floes reach less far across an edge; more guards do no harm
    near = (np.maximum(starts, ends) > low - margin) & (np.minimum(starts, ends) < high + margin)
    starts, ends = starts[near.all(axis=1)], ends[near.all(axis=1)]
    step = SHORE_STEP * smallest
    counts = np.maximum(1, np.ceil(np.hypot(*(ends - starts).T) / step).astype(int)) + 1
    share = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    share = (share / np.repeat(counts - 1, counts))[:, None]
    starts, ends = np.repeat(starts, counts, axis=0), np.repeat(ends, counts, axis=0)
    points = starts + share * (ends - starts)
    return np.column_stack([points, np.full(len(points), (step / 2) ** 2 / (2 * smallest))])


def _dry_edges(grid: Grid) -> np.ndarray:
    """Edges of dry cells that are not between two dry cells, shape (k, 4): x, y of both ends."""
    nodes = grid.face_nodes[~grid.wet]
    following = following_nodes(nodes)
    pairs = np.sort(np.stack([nodes[nodes >= 0], following[nodes >= 0]], axis=1), axis=1)
    pairs, count = np.unique(pairs, axis=0, return_counts=True)
    a, b = pairs[count == 1].T
    return np.stack([grid.node_x[a], grid.node_y[a], grid.node_x[b], grid.node_y[b]], axis=1)


def cell_at(grid: Grid, x: np.ndarray, y: np.ndarray, domain: Domain) -> np.ndarray:
    """The cell that holds each point, or that of its image in a periodic domain; -1 where there is none.

    Where a seam is not straight, a place beyond the last cell is in one at the other end.
    """
    cell = grid.locate(x, y)
    shifts = ((0.0,) if length is None else (0.0, length, -length) for length in domain.period)
    for along, across in itertools.product(*shifts):
        left = cell < 0
        if left.any():
            cell[left] = grid.locate(x[left] + along, y[left] + across)
    return cell


def area_inside(grid: Grid, domain: Domain) -> np.ndarray:
    """Area of each cell inside the domain [m²], shape (grid.size,); what is across a seam is inside, too."""
    import shapely

    (west, east), (south, north) = (
        (low - (length or 0.0), high + (length or 0.0))
        for (low, high), length in zip((domain.x, domain.y), domain.period, strict=True)
    )
    x, y, area = grid.corner_x, grid.corner_y, grid.area.copy()
    cut = ((x < west) | (x > east) | (y < south) | (y > north)).any(axis=1)
    cells = shapely.polygons(np.stack([x[cut], y[cut]], axis=2))
    area[cut] = shapely.area(shapely.clip_by_rect(cells, west, south, east, north))
    return area
