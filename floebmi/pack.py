"""Floes as the kernels see them: active ones only, sorted in space, packed into few cache lines.

All that a contact reads of a floe is one record of 64 bytes.  Which fields and arrays exist follows from the
laws: a spin only with friction or a torque.  What is not needed is None, which the kernels compile to nothing.
"""

from typing import NamedTuple

import numpy as np

from floebmi.bonds import beam_of, bending_ratio, stretch
from floebmi.columns import LANES
from floebmi.contact import (
    Contact,
    coefficient,
    damping,
    largest_ratio,
    lever_arm,
    memories,
    pair_force,
    stiffness,
    stored,
    strength,
)
from floebmi.dynamics import Step, Walls
from floebmi.floes import FIXED_ROTATION, FIXED_X, FIXED_Y, LAND, Floes
from floebmi.kernels import as_records, dispatched, in_place, inner
from floebmi.neighbours import carry, find_pairs, sort_in_space
from floebmi.pairs import PairList, least_of, recall, remember, remembering, wrap
from floebmi.tiles import Tiles, by_tile, coast_last


def _record(*names: str) -> np.dtype:
    return np.dtype([(name, np.float64) for name in names])


# a floe is one line of the cache, in the order of `columns.gather`; w is 1/m, or 0 for a floe that nothing moves
SPINNING = _record("x", "y", "u", "v", "r", "h", "omega", "w")
MOVING = _record("x", "y", "u", "v", "r", "h", "unused", "w")
FORCE = _record("x", "y")
FORCE_AND_TORQUE = _record("x", "y", "torque", "unused")


def _lines(n: int, kind: np.dtype) -> np.ndarray:
    """n zero records that begin where a line of the cache does."""
    line = 64
    room = np.zeros(n * kind.itemsize + line, np.uint8)
    first = -room.ctypes.data % line
    return as_records(room[first : first + n * kind.itemsize].view(kind))


class Packed(NamedTuple):
    """The floes in a kernel's order."""

    floes: np.ndarray  # x, y, u, v, r, h, w
    spinning: np.ndarray | None  # the same records, if they have an omega
    force: np.ndarray  # x, y (and torque)
    number: np.ndarray  # the floe's number for ever
    mass: np.ndarray  # 0 of coast
    inverse_x: np.ndarray  # 1/m, or 0 where motion along x is prescribed
    inverse_y: np.ndarray
    inertia: np.ndarray | None
    inverse_spin: np.ndarray | None
    angle: np.ndarray | None
    held: np.ndarray  # packed index of floes with a prescribed axis, coast aside
    land: np.ndarray  # bool: a piece of coast
    first_x: np.ndarray  # where the floe was when it was packed
    first_y: np.ndarray
    previous: np.ndarray | None  # contact forces, torques of the last step, for the paper's schemes
    origin_x: float  # of the records' coordinates
    origin_y: float
    friction: np.ndarray | None  # μ and σ_c of each floe, where they differ
    tensile_strength: np.ndarray | None


def places(
    floes: Floes,
    number: np.ndarray,
    origin: tuple[float, float],
    remainder: np.ndarray | None,
) -> tuple[np.ndarray, np.ndarray]:
    """Where some floes are, from the origin of the records [m].

    remainder : what rounding took from the floes' x, y when they were unpacked (n, 2) [m], or None
    """
    x, y = np.empty((2, len(number)))
    _from_origin(floes.x, floes.y, number, *origin, x, y)
    return (x, y) if remainder is None else (x + remainder[number, 0], y + remainder[number, 1])


@in_place
def _from_origin(x, y, number, origin_x, origin_y, here_x, here_y):
    for k in range(number.size):
        floe = np.uintp(number[k])
        here_x[k], here_y[k] = x[floe] - origin_x, y[floe] - origin_y


