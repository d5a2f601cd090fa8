"""The momentum equation, and the step that advances it.

    m du/dt = Σ contacts (f_n + f_t) + Σ forces that the scene lists          (eq. momentum)
    J dω/dt = Σ contacts torque      + Σ torques of the fluids                (eq. angular-momentum)

A step of the default scheme is kick, push, kick, drift, touch: half a velocity step under the contact forces,
the other forces (forces.py, one linearly implicit step), the second half kick, the displacement, and the contact
forces at the new positions.  It is second-order and conserves the energy of an undamped pack.  The other forces act
on the velocities that enter this energy, so their work is exactly its change.  A contact that opens or closes
within a step acts only for its part of the step (eq. part-of-a-step): `touch` notes the difference, which is applied
to the two floes as a blow once the forces are known.  The paper's schemes are in taylor.py.

Kernels work on packed floes: only active ones, sorted in space, with all that a contact reads of a floe in one
cache line.  The laws determine which fields and arrays exist: see `pack.py`.
"""

from typing import Any, Literal, NamedTuple

import numpy as np

from floebmi.contact import Contact, Coulomb, blow, pair_force
from floebmi.forces import (
    OMEGA,
    Push,
    U,
    V,
    accelerations,
    book,
    book_spin,
    torques,
    total,
    total_spin,
)  # fmt: skip
from floebmi.kernels import BLOCK, dispatched, in_place, inlined, inner
from floebmi.pairs import (
    DASHPOTS,
    Inverse,
    Near,
    PairList,
    narrow,
    recall,
    remember,
    settle,
    strike,
    strike_floes,
    touch_floes,
)
from floebmi.quantities import Count, Positive, PositiveFraction
from floebmi.tiles import Tiles


class Step(NamedTuple):
    """Integration scheme and length of the time step.

    Parameters
    ----------
    scheme : velocity Verlet, "verlet", or one of the paper's, "taylor2" and "taylor3"
    fraction : time step over the stability limit 2/ω_max, where ω_max follows from each floe's sum of contact stiffnesses
        (eq. stable-step); default: 0.85 for "verlet" with the friction "coulomb", 0.3 for other friction, without friction,
        with bonds, dashpot or failure, and for the paper's schemes
    epsilon : if given, the paper's time step instead: Δt = ε √(m_min/k_max) (Eq. 4; the paper's ε is 0.07)
    length : if given, a fixed time step instead [s]
    drag_every : number of time steps between applications of the forces other than contacts; each application is centred in
        the time that it stands for; "verlet" only
    """

    scheme: Literal["verlet", "taylor2", "taylor3"] = "verlet"
    fraction: PositiveFraction | None = None
    epsilon: Positive | None = None
    length: Positive | None = None
    drag_every: Count = 1


def usual_fraction(scheme: str, contact: Contact | None) -> float:
    """The fraction of the stability limit that conserves the energy of a scene to one part in a thousand.

    It is 0.85 for "verlet" if contacts are springs with Coulomb friction, or absent; else 0.3.  Without
    friction, or with bonds, a pack keeps oscillating, and at 0.85 of the limit its highest frequency is a fifth too
    high; dashpots are first-order; failure removes a force at once; the paper's schemes and lever arms lack the
    correction of (eq. part-of-a-step).
    """
    rubs = contact is None or isinstance(contact.friction, Coulomb)
    more = contact is not None and (contact.bonds or contact.dashpot or contact.failure)
    return 0.85 if scheme == "verlet" and rubs and not more else 0.3


# Skin of a short list over the displacement of the fastest floe in a step: at a steady speed the list then serves 16 steps.
LASTING = 32.0
# Share of the permitted displacement beyond which the list of pairs, or the limit on the step, is renewed.
NEARLY = 0.7
WALL = np.dtype(
    [
        ("axis", np.int64),  # 0: the wall is normal to x, 1: to y
        ("side", np.float64),  # +1: the ice is on the side of larger coordinates
        ("position", np.float64),  # relative to the domain's origin
        ("speed", np.float64),
        ("inverse_mass", np.float64),
        ("press", np.float64),  # load on the wall, towards the ice [N]
        ("damping", np.float64),  # rate [1/s]
        ("force", np.float64),  # of the ice on the wall, along the axis [N]
        ("previous", np.float64),  # that force one step earlier, for the third-order scheme
        ("impulse", np.float64),  # given to the ice, along the axis [N s]
        ("work", np.float64),  # done on the ice [J]
    ]
)


