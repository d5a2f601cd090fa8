"""The stable step: a bound on the highest frequency of a pack, and the time step that resolves it."""

from typing import NamedTuple

import numpy as np

from floebmi.bonds import beam_of, bending_ratio
from floebmi.contact import Contact, damping, largest_ratio, lever_arm, stiffness
from floebmi.dynamics import Step, Walls
from floebmi.floes import Floes
from floebmi.kernels import as_records, in_place, inner
from floebmi.listing import widest_gap
from floebmi.pack import Packed
from floebmi.pairs import PairList, any_period, wrap

# Stiffness matrix of a floe over its mass [1/s²] in x, y and s = r θ/√2; and the sum of its damping rates [1/s].
STIFFNESS = np.dtype([(name, np.float64) for name in ("xx", "yy", "xy", "xs", "ys", "ss", "rate")])


class Stiffest(NamedTuple):
    """The limit on the step: bound on ω_max² [1/s²], its floe (packed index), damping rate [1/s]."""

    omega2: float
    floe: int
    damping: float


def stable_step(stiffest: Stiffest, step: Step) -> float:
    """Δt = fraction × 2 (√(1 + ζ²) − ζ)/ω_max [s] (eq. stable-step); inf where nothing is stiff."""
    if not stiffest.omega2 > 0:
        return np.inf
    omega = np.sqrt(stiffest.omega2)
    zeta = 0.5 * stiffest.damping / omega
    return step.fraction * 2.0 * (np.sqrt(1.0 + zeta * zeta) - zeta) / omega


def paper_step(floes: Floes, contact: Contact, density: float, epsilon: float) -> float:
    """Eq. 4: Δt = ε √(m_min/k_max) [s], k = E h; inf where no floe but coast is active."""
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

    All pairs that may close count as contacts, so the bound holds until floes have moved half of `closing` [m];
    and no floe counts for less than one in a hexagonal pack without friction, so that a single collision is
    also resolved.
    """
    if contact is None or not len(packed.number):
        return Stiffest(0.0, -1, 0.0)
    return Stiffest(
        *_stiffest(
            contact,
            *any_period(period),
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
    # Each floe is then a separate 3 × 3 problem in (x, y, r θ/√2), divided by its mass.
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
    # the sums of one wall, whose floes are listed consecutively
    of_wall, rate_of_wall = 0.0, 0.0
    for q in range(walls.floe.size):
        k = walls.floe[q]
        wall = walls.records[walls.number[q]]
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
    """Largest eigenvalue of the symmetric matrix (xx, yy, ss; xy, xs, ys), by the trigonometric formula; or `floor`, where a bound shows that it is no larger."""
    xx, yy, xy, xs, ys, ss = row.xx, row.yy, row.xy, row.xs, row.ys, row.ss
    mean = (xx + yy + ss) / 3.0
    a, b, c = xx - mean, yy - mean, ss - mean
    p2 = (a * a + b * b + c * c + 2.0 * (xy * xy + xs * xs + ys * ys)) / 6.0
    p = np.sqrt(p2)
    if mean + 2.0 * p <= floor:  # this bound suffices for most floes
        return floor
    if p2 <= 0.0:
        return mean
    determinant = a * (b * c - ys * ys) - xy * (xy * c - ys * xs) + xs * (xy * ys - b * xs)
    r = min(max(determinant / (2.0 * p2 * p), -1.0), 1.0)
    return mean + 2.0 * p * np.cos(np.arccos(r) / 3.0)
