"""Edges, walls, inflow; and that mass and momentum are booked on each of them."""

import numpy as np
import pytest

from floebmi.boundaries import Domain, Feeder, Inflow, Wall, build_walls
from floebmi.contact import Contact, Elastic, Restitution, frictional
from floebmi.dynamics import WALL, Step, Walls, strike_walls
from floebmi.errors import InputError, StabilityError
from floebmi.floes import COAST, FIXED, Floes
from floebmi.forces import AirDrag, BodyForce, OceanDrag, X
from floebmi.grid import Grid
from floebmi.kernels import BLOCK
from floebmi.model import Model
from floebmi.overlaps import overlapping
from floebmi.pack import FLOE, FORCE
from floebmi.packing import scatter
from floebmi.pairs import Inverse
from floebmi.sizes import Empirical, PowerLaw, SingleSize, UniformSize

NONE = BodyForce()  # adds nothing: machine code with dashpots, walls and a body force is compiled for other tests as well


def box(west="inactive", south="inactive", size=100.0, **edges):
    both = {"west": west, "east": west, "south": south, "north": south} | edges
    return Domain((0.0, size), (0.0, size), **both)


def assert_books_close(model, energy=2e-3):
    for quantity in ("mass", "momentum_x", "momentum_y"):
        assert model.ledger.balance(quantity).relative < 1e-12, quantity
    assert model.ledger.balance("energy").relative < energy


def test_a_floe_that_leaves_an_inactive_edge_is_disabled_and_its_mass_is_booked():
    floes = Floes([50.0, 95.0], 50.0, 2.0, 1.0, u=[0.0, 1.0])
    model = Model(box(), floes, contact=Contact())
    model.advance(10.0)
    assert floes.active.tolist() == [True, False]
    assert model.ledger.accounts["outflow"][0] == pytest.approx(-floes.mass(934.0)[1])
    assert_books_close(model)


def test_a_floe_crosses_a_periodic_seam_and_stays_in_the_domain():
    floes = Floes(95.0, 50.0, 2.0, 1.0, u=1.0)
    model = Model(box(west="periodic", south="periodic"), floes, contact=Contact())
    model.advance(10.0)
    model.advance(1e-9)
    assert floes.x[0] == pytest.approx(5.0, abs=1e-6) and floes.active.all()


@pytest.mark.parametrize("x, where", [((99.5, 3.4), 1.45), ((0.5, 96.6), 98.55)])
def test_a_contact_across_a_periodic_seam_lies_in_the_domain(x, where):
    floes = Floes(x, 50.0, 2.0, 1.0)
    contacts = Model(box(west="periodic", south="periodic"), floes, frictional()).contacts()
    assert (contacts.x[0], contacts.y[0]) == pytest.approx((where, 50.0))


@pytest.mark.parametrize(
    "edge, u, v", [("west", -1, 0), ("east", 1, 0), ("south", 0, -1), ("north", 0, 1)]
)
def test_a_closed_edge_throws_a_floe_back(edge, u, v):
    floes = Floes(50.0, 50.0, 5.0, 1.0, u=float(u), v=float(v))
    model = Model(box(**{edge: "closed"}), floes, contact=Contact())
    model.advance(60.0)
    assert (floes.u[0], floes.v[0]) == pytest.approx((-u, -v), abs=0.01)
    assert model.ledger.accounts["walls"][1] == pytest.approx(
        -2 * u * floes.mass(934.0)[0], rel=0.01, abs=1e-6
    )
    assert_books_close(model, energy=1e-2)


def test_a_moving_wall_does_the_work_that_the_floes_gain():
    floes = Floes([20.0, 40.0], 50.0, 9.0, 1.0)
    model = Model(box(), floes, contact=Contact(), walls=[Wall("west", position=0.0, velocity=2.0)])
    model.advance(12.0)
    assert model.wall_positions[0] == pytest.approx(24.0)
    assert floes.u[1] > 2.0
    assert model.ledger.accounts["walls"][3] > 0
    assert_books_close(model, energy=1e-2)


def pressed_row(mass, damping, step=Step()):
    """Two floes between a wall that stands and one that is loaded, all of it along one line."""
    walls = [Wall("south"), Wall("north", 40.3, normal_stress=1e4, mass=mass, damping=damping)]
    return Model(box(), Floes(50.0, [10.0, 30.1], 10.0, 1.0), Contact(), walls=walls, step=step)


@pytest.mark.parametrize("damping", [0.0, 1.0])
@pytest.mark.parametrize("mass", [10.0, 1e5, 1e7])
def test_neither_the_load_of_a_wall_nor_its_damper_is_energy_of_the_ice(mass, damping):
    step = pressed_row(mass, damping).longest_step()
    model = pressed_row(mass, damping, Step(length=step))
    model.advance(500 * step)
    assert model.ledger.accounts["walls"][3] > 1.0
    assert_books_close(model, energy=1e-10)