class Laws(NamedTuple):
    """Contact laws, and the periods of the domain."""

    contact: Any
    wall: Any  # the contact law of walls
    period_x: float | None
    period_y: float | None


class Lists(NamedTuple):
    """Pairs about to touch, tile by tile."""

    near: Near
    pairs: PairList  # of the short list, with their memory
    tiles: Tiles
    blows: np.ndarray  # room for the blows of two tiles, see `pairs.note_blows`
    gap: float  # the short list holds pairs closer than this [1] plus its skin [m], see `pairs.narrow`
    skin: float  # for the first forces of an exchange; later the minimum, see `wide_enough`


class Walls(NamedTuple):
    """Walls, and the floes that may touch them.

    records : of `WALL`, or None without walls
    floe, number : each floe near a wall, and the number of that wall
    damped, opening, blow : of each of these: force of the dashpot [N], if there are any; rate of separation [m/s];
        blow [N s], see `contact.blow`
    """

    records: np.ndarray | None
    floe: np.ndarray
    number: np.ndarray
    damped: np.ndarray | None
    opening: np.ndarray
    blow: np.ndarray


class Marked(NamedTuple):
    """Positions of floes and walls from which their displacement is measured.

    x, y, walls : positions [m]; before : displacement up to then, in earlier exchanges [m]
    still : there are walls or edges, which do not drift along with the floes
    """

    x: np.ndarray
    y: np.ndarray
    walls: np.ndarray
    before: float
    still: bool


class Tally(NamedTuple):
    """Gains and losses: one row per tile, and a last one for seams and walls, so that threads share no row.

    held : momentum along x and y [N s] and energy [J] given to floes by their constraints: coast and prescribed motion.
        Kernels call a row of it `constraint`.
    lost : energy lost [J] by process, and the number of bonds broken, see `pairs.FRICTION` and the names after it
    """

    held: np.ndarray
    lost: np.ndarray


# ---- kick, push, drift, touch -----------------------------------------------------------------------


@inner
def kick(p, first, n, dt, constraint):
    """Accelerate floes first to first + n − 1 by their contact forces for a time dt [s].

    An axis with prescribed motion is held: its inverse mass is 0, its velocity stays, and the impulse and work of the
    force along it are booked in `constraint`, a row of `Tally.held`.
    """
    if p.held.size > 0:
        hold_kick(p, first, n, dt, 1.0, constraint)
    for k in range(first, first + n):
        k = np.uintp(k)
        kick_one(p, k, p.inverse_x[k], p.inverse_y[k], dt)


@inner
def kick_one(p, k, inverse_x, inverse_y, dt):
    floe, f = p.floes[k], p.force[k]
    floe.u += dt * inverse_x * f.x
    floe.v += dt * inverse_y * f.y
    kick_spin(p.spinning, p.inverse_spin, f, k, dt)


@dispatched
def kick_spin(spinning, inverse_spin, f, k, dt):
    spinning[k].omega += dt * inverse_spin[k] * f.torque


@kick_spin.register
def _(spinning: None, inverse_spin, f, k, dt):
    pass


@inner
def hold_kick(p, first, n, dt, kept, constraint):
    """Book the contact forces along held axes, over a time dt [s], as taken up by the constraint.

    kept : factor applied to those forces afterwards: 0 removes them, so that kicks need not check which axes are held;
        1 keeps them for output
    """
    for k in range(first, first + n):
        if p.inverse_x[k] == 0.0:
            constraint[0] -= dt * p.force[k].x
            constraint[2] -= dt * p.force[k].x * p.floes[k].u
            p.force[k].x *= kept
        if p.inverse_y[k] == 0.0:
            constraint[1] -= dt * p.force[k].y
            constraint[2] -= dt * p.force[k].y * p.floes[k].v
            p.force[k].y *= kept
    hold_kick_spin(p.spinning, p.force, p.inverse_spin, first, n, dt, constraint)


@dispatched
def hold_kick_spin(spinning, force, inverse_spin, first, n, dt, constraint):
    for k in range(first, first + n):
        if inverse_spin[k] == 0.0:
            constraint[2] -= dt * force[k].torque * spinning[k].omega


@hold_kick_spin.register
def _(spinning: None, force, inverse_spin, first, n, dt, constraint):
    pass


