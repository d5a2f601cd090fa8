"""Gridded fields, trajectories and restarts: what the model had is in the file, as CF has it, whole or not at all."""

import os
import signal
import subprocess
import sys
import tracemalloc
import warnings
from pathlib import Path
from types import SimpleNamespace

import netCDF4
import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings, strategies as st
from hypothesis.extra import numpy as stn
from netCDF4 import Dataset
from small_run import GRIDS, LAND, small_model, small_run

from floebmi import Contact, Domain, Floes, Grid, InputError, Model, Wall, cohesive, frictional
from floebmi.cf import define_projection
from floebmi.entries import checksum, entries_of
from floebmi.output import (
    GriddedWriter,
    TrajectoryWriter,
    _contact_sums,
    _global_attributes,
    open_file,
)
from floebmi.restarts import load_restart, save_restart
from floebmi.variables import FLOE_VARIABLES, VARIABLES, find

POLAR = "EPSG:3413"


def open_strictly(path, **how):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with xr.open_dataset(path, **how) as data:
            return data.load()


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return small_run(
        tmp_path_factory.mktemp("run"), projection=POLAR, reference="1979-01-15 12:00", land=LAND
    )


@pytest.fixture(scope="module")
def gridded(run):
    return open_strictly(run[0])


@pytest.fixture(scope="module")
def floes(run):
    return open_strictly(run[1])


# ---- gridded ----------------------------------------------------------------------------------


def test_xarray_finds_the_concentration_with_its_names_and_units(run, gridded):
    fraction = gridded.sea_ice_area_fraction
    assert fraction.dims == ("time", "y", "x")
    assert fraction.attrs["units"] == "1"
    assert fraction.attrs["standard_name"] == "sea_ice_area_fraction"
    model = run[2]
    expected = model.fields()["area_fraction"].reshape(model.grid.shape)
    wet = model.grid.wet.reshape(model.grid.shape)
    assert (fraction.values[-1][wet] == expected[wet]).all()


def test_every_field_stands_in_the_file_with_the_attributes_of_the_table(run, gridded):
    fields = set(run[2].fields())
    written = [row for row in VARIABLES if row.name in fields or row.file_name in gridded]
    assert len(written) >= 30
    for row in written:
        attributes = gridded[row.file_name].attrs
        assert attributes["units"] == row.units
        assert attributes["csdms_name"] == row.csdms
        assert attributes.get("standard_name") == row.cf
        assert attributes.get("comment", "") == row.positive
        assert attributes["cell_methods"] == row.mean


def test_the_file_says_over_what_its_numbers_are_means(gridded):
    mean = "area: mean"
    for name, told in (
        ("area_fraction", f"{mean} time: point"),
        ("thickness", f"{mean} where sea_ice time: point"),
        ("floe_count", "area: sum time: point"),
        ("mean_radius", f"{mean} (over floes) time: point"),
        ("ocean_stress_x", f"{mean} where sea_ice over all_area_types time: mean"),
        ("air_stress_x", f"{mean} where sea_ice over all_area_types time: mean"),
        ("wind_x", f"{mean} time: point"),
    ):
        assert gridded[find(name).file_name].attrs["cell_methods"] == told


def test_land_is_missing_and_open_water_has_no_thickness(run, gridded):
    dry = ~run[2].grid.wet.reshape(run[2].grid.shape)
    assert (gridded.land_mask.values == dry).all() and dry.any()
    fraction, thickness = gridded.sea_ice_area_fraction.values, gridded.sea_ice_thickness.values
    assert np.isnan(fraction[:, dry]).all() and np.isfinite(fraction[:, ~dry]).all()
    assert (np.isfinite(thickness) == (fraction > 0)).all()
    assert (fraction[:, ~dry] == 0).any()


def test_stress_times_area_times_time_is_the_impulse_that_the_ocean_got(run, gridded):
    model = run[2]
    span = np.diff(gridded.time_bnds.values, axis=1)[:, 0] / np.timedelta64(1, "s")
    assert (span == [0, 100, 100, 100]).all()
    for name, area, fluid in (
        ("downward_{}_stress_at_sea_ice_base", model.ocean.grid.area, model.ocean),
        ("surface_downward_{}_stress", model.atmosphere.grid.area, model.atmosphere),
    ):
        for axis in "xy":
            stress = gridded[name.format(axis)].values[1:].reshape(3, -1)
            impulse = np.nansum(stress * area * span[1:, None])
            sign = 1.0 if fluid is model.ocean else -1.0
            assert impulse == pytest.approx(
                sign * getattr(fluid, f"impulse_{axis}").sum(), rel=1e-12
            )


