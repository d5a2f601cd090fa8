"""FloeBmi: what the conformance test cannot see, and what the how-to promises."""

import json
import os
import re
import sys
from copy import deepcopy
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
import yaml

from floebmi import FloeBmi, Grid, InputError, StabilityError, bmi, running
from floebmi.bmi_layout import Layout, layout_of
from floebmi.forces import OceanDrag, bulk_coefficient
from floebmi.scene import read_scene

ROOT = Path(__file__).parents[1]
OCEAN = tuple(f"sea_surface_water_flowing__{a}_component_of_velocity" for a in "xy")
WIND = tuple(f"sea_surface_air_flowing__{a}_component_of_velocity" for a in "xy")
DRIFT = "sea_ice_flowing__x_component_of_velocity"
STRESS = "sea_ice_bottom_water_flowing__x_z_component_of_stress"
IMPULSE = "sea_ice_bottom_water_flowing__time_integral_of_x_z_component_of_stress"
MOMENTUM = "sea_ice_flowing__domain_integral_of_x_component_of_momentum"

SCENE = """
[domain]
x = [0.0, 8000.0]
y = [0.0, 6000.0]

[grid]
shape = [3, 4]

[[floes]]
arrangement = "regular"
radius = 400.0
spacing = 1500.0
velocity = [0.1, 0.0]

[contact]
model = "frictional"

[ocean]
velocity = [0.1, 0.05]

[atmosphere]
velocity = [8.0, -4.0]

[time]
exchange = 60.0
"""


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    file = tmp_path / "scene.toml"
    file.write_text(SCENE)
    return file


def started(file: Path) -> FloeBmi:
    component = FloeBmi()
    component.initialize(str(file))
    return component


def value(component: FloeBmi, name: str) -> np.ndarray:
    return component.get_value_ptr(name).copy()


def everything(component: FloeBmi) -> dict[str, np.ndarray]:
    names = component.get_input_var_names() + component.get_output_var_names()
    return {name: value(component, name) for name in names}


