"""Floes that lie over each other: what a start is refused for."""

from typing import NamedTuple

import numpy as np

from floebmi.boundaries import Domain, check_domain
from floebmi.errors import InputError
from floebmi.floes import Floes, check_floes
from floebmi.neighbours import find_pairs
from floebmi.pairs import wrap
from floebmi.quantities import is_number


class Overlap(NamedTuple):
    """Floes i < j overlap by `overlap` [m], a `share` of the smaller radius."""

    i: int
    j: int
    overlap: float
    share: float


def overlapping(floes: Floes, domain: Domain, allowed: float = 0.0) -> list[Overlap]:
    """Pairs that overlap by more than `allowed` of the smaller radius, the worst first.

    Two pieces of coast may lie over each other as they like.

    Parameters
    ----------
    floes : the active ones are looked at
    domain : its periods
    allowed : share of the smaller radius [1]; 0 tells every overlap

    Returns
    -------
    list of `Overlap`: floe numbers i < j, overlap [m], share of the smaller radius [1]

    Raises
    ------
    InputError
        for what are no floes or no domain, values that no floe may have, an `allowed` that is no number, and a period
        so short that two floes could meet on both sides, or a lone floe itself.
    """
    check_domain(domain)
    check_floes(floes)
    if not is_number(allowed):
        raise InputError(f"allowed = {allowed!r}: must be a finite number [1]")
    number = np.flatnonzero(floes.active)
    x, y, r = floes.x[number], floes.y[number], floes.radius[number]
    pairs = find_pairs(x, y, r, domain.period)
    i, j = pairs.i, pairs.j
    apart = (
        wrap(period, place[j] - place[i])
        for place, period in zip((x, y), domain.period, strict=True)
    )
    overlap = r[i] + r[j] - np.hypot(*apart)
    share = overlap / np.minimum(r[i], r[j])
    land = floes.land[number]
    found = np.flatnonzero((share > allowed) & ~(land[i] & land[j]))
    found = found[np.argsort(-share[found])]
    return [
        Overlap(*sorted((int(number[i[p]]), int(number[j[p]]))), float(overlap[p]), float(share[p]))
        for p in found
    ]
