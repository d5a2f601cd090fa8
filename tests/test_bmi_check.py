"""The one-cell check finds a host that is connected wrongly, and passes one that is right."""

import numpy as np
import pytest

from coupling.slab import TwoSlabOcean
from floebmi import bmi_check
from floebmi.bmi_check import STRESS, VELOCITY, check_host, one_cell
from floebmi.errors import InputError

OCEAN = """
[grid]
x = [0.0, 12e3]
y = [0.0, 10e3]
spacing = 2e3
[ocean]
surface_thickness = 5.0
deep_thickness = 30.0
quadratic_drag = 1e-3
surface_velocity = [0.4, 0.1]
[time]
step = 60.0
"""


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "ocean.toml"
    path.write_text(OCEAN)
    return str(path)


class Turned(TwoSlabOcean):
    def set_value(self, name, src):
        super().set_value(name, -np.asarray(src))


class Swapped(TwoSlabOcean):
    def set_value(self, name, src):
        super().set_value(STRESS[1 - STRESS.index(name)], src)


class Deaf(TwoSlabOcean):
    def set_value(self, name, src):
        pass


class Staggered(TwoSlabOcean):
    """Takes the stress at the faces to the east of its velocities."""

    def set_value(self, name, src):
        values = np.asarray(src).reshape(5, 6)
        super().set_value(name, 0.5 * (values + np.roll(values, 1, axis=1)).ravel())


class Knots(TwoSlabOcean):
    def get_var_units(self, name):
        return "Pa s" if name == STRESS[0] else super().get_var_units(name)


def wrong(make, config):
    return [answer.what for answer in check_host(make, config) if not answer.passed]


def test_the_ice_gives_the_stress_of_the_drag_law_in_one_cell():
    answers = one_cell()
    assert len(answers) == 2 and all(answer.passed for answer in answers)


def test_a_host_that_is_right_passes_and_its_layer_is_told(config):
    answers = check_host(TwoSlabOcean, config)
    assert all(answer.passed for answer in answers)
    told = next(answer.text for answer in answers if answer.what == "size along x")
    assert "layer of 4.9" in told  # 5 m, less what the deep slab took


def test_each_mistake_is_named(config):
    assert wrong(Turned, config) == ["sign along x", "sign along y"]
    assert wrong(Swapped, config) == ["axes, push along x", "axes, push along y"]
    assert wrong(Deaf, config) == ["sign along x", "sign along y"]
    assert wrong(Staggered, config) == ["staggering along x", "staggering along y"]
    assert wrong(Knots, config) == [f"units of {STRESS[0]}"]


def test_the_command_answers_in_lines_and_with_its_exit_code(config, capsys):
    assert bmi_check.main(["coupling.slab:TwoSlabOcean", config]) == 0
    assert bmi_check.main([f"{__name__}:Turned", config]) == 1
    assert "the sign is turned" in capsys.readouterr().out
    assert bmi_check.main(["coupling.slab:NoOcean", config]) == 2
    assert (
        bmi_check.main(["coupling.slab:TwoSlabOcean", config, "--velocity", "u", VELOCITY[1]]) == 2
    )
    told = capsys.readouterr()
    assert all(line.startswith(("ok", "WRONG")) for line in told.out.splitlines())
    errors = told.err.splitlines()
    assert len(errors) == 2 and all(line.startswith("floebmi.bmi_check: ") for line in errors)


def test_a_name_that_is_not_there_is_refused(config):
    with pytest.raises(InputError, match="not there; allowed"):
        check_host(TwoSlabOcean, config, stress=("tau_x", "tau_y"))
