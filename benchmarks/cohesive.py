"""How much faster are bonds than friction?  `python -m benchmarks.cohesive [--floes 10000]`.

The paper reports a factor of 2.1 for its interaction routine.  Here it is measured twice on the same dense pack: for the
contact forces alone, on one neighbour list, and for whole advances with the same step.  The two laws take turns,
and the best time of each counts.
"""

import argparse
import time

import numpy as np

import floebmi as fb
from benchmarks.limit import contact_forces
from benchmarks.options import run, whole
from benchmarks.packs import scattered


def best(work: dict[str, object], repeats: int) -> dict[str, float]:
    """Shortest time of each [s]."""
    shortest = dict.fromkeys(work, np.inf)
    for _ in range(repeats):
        for name, do in work.items():
            start = time.perf_counter()
            do()
            shortest[name] = min(shortest[name], time.perf_counter() - start)
    return shortest


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--floes", type=whole, default=10_000)
    parser.add_argument("--repeats", type=whole, default=20)
    options = parser.parse_args()
    domain, floes = scattered(options.floes)
    laws = {"cohesive": fb.cohesive(), "frictional": fb.frictional()}
    step = fb.Step(length=fb.Model(domain, floes.copy(), fb.frictional()).longest_step())

    def packs() -> dict[str, fb.Model]:
        made = {
            n: fb.Model(domain, floes.copy(), contact=law, step=step) for n, law in laws.items()
        }
        for model in made.values():
            model.advance(20 * step.length)  # compiles, and brings the pack into contact
        return made

    models, kernels, pairs = packs(), {}, {}
    for name, model in packs().items():  # others: what is added to their forces stays there
        forces = contact_forces(model._now(), step.length)
        pairs[name] = int(model._now().lists.near.counts.sum())
        kernels[name] = lambda forces=forces: [forces() for _ in range(100)]
    alone = best(kernels, options.repeats)
    advance = best(
        {n: lambda m=m: m.advance(200 * step.length) for n, m in models.items()},
        options.repeats // 4 or 1,
    )
    print(f"{len(floes)} floes, pairs about to touch: {pairs}")
    for what, took, steps in (
        ("contact forces alone", alone, 100),
        ("whole advance", advance, 200),
    ):
        each = {name: 1e9 * t / steps / len(floes) for name, t in took.items()}
        print(
            f"  {what:<22} cohesive {each['cohesive']:.1f} ns per floe and step, frictional "
            f"{each['frictional']:.1f}: {each['frictional'] / each['cohesive']:.2f} times"
        )


if __name__ == "__main__":
    run(main)
