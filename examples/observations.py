"""Drift and sizes of floes beside those observed in Fram Strait and off East Greenland: distributions, not pairs.

The model's floes drift for 29 days in a box under the wind and current of one point north-east of Svalbard, and for four
days in the Barents Sea; the observed ones drifted elsewhere and at other times, and their wind is not known.  So only
speeds over a day, turns from day to day and sizes are compared; wind factor and turning angle are given for the model alone.

    python -m examples.observations DATA_FOLDER

writes observations.png and prints the table of docs/observations.md.
"""

import argparse
import csv
from pathlib import Path

import numpy as np
import xarray as xr
from pyproj import Proj

from examples import barents_sea, drift_in_a_box
from floebmi.plot import graph

DAY = 86400.0
Tracks = list[np.ndarray]  # complex positions x + i y [m], one a day


def in_plane(lon: np.ndarray, lat: np.ndarray) -> np.ndarray:
    """Positions in the plane of EPSG:3413 over its scale at that latitude, x + i y [m]."""
    plane = Proj("EPSG:3413")
    x, y = plane(lon, lat)
    middle = plane.get_factors(float(np.mean(lon)), float(np.mean(lat))).meridional_scale
    return (np.asarray(x) + 1j * np.asarray(y)) / middle


def fram_strait(path: Path) -> tuple[Tracks, np.ndarray]:
    """Tracks of each floe over consecutive days, and the radius of each (of a disc of the same area) [m]."""
    rows: dict[str, list[tuple[np.datetime64, float, float, float]]] = {}
    with path.open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            when = np.datetime64(row["datetime"])
            entry = (when, float(row["longitude"]), float(row["latitude"]), float(row["area_km2"]))
            rows.setdefault(row["floe_id"], []).append(entry)
    tracks, radii = [], []
    for floe in rows.values():
        when, lon, lat, area = (np.array(column) for column in zip(*sorted(floe), strict=True))
        radii.append(np.sqrt(np.median(area) / np.pi) * 1e3)
        days = np.diff(when) / np.timedelta64(1, "s") / DAY
        parts = np.split(np.arange(when.size), np.flatnonzero(np.abs(days - 1) > 0.01) + 1)
        tracks += [in_plane(lon[part], lat[part]) for part in parts if part.size > 1]
    return tracks, np.array(radii)


def east_greenland(path: Path) -> Tracks:
    """Positions of each drifter at whole days, where it sent one within three hours both before and after."""
    tracks = []
    with xr.open_dataset(path) as data:
        for k in range(data.sizes["trajectory"]):
            one = data.isel(trajectory=k).dropna("observation", subset=["time", "lon", "lat"])
            seconds = (one.time.values - one.time.values[0]) / np.timedelta64(1, "s")
            order = np.argsort(seconds)
            seconds, at = seconds[order], in_plane(one.lon.values[order], one.lat.values[order])
            days = np.arange(0.0, seconds[-1], DAY)
            after = np.searchsorted(seconds, days).clip(1, seconds.size - 1)
            near = np.maximum(seconds[after] - days, days - seconds[after - 1]) < 3 * 3600
            place = np.interp(days, seconds, at.real) + 1j * np.interp(days, seconds, at.imag)
            parts = np.split(np.arange(days.size), np.flatnonzero(~near))
            tracks += [place[part[near[part]]] for part in parts if near[part].sum() > 1]
    return tracks


def speeds(tracks: Tracks) -> np.ndarray:
    """Speeds from one day to the next [m/s]."""
    return np.concatenate([np.abs(np.diff(track)) / DAY for track in tracks])


def turns(tracks: Tracks) -> np.ndarray:
    """Angle between one day's displacement and the next [°]."""
    steps = [np.diff(track) for track in tracks if track.size > 2]
    return np.concatenate([np.abs(np.angle(s[1:] * s[:-1].conj(), deg=True)) for s in steps])


def slope(radii: np.ndarray, least: float) -> tuple[float, float]:
    """Exponent of a power law for the number density of radii above the least, and its standard error, by maximum
    likelihood (Clauset, Shalizi & Newman 2009, doi:10.1137/070710111, eq. 3.1)."""
    above = radii[radii >= least]
    alpha = 1 + above.size / np.log(above / least).sum()
    return -alpha, (alpha - 1) / np.sqrt(above.size)


