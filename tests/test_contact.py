"""Contact laws, one pair at a time."""

import numpy as np
import pytest

from floebmi.bonds import Beam, TensileStrength
from floebmi.boundaries import Domain
from floebmi.columns import BLOW_N, BLOW_T, PAIR_BUFFER, gather
from floebmi.contact import (
    Contact,
    Coulomb,
    Damsgaard2018Coulomb,
    Elastic,
    Restitution,
    cohesive,
    frictional,
    lever_arm,
    memories,
    pair_force,
    prepare,
    stiffness,
    stiffness_ratio,
)
from floebmi.dynamics import Step
from floebmi.errors import InputError
from floebmi.floes import FIXED, Floes
from floebmi.model import Model
from floebmi.pack import FLOE, FORCE_AND_TORQUE
from floebmi.packing import relax
from floebmi.pairs import (
    BLOW,
    BONDS,
    FRICTION,
    Inverse,
    PairList,
    near_of,
    note_blows,
    remembering,
    strike_floes,
)
from floebmi.survey import touching_pairs

DOMAIN = Domain((-200.0, 200.0), (-200.0, 200.0))
LAWS = {
    "elastic": Contact(),
    "bonds": cohesive(500e3),
    "friction": frictional(),
    "friction and bonds": Contact(friction=Coulomb(), bonds=TensileStrength(500e3)),
}


def pair(law, gap, slip_rate=0.0, radius=10.0, slip=0.0, dt=0.0):
    """The force of two floes 1 m thick, of radii 10 m and `radius`, that do not remember a bond."""
    mu = law.friction.coefficient
    return pair_force(
        law, gap, 0.0, slip_rate, 0.0, 10.0, radius, 1.0, 1.0, 1.0, mu, 0.0,
        slip, 0.0, 0.0, 0.0, 0.0, 0.0, dt,
    )  # fmt: skip


def force_and_energy(law, gap, slip, bonded):
    """One pair with r_i = 10, r_j = 15, h = 1 and 2 m: force on i along −n, and elastic energy."""
    place = np.zeros(2, FLOE).view(np.recarray)
    place.x, place.r, place.h = [0.0, 25.0 + gap], [10.0, 15.0], [1.0, 2.0]
    place.w = 0.5
    one = np.array([0], np.uint32)
    memory, block = remembering(memories(law), 1)
    for name, value in (("slip", slip), ("bonded", bonded)):
        if name in memory:
            memory[name][:] = value
    pairs = PairList(np.array([0, 1, 1]), one, one + 1, **memory, block=block)
    near, close = near_of(pairs, np.array([0, 1]))
    near.slot[0], near.i[0], near.j[0], near.counts[0] = 0, 0, 1, 1
    close.block[:, 0] = block[:, 0]
    _, rows = touching_pairs(law, None, None, place, None, None, near, close)
    return (-rows[0, 4], rows[0, 8]) if len(rows) else (0.0, 0.0)


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("gap", [-0.3, -0.01, 0.05])
def test_the_normal_force_is_minus_the_slope_of_the_energy(name, gap):
    law, step = prepare(LAWS[name]), 1e-4
    bonded = 1.0 if law.bonds else 0.0
    push, _ = force_and_energy(law, gap, 0.0, bonded)
    slope = (
        force_and_energy(law, gap + step, 0.0, bonded)[1]
        - force_and_energy(law, gap - step, 0.0, bonded)[1]
    ) / (2 * step)
    assert push == pytest.approx(-slope, rel=1e-6, abs=1e-6)
    assert (push != 0) == (gap < 0 or bool(law.bonds))


def test_the_tangential_force_is_minus_the_slope_of_the_energy_while_it_sticks():
    law, slip, step = prepare(frictional()), 0.003, 1e-5
    f = pair(law, -0.1, slip=slip)
    up, down = (force_and_energy(law, -0.1, slip + d, 0.0)[1] for d in (step, -step))
    assert f.f_t == pytest.approx(-(up - down) / (2 * step), rel=1e-6)


def test_the_stiffness_ratio_is_that_of_the_reference_code():
    assert stiffness_ratio(Coulomb()) == pytest.approx(0.898071625, rel=1e-9)


def test_friction_is_limited_by_coulomb_and_forming_it_again_gives_the_same_bits():
    law = prepare(frictional(friction=0.3))
    f = pair(law, -0.1, 5.0, 12.0, slip=0.01, dt=0.1)
    assert abs(f.f_t) == pytest.approx(0.3 * f.f_n, rel=1e-14)
    again = pair(law, -0.1, 5.0, 12.0, slip=f.slip)
    assert (again.f_t, again.slip) == (f.f_t, f.slip)
    assert f.friction_loss > 0