@dispatched
def kick_walls(walls, before, after, ahead):
    """Accelerate the walls by the force of the ice, for the end of a step and the beginning of the next.

    Between the two kicks the dampers act, for both times: a wall then moves at one speed, so that the work of the
    forces before and after the displacement equals the energy that the ice gains.

    before, after : durations of the two kicks [s]; ahead : share of the last change of a force that is added to it
        (eq. taylor), 0 in the default scheme
    """
    for w in range(walls.size):
        wall = walls[w]
        force = wall.force + ahead * (wall.force - wall.previous)
        wall.previous = wall.force
        kick_wall(wall, force, before)
        wall.speed *= np.exp(-wall.damping * (before + after))
        kick_wall(wall, force, after)


@kick_walls.register
def _(walls: None, before, after, ahead):
    pass


@inner
def kick_wall(wall, force, dt):
    """`kick` for one wall, loaded or not."""
    change = dt * wall.inverse_mass * (force + wall.side * wall.press)
    wall.impulse -= dt * force
    wall.work -= dt * force * (wall.speed + 0.5 * change)
    wall.speed += change


@inner
def push_block(forces, at, p, first, n, kicked, pushed, substeps, constraint, buffer):
    """Kick a block of floes for a time `kicked` [s], then apply the other forces for a time `pushed` [s], in sub-steps.

    Contact forces along held axes must be 0: see `hold_kick`.
    """
    for k in range(n):
        floe, f = p.floes[np.uintp(first + k)], p.force[np.uintp(first + k)]
        buffer[U + k] = floe.u + kicked * floe.w * f.x
        buffer[V + k] = floe.v + kicked * floe.w * f.y
    read_spin(p.spinning, p.inverse_spin, p.force, first, n, kicked, buffer)
    for _ in range(substeps):
        push(forces, at, p, first, n, pushed / substeps, constraint, buffer)
    for k in range(n):
        floe = p.floes[np.uintp(first + k)]
        floe.u, floe.v = buffer[U + k], buffer[V + k]
    write_spin(p.spinning, first, n, buffer)


@inner
def glide(p, begin, end, kicked, dt):
    """Kick floes begin to end − 1 for a time `kicked` [s], move them for dt [s], and set their forces to 0 for `touch`.

    Contact forces along held axes must be 0: see `hold_kick`.  Returns the largest speed² [m²/s²].
    """
    fastest = 0.0
    for k in range(begin, end):
        k = np.uintp(k)
        floe = p.floes[k]
        # one inverse mass serves both axes, and is in the floe's own cache line
        kick_one(p, k, floe.w, floe.w, kicked)
        forget_one(p.spinning, p.force[k])
        floe.x += dt * floe.u
        floe.y += dt * floe.v
        fastest = max(fastest, floe.u * floe.u + floe.v * floe.v)
        turn(p.spinning, p.angle, k, dt)
    return fastest


@dispatched
def turn(spinning, angle, k, dt):
    angle[k] += dt * spinning[k].omega


@turn.register
def _(spinning: None, angle, k, dt):
    pass


@dispatched
def read_spin(spinning, inverse_spin, force, first, n, kicked, buffer):
    for k in range(n):
        floe = np.uintp(first + k)
        change = kicked * inverse_spin[floe] * force[floe].torque
        buffer[OMEGA + k] = spinning[floe].omega + change


@read_spin.register
def _(spinning: None, inverse_spin, force, first, n, kicked, buffer):
    pass


@dispatched
def write_spin(spinning, first, n, buffer):
    for k in range(n):
        spinning[np.uintp(first + k)].omega = buffer[OMEGA + k]


@write_spin.register
def _(spinning: None, first, n, buffer):
    pass


@dispatched
def drift_walls(walls, dt):
    fastest = 0.0
    for w in range(walls.size):
        wall = walls[w]
        wall.position += dt * wall.speed
        fastest = max(fastest, wall.speed * wall.speed)
    return fastest


@drift_walls.register
def _(walls: None, dt):
    return 0.0


@inner
def push(forces, at, p, first, n, h, constraint, buffer):
    """Apply the other forces to a block of floes for a time h [s]; a held axis keeps its velocity."""
    if p.held.size > 0:
        push_floes(forces, at, p, first, n, h, True, constraint, buffer)
    else:  # compiled separately, without the checks for held axes
        push_floes(forces, at, p, first, n, h, False, constraint, buffer)


