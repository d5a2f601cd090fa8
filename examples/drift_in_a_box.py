"""A periodic box of pack ice for 29 days under the wind and current of one point: does it drift as one floe does?

Wind and current are the same everywhere, so contacts can only redistribute momentum among the floes (they do meet: the
Coriolis force deflects thick ones more).  Two more runs have some floes aground, which hold the pack, and one floe alone,
in free drift.

    python examples/drift_in_a_box.py [FILE]

reads hourly wind and current at one place (by default 29 days at 80° N 37° E, examples/gallery/drift_29_days.nc),
writes the floes and a picture into the folder, and prints the ledgers.  For each drift it also prints the complex number a
of the best fit  ice velocity = current + a × wind: |a| is the wind factor, its angle the turning angle.
"""

import argparse
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr

import floebmi as fb
from floebmi.floes import FIXED
from floebmi.forces import DRAG_PRESETS
from floebmi.plot import graph
from floebmi.running import Report

POINT = Path(__file__).parent / "gallery" / "drift_29_days.nc"
SIDE = 70e3  # of the box [m]
BOX = fb.Domain((0, SIDE), (0, SIDE), "periodic", "periodic", "periodic", "periodic")
SPREAD = 0.3  # standard deviation of the logarithm of thickness
OCEAN, AIR = DRAG_PRESETS["constant-cd"]
CORIOLIS = fb.Coriolis(2 * 7.2921e-5 * np.sin(np.radians(80.21)))
ICE_DENSITY = 934.0


class Drift(NamedTuple):
    """Velocities u + i v [m/s] at times [s] since the start, each of shape (n,)."""

    time: np.ndarray
    velocity: np.ndarray

    @property
    def path(self) -> np.ndarray:
        """Position of a point that drifts so, x + i y [m]."""
        steps = 0.5 * (self.velocity[1:] + self.velocity[:-1]) * np.diff(self.time)
        return np.concatenate([[0.0], np.cumsum(steps)])


def steady(wind: np.ndarray, current: np.ndarray, thickness: float) -> np.ndarray:
    """Free drift without inertia, where wind drag, water drag and Coriolis force balance [m/s]."""
    turn = 1j * CORIOLIS.parameter * ICE_DENSITY * thickness
    ice = current + 0.016 * wind
    for _ in range(100):
        water = OCEAN.density * OCEAN.horizontal * np.abs(ice - current)
        air = AIR.density * AIR.horizontal * np.abs(wind - ice)
        ice = 0.5 * ice + 0.5 * (air * wind + water * current) / (air + water + turn)
    return ice


def wind_factor(ice: np.ndarray, wind: np.ndarray, current: np.ndarray) -> complex:
    """The a of the best fit  ice = current + a × wind."""
    return complex(np.vdot(wind, ice - current) / np.vdot(wind, wind))


def drift(
    path: Path, to: Path, floes: fb.Floes, contact: fb.Contact | None, hours: float
) -> tuple[Drift, Report]:
    """Run floes in the box; returns the mass-weighted mean velocity of the free ones, every hour."""
    grid = fb.Grid.uniform(BOX.x, BOX.y, spacing=SIDE / 2)
    model = fb.Model(
        BOX, floes, contact=contact, forces=[OCEAN, AIR, CORIOLIS], grid=grid,
        ice_density=ICE_DENSITY,
    )  # fmt: skip
    report = fb.run(
        model, hours * 3600.0,
        ocean=fb.VelocityFile(path, grid),
        atmosphere=fb.VelocityFile(path, grid, kind="wind"),
        every=3600.0, trajectories=to, overwrite=True, progress=True,
    )  # fmt: skip
    with xr.open_dataset(to, decode_times=False) as run:
        mass = (run.radius**2 * run.thickness * (run.motion == 0)).values
        velocity = (run.u + 1j * run.v).values @ mass / mass.sum()
        return Drift(run.time.values, velocity), report


