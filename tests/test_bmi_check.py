"""The one-cell check finds a host that is connected wrongly, and passes one that is right."""

import numpy as np
import pytest

from coupling.slab import TwoSlabOcean
from floebmi import bmi_check
from floebmi.bmi_check import FRACTION, PER_ICE_AREA, STRESS, VELOCITY, check_host, one_cell
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


class Upturned(TwoSlabOcean):
    """Counts the rows of the stress from the north, and those of its velocities from the south."""

    def set_value(self, name, src):
        super().set_value(name, np.asarray(src).reshape(5, 6)[::-1])


class Late(TwoSlabOcean):
    """Is moved by the stress that was set for the step before."""

    def update(self):
        now = [self.get_value_ptr(name).copy() for name in STRESS]
        for name, values in zip(STRESS, getattr(self, "last", (0 * now[0],) * 2), strict=True):
            super().set_value(name, values)
        super().update()
        self.last = now


class Coast(TwoSlabOcean):
    """Has no numbers on land."""

    land = (0, 1, 6)

    def get_value(self, name, dest):
        super().get_value(name, dest)
        dest[list(self.land)] = np.nan
        return dest


class Dry(Coast):
    land = range(30)


class Garbage(TwoSlabOcean):
    """Its first velocities are what was in memory."""

    def get_value(self, name, dest):
        if self.get_current_time() == 0.0:
            dest[:] = np.random.default_rng().normal(size=dest.size)
            return dest
        return super().get_value(name, dest)


class Bursts(TwoSlabOcean):
    def get_value(self, name, dest):
        super().get_value(name, dest)
        if any(self.get_value_ptr(stress).any() for stress in STRESS):
            dest[0] = np.inf
        return dest


class Copies(TwoSlabOcean):
    """Does not fill the caller's array, as `couple` needs it."""

    def get_value(self, name, dest):
        return self.get_value_ptr(name).copy()


class Mesh(TwoSlabOcean):
    def get_grid_type(self, grid):
        return "unstructured"


class Dies(TwoSlabOcean):
    def update(self):
        raise RuntimeError("CFL violated\nand told a long story")


class Minutes(TwoSlabOcean):
    def get_time_units(self):
        return "minutes since 2020-01-01"

    def get_time_step(self):
        return super().get_time_step() / 60.0


class Single(TwoSlabOcean):
    """In single precision, as a wrapper of Fortran that takes arrays of its own type alone."""

    def get_var_type(self, name):
        return "float32"

    def get_value(self, name, dest):
        assert dest.dtype == np.float32
        return super().get_value(name, dest)

    def set_value(self, name, src):
        assert src.dtype == np.float32
        super().set_value(name, src)


class Shared(TwoSlabOcean):
    """Is told the ice fraction in percent, and multiplies the stress by a power of it."""

    power, names = 1, PER_ICE_AREA

    def get_input_var_names(self):
        return (*self.names, FRACTION)

    def get_var_units(self, name):
        return "%" if name == FRACTION else super().get_var_units(self.known(name))

    def get_var_grid(self, name):
        return 0 if name == FRACTION else super().get_var_grid(self.known(name))

    def get_var_type(self, name):
        return "float64"

    def known(self, name):
        return STRESS[self.names.index(name)] if name in self.names else name

    def set_value(self, name, src):
        if name == FRACTION:
            self.share = np.asarray(src) / 100.0
        else:
            super().set_value(self.known(name), src)

    def update(self):
        for name in STRESS:
            super().set_value(name, self.get_value_ptr(name) * self.share**self.power)
        super().update()


class AsPerCell(Shared):
    power = 0


class Once(AsPerCell):
    names = STRESS


class Twice(Shared):
    names = STRESS


class Squared(Shared):
    power = 2


class Untold(Shared):
    share = 1.0

    def get_input_var_names(self):
        return self.names


def wrong(make, config, **options):
    return [answer.what for answer in check_host(make, config, **options) if not answer.passed]


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
    assert wrong(Upturned, config) == ["staggering along x", "staggering along y"]
    assert wrong(Garbage, config) == ["repeats"]
    assert wrong(Dry, config) == wrong(Copies, config) == ["repeats"]
    assert wrong(Bursts, config) == ["axes, push along x", "axes, push along y"]
    late = [answer for answer in check_host(Late, config) if not answer.passed]
    assert [answer.what for answer in late] == ["sign along x", "sign along y"]
    assert all("one step late" in answer.text for answer in late)


def test_who_multiplies_by_the_ice_fraction_must_be_as_the_name_of_the_stress_says(config):
    per = ["per, along x", "per, along y"]
    assert wrong(Shared, config, stress=PER_ICE_AREA) == wrong(Once, config) == []
    assert wrong(AsPerCell, config, stress=PER_ICE_AREA) == wrong(Twice, config) == per
    assert wrong(Squared, config, stress=PER_ICE_AREA) == per
    assert wrong(Untold, config, stress=PER_ICE_AREA) == per
    with pytest.raises(InputError, match="'ice': not there"):
        check_host(Once, config, fraction="ice")


def test_land_without_numbers_single_precision_and_a_clock_in_minutes_are_no_mistakes(config):
    assert wrong(Coast, config) == wrong(Single, config) == []
    assert wrong(Coast, config, cell=(1, 0)) == ["repeats"]
    with pytest.raises(InputError, match="cell = 5, 0: must be a row"):
        check_host(Coast, config, cell=(5, 0))
    told = [
        next(answer.text for answer in check_host(make, config) if answer.what == "size along x")
        for make in (TwoSlabOcean, Minutes)
    ]
    assert told[0] == told[1]


def test_the_command_answers_in_lines_and_with_its_exit_code(config, capsys):
    assert bmi_check.main(["coupling.slab:TwoSlabOcean", config]) == 0
    assert bmi_check.main([f"{__name__}:Turned", config]) == 1
    assert "the sign is turned" in capsys.readouterr().out
    assert bmi_check.main(["coupling.slab:NoOcean", config]) == 2
    assert (
        bmi_check.main(["coupling.slab:TwoSlabOcean", config, "--velocity", "u", VELOCITY[1]]) == 2
    )
    assert bmi_check.main([f"{__name__}:Mesh", config]) == 2
    assert bmi_check.main([f"{__name__}:Dies", config]) == 2
    assert bmi_check.main([f"{__name__}:Turned", config, "--density", "0"]) == 2
    told = capsys.readouterr()
    assert all(line.startswith(("ok", "WRONG")) for line in told.out.splitlines())
    errors = told.err.splitlines()
    assert "'unstructured' and rank" in errors[2]
    assert errors[3].endswith("the host failed: RuntimeError: CFL violated")
    assert len(errors) == 5 and all(line.startswith("floebmi.bmi_check: ") for line in errors)


def test_a_name_that_is_not_there_is_refused(config):
    with pytest.raises(InputError, match="not there; allowed"):
        check_host(TwoSlabOcean, config, stress=("tau_x", "tau_y"))
