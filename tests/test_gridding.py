"""Floes → grid: area, mass, momentum and virial arrive on the grid, or are counted as outside."""

import numpy as np
import pytest
from exchange_grids import CELLS, GRIDS, SIDE, disc_rectangle, masked, random_floes
from hypothesis import given, settings, strategies as st
from uncompiled import uncompiled

from floebmi.errors import InputError
from floebmi.grid import Grid
from floebmi.gridding import (
    area_budget,
    cell_fields,
    divergence,
    give_back,
    internal_stress,
    maximum_shear,
    pressure,
    sizes_of_drag,
)
from floebmi.kernels import BLOCK
from floebmi.sampling import coverage, floe_weights, gather, without_cell

KINDS = list(GRIDS)
PERIOD = (SIDE, SIDE)
DENSITY = 900.0

kinds = st.sampled_from(KINDS)
seeds = st.integers(0, 2**32 - 1)
log_ratios = st.floats(-2.0, 1.0)  # floes from 1/100 of a cell to 10 cells


def area_in_square(x, y, radius):
    return np.array(
        [disc_rectangle(0, SIDE, 0, SIDE, *disc) for disc in zip(x, y, radius, strict=True)]
    )


@settings(deadline=None, max_examples=60)
@given(kinds, seeds, log_ratios)
def test_area_in_the_cells_and_outside_is_the_area_of_each_floe(kind, seed, log_ratio):
    grid = masked(GRIDS[kind], seed)
    x, y, radius = random_floes(seed, log_ratio)
    cover = coverage(grid, x, y, radius)
    floe = np.repeat(np.arange(x.size), np.diff(cover.start))
    inside = np.bincount(floe, weights=cover.area, minlength=x.size)
    disc = np.pi * radius**2
    assert np.abs(inside - area_in_square(x, y, radius)).max() <= 1e-12 * disc.max()
    assert (np.abs(inside - area_in_square(x, y, radius)) <= 1e-12 * disc).all()
    assert (np.abs(inside + cover.outside - disc) <= 1e-12 * disc).all()


@settings(deadline=None, max_examples=30)
@given(kinds, seeds, log_ratios)
def test_on_a_periodic_grid_nothing_lies_outside(kind, seed, log_ratio):
    x, y, radius = random_floes(seed, log_ratio)
    cover = coverage(GRIDS[kind], x, y, radius, PERIOD)
    assert (np.abs(cover.outside) <= 1e-11 * np.pi * radius**2).all()  # the seam is at 1.2e4 m
    assert cover.area.sum() == pytest.approx((np.pi * radius**2).sum(), rel=1e-12)


@settings(deadline=None, max_examples=60)
@given(kinds, seeds, log_ratios)
def test_the_area_budget_closes_for_every_mask(kind, seed, log_ratio):
    grid = masked(GRIDS[kind], seed)
    x, y, radius = random_floes(seed, log_ratio)
    cover = coverage(grid, x, y, radius)
    budget = area_budget(grid, cover)
    assert sum(budget) == pytest.approx((np.pi * radius**2).sum(), rel=1e-12)
    fields = cell_fields(grid, cover, 1.0, 0.0, 0.0, radius, DENSITY)
    shown = (grid.area * fields["area_fraction"])[grid.wet].sum()
    assert shown == pytest.approx(budget.wet, rel=1e-12, abs=1e-6)
    total = np.pi * (radius**2).sum()
    assert shown == pytest.approx(
        total - budget.overlap - budget.dry - budget.outside, abs=1e-12 * total
    )


def test_area_fractions_that_are_only_capped_lose_the_overlap():
    """The wrong way: min(1, c) without the excess as a field of its own."""
    grid = GRIDS["uniform"]
    x, y, radius = random_floes(3, 0.8)
    fields = cell_fields(grid, coverage(grid, x, y, radius), 1.0, 0.0, 0.0, radius, DENSITY)
    inside = area_in_square(x, y, radius).sum()
    assert (grid.area * fields["area_fraction"]).sum() < 0.9 * inside
    both = grid.area * (fields["area_fraction"] + fields["overlap_fraction"])
    assert both.sum() == pytest.approx(inside, rel=1e-12)
    assert fields["area_fraction"].max() == 1
    assert fields["porosity"].min() == 0  # where floes lie on each other, too


