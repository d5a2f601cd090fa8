"""The laws beyond the paper's pair laws: bonds that heal and bend, compressive failure, floes that differ.

Most of this is one pair, moved by hand through `pair_force`; two laws are run in whole models.
"""

from typing import NamedTuple

import numpy as np
import pytest
from scipy.integrate import quad

from floebmi.bonds import Beam, Healing, TensileStrength
from floebmi.boundaries import Domain, Inflow
from floebmi.contact import (
    CompressiveFailure,
    Contact,
    Coulomb,
    PairForce,
    Restitution,
    coefficient,
    own,
    pair_force,
    stored,
    strength,
)
from floebmi.dynamics import Step
from floebmi.errors import InputError
from floebmi.explain import explain
from floebmi.floes import FIXED, Floes
from floebmi.geometry import lens
from floebmi.model import Model
from floebmi.restarts import load_restart, save_restart
from floebmi.scene import read_scene
from floebmi.sizes import SingleSize

E, R, STRENGTH = 2.0e7, 10.0, 200e3  # two floes of radius 10 m, 1 m thick: R_ij = 10 m
DT = 1e-3
BEAM = TensileStrength(STRENGTH, beam=Beam(100e3))


class Memory(NamedTuple):
    """What a pair remembers, as `pair_force` takes it."""

    slip: float = 0.0
    bonded: float = 0.0
    damped: float = 0.0
    bent: float = 0.0
    failed: float = 0.0
    slid: float = 0.0


def force(law, gap, rates=(0.0, 0.0, 0.0), memory=Memory(bonded=1.0), h=(1.0, 1.0), dt=DT):
    """The force at a gap that was reached at rates of opening, slip and turn over the time dt."""
    return pair_force(
        law, gap, *rates, R, R, *h, 1.0, coefficient(law.friction), strength(law.bonds), *memory, dt
    )


def drive(law, gap, rates, seconds, memory=Memory(), h=(1.0, 1.0)):
    """Move a pair at constant rates; the gap and the force of each step."""
    for _ in range(round(seconds / DT)):
        gap += rates[0] * DT
        f = force(law, gap, rates, memory, h)
        memory = Memory(*(getattr(f, name) for name in Memory._fields))
        yield gap, f


def last_bonded(law, gap, rates, seconds, memory=Memory()):
    """The last force before the bond is gone, and the first after."""
    before = None
    for _, f in drive(law, gap, rates, seconds, memory):
        if f.bonded <= 0.0:
            return before, f
        before = f
    raise AssertionError("the bond held")


# ---- bonds that heal ------------------------------------------------------------------------------


def test_a_bond_has_the_share_of_its_strength_that_belongs_to_its_age():
    law = Contact(bonds=TensileStrength(STRENGTH, healing=Healing(1e5, 20e3)))
    shares = [f.bonded for _, f in drive(law, -1e-3, (0.0, 0.0, 0.0), 2.5)]
    assert shares[0] == pytest.approx(0.1, abs=0.001)
    assert shares[999] == pytest.approx(0.6, abs=1e-9)
    assert shares[-1] == 1.0
    (_, parted), *_ = drive(law, 0.2, (0.0, 0.0, 0.0), 0.01, Memory(bonded=1.0))
    assert parted.bonded == 0.0


def test_a_young_bond_breaks_at_the_strength_of_its_age_and_goes_on_healing_while_it_is_pulled():
    law = Contact(bonds=TensileStrength(STRENGTH, healing=Healing(1e5)))
    memory = Memory(
        bonded=0.25
    )  # half a second old; E u t/R = λ (0.5 s + t) at t = 0.5 s, at 100 kPa
    before, after = last_bonded(law, 0.0, (0.1, 0.0, 0.0), 2.0, memory)
    assert -before.f_n == pytest.approx(100e3 * R, rel=0.01)
    assert after.f_n == 0.0
    old, _ = last_bonded(
        Contact(bonds=TensileStrength(STRENGTH)), 0.0, (0.1, 0.0, 0.0), 2.0, memory
    )
    assert -old.f_n == pytest.approx(STRENGTH * R, rel=0.01)


# ---- bonds that are beams -------------------------------------------------------------------------


def test_a_beam_breaks_in_tension_at_its_tensile_strength():
    before, after = last_bonded(Contact(bonds=BEAM), -1e-3, (0.1, 0.0, 0.0), 2.0)
    assert -before.f_n == pytest.approx(STRENGTH * R, rel=0.01)
    assert (before.f_t, before.moment, after.f_n) == (0.0, 0.0, 0.0)
    assert after.bond_loss == pytest.approx(0.5 * (STRENGTH * R) ** 2 / E, rel=0.01)


