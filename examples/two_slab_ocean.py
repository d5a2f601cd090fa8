"""Floes and a two-slab ocean, coupled both ways: what one loses the other gains.

A pack of floes lies at rest in a periodic box; under it a slab of water moves along x, over a deep slab at
rest.  Drag sets the ice in motion and slows the water.  There is no other force, so the momentum of ocean
and ice together must not change.

The run is made twice:

right   the ocean gets the mean stress of the exchange, from the accumulated impulse J that the ice offers
wrong   the ocean gets the stress at the end of the exchange, as from a coupler that reads "the" stress

    python examples/two_slab_ocean.py [--folder two-slab-ocean] [--every 1800] [--hours 12]

writes both configurations and a figure into the folder, and prints the ledger of the right run.
"""

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np

from coupling.driver import couple
from coupling.slab import MOMENTUM as OCEAN_MOMENTUM, STRESS, TwoSlabOcean
from floebmi import FloeBmi
from floebmi.plot import graph

FLOES = """
seed = 3

[contact]
model = "frictional"
youngs_modulus = 2e6

[domain]
x = [0.0, 20e3]
y = [0.0, 20e3]
edges = "periodic"

[grid]                       # the floes' cells are finer than the ocean's, and do not fit into them
shape = [14, 17]

[floes]
concentration = 0.6
thickness = 2.0
size = { distribution = "power_law", radius_min = 400.0, radius_max = 1500.0 }

[ocean]
drag = "constant-cd"

[time]
exchange = 600.0
"""

OCEAN = """
[grid]
x = [0.0, 20e3]
y = [0.0, 20e3]
spacing = 2e3

[ocean]
surface_thickness = 3.0
deep_thickness = 30.0
quadratic_drag = 1e-3
surface_velocity = [0.4, 0.1]
"""

ICE_MOMENTUM = [f"sea_ice_flowing__domain_integral_of_{a}_component_of_momentum" for a in "xy"]
LAST_STEP = 60.0  # what the wrong coupling takes for "now" [s]


class EndOfInterval:
    """Floes that are updated `LAST_STEP` at a time: the mean stress "since the last update" is then that at the end of the exchange."""

    def __init__(self, floes: FloeBmi) -> None:
        self.floes = floes

    def __getattr__(self, name: str) -> object:
        return getattr(self.floes, name)

    def update_until(self, time: float) -> None:
        now = self.floes.get_current_time()
        for k in range(1, round((time - now) / LAST_STEP)):
            self.floes.update_until(now + k * LAST_STEP)
        self.floes.update_until(time)


def start(folder: Path) -> tuple[TwoSlabOcean, FloeBmi]:
    """Start both models from configuration files in the folder."""
    (folder / "ocean.toml").write_text(OCEAN)
    (folder / "floes.toml").write_text(FLOES)
    ocean, floes = TwoSlabOcean(), FloeBmi()
    ocean.initialize(str(folder / "ocean.toml"))
    floes.initialize(str(folder / "floes.toml"))
    return ocean, floes


def momentum(ocean: TwoSlabOcean, floes: FloeBmi) -> tuple[float, float]:
    """Momentum along x of the ocean and of the ice [N s]."""
    return ocean.get_value_ptr(OCEAN_MOMENTUM[0])[0], floes.get_value_ptr(ICE_MOMENTUM[0])[0]


def coupled(
    folder: Path, every: float, hours: float, right: bool, show: Callable[[str], object] | None
) -> np.ndarray:
    """Time [s], momentum of the ocean and of the ice [N s] at the start and after each exchange: (n, 3)."""
    ocean, floes = start(folder)
    rows = [(0.0, *momentum(ocean, floes))]

    def note(line: str) -> None:
        if show is not None:
            show(line)
        if floes.get_current_time() > rows[-1][0]:
            rows.append((floes.get_current_time(), *momentum(ocean, floes)))

    until = hours * 3600.0
    if right:
        couple(ocean, floes, every=every, until=until, show=note)
    else:
        to_host = {name: name for name in STRESS}  # not differenced: whatever it is when it is read
        couple(ocean, EndOfInterval(floes), every=every, until=until, to_host=to_host, show=note)
    return np.array(rows)


def error(rows: np.ndarray) -> float:
    """The largest change of the momentum of ocean and ice together, over what they exchanged."""
    total = rows[:, 1] + rows[:, 2]
    return float(np.abs(total - total[0]).max() / np.abs(np.diff(rows[:, 2])).sum())


def draw(path: Path, runs: dict[str, np.ndarray], every: float) -> None:
    """Draw the momentum of ocean, ice and both, for the right and the wrong exchange."""
    with graph(10, 4.2) as figure:
        panels = figure.subplots(1, 2, sharey=True)
        for panel, (name, rows) in zip(panels, runs.items(), strict=True):
            hours, ocean, ice = rows[:, 0] / 3600.0, rows[:, 1] / 1e9, rows[:, 2] / 1e9
            panel.plot(hours, ocean, color="#0072b2", label="ocean")
            panel.plot(hours, ice, color="#56b4e9", label="ice")
            panel.plot(hours, ocean + ice, color="black", lw=2, label="ocean + ice")
            panel.axhline(ocean[0] + ice[0], color="gray", lw=1, ls=":", zorder=0)
            panel.set_title(
                f"{name}\nocean + ice off by {error(rows):.2g} of what was exchanged", fontsize=10
            )
            panel.set_xlabel("time [h]")
            panel.grid(alpha=0.3)
        panels[0].set_ylabel("momentum along x [10⁹ N s]")
        panels[0].legend(loc="center right")
        figure.suptitle(f"Floes on a two-slab ocean, one exchange every {every:g} s", fontsize=11)
        figure.savefig(path, dpi=130)


def main(folder: Path, every: float = 1800.0, hours: float = 12.0) -> dict[str, float]:
    """Make both runs, the ledger and the figure; returns the error of each run."""
    folder.mkdir(parents=True, exist_ok=True)
    runs = {
        "mean stress, from the running impulse": coupled(folder, every, hours, True, print),
        "stress at the end of the exchange": coupled(folder, every, hours, False, None),
    }
    draw(folder / "two-slab-ocean.png", runs, every)
    print()
    for name, rows in runs.items():
        print(f"{name + ':':42}ocean + ice off by {error(rows):.1e} of the momentum exchanged")
    return {name: error(rows) for name, rows in runs.items()}


if __name__ == "__main__":
    words = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    words.add_argument("--folder", type=Path, default=Path("two-slab-ocean"))
    words.add_argument("--every", type=float, default=1800.0, help="seconds between exchanges")
    words.add_argument("--hours", type=float, default=12.0)
    main(**vars(words.parse_args()))
