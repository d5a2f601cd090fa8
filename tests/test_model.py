"""The model as a whole: what is absent is absent, overlaps are refused, books close, calls may be split."""

import re
import subprocess
import sys

import numba
import numpy as np
import pytest
import xarray as xr

from floebmi import dynamics
from floebmi.bonds import TensileStrength
from floebmi.boundaries import Domain, Inflow, Wall
from floebmi.contact import (
    Contact,
    Coulomb,
    Elastic,
    Restitution,
    cohesive,
    frictional,
    prepare,
)
from floebmi.dynamics import Step
from floebmi.errors import InputError, StabilityError
from floebmi.floes import COAST, DRIVEN, FIXED, FIXED_X, Floes
from floebmi.forces import (
    FORCE_BUFFER,
    AirDrag,
    BodyForce,
    Coriolis,
    OceanDrag,
    Tilt,
    at_floes,
    by_block,
)
from floebmi.grid import Grid
from floebmi.kernels import FASTMATH
from floebmi.model import Model
from floebmi.overlaps import overlapping
from floebmi.pack import pack
from floebmi.packing import relax
from floebmi.sampling import coverage
from floebmi.sizes import PowerLaw, SingleSize

DOMAIN = Domain((-100.0, 100.0), (-100.0, 100.0))


def pair(**laws):
    return Model(DOMAIN, Floes([0.0, 20.5], 0.0, 10.0, 1.0, u=[0.1, 0.0]), **laws)


def packed(**laws):
    now = pair(**laws)._now()
    return now.packed, now.pairs


def test_arrays_of_physics_that_is_not_listed_do_not_exist():
    elastic, pairs = packed(contact=Contact())
    assert elastic.spinning is elastic.angle is elastic.inertia is None
    assert pairs.slip is pairs.bonded is None
    bonded, pairs = packed(contact=cohesive())
    assert bonded.spinning is None and "torque" not in bonded.force.dtype.names
    assert pairs.slip is None and pairs.bonded is not None
    rubbing, pairs = packed(contact=frictional())
    assert rubbing.spinning is rubbing.floes and "torque" in rubbing.force.dtype.names
    assert pairs.bonded is None and pairs.slip is not None
    drifting = pair()
    assert drifting.ocean is drifting.atmosphere is drifting.floes.angle is None
    assert drifting._at == () and drifting._now().walls.records is None
    windy = pair(forces=[AirDrag(), BodyForce(1.0)])
    assert windy.ocean is None and windy.atmosphere.tilt_x is windy.atmosphere.coriolis is None


def machine_code(function, *arguments):
    compiled = numba.njit(fastmath=FASTMATH, error_model="numpy")(function)
    compiled(*arguments)
    return compiled.inspect_llvm(compiled.signatures[0])


def push_code(*forces):
    f = Floes(0.0, 0.0, 10.0, 1.0)
    at = tuple(
        by_block(
            at_floes(force, f.radius, f.thickness, 0.9 * f.thickness, 934.0, False, f.land),
            np.arange(len(f)),
        )
        for force in forces
    )
    one = pack(f, np.arange(len(f)), f.x, f.y, 934.0, None, (0.0, 0.0))
    arguments = forces, at, one, 0, 1, 1.0, np.zeros(3), np.zeros(FORCE_BUFFER)
    return machine_code(dynamics.push, *arguments)


def test_drag_is_not_in_the_machine_code_of_a_scene_without_a_fluid():
    nothing, turning, both = (
        push_code(),
        push_code(Coriolis(1e-4)),
        push_code(OceanDrag(), AirDrag()),
    )
    assert "sqrt" in both and "sqrt" not in turning
    assert len(nothing) < len(turning) < len(both)


def contact_code(law):
    arguments = (law, -0.1, 0.0, 0.1, 0.0, *[1.0] * 7, *[0.0] * 6, 0.1)
    return machine_code(dynamics.pair_force, *arguments)


