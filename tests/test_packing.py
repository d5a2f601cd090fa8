"""Laying out floes by concentration, from fields, on lattices and from tables: the ice that was asked for, without overlap."""

import doctest
import json
import warnings

import numpy as np
import pytest
import shapely
from hypothesis import given, settings, strategies as st
from scipy import spatial

import floebmi.packing
from floebmi.boundaries import Domain
from floebmi.coast import from_polygons, land_geometry
from floebmi.errors import InputError
from floebmi.floes import FIXED, Floes
from floebmi.grid import Grid
from floebmi.packing import IceNotPlaced, from_field, read_floes, regular, relax, scatter
from floebmi.sampling import coverage
from floebmi.scene import read_scene
from floebmi.sizes import PowerLaw, SingleSize, UniformSize

PERIODIC = {edge: "periodic" for edge in ("west", "east", "south", "north")}
CLOSED = {edge: "closed" for edge in ("west", "east", "south", "north")}
CHANNEL = {"west": "periodic", "east": "periodic", "north": "closed"}


def box(sizes, n, concentration, edges, origin=(0.0, 0.0)):
    """A domain twice as wide as high that holds about n floes at a concentration."""
    high = np.sqrt(n * sizes.mean_area() / concentration / 2)
    (x, y) = origin
    return Domain((x, x + 2 * high), (y, y + high), **edges)


def largest_overlap(floes, domain):
    """Over the smaller radius, by comparing all pairs."""
    dx = floes.x[:, None] - floes.x
    dy = floes.y[:, None] - floes.y
    for d, length in zip((dx, dy), domain.period, strict=True):
        if length is not None:
            d -= length * np.rint(d / length)
    gap = np.hypot(dx, dy) - floes.radius[:, None] - floes.radius
    np.fill_diagonal(gap, 0.0)
    return float((-gap / np.minimum(floes.radius[:, None], floes.radius)).max())


def assert_inside(floes, domain):
    for at, (low, high), length in zip(
        (floes.x, floes.y), (domain.x, domain.y), domain.period, strict=True
    ):
        reach = floes.radius if length is None else 0.0
        assert (at - reach >= low).all() and (at + reach <= high).all()


def test_examples_in_the_docstrings_are_true():
    assert doctest.testmod(floebmi.packing).failed == 0


@pytest.mark.parametrize("edges", [{}, PERIODIC, CLOSED, CHANNEL], ids=str)
@pytest.mark.parametrize(
    "sizes, concentration, n",
    [
        (UniformSize(10.0, 20.0), 0.85, 700),
        (PowerLaw(5.0, 50.0), 0.85, 700),
        (PowerLaw(1.0, 150.0), 0.8, 1200),
        (SingleSize(10.0), 0.82, 700),
        (PowerLaw(5.0, 50.0), 0.3, 300),
    ],
    ids=str,
)
def test_scattered_floes_have_the_concentration_and_do_not_overlap(sizes, concentration, n, edges):
    domain = box(sizes, n, concentration, edges, origin=(-4e6, 3e6))
    floes = scatter(domain, sizes, concentration=concentration, thickness=2.0, seed=5)
    assert abs(floes.area.sum() / domain.area / concentration - 1) <= 0.005
    assert largest_overlap(floes, domain) <= 1e-9
    assert_inside(floes, domain)
    assert (floes.thickness == 2.0).all() and not floes.motion.any()
    low, high = sizes.range
    assert floes.radius.min() >= low and floes.radius.max() <= high


def test_one_size_reaches_85_percent_in_a_periodic_box():
    domain = box(SingleSize(10.0), 600, 0.85, PERIODIC)
    floes = scatter(domain, SingleSize(10.0), concentration=0.85, seed=1)
    assert floes.area.sum() / domain.area == pytest.approx(0.85, rel=0.005)
    assert largest_overlap(floes, domain) <= 1e-9


def test_the_check_for_overlaps_would_see_one():
    floes = scatter(box(SingleSize(10.0), 200, 0.8, {}), SingleSize(10.0), count=200)
    domain = box(SingleSize(10.0), 200, 0.8, {})
    floes.radius[17] *= 1.2
    assert largest_overlap(floes, domain) > 0.01


def test_the_same_seed_gives_the_same_bits_and_another_seed_another_packing():
    domain = box(PowerLaw(5.0, 50.0), 300, 0.8, PERIODIC)
    one, same, other = (
        scatter(domain, PowerLaw(5.0, 50.0), concentration=0.8, seed=s) for s in (7, 7, 8)
    )
    for name in ("x", "y", "radius"):
        assert getattr(one, name).tobytes() == getattr(same, name).tobytes()
    assert one.x[:50].tobytes() != other.x[:50].tobytes()


def test_packing_keeps_the_sizes_that_were_drawn():
    sizes = PowerLaw(5.0, 50.0)
    domain = box(sizes, 500, 0.8, PERIODIC)
    floes = scatter(domain, sizes, count=500, seed=11)
    drawn = sizes.draw(500, np.random.Generator(np.random.PCG64(11)))
    np.testing.assert_array_equal(np.sort(floes.radius), np.sort(drawn))