def under_a_heavy_wall(step):
    """Twenty floes side by side that leap up to a loaded wall, several in one step."""
    rng = np.random.default_rng(2)
    x, y, v = 22.0 * np.arange(20) + 11.0, rng.uniform(-8.0, 8.0, 20), rng.normal(0.0, 1.0, 20)
    floes = Floes(x, y, 10.0, 1.0, v=v)
    wall = Wall("north", 25.0, normal_stress=20.0, mass=1e7, damping=0.0)
    domain = Domain((0.0, 440.0), (-30.0, 200.0), south="closed")
    return Model(domain, floes, Contact(), walls=[wall], step=step)


def test_blows_of_many_floes_on_a_wall_know_of_each_other():
    """A blow had been found before the later floes' forces on the wall were known: 2e-6 of the energy."""
    step = under_a_heavy_wall(Step(fraction=0.85)).longest_step()
    model = under_a_heavy_wall(Step(length=step))
    model.advance(700 * step)
    assert_books_close(model, energy=1e-12)


def test_a_wall_lighter_than_its_floes_sets_the_step():
    usual = pressed_row(1e9, 1.0).longest_step()
    step = pressed_row(10.0, 1.0).longest_step()
    assert step < 0.31 * 2.0 * np.sqrt(10.0 / 2e7) < 0.1 * usual
    pressed_row(10.0, 1.0).advance(500 * step)
    with pytest.raises(StabilityError):  # a step for the floes alone is too long
        pressed_row(10.0, 1.0, Step(length=usual)).advance(500 * step)


@pytest.mark.parametrize("mass", [1e2, 1e4, 1e6, 1e9])
def test_restitution_is_met_against_a_loaded_wall_of_any_mass(mass):
    """Its mass had not counted: at 100 kg it flew off at 14 times the speed of the floe."""
    wall = Wall("north", position=12.0, normal_stress=0.0, mass=mass, damping=0.0)
    domain = Domain((-50.0, 50.0), (-50.0, 50.0))
    floe = Floes(0.0, 0.0, 10.0, 1.0, v=1.0)
    law, step = Contact(dashpot=Restitution(0.3)), Step(fraction=0.03)
    model = Model(domain, floe, law, [NONE], walls=[wall], step=step)
    model.advance(3.0)
    before = model.wall_positions[0]
    model.advance(0.1)
    rebound = (model.wall_positions[0] - before) / 0.1 - model.floes.v[0]
    assert rebound == pytest.approx(0.3, rel=0.01)
    assert_books_close(model)


def test_dashpots_of_many_floes_under_a_light_wall_set_the_step():
    """The step had not known of them: the wall flew off at 1.7 times the speed of the floes."""
    wall = Wall("north", position=10.0, normal_stress=0.0, mass=1e3, damping=0.0)
    floes = Floes(20.0 * np.arange(20), 0.0, 9.99, 1.0, v=1.0)
    law = Contact(dashpot=Restitution(0.02))
    model = Model(Domain((-20.0, 420.0), (-50.0, 50.0)), floes, law, [NONE], walls=[wall])
    model.advance(0.3)
    before = model.wall_positions[0]
    model.advance(0.01)
    assert (model.wall_positions[0] - before) / 0.01 == pytest.approx(1.0, abs=0.01)
    assert_books_close(model, energy=1e-5)


def packed_box(stress):
    x, y = (a.ravel() for a in np.meshgrid(np.arange(10) * 2.0 + 1, np.arange(10) * 2.0 + 1))
    domain = Domain((0.0, 20.0), (0.0, 30.0), "closed", "closed", "closed")
    wall = Wall("north", position=20.2, normal_stress=stress)
    law = Contact(dashpot=Restitution(0.2))
    return Model(domain, Floes(x, y, 1.0, 1.0), law, [NONE], walls=[wall])


@pytest.mark.long
@pytest.mark.parametrize("stress", [1e4, 1e6])
def test_a_loaded_wall_settles_at_its_stress_and_no_floe_passes_another(stress):
    model = packed_box(stress)
    for _ in range(40):
        model.advance(1.0)
    assert model.wall_stress()[0] == pytest.approx(stress, rel=0.05)
    floes = model.floes
    gaps = np.hypot(floes.x[:, None] - floes.x, floes.y[:, None] - floes.y) + 10 * np.eye(100)
    assert gaps.min() > 1.5
    assert_books_close(model)


def test_without_its_load_the_same_wall_stays_where_it_was():
    model = packed_box(None)
    model.advance(5.0)
    assert model.wall_positions[0] == 20.2


def test_an_inflow_sees_the_floes_across_a_periodic_seam():
    domain = Domain((0.0, 30.0), (0.0, 30.0), "periodic", "periodic", "closed", "inactive")
    for x in (0.5, 29.5):
        seam = Floes(x, 28.0, 4.0, 1.0)
        for seed in range(20):
            inflow = Inflow("north", SingleSize(2.0))
            model = Model(domain, seam.copy(), frictional(), inflow=inflow, seed=seed)
            model.advance(1e-3)
            assert len(model.floes) > 3 and len(model.contacts().i) == 0


