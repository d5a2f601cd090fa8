"""Size distributions: radii have the density, the range and the mean area of their law."""

from typing import get_args

import numpy as np
import pytest
from hypothesis import given, strategies as st
from pydantic import TypeAdapter, ValidationError
from scipy import stats

from floebmi.errors import InputError
from floebmi.scene_floes import _SIZE_LAWS
from floebmi.sizes import (
    Empirical,
    Histogram,
    PowerLaw,
    SingleSize,
    Sizes,
    UniformSize,
    check_sizes,
    from_file,
)

ALL = [
    PowerLaw(5.0, 50.0),
    PowerLaw(5.0, 50.0, -1.0),
    PowerLaw(5.0, 50.0, -1.0 + 1e-13),
    PowerLaw(5.0, 50.0, -3.0),
    PowerLaw(5.0, 50.0, 2.0),
    PowerLaw(5.0, 5.0),
    UniformSize(10.0, 20.0),
    SingleSize(7.0),
    Histogram((1.0, 2.0, 5.0, 6.0), (3.0, 1.0, 0.0)),
    Empirical((1.0, 2.0, 4.0)),
]


def rng(seed=1):
    return np.random.Generator(np.random.PCG64(seed))


def power_law_cdf(law):
    a, b, p = law.radius_min, law.radius_max, law.exponent + 1
    if abs(p) < 1e-9:
        return lambda r: np.log(r / a) / np.log(b / a)
    return lambda r: (r**p - a**p) / (b**p - a**p)


@pytest.mark.parametrize("exponent", [-3.0, -1.8, -1.0, -1.0 + 1e-12, 0.5])
def test_the_power_law_is_that_of_the_number_density(exponent):
    law = PowerLaw(5.0, 50.0, exponent)
    radii = law.draw(20_000, rng())
    assert stats.kstest(radii, power_law_cdf(law)).pvalue > 0.01
    # negative control: the exponent of the cumulative number is another one
    wrong = power_law_cdf(law._replace(exponent=exponent - 1))
    assert stats.kstest(radii, wrong).pvalue < 1e-6


def test_uniform_and_histogram_sizes_follow_their_densities():
    assert (
        stats.kstest(UniformSize(10.0, 20.0).draw(20_000, rng()), "uniform", (10, 10)).pvalue > 0.01
    )
    radii = Histogram((1.0, 2.0, 5.0), (3.0, 1.0)).draw(20_000, rng())
    assert stats.kstest(radii, lambda r: np.interp(r, [1, 2, 5], [0, 0.75, 1])).pvalue > 0.01


def test_empirical_sizes_are_those_that_were_measured():
    radii = Empirical((1.0, 2.0, 4.0)).draw(3000, rng())
    values, counts = np.unique(radii, return_counts=True)
    np.testing.assert_array_equal(values, [1.0, 2.0, 4.0])
    assert stats.chisquare(counts).pvalue > 0.01


def test_no_distribution_is_forgotten_here_or_in_a_scene():
    assert {type(one) for one in ALL} == set(get_args(Sizes))
    assert set(_SIZE_LAWS.values()) == set(get_args(Sizes)) - {Empirical}  # which a file has


@pytest.mark.parametrize("sizes", ALL, ids=str)
def test_the_mean_area_is_that_of_the_radii_drawn(sizes):
    check_sizes(sizes)
    area = np.pi * sizes.draw(200_000, rng()) ** 2
    error = area.std() / np.sqrt(len(area))
    assert abs(area.mean() - sizes.mean_area()) <= 4 * error + 1e-9 * area.mean()


@pytest.mark.parametrize("sizes", ALL, ids=str)
def test_radii_lie_in_the_range_and_repeat_with_the_seed(sizes):
    radii = sizes.draw(1000, rng(3))
    low, high = sizes.range
    assert radii.min() >= low and radii.max() <= high
    np.testing.assert_array_equal(radii, sizes.draw(1000, rng(3)))
    if high > low:
        assert (radii != sizes.draw(1000, rng(4))).any()
    assert len(sizes.draw(0, rng())) == 0


@given(st.floats(1e-3, 1e4), st.floats(1.0, 1e5), st.floats(-20, 20), st.integers(0, 2**32))
def test_any_power_law_gives_finite_radii_within_its_bounds(low, ratio, exponent, seed):
    law = PowerLaw(low, low * ratio, exponent)
    radii = law.draw(50, rng(seed))
    assert (radii >= law.radius_min).all() and (radii <= law.radius_max).all()
    area = law.mean_area() / np.pi
    assert law.radius_min**2 * (1 - 1e-9) <= area <= law.radius_max**2 * (1 + 1e-9)


