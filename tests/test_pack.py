"""Packed floes: where each number of a floe goes and comes back to, what sets their step, what is seen of them."""

from types import SimpleNamespace

import numpy as np
import pytest
from uncompiled import uncompiled

from floebmi.bonds import Beam, TensileStrength, beam_of, bending_ratio
from floebmi.contact import (
    Contact,
    Coulomb,
    Dashpot,
    Elastic,
    damping,
    largest_ratio,
    lever_arm,
    stiffness,
)
from floebmi.dynamics import WALL
from floebmi.floes import FIXED_ROTATION, FIXED_X, FIXED_Y, Floes
from floebmi.listing import Memory
from floebmi.neighbours import carry
from floebmi.pack import FLOE, FORCE_AND_TORQUE, pack, pack_again, places, unpack
from floebmi.pairs import Near, PairList
from floebmi.stable_step import STIFFNESS, _stiffest, largest_eigenvalue
from floebmi.survey import deepest, pressed, survey

ORIGIN = 1e6, 2e6


def packed(floes, number, previous):
    x, y = floes.x[number] - ORIGIN[0], floes.y[number] - ORIGIN[1]
    return pack(floes, number, x, y, 900.0, previous, ORIGIN)


def test_a_floe_is_packed_with_all_that_is_its_own_and_again_with_what_has_changed():
    motion = [FIXED_Y, 0, FIXED_X | FIXED_ROTATION]
    floes = Floes(
        [1.1, 2.2, 3.3],
        [4.4, 5.5, 6.6],
        [1.0, 2.0, 3.0],
        [0.5, 0.6, 0.7],
        motion=motion,
        rotation=True,
    )
    for name in ("friction", "tensile_strength"):
        floes.allow_own(name)
    floes.friction[:], floes.tensile_strength[:] = [0.1, 0.2, 0.3], [1.0, 2.0, 3.0]
    number, previous = np.array([2, 0, 1]), np.arange(9.0).reshape(3, 3)
    p = packed(floes, number, previous)
    inverse = 1.0 / floes.mass(900.0)[number]
    assert np.array_equal(p.inverse_x, inverse * [0, 1, 1])
    assert np.array_equal(p.inverse_y, inverse * [1, 0, 1])
    assert np.array_equal(p.inverse_spin > 0, [False, True, True]) and p.held.tolist() == [0, 1]
    assert np.array_equal(p.previous, previous[number])
    assert p.friction.tolist() == [0.3, 0.1, 0.2] and p.tensile_strength.tolist() == [3.0, 1.0, 2.0]
    floes.friction[0], floes.v[1] = 0.5, 0.25
    again = pack_again(p, floes, p.first_x + 1.0, p.first_y, -previous)
    assert again.friction[1] == 0.5 and again.floes["v"][2] == 0.25
    assert np.array_equal(again.first_x, p.first_x + 1.0) and np.array_equal(
        again.previous, -previous[number]
    )


def test_what_moved_comes_back_to_its_floe_with_what_rounding_took_and_what_did_not_keeps_its_place():
    floes = Floes([0.1, 0.2, 1e6 + 0.3], [2e6 + 0.4, 0.5, 0.6], 1.0, 1.0)
    before, number = floes.copy(), np.array([2, 0, 1])
    previous, remainder = np.zeros((3, 3)), np.full((3, 2), 7.0)
    p = packed(floes, number, previous)
    p.floes["x"][0] += 1e-9  # floe 2 along x, floe 0 along y
    p.floes["y"][1] += 1e-9
    p.floes["u"], p.floes["v"], p.previous[:] = (
        [1.0, 2.0, 3.0],
        [4.0, 5.0, 6.0],
        np.arange(9.0).reshape(3, 3),
    )
    unpack(p, floes, previous, remainder)
    assert np.array_equal(floes.x[:2], before.x[:2]) and np.array_equal(floes.y[1:], before.y[1:])
    assert floes.x[2] == p.floes["x"][0] + 1e6 and floes.y[0] == p.floes["y"][1] + 2e6
    assert floes.u.tolist() == [2.0, 3.0, 1.0] and floes.v.tolist() == [5.0, 6.0, 4.0]
    assert np.array_equal(previous[number], p.previous)
    assert remainder[2, 0] == p.floes["x"][0] - (floes.x[2] - 1e6) != 0.0
    assert remainder[0, 1] == p.floes["y"][1] - (floes.y[0] - 2e6)
    assert np.count_nonzero(remainder == 7.0) == 4
    x, y = places(floes, number, ORIGIN, np.where(remainder == 7.0, 0.0, remainder))
    assert x[0] == p.floes["x"][0] and y[1] == p.floes["y"][1]


