"""Calls in any order: what only looks, what is refused and what goes back and comes again leaves no trace.

Each sequence is of a seed.  It mixes calls that count (inputs, updates, changes of floes) with others that must not: reading,
wrong calls, updates that fail, states that are saved and loaded, here or in another instance.  A second instance gets the
calls that count, and nothing else; both must end with the same bits.
"""

import copy
import pickle

import numpy as np
import pytest
from bmi_conformance import GIVEN, IMPULSE, MOMENTUM, ON_OCEAN, differing, everything, names_of
from exchange_grids import GRIDS, SIDE, masked
from test_bmi_conformance import AIR, RECTILINEAR, UNIFORM, write_corners

from floebmi import (
    AirDrag,
    Domain,
    FloeBmi,
    Inflow,
    InputError,
    Model,
    OceanDrag,
    SingleSize,
    StabilityError,
    UniformSize,
    frictional,
    scatter,
)
from floebmi.restarts import load_restart, save_restart


def some(kinds):
    """All, two of them for every run of the suite."""
    often = ("uniform", "curvilinear")
    return [one if one in often else pytest.param(one, marks=pytest.mark.long) for one in kinds]


SCENE = """
contact = "frictional"

[domain]
x = [0.0, 8000.0]
y = [0.0, 6000.0]

[grid]
{grid}

[[floes]]
arrangement = "scatter"
count = 12
seed = 3
x = [1000.0, 8000.0]
size = {{distribution = "uniform", radius_min = 200.0, radius_max = 500.0}}
velocity = [0.8, 0.3]

[[inflow]]
edge = "west"
velocity = [2.0, 0.0]
sizes = {{distribution = "single", radius = 300.0}}

[ocean]
velocity = [0.1, 0.05]

[atmosphere]
{air}

[time]
exchange = 40.0
"""
SCENES = {
    "uniform": SCENE.format(grid=UNIFORM, air="velocity = [8.0, -4.0]"),
    "rectilinear": SCENE.format(grid=RECTILINEAR, air=AIR),
    "curvilinear": SCENE.format(grid='kind = "curvilinear"\nfile = "corners.nc"', air=AIR),
    "unstructured": SCENE.format(grid='kind = "unstructured"\nfile = "faces.nc"', air=""),
}
MANY = 60  # calls in a sequence
CALLS = [
    *["counts"] * 6,
    *["wrong"] * 3,
    *["save"] * 3,
    "load",
    "fails",
    "looks",
    "another",
    "anew",
]
STEPS = [*["counts"] * 7, *["save"] * 3, "back", "fails", "looks", "copy", "pickle", "file"]


def bits_differ(one, other):
    """Names of what is not the same in two states, to the last bit."""

    def bits(value):
        return (value.dtype, value.tobytes()) if isinstance(value, np.ndarray) else repr(value)

    names = one.keys() & other.keys()
    return sorted(one.keys() ^ other.keys()) + [n for n in names if bits(one[n]) != bits(other[n])]


# ---- FloeBmi ------------------------------------------------------------------------------------


def started(config):
    ice = FloeBmi()
    ice.initialize(str(config))
    return ice


def make(ice, call):
    """One of the calls that count."""
    name, *values = call
    if name == "steps":
        for _ in range(values[0]):
            ice.update()
    elif name == "until":  # as many whole exchanges at once
        end = ice.get_current_time()
        for _ in range(values[0]):
            end += ice.get_time_step()
        ice.update_until(end)
    elif name == "part":
        ice.update_until(ice.get_current_time() + values[0])
    elif name == "pointer":
        ice.get_value_ptr(values[0])[:] = values[1]
    elif name == "push":
        ice.model.floes.u[values[0]] += 0.1
    else:
        getattr(ice, name)(*values)


def a_call_that_counts(ice, rng):
    name = rng.choice(ice.get_input_var_names())
    size = ice.get_value_ptr(name).size
    values = rng.normal(size=size) * (8.0 if "air" in name else 0.3)
    some = rng.integers(0, size, 3)
    calls = [
        ("set_value", name, values), ("set_value_at_indices", name, some, values[some]),
        ("pointer", name, values), ("push", int(rng.integers(len(ice.model.floes)))),
        ("steps", int(rng.integers(1, 4))), ("until", int(rng.integers(1, 4))), ("part", float(rng.uniform(0, 90))),
    ]  # fmt: skip
    return calls[rng.integers(len(calls))]


