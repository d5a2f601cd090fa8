"""Pairs of floes: the list of those that may touch, the short list of those about to touch, and their forces.

The list (neighbours.py) holds all pairs that may touch before it is renewed.  Most of them do not, so the kernels
keep a second list, of the pairs close enough to touch in the next few steps, and step with that one alone
(eq. near).  The short list holds the memory of its pairs contiguously.
"""

from typing import NamedTuple

import numpy as np

from floebmi.columns import (
    BLOW_N,
    BLOW_T,
    DU,
    DV,
    DX,
    DY,
    FX,
    FY,
    H_I,
    H_J,
    LANES,
    MU,
    OMEGA_I,
    OMEGA_J,
    R_I,
    R_J,
    SIGMA,
    TORQUE_I,
    TORQUE_J,
    W_I,
    W_J,
    gather,
    scatter,
)  # fmt: skip
from floebmi.contact import blow, coefficient, lever_arm, pair_force, strength
from floebmi.kernels import BLOCK, as_records, dispatched, in_place, inner

MEMORIES = "slip", "bonded", "bent", "failed", "slid", "damped"
# Columns of `Tally.lost`: the energy that each took [J], and the number of bonds broken.
FRICTION, DASHPOTS, BONDS, FAILURE, BROKEN = range(5)

BLOW = np.dtype(  # of a pair whose contact opened or closed, see `contact.blow`
    [
        ("i", np.int64),
        ("j", np.int64),
        ("nx", np.float64),
        ("ny", np.float64),
        ("a_i", np.float64),  # lever arms [m]
        ("a_j", np.float64),
        ("opening", np.float64),  # when the blow was found [m/s]
        ("slip_rate", np.float64),
        ("normal", np.float64),  # impulses [N s]
        ("tangential", np.float64),
    ]
)


class PairList(NamedTuple):
    """Candidate pairs and their memory; see `contact.memories`.

    i, j : rows of the packed floes; start : row k has the pairs start[k] to start[k + 1] − 1; None in the short list
    """

    start: np.ndarray | None
    i: np.ndarray
    j: np.ndarray
    slip: np.ndarray | None = None  # of the spring along t [m]
    bonded: np.ndarray | None = None  # see `bonds.hold`
    bent: np.ndarray | None = None  # rotation of j relative to i since they bonded [rad]
    failed: np.ndarray | None = None  # 1 once the ice has failed, until the floes separate
    slid: np.ndarray | None = None  # of the spring along n of a pair that failed [m]
    damped: np.ndarray | None = None  # force of the dashpots [N]; anew in each list and exchange
    block: np.ndarray | None = None  # all of these, row by row

    def memories(self) -> tuple[str, ...]:
        """Names of the rows of the block."""
        return tuple(name for name in MEMORIES if getattr(self, name) is not None)

    def copy(self) -> "PairList":
        """The same pairs with a copy of the memory that outlasts the list."""
        block = self.block.copy()
        memory = dict(zip(self.memories(), block, strict=True))
        if self.damped is not None:
            memory["damped"][:] = 0.0
        return self._replace(**memory, block=block)

    def memory(self) -> dict[str, np.ndarray]:
        """The memory that outlasts the list, by name."""
        named = {name: getattr(self, name) for name in MEMORIES[:-1]}
        return {name: values for name, values in named.items() if values is not None}


class Inverse(NamedTuple):
    """Inverse masses and inertias of floes: 0 along an axis with prescribed motion.

    held : whether any floe other than coast has such an axis; else the w of a floe's own record serves both axes
    x, y : inverse masses [1/kg]; spin : inverse inertia, or None
    """

    held: bool
    x: np.ndarray
    y: np.ndarray
    spin: np.ndarray | None


class Near(NamedTuple):
    """The short list: close pairs of a `PairList`, part by part, with room for all of them.

    list_i, list_j, list_block : the list; slot : positions in it; i, j, block : the short list itself
    parts : where the parts of the list begin and end; counts : number of close pairs in each part
    """

    list_i: np.ndarray
    list_j: np.ndarray
    list_block: np.ndarray
    slot: np.ndarray
    i: np.ndarray
    j: np.ndarray
    block: np.ndarray
    parts: np.ndarray
    counts: np.ndarray


