"""Diagnostics of packed floes: speeds, energy, overlaps, and the contacts between them."""

from typing import NamedTuple

import numpy as np

from floebmi.columns import LANES
from floebmi.contact import coefficient, pair_force, stored, strength
from floebmi.kernels import dispatched, in_place
from floebmi.pack import omega_of
from floebmi.pairs import any_period, least_of, recall, wrap


class Contacts(NamedTuple):
    """Pairs that exert contact forces on each other now.

    i, j : floe numbers; x, y : contact point [m], brought back across periodic edges; dx, dy : branch vector from the centre of i to that of j [m]
    fx, fy : force on i [N], the force on j is its opposite; overlap [m], negative for a stretched bond
    bonded : bool; energy : elastic energy [J]
    """

    i: np.ndarray
    j: np.ndarray
    x: np.ndarray
    y: np.ndarray
    dx: np.ndarray
    dy: np.ndarray
    fx: np.ndarray
    fy: np.ndarray
    overlap: np.ndarray
    bonded: np.ndarray
    energy: np.ndarray


def touching_pairs(law, period_x, period_y, floes, mu, sigma, near, pairs):
    """The pairs that touch, and a row for each: x, y, dx, dy, fx, fy, overlap, bonded, elastic energy.

    near, pairs : the short list, as steps or `dynamics.touch_all` leave it; other pairs cannot touch
    """
    room = near.counts.sum()
    if law is None or room == 0:
        return np.empty(0, np.int64), np.empty((0, 9))
    touching, rows = np.empty(room, np.int64), np.empty((room, 9))
    period = any_period((period_x, period_y))
    n = _touching_pairs(law, *period, floes, mu, sigma, near, pairs, touching, rows)
    return touching[:n], rows[:n]


@in_place
def _touching_pairs(law, period_x, period_y, floes, mu, sigma, near, pairs, touching, rows):
    m = 0
    for part in range(near.counts.size):
        first = near.parts[part] + LANES * part
        for p in range(first, first + near.counts[part]):
            i, j = pairs.i[p], pairs.j[p]
            one, other = floes[i], floes[j]
            dx, dy = wrap(period_x, other.x - one.x), wrap(period_y, other.y - one.y)
            distance = np.sqrt(dx * dx + dy * dy)
            nx, ny = dx / distance, dy / distance
            gap = distance - (one.r + other.r)
            was_bonded = recall(pairs.bonded, p)
            if gap >= 0.0 and was_bonded <= 0.0:
                continue
            opening = (other.u - one.u) * nx + (other.v - one.v) * ny
            f = pair_force(
                law, gap, opening, 0.0, 0.0, one.r, other.r, one.h, other.h, one.w + other.w,
                least_of(mu, coefficient(law.friction), i, j),
                least_of(sigma, strength(law.bonds), i, j),
                recall(pairs.slip, p), was_bonded, 0.0, recall(pairs.bent, p),
                recall(pairs.failed, p), recall(pairs.slid, p), 0.0,
            )  # fmt: skip
            if gap >= 0.0 and f.bonded <= 0.0:
                continue
            row = rows[m]
            row[0], row[1] = one.x + (one.r + 0.5 * gap) * nx, one.y + (one.r + 0.5 * gap) * ny
            row[2], row[3] = dx, dy
            row[4], row[5] = -f.f_n * nx - f.f_t * ny, -f.f_n * ny + f.f_t * nx
            row[6], row[7] = -gap, f.bonded
            row[8] = stored(law, f, gap, one.r, other.r, one.h, other.h)
            touching[m] = near.slot[p]
            m += 1
    return m


