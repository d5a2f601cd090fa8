"""Each script in examples/ runs, in short, and gives the numbers that theory or the file's own data give."""

import csv
import importlib.util
import sys
from functools import cache
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import xarray as xr

ROOT = Path(__file__).parents[1]
REAL = ROOT.parent / "shared" / "data"
real = pytest.mark.skipif(not REAL.is_dir(), reason="the real files are not here")


@cache
def example(name: str) -> ModuleType:
    """The module of an example, loaded once: Veros takes its settings only once."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "examples" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("script", sorted((ROOT / "examples").glob("*.py")), ids=lambda p: p.name)
def test_no_example_is_without_a_test_and_a_line_in_the_docs(script):
    tests, docs = (
        "".join(path.read_text(encoding="utf-8") for path in files)
        for files in (
            (ROOT / "tests").glob("test_*.py"),
            (ROOT / "README.md", *(ROOT / "docs").glob("*.md")),
        )
    )
    assert f'"{script.stem}"' in tests or script.name in tests
    assert f"examples/{script.name}" in docs


@real
@pytest.mark.filterwarnings("ignore:.*set to the bound", "ignore:ice not placed")
def test_barents_sea_starts_from_the_files_ice_and_current_and_keeps_its_books(tmp_path, capsys):
    path = REAL / "arctic20_ocean_ice_20160201-05.nc"
    report = example("barents_sea").main(path, tmp_path, "mapping", days=0.25, radius=10e3)
    balance = report.ledger.balances
    assert max(balance[of].relative for of in ("mass", "momentum_x", "momentum_y")) < 1e-12
    assert balance["energy"].relative < 1e-3
    assert {"ocean drag", "wind", "Coriolis", "friction"} <= report.ledger.accounts.keys()
    assert str(report.ledger) in capsys.readouterr().out
    assert (tmp_path / "barents-sea.png").stat().st_size > 50_000

    with xr.open_dataset(path) as file, xr.open_dataset(tmp_path / "gridded.nc") as run:
        start, first = run.isel(time=0), file.isel(time=0)
        to = {"X": start.x / 1e3, "Y": start.y / 1e3}
        u, v = (first[of].isel(depth=0).interp(to) for of in "uv")
        water = np.isfinite(u.values) & np.isfinite(v.values)
        assert water.sum() > 900
        np.testing.assert_allclose(
            start.surface_sea_water_x_velocity.values[water], u.values[water], atol=1e-6
        )
        np.testing.assert_allclose(
            start.surface_sea_water_y_velocity.values[water], v.values[water], atol=1e-6
        )
        # volume of ice of 0.1 m or more, as much of it as discs hold
        volume, share = (first[of].sel(to, method="nearest") for of in ("hice", "aice"))
        ice = volume.where(volume > 0.1 * share, 0) * (0.85 / share.clip(min=1e-3)).clip(max=1)
        expected = 934 * 20e3**2 * float(ice.sum())
        assert report.ledger.start[0] == pytest.approx(expected, rel=0.05)
        wind = np.hypot(start.x_wind, start.y_wind)
        assert 14.5 < wind.max() <= 15.0 + 1e-9


def test_a_pack_in_a_box_drifts_as_one_floe_does_and_floes_aground_hold_it(tmp_path, capsys):
    box = example("drift_in_a_box")
    found = box.main(box.POINT, tmp_path, hours=24.0, radius=4e3, aground=4)
    printed = capsys.readouterr().out
    for _, report in found.values():
        balance = report.ledger.balances
        assert max(balance[of].relative for of in ("mass", "momentum_x", "momentum_y")) < 1e-12
        assert balance["energy"].relative < 2e-3
        assert str(report.ledger) in printed
    (pack, with_contacts), (alone, _), (held, _) = found.values()
    assert with_contacts.ledger.accounts["friction"][3] < 0  # its floes do meet
    np.testing.assert_allclose(pack.velocity, alone.velocity, atol=2e-3)
    assert np.abs(held.velocity).mean() < 0.97 * np.abs(alone.velocity).mean()

    with xr.open_dataset(box.POINT) as data:
        wind = (data.uwind + 1j * data.vwind).values[: len(alone.time)]
        current = (data.uoce + 1j * data.voce).values[: len(alone.time)]
        thickness = float(data.hice.mean())
    theory = box.steady(wind, current, thickness)
    # the balance of wind, water and Coriolis force, written out once more
    water = 1026 * 5.5e-3 * np.abs(current - theory) * (current - theory)
    air = 1.3 * 1.2e-3 * np.abs(wind - theory) * (wind - theory)
    turn = -1j * 934 * thickness * 2 * 7.2921e-5 * np.sin(np.radians(80.21)) * theory
    assert np.abs(water + air + turn).max() < 1e-9
    later = slice(6, None)  # from rest it takes some hours
    assert np.abs(alone.velocity - theory)[later].max() < 0.02  # inertia
    assert abs(alone.path[-1] - box.Drift(alone.time, theory).path[-1]) < 500.0
    # √(ρ_a C_a/ρ_o C_o) without Coriolis force, which takes a little and turns to the right
    a = box.wind_factor(alone.velocity[later], wind[later], current[later])
    assert 0.94 < abs(a) / np.sqrt(1.3 * 1.2e-3 / (1026 * 5.5e-3)) < 1
    assert -12 < np.angle(a, deg=True) < -2
    assert (
        f"one floe, free drift:        wind factor {abs(box.wind_factor(alone.velocity, wind, current)):.3%}"
        in printed
    )
    assert (tmp_path / "drift-in-a-box.png").stat().st_size > 30_000


@pytest.mark.long
@real
@pytest.mark.filterwarnings("ignore:.*set to the bound", "ignore:ice not placed")
def test_the_speeds_of_the_observed_floes_are_those_of_their_files(tmp_path, capsys):
    observations = example("observations")
    found = observations.main(REAL, tmp_path, hours=48.0, days=1.0, radius=1.5e3)
    floes, drifters, box, barents = found.values()
    with (REAL / "obs_framstrait_floe_trajectories_2014.csv").open(encoding="utf-8") as file:
        speed = [float(row["speed"]) for row in csv.DictReader(file) if row["speed"]]
    # the file's own speed is that to the next day
    assert np.median(floes) == pytest.approx(np.nanmedian(speed), rel=0.1)
    assert floes.size == 3861 and drifters.size == 49 and box.size == 2
    assert 0.05 < np.median(barents) < 0.4
    assert "observed radii: exponent -3.5 ± 0.1" in capsys.readouterr().out
    assert (tmp_path / "observations.png").stat().st_size > 30_000
