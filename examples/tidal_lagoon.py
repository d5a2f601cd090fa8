"""Ice in a tidal lagoon: Landlab's TidalFlowCalculator moves the water, and the floes go out and in with it.

TidalFlowCalculator (Mariotti 2018, doi:10.1016/j.ecss.2018.05.016) gives the mean velocities of ebb and flood
on the *links* of a grid.  Landlab's own mapper brings them to the nodes, where `SeaIceFloes` reads them:

    u, v = grid.map_link_vector_components_to_node(velocity)

The lagoon is surrounded by land; spits leave an inlet to the sea in the east, through which floes may leave.
TidalFlowCalculator takes no stress, so the water does not feel the ice: its velocities are those of a run without ice, bit
for bit.  What the ice takes from the water is booked all the same, in a line of the ledger for each step.

    python examples/tidal_lagoon.py [--folder tidal-lagoon] [--tides 1] [--concentration 0.35]
"""

import argparse
from pathlib import Path
from typing import NamedTuple

import numpy as np
from landlab import RasterModelGrid
from landlab.components import TidalFlowCalculator

from coupling.landlab import SeaIceFloes
from coupling.ledger import HEADER
from floebmi import frictional
from floebmi.coast import from_land_fraction
from floebmi.forces import DRAG_PRESETS, CoriolisField, Tilt
from floebmi.plot import LAND, graph

SPACING = 100.0  # [m]
SHAPE = (31, 46)
HALF_TIDE = (12 + 25.2 / 60) / 2 * 3600.0  # of M2 [s]
STEPS = 12  # of each half
SPIT = 3400.0  # x of the spits between lagoon and sea [m]
VELOCITY = [f"sea_surface_water_flowing__{a}_component_of_velocity" for a in "xy"]


class Found(NamedTuple):
    """worst : largest residual of the ledger over the impulse exchanged; through : number of floes of the lagoon that
    went to sea; host_unchanged : whether the water moves as it does without ice; outside : area of ice outside all cells
    [m²]."""

    worst: float
    through: int
    host_unchanged: bool
    outside: float


def lagoon() -> RasterModelGrid:
    """Bed elevation: a shallow lagoon, a channel, spits, and the open sea in the east."""
    grid = RasterModelGrid(SHAPE, xy_spacing=SPACING)
    grid.set_closed_boundaries_at_grid_edges(False, True, True, True)
    x, y = grid.x_of_node, grid.y_of_node
    middle = 0.5 * y.max()
    depth = 1.2 + 3.0 * np.exp(-(((y - middle) / 350.0) ** 2)) + 2e-3 * np.clip(x - SPIT, 0, None)
    bed = grid.add_field("topographic__elevation", -depth, at="node")
    rim = (x < 150.0) | (y < 150.0) | (y > y.max() - 150.0)
    bed[rim | (np.abs(x - SPIT) < 160.0) & (np.abs(y - middle) > 350.0)] = 2.0
    return grid


def give_water(grid: RasterModelGrid, tide: str) -> None:
    """Map the velocity from links to nodes, where the ice reads it."""
    velocity = grid.at_link[f"{tide}_tide_flow__velocity"]
    for name, values in zip(
        VELOCITY, grid.map_link_vector_components_to_node(velocity), strict=True
    ):
        grid.at_node[name][:] = values


