"""The same currents, ice and land in any way that files come in: the same run, or one line that refuses."""

import warnings

import cftime
import netCDF4
import numpy as np
import pytest
import xarray as xr

from floebmi.errors import InputError
from floebmi.forcing import VelocityFile
from floebmi.grid import Grid
from floebmi.projection import to_lonlat, to_plane
from floebmi.scalars import read_scalar
from floebmi.scene_domain import Curvilinear, Unstructured
from floebmi.scene_keys import Sea

PLANE = "+proj=laea +lat_0=75 +lon_0=5 +datum=WGS84"
GRID = Grid.uniform((-60e3, 60e3), (-60e3, 60e3), shape=(4, 4))
LON, LAT = np.arange(-2.0, 12.5, 0.5), np.arange(73.0, 77.1, 0.25)
TIMES = np.arange("2016-02-01T00", "2016-02-02T00", 6, dtype="datetime64[h]").astype("M8[ns]")
NAMES = ("uo", "vo")
LAND = LON > 6.2  # east of it the cells of the last column have land beside them
OPTIONS = {"projection": PLANE, "fill_land": "nearest", "start": "2016-02-01"}


def plain():
    """Currents of thousandths of m/s, so that packed as integers they are the same numbers."""
    k, lat, lon = np.meshgrid(np.arange(4.0), LAT, LON, indexing="ij")
    u = np.round(0.3 * np.cos(lon / 4) + 0.02 * (lat - 75) + 0.05 * k, 3)
    v = np.round(0.2 * np.sin(lat / 2) - 0.01 * lon - 0.03 * k**1.5, 3)
    u[..., LAND], v[..., LAND] = np.nan, np.nan
    dims, units = ("time", "lat", "lon"), {"units": "m s-1"}
    data = xr.Dataset(
        {
            "uo": (dims, u, units | {"standard_name": "eastward_sea_water_velocity"}),
            "vo": (dims, v, units | {"standard_name": "northward_sea_water_velocity"}),
        },
        {
            "time": TIMES,
            "lat": ("lat", LAT, {"units": "degrees_north"}),
            "lon": ("lon", LON, {"units": "degrees_east"}),
        },
    )
    data.time.encoding.update(units="hours since 2016-02-01", dtype="f8")
    return data


def read(source, **options):
    forcing = VelocityFile(source, GRID, **OPTIONS | options)
    read = []
    for t in (0.0, 16200.0, 46800.0):
        u, v = np.empty(GRID.size), np.empty(GRID.size)
        forcing.fill(t, u, v)
        read.append(u + 1j * v)
    return np.array(read)


REFERENCE = read(plain())


# ------------------------------------------------------------------------------------- ways to write it


def saved(change=lambda data: data, encoding=None, **how):
    def write(path):
        data = change(plain())
        if encoding:
            data = data.drop_encoding()
            how["encoding"] = dict.fromkeys(NAMES, encoding)
        data.to_netcdf(path, **how)

    return write


def with_attributes(names, **attributes):
    """Attributes set, or, of None, taken away."""

    def change(data):
        for name in names:
            kept = {k: v for k, v in (data[name].attrs | attributes).items() if v is not None}
            data[name].attrs = kept
        return data

    return saved(change)


def by_hand(land, kind="f8", scale=1.0, offset=0.0, **attributes):
    """The numbers written as they are, land as a number, with attributes that xarray would not write."""

    fill = attributes.pop("_FillValue", False)

    def write(path):
        data = plain()
        data.drop_vars(NAMES).to_netcdf(path)
        with netCDF4.Dataset(path, "a") as file:
            for name in NAMES:
                variable = file.createVariable(name, kind, data[name].dims, fill_value=fill)
                variable.set_auto_maskandscale(False)
                variable.setncatts(data[name].attrs | attributes)
                number = (np.nan_to_num(data[name].values) - offset) / scale
                variable[:] = np.where(LAND, land, np.round(number) if kind[0] == "i" else number)

    return write


def times(numbers, units, calendar="standard"):
    def change(data):
        return data.assign_coords(time=("time", numbers, {"units": units, "calendar": calendar}))

    return saved(change)


def times_in_words(path):
    plain().drop_vars("time").to_netcdf(path)
    with netCDF4.Dataset(path, "a") as file:
        variable = file.createVariable("time", str, ("time",))
        variable[:] = np.array([str(time)[:16] for time in TIMES], object)


