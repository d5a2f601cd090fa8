"""The two-slab ocean keeps its own books, and is a complete BMI component."""

import sys
import textwrap

import numpy as np
import pytest
from bmipy import Bmi

import coupling.slab
from coupling.slab import DEEP, INPUTS, MOMENTUM, OUTPUTS, RECEIVED, STRESS, SURFACE, TwoSlabOcean
from floebmi.errors import InputError

CONFIG = """
[grid]
x = [1000.0, 5000.0]
y = [0.0, 6000.0]
spacing = [1000.0, 2000.0]
[ocean]
surface_thickness = 5.0
deep_thickness = 20.0
linear_drag = {linear}
quadratic_drag = {quadratic}
surface_velocity = [0.3, -0.1]
deep_velocity = [0.0, 0.05]
[time]
step = 300.0
"""


@pytest.fixture
def make(tmp_path):
    def started(linear=1e-4, quadratic=2.5e-3, text=CONFIG):
        path = tmp_path / "ocean.toml"
        path.write_text(text.format(linear=linear, quadratic=quadratic))
        ocean = TwoSlabOcean()
        ocean.initialize(str(path))
        return ocean

    return started


@pytest.mark.parametrize(("linear", "quadratic"), [(0, 0), (1e-4, 0), (0, 2.5e-3), (10.0, 5.0)])
def test_momentum_changes_by_the_impulse_received_and_by_nothing_else(make, linear, quadratic):
    ocean = make(linear, quadratic)
    rng = np.random.default_rng(2)
    before = [ocean.get_value_ptr(name)[0] for name in MOMENTUM]
    for _ in range(40):
        for name in STRESS:
            ocean.set_value(name, rng.normal(0.05, 0.2, 12))
        ocean.update()
    for axis in (0, 1):
        gained = ocean.get_value_ptr(MOMENTUM[axis])[0] - before[axis]
        received = ocean.get_value_ptr(RECEIVED[axis])[0]
        assert abs(gained - received) < 1e-13 * 12 * 2e6 * 0.2 * 300 * 40
        assert received > 0  # the sign: along +x where the stress is


def test_the_push_is_that_of_a_slab_alone_when_there_is_no_drag(make):
    ocean = make(0, 0)
    ocean.set_value(STRESS[0], np.full(12, 0.5))
    ocean.update_until(1000.0)
    np.testing.assert_allclose(
        ocean.get_value_ptr(SURFACE[0]), 0.3 + 0.5 * 1000 / (1000 * 5), rtol=1e-14
    )
    np.testing.assert_array_equal(ocean.get_value_ptr(DEEP[0]), 0.0)


def test_linear_drag_lets_the_difference_decay_as_the_formula_says(make):
    rate = 1e-4 * (1 / 5 + 1 / 20)
    errors = []
    for step in (400.0, 200.0):
        ocean = make(1e-4, 0, CONFIG.replace("300.0", str(step)))
        ocean.update_until(8000.0)
        difference = ocean.get_value_ptr(SURFACE[0])[0] - ocean.get_value_ptr(DEEP[0])[0]
        errors.append(difference - 0.3 * np.exp(-rate * 8000))
    assert 1.8 < errors[0] / errors[1] < 2.2  # first order in the step
    assert abs(errors[1]) < 1e-3


def test_quadratic_drag_goes_with_the_speed_of_the_one_slab_past_the_other(make):
    """The difference, (0.3, -0.15) m/s at first, turns nowhere; its size follows d' = -C (1/H1 + 1/H2) d^2."""
    ocean = make(0, 2.5e-3, CONFIG.replace("300.0", "10.0"))
    ocean.update_until(8000.0)
    left = [ocean.get_value_ptr(SURFACE[a])[0] - ocean.get_value_ptr(DEEP[a])[0] for a in (0, 1)]
    slowed = 1 / (1 + 2.5e-3 * (1 / 5 + 1 / 20) * np.hypot(0.3, 0.15) * 8000)
    assert left == pytest.approx([0.3 * slowed, -0.15 * slowed], rel=2e-3)


def test_a_step_much_longer_than_the_drag_allows_still_ends_at_rest_with_each_other(make):
    ocean = make(100.0, 100.0)
    ocean.update_until(3000.0)
    np.testing.assert_allclose(
        ocean.get_value_ptr(SURFACE[0]), ocean.get_value_ptr(DEEP[0]), atol=1e-9
    )


