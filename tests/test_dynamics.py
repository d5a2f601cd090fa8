"""Steps: the reference numbers, orders of convergence, stability, conservation."""

from types import SimpleNamespace

import numpy as np
import pytest
from uncompiled import uncompiled

from floebmi import listing
from floebmi.boundaries import Domain, Wall
from floebmi.contact import Contact, Coulomb, Damsgaard2018Coulomb, frictional
from floebmi.dynamics import Marked, Step, strayed, time_left_to_push, time_to_push
from floebmi.errors import InputError, StabilityError
from floebmi.floes import FIXED, FIXED_X, FIXED_Y, Floes
from floebmi.forces import AirDrag, BodyForce, Coriolis, OceanDrag
from floebmi.model import Model
from floebmi.pack import FLOE, FORCE_AND_TORQUE
from floebmi.packing import relax, scatter
from floebmi.sizes import UniformSize
from floebmi.stable_step import stable_step
from floebmi.taylor import hold_taylor_spin, taylor_spin

DOMAIN = Domain((-500.0, 500.0), (-500.0, 500.0))
PAPER = Step("taylor3", epsilon=0.07)


@pytest.mark.parametrize("others", [0, 100])
def test_two_floes_collide_as_in_the_reference_code_whatever_else_is_there(others):
    away = 5.0 + np.arange(others)
    x, u = np.concatenate([[0.0, 0.5], away]), np.concatenate([[1.0, 0.0], 0.0 * away])
    floes = Floes(x, 0.0, 0.1, 0.05, u=u)
    model = Model(DOMAIN, floes, contact=Contact(), step=PAPER)
    assert model.longest_step() == pytest.approx(8.478741928617433e-5, rel=1e-12)
    model.advance(1.0)
    assert model.ledger.start[3] == pytest.approx(0.7335618846, rel=1e-9)
    assert model.ledger.now[3] == pytest.approx(0.7334506348, rel=1e-9)
    assert floes.u[:2] == pytest.approx([7.58343e-5, 0.999924], rel=1e-5)


def test_a_floe_bounces_off_a_fixed_one_as_in_the_reference_code():
    floes = Floes([0.0, 20.05], 0.0, 10.0, 1.0, u=[0.1, 0.0], motion=[0, FIXED])
    Model(DOMAIN, floes, contact=Contact(), step=PAPER).advance(10.0)
    assert floes.u[0] == pytest.approx(-0.1000489775, rel=1e-8)


def test_what_holds_a_floe_takes_up_its_share_of_the_change_of_forces_in_the_papers_scheme():
    floes = Floes([0.0, 20.05], 0.0, 10.0, 1.0, u=[0.1, 0.0], motion=[0, FIXED])
    model = Model(DOMAIN, floes, contact=Contact(), step=PAPER)
    model.advance(0.6)
    assert model.contacts().fx.size == 1
    assert model.ledger.balance("momentum_x").relative < 1e-12


def test_a_floe_that_leaves_in_contact_does_not_take_momentum_that_is_not_its_own():
    floes = Floes([480.38, 499.98], 0.0, 10.0, 1.0, u=[2.0, 2.0])
    model = Model(DOMAIN, floes, contact=Contact(), step=PAPER)
    model.advance(0.015)
    assert model.contacts().fx.size == 1 and floes.x[1] > 500.0
    model.advance(0.015)
    assert floes.active.tolist() == [True, False]
    assert model.ledger.balance("momentum_x").relative < 1e-12


def test_a_floe_that_leaves_in_contact_takes_the_energy_of_the_contact():
    floes = Floes([480.38, 499.98], 0.0, 10.0, 1.0, u=[2.0, 2.0])
    model = Model(DOMAIN, floes, contact=Contact(), step=Step(fraction=0.03))
    model.advance(0.015)
    model.advance(0.015)
    assert floes.active.tolist() == [True, False]
    assert model.ledger.balance("energy").relative < 1e-3


def test_counters_count_the_floes_that_are_there_their_pairs_and_all_steps():
    floes = Floes([0.0, 20.1, 400.0], 0.0, 10.0, 1.0)
    floes.active[2] = False
    model = Model(DOMAIN, floes, contact=Contact(), step=Step(fraction=0.03))
    long = model.longest_step()
    for duration, steps in ((0.5 * long, 1), (5 * long, 5), (0.75 * long, 1)):
        before = model.counters.steps
        model.advance(duration)
        assert model.counters.steps - before == steps
    counters = model.counters
    assert (counters.steps, counters.floe_steps, counters.pairs) == (7, 14, 7)
    # each floe looks at both
    assert (counters.rebuilds, counters.tested, counters.listed) == (1, 4, 1)
    assert counters.shortest_step == pytest.approx(0.5 * long)
    assert counters.longest_step == pytest.approx(long)