def test_the_ice_is_spread_evenly_and_irregularly():
    sizes = UniformSize(10.0, 20.0)
    domain = box(sizes, 3200, 0.5, PERIODIC)
    floes = scatter(domain, sizes, concentration=0.5, seed=1)
    width = domain.x[1] / 8
    area, _, _ = np.histogram2d(floes.x, floes.y, (8, 4), (domain.x, domain.y), weights=floes.area)
    assert abs(area / (0.5 * width**2) - 1).max() < 0.1
    # no lattice: angles to the nearest neighbour have no preferred direction
    d = floes.x[:, None] - floes.x + 1j * (floes.y[:, None] - floes.y)
    np.fill_diagonal(d, np.inf)
    nearest = d[np.arange(len(d)), abs(d).argmin(axis=1)]
    for order in (1, 2, 4, 6):
        assert abs(np.mean((nearest / abs(nearest)) ** order)) < 0.06


@pytest.mark.parametrize("count", [1, 8])
@pytest.mark.parametrize("sizes", [SingleSize(10.0), PowerLaw(5.0, 25.0)])
def test_of_many_seeds_each_part_of_the_domain_gets_its_share_of_few_floes(sizes, count):
    domain = Domain((0.0, 1e3), (0.0, 1e3), *["periodic"] * 4)
    packs = [scatter(domain, sizes, count=count, seed=seed) for seed in range(256)]
    x, y = (np.concatenate([getattr(floes, name) for floes in packs]) for name in "xy")
    found, _, _ = np.histogram2d(x % 1e3, y % 1e3, 4, ((0, 1e3), (0, 1e3)))
    expected = 256 * count / 16
    # χ² of 15 degrees of freedom, 0.1 %; floes that keep away from each other stay below it
    assert ((found - expected) ** 2 / expected).sum() < 37.7


@settings(max_examples=30, deadline=None)
@given(
    st.integers(0, 60),
    st.floats(1.0, 30.0),
    st.floats(0.05, 0.6),
    st.sampled_from([{}, PERIODIC, CLOSED, CHANNEL]),
    st.integers(0, 2**31),
)
def test_any_number_of_floes_is_laid_without_overlap(count, ratio, concentration, edges, seed):
    sizes = PowerLaw(3.0, 3.0 * ratio)
    radius = sizes.draw(count, np.random.Generator(np.random.PCG64(seed)))
    area = np.pi * np.sum(radius**2) / concentration
    side = max(np.sqrt(area), 4.1 * radius.max(initial=1.0))
    domain = Domain((0.0, side), (-side, 0.0), **edges)
    floes = scatter(domain, sizes, count=count, seed=seed)
    assert len(floes) == count
    assert_inside(floes, domain)
    if count > 1:
        assert largest_overlap(floes, domain) <= 1e-9


def test_a_concentration_of_0_is_no_ice():
    domain = Domain((0.0, 1000.0), (0.0, 1000.0))
    assert scatter(domain, SingleSize(10.0), concentration=0).x.size == 0
    free = read_scene("periodic-box", ["floes.concentration=0"]).build().model
    assert free.floes.x.size == 0


@pytest.mark.parametrize(
    "change, said",
    [
        ({"concentration": None, "count": 10**15}, "would cover at least "),  # before any is drawn
        ({"concentration": None}, "give either concentration or count"),
        ({"count": 3}, "give either concentration or count"),
        ({"concentration": 1.2}, "concentration = 1.2; must be between 0 and 1"),
        ({"concentration": 0.97}, "about 0.85 can be packed"),
        ({"concentration": 0.92}, "floes find no room"),
        (
            {"concentration": None, "count": 645, "seed": 1},
            "count = 645: the floes would cover 0.9",
        ),
        ({"concentration": None, "count": -1}, "count = -1; must be a whole number"),
        (
            {"concentration": None, "count": 1, "sizes": SingleSize(300.0)},
            "y from 0 to 500 m: must be at least 600 m long, 2 radii of the",
        ),
        ({"sizes": SingleSize(200.0)}, "no number of the floes drawn comes within 0.5 %"),
        ({"sizes": PowerLaw(5.0, 4.0)}, "radius_max = 4 m"),
        ({"thickness": 0.0}, "thickness = 0.0 m; must be greater than 0"),
        ({"seed": -1}, "seed = -1; must be a whole number"),
        ({"domain": Domain((0, 1), (0, 0))}, "domain.y"),
    ],
)
def test_what_cannot_be_packed_is_refused_in_one_line(change, said):
    given = {
        "domain": Domain((0.0, 1000.0), (0.0, 500.0)),
        "sizes": UniformSize(10.0, 20.0),
        "concentration": 0.5,
    }
    with pytest.raises(InputError) as error:
        scatter(**(given | change))
    assert said in str(error.value) and "\n" not in str(error.value)