def test_contact_time_and_overlap_are_those_of_a_half_oscillation():
    floes = Floes([0.0, 20.0], 0.0, 10.0, 1.0, u=[0.1, 0.0], motion=[0, FIXED])
    model = Model(DOMAIN, floes, contact=Contact(), step=Step(length=1e-4))
    deepest, time = 0.0, None
    for _ in range(420):
        model.advance(1e-3)
        overlap = 20.0 - (floes.x[1] - floes.x[0])
        deepest = max(deepest, overlap)
        if overlap < 0 and time is None:
            time = model.time
    assert deepest == pytest.approx(0.0121125, rel=1e-4)
    assert time == pytest.approx(0.38052505, abs=1.1e-3)


@pytest.mark.parametrize("law", [Contact(), cohesive(), frictional()])
def test_the_third_law_holds_to_the_bit(law):
    floes = Floes([0.0, 24.0], [0.0, 3.0], [10.0, 15.0], [1.0, 2.0], u=[0.3, -0.2], v=[0.1, 0.0])
    model = Model(DOMAIN, floes, contact=law)
    model.advance(0.05)
    now = model._now().packed.force
    assert now["x"][0] == -now["x"][1] != 0
    assert now["y"][0] == -now["y"][1]


@pytest.mark.parametrize(("friction", "short"), [(1.0, 0.01), (3.0, 0.01), (1e6, 0.025)])
def test_energy_of_spinning_floes_that_stick_needs_short_steps(friction, short):
    """The error of an oblique impact, over its energy, against steps that resolve it; as docs/extremes.md says."""

    def energy(model):
        f = model.floes
        mass = model.ice_density * np.pi * f.radius**2 * f.thickness
        return (0.5 * mass * (f.u**2 + f.v**2 + 0.5 * (f.radius * f.angular_velocity) ** 2)).sum()

    def left(fraction, offset):
        floes = Floes(
            [0.0, 15.0], [0.0, 16.0 + offset], [10.0, 12.0], [1.0, 2.0], u=[1.0, 0.0],
            rotation=True, angular_velocity=[0.1, -0.2],
        )  # fmt: skip
        model = Model(DOMAIN, floes, contact=frictional(friction), step=Step(fraction=fraction))
        before = energy(model)
        model.advance(9.0)
        return energy(model) / before - 1.0

    def error(fraction):
        return max(
            abs(left(fraction, offset) - left(0.01, offset)) for offset in np.linspace(0.0, 0.03, 7)
        )

    assert left(None, 0.0) > 0.0 > left(0.01, 0.0)
    assert 0.04 < error(None) < 0.11
    assert error(0.3) < short


@pytest.mark.parametrize("ratio", [1.0, 3.0, 1e2])
@pytest.mark.parametrize("wanted", [0.1, 0.5, 0.9])
def test_restitution_is_met_for_any_mass_ratio_and_nothing_pulls_as_floes_part(ratio, wanted):
    floes = Floes(
        [0.0, 11.05 * np.sqrt(ratio)], 0.0, [10.0, 10.0 * np.sqrt(ratio)], 1.0, u=[0.1, 0]
    )
    floes.x[1] = 10.02 + floes.radius[1]
    # of first order in the step: e = 0.1 errs by 2.6 % at 0.05 of the limit, whatever the phase
    law, step = Contact(dashpot=Restitution(wanted)), Step(fraction=0.03)
    model = Model(DOMAIN, floes, contact=law, step=step)
    least = 0.0
    for _ in range(60):
        model.advance(0.05)
        contacts = model.contacts()
        least = min([least, *(-contacts.fx * np.sign(contacts.dx))])
    assert (floes.u[1] - floes.u[0]) / 0.1 == pytest.approx(wanted, rel=0.02)
    assert least >= 0


def test_a_floe_that_touches_just_as_a_step_ends_rebounds_as_one_that_touches_just_before():
    rebounds = []
    for gap in (0.0625 - 1e-9, 0.0625, 0.0625 + 1e-9):  # 0.0625 m are four steps, to the bit
        floes = Floes([0.0, 20.0 + gap], 0.0, 10.0, 1.0, u=[1.0, 0.0])
        law = Contact(dashpot=Restitution(0.3))
        Model(DOMAIN, floes, contact=law, step=Step(length=2.0**-6)).advance(1.0)
        rebounds.append(floes.u[1] - floes.u[0])
    assert rebounds == pytest.approx([rebounds[1]] * 3, rel=0.01)


