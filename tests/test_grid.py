"""Exchange grids: cells, areas, masks, and finding the cell of a point."""

import copy
import pickle

import numpy as np
import pytest
from exchange_grids import CELLS, GRIDS, SIDE, masked

from floebmi.errors import InputError
from floebmi.grid import Grid

KINDS = list(GRIDS)


@pytest.mark.parametrize("name", KINDS)
def test_cells_fill_the_square_exactly(name):
    assert GRIDS[name].area.sum() == pytest.approx(SIDE**2, rel=1e-14)
    assert (GRIDS[name].area > 0).all()


@pytest.mark.parametrize("name", KINDS)
def test_areas_and_centroids_agree_with_shapely(name):
    shapely = pytest.importorskip("shapely")
    grid = GRIDS[name]
    for c in range(grid.size):
        nodes = grid.face_nodes[c][grid.face_nodes[c] >= 0]
        cell = shapely.Polygon(np.stack([grid.node_x[nodes], grid.node_y[nodes]], axis=1))
        assert cell.exterior.is_ccw
        assert grid.area[c] == pytest.approx(cell.area, rel=1e-11)
        assert (grid.x[c], grid.y[c]) == pytest.approx(cell.centroid.coords[0], rel=1e-9)


def test_areas_far_from_the_origin_are_as_good_as_near_it():
    near = GRIDS["curvilinear"]
    corners = (CELLS + 1, CELLS + 1)
    far = Grid.curvilinear(near.node_x.reshape(corners) + 4e6, near.node_y.reshape(corners) - 4e6)
    assert far.area == pytest.approx(near.area, rel=1e-11)


@pytest.mark.parametrize("name", KINDS)
def test_every_point_of_the_square_is_in_the_one_cell_that_shapely_finds(name):
    shapely = pytest.importorskip("shapely")
    grid = GRIDS[name]
    x, y = np.random.default_rng(1).uniform(0, SIDE, (2, 3000))
    found = grid.locate(x, y)
    assert (found >= 0).all()
    for c in np.unique(found):
        nodes = grid.face_nodes[c][grid.face_nodes[c] >= 0]
        cell = shapely.Polygon(np.stack([grid.node_x[nodes], grid.node_y[nodes]], axis=1))
        assert shapely.contains_xy(cell, x[found == c], y[found == c]).all()


@pytest.mark.parametrize("name", KINDS)
def test_points_on_shared_edges_and_corners_belong_to_exactly_one_cell(name):
    grid = GRIDS[name]
    inner = (grid.node_x > 1) & (grid.node_x < SIDE - 1)
    inner &= (grid.node_y > 1) & (grid.node_y < SIDE - 1)
    assert (grid.locate(grid.node_x[inner], grid.node_y[inner]) >= 0).all()
    following = np.roll(grid.face_nodes[:, :3], -1, axis=1)
    middle_x = 0.5 * (grid.node_x[grid.face_nodes[:, :2]] + grid.node_x[following[:, :2]]).ravel()
    middle_y = 0.5 * (grid.node_y[grid.face_nodes[:, :2]] + grid.node_y[following[:, :2]]).ravel()
    inside = (middle_x < SIDE - 1) & (middle_y < SIDE - 1) & (middle_x > 1) & (middle_y > 1)
    assert (grid.locate(middle_x[inside], middle_y[inside]) >= 0).all()


@pytest.mark.parametrize("name", KINDS)
def test_points_outside_and_nan_are_in_no_cell(name):
    x = [-1.0, SIDE + 1, 10.0, np.nan, np.inf, 1e300]
    y = [10.0, 10.0, -1e9, 10.0, 10.0, -1e300]
    assert (GRIDS[name].locate(x, y) == -1).all()


def test_a_point_on_an_edge_is_in_the_cell_to_its_east_or_north():
    grid = Grid.uniform((0, 4), (0, 2), spacing=1)
    polygons = Grid.unstructured(grid.node_x, grid.node_y, grid.face_nodes)
    for kind in (grid, polygons):
        found = kind.locate([0, 1, 1, 0.5, 4, 3.5], [0, 0.5, 1, 1, 0.5, 2])
        assert list(found) == [0, 1, 5, 4, -1, -1]


def test_strongly_stretched_columns_are_found():
    edges = np.concatenate([[0.0], np.geomspace(1e-3, 1e6, 300)])
    grid = Grid.rectilinear(edges, [0.0, 1.0])
    x = np.random.default_rng(2).choice(edges[:-1], 500)
    assert (grid.locate(x, np.full(500, 0.5)) == np.searchsorted(edges, x, "right") - 1).all()


