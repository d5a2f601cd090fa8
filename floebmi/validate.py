"""Validation at the extremes: cases that run the model through its public interface and measure its behaviour.

Only stale-neighbours uses more than the public interface: it makes a model discard its neighbour list.

A case is a function that yields measures (`measures`).  The command `floebmi validate` and the tests run the same functions,
so each case is defined once.  A case that claims stability or conservation also measures a negative control, a variant
that must fail.

The short form takes seconds; `long=True` goes further (more steps, more floes, wider ranges).
"""

import math
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from floebmi.bonds import TensileStrength
from floebmi.boundaries import Domain, Inflow, Wall
from floebmi.contact import (
    Contact,
    Coulomb,
    Damsgaard2018Coulomb,
    Dashpot,
    Restitution,
    cohesive,
    frictional,
)
from floebmi.dynamics import Step
from floebmi.errors import InputError, StabilityError, choose
from floebmi.floes import FIXED, FIXED_ROTATION, FIXED_X, Floes
from floebmi.forces import AirDrag, Coriolis, OceanDrag
from floebmi.grid import Grid
from floebmi.measures import Case, Measure, fact
from floebmi.model import Model
from floebmi.output import open_file
from floebmi.packing import regular, relax, scatter
from floebmi.restarts import load_restart, save_restart
from floebmi.running import run
from floebmi.sizes import PowerLaw, UniformSize
from floebmi.taylor import PAPERS_STEP

DENSITY = 934.0
PAPER = "Damsgaard et al. 2018, doi:10.1029/2018MS001299"
PERIODIC = ("periodic",) * 4
CASES: dict[str, Case] = {}


def _case(number: int, name: str, source: str) -> Callable:
    def add(function: Callable[[bool], Iterator[Measure]]) -> Callable:
        title = (function.__doc__ or "").strip()
        CASES[name] = Case(number, name, title, source, function)
        return function

    return add


def find(names: Sequence[str]) -> list[Case]:
    """Cases with these short names or numbers; all cases if none are given.

    Raises
    ------
    InputError
        for a name that no case has; the message suggests the nearest.
    """
    by_number = {str(case.number): case for case in CASES.values()}
    cases = []
    for name in names:
        case = CASES.get(name) or by_number.get(name)
        if case is None:
            raise InputError(f"validate {name}: no such case; {choose(name, CASES)}")
        cases.append(case)
    return cases or list(CASES.values())


# ---- what several cases use ----------------------------------------------------------------------


def hexagonal_pack(n: int, contact: Contact, step: Step = Step(), speed: float = 1e-5) -> Model:
    """n × n equal floes with a radius of 1 m, compressed by a thousandth, with small random velocities."""
    squeeze = 0.999
    x, y = np.meshgrid(np.arange(n) * 2.0, np.arange(n) * np.sqrt(3.0))
    x[1::2] += 1.0
    size = (2.0 * n * squeeze, np.sqrt(3.0) * n * squeeze)
    rng = np.random.default_rng(1)
    u, v = rng.normal(0.0, speed, (2, n * n))
    floes = Floes(x.ravel() * squeeze, y.ravel() * squeeze, 1.0, 1.0, u=u, v=v)
    return Model(Domain((0.0, size[0]), (0.0, size[1]), *PERIODIC), floes, contact, step=step)


def kinetic_energy(floes: Floes) -> float:
    """Kinetic energy of translation and rotation [J]."""
    mass = floes.mass(DENSITY)
    energy = (mass * (floes.u**2 + floes.v**2)).sum()
    if floes.rotation:
        energy += (floes.moment_of_inertia(DENSITY) * floes.angular_velocity**2).sum()
    return 0.5 * float(energy)


def _angular_momentum(floes: Floes) -> float:
    mass = floes.mass(DENSITY)
    total = (mass * (floes.x * floes.v - floes.y * floes.u)).sum()
    if floes.rotation:
        total += (floes.moment_of_inertia(DENSITY) * floes.angular_velocity).sum()
    return float(total)


def growth(model: Model, steps: int) -> float:
    """Kinetic energy after some steps over that before; inf if the run was stopped."""
    before = kinetic_energy(model.floes)
    try:
        model.advance(steps * model.longest_step())
    except StabilityError:
        return math.inf
    return kinetic_energy(model.floes) / before


def _refused(attempt: Callable[[], object], *says: str) -> bool:
    """Whether `attempt` is refused with a one-line message that contains all of `says`."""
    try:
        attempt()
    except InputError as error:
        text = str(error)
        return "\n" not in text and all(word in text for word in says)
    return False


def _overlaps(model: Model) -> np.ndarray:
    """Overlap of each contact over the smaller radius."""
    c, radius = model.contacts(), model.floes.radius
    return c.overlap / np.minimum(radius[c.i], radius[c.j])


def _largest(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.abs(a - b).max(initial=0.0))


def _same_bits(one: Model, other: Model) -> bool:
    return one.floes.same(other.floes) and np.array_equal(one.ledger.now, other.ledger.now)


# ---- the cases -----------------------------------------------------------------------------------