def test_restitution_against_a_fixed_floe_is_met_too():
    floes = Floes([0.0, 20.02], 0.0, 10.0, 1.0, u=[0.1, 0.0], motion=[0, FIXED])
    model = Model(
        DOMAIN, floes, contact=Contact(dashpot=Restitution(0.5)), step=Step(fraction=0.05)
    )
    model.advance(3.0)
    assert -floes.u[0] / 0.1 == pytest.approx(0.5, rel=0.02)


@pytest.mark.long
@pytest.mark.parametrize("modulus", [2e7, 2e9])
def test_a_dashpot_between_a_driven_floe_and_a_fixed_one_pushes_with_nothing_of_its_own(modulus):
    floes = Floes([0.0, 20.01], 0.0, 10.0, 1.0, u=[0.1, 0.0], motion=FIXED)
    model = Model(DOMAIN, floes, contact=frictional(youngs_modulus=modulus, restitution=0.5))
    model.advance(1.0)
    assert model.contacts().overlap[0] == pytest.approx(0.09, rel=1e-9)
    work = model.ledger.accounts["held floes and coast"][3]
    assert work == pytest.approx(0.5 * modulus * 0.09**2, rel=1e-2)


def test_a_bond_breaks_at_its_strength_and_can_form_again():
    floes = Floes([0.0, 20.0 - 1e-6], 0.0, 10.0, 1.0, u=[0.0, 1e-3], motion=[FIXED, FIXED])
    model = Model(DOMAIN, floes, contact=cohesive(500e3))
    strongest = widest = 0.0
    while len(model.contacts().i):
        contacts = model.contacts()
        strongest = max(strongest, contacts.fx[0])
        widest = max(widest, -contacts.overlap[0])
        model.advance(1.0)
    assert strongest == pytest.approx(5.0e6, rel=0.01)
    assert widest == pytest.approx(0.25, rel=0.01)
    assert model.counters.bonds_broken == 1
    assert model.ledger.accounts["broken bonds"][3] == pytest.approx(-0.5 * 2e7 * 0.25**2, rel=0.01)
    floes.u[1] = -1e-2
    model.advance(30.0)
    assert model.contacts().bonded.all() and len(model.contacts().i) == 1
    assert model.counters.bonds_broken == 1


def energy_that_a_break_leaves_unbooked(speed, step, law, holds_on):
    """A floe of 1 kg tied to a fixed one, its step in units of √(m/k): energy over that of the start.

    holds_on : its bond acts to the end of the step in which it breaks, and all that it stored there is lost
    """
    k = stiffness(law.elastic, 1.0, 1.0)
    dt, gap, u, f, bonded, damped, lost = step / np.sqrt(k), -1e-3, speed, k * 1e-3, 1.0, 0.0, 0.0
    start = 0.5 * u * u + 0.5 * k * gap * gap
    while bonded:
        u += 0.5 * dt * f
        gap += dt * u
        now = pair_force(
            law, gap, u, 0.0, 0.0, 10.0, 10.0, 1.0, 1.0, 1.0, 0.0, law.bonds.tensile_strength,
            0.0, bonded, damped, 0.0, 0.0, 0.0, dt,
        )  # fmt: skip
        f, bonded, damped = now.f_n, now.bonded, now.damped
        blow = -0.5 * dt * k * gap if holds_on and not bonded else now.blow_n
        lost += 0.5 * k * gap * gap if holds_on and not bonded else now.bond_loss
        lost += now.dashpot_loss
        u += 0.5 * dt * f + blow
    return (0.5 * u * u + lost) / start - 1.0


@pytest.mark.parametrize("step", [0.5, 0.25])
def test_no_energy_is_left_over_where_a_bond_breaks_whatever_the_step(step):
    law, k = cohesive(500e3), 2e7
    for speed in np.sqrt(k) * np.linspace(0.4, 0.8, 9):  # breaks at 0.25 m
        assert abs(energy_that_a_break_leaves_unbooked(speed, step, law, False)) < 1e-6
        assert abs(energy_that_a_break_leaves_unbooked(speed, step, law, True)) > 1e-3


