"""Coasts: floes that line the land keep others off it, and land is read from polygons, fractions and files."""

import json
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings, strategies as st

from floebmi.boundaries import Domain
from floebmi.coast import (
    Coast,
    _shrunk,
    from_geojson,
    from_land_fraction,
    from_polygons,
    land_geometry,
    on_land,
    within,
)
from floebmi.errors import InputError
from floebmi.floes import COAST

NARES = Path(__file__).parents[2] / "shared/data/coast_nares_strait_landfraction_2km.nc"
SQUARE = [(0.0, 0.0), (1000.0, 0.0), (1000.0, 1000.0), (0.0, 1000.0)]
LAKE = [(300.0, 300.0), (700.0, 300.0), (700.0, 700.0), (300.0, 700.0)]
ISLE = [(450.0, 450.0), (550.0, 450.0), (550.0, 550.0), (450.0, 550.0)]


def discs(coast):
    points = shapely.points(coast.floes.x, coast.floes.y)
    return shapely.union_all(shapely.buffer(points, coast.floes.radius, quad_segs=32))


def places_behind_the_coast(coast, floe_radius, depth, within):
    """Area that centres of floes from the sea reach deeper than `depth` in the land."""
    land = land_geometry(coast.polygons)
    open_to_centres = within.difference(discs(coast).buffer(floe_radius, quad_segs=32))
    parts = shapely.get_parts(open_to_centres)
    sea = within.difference(land)
    deep = land.buffer(-depth)
    reached = parts[shapely.area(shapely.intersection(parts, sea)) > 1e-6 * floe_radius**2]
    return shapely.intersection(shapely.union_all(reached), deep).area if len(reached) else 0.0


def test_discs_touch_a_straight_coast_from_the_land_side():
    coast = from_polygons([SQUARE], radius=100.0)
    assert (coast.floes.motion == COAST).all()
    large = coast.floes.radius == 100.0
    inset = np.minimum.reduce(
        [coast.floes.x, coast.floes.y, 1000 - coast.floes.x, 1000 - coast.floes.y]
    )
    np.testing.assert_allclose(inset[large], 100.0)
    x = np.sort(coast.floes.x[large & (abs(coast.floes.y - 100) < 1e-6)])
    assert np.diff(x).max() <= 100.0


def test_the_envelope_of_the_discs_lies_on_the_coastline():
    land = shapely.Polygon(SQUARE)
    union = discs(from_polygons([SQUARE], radius=100.0))
    # out of the land by no more than the smallest disc, at the corners only
    assert union.difference(land.buffer(100.0 / 8)).area < 1.0
    along = land.boundary.interpolate(np.linspace(0, 4000, 4001))
    gap = shapely.distance(along, union)
    assert gap.max() < 0.1 * 100.0
    assert np.percentile(gap, 95) < 0.09 * 100.0


@pytest.mark.parametrize("share", [0.15, 0.3, 1.0, 5.0])
def test_no_floe_slips_through_the_coast(share):
    zigzag = [(100.0 * k, 400.0 + 150.0 * (k % 2)) for k in range(11)]
    spit = [(1040.0, 420.0), (1900.0, 400.0), (1040.0, 380.0)]
    ring = [(0.0, -1000.0), *zigzag, *spit, (1040.0, -1000.0)]
    coast = from_polygons([ring], radius=100.0)
    around = shapely.box(-600, -400, 2500, 1500)
    assert places_behind_the_coast(coast, share * 100.0, 30.0, around) == 0.0
    # negative control: with two of three discs away there are gaps
    if share < 1:
        coast.floes.radius = np.where(
            np.arange(len(coast.floes)) % 3 == 0, coast.floes.radius, 1e-3
        )
        assert places_behind_the_coast(coast, share * 100.0, 30.0, around) > 0.0