def means(side):
    """Means over six hours with the time at one side of the interval."""

    def change(data):
        ends = TIMES[:, None] + np.array([-3, 3]) * np.timedelta64(1, "h")
        for name in NAMES:
            data[name].attrs["cell_methods"] = "time: mean"
        data = data.assign_coords(time=("time", ends[:, side], {"bounds": "time_bnds"}))
        data["time_bnds"] = ("time", "nv"), ends
        data.time.encoding.update(units="hours since 2016-02-01", dtype="f8")
        return data

    return saved(change)


def in_2d(names, moving=False):
    def change(data):
        lat, lon = (
            np.broadcast_to(a, (4, LAT.size, LON.size))
            for a in np.meshgrid(LAT, LON, indexing="ij")
        )
        if moving:
            lat = lat + 0.1 * np.arange(4)[:, None, None]
        for name, values, units in zip(names, (lat, lon), ("north", "east"), strict=True):
            data[name] = ("time", "y", "x"), values, {"units": f"degrees_{units}"}
        return data

    return saved(lambda data: change(data.rename_dims(lat="y", lon="x").drop_vars(["lat", "lon"])))


def radians(data):
    at = {
        name: (name, np.radians(data[name].values), {"units": "radians"}) for name in ("lat", "lon")
    }
    return data.assign_coords(at)


def along(name, values):
    return saved(
        lambda data: data.assign_coords({name: (name, values(data[name].values), data[name].attrs)})
    )


def in_cm(data):
    for name in NAMES:
        data[name] = (100 * data[name]).assign_attrs(data[name].attrs | {"units": "cm/s"})
    return data


def at_one_point(step):
    """A series with a place for each of its times."""

    def change(data):
        at = {"lat": ("time", 75 + step * np.arange(4.0)), "lon": ("time", np.full(4, 5.0))}
        return data.isel(lat=8, lon=14).drop_vars(["lat", "lon"]).assign_coords(at)

    return saved(change)


def at_depths(data):
    levels = xr.concat([0.1 * data, 0.5 * data, data], "depth").assign_coords(
        depth=[100.0, 20.0, 1.0]
    )
    for name in NAMES:
        levels[name].attrs = data[name].attrs
    return levels.transpose("time", "depth", ...)


SAME = {  # with the most that the rounding of the encoding explains
    "classic": (saved(format="NETCDF3_CLASSIC"), 0),
    "64-bit offset": (saved(format="NETCDF3_64BIT"), 0),
    "CDF-5": (saved(format="NETCDF3_64BIT_DATA", engine="netcdf4"), 0),
    "unlimited": (saved(unlimited_dims=["time"], format="NETCDF3_CLASSIC"), 0),
    "big-endian": (saved(encoding={"dtype": ">f8"}), 0),
    "float32": (saved(encoding={"dtype": "f4"}), 3e-8),
    "compressed": (saved(encoding={"zlib": True, "shuffle": True, "chunksizes": (1, 5, 7)}), 0),
    "packed": (saved(encoding={"dtype": "i2", "scale_factor": 1e-3, "_FillValue": -32767}), 1e-15),
    "unsigned": (
        by_hand(-1, "i2", 1e-3, -1.0, _Unsigned="true", scale_factor=1e-3, add_offset=-1.0, _FillValue=np.int16(-1)),
        1e-15,
    ),
    "missing_value": (by_hand(-9999.0, missing_value=-9999.0), 0),
    "missing_value of another type": (by_hand(1e20, "f4", missing_value=1e20), 3e-8),
    "valid_range": (by_hand(9.0, valid_range=[-5.0, 5.0]), 0),
    "valid_max, packed": (by_hand(9000, "i2", 1e-3, scale_factor=1e-3, valid_max=np.int16(5000)), 1e-15),
    "valid_max, unpacked": (by_hand(9000, "i2", 1e-3, scale_factor=1e-3, valid_max=5.0), 1e-15),
    "valid from 0 to 0": (with_attributes(NAMES, valid_min=0.0, valid_max=0.0), 0),
    "columns first": (saved(lambda d: d.transpose("lon", "time", "lat")), 0),
    "north to south": (saved(lambda d: d.isel(lat=slice(None, None, -1))), 1e-15),
    "0 … 360": (along("lon", lambda lon: lon % 360), 1e-12),
    "longitudes beyond pyproj's": (along("lon", lambda lon: lon + 720), 1e-11),
    "radians": (saved(radians), 1e-12),
    "attributes that are lists": (with_attributes(["lon"], standard_name=[1.0, 2.0], axis=[1.0, 2.0]), 0),
    "no attributes": (with_attributes(["lat", "lon"], units=None), 0),
    "places for each record": (in_2d(("XLAT", "XLONG")), 1e-5),
    "depths": (saved(at_depths), 0),
    "one date of forecast": (saved(lambda d: d.expand_dims(reference=TIMES[:1])), 0),
    # xarray of 2024 counts in the type of the numbers
    "time in float32": (times(np.arange(0, 24, 6, "f4"), "hours since 2016-02-01"), 3e-8),
    "time zone": (times(np.arange(0.0, 24, 6), "hours since 2016-02-01 01:00:00 +01:00"), 0),
    "hour alone": (times(np.arange(-6.0, 18, 6), "hours since 2016-02-01 06"), 0),
    "noleap": (times(cftime.date2num([cftime.datetime(2016, 2, 1, h, calendar="noleap") for h in (0, 6, 12, 18)],
                                     "days since 1-1-1", "noleap"), "days since 1-1-1", "noleap"), 1e-7),
    "times at the end of means": (means(1), 0),
    "times at the begin of means": (means(0), 0),
    "cm/s": (saved(in_cm), 1e-15),
}  # fmt: skip


