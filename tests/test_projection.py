"""Planes: places and directions go to the plane and come back."""

import doctest

import numpy as np
import pytest

import floebmi.projection
from floebmi.errors import InputError
from floebmi.projection import (
    axes_in_plane,
    centred_projection,
    check_projection,
    distance,
    east_in_plane,
    same_plane,
    to_lonlat,
    to_plane,
)

NORTH = "+proj=stere +lat_0=90 +lat_ts=70 +lon_0=-45 +datum=WGS84"


def test_examples_in_the_docstrings_are_true():
    assert doctest.testmod(floebmi.projection).failed == 0


def test_east_turns_with_longitude_in_the_polar_stereographic_plane():
    lon = np.array([-45.0, 0.0, 45.0, 135.0, 170.0, -170.0])
    turn = east_in_plane(NORTH, lon, np.full(6, 75.0))
    np.testing.assert_allclose(np.exp(1j * turn), np.exp(1j * np.radians(lon + 45)), atol=1e-8)


def test_east_exists_at_the_pole_along_the_meridian_that_is_named():
    np.testing.assert_allclose(east_in_plane(NORTH, 10.0, 90.0), np.radians(55), atol=1e-6)


def test_east_in_the_southern_plane_turns_the_other_way():
    south = "+proj=stere +lat_0=-90 +lat_ts=-70 +lon_0=0 +datum=WGS84"
    np.testing.assert_allclose(east_in_plane(south, 30.0, -75.0), np.radians(-30), atol=1e-8)


def test_axes_of_one_stereographic_plane_are_turned_in_another_by_the_difference_of_longitudes():
    other = NORTH.replace("-45", "10")
    turn = axes_in_plane(other, NORTH, np.array([1e5, -2e6]), np.array([3e5, 1e6]))
    np.testing.assert_allclose(turn, np.radians(55), atol=1e-8)
    assert not same_plane(other, NORTH)
    assert same_plane(NORTH, NORTH + " +units=m")


def test_longitude_and_latitude_come_back_from_the_plane_in_metres_whatever_its_units():
    km = NORTH + " +units=km"
    x, y = to_plane(km, 30.0, 80.0)
    np.testing.assert_allclose((x, y), to_plane(NORTH, 30.0, 80.0))
    np.testing.assert_allclose(to_lonlat(km, x, y), (30.0, 80.0))


def test_a_place_that_the_plane_does_not_have_is_nan():
    x, _ = to_plane("+proj=laea +lat_0=90 +lon_0=0 +R=6371000", 0.0, -90.0)
    assert np.isnan(x) or abs(x) > 1e7
    x, _ = to_plane("+proj=gnom +lat_0=90 +lon_0=0 +R=6371000", 0.0, -10.0)
    assert np.isnan(x)


def test_the_centred_plane_keeps_areas():
    plane = centred_projection((-10, 10), (75, 85))
    lon, lat = np.array([-9.0, -8.9, -8.9, -9.0]), np.array([84.0, 84.0, 84.1, 84.1])
    x, y = to_plane(plane, lon, lat)
    area = abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) / 2
    import pyproj

    true = abs(pyproj.Geod(ellps="WGS84").polygon_area_perimeter(lon, lat)[0])
    assert area == pytest.approx(true, rel=1e-3)  # chords instead of parallels
    polar = to_plane(NORTH, lon, lat)
    assert (
        abs(np.sum(polar[0] * np.roll(polar[1], -1) - polar[1] * np.roll(polar[0], -1)))
        / 2
        / (true)
        < 0.97
    )  # the negative control: a standard polar plane does not


def test_a_box_across_the_date_line_is_centred_on_it():
    projection = centred_projection((170, -170), (70, 80))
    assert "+lon_0=-180 " in projection
    x, y = to_plane(projection, [170, -170, 180, 180], [70, 70, 70, 80])
    assert x[0] == pytest.approx(-x[1]) and 3e5 < x[1] < 4e5
    assert y[2] < 0 < y[3]


def test_distance_is_that_on_the_great_circle():
    assert distance(0.0, 0.0, 90.0, 0.0) == pytest.approx(np.pi / 2 * 6_371_000)
    assert distance(0.0, 89.0, 180.0, 89.0) == pytest.approx(np.radians(2) * 6_371_000)


@pytest.mark.parametrize("bad, word", [("EPSG:4326", "metres"), ("nonsense", "EPSG:3413")])
def test_what_is_no_plane_is_refused(bad, word):
    with pytest.raises(InputError, match=word) as error:
        check_projection(bad)
    assert "\n" not in str(error.value) and bad in str(error.value)


def test_a_box_of_wrong_latitudes_is_refused():
    with pytest.raises(InputError, match="south, north"):
        centred_projection((0, 10), (80, 70))


def test_coordinates_are_of_the_same_places_and_what_is_masked_or_beyond_the_pole_is_nowhere():
    lat = [80.0, 81.0]
    for function in (to_plane, to_lonlat, east_in_plane):
        one = np.array(function(NORTH, 10.0, lat))
        np.testing.assert_array_equal(one, function(NORTH, [10.0, 10.0], lat))
        with pytest.raises(InputError, match=r"\(3,\) and .* \(2,\): must have shapes that match"):
            function(NORTH, [0.0, 1.0, 2.0], lat)
        masked = np.array(function(NORTH, np.ma.masked_greater([0.0, 99.0], 50.0), lat))
        assert np.isnan(masked[..., 1]).all() and np.isfinite(masked[..., 0]).all()
    assert np.isnan(east_in_plane(NORTH, 10.0, [90.1, -95.0])).all()