NO_WALLS = np.zeros(0, WALL)


def test_floes_come_in_within_the_span_as_they_are_told():
    box = Domain((0.0, 100.0), (0.0, 80.0))
    inflow = Inflow("west", SingleSize(5.0), 2.0, (0.1, -0.2), span=(20.0, 60.0))
    places = []
    for seed in range(20):
        floes = Floes(50.0, 40.0, 5.0, 1.0)
        new = Feeder(inflow, box).feed(floes, NO_WALLS, np.random.default_rng(seed))
        places += floes.y[new].tolist()
        assert (floes.x[new] == 5.0).all() and (floes.thickness[new] == 2.0).all()
        assert (floes.u[new] == 0.1).all() and (floes.v[new] == -0.2).all()
    assert 25.0 <= min(places) < 26.0 and 54.0 < max(places) <= 55.0


def test_floes_come_in_between_the_walls_where_they_are_now():
    """They had come in over and behind walls at the ends of the edge, and over one opposite, with energy from nowhere."""
    box = Domain((1000.0, 1100.0), (1000.0, 1080.0), south="closed")
    inflow = Inflow("west", SingleSize(5.0))

    def places(*walls):
        none = Floes([], [], [], [])
        for seed in range(20):
            floes = Floes([], [], [], [])
            records = build_walls(box, walls, none, 934.0, 2e7)
            Feeder(inflow, box).feed(floes, records, np.random.default_rng(seed))
            yield from floes.y

    between = list(places(Wall("north", 1040.0), Wall("east", 1010.0)))
    assert 1005.0 <= min(between) < 1006.0 and 1034.0 < max(between) <= 1035.0
    assert not list(places(Wall("north", 1009.9))) and not list(places(Wall("east", 1009.9)))


def test_floes_come_in_across_the_seam_of_a_periodic_edge_as_anywhere_else():
    """None had lain across it, so that the ice which came in was looser along the seam."""
    box = Domain((0.0, 100.0), (0.0, 80.0), south="periodic", north="periodic")
    inflow = Inflow("west", SingleSize(5.0))
    places = []
    for seed in range(200):
        floes = Floes([], [], [], [])
        Feeder(inflow, box).feed(floes, NO_WALLS, np.random.default_rng(seed))
        assert not overlapping(floes, box)
        places += floes.y.tolist()
    away = np.minimum(places, 80.0 - np.array(places))  # from the seam
    assert 0.8 < np.mean(away < 5.0) / (10.0 / 80.0) < 1.2
    part = Inflow("west", SingleSize(5.0), span=(0.0, 70.0))  # has two ends
    floes = Floes([], [], [], [])
    Feeder(part, box).feed(floes, NO_WALLS, np.random.default_rng(1))
    assert floes.y.min() >= 5.0 and floes.y.max() <= 65.0


def test_a_load_is_of_the_ice_and_not_of_the_coast():
    box = Domain((0.0, 100.0), (0.0, 60.0))
    ice, shore = (
        Floes([20.0, 60.0], 30.0, 10.0, [1.0, 2.0]),
        Floes(90.0, 5.0, 5.0, 10.0, motion=COAST),
    )
    wall = (Wall("north", normal_stress=1e4),)
    alone, beside = (
        build_walls(box, wall, floes, 900.0, 2e7)
        for floes in (ice, Floes.concatenate([ice, shore]))
    )
    assert alone.tolist() == beside.tolist()
    mass = 900.0 * np.pi * 10.0**2 * 3.0
    assert alone[0].press == pytest.approx(1e4 * 100.0 * 1.5)
    assert alone[0].inverse_mass == pytest.approx(1 / mass)
    spring = 2e7 * 1.5 * 100.0 / 60.0
    assert alone[0].damping == pytest.approx(2 * np.sqrt(spring / mass))  # critical, if not told


def test_an_inflow_adds_floes_as_soon_as_there_is_room_and_books_their_mass():
    inflow = Inflow("north", UniformSize(2.0, 4.0), thickness=1.5, velocity=(0.0, -0.5))
    model = Model(box(), Floes([], [], [], []), contact=frictional(), inflow=inflow, seed=4)
    for _ in range(30):
        model.advance(10.0)
    floes = model.floes
    assert len(floes) > 60
    assert (~floes.active).sum() > 5  # some left at the south
    brought = model.ledger.accounts["inflow"][0]
    assert brought == pytest.approx(floes.mass(934.0).sum(), rel=1e-12)
    assert_books_close(model)
    top = floes.y > 85
    assert (np.pi * floes.radius[top] ** 2).sum() > 0.4 * 100 * 15  # the edge is kept full


