"""Currents and winds from constants, functions and files: place, direction, unit and time are understood or refused."""

import datetime
import warnings
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from xarray.backends import BackendArray
from xarray.core import indexing

from floebmi.cgrid import mean_of_faces
from floebmi.errors import InputError
from floebmi.forcing import Constant, Function, VelocityFile
from floebmi.grid import Grid
from floebmi.opening import open_files
from floebmi.projection import east_in_plane, to_lonlat, to_plane
from floebmi.scene import read_scene

POLAR = "+proj=stere +lat_0=90 +lat_ts=70 +lon_0=-45 +datum=WGS84"
REAL = Path(__file__).parents[2] / "shared" / "data"
M_PER_S = {"units": "m s-1"}
EAST = M_PER_S | {"standard_name": "eastward_sea_water_velocity"}
NORTH = M_PER_S | {"standard_name": "northward_sea_water_velocity"}
ALONG_X = M_PER_S | {"standard_name": "sea_water_x_velocity"}
ALONG_Y = M_PER_S | {"standard_name": "sea_water_y_velocity"}


def velocity(source, grid, t=0.0):
    u, v = np.full(grid.size, np.nan), np.full(grid.size, np.nan)
    source.fill(t, u, v)
    return u, v


def around(lon, lat, plane=POLAR, half=50e3, n=4):
    """A grid of n × n cells around a place."""
    x, y = (float(a) for a in to_plane(plane, lon, lat))
    return Grid.uniform((x - half, x + half), (y - half, y + half), shape=(n, n))


def square(side=10.0, n=5):
    return Grid.uniform((0, side), (0, side), shape=(n, n))


def on_axes(u, v, x, y, u_attrs=ALONG_X, v_attrs=ALONG_Y, dims=("y", "x"), **more):
    """A data set on metres x, y (or longitude and latitude, by the dims), with optional leading time."""
    units = {"lon": "degrees_east", "lat": "degrees_north"}
    lead = ("time",) if np.ndim(u) == 3 else ()
    data = xr.Dataset(
        {"uo": (lead + dims, u, u_attrs), "vo": (lead + dims, v, v_attrs), **more},
        coords={
            dims[0]: (dims[0], y, {"units": units.get(dims[0], "m")}),
            dims[1]: (dims[1], x, {"units": units.get(dims[1], "m")}),
        },
    )
    return data


def metres(u, v, n=11, **more):
    """A data set on x, y = 0, 1 … n-1 m with fields from functions of x, y (or constants)."""
    x = np.arange(float(n))
    y2, x2 = np.meshgrid(x, x, indexing="ij")
    u, v = (f(x2, y2) if callable(f) else np.full((n, n), float(f)) for f in (u, v))
    return on_axes(u, v, x, x, **more)


def saved(data, tmp_path, name="currents.nc"):
    data.to_netcdf(tmp_path / name)
    return tmp_path / name


def in_time(data, times):
    """The same field at each time, multiplied by 1, 2, 3 …"""
    data = xr.concat([data[["uo", "vo"]] * (k + 1.0) for k in range(len(times))], dim="time")
    data.uo.attrs, data.vo.attrs = ALONG_X, ALONG_Y
    return data.assign_coords(time=times)


DAYS = np.array(["2016-02-01", "2016-02-02", "2016-02-04"], "datetime64[ns]")


# ------------------------------------------------------------------------------ constants and functions


def test_a_constant_is_the_same_everywhere_and_always():
    u, v = velocity(Constant(0.1, -0.2), square(), 1e9)
    assert (u == 0.1).all() and (v == -0.2).all()
    assert Constant().span is None and "0.1" in repr(Constant(0.1))
    with pytest.raises(InputError, match="finite"):
        Constant(np.nan)


def test_functions_get_the_cells_centres_and_the_time():
    grid = square()
    source = Function(lambda x, y, t: x + 10 * y + t, 3, grid)
    u, v = velocity(source, grid, 5.0)
    np.testing.assert_array_equal(u, grid.x + 10 * grid.y + 5)
    assert (v == 3).all()


@pytest.mark.parametrize(
    "bad, word",
    [
        (lambda x, y, t: np.where(x > 4, np.nan, 0), "cell 2"),
        (lambda x, y, t: x[:3], "shape"),
        (np.inf, "finite"),
    ],
)
def test_a_function_that_returns_nonsense_is_named_with_time_and_cell(bad, word):
    grid = square()
    with pytest.raises(InputError, match=word):
        velocity(Function(0.0, bad, grid), grid, 7.0)


def test_a_function_of_other_arguments_is_refused():
    with pytest.raises(InputError, match=r"^Function v\(x, y\): must take x, y \[m\] and t \[s\]$"):
        Function(0.0, lambda x, y: x, square())
    for fine in (lambda *a: 0.0, lambda x, y, t, k=1: 0.0, np.vectorize(lambda x, y, t: t)):
        Function(fine, max, square())  # max does not tell its arguments


# ------------------------------------------------------------------------------------------ directions


@pytest.mark.parametrize("lon, lat", [(-45, 85), (10, 80), (135, 75), (-170, 88)])
def test_an_eastward_flow_has_the_analytic_direction_in_the_polar_stereographic_plane(
    tmp_path, lon, lat
):
    lons, lats = np.arange(-180.0, 180.0), np.arange(60.0, 90.5)
    one = np.ones((lats.size, lons.size))
    path = saved(on_axes(0.3 * one, 0 * one, lons, lats, EAST, NORTH, ("lat", "lon")), tmp_path)
    grid = around(lon, lat)
    u, v = velocity(VelocityFile(path, grid, projection=POLAR), grid)
    turn = np.radians(to_lonlat(POLAR, grid.x, grid.y)[0] + 45)
    # Interpolation between directions one degree apart shortens a vector by 4e-5.
    np.testing.assert_allclose(u + 1j * v, 0.3 * np.exp(1j * turn), atol=3e-5)


def test_components_of_a_projected_file_are_turned_to_another_plane(tmp_path):
    x = np.arange(-1000e3, 1001e3, 100e3)
    other = POLAR.replace("-45", "10")
    attrs = {"grid_mapping_name": "polar_stereographic", "proj4_string": other}
    data = on_axes(
        np.full((21, 21), 0.2), np.zeros((21, 21)), x, x,
        ALONG_X | {"grid_mapping": "crs"}, ALONG_Y | {"grid_mapping": "crs"},
        crs=((), 0, attrs),
    )  # fmt: skip
    path = saved(data, tmp_path)
    grid = around(0, 85)
    u, v = velocity(VelocityFile(path, grid, projection=POLAR), grid)
    np.testing.assert_allclose(u + 1j * v, 0.2 * np.exp(1j * np.radians(55)), atol=1e-7)
    own = VelocityFile(path, grid)
    u, v = velocity(own, grid)
    assert own.projection == other
    np.testing.assert_allclose((u, v), (np.full(16, 0.2), np.zeros(16)))


def test_components_along_x_on_longitude_and_latitude_are_east_and_north(tmp_path):
    lon, lat = np.arange(0.0, 20), np.arange(70.0, 80)
    one = np.ones((10, 20))
    answers = []
    for k, names in enumerate(((EAST, NORTH), (ALONG_X, ALONG_Y), (M_PER_S, M_PER_S))):
        data = on_axes(0.1 * one, 0.2 * one, lon, lat, *names, ("lat", "lon"))
        grid = around(10, 75)
        path = saved(data, tmp_path, f"{k}.nc")
        answers.append(velocity(VelocityFile(path, grid, projection=POLAR), grid))
    np.testing.assert_array_equal(answers[0], answers[1])
    np.testing.assert_array_equal(answers[0], answers[2])


def test_components_of_unknown_orientation_are_refused_on_a_curvilinear_grid(tmp_path):
    data = roms()[["u", "v", "lon_rho", "lat_rho"]]
    a_grid = data.rename({"lon_rho": "lon", "lat_rho": "lat"})
    for name in "uv":
        a_grid[name] = (("eta_rho", "xi_rho"), np.full((20, 24), 0.1), M_PER_S)
    path, grid = saved(a_grid, tmp_path), around(10, 75)
    with pytest.raises(InputError, match="vectors = 'east-north' or 'grid'"):
        VelocityFile(path, grid, projection=POLAR)
    u, v = velocity(VelocityFile(path, grid, projection=POLAR, vectors="east-north"), grid)
    east = np.radians(to_lonlat(POLAR, grid.x, grid.y)[0] + 45)
    np.testing.assert_allclose(u + 1j * v, (0.1 + 0.1j) * np.exp(1j * east), atol=1e-4)
    u, v = velocity(VelocityFile(path, grid, projection=POLAR, vectors="grid"), grid)
    np.testing.assert_allclose(u + 1j * v, (0.1 + 0.1j) * np.exp(1j * ROMS_TURN), atol=1e-6)