def test_the_deepest_pair_is_by_the_smaller_radius_across_seams_and_of_what_moves():
    # pairs 0-1 (both held, deepest), 2-3 (3 of 5 m), 4-5 across the seam (4 of 10 m), in a list of two parts
    x, y = [0.0, 0.5, 0.0, 22.0, 1.0, 1.0], [50.0, 50.0, 30.0, 30.0, 1.0, 85.0]
    floes = np.zeros(6, FLOE).view(np.recarray)
    floes.x, floes.y = x, y
    floes.r, floes.w = [5.0, 5.0, 20.0, 5.0, 10.0, 10.0], [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]
    i, j, slot = (
        np.array([0, 2, *[0] * 4, 4]),
        np.array([1, 3, *[1] * 4, 5]),
        np.array([4, 7, *[0] * 4, 9]),
    )
    near = Near(None, None, None, slot, i, j, None, np.array([0, 2, 3]), np.array([2, 1]))
    assert uncompiled(deepest)(None, 100.0, floes, near) == (7, 3.0 / 5.0)
    floes.x[3] += 2.0
    assert uncompiled(deepest)(None, 100.0, floes, near) == (9, 4.0 / 10.0)


@pytest.mark.parametrize("name", ["x", "y", "u", "v", "omega", "angle"])
def test_a_survey_sees_what_is_no_number_and_the_fastest_by_size_and_by_spin(name):
    floes = np.zeros(3, FLOE).view(np.recarray)
    floes.u, floes.v, floes.r = [3.0, 0.0, 0.0], [4.0, 0.0, 2.0], [10.0, 1.0, 2.0]
    floes.omega = [0.1, -0.5, 0.2]
    mass, angle = np.array([2.0, 5.0, 1.0]), np.zeros(3)
    p = SimpleNamespace(floes=floes, spinning=floes, mass=mass, angle=angle)
    assert uncompiled(survey)(p) == (True, 0.5 * (2.0 * 25.0 + 4.0), 5.0, 0.5, 1.0, 2)
    for wrong in (np.nan, np.inf, -np.inf):
        (angle if name == "angle" else floes[name])[1] = wrong
        assert not uncompiled(survey)(p)[0]


def test_pairs_are_saved_by_the_numbers_of_their_floes_and_bent_the_other_way_if_these_change_places():
    number, ends = np.array([2, 0, 1, 3]), (np.array([0, 1, 0, 3]), np.array([1, 2, 2, 2]))
    slip, bent = np.array([0.5, 0.0, 0.0, -0.4]), np.array([0.1, 0.2, 0.0, 0.0])
    saved = Memory(PairList(None, *ends, slip=slip, bent=bent), number).by_number(4).pairs
    assert saved.start.tolist() == [0, 2, 3, 3, 3]
    assert saved.i.tolist() == [0, 0, 1] and saved.j.tolist() == [1, 2, 3]
    assert saved.slip.tolist() == [0.0, 0.5, -0.4] and saved.bent.tolist() == [0.2, -0.1, 0.0]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_what_pairs_remember_finds_its_slot_in_a_tile_and_across_a_seam(sign):
    """In a new list floes 2, 0, 4 are rows 2, 1, 3 with a pair within a tile and one across; floe 5 has left."""
    start, seam, j = np.array([0, 0, 0, 1, 1]), np.array([1, 1, 1, 1, 2]), np.array([1, 1])
    number, place = np.array([2, 0, 4, 5]), np.array([1, 0, 2, -1, 3, -1])

    def carried(i, j_old):
        memory = np.zeros(2)
        old = np.array([0.1, 0.2, 0.3, 0.4])
        uncompiled(carry)(i, j_old, number, old, place, start, seam, j, memory, sign)
        return memory.tolist()

    later, earlier = np.array([0, 2, 3, 1]), np.array([1, 1, 1, 3])
    assert carried(later, earlier) == [0.1, 0.2]
    assert carried(earlier, later) == [sign * 0.1, sign * 0.2]


