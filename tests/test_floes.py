"""The table of floes: what it holds, how it grows, and what it refuses."""

import copy
import doctest
import pickle

import numpy as np
import pytest
from hypothesis import given, strategies as st

import floebmi.floes
from floebmi.errors import InputError
from floebmi.floes import FIXED, FIXED_X, Floes

NAMES = ("x", "y", "u", "v", "radius", "thickness", "motion", "active", "angle", "angular_velocity")


def three(rotation=False):
    return Floes([0.0, 1.0, 2.0], 5.0, [1.0, 2.0, 3.0], [0.5, 1.0, 2.0], rotation=rotation)


def test_examples_in_the_docstrings_are_true():
    assert doctest.testmod(floebmi.floes).failed == 0


def test_numbers_are_spread_over_all_floes():
    floes = three()
    assert len(floes) == 3
    np.testing.assert_array_equal(floes.y, [5.0, 5.0, 5.0])
    np.testing.assert_array_equal(floes.u, 0.0)
    assert floes.active.all() and not floes.motion.any()
    assert len(Floes(0.0, 0.0, 10.0, 1.0)) == 1
    assert len(Floes([], [], [], 1.0)) == 0


def test_area_volume_mass_and_moment_of_inertia_are_those_of_a_cylinder():
    floes = Floes([0.0, 0.0], 0.0, [2.0, 10.0], [0.5, 1.5])
    np.testing.assert_allclose(floes.area, np.pi * np.array([4.0, 100.0]))
    np.testing.assert_allclose(floes.volume, np.pi * np.array([2.0, 150.0]))
    mass = 934.0 * np.pi * np.array([2.0, 150.0])
    np.testing.assert_allclose(floes.mass(934.0), mass)
    np.testing.assert_allclose(floes.moment_of_inertia(934.0), mass * [4.0, 100.0] / 2)


class Kilometres(np.ndarray):
    """As astropy and unyt have them: numbers that convert to bare ones in silence."""

    unit = "km"

    def __new__(cls, values):
        return np.asarray(values).view(cls)

    def to(self, unit):
        raise NotImplementedError


@pytest.mark.parametrize(
    "given, said",
    [
        ({"radius": [1.0, -3.0]}, "floe 1: radius = -3.0 m; must be greater than 0"),
        ({"radius": 0.0}, "floe 0: radius = 0.0 m; must be greater than 0"),
        ({"thickness": [0.0, 1.0]}, "floe 0: thickness = 0.0 m; must be greater than 0"),
        ({"thickness": [1.0, np.inf]}, "floe 1: thickness = inf m; must be a finite number"),
        ({"radius": [1.0, 1e300]}, "floe 1: radius = 1e+300 m; must be less than 1e+09 m"),
        ({"x": [0.0, np.nan]}, "floe 1: x = nan m; must be a finite number"),
        ({"v": np.inf}, "floe 0: v = inf m/s; must be a finite number"),
        ({"motion": [0, 8]}, "floe 1: motion = 8; must be a sum of FIXED_X = 1"),
        ({"motion": 0.5}, "floe 0: motion = 0.5; must be"),
        (
            {"motion": [0, 15], "u": 0.1},
            "floe 1: u = 0.1 m/s: a piece of coast stands still; must be 0",
        ),
        ({"y": [0.0, 1.0, 2.0]}, "different numbers of values (x 2, y 3); must be the same"),
        ({"u": [[0.0]]}, "u has shape (1, 1)"),
        ({"u": "fast"}, "u = 'fast': must be a number"),
        ({"u": np.array(["1", 2.0], object)}, "u = array(['1', 2.0], dtype=object): must be"),
        ({"radius": Kilometres([1.0, 2.0])}, "radius = Kilometres([1., 2.]): must be a number"),
        ({"angle": 1.0}, "angle is given for floes that do not rotate"),
    ],
)
def test_a_wrong_value_is_refused_with_its_floe_and_what_would_be_right(given, said):
    values = {"x": [0.0, 1.0], "y": 0.0, "radius": 1.0, "thickness": 1.0} | given
    with pytest.raises(InputError) as error:
        Floes(**values)
    assert said in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("name", "values", "said"),
    [
        ("u", [1.0, 2.0], r"u has shape \(2,\): must be one number or 3 values, one per floe"),
        ("x", [[1.0, 2.0, 3.0]], r"x has shape \(1, 3\): must be a number or a row"),
        ("motion", [1, 2], r"motion has shape \(2,\): must be one number or 3 values"),
        ("v", "fast", "v = 'fast': must be a number"),
    ],
)
def test_a_refused_assignment_names_the_property_and_leaves_it_as_it_was(name, values, said):
    floes = three()
    before = floes.copy()
    with pytest.raises(InputError, match=said):
        setattr(floes, name, values)
    assert floes.same(before)


def test_a_name_that_floes_do_not_have_is_no_new_property():
    with pytest.raises(AttributeError, match="thicknes"):
        three().thicknes = 2.0