@pytest.mark.parametrize("way", SAME)
@pytest.mark.filterwarnings("ignore:.*(are taken, by|Ambiguous reference)")
def test_the_same_currents_give_the_same_run(tmp_path, way):
    write, rounding = SAME[way]
    write(tmp_path / "currents.nc")
    np.testing.assert_allclose(read(tmp_path / "currents.nc"), REFERENCE, rtol=0, atol=rounding)


def test_a_series_may_have_its_place_for_each_time(tmp_path):
    at_one_point(0.0)(tmp_path / "point.nc")
    point = plain().isel(time=0, lat=8, lon=14)
    np.testing.assert_allclose(read(tmp_path / "point.nc")[0], point.uo + 1j * point.vo, atol=1e-4)


def test_packing_may_round_beyond_the_greatest_valid_value():
    data = plain()
    for name in NAMES:
        data[name].values[:] = 0.3
        data[name].attrs["valid_max"] = 0.2996
        data[name].encoding["scale_factor"] = 1e-3
    np.testing.assert_allclose(np.abs(read(data)), np.hypot(0.3, 0.3), rtol=1e-4)


def in_two_files(turned):
    """u in one file, v in another; or three on a C grid, of which each has dimensions of its own."""

    def write(path):
        data = plain()
        data[["uo"]].to_netcdf(path)
        data[["vo"]].isel(lat=slice(None, None, -1 if turned else 1)).to_netcdf(
            path.with_name("v.nc")
        )
        return [path, path.with_name("v.nc")]

    return write


def test_u_and_v_may_stand_in_two_files_but_not_upside_down(tmp_path):
    np.testing.assert_array_equal(read(in_two_files(False)(tmp_path / "u.nc")), REFERENCE)
    with pytest.raises(
        InputError, match="lat falls along lat in one and grows in the other: turn one"
    ):
        read(in_two_files(True)(tmp_path / "u.nc"))


def test_a_mask_in_another_file_must_be_of_the_same_points(tmp_path):
    wet = ice(~LAND * 1.0).rename(siconc="wet")
    plain().fillna(0.0).to_netcdf(tmp_path / "uv.nc")
    for name, step in (("mask", 1), ("turned", -1)):
        wet.isel(lat=slice(None, None, step)).to_netcdf(tmp_path / f"{name}.nc")
    np.testing.assert_array_equal(read([tmp_path / "uv.nc", tmp_path / "mask.nc"]), REFERENCE)
    with pytest.raises(InputError, match="their 'lat' differ, 73 … 77 and 77 … 73: points of the"):
        read([tmp_path / "uv.nc", tmp_path / "turned.nc"])