def near_of(pairs: PairList, parts: np.ndarray) -> tuple[Near, PairList]:
    """Room for the short list of a list, and the same arrays as a `PairList`.

    Each part has room for four extra pairs, since pairs are taken four at a time.
    """
    count = len(parts) - 1
    room = len(pairs.i) + count * LANES
    slot, i, j = np.empty((3, room), np.uint32)
    memory, block = remembering(pairs.memories(), room)
    return (
        Near(pairs.i, pairs.j, pairs.block, slot, i, j, block, parts, np.zeros(count, np.int64)),
        PairList(None, i, j, **memory, block=block),
    )


def emptied(near: Near, pairs: PairList) -> Near:
    """The same room, emptied, for a short list of the same pairs with another memory."""
    return near._replace(list_block=pairs.block, counts=np.zeros_like(near.counts))


def room_for_blows(parts: np.ndarray) -> np.ndarray:
    """Room for the blows of two parts, each as large as the largest part."""
    return as_records(np.empty((2, np.diff(parts).max(initial=0)), BLOW))


def remembering(names: tuple[str, ...], n: int) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """The memory of n pairs, all 0: by name, and as one block whose rows are the named arrays."""
    block = np.zeros((len(names), n))
    return dict(zip(names, block, strict=True)), block


@dispatched
def wrap(period, d):
    """A coordinate difference to the nearest image in a periodic direction."""
    return d - period * np.rint(d / period)


@wrap.register
def _(period: None, d):
    return d


def any_period(period: tuple[float | None, float | None]) -> tuple[float, ...]:
    """A length [m] for each direction, beyond all distances where there is no period.

    For kernels that run once in many steps: compiled once, `wrap` gives them the same to the last bit.
    """
    return tuple(1e300 if side is None else side for side in period)


@dispatched
def recall(memory, p):
    """The value of pair or floe p; 0 where there is no such array."""
    # unsigned: no wrap-around of negative indices, so the loop vectorises
    return memory[np.uintp(p)]


@recall.register
def _(memory: None, p):
    return 0.0


@dispatched
def remember(memory, p, value):
    """Store a value in the slot of pair p."""
    memory[np.uintp(p)] = value


@remember.register
def _(memory: None, p, value):
    pass


# ---- the short list -----------------------------------------------------------------------------------


@in_place
def narrow(period_x, period_y, floes, near, first_part, last_part, gap, margin):
    """Rebuild the short list of some parts: pairs closer than a gap plus a margin.

    gap : of a bond about to break, over the sum of radii [1]; margin [m]
    """
    settle(near, first_part, last_part)
    for part in range(first_part, last_part):
        first, n = near.parts[part] + LANES * part, 0
        for p in range(near.parts[part], near.parts[part + 1]):
            i, j = near.list_i[np.uintp(p)], near.list_j[np.uintp(p)]
            one, other = floes[i], floes[j]
            dx, dy = wrap(period_x, other.x - one.x), wrap(period_y, other.y - one.y)
            reach = (one.r + other.r) * (1.0 + gap) + margin
            q = np.uintp(first + n)  # unsigned: no wrap-around of negative indices
            near.slot[q], near.i[q], near.j[q] = p, i, j
            n += not dx * dx + dy * dy >= reach * reach  # NaN stays in
        last = near.i[first + max(n - 1, 0)]
        for q in range(first + n, first + n + LANES):  # padding: pairs are taken four at a time
            near.i[q] = near.j[q] = last
        near.counts[part] = n
        for row in range(near.block.shape[0]):
            for q in range(first, first + n):
                near.block[row, q] = near.list_block[row, near.slot[q]]


@in_place
def settle(near, first_part, last_part):
    """Copy the memory of the short list back into the list."""
    for part in range(first_part, last_part):
        first = near.parts[part] + LANES * part
        for row in range(near.block.shape[0]):
            for q in range(first, first + near.counts[part]):
                near.list_block[row, near.slot[q]] = near.block[row, q]


# ---- forces -------------------------------------------------------------------------------------------