@pytest.mark.parametrize(
    "sizes, said",
    [
        (PowerLaw(0.0, 5.0), "PowerLaw.radius_min = 0.0: must be greater than 0"),
        (PowerLaw(5.0, 4.0), "radius_max = 4 m; must be at least radius_min, 5 m"),
        (PowerLaw(5.0, 6.0, np.nan), "PowerLaw.exponent = nan: must be a finite number"),
        (PowerLaw(5.0, 6.0, 30.0), "PowerLaw.exponent = 30.0: must be at most 20"),
        (UniformSize(2.0, 1.0), "radius_max = 1 m"),
        (SingleSize(-1.0), "SingleSize.radius = -1.0: must be greater than 0"),
        (Histogram((1.0, 2.0), (1.0, 2.0)), "edges: 2, with 2 counts; must be one more"),
        (
            Histogram((2.0, 1.0), (1.0,)),
            "edges[1] = 1 m; must be greater than 0, and increase",
        ),
        (
            Histogram((0.0, 1.0), (1.0,)),
            "edges[0] = 0 m; must be greater than 0, and increase",
        ),
        (Histogram((1.0, 2.0), (0.0,)), "counts[0] = 0; at least 0 each, not all 0"),
        (Empirical((1.0, -2.0)), "radii[1] = -2 m; must be greater than 0"),
        (Empirical(()), "must be a row of finite numbers"),
        (3.0, "must be a PowerLaw, UniformSize, SingleSize, Histogram or Empirical"),
    ],
)
def test_sizes_that_cannot_be_drawn_are_refused_in_one_line(sizes, said):
    with pytest.raises(InputError) as error:
        check_sizes(sizes)
    assert said in str(error.value) and "\n" not in str(error.value)


def test_long_rows_are_shown_by_their_first_numbers():
    """All radii of a file had been printed with a model that has an inflow of them, and by `explain`."""
    radii = tuple(map(float, range(1, 500)))
    assert repr(Empirical(radii)) == "Empirical(radii=(1.0, 2.0, 3.0, 4.0, 5.0, 6.0, ...))"
    assert repr(Histogram((1.0, 2.0), (3.0,))) == "Histogram(edges=(1.0, 2.0), counts=(3.0,))"
    assert len(repr(Histogram(radii, radii[1:]))) < 120


def test_a_table_of_a_scene_file_becomes_sizes_with_the_same_bounds():
    read = TypeAdapter(PowerLaw).validate_python
    assert read({"radius_min": 5, "radius_max": 50}) == PowerLaw(5.0, 50.0, -1.8)
    for wrong in ({"radius_min": -5}, {"exponent": 30}, {"exponnt": -2}):
        with pytest.raises(ValidationError):
            read({"radius_min": 5, "radius_max": 50} | wrong)
    with pytest.raises(ValidationError):
        TypeAdapter(Histogram).validate_python({"edges": [1, 2], "counts": [-1]})


def write(tmp_path, text):
    path = tmp_path / "sizes.csv"
    path.write_text(text)
    return path


def test_a_file_of_one_column_holds_radii_and_of_two_a_histogram(tmp_path):
    for name in ("radius", "Radius [m]", "radius_m", "area-equivalent radius", "r"):
        assert from_file(write(tmp_path, f"{name}\n10\n20.5\n")) == Empirical((10.0, 20.5))
    histogram = Histogram((10.0, 20.0, 40.0), (3.0, 1.0))
    for last in ("40,", "40,0", "40"):
        assert from_file(write(tmp_path, f"edge,count\n10,3\n20,1\n{last}\n")) == histogram


@pytest.mark.parametrize(
    "text, said",
    [
        ("radius\n10\nten\n", "row 3, column 'radius': 'ten' must be a number"),
        ("radius\n1_0\n", "row 2, column 'radius': '1_0' must be a number"),
        ("10\n20\n", "row 1 = '10'; must be a header"),
        ("radius\n-1\n", "radii[0] = -1 m; must be greater than 0"),
        ("edge,count\n10,3\n20,1\n", "row 3, column 'count': 1 must be 0 or empty"),
        (
            "edge,count\n10,3\n5,\n",
            "edges[1] = 5 m; must be greater than 0, and increase",
        ),
        ("\nedge,count\n\n10,3\n20,1\n", "row 5, column 'count': 1 must be 0 or empty"),
        ("edge,count\n10,3,4\n20,\n", "row 2 has 3 values; must be 2"),
        ("a,b,c\n1,2,3\n", "3 columns"),
        ("radius\n", "0 rows"),
        ("diameter\n10\n", "column 'diameter': must be radii in metres"),
        ("area\n10\n", "must be radii in metres"),
        ("radius [km]\n10\n", "must be radii in metres"),
        ("edge_km,count\n10,3\n20,\n", "must be radii in metres"),
        ("id,radius\n1,10\n2,0\n", "column 'radius': must be counts"),
        (
            "edge;count\n10;3\n20;\n",
            "its columns are separated by ';'; must be separated by commas",
        ),
        ("", "empty"),
    ],
)
def test_a_wrong_file_is_refused_with_row_column_and_value(tmp_path, text, said):
    path = write(tmp_path, text)
    with pytest.raises(InputError) as error:
        from_file(path)
    assert said in str(error.value) and str(error.value).startswith(str(path))


def test_a_file_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(InputError, match="No such file"):
        from_file(tmp_path / "none.csv")