def same(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> bool:
    return set(one) == set(other) and all(np.array_equal(one[name], other[name]) for name in one)


# ---- the scene drives until the host does ------------------------------------------------------


@pytest.mark.long
def test_without_a_host_it_does_what_a_run_does(scene: Path) -> None:
    component = started(scene)
    for _ in range(3):
        component.update()
    built = read_scene(scene).build()
    running.run(
        built.model,
        180.0,
        ocean=built.ocean,
        atmosphere=built.atmosphere,
        exchange=60.0,
        every=60.0,
    )
    assert np.array_equal(component.model.floes.x, built.model.floes.x)
    assert np.array_equal(component.model.floes.u, built.model.floes.u)


class Rising:
    """A source that shows when it was asked."""

    def fill(self, t: float, u: np.ndarray, v: np.ndarray) -> None:
        u[:], v[:] = 1e-3 * t, -1e-3 * t


def test_a_source_of_the_scene_fills_each_exchange_with_its_middle(scene: Path) -> None:
    component = started(scene)
    component._running.sources["ocean"] = Rising()
    component._running.filled.clear()
    component.update()
    assert (value(component, OCEAN[0]) == 0.03).all()
    component.update_until(180.0)
    assert (value(component, OCEAN[1]) == -0.15).all()


@pytest.mark.parametrize("through", ["set_value", "set_value_at_indices", "pointer"])
def test_what_the_host_writes_stays_and_ends_the_scenes_source(scene: Path, through: str) -> None:
    component = started(scene)
    component.update()
    if through == "set_value":
        component.set_value(OCEAN[0], np.full(12, 0.7))
    elif through == "set_value_at_indices":
        component.set_value_at_indices(OCEAN[0], np.arange(12), np.full(12, 0.7))
    else:
        component.get_value_ptr(OCEAN[0])[:] = 0.7
    for _ in range(2):
        component.update()
    assert (value(component, OCEAN[0]) == 0.7).all()
    assert set(component._running.sources) == {"atmosphere"}


def test_who_drives_is_part_of_the_state(scene: Path, tmp_path: Path) -> None:
    component = started(scene)
    component.set_value(OCEAN[0], np.full(12, 0.7))
    component.update()
    component.save_state(tmp_path / "state.nc")
    other = started(scene)
    other.load_state(tmp_path / "state.nc")
    component.update()
    other.update()
    assert same(everything(component), everything(other))
    assert (value(other, OCEAN[0]) == 0.7).all()


def with_rising_current(scene: Path) -> FloeBmi:
    component = started(scene)
    running = component._running
    running.sources["ocean"] = running.of_scene["ocean"] = Rising()
    component.update()
    return component


def test_a_state_that_the_scene_drove_is_driven_by_it_again(scene: Path, tmp_path: Path) -> None:
    component, other = with_rising_current(scene), with_rising_current(scene)
    component.save_state(tmp_path / "state.nc")
    other.set_value(
        OCEAN[0], np.full(12, 0.7)
    )  # the host has the ocean, until the state comes back
    other.update()
    other.load_state(tmp_path / "state.nc")
    component.update()
    other.update()
    assert value(component, OCEAN[0])[0] == 0.09  # in the middle
    assert same(everything(component), everything(other))


def test_what_a_pointer_wrote_before_a_state_was_saved_is_the_hosts(
    scene: Path, tmp_path: Path
) -> None:
    component, other = with_rising_current(scene), with_rising_current(scene)
    component.get_value_ptr(OCEAN[0])[:] = 0.7
    component.save_state(tmp_path / "state.nc")
    other.load_state(tmp_path / "state.nc")
    component.update()
    other.update()
    assert (value(other, OCEAN[0]) == 0.7).all()
    assert same(everything(component), everything(other))


def test_what_nobody_sets_is_still_water_and_no_wind(scene: Path) -> None:
    scene.write_text(re.sub(r"velocity = .*\]\n", "", SCENE))
    component = started(scene)
    component.update()
    for name in (*OCEAN, *WIND, STRESS, DRIFT):
        assert (value(component, name) == 0.0).all(), name


# ---- configuration ------------------------------------------------------------------------------


def test_a_scene_can_have_every_input_that_the_table_lists(tmp_path: Path) -> None:
    """The Coriolis parameter among them, cell by cell: a floe in each half of the sea turns its own way."""
    text = """contact = "frictional"
[domain]
x = [0.0, 8000.0]
y = [0.0, 4000.0]
[grid]
shape = [1, 2]
[floes]
arrangement = "list"
each = [{x = 2000.0, y = 2000.0, radius = 500.0, u = 0.2}, {x = 6000.0, y = 2000.0, radius = 500.0, u = 0.2}]
[ocean]
[atmosphere]
[tilt]
[coriolis]
parameter = 1e-4
field = true
[time]
exchange = 600.0
"""
    path = tmp_path / "scene.toml"
    path.write_text(text)
    runs = {}
    for name, parameter in {"north": 1e-4, "south": -2e-4, "both": [1e-4, -2e-4]}.items():
        component = FloeBmi()
        component.initialize(str(path))
        assert component.get_input_var_names() == FloeBmi().get_input_var_names()
        assert (value(component, "earth__coriolis_frequency") == 1e-4).all()
        component.set_value("earth__coriolis_frequency", np.full(2, parameter))
        component.update()
        runs[name] = component.model.floes
    alone = [runs["north"].v[0], runs["south"].v[1]]
    np.testing.assert_allclose(runs["both"].v, alone, rtol=1e-12)
    assert runs["both"].v[0] < 0 < runs["both"].v[1]


def test_a_bmi_table_changes_the_scene_and_how_it_is_seen(scene: Path, tmp_path: Path) -> None:
    file = tmp_path / "bmi.toml"
    file.write_text(
        '[bmi]\nscene = "scene.toml"\nset = ["time.exchange=30"]\ncells = "faces"\nfloe_capacity = 40\n'
    )
    component = started(file)
    assert component.get_time_step() == 30.0
    assert component.get_grid_type(0) == "unstructured"
    assert component.get_var_location(STRESS) == "face"
    n, x = len(component.model.floes), "sea_ice_floe_center__x_coordinate"
    assert component.get_var_nbytes(x) == 40 * 8
    component.update()
    assert np.array_equal(value(component, x)[:n], component.model.floes.x)
    assert (value(component, x)[n:] == 0.0).all()
    assert component.get_var_type("sea_ice_floe__active_flag") == "int32"
    assert value(component, "sea_ice_floe__active_flag").sum() == component.model.floes.active.sum()


def test_the_restart_key_goes_on_with_the_same_bits(scene: Path, tmp_path: Path) -> None:
    component = started(scene)
    component.update_until(90.0)
    component.save_state(tmp_path / "state.nc")
    file = tmp_path / "bmi.yaml"
    file.write_text("bmi:\n  scene: scene.toml\n  restart: state.nc\n")
    other = started(file)
    assert other.get_current_time() == 90.0 and other.get_start_time() == 0.0
    assert same(everything(component), everything(other))
    component.update()
    other.update()
    assert same(everything(component), everything(other))


def test_a_component_that_was_killed_goes_on_from_its_checkpoint(
    scene: Path, tmp_path: Path
) -> None:
    whole = started(scene)
    file = tmp_path / "bmi.toml"
    text = '[bmi]\nscene = "scene.toml"\ncheckpoint = "now.nc"\n'
    file.write_text(text)
    killed = started(file)
    assert not (tmp_path / "now.nc").exists()
    for component in (whole, killed):
        component.update()
        component.update()
    file.write_text(text + 'restart = "now.nc"\n')
    other = started(file)
    assert other.get_current_time() == whole.get_current_time()
    whole.update()
    other.update()
    assert same(everything(whole), everything(other))


def test_an_update_whose_checkpoint_fails_leaves_everything_as_it_was(
    scene: Path, tmp_path: Path
) -> None:
    file, folder = tmp_path / "bmi.toml", tmp_path / "states"
    file.write_text('[bmi]\nscene = "scene.toml"\ncheckpoint = "states/now.nc"\n')
    folder.mkdir()
    component, whole = started(file), started(scene)
    whole.update()
    component.update()
    before = everything(component)
    (folder / "now.nc").unlink()
    folder.rmdir()
    for update in (component.update, lambda: component.update_until(400.0)):
        with pytest.raises(InputError, match="there is no folder"):
            update()
        assert component.get_current_time() == 60.0
        assert same(before, everything(component))
    folder.mkdir()
    for one in (component, whole):
        one.update_until(400.0)
    assert same(everything(component), everything(whole))
    restored = started(scene)
    restored.load_state(folder / "now.nc")
    assert same(everything(component), everything(restored))


@pytest.mark.parametrize("of_host", [False, True])
def test_a_restart_with_another_slope_has_that_of_its_scene_unless_a_host_set_it(
    scene: Path, of_host: bool
) -> None:
    file, state = scene.parent / "bmi.toml", scene.parent / "state.nc"

    def sloping(slope: float, restart: str = "") -> FloeBmi:
        changes = f"['tilt.slope=[{slope},0]', 'coriolis.parameter={slope}', 'coriolis.field=true']"
        file.write_text(f'[bmi]\nscene = "{scene.name}"\nset = {changes}\n{restart}')
        return started(file)

    first = sloping(1e-6)
    if of_host:
        first.set_value("sea_water_surface__x_derivative_of_elevation", np.full(12, 3e-6))
    first.save_state(state)
    ocean = sloping(2e-6, 'restart = "state.nc"\n').model.ocean
    expected = (3e-6, 1e-6) if of_host else (2e-6, 2e-6)
    assert (ocean.tilt_x == expected[0]).all() and (ocean.coriolis == expected[1]).all()


def test_what_is_no_name_or_number_of_a_grid_is_refused(scene: Path) -> None:
    component = started(scene)
    for wrong in (["name"], {}, None, 3.5):
        for call in (component.get_var_units, component.get_value_ptr, component.get_grid_size):
            with pytest.raises(InputError, match="not in this component|unknown; allowed"):
                call(wrong)


def test_a_state_of_another_date_is_refused_with_table_and_key(scene: Path) -> None:
    file, state = scene.parent / "bmi.toml", scene.parent / "state.nc"

    def dated(*changes: str) -> FloeBmi:
        file.write_text(f'[bmi]\nscene = "{scene.name}"\nset = {json.dumps(changes)}\n')
        return started(file)

    component = dated("time.start=1980-01-01")
    component.update()
    component.save_state(state)
    same_date = dated("time.start=1980-01-01T00:00")
    same_date.load_state(state)
    for changes, said in (
        (["time.start=1980-01-02"], "start = 1980-01-02, the restart's is 1980-01-01"),
        (["time.start=1980-01-01", "time.calendar=noleap"], "calendar = noleap, the restart's is"),
        ([], "start = none, the restart's is 1980-01-01"),
    ):
        with pytest.raises(InputError, match=rf"restart: \[time\] {said}"):
            dated(*changes).load_state(state)
    undated = dated()
    undated.save_state(state)
    same_date.load_state(state)  # written without one


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('[bmi]\nscene = "nowhere.toml"\n', ["nowhere.toml"]),
        ('[bmi]\nscene = "scene.toml"\ncells = "corners"\n', ["bmi", "cells", "corners", "faces"]),
        ('[bmi]\nscene = "scene.toml"\nfloe_capacity = 2\n', ["floe_capacity", "2"]),
        (
            f'[bmi]\nscene = "scene.toml"\nfloe_capacity = {10**30}\n',
            ["floe_capacity", "at most 1e+09"],
        ),
        ('[bmi]\nscene = "scene.toml"\nrestart = "none.nc"\n', ["none.nc"]),
        ('[bmi]\nscene = "scene.toml"\ncheckpoint = "no/now.nc"\n', ["checkpoint", "no/now.nc"]),
        ('[bmi]\nscene = "scene.toml"\nset = ["grid.kind=hexagonal"]\n', ["kind", "hexagonal"]),
        (SCENE.replace("exchange = 60.0", ""), ["[time] exchange"]),
        (SCENE.replace("shape = [3, 4]", 'kind = "structured"\nshape = [3, 4]'), ["structured"]),
    ],
)
def test_a_wrong_configuration_is_one_line_and_leaves_the_component_free(
    scene: Path, tmp_path: Path, text: str, words: list[str]
) -> None:
    file = tmp_path / "wrong.toml"
    file.write_text(text)
    component = FloeBmi()
    with pytest.raises(InputError) as error:
        component.initialize(str(file))
    assert "\n" not in str(error.value)
    assert all(word in str(error.value) for word in words), str(error.value)
    component.initialize(str(scene))