@dispatched
def touch_floes(
    law, period_x, period_y, floes, spinning, mu, sigma, pairs, near, part, dt, force, inverse, lost,
    buffer, blows,
):  # fmt: skip
    """Add the forces of a part of the short list, a block at a time.

    dt : time over which contacts have slipped [s]
    inverse : an `Inverse`; None: contacts that opened or closed note no blows
    lost : a row of `Tally.lost`
    Returns the number of blows.
    """
    begin = near.parts[part] + LANES * part
    end = begin + near.counts[part]
    pair_i, pair_j = pairs.i, pairs.j
    slip, bonded, damped = pairs.slip, pairs.bonded, pairs.damped
    bent, failed, slid = pairs.bent, pairs.failed, pairs.slid
    friction_loss, dashpot_loss, bond_loss, failure_loss, broken = 0.0, 0.0, 0.0, 0.0, 0.0
    noted = 0
    for first in range(begin, end, BLOCK):
        n = min(BLOCK, end - first)
        struck = 0.0
        for k in range(0, n, LANES):
            gather(floes, pair_i, pair_j, first, buffer, k)
        gather_least(mu, pair_i, pair_j, first, n, MU, buffer)
        gather_least(sigma, pair_i, pair_j, first, n, SIGMA, buffer)
        for k in range(n):
            dx, dy = wrap(period_x, buffer[DX + k]), wrap(period_y, buffer[DY + k])
            r_i, r_j = buffer[R_I + k], buffer[R_J + k]
            distance = np.sqrt(dx * dx + dy * dy)
            over = 1.0 / distance
            nx, ny = dx * over, dy * over
            gap = distance - (r_i + r_j)
            a_i = lever_arm(law.friction, r_i, r_j, gap)
            a_j = lever_arm(law.friction, r_j, r_i, gap)
            du, dv = buffer[DU + k], buffer[DV + k]
            opening = du * nx + dv * ny
            slip_rate = du * ny - dv * nx + turning(spinning, a_i, a_j, k, buffer)
            was_bonded = recall(bonded, first + k)
            f = pair_force(
                law, gap, opening, slip_rate, twisting(bent, k, buffer), r_i, r_j,
                buffer[H_I + k], buffer[H_J + k], buffer[W_I + k] + buffer[W_J + k],
                least(mu, coefficient(law.friction), MU + k, buffer),
                least(sigma, strength(law.bonds), SIGMA + k, buffer),
                recall(slip, first + k), was_bonded, recall(damped, first + k),
                recall(bent, first + k), recall(failed, first + k), recall(slid, first + k), dt,
            )  # fmt: skip
            remember(damped, first + k, f.damped)
            remember(slip, first + k, f.slip)
            remember(bonded, first + k, f.bonded)
            remember(bent, first + k, f.bent)
            remember(failed, first + k, f.failed)
            remember(slid, first + k, f.slid)
            friction_loss += f.friction_loss
            dashpot_loss += f.dashpot_loss
            bond_loss += f.bond_loss
            failure_loss += f.failure_loss
            broken += 1.0 if was_bonded > 0.0 and f.bonded <= 0.0 else 0.0
            struck += keep_force(slip, spinning, f, nx, ny, a_i, a_j, k, buffer)
        for k in range(n, n + (-n) % LANES):
            buffer[FX + k] = buffer[FY + k] = buffer[TORQUE_I + k] = buffer[TORQUE_J + k] = 0.0
        for k in range(0, n, LANES):
            scatter(force, pair_i, pair_j, first, buffer, k)
        if struck > 0.0:
            noted = note_blows(
                inverse, law, period_x, period_y, slip, spinning, pair_i, pair_j, first, n, blows,
                noted, buffer,
            )  # fmt: skip
    lost[FRICTION] += friction_loss
    lost[DASHPOTS] += dashpot_loss
    lost[BONDS] += bond_loss
    lost[FAILURE] += failure_loss
    lost[BROKEN] += broken
    return noted


@touch_floes.register
def _(
    law: None, period_x, period_y, floes, spinning, mu, sigma, pairs, near, part, dt, force, inverse, lost,
    buffer, blows,
):  # fmt: skip
    return 0


@dispatched
def keep_force(slip, spinning, f, nx, ny, a_i, a_j, k, buffer):
    """Write the force on i, the torques and the blow of a pair into their columns; returns the size of the blow."""
    buffer[FX + k] = -f.f_n * nx - f.f_t * ny
    buffer[FY + k] = -f.f_n * ny + f.f_t * nx
    buffer[TORQUE_I + k] = f.f_t * a_i + f.moment
    buffer[TORQUE_J + k] = f.f_t * a_j - f.moment
    buffer[BLOW_N + k], buffer[BLOW_T + k] = f.blow_n, f.blow_t
    return abs(f.blow_n) + abs(f.blow_t)


