"""The pack that the benchmarks share, and what its floe-steps cost."""

import time

import numpy as np

import floebmi as fb


def scattered(
    n: int, ratio: float = 2.0, packing: float = 0.85, speed: float = 0.1
) -> tuple[fb.Domain, fb.Floes]:
    """About n discs in a periodic square, radii from 1 m to `ratio`; velocities are normal with standard deviation `speed` [m/s]."""
    sizes = fb.PowerLaw(1.0, ratio, -1.8)
    side = float(np.sqrt(n * sizes.mean_area() / packing))
    domain = fb.Domain((0, side), (0, side), "periodic", "periodic", "periodic", "periodic")
    floes = fb.scatter(domain, sizes, concentration=packing, seed=1)
    floes.u[:], floes.v[:] = np.random.default_rng(0).normal(0, speed, (2, len(floes)))
    return domain, floes


def steps_of_a_repeat(n: int) -> int:
    """As many for few floes as take a while."""
    return max(300, 2_000_000 // n)


def cost(models: dict, repeats: int) -> dict:
    """Best time of a floe-step [ns] of each model, rebuilds of the neighbour list included.

    Models take turns, and the best of each counts, since other work on the machine can only slow a run down.
    """
    best = dict.fromkeys(models, np.inf)
    for _ in range(repeats):
        for name, model in models.items():
            duration = steps_of_a_repeat(len(model.floes)) * model.longest_step()
            before, start = model.counters.floe_steps, time.perf_counter()
            model.advance(duration)
            spent = time.perf_counter() - start
            best[name] = min(best[name], 1e9 * spent / (model.counters.floe_steps - before))
    return best