def test_a_floe_that_comes_in_meets_the_wind_at_the_next_exchange_and_nothing_is_lost():
    inflow = Inflow("north", SingleSize(4.0), velocity=(0.0, -0.5))
    drag = [OceanDrag(), AirDrag()]
    model = Model(box(), Floes([], [], [], []), frictional(), drag, inflow=inflow)
    model.atmosphere.u[:] = 20.0
    model.advance(5.0)
    assert len(model.floes) and not model.floes.u.any()
    model.advance(5.0)
    assert (model.floes.u[:3] > 0).all()
    given = model.atmosphere.impulse_x.sum() + model.atmosphere.undelivered[0]
    assert given == pytest.approx(-model.ledger.accounts["wind"][1], rel=1e-12)
    assert not model.atmosphere.undelivered.any()


def test_the_same_seed_feeds_the_same_floes_and_another_seed_others():
    def run(seed):
        inflow = Inflow("north", UniformSize(2.0, 4.0), velocity=(0.0, -0.5))
        model = Model(box(), Floes([], [], [], []), contact=Contact(), inflow=inflow, seed=seed)
        model.advance(30.0)
        return model.floes

    assert np.array_equal(run(1).x, run(1).x)
    assert len(run(1)) != len(run(2)) or not np.array_equal(run(1).x, run(2).x)


def test_new_floes_have_other_sizes_than_a_pack_of_the_same_seed():
    sizes = UniformSize(2.0, 4.0)
    floes = scatter(box()._replace(x=(20.0, 100.0)), sizes, count=100, seed=4)
    feed = Inflow("west", sizes, velocity=(1.0, 0.0))
    model = Model(box(), floes, contact=frictional(), inflow=feed, seed=4)
    model.advance(10.0)
    assert len(floes) > 110
    assert not np.isin(floes.radius[100:], floes.radius[:100]).any()


@pytest.mark.parametrize("sizes, told", [(SingleSize(10.0), 0.74), (PowerLaw(1.0, 10.0), 0.34)])
def test_what_comes_in_is_as_loose_as_the_inflow_tells(sizes, told):
    inflow = Inflow("west", sizes, velocity=(5.0, 0.0))
    soft = Contact(Elastic(2e4))
    domain = Domain((0.0, 60.0), (0.0, 400.0))
    model = Model(domain, Floes([], [], [], []), contact=soft, inflow=inflow, seed=1)
    model.advance(12.0)  # once across
    start = model.ledger.accounts["inflow"][0]
    model.advance(60.0)
    area = (model.ledger.accounts["inflow"][0] - start) / model.ice_density
    assert area / (60.0 * 5.0 * 400.0) == pytest.approx(told, abs=0.03)


def test_a_restart_feeds_on_with_the_same_bits():
    def make():
        inflow = Inflow("north", UniformSize(2.0, 4.0), velocity=(0.0, -0.5))
        laws = dict(contact=frictional(), forces=[OceanDrag(), AirDrag()])
        return Model(box(), Floes([], [], [], []), inflow=inflow, seed=5, **laws)

    first = make()
    first.advance(30.0)
    second = make()
    second.restore(first.state())
    for model in (first, second):
        model.advance(30.0)
    assert len(first.floes) > 20
    assert np.array_equal(first.floes.x, second.floes.x)


def test_a_restart_goes_on_with_other_measured_radii_of_an_inflow_and_tells_it_in_a_line():
    """They had been refused, as no other number of an inflow is, in a line with all radii of both."""

    def make(*radii):
        laws = dict(contact=frictional(), forces=[OceanDrag(), AirDrag()])
        inflow = Inflow("north", Empirical(radii), velocity=(0.0, -0.5))
        return Model(box(), Floes([], [], [], []), inflow=inflow, seed=5, **laws)

    first = make(*np.linspace(2.0, 4.0, 100))
    first.advance(30.0)
    other = make(*np.linspace(5.0, 6.0, 90))
    with pytest.warns(
        UserWarning, match=r"\[inflow number 1\] sizes.radii are others than the restart's"
    ) as told:
        other.restore(first.state())
    assert max(len(str(warning.message)) for warning in told) < 200
    other.advance(30.0)
    new = other.floes.radius[len(first.floes) :]
    assert len(new) > 2 and (new[1:] >= 5.0).all()  # the first had been waiting


def test_the_stress_on_a_wall_is_its_load_over_its_length_and_the_mean_thickness_by_area():
    domain = Domain((0.0, 400.0), (0.0, 200.0), west="closed", north="closed")
    places = [49.9, 300.0, 350.0], [100.0, 190.2, 20.0]  # over the walls by 0.1 and 0.2 m
    floes = Floes(*places, [50.0, 10.0, 30.0], [2.0, 1.0, 9.0], motion=[0, 0, COAST])
    model = Model(domain, floes, contact=Contact())
    assert model.wall_edges == ("west", "north")
    thickness = (50.0**2 * 2.0 + 10.0**2 * 1.0) / (50.0**2 + 10.0**2)  # the coast is no ice
    west, north = 2e7 * 2.0 * 0.1, 2e7 * 1.0 * 0.2  # E h × overlap
    expected = [west / (200.0 * thickness), north / (400.0 * thickness)]
    assert model.wall_stress() == pytest.approx(expected)