@settings(deadline=None, max_examples=60)
@given(kinds, seeds, log_ratios)
def test_mass_momentum_and_floes_on_the_grid_are_those_of_the_floes_in_it(kind, seed, log_ratio):
    grid = masked(GRIDS[kind], seed)
    x, y, radius = random_floes(seed, log_ratio)
    rng = np.random.default_rng(seed)
    h, u, v = rng.uniform(0.2, 3, x.size), *rng.normal(size=(2, x.size))
    contacts = rng.integers(0, 6, x.size)
    cover = coverage(grid, x, y, radius)
    got = cell_fields(grid, cover, h, u, v, radius, DENSITY, contacts)
    area = area_in_square(x, y, radius)
    share = area / (np.pi * radius**2)
    mass = got["mass_per_area"] * grid.area
    ice = (got["area_fraction"] + got["overlap_fraction"]) * grid.area
    for field, floes in [
        (mass, DENSITY * h * area),
        (mass * got["ice_velocity_x"], DENSITY * h * area * u),
        (mass * got["ice_velocity_y"], DENSITY * h * area * v),
        (ice * got["thickness"], h * area),
        (got["floe_count"], share),
        (got["floe_count"] * got["mean_radius"], share * radius),
        (got["floe_count"] * got["coordination_number"], share * contacts),
    ]:
        assert abs(field.sum() - floes.sum()) <= 1e-12 * np.abs(floes).sum()


@pytest.mark.parametrize("kind", KINDS)
def test_equal_floes_make_uniform_means_and_where_there_is_no_ice_the_fill_shows(kind):
    grid = GRIDS[kind]
    rng = np.random.default_rng(1)
    x, y = rng.uniform(0, 0.6 * SIDE, (2, 50))
    cover = coverage(grid, x, y, 400.0)
    got = cell_fields(grid, cover, 1.7, 0.3, -0.2, 400.0, DENSITY, np.full(50, 4.0), fill=np.nan)
    ice = np.bincount(cover.cell, minlength=grid.size) > 0
    for name, value in [("thickness", 1.7), ("ice_velocity_x", 0.3), ("ice_velocity_y", -0.2),
                        ("mean_radius", 400.0), ("coordination_number", 4.0)]:  # fmt: skip
        assert got[name][ice] == pytest.approx(value, rel=1e-12)
        assert np.isnan(got[name][~ice]).all()
    for name in ("area_fraction", "overlap_fraction", "mass_per_area", "floe_count"):
        assert (got[name][~ice] == 0).all()
    assert (cell_fields(grid, cover, 1, 1, 1, 400.0, DENSITY)["thickness"][~ice] == 0).all()


def test_a_cell_wholly_under_one_floe_has_area_fraction_one_and_no_overlap():
    grid = GRIDS["uniform"]
    cover = coverage(grid, [SIDE / 2], [SIDE / 2], [4 * SIDE])
    got = cell_fields(grid, cover, 1.0, 0.0, 0.0, 4 * SIDE, DENSITY)
    assert (got["area_fraction"] == 1).all()
    assert (got["overlap_fraction"] == 0).all()
    assert got["porosity"] == pytest.approx(1.0 - got["area_fraction"], abs=1e-15)


def test_names_of_the_fields_are_in_the_table_of_variables():
    variables = pytest.importorskip("floebmi.variables")
    grid = GRIDS["uniform"]
    cover = coverage(grid, [1.0], [1.0], [1.0])
    got = cell_fields(grid, cover, 1.0, 0.0, 0.0, 1.0, DENSITY, np.zeros(1))
    assert set(got) <= {row.name for row in variables.VARIABLES}


def random_contacts(seed: int, log_ratio: float, n: int = 60):
    """Branches of about 2 × 10**log_ratio cells with forces in all directions."""
    rng = np.random.default_rng(seed)
    x, y, length = random_floes(seed, log_ratio, n)
    angle = rng.uniform(0, 2 * np.pi, n)
    return x, y, 2 * length * np.cos(angle), 2 * length * np.sin(angle), *rng.normal(size=(2, n))


