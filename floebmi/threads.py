"""Large packs on several threads, with the same bits for any number of them.

Floes that lie together in space lie together in memory, so a pack is cut into chunks of neighbours; how many
depends on the number of floes alone.  The pairs within a chunk touch nothing outside of it: each thread does its
chunks by itself.  The few pairs across a seam between chunks come last, one after the other.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from typing import Any

import numpy as np

from floebmi.columns import PAIR_BUFFER
from floebmi.dynamics import book_losses, end_steps, move, move_walls, touch
from floebmi.forces import FORCE_BUFFER
from floebmi.pairs import narrow, settle


def verlet(
    threads, chunks, law, wall_law, forces, at, period_x, period_y, packed, pairs, near, gap, near_skin,
    walls, wall_floe, wall_number, wall_damped, constraint, losses, dt, steps, substeps, travelled,
    half_skin, drag_every, lag,
):  # fmt: skip
    """`dynamics.verlet` in chunks; kernels release the GIL, so that threads of Python will do."""
    p, bounds, parts, numbers = packed, chunks.bounds, chunks.parts, range(len(chunks.bounds) - 1)
    held = np.zeros((len(numbers), 3))
    pair_buffers = np.empty((len(numbers) + 1, PAIR_BUFFER))
    force_buffers = np.empty((len(numbers), FORCE_BUFFER))
    fixed = p.floes, p.spinning, p.friction, p.tensile_strength, near
    seams = len(numbers)
    inverse = p.inverse_x, p.inverse_y, p.inverse_spin
    threads = min(threads, len(numbers))
    done, kicked, since = 0, 0.5 * dt, np.inf
    with ThreadPoolExecutor(threads - 1) if threads > 1 else nullcontext() as pool:

        def each(work: Callable[[int], Any]) -> list[Any]:
            """What `work` gives for each chunk, in their order; this thread takes its share."""

            def some(thread: int) -> list[Any]:
                return [work(c) for c in numbers[thread::threads]]

            others = [pool.submit(some, thread) for thread in range(1, threads)]
            shares: Sequence[Sequence[Any]] = [some(0), *(other.result() for other in others)]
            return [shares[c % threads][c // threads] for c in numbers]

        def move_chunk(c: int) -> float:
            return move(
                forces, at, p, bounds[c], bounds[c + 1], kicked, dt, lag[0], substeps, due, held[c],
                force_buffers[c],
            )  # fmt: skip

        def narrow_part(c: int) -> None:
            narrow(period_x, period_y, p.floes, pairs, near, c, parts[c], parts[c + 1], gap,
                   near_skin + 2.0 * way)  # fmt: skip

        def touch_chunk(c: int) -> tuple:
            if renew:
                narrow_part(c)
            return touch(
                law, None, period_x, period_y, *fixed, c, parts[c], None, wall_floe, wall_number,
                None, dt, p.force, *inverse, held[c], pair_buffers[c],
            )  # fmt: skip

        while done < steps and travelled < half_skin:
            lag[0] += dt
            lag[1] += 1.0
            due = lag[1] >= drag_every or done == steps - 1
            fastest = max(move_walls(walls, kicked, dt), *each(move_chunk))
            if due:
                lag[:] = 0.0
            way = dt * np.sqrt(fastest)
            renew = since + way > 0.5 * near_skin
            since = 0.0 if renew else since + way
            for lost in each(touch_chunk):
                book_losses(losses, lost)
            if renew:
                narrow_part(seams)
            lost = touch(
                law, wall_law, period_x, period_y, *fixed, seams, parts[seams], walls, wall_floe,
                wall_number, wall_damped, dt, p.force, *inverse, constraint, pair_buffers[-1],
            )  # fmt: skip
            book_losses(losses, lost)
            travelled += way
            done, kicked = done + 1, dt
    for c in range(seams + 1):
        settle(pairs, near, c, parts[c])
    if done > 0:
        end_steps(p, walls, dt, constraint)
    constraint += held.sum(axis=0)
    return done, travelled
