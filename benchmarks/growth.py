"""How cost and memory grow with the number and the sizes of floes: `python -m benchmarks.growth [--largest 1000000]`.

Frictional discs in a periodic square at packing 0.85 with random velocities, double precision, one core.
Scenes take turns and the best of each counts, so that other work on the machine troubles all alike.
Memory: arrays that a model and its contact list hold between two list renewals, counted one by one, those
of a row per floe and those of a row per listed pair apart; and what the process grew by at its peak.
"""

import argparse
import resource
import time

import numpy as np

import floebmi as fb
from floebmi.advance import Advance

LAWS = {"frictional": fb.frictional, "cohesive": fb.cohesive}


def pack(n: int, ratio: float, contact: fb.Contact) -> fb.Model:
    sizes = fb.PowerLaw(1.0, ratio, -1.8)
    side = float(np.sqrt(n * sizes.mean_area() / 0.85))
    domain = fb.Domain((0, side), (0, side), "periodic", "periodic", "periodic", "periodic")
    floes = fb.scatter(domain, sizes, concentration=0.85, seed=1)
    floes.u[:], floes.v[:] = np.random.default_rng(0).normal(0, 0.1, (2, len(floes)))
    model = fb.Model(domain, floes, contact=contact)
    model.advance(20 * model.longest_step())  # compiles
    return model


def cost(models: dict[str, fb.Model], repeats: int, floe_steps: float) -> dict[str, float]:
    """Best time of a floe-step [s], list renewals included."""
    best = dict.fromkeys(models, np.inf)
    for _ in range(repeats):
        for name, model in models.items():
            duration = max(300, floe_steps // len(model.floes)) * model.longest_step()
            before, start = model.counters.floe_steps, time.perf_counter()
            model.advance(duration)
            spent = time.perf_counter() - start
            best[name] = min(best[name], spent / (model.counters.floe_steps - before))
    return best


def arrays_of(thing: object, seen: dict[int, np.ndarray]) -> dict[int, np.ndarray]:
    """Each array that can be reached from a thing, once; views count as what they look at."""
    if isinstance(thing, np.ndarray):
        while isinstance(thing.base, np.ndarray):
            thing = thing.base
        seen[id(thing)] = thing
    elif isinstance(thing, tuple | list):
        for part in thing:
            arrays_of(part, seen)
    elif isinstance(thing, dict):
        arrays_of(list(thing.values()), seen)
    elif hasattr(thing, "__dict__") and type(thing).__module__.startswith("floebmi"):
        arrays_of(list(vars(thing).values()), seen)
    return seen


def memory(model: fb.Model) -> tuple[float, float, float]:
    """Bytes per floe, per listed pair, and pairs per floe, in the middle of an advance."""
    now: Advance = model._now()
    n, pairs = len(model.floes), len(now.pairs.i)
    listed = arrays_of(now.pairs[1:], {})
    held = arrays_of([model, now], {})
    per_pair = sum(array.nbytes for array in listed.values())
    per_floe = sum(array.nbytes for key, array in held.items() if key not in listed)
    return per_floe / n, per_pair / pairs, pairs / n


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--largest", type=int, default=1_000_000)
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    numbers = [n for n in (1_000, 10_000, 100_000, 1_000_000) if n <= options.largest]

    print("number of floes, size ratio 2          ns per floe-step   to the first")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    models = {f"{n:,}": pack(n, 2.0, fb.frictional()) for n in numbers}
    spent = cost(models, options.repeats, 2e6)
    for name, value in spent.items():
        print(f"  {name:>34}{value * 1e9:>18.1f}{value / spent['1,000']:>15.2f}")
    largest = models[f"{numbers[-1]:,}"]
    grown = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - peak)

    print("size ratio, 10 000 floes               ns per floe-step   to the first")
    sizes = {f"1:{ratio}": pack(10_000, ratio, fb.frictional()) for ratio in (2, 10, 100)}
    spent = cost(sizes, options.repeats, 2e6)
    for name, value in spent.items():
        print(f"  {name:>34}{value * 1e9:>18.1f}{value / spent['1:2']:>15.2f}")

    print("memory                                    bytes a floe   bytes a pair   pairs a floe")
    for name, law in LAWS.items():
        model = largest if name == "frictional" else pack(10_000, 2.0, law())
        row = memory(model)
        print(f"  {name:>34}{row[0]:>18.0f}{row[1]:>15.1f}{row[2]:>15.2f}")
    total = sum(len(model.floes) for model in models.values())
    print(f"the process grew by {grown / total:.0f} bytes a floe at its peak, packing included")


if __name__ == "__main__":
    main()