def in_space(
    floes: Floes, origin: tuple[float, float], remainder: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The numbers of the active floes, sorted in space, coast last, and where they are; see `places`."""
    number = np.flatnonzero(floes.active)
    x, y = places(floes, number, origin, remainder)
    if not len(number):
        return number, x, y
    order = sort_in_space(x, y, floes.radius[number])
    land = floes.land[number[order]]
    if land.any():
        order = order[coast_last(land)]
    return number[order], x[order], y[order]


def pack(
    floes: Floes,
    number: np.ndarray,
    first_x: np.ndarray,
    first_y: np.ndarray,
    density: float,
    previous: np.ndarray | None,
    origin: tuple[float, float],
) -> Packed:
    """Copy floes into records, in the order of their numbers, at the places given.

    previous : forces [N] and torques [N m] (n, 3) of the last step that the paper's schemes keep, or None
    origin : x, y from which the records count [m]
    """
    n = len(number)
    rotation = floes.rotation
    records = _lines(n, SPINNING if rotation else MOVING)
    bits, mass, radius = floes.motion[number], floes.mass(density)[number], floes.radius[number]
    land = (bits & LAND) != 0
    inverse = 1.0 / mass
    inverse_x = np.where(bits & FIXED_X, 0.0, inverse)
    inverse_y = np.where(bits & FIXED_Y, 0.0, inverse)
    records["r"], records["h"] = radius, floes.thickness[number]
    records["w"] = np.maximum(inverse_x, inverse_y)
    inertia = inverse_spin = None
    if rotation:
        inertia = 0.5 * mass * radius**2
        inverse_spin = np.where(bits & FIXED_ROTATION, 0.0, 1.0 / inertia)
    mass[land] = 0.0
    packed = Packed(
        records,
        records if rotation else None,
        _lines(n, FORCE_AND_TORQUE if rotation else FORCE),
        number,
        mass,
        inverse_x,
        inverse_y,
        inertia,
        inverse_spin,
        None,
        np.flatnonzero((bits != 0) & ~land),
        land,
        first_x,
        first_y,
        None,
        *origin,
        None,
        None if floes.tensile_strength is None else floes.tensile_strength[number],
    )
    return pack_again(packed, floes, first_x, first_y, previous)


def pack_again(
    packed: Packed,
    floes: Floes,
    first_x: np.ndarray,
    first_y: np.ndarray,
    previous: np.ndarray | None,
) -> Packed:
    """The same floes in the same arrays, at the places given and as fast as they are now; see `pack`.

    Radius, thickness and prescribed motion are those of before; forces are left to be found.
    """
    number = packed.number
    angle = None if packed.spinning is None else np.empty(len(number))
    _set_going(
        packed.floes, packed.spinning, angle, first_x, first_y, number, floes.u, floes.v,
        floes.angular_velocity, floes.angle,
    )  # fmt: skip
    return packed._replace(
        angle=angle,
        first_x=first_x,
        first_y=first_y,
        previous=None if previous is None else previous[number],
        friction=None if floes.friction is None else floes.friction[number],
    )


@in_place
def _set_going(records, spinning, angle, x, y, number, u, v, omega, all_angles):
    """Write records one after the other: column by column each would be fetched many times."""
    for k in range(number.size):
        floe, record = np.uintp(number[k]), records[k]
        record.x, record.y, record.u, record.v = x[k], y[k], u[floe], v[floe]
        set_omega(spinning, k, recall(omega, floe))
        remember(angle, k, recall(all_angles, floe))


def unpack(
    packed: Packed, floes: Floes, previous: np.ndarray | None, remainder: np.ndarray | None
) -> None:
    """Copy what moved back into the floes."""
    p, number = packed, packed.number
    _put_back(
        p.floes, p.spinning, p.angle, number, p.first_x, p.first_y, p.origin_x, p.origin_y,
        floes.x, floes.y, floes.u, floes.v, floes.angular_velocity, floes.angle,
    )  # fmt: skip
    if remainder is not None:
        # not in a kernel, whose fast mathematics would find that rounding takes nothing
        for axis, (place, now, first, origin) in enumerate(
            (
                (floes.x, p.floes["x"], p.first_x, p.origin_x),
                (floes.y, p.floes["y"], p.first_y, p.origin_y),
            )
        ):
            moved = now != first
            of = number[moved]
            remainder[of, axis] = now[moved] - (place[of] - origin)
    if previous is not None:
        previous[number] = p.previous


@in_place
def _put_back(
    records, spinning, angle, number, first_x, first_y, origin_x, origin_y, x, y, u, v, omega, all_angles
):  # fmt: skip
    for k in range(number.size):
        floe, record = np.uintp(number[k]), records[k]
        if record.x != first_x[k]:  # one that did not move keeps its place to the bit
            x[floe] = record.x + origin_x
        if record.y != first_y[k]:
            y[floe] = record.y + origin_y
        u[floe], v[floe] = record.u, record.v
        remember(omega, floe, omega_of(spinning, k))
        remember(all_angles, floe, recall(angle, k))


def reach(packed: Packed, contact: Contact | None, skin: float) -> np.ndarray:
    """How far a floe may interact [m]: its radius, the gap that a bond spans, half the skin."""
    if contact is None:
        return np.ascontiguousarray(packed.floes["r"])
    return packed.floes["r"] * (1.0 + widest_gap(packed, contact)) + 0.5 * skin


def widest_gap(packed: Packed, contact: Contact | None) -> float:
    """The widest gap that a bond spans, over the sum of radii [1]."""
    if contact is None:
        return 0.0
    strongest = packed.tensile_strength
    if strongest is None:
        strongest = strength(contact.bonds)
    else:
        strongest = strongest.max(initial=0.0)
    return float(stretch(strongest, contact.elastic.youngs_modulus))


def list_pairs(
    packed: Packed,
    contact: Contact | None,
    period: tuple[float | None, float | None],
    skin: float,
    old: PairList,
    old_number: np.ndarray,
    place: np.ndarray,
) -> tuple[PairList, Tiles, int]:
    """A fresh list of candidate pairs that remembers what the old one did, the tiles of the pack, and how many pairs were tested.

    old_number : of the floe of each row of the old list
    place : row of each floe number in the new list, −1 where it has none
    """
    if contact is None or len(packed.number) < 2:
        empty = np.zeros(0, np.uint32)
        start = np.zeros(len(packed.number) + 1, np.int64)
        start, i, j, tiles = by_tile(start, empty, empty, packed.land)
        return PairList(start, i, j, **_nothing(contact, 0)), tiles, 0
    x, y = packed.first_x, packed.first_y
    found = find_pairs(x, y, reach(packed, contact, skin), period, packed.land)
    i, j = found.i.view(np.uint32), found.j.view(np.uint32)
    start, i, j, tiles = by_tile(found.start, i, j, packed.land)
    new = PairList(start, i, j, **_nothing(contact, len(i)))
    for name, memory in old.memory().items():
        carry(
            old.i, old.j, old_number, memory, place, start, tiles.seam, j, getattr(new, name),
            _sign_of_reverse(name),
        )  # fmt: skip
    return new, tiles, found.tested


def _sign_of_reverse(name: str) -> float:
    """Seen from j, the angle by which the other has turned is the opposite; all else is the same."""
    return -1.0 if name == "bent" else 1.0


def _nothing(contact: Contact | None, n: int) -> dict[str, np.ndarray]:
    """The memory of n pairs that remember nothing yet."""
    names = memories(contact)
    if contact is not None and contact.dashpot is not None:
        names += ("damped",)
    memory, block = remembering(names, n)
    return {**memory, "block": block}


def remembered(pairs: PairList, number: np.ndarray, n: int) -> PairList:
    """The pairs that remember anything, by number of n floes, in an order that depends on nothing else.

    number : of the floe of each row
    """
    keep = np.zeros(len(pairs.i), bool)
    for memory in pairs.memory().values():
        keep |= memory != 0.0
    a, b = number[pairs.i[keep]], number[pairs.j[keep]]
    low, high = np.minimum(a, b), np.maximum(a, b)
    order = np.lexsort((high, low))
    start = np.searchsorted(low[order], np.arange(n + 1))
    memory = {
        name: np.where(a > b, _sign_of_reverse(name), 1.0)[order] * values[keep][order]
        for name, values in pairs.memory().items()
    }
    return PairList(start, low[order].astype(np.uint32), high[order].astype(np.uint32), **memory)


# ---- the stable step --------------------------------------------------------------------------------


# A floe's own matrix [1/s²] in x, y and s = r θ/√2, by its mass; and the sum of its damping rates [1/s].
STIFFNESS = np.dtype([(name, np.float64) for name in ("xx", "yy", "xy", "xs", "ys", "ss", "rate")])


class Stiffest(NamedTuple):
    """What sets the step: ω_max² bound [1/s²], its floe (packed index), damping rate [1/s]."""

    omega2: float
    floe: int
    damping: float


def stable_step(stiffest: Stiffest, step: Step) -> float:
    """Δt = fraction × 2 (√(1 + ζ²) − ζ)/ω_max (eq. stable-step); inf where nothing is stiff."""
    if not stiffest.omega2 > 0:
        return np.inf
    omega = np.sqrt(stiffest.omega2)
    zeta = 0.5 * stiffest.damping / omega
    return step.fraction * 2.0 * (np.sqrt(1.0 + zeta * zeta) - zeta) / omega


def paper_step(floes: Floes, contact: Contact, density: float, epsilon: float) -> float:
    """Eq. 4: Δt = ε √(m_min/k_max), k = E h; inf where no floe moves in the domain."""
    ice = floes.active & ~floes.land
    if not ice.any():
        return np.inf
    k_max = contact.elastic.youngs_modulus * floes.thickness[ice].max()
    return epsilon * float(np.sqrt(floes.mass(density)[ice].min() / k_max))


def stiffest(
    contact: Contact | None,
    packed: Packed,
    pairs: PairList,
    period: tuple[float | None, float | None],
    walls: Walls,
    closing: float,
) -> Stiffest:
    """Bound on the highest frequency of the pack, from each floe's own stiffness sum (eq. stable-step).

    All pairs that may close count as contacts, so the bound holds until floes have strayed half of `closing` [m];
    and no floe counts for less than one in a hexagonal pack without friction, so that a single collision is
    resolved as well.
    """
    if contact is None or not len(packed.number):
        return Stiffest(0.0, -1, 0.0)
    return Stiffest(
        *_stiffest(
            contact,
            *period,
            packed.floes,
            packed.inverse_x,
            packed.inverse_y,
            pairs.i,
            pairs.j,
            walls,
            closing,
            widest_gap(packed, contact),
            as_records(np.zeros(len(packed.number), STIFFNESS)),
        )
    )


@in_place
def _stiffest(
    law, period_x, period_y, floes, inverse_x, inverse_y, pair_i, pair_j, walls, closing, widest, sums
):  # fmt: skip
    # The energy of a contact, ½ k (b_i·q_i − b_j·q_j)², is at most ½ k [(1 + s)(b_i·q_i)² + (1 + 1/s)(b_j·q_j)²]
    # for any s > 0; s = √(m_i/m_j) is exact for two equal floes, and for a floe against a fixed one.
    # Each floe is then a 3 × 3 problem of its own in (x, y, r θ/√2), divided by its mass.
    ratio, bend = largest_ratio(law), bending_ratio(beam_of(law.bonds))
    for p in range(pair_i.size):
        i, j = pair_i[p], pair_j[p]
        one, other = floes[i], floes[j]
        dx, dy = wrap(period_x, other.x - one.x), wrap(period_y, other.y - one.y)
        distance = np.sqrt(dx * dx + dy * dy)
        if distance > (one.r + other.r) * (1.0 + widest) + closing:
            continue
        nx, ny = dx / distance, dy / distance
        k_n = stiffness(law.elastic, one.h, other.h)
        w_i, w_j = max(inverse_x[i], inverse_y[i]), max(inverse_x[j], inverse_y[j])
        c = damping(law.dashpot, k_n, w_i + w_j)
        gap = distance - one.r - other.r
        a_i = lever_arm(law.friction, one.r, other.r, gap) / one.r
        a_j = lever_arm(law.friction, other.r, one.r, gap) / other.r
        k_b = bend * k_n * (2.0 * one.r * other.r / (one.r + other.r)) ** 2
        add_stiffness(sums[i], w_i, w_j, k_n, ratio * k_n, k_b / one.r**2, c, nx, ny, a_i)
        add_stiffness(sums[j], w_j, w_i, k_n, ratio * k_n, k_b / other.r**2, c, -nx, -ny, a_j)
    highest, which, rate = 0.0, -1, 0.0
    # the sums of one wall, whose floes are listed one after the other
    of_wall, rate_of_wall = 0.0, 0.0
    for q in range(walls.floe.size):
        k = walls.floe[q]
        wall = walls.walls[walls.number[q]]
        w = max(inverse_x[k], inverse_y[k])
        k_n = stiffness(law.elastic, floes[k].h, floes[k].h)
        nx = 1.0 if wall.axis == 0 else 0.0
        c = damping(law.dashpot, k_n, w + wall.inverse_mass)
        add_stiffness(sums[k], w, wall.inverse_mass, k_n, 0.0, 0.0, c, nx, 1.0 - nx, 0.0)
        if q == 0 or walls.number[q] != walls.number[q - 1]:
            of_wall, rate_of_wall = 0.0, 0.0
        share = wall.inverse_mass + np.sqrt(wall.inverse_mass * w)
        of_wall += share * k_n
        rate_of_wall += share * c
        if of_wall > highest:
            highest, which = of_wall, k
        rate = max(rate, rate_of_wall)
    for k in range(floes.size):
        w = max(inverse_x[k], inverse_y[k])
        if w == 0.0:
            continue
        single = stiffness(law.elastic, floes[k].h, floes[k].h)
        value = max(largest_eigenvalue(sums[k], highest), 6.0 * max(1.0, ratio) * single * w)
        if value > highest:
            highest, which = value, k
        rate = max(rate, sums[k].rate, 2.0 * w * damping(law.dashpot, single, 2.0 * w))
    return highest, which, rate


@inner
def add_stiffness(row, w_i, w_j, k_n, k_t, k_b, c, nx, ny, arm):
    if w_i == 0.0:
        return
    share = (1.0 + np.sqrt(w_j / w_i)) * w_i
    spin = np.sqrt(2.0) * arm  # a/√(J/m) with J = m r²/2
    row.xx += share * (k_n * nx * nx + k_t * ny * ny)
    row.yy += share * (k_n * ny * ny + k_t * nx * nx)
    row.xy += share * (k_n - k_t) * nx * ny
    row.xs += share * k_t * spin * ny  # t = (−n_y, n_x); b = (t, a)
    row.ys -= share * k_t * spin * nx
    row.ss += share * (k_t * spin * spin + 2.0 * k_b)
    row.rate += share * c


@inner
def largest_eigenvalue(row, floor):
    """Of the symmetric matrix (xx, yy, ss; xy, xs, ys), by the trigonometric formula; at least `floor`."""
    xx, yy, xy, xs, ys, ss = row.xx, row.yy, row.xy, row.xs, row.ys, row.ss
    mean = (xx + yy + ss) / 3.0
    a, b, c = xx - mean, yy - mean, ss - mean
    p2 = (a * a + b * b + c * c + 2.0 * (xy * xy + xs * xs + ys * ys)) / 6.0
    p = np.sqrt(p2)
    if mean + 2.0 * p <= floor:  # of most floes no more need be known
        return floor
    if p2 <= 0.0:
        return mean
    determinant = a * (b * c - ys * ys) - xy * (xy * c - ys * xs) + xs * (xy * ys - b * xs)
    r = min(max(determinant / (2.0 * p2 * p), -1.0), 1.0)
    return mean + 2.0 * p * np.cos(np.arccos(r) / 3.0)


# ---- energy and contacts, looked at rather than stepped ---------------------------------------------


class Contacts(NamedTuple):
    """Pairs that push or hold each other now.

    i, j : floe numbers; x, y : contact point [m]; dx, dy : branch vector from the centre of i to that of j [m]
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

    near, pairs : the short list, as steps or a look at the forces leave it; the others cannot touch
    """
    room = near.counts.sum()
    if law is None or room == 0:
        return np.empty(0, np.int64), np.empty((0, 9))
    touching, rows = np.empty(room, np.int64), np.empty((room, 9))
    n = _touching_pairs(law, period_x, period_y, floes, mu, sigma, near, pairs, touching, rows)
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
    """The pair with the largest overlap over its smaller radius, and that share; of floes that move."""
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
    """How packed floes fare.

    finite : all places, velocities and angles are numbers; energy : kinetic, of what does not turn [J]
    speed, spin : of the fastest [m/s] and of the one that turns fastest [rad/s]
    pace, which : how fast the fastest for its radius is [radii per s], and its packed index
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
        # no isfinite: with fast mathematics x − x is 0 whatever x is
        finite &= (speed2 < np.inf) & (abs(floe.x) < np.inf) & (abs(floe.y) < np.inf)
        finite &= abs(omega + recall(p.angle, k)) < np.inf
        energy += 0.5 * p.mass[k] * speed2
        fastest2, spin = max(fastest2, speed2), max(spin, abs(omega))
        here2 = speed2 / (floe.r * floe.r)
        if here2 > pace2:
            pace2, which = here2, k
    return finite, energy, np.sqrt(fastest2), spin, np.sqrt(pace2), which


@dispatched
def omega_of(spinning, k):
    """The angular velocity of a floe; none where floes do not turn."""
    return spinning[k].omega


@omega_of.register
def _(spinning: None, k):
    return 0.0


@dispatched
def set_omega(spinning, k, omega):
    """Give a floe its angular velocity, where floes turn."""
    spinning[k].omega = omega


@set_omega.register
def _(spinning: None, k, omega):
    pass


@in_place
def stock_of_each(of, radius, thickness, u, v, omega, density, stock):
    """Fill rows with mass [kg], momentum x, y [N s] and kinetic energy [J] of some floes, (n,) bool; 0 of the others."""
    for k in range(of.size):
        m = density * np.pi * radius[k] * radius[k] * thickness[k]
        m = m if of[k] else 0.0
        turns = radius[k] * recall(omega, k)
        stock[0, k], stock[1, k], stock[2, k] = m, m * u[k], m * v[k]
        stock[3, k] = 0.5 * m * (u[k] * u[k] + v[k] * v[k] + 0.5 * turns * turns)  # J = m r²/2


@in_place
def pressed(packed, walls):
    """Of the contact forces: Σ|F|²/m [N²/kg], torques with J, and the power Σ F·u [W], of what is held, too.

    What is held has an inverse mass of 0, but its share of the power, for what holds it does that work.
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
    """The same of walls, where |F|² is the force of the ice times the net force (eq. kept-energy).

    What the load does is work on the wall, not energy of the ice.
    """
    for w in range(walls.size):
        wall = walls[w]
        press += wall.inverse_mass * wall.force * (wall.force + wall.side * wall.press)
        power += wall.force * wall.speed
    return press, power


@add_walls.register
def _(walls: None, press, power):
    return press, power