@settings(max_examples=25, deadline=None)
@given(
    st.lists(st.floats(0.3, 1.0), min_size=4, max_size=14),
    st.floats(0.02, 0.4),
)
def test_any_island_is_closed_to_floes(lengths, radius):
    angle = np.linspace(0, 2 * np.pi, len(lengths), endpoint=False)
    ring = np.array(lengths)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    coast = from_polygons([ring], radius=radius)
    land = shapely.Polygon(ring)
    assert discs(coast).difference(land.buffer(radius / 8 * 1.01)).area < 1e-9
    shore = land.boundary.interpolate(np.linspace(0, land.boundary.length, 500))
    assert shapely.distance(shore, discs(coast)).max() <= 0.125 * radius
    box = shapely.box(-2, -2, 2, 2)
    assert places_behind_the_coast(coast, 0.25 * radius, 0.4 * radius, box) == 0.0


def test_an_island_smaller_than_any_disc_is_still_there():
    coast = from_polygons([[(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)]], radius=100.0)
    assert len(coast.floes) >= 1
    np.testing.assert_array_equal(coast.floes.radius, 12.5)


def test_a_ring_in_a_ring_is_a_lake_and_one_in_a_lake_an_island():
    land = land_geometry([ISLE, SQUARE, LAKE])
    assert land.area == 1000**2 - 400**2 + 100**2
    coast = from_polygons([LAKE, SQUARE, ISLE], radius=20.0)
    assert land_geometry(coast.polygons).symmetric_difference(land).area == 0.0
    inside = shapely.contains_xy(land, coast.floes.x, coast.floes.y)
    assert inside[coast.floes.radius == 20.0].all()
    shore_of_lake = shapely.Polygon(LAKE).boundary
    near = shapely.distance(shore_of_lake, shapely.points(coast.floes.x, coast.floes.y)) < 20.1
    assert near.sum() > 60


def test_land_that_overlaps_is_joined_and_its_inner_shore_is_gone():
    other = np.array(SQUARE) + [500.0, 0.0]
    coast = from_polygons([SQUARE, other], radius=20.0)
    assert land_geometry(coast.polygons).area == 1500 * 1000
    assert not ((abs(coast.floes.x - 750) < 300) & (abs(coast.floes.y - 500) < 400)).any()


def test_land_is_brought_back_across_the_corner_of_a_periodic_domain():
    everywhere = dict.fromkeys(("west", "east", "south", "north"), "periodic")
    domain = Domain((0.0, 100.0), (50.0, 150.0), **everywhere)
    isle = np.array([(2090.0, 140.0), (2120.0, 140.0), (2120.0, 165.0), (2090.0, 165.0)])
    land = land_geometry([isle], domain)
    assert land.bounds == (0.0, 50.0, 100.0, 150.0) and land.area == pytest.approx(30 * 25)
    assert len(shapely.get_parts(land)) == 4
    x, y = [5.0, 305.0, 95.0, 95.0, 50.0, 5.0], [60.0, -40.0, 60.0, 145.0, 145.0, 70.0]
    assert on_land([isle], x, y, domain).tolist() == [True] * 4 + [False] * 2
    # what only touches the seam is no land on the other side
    touching = isle[[0, 1, 2]] - (2020.0, 45.0)
    assert land_geometry([touching, isle], domain).area == pytest.approx(30 * 25 + 30 * 25 / 2)
    assert {
        part.geom_type for part in shapely.get_parts(land_geometry([touching, isle], domain))
    } == {"Polygon"}
    # land inside stays as it is, and so does all land where nothing is periodic
    inside = isle - (2050.0, 50.0)
    assert land_geometry([inside], domain).equals_exact(land_geometry([inside]))
    assert (
        land_geometry([isle], domain._replace(**dict.fromkeys(everywhere, "closed"))).area == 750.0
    )


def test_no_land_is_no_coast():
    assert len(from_polygons([], radius=10.0).floes) == 0
    water = from_land_fraction([0.0, 1.0, 2.0], [0.0, 1.0], np.zeros((2, 3)), radius=0.1)
    assert isinstance(water, Coast) and len(water.floes) == 0 and water.polygons == []