def test_the_stress_of_the_last_exchange_alone_would_not_give_the_impulse(run):
    model = run[2]
    last = model.fields()["ocean_stress_y"]
    mean = model.fields()["ocean_impulse_y"] / model.time
    assert not np.allclose(last, mean, rtol=0.01)


def test_stress_per_ice_area_times_the_concentration_is_the_mean_stress_of_the_frame(gridded):
    ice = gridded.sea_ice_area_fraction + gridded[find("overlap_fraction").file_name]
    for axis in "xy":
        row = find(f"ocean_stress_per_ice_area_{axis}")
        per_ice, per_cell = (
            gridded[row.file_name],
            gridded[f"downward_{axis}_stress_at_sea_ice_base"],
        )
        there = (ice > 0) & (gridded.time > gridded.time[0])
        assert (np.isfinite(per_ice) == there).all() and there.any()
        np.testing.assert_allclose(
            (per_ice * ice).values[there], per_cell.values[there], rtol=1e-12
        )
        told = per_ice.attrs["cell_methods"]
        assert (
            told == "area: mean where sea_ice time: mean (comment: over the area of ice at the end)"
        )


def test_stress_is_missing_where_no_time_has_passed(gridded):
    assert np.isnan(gridded.downward_x_stress_at_sea_ice_base.values[0]).all()


def test_dates_are_those_of_the_reference(gridded, floes):
    expected = np.datetime64("1979-01-15T12:00") + np.arange(4) * np.timedelta64(100, "s")
    assert (gridded.time.values == expected).all()
    assert (floes.time.values == expected).all()
    for data in (gridded, floes):
        assert (
            data.time.attrs["units_metadata"] == "leap_seconds: none"
        )  # of the standard calendar alone
        assert [data[name].attrs["axis"] for name in ("time", "x", "y")] == ["T", "X", "Y"]


def test_latitude_and_longitude_are_those_of_the_projection(run, gridded, floes):
    import pyproj

    to_globe = pyproj.Transformer.from_crs(POLAR, "EPSG:4326", always_xy=True)
    x, y = np.meshgrid(gridded.x, gridded.y)
    longitude, latitude = to_globe.transform(x, y)
    np.testing.assert_allclose(gridded.latitude, latitude, rtol=0, atol=1e-9)
    np.testing.assert_allclose(gridded.longitude, longitude, rtol=0, atol=1e-9)
    longitude, latitude = to_globe.transform(floes.x.values[0], floes.y.values[0])
    np.testing.assert_allclose(floes.latitude[0], latitude, rtol=0, atol=1e-9)
    for data in (gridded, floes):
        for name, units in (("longitude", "degrees_east"), ("latitude", "degrees_north")):
            attributes = data[name].attrs
            assert (attributes["units"], attributes["standard_name"]) == (units, name)
    assert pyproj.CRS.from_cf(gridded.crs.attrs) == pyproj.CRS(POLAR)
    assert gridded.sea_ice_thickness.attrs["grid_mapping"] == "crs"
    for data in (gridded, floes):
        land = data.land_polygons
        assert (land.attrs | land.encoding)["grid_mapping"] == "crs"
    assert gridded.crs.attrs["latitude_of_projection_origin"] == 90.0


@pytest.mark.parametrize(
    "projection, name",
    [
        ("EPSG:3408", "lambert_azimuthal_equal_area"),  # EASE grid: on a sphere
        ("+proj=laea +lat_0=78 +lon_0=-5 +R=6371229 +x_0=7", "lambert_azimuthal_equal_area"),
        ("+proj=eqc +R=6371000", None),  # no projection of CF
    ],
)
def test_projections_on_a_sphere_and_those_that_cf_does_not_know_are_written(
    tmp_path, projection, name
):
    import pyproj

    gridded, _, _ = small_run(tmp_path, frames=1, projection=projection)
    attributes = open_strictly(gridded).crs.attrs
    assert attributes.get("grid_mapping_name") == name
    wkt = attributes.pop("crs_wkt")
    readings = [pyproj.CRS.from_wkt(wkt)] + ([pyproj.CRS.from_cf(attributes)] if name else [])
    for reading in readings:
        back = pyproj.Transformer.from_crs(reading, projection, always_xy=True)
        np.testing.assert_allclose(back.transform(3e5, -2e5), (3e5, -2e5), atol=1e-6)


@pytest.mark.parametrize("projection, pole", [("EPSG:3413", 90.0), ("EPSG:3031", -90.0)])
def test_a_polar_stereographic_plane_tells_its_pole(tmp_path, projection, pole):
    with Dataset(tmp_path / "in memory.nc", "w", diskless=True) as data:
        define_projection(data, projection)
        assert data["crs"].latitude_of_projection_origin == pole