def test_friction_bonds_and_dashpots_are_not_in_the_machine_code_unless_listed():
    from floebmi.bonds import Beam, Healing
    from floebmi.contact import CompressiveFailure, Restitution

    codes = {
        name: contact_code(prepare(law))
        for name, law in {
            "elastic": Contact(),
            "bonds": cohesive(),
            "friction": frictional(),
            "dashpot": Contact(dashpot=Restitution(0.5)),
            "healing": Contact(bonds=TensileStrength(healing=Healing(1e3))),
            "beam": Contact(bonds=TensileStrength(beam=Beam(1e5))),
            "failure": Contact(failure=CompressiveFailure()),
        }.items()
    }
    lengths = {name: code.count("fmul") for name, code in codes.items()}
    assert lengths["elastic"] < min(n for name, n in lengths.items() if name != "elastic")
    assert lengths["bonds"] < min(lengths[name] for name in ("healing", "beam"))
    assert "sqrt" in codes["dashpot"]
    assert "sqrt" not in codes["friction"]


@pytest.mark.parametrize("rotation, free", [(False, 2 + 1), (True, 3 + 2)])
def test_degrees_of_freedom_are_what_is_not_prescribed_of_floes_that_are_there(rotation, free):
    motion = [0, FIXED_X, FIXED, COAST, 0]
    floes = Floes(np.arange(5) * 30.0 - 60, 0.0, 10.0, 1.0, motion=motion)
    floes.active[4] = False
    assert Model(DOMAIN, floes, rotation=rotation).degrees_of_freedom() == free


def test_the_tree_names_what_is_there_and_what_is_absent():
    text = repr(pair(contact=cohesive(), forces=[OceanDrag()]))
    assert "TensileStrength" in text and "OceanDrag" in text
    absent = text.splitlines()[-1]
    assert "friction" in absent and "wind" in absent and "bonds" not in absent
    assert "compressive failure" in absent
    assert not any(line.endswith(" ") for line in text.splitlines())


def test_floes_that_lie_over_each_other_are_refused_with_the_worst_pairs():
    floes = Floes([0.0, 15.0, 40.0], 0.0, 10.0, 1.0)
    with pytest.raises(InputError, match="floes 0 and 1 by 5 m"):
        Model(DOMAIN, floes, contact=Contact())
    Model(DOMAIN, floes)  # without contacts it does not matter
    assert [pair[:2] for pair in overlapping(floes, DOMAIN)] == [(0, 1)]
    for allowed in ("a", np.nan, [0.1]):
        with pytest.raises(InputError, match="^allowed = .*: must be a finite number"):
            overlapping(floes, DOMAIN, allowed)


def two_apart(u=0.0):
    return Model(DOMAIN, Floes([0.0, 50.0], 0.0, 10.0, 1.0, u=[u, 0.0]), contact=Contact())


def test_a_floe_that_an_edit_puts_onto_another_is_refused_with_both_and_moved_away_again_it_goes_on():
    model = two_apart()
    model.advance(1.0)
    model.floes.x[1] = 5.0
    for _ in range(2):
        with pytest.raises(InputError, match="after an edit .* floes 0 and 1 by 15 m; move them"):
            model.advance(1.0)
    model.floes.x[1] = 19.5  # as much as a start may
    model.advance(1.0)
    model.floes.radius[0] = 20.0
    with pytest.raises(InputError, match="floes 0 and 1 by"):
        model.advance(1.0)
    model.floes.radius[0] = 10.0
    number = model.floes.add(model.floes.x[0], 0.0, 3.0, 1.0)
    with pytest.raises(InputError, match="floes 0 and 2 by 13 m"):
        model.advance(1.0)
    model.floes.active[number] = False
    model.advance(1.0)


def test_floes_that_a_blow_has_pressed_together_may_be_edited_and_restarted():
    model = two_apart(u=40.0)
    model.advance(0.9)
    assert overlapping(model.floes, DOMAIN, 0.2)
    state = model.state()
    model.floes.x += 1e-3
    model.floes.radius *= 1.001
    model.advance(0.01)
    model.restore(state)
    model.advance(0.01)


def test_a_restart_with_a_floe_on_another_is_refused_with_both():
    model = two_apart()
    state = model.state()
    state["floes_x"] = np.array([0.0, 5.0])
    model.restore(state)
    with pytest.raises(InputError, match="after a restart .* floes 0 and 1 by 15 m"):
        model.advance(1.0)