def funnel():
    """Land on both sides of a strait, with a cape, and a small island."""
    left = [(0, 0), (400, 0), (400, 500), (430, 505), (400, 510), (200, 1000), (0, 1000)]
    right = [(1000, 0), (700, 0), (700, 500), (900, 1000), (1000, 1000)]
    island = [(540, 700), (560, 700), (550, 740)]
    return [np.array(ring, float) for ring in (left, right, island)]


@pytest.mark.parametrize("concentration", [0.5, 0.8])
def test_floes_keep_clear_of_land_and_of_the_coast_that_lines_it(concentration):
    coast = from_polygons(funnel(), radius=20.0)
    domain = Domain((0.0, 1000.0), (0.0, 1000.0))
    sizes = PowerLaw(4.0, 40.0)
    floes = scatter(domain, sizes, concentration=concentration, seed=3, land=coast)
    land = land_geometry(coast.polygons)
    room = domain.area - land.area
    assert floes.area.sum() / room == pytest.approx(concentration, rel=0.005)
    clear = shapely.distance(land, shapely.points(floes.x, floes.y)) - floes.radius
    assert (clear >= -1e-9 * floes.radius).all()
    together = Floes.concatenate([floes, coast.floes])
    gap = np.hypot(*(floes.x[:, None] - coast.floes.x, floes.y[:, None] - coast.floes.y))
    assert (gap - floes.radius[:, None] - coast.floes.radius).min() > -1e-9
    assert largest_overlap(floes, domain) <= 1e-9
    assert len(together) == len(floes) + len(coast.floes)
    # on both sides of the strait's narrowest part
    assert (floes.y < 400).any() and (floes.y > 600).any()
    # negative control: without land there are floes on it
    bare = scatter(domain, sizes, concentration=concentration, seed=3)
    assert shapely.contains_xy(land, bare.x, bare.y).any()


@pytest.mark.parametrize("away", [0.0, 1000.0, -3000.0])  # over the seam, and periods away from it
def test_land_beyond_a_periodic_edge_is_land_on_the_other_side(away):
    ring = np.array([(800.0, 300.0), (1300.0, 300.0), (1300.0, 700.0), (800.0, 700.0)])
    domain = Domain((0.0, 1000.0), (0.0, 1000.0), west="periodic", east="periodic")
    floes = scatter(domain, SingleSize(20.0), 0.5, seed=1, land=[ring + (away, 0.0)])
    both = shapely.MultiPolygon([shapely.Polygon(ring), shapely.Polygon(ring - (1000.0, 0.0))])
    clear = shapely.distance(both, shapely.points(floes.x, floes.y)) - floes.radius
    assert clear.min() > 0.0
    assert floes.area.sum() / (1e6 - 500.0 * 400.0) == pytest.approx(0.5, rel=0.005)


def test_land_may_be_rings_or_the_dry_cells_of_a_grid():
    domain = Domain((0.0, 1000.0), (0.0, 1000.0))
    wet = np.ones((10, 10), bool)
    wet[3:6, 4:7] = False
    grid = Grid.uniform(domain.x, domain.y, shape=(10, 10), wet=wet.ravel())
    ring = np.array([(400.0, 300.0), (700.0, 300.0), (700.0, 600.0), (400.0, 600.0)])
    land = shapely.Polygon(ring)
    for shore in (grid, [ring]):
        floes = scatter(domain, UniformSize(10.0, 30.0), concentration=0.7, seed=1, land=shore)
        clear = shapely.distance(land, shapely.points(floes.x, floes.y)) - floes.radius
        assert clear.min() > 0.0
        assert floes.area.sum() / (1e6 - land.area) == pytest.approx(0.7, rel=0.005)


def test_a_domain_without_water_is_refused():
    ring = np.array([(-1.0, -1.0), (11.0, -1.0), (11.0, 11.0), (-1.0, 11.0)])
    with pytest.raises(InputError, match="land covers the whole domain"):
        scatter(Domain((0.0, 10.0), (0.0, 10.0)), SingleSize(1.0), count=3, land=[ring])


def ice_edge(grid, top=0.8):
    """Ice that thins out to the east, open water in the west quarter, thickness by row."""
    x0, x1 = grid.x.min(), grid.x.max()
    fraction = np.clip(top * 1.3 * (x1 - grid.x) / (x1 - x0), 0.0, top)
    fraction[grid.x < x0 + 0.25 * (x1 - x0)] = 0.0
    return fraction, 1.0 + (grid.y - grid.y.min()) / np.ptp(grid.y)


def cells_of(floes, grid):
    found = coverage(grid, floes.x, floes.y, floes.radius, (None, None))
    return np.bincount(found.cell, found.area, minlength=grid.size)


def make_grids():
    wet = np.ones((12, 16), bool)
    wet[4:7, 8:11] = False
    wet[0, :5] = False
    uniform = Grid.uniform((0.0, 16e3), (0.0, 12e3), shape=(12, 16), wet=wet.ravel())
    column, row = np.meshgrid(np.arange(17.0), np.arange(13.0))
    curved = Grid.curvilinear(
        1e3 * (column + 0.3 * np.sin(row / 4)),
        1e3 * (row + 0.2 * np.cos(column / 5)),
        wet=wet.ravel(),
    )
    return uniform, curved