def test_attributes_tell_what_made_the_file(run, gridded, floes):
    for data in (gridded, floes):
        assert data.attrs["Conventions"].startswith("CF-1.11")
        assert data.attrs["title"] == "A small run"
        assert data.attrs["seed"] == run[2].seed
        assert data.attrs["contact"] == repr(run[2].contact)
        assert "OceanDrag" in data.attrs["forces"]
        assert data.attrs["domain_west"] == "inactive"
    domain = Domain((0.0, 100.0), (0.0, 100.0))
    other = Model(domain, Floes(50.0, 50.0, 10.0, 1.0), ice_density=900.0, seed=7)
    told = _global_attributes(other, None, "gridded")
    assert (told["ice_density"], told["seed"]) == (900.0, 7)


@pytest.mark.parametrize("seed", [2**63 - 1, 2**64, 2**127 + 1])
def test_a_seed_may_be_longer_than_the_numbers_of_netcdf(tmp_path, seed):
    model = Model(Domain((0.0, 100.0), (0.0, 100.0)), Floes(50.0, 50.0, 10.0, 1.0), seed=seed)
    with TrajectoryWriter(tmp_path / "floes.nc", model) as writer:
        writer.write(model)
    with xr.open_dataset(tmp_path / "floes.nc") as data:
        assert int(data.attrs["seed"]) == seed


def test_land_with_a_lake_is_written_as_cf_polygons(tmp_path):
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    rings = [6e3 * square, 1e3 + 2e3 * square]  # both counter-clockwise
    gridded, _, _ = small_run(tmp_path, frames=1, land=rings)
    data = open_strictly(gridded)
    container = data.land_polygons.attrs
    assert container["geometry_type"] == "polygon"
    assert list(data[container["interior_ring"]].values) == [0, 1]
    ends = np.cumsum(data[container["part_node_count"]].values)
    assert data[container["node_count"]].values.sum() == ends[-1] == data.land_x.size

    def area(part):
        x, y = data.land_x.values[part], data.land_y.values[part]
        return 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))

    assert area(slice(0, ends[0])) == pytest.approx(36e6)
    assert area(slice(ends[0], ends[1])) == pytest.approx(-4e6)


@pytest.mark.parametrize("kind", GRIDS)
def test_each_kind_of_grid_can_be_rebuilt_from_its_file(tmp_path, kind):
    model = small_model(GRIDS[kind]())
    path = tmp_path / "a.nc"
    with GriddedWriter(path, model, projection=POLAR) as writer:
        writer.write(model)
    data = open_strictly(path, mask_and_scale=False)
    if kind == "unstructured":
        first = data.face_nodes.start_index
        again = Grid.unstructured(data.node_x, data.node_y, data.face_nodes.values - first)
        assert data.sea_ice_area_fraction.attrs["mesh"] in data
    elif kind == "curvilinear":
        x, y = data.x_bnds.values, data.y_bnds.values
        assert x.shape == (*model.grid.shape, 4)
        area = 0.5 * np.sum(x * np.roll(y, -1, -1) - y * np.roll(x, -1, -1), axis=-1)
        np.testing.assert_allclose(area, data.cell_area, rtol=1e-12)
        assert data.cell_area.units == "m2"
        again = model.grid
    else:
        edges = [
            np.append(data[b].values[:, 0], data[b].values[-1, 1]) for b in ("x_bnds", "y_bnds")
        ]
        again = Grid.rectilinear(*edges)
    np.testing.assert_allclose(again.area, data.cell_area.values.ravel(), rtol=1e-12)
    assert data.sea_ice_area_fraction.shape == (1, *model.grid.shape)
    assert open_strictly(path, decode_coords="all").sea_ice_thickness.coords.keys() >= {"latitude"}


def triangle_and_square():
    x, y = [0, 16e3, 16e3, 0, 20e3], [0, 0, 16e3, 16e3, 8e3]
    return Grid.unstructured(x, y, [[1, 4, 2, -1], [0, 1, 2, 3]])


@pytest.mark.parametrize("make", [*GRIDS.values(), triangle_and_square])
def test_latitude_and_longitude_have_the_corners_of_the_cells_as_bounds(tmp_path, make):
    import pyproj

    model = small_model(make(), atmosphere_grid=make())
    path = tmp_path / "a.nc"
    with GriddedWriter(path, model, projection=POLAR) as writer:
        writer.write(model)
    data = open_strictly(path)
    to_plane = pyproj.Transformer.from_crs("EPSG:4326", POLAR, always_xy=True)
    for suffix in ("", "_atmosphere"):
        corners = []
        for name in ("longitude", "latitude"):
            bounds = data[data[name + suffix].attrs["bounds"]]
            assert bounds.dims == (*data[f"cell_area{suffix}"].dims, f"corner{suffix}")
            corners.append(bounds.values)
        x, y = to_plane.transform(*corners)
        area = 0.5 * np.sum(x * np.roll(y, -1, -1) - y * np.roll(x, -1, -1), axis=-1)
        np.testing.assert_allclose(area, data[f"cell_area{suffix}"], rtol=1e-6)


