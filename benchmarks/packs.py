"""The pack that the benchmarks share."""

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
