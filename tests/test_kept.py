"""A list of neighbours lasts over exchanges while it holds, and what is saved of it gives back the same bits."""

import copy
import pickle

import numpy as np
import pytest

import floebmi.fluid
from floebmi.advance import Advance
from floebmi.boundaries import Domain, Inflow, Wall
from floebmi.contact import Contact, Coulomb, TensileStrength
from floebmi.dynamics import Step
from floebmi.errors import InputError
from floebmi.floes import FIXED, Floes
from floebmi.forces import AirDrag, Coriolis, OceanDrag
from floebmi.kept import Kept, Marks, marks
from floebmi.model import Model
from floebmi.sizes import UniformSize

LAWS = dict(
    contact=Contact(friction=Coulomb(), bonds=TensileStrength(50e3)),
    forces=[OceanDrag(), AirDrag(), Coriolis(1e-4)],
)
NOWHERE = {f"list_{name}": value for name, value in marks(None, np.zeros(0))._asdict().items()}


def jostle(edges="periodic", ratio=1.4, seed=0, drift=50.0, **laws):
    """Floes that drift along x, bump and rub; beside a driven wall, where edges are closed."""
    rng = np.random.default_rng(seed)
    x, y = (a.ravel() for a in np.meshgrid(np.arange(12) * 2.05 + 1, np.arange(12) * 2.05 + 1))
    floes = Floes(x, y, rng.uniform(1.0 / ratio, 1.0, 144), 1.0, u=drift + rng.normal(0, 0.1, 144))
    floes.v[:] = rng.normal(0, 0.1, 144)
    open_to = "inactive" if edges == "closed" else "periodic"
    domain = Domain((0, 24.6), (0, 24.6), edges, edges, open_to, open_to)
    walls = [] if edges == "periodic" else [Wall("west", velocity=0.2)]
    model = Model(domain, floes, walls=walls, **(LAWS | laws))
    model.ocean.u[:] = drift
    return model


def go_on(model, exchanges=4):
    for _ in range(exchanges):
        model.advance(0.01)
    return model


def amid(**scene):
    """Amid contacts, some exchanges after a list was made."""
    model = jostle(**scene)
    model.advance(2.0)
    model._state.kept = None
    return go_on(model)


def same(one, other):
    """Names of what differs between two models, of all that a restart file has."""
    one, other = one.state(), other.state()
    assert one.keys() == other.keys()
    return [name for name in one if not np.array_equal(one[name], other[name])]


def restarted(model, **changes):
    other = jostle("periodic" if not model.walls else "closed", seed=9, step=model.step)
    other.restore(model.state() | changes)
    return other


@pytest.mark.parametrize(
    "scene",
    [
        dict(),
        dict(edges="closed", drift=0.0),
        dict(ratio=6.0),
        dict(step=Step(scheme="taylor3", epsilon=0.07)),
    ],
    ids=["across a seam", "beside walls", "sizes that differ much", "the scheme of the paper"],
)
def test_a_list_lasts_over_exchanges_and_a_restart_amid_them_gives_the_same_bits(scene):
    model = amid(**scene)
    state, lists = model.state(), model.counters.rebuilds
    way = np.abs(model.floes.x[state["list_number"]] - state["list_x"])
    assert way.max() > 1e-3 and (way.max() > 20.0 or model.walls)  # through the seam
    second = restarted(model)
    assert go_on(second, 1).counters.rebuilds == go_on(model, 1).counters.rebuilds == lists
    assert same(go_on(model, 30), go_on(second, 30)) == []
    assert model.counters.rebuilds < lists + 15


@pytest.mark.parametrize("memory", ["slip", "bonded"])
def test_a_restart_that_forgets_what_contacts_remember_is_noticed(memory):
    model = amid()
    remembered = model.state()[f"pair_{memory}"]
    assert len(model.contacts().i) > 20 and remembered.any()
    second = restarted(model, **{f"pair_{memory}": 0.0 * remembered})
    assert "floes_x" in same(go_on(model), go_on(second))