@inner
def push_floes(forces, at, p, first, n, h, held, constraint, buffer):
    """`push`, with held : whether any floe of the pack has a held axis."""
    block = first // BLOCK
    for k in range(n):
        u, v = buffer[U + k], buffer[V + k]
        each = accelerations(forces, at, block, k, u, v)
        a = total(each)
        du, dv = implicit(a, h)
        if held:
            du, dv = hold_push(p, first + k, a, du, dv, h, u, v, constraint)
        book(each, at, block, k, u, v, du, dv, p.mass[np.uintp(first + k)] * h)
        buffer[U + k], buffer[V + k] = u + du, v + dv
    push_spin(p.spinning, forces, at, p, first, n, h, held, constraint, buffer)


@inner
def implicit(a, h):
    """Solution δu of (1 − h/2 Σ J) δu = h Σ a, the step of all forces but contacts (eq. linearly-implicit)."""
    half = 0.5 * h
    m11, m12, m21, m22 = 1.0 - half * a.xx, -half * a.xy, -half * a.yx, 1.0 - half * a.yy
    scale = h / (m11 * m22 - m12 * m21)
    return scale * (m22 * a.x - m12 * a.y), scale * (m11 * a.y - m21 * a.x)


@dispatched
def push_spin(spinning, forces, at, p, first, n, h, held, constraint, buffer):
    block = first // BLOCK
    for k in range(n):
        omega, inertia = buffer[OMEGA + k], p.inertia[np.uintp(first + k)] * h
        each = torques(forces, at, block, k, omega)
        alpha, slope = total_spin(each)
        change = h * alpha / (1.0 - 0.5 * h * slope)
        if held and p.inverse_spin[first + k] == 0.0:  # the constraint takes up the torque
            constraint[2] -= inertia * alpha * omega
            change = 0.0
        book_spin(each, at, block, k, omega, change, inertia)
        buffer[OMEGA + k] = omega + change


@push_spin.register
def _(spinning: None, forces, at, p, first, n, h, held, constraint, buffer):
    pass


@inner
def hold_push(p, k, a, du, dv, h, u, v, constraint):
    """The change of a floe's velocity, 0 along a held axis; du, dv if no axis is held."""
    free_x, free_y = p.inverse_x[k] > 0.0, p.inverse_y[k] > 0.0
    if free_x and free_y:
        return du, dv
    ax, xx, xy = (a.x, a.xx, a.xy) if free_x else (0.0, 0.0, 0.0)
    ay, yx, yy = (a.y, a.yx, a.yy) if free_y else (0.0, 0.0, 0.0)
    du, dv = implicit(Push(ax, ay, xx, xy, yx, yy), h)
    hold_back(p, k, a, du, dv, h, u, v, constraint)
    return du, dv


@inner
def hold_back(p, k, a, du, dv, h, u, v, constraint):
    """Book the other forces along a floe's held axes as taken up by the constraint."""
    if p.inverse_x[k] == 0.0:
        impulse = p.mass[k] * h * (a.x + 0.5 * (a.xx * du + a.xy * dv))
        constraint[0] -= impulse
        constraint[2] -= impulse * u
    if p.inverse_y[k] == 0.0:
        impulse = p.mass[k] * h * (a.y + 0.5 * (a.yx * du + a.yy * dv))
        constraint[1] -= impulse
        constraint[2] -= impulse * v


@dispatched
def touch_walls(
    wall_law, floes, walls, dt, force, inverse, constraint, lost,
):  # fmt: skip
    """Add the forces of frictionless walls on floes that overlap them (eq. wall)."""
    for w in range(walls.records.size):
        walls.records[w].force = 0.0
    for q in range(walls.floe.size):
        k = walls.floe[q]
        wall = walls.records[walls.number[q]]
        floe = floes[k]
        along_x = wall.axis == 0
        gap = wall.side * ((floe.x if along_x else floe.y) - wall.position) - floe.r
        opening = wall.side * ((floe.u if along_x else floe.v) - wall.speed)
        f = pair_force(
            wall_law, gap, opening, 0.0, 0.0, floe.r, floe.r, floe.h, floe.h,
            floe.w + wall.inverse_mass, 0.0, 0.0, 0.0, 0.0, recall(walls.damped, q), 0.0, 0.0, 0.0, dt,
        )  # fmt: skip
        remember(walls.damped, q, f.damped)
        if along_x:
            force[k].x += wall.side * f.f_n
        else:
            force[k].y += wall.side * f.f_n
        wall.force -= wall.side * f.f_n
        walls.opening[q], walls.blow[q] = opening, f.blow_n
        lost[DASHPOTS] += f.dashpot_loss
    strike_walls(inverse, wall_law, floes, force, walls, dt, constraint)