AXES = {  # by the names of variables, and by standard names
    ("ocean", "east"): (
        ("water_u", "water_v"), ("eastward_sea_water_velocity", "northward_sea_water_velocity"),
        ("surface_eastward_sea_water_velocity", "surface_northward_sea_water_velocity"),
    ),
    ("ocean", "grid"): (
        ("vozocrtx", "vomecrty"), ("sozocrtx", "somecrty"), ("UVEL", "VVEL"),
        ("sea_water_x_velocity", "sea_water_y_velocity"), ("x_sea_water_velocity", "y_sea_water_velocity"),
        ("surface_sea_water_x_velocity", "surface_sea_water_y_velocity"),
    ),
    ("wind", "east"): (
        ("u10", "v10"), ("uas", "vas"), ("U10M", "V10M"), ("u10m", "v10m"), ("eastward_wind", "northward_wind"),
    ),
    ("wind", "grid"): (
        ("x_wind_10m", "y_wind_10m"), ("x_wind", "y_wind"), ("grid_eastward_wind", "grid_northward_wind"),
    ),
    ("ocean", None): (("uo", "vo"),),
    ("wind", None): (("U10", "V10"), ("Uwind", "Vwind")),
}  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "axes", "names"), [(*key, names) for key, pairs in AXES.items() for names in pairs]
)
@pytest.mark.filterwarnings("ignore:.*as NEMO writes them")
def test_a_name_tells_the_axes_of_its_components_or_does_not(tmp_path, kind, axes, names):
    """On cells that are turned against east."""
    data = roms()[["lon_rho", "lat_rho"]].rename({"lon_rho": "lon", "lat_rho": "lat"})
    for name, value in zip(names, (0.1, 0.2), strict=True):
        standard = {"standard_name": name} if name.endswith(("_wind", "_velocity")) else {}
        called = f"component_{value}" if standard else name
        data[called] = (("eta_rho", "xi_rho"), np.full((20, 24), value), M_PER_S | standard)
    path, grid = saved(data, tmp_path), around(10, 75)
    if axes is None:
        with pytest.raises(InputError, match="nothing says whether"):
            VelocityFile(path, grid, kind=kind, projection=POLAR)
        return
    x, y = velocity(VelocityFile(path, grid, kind=kind, projection=POLAR), grid)
    east = np.radians(to_lonlat(POLAR, grid.x, grid.y)[0] + 45)
    turned = (0.1 + 0.2j) * np.exp(1j * (east if axes == "east" else ROMS_TURN))
    np.testing.assert_allclose(x + 1j * y, turned, atol=1e-4)


def test_a_point_series_is_the_same_everywhere_and_turned_to_the_plane_only_if_there_is_one(
    tmp_path,
):
    data = xr.Dataset(
        {
            "uoce": ("time", [0.1, 0.3, 0.3], EAST), "voce": ("time", [0.0, 0.2, 0.2], NORTH),
            "lon": ((), 45.0, {"units": "degrees_east"}),
            "lat": ((), 80.0, {"units": "degrees_north"}),
        },
        {"time": DAYS},
    )  # fmt: skip
    path, grid = saved(data, tmp_path), square()
    u, v = velocity(VelocityFile(path, grid), grid, 43200.0)
    np.testing.assert_allclose((u, v), (np.full(25, 0.2), np.full(25, 0.1)))
    u, v = velocity(VelocityFile(path, grid, projection=POLAR), grid, 43200.0)
    np.testing.assert_allclose((u, v), (np.full(25, -0.1), np.full(25, 0.2)), atol=1e-8)


# ------------------------------------------------------------------------------------------- staggered

ROMS_TURN = 0.7  # of the grid's ξ axis from the plane's x axis


def roms(ny=20, nx=24, same_size=False):
    """A ROMS file: a C grid turned by 0.7 in the plane, around 10 E 75 N, with u = 0.1 + 0.01 ξ, v = -0.05."""
    x0, y0 = (float(a) for a in to_plane(POLAR, 10, 75))
    eta, xi = np.mgrid[0:ny, 0:nx].astype(float)
    z = 10e3 * ((xi - nx / 2) + 1j * (eta - ny / 2)) * np.exp(1j * ROMS_TURN)
    lon, lat = to_lonlat(POLAR, x0 + z.real, y0 + z.imag)
    angle = ROMS_TURN - np.radians(lon + 45)
    nu, nv = (nx, ny) if same_size else (nx - 1, ny - 1)
    u = np.broadcast_to(0.1 + 0.01 * (np.arange(nu) + 0.5), (ny, nu)).copy()
    v = np.full((nv, nx), -0.05)
    zero = {"units": "degree_east"}, {"units": "degree_north"}
    data = xr.Dataset(
        {
            "u": (("eta_u", "xi_u"), u, {"units": "meter second-1"}),
            "v": (("eta_v", "xi_v"), v, {"units": "meter second-1"}),
            "angle": (("eta_rho", "xi_rho"), angle, {"units": "radians"}),
            "mask_rho": (("eta_rho", "xi_rho"), np.ones((ny, nx))),
            "lon_rho": (("eta_rho", "xi_rho"), lon, {"units": "degree_east"}),
            "lat_rho": (("eta_rho", "xi_rho"), lat, {"units": "degree_north"}),
            "lon_u": (("eta_u", "xi_u"), np.zeros((ny, nu)), zero[0]),
            "lat_u": (("eta_u", "xi_u"), np.zeros((ny, nu)), zero[1]),
        }
    )
    return data


def along_xi(grid):
    """ξ of the cells, in spacings of the ROMS grid above."""
    x0, y0 = to_plane(POLAR, 10, 75)
    return ((grid.x - x0 + 1j * (grid.y - y0)) * np.exp(-1j * ROMS_TURN)).real / 10e3 + 12


@pytest.mark.parametrize("same_size", [False, True])
def test_a_roms_grid_is_brought_to_centres_and_turned_by_its_angle(tmp_path, same_size):
    grid = around(10, 75)
    source = VelocityFile(saved(roms(same_size=same_size), tmp_path), grid, projection=POLAR)
    u, v = velocity(source, grid)
    expected = (0.1 + 0.01 * along_xi(grid) - 0.05j) * np.exp(1j * ROMS_TURN)
    np.testing.assert_allclose(u + 1j * v, expected, atol=1e-7)
    assert "C grid" in repr(source) and "angle" in repr(source)


@pytest.mark.parametrize("same_size", [False, True])
def test_components_of_a_roms_grid_given_in_the_wrong_order_are_refused(same_size):
    data, names = roms(same_size=same_size), ["v", "u"]
    with pytest.raises(InputError, match=r"v: .*\(eta_v, xi_v\) it is v, but is given as u"):
        VelocityFile(data, around(10, 75), variables=names, projection=POLAR)


def test_without_angle_the_direction_is_that_of_the_columns(tmp_path):
    grid = around(10, 75)
    path = saved(roms().drop_vars("angle"), tmp_path)
    u, v = velocity(VelocityFile(path, grid, projection=POLAR), grid)
    expected = (0.1 + 0.01 * along_xi(grid) - 0.05j) * np.exp(1j * ROMS_TURN)
    np.testing.assert_allclose(u + 1j * v, expected, atol=1e-5)


def test_components_have_units_and_masks_of_their_own_and_an_angle_may_be_in_degrees(tmp_path):
    grid, data = around(10, 75), roms()
    data["angle"] = np.degrees(data.angle).assign_attrs(units="degrees")
    data["v"] = (100 * data.v).assign_attrs(units="cm s-1")
    for name, v_there in (("open.nc", -0.05), ("closed.nc", 0.0)):
        u, v = velocity(VelocityFile(saved(data, tmp_path, name), grid, projection=POLAR), grid)
        expected = (0.1 + 0.01 * along_xi(grid) + 1j * v_there) * np.exp(1j * ROMS_TURN)
        np.testing.assert_allclose(u + 1j * v, expected, atol=1e-7)
        # of the second file: nothing flows through these faces
        data["mask_v"] = xr.zeros_like(data.v)


def test_an_angle_of_the_wrong_sign_is_warned_of(tmp_path):
    data = roms()
    data["angle"] = -data.angle
    with pytest.warns(UserWarning, match="angle differs from the direction of its columns"):
        VelocityFile(saved(data, tmp_path), around(10, 75), projection=POLAR)