@pytest.mark.parametrize(
    "duplicate", [copy.deepcopy, lambda model: pickle.loads(pickle.dumps(model))]
)
@pytest.mark.parametrize("edited", [False, True])
def test_a_copy_goes_on_with_the_same_bits_and_shares_nothing(duplicate, edited):
    model = amid(edges="closed", drift=0.0)
    if edited:
        model.floes.u[3] += 0.1
        model.floes.active[5] = False
    second, third = duplicate(model), duplicate(model)
    assert same(second, model) == []
    go_on(second)
    assert second.ocean.grid is second.grid
    assert same(third, model) == []
    assert same(second, go_on(model)) == same(second, go_on(third)) == []
    assert ("edits by the user" in second.ledger.accounts) == edited


def test_a_restart_that_lists_floes_where_they_are_is_noticed():
    model = amid()
    second = restarted(model, **NOWHERE)
    assert "counters" in same(go_on(model, 1), go_on(second, 1))
    assert "floes_v" in same(go_on(model, 30), go_on(second, 30))
    state = model.state()
    for name in Marks._fields:
        del state[f"list_{name}"]
    with pytest.raises(InputError, match="older floebmi wrote it"):
        model.restore(state)


def move(floes):
    floes.x[7] += 0.02


def grow(floes):
    floes.radius[7] *= 1.05


def sink(floes):
    floes.active[7] = False


def hold(floes):
    floes.motion[7] = FIXED


def thicken(floes):
    floes.thickness[7] = 9.0


def push(floes):
    floes.u[7], floes.angular_velocity[7] = 51.0, 1.0


def add(floes):
    floes.add(2.1, 2.1, 0.05, 1.0)


@pytest.mark.parametrize("edit", [move, grow, sink, hold, add])
def test_after_an_edit_of_what_decides_neighbours_they_are_listed_anew(edit):
    model = amid()
    lists = model.counters.rebuilds
    edit(model.floes)
    second, anew = restarted(model), restarted(model, **NOWHERE)
    assert np.array_equal(model.contacts(), anew.contacts())
    assert len(model.state()["list_x"]) == 0
    assert go_on(model, 1).counters.rebuilds > lists
    go_on(second, 1), go_on(anew, 1)
    assert same(go_on(model, 3), go_on(second, 3)) == []
    assert same(model, go_on(anew, 3)) == []


def test_a_list_that_no_longer_holds_misses_neighbours(monkeypatch):
    model = amid()
    model.floes.x[8], model.floes.y[8] = model.floes.x[100] + 1.0, model.floes.y[100] + 0.1
    touching = model.contacts()
    assert {8, 100} in map(set, zip(touching.i, touching.j, strict=True))
    model.floes.u[0] += 1.0  # so that it is looked again
    monkeypatch.setattr(Kept, "of", lambda kept, floes: kept)
    touching = model.contacts()
    assert {8, 100} not in map(set, zip(touching.i, touching.j, strict=True))


@pytest.mark.parametrize("edit", [thicken, push])
def test_an_edit_of_what_does_not_decide_neighbours_goes_on_with_the_list(edit):
    model = amid()
    lists = model.counters.rebuilds
    edit(model.floes)
    anew = restarted(model, **NOWHERE)
    assert model.longest_step() == pytest.approx(anew.longest_step(), rel=0.05)
    assert len(model.state()["list_stiffest"]) == (0 if edit is thicken else 3)
    second = restarted(model)
    assert go_on(model, 1).counters.rebuilds == lists
    assert same(model, go_on(second, 1)) == []
    assert same(go_on(model, 3), go_on(second, 3)) == []
    assert model.floes.x == pytest.approx(go_on(anew, 4).floes.x, abs=1e-6)