def total(grid, values, size=4):
    """Sums over blocks of size x size cells of a 12 x 16 grid."""
    row, column = np.divmod(np.arange(grid.size), 16)
    return np.bincount(row // size * 4 + column // size, values)


@pytest.mark.parametrize("grid", make_grids(), ids=lambda grid: grid.kind)
@pytest.mark.parametrize(
    "sizes, error", [(UniformSize(60.0, 120.0), 0.03), (PowerLaw(40.0, 900.0), 0.15)], ids=str
)
def test_floes_from_a_field_hold_its_ice_where_it_lies(grid, sizes, error):
    fraction, thickness = ice_edge(grid)
    floes = from_field(grid, fraction, thickness, sizes, seed=4)
    ice = np.where(grid.wet, fraction, 0.0) * grid.area
    domain = Domain((grid.node_x.min(), grid.node_x.max()), (grid.node_y.min(), grid.node_y.max()))
    half_a_floe = 0.5 * np.pi * sizes.range[1] ** 2
    assert abs(floes.area.sum() - ice.sum()) <= max(half_a_floe, 0.005 * ice.sum())
    assert largest_overlap(floes, domain) <= 1e-9
    found = cells_of(floes, grid)
    assert found[~grid.wet].sum() == 0.0
    # in blocks of 16 km², more or less ice by a share of the block that grows with the largest
    # floes
    assert abs(total(grid, found - ice)).max() < error * 16e6
    assert floes.volume.sum() == pytest.approx(np.sum(ice * thickness), rel=error / 3)
    # negative control: the same floes mirrored do not fit the field
    floes.x = domain.x[0] + domain.x[1] - floes.x
    assert abs(total(grid, cells_of(floes, grid) - ice)).max() > 0.4 * 16e6


def bent_seams():
    """A grid that goes round a periodic domain of 12 km, its seams not straight; cells reach beyond the edges."""
    x, y = np.meshgrid(np.linspace(0, 12e3, 13), np.linspace(0, 12e3, 13))
    turn = 2 * np.pi / 12e3
    grid = Grid.curvilinear(x + 900 * np.sin(turn * y), y + 600 * np.sin(turn * x))
    return grid, Domain((0, 12e3), (0, 12e3), **PERIODIC)


def test_a_seam_that_is_not_straight_leaves_no_ice_out():
    grid, domain = bent_seams()
    floes = from_field(grid, np.full(grid.size, 0.4), 1.0, UniformSize(40.0, 80.0), domain, seed=3)
    assert floes.area.sum() == pytest.approx(0.4 * 144e6, rel=0.002)
    cover = coverage(grid, floes.x, floes.y, floes.radius, domain.period)
    found = np.bincount(cover.cell, cover.area, grid.size) / grid.area
    assert abs(found - 0.4).max() < 0.06
    # a domain of half the grid has no seam that the grid could meet
    with pytest.raises(InputError, match="is shorter than the grid"):
        from_field(grid, 0.4, 1.0, UniformSize(40.0, 80.0), domain._replace(x=(0, 6e3)))


def test_dry_cells_beyond_a_seam_that_is_not_straight_are_land_on_the_other_side():
    grid, domain = bent_seams()
    row, column = np.divmod(np.arange(grid.size), 12)
    grid = grid.with_wet((row != 0) & (column != 11))
    water = grid.area[grid.wet].sum()
    sizes = UniformSize(60.0, 120.0)
    scattered = scatter(domain, sizes, concentration=0.7, seed=1, land=grid)
    assert scattered.area.sum() == pytest.approx(0.7 * water, rel=0.005)
    for floes in (from_field(grid, 0.8, 1.0, sizes, domain, seed=1), scattered):
        cover = coverage(grid, floes.x, floes.y, floes.radius, domain.period)
        assert cover.area[~grid.wet[cover.cell]].sum() < 1.0  # m² of 96 km²
    with pytest.raises(InputError, match="is shorter than the grid"):
        scatter(domain._replace(x=(0, 6e3)), sizes, count=9, land=grid)


def test_each_cell_gets_its_ice_within_about_half_a_floe():
    grid = Grid.uniform((0.0, 8e3), (0.0, 8e3), shape=(8, 8))
    fraction = np.linspace(0.02, 0.15, 64)
    floes = from_field(grid, fraction, 1.0, SingleSize(25.0), seed=2)
    found = np.bincount(grid.locate(floes.x, floes.y), minlength=64)
    wanted = fraction * grid.area / (np.pi * 25.0**2)
    # half a floe at both ends of its piece of the string, and two that were pressed across
    assert abs(found - wanted).max() <= 3.0
    assert abs(found.sum() - wanted.sum()) <= 0.5
    # negative control: floes thrown anywhere in proportion are off by their square root
    thrown = np.random.default_rng(1).multinomial(len(floes), wanted / wanted.sum())
    assert abs(thrown - wanted).max() > 8.0


def test_small_floes_lie_all_over_a_field_of_which_large_ones_cover_cells():
    grid = Grid.uniform((0.0, 20e3), (0.0, 10e3), spacing=1e3)
    floes = from_field(grid, 0.8, 1.0, PowerLaw(50.0, 800.0, -2.0), seed=0)
    small = floes.radius < 200.0
    share, _, _ = np.histogram2d(
        floes.x[small], floes.y[small], (4, 2), ((0, 20e3), (0, 10e3)), weights=floes.area[small]
    )
    assert (abs(share / share.sum() - 1 / 8) < 0.05).all()


def test_a_floe_has_the_thickness_of_its_cell():
    grid = Grid.uniform((0.0, 4e3), (0.0, 4e3), shape=(4, 4))
    thickness = 1.0 + np.arange(16.0)
    floes = from_field(grid, 0.3, thickness, SingleSize(30.0), seed=2)
    here = thickness[grid.locate(floes.x, floes.y)]
    assert np.mean(here == floes.thickness) > 0.9
    assert set(floes.thickness) <= set(thickness)


def test_ice_above_the_highest_concentration_is_left_out_with_a_warning():
    grid = Grid.uniform((0.0, 4e3), (0.0, 4e3), shape=(4, 4))
    fraction = np.full(16, 0.5)
    fraction[5:7] = 1.0
    with pytest.warns(IceNotPlaced, match=r"3e\+05 m² .* above max_concentration = 0.85"):
        floes = from_field(grid, fraction, 1.0, UniformSize(30.0, 60.0), seed=2)
    assert floes.area.sum() == pytest.approx((14 * 0.5 + 2 * 0.85) * 1e6, rel=0.002)


def test_ice_that_finds_no_room_is_left_out_with_a_warning():
    wet = np.zeros((8, 8), bool)
    wet[2:6, 1:4] = True
    wet[3, 4:8] = True  # a channel too narrow for any floe
    grid = Grid.uniform((0.0, 8e3), (0.0, 8e3), shape=(8, 8), wet=wet.ravel())
    with pytest.warns(IceNotPlaced, match="floes that found no room"):
        floes = from_field(grid, 0.85, 1.0, UniformSize(520.0, 600.0), seed=2)
    domain = Domain((0.0, 8e3), (0.0, 8e3))
    assert largest_overlap(floes, domain) <= 1e-9
    assert cells_of(floes, grid)[~grid.wet].sum() == 0.0
    assert len(floes) > 3


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_where_a_pack_jams_few_floes_are_left_out(seed):
    grid = Grid.uniform((0.0, 8e3), (0.0, 8e3), shape=(8, 8))
    with pytest.warns(IceNotPlaced, match="floes that found no room"):
        floes = from_field(grid, 0.85, 1.0, SingleSize(200.0), seed=seed)
    assert largest_overlap(floes, Domain((0.0, 8e3), (0.0, 8e3))) <= 1e-9
    # equal floes jam at about 0.82, and have less room at edges
    assert floes.area.sum() > 0.77 * 64e6


def test_less_ice_than_half_a_floe_is_left_out_with_a_warning():
    grid = Grid.uniform((0.0, 8e3), (0.0, 8e3), shape=(8, 8))
    with pytest.warns(IceNotPlaced, match=r"64 m² \(100.00%\) less than half a floe"):
        assert len(from_field(grid, 1e-6, 1.0, SingleSize(50.0))) == 0


def test_a_domain_inside_the_grid_gets_only_its_own_ice():
    grid = Grid.uniform((0.0, 8e3), (0.0, 8e3), shape=(8, 8))
    domain = Domain((1.5e3, 6.2e3), (0.7e3, 5.5e3))
    floes = from_field(grid, 0.6, 1.0, UniformSize(30.0, 60.0), domain, seed=1)
    assert_inside(floes, domain)
    assert floes.area.sum() == pytest.approx(0.6 * domain.area, rel=0.003)


def test_a_field_without_ice_gives_no_floes_and_no_warning():
    grid = Grid.uniform((0.0, 8e3), (0.0, 8e3), shape=(8, 8))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(from_field(grid, 0.0, 0.0, SingleSize(50.0))) == 0


@pytest.mark.parametrize(
    "name, value, said",
    [
        ("area_fraction", np.nan, "area_fraction of cell 9 = nan; must be between 0 and 1"),
        ("area_fraction", -0.1, "area_fraction of cell 9 = -0.1; must be between 0 and 1"),
        ("thickness", 0.0, "thickness of cell 9 = 0.0; must be greater than 0 where there is ice"),
        ("thickness", np.nan, "thickness of cell 9 = nan; must be"),
    ],
)
def test_a_field_value_that_cannot_be_used_is_refused_on_wet_cells_only(name, value, said):
    fields = {"area_fraction": np.full(16, 0.4), "thickness": np.full(16, 1.0)}
    fields[name][9] = value
    grid = Grid.uniform((0.0, 4e3), (0.0, 4e3), shape=(4, 4))
    with pytest.raises(InputError) as error:
        from_field(grid, sizes=SingleSize(50.0), **fields)
    assert said in str(error.value)
    wet = np.arange(16) != 9
    assert len(from_field(grid.with_wet(wet), sizes=SingleSize(50.0), **fields)) > 100
    with pytest.raises(InputError, match="area_fraction has shape"):
        from_field(grid, np.zeros(3), 1.0, SingleSize(50.0))
    with pytest.raises(InputError, match=r"area_fraction has shape \(2, 8\): must be \(4, 4\)"):
        from_field(grid, np.zeros((2, 8)), 1.0, SingleSize(50.0))


@pytest.mark.parametrize("lattice, neighbours", [("hexagonal", 6), ("square", 4)])
@pytest.mark.parametrize("edges", [{}, PERIODIC, CHANNEL], ids=str)
def test_a_lattice_has_its_spacing_and_its_neighbours(lattice, neighbours, edges):
    domain = Domain((100.0, 1100.0), (0.0, 20 * 50 * np.sqrt(0.75)), **edges)
    if lattice == "square":
        domain = domain._replace(y=(0.0, 800.0))
    floes = regular(domain, 20.0, spacing=50.0, lattice=lattice)
    assert_inside(floes, domain)
    dx, dy = floes.x[:, None] - floes.x, floes.y[:, None] - floes.y
    for d, length in zip((dx, dy), domain.period, strict=True):
        if length is not None:
            d -= length * np.rint(d / length)
    distance = np.hypot(dx, dy)
    np.fill_diagonal(distance, np.inf)
    assert distance.min() == pytest.approx(50.0)
    near = (distance < 50.001).sum(axis=1)
    assert near.max() == neighbours
    assert np.median(near) == neighbours
    if edges == PERIODIC:
        assert near.min() == neighbours


@pytest.mark.parametrize("edges", [{}, PERIODIC, CHANNEL], ids=str)
@pytest.mark.parametrize("concentration", [0.2, 0.6, 0.85])
def test_a_lattice_has_the_concentration_as_closely_as_rows_allow(concentration, edges):
    domain = Domain((0.0, 1700.0), (0.0, 1100.0), **edges)
    floes = regular(domain, 20.0, concentration=concentration)
    assert floes.area.sum() / domain.area == pytest.approx(concentration, rel=0.03)
    assert largest_overlap(floes, domain) <= 1e-9
    assert_inside(floes, domain)


@pytest.mark.parametrize(
    "change, said",
    [
        ({"spacing": 30.0}, "spacing = 30.0 m; must be at least 2 radii, 40 m"),
        ({"spacing": 44.0}, "whole rows along the period are"),
        (
            {"domain": Domain((0, 100), (0, 300)), "radius": 60.0, "spacing": 130.0},
            "radius = 60 m; no floe has room",
        ),
        ({"spacing": None}, "give either concentration or spacing"),
        ({"spacing": None, "concentration": 0.95}, "nearest that fits"),
        ({"spacing": None, "concentration": "0.5"}, "concentration = '0.5'; must be between"),
        ({"lattice": "hexagon"}, "did you mean 'hexagonal'?"),
        ({"radius": -1.0}, "radius = -1.0 m; must be greater than 0"),
    ],
)
def test_a_lattice_that_does_not_fit_is_refused(change, said):
    given = {"domain": Domain((0, 100), (0, 300), **PERIODIC), "radius": 20.0, "spacing": 50.0}
    if change.get("spacing") == 44.0:
        given["domain"] = Domain((0, 117), (0, 300), **PERIODIC)
    with pytest.raises(InputError) as error:
        regular(**(given | change))
    assert said in str(error.value)


def heap(n=400, concentration=0.5, seed=1):
    """Floes in random places: most overlap, some lie on others."""
    rng = np.random.default_rng(seed)
    radius = rng.uniform(10.0, 20.0, n)
    side = np.sqrt(np.pi * np.sum(radius**2) / concentration)
    floes = Floes(rng.random(n) * side, rng.random(n) * side, radius, 1.0)
    return floes, Domain((0.0, side), (0.0, side), **CLOSED)


@pytest.mark.parametrize("concentration", [0.5, 0.75])
def test_relaxing_presses_a_random_start_apart(concentration):
    floes, domain = heap(concentration=concentration)
    assert largest_overlap(floes, domain) > 0.5
    radius, u = floes.radius.copy(), floes.u.copy()
    assert relax(floes, domain) == 0.0
    assert largest_overlap(floes, domain) <= 1e-9
    assert_inside(floes, domain)
    np.testing.assert_array_equal(floes.radius, radius)
    np.testing.assert_array_equal(floes.u, u)


def test_relaxing_moves_neither_fixed_floes_nor_inactive_ones():
    floes, domain = heap(concentration=0.3)
    floes.motion[::40] = FIXED
    floes.active[5::10] = False
    x = floes.x.copy()
    # fixed floes that overlap each other stay so, and are not counted
    floes.x[0], floes.y[0] = x[40], floes.y[40]
    before = floes.x.copy()
    assert relax(floes, domain) == 0.0
    still = (floes.motion == FIXED) | ~floes.active
    np.testing.assert_array_equal(floes.x[still], before[still])
    assert (floes.x[~still] != before[~still]).mean() > 0.5
    free = np.flatnonzero(floes.active & (floes.motion == 0))
    seen = np.append(free, 0)
    kept = Floes(floes.x[seen], floes.y[seen], floes.radius[seen], 1.0)
    assert largest_overlap(kept, domain) <= 1e-9


def test_relaxing_tells_what_is_left_where_there_is_no_room():
    floes, domain = heap(concentration=0.95)
    left = relax(floes, domain)
    assert 0.0 < left < 0.7
    assert largest_overlap(floes, domain) == pytest.approx(left)
    assert relax(Floes([], [], [], []), domain) == 0.0


def write(tmp_path, name, text):
    path = tmp_path / name
    path.write_text(text)
    return path


def test_a_csv_file_gives_its_floes_in_any_order_and_case_of_columns(tmp_path):
    path = write(
        tmp_path,
        "floes.csv",
        "id,Radius,X,y,THICKNESS,u,motion\na,10,0,5,1.5,0.1,0\nb,20,100,6,2,0,7\n",
    )
    floes = read_floes(path)
    np.testing.assert_array_equal(floes.x, [0.0, 100.0])
    np.testing.assert_array_equal(floes.radius, [10.0, 20.0])
    np.testing.assert_array_equal(floes.thickness, [1.5, 2.0])
    np.testing.assert_array_equal(floes.u, [0.1, 0.0])
    np.testing.assert_array_equal(floes.motion, [0, FIXED])
    assert not floes.rotation
    spinning = write(tmp_path, "b.csv", "x,y,area,angular_velocity\n0,0,314.159265358979,0.1\n")
    floes = read_floes(spinning, thickness=2.0)
    assert floes.radius[0] == pytest.approx(10.0) and floes.thickness[0] == 2.0
    assert floes.rotation and floes.angular_velocity[0] == 0.1
    assert len(read_floes(write(tmp_path, "c.csv", "x,y,radius\n"), thickness=1.0)) == 0


@pytest.mark.parametrize(
    "text, said",
    [
        (
            "x,y,radius,thickness\n0,0,10,1\n0,0,-3,1\n",
            "row 3, column 'radius': '-3' must be greater",
        ),
        ("x,y,radius,thickness\n0,zero,10,1\n", "row 2, column 'y': 'zero' must be a number"),
        ("x,y,radius,thickness\n0,nan,10,1\n", "row 2, column 'y': 'nan' must be a finite number"),
        ("x,y,radius,thickness\n\n0,0,9,1\n\n0,zero,10,1\n", "row 5, column 'y': 'zero'"),
        ("x,y,radius,thickness\n1_000,0,10,1\n", "row 2, column 'x': '1_000' must be a number"),
        (
            "x,y,radius,thickness\n0,-1e200,10,1\n",
            "row 2, column 'y': '-1e200' must be within 1e+09",
        ),
        ("x,y,area,thickness\n0,0,1e200,1\n", "row 2, column 'area': '1e200' must be within 1e+18"),
        ("x,y,radius,thickness\n0,0,10\n", "row 2 has 3 values; must be 4"),
        ("x,y,radius,thickness\n0,0,10,\n", "row 2, column 'thickness': '' must be a number"),
        ("x,yy,radius,thickness\n0,0,10,1\n", "has no column 'y'; allowed"),
        (
            "x,y,radius,area,thickness\n0,0,1,1,1\n",
            "must have a column 'radius' or 'area', and not",
        ),
        ("x,y,radius,thickness,Radius\n0,0,1,1,9\n", "has 2 columns 'radius'; must be one"),
        ("x,y,radius\n0,0,1\n", "has no thickness; give one"),
        ("x,y,radius,thickness,motion\n0,0,1,1,9\n", "floe 0: motion = 9"),
        ("", "empty; must have a header line"),
    ],
)
def test_a_csv_file_that_cannot_be_used_is_refused_with_row_column_and_value(tmp_path, text, said):
    path = write(tmp_path, "floes.csv", text)
    with pytest.raises(InputError) as error:
        read_floes(path)
    assert said in str(error.value) and str(error.value).startswith(str(path))


def test_a_second_thickness_and_other_endings_are_refused(tmp_path):
    path = write(tmp_path, "floes.csv", "x,y,radius,thickness\n0,0,1,1\n")
    with pytest.raises(InputError, match="has a thickness of its own"):
        read_floes(path, thickness=2.0)
    with pytest.raises(InputError, match="must end in .csv, .geojson or .json"):
        read_floes(tmp_path / "floes.txt")
    with pytest.raises(InputError, match="No such file"):
        read_floes(tmp_path / "none.csv")


@pytest.mark.parametrize("thickness", [-1.0, np.nan, "1 m", [1.0, 2.0]])
def test_a_thickness_that_is_no_length_is_refused(tmp_path, thickness):
    path = write(tmp_path, "floes.csv", "x,y,radius\n0,0,1\n0,9,1\n")
    with pytest.raises(InputError, match="thickness = .* m; must be greater than 0"):
        read_floes(path, thickness=thickness)


def features(*pairs):
    listed = [{"type": "Feature", "geometry": g, "properties": p} for g, p in pairs]
    return json.dumps({"type": "FeatureCollection", "features": listed})


def test_geojson_points_and_polygons_become_discs_of_their_area(tmp_path):
    point = {"type": "Point", "coordinates": [5000.0, 100.0]}
    square = {"type": "Polygon", "coordinates": [[[0, 0], [200, 0], [200, 200], [0, 200], [0, 0]]]}
    given = features((point, {"area": 100 * np.pi}), (square, {}))
    floes = read_floes(write(tmp_path, "a.geojson", given), thickness=1.5)
    np.testing.assert_allclose(floes.x, [5000.0, 100.0])
    np.testing.assert_allclose(floes.y, [100.0, 100.0])
    np.testing.assert_allclose(floes.area, [100 * np.pi, 200.0**2])
    given = features((point, {"Radius": 10, "thickness": 2, "u": 0.5}))
    floes = read_floes(write(tmp_path, "b.json", given))
    assert (floes.radius[0], floes.thickness[0], floes.u[0]) == (10.0, 2.0, 0.5)


def test_geojson_in_degrees_is_projected(tmp_path):
    given = features(({"type": "Point", "coordinates": [-45.0, 80.0]}, {"radius": 10}))
    path = write(tmp_path, "a.geojson", given)
    floes = read_floes(path, thickness=1.0, projection="EPSG:3413")
    assert floes.x[0] == pytest.approx(0.0, abs=1e-6) and -1.2e6 < floes.y[0] < -1.0e6
    with pytest.raises(InputError, match="look like degrees"):
        read_floes(path, thickness=1.0)


def test_a_plane_in_other_units_than_metres_gives_metres_and_degrees_are_no_plane(tmp_path):
    given = features(({"type": "Point", "coordinates": [-45.0, 80.0]}, {"radius": 10}))
    path = write(tmp_path, "a.geojson", given)
    plane = "+proj=laea +lat_0=82 +lon_0=-30 +datum=WGS84"
    metres, feet = (read_floes(path, 1.0, f"{plane} +units={unit}") for unit in ("m", "ft"))
    np.testing.assert_allclose([feet.x, feet.y], [metres.x, metres.y], rtol=1e-12)
    with pytest.raises(InputError, match="not a plane in metres"):
        read_floes(path, 1.0, "EPSG:4326")


def test_a_polygon_that_crosses_itself_is_no_floe(tmp_path):
    bow = [[0, 0], [1000, 1000], [1000, 0], [0, 2000], [0, 0]]  # its signed areas do not cancel
    given = features(({"type": "Polygon", "coordinates": [bow]}, {}))
    with pytest.raises(InputError, match="feature 0: Self-intersection.*must be a valid polygon"):
        read_floes(write(tmp_path, "a.geojson", given), thickness=1.0)


@pytest.mark.parametrize(
    "geometry, properties, said",
    [
        ([5000, 0], {"radius": -1}, "feature 0, column 'radius': -1 must be greater than 0"),
        ([5000, 0], {"radius": True}, "feature 0, column 'radius': True must be a number"),
        (
            [5000, 1e200],
            {"radius": 1},
            "feature 0: a coordinate of 1e+200 m; must be within 1e+09 m",
        ),
        ([5000, 0], {}, "must have a column 'radius' or 'area'"),
        ([5000, 0], {"radius": 1, "x": 3}, "property 'x' or 'y' beside a geometry"),
    ],
)
def test_geojson_that_cannot_be_used_is_refused_with_its_feature(
    tmp_path, geometry, properties, said
):
    text = features(({"type": "Point", "coordinates": geometry}, properties))
    with pytest.raises(InputError) as error:
        read_floes(write(tmp_path, "a.geojson", text), thickness=1.0)
    assert said in str(error.value)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("x,y,radius,thickness,name\n1,1,1,1,é".encode("latin-1"), "not a text file in UTF-8"),
        (b"0,0,10,1\n", "has no column 'x'"),
        (b"", "empty; must have a header line"),
    ],
)
def test_a_table_that_is_none_is_refused_for_what_it_is(tmp_path, content, said):
    path = tmp_path / "floes.csv"
    path.write_bytes(content)
    with pytest.raises(InputError, match=f"floes.csv: {said}"):
        read_floes(path)


def test_a_table_with_a_header_alone_has_no_floes(tmp_path):
    path = tmp_path / "floes.csv"
    path.write_text("x,y,radius,thickness\n")
    assert len(read_floes(path)) == 0


def test_floes_that_find_no_room_share_the_trees_of_where_they_may_be_laid(monkeypatch):
    made, tree = [], spatial.cKDTree
    monkeypatch.setattr(spatial, "cKDTree", lambda at: made.append(len(at)) or tree(at))
    wet = np.ones((16, 16), bool)
    wet[4:7, 5:9] = False
    grid = Grid.uniform((0.0, 3e4), (0.0, 3e4), shape=(16, 16)).with_wet(wet)
    from_field(grid, 0.85, 1.0, PowerLaw(200.0, 2000.0), seed=1)
    assert made and len(set(made)) == len(made)
