"""Vectors at a host's own points and along its own axes: force and work are the same there."""

import numpy as np
import pytest
from exchange_grids import CELLS, GRIDS, SIDE
from hypothesis import given, settings, strategies as st

from coupling.regrid import Regrid, project, sphere_area
from coupling.vectors import Staggered, axis_angle, turn
from floebmi.boundaries import Domain
from floebmi.errors import InputError
from floebmi.floes import Floes
from floebmi.forces import OceanDrag
from floebmi.grid import Grid
from floebmi.model import Model
from floebmi.projection import east_in_plane

KINDS = ("uniform", "rectilinear", "curvilinear")
POINTS = ("u", "v", "corners")

kinds = st.sampled_from(KINDS)
points = st.sampled_from(POINTS)
periods = st.tuples(st.booleans(), st.booleans())
seeds = st.integers(0, 2**32 - 1)
shares = st.floats(0.0, 0.9)  # of dry cells


def with_land(kind, seed, dry):
    return GRIDS[kind].with_wet(np.random.default_rng(seed).random(CELLS**2) >= dry)


@settings(deadline=None, max_examples=100)
@given(kinds, points, periods, seeds, shares)
def test_the_force_on_wet_cells_is_the_force_on_open_points_or_undelivered(
    kind, where, periodic, seed, dry
):
    grid = with_land(kind, seed, dry)
    staggered = Staggered(grid, where, periodic)
    stress = np.random.default_rng(seed).normal(size=grid.size)
    given_ = (stress * grid.area)[grid.wet]
    at_points = staggered.flux(np.where(grid.wet, stress, np.nan))
    arrived = (at_points * staggered.area).sum() + staggered.undelivered(stress)
    assert abs(arrived - given_.sum()) <= 1e-13 * np.abs(given_).sum()
    assert (at_points[~staggered.open] == 0).all()


@settings(deadline=None, max_examples=100)
@given(kinds, points, periods, seeds, shares)
def test_the_work_on_the_points_is_the_work_on_the_cells(kind, where, periodic, seed, dry):
    grid = with_land(kind, seed, dry)
    staggered = Staggered(grid, where, periodic)
    rng = np.random.default_rng(seed)
    stress, velocity = rng.normal(size=grid.size), rng.normal(size=staggered.open.size)
    at_points = staggered.area * staggered.flux(stress) * velocity
    at_cells = grid.area * stress * staggered.state(np.where(staggered.open, velocity, np.nan))
    assert abs(at_points.sum() - at_cells.sum()) <= 1e-12 * np.abs(at_cells).sum()


@pytest.mark.parametrize("where", POINTS)
@pytest.mark.parametrize("kind", KINDS)
def test_plain_averaging_loses_momentum_at_coasts(kind, where):
    """The wrong way: each point takes the mean of its cells, and closed points drop theirs."""
    grid = with_land(kind, 5, 0.2)
    staggered, everywhere = Staggered(grid, where), Staggered(GRIDS[kind], where)
    stress = np.where(grid.wet, 0.1, 0.0)
    force = (stress * grid.area).sum()
    # the weights of a grid without land and rim are the plain means
    plain = Staggered(GRIDS[kind], where, open=np.ones(everywhere.open.size, bool)).flux(stress)
    assert (plain * everywhere.area).sum() == pytest.approx(force, rel=1e-13)
    kept = (plain * everywhere.area)[staggered.open].sum()
    assert kept < 0.8 * force
    right = (staggered.flux(stress) * staggered.area).sum() + staggered.undelivered(stress)
    assert right == pytest.approx(force, rel=1e-13)


@pytest.mark.parametrize("where", POINTS)
@pytest.mark.parametrize("kind", KINDS)
def test_uniform_fields_stay_uniform_but_for_the_coast_that_takes_nothing(kind, where):
    grid = with_land(kind, 7, 0.1)
    staggered = Staggered(grid, where, (True, True))
    reads = staggered.weights.sum(axis=0) > 0
    velocity = staggered.state(np.full(staggered.open.size, 0.3))
    np.testing.assert_allclose(velocity[reads], 0.3, rtol=1e-14)
    assert (velocity[~reads] == 0).all()
    whole = Staggered(GRIDS[kind], where, (True, True))
    np.testing.assert_allclose(whole.flux(np.full(grid.size, 0.1)), 0.1, rtol=1e-13)