def test_an_atmosphere_grid_of_its_own_has_its_own_dimensions(tmp_path):
    wind_grid = Grid.uniform((-1e3, 21e3), (-1e3, 17e3), shape=(3, 4))
    model = small_model(atmosphere_grid=wind_grid)
    path = tmp_path / "a.nc"
    with GriddedWriter(path, model) as writer:
        writer.write(model)
    data = open_strictly(path)
    assert data.x_wind.dims == ("time", "y_atmosphere", "x_atmosphere")
    assert data.x_wind.shape == (1, 3, 4)
    assert data.surface_sea_water_x_velocity.dims == ("time", "y", "x")
    np.testing.assert_allclose(data.cell_area_atmosphere.values.ravel(), wind_grid.area)


def test_only_the_variables_asked_for_are_written(tmp_path):
    model = small_model()
    with GriddedWriter(tmp_path / "a.nc", model, names=["thickness", "wind_x"]) as writer:
        writer.write(model)
    data = open_strictly(tmp_path / "a.nc")
    assert {"sea_ice_thickness", "x_wind"} <= set(data)
    assert "sea_ice_area_fraction" not in data


def test_a_run_without_a_date_says_so_and_opens_all_the_same(tmp_path):
    _, trajectories, _ = small_run(tmp_path, frames=2)
    time = open_strictly(trajectories).time
    assert time.attrs["epoch"] == "arbitrary"
    assert np.diff(time.values) == np.timedelta64(100, "s")


def test_other_calendars_are_kept(tmp_path):
    gridded, _, _ = small_run(tmp_path, frames=2, reference="1979-02-28", calendar="noleap")
    assert open_strictly(gridded).time.dt.calendar == "noleap"


# ---- trajectories -----------------------------------------------------------------------------


def test_trajectories_are_cf_features(floes):
    assert floes.attrs["featureType"] == "trajectory"
    assert floes.trajectory.attrs["cf_role"] == "trajectory_id"
    assert list(floes.trajectory.values) == list(range(18))
    assert floes.u.dims == ("time", "trajectory")
    assert {"time", "x", "y", "latitude", "longitude"} <= set(floes.u.coords)


def test_the_last_frame_is_the_state_to_the_last_bit(run, floes):
    model = run[2]
    there = model.floes.active
    for name in ("x", "y", "u", "v", "angle", "angular_velocity"):
        assert (floes[name].values[-1][there] == getattr(model.floes, name)[there]).all(), name
    for name in ("radius", "thickness", "motion"):
        assert floes[name].dims == ("trajectory",)
        assert (floes[name].values == getattr(model.floes, name)).all()


def test_floes_are_missing_before_they_come_and_after_they_left(floes):
    assert np.isfinite(floes.x.values[:, 1]).all()
    assert list(np.isfinite(floes.x.values[:, 0])) == [True, False, False, False]
    assert list(np.isfinite(floes.x.values[:, 17])) == [False, False, False, True]
    assert np.isfinite(floes.radius.values).all()
    assert (np.isfinite(floes.contact_count.values) == np.isfinite(floes.x.values)).all()


def test_contacts_of_each_floe_are_counted_and_their_forces_summed(floes):
    count = floes.contact_count.values[0, :16]
    assert list(np.flatnonzero(count == 1)) == [5, 6] and (np.delete(count, [5, 6]) == 0).all()
    force = floes.contact_force.values[0]
    stiffness = 2e7 * floes.thickness.values[5]
    assert force[5] == force[6] == pytest.approx(stiffness * 1.0, rel=1e-9)  # they overlap by 1 m
    radius = floes.radius.values[5:7]
    arm_and_volume = (radius - 0.5) / (np.pi * radius**2 * floes.thickness.values[5:7])
    assert floes.pressure.values[0, 5:7] == pytest.approx(0.5 * force[5] * arm_and_volume)
    assert (np.delete(floes.pressure.values[0, :16], [5, 6]) == 0).all()