@keep_force.register
def _(slip: None, spinning, f, nx, ny, a_i, a_j, k, buffer):
    buffer[FX + k], buffer[FY + k], buffer[BLOW_N + k] = -f.f_n * nx, -f.f_n * ny, f.blow_n
    keep_no_torque(spinning, k, buffer)
    return abs(f.blow_n)


@dispatched
def keep_no_torque(spinning, k, buffer):
    """Set the torque of a contact that does not resist slip to 0, for floes that rotate."""
    buffer[TORQUE_I + k] = buffer[TORQUE_J + k] = 0.0


@keep_no_torque.register
def _(spinning: None, k, buffer):
    pass


@dispatched
def blow_along(slip, k, buffer):
    """The tangential blow; 0 where nothing resists slip."""
    return buffer[BLOW_T + k]


@blow_along.register
def _(slip: None, k, buffer):
    return 0.0


@dispatched
def turning(spinning, a_i, a_j, k, buffer):
    """Part of the slip rate due to rotation [m/s]."""
    return a_i * buffer[OMEGA_I + k] + a_j * buffer[OMEGA_J + k]


@turning.register
def _(spinning: None, a_i, a_j, k, buffer):
    return 0.0


@dispatched
def twisting(bent, k, buffer):
    """Rotation rate of j relative to i [rad/s]."""
    return buffer[OMEGA_J + k] - buffer[OMEGA_I + k]


@twisting.register
def _(bent: None, k, buffer):
    return 0.0


@dispatched
def least_of(own, of_all, i, j):
    """The property of a pair: the smaller of its floes' values (eq. spread), or the common one."""
    return min(own[i], own[j])


@least_of.register
def _(own: None, of_all, i, j):
    return of_all


@dispatched
def gather_least(own, pair_i, pair_j, first, n, row, buffer):
    for k in range(n):
        buffer[row + k] = least_of(own, 0.0, pair_i[first + k], pair_j[first + k])


@gather_least.register
def _(own: None, pair_i, pair_j, first, n, row, buffer):
    pass


@dispatched
def least(own, of_all, slot, buffer):
    """The gathered value of a pair, or the one that all floes have in common."""
    return buffer[slot]


@least.register
def _(own: None, of_all, slot, buffer):
    return of_all


@dispatched
def note_blows(
    inverse, law, period_x, period_y, slip, spinning, pair_i, pair_j, first, n, blows, noted, buffer
):  # fmt: skip
    """Note the blows of a block of pairs, most of which have none; returns the number noted so far."""
    last = noted
    for k in range(n):  # first select the pairs, without a branch that no processor could predict
        blows[last].i = k
        last += (buffer[BLOW_N + k] != 0.0) | (blow_along(slip, k, buffer) != 0.0)
    for q in range(noted, last):
        one = blows[q]
        k = one.i
        dx, dy = wrap(period_x, buffer[DX + k]), wrap(period_y, buffer[DY + k])
        du, dv = buffer[DU + k], buffer[DV + k]
        r_i, r_j = buffer[R_I + k], buffer[R_J + k]
        distance = np.sqrt(dx * dx + dy * dy)
        nx, ny, gap = dx / distance, dy / distance, distance - (r_i + r_j)
        a_i = lever_arm(law.friction, r_i, r_j, gap)
        a_j = lever_arm(law.friction, r_j, r_i, gap)
        one.i, one.j = pair_i[first + k], pair_j[first + k]
        one.nx, one.ny, one.a_i, one.a_j = nx, ny, a_i, a_j
        one.opening = du * nx + dv * ny
        one.slip_rate = du * ny - dv * nx + turning(spinning, a_i, a_j, k, buffer)
        one.normal, one.tangential = buffer[BLOW_N + k], blow_along(slip, k, buffer)
    return last


@note_blows.register
def _(
    inverse: None, law, period_x, period_y, slip, spinning, pair_i, pair_j, first, n, blows, noted,
    buffer,
):  # fmt: skip
    return noted