def test_of_a_staggered_grid_u_v_and_the_centres_may_each_stand_in_a_file(tmp_path):
    half = {"lon": 0.25, "lat": 0.125}
    at = {"c": (LAT, LON), "u": (LAT, LON[1:] - half["lon"]), "v": (LAT[1:] - half["lat"], LON)}
    for part, (lat, lon) in at.items():
        lat, lon = np.meshgrid(lat, lon, indexing="ij")
        dims = {"c": ("eta_rho", "xi_rho"), "u": ("eta_u", "xi_u"), "v": ("eta_v", "xi_v")}[part]
        name = {"c": "rho"}.get(part, part)
        data = xr.Dataset({f"lon_{name}": (dims, lon), f"lat_{name}": (dims, lat)})
        if part != "c":
            data[part] = dims, np.full(lat.shape, {"u": 0.2, "v": -0.1}[part]), {"units": "m s-1"}
        data.to_netcdf(tmp_path / f"{part}.nc")
    got = read([tmp_path / f"{part}.nc" for part in "uvc"], vectors="east-north", start=None)
    np.testing.assert_allclose(np.abs(got), np.hypot(0.2, 0.1), rtol=1e-4)


def on_a_plane(path):
    """x, y [km] with a grid mapping, and longitudes that are elsewhere: u, v and the rest in a file each, or all in one."""
    km = np.arange(-100.0, 101.0, 10.0)
    names = {"x": "projection_x_coordinate", "y": "projection_y_coordinate"}
    at = {k: (k, km, {"standard_name": name, "units": "km"}) for k, name in names.items()}
    current = {"units": "m s-1", "grid_mapping": "crs"}
    y, x = np.meshgrid(km, km, indexing="ij")
    lon, lat = to_lonlat(PLANE, 1e3 * x + 20e3, 1e3 * y)
    data = xr.Dataset(
        {
            "u": (("y", "x"), 1e-3 * x, current | {"standard_name": "sea_water_x_velocity"}),
            "v": (("y", "x"), 1e-3 * y, current | {"standard_name": "sea_water_y_velocity"}),
            "crs": ((), 0, {"grid_mapping_name": "lambert_azimuthal_equal_area", "proj4": PLANE}),
            "lon": (("y", "x"), lon, {"units": "degrees_east"}),
            "lat": (("y", "x"), lat, {"units": "degrees_north"}),
        },
        at,
    )
    data.to_netcdf(path)
    parts = [data[["u"]], data[["v"]], data.drop_vars(["u", "v"])]
    files = [path.with_name(f"{k}.nc") for k in range(3)]
    for part, file in zip(parts, files, strict=True):
        part.to_netcdf(file)
    return path, files


def test_the_grid_mapping_may_stand_in_a_file_of_its_own(tmp_path):
    one, three = on_a_plane(tmp_path / "all.nc")
    with pytest.warns(UserWarning, match="disagree by 19.9 km .* x, y are used"):
        expected = read(one, start=None)
    np.testing.assert_allclose(expected[0], 1e-6 * (GRID.x + 1j * GRID.y), atol=1e-12)
    np.testing.assert_array_equal(read(three, start=None), expected)


def test_names_of_nemo_at_one_place_are_warned_of(tmp_path):
    in_2d(("nav_lat", "nav_lon"))(tmp_path / "a.nc")
    with xr.open_dataset(tmp_path / "a.nc") as data:
        nemo = data.load().rename(uo="vozocrtx", vo="vomecrty")
    for name in ("vozocrtx", "vomecrty"):
        del nemo[name].attrs["standard_name"]
    with pytest.warns(UserWarning, match="vozocrtx, vomecrty: .* say stagger = 'after'"):
        read(nemo)
    with warnings.catch_warnings(action="error"):
        read(nemo, stagger="none", vectors="east-north")


# ---------------------------------------------------------------------------------------- what is refused


def text(content):
    return lambda path: path.write_bytes(content)


def in_groups(path):
    plain().to_netcdf(path, group="ocean")


def damaged(path):
    plain().to_netcdf(path, encoding=dict.fromkeys(NAMES, {"zlib": True}))
    content = bytearray(path.read_bytes())
    half = len(content) // 2
    content[half : half + 4000] = bytes(4000)
    path.write_bytes(content)


def cut(size):
    def write(path):
        plain().to_netcdf(path, format="NETCDF3_CLASSIC")
        path.write_bytes(path.read_bytes()[:size])

    return write


