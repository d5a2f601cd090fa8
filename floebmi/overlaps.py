"""Floes that overlap, or reach over a wall, for which the start of a run or an edit of the floes is refused; floes outside."""

from typing import NamedTuple

import numpy as np

from floebmi.boundaries import Domain, check_domain, edge_of, over_walls
from floebmi.errors import InputError
from floebmi.floes import FIXED_X, FIXED_Y, Floes, check_floes
from floebmi.neighbours import find_pairs
from floebmi.pressing import distances
from floebmi.quantities import is_number

ALLOWED = 0.1  # of the smaller radius, at the start


class Overlap(NamedTuple):
    """Floes i < j overlap by `overlap` [m], a `share` of the smaller radius."""

    i: int
    j: int
    overlap: float
    share: float


def overlapping(floes: Floes, domain: Domain, allowed: float = 0.0) -> list[Overlap]:
    """Pairs that overlap by more than `allowed` of the smaller radius, the worst first.

    Pieces of coast may overlap each other by any amount.

    Parameters
    ----------
    floes : floes to check; only active ones count
    domain : their domain, for its periods
    allowed : largest permitted overlap over the smaller radius [1]; with 0 every overlap is reported

    Returns
    -------
    list of `Overlap`: floe numbers i < j, overlap [m], and its ratio to the smaller radius [1]

    Raises
    ------
    InputError
        for anything that is not Floes or a Domain, invalid floes, an `allowed` that is not a number, and a period
        so short that two floes could touch on both sides, or a floe could touch itself.
    """
    check_domain(domain)
    check_floes(floes)
    if not is_number(allowed):
        raise InputError(f"allowed = {allowed!r}: must be a finite number [1]")
    number = np.flatnonzero(floes.active)
    x, y, r = floes.x[number], floes.y[number], floes.radius[number]
    _, i, j, _ = find_pairs(x, y, r, domain.period)
    overlap = r[i] + r[j] - distances(x, y, i, j, domain)
    share = overlap / np.minimum(r[i], r[j])
    land = floes.land[number]
    found = np.flatnonzero((share > allowed) & ~(land[i] & land[j]))
    found = found[np.argsort(-share[found])]
    return [
        Overlap(*sorted((int(number[i[p]]), int(number[j[p]]))), float(overlap[p]), float(share[p]))
        for p in found
    ]


def refuse_overlaps(
    floes: Floes,
    domain: Domain,
    when: str,
    before: Floes | None = None,
    allowed: float = ALLOWED,
    moved: bool = False,
) -> None:
    """InputError for floes that overlap by more than `allowed` of the smaller radius.

    when : words for the error; before : floes that were let pass: what counts is how much more they overlap than those did
    moved : only pairs count that forces can move, as in a run: driven floes may pass through each other
    """
    worst = overlapping(floes, domain, allowed) if len(floes) else []
    if moved:
        free = (floes.motion & (FIXED_X | FIXED_Y)) != (FIXED_X | FIXED_Y)
        worst = [pair for pair in worst if free[pair.i] or free[pair.j]]
    if worst and before is not None:
        had = {pair[:2]: pair.share for pair in overlapping(before, domain)}
        worst = [pair for pair in worst if pair.share - had.get(pair[:2], 0.0) > allowed]
    if worst:
        shown = "; ".join(
            f"floes {pair.i} and {pair.j} by {pair.overlap:.4g} m" for pair in worst[:3]
        )
        more = f" and {len(worst) - 3} more pairs" if len(worst) > 3 else ""
        raise InputError(
            f"floes overlap {when} by more than {allowed:g} of the smaller radius: "
            f"{shown}{more}; move them apart, or call floebmi.relax(floes, domain)"
        )


def refuse_over_walls(
    walls: np.ndarray,
    floes: Floes,
    domain: Domain,
    when: str,
    before: Floes | None = None,
    allowed: float = ALLOWED,
) -> None:
    """The same for floes that reach over walls by more than `allowed` of their radius: those would shoot them off."""
    share = over_walls(walls, floes, domain.origin)
    more = share.copy()
    if before is not None:
        more[: len(before)] -= over_walls(walls, before, domain.origin).clip(0.0)
    if (more > allowed).any():
        floe, number = np.unravel_index(np.argmax(more), more.shape)
        wall = walls[number]
        raise InputError(
            f"{np.count_nonzero((more > allowed).any(axis=1))} floes reach over walls {when} by more than "
            f"{allowed:g} of their radius, floe {floe} by {share[floe, number] * floes.radius[floe]:.4g} m over the wall "
            f"in the {edge_of(wall)}, at {wall['position'] + domain.origin[int(wall['axis'])]:g} m; move them, or the wall"
        )


def told_outside(floes: Floes, domain: Domain) -> str:
    """What to say of free floes beyond edges that are not periodic, where they leave at once; empty where there are none."""
    out = np.zeros(len(floes), bool)
    for values, (low, high), period in zip(
        (floes.x, floes.y), (domain.x, domain.y), domain.period, strict=True
    ):
        if period is None:
            out |= (values < low) | (values > high)
    out &= floes.active & (floes.motion == 0)
    if not out.any():
        return ""
    k = int(out.argmax())
    return (
        f"{out.sum()} of {len(floes)} floes lie outside the domain, x {domain.x[0]:g} … {domain.x[1]:g},"
        f" y {domain.y[0]:g} … {domain.y[1]:g} m, the first at x = {floes.x[k]:g}, y = {floes.y[k]:g} m"
    )