def test_a_restart_while_driven_floes_pass_through_each_other_goes_on():
    """It had been refused, though a run goes on."""
    model = two_apart()
    model.floes.motion[:] = DRIVEN
    state = model.state()
    state["floes_x"] = np.array([0.0, 5.0])
    model.restore(state)
    model._refuse_edits()  # as the next advance does
    model.floes.motion[0] = 0
    model.restore(model.state() | {"floes_x": np.array([0.0, 4.0])})
    with pytest.raises(InputError, match="after a restart .* floes 0 and 1 by 16 m"):
        model.advance(1.0)


@pytest.mark.parametrize(
    "duration", [-1.0, np.nan, np.inf, "10", None, [10.0], np.ones(2), True, 1j], ids=repr
)
def test_a_duration_that_cannot_be_is_refused(duration):
    with pytest.raises(InputError, match="duration"):
        pair().advance(duration)


def test_a_field_that_is_assigned_is_written_into_the_array_that_hosts_hold():
    model = pair(forces=[OceanDrag()], grid=Grid.uniform((-100, 100), (-100, 100), shape=(2, 3)))
    held = model.ocean.u
    for values in (0.1, [0.1] * 6, np.full((2, 3), 0.1, order="F"), np.full(12, 0.1)[::2]):
        held[:] = 0.0
        model.ocean.u = values
        assert model.ocean.u is held and (held == 0.1).all()
    for wrong in (np.zeros(3), "fast", np.zeros((6, 2))):  # would be read beyond its end
        with pytest.raises(InputError, match="u (has shape|= 'fast')"):
            model.ocean.u = wrong
    with pytest.raises(InputError, match="tilt_x: no force"):
        model.ocean.tilt_x = 0.1
    model.ocean.u = np.ma.masked_array(held, [True] + 5 * [False])
    with pytest.raises(InputError, match="ocean.u: nan in wet cell 0"):
        model.advance(1.0)


def test_speeds_of_no_current_wind_or_floe_are_refused_before_drag_is_after_them():
    fill = 1e20  # what a host passes that forgot its mask: sub-steps of drag had no end
    for what, fluid in (("ocean", OceanDrag()), ("atmosphere", AirDrag())):
        model = pair(contact=Contact(), forces=[fluid])
        getattr(model, what).v = fill
        with pytest.raises(
            InputError, match=f"{what}.v: 1e.20 in wet cell 0 .* must be a velocity"
        ):
            model.advance(1.0)
    model = pair(contact=Contact(), forces=[OceanDrag()])
    model.floes.u[0] = fill
    with pytest.raises(StabilityError, match="floe 0: moves"):
        model.advance(1.0)
    model = pair(forces=[OceanDrag()])
    model.floes.u[0] = fill
    with pytest.raises(StabilityError, match="would take .* steps"):
        model.advance(1.0)
    model = pair(
        contact=Contact(), forces=[Coriolis(1e30)]
    )  # more sub-steps than an integer counts
    model.floes.u[0] = 1e-3
    with pytest.raises(StabilityError, match="would take .* sub-steps"):
        model.advance(1.0)


def test_rows_and_columns_of_another_shape_are_refused_they_would_come_to_other_cells():
    grid = Grid.uniform(DOMAIN.x, DOMAIN.y, shape=(2, 3))
    model = pair(forces=[OceanDrag()], grid=grid)
    model.ocean.u = grid.x.reshape(1, 2, 3)
    np.testing.assert_array_equal(model.ocean.u, grid.x)
    with pytest.raises(InputError, match=r"u has shape \(3, 2\): must be \(2, 3\), rows and"):
        model.ocean.u = grid.x.reshape(2, 3).T
    np.testing.assert_array_equal(model.ocean.u, grid.x)


def test_what_a_model_is_made_of_cannot_be_changed_nor_a_name_misspelt():
    model = pair(contact=frictional(), forces=[OceanDrag(), AirDrag()])
    for name in ("contact", "domain", "floes", "forces", "grid", "ocean", "step", "stpe"):
        with pytest.raises(AttributeError, match=f"model.{name}: cannot be set; build another"):
            setattr(model, name, None)
    with pytest.raises(AttributeError, match="velocity"):
        model.ocean.velocity = 0.1
    model.time = 3.0
    model.advance(1.0)
    assert model.time == 4.0