def a_wrong_call(ice, rng, folder):
    one, size = ice.get_input_var_names()[0], ice.get_value_ptr(ice.get_input_var_names()[0]).size
    out = str(rng.choice(ice.get_output_var_names()))
    places, nan = ice.get_value_ptr(out).size, np.full(size, np.nan)
    calls = [
        lambda: ice.set_value(one, np.zeros(size + 1)),
        lambda: ice.set_value(one, nan),
        lambda: ice.set_value(out, np.zeros(places)),
        lambda: ice.set_value("no such name", np.zeros(size)),
        lambda: ice.set_value_at_indices(one, np.array([0, size]), np.ones(2)),
        lambda: ice.set_value_at_indices(one, np.array([0, 1]), np.array([1.0, np.nan])),
        lambda: ice.set_value_at_indices(one, np.array([0, 1]), np.ones(3)),
        lambda: ice.get_value(out, np.zeros(places + 1)),
        lambda: ice.get_value_at_indices(out, np.zeros(1), np.array([places])),
        lambda: ice.get_value_ptr("no such name"),
        lambda: ice.get_grid_type(77),
        lambda: ice.update_until(ice.get_current_time() - 1.0),
        lambda: ice.update_until(np.nan),
        lambda: ice.initialize(str(folder / "bmi.toml")),
        lambda: ice.load_state(folder / "none.nc"),
        lambda: ice.save_state(folder / "none" / "state.nc"),
    ]
    with pytest.raises(InputError):
        calls[rng.integers(len(calls))]()


def an_update_that_fails(ice, rng):
    """A number that is none, through a pointer or in a floe, in the first exchange or after some."""
    if rng.random() < 0.5:
        array = ice.get_value_ptr(rng.choice(ice.get_input_var_names()))
    else:
        array = ice.model.floes.v
    place = rng.integers(array.size)
    before, array[place] = array[place], np.nan
    with pytest.raises(InputError):
        ice.update_until(ice.get_current_time() + rng.uniform(1.0, 100.0))
    array[place] = before


def look(ice, rng):
    for name in rng.permutation(names_of(ice))[:9]:
        array = ice.get_value_ptr(name)
        some = rng.integers(0, array.size, 4)
        copied = ice.get_value(name, np.empty(array.size, array.dtype))
        picked = ice.get_value_at_indices(name, np.empty(4, array.dtype), some)
        assert np.array_equal(copied, array) and np.array_equal(picked, array[some])
        assert ice.get_var_nbytes(name) == array.nbytes
    ice.model.fields(), ice.model.longest_step(), ice.model.contacts()


def books_close(ice, before, after):
    """Between two moments: momentum against impulses, and the mean stress against their difference."""
    area, time = ice.model.grid.area, after["time"] - before["time"]
    for axis in (0, 1):
        change = {name: after[name] - before[name] for name in after}
        given = area @ change[IMPULSE[axis]]
        lost, wind, other = (float(change[name][0]) for name in GIVEN[axis])
        residual = change[MOMENTUM[axis]] + given + lost - wind - other
        size = area @ np.abs(after[IMPULSE[axis]]) + abs(after[MOMENTUM[axis]]) + abs(wind)
        assert abs(residual) < 1e-12 * (size + after["sea_ice__domain_integral_of_mass"])
        mean = after[ON_OCEAN[axis]] * time
        assert np.allclose(
            mean, change[IMPULSE[axis]], rtol=1e-10, atol=1e-12 * np.abs(after[IMPULSE[axis]]).max()
        )


@pytest.mark.parametrize("kind", some(SCENES))
def test_what_does_not_count_leaves_no_trace_in_the_component(kind, tmp_path):
    rng = np.random.default_rng(list(SCENES).index(kind))
    write_corners(tmp_path)
    (tmp_path / "scene.toml").write_text(SCENES[kind])
    config, state = tmp_path / "bmi.toml", tmp_path / "state.nc"
    config.write_text('[bmi]\nscene = "scene.toml"\nfloe_capacity = 60\n')
    ice, calls = started(config), []
    ice.save_state(state)
    saved = 0
    for what in rng.choice(CALLS, MANY):
        if what == "counts":
            call = a_call_that_counts(ice, rng)
            updates = call[0] in ("until", "part") and "push" not in [name for name, *_ in calls]
            before = everything(ice) if updates else None
            make(ice, call)
            if updates:
                books_close(ice, before, everything(ice))
            calls.append(call)
        elif what == "wrong":
            a_wrong_call(ice, rng, tmp_path)
        elif what == "fails":
            an_update_that_fails(ice, rng)
        elif what == "looks":
            look(ice, rng)
        elif what == "save":
            ice.save_state(state)
            saved = len(calls)
        elif what == "load":
            ice.load_state(state)
            del calls[saved:]
        else:
            ice.save_state(tmp_path / "now.nc")
            if what == "another":
                ice = started(config)
                ice.update()
            else:
                ice.finalize()
                with pytest.raises(InputError):
                    ice.update()
                ice.initialize(str(config))
            ice.load_state(tmp_path / "now.nc")
    calls.append(("steps", 1))
    make(ice, calls[-1])
    other, cut = started(config), started(config)
    swapped = {"steps": "until", "until": "steps"}
    for name, *values in calls:
        make(other, (name, *values))
        make(cut, (swapped.get(name, name), *values))
    assert ice.get_current_time() > 300.0 and len(ice.model.floes) > 20
    assert not differing(everything(ice), everything(other))
    assert not bits_differ(ice.model.state(), other.model.state())
    assert not bits_differ(cut.model.state(), other.model.state())