def polar(data):
    speed = np.hypot(data.uo, data.vo).assign_attrs(standard_name="wind_speed")
    wind = {"speed": speed, "dd": speed.assign_attrs(standard_name="wind_from_direction")}
    return data.drop_vars(NAMES).assign(wind)


REFUSED = {
    "web page": (text(b"<!DOCTYPE html><html>"), "is a web page or XML"),
    "GRIB": (text(b"GRIB\0\0\0\2" + bytes(99)), "is GRIB: convert it to NetCDF first"),
    "gzip": (text(b"\x1f\x8b" + bytes(99)), "is compressed by gzip: unpack it"),
    "empty": (text(b""), "is empty"),
    "groups": (in_groups, r"its variables are in groups \(ocean\).*ncks -G"),
    "damaged": (damaged, "[uv]o: cannot be read .*is the file damaged"),
    "cut in its header": (cut(100), "was cut short within its header"),
    "speed and direction": (saved(polar), "of speed and direction make u and v first"),
    "hour alone": (times(np.arange(0.0, 24, 6), "hours since 2016-02-01 06", "noleap"), "not all is understood"),
    "zone by name": (times(np.arange(0.0, 24, 6), "hours since 2016-02-01 01:00:00 CET"), "not all is understood"),
    "zone of one digit": (times(np.arange(0.0, 24, 6), "hours since 2016-02-01 01:00:00 +1:00", "noleap"), "in UTC"),
    "months": (times(np.arange(4.0), "months since 2016-02-01"), "must be seconds, minutes, hours or days since a date"),
    "times that are texts": (times_in_words, "times are texts"),
    "no times": (saved(lambda d: d.drop_vars("time")), r"select = \{ time = 0 \}"),
    "times twice": (times(np.array([0.0, 6, 6, 12]), "hours since 2016-02-01"), "sort the records"),
    "members": (saved(lambda d: d.expand_dims(member=3)), r"choose with select = \{ member = 0 \}"),
    "no places": (saved(lambda d: d.drop_vars("lon")), r"units \(degrees_east\).*name the file that has them"),
    "a grid that moves": (in_2d(("XLAT", "XLONG"), moving=True), "a grid that moves is not read"),
    "trajectory": (at_one_point(0.1), "its lat changes with time: a trajectory is not read"),
    "land as a number": (by_hand(-9999.0), "-9999 on water .*a fill value that is not its _FillValue"),
}  # fmt: skip


@pytest.mark.parametrize("way", REFUSED)
def test_what_cannot_be_understood_is_refused_in_a_line(tmp_path, way, recwarn):
    write, words = REFUSED[way]
    write(tmp_path / "currents.nc")
    recwarn.clear()
    with pytest.raises(InputError, match=words) as error:
        read(tmp_path / "currents.nc")
    assert "\n" not in str(error.value) and not recwarn


@pytest.mark.parametrize(
    "name, words", [("*.nc", "no patterns"), ("https://a.b/c.nc", "no addresses")]
)
def test_patterns_and_addresses_are_no_files(tmp_path, name, words):
    with pytest.raises(InputError, match=f"no such file; {words} are read"):
        read(f"{tmp_path}/{name}")


# --------------------------------------------------------------------- values that a mean would have hidden


def between_columns(share):
    """A grid of one cell, between the last column of water and the first of land."""
    east = LON[LAND][0]
    x, y = (float(a) for a in to_plane(PLANE, east - 0.5 + 0.5 * share, 75.0))
    return Grid.uniform((x - 1, x + 1), (y - 1, y + 1), shape=(1, 1))


def test_a_fill_value_of_little_weight_is_seen():
    forcing = VelocityFile(plain().fillna(-99.0), between_columns(0.05), projection=PLANE)
    with pytest.raises(InputError, match="uo.* -99 on water"):
        forcing.fill(0.0, np.empty(1), np.empty(1))


def ice(values, **attributes):
    row = (("lat", "lon"), np.broadcast_to(values, (LAT.size, LON.size)), attributes)
    return xr.Dataset({"siconc": row}, plain().drop_vars([*NAMES, "time"]).coords)


def test_a_flag_among_concentrations_is_seen():
    with pytest.raises(InputError, match=r"siconc\[.*: 1.27; must lie in 0 … 1"):
        read_scalar(ice(np.where(LAND, 1.27, 0.5)), "area_fraction", between_columns(0.3), PLANE)


