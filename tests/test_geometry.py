"""Areas of discs in rectangles and polygons, and cuts of branches, against independent answers."""

import math
from itertools import pairwise

import numpy as np
import pytest
from exchange_grids import disc_rectangle
from hypothesis import example, given, settings, strategies as st

from floebmi.geometry import cut, disc_polygon, disc_west

SQUARE = np.array([0.0, 1.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0, 1.0])
ELL = np.array([-1.0, 1.0, 1.0, 0.0, 0.0, -1.0]), np.array([-1.0, -1.0, 0.0, 0.0, 1.0, 1.0])


def half_disc_beyond(d: float, r: float) -> float:
    """Area of the part of a disc beyond a line at distance d from its centre."""
    return r * r * math.acos(d / r) - d * math.sqrt(r * r - d * d)


EXACT = [
    ("inside the cell", SQUARE, (0.5, 0.4, 0.1), math.pi * 0.01),
    ("around the cell", SQUARE, (0.3, 0.4, 5.0), 1.0),
    ("apart", SQUARE, (3.0, 3.0, 1.0), 0.0),
    ("centre on an edge", SQUARE, (0.5, 0.0, 0.3), math.pi * 0.09 / 2),
    ("centre on a corner", SQUARE, (1.0, 1.0, 0.5), math.pi * 0.25 / 4),
    ("touching an edge from inside", SQUARE, (0.5, 0.25, 0.25), math.pi * 0.0625),
    ("touching an edge from outside", SQUARE, (0.5, -0.25, 0.25), 0.0),
    ("around all four corners exactly", SQUARE, (0.5, 0.5, math.sqrt(0.5)), 1.0),
    ("touching all four edges", SQUARE, (0.5, 0.5, 0.5), math.pi / 4),
    ("a cap", SQUARE, (0.5, -0.1, 0.2), half_disc_beyond(0.1, 0.2)),
    ("through one corner", SQUARE, (0.0, 0.5, 0.5), math.pi / 8),
    ("a concave corner", ELL, (0.0, 0.0, 0.7), 0.75 * math.pi * 0.49),
    ("in the notch", ELL, (0.5, 0.5, 0.4), 0.0),
    ("across the notch", ELL, (0.5, 0.5, 0.6), None),
    ("around the L", ELL, (0.2, 0.1, 9.0), 3.0),
]


@pytest.mark.parametrize(("case", "polygon", "disc", "area"), EXACT, ids=[c[0] for c in EXACT])
def test_disc_and_polygon_in_known_cases(case, polygon, disc, area):
    if area is None:  # the L is its box without the north-east square
        x, y, r = disc
        area = disc_rectangle(-1, 1, -1, 1, x, y, r) - disc_rectangle(0, 1, 0, 1, x, y, r)
    assert disc_polygon(*polygon, *disc) == pytest.approx(area, rel=1e-14, abs=1e-15)


@pytest.mark.parametrize(
    ("case", "disc", "area"), [(c[0], c[2], c[3]) for c in EXACT if c[1] is SQUARE]
)
def test_disc_and_rectangle_in_known_cases(case, disc, area):
    assert disc_rectangle(0, 1, 0, 1, *disc) == pytest.approx(area, rel=1e-14, abs=1e-15)


def random_rectangles(n: int) -> np.ndarray:
    """West, east, south, north and radius of rectangles around a disc at the origin."""
    rng = np.random.default_rng(7)
    west, south = rng.uniform(-2, 1.5, (2, n))
    width, height = 10 ** rng.uniform(-2, 1, (2, n))
    return np.stack([west, west + width, south, south + height, 10 ** rng.uniform(-1, 0.5, n)], 1)


def test_rectangle_and_polygon_formulas_agree():
    for west, east, south, north, r in random_rectangles(2000):
        corners = np.array([west, east, east, west]), np.array([south, south, north, north])
        polygon = disc_polygon(*corners, 0.0, 0.0, r)
        rectangle = disc_rectangle(west, east, south, north, 0.0, 0.0, r)
        assert polygon == pytest.approx(rectangle, abs=4e-15 * r * r)


def segment(height: float) -> float:
    """Area of a segment of the unit disc by its series, ∫₀ʰ 2 √(2 t − t²) dt, which loses no digit."""
    terms, binomial = [], 1.0  # of √(1 − t/2)
    for k in range(70):
        terms.append(binomial * height**k / (k + 1.5))
        binomial *= -0.5 * (0.5 - k) / (k + 1)
    return math.sqrt(8.0) * height * math.sqrt(height) * math.fsum(terms)


def test_the_disc_west_of_a_line_agrees_with_its_series_to_four_units_in_the_last_place():
    for height in np.concatenate([np.linspace(0.0, 1.0, 1001), 2.0 ** -np.arange(11, 54)]):
        x = 1.0 - height
        part = segment(1.0 - x)
        assert abs(disc_west(-x, 1.0) - part) <= 4 * math.ulp(part)
        assert abs(disc_west(x, 1.0) - (math.pi - part)) <= 4 * math.ulp(math.pi)


