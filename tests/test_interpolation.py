"""From the points of a file to the cells: exact for what is bilinear, and nothing of land."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from floebmi.interpolation import corners, half_cell_ends, in_net, nearest, on_axis, weights


def wavy_net(ny=14, nx=17):
    j, i = np.mgrid[0:ny, 0:nx].astype(float)
    return 1000 * (i + 0.3 * np.sin(j / 3)), 1000 * (j + 0.4 * np.cos(i / 4))


@given(st.floats(0, 13), st.floats(0, 16))
@settings(max_examples=40, deadline=None)
def test_the_index_in_a_net_is_the_inverse_of_bilinear_interpolation(row, column):
    x, y = wavy_net()
    around = corners(np.array([row]), np.array([column]), x.shape)
    at = [np.sum(a[around.row, around.column] * around.weight, axis=1) for a in (x, y)]
    found = in_net(x, y, *at)
    np.testing.assert_allclose((found[0][0], found[1][0]), (row, column), atol=1e-7)


def test_a_net_ends_half_a_spacing_beyond_its_points_with_the_value_of_the_last():
    y, x = np.meshgrid(np.arange(3.0), np.arange(4.0), indexing="ij")
    row, column = in_net(x, y, np.array([-0.49, -0.51, 1.5]), np.array([1.0, 1.0, 2.4]))
    np.testing.assert_allclose(row, [1.0, np.nan, 2.0])
    np.testing.assert_allclose(column, [0.0, np.nan, 1.5])


def test_long_thin_slanting_cells_are_searched_beyond_their_nearest_centres():
    j, i = np.mgrid[0:90, 0:4].astype(float)
    x, y = 100 * i, j + 50 * i
    row, column = in_net(x, y, np.array([198.0, 3.0]), np.array([150.3, 30.0]))
    np.testing.assert_allclose((row, column), ([51.3, 28.5], [1.98, 0.03]))


def test_points_of_a_net_without_a_place_leave_a_hole():
    x, y = wavy_net()
    x[5, 5] = np.nan
    row, _ = in_net(x, y, x[[4, 9], [4, 9]] + 500, y[[4, 9], [4, 9]] + 500)
    assert np.isnan(row[0]) and np.isfinite(row[1])


def test_an_axis_may_fall():
    np.testing.assert_allclose(
        on_axis(np.array([9.0, 5.0, 1.0]), np.array([7.0, 1.0, 0.0, -3.0]), -1.0, 11.0),
        [0.5, 2.0, 2.0, np.nan],
    )
    np.testing.assert_allclose(half_cell_ends(np.array([9.0, 5.0, 1.0])), (-1.0, 11.0), atol=1e-5)


def test_an_uneven_axis_ends_half_a_spacing_of_its_own_beyond_each_end():
    for axis in ([0.0, 1.0, 3.0], [3.0, 1.0, 0.0]):
        np.testing.assert_allclose(half_cell_ends(np.array(axis)), (-0.5, 4.0), atol=1e-5)


def test_a_hole_in_an_axis_is_a_step_much_longer_than_both_beside_it():
    """Each side of a hole keeps half a step of its own; a step twice as long as its neighbours is none."""
    with_hole = np.array([0.0, 1.0, 2.0, 20.0, 22.0, 24.0])
    index = on_axis(with_hole, np.array([1.5, 2.4, 2.6, 18.9, 19.2, 21.0]), -0.5, 25.0)
    np.testing.assert_allclose(index, [1.5, 2.0, np.nan, np.nan, 3.0, 3.5])
    without = np.array([0.0, 1.0, 3.0, 4.0])
    np.testing.assert_allclose(on_axis(without, np.array([1.5, 2.0]), -0.5, 4.5), [1.25, 1.5])


def test_weights_sum_to_one_over_wet_points_and_touch_no_other():
    rng = np.random.default_rng(3)
    wet = rng.random((6, 7)) > 0.7
    around = corners(rng.uniform(0, 5, 200), rng.uniform(0, 6, 200), wet.shape)
    matrix = weights(around, wet)
    full = np.diff(matrix.indptr) > 0
    np.testing.assert_allclose(matrix[full].sum(axis=1), 1.0)
    assert not (~full).all() and full.sum() < 200
    assert wet.ravel()[matrix.indices].all()
    np.testing.assert_array_equal(full, (wet[around.row, around.column]).any(axis=1))


def test_a_bare_target_gets_the_nearest_wet_point():
    wet = np.array([[True, False, False, False]])
    x, y = np.arange(4.0)[None] * 10, np.zeros((1, 4))
    matrix = weights(corners(np.zeros(1), np.array([2.5]), (1, 4)), wet)
    assert matrix.nnz == 0
    matrix, away = nearest(matrix, np.array([0]), (np.array([25.0]), np.zeros(1)), (x, y), wet)
    assert matrix.toarray().tolist() == [[1, 0, 0, 0]] and away == pytest.approx(25.0)