@pytest.mark.parametrize(
    "polygons, said",
    [
        ([SQUARE, [(0, 0), (1, 1)]], "polygon 1 has shape (2, 2)"),
        ([[(0, 0), (1, 1), (1, 0), (0, 1)]], "polygon 0: Self-intersection"),
        ([[(0, 0), (1, 1), (2, 2)]], "polygon 0"),
        ([[(0, 0), (1, np.nan), (2, 2)]], "polygon 0, point 1"),
        (
            [SQUARE, np.array(SQUARE) * 1e200],
            "polygon 1: a coordinate of 1e+203 m; must be within 1e+09 m",
        ),
    ],
)
def test_a_polygon_that_is_none_is_refused_with_its_number(polygons, said):
    with pytest.raises(InputError) as error:
        from_polygons(polygons, radius=10.0)
    assert said in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize(
    "radius, thickness, said", [(0.0, 1.0, "coast radius = 0.0 m"), (1.0, -1.0, "coast thickness")]
)
def test_wrong_sizes_of_the_floes_are_refused(radius, thickness, said):
    with pytest.raises(InputError, match=said):
        from_polygons([SQUARE], radius=radius, thickness=thickness)


def test_the_shore_is_as_thick_as_it_is_told_or_ten_metres(tmp_path):
    ring = {"type": "Polygon", "coordinates": [[*SQUARE, SQUARE[0]]]}
    path = geojson(tmp_path, ring)
    for make, land in (
        (from_polygons, ([SQUARE],)), (from_geojson, (path,)), (from_land_fraction, land_to_the_south()),
    ):  # fmt: skip
        assert (make(*land, 100.0).floes.thickness == 10.0).all()
        assert (make(*land, 100.0, 3.0).floes.thickness == 3.0).all()


def test_a_coast_beyond_a_periodic_edge_lies_within_at_its_image():
    domain = Domain((0.0, 3000.0), (0.0, 2000.0), west="periodic", east="periodic")
    coast = from_polygons([np.array(SQUARE) + (2500.0, 500.0)], radius=100.0)
    inside = within(coast, domain)
    floes = inside.floes
    assert floes.x.min() >= 0.0 and floes.x.max() <= 3000.0 < coast.floes.x.max()
    np.testing.assert_array_equal(floes.y, coast.floes.y)
    land = land_geometry(inside.polygons)
    assert land.bounds == (0.0, 500.0, 3000.0, 1500.0) and land.area == pytest.approx(1e6)
    large = floes.radius == 100.0
    assert shapely.distance(land, shapely.points(floes.x, floes.y))[large].max() == 0.0


def land_to_the_south(nx=30, ny=20):
    """Land below y = 500 m, its edge within a cell of 100 m given by the fraction."""
    x, y = 50 + 100.0 * np.arange(nx), 50 + 100.0 * np.arange(ny)
    fraction = np.clip((475.0 - (y - 50)) / 100, 0, 1)[:, None] * np.ones(nx)
    return x, y, fraction


def test_the_coast_from_a_land_fraction_is_its_contour_and_reaches_the_rim_of_the_grid():
    x, y, fraction = land_to_the_south()
    coast = from_land_fraction(x, y, fraction, radius=40.0, thickness=3.0)
    assert (coast.floes.thickness == 3.0).all()
    # one half of the water's edge: between the centres at 350 (fraction 1), 450 (0.75) and 550 (0)
    top = coast.floes.y + coast.floes.radius
    np.testing.assert_allclose(top, 450 + 100 / 3, atol=1e-6)
    assert coast.floes.x.min() <= 0.0 and coast.floes.x.max() >= 3000.0
    assert np.diff(np.sort(coast.floes.x)).max() <= 40.0
    # and no floes stand along the rim, where the grid ends and the land goes on
    assert coast.floes.y.min() > 400.0


