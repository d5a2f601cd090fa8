"""Laws from outside the package: their code is run, in all its versions, and none is passed over in silence."""

import os
import subprocess
import sys
from typing import NamedTuple, get_args, get_type_hints

import numpy as np
import pytest
from test_laws import BEAM, Memory, drive, force
from test_pages import ROOT

from floebmi import forces as package
from floebmi.bonds import TensileStrength
from floebmi.boundaries import Domain
from floebmi.contact import (
    Contact,
    Coulomb,
    coefficient_now,
)
from floebmi.errors import InputError
from floebmi.explain import table_of_force
from floebmi.floes import Floes
from floebmi.forces import (
    ACCOUNTS,
    FLUID_U,
    RATE,
    READS,
    BodyForce,
    Force,
    OceanDrag,
    Push,
    acceleration,
    add_fastest_rate,
    at_floes,
    by_block,
    each_floe,
    lanes,
    row,
    speed_bound,
)
from floebmi.kernels import BLOCK
from floebmi.model import Model
from floebmi.scene import Scene
from floebmi.scene_physics import _FRICTIONS

OPEN = Domain((-200.0, 200.0), (-200.0, 200.0))


def floes():
    return Floes([0.0, 100.0], 0.0, [10.0, 20.0], [1.0, 2.0])


# ---- code that was edited --------------------------------------------------------------------------

FILE = """
from typing import NamedTuple
from floebmi.forces import Push, acceleration
from floebmi.kernels import inner
from further import LENGTH, half

class Wave(NamedTuple):
    stress: float

@acceleration.register
def _(force: Wave, at, k, u, v):
    print("pushed by", force.stress)
    return Push(TIMES * half(force.stress) / LENGTH, 0.0, 0.0, 0.0, 0.0, 0.0)
"""
FURTHER = """
from floebmi.kernels import inner
LENGTH = 1.0

@inner
def half(x):
    return 0.5 * x
"""
SCRIPT = """
import numpy as np
from floebmi.forces import WORK, _largest_push
from floebmi.forces import BodyForce
from floebmi.kernels import BLOCK
LAW
print(_largest_push(law, np.zeros((1, (WORK + 1) * BLOCK))), sum(_largest_push.stats.cache_hits.values()))
"""