def test_coast_is_no_ice_it_has_no_mass_and_no_drag_but_it_stops_floes():
    floes = Floes([0.0, 30.0], 0.0, 10.0, 1.0, u=[1.0, 0.0], motion=[0, COAST])
    domain = Domain((-100.0, 100.0), (-100.0, 100.0))
    model = Model(domain, floes, contact=frictional(), forces=[OceanDrag(), AirDrag()])
    model.ocean.u[:] = 0.5
    assert model.ledger.start[0] == pytest.approx(floes.mass(934.0)[0])
    model.advance(30.0)
    assert floes.x[0] + 20.0 < floes.x[1] + 0.5 and floes.x[1] == 30.0
    fields = model.fields()
    assert (fields["area_fraction"] * model.grid.area).sum() == pytest.approx(np.pi * 100, rel=1e-9)
    assert model._at[0][0, X * BLOCK + 1] == 0.0
    assert_books_close(model)


@pytest.mark.parametrize("sampling", ["overlap", "centre"])
def test_what_the_coast_takes_is_no_force_on_the_ice(sampling):
    floes = Floes([40.0, 59.9], 50.0, 10.0, 1.0, motion=[0, COAST])
    grid = Grid.uniform((0.0, 100.0), (0.0, 100.0), spacing=25.0)
    model = Model(box(), floes, contact=Contact(), grid=grid, sampling=sampling)
    push = model.internal_stress_fields()["internal_stress_divergence_x"]
    assert push @ grid.area == pytest.approx(-2e7 * 1.0 * 0.1)  # E h × overlap


def test_energy_that_came_and_went_within_an_exchange_has_passed():
    floes = Floes(0.0, 9.0, 1.0, 1.0)
    domain = Domain((-5.0, 5.0), (0.0, 20.0), "inactive", "inactive", "closed", "closed")
    law = Contact(dashpot=Restitution(1.0))  # loses nothing; with dashpots, as the sand below
    model = Model(domain, floes, contact=law, forces=[BodyForce(0.0, -1.0)])
    model.advance(8.0)  # falls 8 m, and is thrown up again
    fallen = floes.mass(934.0)[0] * 8.0
    assert abs(model.ledger.accounts["body force"][3]) < 0.1 * fallen
    assert 0.8 * fallen < model.ledger.turnover[3] < 1.2 * fallen


def test_momentum_is_held_against_that_of_floes_that_move_against_each_other():
    floes = Floes([0.0, 24.0], 0.0, [10.0, 10.1], 1.0, u=[0.3, -0.3 * (10.0 / 10.1) ** 2])
    model = Model(
        Domain((-50.0, 50.0), (-50.0, 50.0), *4 * ("inactive",)), floes, contact=Contact()
    )
    model.advance(20.0)
    assert floes.u[0] < 0.0 < floes.u[1]
    balance = model.ledger.balance("momentum_x")
    assert abs(balance.now) < 1e-9 and balance.relative < 1e-14  # not what is left over itself
    model.ledger.now[1] += 1e-3 * floes.mass(934.0)[0]  # control: so much from nowhere
    assert model.ledger.balance("momentum_x").relative > 1e-3


def test_a_body_force_acts_on_ice_and_not_on_coast():
    floes = Floes([0.0, 25.0], 9.0, 1.0, 1.0, motion=[0, COAST])
    domain = Domain((-5.0, 30.0), (0.0, 20.0), "inactive", "inactive", "closed", "closed")
    law = Contact(dashpot=Restitution(1.0))  # loses nothing; with dashpots, as the sand below
    model = Model(domain, floes, contact=law, forces=[BodyForce(0.0, -1.0)])
    model.advance(2.0)
    assert model.ledger.accounts["body force"][2] == pytest.approx(-2.0 * floes.mass(934.0)[0])
    assert not model.ledger.accounts["held floes and coast"].any()


def test_coast_that_lies_over_a_closed_edge_presses_nothing_on_it():
    floes = Floes([0.0, -99.0], 0.0, 10.0, 1.0, u=[1.0, 0.0], motion=[0, COAST])
    domain = Domain((-100.0, 100.0), (-100.0, 100.0), "closed", "closed")
    model = Model(domain, floes, contact=Contact())
    assert model.ledger.start[3] == 0.5 * floes.mass(934.0)[0]
    model.advance(10.0)
    assert not any(wall.force or wall.work for wall in model._state.walls)
    assert "walls" not in {name for name, row in model.ledger.accounts.items() if row.any()}