def test_closed_faces_beside_water_stop_the_flow_and_land_is_never_touched(tmp_path):
    data = roms(same_size=True)
    data.mask_rho[:, 16:] = 0.0
    data.u[:] = np.where(np.arange(24) >= 15, 9.97e36, 0.2)  # faces 15 … are closed or on land
    data.v[:] = np.where(np.arange(24) >= 16, 9.97e36, 0.0)
    path = saved(data, tmp_path)
    z0 = complex(*(float(a) for a in to_plane(POLAR, 10, 75)))

    def speed_at(xi):
        z = z0 + 10e3 * (xi - 12) * np.exp(1j * ROMS_TURN)
        cell = Grid.uniform((z.real - 1, z.real + 1), (z.imag - 1, z.imag + 1), shape=(1, 1))
        return abs(
            complex(*(a[0] for a in velocity(VelocityFile(path, cell, projection=POLAR), cell)))
        )

    assert speed_at(14) == pytest.approx(0.2)
    assert speed_at(15) == pytest.approx(0.1)  # one of its two faces is the coast
    assert speed_at(15.4) == pytest.approx(0.1)  # land has no weight
    with pytest.raises(InputError, match="only land"):
        speed_at(17)


def test_around_the_globe_the_first_face_comes_after_the_last():
    """Faces before the centres: those of the last of four columns are the fourth and, if the grid closes, the first."""
    flow = np.array([1.0, 2.0, 3.0, 8.0])
    for periodic, last in ((True, 4.5), (False, 8.0)):
        mean, used = mean_of_faces(4, slice(2, 4), (0, 1), periodic)
        assert (mean @ flow[used]).tolist() == [5.5, last]
    mean, used = mean_of_faces(4, slice(0, 2), (-1, 0), True)
    assert (mean @ flow[used]).tolist() == [4.5, 1.5]


def test_a_face_beyond_the_end_of_the_file_does_not_count():
    x0, y0 = (float(a) for a in to_plane(POLAR, 10, 75))
    z = x0 + 1j * y0 + 10e3 * (-12 + 0j) * np.exp(1j * ROMS_TURN)  # the first column of centres
    cell = Grid.uniform((z.real - 1, z.real + 1), (z.imag - 1, z.imag + 1), shape=(1, 1))
    u, v = velocity(VelocityFile(roms(), cell, projection=POLAR), cell)
    expected = (0.105 - 0.05j) * np.exp(1j * ROMS_TURN)
    np.testing.assert_allclose(u + 1j * v, expected, atol=1e-6)


@pytest.mark.parametrize("before", [True, False])
def test_an_mitgcm_grid_on_longitude_and_latitude_is_told_by_its_coordinates(tmp_path, before):
    lon, lat = np.arange(0.0, 20), np.arange(70.0, 80)
    shift = -0.5 if before else 0.5
    lon_u, lat_v = lon + shift, lat + shift
    data = xr.Dataset(
        {
            "uo": (("lat", "lon_u"), np.broadcast_to(0.01 * lon_u, (10, 20)), ALONG_X),
            "vo": (("lat_v", "lon"), np.broadcast_to(0.01 * lat_v[:, None], (10, 20)), ALONG_Y),
        },
        {
            "lon": ("lon", lon, {"units": "degrees_east"}),
            "lat": ("lat", lat, {"units": "degrees_north"}),
            "lon_u": ("lon_u", lon_u, {"units": "degrees_east"}),
            "lat_v": ("lat_v", lat_v, {"units": "degrees_north"}),
        },
    )
    grid = around(10, 75)
    u, v = velocity(VelocityFile(saved(data, tmp_path), grid, projection=POLAR), grid)
    lons, lats = to_lonlat(POLAR, grid.x, grid.y)
    z = (u + 1j * v) * np.exp(-1j * np.radians(lons + 45))
    np.testing.assert_allclose(z, 0.01 * (lons + 1j * lats), atol=2e-4)


@pytest.mark.parametrize(
    "dims, first",
    [
        (("eta_rho", "xi_u", "eta_v", "xi_rho"), 0.5),  # ROMS
        (("y_grid_T", "x_grid_U", "y_grid_V", "x_grid_T"), 0.5),  # NEMO
        (("y_grid_T_inner", "x_grid_U_inner", "y_grid_V_inner", "x_grid_T_inner"), 0.5),
        (("YC", "XG", "YG", "XC"), -0.5),  # MITgcm
        (("j", "i_g", "j_g", "i"), -0.5),  # MITgcm through xmitgcm
        (("yt", "xu", "yu", "xt"), None),  # Veros (0.5), and others
        (("y", "x_u", "y_v", "x"), None),
    ],
)
def test_names_of_dimensions_tell_the_side_of_faces_only_where_they_are_of_one_model(dims, first):
    data, grid = roms(same_size=True), around(10, 75)
    u = 0.1 + 0.01 * (np.arange(24) + (first or 0.5)) + np.zeros((20, 1))
    faces = {"U": (dims[:2], u, ALONG_X), "V": (dims[2:], data.v.values, ALONG_Y)}
    centres = {
        name: ((dims[0], dims[3]), data[f"{name}_rho"].values, data[f"{name}_rho"].attrs)
        for name in ("lon", "lat")
    }
    data = xr.Dataset(faces | centres)  # nothing says where the faces are but names
    if first is None:
        with pytest.raises(InputError, match="not on which side of the centres"):
            VelocityFile(data, grid, projection=POLAR)
        return
    expected = (0.1 + 0.01 * along_xi(grid) - 0.05j) * np.exp(1j * ROMS_TURN)
    u, v = velocity(VelocityFile(data, grid, projection=POLAR), grid)
    np.testing.assert_allclose(u + 1j * v, expected, atol=1e-5)


def test_nemo_files_of_u_and_v_get_their_centres_from_a_third_file_or_from_u(tmp_path):
    data = roms(same_size=True)
    x0, y0 = (float(a) for a in to_plane(POLAR, 10, 75))
    eta, xi = np.mgrid[0:20, 0:24].astype(float)

    def positions(dj, di):
        z = 10e3 * ((xi + di - 12) + 1j * (eta + dj - 10)) * np.exp(1j * ROMS_TURN)
        lon, lat = to_lonlat(POLAR, x0 + z.real, y0 + z.imag)
        return {
            "nav_lon": (("y", "x"), lon, {"units": "degrees_east"}),
            "nav_lat": (("y", "x"), lat, {"units": "degrees_north"}),
        }

    u_file, v_file, t_file = (
        saved(xr.Dataset(parts), tmp_path, name)
        for name, parts in (
            ("grid_U.nc", {"vozocrtx": (("y", "x"), data.u.values, M_PER_S), **positions(0, 0.5)}),
            ("grid_V.nc", {"vomecrty": (("y", "x"), data.v.values, M_PER_S), **positions(0.5, 0)}),
            ("grid_T.nc", positions(0, 0)),
        )
    )
    grid = around(10, 75)
    expected = (0.1 + 0.01 * along_xi(grid) - 0.05j) * np.exp(1j * ROMS_TURN)
    for paths in ([u_file, v_file, t_file], [u_file, v_file]):
        u, v = velocity(VelocityFile(paths, grid, projection=POLAR), grid)
        np.testing.assert_allclose(u + 1j * v, expected, atol=1e-5)


# ------------------------------------------------------------------------------------ place and land


def test_interpolation_is_exact_for_a_bilinear_field_and_half_a_cell_beyond_it_is_constant():
    data = metres(lambda x, y: 0.1 * x + 0.01 * x * y, lambda x, y: 0.2 * y)
    grid = Grid.uniform((-0.4, 10.2), (-0.4, 10.2), shape=(9, 9))
    u, v = velocity(VelocityFile(data, grid), grid)
    x, y = np.clip(grid.x, 0, 10), np.clip(grid.y, 0, 10)
    np.testing.assert_allclose(u, 0.1 * x + 0.01 * x * y, atol=1e-14)
    np.testing.assert_allclose(v, 0.2 * y, atol=1e-14)


def test_rows_from_north_to_south_and_columns_first_change_nothing():
    data = metres(lambda x, y: 0.1 * x, lambda x, y: 0.2 * y)
    grid = square(9.0)
    expected = velocity(VelocityFile(data, grid), grid)
    for other in (data.isel(y=slice(None, None, -1)), data.transpose("x", "y")):
        np.testing.assert_allclose(velocity(VelocityFile(other, grid), grid), expected, atol=1e-15)


def test_longitudes_wrap_around_the_globe_whatever_range_they_are_given_in():
    lat = np.arange(60.0, 89.5)
    answers = []
    for lon in (np.arange(0.0, 360), np.arange(-180.0, 180), np.arange(180.0, -180, -1)):
        u = np.broadcast_to(np.cos(np.radians(lon)), (30, 360))
        data = on_axes(u, 0 * u, lon, lat, EAST, NORTH, ("lat", "lon"))
        for place in ((0.3, 75), (-179.9, 75), (0, 90)):
            grid = around(*place)
            answers.append(np.array(velocity(VelocityFile(data, grid, projection=POLAR), grid)))
    for k in range(3):
        np.testing.assert_allclose(answers[k], answers[k + 3], atol=1e-13)
        np.testing.assert_allclose(answers[k], answers[k + 6], atol=1e-13)


