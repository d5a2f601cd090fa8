"""How near a step is to the limits of the machine: `python -m benchmarks.limit [--floes 1000000]`.

On one core.  Memory: a triad a[i] = b[i] + s c[i] on arrays far larger than the cache gives the bandwidth; the
arrays that a step must read and write, each once, give the least that it moves.  Arithmetic: a loop of multiply-adds in
the nearest cache shows what this core can do.  Instructions: valgrind counts them for two runs that differ only in the
number of steps, so that the difference is that of steps alone.  The code is compiled for an old processor, two numbers
per instruction, which makes the counts the same on all machines with the same numba.
"""

import argparse
import os
import re
import subprocess
import sys
import time
from collections.abc import Callable

import numba
import numpy as np

import floebmi as fb
from benchmarks.options import run, whole
from benchmarks.packs import scattered
from floebmi.advance import Advance
from floebmi.dynamics import sweep
from floebmi.pairs import narrow

LAWS = {
    "frictional": (fb.frictional(), ()),
    "frictional, ocean and air drag": (fb.frictional(), (fb.OceanDrag(), fb.AirDrag())),
    "cohesive": (fb.cohesive(), ()),
}
PLAIN = {  # instructions of 2008: of later ones valgrind does not know all
    "NUMBA_CPU_NAME": "nehalem",
    "NUMBA_CPU_FEATURES": "",
    "NUMBA_NUM_THREADS": "1",
    "PYTHONHASHSEED": "0",
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
}
COUNTED = 1_000, 100, 500  # floes, steps of the shorter run and of the longer one
SLOW = 0.05  # [m/s]: floes that keep their list of neighbours all the while


def pack(law: str, n: int, speed: float) -> fb.Model:
    """The scene of benchmarks/engines.py, size ratio 2; slow floes need no rebuild of the neighbour list."""
    contact, forces = LAWS[law]
    domain, floes = scattered(n, speed=speed)
    return fb.Model(domain, floes, contact, forces, step=fb.Step(length=1.5e-3))


@numba.njit(fastmath=True)
def triad(a, b, c, s):
    for i in range(a.size):
        a[i] = b[i] + s * c[i]


@numba.njit(fastmath=True)
def multiply_add(a, times):
    for _ in range(times):
        for i in range(a.size):
            x = a[i]
            a[i] = x * (0.5 + x * (0.25 - x * (0.125 + x * (0.0625 - x * 0.03125))))


def seconds(work, *arguments, repeats: int = 15) -> float:
    """Shortest time."""
    best = np.inf
    for _ in range(repeats):
        start = time.perf_counter()
        work(*arguments)
        best = min(best, time.perf_counter() - start)
    return best


def bandwidth() -> float:
    """Bytes per second of the triad, 24 per number (32 for a cache that reads what it will overwrite)."""
    a, b, c = np.zeros((3, 20_000_000))
    return 24 * a.size / seconds(triad, a, b, c, 0.5)


def run_counted(law: str, steps: int) -> None:
    """What valgrind counts: so many steps on one neighbour list."""
    model = pack(law, COUNTED[0], SLOW)
    model.advance(steps * model.step.length)
    if model.counters.rebuilds != 1:
        raise SystemExit("the list was renewed: not steps alone")


def instructions(law: str) -> float:
    """Instructions per floe-step of a law, without rebuilds of the list and the ledger."""
    n, less, more = COUNTED
    counts = []
    for steps in (less, more):
        command = [sys.executable, "-m", "benchmarks.limit", "--count", law, str(steps)]
        if not counts:  # compiles, without valgrind
            subprocess.run(command, env=os.environ | PLAIN, check=True)
        watched = ["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null", *command]
        done = subprocess.run(watched, env=os.environ | PLAIN, capture_output=True, text=True)
        found = re.search(r"Collected : (\d+)", done.stderr)
        if done.returncode or not found:
            raise RuntimeError(f"valgrind did not finish:\n{done.stderr[-2000:]}")
        counts.append(int(found[1]))
    return (counts[1] - counts[0]) / (more - less) / len(pack(law, n, SLOW).floes)


def bytes_of_a_step(model: fb.Model) -> float:
    """Bytes per floe that a step of the frictional pack must move: each array once each way."""
    now = model._now()
    p, n, near = now.packed, len(model.floes), now.lists.pairs
    contact_forces(now, model.step.length)
    close = int(now.lists.near.counts.sum())
    both = [p.floes, p.force, p.angle, near.slip[:close]]  # read and written
    only = [p.inverse_spin, near.i[:close], near.j[:close]]  # read
    return (2 * sum(a.nbytes for a in both) + sum(a.nbytes for a in only)) / n


def contact_forces(now: Advance, dt: float) -> Callable[[], float]:
    """A function that finds the forces of the pairs about to touch, as a step does."""
    laws, tiles = now._laws(), len(now.lists.tiles.bounds) - 1
    lists = now.lists
    narrow(*now.period, now.packed.floes, lists.near, 0, tiles, lists.gap, lists.skin)
    none, tally = np.zeros(1, np.int64), now._tally()
    scene = laws, (), (), now.packed, lists, now.walls
    what = 0, tiles, False, True, (dt, 0.0), dt, 0.0, none, tally, (*now.buffers, lists.blows)
    return lambda: sweep(*scene, *what)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--floes", type=whole, default=1_000_000)
    parser.add_argument("--count", nargs=2, help=argparse.SUPPRESS)
    parser.add_argument("--instructions", action="store_true", help="count them (minutes)")
    options = parser.parse_args()
    if options.count:
        run_counted(options.count[0], int(options.count[1]))
        return
    speed = bandwidth()
    print(f"a triad moves {speed / 1e9:.1f} GB/s")
    a = np.full(512, 0.1)
    multiply_add(a, 1)
    spent = seconds(multiply_add, a, 20_000) / 20_000
    print(f"multiply-adds in the nearest cache: {10 * a.size / spent / 1e9:.1f} Gflop/s")
    for n in dict.fromkeys((10_000, options.floes)):
        model = pack("frictional", n, 0.5)
        steps = max(60, 2_000_000 // n)
        duration = steps * model.step.length
        model.advance(0.2 * duration)  # compiles
        spent = seconds(model.advance, duration, repeats=3) / steps
        now, moved = model._now(), bytes_of_a_step(model)
        touch = seconds(contact_forces(now, model.step.length))
        renewal = seconds(now._list_anew, model._state.memory, repeats=3)
        each = 1e9 / len(model.floes)
        print(
            f"{n} floes: {each * spent:.1f} ns a floe-step, {each * touch:.1f} of them contact forces; "
            f"{each * renewal:.0f} ns a floe for a new list; its arrays are {moved:.0f} bytes a floe, "
            f"once each way {1e9 * moved / speed:.1f} ns"
        )
    if options.instructions:
        for law in LAWS:
            print(f"{law}: {instructions(law):.1f} instructions a floe-step", flush=True)


if __name__ == "__main__":
    run(main)
