"""Concentration, thickness and land from files: what they mean is understood or refused."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import floebmi
from floebmi.errors import InputError
from floebmi.forcing import VelocityFile
from floebmi.grid import Grid
from floebmi.projection import centred_projection, to_plane
from floebmi.scalars import read_scalar

LABRADOR = Path(floebmi.__file__).parent / "scenes" / "data" / "labsea_mitgcm_1979.nc"
REAL = Path(__file__).parents[2] / "shared" / "data"
CONCENTRATION = {"standard_name": "sea_ice_area_fraction", "units": "1"}
THICKNESS = {"standard_name": "sea_ice_thickness", "units": "m"}


def square(n=5):
    return Grid.uniform((0, 10), (0, 10), shape=(n, n))


def on_metres(**fields):
    """A data set on x, y = 0 … 10 m; each field is (function of x, y or number, attributes)."""
    x = np.arange(11.0)
    y2, x2 = np.meshgrid(x, x, indexing="ij")
    parts = {
        name: (("y", "x"), f(x2, y2) if callable(f) else np.full((11, 11), float(f)), attrs)
        for name, (f, attrs) in fields.items()
    }
    units = {"units": "m"}
    return xr.Dataset(parts, {"y": ("y", x, units), "x": ("x", x, units)})


def test_concentration_is_bilinear_and_percent_is_converted():
    grid = square()
    one = on_metres(siconc=(lambda x, y: x * y / 100, CONCENTRATION))
    np.testing.assert_allclose(read_scalar(one, "area_fraction", grid), grid.x * grid.y / 100)
    percent = on_metres(siconc=(lambda x, y: x * y, CONCENTRATION | {"units": "%"}))
    np.testing.assert_allclose(
        read_scalar(percent, "area_fraction", grid), grid.x * grid.y / 100, atol=1e-15
    )


def test_rounding_beyond_a_bound_is_set_to_it_with_a_warning_and_more_is_an_error():
    data = on_metres(aice=(lambda x, y: np.where(x < 5, -6e-6, 0.5), CONCENTRATION))
    with pytest.warns(UserWarning, match="aice: 10 cells beyond 0 … 1 by at most 6e-06"):
        values = read_scalar(data, "area_fraction", square())
    assert values.min() == 0.0
    wrong = on_metres(aice=(80.0, CONCENTRATION))
    with pytest.raises(InputError, match=r"aice\[1, 1\]: 80; must lie in 0 … 1"):
        read_scalar(wrong, "area_fraction", square())


@pytest.mark.parametrize(
    "words",
    [
        {"long_name": "effective (grid-cell mean) ice thickness"},
        {"cell_methods": "area: mean where sea_ice over sea"},
    ],
)
def test_mean_thickness_over_the_cell_is_divided_by_the_concentration(words):
    data = on_metres(
        siconc=(lambda x, y: np.where(x < 5, 0.0, 0.5), CONCENTRATION),
        hice=(lambda x, y: np.where(x < 5, 0.0, 0.6), THICKNESS | words),
    )
    grid = square()
    for quantity, value in (("thickness", 1.2), ("sea_ice_volume", 0.6)):
        values = read_scalar(data, quantity, grid)
        np.testing.assert_allclose(values[grid.x > 5], value)
        assert (values[grid.x < 4] == 0).all()
    told = read_scalar(data, "thickness", grid, thickness_of="ice")
    np.testing.assert_allclose(told[grid.x > 5], 0.6)


def test_volume_is_thickness_over_the_ice_times_concentration():
    data = on_metres(siconc=(0.25, CONCENTRATION), sithick=(2.0, THICKNESS))
    np.testing.assert_allclose(read_scalar(data, "sea_ice_volume", square()), 0.5)
    np.testing.assert_allclose(read_scalar(data, "thickness", square()), 2.0)


@pytest.mark.parametrize("kind", ["ice", "cell"])
@pytest.mark.parametrize("per_cent", [1.0, 100.0])
def test_thickness_without_a_value_where_there_is_no_ice_is_open_water(kind, per_cent):
    units = CONCENTRATION | {"units": "%" if per_cent == 100 else "1"}
    fields = {"siconc": (lambda x, y: np.where(x < 5, 0.0, 0.8 * per_cent), units)}
    share = {"ice": 1.0, "cell": 0.8}[kind]
    grid = Grid.uniform((0, 10), (0, 10), shape=(5, 40))
    for none in (0.0, np.nan):
        thickness = (lambda x, y, none=none: np.where(x < 5, none, 1.5 * share), THICKNESS)
        data = on_metres(**fields, sithick=thickness)
        found = {
            quantity: read_scalar(data, quantity, grid, thickness_of=kind)
            for quantity in ("thickness", "sea_ice_volume")
        }
        np.testing.assert_allclose(found["thickness"][grid.x > 4.01], 1.5, rtol=1e-12)
        assert not found["thickness"][grid.x < 4].any()
        ramp = 1.2 * np.clip(grid.x - 4, 0, 1)
        np.testing.assert_allclose(found["sea_ice_volume"], ramp, atol=1e-12)


@pytest.mark.parametrize("with_concentration", [True, False])
def test_ice_is_no_thinner_beside_open_water(with_concentration):
    fields = {"sithick": (lambda x, y: np.where(x < 5, 0.0, 2.0), THICKNESS)}
    if with_concentration:
        fields["siconc"] = (lambda x, y: np.where(x < 5, 0.0, 0.5), CONCENTRATION)
    grid = Grid.uniform((4, 7), (0, 10), shape=(5, 6))  # centres at 4.25, 4.75, …
    thickness = read_scalar(on_metres(**fields), "thickness", grid)
    np.testing.assert_allclose(thickness, 2.0, rtol=1e-13)
    if with_concentration:  # what there is of it is the mean of the volume
        volume = read_scalar(on_metres(**fields), "sea_ice_volume", grid)
        np.testing.assert_allclose(volume, np.clip(grid.x - 4, 0, 1), rtol=1e-13)


@pytest.mark.parametrize("fill", [9999.0, 1e20, 9.96921e36])
@pytest.mark.parametrize("kind", ["ice", "cell"])
def test_a_fill_value_that_the_file_does_not_declare_is_no_thickness(fill, kind):
    data = on_metres(siconc=(0.5, CONCENTRATION), sithick=(1.0, THICKNESS))
    data.sithick[5, 5] = fill
    with pytest.raises(InputError, match=r"sithick\[\d+, \d+\]: .* 0 … 1000 .*fill value"):
        read_scalar(data, "thickness", square(), thickness_of=kind)


def test_volume_is_not_made_of_a_concentration_beyond_its_bounds():
    data = on_metres(siconc=(50.0, CONCENTRATION), sithick=(1.0, THICKNESS))
    with pytest.raises(InputError, match=r"siconc\[1, 1\]: 50; must lie in 0 … 1"):
        read_scalar(data, "sea_ice_volume", square())


def test_thickness_of_unknown_meaning_is_refused():
    with pytest.raises(InputError, match="thickness_of = 'ice' or 'cell'"):
        read_scalar(on_metres(hice=(2.0, THICKNESS)), "thickness", square())


def test_dividing_at_the_cells_gives_back_the_volume():
    data = on_metres(
        siconc=(lambda x, y: 0.05 + 0.9 * (x > 5), CONCENTRATION),
        sivol=(lambda x, y: 0.01 + 1.9 * (x > 5), THICKNESS),
    )
    grid = square(9)
    volume, thickness, share = (
        read_scalar(data, q, grid) for q in ("sea_ice_volume", "thickness", "area_fraction")
    )
    np.testing.assert_allclose(thickness * share, volume, rtol=1e-13)
    assert thickness.max() <= 1.91 / 0.95 + 1e-12  # no thicker than any ice in the file


@pytest.mark.parametrize(
    "name, land, attrs",
    [
        ("land_fraction", 1, {"standard_name": "land_area_fraction", "units": "1"}),
        ("sftlf", 100, {"standard_name": "land_area_fraction", "units": "%"}),
        ("mask_rho", 0, {}),
        ("lsm", 1, {}),
        ("mask", 0, {"option_0": "land", "option_1": "water"}),
        ("mask", 1, {"flag_values": [0, 1], "flag_meanings": "sea land"}),
        ("wherever", 0, {"standard_name": "sea_binary_mask"}),
    ],
)
def test_land_is_found_whichever_way_round_the_file_has_it(name, land, attrs):
    one = 100 if land == 100 else 1

    def field(x, y):
        return np.where(x > 5, land, one - land).astype(float)

    grid = square()
    values = read_scalar(on_metres(**{name: (field, attrs)}), "land_fraction", grid)
    np.testing.assert_allclose(values, np.interp(grid.x, [5, 6], [0, 1]), atol=1e-14)


@pytest.mark.parametrize(
    ("quantity", "name"), [("land_fraction", "sftlf"), ("area_fraction", "siconc")]
)
def test_units_without_a_word_are_those_of_the_file(quantity, name):
    percent = on_metres(**{name: (25.0, {"units": "%"})})
    np.testing.assert_allclose(read_scalar(percent, quantity, square(), units=""), 0.25)


def test_a_mask_that_says_nothing_about_itself_is_refused():
    data = on_metres(somewhere=(1.0, {}))
    with pytest.raises(InputError, match="1 is land or water"):
        read_scalar(data, "land_fraction", square(), variable="somewhere")


def test_cells_outside_the_file_are_an_error_or_get_what_is_told():
    data = on_metres(land_fraction=(0.0, {"standard_name": "land_area_fraction"}))
    wide = Grid.uniform((-10, 10), (0, 10), shape=(2, 4))
    with pytest.raises(InputError, match="4 of 8 cells.*covers x -0.5"):
        read_scalar(data, "land_fraction", wide)
    values = read_scalar(data, "land_fraction", wide, outside=1.0)
    np.testing.assert_array_equal(values, (wide.x < 0).astype(float))


def test_time_is_chosen_between_records_and_must_exist():
    data = xr.concat(
        [on_metres(siconc=(c, CONCENTRATION)) for c in (0.2, 0.6)], dim="time"
    ).assign_coords(time=np.array(["2016-02-01", "2016-02-03"], "datetime64[ns]"))
    assert read_scalar(data, "area_fraction", square())[0] == pytest.approx(0.2)
    values = read_scalar(data, "area_fraction", square(), time="2016-02-02")
    assert values[0] == pytest.approx(0.4)
    with pytest.raises(
        InputError, match="time = '2016-03-01': the file has 2016-02-01 … 2016-02-03"
    ):
        read_scalar(data, "area_fraction", square(), time="2016-03-01")


@pytest.mark.parametrize(
    "quantity, option, word",
    [
        ("concentration", {}, "area_fraction"),
        ("thickness", {"thickness_of": "floe"}, "cell, ice"),
        ("area_fraction", {"variable": "sicon"}, "did you mean 'siconc'"),
        ("thickness", {}, "no ice thickness found"),
    ],
)
def test_what_is_not_there_or_not_allowed_is_refused_in_one_line(quantity, option, word):
    data = on_metres(siconc=(0.5, CONCENTRATION))
    with pytest.raises(InputError, match=word) as error:
        read_scalar(data, quantity, square(), **option)
    assert "\n" not in str(error.value)


def labrador(half=1200e3, n=48):
    """A grid over the Labrador Sea with the file's land (and what lies outside the file) dry."""
    plane = centred_projection((285, 315), (50, 72))
    grid = Grid.uniform((-half, half), (-half, half), shape=(n, n))
    land = read_scalar(LABRADOR, "land_fraction", grid, plane, outside=1.0)
    return plane, grid.with_wet(land < 0.5), land