# ---- Model --------------------------------------------------------------------------------------


def a_model(kind, threads=1):
    domain = Domain((0.0, SIDE), (0.0, SIDE))
    floes = scatter(domain, UniformSize(250, 600), count=20, thickness=1.0, seed=4)
    floes.u[:], floes.v[:] = np.random.default_rng(1).normal(size=(2, 20))
    inflow = Inflow("west", SingleSize(300.0), 1.0, (1.0, 0.0))
    model = Model(
        domain, floes, frictional(), [OceanDrag(), AirDrag()], masked(GRIDS[kind], 2), inflow=inflow,
        seed=5, threads=threads,
    )  # fmt: skip
    model.atmosphere.u[:] = 8.0
    return model


def change(model, call):
    """One of the calls that count."""
    name, *values = call
    floes = model.floes
    if name == "advance":
        model.advance(*values)
    elif name == "add":
        floes.add(*values)
    elif name == "water":
        model.ocean.v = values[0]
    else:
        getattr(floes, name)[values[0]] = values[1]


def a_change(model, rng):
    floes = model.floes
    one, spot = int(rng.integers(len(floes))), rng.uniform(700.0, SIDE - 700.0, 2)
    room = (np.hypot(floes.x - spot[0], floes.y - spot[1]) > floes.radius + 200.0).all()
    calls = [
        ("u", one, float(rng.normal())), ("thickness", one, float(rng.uniform(0.5, 2.0))),
        ("radius", one, 0.9 * floes.radius[one]), ("x", one, floes.x[one] + 1e-3),
        ("motion", one, int(rng.integers(8))), ("active", one, False),
        ("water", rng.normal(size=model.grid.size)),
        ("add", *spot, 150.0, 1.0) if room else ("advance", 5.0),
    ]  # fmt: skip
    calls += [("advance", float(rng.uniform(0.0, 60.0)))] * 8
    return calls[rng.integers(len(calls))]


def an_advance_that_fails(model, rng):
    floes, name = model.floes, str(rng.choice(["u", "x", "radius", "thickness"]))
    one = int(rng.integers(len(floes)))
    values = getattr(floes, name)
    before, values[one] = values[one], np.nan
    with pytest.raises(InputError):
        model.advance(30.0)
    values[one] = before
    moving = np.flatnonzero(floes.active & (floes.motion == 0))
    if len(moving):  # so fast that it would miss others on its way
        before, floes.u[moving[0]] = floes.u[moving[0]], 9e5
        with pytest.raises(StabilityError):
            model.advance(30.0)
        assert model.floes is floes
        floes.u[moving[0]] = before
    with pytest.raises(InputError):
        floes.add(0.0, 0.0, -1.0, 1.0)
    with pytest.raises(InputError):
        model.advance(-1.0)


@pytest.mark.parametrize("kind", some(GRIDS))
def test_what_does_not_count_leaves_no_trace_in_the_model(kind, tmp_path):
    rng = np.random.default_rng(10 + list(GRIDS).index(kind))
    model, calls = a_model(kind), []
    state, saved = model.state(), 0
    for what in rng.choice(STEPS, MANY):
        if what == "counts":
            calls.append(a_change(model, rng))
            change(model, calls[-1])
        elif what == "fails":
            an_advance_that_fails(model, rng)
        elif what == "looks":
            model.fields(), model.contacts(), model.longest_step(), model.coverage(), repr(model)
            if model.counters.steps:
                model.seconds_per_step(3)
        elif what == "save":
            state, saved = model.state(), len(calls)
        elif what == "back":
            model.restore(state)
            del calls[saved:]
        elif what == "copy":
            left, model = model, copy.deepcopy(model)
            left.advance(20.0)
        elif what == "pickle":
            model = pickle.loads(pickle.dumps(model))
        else:
            save_restart(tmp_path / "state.nc", model.state())
            model = a_model(kind, threads=2)
            model.advance(7.0)
            model.restore(load_restart(tmp_path / "state.nc")[0])
    calls.append(("advance", 10.0))
    change(model, calls[-1])
    other = a_model(kind)
    for call in calls:
        change(other, call)
    assert model.time > 250.0 and len(model.floes) > 30
    assert not bits_differ(model.state(), other.state())
    assert not bits_differ(model.fields(), other.fields())
    assert str(model.ledger) == str(other.ledger) and repr(model) == repr(other)
    for quantity in ("mass", "momentum_x", "momentum_y"):
        assert model.ledger.balance(quantity).relative < 1e-12