def test_along_a_period_a_land_fraction_goes_on_with_the_other_side():
    x, y = 50 + 100.0 * np.arange(30), 50 + 100.0 * np.arange(20)
    fraction = np.zeros((20, 30))
    fraction[5:12, :3] = 0.8, 1.0, 1.0  # west of the seam there is water
    domain = Domain((0.0, 3000.0), (0.0, 2000.0), west="periodic", east="periodic")
    for places in ((x, y), np.meshgrid(x, y)):
        coast = from_land_fraction(*places, fraction, 40.0, period=domain.period)
        land = land_geometry(coast.polygons, domain)
        assert land.bounds == pytest.approx((12.5, 500.0, 300.0, 1200.0))
        assert (coast.floes.x - coast.floes.radius).min() == pytest.approx(12.5)
    # negative control: without it, the land goes on beyond the rim, in what is water on the other side
    coast = from_land_fraction(x, y, fraction, 40.0)
    assert land_geometry(coast.polygons, domain).bounds[2] == 3000.0


def test_edges_and_curvilinear_centres_give_the_same_coast_as_rows_of_centres():
    x, y, fraction = land_to_the_south()
    floes = from_land_fraction(x, y, fraction, radius=40.0).floes
    edges = from_land_fraction(np.append(x - 50, 3000), np.append(y - 50, 2000), fraction, 40.0)
    curved = from_land_fraction(*np.meshgrid(x, y), fraction, radius=40.0)
    for other in (edges.floes, curved.floes):
        np.testing.assert_allclose(other.x, floes.x)
        np.testing.assert_allclose(other.y, floes.y)


@pytest.mark.parametrize(
    "change, said",
    [
        (
            {"fraction": np.full((20, 30), 1.5)},
            "land fraction[0, 0] = 1.5; must be between 0 and 1",
        ),
        ({"fraction": np.full((20, 30), np.nan)}, "land fraction[0, 0] = nan"),
        ({"fraction": np.zeros(30)}, "land fraction has shape (30,)"),
        ({"x": np.arange(7.0)}, "x has shape (7,); must be (30,) centres or (31,) edges"),
        ({"threshold": 0.0}, "threshold = 0.0"),
    ],
)
def test_a_land_fraction_that_cannot_be_used_is_refused(change, said):
    x, y, fraction = land_to_the_south()
    given = {"x": x, "y": y, "fraction": fraction, "radius": 40.0} | change
    with pytest.raises(InputError) as error:
        from_land_fraction(**given)
    assert said in str(error.value)


def geojson(tmp_path, *geometries):
    path = tmp_path / "land.geojson"
    features = [{"type": "Feature", "properties": {}, "geometry": g} for g in geometries]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return path


def test_geojson_in_metres_gives_the_coast_of_its_polygons(tmp_path):
    with_lake = {"type": "Polygon", "coordinates": [[*SQUARE, SQUARE[0]], [*LAKE, LAKE[0]]]}
    coast = from_geojson(geojson(tmp_path, with_lake), radius=20.0)
    assert land_geometry(coast.polygons).area == 1000**2 - 400**2
    same = from_polygons([SQUARE, LAKE], radius=20.0)
    assert len(coast.floes) == len(same.floes)
    # with heights, and with the mark that Windows puts before UTF-8
    rings = with_lake["coordinates"]
    with_lake["coordinates"] = [[[*point, 7.0] for point in ring] for ring in rings]
    path = geojson(tmp_path, with_lake)
    path.write_text(path.read_text(), encoding="utf-8-sig")
    high = from_geojson(path, radius=20.0)
    assert {ring.shape[1] for ring in high.polygons} == {2}
    np.testing.assert_array_equal(high.floes.x, coast.floes.x)


def test_many_islands_in_geojson_are_merged_like_their_rings(tmp_path):
    rng = np.random.default_rng(1)
    boxes = [shapely.box(x, y, x + 150.0, y + 150.0) for x, y in rng.uniform(0.0, 1000.0, (37, 2))]
    coast = from_geojson(geojson(tmp_path, *map(shapely.geometry.mapping, boxes)), radius=20.0)
    land = land_geometry(coast.polygons)
    assert 1 < len(shapely.get_parts(land)) < 37
    assert land.normalize().equals_exact(shapely.union_all(boxes).normalize(), 1e-9)


