"""Grid → floe and back: what one side gives, the other gets."""

import numpy as np
import pytest
from exchange_grids import CELLS, GRIDS, SIDE, masked, random_floes
from hypothesis import given, settings, strategies as st

from floebmi.errors import InputError
from floebmi.geometry import disc_polygon
from floebmi.grid import Grid
from floebmi.sampling import Weights, coverage, floe_weights, gather, scatter, without_cell

KINDS = list(GRIDS)
PERIOD = (SIDE, SIDE)

kinds = st.sampled_from(KINDS)
accuracies = st.sampled_from(["overlap", "centre"])
seeds = st.integers(0, 2**32 - 1)
log_ratios = st.floats(-2.0, 1.0)  # floes from 1/100 of a cell to 10 cells
periods = st.sampled_from([(None, None), (SIDE, None), PERIOD])


def dense(weights: Weights) -> np.ndarray:
    """The weights as an array (floes, cells)."""
    matrix = np.zeros((weights.start.size - 1, weights.size))
    rows = np.repeat(np.arange(weights.start.size - 1), np.diff(weights.start))
    np.add.at(matrix, (rows, weights.cell), weights.weight)
    return matrix


@settings(deadline=None, max_examples=60)
@given(kinds, accuracies, seeds, log_ratios, periods)
def test_momentum_given_by_the_floes_is_momentum_received_by_wet_cells_or_undelivered(
    kind, accuracy, seed, log_ratio, period
):
    grid = masked(GRIDS[kind], seed)
    x, y, radius = random_floes(seed, log_ratio)
    weights = floe_weights(grid, x, y, radius, accuracy, period)
    impulse = np.random.default_rng(seed).normal(size=x.size)
    received = np.zeros(grid.size)
    scatter(weights, impulse, received)
    lost = impulse[without_cell(weights)].sum()
    assert abs(received.sum() + lost - impulse.sum()) <= 1e-12 * np.abs(impulse).sum()
    assert (received[~grid.wet] == 0).all()


@pytest.mark.parametrize("kind", KINDS)
def test_weights_that_are_not_renormalised_over_wet_cells_lose_momentum(kind):
    """The wrong way: shares of the whole disc."""
    grid = masked(GRIDS[kind], 1)
    x, y, radius = random_floes(1, 0.0)
    weights = floe_weights(grid, x, y, radius)
    share = floe_weights(GRIDS[kind], x, y, radius)
    keep = grid.wet[share.cell]
    received = share.weight[keep].sum()
    delivered = (~without_cell(weights)).sum()
    assert weights.weight.sum() == pytest.approx(delivered, rel=1e-13)
    assert received < 0.95 * delivered


@settings(deadline=None, max_examples=60)
@given(kinds, accuracies, seeds, log_ratios, periods)
def test_work_of_the_water_is_work_on_the_floes(kind, accuracy, seed, log_ratio, period):
    grid = masked(GRIDS[kind], seed)
    x, y, radius = random_floes(seed, log_ratio)
    weights = floe_weights(grid, x, y, radius, accuracy, period)
    rng = np.random.default_rng(seed)
    u, force = rng.normal(size=grid.size), rng.normal(size=x.size)
    on_floes = gather(weights, u) * force
    on_cells = np.zeros(grid.size)
    scatter(weights, force, on_cells)
    assert abs(on_floes.sum() - (u * on_cells).sum()) <= 1e-12 * np.abs(on_floes).sum()


@settings(deadline=None, max_examples=60)
@given(kinds, accuracies, seeds, log_ratios, periods)
def test_uniform_fields_are_reproduced_where_there_is_water(
    kind, accuracy, seed, log_ratio, period
):
    grid = masked(GRIDS[kind], seed)
    x, y, radius = random_floes(seed, log_ratio)
    weights = floe_weights(grid, x, y, radius, accuracy, period)
    field = np.where(grid.wet, 0.37, np.nan)  # dry cells are never read
    got = gather(weights, field)
    dry = without_cell(weights)
    assert (got[dry] == 0).all()
    assert np.abs(got[~dry] / 0.37 - 1).max(initial=0) <= 1e-12