@pytest.mark.parametrize("friction", [None, Coulomb(0.3)])
def test_a_beam_breaks_in_shear_at_its_shear_strength_and_leaves_friction(friction):
    law = Contact(friction=friction, bonds=BEAM)
    before, after = last_bonded(law, -1e-3, (0.0, 0.1, 0.0), 2.0)
    assert -before.f_t == pytest.approx(100e3 * R, rel=0.01)
    assert -after.f_t == pytest.approx(0.3 * E * 1e-3 if friction else 0.0)
    assert after.bonded == -1.0 and after.f_n == pytest.approx(E * 1e-3)
    memory = Memory(bonded=after.bonded)
    (_, still), *_ = drive(law, -1e-3, (0.0, 0.0, 0.0), 0.01, memory)
    (_, apart), *_ = drive(law, 1e-3, (0.0, 0.0, 0.0), 0.01, memory)
    (_, again), *_ = drive(law, -1e-3, (0.0, 0.0, 0.0), 0.01, Memory(bonded=apart.bonded))
    assert (still.bonded, apart.bonded, again.bonded) == (-1.0, 0.0, 1.0)


def test_a_young_beam_resists_shear_with_its_share_of_the_strength():
    law = Contact(bonds=BEAM._replace(healing=Healing(1.0)))
    before, after = last_bonded(law, -1e-3, (0.0, 0.1, 0.0), 2.0, Memory(bonded=0.5))
    assert -before.f_t == pytest.approx(50e3 * R, rel=0.01)
    assert after.bonded == -1.0


def test_a_beam_too_weak_from_the_first_touch_breaks_in_a_step_and_not_between_exchanges():
    """It broke unbooked, and as an edit by the user after a restart."""

    def floes_that_meet_askew():
        floes = Floes([20.0, 40.2], 50.0, R, 1.0, u=[1.0, 0.0], v=[2.0, 0.0])
        weak = TensileStrength(STRENGTH, 0.3, Healing(1.0, STRENGTH), Beam(1e3))
        law = ALL._replace(bonds=weak, failure=CompressiveFailure(1e12))
        return Model(Domain((0.0, 100.0), (0.0, 100.0), *["periodic"] * 4), floes, law)

    model, restarted = floes_that_meet_askew(), floes_that_meet_askew()
    for _ in range(1000):
        if model.counters.bonds_broken:
            break
        restarted.restore(model.state())
        for one in (model, restarted):
            one.step_by(1)
        assert "edits by the user" not in restarted.ledger.accounts
        assert np.array_equal(model.ledger.now, restarted.ledger.now)
    assert model.ledger.accounts["broken bonds"][-1] < 0.0


def test_a_beam_breaks_in_bending_where_its_outer_fibre_has_the_tensile_strength():
    before, after = last_bonded(Contact(bonds=BEAM), -1e-6, (0.0, 0.0, 0.02), 2.0)
    assert before.moment == pytest.approx(STRENGTH * R**2 / 6, rel=0.01)
    assert before.bent == pytest.approx(2 * STRENGTH / E, rel=0.01)
    assert after.moment == after.bent == 0.0


def test_tension_and_bending_add_up_in_the_outer_fibre():
    law = Contact(bonds=BEAM)
    for part in (0.0, 0.3, 0.9):
        gap, bent = part * STRENGTH * R / E, (1 - part) * 2 * STRENGTH / E
        whole = force(law, 0.999 * gap, memory=Memory(bonded=1.0, bent=0.999 * bent))
        broken = force(law, 1.001 * gap, memory=Memory(bonded=1.0, bent=1.001 * bent))
        assert (whole.bonded > 0.0, broken.bonded > 0.0) == (True, False)


@pytest.mark.parametrize("gap", [-0.02, 0.05])
def test_forces_and_moment_of_a_beam_are_minus_the_slopes_of_its_energy(gap):
    law, at, step = Contact(bonds=BEAM), np.array([gap, 0.02, 0.004]), 1e-5

    def energy(gap, slip, bent):
        f = force(law, gap, memory=Memory(slip, 1.0, 0.0, bent))
        return stored(law, f, gap, R, R, 1.0, 1.0)

    slopes = [
        (energy(*(at + step * axis)) - energy(*(at - step * axis))) / (2 * step)
        for axis in np.eye(3)
    ]
    f = force(law, gap, memory=Memory(0.02, 1.0, 0.0, 0.004))
    # f_n and f_t push against gap and slip; the moment on i follows the angle that j has turned
    assert [f.f_n, f.f_t, -f.moment] == pytest.approx([-slope for slope in slopes], rel=1e-7)