def test_sand_settles_under_a_body_force_in_a_closed_box():
    floes = Floes(np.arange(5) * 4.0 + 2, 10.0, 1.5, 1.0)
    domain = Domain((0.0, 20.0), (0.0, 20.0), "closed", "closed", "closed", "closed")
    law = Contact(Elastic(2e5), dashpot=Restitution(0.3))
    # all five hit the floor in one and the same phase of a step, on which the residual of a blow depends
    step = Step(fraction=0.1)
    model = Model(domain, floes, contact=law, forces=[BodyForce(0.0, -0.5)], step=step)
    model.advance(60.0)
    assert floes.y == pytest.approx(1.5, abs=0.02)
    assert_books_close(model)


@pytest.mark.parametrize(
    "make, word",
    [
        (lambda: Domain((0, 1), (0, 1), west="open"), "domain.west = 'open'"),
        (lambda: Domain((0, 1), (0, 1), west="periodic"), "both or neither"),
        (lambda: Domain((1, 0), (0, 1)), "domain.x"),
    ],
)
def test_a_domain_that_cannot_be_is_refused(make, word):
    with pytest.raises(InputError, match=word):
        Model(make(), Floes(0.5, 0.5, 0.1, 1.0))


@pytest.mark.parametrize(
    "laws, word",
    [
        (dict(walls=[Wall("up")]), "wall.edge = 'up'"),
        (dict(walls=[Wall("west"), Wall("west")]), "two walls"),
        (dict(walls=[Wall("west")], contact=None), "contact law"),
        (dict(inflow=Inflow("west", SingleSize(80.0))), "narrower"),
        (dict(inflow=Inflow("west", SingleSize(5.0), span=(60.0, 20.0))), "a stretch of the edge"),
        (dict(inflow=Inflow("west", SingleSize(5.0), span=(-20.0, 60.0))), "from 0 to 100 m"),
        (dict(sampling="exact"), "sampling"),
        (dict(walls=[Wall("west", position=np.nan)]), "Wall.position"),
        (dict(walls=[Wall("west", normal_stress=1e3, mass=-1.0)]), "Wall.mass"),
        (
            dict(walls=[Wall("west", mass=1e6)]),
            "wall.mass = 1000000.0: applies only to a loaded wall",
        ),
        (
            dict(walls=[Wall("west", damping=0.5)]),
            "wall.damping = 0.5: applies only to a loaded wall",
        ),
        (dict(walls=[Wall("west", position=50.0)]), "by 1 m over the wall in the west, at 50 m"),
        (
            dict(walls=[Wall("west", position=-1.0)]),
            "beyond the west edge at 0 m, which is inactive",
        ),
        (dict(walls=[Wall("north", 300.0, velocity=1.0)]), "beyond the north edge at 100 m"),
        (dict(walls=[Wall("west", normal_stress=1e3, damping=-1.0)]), "Wall.damping"),
        (dict(inflow=Inflow("west", SingleSize(5.0), thickness=-1.0)), "Inflow.thickness"),
        (dict(inflow=Inflow("west", SingleSize(5.0), velocity=(np.nan, 0.0))), "Inflow.velocity"),
        (
            dict(inflow=Inflow("north", SingleSize(5.0), velocity=(0.0, 0.1))),
            "out of the domain at its north edge",
        ),
        (dict(step=Step(epsilon=-1.0)), "Step.epsilon"),
        (dict(step=Step(length=0.0)), "Step.length"),
        (dict(step=Step(fraction=1.5)), "Step.fraction"),
    ],
)
def test_walls_and_inflows_that_cannot_be_are_refused(laws, word):
    with pytest.raises(InputError, match=word):
        Model(box(), Floes(50.0, 50.0, 1.0, 1.0), **({"contact": Contact()} | laws))


@pytest.mark.parametrize(
    "wall",
    [
        Wall("west", position=-0.9),  # a floe of 1 m meets it before its centre leaves
        Wall("west", position=-5.0, velocity=0.1),
        Wall("north", position=105.0, normal_stress=1e3),
    ],
)
def test_a_wall_beyond_an_inactive_edge_is_taken_where_floes_may_meet_it(wall):
    assert Model(box(), Floes(50.0, 50.0, 1.0, 1.0), Contact(), walls=[wall]).wall_edges