def test_the_stiffest_floe_is_that_of_the_sums_of_its_contacts():
    """A star of unequal floes across both seams, three of them held along x or all; one too far away to count."""
    law = Contact(Elastic(), Coulomb(), TensileStrength(2e6, beam=Beam(1e5)), Dashpot(0.2))
    n, closing, widest, side = 13, 0.05, 0.03, 50.0
    rng = np.random.default_rng(7)
    angle = np.arange(n) * 2.0 * np.pi / (n - 1) + 0.1
    floes = np.zeros(n, FLOE).view(np.recarray)
    floes.r, floes.h = rng.uniform(4.0, 6.0, n), rng.uniform(1.0, 2.0, n)
    floes.r[0] = 16.0
    gap = rng.uniform(-0.2, widest * 19.0, n)
    for k, share in ((3, 1.1), (4, 0.9)):
        gap[k] = widest * (16.0 + floes.r[k]) + share * closing
    away = 16.0 + floes.r + gap
    away[0] = 0.0
    floes.x, floes.y = away * np.cos(angle) % side, away * np.sin(angle) % side
    inverse_x = 1e-6 * rng.uniform(1.0, 3.0, n)
    inverse_y = inverse_x.copy()
    inverse_x[[0, 5, 6]] = inverse_y[6] = (
        0.0  # the star's centre is free along y, and counts as if along x
    )
    w, sums, rates = np.maximum(inverse_x, inverse_y), np.zeros((n, 3, 3)), np.zeros(n)
    ratio, bend = largest_ratio(law), bending_ratio(beam_of(law.bonds))
    i, j = np.zeros(n - 1, np.uint32), np.arange(1, n, dtype=np.uint32)
    for other in j:
        if other == 3:
            continue
        k = stiffness(law.elastic, floes.h[0], floes.h[other])
        c = damping(law.dashpot, k, w[0] + w[other])
        reduced = 2.0 * floes.r[0] * floes.r[other] / (floes.r[0] + floes.r[other])
        for one, two, sign in ((0, other, 1.0), (other, 0, -1.0)):
            arm = lever_arm(law.friction, floes.r[one], floes.r[two], gap[other]) / floes.r[one]
            nx, ny = sign * np.cos(angle[other]), sign * np.sin(angle[other])
            along, across = np.array([nx, ny, 0.0]), np.array([-ny, nx, np.sqrt(2.0) * arm])
            bent = np.diag([0.0, 0.0, 2.0 * bend * k * (reduced / floes.r[one]) ** 2])
            share = w[one] + np.sqrt(w[one] * w[two])
            sums[one] += share * (
                k * np.outer(along, along) + ratio * k * np.outer(across, across) + bent
            )
            rates[one] += share * c
    nobody = SimpleNamespace(floe=np.zeros(0, int))
    rows = np.zeros(n, STIFFNESS).view(np.recarray)
    omega2, which, rate = uncompiled(_stiffest)(
        law, side, side, floes, inverse_x, inverse_y, i, j, nobody, closing, widest, rows
    )
    assert which == 0 and omega2 == pytest.approx(np.linalg.eigvalsh(sums[0])[-1], rel=1e-12)
    assert rate == pytest.approx(rates.max(), rel=1e-12)
    for k in range(n):
        expected = np.linalg.eigvalsh(sums[k])[-1]
        assert largest_eigenvalue(rows[k], 0.0) == pytest.approx(expected, rel=1e-9), k