@pytest.mark.parametrize("step", [Step(fraction=0.03), PAPER])
def test_an_oblique_collision_follows_elastic_theory(step):
    floes = Floes([0.0, 19.0], [10.0, 0.0], 10.0, 1.0, u=[0.1, 0.0], motion=[0, FIXED])
    Model(DOMAIN, floes, contact=Contact(), step=step).advance(30.0)
    # of rigid floes: the line of centres at impact has sin = 10/20; ours are a little soft
    assert (floes.u[0], floes.v[0]) == pytest.approx((-0.05, 0.05 * np.sqrt(3)), rel=2e-3)


def collision_error(law, fraction):
    """Largest share of energy that appears or vanishes in two dozen collisions, each met at another phase."""
    rng, errors = np.random.default_rng(0), []
    for _ in range(24):
        across, gap = rng.uniform(0, 15), rng.uniform(0, 0.2)
        floes = Floes(
            [0.0, np.sqrt(400 - across**2) + gap], [0.0, across], 10.0, 1.0, u=[0.1, -0.05], v=[0, 0.02]
        )  # fmt: skip
        model = Model(DOMAIN, floes, contact=law, step=Step(fraction=fraction))
        model.advance(20.0)
        assert not len(model.contacts().i)
        balance = model.ledger.balance("energy")
        errors.append(abs(balance.residual) / model.ledger.start[3])
    return max(errors)


@pytest.mark.parametrize("law", [Contact(), frictional()])
def test_a_collision_keeps_its_energy_whatever_the_phase_of_the_step_in_which_floes_meet(law):
    assert collision_error(law, 0.15) < 1e-4
    assert collision_error(law, 0.3) < 1e-3


def newtons_cradles(law, fraction):
    """Ledgers of three floes in a line, two of them struck."""
    for gap in np.linspace(0.01, 0.1, 7):
        floes = Floes([-20.0 - gap, 0.0, 20.0, 40.01], 0.0, 10.0, 1.0, u=[0.3, 0.0, 0.0, -0.1])
        model = Model(DOMAIN, floes, contact=law, step=Step(fraction=fraction))
        model.advance(20.0)
        yield model.ledger


def newtons_cradle(law, fraction):
    """The share of energy that is lost or found."""
    return max(
        abs(ledger.balance("energy").residual) / ledger.start[3]
        for ledger in newtons_cradles(law, fraction)
    )


def test_contacts_that_open_and_close_together_keep_their_energy_to_round_off():
    assert newtons_cradle(Contact(), 0.3) < 1e-11
    assert newtons_cradle(Contact(), 0.85) < 3e-3  # a blow may ask for more than there is to take
    without_the_rule = Contact(friction=Damsgaard2018Coulomb(0.0))
    assert newtons_cradle(without_the_rule, 0.3) > 3e-3


def test_energy_that_a_blow_could_not_take_is_booked_to_no_law_that_the_scene_lacks():
    assert all(not ledger.accounts for ledger in newtons_cradles(Contact(), 0.85))


def test_floes_that_are_let_go_at_rest_have_all_their_energy_at_the_default_step():
    def energy(step):
        floes = Floes([0.0, 19.9], 0.0, 10.0, 1.0)
        model = Model(DOMAIN, floes, contact=Contact(), step=step)
        start = model.ledger.start[3]
        model.advance(1.0)
        assert not len(model.contacts().i)
        return 0.5 * (floes.mass(model.ice_density) * floes.u**2).sum() / start

    assert energy(Step()) == pytest.approx(1.0, rel=1e-12)
    assert energy(Step(length=0.04)) < 0.97  # which begins with half a kick


def test_without_the_rule_for_a_part_of_a_step_a_collision_would_not():
    # the paper's lever arms go without it; without friction they are nothing else
    assert collision_error(Contact(friction=Damsgaard2018Coulomb(0.0)), 0.15) > 1e-3


