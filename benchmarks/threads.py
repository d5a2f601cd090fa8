"""One thread and several on the same dense packs: `python -m benchmarks.threads [--floes 10000,100000] [--threads 2]`.

Frictional packs at packing 0.85, whole advances, in turn.  It says whether the positions at the end are the same to the bit.
"""

import argparse
import time
from pathlib import Path

import numpy as np

import floebmi as fb
from benchmarks.options import picture, run, several, whole
from benchmarks.packs import scattered
from floebmi.plot import graph


def gain(count: int, threads: int, steps: int, repeats: int) -> np.ndarray:
    """How many times as fast several threads are as one, in each repeat."""
    domain, floes = scattered(count)
    models = {
        n: fb.Model(domain, floes.copy(), contact=fb.frictional(), threads=n) for n in (1, threads)
    }
    duration = steps * models[1].longest_step()
    rows = []
    for _ in range(repeats + 1):  # the first compiles
        row = []
        for model in models.values():
            begin = time.perf_counter()
            model.advance(duration)
            row.append(time.perf_counter() - begin)
        rows.append(row)
    one, several = np.array(rows[1:]).T
    ratio = one / several
    same = np.array_equal(models[1].floes.x, models[threads].floes.x)
    print(
        f"{len(floes)} floes, {models[1].counters.steps} steps: {threads} threads are "
        f"{np.median(ratio):.2f} ({ratio.min():.2f} … {ratio.max():.2f}) times as fast as one; "
        f"{'the same bits' if same else 'OTHER BITS'}"
    )
    return ratio


def draw(gains: dict[int, np.ndarray], threads: int, to: Path) -> None:
    """The gain against the number of floes: median, and from the smallest to the largest."""
    middle, low, high = (
        np.array([of(ratio) for ratio in gains.values()]) for of in (np.median, np.min, np.max)
    )
    with graph(5, 3) as figure:
        axes = figure.subplots()
        axes.errorbar([*gains], middle, [middle - low, high - middle], fmt="o-", capsize=3)
        axes.axhline(1, color="gray", lw=1, ls=":")
        axes.set(xlabel="number of floes [1]", ylabel=f"speed with {threads} threads over one [1]")
        axes.set(xscale="log", ylim=(0, threads))
        figure.savefig(to, dpi=130)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--floes", type=several(whole), default=[100_000], metavar="N[,…]")
    parser.add_argument("--threads", type=whole, default=2)
    parser.add_argument("--steps", type=whole, default=300, help="of a repeat")
    parser.add_argument("--repeats", type=whole, default=5)
    parser.add_argument("--figure", type=picture, metavar="FILE.png", help="draw the gains")
    options = parser.parse_args()
    gains = {
        count: gain(count, options.threads, options.steps, options.repeats)
        for count in options.floes
    }
    if options.figure:
        draw(gains, options.threads, options.figure)


if __name__ == "__main__":
    run(main)