def test_a_refused_addition_names_the_floe_it_would_have_been_and_leaves_all_as_it_was():
    floes = three()
    with pytest.raises(InputError, match="floe 4: radius = -1.0 m"):
        floes.add([0.0, 1.0], 0.0, [1.0, -1.0], 1.0)
    assert len(floes) == 3


def test_rotation_arrays_exist_only_where_they_are_asked_for():
    floes = three()
    assert floes.angle is None and floes.angular_velocity is None and not floes.rotation
    with pytest.raises(InputError, match="do not rotate"):
        floes.angular_velocity = 1.0
    floes.u = [1.0, 2.0, 3.0]
    floes.allow_rotation()
    np.testing.assert_array_equal(floes.angle, 0.0)
    floes.add(9.0, 9.0, 1.0, 1.0, angle=0.5, angular_velocity=-1.0)
    floes.allow_rotation()
    np.testing.assert_array_equal(floes.angle, [0, 0, 0, 0.5])
    np.testing.assert_array_equal(floes.angular_velocity, [0, 0, 0, -1.0])
    np.testing.assert_array_equal(floes.u, [1.0, 2.0, 3.0, 0.0])


def test_assignment_writes_into_the_array_that_others_hold():
    floes = three()
    held = floes.u
    floes.u = 0.25
    np.testing.assert_array_equal(held, 0.25)
    floes.u[1] = 7.0
    assert held[1] == 7.0


@given(st.lists(st.integers(0, 9), max_size=12), st.booleans())
def test_floes_keep_their_numbers_and_values_however_they_are_added(groups, rotation):
    rng = np.random.default_rng(0)
    floes = Floes([], [], [], [], rotation=rotation)
    columns = {name: [] for name in ("x", "y", "radius", "thickness", "u", "v")}
    for k in groups:
        first = len(floes)
        values = {name: 0.1 + rng.random(k) for name in columns}
        np.testing.assert_array_equal(floes.add(**values), np.arange(first, first + k))
        for name, value in values.items():
            columns[name].extend(value)
    assert len(floes) == sum(groups)
    for name, value in columns.items():
        np.testing.assert_array_equal(getattr(floes, name), value)
    assert floes.active.all()


def test_storage_grows_by_doubling_so_that_many_additions_stay_cheap():
    floes = Floes([], [], [], [])
    storages = set()
    for k in range(1000):
        floes.add(k, 0.0, 1.0, 1.0)
        storages.add(floes.x.base.ctypes.data)
    assert len(floes) == 1000 and len(floes.x.base) <= 2048
    assert len(storages) <= 12


def test_concatenate_keeps_order_motion_activity_and_rotation():
    one, other = three(), three(rotation=True)
    one.active[1] = False
    one.motion[2] = FIXED
    other.angle[:] = 0.5
    floes = Floes.concatenate([one, other])
    assert len(floes) == 6
    np.testing.assert_array_equal(floes.active, [True, False, True, True, True, True])
    np.testing.assert_array_equal(floes.motion, [0, 0, FIXED, 0, 0, 0])
    np.testing.assert_array_equal(floes.angle, [0, 0, 0, 0.5, 0.5, 0.5])
    floes.x[0] = 99.0
    assert one.x[0] == 0.0
    assert len(Floes.concatenate([])) == 0


@pytest.mark.parametrize(
    "duplicate", [Floes.copy, copy.deepcopy, lambda floes: pickle.loads(pickle.dumps(floes))]
)
def test_copies_hold_the_same_and_share_nothing(duplicate):
    floes = three(rotation=True)
    floes.active[0] = False
    floes.motion[1] = FIXED_X
    twin = duplicate(floes)
    for name in NAMES:
        np.testing.assert_array_equal(getattr(twin, name), getattr(floes, name))
    twin.radius[0] = 100.0
    assert floes.radius[0] == 1.0


def test_check_finds_what_an_edit_spoiled():
    floes = three(rotation=True)
    floes.check()
    floes.angular_velocity[2] = np.nan
    with pytest.raises(InputError, match="floe 2: angular_velocity = nan rad/s"):
        floes.check()
    floes.angular_velocity[2] = 0.0
    floes.motion[0] = 9
    with pytest.raises(InputError, match="floe 0: motion = 9"):
        floes.check()


def test_repr_is_one_line_with_number_sizes_and_area():
    floes = three()
    assert repr(floes) == "Floes(n=3, radius 1 to 3 m, thickness 0.5 to 2 m, area 43.98 m²)"
    floes.motion[0] = FIXED
    floes.active[1] = False
    assert repr(floes).endswith("1 with prescribed motion, 1 inactive)")
    assert repr(Floes([], [], [], [])) == "Floes(n=0)"


def test_what_is_assigned_is_checked_as_what_is_given():
    floes = Floes([0.0, 50.0], 0.0, 10.0, 1.0)
    with pytest.raises(InputError, match="motion = 3.5"):
        floes.motion = 3.5
    floes.u = np.ma.masked_array([0.1, 1e20], [False, True])
    with pytest.raises(InputError, match="floe 1: u = nan"):
        floes.check()