def test_a_collision_with_a_closed_edge_keeps_its_energy_too():
    domain = Domain((0.0, 100.0), (0.0, 100.0), "closed", "closed", "closed", "closed")
    for start in np.linspace(10.5, 10.6, 7):
        floes = Floes(start, 50.0, 10.0, 1.0, u=-0.3, v=0.2)
        model = Model(domain, floes, contact=Contact())
        model.advance(10.0)
        assert floes.u[0] == pytest.approx(0.3, rel=5e-4)
        for quantity in ("momentum_x", "momentum_y"):
            assert model.ledger.balance(quantity).relative < 1e-12


def oscillation_error(scheme, step):
    """Two overlapping floes let go; error of the gap at a time at which they still touch."""
    floes = Floes([0.0, 19.9], 0.0, 10.0, 1.0)
    Model(DOMAIN, floes, contact=Contact(), step=Step(scheme, length=step)).advance(0.1)
    omega = np.sqrt(2 * 2.0e7 / (934.0 * np.pi * 100.0))
    return abs(20.0 - (floes.x[1] - floes.x[0]) - 0.1 * np.cos(0.1 * omega))


@pytest.mark.parametrize("scheme, order", [("verlet", 2), ("taylor2", 1), ("taylor3", 1)])
def test_the_order_of_each_scheme_is_as_stated(scheme, order):
    errors = [oscillation_error(scheme, step) for step in (0.01, 0.005, 0.0025)]
    rates = np.log2(np.divide(errors[:-1], errors[1:]))
    assert rates == pytest.approx(order, abs=0.1)


def drift_error(step):
    floes = Floes(0.0, 0.0, 20.0, 1.0, u=0.3, v=-0.2)
    forces = [OceanDrag(), AirDrag(), Coriolis(1.4e-2), BodyForce(1e-3, 0.0)]
    model = Model(DOMAIN, floes, contact=Contact(), forces=forces, step=Step(length=step))
    model.ocean.v[:], model.atmosphere.u[:] = 0.4, 20.0
    model.advance(32.0)
    return np.array([floes.u[0], floes.v[0], floes.x[0]])


@pytest.mark.long
def test_drag_wind_and_coriolis_together_are_of_second_order():
    fine = drift_error(1 / 64)
    errors = [np.abs(drift_error(step) - fine).max() for step in (1.0, 0.5, 0.25)]
    assert np.log2(np.divide(errors[:-1], errors[1:])) == pytest.approx(2, abs=0.3)


def hexagonal_pack(n, squeeze=0.999, friction=None, step=Step()):
    x, y = np.meshgrid(np.arange(n) * 2.0, np.arange(n) * np.sqrt(3.0))
    x[1::2] += 1.0
    domain = Domain(
        (0.0, 2.0 * n * squeeze), (0.0, np.sqrt(3.0) * n * squeeze),
        "periodic", "periodic", "periodic", "periodic",
    )  # fmt: skip
    rng = np.random.default_rng(1)
    floes = Floes(
        x.ravel() * squeeze, y.ravel() * squeeze, 1.0, 1.0,
        u=rng.normal(0, 1e-5, n * n), v=rng.normal(0, 1e-5, n * n),
    )  # fmt: skip
    return Model(domain, floes, contact=Contact(friction=friction), step=step)


def kinetic(model):
    f = model.floes
    energy = (f.mass(934.0) * (f.u**2 + f.v**2)).sum()
    if f.rotation:
        energy += (f.moment_of_inertia(934.0) * f.angular_velocity**2).sum()
    return float(energy)


@pytest.mark.parametrize("friction", [None, Coulomb(1e9)])
@pytest.mark.parametrize("fraction, stable", [(0.9, True), (1.1, False)])
def test_the_stiffness_sums_predict_where_a_pack_becomes_unstable(friction, fraction, stable):
    limit = stable_step(hexagonal_pack(6, friction=friction)._now().stiffest, Step(fraction=1.0))
    model = hexagonal_pack(6, friction=friction, step=Step(length=fraction * limit))
    before = kinetic(model)
    try:
        model.advance(400 * fraction * limit)
        grown = not kinetic(model) < 30 * before
    except StabilityError:
        grown = True
    assert grown != stable