def test_forcing_that_does_not_reach_time_0_is_refused_with_file_and_table(scene: Path) -> None:
    at = (
        {"standard_name": "x_wind", "units": "m s-1"},
        {"standard_name": "y_wind", "units": "m s-1"},
    )
    place = {"units": "m"}
    xr.Dataset(
        {name: (("time", "y", "x"), np.ones((2, 2, 2)), one) for name, one in zip("uv", at, strict=True)},
        {
            "time": np.array(["2001-01-01", "2001-01-02"], "M8[ns]"),
            "y": ("y", [-1e6, 1e6], place), "x": ("x", [-1e6, 1e6], place),
        },
    ).to_netcdf(scene.with_name("wind.nc"))  # fmt: skip
    text = SCENE.replace("velocity = [8.0, -4.0]", 'file = "wind.nc"')
    scene.write_text(text + "start = '2000-01-01'\n")
    with pytest.raises(InputError) as error:
        started(scene)
    assert str(error.value).startswith(f"{scene}: [atmosphere] wind.nc: ")


@pytest.mark.parametrize("config", ["", "no-such-scene", "none.toml"])
def test_a_missing_configuration_is_one_line(config: str) -> None:
    with pytest.raises(InputError) as error:
        FloeBmi().initialize(config)
    assert "\n" not in str(error.value)