def test_what_is_asked_for_its_overlaps_must_be_floes():
    floes = Floes([0.0, 5.0], 0.0, 10.0, 1.0)
    for wrong in ((None, DOMAIN), (floes, None)):
        for ask in (overlapping, relax):
            with pytest.raises(InputError, match="(floes|domain) = None: must be"):
                ask(*wrong)
    floes.x[1] = np.nan  # no number is above what is allowed
    for ask in (overlapping, relax):
        with pytest.raises(InputError, match="floe 1: x = nan m"):
            ask(floes, DOMAIN)


@pytest.mark.parametrize(
    ("part", "said"),
    [
        ({"floes": DOMAIN}, "floes = .*: must be of the kind Floes"),
        ({"domain": ((0, 1), (0, 1))}, "domain = .*: must be a Domain"),
        ({"domain": Domain(100.0, (0, 1))}, "domain.x = 100.0: must be two numbers"),
        ({"domain": Domain((0, "1"), (0, 1))}, "domain.x = .*: must be two numbers"),
        ({"domain": Domain(xr.DataArray([0, 1]), (0, 1))}, "domain.x = .*: must be two numbers"),
        ({"grid": (10, 10)}, "grid = .*: must be a Grid"),
        ({"walls": Wall("west")}, "walls = .*: must be a list of Wall"),
        ({"inflow": [Wall("west")]}, "inflow = .*: must be a list of Inflow"),
        ({"inflow": Inflow("west", PowerLaw(1, 2), velocity=0.5)}, "inflow.velocity = 0.5: must be two"),
        ({"step": 0.3}, "step = 0.3: must be of the kind Step"),
        ({"seed": -1}, "seed = -1: must be a whole number"),
        ({"ice_density": "934"}, "ice_density = '934': must be greater than 0"),
        ({"forces": None}, r"forces = None: must be a list of forces, as \[OceanDrag\(\)\]"),
    ],
)  # fmt: skip
def test_a_part_of_another_kind_is_refused_by_its_name(part, said):
    parts = {"domain": DOMAIN, "floes": Floes(0.0, 0.0, 10.0, 1.0), "contact": Contact()} | part
    with pytest.raises(InputError, match=said):
        Model(**parts)


def scene_of_a_restart(**other):
    """A model of which each part but the floes may be another."""
    floes = Floes([0.0, 20.5], 0.0, 10.0, 1.0)
    shore = Floes(
        [-100.0, 90.0], [50.0, 50.0], other.pop("radius", 5.0), other.pop("hard", 3.0), motion=COAST
    )
    if other.pop("bare", False):
        shore = Floes([], [], [], [])
    parts = dict(
        domain=DOMAIN._replace(north="closed", west="periodic", east="periodic"),
        contact=Contact(friction=Coulomb(0.3)),
        forces=[OceanDrag(), AirDrag(), Coriolis(1e-4)],
        grid=Grid.uniform(DOMAIN.x, DOMAIN.y, shape=(3, 4)),
        atmosphere_grid=Grid.uniform(DOMAIN.x, DOMAIN.y, shape=(2, 2)),
        walls=[Wall("south", velocity=-0.01)],
    )
    return Model(floes=Floes.concatenate([floes, shore]), **(parts | other))