@settings(deadline=None, max_examples=60)
@given(kinds, seeds, log_ratios, st.sampled_from([(None, None), PERIOD]))
def test_stress_times_area_and_the_outside_part_is_the_total_virial(kind, seed, log_ratio, period):
    grid = masked(GRIDS[kind], seed)
    x, y, dx, dy, fx, fy = random_contacts(seed, log_ratio)
    stress = internal_stress(grid, x, y, dx, dy, fx, fy, period)
    virials = fx * dx, 0.5 * (fx * dy + fy * dx), fy * dy
    for k, virial in enumerate(virials):
        total = (stress[k] * grid.area).sum() + stress.outside[k]
        assert abs(total - virial.sum()) <= 1e-12 * np.abs(virial).sum()
        if period == PERIOD:
            assert abs(stress.outside[k]) <= 1e-11 * np.abs(virial).sum()


@settings(deadline=None, max_examples=20)
@given(kinds, seeds, log_ratios)
def test_each_cell_gets_the_length_of_the_branch_that_shapely_finds_in_it(kind, seed, log_ratio):
    shapely = pytest.importorskip("shapely")
    grid = GRIDS[kind]
    x, y, dx, dy, *_ = random_contacts(seed, log_ratio, n=3)
    for k in range(3):
        branch = shapely.LineString([(x[k], y[k]), (x[k] + dx[k], y[k] + dy[k])])
        one = [np.array([a[k]]) for a in (x, y, dx, dy)]
        length = np.hypot(dx[k], dy[k])
        along = dx[k] / length, dy[k] / length
        stress = internal_stress(grid, *one, [along[0]], [along[1]])
        got = (stress.xx + stress.yy) * grid.area
        cells = [
            shapely.Polygon(np.stack([grid.node_x[f[f >= 0]], grid.node_y[f[f >= 0]]], axis=1))
            for f in grid.face_nodes
        ]
        oracle = [branch.intersection(cell).length for cell in cells]
        assert got == pytest.approx(oracle, abs=1e-9 * max(length, SIDE))


def test_a_virial_kept_only_in_wet_cells_is_not_the_virial():
    """The wrong way: the stress at the contact point, and only where there is water."""
    grid = masked(GRIDS["curvilinear"], 4)
    x, y, dx, dy, fx, fy = random_contacts(4, -0.2)
    fx, fy = -dx, -dy  # compression, so that errors cannot cancel
    total = (fx * dx).sum()
    stress = internal_stress(grid, x, y, dx, dy, fx, fy)
    at = grid.locate(x + dx / 2, y + dy / 2)
    kept = (at >= 0) & grid.wet[at]
    assert abs((fx * dx)[kept].sum() / total - 1) > 0.2
    exact = (stress.xx * grid.area).sum() + stress.outside[0]
    assert exact == pytest.approx(total, rel=1e-12)


def test_a_branch_along_an_edge_between_cells_counts_once():
    grid = Grid.uniform((0, 4), (0, 4), spacing=1)
    stress = internal_stress(grid, [0.5], [2.0], [3.0], [0.0], [-1.0], [0.0])
    assert (stress.xx * grid.area).sum() == pytest.approx(-3)
    assert stress.xx.reshape(4, 4)[2] == pytest.approx([-0.5, -1, -1, -0.5])


@pytest.mark.parametrize("kind", KINDS)
def test_a_branch_across_the_seam_is_shared_by_both_ends(kind):
    grid = GRIDS[kind]
    contact = [SIDE - 100.0], [0.4 * SIDE], [400.0], [0.0], [-1.0], [0.0]
    stress = internal_stress(grid, *contact, period=(SIDE, None))
    west = grid.x < SIDE / 2
    assert (stress.xx * grid.area)[west].sum() == pytest.approx(-300, rel=1e-12)
    assert (stress.xx * grid.area)[~west].sum() == pytest.approx(-100, rel=1e-12)
    cut_off = internal_stress(grid, *contact)
    assert cut_off.outside == pytest.approx([-300, 0, 0], rel=1e-12)