def test_initialize_twice_is_refused_and_changes_nothing(scene: Path) -> None:
    component = started(scene)
    component.update()
    with pytest.raises(InputError, match="finalize"):
        component.initialize(str(scene))
    assert component.get_current_time() == 60.0


def test_the_end_is_the_scenes_duration_or_the_largest_float(scene: Path) -> None:
    assert started(scene).get_end_time() == sys.float_info.max
    scene.write_text(SCENE + "duration = 600.0\n")
    assert started(scene).get_end_time() == 600.0


def test_a_time_that_no_run_comes_to_is_refused_as_the_end_where_no_scene_says_one(
    scene: Path,
) -> None:
    component = started(scene)
    with pytest.raises(
        InputError, match=r"update_until: time = 1\.797.* s: is .* exchanges of 60 s"
    ):
        component.update_until(component.get_end_time())
    assert component.get_current_time() == 0.0


# ---- outputs are made when they are asked for ---------------------------------------------------


def test_an_output_asked_for_late_is_what_it_is_when_asked_for_from_the_start(scene: Path) -> None:
    late, early = started(scene), started(scene)
    for time in (60.0, 130.0, 300.0):  # one exchange, a whole and a part, two and a part
        everything(early)
        early.update_until(time)
        late.update_until(time)
    assert STRESS not in late._running.asked
    assert same(everything(late), everything(early))
    late.update()
    early.update()
    assert same(everything(late), everything(early))