def test_a_region_across_greenwich_may_be_numbered_from_0_to_360():
    lon, lat = np.arange(350.0, 370), np.arange(70.0, 80)
    u = np.broadcast_to(0.01 * (lon - 360), (10, 20))
    data = on_axes(u, 0 * u, lon % 360, lat, EAST, NORTH, ("lat", "lon"))
    grid = around(0, 75)
    u, v = velocity(VelocityFile(data, grid, projection=POLAR), grid)
    lons = to_lonlat(POLAR, grid.x, grid.y)[0]
    z = (u + 1j * v) * np.exp(-1j * np.radians(lons + 45))
    np.testing.assert_allclose(z, 0.01 * lons, atol=1e-4)


@pytest.mark.parametrize("east, west", [(60, 300), (100, 250)])
def test_longitudes_that_were_left_out_are_a_hole_and_those_around_greenwich_none(east, west):
    lon, lat = np.arange(0.0, 360), np.arange(60.0, 81)
    flow = spin(*np.meshgrid(lon, lat))
    data = on_axes(*flow, lon, lat, EAST, NORTH, ("lat", "lon"))
    chosen = data.isel(lon=(lon < east) | (lon > west))
    for place in ((0, 70), (359.5, 70), (40, 75), (320, 65)):
        grid = around(*place)
        u, v = velocity(VelocityFile(chosen, grid, projection=POLAR), grid)
        np.testing.assert_allclose(u + 1j * v, spin_in_plane(grid, POLAR), atol=0.002)
    for place in ((east + 2, 70), (180, 70), (west - 1, 70)):
        with pytest.raises(InputError, match=f"nothing between lon {east - 1} and {west + 1}"):
            VelocityFile(chosen, around(*place), projection=POLAR)


@pytest.mark.parametrize("pole", [-90, 90])
def test_the_last_row_of_a_global_file_reaches_the_pole(pole):
    plane = f"+proj=laea +lat_0={pole} +lon_0=0 +datum=WGS84"
    lon, lat = np.arange(0.0, 360, 2), np.arange(-88.5, 89, 1.5)
    one = np.ones((lat.size, lon.size))
    grid = around(0, pole, plane, half=20e3)
    source = VelocityFile(
        on_axes(0.1 * one, 0 * one, lon, lat, EAST, NORTH, ("lat", "lon")), grid, projection=plane
    )
    z = np.array([1, 1j]) @ velocity(source, grid)
    radius = (grid.x + 1j * grid.y) / np.hypot(grid.x, grid.y)
    np.testing.assert_allclose(z, 0.1j * np.sign(pole) * radius, atol=3e-4)  # around the pole


def test_land_that_is_nan_or_masked_has_no_weight():
    hole = metres(0.3, lambda x, y: np.where(x > 5, np.nan, 0.1))
    masked = metres(
        lambda x, y: np.where(x > 5, 0.0, 0.3), lambda x, y: np.where(x > 5, 0.0, 0.1),
        mask=(("y", "x"), np.broadcast_to(np.arange(11) <= 5, (11, 11)).astype(int)),
    )  # fmt: skip
    grid = Grid.uniform((0, 5.8), (0, 8), shape=(4, 29))
    for data in (hole, masked):
        u, v = velocity(VelocityFile(data, grid), grid)
        np.testing.assert_allclose((u, v), (np.full(116, 0.3), np.full(116, 0.1)))
    u, _ = velocity(VelocityFile(masked, grid, mask="none"), grid)
    assert u.min() < 0.29  # the negative control: zeros on land taken for water


def test_a_mask_whose_flags_say_that_one_is_land_is_believed():
    land = np.broadcast_to(np.arange(11) > 5, (11, 11)).astype(int)
    flags = {"flag_values": [0, 1], "flag_meanings": "sea land"}
    data = metres(0.3, 0.1, mask=(("y", "x"), land, flags))
    with pytest.raises(InputError, match="only land"):
        VelocityFile(data, Grid.uniform((7, 9), (0, 8), shape=(4, 4)))
    VelocityFile(data, Grid.uniform((1, 4), (0, 8), shape=(4, 4)))


@pytest.mark.parametrize(
    "standard, percent, water",
    [("sea_area_fraction", 10, False), ("sea_area_fraction", 90, True)]
    + [("land_area_fraction", 10, True), ("land_area_fraction", 90, False)],
)
def test_a_mask_in_percent_is_water_from_half_of_a_cell_on(standard, percent, water):
    attrs = {"standard_name": standard, "units": "%"}
    share = (("y", "x"), np.full((11, 11), float(percent)), attrs)
    source = VelocityFile(metres(0.5, 0, share=share), square(), fill_land="dry")
    assert source.covered.all() == source.covered.any() == water


def test_a_cell_that_is_water_in_part_of_its_depth_is_water():
    for share, water in ((0.2, True), (0.0, False)):
        data = metres(0.5, 0, hFacC=(("y", "x"), np.full((11, 11), share)))
        source = VelocityFile(data, square(), fill_land="dry")
        assert source.covered.all() == source.covered.any() == water


def test_wind_blows_over_land_unless_a_mask_is_named():
    wind = {"u_attrs": M_PER_S | {"standard_name": "x_wind"}}
    wind["v_attrs"] = M_PER_S | {"standard_name": "y_wind"}
    data = metres(5.0, 0.0, mask=(("y", "x"), np.zeros((11, 11))), **wind)
    assert velocity(VelocityFile(data, square(), kind="wind"), square())[0][0] == 5
    with pytest.raises(InputError, match="only land"):
        VelocityFile(data, square(), kind="wind", mask="mask")


@pytest.mark.parametrize("land", ["nan", "fill value", "mask"])
def test_a_scene_whose_wet_cells_are_land_in_its_file_is_refused_in_a_line(tmp_path, land):
    gone = np.arange(11.0) > 5
    mask = {"mask": (("y", "x"), np.tile(~gone, (11, 1)).astype("i1"))} if land == "mask" else {}
    value = 0.1 if land == "mask" else np.nan
    data = metres(lambda x, y: np.where(x > 5, value, 0.1), 0.1, **mask)
    for name in ("uo", "vo") if land == "fill value" else ():
        data[name].encoding = {"_FillValue": -999.0}
    saved(data, tmp_path)
    path = tmp_path / "scene.toml"
    path.write_text(
        "[domain]\nx = [0, 10]\ny = [0, 10]\n[grid]\nspacing = 2\n[ocean]\nfile = 'currents.nc'\n"
    )
    with pytest.raises(InputError) as told:
        read_scene(path).build()
    assert str(told.value) == (
        f"{path}: [ocean] currents.nc: uo, vo: 10 of 25 wet cells have only land of the file around them, the first is"
        " cell 3 at x 7, y 1 m: make them dry, as the land of a [coast] is, or take fill_land = 'nearest', the nearest"
        " water of the file, or 'dry', 0"
    )
    at_rest = read_scene(path, ["ocean.fill_land=dry"]).build()
    u, _ = velocity(at_rest.ocean, at_rest.model.grid)
    assert (u[at_rest.model.grid.x > 6] == 0).all() and at_rest.model.grid.wet.all()


def test_a_wet_cell_on_the_files_land_is_an_error_unless_told_what_it_gets():
    data = metres(lambda x, y: np.where(x > 5, np.nan, 0.1 * x), 0.1)
    grid = square(10.0)
    with pytest.raises(InputError, match="10 of 25 wet cells have only land.*fill_land"):
        VelocityFile(data, grid)
    source = VelocityFile(data, grid, fill_land="dry")
    np.testing.assert_array_equal(source.covered, grid.x < 6)
    u, _ = velocity(source, grid)
    assert (u[~source.covered] == 0).all()
    near = VelocityFile(data, grid, fill_land="nearest")
    assert near.covered.all() and "10 of them from water up to 0.0 km away" in repr(near)
    np.testing.assert_allclose(velocity(near, grid)[0][grid.x > 6], 0.5)
    inland = Grid.uniform((9, 10), (4, 5), shape=(1, 1))
    assert velocity(VelocityFile(data, inland, fill_land="nearest"), inland)[0][0] == 0.5
    dry = grid.with_wet(grid.x < 6)
    np.testing.assert_array_equal(VelocityFile(data, dry).covered, dry.wet)


