"""What no law says about the axes: a scene that is turned by a right angle goes the same way, turned, and wherever the seam lies.

Run without being compiled, since few floes for few steps take less time than their kernels would.
"""

import numpy as np
import pytest
from uncompiled import in_plain_python

from floebmi.bonds import Beam, TensileStrength
from floebmi.boundaries import Domain, Wall
from floebmi.contact import Contact, Coulomb, Restitution
from floebmi.dynamics import Step
from floebmi.floes import COAST, DRIVEN, FIXED_ROTATION, FIXED_X, FIXED_Y, Floes
from floebmi.forces import AirDrag, BodyForce, Coriolis, OceanDrag
from floebmi.model import Model

BONDED = Contact(friction=Coulomb(), bonds=TensileStrength(50e3))
BEAMS = Contact(bonds=TensileStrength(50e3, beam=Beam(50e3)))
DAMPED = Contact(dashpot=Restitution(0.3))
# a law, a step, and the share of the energy that may be lost at it
RUNS = {
    "friction": (Contact(friction=Coulomb()), Step(fraction=0.3, drag_every=3), 3e-4),
    "dashpots": (DAMPED, Step(fraction=0.4), 1e-3),
    "beams": (BEAMS, Step(fraction=0.1), 1e-4),
    "the paper's scheme": (BONDED, Step("taylor3", epsilon=0.04), 3e-3),
}
PUSH = 1e-2, -2e-2  # body force [m/s²]
EDGES = "west", "south", "east", "north", "west"


def turn(x, y, turned=True):
    return (-np.asarray(y), np.asarray(x)) if turned else (np.asarray(x), np.asarray(y))


def enclosed(turned, law, step):
    """Floes of which each kind of axis is held, and a piece of coast, between walls that stand, move and are loaded."""
    x = [-39.95, -19.9, 0.1, 20.0, -30.0, -10.0, 10.0, 29.0]
    y = [0.0, 1.0, -1.0, 2.0, 18.3, 17.5, 18.2, 19.0]
    u = [0.1, 0.3, -0.2, 0.05, 0.1, 0.0, 0.05, 0.0]
    v = [0.1, 0.2, 0.1, 0.2, -0.2, -0.3, -0.25, 0.0]
    radius = [10.0, 9.8, 10.1, 9.6, 9.7, 10.0, 9.9, 10.0]
    one, other = (FIXED_Y, FIXED_X) if turned else (FIXED_X, FIXED_Y)
    motion = [0, 0, other, one, FIXED_ROTATION, 0, one | FIXED_ROTATION, COAST]
    (x, y), (u, v) = turn(x, y, turned), turn(u, v, turned)
    floes = Floes(x, y, radius, np.linspace(0.8, 1.5, 8), u=u, v=v, motion=motion)
    kinds = {
        "west": (-49.93, dict(velocity=0.2)),
        "south": (-11.2, {}),
        "east": (29.58, dict(normal_stress=1e4)),
        "north": (27.98, dict(normal_stress=2e4, mass=1e5)),
    }
    walls = []
    for edge, (place, kind) in kinds.items():
        if turned:
            place = -place if edge in ("south", "north") else place
            edge = EDGES[EDGES.index(edge) + 1]
        walls.append(Wall(edge, place, **kind))
    push = map(float, turn(*PUSH, turned))
    forces = [OceanDrag(horizontal=5.0), AirDrag(), Coriolis(1e-2), BodyForce(*push)]
    domain = Domain((-100.0, 100.0), (-100.0, 100.0))
    model = Model(domain, floes, law, forces, walls=walls, step=step)
    if model.floes.rotation:
        floes.angular_velocity[:7] = np.linspace(-0.01, 0.02, 7)
    model.ocean.u[:], model.ocean.v[:] = turn(0.3, -0.2, turned)
    model.atmosphere.u[:], model.atmosphere.v[:] = turn(10.0, 20.0, turned)
    return model