def test_stress_per_ice_area_times_the_fraction_is_that_per_cell_area_over_many_exchanges(
    scene: Path,
) -> None:
    component = started(scene)
    component.update_until(1830.0)  # floes stray by a third of a radius
    fraction = value(component, "sea_ice__area_fraction")
    per_ice = value(component, STRESS.replace("ice_bottom", "ice_floe_bottom"))
    assert ((0 < fraction) & (fraction < 1)).all()
    np.testing.assert_allclose(per_ice * fraction, value(component, STRESS), rtol=1e-12)


@pytest.mark.parametrize("until", [60.0, 130.0])
def test_an_edit_of_the_floes_is_seen_at_once_whether_outputs_were_asked_for_before_or_not(
    scene: Path, until: float
) -> None:
    file = scene.with_name("bmi.toml")
    file.write_text('[bmi]\nscene = "scene.toml"\nfloe_capacity = 100\n')
    early, late, plain = started(file), started(file), started(file)
    everything(early)
    for one in (early, late, plain):
        one.update_until(until)
    before, held = everything(early), early.get_value_ptr("sea_ice__area_fraction")
    for one in (early, late):
        one.model.floes.x[1] += 150.0
        one.model.floes.u[0] = 0.3
    grid = early.get_var_grid("sea_ice_floe_center__x_coordinate")
    for one in (early, late):
        assert one.get_grid_x(grid, np.empty(100))[1] == one.model.floes.x[1]
    assert same(everything(early), everything(late))
    assert np.array_equal(held, value(late, "sea_ice__area_fraction"))
    assert (value(early, DRIFT) != before[DRIFT]).any()
    assert (value(early, "sea_ice__area_fraction") != before["sea_ice__area_fraction"]).any()
    per_ice = value(early, STRESS.replace("ice_bottom", "ice_floe_bottom"))
    ice = value(early, "sea_ice__area_fraction") + value(
        early, "sea_ice_floe_overlap__area_fraction"
    )
    np.testing.assert_allclose((per_ice * ice)[ice > 0], before[STRESS][ice > 0], rtol=1e-12)
    for name in (STRESS, IMPULSE, MOMENTUM):  # of the update before
        assert np.array_equal(value(early, name), before[name])
    plain.model.floes.x[1] += 150.0
    plain.model.floes.u[0] = 0.3
    for one in (early, late, plain):  # to look changes nothing
        one.update()
    assert same(everything(early), everything(late)) and same(everything(early), everything(plain))


def test_the_linear_drag_coefficient_is_that_at_the_end_of_an_update(scene: Path) -> None:
    component, other = started(scene), started(scene)
    component.update_until(600.0)  # ten exchanges
    for _ in range(10):
        other.update()
    name = STRESS.replace("x_z_component_of_stress", "linear_drag_coefficient")
    assert np.array_equal(value(component, name), value(other, name))
    ocean, floes = component.model.ocean, component.model.floes
    slip = np.hypot(ocean.u[0] - floes.u, ocean.v[0] - floes.v)  # of water that is alike everywhere
    drag, side = OceanDrag(), component.model.draft_fraction * floes.thickness
    area = np.pi * floes.radius**2
    each = drag.density * area * bulk_coefficient(drag, floes.radius, side) * slip
    total = (value(component, name) * component.model.grid.area).sum()
    assert total == pytest.approx(each[floes.active].sum(), rel=1e-12)