def test_bonds_of_each_floe_are_counted():
    """Of three contacts in a row of four floes one is no bond."""
    one = np.ones(3)
    pairs = SimpleNamespace(
        i=np.arange(3), j=np.arange(1, 4), fx=one, fy=one, dx=one, dy=one, overlap=0 * one,
        bonded=np.array([True, True, False]),
    )  # fmt: skip
    floes = Floes(np.arange(4) * 20.0, 0.0, 10.0, 1.0)
    model = SimpleNamespace(floes=floes, contact=cohesive(), contacts=lambda: pairs)
    sums = _contact_sums(model)
    assert sums["bond_count"].tolist() == [1, 2, 1, 0]
    assert sums["contact_count"].tolist() == [1, 2, 2, 1]


def test_types_are_those_of_the_table_also_where_nothing_touches_at_first(tmp_path):
    model = small_model()
    model.floes.x[6] += 100.0
    _, trajectories, _ = small_run(tmp_path, model, frames=2)
    raw = open_strictly(trajectories, mask_and_scale=False)
    assert (raw.contact_count.values[0, :16] == 0).all()
    for row in FLOE_VARIABLES:
        if row.name in raw:
            assert raw[row.name].dtype == row.dtype, row.name


def test_a_constant_property_that_changes_is_refused(tmp_path):
    model = small_model()
    with TrajectoryWriter(tmp_path / "a.nc", model) as writer:
        writer.write(model)
        model.advance(10.0)
        model.floes.thickness[3] = 7.0
        with pytest.raises(InputError, match=r"thickness of floe 3 has changed.*changing"):
            writer.write(model)
    assert open_strictly(tmp_path / "a.nc").time.size == 1


def test_a_property_that_is_said_to_change_gets_a_time_dimension(tmp_path):
    model = small_model()
    with TrajectoryWriter(tmp_path / "a.nc", model, changing=["thickness"]) as writer:
        writer.write(model)
        model.advance(10.0)
        model.floes.thickness[3] = 7.0
        writer.write(model)
    thickness = open_strictly(tmp_path / "a.nc").thickness
    assert thickness.dims == ("time", "trajectory")
    assert thickness.values[1, 3] == 7.0 and thickness.values[0, 3] != 7.0


@pytest.mark.parametrize("n", [0, 1])
def test_a_model_of_hardly_any_floes_makes_valid_files(tmp_path, n):
    like = small_model()
    floes = Floes(np.full(n, 5e3), np.full(n, 5e3), 100.0, 1.0)
    model = Model(like.domain, floes, like.contact, like.forces, like.grid)
    gridded, trajectories, _ = small_run(tmp_path, model, frames=2)
    assert open_strictly(trajectories).sizes["trajectory"] == n + 2
    assert open_strictly(gridded).sea_ice_area_fraction.sizes["time"] == 2


# ---- ledger -----------------------------------------------------------------------------------


def test_the_ledger_stands_in_both_files(run, gridded, floes):
    ledger = run[2].ledger
    for data in (gridded, floes):
        assert list(data.ledger_account.values) == list(ledger.accounts)
        for account, row in ledger.accounts.items():
            assert (data.ledger_gained.sel(ledger_account=account).values[-1] == row).all()
        assert (data.ledger_stock.values[-1] == ledger.now).all()


# ---- safety of files --------------------------------------------------------------------------


def test_an_existing_file_is_refused_and_left_alone(tmp_path):
    path = tmp_path / "a.nc"
    path.write_text("precious")
    for writer in (GriddedWriter, TrajectoryWriter):
        with pytest.raises(InputError, match="exists already"):
            writer(path, small_model())
    assert path.read_text() == "precious"


def test_overwriting_waits_for_a_whole_first_frame(tmp_path):
    path = tmp_path / "a.nc"
    path.write_text("precious")
    model = small_model()
    writer = GriddedWriter(path, model, overwrite=True)
    assert path.read_text() == "precious"
    broken = model.ledger
    del model._state.ledger  # the last thing that a frame needs
    with pytest.raises(AttributeError):
        writer.write(model)
    assert path.read_text() == "precious"
    assert list(tmp_path.iterdir()) == [path]
    model._state.ledger = broken
    writer.write(model)
    writer.close()
    assert open_strictly(path).time.size == 1


@pytest.mark.parametrize(
    "how, message",
    [
        ({"reference": "yesterday"}, "reference = 'yesterday': not a date of"),
        ({"reference": "1979-01-15 12"}, "reference = '1979-01-15 12': not a date of"),
        ({"projection": "EPSG:0"}, "projection = 'EPSG:0'"),
        ({"projection": "EPSG:4326"}, "projection = 'EPSG:4326'.*metres"),
        ({"attributes": {"laws": [1, {}]}}, "attribute 'laws'.*text or a number"),
        ({"attributes": {"Conventions": "mine"}}, "attribute 'Conventions'"),
        ({"land": [np.zeros((2, 2))]}, r"polygon 0 has shape \(2, 2\)"),
    ],
)
def test_unusable_words_are_refused_in_one_line_before_a_file_is_made(tmp_path, how, message):
    for writer in (GriddedWriter, TrajectoryWriter):
        with pytest.raises(InputError, match=message) as error:
            writer(tmp_path / "a.nc", small_model(), **how)
        assert "\n" not in str(error.value)
    assert not list(tmp_path.iterdir())