@touch_walls.register
def _(wall_law: None, floes, walls, dt, force, inverse, constraint, lost):
    pass


@dispatched
def strike_walls(inverse, wall_law, floes, force, walls, dt, constraint):
    """Apply the blows of floes that met or left a wall, now that all contact forces are known; opposite on floe and wall.

    The load of a wall is left out, as in the energy that the scheme conserves (eq. kept-energy).
    """
    for q in range(walls.floe.size):
        if walls.blow[q] == 0.0:
            continue
        k, wall = walls.floe[q], walls.records[walls.number[q]]
        along_x = wall.axis == 0
        w = inverse.x[k] if along_x else inverse.y[k]
        pushed = w * (force[k].x if along_x else force[k].y) - wall.inverse_mass * wall.force
        parting = (floes[k].u if along_x else floes[k].v) - wall.speed
        ahead = wall.side * (parting + 0.5 * dt * pushed)
        impulse, _ = blow(
            wall_law.dashpot, walls.blow[q], walls.opening[q], ahead, w + wall.inverse_mass
        )
        impulse *= wall.side
        x, y = (impulse, 0.0) if along_x else (0.0, impulse)
        strike(inverse, floes, k, x, y, constraint)
        change = -wall.inverse_mass * impulse
        wall.impulse += impulse
        wall.work += impulse * (wall.speed + 0.5 * change)
        wall.speed += change


@strike_walls.register
def _(inverse: None, wall_law, floes, force, walls, dt, constraint):
    pass


# ---- the schemes ------------------------------------------------------------------------------------


@inner
def lean(force, begin, end, dt, kept, constraint):
    """Book the contact forces on pieces of coast, as in `hold_kick`; their torques do no work and are not booked."""
    x = y = 0.0
    for k in range(begin, end):
        f = force[np.uintp(k)]
        x += f.x
        y += f.y
        f.x *= kept
        f.y *= kept
    constraint[0] -= dt * x
    constraint[1] -= dt * y