@pytest.mark.parametrize(
    ("other", "said"),
    [
        ({"domain": DOMAIN._replace(y=(-100.0, 120.0), north="closed", west="periodic", east="periodic")},
         "[domain] y = [-100.0, 120.0], the restart's is [-100.0, 100.0]; must be the same"),
        ({"domain": DOMAIN._replace(west="periodic", east="periodic")}, "[domain] north = inactive, the restart's is closed"),
        ({"grid": Grid.uniform(DOMAIN.x, DOMAIN.y, shape=(4, 3))}, "[grid] shape = [4, 3], the restart's is [3, 4]"),
        ({"grid": Grid.rectilinear([-100, 0, 10, 20, 100], [-100, 0, 50, 100])}, "[grid] corners are others"),
        ({"grid": Grid.uniform(DOMAIN.x, (-90, 100), shape=(3, 4))}, "[grid] bounds = "),
        ({"grid": Grid.uniform(DOMAIN.x, DOMAIN.y, shape=(3, 4), wet=[False] + 11 * [True])}, "[grid] wet are others"),
        ({"atmosphere_grid": Grid.uniform(DOMAIN.x, DOMAIN.y, shape=(1, 4))}, "[atmosphere] grid.shape = [1, 4]"),
        ({"forces": [OceanDrag(), AirDrag()]}, "[coriolis] = none, the restart's is Coriolis"),
        ({"forces": [OceanDrag(), AirDrag(), Coriolis(1e-4), Tilt()]}, "[tilt] is given, the restart's is none; must be the same"),
        ({"forces": [AirDrag(), Coriolis(1e-4)]}, "[ocean] is none, the restart's is given; must be the same"),
        ({"walls": []}, "[walls number 1] = none, the restart's is Wall"),
        ({"inflow": Inflow("south", SingleSize(3.0))}, "[inflow number 1] edge = south, the restart's is none"),
        ({"step": Step("taylor3")}, "[step] scheme is the paper's, the restart's is verlet; must be verlet in both or in neither"),
        ({"bare": True}, "[coast] has 0 pieces, the restart's 2; must be the same land and radius"),
        ({"radius": 6.0}, "[coast] has a piece of radius 6 m, the restart's is 5 m"),
        ({"hard": 4.0}, "[coast] has a piece of thickness 4 m, the restart's is 3 m"),
    ],
)  # fmt: skip
def test_a_state_of_another_scene_is_refused_with_table_and_key(other, said):
    state = scene_of_a_restart().state()
    model = scene_of_a_restart(**other)
    with pytest.raises(InputError) as error:
        model.restore(state)
    assert said in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("other", "said"),
    [
        ({"contact": Contact(friction=Coulomb(0.4))}, "[contact] friction.coefficient = 0.4, the restart's is 0.3"),
        ({"contact": Contact(Elastic(1e7), Coulomb(0.3))}, "[contact] elastic.youngs_modulus = 10000000.0, the restart's is 20000000.0"),
        ({"forces": [OceanDrag(), AirDrag(), Coriolis(1.2e-4)]}, "[coriolis] parameter = 0.00012, the restart's is 0.0001"),
        ({"ice_density": 900.0}, "[ice] density = 900.0, the restart's is 934.0"),
        ({"walls": [Wall("south", velocity=-0.02)]}, "[walls number 1] velocity = -0.02, the restart's is -0.01"),
    ],
)  # fmt: skip
def test_another_number_of_a_law_branches_a_run_off_with_a_warning(other, said):
    first = scene_of_a_restart()
    first.advance(1.0)
    model = scene_of_a_restart(**other)
    with pytest.warns(UserWarning) as told:
        model.restore(first.state())
    assert [str(one.message) for one in told] == [f"restart: goes on with {said}"]
    model.advance(1.0)
    for quantity in ("mass", "momentum_x", "momentum_y", "energy"):
        assert model.ledger.balance(quantity).relative < 1e-6


@pytest.mark.parametrize(
    ("other", "said"),
    [
        ({"thickness": 2.0}, "thickness = 2.0, the restart's is 1.0"),
        ({"velocity": (0.0, 0.5)}, "velocity = [0.0, 0.5], the restart's is [0.0, 0.0]"),
        ({"span": (-50.0, 50.0)}, "span = [-50.0, 50.0], the restart's is none"),
    ],
)
def test_another_number_of_an_inflow_is_told_in_a_restart(other, said):
    inflow = Inflow("south", SingleSize(3.0))
    parts = dict(domain=DOMAIN, walls=[], contact=None)
    first, model = (
        scene_of_a_restart(inflow=one, **parts) for one in (inflow, inflow._replace(**other))
    )
    with pytest.warns(UserWarning) as told:
        model.restore(first.state())
    assert [str(one.message) for one in told] == [f"restart: goes on with [inflow number 1] {said}"]