def test_edges_of_geojson_in_degrees_follow_their_parallels(tmp_path):
    ring = [[0, 70], [90, 70], [90, 75], [0, 75], [0, 70]]
    box = {"type": "Polygon", "coordinates": [ring]}
    plane = "+proj=laea +lat_0=72 +lon_0=45 +R=6371000"  # equal areas
    coast = from_geojson(geojson(tmp_path, box), radius=20e3, projection=plane)
    sines = np.sin(np.radians([70, 75]))
    true = np.radians(90) * np.diff(sines).item() * 6371e3**2
    assert land_geometry(coast.polygons).area == pytest.approx(true, rel=1e-4)


@pytest.mark.parametrize("features", [None, 5])
def test_a_collection_without_a_list_of_features_is_refused(tmp_path, features):
    path = tmp_path / "land.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    with pytest.raises(InputError, match="must be GeoJSON"):
        from_geojson(path, radius=100.0)


@pytest.mark.parametrize(
    "name, metres",
    [("EPSG:3413", True), ("urn:ogc:def:crs:OGC:1.3:CRS84", False), ("EPSG:nowhere", False), (3, False)],
)  # fmt: skip
def test_geojson_in_few_metres_says_so_by_the_plane_that_it_names(tmp_path, name, metres):
    isle = {"type": "Polygon", "coordinates": [[[20, 10], [60, 10], [60, 50], [20, 10]]]}
    path = tmp_path / "isle.geojson"
    path.write_text(json.dumps(isle | {"crs": {"type": "name", "properties": {"name": name}}}))
    if metres:
        assert land_geometry(from_geojson(path, radius=1.0).polygons).area == 800.0
    else:
        with pytest.raises(InputError, match='look like degrees.*"crs": .*"EPSG:3413"'):
            from_geojson(path, radius=1.0)


def test_geojson_in_degrees_needs_a_projection(tmp_path):
    isle = {"type": "Polygon", "coordinates": [[[-45, 80], [-44, 80], [-44, 81], [-45, 80]]]}
    path = geojson(tmp_path, isle)
    with pytest.raises(InputError, match="look like degrees"):
        from_geojson(path, radius=1000.0)
    coast = from_geojson(path, radius=1000.0, projection="EPSG:3413")
    # one degree of latitude is about 111 km, one of longitude at 80 N about 19 km
    assert land_geometry(coast.polygons).area == pytest.approx(111e3 * 19e3 / 2, rel=0.1)
    with pytest.raises(InputError, match="give a PROJ string or a code such as 'EPSG:3413'"):
        from_geojson(path, radius=1000.0, projection="EPSG:nowhere")


def test_geojson_in_metres_is_refused_where_a_projection_is_given(tmp_path):
    isle = {"type": "Polygon", "coordinates": [[[3e3, 0], [4e3, 0], [4e3, 1e3], [3e3, 0]]]}
    with pytest.raises(InputError, match="feature 0: 3000, 0 are not longitude and latitude"):
        from_geojson(geojson(tmp_path, isle), radius=100.0, projection="EPSG:3413")


def test_an_edge_that_goes_the_long_way_round_the_globe_is_warned_of(tmp_path):
    west, plane = np.array([179.0, -179, -179, 179]), "+proj=laea +lat_0=75 +lon_0=180"

    def isle(lon):
        ring = np.column_stack([lon, [75, 75, 76, 76]]).tolist()
        return geojson(tmp_path, {"type": "Polygon", "coordinates": [[*ring, ring[0]]]})

    with pytest.warns(UserWarning, match="over 358° of longitude.* such as 181 for -179") as told:
        from_geojson(isle(west), radius=5000.0, projection=plane)
    assert told[0].filename == __file__
    coast = from_geojson(isle(west % 360), radius=5000.0, projection=plane)
    assert land_geometry(coast.polygons).area == pytest.approx(111e3 * 56e3, rel=0.05)


