"""Tiles of a pack that fit the cache, and chunks of tiles of a large pack for threads.

Floes close in space are close in memory, so a tile is a range of floes.  A pair is touched with the later of its
two floes: once that one's tile has moved, both have.  So a step passes through memory once.
Pairs across the seams between chunks come last, one after the other.  The tiles depend only on the number of
floes, not on the number of threads; so the bits of a run do not depend on the number of threads either.
Pieces of coast come last in their tile: forces act on them but they never move, so steps need not visit them.
"""

from typing import NamedTuple

import numpy as np

from floebmi.kernels import BLOCK, jit

TILE = 4096  # floes
# A large pack is cut into chunks: the fewest floes in each, and the largest number of chunks.
CHUNK, CHUNKS = 25_000, 8


class Tiles(NamedTuple):
    """Where tiles begin and end.

    bounds : tile t has the floes bounds[t] to bounds[t + 1] − 1
    coast : first floe of each tile that is a piece of coast
    parts : tile t has the pairs parts[t] to parts[t + 1] − 1; the last part is that of the seams
    chunks : chunk c has the tiles chunks[c] to chunks[c + 1] − 1
    seam : rows, like `PairList.start`, of the pairs across seams
    """

    bounds: np.ndarray
    coast: np.ndarray
    parts: np.ndarray
    chunks: np.ndarray
    seam: np.ndarray


def cut(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Bounds of the tiles of n packed floes, multiples of BLOCK and n, and of the chunks among the tiles."""
    chunks = 1
    while 2 * chunks <= min(CHUNKS, n // CHUNK):  # equal in size, for two, four or eight threads
        chunks *= 2
    tiles = max(1, round(n / chunks / TILE))
    bounds = np.arange(chunks * tiles + 1) * (n // chunks // tiles) // BLOCK * BLOCK
    bounds[-1] = n
    return bounds, np.arange(chunks + 1) * tiles


def coast_last(land: np.ndarray) -> np.ndarray:
    """The permutation that puts pieces of coast last in their tile; the others keep their order."""
    bounds, _ = cut(len(land))
    return np.lexsort((land, np.repeat(np.arange(len(bounds) - 1), np.diff(bounds))))


def by_tile(
    start: np.ndarray, i: np.ndarray, j: np.ndarray, land: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, Tiles]:
    """The same pairs in rows of their later floes, with pairs across seams last: rows, i, j, tiles.

    land : bool, which packed floes are pieces of coast, in the order of `coast_last`
    """
    bounds, chunks = cut(len(land))
    pieces = [np.count_nonzero(land[a:b]) for a, b in zip(bounds[:-1], bounds[1:], strict=True)]
    coast = bounds[1:] - pieces
    if len(bounds) == 2:  # one tile holds all pairs, in any order
        end = len(i)
        seam = np.full(len(start), end)
        return start, i, j, Tiles(bounds, coast, np.array([0, end, end]), chunks, seam)
    inner, seam = np.zeros((2, len(start)), np.int64)
    parts = np.empty(len(bounds) + 1, np.int64)
    new_i, new_j = np.empty_like(i), np.empty_like(j)
    _split(bounds[chunks], i, j, inner, seam, new_i, new_j)
    parts[:-1] = inner[bounds]
    parts[-1] = len(i)
    return inner, new_i, new_j, Tiles(bounds, coast, parts, chunks, seam)


@jit
def _split(chunk_bounds, i, j, inner, seam, new_i, new_j):
    n = inner.size - 1
    chunk = np.empty(n, np.int32)
    for c in range(chunk_bounds.size - 1):
        chunk[chunk_bounds[c] : chunk_bounds[c + 1]] = c
    for p in range(i.size):
        rows = inner if chunk[i[p]] == chunk[j[p]] else seam
        rows[max(i[p], j[p])] += 1
    m = 0
    for rows in (inner, seam):  # counts become offsets
        for k in range(n):
            m, rows[k] = m + rows[k], m
        rows[n] = m
    for p in range(i.size):
        rows = inner if chunk[i[p]] == chunk[j[p]] else seam
        late, early = max(i[p], j[p]), min(i[p], j[p])
        new_i[rows[late]], new_j[rows[late]] = late, early
        rows[late] += 1
    for rows in (inner, seam):  # filling moved each row's offset to that of the next row
        for k in range(n - 1, 0, -1):
            rows[k] = rows[k - 1]
    inner[0], seam[0] = 0, inner[n]