def test_a_square_lattice_under_pressure_has_the_stress_of_force_over_spacing():
    side, n = 100.0, 8
    grid = Grid.uniform((0, n * side), (0, n * side), shape=(2, 2))
    x, y = (side * (np.indices((n, n)).reshape(2, -1) + 0.5))[::-1]
    still = np.zeros(n * n)
    along_x = internal_stress(grid, x, y, still + side, still, still - 3e4, still, (n * side,) * 2)
    assert along_x.xx == pytest.approx(-3e4 / side, rel=1e-12)
    assert np.abs(along_x.yy).max() == np.abs(along_x.xy).max() == 0
    along_y = internal_stress(grid, x, y, still, still + side, still, still - 3e4, (n * side,) * 2)
    xx, yy = along_x.xx + along_y.xx, along_x.yy + along_y.yy
    assert pressure(xx, yy) == pytest.approx(3e4 / side, rel=1e-12)  # compression: positive
    assert maximum_shear(xx, along_x.xy, yy) == pytest.approx(0, abs=1e-9)
    assert maximum_shear(along_x.xx, along_x.xy, along_x.yy) == pytest.approx(150, rel=1e-12)


def test_pressure_and_maximum_shear_are_mean_and_difference_of_the_principal_stresses():
    xx, xy, yy = np.random.default_rng(5).normal(size=(3, 20))
    principal = np.linalg.eigvalsh(np.stack([xx, xy, xy, yy], axis=1).reshape(-1, 2, 2))
    assert pressure(xx, yy) == pytest.approx(-principal.mean(axis=1))
    assert maximum_shear(xx, xy, yy) == pytest.approx(np.diff(principal, axis=1)[:, 0] / 2)


@settings(deadline=None, max_examples=40)
@given(kinds, seeds, log_ratios)
def test_the_divergence_sums_to_the_net_contact_force(kind, seed, log_ratio):
    grid = masked(GRIDS[kind], seed)
    x, y, radius = random_floes(seed, log_ratio)
    weights = floe_weights(grid, x, y, radius)
    fx, fy = np.random.default_rng(seed).normal(size=(2, x.size))
    on_grid = divergence(grid, weights, fx, fy)
    some = ~without_cell(weights)
    for force, field in zip((fx, fy), on_grid, strict=True):
        assert abs((field * grid.area).sum() - force[some].sum()) <= 1e-12 * np.abs(force).sum()


@pytest.mark.parametrize("kind", KINDS)
def test_the_divergence_does_the_work_that_contacts_do_on_the_floes(kind):
    grid = masked(GRIDS[kind], 1)
    x, y, radius = random_floes(1, 0.0)
    weights = floe_weights(grid, x, y, radius)
    rng = np.random.default_rng(2)
    fx, u = rng.normal(size=x.size), rng.normal(size=grid.size)
    on_grid, _ = divergence(grid, weights, fx, 0 * fx)
    work = (gather(weights, u) * fx).sum()
    assert (u * on_grid * grid.area).sum() == pytest.approx(work, rel=1e-12)


def test_the_divergence_is_the_slope_of_the_stress_of_a_chain_that_is_pushed_along():
    """A chain along x, its contact force growing linearly: σ_xx(x) and ∂σ_xx/∂x are known."""
    n, slope = 1200, 5.0  # floes; N of contact force per contact
    spacing = SIDE / n
    grid = Grid.uniform((0, SIDE), (0, spacing), shape=(1, CELLS))
    x = spacing * (np.arange(n) + 0.5)
    y = np.full(n, spacing / 2)
    force = slope * (np.arange(n - 1) + 1)  # contact k holds floes k and k + 1 apart
    zero = np.zeros(n - 1)
    stress = internal_stress(grid, x[:-1], y[:-1], zero + spacing, zero, -force, zero)
    net = np.zeros(n)
    net[:-1] -= force
    net[1:] += force
    weights = floe_weights(grid, x, y, 0.4 * spacing)
    along_x, _ = divergence(grid, weights, net, np.zeros(n))
    differences = (stress.xx[2:] - stress.xx[:-2]) / (2 * SIDE / CELLS)
    # The end cells hold the two ends of the chain; elsewhere each floe is pushed west by `slope`.
    assert along_x[1:-1] == pytest.approx(-slope / spacing**2, rel=1e-9)
    assert differences[1:-1] == pytest.approx(along_x[2:-2], rel=1e-9)