def test_a_point_that_the_host_lets_flow_beside_land_is_of_its_wet_cell_alone():
    row = Grid.uniform((0.0, 3.0), (0.0, 1.0), shape=(1, 3), wet=[True, True, False])
    faces = Staggered(row, "u", open=[False, True, True, False])
    assert repr(faces) == "Staggered(1 × 4 faces across i, 2 open)"
    assert faces.state([9.0, 0.5, 0.7, 9.0]).tolist() == [0.5, 0.6, 0.0]
    assert faces.flux([1.0, 1.0, 5.0]).tolist() == [0.0, 1.5, 0.5, 0.0]


@pytest.mark.parametrize("where", [("u", "v"), ("corners", "corners")])
@pytest.mark.parametrize("kind", KINDS)
def test_ice_and_a_staggered_ocean_keep_their_momentum_between_coasts(kind, where):
    grid = with_land(kind, 3, 0.25)
    pair = [Staggered(grid, w) for w in where]
    rng = np.random.default_rng(0)
    x, y = rng.uniform(0, SIDE, (2, 60))
    floes = Floes(x, y, rng.uniform(100, 900, 60), 1.0, u=rng.normal(0, 0.3, 60))
    model = Model(Domain((0, SIDE), (0, SIDE)), floes, forces=[OceanDrag()], grid=grid)
    column = 1000.0 * 20.0  # ρ H of the water at the points [kg m-2]
    water = [rng.normal(0, 0.3, s.open.size) * s.open for s in pair]
    mass = model.floes.mass(model.ice_density)

    def momentum():
        sea = [column * (s.area * u).sum() for s, u in zip(pair, water, strict=True)]
        return np.array(sea) + [(mass * floes.u).sum(), (mass * floes.v).sum()]

    start, nowhere = momentum(), np.zeros(2)
    for _ in range(5):
        model.ocean.u[:], model.ocean.v[:] = (s.state(u) for s, u in zip(pair, water, strict=True))
        model.advance(600.0)
        for q, (s, given_) in enumerate(
            zip(pair, (model.ocean.last_x, model.ocean.last_y), strict=True)
        ):
            water[q] += s.flux(given_ / grid.area) / column
            nowhere[q] += s.undelivered(given_ / grid.area)
    lost = momentum() + nowhere + model.ocean.undelivered - start
    assert np.abs(lost).max() <= 1e-13 * column * grid.area.sum()
    assert np.abs(nowhere + model.ocean.undelivered).max() > 0  # land that the floes do find


# ---- axes -----------------------------------------------------------------------------------------


@given(seeds)
def test_a_turn_keeps_magnitude_and_work_and_turns_back(seed):
    rng = np.random.default_rng(seed)
    angle, (u, v), (p, q) = (
        rng.uniform(-9, 9, 50),
        rng.normal(size=(2, 50)),
        rng.normal(size=(2, 50)),
    )
    (ux, uy), (px, py) = turn(u, v, angle), turn(p, q, angle)
    np.testing.assert_allclose(np.hypot(ux, uy), np.hypot(u, v), rtol=1e-14)
    np.testing.assert_allclose(ux * px + uy * py, u * p + v * q, atol=1e-13)
    np.testing.assert_allclose(turn(ux, uy, -angle), (u, v), atol=1e-14)


def test_the_axes_of_a_skewed_cell_are_shared_out_between_its_two_directions():
    """Rows along x, columns at 45 degrees: the nearest turn is that by atan2(-1, 2)."""
    i, j = np.meshgrid(np.arange(3.0), np.arange(3.0))
    assert axis_angle(Grid.curvilinear(i + j, j)) == pytest.approx(np.full(4, np.arctan2(-1, 2)))


def test_the_axes_of_a_grid_turned_as_a_whole_stand_at_that_angle():
    grid = GRIDS["rectilinear"]
    x, y = np.meshgrid(grid.x_edges, grid.y_edges)
    for angle in (-2.5, 0.0, 0.7, 3.0):
        turned = Grid.curvilinear(*turn(x, y, angle))
        np.testing.assert_allclose(axis_angle(turned), angle, atol=1e-12)
    assert np.abs(axis_angle(GRIDS["curvilinear"])).max() < 0.6