def test_momentum_and_angular_momentum_of_unequal_floes_stay_for_10000_steps():
    rng = np.random.default_rng(3)
    x, y = (a.ravel() * 2.0 for a in np.meshgrid(np.arange(8.0), np.arange(8.0)))
    floes = Floes(
        x, y, rng.uniform(0.3, 1.0, 64), rng.uniform(0.5, 1.0, 64),
        u=-0.02 * x + rng.normal(0, 0.02, 64), v=-0.02 * y,
    )  # fmt: skip
    model = Model(DOMAIN, floes, contact=frictional())

    def angular():
        mass, inertia = floes.mass(934.0), floes.moment_of_inertia(934.0)
        return float((mass * (floes.x * floes.v - floes.y * floes.u)).sum()
                     + (inertia * floes.angular_velocity).sum())  # fmt: skip

    scale = (floes.mass(934.0) * np.hypot(floes.x, floes.y) * np.hypot(floes.u, floes.v)).sum()
    before = angular()
    model.step_by(10_000)
    assert "friction" in model.ledger.accounts
    assert abs(angular() - before) < 1e-11 * scale
    for quantity in ("momentum_x", "momentum_y"):
        assert model.ledger.balance(quantity).relative < 1e-12
    assert model.ledger.balance("energy").relative < 1e-3


def jostle(seed=0, **laws):
    rng = np.random.default_rng(seed)
    x, y = (a.ravel() for a in np.meshgrid(np.arange(12) * 2.05 + 1, np.arange(12) * 2.05 + 1))
    floes = Floes(x, y, rng.uniform(0.7, 1.0, 144), 1.0, u=rng.normal(0, 0.1, 144))
    floes.v[:] = rng.normal(0, 0.1, 144)
    size = 12 * 2.05
    domain = Domain((0, size), (0, size), "periodic", "periodic", "periodic", "periodic")
    return Model(domain, floes, **laws)


def test_the_same_start_gives_the_same_bits():
    runs = [jostle(contact=frictional()) for _ in range(2)]
    for model in runs:
        model.advance(5.0)
    assert np.array_equal(runs[0].floes.x, runs[1].floes.x)
    assert np.array_equal(runs[0].floes.angle, runs[1].floes.angle)


@pytest.mark.long
def test_the_order_of_the_forces_does_not_matter():
    forces = [OceanDrag(), AirDrag(), Coriolis(1e-2), BodyForce(0.0, 1e-3)]
    results = []
    for order in (forces, forces[::-1]):
        model = jostle(contact=Contact(), forces=order)
        model.atmosphere.u[:] = 15.0
        model.advance(2.0)
        results.append(model.floes.x.copy())
    assert results[0] == pytest.approx(results[1], abs=1e-9)


def test_held_axes_keep_their_velocity_and_the_held_force_is_booked():
    floes = Floes([0.0, 19.95], 0.0, 10.0, 1.0, u=[0.1, 0.0], v=[0.3, 0.0], motion=[FIXED_Y, FIXED])
    model = Model(DOMAIN, floes, contact=Contact())
    model.advance(2.0)
    assert floes.v[0] == 0.3 and floes.u[1] == 0.0
    assert floes.u[0] < 0
    assert model.ledger.accounts["held floes and coast"][1] < 0
    assert model.ledger.balance("momentum_x").relative < 1e-12


@pytest.mark.parametrize("held", ["axis", "floe", "wall"])
def test_the_work_of_what_is_held_as_a_run_begins_under_load_is_booked(held):
    floes, walls, account = (
        Floes([0.0, 3.0], [0.0, 19.5], 10.0, 1.0, u=[0.0, 0.5]),
        (),
        "held floes and coast",
    )
    floes.motion[:] = FIXED, FIXED_X
    if held == "floe":
        floes = Floes([0.0, 19.8], 0.0, 10.0, 1.0, u=[0.5, 0.0], motion=[FIXED, 0])
    if held == "wall":
        floes, walls, account = Floes(-490.2, 0.0, 10.0, 1.0), [Wall("west", velocity=0.5)], "walls"
    model = Model(DOMAIN, floes, contact=Contact(), walls=walls)
    model.step_by(1)
    assert abs(model.ledger.accounts[account][3]) > 1e3
    assert model.ledger.balance("energy").relative < 1e-5  # n turns a little


def test_a_step_that_is_too_long_stops_the_run_and_says_which_would_hold():
    floes = Floes([0.0, 2.0], 0.0, 1.0, 1.0, u=[100.0, 0.0])
    model = Model(DOMAIN, floes, contact=Contact(), step=Step(length=0.5))
    with pytest.raises(StabilityError, match=r"floe [01]: .* step of .* would hold"):
        model.advance(1.0)