def found(name, turned):
    """What a run leaves behind, turned back, and how far its books are from closed."""
    law, step, _ = RUNS[name]
    model = enclosed(turned, law, step)
    for _ in range(2):
        model.advance(0.15)
    floes, ledger = model.floes, model.ledger
    xs, ys = np.stack([floes.x, floes.u]), np.stack([floes.y, floes.v])
    rows = [row for _, row in sorted(ledger.accounts.items())]
    mass, along_x, along_y, energy = np.transpose([ledger.now, *rows])
    push = ledger.accounts["body force"][1:3] / (model.time * ledger.now[0])
    if turned:  # back
        xs, ys, along_x, along_y = ys, -xs, along_y, -along_x
        push = push[1], -push[0]
    balances = {q: ledger.balance(q).relative for q in ("momentum_x", "momentum_y", "energy")}
    left = dict(x=xs, y=ys, mass=mass, along_x=along_x, along_y=along_y, energy=energy)
    left |= dict(walls=np.abs(model.wall_positions), stress=model.wall_stress())
    left |= dict(step=model.longest_step(), push=push)
    if floes.rotation:
        left |= dict(spin=floes.angular_velocity, angle=floes.angle)
    return {what: np.ravel(values).tolist() for what, values in left.items()}, balances


SIDE = 40.0
SHIFTS = (0.0, 0.0), (11.0, 0.0), (5.0, 23.0)


def around(law, shift):
    """Floes that press each other in a box without edges, shifted; what they leave behind, from where they began."""
    at = 5.0 + 10.0 * np.arange(4)
    x, y = (np.ravel(a) + by for a, by in zip(np.meshgrid(at, at), shift, strict=True))
    rng = np.random.default_rng(4)
    u, v = rng.normal(0.0, 0.3, (2, 16))
    domain = Domain((0.0, SIDE), (0.0, SIDE), *["periodic"] * 4)
    floes = Floes(x % SIDE, y % SIDE, rng.uniform(4.9, 5.02, 16), 1.0, u=u, v=v)
    model = Model(domain, floes, law, step=Step(fraction=0.3))
    left = dict(first_step=model.longest_step())
    for _ in range(2):
        model.advance(0.15)
    dx, dy = floes.x - x, floes.y - y
    left |= dict(dx=dx - SIDE * np.rint(dx / SIDE), dy=dy - SIDE * np.rint(dy / SIDE))
    left |= dict(u=floes.u, v=floes.v, angle=floes.angle, step=model.longest_step())
    contacts = model.contacts()
    left |= dict(energy=model.ledger.now[3], n=len(contacts.i), force=np.abs(contacts.fx).sum())
    return {what: np.ravel(values).tolist() for what, values in left.items()}


def dragged(scheme, motion):
    """More floes than are dragged at a time, apart from each other: what is held of them, and how far the books are from closed."""
    x, y = (
        np.ravel(a) for a in np.meshgrid(np.arange(10) * 30.0 + 15.0, np.arange(7) * 30.0 + 15.0)
    )
    kind, number = np.resize(motion, 70), np.arange(70)
    floes = Floes(x, y, 5.0 + 0.1 * number, 1.0 + 0.02 * number, u=0.3, v=-0.2, motion=kind)
    floes.u += 1e-3 * number
    drag = [OceanDrag(horizontal=5.0), AirDrag(), Coriolis(1e-2), BodyForce(1e-3, 2e-3)]
    domain, law = Domain((0.0, 300.0), (0.0, 210.0)), Contact(friction=Coulomb())
    model = Model(domain, floes, law, drag, step=Step(scheme, length=0.05))
    floes.angular_velocity[:] = 1e-3 * (1 + number)
    model.ocean.v[:], model.atmosphere.u[:] = 0.4, 20.0
    before = floes.copy()
    model.advance(0.1)
    bits = zip(("u", "v", "angular_velocity"), (FIXED_X, FIXED_Y, FIXED_ROTATION), strict=True)
    kept = [
        np.array_equal(getattr(floes, name) == getattr(before, name), kind & bit != 0)
        for name, bit in bits
    ]
    return kept, [model.ledger.balance(q).relative for q in ("momentum_x", "momentum_y", "energy")]


HELD = {
    "each axis": ("verlet", [0, FIXED_X, FIXED_Y, FIXED_ROTATION, FIXED_X | FIXED_Y]),
    "spins": ("verlet", [0, FIXED_ROTATION]),
    "each axis in the paper's scheme": ("taylor3", [0, FIXED_X, FIXED_Y, FIXED_ROTATION]),
    "all axes in the paper's scheme": ("taylor3", [DRIVEN]),
}