def test_unknown_names_and_folders_are_refused(tmp_path):
    model = small_model()
    with pytest.raises(InputError, match="'thickess'.*did you mean 'thickness'"):
        GriddedWriter(tmp_path / "a.nc", model, names=["thickess"])
    with pytest.raises(InputError, match="changing = 'radus'.*did you mean 'radius'"):
        TrajectoryWriter(tmp_path / "a.nc", model, changing=["radus"])
    with pytest.raises(InputError, match="there is no folder"):
        TrajectoryWriter(tmp_path / "no" / "a.nc", model)
    with pytest.raises(InputError, match="is a folder"):
        TrajectoryWriter(tmp_path, model)


def test_time_must_go_on(tmp_path):
    model = small_model()
    with TrajectoryWriter(tmp_path / "a.nc", model) as writer:
        writer.write(model)
        with pytest.raises(InputError, match=r"frame at 0.0 s, but the last is at 0.0 s"):
            writer.write(model)
    with pytest.raises(InputError, match="already closed"):
        writer.write(model)


def test_a_file_can_be_read_while_it_is_written(tmp_path):
    model = small_model()
    with TrajectoryWriter(tmp_path / "a.nc", model) as writer:
        for frames in (1, 2):
            writer.write(model)
            code = (
                "from floebmi.output import open_file\n"
                f"with open_file({str(writer.path)!r}, 'trajectories') as data:\n"
                "    print(len(data['time']), float(data['x'][-1, 5]))"
            )
            done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
            assert done.stdout.split() == [str(frames), repr(float(model.floes.x[5]))], done.stderr
            model.advance(10.0)


def test_a_file_that_is_being_written_need_not_fit_into_memory(tmp_path, monkeypatch):
    path, real, size = tmp_path / "a.nc", netCDF4.Dataset, 20_000_000
    with TrajectoryWriter(path, small_model()) as writer:
        writer.write(small_model())
    os.truncate(path, size)  # HDF5 does not mind what comes after its end

    def locked(name):
        if name == path:
            raise OSError("HDF error")
        return real(name)

    monkeypatch.setattr(netCDF4, "Dataset", locked)
    tracemalloc.start()
    try:
        with open_file(path, "trajectories") as data:
            assert len(data["time"]) == 1
        assert tracemalloc.get_traced_memory()[1] < 0.5 * size
    finally:
        tracemalloc.stop()