@in_place
def deepest(period_x, period_y, floes, near):
    """The pair with the largest overlap over its smaller radius, and that ratio, among pairs that forces can move."""
    which, deepest_share = -1, 0.0
    for part in range(near.counts.size):
        first = near.parts[part] + LANES * part
        for p in range(first, first + near.counts[part]):
            one, other = floes[near.i[p]], floes[near.j[p]]
            if one.w + other.w == 0.0:
                continue
            dx, dy = wrap(period_x, other.x - one.x), wrap(period_y, other.y - one.y)
            share = (one.r + other.r - np.sqrt(dx * dx + dy * dy)) / min(one.r, other.r)
            if share > deepest_share:
                which, deepest_share = near.slot[p], share
    return which, deepest_share


class Survey(NamedTuple):
    """Diagnostics of packed floes.

    finite : all positions, velocities and angles are finite; energy : translational kinetic energy [J]
    speed, spin : largest speed [m/s] and largest angular speed [rad/s]
    pace, which : largest speed over radius [radii per s], and the packed index of that floe
    """

    finite: bool
    energy: float
    speed: float
    spin: float
    pace: float
    which: int


@in_place
def survey(packed):
    """A `Survey` as a tuple."""
    p, finite, energy, fastest2, spin, pace2, which = packed, True, 0.0, 0.0, 0.0, 0.0, 0
    for k in range(p.floes.size):
        floe = p.floes[k]
        speed2, omega = floe.u * floe.u + floe.v * floe.v, omega_of(p.spinning, k)
        # not isfinite: under fast-math x − x is 0 whatever x is
        finite &= (speed2 < np.inf) & (abs(floe.x) < np.inf) & (abs(floe.y) < np.inf)
        finite &= abs(omega + recall(p.angle, k)) < np.inf
        energy += 0.5 * p.mass[k] * speed2
        fastest2, spin = max(fastest2, speed2), max(spin, abs(omega))
        here2 = speed2 / (floe.r * floe.r)
        if here2 > pace2:
            pace2, which = here2, k
    return finite, energy, np.sqrt(fastest2), spin, np.sqrt(pace2), which


@in_place
def stock_of_each(of, radius, thickness, u, v, omega, density, stock):
    """Fill rows with mass [kg], momentum x, y [N s] and kinetic energy [J] of floes in the mask `of`, (n,) bool; 0 elsewhere."""
    for k in range(of.size):
        m = density * np.pi * radius[k] * radius[k] * thickness[k]
        m = m if of[k] else 0.0
        turns = radius[k] * recall(omega, k)
        stock[0, k], stock[1, k], stock[2, k] = m, m * u[k], m * v[k]
        stock[3, k] = 0.5 * m * (u[k] * u[k] + v[k] * v[k] + 0.5 * turns * turns)  # J = m r²/2


@in_place
def pressed(packed, walls):
    """Sums over the contact forces: Σ|F|²/m [N²/kg], with torques over J, and the power Σ F·u [W].

    Held axes have an inverse mass of 0, but count in the power, since the constraint does that work.
    """
    p, press, power = packed, 0.0, 0.0
    for k in range(p.floes.size):
        floe, f = p.floes[k], p.force[k]
        press += p.inverse_x[k] * f.x * f.x + p.inverse_y[k] * f.y * f.y
        power += f.x * floe.u + f.y * floe.v
    press, power = add_twisted(p.spinning, p, press, power)
    return add_walls(walls, press, power)


@dispatched
def add_twisted(spinning, p, press, power):
    for k in range(spinning.size):
        press += p.inverse_spin[k] * p.force[k].torque ** 2
        power += p.force[k].torque * spinning[k].omega
    return press, power


@add_twisted.register
def _(spinning: None, p, press, power):
    return press, power


@dispatched
def add_walls(walls, press, power):
    """Add the same sums for walls, where |F|² is the force of the ice times the net force (eq. kept-energy).

    The load does work on the wall; it is not energy of the ice.
    """
    for w in range(walls.size):
        wall = walls[w]
        press += wall.inverse_mass * wall.force * (wall.force + wall.side * wall.press)
        power += wall.force * wall.speed
    return press, power


@add_walls.register
def _(walls: None, press, power):
    return press, power