def test_a_grid_beyond_the_file_is_an_error_that_names_what_it_covers(tmp_path):
    lon, lat = np.arange(0.0, 20), np.arange(70.0, 80)
    one = np.ones((10, 20))
    path = saved(on_axes(one, one, lon, lat, EAST, NORTH, ("lat", "lon")), tmp_path)
    with pytest.raises(InputError) as error:
        VelocityFile(path, around(21, 75), projection=POLAR)
    text = str(error.value)
    assert "lon -0.5 … 19.5, lat 69.5 … 79.5" in text and "currents.nc" in text and "\n" not in text


def test_longitudes_without_a_projection_are_an_error_that_proposes_one():
    lon, lat = np.arange(0.0, 20), np.arange(70.0, 80)
    one = np.ones((10, 20))
    with pytest.raises(InputError, match=r"projection = '\+proj=laea \+lat_0=74.5 \+lon_0=9.5"):
        VelocityFile(on_axes(one, one, lon, lat, EAST, NORTH, ("lat", "lon")), square())


def twice_placed(shift):
    """x, y [km] with a projection, and 2-D longitude and latitude shifted by `shift` metres."""
    x = np.arange(-500e3, 501e3, 100e3)
    x2, y2 = np.meshgrid(x, x)
    lon, lat = to_lonlat(POLAR, x2 + shift, y2)
    mapped = {"grid_mapping": "crs"}
    data = on_axes(x2 / 1e6, 0 * x2, x / 1e3, x / 1e3, ALONG_X | mapped, ALONG_Y | mapped)
    data["x"].attrs["units"] = data["y"].attrs["units"] = "km"
    data["crs"] = ((), 0, {"grid_mapping_name": "polar_stereographic", "proj4": POLAR})
    data["lon"] = (("y", "x"), lon, {"units": "degrees_east"})
    data["lat"] = (("y", "x"), lat, {"units": "degrees_north"})
    return data


def test_positions_that_disagree_are_warned_of_and_the_user_chooses():
    grid = Grid.uniform((-200e3, 200e3), (-200e3, 200e3), shape=(4, 4))
    with pytest.warns(UserWarning, match=r"disagree by 4\d\.\d km \(0\.4 cells\)") as told:
        mapped = velocity(VelocityFile(twice_placed(40e3), grid), grid)[0]
    assert told[0].filename == __file__
    np.testing.assert_allclose(mapped, grid.x / 1e6, atol=1e-12)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        placed = velocity(VelocityFile(twice_placed(40e3), grid, position="lonlat"), grid)[0]
        VelocityFile(twice_placed(10e3), grid)
    np.testing.assert_allclose(placed, (grid.x - 40e3) / 1e6, atol=1e-8)


# ------------------------------------------------------------------------------ curvilinear nets of the globe


def on_sphere(lon, lat):
    """Unit vectors (3, …) of places [degrees], of east and of north there."""
    lon, lat = np.radians(lon), np.radians(lat)
    out = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    east = np.array([-np.sin(lon), np.cos(lon), 0 * lon])
    return out, east, np.cross(out, east, axis=0)


def spin(lon, lat):
    """East and north of a rotation of the whole sphere [m/s]: the same flow whatever the grid."""
    out, east, north = on_sphere(lon, lat)
    flow = np.cross([0.3, -0.5, 0.8], out, axisb=0, axisc=0)
    return np.sum(flow * east, axis=0), np.sum(flow * north, axis=0)


def spin_in_plane(grid, plane):
    lon, lat = to_lonlat(plane, grid.x, grid.y)
    east, north = spin(lon, lat)
    return (east + 1j * north) * np.exp(1j * east_in_plane(plane, lon, lat))


def spin_on_rotated_pole(lon, lat, pole=40.0):
    """The rotation on a grid whose own pole stands at latitude `pole` of the date line, along its own axes."""
    own_lon, own_lat = np.meshgrid(lon, lat)
    turn = np.radians(90.0 - pole)
    back = np.array([[np.cos(turn), 0, -np.sin(turn)], [0, 1, 0], [np.sin(turn), 0, np.cos(turn)]])
    out, along, across = (np.tensordot(back, v, 1) for v in on_sphere(own_lon, own_lat))
    flow = np.cross([0.3, -0.5, 0.8], out, axisb=0, axisc=0)
    u, v = np.sum(flow * along, axis=0), np.sum(flow * across, axis=0)
    x, y, z = out
    return xr.Dataset(
        {
            "uo": (("rlat", "rlon"), u, ALONG_X),
            "vo": (("rlat", "rlon"), v, ALONG_Y),
            "lon": (("rlat", "rlon"), np.degrees(np.arctan2(y, x)), {"units": "degrees_east"}),
            "lat": (("rlat", "rlon"), np.degrees(np.arcsin(z)), {"units": "degrees_north"}),
        },
        {
            "rlon": ("rlon", lon, {"units": "degrees", "standard_name": "grid_longitude"}),
            "rlat": ("rlat", lat, {"units": "degrees", "standard_name": "grid_latitude"}),
        },
    )


@pytest.mark.parametrize("plane", [POLAR, "+proj=laea +lat_0=88 +lon_0=30", "+proj=merc +lon_0=25"])
def test_a_net_of_the_globe_does_not_cover_places_twice_where_the_plane_is_torn(plane):
    lat = {"merc": 70}.get(plane[6:10], 90)
    grid = around(25, lat, plane, half=400e3, n=40)
    data = spin_on_rotated_pole(np.arange(0.0, 360), np.arange(-89.5, 90))
    u, v = velocity(VelocityFile(data, grid, projection=plane), grid)
    np.testing.assert_allclose(u + 1j * v, spin_in_plane(grid, plane), atol=0.01)


def test_a_net_around_the_globe_has_no_gap_between_its_last_column_and_its_first():
    data = spin_on_rotated_pole(np.arange(0.0, 360), np.arange(-89.5, 90))
    for row in (110, 130, 150):
        plane = f"+proj=laea +lon_0={data.lon.values[row, 0]} +lat_0={data.lat.values[row, 0]}"
        grid = Grid.uniform((-150e3, 150e3), (-150e3, 150e3), shape=(150, 150))
        u, v = velocity(VelocityFile(data, grid, projection=plane), grid)
        np.testing.assert_allclose(u + 1j * v, spin_in_plane(grid, plane), atol=0.005)


@pytest.mark.parametrize("rows, columns", [(-1, 1), (1, -1), (-1, -1)])
def test_components_along_axes_that_fall_are_positive_where_their_coordinates_grow(rows, columns):
    data = spin_on_rotated_pole(np.arange(-10.0, 11), np.arange(30.0, 51))
    turned = data.isel(rlat=slice(None, None, rows), rlon=slice(None, None, columns))
    grid = around(data.lon.values[10, 10], data.lat.values[10, 10])
    u, v = velocity(VelocityFile(turned, grid, projection=POLAR), grid)
    np.testing.assert_allclose(u + 1j * v, spin_in_plane(grid, POLAR), atol=0.002)


def test_degrees_about_a_rotated_pole_are_no_longitudes_whatever_their_units():
    data = spin_on_rotated_pole(np.arange(-10.0, 11), np.arange(30.0, 51))
    grid = around(data.lon.values[10, 10], data.lat.values[10, 10])
    data.rlon.attrs, data.rlat.attrs = {"units": "degrees_east"}, {"units": "degrees_north"}
    data["pole"] = ((), 0, {"grid_mapping_name": "rotated_latitude_longitude"})
    u, v = velocity(VelocityFile(data, grid, projection=POLAR), grid)
    np.testing.assert_allclose(u + 1j * v, spin_in_plane(grid, POLAR), atol=0.002)
    with pytest.raises(InputError, match="neither longitude and latitude nor x and y"):
        VelocityFile(data.drop_vars(["lon", "lat"]), grid, projection=POLAR)


def nominal():
    """A tripolar grid's kind of file: axes of nominal longitude and latitude, the true ones in 2-D."""
    data = spin_on_rotated_pole(np.arange(-10.0, 11), np.arange(30.0, 51))
    data.rlon.attrs = {"units": "degrees_east", "long_name": "h point nominal longitude"}
    data.rlat.attrs = {"units": "degrees_north", "long_name": "h point nominal latitude"}
    return data


@pytest.mark.parametrize("apart", [False, True])
def test_longitudes_in_2d_go_before_nominal_ones_along_axes_with_a_warning(apart):
    data = nominal()
    grid = around(data.lon.values[10, 10], data.lat.values[10, 10])
    files = [data[["uo", "vo"]], data[["lon", "lat"]]] if apart else data
    with pytest.warns(UserWarning, match="axes of latitude and longitude and lat, lon disagree"):
        source = VelocityFile(files, grid, projection=POLAR)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        told = VelocityFile(files, grid, projection=POLAR, position="lonlat")
        axes = VelocityFile(files, around(0, 40), projection=POLAR, position="mapping")
    for found in (source, told):
        u, v = velocity(found, grid)
        np.testing.assert_allclose(u + 1j * v, spin_in_plane(grid, POLAR), atol=0.002)
    assert "lat, lon;" in repr(axes) and "curvilinear" not in repr(axes)