@settings(deadline=None, max_examples=30)
@given(kinds, seeds, log_ratios)
def test_overlap_weights_are_the_areas_of_the_disc_in_wet_cells_found_one_by_one(
    kind, seed, log_ratio
):
    grid = masked(GRIDS[kind], seed)
    x, y, radius = random_floes(seed, log_ratio, n=4)
    weights = dense(floe_weights(grid, x, y, radius))
    for k in range(x.size):
        area = np.zeros(grid.size)
        for c in np.flatnonzero(grid.wet):
            nodes = grid.face_nodes[c][grid.face_nodes[c] >= 0]
            area[c] = disc_polygon(grid.node_x[nodes], grid.node_y[nodes], x[k], y[k], radius[k])
        if area.sum() > 1e-10 * radius[k] ** 2:
            # Dropped slivers of round-off matter as far as little else of the disc is wet.
            tolerance = 1e-12 * max(1, radius[k] ** 2 / area.sum())
            assert weights[k] == pytest.approx(area / area.sum(), abs=tolerance)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("accuracy", ["overlap", "centre"])
def test_a_floe_in_the_next_period_is_the_same_floe(kind, accuracy):
    grid = masked(GRIDS[kind], 5)
    x, y, radius = random_floes(5, 0.1)
    here = dense(floe_weights(grid, x, y, radius, accuracy, PERIOD))
    there = dense(floe_weights(grid, x + SIDE, y - 2 * SIDE, radius, accuracy, PERIOD))
    assert there == pytest.approx(here, abs=1e-11)


@pytest.mark.parametrize("accuracy", ["overlap", "centre"])
def test_moving_floes_across_the_seam_by_one_cell_moves_their_weights_by_one_cell(accuracy):
    grid = GRIDS["uniform"]
    x, y, radius = random_floes(6, 0.0)
    step = SIDE / CELLS
    here = dense(floe_weights(grid, x, y, radius, accuracy, PERIOD)).reshape(-1, CELLS, CELLS)
    there = dense(floe_weights(grid, x + step, y, radius, accuracy, PERIOD))
    assert np.roll(here, 1, axis=2) == pytest.approx(there.reshape(-1, CELLS, CELLS), abs=1e-12)


def test_a_seam_that_is_not_straight_loses_no_ice_and_counts_none_twice():
    x, y = np.meshgrid(np.linspace(0, SIDE, CELLS + 1), np.linspace(0, SIDE, CELLS + 1))
    across, along = np.sin(2 * np.pi * y / SIDE), np.sin(2 * np.pi * x / SIDE)
    grid = Grid.curvilinear(x + 900 * across, y + 600 * along)
    x, y, radius = random_floes(6, 0.0)
    assert coverage(grid, x, y, radius, PERIOD).inside == pytest.approx(
        np.pi * radius**2, rel=1e-12
    )
    centre = floe_weights(grid, x, y, radius, "centre", PERIOD)
    assert (np.diff(centre.start) == 1).all()


@pytest.mark.parametrize("kind", KINDS)
def test_half_of_a_floe_on_the_seam_belongs_to_cells_at_the_other_end(kind):
    grid = GRIDS[kind]
    weights = floe_weights(grid, [0.0], [0.5 * SIDE], [300.0], period=(SIDE, None))
    east = grid.x[weights.cell] > 0.5 * SIDE
    assert weights.weight[east].sum() == pytest.approx(0.5, rel=1e-12)
    apart = floe_weights(grid, [0.0], [0.5 * SIDE], [300.0])
    assert (grid.x[apart.cell] < 0.5 * SIDE).all()


@pytest.mark.parametrize("kind", KINDS)
def test_a_floe_wider_than_the_period_still_has_shares_that_add_up_to_one(kind):
    weights = floe_weights(GRIDS[kind], [1.0], [2.0], [2.3 * SIDE], period=PERIOD)
    assert weights.weight.sum() == pytest.approx(1.0, rel=1e-13)
    assert np.abs(dense(weights)[0] - GRIDS[kind].area / SIDE**2).max() < 0.01


