"""Large packs on several threads, with the same bits for any number of them: each takes its chunks of tiles."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext

import numpy as np

from floebmi.columns import PAIR_BUFFER
from floebmi.dynamics import (
    NEARLY,
    Books,
    Laws,
    Lists,
    Marked,
    Walls,
    end_steps,
    is_stale,
    move_walls,
    strayed,
    sweep,
    time_left_to_push,
    time_to_push,
)
from floebmi.forces import FORCE_BUFFER
from floebmi.pack import Packed
from floebmi.pairs import narrow, settle


def verlet_in_threads(
    threads: int, laws: Laws, forces: tuple, at: tuple, packed: Packed, lists: Lists, walls: Walls, books: Books, first_kick: float, way: float, dt: float, steps: int,
    substeps: np.ndarray, marked: Marked, travelled: float, reach: float, drag_every: int, lag: np.ndarray,
) -> int:  # fmt: skip
    """`dynamics.verlet`, chunk by chunk, in the same order; kernels release the GIL, so that threads of Python will do."""
    p, chunks = packed, lists.tiles.chunks
    threads = min(threads, len(chunks) - 1)
    seams, period = chunks[-1], (laws.period_x, laws.period_y)
    buffers = [
        (np.empty(PAIR_BUFFER), np.empty(FORCE_BUFFER), np.empty_like(lists.blows))
        for _ in range(threads)
    ]
    bounds = [chunks[k * (len(chunks) - 1) // threads] for k in range(threads + 1)]
    done, kicks, since = 0, (0.0, first_kick), 0.0
    with ThreadPoolExecutor(threads - 1) if threads > 1 else nullcontext() as pool:

        def share(work: Callable[[int, int, int], float]) -> float:
            """The largest that `work` gives; each thread does its tiles, this one the first of them."""
            ranges = list(zip(range(threads), bounds[:-1], bounds[1:], strict=True))
            others = [pool.submit(work, *each) for each in ranges[1:]]
            return max([work(*ranges[0]), *(other.result() for other in others)])

        def steps_of(moves: bool, touches: bool) -> Callable[[int, int, int], float]:
            return lambda thread, first, last: sweep(
                laws, forces, at, p, lists, walls, first, last, moves, touches, kicks, dt, pushed, substeps, books,
                buffers[thread],
            )  # fmt: skip

        def touch_anew(thread: int, first: int, last: int) -> float:
            narrow(*period, p.floes, lists.near, first, last, lists.gap, lists.skin + 2.0 * way)
            return steps_of(False, True)(thread, first, last)

        while done < steps:
            if not travelled < reach:
                travelled = strayed(p.floes, walls.walls, marked)
                if not travelled < NEARLY * reach:
                    break
            pushed = time_to_push(lag, drag_every, dt, (steps - done) * dt)
            anew = is_stale(since, way, lists.skin)
            fastest = max(move_walls(walls.walls, kicks, dt), share(steps_of(True, not anew)))
            way = dt * np.sqrt(fastest)
            if anew:
                share(touch_anew)
                touch_anew(0, seams, seams + 1)
            else:
                steps_of(False, True)(0, seams, seams + 1)
            travelled, since = travelled + way, 0.0 if anew else since + way
            done, kicks = done + 1, (0.5 * dt, 0.5 * dt)
    settle(lists.near, 0, seams + 1)
    if done > 0:
        pushed = time_left_to_push(lag, done == steps)
        end_steps(
            forces, at, p, lists.tiles, walls.walls, 0.5 * dt, pushed, substeps, books.held[seams],
            buffers[0][1],
        )  # fmt: skip
    return done