def test_nominal_longitudes_alone_are_warned_of():
    with pytest.warns(UserWarning, match="nominal by their long_name"):
        VelocityFile(nominal().drop_vars(["lon", "lat"]), around(0, 40), projection=POLAR)


def test_positions_and_masks_may_stand_in_a_file_of_their_own():
    data = spin_on_rotated_pole(np.arange(-10.0, 11), np.arange(30.0, 51)).drop_vars(
        ["rlon", "rlat"]
    )
    grid = around(data.lon.values[10, 10], data.lat.values[10, 10])
    places = data[["lon", "lat"]]
    u, v = velocity(VelocityFile([data[["uo", "vo"]], places], grid, projection=POLAR), grid)
    np.testing.assert_allclose(u + 1j * v, spin_in_plane(grid, POLAR), atol=0.002)
    places["mask"] = places.lon * 0.0
    for mask in ("auto", "mask"):
        with pytest.raises(InputError, match="have only land of the file around them"):
            VelocityFile([data[["uo", "vo"]], places], grid, projection=POLAR, mask=mask)
    # of two files without places none tells whether u and v stand at the same points
    with pytest.raises(InputError, match="where its points are is not said"):
        VelocityFile([data[["uo"]], data[["vo"]], places], grid, projection=POLAR)


# ------------------------------------------------------------------------------------- names and units


@pytest.mark.parametrize(
    "units, factor",
    [("m s-1", 1), ("meter second-1", 1), ("m/s", 1), ("cm/s", 0.01), ("km h-1", 1 / 3.6)]
    + [("knots", 1852 / 3600), ("m s**-1", 1), ("metres per second", 1)],
)
def test_units_are_converted(units, factor):
    grid = square()
    data = metres(2.0, 1.0, u_attrs={"units": units}, v_attrs={"units": units})
    u, v = velocity(VelocityFile(data, grid), grid)
    np.testing.assert_allclose((u[0], v[0]), (2 * factor, factor))


@pytest.mark.parametrize("attrs", [{}, {"units": "m"}, {"units": "ms-1"}, {"units": "Pa"}])
def test_units_that_are_no_velocity_are_refused_unless_told(attrs):
    data = metres(2.0, 1.0, u_attrs=attrs, v_attrs=attrs)
    with pytest.raises(InputError, match="data set: uo.*must be a velocity"):
        VelocityFile(data, square())
    u, _ = velocity(VelocityFile(data, square(), units="cm s-1"), square())
    assert u[0] == pytest.approx(0.02)


def test_standard_names_go_before_short_names_and_explicit_names_before_both():
    data = metres(0.1, 0.0)
    data["u10"], data["v10"] = (data[n] * 0 + 7 for n in ("uo", "vo"))
    data["a"], data["b"] = (data[n] * 0 + 5 for n in ("uo", "vo"))
    for name, standard in zip("uvab", ("", "", "eastward_wind", "northward_wind"), strict=True):
        if standard:
            data[name].attrs = M_PER_S | {"standard_name": standard}
    data["u10"].attrs = data["v10"].attrs = M_PER_S
    grid = square()
    assert velocity(VelocityFile(data, grid, kind="wind", vectors="grid"), grid)[0][0] == 5
    named = VelocityFile(data, grid, kind="wind", variables=("u10", "v10"))
    assert velocity(named, grid)[0][0] == 7
    assert velocity(VelocityFile(data, grid), grid)[0][0] == 0.1


def test_two_that_fit_or_none_are_errors_that_list_the_candidates():
    data = metres(0.1, 0.0)
    data["u_2"], data["v_2"] = data.uo, data.vo
    with pytest.raises(InputError, match="uo, u_2, vo, v_2 all have standard_name"):
        VelocityFile(data, square())
    with pytest.raises(InputError, match="no wind found.*uo .sea_water_x_velocity, m s-1."):
        VelocityFile(data, square(), kind="wind")
    with pytest.raises(InputError, match="did you mean 'u_2'"):
        VelocityFile(data, square(), variables=("u_3", "v_2"))
    plain = metres(0.1, 0.0, u_attrs=M_PER_S, v_attrs=M_PER_S)
    plain["u"], plain["v"] = plain.uo, plain.vo
    with pytest.raises(InputError, match="uo, vo or u, v could be"):
        VelocityFile(plain, square())


def test_the_level_nearest_to_the_depth_is_taken_and_other_dimensions_must_be_chosen():
    data = metres(0.1, 0.0)
    levels = xr.concat([data * k for k in (3.0, 2.0, 1.0)], dim="depth")
    levels = levels.assign_coords(depth=("depth", [50.0, 10.0, 0.5], {"units": "m"}))
    levels.uo.attrs, levels.vo.attrs = ALONG_X, ALONG_Y
    grid = square()
    assert velocity(VelocityFile(levels, grid), grid)[0][0] == pytest.approx(0.1)
    assert velocity(VelocityFile(levels, grid, depth=12), grid)[0][0] == pytest.approx(0.2)
    for by, units in ((1.0, "m"), (1e3, "km")):  # heights below 0, as in ROMS
        told = levels.assign_coords(
            depth=("depth", [-50 / by, -10 / by, -0.5 / by], {"units": units})
        )
        for depth, u in ((0.0, 0.1), (12.0, 0.2), (40.0, 0.3)):
            source = VelocityFile(told, grid, depth=depth)
            assert velocity(source, grid)[0][0] == pytest.approx(u)
    members = levels.drop_vars("depth").rename(depth="member")
    with pytest.raises(InputError, match="member, .*choose with select"):
        VelocityFile(members, grid)
    third = VelocityFile(members, grid, select={"member": 0})
    assert velocity(third, grid)[0][0] == pytest.approx(0.3)
    with pytest.raises(InputError, match="it has 3 entries"):
        VelocityFile(members, grid, select={"member": 3})


def test_of_wind_at_several_heights_that_at_10_m_is_taken_and_of_pressures_none():
    data = metres(1.0, 0.0).rename(uo="u10", vo="v10")
    levels = xr.concat([data * k for k in (7.0, 9.0, 8.0)], dim="height")
    levels = levels.assign_coords(height=("height", [2.0, 100.0, 10.0], {"units": "m"}))
    levels.u10.attrs = M_PER_S | {"standard_name": "x_wind"}
    levels.v10.attrs = M_PER_S | {"standard_name": "y_wind"}
    grid = square()
    assert velocity(VelocityFile(levels, grid, kind="wind"), grid)[0][0] == pytest.approx(8.0)
    low = VelocityFile(levels, grid, kind="wind", depth=2.0)
    assert velocity(low, grid)[0][0] == pytest.approx(7.0)
    levels.height.attrs = {"units": "hPa", "axis": "Z"}
    with pytest.raises(InputError, match="'height' are not in metres: choose with select"):
        VelocityFile(levels, grid, kind="wind")
    third = VelocityFile(levels, grid, kind="wind", select={"height": 1})
    assert velocity(third, grid)[0][0] == pytest.approx(9.0)


@pytest.mark.parametrize(
    "option, word",
    [
        ({"kind": "air"}, "ocean, wind"),
        ({"vectors": "north"}, "east-north"),
        ({"fill_land": "near"}, "did you mean 'nearest'"),
        ({"beyond_span": "loop"}, "error, hold, repeat"),
        ({"position": "xy"}, "lonlat"),
        ({"stagger": "C"}, "after"),
        ({"mask": "wett"}, "no such variable"),
        ({"variables": "uo"}, "two names"),
        ({"select": {"levle": 1}}, "levle"),
        ({"select": {"x": "a"}}, "select x = 'a': must be a whole number"),
        ({"select": {"x": 1.5}}, "select x = 1.5: must be a whole number"),
        ({"select": "x"}, "select = 'x': must be a dict"),
        ({"projection": "EPSG:4326"}, "metres"),
        ({"calendar": ["noleap"]}, "calendar = .*: must be a text"),
    ],
)
def test_an_option_that_is_not_allowed_is_refused_in_one_line(option, word):
    with pytest.raises(InputError, match=word) as error:
        VelocityFile(metres(0.1, 0.0), square(), **option)
    assert "\n" not in str(error.value)