def test_no_floes_and_no_contacts_make_empty_fields():
    grid = GRIDS["curvilinear"]
    cover = coverage(grid, [], [], [])
    assert cell_fields(grid, cover, 1.0, 0.0, 0.0, 1.0, DENSITY)["area_fraction"].max() == 0
    assert internal_stress(grid, [], [], [], [], [], []).xx.max() == 0


@pytest.mark.parametrize(
    ("attempt", "says"),
    [
        (lambda: coverage(GRIDS["uniform"], [np.inf], [0.0], [1.0]), "floe 0: x = inf"),
        (
            lambda: cell_fields(
                GRIDS["uniform"], coverage(GRIDS["uniform"], [1.0], [1.0], [1.0]),
                np.ones(2), 0.0, 0.0, 1.0, DENSITY,
            ),
            "thickness has shape",
        ),
        (
            lambda: area_budget(GRIDS["unstructured"], coverage(GRIDS["uniform"], [1], [1], [1])),
            "cells",
        ),
        (
            lambda: internal_stress(GRIDS["uniform"], [1.0], [1.0], [1.0], [1.0], [1.0], []),
            "fy has shape",
        ),
        (
            lambda: internal_stress(GRIDS["uniform"], [1.0], [1.0], [np.nan], [1.0], [1.0], [0.0]),
            "contact 0: dx = nan",
        ),
    ],
)  # fmt: skip
def test_bad_input_is_refused_in_one_line(attempt, says):
    with pytest.raises(InputError, match=says) as refusal:
        attempt()
    assert "\n" not in str(refusal.value)


# Floe 0 lies in cell 0, floe 1 half in each of the two, floe 2 in none, floe 3 came in since.
SHARES = dict(
    start=np.array([0, 1, 3, 3]), cell=np.array([0, 0, 1]), amount=np.array([2.0, 2.0, 2.0]),
    over=np.array([0.5, 0.25, 3.0]), number=np.array([1, 3, 0, 2]),
)  # fmt: skip


def in_lanes(*values):
    return np.array([[*values, *[np.nan] * (BLOCK - len(values))]])


def test_what_fluids_gave_is_shared_out_and_what_finds_no_cell_is_lost_but_not_that_of_new_floes():
    x, y = in_lanes(2.0, 70.0, 3.0, 5.0), in_lanes(-4.0, 80.0, 1.0, 7.0)
    last_x, last_y, lost = np.full(2, 9.0), np.full(2, 9.0), np.array([100.0, 200.0])
    total_x, total_y = np.array([10.0, 20.0]), np.array([30.0, 40.0])
    fluid = x, y, last_x, last_y, total_x, total_y, lost
    uncompiled(give_back)(**SHARES, fluids=(fluid,))
    assert last_x.tolist() == [-3.0 - 1.0, -1.0] and last_y.tolist() == [-1.0 + 2.0, 2.0]
    assert total_x.tolist() == [6.0, 19.0] and total_y.tolist() == [31.0, 42.0]
    assert lost.tolist() == [95.0, 193.0]


def test_sizes_of_drag_are_by_floe_cell_and_area():
    u, v = np.array([0.1, 0.2, 0.3, 0.4]), np.array([0.5, 0.6, 0.7, 0.8])
    mass = np.array([10.0, 20.0, 30.0, 40.0])
    magnitude, slope = np.full((2, 2), 9.0)
    uncompiled(sizes_of_drag)(
        **SHARES, impulse_x=in_lanes(3.0, 1.0, 5.0, 1.0), impulse_y=in_lanes(4.0, 1.0, -12.0, 1.0),
        fluid_u=in_lanes(0.5, 0.0, 0.1, 0.0), fluid_v=in_lanes(1.0, 0.0, -0.5, 0.0),
        rate=in_lanes(0.1, 1.0, 0.3, 1.0), u=u, v=v, mass=mass, cell_area=np.array([2.0, 4.0]),
        magnitude=magnitude, slope=slope,
    )  # fmt: skip
    assert magnitude == pytest.approx([(13.0 + 2.5) / 2.0, 2.5 / 4.0])
    one, other = 1.0 * 0.3 * 10.0, 0.5 * 0.1 * 20.0  # K |Δu| of floes 0 and 1
    assert slope == pytest.approx([(one + 0.5 * other) / 2.0, 0.5 * other / 4.0])
