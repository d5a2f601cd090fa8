"""Floe-steps per second of a dense periodic pack: `python -m benchmarks.dense [--floes 10000] [--ratio 2]`.

Discs at packing 0.85 with random velocities, double precision, one core.  The contact laws take turns.
"""

import argparse

import floebmi as fb
from benchmarks.options import number_from, run, whole
from benchmarks.packs import cost, scattered, steps_of_a_repeat


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--floes", type=whole, default=10_000)
    parser.add_argument(
        "--ratio", type=number_from(1), default=2.0, help="largest over smallest radius"
    )
    parser.add_argument("--repeats", type=whole, default=5)
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
    for model in models.values():
        model.advance(20 * model.longest_step())  # compiles
    spent, steps = cost(models, options.repeats), steps_of_a_repeat(len(floes))
    print(f"{len(floes)} floes, size ratio {options.ratio:g}, packing 0.85, {steps} steps a repeat")
    for name, each in spent.items():
        ratio = spent["frictional"] / each
        print(f"  {name:<32}{1e3 / each:8.1f} million floe-steps/s{ratio:8.2f} × frictional")


if __name__ == "__main__":
    run(main)