def test_update_until_lands_exactly_and_never_goes_back(make):
    ocean = make()
    ocean.update_until(700.1)
    assert ocean.get_current_time() == 700.1
    by_hand = make(text=CONFIG.replace("300.0", "1000.0"))  # one step for each call
    for until in (300.0, 600.0, 700.1):
        by_hand.update_until(until)
    np.testing.assert_array_equal(
        ocean.get_value_ptr(SURFACE[0]), by_hand.get_value_ptr(SURFACE[0])
    )
    momentum = ocean.get_value_ptr(SURFACE[0]).copy()
    ocean.update_until(700.1)
    np.testing.assert_array_equal(ocean.get_value_ptr(SURFACE[0]), momentum)
    ocean.update()
    assert ocean.get_current_time() == 700.1 + 300.0
    with pytest.raises(InputError, match="before the current time, 1000.1 s"):
        ocean.update_until(700.1)


def test_what_the_text_calls_optional_has_the_numbers_that_the_text_shows(tmp_path):
    told = textwrap.dedent(coupling.slab.__doc__.partition("(TOML):")[2])
    at_rest = told.replace("[0.2, 0.0]", "[0.0, 0.0]").replace("end = 86400.0", "")
    oceans = []
    for name, text in (("told", at_rest), ("bare", told.partition("[ocean]")[0])):
        (tmp_path / name).write_text(text)
        oceans.append(TwoSlabOcean())
        oceans[-1].initialize(str(tmp_path / name))
        oceans[-1].set_value(STRESS[0], np.full(200, 0.5))
        oceans[-1].update()
    one, other = oceans
    assert one.get_current_time() == other.get_current_time() == 600.0
    assert one.get_end_time() == other.get_end_time() == sys.float_info.max
    for name in OUTPUTS:
        np.testing.assert_array_equal(one.get_value_ptr(name), other.get_value_ptr(name))
    (tmp_path / "whole").write_text(told)
    one.initialize(str(tmp_path / "whole"))
    assert one.get_end_time() == 86400.0


def test_it_answers_every_question_of_bmi(make):
    unstarted = TwoSlabOcean()
    assert unstarted.get_input_var_names() == INPUTS
    assert not set(INPUTS) & set(OUTPUTS)
    assert unstarted.get_output_item_count() == len(OUTPUTS)
    assert not Bmi.__abstractmethods__ - set(dir(TwoSlabOcean))
    ocean = make()
    for name in INPUTS + OUTPUTS:
        grid = ocean.get_var_grid(name)
        size = ocean.get_grid_size(grid)
        assert ocean.get_var_nbytes(name) == size * ocean.get_var_itemsize(name)
        assert ocean.get_value(name, dest := np.empty(size)) is dest
        assert ocean.get_value_at_indices(name, one := np.empty(1), np.array([size - 1])) is one
        assert one[0] == dest[-1]
        assert ocean.get_var_location(name) == "node"
    for names, units in (
        (SURFACE + DEEP, "m s-1"),
        (STRESS, "N m-2"),
        (MOMENTUM + RECEIVED, "N s"),
    ):
        assert {ocean.get_var_units(name) for name in names} == {units}
    assert ocean.get_time_units() == "s"
    ocean.set_value(STRESS[0], np.arange(12.0))
    ocean.set_value_at_indices(STRESS[0], np.array([9, 2]), np.array([-1.0, -2.0]))
    some = ocean.get_value_at_indices(STRESS[0], np.empty(3), np.array([2, 10, 9]))
    assert some.tolist() == [-2.0, 10.0, -1.0] and ocean.get_value_ptr(STRESS[0])[0] == 0.0
    shape = ocean.get_grid_shape(0, np.empty(2, np.int32))
    assert list(shape) == [3, 4]
    assert list(ocean.get_grid_spacing(0, np.empty(2))) == [2000.0, 1000.0]
    assert list(ocean.get_grid_origin(0, np.empty(2))) == [1000.0, 1500.0]
    assert list(ocean.get_grid_x(0, np.empty(4))) == [1500.0, 2500.0, 3500.0, 4500.0]
    assert list(ocean.get_grid_y(0, np.empty(3))) == [1000.0, 3000.0, 5000.0]
    assert (ocean.get_grid_type(0), ocean.get_grid_rank(0)) == ("uniform_rectilinear", 2)
    assert (ocean.get_grid_type(1), ocean.get_grid_rank(1)) == ("scalar", 0)


