"""The list of neighbours has every pair in reach, whatever sizes and periods."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from floebmi.errors import InputError
from floebmi.neighbours import find_pairs, sort_in_space


def brute_force(x, y, reach, period):
    dx, dy = x[:, None] - x, y[:, None] - y
    for d, length in ((dx, period[0]), (dy, period[1])):
        if length is not None:
            d -= length * np.rint(d / length)
    near = np.hypot(dx, dy) < reach[:, None] + reach
    return {(a, b) for a, b in zip(*np.nonzero(near), strict=True) if a < b}


def as_set(pairs):
    found = [tuple(sorted(p)) for p in zip(pairs.i.tolist(), pairs.j.tolist(), strict=True)]
    assert len(found) == len(set(found)), "a pair is listed twice"
    return set(found)


@settings(deadline=None, max_examples=200)
@given(
    st.integers(2, 60),
    st.floats(0, 3),
    st.tuples(st.booleans(), st.booleans()),
    st.floats(0.05, 20),
    st.integers(0, 10_000),
)
def test_the_list_equals_brute_force_for_radius_ratios_to_1000(n, decades, periodic, size, seed):
    rng = np.random.default_rng(seed)
    reach = 10 ** rng.uniform(-decades, 0, n)
    length = 4.5 + size
    x, y = rng.uniform(0, length, n), rng.uniform(0, 3 * length, n)
    period = (length if periodic[0] else None, 3 * length if periodic[1] else None)
    pairs = brute_force(x, y, reach, period)
    assert as_set(find_pairs(x, y, reach, period)) == pairs
    land = rng.random(n) < 0.5
    of_ice = {(a, b) for a, b in pairs if not (land[a] and land[b])}
    assert as_set(find_pairs(x, y, reach, period, land)) == of_ice


def test_one_large_floe_among_thousands_of_small_ones_keeps_all_its_neighbours():
    rng = np.random.default_rng(1)
    n = 1500
    reach = np.full(n, 0.05)
    reach[700] = 10.0
    x, y = rng.uniform(-15, 15, n), rng.uniform(-15, 15, n)
    found = as_set(find_pairs(x, y, reach))
    assert found == brute_force(x, y, reach, (None, None))
    assert sum(700 in pair for pair in found) > 60


def test_a_period_in_which_floes_could_meet_twice_is_refused():
    with pytest.raises(InputError, match="period"):
        find_pairs(np.zeros(2), np.zeros(2), np.ones(2), (3.0, None))


def test_sorting_in_space_is_a_permutation_that_brings_neighbours_together():
    rng = np.random.default_rng(2)
    x, y = rng.uniform(0, 100, (2, 4000))
    order = sort_in_space(x, y, np.full(4000, 0.8))
    assert np.array_equal(np.sort(order), np.arange(4000))
    step = np.hypot(np.diff(x[order]), np.diff(y[order])).mean()
    assert step < 0.2 * np.hypot(np.diff(x), np.diff(y)).mean()


def test_floes_periods_away_are_paired_as_their_images_are():
    """They had been looked for in cells beyond the grid, which ended the process."""
    y = np.array([50.0, 58.0, 20.0])
    for away in (0.0, 300.0, -700.0):
        pairs = find_pairs(np.full(3, 50.0), y + [0.0, away, 0.0], np.full(3, 5.0), (None, 100.0))
        assert sorted((*pairs.i, *pairs.j)) == [0, 1]


def test_what_is_tested_is_counted_and_is_the_floes_in_reach():
    """Each floe looks at all of the cells that it reaches into, at itself too."""
    crowd = find_pairs(np.linspace(0.0, 1.0, 5), np.zeros(5), np.ones(5))
    assert (crowd.tested, len(crowd.i)) == (25, 10)
    lonely = find_pairs(np.arange(0.0, 500.0, 100.0), np.zeros(5), np.ones(5))
    assert (lonely.tested, len(lonely.i)) == (5, 0)
    assert find_pairs(np.zeros(0), np.zeros(0), np.zeros(0)).tested == 0