def test_far_from_the_origin_walls_contacts_and_restarts_are_where_they_belong():
    def scene():
        domain = Domain((3e6, 3e6 + 100.0), (-2e6, -2e6 + 100.0), *["closed"] * 4)
        floes = Floes(3e6 + np.array([20.0, 39.7]), -2e6 + 50.0, 10.0, 1.0, u=[0.1, -0.13])
        return Model(domain, floes, contact=Contact())

    model = scene()
    places = dict(zip(model.wall_edges, model.wall_positions, strict=True))
    assert places == {"west": 3e6, "east": 3e6 + 100.0, "south": -2e6, "north": -2e6 + 100.0}
    contacts = model.contacts()
    assert (contacts.x[0] - 3e6, contacts.y[0] + 2e6) == pytest.approx((29.85, 50.0))
    model.floes.add(3e6 + 80.0, -2e6 + 50.0, 5.0, 1.0)
    model.advance(7.3)
    half = scene()
    half.floes.add(3e6 + 80.0, -2e6 + 50.0, 5.0, 1.0)
    half.restore(model.state())
    for each in (model, half):
        each.advance(50.0)
    assert np.array_equal(half.floes.x, model.floes.x)
    assert np.array_equal(half.floes.u, model.floes.u)
    assert (model.floes.x > 3e6).all() and (model.floes.x < 3e6 + 100.0).all()


def test_the_state_of_another_number_of_walls_or_of_an_older_record_is_refused():
    model = packed_box(1e4)
    for walls in (model.state()["walls"][1:], model.state()["walls"][:, :-1]):
        with pytest.raises(InputError, match="number of walls differs .* older floebmi"):
            model.restore(model.state() | {"walls": walls})


def test_a_restart_takes_places_of_walls_from_the_state_and_loads_and_speeds_from_the_scene():
    def scene(*walls):
        floes = Floes([10.0, 30.0], 50.0, 10.0, 1.0, u=[0.1, 0.0])
        law = Contact(dashpot=Restitution(0.5))
        return Model(box(west="closed"), floes, law, [NONE], walls=walls)

    model = scene(Wall("east", 40.0, normal_stress=1e4))
    for _ in range(40):
        model.advance(10.0)
    assert model.wall_stress() == pytest.approx([1e4, 1e4], rel=1e-6)
    harder = scene(Wall("east", 40.0, normal_stress=4e4))
    with pytest.warns(UserWarning, match="normal_stress = 40000.0, the restart's is 10000.0"):
        harder.restore(model.state())
    assert harder.wall_positions == pytest.approx(model.wall_positions, abs=0)
    for _ in range(40):
        harder.advance(10.0)
    assert harder.wall_stress() == pytest.approx([4e4, 4e4], rel=1e-6)
    away = scene(Wall("east", 40.0, velocity=0.05))
    with pytest.warns(UserWarning, match="velocity = 0.05, the restart's is 0.0"):
        away.restore(model.state())
    away.advance(10.0)
    assert away.wall_positions[0] == pytest.approx(model.wall_positions[0] + 0.5)


def test_the_state_of_walls_at_other_places_is_refused():
    def scene(*walls):
        return Model(box(), Floes(50.0, 50.0, 10.0, 1.0), contact=frictional(), walls=walls)

    state = scene(Wall("west", 10.0)).state()
    scene(Wall("west", 10.0)).restore(state)
    with pytest.raises(
        InputError, match=r"\[walls number 1\] position = 15.0, the restart's is 10.0"
    ):
        scene(Wall("west", 15.0)).restore(state)
    with pytest.raises(InputError, match=r"\[walls number 1\] edge = south, the restart's is west"):
        scene(Wall("south", 10.0)).restore(state)


def test_a_lone_floe_wider_than_a_period_is_refused():
    """It had been let through, and lay over itself."""
    floes, west, south = Floes(5.0, 5.0, 10.0, 1.0), {"west": "periodic"}, {"south": "periodic"}
    Model(box(size=20.0, **west, **south), floes, contact=Contact()).advance(1.0)
    for edges in (west, south):
        with pytest.raises(InputError, match="period = 19 m; must be at least 2 times"):
            Model(box(size=19.0, **edges), floes, contact=Contact())


def test_a_floe_that_reaches_over_a_wall_is_refused_as_one_on_another_is():
    def scene(x, motion=0, **wall):
        walls = [Wall("west", 20.0, **wall)]
        floes = Floes(x, 50.0, 10.0, 1.0, motion=motion)
        return Model(box(), floes, contact=Contact(), walls=walls)

    assert scene(29.5).floes.x == 29.5
    with pytest.raises(InputError, match="1 floes reach over walls at the start .* floe 0 by 2 m"):
        scene(28.0)
    scene(28.0, motion=FIXED)  # both stay where they are
    with pytest.raises(InputError, match="over walls at the start"):
        scene(28.0, motion=FIXED, normal_stress=1e3)  # would shoot off the wall
    model = scene(29.5)
    model.advance(0.1)
    model.floes.x[0] = 27.0
    with pytest.raises(
        InputError, match="over walls after an edit .* by 3 m over the wall in the west"
    ):
        model.advance(1.0)