def test_two_oceans_are_independent_and_one_can_be_started_again(make):
    one, other = make(), make()
    pointer = other.get_value_ptr(SURFACE[0])
    one.set_value(STRESS[0], np.ones(12))
    one.update()
    assert other.get_current_time() == 0.0
    np.testing.assert_array_equal(pointer, 0.3)
    other.update()
    assert (pointer < 0.3).all()  # a live reference
    one.finalize()
    with pytest.raises(InputError, match="call initialize first"):
        one.update()
    one.__init__()
    with pytest.raises(InputError, match="call initialize first"):
        one.get_value(SURFACE[0], np.empty(12))


def test_what_cannot_be_used_is_refused_in_one_line(make, tmp_path):
    ocean = make()
    stress = np.zeros(12)
    stress[5] = np.nan
    before = ocean.get_value_ptr(STRESS[0]).copy()
    cases = [
        (lambda: ocean.set_value(STRESS[0], stress), "nan at cell 5"),
        (lambda: ocean.set_value(STRESS[0], stress[:4]), "4 values; must be 12"),
        (lambda: ocean.set_value(STRESS[0], "calm"), "must be real numbers"),
        (lambda: ocean.set_value(STRESS[0], np.zeros((4, 3))), "rows and columns"),
        (lambda: ocean.set_value_at_indices(STRESS[0], [12], [1.0]), "index 12: must be from 0 to 11"),
        (lambda: ocean.set_value_at_indices(STRESS[0], [0.5], [1.0]), "must be integers"),
        (lambda: ocean.get_value(MOMENTUM[0], np.empty(12)), "has 12 places; must have 1"),
        (lambda: ocean.get_value(SURFACE[0], np.empty((12, 2))), "has 24 places; must have 12"),
        (lambda: ocean.get_value(SURFACE[0], [0.0] * 12), "is a list; must be a numpy array"),
        (lambda: ocean.get_value(SURFACE[0], np.empty((4, 3))), "the buffer has shape .4, 3.: must be"),
        (lambda: ocean.get_value(SURFACE[0], np.empty(12, int)), "of type int64; must hold float64"),
        (lambda: ocean.get_value(SURFACE[0], np.empty(12, complex)), "of type complex128; must hold"),
        (lambda: ocean.get_value(SURFACE[0], np.empty(12, object)), "of type object; must hold"),
        (lambda: ocean.get_value_at_indices(SURFACE[0], np.empty(2), [0]), "2 places; must have 1"),
        (lambda: ocean.get_value_at_indices(SURFACE[0], np.empty(1), [-1]), "must be from 0 to 11"),
        (lambda: ocean.get_grid_x(0, np.empty(3)), "grid 0: x: the buffer has 3 places; must have 4"),
        (lambda: ocean.get_grid_shape(0, np.empty(1, int)), "has 1 places; must have 2"),
        (lambda: ocean.set_value(SURFACE[0], np.zeros(12)), "an output"),
        (lambda: ocean.get_value("sea_ice__thickness", stress), "unknown"),
        (lambda: ocean.get_grid_type(7), "grid 7"),
        (lambda: ocean.get_grid_shape(1, np.empty(2)), "not a grid of cells"),
        (lambda: ocean.update_until(-1.0), "before the current time"),
        (lambda: ocean.update_until(1e300), "at most 1e\\+09 are allowed"),
        (lambda: TwoSlabOcean().initialize(""), "configuration file"),
        (lambda: TwoSlabOcean().initialize(str(tmp_path / "none.toml")), "no such file"),
        (lambda: make(text=CONFIG.replace("surface_thickness", "thickness_")), "thickness_"),
        (lambda: make(linear=-1.0), "linear_drag"),
        (lambda: make(text=CONFIG.replace("spacing = [1000.0", "spacing = [999.0")), "does not divide"),
    ]  # fmt: skip
    for call, text in cases:
        with pytest.raises(InputError, match=text) as caught:
            call()
        assert "\n" not in str(caught.value)
    np.testing.assert_array_equal(ocean.get_value_ptr(STRESS[0]), before)