def parted(parts):
    """Where floes are after so many exchanges of a run, whose contacts remember what came before."""
    model = enclosed(False, BONDED, Step("taylor3", length=0.004))
    for _ in range(parts):
        model.advance(0.08 / parts)
    return [*model.floes.x.tolist(), *model.floes.v.tolist(), *model.floes.angle.tolist()]


def met(step, axis, wall):
    """The speeds of a floe at rest, that has none near, after a fast floe or a fast wall met it."""
    place, other, speed = [0.0, 24.0], [0.0, 0.0], [0.0, -8.0]
    walls = []
    if wall:
        place, other, speed = [0.0], [0.0], [0.0]
        walls = [Wall(("east", "north")[axis], 14.0, -8.0)]
    where, how = ((place, other), (speed, other)) if axis == 0 else ((other, place), (other, speed))
    floes = Floes(*where, 10.0, 1.0, u=how[0], v=how[1])
    domain = Domain((-200.0, 200.0), (-200.0, 200.0))
    model = Model(domain, floes, Contact(), walls=walls, step=step)
    model.advance(0.9)
    return [float(floes.u[0]), float(floes.v[0])]


STEPS = {"verlet": Step(length=0.01), "taylor3": Step("taylor3", length=0.01)}


def all_runs():
    turned = {name: [found(name, each) for each in (False, True)] for name in RUNS}
    laws = {"friction and bonds": BONDED, "beams": BEAMS}
    shifted = {name: [around(law, shift) for shift in SHIFTS] for name, law in laws.items()}
    held = {name: dragged(*how) for name, how in HELD.items()}
    fast = {
        name: {
            kind: [met(step, axis, kind == "wall") for axis in (0, 1)] for kind in ("floe", "wall")
        }
        for name, step in STEPS.items()
    }
    return {
        "turned": turned,
        "shifted": shifted,
        "held": held,
        "parts": [parted(1), parted(2)],
        "fast": fast,
    }


@pytest.fixture(scope="module")
def runs():
    return in_plain_python("test_symmetry", "t.all_runs()")


def assert_alike(one, other, tolerance):
    for what, values in one.items():
        error = tolerance * np.abs(values).max(initial=0.0)
        np.testing.assert_allclose(other[what], values, rtol=0, atol=error, err_msg=what)


@pytest.mark.parametrize("name", RUNS)
def test_a_scene_that_is_turned_goes_the_same_way_turned_and_its_books_close(runs, name):
    (left, balances), (turned, _) = runs["turned"][name]
    assert_alike(left, turned, 1e-12)
    assert left["push"] == pytest.approx(PUSH, rel=1e-12)  # of all ice, and not of the coast
    assert balances["momentum_x"] < 1e-14 and balances["momentum_y"] < 1e-14
    assert balances["energy"] < RUNS[name][2]


@pytest.mark.parametrize("name", ["friction and bonds", "beams"])
def test_where_the_seam_lies_makes_no_difference(runs, name):
    first, *others = runs["shifted"][name]
    assert first["n"][0] > 5
    for other in others:  # blows are struck one after the other, so their order shows a little
        assert_alike(first, other, 1e-4)


@pytest.mark.parametrize("name", HELD)
def test_what_holds_an_axis_takes_up_the_drag_along_it_and_nothing_else_is_held(runs, name):
    kept, (momentum_x, momentum_y, energy) = runs["held"][name]
    assert all(kept)
    assert momentum_x < 1e-14 and momentum_y < 1e-14
    # the paper's scheme is explicit: its books of energy are of first order
    assert energy < 1e-13 or name == "each axis in the paper's scheme"


def test_what_contacts_remember_outlives_an_exchange_in_the_papers_scheme(runs):
    once, twice = runs["parts"]
    assert once == pytest.approx(twice, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("scheme", STEPS)
def test_a_fast_floe_or_wall_from_afar_is_met_along_either_axis(runs, scheme):
    for speeds in runs["fast"][scheme].values():
        (along, _), (_, too) = speeds
        assert along == too < -1.0