@pytest.mark.long
def test_a_law_in_a_file_that_was_edited_is_compiled_anew(tmp_path):
    """Kernels on disk were found by the package's sources alone: the law went on as it had been."""
    told = {"FLOEBMI_CACHE": str(tmp_path), "PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])}  # fmt: skip

    def push(times, further=FURTHER, law="from wave import Wave; law = Wave(2.0)"):
        (tmp_path / "wave.py").write_text(FILE.replace("TIMES", times), "utf-8")
        (tmp_path / "further.py").write_text(further, "utf-8")
        words = [sys.executable, "-B", "-c", SCRIPT.replace("LAW", law)]
        done = subprocess.run(words, env=os.environ | told, capture_output=True, text=True, timeout=300)  # fmt: skip
        assert done.returncode == 0, done.stderr
        *printed, last = done.stdout.splitlines()
        assert set(printed) == ({"pushed by 2.0"} if "Wave" in law else set())
        value, hits = last.split()
        return float(value), int(hits)

    assert push("1.0") == (1.0, 0)
    assert push("3.0") == (3.0, 0)
    assert push("1.0") == (1.0, 1)  # and is still on disk
    assert push("1.0", FURTHER.replace("0.5 *", "0.25 *")) == (0.5, 0)
    assert push("1.0", FURTHER.replace("LENGTH = 1.0", "LENGTH = 4.0")) == (0.25, 0)
    # a run without it, where its file is not found, does not stumble over it: it did
    told["PYTHONPATH"] = str(ROOT)
    assert push("1.0", law="law = BodyForce(7.0)") == (7.0, 0)


def test_code_for_a_law_that_has_some_is_refused_until_the_law_is_defined_anew():
    class Rough(NamedTuple):
        coefficient: float = 0.5

    @coefficient_now.register
    def _(friction: Rough, mu, slip_rate):
        return mu

    with pytest.raises(InputError, match="coefficient_now: .* code for Rough already.* Rough anew"):

        @coefficient_now.register
        def _(friction: Rough, mu, slip_rate):
            return 2 * mu


def test_code_for_a_law_that_kernels_are_compiled_with_is_refused():
    class Late(NamedTuple):
        density: float = 1.0

    ACCOUNTS[Late] = "late"
    try:

        @acceleration.register
        def _(force: Late, at, k, u, v):
            return Push(1.0, 0.0, 0.0, 0.0, 0.0, 0.0)

        class Later(Late):
            """Has the code of `Late` so far."""

        package._largest_push(Later(), np.zeros((1, 3 * BLOCK)))
        with pytest.raises(InputError, match="acceleration: kernels have code for Later already"):
            acceleration.register(code_of(Later))
    finally:
        del ACCOUNTS[Late]


def code_of(kind):
    def code(force, at, k, u, v):
        return Push(2.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    code.__annotations__["force"] = kind
    return code


# ---- laws without code -------------------------------------------------------------------------------


class Hertz(NamedTuple):
    youngs_modulus: float = 2e7


class Smooth(NamedTuple):
    coefficient: float = 0.3
    poisson_ratio: float = 0.185


class Nothing(NamedTuple):
    x: float = 1.0


@pytest.mark.parametrize(
    "law, said",
    [
        (Contact(Hertz()), "Contact.elastic = Hertz.*: must be of the kind Elastic; .* linear spring"),
        (Contact(friction=Smooth()), "Contact.friction = Smooth.*: no code is registered"),
        (Contact(dashpot=Nothing()), "Contact.dashpot = Nothing.*: no code is registered"),
        (Contact(failure=Nothing()), "Contact.failure = Nothing.*: no code is registered"),
        (Contact(bonds=TensileStrength(healing=Nothing())), "TensileStrength.healing = Nothing.*: no code"),
    ],
)  # fmt: skip
def test_a_part_of_contact_that_has_no_code_is_refused(law, said):
    """A spring of another kind, and friction, went on as the package's own, whose place they take."""
    with pytest.raises(InputError, match=said):
        Model(OPEN, floes(), contact=law)


def test_a_force_without_an_acceleration_is_refused():
    ACCOUNTS[Nothing] = "nothing"
    try:
        with pytest.raises(InputError, match="Nothing.* has no acceleration; register one"):
            Model(OPEN, floes(), forces=[Nothing()])
    finally:
        del ACCOUNTS[Nothing]


# ---- friction ----------------------------------------------------------------------------------------


class Weakening(NamedTuple):
    coefficient: float = 0.6
    fast: float = 0.1
    speed: float = 0.05
    poisson_ratio: float = 0.185


@coefficient_now.register
def _(friction: Weakening, mu, slip_rate):
    return friction.fast + (mu - friction.fast) / (1.0 + abs(slip_rate) / friction.speed)


BROKEN = Memory(bonded=-1.0)  # a beam that lies broken between floes


@pytest.mark.parametrize("bonds, memory", [(None, Memory()), (BEAM, BROKEN)])
def test_friction_of_ones_own_falls_with_the_rate_of_slip_also_where_bonds_are_beams(bonds, memory):
    law = Contact(friction=Weakening(), bonds=bonds)
    for rate in (0.01, 0.05, 1.0):
        *_, (_, f) = drive(law, -1e-3, (0.0, rate, 0.0), 3.0 / rate * 1e-2, memory)
        mu = 0.1 + 0.5 / (1.0 + rate / 0.05)
        assert -f.f_t == pytest.approx(mu * f.f_n, rel=1e-12)
    coulomb = Contact(friction=Coulomb(0.6), bonds=bonds)
    *_, (_, f) = drive(coulomb, -1e-3, (0.0, 1.0, 0.0), 0.03, memory)
    assert -f.f_t == pytest.approx(0.6 * f.f_n, rel=1e-12)


def test_a_look_at_the_forces_lets_no_slip_go():
    law, slip = Contact(friction=Weakening()), 4e-4
    f = force(law, -1e-3, (0.0, 5.0, 0.0), Memory(slip=slip), dt=0.0)
    assert f.slip == slip and f.friction_loss == 0.0


def test_what_friction_of_ones_own_takes_is_its_loss_or_stored():
    law, taken, lost, before, memory = Contact(friction=Weakening()), 0.0, 0.0, 0.0, Memory()
    rates = np.repeat(np.random.default_rng(1).normal(0.0, 0.2, 100), 20)
    for rate in rates:
        f = force(law, -1e-2, (0.0, rate, 0.0), memory)
        taken -= 0.5e-3 * rate * (before + f.f_t)
        lost += f.friction_loss
        memory, before = Memory(f.slip), f.f_t
    stored = 0.5 * before**2 / (2.0e7 * package_ratio())
    assert lost > 0 and taken == pytest.approx(lost + stored, rel=1e-12)


def package_ratio():
    nu = 0.185
    return 2 * (1 - nu**2) / ((2 - nu) * (1 + nu))


# ---- forces ------------------------------------------------------------------------------------------


class Waves(NamedTuple):
    """Waves on the ice, and a wind of their own that grows with the floe's speed."""

    rate: float = 0.0


@each_floe.register
def _(force: Waves, radius, thickness, draft, mass_per_area):
    return (1.0 / mass_per_area,)


@acceleration.register
def _(force: Waves, at, k, u, v):
    return Push(row(at, RATE, k) * row(at, FLUID_U, k), -force.rate * v, 0.0, 0.0, 0.0, -force.rate)


@pytest.fixture
def waves():
    ACCOUNTS[Waves], READS[Waves] = "waves", ("ocean", {"wave_x": FLUID_U})
    yield Waves
    del ACCOUNTS[Waves], READS[Waves]


@pytest.mark.long
def test_a_force_of_ones_own_reads_a_field_of_its_own_at_each_floe(waves):
    def begin(v=0.0):
        model = Model(OPEN, Floes([0.0, 100.0], 0.0, 10.0, [1.0, 2.0], v=v), forces=[Waves(0.5)])
        model.ocean.fields["wave_x"][:] = 0.934
        return model

    model = begin(v=1.0)
    assert "waves" not in model.absent() and "waves" in Model(OPEN, floes()).absent()
    model.advance(10.0)
    assert model.floes.u == pytest.approx([1e-2, 5e-3], rel=1e-12)
    # in steps that its rate asks for; in one of all ten seconds they would have turned round
    assert (model.floes.v > 0.0).all() and model.floes.v == pytest.approx(np.exp(-5.0), rel=0.5)
    assert model.ledger.balance("momentum_x").relative < 1e-15
    assert model.ledger.accounts["waves"][1] > 0
    other = begin()
    with pytest.raises(InputError, match="ocean_wave_x"):
        Model(OPEN, floes(), forces=[BodyForce()]).restore(model.state())
    other.ocean.fields["wave_x"][:] = 0.0
    other.restore(model.state())
    assert (other.ocean.fields["wave_x"] == 0.934).all()
    other.ocean.fields["wave_x"][0] = np.nan
    with pytest.raises(InputError, match=r"ocean\.wave_x: nan in wet cell 0"):
        other.advance(1.0)


def test_the_bounds_of_a_force_of_ones_own_follow_from_its_acceleration(waves):
    some = floes()
    table = by_block(
        at_floes(Waves(0.3), some.radius, some.thickness, 0.9, 934.0, False, some.land),
        np.arange(2),
    )
    lanes(table, FLUID_U)[0, :2] = 93.4
    water = OceanDrag()
    at = at_floes(water, some.radius, some.thickness, 0.9 * some.thickness, 934.0, False, some.land)
    tables = by_block(at, np.arange(2)), table
    drift = np.sqrt(0.1 / at[RATE].min())  # 93.4 Pa on the thinner floe
    assert speed_bound((water, Waves(0.3)), tables, 0.0) == pytest.approx(drift)
    rate = np.full((len(table), BLOCK), 0.25)
    add_fastest_rate(Waves(0.3), table, 1.0, 0.0, rate)
    assert rate[0, :2] == pytest.approx(0.55)


# ---- laws of the package ------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", get_args(Force))
def test_no_place_of_a_force_is_forgotten(kind):
    assert kind in ACCOUNTS and kind in acceleration.registry
    assert table_of_force(kind) in Scene.model_fields


def test_a_scene_may_name_every_kind_of_friction():
    assert set(_FRICTIONS.values()) == {
        one for one in get_args(get_type_hints(Contact)["friction"]) if hasattr(one, "_fields")
    }