def test_a_bond_without_strength_that_opens_is_a_contact_that_opens():
    state = 10.0, 10.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0
    step, opening, gap = 0.01, 3.0, 0.01  # touching for two thirds of the step
    for law in (cohesive(0.0), cohesive(0.0, restitution=0.5)):
        law = prepare(law)
        damped = -0.4e7 * 0.02 if law.dashpot else 0.0
        tied, free = (
            pair_force(law, gap, opening, 0.0, 0.0, *state, bonded, damped, 0.0, 0.0, 0.0, step)
            for bonded in (1.0, 0.0)
        )
        assert tied == free and tied.blow_n < 0.0 and tied.bond_loss == 0.0


def test_without_a_bond_the_same_pull_meets_no_force():
    floes = Floes([0.0, 20.0 - 1e-6], 0.0, 10.0, 1.0, u=[0.0, 1e-3], motion=[FIXED, FIXED])
    model = Model(DOMAIN, floes, contact=Contact())
    model.advance(10.0)
    assert not len(model.contacts().i)


def test_the_papers_lever_arm_breaks_angular_momentum_and_the_default_does_not():
    def drift(friction):
        floes = Floes([0.0, 0.0], [0.0, 24.9], [5.0, 20.0], 1.0, u=[0.3, -0.3], v=[0.02, -0.02])
        model = Model(DOMAIN, floes, contact=Contact(friction=friction))

        def angular():
            mass, inertia = floes.mass(934.0), floes.moment_of_inertia(934.0)
            orbit = mass * (floes.x * floes.v - floes.y * floes.u)
            return float((orbit + inertia * floes.angular_velocity).sum())

        before = angular()
        model.advance(20.0)
        assert abs(floes.angular_velocity).max() > 1e-4
        return abs(angular() - before) / abs(before)

    assert drift(Coulomb()) < 1e-12
    assert drift(Damsgaard2018Coulomb()) > 1e-6
    assert lever_arm(Coulomb(), 5.0, 20.0, -0.2) == 4.9
    assert lever_arm(Damsgaard2018Coulomb(), 5.0, 20.0, -0.2) == 8.0  # the harmonic mean of both


@pytest.mark.parametrize(
    "law, name",
    [
        (frictional(friction=-0.1), "coefficient"),
        (frictional(youngs_modulus=0.0), "youngs_modulus"),
        (frictional(poisson_ratio=0.7), "poisson_ratio"),
        (cohesive(tensile_strength=-1.0), "tensile_strength"),
        (Contact(Elastic(float("nan"))), "youngs_modulus"),
        (Contact(dashpot=Restitution(1.5)), "coefficient"),
        (Contact(None), "Contact.elastic = None: must be of the kind Elastic"),
        (Contact(Coulomb()), r"Contact.elastic = Coulomb\(.*: must be of the kind Elastic"),
        (Contact(friction=0.3), "Contact.friction = 0.3: must be of the kind Coulomb or Dams"),
        (Contact(friction=Coulomb), "Contact.friction = <class.*: must be of the kind Coulomb"),
        (
            Contact(bonds=TensileStrength(healing=1.0)),
            "TensileStrength.healing = 1.0: must be of the kind Healing",
        ),
    ],
)
def test_a_law_out_of_its_bounds_is_refused_by_name(law, name):
    with pytest.raises(InputError, match=name):
        Model(DOMAIN, Floes(0.0, 0.0, 1.0, 1.0), contact=law)


@pytest.mark.parametrize(
    ("law", "edges"),
    [
        (frictional()._replace(bonds=cohesive().bonds), "periodic"),
        (Contact(dashpot=Restitution(0.3)), "inactive"),
    ],
)
def test_the_forces_that_contacts_show_add_up_to_those_that_move_the_floes(law, edges):
    rng = np.random.default_rng(8)
    floes = Floes(*rng.uniform(0.0, 80.0, (2, 30)), 8.0, 1.0)
    domain = Domain((-20.0, 100.0), (-20.0, 100.0), *[edges] * 4)
    relax(floes, domain)
    floes.x[:], floes.y[:] = 0.995 * floes.x, 0.995 * floes.y  # many push each other
    floes.u[:], floes.v[:] = rng.normal(0.0, 0.5, (2, 30))
    model = Model(domain, floes, law)
    model.advance(0.01)
    contacts, now, net = model.contacts(), model._now().packed, np.zeros((2, 30))
    for axis, force in enumerate((contacts.fx, contacts.fy)):
        np.add.at(net[axis], contacts.i, force)
        np.subtract.at(net[axis], contacts.j, force)
    moving = np.array([now.force["x"], now.force["y"]])
    assert len(contacts.i) > 2 and np.abs(moving).max() > 1e3
    assert net[:, now.number] == pytest.approx(moving, abs=1e-9 * np.abs(moving).max())


