"""One thread and two on the same dense pack: `python -m benchmarks.threads [--floes 100000] [--threads 2]`.

Frictional, packing 0.85, whole advances, in turn; the places at the end must be the same to the bit.
"""

import argparse
import time

import numpy as np

import floebmi as fb


def pack(floes: int) -> tuple[fb.Domain, fb.Floes]:
    """A dense periodic pack with random velocities."""
    sizes = fb.PowerLaw(1.0, 2.0, -1.8)
    side = float(np.sqrt(floes * sizes.mean_area() / 0.85))
    domain = fb.Domain((0, side), (0, side), "periodic", "periodic", "periodic", "periodic")
    made = fb.scatter(domain, sizes, concentration=0.85, seed=1)
    rng = np.random.default_rng(0)
    made.u[:], made.v[:] = rng.normal(0, 0.1, (2, len(made)))
    return domain, made


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--floes", type=int, default=100_000)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--steps", type=int, default=300, help="of a repeat")
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    domain, floes = pack(options.floes)
    models = {
        n: fb.Model(domain, floes.copy(), contact=fb.frictional(), threads=n)
        for n in (1, options.threads)
    }
    duration = options.steps * models[1].longest_step()
    rows = []
    for _ in range(options.repeats + 1):  # the first compiles
        row = []
        for model in models.values():
            begin = time.perf_counter()
            model.advance(duration)
            row.append(time.perf_counter() - begin)
        rows.append(row)
    one, several = np.array(rows[1:]).T
    ratio = one / several
    same = np.array_equal(models[1].floes.x, models[options.threads].floes.x)
    print(
        f"{len(floes)} floes, {models[1].counters.steps} steps: {options.threads} threads are "
        f"{np.median(ratio):.2f} ({ratio.min():.2f} … {ratio.max():.2f}) times as fast as one; "
        f"{'the same bits' if same else 'OTHER BITS'}"
    )


if __name__ == "__main__":
    main()