def test_an_edit_of_how_fast_floes_go_sets_the_sub_steps_of_their_drag(monkeypatch):
    def thrown() -> tuple[Model, Model]:
        forces = [OceanDrag(vertical=100.0), *LAWS["forces"][1:]]
        model, second = (go_on(jostle(drift=0.0, forces=forces, seed=k), 2) for k in (0, 9))
        model.floes.u[7] = 30.0
        second.restore(model.state())
        return go_on(model, 1), go_on(second, 1)

    assert same(*thrown()) == []
    monkeypatch.setattr(Kept, "of", lambda kept, floes: kept)
    assert "floes_u" in same(*thrown())


def test_a_failed_exchange_leaves_the_list_as_it_was(monkeypatch):
    model, second = amid(), amid()
    before, finish = model.state(), Advance.finish

    def fail(advance):
        finish(advance)
        raise KeyboardInterrupt

    monkeypatch.setattr(Advance, "finish", fail)
    with pytest.raises(KeyboardInterrupt):
        model.advance(0.5)
    monkeypatch.undo()
    after = model.state()
    assert all(np.array_equal(before[name], after[name]) for name in before)
    assert same(go_on(model, 3), go_on(second, 3)) == []


def test_ctrl_c_finds_all_of_an_exchange_or_nothing_of_it(monkeypatch):
    whole, cut = amid(), amid()

    def pressed_in(place, name):
        call = getattr(place, name)

        def pressed(*arguments):
            call(*arguments)
            raise KeyboardInterrupt

        with monkeypatch.context() as patch:
            patch.setattr(place, name, pressed)
            with pytest.raises(KeyboardInterrupt):
                cut.advance(0.01)

    for place, name in (
        (Advance, "_go_on"), (Advance, "_touch"), (Advance, "run"), (Model, "_check_energy"), (Model, "_ocean_drag"),
    ):  # fmt: skip
        pressed_in(place, name)
        assert same(cut, whole) == [], name
    pressed_in(floebmi.fluid, "give_back")  # compiled: the key is heard when it is through
    assert same(cut, go_on(whole, 1)) == []
    assert same(go_on(cut), go_on(whole)) == []


def test_the_scheme_of_the_paper_goes_on_without_ice():
    model = jostle(step=Step(scheme="taylor3", epsilon=0.07))
    model.floes.active[:] = False
    assert go_on(model, 2).longest_step() == np.inf and model.time == pytest.approx(0.02)


def test_looking_at_contacts_lists_no_neighbours_and_changes_nothing():
    model, blind = amid(), amid()
    lists = model.counters.rebuilds
    for _ in range(2):
        assert len(model.contacts().i) > 20 and model.fields()
        go_on(model, 1), go_on(blind, 1)
    assert model.counters.rebuilds == lists and same(model, blind) == []


def test_an_inflow_lists_anew_only_when_a_floe_comes():
    domain = Domain((0.0, 30.0), (0.0, 60.0), "closed", "closed", "inactive", "inactive")
    inflow = Inflow("north", UniformSize(2.0, 4.0), velocity=(0.0, -0.5))
    model = Model(domain, Floes([], [], [], []), inflow=inflow, seed=5, **LAWS)
    go_on(model, 1)
    floes, lists = len(model.floes), model.counters.rebuilds
    go_on(model, 5)
    assert (len(model.floes), model.counters.rebuilds) == (floes, lists)
    model.advance(30.0)
    assert len(model.floes) > floes and model.counters.rebuilds > lists


def test_a_state_that_does_not_say_how_many_pairs_were_tested_is_taken_up():
    model = amid()
    counted = model.state()["counters"]
    old = restarted(model, counters=counted[:-2])
    assert old.counters.steps == model.counters.steps > 0
    assert old.counters.tested == old.counters.listed == 0 < model.counters.listed
    with pytest.raises(InputError, match="restart: counters: 3 of them; must be 10, or 8"):
        restarted(model, counters=counted[:3])