def test_a_state_may_go_on_with_other_drag_steps_and_threads_and_in_files_of_before():
    first = scene_of_a_restart()
    first.advance(1.0)
    state = first.state()
    others = dict(
        forces=[OceanDrag(horizontal=1e-3), AirDrag(), Coriolis(1e-4)], step=Step(fraction=0.1), threads=2,
        sampling="centre", draft_fraction=0.8, seed=3,
    )  # fmt: skip
    model = scene_of_a_restart(**others)
    model.restore(state)
    model.advance(1.0)
    del state["scene"]  # as before states said what they are of
    model = scene_of_a_restart()
    model.restore(state)
    assert model.time == 1.0
    with pytest.raises(InputError, match=r"\[coast\] has a piece of radius"):
        scene_of_a_restart(radius=6.0).restore(state)


def test_who_holds_the_floes_holds_those_of_the_model_after_a_restart():
    model, other = pair(contact=Contact()), pair(contact=Contact())
    held, few = model.floes, model.state()
    other.floes.add([60.0, -60.0], 0.0, 10.0, 1.0)
    for state, number in ((other.state(), 4), (few, 2)):
        model.restore(state)
        assert model.floes is held and len(held) == number
    held.u[:] = 0.5
    model.advance(1.0)
    assert held.x[0] == 0.5


def test_no_time_changes_nothing_and_any_time_is_met_exactly():
    model = pair(contact=frictional(), forces=[OceanDrag(), AirDrag()])
    before = model.state()
    model.advance(0.0)
    assert all(np.array_equal(before[key], value) for key, value in model.state().items())
    for duration in (1e-9, 0.3 * model.longest_step(), 7.0):
        start = model.time
        model.advance(duration)
        assert model.time == start + duration


def test_any_split_of_an_interval_gives_the_same_impulse():
    def run(parts):
        model = pair(contact=frictional(), forces=[OceanDrag(), AirDrag()])
        model.ocean.v[:], model.atmosphere.u[:] = 0.3, 15.0
        for _ in range(parts):
            model.advance(12.0 / parts)
        return np.array([model.ocean.impulse_x.sum(), model.ocean.impulse_y.sum()])

    assert run(7) == pytest.approx(run(1), rel=2e-3)
    assert np.array_equal(run(5), run(5))


def test_edits_between_exchanges_are_an_account_of_their_own():
    model = pair(contact=Contact())
    model.advance(1.0)
    model.floes.u[0] += 0.5
    model.advance(1.0)
    gained = 0.5 * model.floes.mass(934.0)[0]
    assert model.ledger.accounts["edits by the user"][1] == pytest.approx(gained)
    assert model.ledger.balance("momentum_x").relative < 1e-12


def test_to_look_between_exchanges_changes_no_bit_of_what_follows():
    def run(looks):
        model = pair(contact=frictional(), forces=[OceanDrag(), AirDrag()])
        model.ocean.u[:] = 0.3
        for _ in range(4):
            model.advance(3.0)
            if looks:
                model.fields(), model.contacts(), model.longest_step(), model.wall_stress()
        return model.state()

    looked, blind = run(True), run(False)
    assert all(np.array_equal(looked[name], value) for name, value in blind.items())


def test_a_floe_that_somebody_changes_is_seen_as_it_is_now():
    model = pair(contact=Contact())
    before = model.fields()["area_fraction"].sum(), len(model.contacts().i)
    model.floes.radius[0] = 12.0
    assert model.fields()["area_fraction"].sum() > before[0]
    assert (before[1], len(model.contacts().i)) == (0, 1)
    model.floes.add(x=-60.0, y=0.0, radius=10.0, thickness=1.0)
    assert model.fields()["floe_count"].sum() == pytest.approx(3)


def test_what_is_known_of_a_grid_is_not_told_of_another_that_took_its_place_in_memory():
    model = pair()
    for k in range(400):
        grid = Grid.uniform(DOMAIN.x, DOMAIN.y, shape=(2 + k % 7, 3))
        there = set(coverage(grid, model.floes.x, model.floes.y, model.floes.radius).cell)
        assert set(model.coverage(grid).cell) == set(model.weights(grid).cell) == there