def test_the_centre_of_a_rectilinear_grid_is_bilinear_interpolation():
    scipy = pytest.importorskip("scipy.interpolate")
    grid = GRIDS["rectilinear"]
    field = np.random.default_rng(8).normal(size=grid.size)
    middles = (0.5 * (e[:-1] + e[1:]) for e in (grid.y_edges, grid.x_edges))
    oracle = scipy.RegularGridInterpolator(tuple(middles), field.reshape(grid.shape))
    x, y = np.random.default_rng(9).uniform(0.15 * SIDE, 0.85 * SIDE, (2, 200))
    got = gather(floe_weights(grid, x, y, 1.0, "centre"), field)
    assert got == pytest.approx(oracle(np.stack([y, x], axis=1)), abs=1e-12)


def test_the_centre_in_the_outermost_half_cell_reads_the_outermost_cell():
    grid = Grid.uniform((0, 4), (0, 2), spacing=1)
    weights = floe_weights(grid, [0.2, 0.0, 4.0], [0.1, 0.0, 2.0], 0.1, "centre")
    assert gather(weights, grid.x) == pytest.approx([0.5, 0.5, 3.5])
    for x in (0.0, 4.0, -1e-17, 8.0):  # on the seam, or there by round-off
        seam = floe_weights(grid, [x], [0.5], 0.1, "centre", period=(4, None))
        assert sorted(seam.cell) == [0, 3]
        assert seam.weight == pytest.approx([0.5, 0.5])


def test_the_centre_on_other_grids_is_the_wet_cell_that_holds_it():
    grid = masked(GRIDS["unstructured"], 2)
    weights = floe_weights(grid, grid.x, grid.y, 1.0, "centre")
    holds = grid.locate(grid.x, grid.y)
    assert (without_cell(weights) == ~grid.wet[holds]).all()
    assert (weights.cell == holds[grid.wet[holds]]).all()


def test_one_column_that_wraps_onto_itself_is_all_there_is():
    grid = Grid.uniform((0, 1), (0, 4), shape=(4, 1))
    for accuracy in ("overlap", "centre"):
        weights = floe_weights(grid, [0.05], [2.0], [0.4], accuracy, period=(1, None))
        assert dense(weights)[0] == pytest.approx([0, 0.5, 0.5, 0], abs=1e-14)


def order(kind: str, accuracy: str, radius_in_cells: float | None) -> float:
    """Order at which a sine wave, read by floes, approaches its exact mean over the floe."""
    special = pytest.importorskip("scipy.special")
    wave = 2 * np.pi / SIDE * np.array([1, 2])
    steps = SIDE / np.array([32, 64, 128])
    error = []
    for h in steps:
        e = np.arange(0, SIDE + h / 2, h)
        x, y = np.meshgrid(e, e)
        bump = np.sin(np.pi * x / SIDE) * np.sin(np.pi * y / SIDE)
        grid = (
            Grid.rectilinear(e, e)
            if kind == "rectilinear"
            else Grid.curvilinear(x + 700 * bump, y - 500 * bump)
        )
        r = radius_in_cells * h if radius_in_cells else 900.0
        x, y = np.random.default_rng(3).uniform(1500, SIDE - 1500, (2, 600))
        got = gather(
            floe_weights(grid, x, y, r, accuracy), np.sin(wave[0] * grid.x + wave[1] * grid.y)
        )
        z = np.hypot(*wave) * r
        damping = 2 * special.j1(z) / z if accuracy == "overlap" else 1.0
        exact = damping * np.sin(wave[0] * x + wave[1] * y)
        error.append(np.sqrt(np.mean((got - exact) ** 2)))
    return float(np.polyfit(np.log(steps), np.log(error), 1)[0])