def test_concave_cells_are_found_on_both_sides_of_their_notch():
    nodes = [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2), (2, 2)]
    x, y = np.array(nodes, float).T
    grid = Grid.unstructured(x, y, [[0, 1, 2, 3, 4, 5], [2, 6, 4, 3]])
    assert list(grid.locate([0.5, 1.5, 0.5, 1.5], [0.5, 0.5, 1.5, 1.5])) == [0, 0, 0, 1]


def test_spacing_and_shape_make_the_same_uniform_grid():
    a = Grid.uniform((-3e3, 1e3), (0, 6e3), spacing=(500, 1000))
    b = Grid.uniform((-3e3, 1e3), (0, 6e3), shape=(6, 8))
    assert a.shape == b.shape == (6, 8)
    assert (a.x_edges == b.x_edges).all()
    assert (a.x[:2], a.y[0]) == (pytest.approx([-2750, -2250]), 500)
    assert a.x_edges[-1] == 1e3


def test_clockwise_faces_are_stored_counter_clockwise_and_keep_cell_order_and_first_node():
    grid = GRIDS["unstructured"]
    clockwise = [[f[0], *f[1:][::-1]] for f in (row[row >= 0].tolist() for row in grid.face_nodes)]
    other = Grid.unstructured(grid.node_x, grid.node_y, clockwise)
    assert (other.face_nodes == grid.face_nodes).all()
    assert other.area == pytest.approx(grid.area)


def test_rows_may_run_from_north_to_south():
    near = GRIDS["curvilinear"]
    x, y = near.node_x.reshape(CELLS + 1, -1)[::-1], near.node_y.reshape(CELLS + 1, -1)[::-1]
    grid = Grid.curvilinear(x, y)
    assert grid.area.reshape(CELLS, CELLS)[::-1] == pytest.approx(near.area.reshape(CELLS, CELLS))
    assert grid.y[0] > grid.y[-1]


def test_lists_and_padded_arrays_make_the_same_cells():
    grid = GRIDS["unstructured"]
    lists = Grid.unstructured(
        grid.node_x, grid.node_y, [row[row >= 0].tolist() for row in grid.face_nodes]
    )
    assert (lists.face_nodes == grid.face_nodes).all()


@pytest.mark.parametrize("name", KINDS)
def test_a_mask_changes_nothing_but_the_mask(name):
    grid = GRIDS[name]
    other = masked(grid, 3)
    assert other.wet.sum() < grid.wet.sum() == grid.size
    assert (other.area == grid.area).all()
    assert (grid.with_wet(other.wet.reshape(grid.shape)).wet == other.wet).all()


@pytest.mark.parametrize(
    "duplicate", [copy.copy, copy.deepcopy, lambda grid: pickle.loads(pickle.dumps(grid))]
)
def test_arrays_of_a_copied_grid_cannot_be_overwritten_either(duplicate):
    grid = Grid.uniform((0.0, 2.0), (0.0, 2.0), shape=(2, 2))
    assert grid.axes.x.edges is grid.x_edges
    other = duplicate(grid)
    for values in (other.x, other.wet, other.axes.x.edges):
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 0


def test_arrays_of_a_grid_cannot_be_overwritten():
    with pytest.raises(ValueError, match="read-only"):
        GRIDS["uniform"].wet[0] = False


def test_a_callers_array_stays_the_callers_own():
    edges = np.array([0.0, 1.0, 2.0])
    grid = Grid.rectilinear(edges, edges)
    edges[0] = -1.0
    assert grid.x_edges[0] == 0