@pytest.mark.parametrize("kind", ["uniform", "rectilinear", "curvilinear", "unstructured"])
@pytest.mark.parametrize("sampling", ["overlap", "centre"])
def test_momentum_closes_on_every_grid_with_land(kind, sampling):
    rng = np.random.default_rng(2)
    edges = np.linspace(-100.0, 100.0, 9)
    x, y = np.meshgrid(edges, edges)
    x, y = x + 3 * np.sin(y / 40), y + 3 * np.cos(x / 30)
    wet = rng.uniform(size=64) > 0.3
    grid = {
        "uniform": lambda: Grid.uniform((-100, 100), (-100, 100), shape=(8, 8), wet=wet),
        "rectilinear": lambda: Grid.rectilinear(edges, np.sign(edges) * edges**2 / 100, wet=wet),
        "curvilinear": lambda: Grid.curvilinear(x, y, wet=wet),
        "unstructured": lambda: Grid.unstructured(
            x.ravel(), y.ravel(),
            [[j * 9 + i, j * 9 + i + 1, j * 9 + i + 10, j * 9 + i + 9] for j in range(8) for i in range(8)],
            wet=wet,
        ),
    }[kind]()  # fmt: skip
    px, py = (a.ravel() for a in np.meshgrid(np.arange(-80, 81, 20.0), np.arange(-80, 81, 20.0)))
    floes = Floes(px, py, rng.uniform(1.0, 9.0, 81), 1.0, u=rng.normal(0, 0.2, 81))
    model = Model(DOMAIN, floes, contact=frictional(), forces=[OceanDrag(), AirDrag()], grid=grid,
                  sampling=sampling)  # fmt: skip
    model.ocean.u[:], model.atmosphere.v[:] = rng.normal(0, 0.3, 64), 10.0
    for _ in range(3):
        model.advance(20.0)
    for axis, name in ((0, "x"), (1, "y")):
        for fluid, account in ((model.ocean, "ocean drag"), (model.atmosphere, "wind")):
            given = getattr(fluid, f"impulse_{name}").sum() + fluid.undelivered[axis]
            taken = model.ledger.accounts[account][1 + axis]
            scale = np.abs(getattr(fluid, f"impulse_{name}")).sum()
            assert abs(given + taken) <= 1e-12 * scale
        assert model.ledger.balance(f"momentum_{name}").relative < 1e-12
    assert not np.any(model.ocean.impulse_x[~grid.wet])
    fields = model.fields()
    covered = ((fields["area_fraction"] + fields["overlap_fraction"]) * grid.area).sum()
    assert covered + model.coverage().outside.sum() == pytest.approx(floes.area.sum(), rel=1e-12)
    assert all(np.isfinite(values).all() for values in fields.values())


def test_a_grid_that_meets_its_own_image_across_a_period_is_refused():
    """Floes there had counted twice; the area of such a grid can be less than that of the domain."""
    domain = DOMAIN._replace(west="periodic", east="periodic", south="periodic", north="periodic")
    floes = Floes([-95.0], [0.0], 4.0, 1.0)
    long = Grid.uniform((-140.0, 140.0), (-50.0, 50.0), spacing=10.0)
    a, b = np.meshgrid(np.linspace(-0.5, 0.5, 17), np.linspace(-0.5, 0.5, 17))
    x, y = a - b, a + b  # a square on its corner, 2 d wide
    wavy = 200.0 * a + 30.0 * np.sin(6.0 * b), 200.0 * b
    for grid, text in (
        (long, "shorter than the grid"),
        (Grid.curvilinear(110.0 * x, 110.0 * y), "cell .* lies on the grid's own image"),
        (Grid.curvilinear(110.0 * x, 80.0 * y), "cell .* lies on the grid's own image"),
    ):
        with pytest.raises(InputError, match=text):
            Model(domain, floes, forces=[OceanDrag()], grid=grid)
        with pytest.raises(InputError, match=text):
            Model(domain, floes, forces=[AirDrag()], atmosphere_grid=grid)
        assert Model(DOMAIN, floes, forces=[OceanDrag()], grid=grid).time == 0.0
    for grid in (
        Grid.curvilinear(100.0 * x, 100.0 * y),  # corner to corner
        Grid.curvilinear(*wavy),  # a seam that is not straight
        Grid.uniform((-140.0, 60.0), (-50.0, 50.0), spacing=10.0),
    ):
        model = Model(domain, floes, forces=[OceanDrag()], grid=grid)
        fields = model.fields()
        covered = ((fields["area_fraction"] + fields["overlap_fraction"]) * grid.area).sum()
        assert 0 < covered <= floes.area.sum() * (1 + 1e-12)


