"""The momentum equation, and the step that advances it.

    m du/dt = Σ contacts (f_n + f_t) + Σ forces that the scene lists          (eq. momentum)
    J dω/dt = Σ contacts torque      + Σ torques of the fluids                (eq. angular-momentum)

A step of the default scheme is kick, push, kick, drift, touch: half a velocity step under the contact forces,
the other forces (forces.py, one linearly implicit step), the second half kick, the way, and the contact forces at
the new place.  It is of second order, and keeps the energy of an undamped pack; the other forces act on the
velocities that this energy is made of, so that their work is what it changes by.  A contact that opens or closes
within a step acts only for its part of it (eq. part-of-a-step): `touch` notes the difference, and when the forces
are known the two floes are struck with it.  `taylor2` and `taylor3` are the paper's schemes (Eq. 4, its text).

Kernels work on packed floes: active ones only, sorted in space, what a contact reads of a floe in one line
of the cache.  Which fields exist, and which arrays, follows from the laws: see `pack.py`.
"""

from typing import Any, Literal, NamedTuple

import numpy as np

from floebmi.contact import Contact, Coulomb, blow, pair_force
from floebmi.forces import (
    A_X,
    A_Y,
    ALPHA,
    D_OMEGA,
    D_U,
    D_V,
    IMPULSE,
    J_XX,
    J_XY,
    J_YX,
    J_YY,
    OMEGA,
    SLOPE,
    TWIST,
    U,
    V,
    book,
    book_spin,
    total,
    total_spin,
)  # fmt: skip
from floebmi.kernels import BLOCK, dispatched, in_place, inlined, inner
from floebmi.pairs import (
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
    """How time is stepped.

    Parameters
    ----------
    scheme : "verlet" (default), or the paper's "taylor2", "taylor3"
    fraction : of the stability limit 2/ω_max, ω_max from the floes' own stiffness sums (eq. stable-step);
        default: 0.85 with friction, 0.3 without it or with bonds or dashpots, see `usual_fraction`
    epsilon : if given, the paper's rule instead: Δt = ε √(m_min/k_max) (Eq. 4; the paper's ε is 0.07)
    length : if given, a fixed step [s] instead
    drag_every : the forces other than contacts act once in so many steps, for half of their time before and half after
    """

    scheme: Literal["verlet", "taylor2", "taylor3"] = "verlet"
    fraction: PositiveFraction | None = None
    epsilon: Positive | None = None
    length: Positive | None = None
    drag_every: Count = 1


def usual_fraction(scheme: str, contact: Contact | None) -> float:
    """The step over its limit that keeps the energy of a scene to a thousandth.

    Long steps do where contacts are springs and friction, stepped by "verlet".  Without friction, or with bonds, a
    pack goes on to ring, at 0.85 of the limit a fifth too fast in its highest tone; dashpots are of first order;
    the paper's schemes and lever arms know no part of a step.
    """
    rubs = contact is None or isinstance(contact.friction, Coulomb)
    more = contact is not None and (contact.bonds or contact.dashpot or contact.failure)
    return 0.85 if scheme == "verlet" and rubs and not more else 0.3


NEARLY = 0.7  # of the way that floes may stray: then something is looked at anew
WALL = np.dtype(
    [
        ("axis", np.int64),  # 0: the wall stands across x, 1: across y
        ("side", np.float64),  # +1: the ice is on the side of larger coordinates
        ("position", np.float64),  # from the domain's origin
        ("speed", np.float64),
        ("inverse_mass", np.float64),
        ("press", np.float64),  # force that the wall is loaded with, towards the ice [N]
        ("damping", np.float64),  # rate [1/s]
        ("force", np.float64),  # of the ice on the wall, along the axis [N]
        ("previous", np.float64),  # the same one step before, for the paper's third-order scheme
        ("impulse", np.float64),  # given to the ice, along the axis [N s]
        ("work", np.float64),  # done on the ice [J]
    ]
)


class Laws(NamedTuple):
    """What contacts do, and where the box ends."""

    contact: Any
    wall: Any  # the contact law of walls
    period_x: float | None
    period_y: float | None


class Lists(NamedTuple):
    """Pairs about to touch, tile by tile."""

    near: Near
    pairs: PairList  # of the short list, with what they remember
    tiles: Tiles
    blows: np.ndarray  # room for those of two tiles, see `pairs.note_blows`
    gap: float  # the short list holds pairs nearer than this [1] and the skin [m], see `pairs.narrow`
    skin: float


class Walls(NamedTuple):
    """Walls, and the floes that may touch them."""

    walls: np.ndarray | None
    floe: np.ndarray
    number: np.ndarray  # of the wall
    damped: np.ndarray | None  # force of the dashpots [N], since the list was made


class Marked(NamedTuple):
    """Where floes and walls were when what holds until they have strayed too far was found.

    x, y, walls : places [m]; before : how far they had strayed by then, in earlier exchanges [m]
    still : there are walls or edges, which do not drift along with the floes
    """

    x: np.ndarray
    y: np.ndarray
    walls: np.ndarray
    before: float
    still: bool


class Books(NamedTuple):
    """A row for each tile, and a last one for seams and walls, so that threads share none.

    held : momentum along x and y [N s] and energy [J] given by what holds floes; lost : see `pairs.touch_floes`
    """

    held: np.ndarray
    lost: np.ndarray


# ---- kick, push, drift, touch -----------------------------------------------------------------------


@inner
def kick(p, first, n, dt, constraint):
    """Contact forces change the velocities of a block of floes for a time dt; held ones are booked."""
    if p.held.size > 0:
        hold_kick(p, first, n, dt, constraint)
    for k in range(first, first + n):
        kick_one(p, np.uintp(k), dt, 1.0)


@inner
def kick_one(p, k, dt, kept):
    """`kick` for one floe; kept : 1, or 0 where its force is used up."""
    floe, f = p.floes[k], p.force[k]
    floe.u += dt * p.inverse_x[k] * f.x
    floe.v += dt * p.inverse_y[k] * f.y
    f.x *= kept
    f.y *= kept
    kick_spin(p.spinning, p.inverse_spin, f, k, dt, kept)


@dispatched
def kick_spin(spinning, inverse_spin, f, k, dt, kept):
    spinning[k].omega += dt * inverse_spin[k] * f.torque
    f.torque *= kept


@kick_spin.register
def _(spinning: None, inverse_spin, f, k, dt, kept):
    pass


@inner
def hold_kick(p, first, n, dt, constraint):
    """What holds an axis takes up the contact forces along it."""
    for k in range(first, first + n):
        if p.inverse_x[k] == 0.0:
            constraint[0] -= dt * p.force[k].x
            constraint[2] -= dt * p.force[k].x * p.floes[k].u
        if p.inverse_y[k] == 0.0:
            constraint[1] -= dt * p.force[k].y
            constraint[2] -= dt * p.force[k].y * p.floes[k].v
    hold_kick_back(p.spinning, p.force, p.inverse_spin, first, n, dt, constraint)


@dispatched
def hold_kick_back(spinning, force, inverse_spin, first, n, dt, constraint):
    for k in range(first, first + n):
        if inverse_spin[k] == 0.0:
            constraint[2] -= dt * force[k].torque * spinning[k].omega


@hold_kick_back.register
def _(spinning: None, force, inverse_spin, first, n, dt, constraint):
    pass


@dispatched
def kick_walls(walls, dt, ahead):
    """Forces of the ice change the speed of walls; `ahead`: as much of their last change goes on top of them."""
    for w in range(walls.size):
        wall = walls[w]
        force = wall.force + ahead * (wall.force - wall.previous)
        wall.previous = wall.force
        change = dt * wall.inverse_mass * (force + wall.side * wall.press)
        wall.impulse -= dt * force
        wall.work -= dt * force * (wall.speed + 0.5 * change)
        wall.speed += change


@kick_walls.register
def _(walls: None, dt, ahead):
    pass


@inner
def kick_and_push(forces, at, p, first, n, kicked, pushed, parts, constraint, buffer):
    """Kick a block of floes, then let the other forces act for a time `pushed` in some parts."""
    kick(p, first, n, kicked, constraint)
    for k in range(n):
        floe = p.floes[np.uintp(first + k)]
        buffer[U + k], buffer[V + k] = floe.u, floe.v
    read_spin(p.spinning, first, n, buffer)
    for _ in range(parts):
        push(
            forces, at, first, n, p.mass, p.inertia, p.inverse_x, p.inverse_y, p.inverse_spin,
            p.held, pushed / parts, constraint, buffer,
        )  # fmt: skip
    for k in range(n):
        floe = p.floes[np.uintp(first + k)]
        floe.u, floe.v = buffer[U + k], buffer[V + k]
    write_spin(p.spinning, first, n, buffer)


@inner
def glide(p, begin, end, kicked, dt, constraint):
    """Kick and drift floes, which uses up the contact forces; returns the largest speed²."""
    fastest = 0.0
    if p.held.size > 0:
        hold_kick(p, begin, end - begin, kicked, constraint)
    for k in range(begin, end):
        k = np.uintp(k)
        kick_one(p, k, kicked, 0.0)
        floe = p.floes[k]
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
def read_spin(spinning, first, n, buffer):
    for k in range(n):
        buffer[OMEGA + k] = spinning[np.uintp(first + k)].omega


@read_spin.register
def _(spinning: None, first, n, buffer):
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
        wall.position += 0.5 * dt * wall.speed
        wall.speed *= np.exp(-wall.damping * dt)
        wall.position += 0.5 * dt * wall.speed
        fastest = max(fastest, wall.speed * wall.speed)
    return fastest


@drift_walls.register
def _(walls: None, dt):
    return 0.0


@inner
def push(
    forces, at, first, n, mass, inertia, inverse_x, inverse_y, inverse_spin, held, h, constraint, buffer
):  # fmt: skip
    """The other forces on a block of floes: (1 − h/2 Σ J) δu = h Σ a; a held axis keeps its velocity."""
    half, block = 0.5 * h, first // BLOCK
    buffer[A_X : SLOPE + BLOCK] = 0.0
    total(forces, at, block, n, buffer)
    for k in range(n):
        floe = np.uintp(first + k)
        free_x, free_y = inverse_x[floe] > 0.0, inverse_y[floe] > 0.0
        ax, xx, xy = buffer[A_X + k], buffer[J_XX + k], buffer[J_XY + k]
        ay, yx, yy = buffer[A_Y + k], buffer[J_YX + k], buffer[J_YY + k]
        ax, xx, xy = (ax, xx, xy) if free_x else (0.0, 0.0, 0.0)
        ay, yx, yy = (ay, yx, yy) if free_y else (0.0, 0.0, 0.0)
        m11, m12, m21, m22 = 1.0 - half * xx, -half * xy, -half * yx, 1.0 - half * yy
        scale = h / (m11 * m22 - m12 * m21)
        buffer[D_U + k] = scale * (m22 * ax - m12 * ay)
        buffer[D_V + k] = scale * (m11 * ay - m21 * ax)
    for k in range(n):
        buffer[IMPULSE + k] = mass[np.uintp(first + k)] * h
    book(forces, at, block, n, buffer)
    if held.size > 0:
        hold_back(first, n, inverse_x, inverse_y, constraint, buffer)
    push_spin(inverse_spin, forces, at, first, n, inertia, h, held, constraint, buffer)
    for k in range(n):
        buffer[U + k] += buffer[D_U + k]
        buffer[V + k] += buffer[D_V + k]


@dispatched
def push_spin(inverse_spin, forces, at, first, n, inertia, h, held, constraint, buffer):
    block = first // BLOCK
    total_spin(forces, at, block, n, buffer)
    for k in range(n):
        floe = np.uintp(first + k)
        change = h * buffer[ALPHA + k] / (1.0 - 0.5 * h * buffer[SLOPE + k])
        buffer[D_OMEGA + k] = change if inverse_spin[floe] > 0.0 else 0.0
    for k in range(n):
        buffer[TWIST + k] = inertia[np.uintp(first + k)] * h
    book_spin(forces, at, block, n, buffer)
    if held.size > 0:
        hold_spin_back(inverse_spin, first, n, constraint, buffer)
    for k in range(n):
        buffer[OMEGA + k] += buffer[D_OMEGA + k]


@push_spin.register
def _(inverse_spin: None, forces, at, first, n, inertia, h, held, constraint, buffer):
    pass


@inner
def hold_back(first, n, inverse_x, inverse_y, constraint, buffer):
    """What holds an axis takes up the other forces along it."""
    for k in range(n):
        du, dv = buffer[D_U + k], buffer[D_V + k]
        if inverse_x[first + k] == 0.0:
            a = buffer[A_X + k] + 0.5 * (buffer[J_XX + k] * du + buffer[J_XY + k] * dv)
            constraint[0] -= buffer[IMPULSE + k] * a
            constraint[2] -= buffer[IMPULSE + k] * a * buffer[U + k]
        if inverse_y[first + k] == 0.0:
            a = buffer[A_Y + k] + 0.5 * (buffer[J_YX + k] * du + buffer[J_YY + k] * dv)
            constraint[1] -= buffer[IMPULSE + k] * a
            constraint[2] -= buffer[IMPULSE + k] * a * buffer[V + k]


@inner
def hold_spin_back(inverse_spin, first, n, constraint, buffer):
    for k in range(n):
        if inverse_spin[first + k] == 0.0:
            constraint[2] -= buffer[TWIST + k] * buffer[ALPHA + k] * buffer[OMEGA + k]


@dispatched
def touch_walls(
    wall_law, floes, edges, dt, force, inverse, constraint, lost,
):  # fmt: skip
    """Frictionless walls push floes that reach over them (eq. wall)."""
    walls = edges.walls
    for w in range(walls.size):
        walls[w].force = 0.0
    for q in range(edges.floe.size):
        k = edges.floe[q]
        wall = walls[edges.number[q]]
        floe = floes[k]
        along_x = wall.axis == 0
        gap = wall.side * ((floe.x if along_x else floe.y) - wall.position) - floe.r
        opening = wall.side * ((floe.u if along_x else floe.v) - wall.speed)
        f = pair_force(
            wall_law, gap, opening, 0.0, 0.0, floe.r, floe.r, floe.h, floe.h, floe.w, 0.0, 0.0,
            0.0, 0.0, recall(edges.damped, q), 0.0, 0.0, 0.0, dt,
        )  # fmt: skip
        remember(edges.damped, q, f.damped)
        if along_x:
            force[k].x += wall.side * f.f_n
        else:
            force[k].y += wall.side * f.f_n
        wall.force -= wall.side * f.f_n
        strike_wall(inverse, wall_law, floes, force, k, wall, along_x, f, opening, dt, constraint)
        lost[1] += f.dashpot_loss


@touch_walls.register
def _(wall_law: None, floes, edges, dt, force, inverse, constraint, lost):
    pass


@dispatched
def strike_wall(inverse, wall_law, floes, force, k, wall, along_x, f, opening, dt, constraint):
    """The blow of a floe that met a wall or left it: on the floe, and its opposite on the wall."""
    if f.blow_n == 0.0:
        return
    w = inverse[0][k] if along_x else inverse[1][k]
    pushed = w * (force[k].x if along_x else force[k].y) - wall.inverse_mass * wall.force
    ahead = opening + 0.5 * dt * wall.side * pushed
    impulse, _ = blow(wall_law.dashpot, f.blow_n, opening, ahead, w + wall.inverse_mass)
    impulse *= wall.side
    x, y = (impulse, 0.0) if along_x else (0.0, impulse)
    strike(inverse, floes, k, x, y, constraint)
    change = -wall.inverse_mass * impulse
    wall.impulse += impulse
    wall.work += impulse * (wall.speed + 0.5 * change)
    wall.speed += change


@strike_wall.register
def _(inverse: None, wall_law, floes, force, k, wall, along_x, f, opening, dt, constraint):
    pass


# ---- the schemes ------------------------------------------------------------------------------------


@inner
def lean(force, begin, end, dt, kept, constraint):
    """Pieces of coast take up the contact forces on them; what turns them matters to nothing.

    kept : see `kick`
    """
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
    """Kick, push, kick and drift floes from begin, a multiple of BLOCK, to end; returns the largest speed².

    kicks : before and after the push [s]; pushed : time that the other forces act for [s], 0 where they do not yet
    """
    before, after = kicks
    if len(forces) == 0 or pushed == 0.0:
        return glide(packed, begin, end, before + after, dt, constraint)
    fastest = 0.0
    for first in range(begin, end, BLOCK):
        n = min(BLOCK, end - first)
        kick_and_push(
            forces, at, packed, first, n, before, pushed, substeps[first // BLOCK], constraint,
            buffer,
        )  # fmt: skip
        fastest = max(fastest, glide(packed, first, first + n, after, dt, constraint))
    return fastest


@in_place
def move_walls(walls, kicked, dt):
    """Kick and drift the walls; returns the largest speed²."""
    kick_walls(walls, kicked, 0.0)
    return drift_walls(walls, dt)


@in_place
def end_steps(forces, at, packed, tiles, walls, kicked, pushed, substeps, constraint, buffer):
    """The second half of the last kick, and what is left of the push; the forces stay to be looked at."""
    p = packed
    kick_walls(walls, kicked, 0.0)
    for tile in range(tiles.coast.size):
        begin, coast, end = tiles.bounds[tile], tiles.coast[tile], tiles.bounds[tile + 1]
        if len(forces) == 0 or pushed == 0.0:
            kick(p, begin, coast - begin, kicked, constraint)
        else:
            for first in range(begin, coast, BLOCK):
                n = min(BLOCK, coast - first)
                kick_and_push(
                    forces, at, p, first, n, kicked, pushed, substeps[first // BLOCK], constraint,
                    buffer,
                )  # fmt: skip
        lean(p.force, coast, end, kicked, 1.0, constraint)


@in_place
def time_to_push(lag, drag_every, dt, rest):
    """Time that the other forces act for at the beginning of a step [s]; 0 where they do not.

    They act once in `drag_every` steps, for half of that time before and half of it after.

    lag : time by which they are behind [s], and in how many steps they act; as it will be after this step
    rest : time to the end of the exchange, beyond which they may not act [s]
    """
    pushed = 0.0
    if lag[1] <= 0.0:
        ahead = min(0.5 * drag_every * dt, rest)
        pushed = lag[0] + ahead
        lag[0], lag[1] = -ahead, drag_every
    lag[0] += dt
    lag[1] -= 1.0
    return pushed


@in_place
def time_left_to_push(lag, reached):
    """The same at the end of some steps: what is left, if the end of the exchange is reached."""
    if not reached:
        return 0.0
    left = max(lag[0], 0.0)
    lag[:] = 0.0
    return left


@inner
def touch(laws, packed, lists, walls, tile, dt, inverse, books, buffer, blows):
    """Add the forces of the pairs of a tile; with those across the seams, the last, come the walls.

    dt, inverse : see `pairs.touch_floes`.  Returns how many blows there are.
    """
    p = packed
    noted = touch_floes(
        laws.contact, laws.period_x, laws.period_y, p.floes, p.spinning, p.friction,
        p.tensile_strength, lists.pairs, lists.near, tile, dt, p.force, inverse, books.held[tile],
        books.lost[tile], buffer, blows,
    )  # fmt: skip
    if tile == lists.near.counts.size - 1:
        touch_walls(laws.wall, p.floes, walls, dt, p.force, inverse, books.held[tile], books.lost[tile])  # fmt: skip
    return noted


@in_place
def touch_all(laws, packed, lists, walls, books, buffers):
    """The forces at the present place, and the short list, as a step leaves them."""
    p, near, last = packed, lists.near, lists.near.counts.size
    first = last - last  # as in `verlet`
    inverse = (p.inverse_x, p.inverse_y, p.inverse_spin)
    forget(p.spinning, p.force)
    narrow(laws.period_x, laws.period_y, p.floes, near, first, last, lists.gap, lists.skin)
    for tile in range(last):
        touch(laws, p, lists, walls, tile, 0.0, inverse, books, buffers[0], lists.blows[0])
    settle(near, first, last)


@inlined
def sweep(laws, forces, at, packed, lists, walls, first, last, moves, touches, kicks, dt, pushed, substeps,
          books, buffers):  # fmt: skip
    """Move the floes of some tiles, touch their pairs, tile by tile; returns the largest speed².

    kicks, pushed : see `move`
    buffers : of a block of pairs, shape (PAIR_BUFFER,), of a block of floes, (FORCE_BUFFER,), and the blows of two tiles
    """
    p, tiles, seams, fastest = packed, lists.tiles, lists.tiles.coast.size, 0.0
    pair_buffer, floe_buffer, blows = buffers
    inverse = (p.inverse_x, p.inverse_y, p.inverse_spin)
    noted = 0
    for tile in range(first, last + 1):
        if moves and tile < seams and tile < last:
            begin, coast, end = tiles.bounds[tile], tiles.coast[tile], tiles.bounds[tile + 1]
            speed2 = move(
                forces, at, p, begin, coast, kicks, dt, pushed, substeps, books.held[tile],
                floe_buffer,
            )  # fmt: skip
            lean(p.force, coast, end, kicks[0] + kicks[1], 0.0, books.held[tile])
            fastest = max(fastest, speed2)
        before, noted = noted, 0
        if touches and tile < last:
            noted = touch(
                laws, p, lists, walls, tile, dt, inverse, books, pair_buffer, blows[tile % 2]
            )
        if tile > first:  # the blows of the tile before, for which this one's forces are known now
            strike_floes(
                laws.contact, inverse, p.floes, p.spinning, blows[(tile - 1) % 2], before, dt,
                p.force, books.held[tile - 1], books.lost[tile - 1],
            )  # fmt: skip
    return fastest


@in_place
def verlet(
    laws, forces, at, packed, lists, walls, books, first_kick, way, dt, steps, substeps, marked,
    travelled, reach, drag_every, lag, buffers,
):  # fmt: skip
    """Up to `steps` steps of dt; ends early when floes have strayed nearly as far as `reach` [m]. Returns steps done.

    The last half kick of a step and the first of the next are of the same force: they are one kick, unless the other
    forces act between them.  Floes move and touch tile by tile, while they are in the cache, unless the short list is
    to be made anew between.

    way : of the fastest floe in a step [m], if the short list is of the present place; inf: it is to be made anew
    lag : see `time_to_push`; none is left after `steps`
    """
    p, near, last = packed, lists.near, lists.near.counts.size
    first = (
        last - last
    )  # a zero, but no literal: for one the compiler would make kernels of their own
    done, kicks, since = 0, (0.0, first_kick), 0.0
    while done < steps:
        if not travelled < reach:  # as a sum of ways, which is more than how far floes have strayed
            travelled = strayed(p.floes, walls.walls, marked)
            if not travelled < NEARLY * reach:
                break
        pushed = time_to_push(lag, drag_every, dt, (steps - done) * dt)
        anew = is_stale(since, way, lists.skin)
        fastest = move_walls(walls.walls, kicks[0] + kicks[1], dt)
        for turn in range(2 if anew else 1):  # move, list anew, touch; or move and touch at once
            if turn == 1:
                narrow(laws.period_x, laws.period_y, p.floes, near, first, last, lists.gap,
                       lists.skin + 2.0 * way)  # fmt: skip
            speed2 = sweep(
                laws, forces, at, p, lists, walls, first, last, turn == 0, turn == 1 or not anew,
                kicks, dt, pushed, substeps, books, (*buffers, lists.blows),
            )  # fmt: skip
            fastest = max(fastest, speed2)
            way = dt * np.sqrt(fastest)
        travelled, since = travelled + way, 0.0 if anew else since + way
        done, kicks = done + 1, (0.5 * dt, 0.5 * dt)
    settle(near, first, last)
    if done > 0:
        pushed = time_left_to_push(lag, done == steps)
        end_steps(
            forces, at, p, lists.tiles, walls.walls, 0.5 * dt, pushed, substeps,
            books.held[last - 1], buffers[1],
        )  # fmt: skip
    return done


@in_place
def strayed(floes, walls, marked):
    """Half of how much nearer any two floes, or a floe and a wall, may be than when they were marked [m]."""
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


@in_place
def is_stale(since, way, skin):
    """Whether a pair that is not on the short list may touch after the next step.

    since, way : of the fastest floe since the list was made, and in the last step [m]
    """
    return since + 2.0 * way > 0.5 * skin


@in_place
def taylor(
    third_order, laws, forces, at, packed, lists, walls, books, dt, steps, travelled, reach,
    buffers,
):  # fmt: skip
    """The paper's schemes: forces at the old place and velocity, then one Taylor step.

    x += u Δt + ½ a Δt² (+ ⅙ (a − a_old) Δt²),  u += a Δt (+ ½ (a − a_old) Δt)   (eq. taylor)

    a_old belongs to the contact forces; the other forces are explicit, their impulse is a Δt.  What a floe
    gets for the change of a force, its partner gets too: another floe, a wall, or what holds a floe.
    """
    p, near, tiles, parts = packed, lists.near, lists.tiles, lists.near.counts.size
    start, constraint = parts - parts, books.held[parts - 1]
    ahead = 0.5 if third_order else 0.0
    pair_buffer, buffer = buffers
    done, way, since = 0, 0.0, np.inf
    while done < steps and travelled < reach:
        forget(p.spinning, p.force)
        if is_stale(since, way, lists.skin):
            narrow(laws.period_x, laws.period_y, p.floes, near, start, parts, lists.gap,
                   lists.skin + 2.0 * way)  # fmt: skip
            since = 0.0
        for tile in range(parts):
            touch(laws, p, lists, walls, tile, dt, None, books, pair_buffer, lists.blows[0])
        for q in range(p.held.size):
            hold_taylor(p, p.held[q], ahead, dt, constraint)
        for tile in range(tiles.coast.size):
            for k in range(tiles.coast[tile], tiles.bounds[tile + 1]):
                hold_taylor(p, k, ahead, dt, constraint)
        fastest = 0.0
        for first in range(0, p.floes.size, BLOCK):
            n = min(BLOCK, p.floes.size - first)
            for k in range(n):
                buffer[U + k], buffer[V + k] = p.floes[first + k].u, p.floes[first + k].v
            read_spin(p.spinning, first, n, buffer)
            buffer[D_U : SLOPE + BLOCK] = 0.0
            for k in range(n):
                buffer[IMPULSE + k] = p.mass[first + k] * dt
            total(forces, at, first // BLOCK, n, buffer)
            book(forces, at, first // BLOCK, n, buffer)
            if p.held.size > 0:
                hold_back(first, n, p.inverse_x, p.inverse_y, constraint, buffer)
            twist(p.spinning, forces, at, first, n, p, dt, constraint, buffer)
            for k in range(n):
                floe, contact = p.floes[first + k], p.force[first + k]
                inverse_x, inverse_y = p.inverse_x[first + k], p.inverse_y[first + k]
                previous = p.previous[first + k]
                ax, ay = inverse_x * contact.x, inverse_y * contact.y
                ox = buffer[A_X + k] if inverse_x > 0.0 else 0.0
                oy = buffer[A_Y + k] if inverse_y > 0.0 else 0.0
                jerk_x = inverse_x * (contact.x - previous[0]) if third_order else 0.0
                jerk_y = inverse_y * (contact.y - previous[1]) if third_order else 0.0
                floe.x += (floe.u + (0.5 * (ax + ox) + jerk_x / 6.0) * dt) * dt
                floe.y += (floe.v + (0.5 * (ay + oy) + jerk_y / 6.0) * dt) * dt
                floe.u += (ax + ox + ahead * jerk_x) * dt
                floe.v += (ay + oy + ahead * jerk_y) * dt
                previous[0], previous[1] = contact.x, contact.y
                fastest = max(fastest, floe.u**2 + floe.v**2)
            taylor_spin(p.spinning, third_order, p, first, n, dt, buffer)
        kick_walls(walls.walls, dt, ahead)
        way = dt * np.sqrt(max(fastest, drift_walls(walls.walls, dt)))
        travelled, since = travelled + way, since + way
        done += 1
    settle(near, start, parts)
    return done


@inner
def hold_taylor(p, k, ahead, dt, constraint):
    """What holds an axis takes up the contact forces along it, and their change as free floes do."""
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


@inner
def forget(spinning, force):
    """Forces of the last step are used up."""
    for k in range(force.size):
        force[k].x = 0.0
        force[k].y = 0.0
    forget_torque(spinning, force)


@dispatched
def forget_torque(spinning, force):
    for k in range(force.size):
        force[k].torque = 0.0


@forget_torque.register
def _(spinning: None, force):
    pass


@dispatched
def twist(spinning, forces, at, first, n, p, dt, constraint, buffer):
    """Torques of the fluids at the old spin, and their work."""
    for k in range(n):
        buffer[TWIST + k] = p.inertia[first + k] * dt
    total_spin(forces, at, first // BLOCK, n, buffer)
    book_spin(forces, at, first // BLOCK, n, buffer)
    if p.held.size > 0:
        hold_spin_back(p.inverse_spin, first, n, constraint, buffer)


@twist.register
def _(spinning: None, forces, at, first, n, p, dt, constraint, buffer):
    pass


@dispatched
def taylor_spin(spinning, third_order, p, first, n, dt, buffer):
    for k in range(n):
        floe = first + k
        other = buffer[ALPHA + k] if p.inverse_spin[floe] > 0.0 else 0.0
        inverse, torque = p.inverse_spin[floe], p.force[floe].torque
        alpha = inverse * torque
        jerk = inverse * (torque - p.previous[floe, 2]) if third_order else 0.0
        omega = spinning[floe].omega
        p.angle[floe] += (omega + (0.5 * (alpha + other) + jerk / 6.0) * dt) * dt
        spinning[floe].omega += (alpha + other + 0.5 * jerk) * dt
        p.previous[floe, 2] = torque


@taylor_spin.register
def _(spinning: None, third_order, p, first, n, dt, buffer):
    pass