@pytest.mark.parametrize("n", [0, 1, 2])
def test_no_floe_one_floe_and_two_floes_run(n):
    floes = Floes(np.arange(n) * 30.0, 0.0, 10.0, 1.0)
    model = Model(DOMAIN, floes, contact=frictional(), forces=[OceanDrag(), AirDrag()])
    model.atmosphere.u[:] = 10.0
    model.advance(10.0)
    model.fields()
    assert model.ledger.balance("momentum_x").relative < 1e-12
    assert n == 0 or (floes.u > 0).all()


def test_drag_once_in_several_steps_gives_its_whole_impulse_and_nearly_the_same_way():
    def drift(**step):
        rng = np.random.default_rng(1)
        floes = Floes(*rng.uniform(-9, 9, (2, 12)), 2.0, 1.0)
        relax(floes, DOMAIN)
        model = Model(DOMAIN, floes, frictional(), [OceanDrag(), AirDrag()], step=Step(**step))
        model.atmosphere.u[:] = 20.0
        for _ in range(3):
            model.advance(33.3)
        assert model.ledger.balance("momentum_x").relative < 1e-13
        return model

    each, seldom = drift(fraction=0.3), drift(fraction=0.3, drag_every=7)
    assert seldom.counters.steps == each.counters.steps
    given, same = (m.ledger.accounts["wind"][1] for m in (seldom, each))
    assert given == pytest.approx(same, rel=1e-8) and given != same
    assert seldom.floes.x == pytest.approx(each.floes.x, abs=0.004)


def test_a_floe_that_drifts_freely_goes_as_far_in_one_long_exchange_as_in_many_short_ones():
    def way(exchanges, step):
        floes = Floes(0.0, 0.0, 1000.0, 1.0, u=0.5)
        forces = [OceanDrag(), AirDrag(), Coriolis(1.4e-4)]
        domain = Domain((-1e5, 1e5), (-1e5, 1e5), *["periodic"] * 4)
        model = Model(domain, floes, forces=forces, step=step)
        model.atmosphere.u[:] = 10.0
        for _ in range(exchanges):
            model.advance(21600.0 / exchanges)
        return np.array([floes.x[0], floes.y[0]])

    def error(step):
        return np.linalg.norm(way(1, step) - far) / np.linalg.norm(far)

    far = way(1000, Step())
    assert error(Step()) < 0.003
    assert error(Step(length=21600.0)) > 0.03  # control: in one step


@pytest.mark.parametrize("every", [1, 3])
def test_drag_on_waves_takes_from_the_energy_what_is_booked_to_round_off(every):
    floes = Floes(
        20.0 * np.arange(4) - 0.02 * np.arange(4), 0.0, 10.0, 1.0, motion=[FIXED, 0, 0, FIXED],
        u=[0.0, 0.05, -0.02, 0.0],
    )  # fmt: skip
    drags = [OceanDrag(horizontal=50.0), AirDrag()]
    model = Model(DOMAIN, floes, frictional(), drags, step=Step(drag_every=every))
    model.advance(20.0)
    balance, ledger = model.ledger.balance("energy"), model.ledger
    assert ledger.accounts["ocean drag"][3] < -0.03 * ledger.start[3]
    assert balance.relative < 1e-12
    seen = 0.5 * floes.mass(934.0) @ floes.u**2 + model.contacts().energy.sum()
    assert abs(seen - ledger.now[3]) > 1e-6 * ledger.start[3]  # control: as the floes are seen


@pytest.mark.parametrize("k", [0, 2.5, True])
def test_a_number_of_steps_that_is_none_is_refused(k):
    with pytest.raises(InputError, match=r"Step.drag_every = .*must be"):
        Model(DOMAIN, Floes(0.0, 0.0, 1.0, 1.0), step=Step(drag_every=k))


def test_seldom_drag_without_any_force_is_refused():
    with pytest.raises(InputError, match=r"step.drag_every = 4: is of forces other than contacts"):
        Model(DOMAIN, Floes(0.0, 0.0, 1.0, 1.0), frictional(), step=Step(drag_every=4))


def test_a_period_that_is_just_long_enough_for_two_floes_is_not_too_short_for_their_list():
    domain = Domain((0.0, 4.7), (0.0, 60.0), "periodic", "periodic", "periodic", "periodic")
    model = Model(domain, Floes([1.0, 3.3], 30.0, 1.0, 1.0, u=[0.3, -0.3]), contact=frictional())
    model.advance(5.0)
    assert model.ledger.balance("momentum_x").relative < 1e-12
    assert (
        model._now().listed.skin < 1.5 * model._now().listed.closing
    )  # elsewhere such few floes have 6