def test_the_packaged_file_gives_one_consistent_case():
    plane, grid, land = labrador()
    assert 0.1 < (land == 1).mean() < 0.9
    for kind, fastest in (("ocean", 0.1), ("wind", 8.0)):
        names = ("uo", "vo") if kind == "ocean" else None
        source = VelocityFile(LABRADOR, grid, kind=kind, projection=plane, variables=names)
        u, v = np.empty(grid.size), np.empty(grid.size)
        source.fill(0.0, u, v)
        assert source.covered[grid.wet].all()
        assert 0 < np.hypot(u, v)[grid.wet].max() < fastest
    share = read_scalar(LABRADOR, "area_fraction", grid, plane)
    thickness = read_scalar(LABRADOR, "thickness", grid, plane)
    assert share.max() <= 1 and 0.2 < share[grid.wet].mean() < 0.8
    assert 0.5 < thickness.max() < 2 and (thickness[share < 1e-3] == 0).all()


def test_the_packaged_file_has_its_values_at_its_own_points():
    data = xr.open_dataset(LABRADOR)
    lon, lat = np.meshgrid(data.lon, data.lat)
    j, i = np.argwhere((data.siconc.values > 0.5) & (data.siconc.values < 0.95))[3]
    plane = centred_projection(float(lon[j, i]), float(lat[j, i]))
    x, y = (float(a) for a in to_plane(plane, lon[j, i], lat[j, i]))
    cell = Grid.uniform((x - 1, x + 1), (y - 1, y + 1), shape=(1, 1))
    for quantity, value in (
        ("area_fraction", data.siconc), ("sea_ice_volume", data.sivol),
        ("thickness", data.sivol / data.siconc),
    ):  # fmt: skip
        assert read_scalar(LABRADOR, quantity, cell, plane)[0] == pytest.approx(
            float(value[j, i]), rel=1e-5
        )