@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize("normal, along", [(0.4, 0.0), (0.0, 0.3)])
@pytest.mark.parametrize(
    "law, account",
    [(frictional(), FRICTION), (Contact(bonds=TensileStrength(5e5, beam=Beam(5e5))), BONDS)],
)
def test_a_blow_does_its_work_on_both_floes_half_a_step_ahead(normal, along, held, law, account):
    """Across a seam, with spins; and with inverse masses that differ by axis, as where an axis is held."""
    period, dt = 100.0, 0.2
    floes, force = (np.zeros(4, kind).view(np.recarray) for kind in (FLOE, FORCE_AND_TORQUE))
    floes.x, floes.y, floes.r = (
        [98.0, 12.1, 50.0, 69.9],
        [97.0, 2.9, 50.0, 50.0],
        [10.0, 5.0, 10.0, 10.0],
    )
    floes.u, floes.v = [0.3, -0.2, 0.0, 0.0], [0.1, 0.4, 0.0, 0.0]
    floes.omega, floes.w = [0.05, 0.02, 0.0, 0.0], [0.25, 0.5, 1.0, 1.0]
    force.x, force.y, force.torque = (
        [3.0, -2.0, 0.0, 0.0],
        [1.0, 4.0, 0.0, 0.0],
        [5.0, 7.0, 0.0, 0.0],
    )
    other_axis = [0.35, 0.2, 1.0, 1.0] if held else floes.w
    inverse = Inverse(held, floes.w.copy(), np.array(other_axis), np.array([0.02, 0.08, 1.0, 1.0]))
    pair_i, pair_j = np.array([2, 2, 0, 2, 2]), np.array([3, 3, 1, 3, 3])  # the second of four
    buffer, blows = np.zeros(PAIR_BUFFER), np.zeros(4, BLOW).view(np.recarray)
    gather(floes, pair_i, pair_j, 1, buffer, 0)
    dx, dy = floes.x[1] + period - floes.x[0], floes.y[1] + period - floes.y[0]
    distance = np.hypot(dx, dy)
    nx, ny = dx / distance, dy / distance
    a_i, a_j = (
        lever_arm(law.friction, *radii, distance - 15.0) for radii in ((10.0, 5.0), (5.0, 10.0))
    )
    du, dv = floes.u[1] - floes.u[0], floes.v[1] - floes.v[0]
    slip_rate = du * ny - dv * nx + a_i * floes.omega[0] + a_j * floes.omega[1]
    opening = du * nx + dv * ny
    work = (normal, along)
    buffer[BLOW_N + 1], buffer[BLOW_T + 1] = normal / opening, along / slip_rate

    def energy():
        ahead = zip(
            (floes.u, floes.v, floes.omega),
            (force.x, force.y, force.torque),
            inverse[1:],
            strict=True,
        )
        return sum(((v + 0.5 * dt * w * f) ** 2 / w).sum() / 2 for v, f, w in ahead)

    noted = note_blows(
        inverse, law, period, period, floes.r, floes, pair_i, pair_j, 1, 4, blows, 0, buffer
    )
    before, lost, momentum = energy(), np.zeros(5), (floes.u / inverse.x).sum()
    spins = floes.omega.copy()
    strike_floes(law, floes.r, inverse, floes, floes, blows, noted, dt, force, np.zeros(3), lost)
    assert noted == 1 and energy() - before == pytest.approx(sum(work))
    assert (floes.u / inverse.x).sum() == pytest.approx(momentum) and not lost.any()
    turned = (floes.omega - spins) / inverse.spin
    assert turned[0] * a_j == pytest.approx(turned[1] * a_i) and (along == 0.0 or turned[0] != 0.0)
    assert not any(floes[name][2:].any() for name in ("u", "v", "omega"))
    buffer[BLOW_N + 1] *= -1e3  # more than there is to take
    buffer[BLOW_T + 1] *= -1e3
    note_blows(inverse, law, period, period, floes.r, floes, pair_i, pair_j, 1, 4, blows, 0, buffer)
    before, rates = (
        energy(),
        (blows[0].normal * blows[0].opening, blows[0].tangential * blows[0].slip_rate),
    )
    strike_floes(law, floes.r, inverse, floes, floes, blows, 1, dt, force, np.zeros(3), lost)
    assert lost[account] < 0.0 and energy() - before + lost[account] == pytest.approx(sum(rates))
    assert np.count_nonzero(lost) == 1