def test_fast_floes_on_a_short_list_meet_as_they_do_on_the_whole_list(monkeypatch):
    """The list is made anew many times in these steps; made as narrow as for slow floes it misses contacts by the tenth."""

    def after(near: float) -> tuple[np.ndarray, int]:
        monkeypatch.setattr(listing, "NEAR", near)
        domain = Domain((0.0, 2000.0), (0.0, 2000.0), *["periodic"] * 4)
        floes = scatter(domain, UniformSize(20.0, 40.0), concentration=0.7, seed=2)
        floes.u[:], floes.v[:] = np.random.default_rng(0).normal(0.0, 2.0, (2, len(floes)))
        model = Model(domain, floes, frictional())
        model.step_by(1)
        pairs = int(model._now().lists.near.counts.sum())
        model.step_by(80)
        return np.array([floes.x, floes.y, floes.u, floes.v]), pairs

    (short, few), (whole, many) = after(listing.NEAR), after(50.0)
    assert few < 0.8 * many
    # to round-off: which pairs are computed side by side differs
    np.testing.assert_allclose(short, whole, rtol=0, atol=1e-8)


@pytest.mark.parametrize("steps, left", [(8, 1.0), (9, 0.0), (11, 0.5)])
def test_seldom_forces_act_for_all_of_the_time_and_not_beyond_its_end(steps, left):
    lag = np.zeros(2)
    pushed = [time_to_push(lag, 4, 0.5, (steps - k) * 0.5) for k in range(steps)]
    assert pushed[:5] == [1.0, 0.0, 0.0, 0.0, 2.0]
    assert time_left_to_push(lag, False) == 0.0
    assert time_left_to_push(lag, True) == left and not lag.any()
    assert sum(pushed) + left == 0.5 * steps


def test_how_far_floes_have_strayed_is_half_of_how_much_nearer_two_may_be_or_one_and_a_wall():
    def way(x, y, still, walls=None, before=0.25):
        marked = Marked(np.full(len(x), 1.0), np.full(len(x), 2.0), np.full(1, 10.0), before, still)
        floes = np.zeros(len(x), FLOE).view(np.recarray)
        floes.x, floes.y = 1.0 + np.array(x), 2.0 + np.array(y)
        return uncompiled(strayed)(floes, walls, marked)

    apart, together = ([3.0, 0.0, 1.0], [-1.0, 3.0, 0.0]), ([3.0, 3.0], [-4.0, -4.0])
    assert way(*apart, False) == way(*apart, True) == 0.25 + 0.5 * 5.0
    assert way(*together, False) == 0.25 and way(*together, True) == 0.25 + 0.5 * 5.0
    wall = np.array([(9.0,)], [("position", float)]).view(np.recarray)
    assert way(*together, True, wall) == 0.25 + 0.5 * 6.0
    assert way([], [], False) == way([], [], True) == 0.25


def test_the_spin_of_the_papers_scheme_is_a_taylor_step_and_a_held_one_gives_its_work_away():
    force = np.zeros(2, FORCE_AND_TORQUE).view(np.recarray)
    floes = np.zeros(2, FLOE).view(np.recarray)
    force.torque, floes.omega = 4.0, 0.5
    p = SimpleNamespace(
        spinning=floes, force=force, held=np.array([1]), inertia=np.full(2, 2.0), angle=np.zeros(2),
        inverse_spin=np.array([0.5, 0.0]), previous=np.full((2, 3), 1.0),
    )  # fmt: skip
    held = np.zeros(3)
    for k in range(2):
        hold_taylor_spin(floes, p, k, 0.5, 0.1, held)
    assert held == pytest.approx([0.0, 0.0, -0.1 * (4.0 + 0.5 * 3.0) * 0.5])
    taylor_spin(floes, True, (), (), p, 0, 2, 0.1, held)
    alpha, jerk = 0.5 * 4.0, 0.5 * 3.0
    assert floes.omega == pytest.approx([0.5 + 0.1 * (alpha + 0.5 * jerk), 0.5])
    assert p.angle == pytest.approx([0.05 + 0.01 * (alpha / 2 + jerk / 6), 0.05])
    assert p.previous[:, 2].tolist() == [4.0, 4.0]