@pytest.mark.parametrize("units", ["", "1", "none", "-", "m2 m-2", "%"])
def test_a_fraction_may_be_said_in_many_ways(units):
    data = ice(50.0 if units == "%" else 0.5, units=units)
    assert read_scalar(data, "area_fraction", GRID, PLANE) == pytest.approx(0.5)


def test_a_fraction_of_one_that_is_said_to_be_percent_is_warned_of():
    with pytest.warns(UserWarning, match="siconc: units = '%', but nowhere is it more than 0.9"):
        read_scalar(ice(0.9, units="%"), "area_fraction", GRID, PLANE)


# ------------------------------------------------------------------------------------------------ masks


@pytest.mark.parametrize(
    "attributes",
    [
        {"flag_values": [0, 1], "flag_meanings": "sea_water dry_land"},
        {"flag_values": [0, 1], "flag_meanings": "open_ocean land_ice"},
        {"flag_values": "0b, 1b", "flag_meanings": "sea land"},
        {"long_name": "Mask (1 = land, 0 = sea)"},
        {"long_name": "land is 1, sea is 0"},
        {"comment": "land: 1; water: 0"},
    ],
)
def test_a_mask_that_says_that_one_is_land_is_believed(attributes):
    data = ice(LAND.astype(float), **attributes).rename(siconc="mask")
    land = read_scalar(data, "land_fraction", GRID, PLANE)
    assert land.reshape(4, 4)[1, 0] == 0.0 and land.max() > 0.5


# ---------------------------------------------------------------------------------------- cells of a grid


def corners(path, missing=None, **attributes):
    x, y = np.meshgrid(np.arange(0.0, 5e3, 1e3), np.arange(0.0, 4e3, 1e3))
    per_unit = {"km": 1e-3}.get(attributes.get("units"), 1.0)
    with netCDF4.Dataset(path, "w") as file:
        file.createDimension("j", 4), file.createDimension("i", 5)
        for name, values in (("x_corners", x), ("y_corners", y)):
            variable = file.createVariable(name, "f8", ("j", "i"), fill_value=-9999.0)
            variable.setncatts(attributes)
            variable[:] = np.ma.masked_equal(values * per_unit, missing)


def sea_in(folder):
    return Sea(None, None, None, folder, None, None, None)


def test_corners_of_a_grid_may_be_in_kilometres(tmp_path):
    for units in ({}, {"units": "m"}, {"units": "km"}):
        corners(tmp_path / "grid.nc", **units)
        grid = Curvilinear(file="grid.nc").build(sea_in(tmp_path))
        np.testing.assert_allclose(grid.area, 1e6, rtol=1e-12)


def test_corners_that_are_degrees_or_missing_are_refused(tmp_path):
    corners(tmp_path / "grid.nc", units="degrees_east")
    with pytest.raises(InputError, match="x_corners: units = 'degrees_east'; must be a length"):
        Curvilinear(file="grid.nc").build(sea_in(tmp_path))
    corners(tmp_path / "grid.nc", missing=2000.0)
    with pytest.raises(InputError, match=r"x_corners\[0, 2\] = nan: must be finite"):
        Curvilinear(file="grid.nc").build(sea_in(tmp_path))


@pytest.mark.parametrize("first, empty", [(0, -1), (1, -1), (0, 999), (1, 0)])
def test_nodes_of_cells_are_counted_from_where_the_file_says(tmp_path, first, empty):
    with netCDF4.Dataset(tmp_path / "mesh.nc", "w") as file:
        for name, n in (("node", 5), ("face", 2), ("corner", 4)):
            file.createDimension(name, n)
        for name, values in (("node_x", [0, 1, 1, 0, 2]), ("node_y", [0, 0, 1, 1, 0])):
            file.createVariable(name, "f8", ("node",))[:] = values
        faces = file.createVariable("face_nodes", "i4", ("face", "corner"), fill_value=empty)
        faces.start_index = first
        faces[:] = [[k + first for k in (0, 1, 2, 3)], [*(k + first for k in (1, 4, 2)), empty]]
    grid = Unstructured(kind="unstructured", file="mesh.nc").build(sea_in(tmp_path))
    np.testing.assert_allclose(grid.area, [1.0, 0.5])