KILLED = """
import sys
from types import SimpleNamespace as Stub
import numpy as np
from floebmi.boundaries import Domain
from floebmi.budgets import Ledger
from floebmi.floes import Floes
from floebmi.output import TrajectoryWriter
n = 5000
model = Stub(
    domain=Domain((0.0, 1.0), (0.0, 1.0)), floes=Floes(np.zeros(n), 0.0, 1.0, 1.0), time=0.0, seed=0,
    contact=None, forces=(), step=None, ice_density=900.0, ledger=Ledger(), grid=None, wall_edges=(),
)
with TrajectoryWriter(sys.argv[1], model, contacts=False) as writer:
    while True:
        writer.write(model)
        print(model.time, flush=True)
        model.floes.x[:] += 1.0
        model.time += 1.0
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")
@pytest.mark.parametrize(
    ("kind", "writer", "name"),
    [("gridded", GriddedWriter, "sea_ice_thickness"), ("trajectories", TrajectoryWriter, "u")],
)
def test_a_long_series_does_not_stay_in_memory(tmp_path, kind, writer, name):
    """By default HDF5 keeps 64 MB of each variable."""
    x, y = np.meshgrid(np.arange(80.0), np.arange(60.0))
    floes = Floes(x.ravel(), y.ravel(), 0.4, 1.0)
    grid = Grid.uniform((0, 80), (0, 60), spacing=1.0)
    model = Model(Domain((-1.0, 80.0), (-1.0, 60.0)), floes, grid=grid)
    path = tmp_path / "a.nc"
    with writer(path, model) as file:
        file.write(model)
        kept = [file._data[one].get_var_chunk_cache()[0] for one in (name, "ledger_stock")]
    with open_file(path, kind) as data:
        kept.append(data[name].get_var_chunk_cache()[0])
    assert max(kept) <= 2**20


def test_a_killed_run_leaves_a_file_with_all_its_frames(tmp_path):
    path = tmp_path / "a.nc"
    child = subprocess.Popen([sys.executable, "-c", KILLED, str(path)], stdout=subprocess.PIPE)
    for _ in range(12):
        child.stdout.readline()
    child.kill()
    seen = 12 + len(child.stdout.read().splitlines())
    child.wait()
    data = open_strictly(path)
    assert seen <= data.time.size <= seen + 1
    assert (data.x.values[:seen] == np.arange(seen)[:, None]).all()
    assert list(tmp_path.iterdir()) == [path]


def test_what_is_not_a_file_of_ours_is_refused_in_one_line(tmp_path, run):
    with pytest.raises(InputError, match="no such file"), open_file(tmp_path / "no.nc", "gridded"):
        pass
    text = tmp_path / "text.nc"
    text.write_text("no NetCDF")
    with pytest.raises(InputError, match="no NetCDF file"), open_file(text, "gridded"):
        pass
    with Dataset(tmp_path / "other.nc", "w"):
        pass
    message = "must be 'gridded 1'"
    with pytest.raises(InputError, match=message), open_file(tmp_path / "other.nc", "gridded"):
        pass
    with pytest.raises(InputError, match="is 'trajectories 1'"), open_file(run[1], "gridded"):
        pass
    save_restart(tmp_path / "restart.nc", {"a": 1.0})
    message = "is 'a restart file'; must be 'gridded 1'"
    with pytest.raises(InputError, match=message), open_file(tmp_path / "restart.nc", "gridded"):
        pass


# ---- restart ----------------------------------------------------------------------------------


def identical(one, other):
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(identical(one[k], other[k]) for k in one)
    if isinstance(one, np.ndarray):
        same_kind = one.dtype == other.dtype and one.shape == other.shape
        return same_kind and one.tobytes() == other.tobytes()
    if isinstance(one, float):
        return type(other) is float and np.float64(one).tobytes() == np.float64(other).tobytes()
    return type(one) is type(other) and one == other


kinds = ["f8", "f4", "i8", "i4", "i1", "u8", "u4", "?"]
arrays = st.sampled_from(kinds).flatmap(
    lambda kind: stn.arrays(kind, stn.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4))
)
texts = st.text(st.characters(codec="utf-8"), max_size=9)
leaves = st.one_of(
    arrays, texts, st.binary(max_size=9), st.integers(), st.floats(), st.booleans(), st.none()
)
names = st.text("abcXYZ_09", min_size=1, max_size=5).map(lambda name: "k" + name)
states = st.dictionaries(
    names, st.one_of(leaves, st.dictionaries(names, leaves, max_size=3)), max_size=5
)


@settings(max_examples=20, deadline=None)
@given(states)
def test_a_state_comes_back_to_the_last_bit(tmp_path_factory, state):
    path = tmp_path_factory.mktemp("restart") / "a.nc"
    save_restart(path, state, {"scene": "ünï = 1\n"})
    again, attributes = load_restart(path)
    assert identical(again, state)
    assert attributes["scene"] == "ünï = 1\n"


def test_a_restart_file_says_what_made_it_and_when_unless_it_is_told(tmp_path):
    save_restart(tmp_path / "a.nc", {"a": 1.0})
    save_restart(tmp_path / "b.nc", {"a": 1.0}, {"title": "a strait", "number": 3})
    (_, told), (_, own) = (load_restart(tmp_path / name) for name in ("a.nc", "b.nc"))
    assert told["source"] == own["source"] == f"floebmi {told['floebmi_version']}"
    assert told["source"] in told["history"] and told["title"].startswith("State of")
    assert (own["title"], own["number"]) == ("a strait", 3)


def test_a_restart_file_of_before_without_these_attributes_is_read(tmp_path):
    path = tmp_path / "a.nc"
    save_restart(path, {"a": 1.5, "b": np.arange(3)})
    with Dataset(path, "a") as data:
        for name in ("title", "source", "history"):
            data.delncattr(name)
        data.checksum = checksum(
            entries_of({"a": 1.5, "b": np.arange(3)}), {"floebmi_version": data.floebmi_version}
        )
    state, told = load_restart(path)
    assert identical(state, {"a": 1.5, "b": np.arange(3)}) and list(told) == ["floebmi_version"]


@pytest.mark.parametrize("name", ["floebmi_restart", "checksum"])
def test_an_attribute_that_the_writer_of_a_restart_file_sets_is_refused(tmp_path, name):
    with pytest.raises(InputError, match=f"attribute '{name}': is set by save_restart"):
        save_restart(tmp_path / "a.nc", {}, {name: 1})
    assert not list(tmp_path.iterdir())


def test_texts_in_arrays_and_states_of_random_generators_come_back(tmp_path):
    state = {
        "accounts": np.array(["wind", "ocean drag"]),
        "none": np.zeros(0, np.str_),
        "rng": np.random.PCG64(3).state,
        "payload": np.array([0x7FF8000000000123], np.uint64).view(np.float64),
    }
    save_restart(tmp_path / "a.nc", state)
    again, _ = load_restart(tmp_path / "a.nc")
    assert identical(again, state)


def test_a_run_goes_on_from_its_file_with_the_same_bits(tmp_path):
    straight, stopped = small_model(), small_model()
    straight.advance(50.0)
    straight.advance(50.0)
    stopped.advance(50.0)
    save_restart(tmp_path / "a.nc", stopped.state())
    resumed = small_model()
    resumed.restore(load_restart(tmp_path / "a.nc")[0])
    resumed.advance(50.0)
    assert identical(resumed.state(), straight.state())
    for name in ("x", "u", "angle"):
        assert (getattr(resumed.floes, name) == getattr(straight.floes, name)).all()


def test_a_truncated_or_altered_restart_file_is_refused_or_harmless(tmp_path):
    state = {"a": np.random.default_rng(1).normal(size=(500, 3)), "b": np.arange(500), "c": "text"}
    path = tmp_path / "a.nc"
    save_restart(path, state)
    raw = path.read_bytes()
    rng = np.random.default_rng(2)
    refused = 0
    spoilt = [raw[: int(n)] for n in rng.integers(0, len(raw), 20)]
    for place in rng.integers(0, len(raw), 60):
        altered = bytearray(raw)
        altered[place] ^= 0x55
        spoilt.append(bytes(altered))
    for content in spoilt:
        path.write_bytes(content)
        try:
            again, _ = load_restart(path)
        except InputError as error:
            assert "\n" not in str(error)
            refused += 1
        else:
            assert identical(again, state)
    assert refused > 40


def test_a_restart_file_of_another_version_is_refused(tmp_path):
    path = tmp_path / "a.nc"
    save_restart(path, {"a": 1.0})
    with Dataset(path, "a") as data:
        data.floebmi_restart = np.int32(99)
    with pytest.raises(InputError, match="version 99; this floebmi reads 1"):
        load_restart(path)
    with pytest.raises(InputError, match="no such restart file"):
        load_restart(tmp_path / "b.nc")


def test_a_save_that_fails_leaves_the_older_restart_file(tmp_path, monkeypatch):
    path = tmp_path / "a.nc"
    save_restart(path, {"a": 1.0})
    with pytest.raises(InputError, match="b is object: cannot be saved|b is"):
        save_restart(path, {"a": 2.0, "b": object()})

    def full(file):
        raise OSError("no space left")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="no space"):
        save_restart(path, {"a": 2.0})
    assert load_restart(path)[0] == {"a": 1.0}
    assert [file.name for file in Path(tmp_path).iterdir()] == ["a.nc"]


def test_walls_stand_in_the_trajectory_file_with_their_places_and_stresses(tmp_path):
    domain = Domain((0.0, 100.0), (0.0, 100.0), west="closed")
    floes = Floes(np.arange(5) * 19.9 + 10, 50.0, 10.0, 1.0)
    wall = Wall("east", velocity=-0.1)
    model = Model(domain, floes, contact=Contact(), walls=[wall])
    with TrajectoryWriter(tmp_path / "floes.nc", model) as writer:
        for _ in range(3):
            model.advance(10.0)
            writer.write(model)
    with xr.open_dataset(tmp_path / "floes.nc") as data:
        assert list(data.wall.values) == list(model.wall_edges) == ["east", "west"]
        assert data.wall_position.values[:, 0] == pytest.approx([99.0, 98.0, 97.0])
        assert (data.wall_position.values[:, 1] == 0.0).all()
        assert (data.wall_position.units, data.wall_normal_stress.units) == ("m", "Pa")
        assert (data.wall_normal_stress.values[-1] == model.wall_stress()).all()
        assert (data.wall_normal_stress.values[-1] > 0).all()


def test_a_run_without_ice_writes_its_walls_too(tmp_path):
    domain = Domain((0.0, 100.0), (0.0, 100.0), west="closed")
    model = Model(domain, Floes([], [], [], []), contact=frictional())
    with TrajectoryWriter(tmp_path / "floes.nc", model) as writer:
        writer.write(model)
    assert (model.wall_stress() == 0.0).all()