def test_a_file_that_is_not_there_or_not_a_grid_is_an_error_in_one_line(tmp_path):
    saved(metres(0.1, 0.0), tmp_path)
    with pytest.raises(InputError, match="no such file; did you mean 'currents.nc'"):
        VelocityFile(tmp_path / "curents.nc", square())
    with pytest.raises(InputError, match=r"^path = \[\]: must be a file, several"):
        VelocityFile([], square())
    (tmp_path / "text.nc").write_text("not NetCDF")
    with pytest.raises(InputError, match="is no NetCDF file, or a damaged one$"):
        VelocityFile(tmp_path / "text.nc", square())
    mesh = xr.Dataset({n: ("node", np.zeros(9), M_PER_S) for n in ("uo", "vo")})
    with pytest.raises(InputError, match="meshes and trajectories are not read"):
        VelocityFile(mesh, square())


@pytest.mark.parametrize(
    "kind", ["NETCDF3_CLASSIC", "NETCDF3_64BIT", "NETCDF3_64BIT_DATA", "NETCDF4"]
)
@pytest.mark.parametrize("records", ["of all", "of one", "none"])
def test_a_file_that_was_cut_short_is_refused(tmp_path, kind, records):
    """The library reads zeros beyond the end of NetCDF's classic formats, a current as good as any."""
    data = metres(0.1, 0.2).assign_attrs(title="odd", levels=np.arange(3, dtype="i2"))
    if records != "none":
        data = xr.concat([data, data], xr.Variable("time", [0.0, 3600.0], {"units": "s"}))
        if records == "of one":  # its records are not padded
            data = data.assign(vo=data.vo[0].drop_vars("time")).drop_vars("time")
    data = data.drop_vars(["x", "y"])
    data["uo"] = data.uo.astype("i2")  # 242 bytes, which are padded to 244 or not
    path = tmp_path / "currents.nc"
    data.to_netcdf(path, format=kind, engine="netcdf4", unlimited_dims=set(data.dims) & {"time"})
    whole = path.read_bytes()
    assert open_files(path)[0].data.equals(data)
    for left in (len(whole) - 4, len(whole) - 200):
        path.write_bytes(whole[:left])
        with pytest.raises(InputError, match=r"cut short: it has|cannot be read as NetCDF"):
            open_files(path)


# ------------------------------------------------------------------------------------------------ time


def test_time_is_linear_between_records_whatever_the_order_of_calls(tmp_path):
    path = saved(in_time(metres(0.1, -0.2), DAYS), tmp_path)
    grid = square()
    source = VelocityFile(path, grid)
    assert source.span == (0.0, 3 * 86400.0)
    for t in (0.0, 0.25, 2.0, 1.0, 3.0, 0.5):
        factor = 1 + np.interp(t, [0, 1, 3], [0, 1, 2])
        u, v = velocity(source, grid, t * 86400)
        np.testing.assert_allclose((u, v), (np.full(25, 0.1 * factor), np.full(25, -0.2 * factor)))
    assert len(source._records) <= 2


@pytest.mark.parametrize(
    "start",
    ["2016-02-02", "2016-02-02T00:00Z", np.datetime64("2016-02-02"), "2016-02-02T01:00+01:00"],
)
def test_the_start_shifts_the_clock(start):
    source = VelocityFile(in_time(metres(0.1, 0.0), DAYS), square(), start=start)
    assert source.span == (-86400.0, 2 * 86400.0)
    assert velocity(source, square())[0][0] == pytest.approx(0.2)


def test_a_time_outside_the_span_is_an_error_that_says_what_span_exists():
    source = VelocityFile(in_time(metres(0.1, 0.0), DAYS), square(), start="2016-02-02")
    with pytest.raises(InputError) as error:
        velocity(source, square(), 2.5 * 86400)
    text = str(error.value)
    assert "t = 216000 s (2016-02-04T12:00)" in text
    assert "2016-02-01 … 2016-02-04 (t = -86400 … 172800 s, 3 records)" in text
    assert "\n" not in text


def test_beyond_the_span_fields_hold_or_repeat_if_asked():
    data = in_time(metres(0.1, 0.0), DAYS[:2])
    hold = VelocityFile(data, square(), beyond_span="hold")
    repeat = VelocityFile(data, square(), beyond_span="repeat")
    assert hold.span is None and repeat.span is None
    for t, held, repeated in (
        (-1.0, 0.1, 0.2),
        (5.25, 0.2, 0.175),
        (1.5, 0.2, 0.15),
        (2.0, 0.2, 0.1),
    ):
        assert velocity(hold, square(), t * 86400)[0][0] == pytest.approx(held)
        assert velocity(repeat, square(), t * 86400)[0][0] == pytest.approx(repeated)


@pytest.mark.parametrize("t", [None, "1979-01-16", [0.0, 1.0], np.nan, object()])
@pytest.mark.parametrize("times", [DAYS, DAYS[:1]], ids=len)
def test_what_is_no_time_is_refused_in_one_line(t, times):
    source = VelocityFile(in_time(metres(0.1, 0.0), times), square())
    with pytest.raises(InputError, match="must be a finite number of seconds"):
        velocity(source, square(), t)


def test_a_sum_of_steps_meets_the_last_record_in_spite_of_round_off():
    source = VelocityFile(in_time(metres(0.1, 0.0), DAYS), square())
    last = 3 * 86400.0
    assert velocity(source, square(), last * (1 + 1e-12))[0][0] == pytest.approx(0.3)
    with pytest.raises(InputError, match="is outside the file's times"):
        velocity(source, square(), last + 0.01)


def test_after_uneven_records_the_first_comes_again_after_the_mean_interval():
    source = VelocityFile(in_time(metres(0.1, 0.0), DAYS), square(), beyond_span="repeat")
    for day, u in ((3.0, 0.3), (3.75, 0.2), (4.5, 0.1), (5.0, 0.15), (-0.75, 0.2)):
        assert velocity(source, square(), day * 86400)[0][0] == pytest.approx(u)


def test_a_noleap_calendar_has_no_29_february(tmp_path):
    data = in_time(metres(0.1, 0.0), [0.0, 1.0])
    data["time"].attrs = {"units": "days since 2016-02-28", "calendar": "noleap"}
    path, grid = saved(data, tmp_path), square()
    source = VelocityFile(path, grid, start="2016-02-28T12:00")
    assert source.span == (-43200.0, 43200.0)
    assert velocity(source, grid)[0][0] == pytest.approx(0.15)
    assert "2016-02-28 … 2016-03-01" in repr(source)
    with pytest.raises(InputError, match=r"t = 172800 s \(2016-03-02T12:00\) is outside"):
        velocity(source, grid, 2 * 86400.0)
    with pytest.raises(InputError, match="time: start = .* not a date of the calendar 'noleap'"):
        VelocityFile(path, grid, start="2016-02-29")


@pytest.mark.parametrize(
    "start",
    ["2016-02-01T06", "2016-02-01 06:00 PM", "2016-02-01 06:00 +1:00", "2016-02-01  06:00", "01-02-2016",
     "2016-02-01 06:00 CET", "2016-02", "2016"],
)  # fmt: skip
@pytest.mark.parametrize("calendar", ["standard", "noleap"])
def test_a_start_that_is_not_read_to_its_end_is_refused(tmp_path, start, calendar):
    data = in_time(metres(0.1, 0.0), [0.0, 1.0])
    data["time"].attrs = {"units": "days since 2016-02-01", "calendar": calendar}
    with pytest.raises(InputError, match=f"not a date of the calendar '{calendar}'"):
        VelocityFile(saved(data, tmp_path), square(), start=start)


@pytest.mark.parametrize(
    "start",
    ["2016-02-01 06:00", "2016-02-01T07:00+01:00", "2016-02-01T06:00:00.0Z", "2016-2-1 01:00 -05",
     np.datetime64("2016-02-01T06"), datetime.datetime(2016, 2, 1, 6)],
)  # fmt: skip
def test_a_start_may_have_a_time_and_an_offset_from_utc(tmp_path, start):
    path = saved(in_time(metres(0.1, 0.0), DAYS), tmp_path)
    assert VelocityFile(path, square(), start=start).span[0] == -6 * 3600.0


@pytest.mark.parametrize("variables", [None, ("uo", "vo")])
@pytest.mark.parametrize("standard", [True, False])
def test_one_series_in_two_files_is_refused(tmp_path, variables, standard):
    data = in_time(metres(0.1, 0.0), DAYS)
    if not standard:
        data.uo.attrs, data.vo.attrs = M_PER_S, M_PER_S
    files = [
        saved(data.isel(time=when), tmp_path, name)
        for when, name in ((slice(0, 2), "a.nc"), (slice(1, 3), "b.nc"))
    ]
    with pytest.raises(InputError, match="uo is in both a.nc and b.nc: .* join them"):
        VelocityFile(files, square(), variables=variables, vectors="grid")