def main(folder: Path, tides: int = 1, concentration: float = 0.35) -> Found:
    """Make the run, the ledger of its last step, and the figure."""
    folder.mkdir(parents=True, exist_ok=True)
    grid, alone = lagoon(), lagoon()
    flow, flow_alone = (
        TidalFlowCalculator(g, tidal_range=1.5, roughness=0.03) for g in (grid, alone)
    )
    bed = grid.at_node["topographic__elevation"].reshape(SHAPE)
    x, y = grid.x_of_node.reshape(SHAPE), grid.y_of_node.reshape(SHAPE)
    coast = from_land_fraction(x[0], y[:, 0], (bed > 0).astype(float), radius=30.0)
    ocean, air = DRAG_PRESETS["constant-cd"]
    ice = SeaIceFloes(
        grid, concentration=concentration, thickness=0.4, sizes=(30.0, 70.0), coast=coast,
        contact=frictional(youngs_modulus=1e6), forces=(ocean, air, CoriolisField(), Tilt()), seed=2,
    )  # fmt: skip
    for name in VELOCITY:
        grid.at_node[name][:] = 0.0
    pictures = [_picture("start", ice, grid)]
    inside = set(np.flatnonzero(~ice.model.floes.land & (ice.model.floes.x < SPIT)))
    through: set[int] = set()
    for half in range(2 * tides):
        tide = ("ebb", "flood")[half % 2]
        for _ in range(STEPS):
            for calculator in (flow, flow_alone):
                calculator.run_one_step()
            give_water(grid, tide)
            ice.run_one_step(HALF_TIDE / STEPS)
            floes = ice.model.floes
            through |= inside & set(np.flatnonzero(floes.x > SPIT + 200.0))
        pictures.append(_picture(f"end of the {tide}", ice, grid))
    print(HEADER)
    print(ice.ledger[-1])
    print(f"ice outside all cells: {ice.area_outside:.4g} m²")
    _draw(folder / "tidal-lagoon.png", pictures[:3], grid)
    links = [f"{tide}_tide_flow__velocity" for tide in ("ebb", "flood")]
    return Found(
        max(line.relative for line in ice.ledger),
        len(through),
        all(np.array_equal(grid.at_link[name], alone.at_link[name]) for name in links),
        ice.area_outside,
    )


def _picture(title: str, ice: SeaIceFloes, grid: RasterModelGrid) -> tuple:
    floes = ice.model.floes
    keep = floes.active & ~floes.land
    speed = np.hypot(floes.u, floes.v)[keep]
    water = [grid.at_node[name].reshape(SHAPE).copy() for name in VELOCITY]
    return title, floes.x[keep], floes.y[keep], floes.radius[keep], speed, water


def _draw(path: Path, pictures: list[tuple], grid: RasterModelGrid) -> None:
    from matplotlib.collections import EllipseCollection

    x, y = (values.reshape(SHAPE) / 1e3 for values in (grid.x_of_node, grid.y_of_node))
    bed = grid.at_node["topographic__elevation"].reshape(SHAPE)
    with graph(14, 3.9) as figure:
        panels = figure.subplots(1, 3, sharey=True, sharex=True)
        fastest = max(picture[4].max() for picture in pictures)
        some = (slice(1, None, 2), slice(1, None, 3))
        for panel, (title, fx, fy, radius, speed, water) in zip(panels, pictures, strict=True):
            sea = panel.pcolormesh(x, y, -bed, cmap="Greys", vmin=0, vmax=12, rasterized=True)
            panel.contourf(x, y, bed, levels=[0, 10], colors=[LAND])
            ice = EllipseCollection(
                2 * radius / 1e3, 2 * radius / 1e3, 0 * radius, units="xy", offsets=np.c_[fx, fy] / 1e3,
                transOffset=panel.transData, cmap="viridis", ec="white", lw=0.2,
            )  # fmt: skip
            ice.set_array(speed)
            ice.set_clim(0, fastest)
            panel.add_collection(ice)
            moving = (bed[some] < 0) & (np.hypot(*(w[some] for w in water)) > 0.02)
            arrows = panel.quiver(
                *(values[some][moving] for values in (x, y, *water)), scale=3.0, width=3e-3, color="#d55e00",
                ec="white", lw=0.3, zorder=3,
            )  # fmt: skip
            panel.set(
                title=title, xlabel="x [km]", aspect="equal", xlim=(0, x.max()), ylim=(0, y.max())
            )
        panels[2].quiverkey(arrows, 0.72, -0.17, 0.3, "current 0.3 m/s", labelpos="E")
        panels[0].set_ylabel("y [km]")
        figure.colorbar(ice, ax=panels, label="speed of the ice [m/s]", aspect=30, pad=0.01)
        figure.colorbar(sea, ax=panels, label="depth of the water [m]", aspect=30, pad=0.01)
        figure.savefig(path, dpi=130)


if __name__ == "__main__":
    words = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    words.add_argument("--folder", type=Path, default=Path("tidal-lagoon"))
    words.add_argument("--tides", type=int, default=1)
    words.add_argument("--concentration", type=float, default=0.35)
    print(main(**vars(words.parse_args())))
