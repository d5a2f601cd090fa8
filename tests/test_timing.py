"""What contacts, other forces and motion take of a step is timed by leaving each out; the model stays as it is."""

import math

import numpy as np
import pytest

from floebmi.boundaries import Domain
from floebmi.contact import Contact, Coulomb, TensileStrength, frictional
from floebmi.dynamics import Step
from floebmi.errors import InputError
from floebmi.floes import Floes
from floebmi.forces import AirDrag, Coriolis, OceanDrag, X, lanes
from floebmi.model import Model
from floebmi.timing import shares_of_a_step


def pack(edge="inactive", contact=frictional(), forces=(OceanDrag(),), **scene):
    """Floes that press on each other, in a current, after their first steps."""
    x, y = (a.ravel() for a in np.meshgrid(np.arange(12) * 2.0 + 1, np.arange(12) * 2.0 + 1))
    u, v = np.random.default_rng(0).normal(0, 0.1, (2, 144))
    floes = Floes(x, y, 1.002, 1.0, u=u, v=v)
    domain = Domain((0, 24), (0, 24), edge, edge, edge, edge)
    model = Model(domain, floes, contact=contact, forces=forces, **scene)
    if model.ocean is not None:
        model.ocean.u[:] = 0.5
    model.advance(0.01)
    return model


@pytest.mark.parametrize("without", [None, "contacts", "forces"])
def test_a_part_that_is_left_out_does_nothing(without):
    model = pack()
    advance, _ = model._ready(model._known())
    assert advance.seconds_per_step(model._at, 8, without) > 0.0
    assert (advance.packed.force["x"] != 0.0).any() == (without != "contacts")
    assert (lanes(model._at[0], X) != 0.0).any() == (without != "forces")


def test_the_model_stays_as_it_is_to_the_bit(monkeypatch):
    monkeypatch.setattr("floebmi.timing.LEAST_SECONDS", 0.0)
    timed, other = pack(), pack()
    shares = shares_of_a_step(timed)
    assert list(shares) == ["contacts", "forces", "motion"]
    assert math.isclose(sum(shares.values()), 1.0)
    for _ in range(2):
        one, same = timed.state(), other.state()
        assert [name for name in one if not np.array_equal(one[name], same[name])] == []
        for model in (timed, other):
            model.advance(0.01)


def test_parts_that_a_model_does_not_have_are_not_told(monkeypatch):
    monkeypatch.setattr("floebmi.timing.LEAST_SECONDS", 0.0)
    paper = pack(
        "periodic",
        Contact(friction=Coulomb(), bonds=TensileStrength(50e3)),
        (OceanDrag(), AirDrag(), Coriolis(1e-4)),
        step=Step(scheme="taylor3"),
    )
    assert list(shares_of_a_step(paper)) == ["contacts", "motion"]
    assert list(shares_of_a_step(pack(contact=Contact(), forces=()))) == ["contacts", "motion"]
    lone = Model(Domain((0, 24), (0, 24)), Floes(5.0, 5.0, 2.0, 1.0), forces=[OceanDrag()])
    assert shares_of_a_step(lone) == {}
    with pytest.raises(InputError, match="no step was taken yet"):
        lone.seconds_per_step(10)
    lone.advance(10.0)
    assert list(shares_of_a_step(lone)) == ["forces", "motion"]


def test_no_share_is_negative_however_noisy_the_machine(monkeypatch):
    monkeypatch.setattr("floebmi.timing.LEAST_SECONDS", 0.0)
    model = pack()
    for seconds, shares in (
        ({None: 1.0, "contacts": 1.3, "forces": 0.5}, [0.0, 0.5, 0.5]),
        ({None: 1.0, "contacts": 0.1, "forces": 0.4}, [0.6, 0.4, 0.0]),
    ):
        monkeypatch.setattr(Model, "seconds_per_step", lambda *a, of=seconds: of[a[-1]])
        assert list(shares_of_a_step(model).values()) == pytest.approx(shares)


def test_a_step_without_floes_has_no_parts():
    model = Model(Domain((0, 24), (0, 24)), Floes([], [], [], []), forces=[OceanDrag()])
    model.advance(10.0)
    assert model.counters.steps and shares_of_a_step(model) == {}