# ---- compressive failure --------------------------------------------------------------------------

FAILURE = CompressiveFailure(1.285e6, 0.4, 66.0)


def disc_lens(r, d):
    """Area common to two equal discs, by another formula than the kernel's."""
    return 2 * r**2 * np.arccos(d / (2 * r)) - 0.5 * d * np.sqrt(4 * r**2 - d**2)


def test_the_lens_of_two_discs_is_their_common_area():
    for d in (3.0, 10.0, 19.9):
        assert lens(R, R, d) == pytest.approx(disc_lens(R, d), rel=1e-10)
    assert lens(10.0, 4.0, 5.0) == pytest.approx(16 * np.pi)
    assert lens(10.0, 4.0, 14.0) == 0.0


@pytest.mark.parametrize("friction", [None, Coulomb(0.3)])
def test_the_force_rises_to_the_strength_of_the_ice_and_then_is_that_of_sliding(friction):
    law = Contact(friction=friction, failure=FAILURE)
    way = list(drive(law, 0.0, (-0.5, 0.0, 0.0), 10.0, h=(2.0, 1.5)))
    whole = [f.f_n for _, f in way if not f.failed]
    cap = 1.285e6 * 1.5**1.5
    assert 0.99 * cap < max(whole) <= cap and whole == sorted(whole)
    failed = [(gap, f) for gap, f in way if f.failed]
    assert failed[0][1].failure_loss == pytest.approx(0.5 * cap**2 / (1.5 * E), rel=0.02)
    for gap, f in failed[:: len(failed) // 7]:
        slides = 0.4 * 66.0 * 9.81 * 1.5 * disc_lens(R, 2 * R + gap)
        assert f.f_n == pytest.approx(slides, rel=1e-9)
    bare = list(drive(Contact(friction=friction), 0.0, (-0.5, 0.0, 0.0), 0.5, h=(2.0, 1.5)))
    assert bare[-1][1].f_n > 2 * cap  # without the law nothing gives way


def test_sliding_resists_along_the_motion_whatever_its_direction():
    law, memory = Contact(failure=FAILURE), Memory(failed=1.0)
    for opening, slip_rate in ((-0.3, 0.4), (0.3, 0.4), (0.2, -0.2)):
        *_, (gap, f) = drive(law, -5.0, (opening, slip_rate, 0.0), 1.0, memory)
        memory = Memory(f.slip, 0.0, 0.0, 0.0, f.failed, f.slid)
        slides = 0.4 * 66.0 * 9.81 * disc_lens(R, 2 * R + gap)
        expected = -slides * np.array([opening, slip_rate]) / np.hypot(opening, slip_rate)
        assert [f.f_n, f.f_t] == pytest.approx(expected, rel=1e-2)


def test_failed_ice_has_lost_its_bond_and_is_whole_again_once_the_floes_have_parted():
    law = Contact(bonds=TensileStrength(STRENGTH), failure=FAILURE)
    *_, (gap, f) = drive(law, 0.0, (-0.5, 0.0, 0.0), 1.0)
    assert (f.failed, f.bonded) == (1.0, 0.0)
    memory = Memory(f.slip, 0.0, 0.0, 0.0, f.failed, f.slid)
    *_, (gap, f) = drive(law, gap, (0.5, 0.0, 0.0), 1.01, memory)
    assert gap > 0 and (f.failed, f.slid, f.f_n) == (0.0, 0.0, 0.0)
    (_, f), *_ = drive(law, -1e-3, (0.0, 0.0, 0.0), 0.01)
    assert f.bonded == 1.0 and f.f_n == pytest.approx(E * 1e-3)


ALL = Contact(
    friction=Coulomb(0.3, spread=0.2),
    bonds=TensileStrength(100e3, 0.3, Healing(4e4, 60e3), Beam(60e3)),
    failure=CompressiveFailure(1e5),
)
FLAT = Contact(  # what needs no rotation
    bonds=TensileStrength(100e3, 0.3, Healing(4e4)), failure=CompressiveFailure(2e5)
)


@pytest.mark.parametrize("law", [ALL, FLAT])
def test_what_a_pair_takes_from_the_motion_is_stored_or_lost(law):
    rng, memory, gap = np.random.default_rng(5), Memory(), 1e-3
    before = PairForce(*[0.0] * len(PairForce._fields))
    taken, losses, kept = 0.0, np.zeros(3), 0.0
    for k in range(20_000):
        if k % 20 == 0:
            rates = rng.normal(0, (0.5, 0.5, 0.05)) - (0.3 * np.sign(gap), 0.0, 0.0)
        gap += rates[0] * DT
        f = force(law, gap, rates, memory)
        for name, rate in zip(("f_n", "f_t", "moment"), rates, strict=True):
            sign = 1.0 if name == "moment" else -1.0
            taken += sign * 0.5 * DT * rate * (getattr(before, name) + getattr(f, name))
        taken -= f.blow_n * rates[0] + f.blow_t * rates[1]
        losses += f.friction_loss, f.bond_loss, f.failure_loss
        kept = stored(law, f, gap, R, R, 1.0, 1.0) if gap < 0 or f.bonded > 0 else 0.0
        memory, before = Memory(*(getattr(f, name) for name in Memory._fields)), f
    assert (losses[0 if law is ALL else 1 :] > 0).all()
    assert taken == pytest.approx(losses.sum() + kept, rel=1e-9)


# ---- floes that differ ----------------------------------------------------------------------------

OPEN = Domain((-200.0, 200.0), (-200.0, 200.0))


def row_of_floes(n=4):
    return Floes(np.arange(n) * 30.0 - 100.0, 0.0, R, 1.0)


@pytest.mark.long
def test_own_values_have_the_laws_mean_and_spread_and_come_from_the_seed():
    law = Contact(bonds=TensileStrength(STRENGTH, 0.5, Healing(1e5)), failure=FAILURE)
    line = Domain((0.0, 1e6), (-1e3, 1e3))

    def draw(seed):
        floes = Floes(np.arange(20_000) * 30.0, 0.0, R, 1.0)
        Model(line, floes, contact=law, seed=seed)
        return floes.tensile_strength

    values = draw(1)
    assert values.mean() == pytest.approx(STRENGTH, rel=0.02)
    assert values.std() == pytest.approx(0.5 * STRENGTH, rel=0.05)
    assert np.log(values).std() == pytest.approx(np.sqrt(np.log1p(0.25)), rel=0.03)
    assert np.array_equal(draw(1), values) and not np.array_equal(draw(2), values)


@pytest.mark.long
def test_a_pair_is_as_strong_as_its_weaker_floe():
    def breaks_at(*strengths):
        floes = Floes([0.0, 19.999], 0.0, R, 1.0, motion=FIXED)
        law = Contact(bonds=TensileStrength(STRENGTH, 0.5, Healing(1e9)), failure=FAILURE)
        model = Model(OPEN, floes, contact=law, step=Step(length=5e-3))
        floes.tensile_strength = strengths
        floes.u[1] = 0.1
        largest = 0.0
        while len(model.contacts().i):
            largest = max(largest, float(model.contacts().fx[0]))
            model.advance(0.005)
        return largest

    assert breaks_at(100e3, 300e3) == pytest.approx(100e3 * R, rel=0.02)
    assert breaks_at(300e3, 100e3) == pytest.approx(100e3 * R, rel=0.02)
    assert breaks_at(300e3, 300e3) == pytest.approx(300e3 * R, rel=0.02)


def test_floes_are_alike_and_have_no_arrays_unless_a_spread_is_listed():
    assert own(Contact(friction=Coulomb(), bonds=TensileStrength())) == {}
    floes = row_of_floes()
    assert floes.friction is floes.tensile_strength is None
    with pytest.raises(InputError, match="list a spread"):
        floes.friction = 0.2


@pytest.mark.long
def test_added_floes_draw_their_own_values_and_those_of_another_model_are_refused():
    floes = row_of_floes()
    inflow = Inflow("north", SingleSize(R), velocity=(0.0, -1.0))
    model = Model(OPEN, floes, contact=FLAT, inflow=inflow)
    before = floes.tensile_strength.copy()
    floes.add(0.0, 100.0, R, 1.0)
    model.advance(1.0)
    assert len(floes) > 10 and np.array_equal(floes.tensile_strength[:4], before)
    assert len(np.unique(floes.tensile_strength)) == len(floes)
    both = Floes.concatenate([floes, row_of_floes(2)])
    assert np.isnan(both.tensile_strength[-2:]).all()
    with pytest.raises(InputError, match=r"floes.tensile_strength: .* lists no spread"):
        Model(OPEN, floes, contact=Contact())
    floes.tensile_strength[2] = -1.0
    with pytest.raises(InputError, match="floe 2: tensile_strength = -1.0 Pa; must be at least 0"):
        model.advance(1.0)


# ---- whole models ---------------------------------------------------------------------------------


@pytest.mark.long
def test_a_floe_slides_over_another_until_friction_has_used_up_its_energy():
    floes = Floes([0.0, 20.0], 0.0, R, 1.0, u=[0.0, -0.5], motion=[FIXED, 0])
    law = FLAT._replace(bonds=TensileStrength(0.0, 0.3, Healing(1.0)))
    model = Model(OPEN, floes, contact=law, step=Step(length=1e-3))  # resolves the failure too
    assert floes.angle is None
    model.advance(60.0)
    kinetic = 0.5 * floes.mass(934.0)[1] * 0.25
    slides = 0.3 * 66.0 * 9.81
    begin = 20.0 - 2e5 / E
    used = quad(lambda d: slides * disc_lens(R, d), floes.x[1], begin)[0] + 0.5 * 2e5**2 / E
    assert abs(floes.u[1]) < 0.01 and 5.0 < floes.x[1] < 18.0
    assert used == pytest.approx(kinetic, rel=0.01)
    assert (
        model.ledger.accounts["friction"][3] < 0 > model.ledger.accounts["compressive failure"][3]
    )
    assert model.ledger.balance("energy").relative < 1e-3


def turning_pair(spin):
    """Bonded floes that turn about their common centre at 0.01 rad/s, and about their own at `spin`."""
    period = Domain((-200.0, 200.0), (-200.0, 200.0), *["periodic"] * 4)
    floes = Floes([-9.99, 9.99], 0.0, R, 1.0, v=[-0.0999, 0.0999], rotation=True)
    floes.angular_velocity = spin
    strong = TensileStrength(2e6, 0.1, Healing(1e12), Beam(1e9))
    law = ALL._replace(bonds=strong, failure=CompressiveFailure(1e12))
    model = Model(period, floes, contact=law)
    angular = []
    for _ in range(2):
        mass, inertia = floes.mass(934.0), floes.moment_of_inertia(934.0)
        orbit = mass * (floes.x * floes.v - floes.y * floes.u)
        angular.append(float((orbit + inertia * floes.angular_velocity).sum()))
        model.advance(2.0)
    return np.abs(model.state()["pair_bent"]).max(), angular


@pytest.mark.long
def test_a_bonded_pair_that_turns_as_a_whole_is_not_bent_and_keeps_its_angular_momentum():
    bent, (before, after) = turning_pair(0.01)
    assert bent < 1e-9
    assert after == pytest.approx(before, rel=1e-12)
    bent, (before, after) = turning_pair([0.01, 0.0])
    assert bent > 1e-5
    assert after == pytest.approx(before, rel=1e-12)


def jostle(contact, seed=0, order=None):
    rng = np.random.default_rng(seed)
    x, y = (a.ravel() for a in np.meshgrid(np.arange(8) * 2.0 + 1, np.arange(8) * 2.0 + 1))
    floes = Floes(x, y, rng.uniform(0.9, 1.01, 64), 1.0)
    floes.u[:], floes.v[:] = rng.normal(0, 0.3, (2, 64))
    order = np.arange(64) if order is None else order
    names = ("x", "y", "radius", "thickness", "u", "v")
    floes = Floes(*(getattr(floes, name)[order] for name in names))
    for name, (mean, spread) in own(contact).items():  # given, the model does not draw them
        floes.allow_own(name)
        setattr(floes, name, mean * (1 + spread * rng.uniform(-1, 1, 64))[order])
    domain = Domain((0, 16.0), (0, 16.0), *["periodic"] * 4)
    return Model(domain, floes, contact=contact)


def test_a_restart_in_mid_contact_gives_the_same_bits(tmp_path):
    first = jostle(ALL)
    first.advance(0.5)
    state = first.state()
    save_restart(tmp_path / "restart.nc", state, {})
    for name in ("pair_slip", "pair_bonded", "pair_bent", "pair_failed", "pair_slid"):
        assert np.count_nonzero(state[name]) > 1, name
    first.advance(1.0)
    second = jostle(ALL, seed=9)
    second.restore(load_restart(tmp_path / "restart.nc")[0])
    second.advance(1.0)
    for name in ("x", "y", "u", "v", "angle", "angular_velocity", "friction", "tensile_strength"):
        assert np.array_equal(getattr(first.floes, name), getattr(second.floes, name)), name
    assert np.array_equal(first.ledger.now, second.ledger.now)
    for name in ("bonded", "bent", "failed", "slid"):  # each of them matters
        second.restore(state | {f"pair_{name}": 0.0 * state[f"pair_{name}"]})
        second.advance(1.0)
        assert not np.array_equal(first.floes.x, second.floes.x), name


def test_the_order_of_the_floes_does_not_matter():
    order = np.random.default_rng(3).permutation(64)
    models = [jostle(ALL), jostle(ALL, order=order)]
    for name in ("friction", "tensile_strength"):
        values = [getattr(model.floes, name) for model in models]
        assert np.array_equal(values[1], values[0][order])
    for model in models:
        model.advance(0.5)
    assert models[0].counters.bonds_broken > 5
    assert models[1].floes.x == pytest.approx(models[0].floes.x[order], abs=1e-9)


def test_the_energy_of_a_pack_goes_where_the_ledger_says():
    model = jostle(ALL)
    model.advance(3.0)
    balance, lost = model.ledger.balance("energy"), model.ledger.accounts
    lost = [lost[name][3] for name in ("friction", "broken bonds", "compressive failure")]
    assert max(lost) < 0
    assert abs(balance.residual) < 0.01 * balance.start < 0.2 * -sum(lost)
    for momentum in ("momentum_x", "momentum_y"):
        assert abs(model.ledger.balance(momentum).residual) < 1e-9 * model.floes.mass(934.0).sum()


@pytest.mark.long
@pytest.mark.parametrize(
    "law",
    [
        Contact(bonds=ALL.bonds._replace(healing=None)),
        Contact(bonds=ALL.bonds._replace(spread=None, healing=None), friction=Coulomb()),
        ALL._replace(dashpot=Restitution(0.5)),
        Contact(failure=ALL.failure),
        FLAT,
    ],
)
def test_the_energy_of_a_pack_goes_where_the_ledger_says_with_each_law(law):
    model = jostle(law)
    model.advance(3.0)
    balance = model.ledger.balance("energy")
    assert abs(balance.residual) < 0.01 * balance.start


@pytest.mark.parametrize(
    "law, message",
    [
        (TensileStrength(1e5, healing=Healing(0.0)), r"Healing.rate = 0.0: must be greater than 0"),
        (
            TensileStrength(1e5, healing=Healing(1.0, 2e5)),
            "contact.bonds.healing.initial = 200000.0: must be at",
        ),
        (TensileStrength(1e5, beam=Beam(-1.0)), "Beam.shear_strength = -1.0"),
        (
            TensileStrength(1e5, beam=Beam(1e5, 0.3)),
            "contact.bonds.beam.poisson_ratio = 0.3: must be that of",
        ),
        (TensileStrength(1e5, spread=0.0), "TensileStrength.spread = 0.0"),
    ],
)
def test_a_law_within_a_law_is_refused_by_name(law, message):
    with pytest.raises(InputError, match=message):
        Model(OPEN, row_of_floes(), contact=Contact(friction=Coulomb(), bonds=law))


SCENE = """
domain = {x = [0.0, 100.0], y = [0.0, 100.0], edges = "periodic"}
floes = {arrangement = "regular", radius = 8.0, spacing = 20.0, lattice = "square"}
[contact.friction]
spread = 0.1
[contact.bonds]
tensile_strength = 2e5
spread = 0.3
healing = {rate = 1e3}
beam = {shear_strength = 1e5}
[contact.failure]
toughness = 1e6
"""


def test_a_scene_lists_them_and_explain_names_them(tmp_path):
    (tmp_path / "scene.toml").write_text(SCENE)
    scene = read_scene(tmp_path / "scene.toml")
    law = scene.contact_law()
    assert law.friction == Coulomb(spread=0.1)
    assert law.bonds == TensileStrength(2e5, 0.3, Healing(1e3), Beam(1e5))
    assert law.failure == CompressiveFailure(1e6)
    built = scene.build()
    text = explain(scene, built)
    for part in ("spread 0.3", "healing (rate 1000", "beam (shear", "CompressiveFailure", "toughn"):
        assert part in text
    assert "healing=Healing(rate=1000.0, initial=0.0)" in repr(built.model)
    assert "compressive failure" not in text.partition("left out")[2]
