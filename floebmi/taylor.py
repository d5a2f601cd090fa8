"""The paper's schemes, "taylor2" and "taylor3": forces at the old position and velocity, then one Taylor step.

They are for comparison; `dynamics.verlet` is the default scheme.
"""

import numpy as np

from floebmi.dynamics import (
    Step,
    drift_walls,
    forget,
    hold_back,
    is_stale,
    kick_walls,
    touch,
    wide_enough,
)
from floebmi.forces import (
    accelerations,
    book,
    book_spin,
    torques,
    total,
    total_spin,
)
from floebmi.kernels import BLOCK, dispatched, in_place, inner
from floebmi.pairs import narrow, settle

PAPERS_STEP = Step(scheme="taylor3", epsilon=0.07)  # time stepping of the paper


@in_place
def taylor(
    third_order, laws, forces, at, packed, lists, walls, tally, dt, steps, travelled, reach,
    buffers,
):  # fmt: skip
    """The paper's schemes: forces at the old position and velocity, then one Taylor step.

    x += u Δt + ½ a Δt² (+ ⅙ (a − a_old) Δt²),  u += a Δt (+ ½ (a − a_old) Δt)   (eq. taylor)

    a_old is the contact acceleration alone; the other forces are explicit, with impulse a Δt.  The term for the
    change of a force also acts, reversed, on the floe's partner: another floe, a wall, or a constraint.
    """
    p, near, tiles, parts = packed, lists.near, lists.tiles, lists.near.counts.size
    start, constraint = parts - parts, tally.held[parts - 1]  # zero, as in `dynamics.verlet`
    ahead = 0.5 if third_order else 0.0
    pair_buffer, _ = buffers
    done, way, since, skin = 0, 0.0, np.inf, lists.skin
    while done < steps and travelled < reach:
        forget(p.spinning, p.force)
        if is_stale(since, way, skin):
            skin = wide_enough(lists.skin, way)
            narrow(laws.period_x, laws.period_y, p.floes, near, start, parts, lists.gap,
                   skin + 2.0 * way)  # fmt: skip
            since = 0.0
        for tile in range(parts):
            touch(laws, p, lists, walls, tile, dt, None, tally, pair_buffer, lists.blows[0])
        for q in range(p.held.size):
            hold_taylor(p, p.held[q], ahead, dt, constraint)
        for tile in range(tiles.coast.size):
            for k in range(tiles.coast[tile], tiles.bounds[tile + 1]):
                hold_taylor(p, k, ahead, dt, constraint)
        fastest = 0.0
        for first in range(0, p.floes.size, BLOCK):
            n, block = min(BLOCK, p.floes.size - first), first // BLOCK
            for k in range(n):
                floe, contact = p.floes[first + k], p.force[first + k]
                inverse_x, inverse_y = p.inverse_x[first + k], p.inverse_y[first + k]
                previous = p.previous[first + k]
                ax, ay = inverse_x * contact.x, inverse_y * contact.y
                each = accelerations(forces, at, block, k, floe.u, floe.v)
                book(each, at, block, k, floe.u, floe.v, 0.0, 0.0, p.mass[first + k] * dt)
                a = total(each)
                hold_back(p, first + k, a, 0.0, 0.0, dt, floe.u, floe.v, constraint)
                ox, oy = a.x if inverse_x > 0.0 else 0.0, a.y if inverse_y > 0.0 else 0.0
                jerk_x = inverse_x * (contact.x - previous[0]) if third_order else 0.0
                jerk_y = inverse_y * (contact.y - previous[1]) if third_order else 0.0
                floe.x += (floe.u + (0.5 * (ax + ox) + jerk_x / 6.0) * dt) * dt
                floe.y += (floe.v + (0.5 * (ay + oy) + jerk_y / 6.0) * dt) * dt
                floe.u += (ax + ox + ahead * jerk_x) * dt
                floe.v += (ay + oy + ahead * jerk_y) * dt
                previous[0], previous[1] = contact.x, contact.y
                fastest = max(fastest, floe.u**2 + floe.v**2)
            taylor_spin(p.spinning, third_order, forces, at, p, first, n, dt, constraint)
        kick_walls(walls.records, dt, 0.0, ahead)
        way = dt * np.sqrt(max(fastest, drift_walls(walls.records, dt)))
        travelled, since = travelled + way, since + way
        done += 1
    settle(near, start, parts)
    return done


@inner
def hold_taylor(p, k, ahead, dt, constraint):
    """Book the contact forces along held axes, and the term for their change, as taken up by the constraint."""
    floe, contact, previous = p.floes[k], p.force[k], p.previous[k]
    if p.inverse_x[k] == 0.0:
        impulse = dt * (contact.x + ahead * (contact.x - previous[0]))
        constraint[0] -= impulse
        constraint[2] -= impulse * floe.u
    if p.inverse_y[k] == 0.0:
        impulse = dt * (contact.y + ahead * (contact.y - previous[1]))
        constraint[1] -= impulse
        constraint[2] -= impulse * floe.v
    hold_taylor_spin(p.spinning, p, k, ahead, dt, constraint)


@dispatched
def hold_taylor_spin(spinning, p, k, ahead, dt, constraint):
    if p.inverse_spin[k] == 0.0:
        torque = p.force[k].torque
        torque += ahead * (torque - p.previous[k, 2])
        constraint[2] -= dt * torque * spinning[k].omega


@hold_taylor_spin.register
def _(spinning: None, p, k, ahead, dt, constraint):
    pass


@dispatched
def taylor_spin(spinning, third_order, forces, at, p, first, n, dt, constraint):
    for k in range(n):
        floe = first + k
        omega, inertia = spinning[floe].omega, p.inertia[floe] * dt
        each = torques(forces, at, first // BLOCK, k, omega)
        book_spin(each, at, first // BLOCK, k, omega, 0.0, inertia)
        alpha, _ = total_spin(each)
        if p.held.size > 0 and p.inverse_spin[floe] == 0.0:  # the constraint takes up the torque
            constraint[2] -= inertia * alpha * omega
        other = alpha if p.inverse_spin[floe] > 0.0 else 0.0
        inverse, torque = p.inverse_spin[floe], p.force[floe].torque
        alpha = inverse * torque
        jerk = inverse * (torque - p.previous[floe, 2]) if third_order else 0.0
        p.angle[floe] += (omega + (0.5 * (alpha + other) + jerk / 6.0) * dt) * dt
        spinning[floe].omega += (alpha + other + 0.5 * jerk) * dt
        p.previous[floe, 2] = torque


@taylor_spin.register
def _(spinning: None, third_order, forces, at, p, first, n, dt, constraint):
    pass