@dispatched
def strike_floes(law, slip, inverse, floes, spinning, blows, noted, dt, force, constraint, lost):
    """Apply the noted blows one after the other, with opposite sign on the two floes.

    By now the forces of the other contacts are known too, except those with floes of still later tiles.
    """
    half, not_taken = 0.5 * dt, 0.0
    for q in range(noted):
        one = blows[q]
        i, j, nx, ny = one.i, one.j, one.nx, one.ny
        x_i, y_i = inverse_masses(inverse, floes, i)
        x_j, y_j = inverse_masses(inverse, floes, j)
        du = floes[j].u - floes[i].u
        du += half * (x_j * force[j].x - x_i * force[i].x)
        dv = floes[j].v - floes[i].v
        dv += half * (y_j * force[j].y - y_i * force[i].y)
        w_x, w_y = x_i + x_j, y_i + y_j
        w_n, w_t = w_x * nx * nx + w_y * ny * ny, w_x * ny * ny + w_y * nx * nx
        blow_n, rest_n = blow(law.dashpot, one.normal, one.opening, du * nx + dv * ny, w_n)
        blow_t, rest_t = take_slip(
            slip, law, one, du * ny - dv * nx, w_t, inverse.spin, spinning, force, half
        )
        not_taken += rest_n + rest_t
        x, y = -blow_n * nx - blow_t * ny, -blow_n * ny + blow_t * nx
        strike(inverse, floes, i, x, y, constraint)
        strike(inverse, floes, j, -x, -y, constraint)
        strike_spin(inverse.spin, spinning, i, blow_t * one.a_i, constraint)
        strike_spin(inverse.spin, spinning, j, blow_t * one.a_j, constraint)
    # slip resisted by a beam belongs to the bond; where no law takes energy, this stays in the residual
    if law.friction is not None:
        lost[FRICTION] -= not_taken
    elif law.bonds is not None:
        lost[BONDS] -= not_taken


@strike_floes.register
def _(law: None, slip, inverse, floes, spinning, blows, noted, dt, force, constraint, lost):
    pass


@dispatched
def take_slip(slip, law, one, slip_rate, w_t, inverse_spin, spinning, force, half):
    """The tangential blow, see `contact.blow`; 0 where nothing resists slip.

    slip_rate : without rotation, after half a step [m/s]; w_t : tangential inverse mass of the pair, without rotation [1/kg]
    """
    for k, arm in ((one.i, one.a_i), (one.j, one.a_j)):
        turn_rate, w = turning_ahead(inverse_spin, spinning, force, k, arm, half)
        slip_rate += turn_rate
        w_t += w
    return blow(law.dashpot, one.tangential, one.slip_rate, slip_rate, w_t)


@take_slip.register
def _(slip: None, law, one, slip_rate, w_t, inverse_spin, spinning, force, half):
    return 0.0, 0.0


@dispatched
def turning_ahead(inverse_spin, spinning, force, k, arm, half):
    """Slip rate due to a floe's rotation after half a step [m/s], and its rotational inverse mass a²/J [1/kg]."""
    w = arm * inverse_spin[k]
    return arm * spinning[k].omega + half * w * force[k].torque, arm * w


@turning_ahead.register
def _(inverse_spin: None, spinning, force, k, arm, half):
    return 0.0, 0.0


@inner
def inverse_masses(inverse, floes, k):
    """1/m of a floe along x and y; where no axis is held, from the floe's own cache line."""
    if inverse.held:
        return inverse.x[k], inverse.y[k]
    return floes[k].w, floes[k].w


@inner
def strike(inverse, floes, k, x, y, constraint):
    """Apply an impulse to a floe; along a held axis the constraint takes it up."""
    w_x, w_y = inverse_masses(inverse, floes, k)
    floes[k].u += w_x * x
    floes[k].v += w_y * y
    if w_x == 0.0:
        constraint[0] -= x
        constraint[2] -= x * floes[k].u
    if w_y == 0.0:
        constraint[1] -= y
        constraint[2] -= y * floes[k].v


@dispatched
def strike_spin(inverse_spin, spinning, k, angular_impulse, constraint):
    spinning[k].omega += inverse_spin[k] * angular_impulse
    if inverse_spin[k] == 0.0:
        constraint[2] -= angular_impulse * spinning[k].omega


@strike_spin.register
def _(inverse_spin: None, spinning, k, angular_impulse, constraint):
    pass
