"""Neighbour lists: the pairs of floes, and of floes and walls, that may touch until floes have moved too far.

list_neighbours    lists them at the positions of packed floes, and carries over the memory of an older list
"""

import math
from typing import NamedTuple

import numpy as np

from floebmi.bonds import stretch
from floebmi.contact import Contact, memories, strength
from floebmi.dynamics import Lists
from floebmi.neighbours import carry, find_pairs
from floebmi.pack import Packed
from floebmi.pairs import PairList, near_of, remembering, room_for_blows
from floebmi.tiles import Tiles, by_tile

# Three widths, each a gap up to which pairs are listed, from the widest to the narrowest:
#   skin     of the list of pairs, which holds until floes have moved by half of it
#   closing  of the pairs that count in the stable step, which holds until floes have moved by half of it
#   near     of the short list, at least (see `dynamics.wide_enough`)
CLOSING = 0.3  # of the smallest radius, or up to three times that where sizes differ
NARROWEST, WIDEST = 3.0, 6.0  # skin over closing
FEW = 3000  # floes: listing so many costs as much as the part of making a list that does not depend on their number
NEAR = 0.05  # near over closing


class Memory(NamedTuple):
    """The memory of pairs, in the slots of a list or of a restart file.

    pairs : never changed in place; number : floe number of each row
    """

    pairs: PairList
    number: np.ndarray

    def by_number(self, floes: int) -> "Memory":
        """The pairs with non-zero memory, sorted by floe numbers alone; floes : total number of floes."""
        pairs, number = self
        keep = np.zeros(len(pairs.i), bool)
        for values in pairs.memory().values():
            keep |= values != 0.0
        a, b = number[pairs.i[keep]], number[pairs.j[keep]]
        low, high = np.minimum(a, b), np.maximum(a, b)
        order = np.lexsort((high, low))
        start = np.searchsorted(low[order], np.arange(floes + 1))
        memory = {
            name: np.where(a > b, _sign_of_reverse(name), 1.0)[order] * values[keep][order]
            for name, values in pairs.memory().items()
        }
        i, j = low[order].astype(np.uint32), high[order].astype(np.uint32)
        return Memory(PairList(start, i, j, **memory), np.arange(floes))


class Listed(NamedTuple):
    """Where and how widely neighbours were listed.

    x, y : positions of the floes in the order of the list, from the domain's origin (m,) [m]; walls : those of the walls [m]
    skin, closing : widths of the list, see the top of this file [m]
    wall_floe, wall_number : the pairs of floe and wall, see `dynamics.Walls`
    """

    x: np.ndarray
    y: np.ndarray
    walls: np.ndarray
    skin: float
    closing: float
    wall_floe: np.ndarray
    wall_number: np.ndarray


def list_neighbours(
    packed: Packed,
    contact: Contact | None,
    period: tuple[float | None, float | None],
    walls: np.ndarray,
    positions: np.ndarray,
    old: Memory,
    floes: int,
) -> tuple[Listed, PairList, Lists, int]:
    """The neighbours among floes at their packed positions, and walls at the given positions [m].

    walls : records of `dynamics.WALL`; old : memory of the pairs so far; floes : number of floes, packed or not

    Returns
    -------
    Listed, the pairs, room for the short lists with the tiles, and the number of pairs tested
    """
    skin, closing = _widths(packed, contact, period)
    pairs, tiles, tested = _list_pairs(packed, contact, period, skin, old, floes)
    lists = Lists(
        *near_of(pairs, tiles.parts), tiles, room_for_blows(tiles.parts),
        widest_gap(packed, contact), NEAR * closing,
    )  # fmt: skip
    meetings = _near_walls(packed, contact, skin, walls, positions)
    listed = Listed(packed.first_x, packed.first_y, positions, skin, closing, *meetings)
    return listed, pairs, lists, tested


def _widths(
    packed: Packed, contact: Contact | None, period: tuple[float | None, float | None]
) -> tuple[float, float]:
    """Skin and closing [m]."""
    radius = packed.floes["r"][~packed.land]
    smallest, largest = radius.min(initial=np.inf), radius.max(initial=0.0)
    octaves = np.log2(largest / smallest) if largest else 0.0
    closing = CLOSING * smallest * min(1.0 + 0.5 * octaves, 3.0) if largest else 0.0
    # the list is widest where sizes differ much, since then few pairs are close, and where floes are few: with a skin of
    # w closings, the cost of steps is proportional to w n, that of lists to (n + FEW)/w; the sum is least at w² = 1 + FEW/n
    few = math.sqrt(1.0 + FEW / max(len(radius), 1))
    width = min(max(NARROWEST, octaves) * few, WIDEST)
    # but no floe may meet another on both sides of a period
    widest = _reach(packed, contact, 0.0).max(initial=0.0)
    room = [0.49 * length - 2.0 * widest for length in period if length]
    return max(closing, min([closing * width, *room])), closing


def _reach(packed: Packed, contact: Contact | None, skin: float) -> np.ndarray:
    """Interaction range of each floe [m]: its radius, plus the gap that a bond spans, plus half the skin."""
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


def _list_pairs(
    packed: Packed,
    contact: Contact | None,
    period: tuple[float | None, float | None],
    skin: float,
    old: Memory,
    floes: int,
) -> tuple[PairList, Tiles, int]:
    """A new list of candidate pairs with the memory of the old one, the tiles of the pack, and the number of pairs tested."""
    if contact is None or len(packed.number) < 2:
        empty = np.zeros(0, np.uint32)
        start = np.zeros(len(packed.number) + 1, np.int64)
        start, i, j, tiles = by_tile(start, empty, empty, packed.land)
        return PairList(start, i, j, **_nothing(contact, 0)), tiles, 0
    x, y = packed.first_x, packed.first_y
    found = find_pairs(x, y, _reach(packed, contact, skin), period, packed.land)
    i, j = found.i.view(np.uint32), found.j.view(np.uint32)
    start, i, j, tiles = by_tile(found.start, i, j, packed.land)
    new = PairList(start, i, j, **_nothing(contact, len(i)))
    row = np.full(floes, -1)  # of each floe in the new list, −1 where it has none
    row[packed.number] = np.arange(len(packed.number))
    for name, memory in old.pairs.memory().items():
        carry(
            old.pairs.i, old.pairs.j, old.number, memory, row, start, tiles.seam, j,
            getattr(new, name), _sign_of_reverse(name),
        )  # fmt: skip
    return new, tiles, found.tested


def _sign_of_reverse(name: str) -> float:
    """Factor on a memory when i and j are swapped: the relative rotation changes sign, all else stays."""
    return -1.0 if name == "bent" else 1.0


def _nothing(contact: Contact | None, n: int) -> dict[str, np.ndarray]:
    """The memory of n new pairs, all 0."""
    names = memories(contact)
    if contact is not None and contact.dashpot is not None:
        names += ("damped",)
    memory, block = remembering(names, n)
    return {**memory, "block": block}


def _near_walls(
    packed: Packed, contact: Contact | None, skin: float, walls: np.ndarray, positions: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of packed floe and wall number that may touch; coast, which may overlap a wall, is left out."""
    floes, numbers = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    if contact is not None:
        near = packed.floes["r"] + skin
        for w, (axis, side) in enumerate(zip(walls["axis"], walls["side"], strict=True)):
            across = packed.first_y if axis else packed.first_x
            close = np.flatnonzero((side * (across - positions[w]) < near) & ~packed.land)
            floes.append(close)
            numbers.append(np.full(len(close), w))
    return np.concatenate(floes), np.concatenate(numbers)
