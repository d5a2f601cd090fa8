"""Errors of a smooth field regridded from a host to the floes and back: `python -m benchmarks.convergence`.

A wave on the warped cells of a host is regridded to the rectangular exchange grid; from there it goes to floes, and back
to the host.  From column to column the cell size of both grids is halved.  Radii of floes are 0.4 cells, or 450 m, which is
1.5 cells of the coarsest grid.  "overlap" is compared with the mean over the floe, "centre" with the value at its centre.
The order is the slope between the last two columns.
"""

import argparse

import numpy as np

from coupling.regrid import Regrid
from floebmi.grid import Grid
from floebmi.sampling import floe_weights, gather

SIDE = 12_000.0  # m
CELLS = (32, 64, 128)


def wave(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.sin(2 * np.pi * (x + 2 * y) / SIDE)


def over_floes(x: np.ndarray, y: np.ndarray, radius: float) -> np.ndarray:
    """The exact mean of the wave over discs."""
    from scipy.special import j1

    z = 2 * np.pi * np.sqrt(5) / SIDE * radius
    return 2 * j1(z) / z * wave(x, y)


def warped(n: int) -> Grid:
    x, y = np.meshgrid(*2 * [np.linspace(0, SIDE, n + 1)])
    bump = np.sin(np.pi * x / SIDE) * np.sin(np.pi * y / SIDE)
    return Grid.curvilinear(x + 700 * bump, y - 500 * bump)


def errors(n: int) -> dict[str, float]:
    """Root mean square errors, of a field whose own root mean square is 0.71."""
    host, ice = warped(n), Grid.uniform((0, SIDE), (0, SIDE), shape=(5 * n // 4, 5 * n // 4))
    regrid = Regrid(host, ice)
    given = wave(host.x, host.y)
    there = regrid.state(given)
    back = regrid.reverse.state(there)
    flux = regrid.flux(there)
    x, y = np.random.default_rng(3).uniform(1500, SIDE - 1500, (2, 2000))
    cell = SIDE / (5 * n // 4)

    def rms(wrong: np.ndarray) -> float:
        return float(np.sqrt(np.mean(wrong**2)))

    found = {
        "host → exchange": rms(there - wave(ice.x, ice.y)),
        "host → exchange → host, state": rms(back - given),
        "host → exchange → host, flux": rms(flux - given),
        "  its integral": abs((flux * host.area).sum() - (given * host.area).sum())
        / np.abs(given * host.area).sum(),
    }
    for name, radius in (("0.4 cells", 0.4 * cell), ("450 m", 450.0)):
        for accuracy in ("overlap", "centre"):
            weights = floe_weights(ice, x, y, radius, accuracy)
            exact = over_floes(x, y, radius) if accuracy == "overlap" else wave(x, y)
            found[f"exchange → floes of {name}, {accuracy}"] = rms(
                gather(weights, wave(ice.x, ice.y)) - exact
            )
            found[f"host → exchange → floes of {name}, {accuracy}"] = rms(
                gather(weights, there) - exact
            )
    return found


def main() -> None:
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    rows = [errors(n) for n in CELLS]
    print(f"{'':<48}" + "".join(f"{f'{n} × {n}':>12}" for n in CELLS) + f"{'order':>8}")
    for name in rows[0]:
        values = [row[name] for row in rows]
        order = "" if values[-1] < 1e-12 else f"{np.log2(values[-2] / values[-1]):.2f}"
        print(f"{name:<48}" + "".join(f"{value:>12.1e}" for value in values) + f"{order:>8}")


if __name__ == "__main__":
    main()
