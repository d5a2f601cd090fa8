"""Large packs on several threads, each with its chunks of tiles; results are bitwise equal for any number of threads."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, nullcontext

import numpy as np

from floebmi.columns import PAIR_BUFFER
from floebmi.dynamics import (
    NEARLY,
    Laws,
    Lists,
    Marked,
    Tally,
    Walls,
    end_steps,
    is_stale,
    move_walls,
    strayed,
    sweep,
    time_left_to_push,
    time_to_push,
    wide_enough,
)
from floebmi.forces import FORCE_BUFFER
from floebmi.kernels import in_place
from floebmi.meeting import meet
from floebmi.pack import Packed
from floebmi.pairs import narrow, settle

LINE = 8  # numbers in a cache line: threads that write into the same line would wait for each other


def verlet_in_threads(
    threads: int, laws: Laws, forces: tuple, at: tuple, packed: Packed, lists: Lists, walls: Walls, tally: Tally, first_kick: float, way: float, dt: float, steps: int,
    substeps: np.ndarray, marked: Marked, travelled: float, reach: float, drag_every: int, lag: np.ndarray,
) -> int:  # fmt: skip
    """`dynamics.verlet`, chunk by chunk, in the same order; kernels release the GIL, so Python threads suffice."""
    chunks = lists.tiles.chunks
    threads = min(threads, len(chunks) - 1)
    bounds = np.array([chunks[k * (len(chunks) - 1) // threads] for k in range(threads + 1)])
    counter, fastest = np.zeros(1, np.int64), np.zeros((threads, LINE))
    buffers = np.empty(PAIR_BUFFER), np.empty(FORCE_BUFFER)

    def share(thread: int) -> int:
        with _let_others_end(counter):
            own = (
                (lag, (*buffers, lists.blows))
                if thread == 0
                else (lag.copy(), (*map(np.empty_like, buffers), np.empty_like(lists.blows)))
            )
            return _share(
                thread, threads, bounds, counter, fastest, laws, forces, at, packed, lists, walls, tally,
                first_kick, way, dt, steps, substeps, marked, travelled, reach, drag_every, *own,
            )  # fmt: skip

    pool = ThreadPoolExecutor(threads - 1) if threads > 1 else nullcontext()
    # a thread may not even start: systems limit their number
    with pool, _let_others_end(counter):
        others = [pool.submit(share, thread) for thread in range(1, threads)]
        done = share(0)
        for other in others:
            other.result()
    _end(forces, at, packed, lists, walls, tally, dt, done, steps, substeps, lag, buffers[1])
    return done


@contextmanager
def _let_others_end(counter: np.ndarray) -> Iterator[None]:
    """After an error no thread goes on waiting for the others; counter : see `meet`."""
    try:
        yield
    except BaseException:
        counter[0] = np.iinfo(np.int64).max // 2
        raise


@in_place
def _end(forces, at, packed, lists, walls, tally, dt, done, steps, substeps, lag, buffer):
    """Finish the last step, once all threads are done."""
    seams = lists.tiles.coast.size
    settle(lists.near, 0, seams + 1)
    if done > 0:
        pushed = time_left_to_push(lag, done == steps)
        end_steps(
            forces, at, packed, lists.tiles, walls.records, 0.5 * dt, pushed, substeps,
            tally.held[seams], buffer,
        )  # fmt: skip


@in_place
def _share(
    thread, threads, bounds, counter, fastest, laws, forces, at, packed, lists, walls, tally, first_kick,
    way, dt, steps, substeps, marked, travelled, reach, drag_every, lag, buffers,
):  # fmt: skip
    """One thread's share of the steps: its tiles; the first thread also moves the walls and touches across seams.

    Each thread tracks the progress of the steps by itself, from numbers that all read at the same time.

    bounds : tiles of each thread; counter : see `meet`; fastest : (threads, LINE), the largest speed² of each [m²/s²]
    """
    p, seams = packed, lists.tiles.coast.size
    done, kicks, since, skin, times = 0, (0.0, first_kick), 0.0, lists.skin, 0
    while done < steps:
        if not travelled < reach:
            travelled = strayed(p.floes, walls.records, marked)
            times = meet(counter, threads, times)
            if not travelled < NEARLY * reach:
                break
        pushed = time_to_push(lag, drag_every, dt, (steps - done) * dt)
        anew = is_stale(since, way, skin)
        # move, and touch at once unless the list is rebuilt; touch; touch across seams
        for turn in range(3):
            if turn == 1 and not anew:
                continue
            first, end = (bounds[thread], bounds[thread + 1]) if turn < 2 else (seams, seams + 1)
            if turn == 1:
                skin = wide_enough(lists.skin, way)
            if turn < 2 or thread == 0:
                if anew and turn > 0:
                    narrow(laws.period_x, laws.period_y, p.floes, lists.near, first, end, lists.gap,
                           skin + 2.0 * way)  # fmt: skip
                speed2 = sweep(
                    laws, forces, at, p, lists, walls, first, end, turn == 0, turn > 0 or not anew,
                    kicks, dt, pushed, substeps, tally, buffers,
                )  # fmt: skip
                if turn == 0:
                    of_walls = move_walls(walls.records, kicks, dt) if thread == 0 else 0.0
                    fastest[thread, 0] = max(of_walls, speed2)
            times = meet(counter, threads, times)
            if turn == 0:
                speed2 = 0.0
                for each in range(threads):
                    speed2 = max(speed2, fastest[each, 0])
                way = dt * np.sqrt(speed2)
        travelled, since = travelled + way, 0.0 if anew else since + way
        done, kicks = done + 1, (0.5 * dt, 0.5 * dt)
    return done