@pytest.mark.parametrize("calendar", ["noleap", "standard"])
@pytest.mark.parametrize("lost", [0, 1])
def test_a_missing_time_is_refused_in_each_calendar(tmp_path, calendar, lost):
    days = [0.0, 1.0]
    days[lost] = np.nan
    data = in_time(metres(0.1, 0.0), days)
    data["time"].attrs = {"units": "days since 1900-01-01", "calendar": calendar}
    with pytest.raises(InputError, match=rf"time\[{lost}\] is not a time"):
        VelocityFile(saved(data, tmp_path), square())


def test_a_run_that_names_its_calendar_takes_files_of_no_other(tmp_path):
    data, grid = in_time(metres(0.1, 0.0), [0.0, 1.0]), square()
    for own, other in (("noleap", "standard"), ("360_day", "noleap"), ("standard", "365_day")):
        data["time"].attrs = {"units": "days since 2016-02-28", "calendar": own}
        path = saved(data, tmp_path, f"{own}.nc")
        wrong = f"{own}.nc: time: its dates are of the calendar '{own}', but calendar = '{other}'"
        with pytest.raises(InputError, match=wrong):
            VelocityFile(path, grid, calendar=other)
        assert VelocityFile(path, grid, calendar=own).span == (0.0, 86400.0)
        assert VelocityFile(path, grid).span == (0.0, 86400.0)
    VelocityFile(path, grid, calendar="gregorian")  # another name of the standard one
    VelocityFile(tmp_path / "noleap.nc", grid, calendar="365_day")


def test_30_february_is_a_date_where_months_have_30_days(tmp_path):
    data = in_time(metres(0.1, 0.0), [0.0, 4.0])
    data["time"].attrs = {"units": "days since 2016-02-28", "calendar": "360_day"}
    source = VelocityFile(saved(data, tmp_path), square(), start="2016-02-30")
    assert source.span == (-172800.0, 172800.0)


def test_times_may_be_durations_and_must_grow(tmp_path):
    data = in_time(metres(0.1, 0.0), [0.0, 2.0])
    data["time"].attrs = {"units": "hours"}
    path = saved(data, tmp_path)
    assert VelocityFile(path, square(), start=3600.0).span == (-3600.0, 3600.0)
    with pytest.raises(InputError, match="a number of seconds"):
        VelocityFile(path, square(), start="2016-01-01")
    with pytest.raises(InputError, match=r"time\[2\] = 2016-02-02 does not come after"):
        VelocityFile(in_time(metres(0.1, 0.0), DAYS[[0, 2, 1]]), square())
    with pytest.raises(InputError, match="not a date"):
        VelocityFile(in_time(metres(0.1, 0.0), DAYS), square(), start="soon")


def test_a_hole_on_water_in_a_later_record_is_named_with_variable_index_and_date():
    data = in_time(metres(0.1, 0.0), DAYS)
    data.vo[2, 5, 3] = np.nan
    grid = square()
    source = VelocityFile(data, grid)
    velocity(source, grid, 86400.0)
    with pytest.raises(InputError, match=r"vo\[5, 3\] at 2016-02-04: nan on water"):
        velocity(source, grid, 2 * 86400.0)
    dry = grid.with_wet(grid.x > 5)
    velocity(VelocityFile(data, dry), dry, 2 * 86400.0)  # nobody needs that point


def test_a_fill_value_that_the_file_does_not_declare_is_no_velocity():
    data = metres(0.1, lambda x, y: np.where((x == 3) & (y == 5), 9.97e36, 0))
    with pytest.raises(InputError, match=r"vo\[5, 3\] at its only record: 9.97e\+36"):
        velocity(VelocityFile(data, square()), square())


class Counting(BackendArray):
    """Records of ones, which counts the values that are asked for."""

    def __init__(self, shape):
        self.shape, self.dtype, self.read = shape, np.dtype(float), 0

    def __getitem__(self, key):
        return indexing.explicit_indexing_adapter(
            key, self.shape, indexing.IndexingSupport.BASIC, self._get
        )

    def _get(self, key):
        values = np.broadcast_to(0.1, self.shape)[key]
        self.read += values.size
        return values


def test_of_a_long_file_only_the_records_and_the_block_in_use_are_read():
    times = np.datetime64("2016-01-01", "ns") + np.arange(366) * np.timedelta64(1, "D")
    x = np.arange(200.0)
    counters, parts = [], {}
    for name, attrs in (("uo", ALONG_X), ("vo", ALONG_Y)):
        counters.append(Counting((366, 200, 200)))
        parts[name] = (("time", "y", "x"), indexing.LazilyIndexedArray(counters[-1]), attrs)
    data = xr.Dataset(parts, {"time": times, "x": ("x", x), "y": ("y", x)})
    source = VelocityFile(data, square())
    for t in np.linspace(0, 86400, 9):
        velocity(source, square(), t)
    block = 14 * 14  # 10 m, a point beyond, and a margin
    for counter in counters:
        assert 0 < counter.read <= 3 * block  # where water is; two records


def test_zarr_stores_are_read_as_well(tmp_path):
    pytest.importorskip("zarr")
    data = in_time(metres(0.1, 0.2), DAYS)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        data.to_zarr(tmp_path / "currents.zarr")
    u, v = velocity(VelocityFile(tmp_path / "currents.zarr", square()), square(), 86400.0)
    np.testing.assert_allclose((u[0], v[0]), (0.2, 0.4))


def test_the_report_line_tells_what_was_understood(tmp_path):
    lon, lat = np.arange(0.0, 20), np.arange(70.0, 80)
    attrs = [a | {"units": "cm/s"} for a in (EAST, NORTH)]
    data = on_axes(np.ones((10, 20)), np.ones((10, 20)), lon, lat, *attrs, ("lat", "lon"))
    text = repr(VelocityFile(saved(data, tmp_path), around(10, 75), projection=POLAR))
    assert "\n" not in text
    for words in (
        "currents.nc: uo, vo by standard_name eastward_sea_water_velocity", "[cm/s × 0.01]",
        "10 × 20 lat, lon", "east, north turned by 5", "land by NaN", "16 of 16 cells", "without time",
    ):  # fmt: skip
        assert words in text


# ------------------------------------------------------------------------------------------ real files

real = pytest.mark.skipif(not REAL.is_dir(), reason="the real files are not here")


@real
def test_the_real_roms_file_gives_the_speed_of_its_face_means_and_its_own_angle():
    path = REAL / "nordic4km_surface_cgrid_20160202-04.nc"
    data = xr.open_dataset(path)
    j, i = 40, 20
    plane = "+proj=laea +lat_0=69 +lon_0=10 +datum=WGS84"
    lon, lat = float(data.lon_rho[j, i]), float(data.lat_rho[j, i])
    grid = around(lon, lat, plane, half=1.0, n=1)
    u, v = velocity(VelocityFile(path, grid, projection=plane), grid)
    along = (data.u[0, j, i - 1] + data.u[0, j, i]) / 2 + 1j * (
        data.v[0, j - 1, i] + data.v[0, j, i]
    ) / 2
    step = (
        to_plane(plane, lon + 1e-4, lat)[1] - grid.y,
        to_plane(plane, lon + 1e-4, lat)[0] - grid.x,
    )
    turn = np.arctan2(*step) + float(data.angle[j, i])
    np.testing.assert_allclose(u + 1j * v, complex(along) * np.exp(1j * turn), atol=1e-5)


@real
def test_the_real_file_with_two_positions_is_warned_of():
    plane = "+proj=laea +lat_0=76 +lon_0=35 +datum=WGS84"
    grid = around(35, 76, plane, half=100e3)
    with pytest.warns(UserWarning, match=r"disagree by 17\.\d km"):
        source = VelocityFile(REAL / "arctic20_ocean_ice_20160201-05.nc", grid, projection=plane)
    assert source.span == (0.0, 4 * 86400.0)


@real
def test_the_real_noleap_wind_covers_the_pole():
    grid = around(0, 90)
    source = VelocityFile(
        REAL / "core2_wind10m_6hourly_19480101.nc", grid, kind="wind", projection=POLAR
    )
    u, v = velocity(source, grid, 6 * 3600.0)
    assert np.hypot(u, v).max() < 15 and np.hypot(u, v).min() > 0
    assert np.ptp(np.angle(u + 1j * v)) < 1  # about one direction across the pole


@pytest.mark.parametrize("path", [None, 3, np.array(3)])
def test_what_is_no_file_is_refused_in_one_line(path):
    grid = Grid.uniform((0.0, 2.0), (0.0, 1.0), shape=(1, 2))
    with pytest.raises(InputError, match="^path = .*: must be a file, several, or a data set"):
        VelocityFile(path, grid)