def test_the_packaged_file_comes_with_its_licence():
    licence = LABRADOR.with_suffix(".LICENSE").read_text()
    assert "MITgcm" in licence and "Permission is hereby granted" in licence
    assert LABRADOR.stat().st_size < 300_000


@pytest.mark.skipif(not REAL.is_dir(), reason="the real files are not here")
@pytest.mark.filterwarnings("ignore:.*disagree by:UserWarning")
def test_the_real_coast_and_ice_files_are_read():
    nares = REAL / "coast_nares_strait_landfraction_2km.nc"
    grid = Grid.uniform((-430e3, -230e3), (-1030e3, -830e3), shape=(100, 100))
    own, given = (read_scalar(nares, "land_fraction", grid, p) for p in (None, "EPSG:3413"))
    np.testing.assert_array_equal(own, given)
    assert own.min() == 0 and own.max() == 1 and 0.5 < own.mean() < 0.8
    plane = centred_projection(35, 77)
    grid = Grid.uniform((-200e3, 200e3), (-200e3, 200e3), shape=(20, 20))
    arctic = REAL / "arctic20_ocean_ice_20160201-05.nc"
    with pytest.warns(UserWarning, match="aice: .* are set to the bound"):
        share = read_scalar(arctic, "area_fraction", grid, plane)
    assert share.min() == 0 and 0.5 < share.max() < 1