@pytest.mark.parametrize(
    ("kind", "accuracy", "radius_in_cells", "expected"),
    [
        ("rectilinear", "overlap", None, 2),
        ("curvilinear", "overlap", None, 2),
        ("rectilinear", "overlap", 0.4, 1),  # a floe smaller than a cell reads the cell
        ("rectilinear", "centre", None, 2),
        ("curvilinear", "centre", None, 1),
    ],
)
def test_smooth_fields_converge_at_their_order(kind, accuracy, radius_in_cells, expected):
    assert order(kind, accuracy, radius_in_cells) == pytest.approx(expected, abs=0.15)


def test_scatter_adds_to_what_is_there():
    grid = GRIDS["uniform"]
    weights = floe_weights(grid, [grid.x[5]], [grid.y[5]], 100.0)
    out = np.ones(grid.size)
    scatter(weights, [2.0], out)
    assert out[5] == pytest.approx(3.0)
    assert out.sum() == pytest.approx(grid.size + 2)


def test_gather_fills_the_array_that_it_is_given():
    grid = GRIDS["uniform"]
    weights = floe_weights(grid, [SIDE / 2, 9 * SIDE], [SIDE / 2, 0.0], 100.0)
    out = np.full(2, 7.0)
    assert gather(weights, np.ones(grid.size), out) is out
    assert out == pytest.approx([1, 0])


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("accuracy", ["overlap", "centre"])
def test_no_floes_and_no_water_are_no_trouble(kind, accuracy):
    none = floe_weights(GRIDS[kind], [], [], [], accuracy)
    assert gather(none, np.ones(GRIDS[kind].size)).size == 0
    land = GRIDS[kind].with_wet(np.zeros(GRIDS[kind].size, bool))
    assert without_cell(floe_weights(land, [10.0], [10.0], [5e3], accuracy, PERIOD)).all()


@pytest.mark.parametrize("kind", KINDS)
def test_far_from_the_origin_weights_are_the_same(kind):
    near = GRIDS[kind]
    far = Grid.unstructured(
        near.node_x + 4e6, near.node_y - 4e6, [f[f >= 0].tolist() for f in near.face_nodes]
    )
    x, y, radius = random_floes(4, -0.3)
    here = dense(floe_weights(near, x, y, radius))
    assert dense(floe_weights(far, x + 4e6, y - 4e6, radius)) == pytest.approx(here, abs=1e-9)


GRID = GRIDS["uniform"]
ONE = floe_weights(GRID, [1.0], [1.0], [1.0])


@pytest.mark.parametrize(
    ("attempt", "says"),
    [
        (lambda: floe_weights(GRID, [1.0, np.nan], [1.0, 1.0], 1.0), "floe 1: x = nan"),
        (lambda: floe_weights(GRID, [1.0], [1.0], [0.0]), "floe 0: radius = 0.0"),
        (lambda: floe_weights(GRID, [1.0], [1.0], 1.0, "center"), "did you mean 'centre'"),
        (lambda: floe_weights(GRID, [1.0], [1.0], 1.0, period=(SIDE / 2, None)), "shorter"),
        (lambda: floe_weights(GRID, [1.0], [1.0], 1.0, period=(0.0, None)), "period"),
        (lambda: floe_weights(GRID, [1.0, 2.0], [1.0, 2.0], np.ones(3)), "one shape"),
        (lambda: floe_weights(GRID, [[1.0]], [[1.0]], 1.0), "must be"),
        (lambda: gather(ONE, np.ones(3)), r"must be \(144,\)"),
        (lambda: gather(ONE, np.ones(144), np.ones(2)), r"must be \(1,\)"),
        (lambda: scatter(ONE, np.ones(2), np.ones(144)), r"must be \(1,\)"),
        (lambda: scatter(ONE, np.ones(1), np.ones(143)), r"must be \(144,\)"),
    ],
)
def test_bad_input_is_refused_in_one_line(attempt, says):
    with pytest.raises(InputError, match=says) as refusal:
        attempt()
    assert "\n" not in str(refusal.value)