@_case(1, "dense-pack", f"{PAPER}, section 2.4")
def _dense_pack(long: bool) -> Iterator[Measure]:
    """Undamped dense pack, long run: the scheme must not add energy."""
    steps = 400_000 if long else 40_000
    pack, highest = hexagonal_pack(8, Contact()), 0.0
    before = kinetic_energy(pack.floes)
    for _ in range(40):
        pack.step_by(steps // 40)
        highest = max(highest, kinetic_energy(pack.floes) / before)
    yield Measure(f"highest kinetic energy over the first, {steps} steps", highest, "≤", 1.1)
    taylor = growth(hexagonal_pack(8, Contact(), PAPERS_STEP), 40_000)
    yield Measure("control: the same with taylor3, 40000 steps of Eq. 4", taylor, "≥", 20.0)


@_case(2, "sticking-pack", "docs/theory.md, eq. stable-step")
def _sticking_pack(long: bool) -> Iterator[Measure]:
    """Packs with and without sticking and rotation: instability sets in at the predicted limit of the time step."""
    steps = 100_000 if long else 10_000
    for name, friction in (("without friction", None), ("sticking", Coulomb(1e3))):
        law = Contact(friction=friction)
        limit = hexagonal_pack(6, law, Step(fraction=1.0)).longest_step()
        stable = growth(hexagonal_pack(6, law, Step(length=0.9 * limit), speed=1e-7), steps)
        wild = growth(hexagonal_pack(6, law, Step(length=1.1 * limit), speed=1e-7), 40)
        yield Measure(f"{name}: energy growth at 0.9 of the limit, {steps} steps", stable, "≤", 1.5)
        yield Measure(f"{name}, control: at 1.1 of the limit, 40 steps", wild, "≥", 1e3)


def _meeting(contact: Contact, ratio: float, step: Step = Step()) -> Model:
    """Two floes of a given mass ratio, about to collide at 0.1 m/s."""
    radius = np.array([10.0, 10.0 * np.sqrt(ratio)])
    floes = Floes([0.0, radius.sum() + 0.02], 0.0, radius, 1.0, u=[0.1, 0.0])
    reach = 10 * radius.sum()
    return Model(Domain((-reach, reach), (-reach, reach)), floes, contact, step=step)


def _rebound(contact: Contact, ratio: float, step: Step = Step()) -> float:
    """Rebound speed over impact speed."""
    model = _meeting(contact, ratio, step)
    model.advance(3.0)
    return float((model.floes.u[1] - model.floes.u[0]) / 0.1)


def _pull(contact: Contact, ratio: float) -> float:
    """The largest attractive force between the two floes [N]."""
    model, pull = _meeting(contact, ratio), 0.0
    for _ in range(60):
        model.advance(0.05)
        c = model.contacts()
        pull = max([pull, *(c.fx * np.sign(c.dx))])
    return float(pull)


@_case(3, "dashpots", "Schwager & Pöschel 2007, doi:10.1007/s10035-007-0065-z")
def _dashpots(long: bool) -> Iterator[Measure]:
    """Restitution for mass ratios of 1 to 10 000: as prescribed, without attraction at the end."""
    wanted = (0.1, 0.3, 0.5, 0.7, 0.9) if long else (0.1, 0.5, 0.9)
    ratios = (1.0, 10.0, 100.0, 1e3, 1e4) if long else (1.0, 1e2, 1e4)
    error = finer = pull = classic = 0.0
    for e in wanted:
        law = Contact(dashpot=Restitution(e))
        for ratio in ratios:
            error = max(error, abs(_rebound(law, ratio) - e))
            finer = max(finer, abs(_rebound(law, ratio, Step(fraction=0.03)) / e - 1.0))
            pull = max(pull, _pull(law, ratio))
        zeta = -math.log(e) / math.hypot(math.pi, math.log(e))
        classic = max(classic, abs(_rebound(Contact(dashpot=Dashpot(zeta)), 1.0) - e))
    yield Measure("error of the rebound over the impact speed, default step", error, "≤", 0.02)
    yield Measure("relative error of the restitution, a tenth of the step", finer, "≤", 0.02)
    yield Measure("largest pull between parting floes [N]", pull, "≤", 0.0)
    yield Measure("control: error with ζ of a contact that may pull", classic, "≥", 0.02)


class _Errors(NamedTuple):
    """Largest relative errors over some collisions, each of which begins at another phase of the time step.

    momentum, energy : relative to the totals; angular : relative to the angular momentum that was exchanged;
    impact : the energy error relative to the energy of the impact, ½ m_ij Δv², the strictest scale
    """

    momentum: float
    angular: float
    energy: float
    impact: float


def _collide(law: Contact, fraction: float | None, phases: int) -> _Errors:
    """A floe of 1 m collides obliquely with one of 1 km."""
    worst, box = np.zeros(4), Domain((-1e4, 1e4), (-1e4, 1e4))
    for gap in np.linspace(0.01, 0.05, phases):
        away = 1001.0 + gap
        floes = Floes(
            [0.0, away * np.cos(0.4)], [0.0, away * np.sin(0.4)], [1.0, 1000.0], 1.0,
            u=[0.3, -0.02], v=[0.05, 0.01],
        )  # fmt: skip
        model = Model(box, floes, law, step=Step(fraction=fraction))
        mass = floes.mass(DENSITY)
        impact = 0.5 * mass[0] * (np.ptp(floes.u) ** 2 + np.ptp(floes.v) ** 2)
        scale = float((mass * np.hypot(floes.x, floes.y) * np.hypot(floes.u, floes.v)).sum())
        before = _angular_momentum(floes)
        model.advance(2.0)
        energy = model.ledger.balance("energy")
        momentum = max(model.ledger.balance(f"momentum_{a}").relative for a in "xy")
        angular = abs(_angular_momentum(floes) - before) / scale
        errors = momentum, angular, energy.relative, abs(energy.residual) / impact
        worst = np.maximum(worst, errors)
    return _Errors(*worst)


@_case(4, "size-ratio", "conservation laws; docs/theory.md, eq. part-of-a-step")
def _size_ratio(long: bool) -> Iterator[Measure]:
    """A size ratio of 1000 in an oblique collision: momentum, angular momentum, energy."""
    phases = 24 if long else 6
    elastic, rough = Contact(), frictional()
    for name, law in (("elastic", elastic), ("frictional", rough)):
        errors = _collide(law, None, phases)
        yield Measure(f"{name}: momentum", errors.momentum, "≤", 1e-10)
        yield Measure(f"{name}: angular momentum", errors.angular, "≤", 1e-10)
        if law is elastic:
            yield Measure(f"{name}: energy", errors.energy, "≤", 1e-10)
        yield Measure(f"{name}: energy over that of the impact", errors.impact, "≤", 1e-3)
    plain = Contact(friction=Damsgaard2018Coulomb(0.0))
    without = _collide(plain, 0.3, phases).impact
    yield Measure("control: energy over the impact's, no part of a step", without, "≥", 2e-3)


@_case(5, "drag-overshoot", f"{PAPER}, Eq. 12; exact solution Δu/(1 + K|Δu|t)")
def _drag_overshoot(long: bool) -> Iterator[Measure]:
    """A floe of 1 m in a current of 2 m/s, steps up to an hour: no overshoot, correct terminal speed, closed impulse."""

    def reached(duration: float, step: Step = Step()) -> tuple[float, float]:
        floes = Floes(50.0, 50.0, 1.0, 1.0)
        model = Model(Domain((0.0, 1e6), (0.0, 100.0)), floes, forces=[OceanDrag()], step=step)
        model.ocean.u[:] = 2.0
        model.advance(duration)
        momentum = floes.mass(DENSITY)[0] * floes.u[0]
        return float(floes.u[0]), abs(momentum + model.ocean.impulse_x.sum()) / momentum

    law, m = OceanDrag(), DENSITY * np.pi
    rate = np.pi * law.density * (law.vertical * 2 * 0.9 + law.horizontal) / m  # K/m, r = h = 1 m
    durations = np.geomspace(0.01, 3600.0, 200 if long else 40)
    ends = np.array([reached(duration) for duration in durations])
    exact = 2.0 - 2.0 / (1.0 + 2.0 * rate * durations)
    speed, unbooked = ends.T
    fall, slip = -np.diff(speed).min(), abs(1 - (2 - speed[-1]) / (2 - exact[-1]))
    yield Measure("largest speed over that of the water", speed.max() / 2.0, "≤", 1.0)
    yield Measure("largest fall of the speed with duration [m/s]", fall, "≤", 0.0)
    yield Measure("terminal error of the slip velocity", slip, "≤", 0.01)
    yield Measure("impulse of floe and water together", unbooked.max(), "≤", 1e-12)
    try:
        wild = reached(3600.0, Step("taylor2", length=3600.0))[0] / 2.0
    except StabilityError:  # the ledger sees it
        wild = math.inf
    yield Measure("control: speed over the water's, explicit drag, one step", wild, "≥", 1.0)


@_case(6, "sizes-and-thicknesses", "conservation of mass")
def _sizes_and_thicknesses(long: bool) -> Iterator[Measure]:
    """Touching pairs with radii of 0.1 m to 100 km and thicknesses of 1 µm to 10 m, in wind and current."""
    radius = np.repeat(np.geomspace(0.1, 1e5, 7), 8)
    thickness = np.tile(np.geomspace(1e-6, 10.0, 8), 7)
    x = np.cumsum(2 * radius) - radius
    floes = Floes(x, 0.0, radius, thickness, u=-0.01)
    floes.x -= np.cumsum(np.full(len(x), 1e-3))  # all touch a little
    width = float(x[-1] + radius[-1])
    domain = Domain((-0.01, 2 * width), (-width, width))
    model = Model(domain, floes, frictional(), [OceanDrag(), AirDrag()])
    model.ocean.u[:], model.atmosphere.v[:] = -0.5, 10.0
    floes.u[0] = -10.0  # over the edge
    mass = floes.mass(DENSITY).sum()
    for _ in range(10):
        model.advance(1.0 if long else 0.005)
    numbers = np.concatenate([floes.x, floes.y, floes.u, floes.v, floes.angular_velocity])
    left = float(floes.mass(DENSITY)[~floes.active].sum())
    booked = -model.ledger.accounts.get("outflow", np.zeros(4))[0]
    missed = abs(model.ledger.balance("mass").residual) / mass
    off = abs(left / booked - 1.0) if booked else math.nan
    yield Measure("numbers that are not finite", np.count_nonzero(~np.isfinite(numbers)), "=", 0)
    yield Measure("mass that the books miss, relative", missed, "≤", 1e-12)
    yield Measure("floes that have left over the edge", np.count_nonzero(~floes.active), "≥", 1)
    yield Measure("their mass and what was booked, relative", off, "≤", 1e-12)

    def refused(name: str, value: float) -> bool:
        sizes = {"radius": 1.0, "thickness": 1.0, name: [1.0, value]}
        return _refused(lambda: Floes([0.0, 9.0], 0.0, **sizes), name, "1", f"{value:g}")

    every = all(refused(name, v) for name in ("radius", "thickness") for v in (0.0, -2.0))
    yield fact("r or h of 0 or −2 is refused with floe and value", every)


@_case(7, "overlap-at-the-start", "½kδ² that nobody put in")
def _overlap_at_the_start(long: bool) -> Iterator[Measure]:
    """Random places, overlaps of half a radius and more: refused, and at rest after `relax`."""
    n = 2000 if long else 200
    side = float(np.sqrt(n * np.pi / 0.6))
    domain, rng = Domain((0.0, side), (0.0, side), *PERIODIC), np.random.default_rng(2)
    floes = Floes(*rng.uniform(0.0, side, (2, n)), 1.0, 1.0)
    says = ("overlap at the start", "floes ", " by ", "relax")
    refused = _refused(lambda: Model(domain, floes, frictional()), *says)
    yield fact("refused with the worst pairs", refused)
    left = relax(floes, domain)
    yield Measure("largest overlap that relax leaves, of the radius", left, "≤", 1e-3)
    model = Model(domain, floes, frictional())
    model.advance(1.0)
    fastest = float(np.hypot(floes.u, floes.v).max())
    yield Measure("fastest floe one second later [m/s]", fastest, "≤", 1e-2)


class _Chain(NamedTuple):
    """Result of pulling a chain apart.

    strength : largest force before a bond broke, over the strength of the weak link
    residual : largest energy residual from the break on, over the work of the pull
    """

    model: Model
    strength: float
    residual: float


def _chain(step: Step, order: np.ndarray | None = None) -> _Chain:
    """A chain of 10 floes with one weak link, pulled at 1 cm/s until it breaks, and for 20 s more."""
    n = 10
    x, u = 20.0 * np.arange(n) * (1 - 1e-7), np.linspace(0, 1e-2, n)
    thickness, motion = np.ones(n), np.zeros(n, int)
    thickness[4], motion[[0, -1]] = 0.9, FIXED
    at = np.arange(n) if order is None else order
    floes = Floes(x[at], 0.0, 10.0, thickness[at], u=u[at], motion=motion[at])
    domain = Domain((-500.0, 500.0), (-500.0, 500.0))
    model = Model(domain, floes, cohesive(500e3), step=step)
    force = residual = 0.0
    while not model.counters.bonds_broken:
        force = max(force, np.abs(model.contacts().fx).max())
        model.advance(0.1)
    for _ in range(200):
        model.advance(0.1)
        work = model.ledger.accounts["held floes and coast"][3]
        residual = max(residual, abs(model.ledger.balance("energy").residual) / work)
    return _Chain(model, force / (500e3 * 10.0 * 0.9), residual)


def _torn_pair(fraction: float) -> float:
    """A floe that tears itself off a fixed one: energy residual over its initial energy."""
    floes = Floes([0.0, 20.0], 0.0, 10.0, 1.0, u=[0.0, 4.0], motion=[FIXED, 0])
    floes.x[1] -= 1e-6
    box = Domain((-500.0, 500.0), (-500.0, 500.0))
    model = Model(box, floes, cohesive(500e3), step=Step(fraction=fraction))
    model.advance(2.0)
    balance = model.ledger.balance("energy")
    return abs(balance.residual) / balance.start


@_case(8, "bond-break", f"{PAPER}, Eq. 11; docs/theory.md, eq. broken-bond")
def _bond_break(long: bool) -> Iterator[Measure]:
    """A chain pulled apart: its strength, its energy, and independence of the order of floes."""
    whole = _chain(Step())
    model = whole.model
    strength = abs(whole.strength - 1.0)
    yield Measure("force at which the first bond breaks over σ_c R h", strength, "≤", 0.01)
    for fraction in (0.3, 0.9):
        what = f"a pair torn apart: energy residual, {fraction:g} of the limit"
        yield Measure(what, _torn_pair(fraction), "≤", 1e-9)
    yield Measure("chain: energy residual over the work", whole.residual, "≤", 1e-9)
    numbers = np.array([7, 2, 9, 0, 5, 1, 8, 3, 6, 4])
    shuffled = _chain(Step(), numbers).model.floes
    place = np.empty(10, int)
    place[numbers] = np.arange(10)
    off = _largest(shuffled.x[place], model.floes.x)
    yield Measure("difference of places, floes numbered otherwise [m]", off, "≤", 1e-9)
    accounts = model.ledger.accounts
    broken = -accounts["broken bonds"][3] / accounts["held floes and coast"][3]
    yield Measure("control: energy residual if broken bonds were not booked", broken, "≥", 0.1)


@_case(9, "far-from-the-origin", "double precision: 9e-10 m at 4e6 m; single: 0.25 m")
def _far_from_the_origin(long: bool) -> Iterator[Measure]:
    """A scene of colliding floes, shifted by 4000 km, evolves in the same way."""

    def places(shift: float, single: bool = False) -> np.ndarray:
        rng = np.random.default_rng(0)
        k = np.arange(16)
        # of few bits, so that the start is the same to the bit
        x, y = 20.0 + 19.5 * (k % 4) + k / 1024, 20.0 + 19.5 * (k // 4)
        if single:
            x = np.float32(x + shift) - shift
        u, v = rng.normal(0.0, 0.05, (2, 16))
        sides = (shift, shift + 128.0)
        domain = Domain(sides, sides, "periodic", "periodic", "closed", "closed")
        floes = Floes(x + shift, y + shift, 10.0, 1.0, u=u, v=v)
        model = Model(domain, floes, frictional())
        for _ in range(200 if long else 20):
            model.advance(1.0)
        return np.concatenate([floes.x - shift, floes.y - shift])

    here = places(0.0)
    yield Measure("largest difference of places [m]", _largest(places(4.0e6), here), "≤", 1e-9)
    rounded = _largest(places(4.0e6, single=True), here)
    yield Measure("control: x rounded once to single precision [m]", rounded, "≥", 1e-3)


@_case(10, "periodic-seam", "translation invariance")
def _periodic_seam(long: bool) -> Iterator[Measure]:
    """A bonded, rotating pair across a periodic edge moves for 100 000 steps as the same pair inside."""
    law = Contact(friction=Coulomb(), bonds=TensileStrength(500e3))
    step, times = 2.5e-3, 10 if long else 1

    def pair(x: float) -> Floes:
        domain = Domain((0.0, 100.0), (0.0, 100.0), *PERIODIC)
        floes = Floes([x - 9.9, x + 9.9], [50.0, 51.0], 10.0, 1.0, v=[0.02, -0.03])
        floes.x %= 100.0
        model = Model(domain, floes, law, step=Step(length=step))
        for _ in range(10):
            model.advance(10_000 * step * times)
        return floes

    def apart(x: float) -> float:
        places = np.mod(moved[x].x - inside.x - x, 100.0) - 50.0
        return float(max(np.abs(places).max(), _largest(moved[x].y, inside.y)) / 100.0)

    inside, moved = pair(50.0), {x: pair(x) for x in ((0.0, 70.0) if long else (0.0,))}
    # rounding of places is a random walk of the spin, ∝ √steps, which the places integrate: ∝ steps^1.5
    mark = 1e-12 * times**1.5
    yield Measure("largest difference of places over the period", apart(0.0), "≤", mark)
    if long:
        yield Measure("the same of a pair inside, 20 m aside: round-off alone", apart(70.0))
    spin = _largest(moved[0.0].angular_velocity / inside.angular_velocity, np.ones(2))
    what = f"largest relative difference of spin, round-off of {times}e5 steps"
    yield Measure(what, spin, "≤", 1e-9)


@_case(11, "high-stress", f"{PAPER}, section 2.5: walls")
def _high_stress(long: bool) -> Iterator[Measure]:
    """A pack under 1 MPa: the stress balances the wall's load, and no floe passes another's centre."""
    domain = Domain((0.0, 40.0), (0.0, 40.0), "periodic", "periodic", "closed", "closed")
    worst = passed = 0.0
    for stress in (1e4, 1e5, 1e6) if long else (1e6,):
        floes = scatter(domain, UniformSize(1.0, 1.5), concentration=0.8, seed=1)
        model = Model(domain, floes, frictional(), walls=[Wall("north", normal_stress=stress)])
        # a wall comes to the ice at N l h/(m d): 10 kPa move it by 0.04 m/s, for 7 s; then it settles
        for _ in range(24 if stress < 1e5 else 12):
            model.advance(1.0)
            passed = max(passed, _overlaps(model).max())
        worst = max(worst, abs(model.wall_stress()[0] / stress - 1.0))
    what = "largest overlap over the smaller radius (1: a centre is passed)"
    yield Measure(what, passed, "≤", 1.0)
    yield Measure("error of the stress on the wall", worst, "≤", 0.05)


@_case(12, "fast-collisions", "no tunnelling")
def _fast_collisions(long: bool) -> Iterator[Measure]:
    """Floes of any stiffness that collide at 100 m/s: resolved or refused, and never passing through each other."""
    box, rng = Domain((-500.0, 500.0), (-500.0, 500.0)), np.random.default_rng(0)
    through = refused = resolved = 0
    for modulus in np.geomspace(1e4, 1e9, 16) if long else (1e5, 2e6, 4e6, 2e7, 1e9):
        for _ in range(32 if long else 8):
            radius = rng.uniform(3.0, 10.0, 2)
            aside = rng.uniform(0.0, 0.5) * radius.min()
            floes = Floes([-30.0, 30.0], [0.0, aside], radius, 1.0, u=[50.0, -50.0])
            try:
                Model(box, floes, frictional(youngs_modulus=modulus)).advance(1.2)
            except StabilityError:
                refused += 1
            else:
                through += int(floes.x[0] > floes.x[1])
                resolved += int(floes.x[0] < floes.x[1])
    yield Measure("pairs that passed through each other", through, "=", 0)
    yield Measure("pairs resolved, E from 1e4 to 1e9 Pa", resolved, "≥", 1)
    yield Measure("pairs stopped with one line, softer ones", refused, "≥", 1)


@_case(13, "stale-neighbours", "a list made anew at every step")
def _stale_neighbours(long: bool) -> Iterator[Measure]:
    """A fast floe among many slow ones: the same motion whether neighbour lists are kept or rebuilt at each step."""
    across = 100 if long else 30
    k = np.arange(across * across)
    x, y = 2.5 * (k % across) + 10.0, 2.5 * (k // across)
    floes = Floes(np.append(x, 5.0), np.append(y, y.mean()), 1.0, 1.0, u=np.append(0.0 * x, 20.0))
    domain = Domain((-50.0, 500.0), (-50.0, 500.0))
    kept, anew = (Model(domain, floes.copy(), Contact(), step=Step(length=1e-3)) for _ in range(2))
    for _ in range(300):
        anew.advance(1e-3)
        anew._state.kept = None  # discards the neighbour list that it would go on using
    kept.advance(0.3)
    struck = np.count_nonzero(kept.floes.u[:-1] != 0.0)
    off = max(_largest(kept.floes.x, anew.floes.x), _largest(kept.floes.y, anew.floes.y))
    each = kept.counters.steps / kept.counters.rebuilds
    yield Measure("floes that were struck", struck, "≥", 3)
    yield Measure("largest difference of places [m]", off, "≤", 1e-9)
    yield Measure("steps for each list that was kept", each, "≥", 2)
    angle = np.arange(60) * 2 * np.pi / 60
    x, y = np.append(20.95 * np.cos(angle), 0.0), np.append(20.95 * np.sin(angle), 0.0)
    ring = Floes(x, y, np.append(np.ones(60), 20.0), 1.0)
    contacts = Model(domain, ring, Contact()).contacts()
    neighbours = np.count_nonzero((contacts.i == 60) | (contacts.j == 60))
    yield Measure("contacts of a large floe with 60 around it", neighbours, "=", 60)


@_case(14, "host-calls", "docs/couple.md")
def _host_calls(long: bool) -> Iterator[Measure]:
    """Any division of an interval by the host gives the same impulse; the same division gives the same bits."""

    def after(split: list[float], step: Step = Step()) -> Model:
        x, y, radius = [0.0, 30.0, 60.0], [0.0, 5.0, -5.0], [10.0, 12.0, 9.0]
        floes = Floes(x, y, radius, 1.0, u=[0.6, 0.0, -0.5])
        box, fluids = Domain((-900.0, 900.0), (-900.0, 900.0)), [OceanDrag(), AirDrag()]
        model = Model(box, floes, frictional(), fluids, step=step)
        model.ocean.u[:], model.atmosphere.v[:] = 0.2, 8.0
        for duration in split:
            model.advance(duration)
        return model

    total = 200.0
    rng = np.random.default_rng(3)
    random = np.diff(np.append(0.0, np.sort(rng.uniform(0, total, 40)))).tolist()

    def difference(step: Step) -> float:
        longest, reference = after([], step).longest_step(), after([total], step)
        splits = [[total / 10] * 10, [0.0, 1e-9, 0.3 * longest], [0.3 * longest] * 100, random]
        worst = 0.0
        for split in splits:
            model = after([*split, total - sum(split)], step)
            for name in ("ocean", "atmosphere"):
                one, other = getattr(model, name), getattr(reference, name)
                impulses = np.array([[f.impulse_x.sum(), f.impulse_y.sum()] for f in (one, other)])
                off = np.hypot(*(impulses[0] - impulses[1])) / np.hypot(*impulses[1])
                worst = max(worst, float(off))
        return worst

    coarse, fine = difference(Step()), difference(Step(fraction=0.1))
    yield Measure("largest difference of the impulse on the fluids, relative", coarse)
    yield Measure("the same, 0.1 of the limit", fine, "≤", 1e-3)
    yield Measure("order of that in the step", math.log(coarse / fine, 8.5), "≥", 1.0)
    yield fact("the same split gives the same bits", _same_bits(after(random), after(random)))
    floe, wide = Floes(50.0, 50.0, 10.0, 1.0), Domain((0.0, 1e9), (0.0, 100.0))
    free = Model(wide, floe, forces=[OceanDrag()])
    free.ocean.u[:] = 0.3
    free.advance(1e7)
    speed = free.floes.u[0] / 0.3
    yield Measure("speed after one call of 1e7 s over the water's", speed, "≤", 1.0)
    yield Measure("  and at least", speed, "≥", 0.999)


def _lagged(exchange: float, layer: float, implicit: bool, told: bool = False) -> tuple[float, int]:
    """Slab of water at 0.5 m/s under immobile ice: its speed after 40 exchanges over the first; warnings."""
    domain = Domain((0.0, 100.0), (0.0, 100.0))
    floes = Floes(50.0, 50.0, 45.0, 1.0, motion=FIXED)
    model = Model(domain, floes, forces=[OceanDrag(1000.0, 0.0, 5.5e-3)])
    if told:
        model.ocean.layer_thickness = layer
    model.ocean.u[:] = 0.5
    mass = 1000.0 * layer  # of the slab per area
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for _ in range(40):
            before = float(model.ocean.u[0])
            model.advance(exchange)
            stress = model.fluid_stress_fields()
            if implicit:
                kappa = stress["ocean_drag_coefficient"][0]
                model.ocean.u[:] = before / (1.0 + exchange * kappa / mass)
            else:
                model.ocean.u[:] = before + exchange * stress["ocean_stress_x"][0] / mass
            if abs(model.ocean.u[0]) > 50.0:
                break
    return abs(float(model.ocean.u[0])) / 0.5, len(caught)


@_case(15, "lagged-ocean", "docs/theory.md, eq. lagged-stress")
def _lagged_ocean(long: bool) -> Iterator[Measure]:
    """A host that applies the previous stress, under ice that cannot move."""
    coefficient = 5.5e-3 * np.pi * 45.0**2 / 100.0**2  # c C_d
    layer = 1.0
    bound = 2.0 * layer / (coefficient * 0.5)  # exchange at which Δt c C_d |Δu|/Δz = 2
    below, above = _lagged(0.9 * bound, layer, False), _lagged(1.1 * bound, layer, False)
    yield Measure("explicit host, 0.9 of the bound: last speed over the first", below[0], "≤", 1.0)
    yield Measure("explicit host, 1.1 of the bound (control: it diverges)", above[0], "≥", 10.0)
    for times in (1.1, 10.0, 1000.0) if long else (1.1, 10.0):
        implicit = _lagged(times * bound, layer, True)[0]
        yield Measure(f"implicit host, {times:g} of the bound", implicit, "≤", 1.0)
    warned, unwarned = (_lagged(by * bound, layer, False, True)[1] for by in (1.1, 0.9))
    yield Measure("warnings where the host tells its layer: above the bound", warned, "=", 1)
    yield Measure("  and below it", unwarned, "=", 0)


@_case(16, "area-budget", "docs/theory.md, eq. area-budget")
def _area_budget(long: bool) -> Iterator[Measure]:
    """Empty cells, cells covered more than once, rows of land: area is conserved for every mask."""
    sea, beyond, rng = (0.0, 1000.0), (-20.0, 1020.0), np.random.default_rng(5)
    n, cells = (4000, 40) if long else (400, 12)
    floes = Floes(*rng.uniform(*beyond, (2, n)), rng.uniform(1.0, 60.0, n), 1.0)
    floes.x[:50], floes.y[:50] = 500.0, 500.0  # a heap: concentration far above 1
    masks = {"all wet": np.ones((cells, cells), bool), "no water": np.zeros((cells, cells), bool)}
    masks["rows of land"] = np.tile(np.arange(cells)[:, None] % 3 > 0, cells)
    masks["at random"] = rng.random((cells, cells)) < 0.5
    worst, most, finite = 0.0, 0.0, True
    for wet in masks.values():
        grid = Grid.uniform(sea, sea, shape=(cells, cells)).with_wet(wet)
        model = Model(Domain(beyond, beyond), floes.copy(), forces=[OceanDrag()], grid=grid)
        fields, covered = model.fields(), model.coverage()
        both = fields["area_fraction"] + fields["overlap_fraction"]
        total = (grid.area * both).sum() + covered.outside.sum()
        worst = max(worst, abs(total / floes.area.sum() - 1.0))
        most = max(most, both.max())
        finite &= bool(np.isfinite([*fields.values()]).all())
    yield Measure("area of floes that cells, overlap and outside miss, relative", worst, "≤", 1e-12)
    yield Measure("largest sum of areas over that of its cell", most, "≥", 1.5)
    yield fact("all fields finite", finite)


@_case(17, "bad-forcing", "docs/couple.md: NaN is refused")
def _bad_forcing(long: bool) -> Iterator[Measure]:
    """NaN on a wet cell is refused, and a wind that jumps from 0 to 40 m/s causes no instability."""
    domain = Domain((0.0, 40.0), (0.0, 40.0))
    floes = scatter(domain, UniformSize(0.7, 1.0), concentration=0.5, seed=1)
    wet = np.arange(16) != 3
    grid = Grid.uniform(domain.x, domain.y, shape=(4, 4)).with_wet(wet)
    model = Model(domain, floes, frictional(), [OceanDrag(), AirDrag()], grid)
    model.advance(1.0)
    before = model.floes.copy()
    model.ocean.u[3] = np.nan  # dry: never read
    model.advance(0.0)
    model.atmosphere.v[5] = np.nan
    refused = _refused(lambda: model.advance(1.0), "atmosphere.v", "cell 5", "t = 1 s")
    yield fact("refused with field, cell and time", refused)
    untouched = np.array_equal(before.x, model.floes.x) and model.time == 1.0
    yield fact("the model is then as before", untouched)
    model.atmosphere.v[:] = 40.0
    model.advance(60.0 if long else 10.0)
    finite = np.isfinite([model.floes.x, model.floes.v]).all()
    yield fact("all finite after a jump to 40 m/s", finite)
    residual = model.ledger.balance("energy").relative
    yield Measure("energy residual over what was exchanged", residual, "≤", 1e-3)


def _busy(seconds: float, state: dict | None = None) -> Model:
    """Friction, bonds, a closed edge, current, wind and rotation, outflow and random inflow of floes; run for a while.

    state : restart of the same scene to continue from
    """
    domain = Domain((0.0, 30.0), (0.0, 30.0), "inactive", "inactive", "closed", "inactive")
    floes = scatter(domain, UniformSize(0.7, 1.0), concentration=0.6, seed=1)
    rng = np.random.default_rng(2)
    floes.u[:], floes.v[:] = rng.normal(0.0, 0.3, (2, len(floes)))
    floes.v -= 0.5
    law = Contact(friction=Coulomb(), bonds=TensileStrength(50e3))
    feed = Inflow("north", PowerLaw(0.7, 1.0), velocity=(0.0, -0.5))
    forces = [OceanDrag(), AirDrag(), Coriolis(1e-4)]
    model = Model(domain, floes, law, forces, inflow=feed, seed=4)
    model.ocean.u[:], model.atmosphere.v[:] = 0.4, -10.0
    if state is not None:
        model.restore(state)
    model.advance(seconds)
    return model


@_case(18, "restart", "bit for bit")
def _restart(long: bool) -> Iterator[Measure]:
    """2N steps equal N steps, a restart, and N steps, in the middle of contacts, with bonds and a random inflow."""
    duration = 20.0 if long else 4.0
    whole = _busy(duration)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "restart.nc"
        save_restart(path, whole.state())
        state = load_restart(path)[0]
    contacts, n = len(whole.contacts().i), len(whole.floes)
    whole.advance(duration)
    yield Measure("contacts at the restart", contacts, "≥", 20)
    yield Measure("floes that came in after it", len(whole.floes) - n, "≥", 1)
    yield fact("the same bits", _same_bits(whole, _busy(duration, state)))
    forgetful = _busy(duration, state | {"pair_slip": 0.0 * state["pair_slip"]})
    same = float(_same_bits(whole, forgetful))
    yield Measure("control: the same without the slip of contacts", same, "=", 0)


def _large(steps: int, threads: int) -> Model:
    """60 000 floes in a dense lattice with random velocities: enough to use several threads."""
    side = 20.0 * 245
    domain = Domain((0.0, side), (0.0, side), *PERIODIC)
    floes = regular(domain, 9.99, spacing=20.0, lattice="square")
    rng = np.random.default_rng(5)
    floes.u[:], floes.v[:] = rng.normal(0.0, 0.5, (2, len(floes)))
    model = Model(domain, floes, frictional(), step=Step(length=0.01), threads=threads)
    model.advance(0.01 * steps)
    return model


@_case(19, "threads", "order of sums")
def _threads(long: bool) -> Iterator[Measure]:
    """A large pack on one thread and on two: bit for bit."""
    steps = 400 if long else 40
    one, two = (_large(steps, threads) for threads in (1, 2))
    yield Measure("contacts of 60 000 floes at the end", len(one.contacts().i), "≥", 1000)
    yield fact("the same bits", _same_bits(one, two))
    same = float(_same_bits(_large(steps - 1, 1), one))
    yield Measure("control: a step less, the same bits", same, "=", 0)


class _Sheared(NamedTuple):
    """Result for a sheared pack: τ/N, the inertia number I, and the mean overlap over the smaller radius."""

    friction: float
    inertia_number: float
    overlap: float


def _sheared(youngs_modulus: float, seed: int, strain: float) -> _Sheared:
    """A small pack, radii of 5 to 10 m, between fixed and driven floes under 20 kPa."""
    stress, speed, side = 20e3, 0.3, 150.0
    sides = "periodic", "periodic", "closed"
    loose = Domain((0.0, side), (0.0, side), *sides, "closed")
    domain = Domain((0.0, side), (0.0, 1.3 * side), *sides)
    floes = scatter(loose, UniformSize(5.0, 10.0), concentration=0.82, seed=seed)
    law = frictional(youngs_modulus=youngs_modulus, restitution=0.3)
    press = Model(domain, floes, law, walls=[Wall("north", side, normal_stress=stress)])
    press.advance(150.0)
    height = float(press.wall_positions[0])
    floes.u[:] = floes.v[:] = floes.angular_velocity[:] = 0.0
    standing, driven = floes.y < 12.0, floes.y > height - 12.0
    floes.motion[standing], floes.motion[driven] = FIXED, FIXED_X | FIXED_ROTATION
    floes.u[driven] = speed
    # critical damping would grow with √E, and with it the force that the wall itself sets against dilation
    damping = math.sqrt(2e6 / youngs_modulus)
    top = Wall("north", height, normal_stress=stress, damping=damping)
    model = Model(domain, floes, law, walls=[top])
    forces, overlaps = [], []
    for k in range(round(strain / 0.02)):
        model.advance(0.02 * height / speed)
        c = model.contacts()
        one, other = driven[c.i], driven[c.j]
        if 0.02 * k >= 0.3:  # steady
            forces.append(c.fx[other & ~one].sum() - c.fx[one & ~other].sum())
            overlaps.append(_overlaps(model).mean())
    number = speed / height * 15.0 * math.sqrt(DENSITY / stress)
    return _Sheared(float(np.mean(forces)) / (side * stress), number, float(np.mean(overlaps)))


@_case(20, "softened-modulus", f"{PAPER}, Eq. 3")
def _softened_modulus(long: bool) -> Iterator[Measure]:
    """A smaller E, for a longer time step: above which E a sheared pack under 20 kPa no longer depends on it."""
    moduli = (2e6, 2e7, 2e8, 2e9) if long else (2e6, 2e7)
    seeds, strain = (4, 1.2) if long else (1, 0.6)
    packs = {}
    for modulus in moduli:
        runs = [_sheared(modulus, seed, strain) for seed in range(seeds)]
        pack = packs[modulus] = _Sheared(*np.mean(runs, axis=0))
        name = f"E = {modulus:.0e} Pa"
        yield Measure(f"{name}: bulk friction, I = {pack.inertia_number:.1e}", pack.friction)
        yield Measure(f"{name}: mean overlap over the smaller radius", pack.overlap)
    yield Measure("overlap at the default E, 2e7 Pa", packs[2e7].overlap, "≤", 0.01)
    yield Measure("control: overlap at 2e6 Pa", packs[2e6].overlap, "≥", 0.01)
    if long:
        change = abs(packs[2e7].friction / packs[2e9].friction - 1.0)
        yield Measure("friction at 2e7 Pa against 2e9 Pa, relative", change, "≤", 0.2)


@_case(21, "fast-spin", f"{PAPER}, Eq. 14; exact solution ω/(1 + K|ω|t)")
def _fast_spin(long: bool) -> Iterator[Measure]:
    """A floe that spins at 10 rad/s in still water, with 100 times the usual time step: monotonic decay."""

    def spins(scheme: Literal["verlet", "taylor2"]) -> tuple[np.ndarray, np.ndarray]:
        floes = Floes(0.0, 0.0, 10.0, 1.0, rotation=True, angular_velocity=10.0)
        box, fluids = Domain((-500.0, 500.0), (-500.0, 500.0)), (OceanDrag(), AirDrag())
        step = 100 * Model(box, floes.copy(), frictional()).longest_step()
        model = Model(box, floes, frictional(), fluids, step=Step(scheme, length=step))
        values = [10.0]
        for _ in range(1000 if long else 100):
            try:
                model.advance(step)
            except StabilityError:  # the ledger sees it
                values.append(math.inf)
                break
            values.append(float(floes.angular_velocity[0]))
        sides = zip(fluids, (0.9, 0.1), strict=True)  # draft and freeboard [m]
        drag = sum(2 * f.density * (2.0 * f.horizontal + f.vertical * h) for f, h in sides)
        rate = drag / DENSITY
        return np.array(values), 10.0 / (1.0 + 10.0 * rate * step * np.arange(len(values)))

    values, exact = spins("verlet")
    yield Measure("largest rise from step to step [rad/s]", np.diff(values).max(), "≤", 0.0)
    yield Measure("least spin [rad/s]", values.min(), "≥", 0.0)
    error = np.abs(values / exact - 1).max()
    yield Measure("largest error of the exact decay, relative", error, "≤", 0.01)
    explicit = np.abs(spins("taylor2")[0]).max() / 10.0
    yield Measure(
        "control: largest |spin| of the explicit scheme over the first", explicit, "≥", 1.5
    )


@_case(22, "few-and-many", "valid files")
def _few_and_many(long: bool) -> Iterator[Measure]:
    """No floe, one, two, all fixed, and very many: the runs work, and their files can be read."""
    with tempfile.TemporaryDirectory() as folder:
        many = 1_000_000 if long else 20_000
        for name, n in (("0", 0), ("1", 1), ("2", 2), ("all fixed", 9), ("many", many)):
            across = max(1, math.ceil(math.sqrt(n)))
            side = 21.0 * across
            k = np.arange(n)
            x, y = 21.0 * (k % across) + 10.5, 21.0 * (k // across) + 10.5
            floes = Floes(x, y, 10.0, 1.0, motion=FIXED if name == "all fixed" else 0)
            domain = Domain((0.0, side), (0.0, side))
            grid = Grid.uniform(domain.x, domain.y, shape=(4, 4))
            model = Model(domain, floes, frictional(), [OceanDrag(), AirDrag()], grid)
            model.atmosphere.u[:] = 10.0
            files = [Path(folder) / f"{kind} {name}.nc" for kind in ("grid", "floes")]
            run(model, 2.0, every=1.0, gridded=files[0], trajectories=files[1])
            with (
                open_file(files[0], "gridded") as fields,
                open_file(files[1], "trajectories") as ways,
            ):
                good = len(fields.dimensions["time"]) == 3
                good &= len(ways.dimensions["trajectory"]) == n
                area = float((fields["sea_ice_area_fraction"][-1] * grid.area.reshape(4, 4)).sum())
                good &= bool(np.isfinite(np.ma.getdata(ways["x"][:])).all())
            good &= bool(abs(area - floes.area.sum()) <= 1e-3 * max(1.0, floes.area.sum()))
            which = f"{n} floes, all fixed" if name == "all fixed" else f"{n} floes"
            yield fact(f"{which}: ran, files hold them", good)
