"""Overlapping floes, for which the start of a run is refused."""

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