def draw(to: Path, drifts: dict[str, Drift]) -> None:
    """Draw the tracks, with a mark every week, and the speeds."""
    with graph(8, 7) as figure:
        tracks, speeds = figure.subplots(2, 1)
        looks = (("-", 3.0), ("--", 1.4), ("-", 1.4))
        for (name, run), (line, width) in zip(drifts.items(), looks, strict=True):
            km, days = run.path / 1000.0, run.time / 86400.0
            weeks = slice(None, None, 24 * 7)
            (track,) = tracks.plot(km.real, km.imag, line, lw=width, label=name)
            tracks.plot(km.real[weeks], km.imag[weeks], "o", ms=5, color=track.get_color())
            speeds.plot(days, np.abs(run.velocity), line, lw=0.7 * width, color=track.get_color())
        tracks.set(xlabel="to the east [km]", ylabel="to the north [km]", aspect="equal")
        tracks.set_title("Drift of the free floes, a mark each week")
        tracks.legend()
        speeds.set(xlabel="time [days]", ylabel="speed [m s⁻¹]", ylim=(0, None), xlim=(0, days[-1]))
        speeds.set_title("Their mean speed")
        figure.savefig(to, dpi=130)


def main(
    path: Path, folder: Path, hours: float = 695.0, radius: float = 1e3, aground: int = 10
) -> dict[str, tuple[Drift, Report]]:
    """Run the three drifts; radius : of the smallest floes [m]."""
    folder.mkdir(parents=True, exist_ok=True)
    data = xr.open_dataset(path)
    thickness = float(data.hice.mean())
    sizes = fb.PowerLaw(radius, 2.5 * radius, exponent=-1.8)
    pack = fb.scatter(BOX, sizes, concentration=0.7, seed=1)
    noise = np.random.default_rng(1).normal(size=len(pack))
    pack.thickness = thickness * np.exp(SPREAD * noise - 0.5 * SPREAD**2)
    held = pack.copy()
    held.motion = np.where(np.arange(len(held)) < aground, FIXED, 0)
    alone = fb.Floes(0.5 * SIDE, 0.5 * SIDE, radius, thickness)

    soft = fb.frictional(friction=0.3, youngs_modulus=2e6)
    found = {}
    for name, file, floes, contact in (
        (f"pack of {len(pack)} floes", "floes.nc", pack, soft),
        ("one floe, free drift", "one-floe.nc", alone, None),
        (f"pack, {aground} floes aground", "floes-aground.nc", held, soft),
    ):
        print(f"\n{name}: {floes}")
        found[name] = drift(path, folder / file, floes, contact, hours)
        print(found[name][1])

    n = round(hours) + 1
    wind, current = ((data[f"u{of}"] + 1j * data[f"v{of}"]).values[:n] for of in ("wind", "oce"))
    drifts = {name: run for name, (run, _) in found.items()}
    draw(folder / "drift-in-a-box.png", drifts)
    balance = Drift(3600.0 * np.arange(n), steady(wind, current, thickness))
    for name, run in {**drifts, "free drift without inertia": balance}.items():
        a, end = wind_factor(run.velocity, wind, current), run.path[-1] / 1000.0
        print(
            f"{name + ':':<28} wind factor {abs(a):.3%}, turning {np.angle(a, deg=True):+.1f}°, mean"
            f" speed {np.abs(run.velocity).mean():.4f} m/s, in all {end.real:.1f} km east, {end.imag:.1f}"
            " km north"
        )
    return found


if __name__ == "__main__":
    words = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    words.add_argument("path", type=Path, nargs="?", default=POINT)
    words.add_argument("--folder", type=Path, default=Path("drift-in-a-box"))
    words.add_argument("--hours", type=float, default=695.0, help="at most 695, the file's")
    words.add_argument("--aground", type=int, default=10, help="floes that hold the pack")
    main(**vars(words.parse_args()))