def test_floes_along_walls_add_to_the_sums_of_each_wall_and_of_themselves():
    law = Contact(Elastic(), dashpot=Dashpot(0.2))
    floes, walls = (np.zeros(4, kind).view(np.recarray) for kind in (FLOE, WALL))
    floes.x, floes.h, floes.r, walls.axis = [0.0, 99.0, 198.0, 297.0], 1.0, 10.0, [0, 1, 0, 1]
    w = np.array([1e-6, 2e-6, 3e-6, 4e-6])
    walls.inverse_mass = [1e-5, 5e-5, 0.0, 2e-5]
    none, at = (
        np.zeros(0, np.uint32),
        np.array([[0, 1, 2, 3, 2, 3, 0, 1], [0, 0, 1, 1, 2, 2, 3, 3]]),
    )
    edges = SimpleNamespace(records=walls, floe=at[0], number=at[1])
    rows = np.zeros(4, STIFFNESS).view(np.recarray)
    omega2, which, rate = uncompiled(_stiffest)(
        law, None, None, floes, w, 0.0 * w, none, none, edges, 0.0, 0.0, rows
    )
    k, shares, rates = stiffness(law.elastic, 1.0, 1.0), np.zeros((4, 2)), np.zeros(4)
    of_wall, rate_of_wall = np.zeros(4), np.zeros(4)
    for floe, wall in at.T:
        v = walls.inverse_mass[wall]
        c = damping(law.dashpot, k, w[floe] + v)
        own, its = w[floe] + np.sqrt(v * w[floe]), v + np.sqrt(v * w[floe])
        shares[floe, walls.axis[wall]] += own * k
        rates[floe] += own * c
        of_wall[wall] += its * k
        rate_of_wall[wall] += its * c
    assert (rows.xx == pytest.approx(shares[:, 0])) and (rows.yy == pytest.approx(shares[:, 1]))
    assert omega2 == pytest.approx(max(of_wall.max(), shares.max())) and which == 3
    assert rate == pytest.approx(max(rates.max(), rate_of_wall.max()))


def test_a_floe_alone_is_as_stiff_as_one_in_a_pack_of_its_kind():
    law = Contact(Elastic(), Coulomb(poisson_ratio=-0.5), dashpot=Dashpot(0.2))
    floes, w, none = np.zeros(1, FLOE).view(np.recarray), np.full(1, 2e-6), np.zeros(0, np.uint32)
    floes.h, nobody = 1.5, SimpleNamespace(floe=none)
    rows = np.zeros(1, STIFFNESS).view(np.recarray)
    k, ratio = stiffness(law.elastic, 1.5, 1.5), largest_ratio(law)
    omega2, which, rate = uncompiled(_stiffest)(
        law, None, None, floes, 0.0 * w, w, none, none, nobody, 0.0, 0.0, rows
    )
    assert ratio > 1.0 and which == 0 and omega2 == pytest.approx(6.0 * ratio * k * w[0])
    assert rate == pytest.approx(2.0 * w[0] * damping(law.dashpot, k, 2.0 * w[0]))


def test_contact_forces_press_on_what_is_free_to_move_and_work_on_what_is_held_too():
    floes, force = (np.zeros(2, kind).view(np.recarray) for kind in (FLOE, FORCE_AND_TORQUE))
    floes.u, floes.v, floes.omega = [0.3, 0.5], [0.7, 1.1], [1.3, 1.7]
    force.x, force.y, force.torque = [2.0, 3.0], [5.0, 7.0], [11.0, 13.0]
    inverse = np.array([0.0, 0.1]), np.array([0.2, 0.0]), np.array([0.0, 0.4])
    walls = np.zeros(2, WALL).view(np.recarray)
    walls.inverse_mass, walls.side, walls.force = [0.0, 0.3], [1.0, -1.0], [17.0, 19.0]
    walls.press, walls.speed = [23.0, 29.0], [1.9, 2.3]
    p = SimpleNamespace(floes=floes, spinning=floes, force=force)
    p.inverse_x, p.inverse_y, p.inverse_spin = inverse
    press, power = uncompiled(pressed)(p, walls)
    of_floes = 0.1 * 3.0**2 + 0.2 * 5.0**2 + 0.4 * 13.0**2
    assert press == pytest.approx(of_floes + 0.3 * 19.0 * (19.0 - 29.0))
    along = 2.0 * 0.3 + 3.0 * 0.5 + 5.0 * 0.7 + 7.0 * 1.1
    assert power == pytest.approx(along + 11.0 * 1.3 + 13.0 * 1.7 + 17.0 * 1.9 + 19.0 * 2.3)