@pytest.mark.parametrize(
    "text, said",
    [
        ("{", "must be GeoJSON"),
        ("[1]", "must be GeoJSON"),
        ('{"type": "FeatureCollection", "features": []}', "holds no features"),
        ('{"type": "Point", "coordinates": [5000, 5000]}', "feature 0: Point; must be Polygon"),
        (
            '{"type": "Polygon", "coordinates": [[[0,0],[1e200,0],[0,999],[0,0]]]}',
            "feature 0: a coordinate of 1e+200 m; must be within 1e+09 m",
        ),
        ('{"type": "Polygon", "coordinates": []}', "feature 0: has no geometry"),
        ('{"type": "Feature", "geometry": null, "properties": {}}', "feature 0: has no geometry"),
        (
            '{"type": "Polygon", "coordinates": [[[0,0],[999,999],[999,0],[0,999],[0,0]]]}',
            "feature 0: Self-intersection",
        ),
    ],
)
def test_a_geojson_file_that_cannot_be_used_is_refused_with_its_feature(tmp_path, text, said):
    path = tmp_path / "land.geojson"
    path.write_text(text)
    with pytest.raises(InputError) as error:
        from_geojson(path, radius=10.0)
    assert said in str(error.value) and str(path) in str(error.value)


def test_a_coastline_much_finer_than_the_discs_is_lined_like_a_coarser_one():
    angle = np.linspace(0.0, 2 * np.pi, 10_000, endpoint=False)
    rough = 1.0 + 0.1 * np.cos(7 * angle) + 0.02 * np.cos(61 * angle) + 1e-4 * np.cos(2001 * angle)
    ring = 50e3 * np.stack([rough * np.cos(angle), rough * np.sin(angle)], axis=1)
    land, sizes = shapely.Polygon(ring), [800.0, 400.0, 200.0, 100.0]
    shore = land.boundary
    shapely.prepare(shore)
    for size, inner in zip(sizes, _shrunk(land, sizes), strict=True):
        assert inner.area == pytest.approx(land.buffer(-size, quad_segs=8).area, rel=1e-4)
        some = shapely.get_coordinates(shapely.segmentize(inner, size / 8))[::25]
        distance = shapely.distance(shapely.points(some), shore) / size
        assert 0.99 < distance.min() and distance.max() < 1.000001
    fine, coarse = from_polygons([ring], 800.0), from_polygons([ring[::10]], 800.0)
    assert len(fine.floes) == pytest.approx(len(coarse.floes), rel=0.02)


def test_land_of_a_coarse_coastline_is_shrunk_at_once():
    land, sizes = shapely.Polygon(SQUARE), [80.0, 40.0, 20.0, 10.0]
    for size, shrunk in zip(sizes, _shrunk(land, sizes), strict=True):
        assert shrunk.equals_exact(land.buffer(-size, quad_segs=8))


@pytest.mark.skipif(not NARES.exists(), reason="needs the shared data")
def test_nares_strait_is_lined_and_stays_open():
    import xarray as xr

    data = xr.open_dataset(NARES)
    coast = from_land_fraction(data.x.values, data.y.values, data.land_fraction.values, 2000.0)
    rim = shapely.box(*(float(v) for v in (data.x[0], data.y[0], data.x[-1], data.y[-1])))
    land = land_geometry(coast.polygons)
    assert land.intersection(rim).area == pytest.approx(
        float(data.land_fraction.sum()) * 2000.0**2, rel=0.02
    )
    assert places_behind_the_coast(coast, 500.0, 800.0, rim) == 0.0
    # a floe of 10 km passes from the Lincoln Sea to Baffin Bay
    water = shapely.get_parts(rim.difference(discs(coast).buffer(5000.0)))
    north, south = shapely.points([(-165e3, -790e3), (-480e3, -1050e3)])
    assert any(part.contains(north) and part.contains(south) for part in water)
