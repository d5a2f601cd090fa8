"""Svalbard and the Barents Sea in February: currents, ice and land of an ocean model, under a passing low.

The file, five daily means of MET Norway's ROMS in cells of 20 km, has all but the wind, which is prescribed here as
functions of position and time.  Its projected coordinates x, y and its longitudes and latitudes disagree by 17.8 km:
`--position` chooses, and "mapping" fits the real coast better.

    python examples/barents_sea.py arctic20_ocean_ice_20160201-05.nc

writes gridded.nc, floes.nc and a picture into the folder, and prints the ledger.
"""

import argparse
from pathlib import Path

import numpy as np

import floebmi as fb
from floebmi.coast import from_land_fraction
from floebmi.forces import DRAG_PRESETS
from floebmi.plot import frame
from floebmi.running import Report

PLANE = "+proj=stere +a=6371000 +b=6371000 +lat_0=90 +lat_ts=60 +lon_0=58"  # of the file's x, y
START = "2016-02-01 12:00"
THINNEST = 0.1  # thinner ice is no floe yet [m]


def from_low(x: np.ndarray, y: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position relative to a low that moves along y, in units of its radius of 400 km; and its wind per radius [m/s]."""
    dx, dy = (x + 450e3) / 400e3, (y + 1500e3 - 2.0 * t) / 400e3
    return dx, dy, 15.0 * np.exp(0.5 - 0.5 * (dx**2 + dy**2))


def wind_u(x: np.ndarray, y: np.ndarray, t: float) -> np.ndarray:
    """Wind along x [m/s]: it circles the low, with 15 m/s at its radius."""
    _, dy, wind = from_low(x, y, t)
    return -wind * dy


def wind_v(x: np.ndarray, y: np.ndarray, t: float) -> np.ndarray:
    """Wind along y [m/s]."""
    dx, _, wind = from_low(x, y, t)
    return wind * dx


def main(path: Path, folder: Path, position: str, days: float = 4.0, radius: float = 4e3) -> Report:
    """Run, write files and picture; radius : of the smallest floes [m]."""
    folder.mkdir(parents=True, exist_ok=True)
    domain = fb.Domain(x=(-980e3, -180e3), y=(-1360e3, -760e3))  # floes that leave are gone
    grid = fb.Grid.uniform(domain.x, domain.y, spacing=20e3)
    place = {"projection": PLANE, "position": position}

    land = fb.read_scalar(path, "land_fraction", grid, variable="mask", **place)
    rows = (values.reshape(grid.shape) for values in (grid.x, grid.y, land))
    coast = from_land_fraction(*rows, radius=8e3)
    grid = grid.with_wet(land < 0.5)

    place["fill_land"] = "nearest"  # what cells by the coast get: the nearest water of the file
    thickness = fb.read_scalar(path, "thickness", grid, **place)
    fraction = fb.read_scalar(path, "area_fraction", grid, **place)
    fraction[thickness < THINNEST] = 0.0
    sizes = fb.PowerLaw(radius, 2.5 * radius, exponent=-1.8)
    ice = fb.from_field(grid, fraction, thickness, sizes, domain, seed=1, land=coast)

    model = fb.Model(
        domain,
        fb.Floes.concatenate([ice, coast.floes]),
        contact=fb.frictional(friction=0.3, youngs_modulus=2e6),
        forces=[*DRAG_PRESETS["constant-cd"], fb.Coriolis(parameter=1.43e-4)],
        grid=grid,
    )
    print(model)
    report = fb.run(
        model, days * 86400.0,
        ocean=fb.VelocityFile(path, grid, start=START, **place),
        atmosphere=fb.Function(wind_u, wind_v, grid),
        exchange=3600.0, every=min(6.0, 24.0 * days) * 3600.0,
        gridded=folder / "gridded.nc", trajectories=folder / "floes.nc",
        attributes={"title": "Svalbard and the Barents Sea, a low passes"},
        reference=START, projection=PLANE, land=coast.polygons, overwrite=True, progress=True,
    )  # fmt: skip
    frame(folder / "floes.nc", folder / "gridded.nc", to=folder / "barents-sea.png", arrows="wind")
    print(report)
    return report


if __name__ == "__main__":
    words = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    words.add_argument("path", type=Path, help="arctic20_ocean_ice_20160201-05.nc")
    words.add_argument("--folder", type=Path, default=Path("barents-sea"))
    words.add_argument("--position", choices=("mapping", "lonlat"), default="mapping")
    words.add_argument("--days", type=float, default=4.0)
    main(**vars(words.parse_args()))