@inner
def move(
    forces, at, packed, begin, end, kicks, dt, pushed, substeps, constraint, buffer
):  # fmt: skip
    """Kick, push, kick and drift floes from begin, a multiple of BLOCK, to end; returns the largest speed² [m²/s²].

    kicks : durations of the contact forces before and after the push [s]
    pushed : time for which the other forces act [s], 0 in a step in which they do not (see `time_to_push`)
    substeps : number of sub-steps of the push, for each block of floes
    """
    before, after = kicks
    if packed.held.size > 0:
        hold_kick(packed, begin, end - begin, before + after, 0.0, constraint)
    if len(forces) == 0 or pushed == 0.0:
        return glide(packed, begin, end, before + after, dt)
    fastest = 0.0
    for first in range(begin, end, BLOCK):
        n, times = min(BLOCK, end - first), substeps[first // BLOCK]
        push_block(forces, at, packed, first, n, before, pushed, times, constraint, buffer)
        fastest = max(fastest, glide(packed, first, first + n, after, dt))
    return fastest


@inner
def move_walls(walls, kicks, dt):
    """Kick and drift the walls; returns the largest speed²."""
    kick_walls(walls, *kicks, 0.0)
    return drift_walls(walls, dt)


@inner
def end_steps(forces, at, packed, tiles, walls, kicked, pushed, substeps, constraint, buffer):
    """Finish the last step: the second half kick and the rest of the push; the forces are kept for output."""
    p = packed
    kick_walls(walls, kicked, 0.0, 0.0)
    for tile in range(tiles.coast.size):
        begin, coast, end = tiles.bounds[tile], tiles.coast[tile], tiles.bounds[tile + 1]
        kick(p, begin, coast - begin, kicked, constraint)
        if len(forces) > 0 and pushed != 0.0:
            for first in range(begin, coast, BLOCK):
                n, times = min(BLOCK, coast - first), substeps[first // BLOCK]
                push_block(forces, at, p, first, n, 0.0, pushed, times, constraint, buffer)
        lean(p.force, coast, end, kicked, 1.0, constraint)


@inner
def time_to_push(lag, drag_every, dt, rest):
    """Time for which the other forces act at the beginning of a step [s]; 0 if they do not.

    They act once in `drag_every` steps, for half of that interval before and half of it after.

    lag : [0] time by which they are behind the floes [s], negative if they are ahead; [1] steps until they act again;
        both are updated to their values after this step
    rest : time to the end of the exchange, beyond which they must not act [s]
    """
    pushed = 0.0
    if lag[1] <= 0.0:
        ahead = min(0.5 * drag_every * dt, rest)
        pushed = lag[0] + ahead
        lag[0], lag[1] = -ahead, drag_every
    lag[0] += dt
    lag[1] -= 1.0
    return pushed


@inner
def time_left_to_push(lag, reached):
    """Time for which the other forces still have to act [s] at the end of the exchange; 0 before it."""
    if not reached:
        return 0.0
    left = max(lag[0], 0.0)
    lag[:] = 0.0
    return left


@inner
def touch(laws, packed, lists, walls, tile, dt, inverse, tally, buffer, blows):
    """Add the forces of the pairs of a tile; the last part, of pairs across seams, also does the walls.

    dt, inverse : see `pairs.touch_floes`.  Returns the number of blows.
    """
    p = packed
    noted = touch_floes(
        laws.contact, laws.period_x, laws.period_y, p.floes, p.spinning, p.friction,
        p.tensile_strength, lists.pairs, lists.near, tile, dt, p.force, inverse, tally.lost[tile],
        buffer, blows,
    )  # fmt: skip
    if tile == lists.near.counts.size - 1:
        touch_walls(laws.wall, p.floes, walls, dt, p.force, inverse, tally.held[tile], tally.lost[tile])  # fmt: skip
    return noted


@inner
def inverse_of(p):
    return Inverse(p.held.size > 0, p.inverse_x, p.inverse_y, p.inverse_spin)


@in_place
def touch_all(laws, packed, lists, walls, tally, buffers):
    """Compute the forces at the present positions and the short list, as after a step."""
    p, near, last = packed, lists.near, lists.near.counts.size
    first = last - last  # as in `verlet`
    inverse = inverse_of(p)
    forget(p.spinning, p.force)
    narrow(laws.period_x, laws.period_y, p.floes, near, first, last, lists.gap, lists.skin)
    for tile in range(last):
        touch(laws, p, lists, walls, tile, 0.0, inverse, tally, buffers[0], lists.blows[0])
    settle(near, first, last)


@inlined
def sweep(laws, forces, at, packed, lists, walls, first, last, moves, touches, kicks, dt, pushed, substeps,
          tally, buffers):  # fmt: skip
    """Move the floes of tiles first to last − 1 and touch their pairs, tile by tile; returns the largest speed² [m²/s²].

    moves, touches : whether to move floes, and whether to touch pairs
    kicks, pushed, substeps : see `move`
    buffers : of a block of pairs, shape (PAIR_BUFFER,), of a block of floes, (FORCE_BUFFER,), and the blows of two tiles
    """
    p, tiles, seams, fastest = packed, lists.tiles, lists.tiles.coast.size, 0.0
    pair_buffer, floe_buffer, blows = buffers
    inverse = inverse_of(p)
    noted = 0
    for tile in range(first, last + 1):
        if moves and tile < seams and tile < last:
            begin, coast, end = tiles.bounds[tile], tiles.coast[tile], tiles.bounds[tile + 1]
            speed2 = move(
                forces, at, p, begin, coast, kicks, dt, pushed, substeps, tally.held[tile],
                floe_buffer,
            )  # fmt: skip
            lean(p.force, coast, end, kicks[0] + kicks[1], 0.0, tally.held[tile])
            fastest = max(fastest, speed2)
        before, noted = noted, 0
        if touches and tile < last:
            noted = touch(
                laws, p, lists, walls, tile, dt, inverse, tally, pair_buffer, blows[tile % 2]
            )
        if tile > first:  # blows of the previous tile: the forces of this one are known now
            strike_floes(
                laws.contact, lists.pairs.slip, inverse, p.floes, p.spinning, blows[(tile - 1) % 2],
                before, dt, p.force, tally.held[tile - 1], tally.lost[tile - 1],
            )  # fmt: skip
    return fastest


@in_place
def verlet(
    laws, forces, at, packed, lists, walls, tally, first_kick, way, dt, steps, substeps, marked,
    travelled, reach, drag_every, lag, buffers,
):  # fmt: skip
    """Take up to `steps` steps of dt; stop early when displacements near `reach` [m]. Returns the number of steps done.

        kick and push    `push_block`, in steps in which the other forces act
        kick and drift   `glide`
        touch            `touch`, then the blows that it noted
        kick             with the next step's first, or in `end_steps`

    The last half kick of a step and the first of the next have the same force: they are one kick, unless the other
    forces act between them.  Floes move and touch tile by tile, while they are in the cache, unless the short list
    must be rebuilt in between.  `threads.verlet_in_threads` does the same chunk by chunk: change both together.

    first_kick : duration of the first kick of contact forces [s], see `Advance._first_kick`
    way : displacement of the fastest floe in a step [m] if the short list is current; inf: the list must be rebuilt
    travelled, reach : displacement of floes from `marked`, and the largest permitted [m]
    lag : see `time_to_push`; none is left after `steps`
    """
    p, near, last = packed, lists.near, lists.near.counts.size
    # zero, but not a literal, for which the compiler would make a second set of kernels
    first = last - last
    done, kicks, since, skin = 0, (0.0, first_kick), 0.0, lists.skin
    while done < steps:
        if not travelled < reach:  # a sum over steps, which overestimates the displacement
            travelled = strayed(p.floes, walls.records, marked)
            if not travelled < NEARLY * reach:
                break
        pushed = time_to_push(lag, drag_every, dt, (steps - done) * dt)
        anew = is_stale(since, way, skin)
        fastest = move_walls(walls.records, kicks, dt)
        for half in range(2 if anew else 1):  # move, rebuild the list, touch; or move and touch
            if half == 1:
                skin = wide_enough(lists.skin, way)
                narrow(laws.period_x, laws.period_y, p.floes, near, first, last, lists.gap,
                       skin + 2.0 * way)  # fmt: skip
            speed2 = sweep(
                laws, forces, at, p, lists, walls, first, last, half == 0, half == 1 or not anew,
                kicks, dt, pushed, substeps, tally, (*buffers, lists.blows),
            )  # fmt: skip
            fastest = max(fastest, speed2)
            way = dt * np.sqrt(fastest)
        travelled, since = travelled + way, 0.0 if anew else since + way
        done, kicks = done + 1, (0.5 * dt, 0.5 * dt)
    settle(near, first, last)
    if done > 0:
        pushed = time_left_to_push(lag, done == steps)
        end_steps(
            forces, at, p, lists.tiles, walls.records, 0.5 * dt, pushed, substeps,
            tally.held[last - 1], buffers[1],
        )  # fmt: skip
    return done


@in_place
def strayed(floes, walls, marked):
    """Half the distance by which two floes, or a floe and a wall, may have come closer since they were marked [m].

    A displacement common to all floes brings none of them closer; it counts only where there are walls or edges.
    """
    none = 0.0 if marked.still or floes.size == 0 else np.inf
    west, east, south, north = none, -none, none, -none
    for k in range(floes.size):
        x, y = floes[k].x - marked.x[k], floes[k].y - marked.y[k]
        west, east = min(west, x), max(east, x)
        south, north = min(south, y), max(north, y)
    apart = np.sqrt((east - west) ** 2 + (north - south) ** 2) + way_of_walls(walls, marked.walls)
    return marked.before + 0.5 * apart


@dispatched
def way_of_walls(walls, positions):
    longest = 0.0
    for w in range(walls.size):
        longest = max(longest, abs(walls[w].position - positions[w]))
    return longest


@way_of_walls.register
def _(walls: None, positions):
    return 0.0


@inner
def wide_enough(skin, way):
    """Skin of a short list [m] that lasts for some steps if floes keep their present speed.

    skin : minimum [m]; way : displacement of the fastest floe in a step [m]
    """
    return max(skin, LASTING * way)


@inner
def is_stale(since, way, skin):
    """Whether a pair that is not on the short list may touch after the next step.

    since, way : displacement of the fastest floe since the list was made, and in the last step [m]
    """
    return since + 2.0 * way > 0.5 * skin


@inner
def forget(spinning, force):
    """Set the contact forces to 0."""
    for k in range(force.size):
        forget_one(spinning, force[k])


@inner
def forget_one(spinning, f):
    f.x = 0.0
    f.y = 0.0
    forget_torque(spinning, f)


@dispatched
def forget_torque(spinning, f):
    f.torque = 0.0


@forget_torque.register
def _(spinning: None, f):
    pass