@pytest.mark.parametrize("motion", [0, FIXED])
def test_a_wall_that_passes_the_centre_of_a_floe_stops_the_run(motion):
    walls = [Wall("west", 30.0, 0.1), Wall("east", 70.0, -0.1)]
    if motion:  # a loaded one
        walls = [Wall("west", 30.0, normal_stress=1e9, mass=1e6)]
    model = Model(
        box(), Floes(50.0, 50.0, 10.0, 1.0, motion=motion), contact=Contact(), walls=walls
    )
    with pytest.raises(StabilityError, match="floe 0: its centre is .* behind the wall in the"):
        for _ in range(100):
            model.advance(4.0)


@pytest.mark.parametrize("wall", [dict(position=20.0), dict(velocity=0.1), dict(normal_stress=1e4)])
def test_floes_that_would_come_in_on_a_wall_or_behind_it_are_refused(wall):
    def scene(edge="west", **wall):
        inflow = Inflow("west", SingleSize(5.0), velocity=(0.1, 0.0))
        floes = Floes(50.0, 50.0, 10.0, 1.0)
        return Model(box(), floes, contact=frictional(), walls=[Wall(edge, **wall)], inflow=inflow)

    scene(), scene("east", normal_stress=1e4)
    with pytest.raises(
        InputError, match="inflow.edge = 'west': floes come in at 0 m, and the wall"
    ):
        scene(**wall)


@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("axis", [0, 1])
def test_the_blow_of_a_wall_does_its_work_on_floe_and_wall_half_a_step_ahead(axis, side, held):
    """The floe has another mass along the other axis, which no floe has, so that one is not taken for the other."""
    floes, forces, walls = (
        np.zeros(1, kind).view(np.recarray) for kind in (FLOE, FORCE, WALL)
    )  # fmt: skip
    speed, force = ("u", "v")[axis], ("x", "y")[axis]
    inverse_mass, rate = 0.0 if held else 0.25, -0.7
    wall, floe = walls[0], floes[0]
    wall.axis, wall.side, wall.speed, wall.inverse_mass = axis, side, 0.3, 0.1
    wall.force, wall.press, floe[speed] = -side * 3.0, 50.0, 0.3 + side * rate
    forces[0][force], forces[0]["yx"[axis]] = side * 5.0, 90.0
    both = [np.full(1, 0.9), np.full(1, 0.9)]
    both[axis][0] = inverse_mass
    dt, work, taken = 0.2, 0.4, np.zeros(3)

    def energy():
        """Where that is not infinite; of a held floe what it is changed by."""
        ahead = wall.speed + 0.5 * dt * 0.1 * wall.force
        of_wall = 0.5 * ahead**2 / 0.1
        if held:
            return of_wall - taken[2]
        return of_wall + 0.5 * (floe[speed] + 0.5 * dt * 0.25 * forces[0][force]) ** 2 / 0.25

    before, was, before_wall = energy(), floe[speed], 0.5 * wall.speed**2 / 0.1
    first = np.zeros(1, np.int64)
    edges = Walls(walls, first, first, None, np.full(1, rate), np.full(1, work / rate))
    strike_walls(Inverse(True, *both, None), Contact(), floes, forces, edges, dt, taken)
    assert energy() - before == pytest.approx(work)
    assert (wall.speed - 0.3) / 0.1 == pytest.approx(-wall.impulse)
    assert wall.work == pytest.approx(before_wall - 0.5 * wall.speed**2 / 0.1)
    if held:
        assert floe[speed] == was and taken[axis] == -wall.impulse
    else:
        assert (floe[speed] - was) / 0.25 == pytest.approx(wall.impulse)
    assert floe["vu"[axis]] == 0.0 and taken[1 - axis] == 0.0


def test_what_lies_beyond_a_periodic_edge_is_within_from_the_start():
    domain = Domain((0.0, 1000.0), (0.0, 1000.0), west="periodic", east="periodic")
    places = [1050.0, -30.0, 500.0, 1000.0], [200.0, 400.0, 1200.0, 800.0]
    floes = Floes(*places, 20.0, 1.0, motion=[0, 0, FIXED, 0])
    model = Model(domain, floes)
    np.testing.assert_array_equal(model.floes.x, [50.0, 970.0, 500.0, 1000.0])
    np.testing.assert_array_equal(model.floes.y, [200.0, 400.0, 1200.0, 800.0])


def test_free_floes_beyond_an_open_edge_are_told_of_before_they_leave(recwarn):
    open_sea = Domain((0.0, 1000.0), (0.0, 1000.0))
    domain = open_sea._replace(west="periodic", east="periodic")
    for y, motion in ((1200.0, FIXED), (1000.0, 0)):
        Model(domain, Floes(1050.0, y, 20.0, 1.0, motion=motion))
    assert not recwarn
    for y in (-1.0, 1200.0):
        with pytest.warns(
            UserWarning, match=f"1 of 2 floes lie outside .* y = {y:g} m: they leave"
        ):
            model = Model(open_sea, Floes(500.0, [500.0, y], 20.0, 1.0), contact=Contact())
        model.advance(1.0)
        assert model.floes.active.tolist() == [True, False]