# ---- faults -------------------------------------------------------------------------------------


def test_an_update_that_fails_leaves_everything_as_it_was(scene: Path) -> None:
    component, other = started(scene), started(scene)
    for one in (component, other):
        one.update()
    component.model.floes.u[0] = other.model.floes.u[0] = 0.12
    before, state = everything(component), deepcopy(component.model.state())
    vars(component.model)["advance"] = failing_after(component.model.advance)
    with pytest.raises(StabilityError):
        component.update_until(400.0)
    del component.model.advance
    assert component.get_current_time() == 60.0
    assert same(before, everything(component))
    after = component.model.state()
    for name, old in state.items():
        assert np.array_equal(old, after[name]), name
    component.update()
    other.update()
    assert same(everything(component), everything(other))


def failing_after(advance):
    """An advance that moves everything, and then gives up."""

    def fail(duration: float) -> None:
        advance(duration)
        raise StabilityError("floe 3: no longer finite")

    return fail


def test_NaN_through_a_pointer_is_refused_by_the_update(scene: Path) -> None:
    component = started(scene)
    component.update()
    component.get_value_ptr(WIND[0])[5] = np.nan
    with pytest.raises(InputError, match=r"atmosphere\.u.*5"):
        component.update()
    assert component.get_current_time() == 60.0
    component.get_value_ptr(WIND[0])[5] = 3.0
    component.update()
    turned = np.zeros(component.model.grid.shape).T
    with pytest.raises(InputError, match=rf"{OCEAN[0]} has shape .*: must be .* rows and columns"):
        component.set_value(OCEAN[0], turned)


def test_NaN_on_dry_cells_is_accepted_and_does_not_spread(tmp_path: Path) -> None:
    ring = "[[[5000, -1000], [9000, -1000], [9000, 9000], [5000, 9000], [5000, -1000]]]"
    (tmp_path / "land.geojson").write_text(f'{{"type": "Polygon", "coordinates": {ring}}}')
    floes = SCENE.replace('arrangement = "regular"', 'arrangement = "regular"\nx = [0.0, 4000.0]')
    coast = '\n[coast]\ngeojson = "land.geojson"\nradius = 300.0\n'
    (tmp_path / "scene.toml").write_text(floes + coast)
    component = started(tmp_path / "scene.toml")
    wet = component.model.grid.wet
    assert wet.any() and not wet.all()
    current = np.where(wet, 0.2, np.nan)
    component.set_value(OCEAN[0], current)
    component.update()
    for name in component.get_output_var_names():
        assert np.isfinite(value(component, name)).all(), name
    current[np.flatnonzero(wet)[1]] = np.nan
    with pytest.raises(InputError, match=f"{OCEAN[0]}.* {np.flatnonzero(wet)[1]}"):
        component.set_value(OCEAN[0], current)


INFLOW = """
[[inflow]]
edge = "west"
thickness = 1.0
velocity = [5.0, 0.0]
sizes = {distribution = "single", radius = 400.0}
"""