def modelled(data: Path, folder: Path, hours: float, days: float, radius: float) -> tuple[dict[str, Tracks], complex, np.ndarray]:  # fmt: skip
    """Tracks of the model's floes, the wind factor of the pack in the box, and the radii in the Barents Sea [m]."""
    point = drift_in_a_box.POINT
    found = drift_in_a_box.main(point, folder / "box", hours=hours, radius=radius)
    pack = next(run for run, _ in found.values())
    with xr.open_dataset(point) as file:
        wind, current = ((file[f"u{of}"] + 1j * file[f"v{of}"]).values[: pack.time.size] for of in ("wind", "oce"))  # fmt: skip
    factor = drift_in_a_box.wind_factor(pack.velocity, wind, current)
    barents_sea.main(
        data / "arctic20_ocean_ice_20160201-05.nc", folder / "barents", "mapping", days, 4 * radius
    )
    with xr.open_dataset(folder / "barents" / "floes.nc", decode_times=False) as run:
        moves = (run.motion == 0).values
        whole = np.isclose(run.time.values % DAY, 0)
        place = (run.x + 1j * run.y).values[whole][:, moves]
        radii = run.radius.values[moves]
    tracks = [one[np.isfinite(one)] for one in place.T]
    return {
        "box at 80° N 37° E": [pack.path[::24]],
        "Barents Sea": [one for one in tracks if one.size > 1],
    }, factor, radii  # fmt: skip


def main(
    data: Path, folder: Path, hours: float = 695.0, days: float = 4.0, radius: float = 1e3
) -> dict[str, np.ndarray]:
    """Make the runs, the table and the picture; returns the speeds over a day of each source [m/s]."""
    folder.mkdir(parents=True, exist_ok=True)
    floes, radii = fram_strait(data / "obs_framstrait_floe_trajectories_2014.csv")
    drifters = east_greenland(data / "obs_icedrift_eastgreenland_201803.nc")
    ours, factor, made = modelled(data, folder, hours, days, radius)
    sources = {
        "observed: floes, Fram Strait": floes,
        "observed: drifters, East Greenland": drifters,
        **{f"model: {name}": tracks for name, tracks in ours.items()},
    }
    print(
        "\n| | days | speed 5 % | 50 % | 95 % | turn from day to day, median |\n|---|---|---|---|---|---|"
    )
    found = {name: speeds(tracks) for name, tracks in sources.items()}
    for name, tracks in sources.items():
        low, middle, high = np.percentile(found[name], (5, 50, 95))
        turn = np.median(turns(tracks)) if any(t.size > 2 for t in tracks) else np.nan
        print(
            f"| {name} | {found[name].size} | {low:.3f} | {middle:.3f} | {high:.3f} | {turn:.0f}° |"
        )
    least = float(np.median(radii))
    exponent, error = slope(radii, least)
    print(
        f"\nmodel, pack in the box: wind factor {abs(factor):.2%}, turning {np.angle(factor, deg=True):+.0f}°"
        f"\nobserved radii: exponent {exponent:.1f} ± {error:.1f} above their median, {least / 1e3:.1f} km"
    )
    draw(
        folder / "observations.png",
        found,
        {"observed: floes, Fram Strait": radii, "model: Barents Sea": made},
    )
    return found


def draw(to: Path, found: dict[str, np.ndarray], radii: dict[str, np.ndarray]) -> None:
    """Draw the share of days slower than a speed, and of floes larger than a radius."""
    with graph(9, 4) as figure:
        left, right = figure.subplots(1, 2)
        colors = {}
        for name, values in found.items():
            line = "-" if name.startswith("observed") else "--"
            share = (np.arange(values.size) + 0.5) / values.size
            (drawn,) = left.plot(np.sort(values), share, line, label=name)
            colors[name] = drawn.get_color()
        left.set(xlabel="speed over a day [m s⁻¹]", ylabel="share of days that are slower [1]", xlim=(0, None), ylim=(0, 1))  # fmt: skip
        left.legend(loc="lower right")
        for name, values in radii.items():
            line = "-" if name.startswith("observed") else "--"
            share = 1 - (np.arange(values.size) + 0.5) / values.size
            right.loglog(np.sort(values) / 1e3, share, line, color=colors[name], label=name)
        right.set(xlabel="radius [km]", ylabel="share of floes that are larger [1]")
        ticks = [2, 4, 10, 20]
        right.set_xticks(ticks, [str(tick) for tick in ticks])
        right.set_xticks([], minor=True)
        figure.savefig(to, dpi=130)


if __name__ == "__main__":
    words = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    words.add_argument("data", type=Path, help="folder of the files")
    words.add_argument("--folder", type=Path, default=Path("observations"))
    main(**vars(words.parse_args()))