def test_a_floe_that_touches_no_wet_cell_has_no_drag_and_leaves_nothing_undelivered():
    grid = Grid.uniform((-60.0, 60.0), (-60.0, 60.0), shape=(4, 4), wet=np.tile([1, 1, 0, 0], 4))
    floes = Floes([-30.0, 30.0, -80.0, 0.0], [0.0, 0.0, 0.0, 30.0], 5.0, 1.0, u=0.5)
    model = Model(
        DOMAIN, floes, contact=frictional(), forces=[OceanDrag(), AirDrag()], grid=grid,
        atmosphere_grid=Grid.uniform((-60.0, 60.0), (-60.0, 60.0), shape=(1, 1)),
    )  # fmt: skip
    model.atmosphere.u[:], model.atmosphere.v[:] = 0.5, 10.0
    model.advance(20.0)
    u, v = model.floes.u, model.floes.v
    assert (u[[1, 2]] == 0.5).all()
    assert (u[[0, 3]] < 0.5).all()
    assert v[2] == 0.0 < v[1]  # the wind has no land, and no cell beyond its grid
    assert not model.ocean.undelivered.any()


@pytest.mark.parametrize(
    ("contact", "said"),
    [
        (frictional(), "[contact] friction = none, the restart's is Coulomb"),
        (
            Contact(dashpot=Restitution(0.5)),
            "[contact] dashpot = none, the restart's is Restitution",
        ),
    ],
)
def test_a_state_of_other_contacts_is_refused_and_the_model_is_as_before(contact, said):
    model, other = pair(contact=Contact()), pair(contact=contact)
    before = model.floes.x.copy()
    with pytest.raises(InputError, match=re.escape(f"restart: {said}")):
        model.restore(other.state())
    assert np.array_equal(model.floes.x, before)


@pytest.mark.parametrize("scheme", ["verlet", pytest.param("taylor3", marks=pytest.mark.long)])
def test_an_advance_that_fails_leaves_the_model_as_it_was(scheme, monkeypatch):
    def made():
        floes = Floes([0.0, 19.9, 300.0], [0.0, 0.0, 5.0], 10.0, 1.0, u=[0.3, 0.0, 0.0])
        return Model(
            Domain((-400.0, 400.0), (-400.0, 400.0)), floes, contact=frictional()._replace(bonds=TensileStrength()),
            forces=[OceanDrag(), AirDrag(), Coriolis(1e-4)],
            inflow=Inflow("north", PowerLaw(10.0, 20.0), velocity=(0.0, -5.0)),
            walls=[Wall("west", normal_stress=1e3)],
            step=Step(scheme, length=0.02),
        )  # fmt: skip

    model, other = made(), made()
    for one in (model, other):
        one.advance(2.0)
    ledger, x, slow = model.ledger, model.floes.x, model.floes.u[2]
    model.floes.u[2] = 600.0  # a later exchange meets it, with floes added on the way
    edited = model.state()
    with pytest.raises(StabilityError):
        model.advance(10.0)
    after = model.state()
    assert all(np.array_equal(edited[name], after[name]) for name in edited)
    assert model.ledger is ledger and np.shares_memory(model.floes.x, x)
    model.floes.u[2] = slow

    def too_late(*given):  # all steps are taken, the wall has moved, floes have come in
        raise StabilityError("late")

    before = model.state()
    with monkeypatch.context() as late:
        late.setattr(Model, "_check_energy", too_late)
        with pytest.raises(StabilityError, match="late"):
            model.advance(10.0)
    after = model.state()
    assert [name for name in before if not np.array_equal(before[name], after[name])] == []
    for one in (model, other):
        one.advance(2.0)
    assert np.array_equal(other.floes.x, model.floes.x)


def test_a_balance_of_what_is_not_booked_is_refused_in_one_line():
    with pytest.raises(InputError, match="balance of 'momentum': allowed: .*mean 'momentum_"):
        pair().ledger.balance("momentum")


def test_a_model_is_imported_without_what_only_some_models_need():
    code = "import sys, floebmi.model; print([m for m in ('scipy.sparse', 'xarray', 'netCDF4', 'shapely', 'pydantic') if m in sys.modules])"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout == "[]\n"