def test_inflow_beyond_the_capacity_fails_and_leaves_everything_as_it_was(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(SCENE + INFLOW)
    probe = started(tmp_path / "scene.toml")
    n = len(probe.model.floes)
    (tmp_path / "bmi.toml").write_text(f'[bmi]\nscene = "scene.toml"\nfloe_capacity = {n}\n')
    component = started(tmp_path / "bmi.toml")
    before = everything(component)
    with pytest.raises(InputError, match=f"floe_capacity = {n}"):
        component.update_until(3600.0)
    assert len(component.model.floes) == n and same(before, everything(component))


def test_a_state_with_fewer_floes_leaves_nothing_of_those_that_came_later(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(SCENE + INFLOW)
    (tmp_path / "bmi.toml").write_text('[bmi]\nscene = "scene.toml"\nfloe_capacity = 100\n')
    component = started(tmp_path / "bmi.toml")
    n, before = len(component.model.floes), everything(component)
    component.save_state(tmp_path / "state.nc")
    component.update_until(600.0)
    assert len(component.model.floes) > n
    component.load_state(tmp_path / "state.nc")
    assert len(component.model.floes) == n and same(before, everything(component))


# ---- grids --------------------------------------------------------------------------------------


def shared_edges(layout: Layout) -> np.ndarray:
    return np.bincount(layout.face_edges, minlength=layout.edge_nodes.size // 2)


def test_polygons_of_all_corners_are_faces_without_padding() -> None:
    grid = Grid.unstructured(
        [0, 2, 4, 4, 2, 0, 6], [0, 0, 0, 2, 3, 2, 1], [[0, 1, 4, 5], [1, 2, 3, 4], [2, 6, 3]]
    )
    layout = layout_of(grid, faces=False)
    assert layout.type == "unstructured" and layout.location == "face"
    assert layout.nodes_per_face.tolist() == [4, 4, 3]
    assert layout.face_nodes.tolist() == [0, 1, 4, 5, 1, 2, 3, 4, 2, 6, 3]
    ends = layout.edge_nodes.reshape(-1, 2)[layout.face_edges]
    assert [set(e) for e in ends.tolist()] == [
        {0, 1}, {1, 4}, {4, 5}, {5, 0}, {1, 2}, {2, 3}, {3, 4}, {4, 1}, {2, 6}, {6, 3}, {3, 2}
    ]  # fmt: skip
    assert sorted(shared_edges(layout).tolist()) == [1] * 7 + [2] * 2
    assert (
        layout.size - layout.edge_nodes.size // 2 + layout.values == 1
    )  # Euler, without the outside


def test_curvilinear_cells_are_faces() -> None:
    x, y = np.meshgrid(np.linspace(0, 5, 6), np.linspace(0, 3, 4))
    layout = layout_of(Grid.curvilinear(x + 0.2 * y, y), faces=False)
    assert (layout.type, layout.values, layout.size) == ("unstructured", 15, 24)
    assert layout.size - layout.edge_nodes.size // 2 + layout.values == 1


# ---- the books ----------------------------------------------------------------------------------


def test_the_residuals_are_round_off(scene: Path) -> None:
    component = started(scene)
    for _ in range(5):
        component.update()
    for a in "xy":
        residual = value(component, f"sea_ice_flowing__{a}_component_of_momentum_balance_residual")
        assert abs(residual[0]) <= 1e-12 * component.model.ledger.turnover[1:3].max()


# ---- over gRPC ----------------------------------------------------------------------------------


def test_in_another_process_it_gives_the_same_bits(
    scene: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("grpc4bmi")
    # the server is a program beside the interpreter, and imports floebmi from here
    monkeypatch.setenv("PATH", str(Path(sys.executable).parent), prepend=os.pathsep)
    monkeypatch.setenv("PYTHONPATH", str(ROOT), prepend=os.pathsep)
    from grpc4bmi.bmi_client_subproc import BmiClientSubProcess

    remote = BmiClientSubProcess("floebmi.bmi.FloeBmi", timeout=60)
    try:
        remote.initialize(str(scene))
        local = started(scene)
        names = local.get_input_var_names() + local.get_output_var_names()
        assert (*remote.get_input_var_names(), *remote.get_output_var_names()) == names
        current = np.random.default_rng(0).uniform(-0.3, 0.3, 12)
        for component in (remote, local):
            component.set_value(OCEAN[0], current)
            component.update()
            component.update_until(200.0)
        assert remote.get_current_time() == 200.0
        for name in names:
            size = local.get_value_ptr(name).size
            there = remote.get_value(name, np.empty(size, local.get_var_type(name)))
            assert np.array_equal(there, local.get_value_ptr(name)), name
        with pytest.raises(Exception, match="wet cell: must be finite"):
            remote.set_value(OCEAN[0], np.full(12, np.nan))
        remote.finalize()
    finally:
        del remote


# ---- how-to and metadata ------------------------------------------------------------------------


def test_the_table_of_the_how_to_is_the_table() -> None:
    assert bmi.table() in (ROOT / "docs/couple.md").read_text(encoding="utf-8")


@pytest.mark.long
def test_the_metadata_make_a_scene_that_starts(tmp_path: Path) -> None:
    folder = Path(bmi.__file__).parent / FloeBmi.METADATA
    api, run, parameters = (
        yaml.safe_load((folder / f"{name}.yaml").read_text())
        for name in ("api", "run", "parameters")
    )
    assert (api["package"], api["class"]) == ("floebmi", "FloeBmi")
    text = (folder / run["config_file"]).read_text()
    assert set(re.findall(r"{{ (\w+) }}", text)) == set(parameters)
    for name, parameter in parameters.items():
        text = text.replace(f"{{{{ {name} }}}}", str(parameter["value"]["default"]))
    (tmp_path / "scene.toml").write_text(text)
    component = started(tmp_path / "scene.toml")
    component.update()
    assert component.get_current_time() == parameters["exchange"]["value"]["default"]
    # no ice is in the range of what the form offers: the run beside which the others stand
    assert parameters["concentration"]["value"]["range"]["min"] == 0.0
    free = tmp_path / "free.toml"
    free.write_text(text.replace("concentration = 0.6", "concentration = 0.0"))
    component = started(free)
    component.set_value(OCEAN[0], np.full(80, 0.3))
    component.update()
    assert not value(component, "sea_ice__area_fraction").any()
    assert not value(component, "sea_ice_bottom_water_flowing__x_z_component_of_stress").any()


def test_what_lies_under_a_mask_is_no_value(scene):
    component = started(scene)
    size = component.get_grid_size(0)
    current = np.ma.masked_array(np.full(size, 0.1))
    component.set_value(OCEAN[0], current)
    current[2] = np.ma.masked
    current.data[2] = 3.0
    with pytest.raises(InputError, match="nan at index 2, a wet cell: must be finite"):
        component.set_value(OCEAN[0], current)
    assert (component.get_value_ptr(OCEAN[0]) == 0.1).all()


def test_buffers_and_indices_that_do_not_hold_the_values_are_refused(tmp_path: Path) -> None:
    """Nodes from 128 on came round in a buffer of int8, to -128; what is masked was read all the same."""
    (tmp_path / "scene.toml").write_text(SCENE.replace("shape = [3, 4]", "shape = [12, 16]"))
    (tmp_path / "bmi.toml").write_text('[bmi]\nscene = "scene.toml"\ncells = "faces"\n')
    component = started(tmp_path / "bmi.toml")
    size = component.get_grid_size(0)
    corners = 4 * component.get_grid_face_count(0)
    for kind in ("int32", ">i4", "int64"):
        nodes = component.get_grid_face_nodes(0, np.empty(corners, kind))
        assert (nodes.min(), nodes.max()) == (0, size - 1)
    fixed = np.zeros(192)
    fixed.flags.writeable = False
    far = np.array([2**63 + 5], np.uint64)
    masked = np.ma.masked_array([1, 2], [False, True])
    before = everything(component)
    cases = [
        (lambda: component.get_grid_face_nodes(0, np.empty(corners, np.int8)), "int8; must hold"),
        (lambda: component.get_value(STRESS, np.empty(192, np.float16)), "float16; must hold"),
        (lambda: component.get_value(STRESS, fixed), "read-only"),
        (lambda: component.get_value(STRESS, np.empty((16, 12))), "must be .12, 16., rows and columns"),
        (lambda: component.get_value_at_indices(STRESS, np.empty(1), far), "index 9223372036854775813"),
        (lambda: component.get_value_at_indices(STRESS, np.empty(2), masked), "masked indices"),
        (lambda: component.set_value_at_indices(OCEAN[0], masked, np.ones(2)), "masked indices"),
        (lambda: component.update_until("60"), "time = '60': must be a number"),
    ]  # fmt: skip
    for call, words in cases:
        with pytest.raises(InputError, match=words) as caught:
            call()
        assert "\n" not in str(caught.value)
    assert same(before, everything(component))