def test_a_geographic_host_gets_the_force_and_the_work_of_the_ice_in_the_plane():
    projection = "+proj=laea +lat_0=79 +lon_0=0"
    lon, lat = np.linspace(-12, 12, 13), np.linspace(74, 84, 11)
    host = Grid.rectilinear(lon, lat)
    angle = east_in_plane(projection, host.x, host.y)
    assert np.abs(angle).max() > 0.15  # forgetting it would be seen
    area = sphere_area(host)
    ice = Grid.uniform((-150e3, 150e3), (-100e3, 100e3), spacing=10e3)
    regrid = Regrid(project(host, projection), ice, source_area=area)
    rng = np.random.default_rng(4)
    east, north = rng.normal(0, 0.3, (2, host.size))
    at_ice = [
        regrid.state(values) for values in turn(east, north, angle)
    ]  # first turn, then regrid
    tau = rng.normal(0, 0.1, (2, ice.size))
    at_host = [regrid.flux(values) for values in tau]  # on the way back the other way round
    tau_east, tau_north = turn(*at_host, -angle)
    np.testing.assert_allclose(np.hypot(tau_east, tau_north), np.hypot(*at_host), rtol=1e-13)
    work_ice = sum((ice.area * t * u).sum() for t, u in zip(tau, at_ice, strict=True))
    work_host = (area * (tau_east * east + tau_north * north)).sum()
    assert work_host == pytest.approx(work_ice, rel=1e-12)
    for q, back in enumerate(turn(tau_east, tau_north, angle)):
        assert (area * back).sum() == pytest.approx((ice.area * tau[q]).sum(), rel=1e-12)
    unturned = (area * (at_host[0] * east + at_host[1] * north)).sum()
    assert abs(unturned - work_ice) > 0.01 * abs(work_ice)  # the negative control


# ---- faults ---------------------------------------------------------------------------------------

GRID = GRIDS["uniform"]


@pytest.mark.parametrize(
    ("attempt", "says"),
    [
        (lambda: Staggered(GRIDS["unstructured"], "u"), "rows and columns"),
        (lambda: axis_angle(GRIDS["unstructured"]), "rows and columns"),
        (lambda: axis_angle(None), "grid = None: must be a Grid"),
        (lambda: axis_angle(Grid.curvilinear(*np.meshgrid([0, 1, 2], [2, 1, 0]))), "right of i"),
        (
            lambda: Staggered(GRID, "u").flux(np.zeros((16, 9))),
            r"cells has shape \(16, 9\): must be \(12, 12\)",
        ),
        (
            lambda: Staggered(GRID, "u").state(np.zeros((13, 12))),
            r"shape \(13, 12\): must be \(12, 13\)",
        ),
        (lambda: Staggered(GRID, "faces"), "where = 'faces'.* u, v"),
        (lambda: Staggered(GRID, "u", open=np.ones(3)), "open: 3 values for 156 points"),
        (lambda: Staggered(GRID, "u", open=np.full(156, np.nan)), r"open\[0\] = nan"),
        (lambda: Staggered(GRID, "u", area=np.zeros(156)), r"area\[1\] = 0.0"),
        (lambda: Staggered(GRID, "u", area=np.ma.masked_all(156)), r"area\[1\] = nan"),
        (lambda: Staggered(GRID, "u").flux(np.ones(3)), "3 values for 144 cells"),
        (lambda: Staggered(GRID, "u").flux(np.full(144, np.nan)), "nan on open cell 0"),
        (
            lambda: Staggered(GRID, "v").state(np.full(156, np.inf)),
            "inf on open v point 12, row 1, column 0",
        ),
        (lambda: Staggered(GRID, "v").state(np.ma.masked_all(156)), "nan on open v point 12"),
        (lambda: Staggered(GRID, "v").state(np.zeros(144)), "144 values for 156 points"),
        (lambda: turn(np.ones(3), np.ones(3), None), "^None: must be real numbers"),
    ],
)
def test_bad_input_is_refused_in_one_line(attempt, says):
    with pytest.raises(InputError, match=says) as refusal:
        attempt()
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("first", "second", "angle"),
    [((3, 4), (4,), ()), ((4, 4), (4, 4), (4,)), ((3, 4), (4, 3), ()), ((4,), (4,), (4, 4))],
)
def test_vectors_of_unlike_shapes_are_not_spread_over_each_other(first, second, angle):
    with pytest.raises(InputError, match="^turn: components of shape .*: must be of one shape"):
        turn(np.ones(first), np.ones(second), np.zeros(angle))


@pytest.mark.parametrize("periodic", [True, "xy", (True,), ("no", "no"), (True, False, False)])
def test_periodic_is_two_bools(periodic):
    with pytest.raises(InputError, match="^periodic = .*: must be two of True and False"):
        Staggered(GRIDS["uniform"], "u", periodic)
