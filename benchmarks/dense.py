"""Floe-steps per second of a dense periodic pack: `python -m benchmarks.dense [--floes 10000] [--ratio 2]`.

Discs at packing 0.85 with random velocities, double precision, one core.  The contact laws take turns, and the best of
each is printed, since other work on the machine can only slow a run down.
"""

import argparse
import time

import floebmi as fb
from benchmarks.packs import scattered


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--floes", type=int, default=10_000)
    parser.add_argument("--ratio", type=float, default=2.0, help="largest over smallest radius")
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    domain, floes = scattered(options.floes, options.ratio)
    drag = (fb.OceanDrag(), fb.AirDrag())
    laws = {
        "elastic": (fb.Contact(), (), 1),
        "cohesive": (fb.cohesive(), (), 1),
        "frictional": (fb.frictional(), (), 1),
        "frictional, ocean and air drag": (fb.frictional(), drag, 1),
        "the same, drag every 10 steps": (fb.frictional(), drag, 10),
    }
    models = {
        name: fb.Model(
            domain, floes.copy(), contact=contact, forces=forces, step=fb.Step(drag_every=every)
        )
        for name, (contact, forces, every) in laws.items()
    }
    steps = max(100, 2_000_000 // len(floes))
    for model in models.values():
        model.advance(20 * model.longest_step())  # compiles
    best = dict.fromkeys(models, 0.0)
    for _ in range(options.repeats):
        for name, model in models.items():
            before, duration = model.counters.floe_steps, steps * model.longest_step()
            start = time.perf_counter()
            model.advance(duration)
            speed = (model.counters.floe_steps - before) / (time.perf_counter() - start)
            best[name] = max(best[name], speed)
    print(f"{len(floes)} floes, size ratio {options.ratio:g}, packing 0.85, {steps} steps a repeat")
    for name, speed in best.items():
        ratio = speed / best["frictional"]
        print(f"  {name:<32}{speed / 1e6:8.1f} million floe-steps/s{ratio:8.2f} × frictional")


if __name__ == "__main__":
    main()
