"""Floes that overlap are pressed apart.

*Press*: floes that overlap are pushed apart, pair by pair, in sweeps.  *Swap*: every few sweeps a squeezed floe changes
radius with a slightly smaller one that is less squeezed.  The set of sizes stays as drawn, and discs of a size ratio of
2 reach 0.88, where pressing alone jams at 0.84.  Floes of a single size are shaken instead, and order into grains.
"""

import numpy as np

from floebmi.boundaries import EDGES, Domain
from floebmi.kernels import jit
from floebmi.neighbours import find_pairs
from floebmi.pairs import wrap

SPARE = 0.002  # floes are pressed apart as if this much larger, so that in the end none overlap
OVERSHOOT = 1.5  # push beyond the point of touching: fewer sweeps, as in successive over-relaxation
CALM = 0.5  # the same in the last fifth of the sweeps, so that jammed floes share their overlaps
SKIN = (0.6, 2.0)  # of the pair list, in median radii; the wider, the more the floes overlap
NARROW = 1.05  # floes whose radii differ by less than this factor are shaken, not swapped
SHAKE = 0.7  # in mean overlaps
SWEEPS = 2000, 6000  # after which a packing is given up: floes of several sizes, of one size


def press(
    x: np.ndarray,
    y: np.ndarray,
    radius: np.ndarray,
    free: np.ndarray,
    discs: np.ndarray,
    domain: Domain,
    walls: tuple[str, ...],
    sweeps: int | None = None,
    rng: np.random.Generator | None = None,
    idle: bool = True,
) -> float:
    """Push floes apart, in place; the largest overlap left, over the smaller radius.

    Floes stay inside edges that are one of the words in `walls`, and clear of the fixed `discs`.
    With `rng`, radii are swapped among the floes, or floes of a single size shaken.  `idle` : whether
    floes that touch nothing take part; in fields of ice they must not, or swaps would carry ice from
    dense parts to thin ones.
    """
    n = len(x)
    all_x, all_y, size = (
        np.concatenate(pair) for pair in zip((x, y, radius), discs.T, strict=True)
    )
    pressed = size.copy()
    pressed[:n] *= 1 + SPARE
    mobile = np.zeros(len(all_x))
    movable = np.concatenate([free, np.zeros(len(discs), bool)])
    box = np.array([
        domain.position(edge) if getattr(domain, edge) in walls else far
        for edge, far in zip(EDGES, (-np.inf, np.inf, -np.inf, np.inf), strict=True)
    ])  # fmt: skip
    lengths = np.array([np.inf if length is None else length for length in domain.period])
    # what is fixed needs no skin; five times its radius, a guard of the shore still does not reach
    # the next
    still = np.maximum(discs[:, 2], 5 * discs[:, 2].min(initial=np.inf))
    typical = float(np.median(pressed[:n]))
    # a pair must not be able to meet across two sides of a period, see find_pairs
    widest = 2 * max(float(lengths.min()) / 4 * (1 - 1e-9) - float(pressed.max()), 0.0)
    skin, worst = 0.0, 1.0
    narrow = size[:n].max() < NARROW * size[:n].min()
    every = 5 if narrow else 3
    sweeps = SWEEPS[int(narrow)] if sweeps is None else sweeps
    order = np.argsort(size[:n], kind="stable")
    squeezed = np.empty(len(all_x))
    done, moved, grown = 0, np.inf, 0.0
    while done < sweeps:
        if moved + grown >= skin / 2:
            skin = min(typical * min(max(2 * worst, SKIN[0]), SKIN[1]), widest)
            all_x[:n], all_y[:n] = domain.brought_back(all_x[:n], all_y[:n])
            reach = np.concatenate([pressed[:n] + skin / 2, still])
            i, j = pairs_to_press(all_x, all_y, reach, movable, domain)
            # a small floe gives way to a large one, but not so much that it is caught between two
            mobile[:n] = free / size[:n]
            start_x, start_y, moved, grown = all_x.copy(), all_y.copy(), 0.0, 0.0
        steps, worst, moved = _push(
            all_x, all_y, pressed, mobile, i, j, lengths, box, n, start_x, start_y,
            skin / 2 - grown, every - done % every, OVERSHOOT if done < 0.8 * sweeps else CALM,
        )  # fmt: skip
        done += steps
        complete = moved + grown < skin / 2  # no pair has come near that is not in the list
        if worst < SPARE and complete and _worst(all_x, all_y, size, n, i, j, lengths) <= 0.0:
            break
        if rng is not None and done % every == 0:
            _squeeze(all_x, all_y, pressed, i, j, lengths, squeezed)
            if narrow:
                shake = SHAKE * float(squeezed[:n].mean())
                all_x[:n] += rng.normal(0.0, shake, n)
                all_y[:n] += rng.normal(0.0, shake, n)
            else:
                apart = int(np.exp(rng.uniform(0.0, np.log(max(n // 8, 1)))))
                first = int(rng.integers(0, 2 * apart))
                grown += _swap(size, pressed, squeezed, order, apart, first, idle)
    all_x[:n], all_y[:n] = domain.brought_back(all_x[:n], all_y[:n])
    x[:], y[:], radius[:] = all_x[:n], all_y[:n], size[:n]
    i, j = pairs_to_press(all_x, all_y, size, movable, domain)
    return _worst(all_x, all_y, size, n, i, j, lengths)


def pairs_to_press(
    x: np.ndarray, y: np.ndarray, reach: np.ndarray, movable: np.ndarray, domain: Domain
) -> tuple[np.ndarray, np.ndarray]:
    """Pairs within their reaches of each other, of which at least one can move."""
    _, i, j, _ = find_pairs(x, y, reach, domain.period)
    keep = movable[i] | movable[j]
    return i[keep], j[keep]


def distances(
    x: np.ndarray, y: np.ndarray, i: np.ndarray, j: np.ndarray, domain: Domain
) -> np.ndarray:
    """Distances between the centres of pairs [m]."""
    length_x, length_y = domain.period
    return np.hypot(wrap(length_x, x[j] - x[i]), wrap(length_y, y[j] - y[i]))


@jit
def _push(x, y, r, mobile, i, j, lengths, box, n, start_x, start_y, slack, sweeps, overshoot):
    """Sweep over the pairs until overlaps are below `SPARE` or a floe has moved by `slack`.

    Returns sweeps done, largest overlap met in the last one over the smaller radius, largest
    distance moved.
    """
    west, east, south, north = box
    length_x, length_y = lengths
    worst = far = 0.0
    for sweep in range(sweeps):
        worst = 0.0
        for q in range(i.size):
            p = i.size - 1 - q if sweep % 2 else q
            a, b = i[p], j[p]
            dx, dy = x[b] - x[a], y[b] - y[a]
            if length_x < np.inf:
                dx -= length_x * np.rint(dx / length_x)
            if length_y < np.inf:
                dy -= length_y * np.rint(dy / length_y)
            touch = r[a] + r[b]
            square = dx * dx + dy * dy
            if square < touch * touch:
                distance = np.sqrt(square)
                overlap = touch - distance
                worst = max(worst, overlap / _smaller(r, n, a, b))
                if distance == 0.0:
                    dx, distance = 1.0, 1.0
                share = overshoot * overlap / (distance * (mobile[a] + mobile[b]))
                x[a] -= share * mobile[a] * dx
                y[a] -= share * mobile[a] * dy
                x[b] += share * mobile[b] * dx
                y[b] += share * mobile[b] * dy
        far = 0.0
        for k in range(n):
            if mobile[k] > 0.0:
                x[k] = max(min(x[k], east - r[k]), west + r[k])
                y[k] = max(min(y[k], north - r[k]), south + r[k])
                far = max(far, (x[k] - start_x[k]) ** 2 + (y[k] - start_y[k]) ** 2)
        if worst < SPARE or far > slack * slack:
            return sweep + 1, worst, np.sqrt(far)
    return sweeps, worst, np.sqrt(far)


@jit
def _smaller(r, n, a, b):
    """The smaller radius of a pair; that of the floe, if the other is a fixed disc."""
    if a >= n:
        return r[b]
    return r[a] if b >= n else min(r[a], r[b])


@jit
def _overlap(x, y, r, a, b, lengths):
    dx, dy = x[b] - x[a], y[b] - y[a]
    if lengths[0] < np.inf:
        dx -= lengths[0] * np.rint(dx / lengths[0])
    if lengths[1] < np.inf:
        dy -= lengths[1] * np.rint(dy / lengths[1])
    return r[a] + r[b] - np.sqrt(dx * dx + dy * dy)


@jit
def _worst(x, y, r, n, i, j, lengths):
    """Largest overlap over the smaller radius; 0 if nothing overlaps."""
    worst = 0.0
    for p in range(i.size):
        overlap = _overlap(x, y, r, i[p], j[p], lengths)
        worst = max(worst, overlap / _smaller(r, n, i[p], j[p]))
    return worst


@jit
def _squeeze(x, y, r, i, j, lengths, total):
    """Sum of the overlaps of each floe [m]."""
    total[:] = 0.0
    for p in range(i.size):
        overlap = _overlap(x, y, r, i[p], j[p], lengths)
        if overlap > 0.0:
            total[i[p]] += overlap
            total[j[p]] += overlap


@jit
def _swap(size, pressed, squeezed, order, apart, first, idle):
    """Swap radii where the larger of two floes is squeezed the more; the largest growth [m].

    `order` sorts the floes by radius, and is kept so; partners are `apart` in it, in blocks from
    `first` on.  To first order, giving the smaller radius to the floe with the larger sum of
    overlaps lowers Σ overlap² / 2. `idle`: whether floes that touch nothing take part.
    """
    growth = 0.0
    for start in range(first, order.size - 2 * apart + 1, 2 * apart):
        for low in range(start, start + apart):
            high = low + apart
            small, large = order[low], order[high]
            difference = pressed[large] - pressed[small]
            if squeezed[large] - squeezed[small] > difference and (idle or squeezed[small] > 0.0):
                size[small], size[large] = size[large], size[small]
                pressed[small], pressed[large] = pressed[large], pressed[small]
                order[low], order[high] = large, small
                growth = max(growth, difference)
    return growth