SQUARE = ([0.0, 1.0, 1.0, 0.0], [0.0, 0.0, 1.0, 1.0])
NOTCH = ([0.0, 4.0, 4.0, 0.0, 2.0], [0.0, 0.0, 4.0, 4.0, 0.0])


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: Grid.uniform((0, 1), (0, 1)), "spacing"),
        (lambda: Grid.uniform((0, 1), (1, 1), shape=(1, 1)), "second larger"),
        (lambda: Grid.uniform((0, 1), (0, 1), spacing=0.3), "0.333"),
        (lambda: Grid.uniform((0, 1), (0, 1), spacing=-0.5), "greater than 0"),
        (
            lambda: Grid.uniform((0, 1), (0, 1), spacing=5e-324),
            "inf cells: must be at most 2147483647",
        ),
        (lambda: Grid.uniform((0, 1), (0, 1), shape=(10**6, 10**6)), "1000000 × 1000000 cells"),
        (lambda: Grid.rectilinear(np.arange(5e4), np.arange(5e4)), "49999 × 49999 cells"),
        (lambda: Grid.uniform((0, 1), (0, 1), shape=(0, 3)), "whole numbers"),
        (lambda: Grid.rectilinear([0, 1, 1], [0, 1]), r"x_edges\[2\] = 1.0"),
        (lambda: Grid.rectilinear([0], [0, 1]), "two or more"),
        (lambda: Grid.rectilinear([0, np.nan], [0, 1]), r"x_edges\[1\] = nan"),
        (lambda: Grid.curvilinear([[0, 1]], [[0, 0]]), "ny"),
        (lambda: Grid.curvilinear([[0, 1, 0.5], [0, 1, 0.5]], [[0] * 3, [1] * 3]), "turned over"),
        (lambda: Grid.curvilinear([[0, 1], [0, 1]], [[0, 0], [0, 0]]), "no area"),
        (lambda: Grid.unstructured(*SQUARE, [[0, 1, 3, 2]]), "cell 0"),
        (lambda: Grid.unstructured(*SQUARE, [[0, 1, 2, 2]]), "twice"),
        (lambda: Grid.unstructured(*SQUARE, [[0, 1]]), "three or more"),
        (lambda: Grid.unstructured(*SQUARE, [[0, 1, 4]]), r"faces\[0\]\[2\] = 4"),
        (lambda: Grid.unstructured(*SQUARE, [[0, -1, 1, 2]]), "-1 only at the end"),
        (lambda: Grid.unstructured(*SQUARE, np.zeros((1, 3))), "integers"),
        (lambda: Grid.unstructured(*SQUARE, []), "empty"),
        (lambda: Grid.unstructured(*SQUARE, [[0, 1, 2], [0, 1, 2, 3]]), "overlap"),
        (lambda: Grid.unstructured([0, 1, 2, 1], [0, 0, 0, 1], [[0, 2, 1, 3]]), "back on itself"),
        (lambda: Grid.unstructured(*NOTCH, [[0, 1, 2, 4, 3]]), "cross or touch"),
        (lambda: GRIDS["uniform"].with_wet(np.ones(3, bool)), "wet has shape"),
        (lambda: GRIDS["uniform"].with_wet(np.full(GRIDS["uniform"].size, 0.5)), "bool"),
        (
            lambda: Grid.uniform((0, 2), (0, 1), 1, wet=np.ma.masked_equal([1, 9], 9)),
            r"wet\[1\] is",
        ),
        (
            lambda: Grid.uniform((0, 2), (0, 1), 1, wet=np.ma.masked_array([1, 1], [False, True])),
            r"wet\[1\] is masked",
        ),
        (
            lambda: Grid.rectilinear(np.ma.masked_array([0, 1e20], [False, True]), [0, 1]),
            r"x_edges\[1\] = nan",
        ),
        (
            lambda: Grid.unstructured(*SQUARE, [[0, 1, 2.7]]),
            r"faces\[0\] = .*: must be a row of int",
        ),
        (lambda: Grid.unstructured(*SQUARE, [["0", "1", "2"]]), "must be a row of integers"),
        (lambda: Grid.unstructured(*SQUARE, [0, 1, 2]), r"faces\[0\] = 0: must be a row"),
        (lambda: Grid.unstructured(*SQUARE, None), "faces is object"),
        (
            lambda: Grid.unstructured(
                [160, 170, -170, 160, 170, -170], [70] * 3 + [80] * 3, [[0, 1, 4, 3], [1, 2, 5, 4]]
            ),
            "must not overlap .in degrees, longitudes must not jump",
        ),
    ],
)
def test_a_grid_that_is_none_is_refused_in_one_line(make, says):
    with pytest.raises(InputError, match=says) as refusal:
        make()
    assert "\n" not in str(refusal.value)


def test_a_corner_under_a_mask_is_none_and_a_place_under_a_mask_is_nowhere():
    faces = np.ma.masked_array([[0, 1, 2, 3], [0, 1, 2, 3]], [[False] * 4, [False] * 3 + [True]])
    square, triangle = Grid.unstructured(*SQUARE, faces[:1]), Grid.unstructured(*SQUARE, faces[1:])
    assert (square.area, triangle.area) == (1.0, 0.5)
    places = np.ma.masked_array([0.5, 0.5], [False, True])
    np.testing.assert_array_equal(square.locate(places, 0.25), [0, -1])


def test_a_five_pointed_star_is_refused_though_it_turns_one_way_only():
    angle = 2 * np.pi * np.arange(5) * 2 / 5
    with pytest.raises(InputError, match="cross or touch"):
        Grid.unstructured(np.cos(angle), np.sin(angle), [[0, 1, 2, 3, 4]])