def test_areas_agree_with_photutils_on_random_rectangles():
    photutils = pytest.importorskip("photutils.geometry")
    for west, east, south, north, r in random_rectangles(500):
        oracle = photutils.circular_overlap_grid(west, east, south, north, 1, 1, r, 1, 1)[0, 0]
        area = disc_rectangle(west, east, south, north, 0.0, 0.0, r)
        assert area == pytest.approx(oracle * (east - west) * (north - south), abs=1e-13 * r * r)


def star(seed: int, corners: int) -> tuple[np.ndarray, np.ndarray]:
    """A simple polygon, as a rule concave: corners in order of angle around a point."""
    rng = np.random.default_rng(seed)
    angle = 2 * np.pi * (np.arange(corners) + rng.uniform(0, 0.8, corners)) / corners
    reach = rng.uniform(0.2, 1.0, corners)
    return reach * np.cos(angle), reach * np.sin(angle)


positions = st.floats(-1.5, 1.5)
radii = st.floats(0.01, 2.0)
seeds = st.integers(0, 2**32 - 1)


@settings(deadline=None, max_examples=60)
@given(seeds, st.integers(3, 9), positions, positions, radii)
def test_concave_polygons_are_the_sum_of_their_triangles(seed, corners, x, y, r):
    px, py = star(seed, corners)
    total = 0.0
    for k in range(corners):
        m = (k + 1) % corners
        triangle = np.array([0.0, px[k], px[m]]), np.array([0.0, py[k], py[m]])
        total += disc_polygon(*triangle, x, y, r)
    assert disc_polygon(px, py, x, y, r) == pytest.approx(total, abs=1e-14 * max(r * r, 1))


@settings(deadline=None, max_examples=30)
@given(seeds, st.integers(4, 9), positions, positions, radii)
def test_concave_polygons_agree_with_shapely_as_far_as_its_circles_are_round(
    seed, corners, x, y, r
):
    shapely = pytest.importorskip("shapely")
    px, py = star(seed, corners)
    disc = shapely.Point(x, y).buffer(r, quad_segs=500)
    oracle = disc.intersection(shapely.Polygon(np.stack([px, py], 1))).area
    assert disc_polygon(px, py, x, y, r) == pytest.approx(oracle, abs=1e-5 * r * r)


@settings(deadline=None, max_examples=60)
@given(seeds, st.integers(3, 9), positions, positions, radii, st.floats(0, 6.28))
def test_turning_and_scaling_disc_and_polygon_together_changes_nothing(
    seed, corners, x, y, r, turn
):
    px, py = star(seed, corners)
    c, s = math.cos(turn), math.sin(turn)
    scale = 3000.0
    turned = disc_polygon(
        scale * (c * px - s * py), scale * (s * px + c * py),
        scale * (c * x - s * y), scale * (s * x + c * y), scale * r,
    )  # fmt: skip
    # Nearly touching discs answer to a shift δ by an area of δ^1.5 or less: 1e-13 is generous.
    assert turned / scale**2 == pytest.approx(disc_polygon(px, py, x, y, r), abs=1e-13)


@settings(deadline=None, max_examples=60)
@given(positions, positions, radii)
@example(0.0, 0.0, 0.2)  # all but touches four of the lines, at r (1 - 2e-16)
def test_the_tiles_of_a_square_add_up_to_the_square(x, y, r):
    edges = np.linspace(-1, 1, 6)
    tiles = sum(
        disc_rectangle(w, e, s, n, x, y, r) for w, e in pairwise(edges) for s, n in pairwise(edges)
    )
    rounding = (
        25 * np.finfo(float).eps * max(1.0, r * r)
    )  # each of 25 tiles loses a last digit of r²
    assert tiles == pytest.approx(disc_rectangle(-1, 1, -1, 1, x, y, r), abs=rounding, rel=0)


def test_areas_far_from_the_origin_lose_only_the_digits_of_the_coordinates():
    far = 4e6
    near = disc_polygon(*(1000 * p for p in ELL), 300.0, 200.0, 400.0)
    moved = disc_polygon(1000 * ELL[0] + far, 1000 * ELL[1] - far, 300 + far, 200 - far, 400.0)
    assert moved == pytest.approx(near, rel=1e-12)


def test_a_small_disc_on_a_long_edge_is_halved():
    corners = 1e4 * SQUARE[0], 1e4 * SQUARE[1]
    assert disc_polygon(*corners, 1234.5, 0.0, 1.0) == pytest.approx(math.pi / 2, rel=1e-12)


def test_a_branch_is_cut_where_it_crosses_an_edge_and_nowhere_else():
    assert cut(0.0, 0.0, 4.0, 0.0, 1.0, -1.0, 1.0, 1.0) == 0.25
    assert cut(0.0, 0.0, 4.0, 0.0, 1.0, 1.0, 1.0, -1.0) == 0.25
    assert cut(0.0, 0.0, 4.0, 0.0, 5.0, -1.0, 5.0, 1.0) == -1  # beyond its end
    assert cut(0.0, 0.0, 4.0, 0.0, 1.0, 0.1, 1.0, 1.0) == -1  # passes beside the edge
    assert cut(0.0, 0.0, 4.0, 0.0, 1.0, 0.0, 3.0, 0.0) == -1  # runs along it
    assert cut(0.0, 0.0, 4.0, 0.0, 2.0, 0.0, 2.0, 1.0) == 0.5  # through its corner
