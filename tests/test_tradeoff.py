"""Speed against accuracy: what is compared with what, and which setting is recommended."""

import json
import time
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner
from matplotlib.backends.backend_agg import FigureCanvasAgg

from floebmi import calibration, tradeoff, tradeoff_result
from floebmi.boundaries import Domain
from floebmi.cli import floebmi as command
from floebmi.errors import InputError
from floebmi.floes import COAST, Floes, without_small
from floebmi.grid import Grid
from floebmi.making import Making
from floebmi.model import Model
from floebmi.scene import read_scene

SCENE = """
title = "a few floes that meet"
contact = "frictional"
[domain]
x = [0, 400]
y = [0, 400]
edges = "periodic"
[floes]
size = { distribution = "power_law", radius_min = 10, radius_max = 40 }
concentration = 0.2
velocity = [0.1, 0.05]
[time]
duration = 60
[output]
every = 15
"""
TWO = """arrangement = "list"
each = [
    { x = 150, y = 150, radius = 10, u = 0.5 },
    { x = 175, y = 158, radius = 15 },
]
"""
PACK = SCENE[SCENE.index("size =") : SCENE.index("[time]")]
QUIET = SCENE.replace(PACK, TWO)
STREAM = """[[floes]]
size = { distribution = "power_law", radius_min = 10, radius_max = 30 }
concentration = 0.6
x = [WEST, EAST]
velocity = [SPEED, 0]
"""
CHAOTIC = SCENE.replace("[floes]\n" + PACK, "".join(
    STREAM.replace("WEST", west).replace("EAST", east).replace("SPEED", speed)
    for west, east, speed in (("0", "200", "0.5"), ("200", "400", "-0.5"))
)).replace("duration = 60", "duration = 300").replace("every = 15", "every = 60")  # fmt: skip


MARK = {"floebmi_file": "tradeoff 1"}


@pytest.fixture
def few_dials(monkeypatch):
    """Dials that all run the same machine code."""
    dials = {"step": ["step.fraction=0.3"], "stiffness": ["contact.youngs_modulus=5e+06"]}
    monkeypatch.setattr(tradeoff, "settings", lambda scene, model, schedule: dials)


def scene_file(folder, text):
    path = folder / "pack.toml"
    path.write_text(text)
    return path


def test_a_quiet_scene_is_compared_pointwise_and_the_fastest_accurate_setting_is_run(
    tmp_path, few_dials
):
    path = scene_file(tmp_path, QUIET)
    told = CliRunner().invoke(
        command, ["tradeoff", str(path), "--seeds", "1", "--jobs", "1", "--to", str(path.with_suffix(".tradeoff.nc")), "--quiet"]
    )  # fmt: skip
    assert told.exit_code == 0, told.output
    assert path.with_suffix(".tradeoff.png").stat().st_size > 10_000
    scene = read_scene(path)
    data = tradeoff_result.result(scene)
    assert "quiet" in data.comparison and data.of == "velocity"
    assert (
        data.Conventions == "CF-1.11" and data.title == "speed against accuracy of the scene pack"
    )
    assert "Z: written by floebmi" in data.history and data.source.startswith("floebmi ")
    errors = data.error.sel(quantity="velocity")
    assert errors.sel(setting=data.reference) == 0.0
    assert 0 < errors.sel(setting="step.fraction=0.3") < errors.sel(setting="")
    assert tradeoff_result.chosen(scene, 0.9) == tradeoff_result.recommended(data, 0.9)
    with pytest.raises(InputError, match="no setting in .* is so accurate; must be at least") as no:
        tradeoff_result.chosen(scene, 1e-12)
    assert tradeoff_result.chosen(scene, float(str(no.value).split()[-1]))
    ran = CliRunner().invoke(
        command, ["run", str(path), "--accuracy", "0.9", "--to", str(tmp_path / "out")]
    )
    assert ran.exit_code == 0 and "accuracy 0.9: " in ran.output, ran.output
    told = CliRunner().invoke(command, ["explain", str(path)])
    assert "step.fraction=0.3 " in told.output and "× the speed, error of velocity" in told.output


def test_a_result_of_another_text_of_the_scene_is_refused(tmp_path):
    scene = read_scene(scene_file(tmp_path, QUIET))
    with pytest.raises(InputError, match="there is no pack.tradeoff.nc beside"):
        tradeoff_result.chosen(scene, 0.1)
    xr.Dataset(attrs=MARK | {"scene_hash": "of another"}).to_netcdf(tradeoff_result.stored(scene))
    with pytest.raises(InputError, match="was measured for another text"):
        tradeoff_result.chosen(scene, 0.1)
    assert tradeoff_result.result(scene) is None


@pytest.mark.parametrize("by_hand", [[], ["step.fraction=0.2"]])
def test_a_result_of_files_that_have_changed_since_is_refused(tmp_path, by_hand):
    floes = tmp_path / "floes.csv"
    floes.write_text("x,y,radius,thickness,u\n150,150,10,1,0.5\n175,158,15,1,0\n")
    path = scene_file(tmp_path, SCENE.replace(PACK, 'arrangement = "file"\nfile = "floes.csv"\n'))
    scene = read_scene(path, by_hand)
    data = numbers([0.01, 0.02, 0.0]).assign_coords(setting=["step.fraction=0.7", "", "fine"])
    data.attrs |= MARK | {
        "scene_hash": tradeoff_result.digest(scene.text),
        "files": json.dumps(tradeoff_result.files_of(scene)),
        "overrides": json.dumps(by_hand),
    }
    data.to_netcdf(tradeoff_result.stored(scene))
    options = [word for change in by_hand for word in ("--set", change)]
    run = ["run", str(path), *options, "--accuracy", "0.1", "--duration", "15"]
    told = CliRunner().invoke(command, [*run, "--to", str(tmp_path / "out")])
    assert told.exit_code == 0 and "accuracy 0.1: --set step.fraction=0.7" in told.output
    floes.write_text("x,y,radius,thickness,u\n150,150,10,1,0.05\n175,158,15,1,0\n")
    told = CliRunner().invoke(command, [*run, "--to", str(tmp_path / "other")], prog_name="floebmi")
    assert told.exit_code == 2 and told.stderr.count("\n") == 1
    anew = " ".join(["--to", str(tradeoff_result.stored(scene)), *options, "makes it anew"])
    assert "pack.tradeoff.nc: floes.csv changed since it was measured" in told.stderr
    assert anew in told.stderr
    assert tradeoff_result.result(scene) is None


def test_packaged_results_are_of_the_packaged_scenes_and_their_files():
    for name in ("labrador-sea", "periodic-box", "shear-cell", "strait", "two-floes"):
        assert tradeoff_result.result(read_scene(name)) is not None, name


def test_a_damaged_result_and_a_file_that_is_none_are_refused_in_one_line(tmp_path):
    path = scene_file(tmp_path, QUIET)
    result = tradeoff_result.stored(read_scene(path))
    for spoil, told in (
        (lambda: result.write_bytes(b"no NetCDF"), "is no NetCDF file, or a damaged one"),
        (lambda: xr.Dataset().to_netcdf(result), "is \"none of floebmi's\"; must be 'tradeoff 1'"),
    ):
        spoil()
        for words in (["run", str(path), "--accuracy", "0.1"], ["explain", str(path)]):
            refused = CliRunner().invoke(command, words, prog_name="floebmi")
            assert refused.exit_code == 2 and refused.stderr.count("\n") == 1
            assert f"{result}: {told}" in refused.stderr
    assert not (tmp_path / "pack").exists()


def test_a_packaged_result_is_drawn_anew(tmp_path):
    picture = tmp_path / "front.png"
    words = ["plot", str(tradeoff_result.stored(read_scene("two-floes"))), "--to", str(picture)]
    assert CliRunner().invoke(command, words).output == f"wrote {picture}\n"
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert "exists already" in CliRunner().invoke(command, words).stderr


@pytest.mark.parametrize(
    "option", ["--ledger", "--time 0", "--variable speed", "--color speed", "--arrows ice"]
)
def test_what_a_result_does_not_show_is_refused(tmp_path, option):
    result = str(tradeoff_result.stored(read_scene("two-floes")))
    words = ["plot", result, "--to", str(tmp_path / "front.png"), *option.split()]
    drawn = CliRunner().invoke(command, words, prog_name="floebmi")
    assert drawn.exit_code == 2 and not list(tmp_path.iterdir())
    told = f"floebmi: {option.split()[0]}: a trade-off does not show it; leave it out\n"
    assert drawn.stderr == told


@pytest.mark.parametrize("name", ["labrador-sea", "periodic-box", "strait"])
def test_the_number_of_each_setting_can_be_read(name):
    data = tradeoff_result.read(tradeoff_result.stored(read_scene(name)))
    figure = tradeoff_result.figure(data)
    FigureCanvasAgg(figure).draw()
    axes = figure.axes[0]
    numbers = [text for text in axes.texts if text.get_text().isdigit()]
    boxes = [text.get_window_extent() for text in numbers]
    assert len(boxes) == (data.sel(quantity=data.attrs["of"]).error > 0).sum()
    assert not any(box.overlaps(other) for k, box in enumerate(boxes) for other in boxes[:k])
    dots = [line for line in axes.lines if line.get_marker() == "o" and line.get_markersize() < 5]
    for number, dot in zip(numbers, dots, strict=True):  # each stands at its place or by it
        assert np.hypot(*number.get_position()) < 30  # points
        assert number.xy == pytest.approx(dot.get_xydata()[0])


def test_a_result_is_taken_for_what_was_set_by_hand_when_it_was_measured_or_for_the_scene_alone(
    tmp_path,
):
    path, by_hand = scene_file(tmp_path, QUIET), "step.fraction=0.2"
    data = numbers([0.01, 0.02, 0.0]).assign_coords(setting=["step.fraction=0.7", "", "fine"])

    def run(measured_with, *changes):
        text = read_scene(path, measured_with).text
        data.attrs |= MARK | {
            "scene_hash": tradeoff_result.digest(text),
            "overrides": json.dumps(measured_with),
        }
        data.to_netcdf(path.with_suffix(".tradeoff.nc"))
        options = [
            "--accuracy",
            "0.1",
            "--duration",
            "15",
            "--force",
            "--to",
            str(tmp_path / "out"),
        ]
        options += [word for change in changes for word in ("--set", change)]
        return CliRunner().invoke(command, ["run", str(path), *options], prog_name="floebmi")

    assert "fraction=0.7" in run([by_hand], by_hand).output  # the recommendation was made upon it
    assert "fraction=0.2" in run([], by_hand).output  # the last word is one's own
    for changes in ((), ("step.fraction=0.3",)):
        other = run([by_hand], *changes)
        assert other.exit_code == 2 and other.stderr.count("\n") == 1
        assert f"was measured with --set {by_hand}: give these too and first" in other.stderr


def test_a_chaotic_scene_is_compared_in_means_over_seeds(tmp_path, few_dials):
    path = scene_file(tmp_path, CHAOTIC)
    made = tradeoff.tradeoff(path, of="area_fraction", seeds=2, jobs=1, to=tmp_path / "t.nc")
    assert "chaotic" in made.why and made.data.of == "area_fraction" and not made.failures
    errors = made.data.sel(quantity="area_fraction", setting="step.fraction=0.3")
    assert 0 < errors.error < 0.3  # the means are near, though no floe is where it was
    assert errors.noise > 0
    table = tradeoff_result.table(made.data)
    assert tradeoff_result.AS_IT_IS in table and "±" in table
    assert "not known" not in made.why


@pytest.mark.parametrize(
    ("own", "seeds", "told"), [("seed = 1\n", 2, "the seed changes nothing"), ("", 1, "more seeds")]
)
def test_runs_that_are_all_the_same_do_not_tell_how_well_an_error_is_known(
    tmp_path, few_dials, own, seeds, told
):
    path = scene_file(tmp_path, CHAOTIC.replace("[[floes]]\n", "[[floes]]\n" + own))
    made = tradeoff.tradeoff(path, of="area_fraction", seeds=seeds, jobs=1, to=tmp_path / "t.nc")
    assert "chaotic" in made.why and told in made.why
    assert np.isnan(made.data.noise).all() and "±" not in tradeoff_result.table(made.data)


def numbers(errors, noise=0.0, cost=(1.0, 2.0, 3.0)):
    data = xr.Dataset(
        {
            "error": (("setting", "quantity"), np.reshape(errors, (3, 1))),
            "noise": (("setting", "quantity"), np.full((3, 1), noise)),
            "cost_per_day": ("setting", list(cost)),
        },
        coords={"setting": ["fast", "middle", "fine"], "quantity": ["drift"]},
        attrs={"of": "drift", "reference": "fine"},
    )
    return data


def test_an_error_that_the_seeds_cannot_tell_is_told_with_its_uncertainty_to_two_digits():
    """0.12 ± 0.1 had been recommended for an error that is below its uncertainty, 0.13."""
    data = numbers([0.116, 0.2, 0.0], noise=0.129).assign_attrs(seeds=4)
    assert tradeoff_result.recommended(data, 0.05) == "fast"
    assert "(error of drift 0.12, which 4 seeds know to ± 0.13)" in tradeoff_result.setting_text(
        data, "fast"
    )
    assert tradeoff_result._with_noise(data.sel(setting="fast", quantity="drift")) == "0.12 ± 0.13"


@pytest.mark.parametrize("shift, same", [(0.0, True), (1.0, False)])
def test_runs_with_no_number_in_the_same_cells_may_be_the_same(shift, same):
    """A field may have no number in a cell or more; the seeds may change nothing all the same."""

    def run(setting, seed):
        fields = {q: np.ones((2, 2)) for q in tradeoff_result.COMPARED}
        fields["transport"][:, 0] = np.nan
        fields["drift"] += (setting == "fine nudged") + shift * seed
        return {"time": np.arange(2.0), **fields} | {
            name: np.array(1.0) for name, of in tradeoff.OUTPUTS.items() if not of.dims
        }

    settings = ("fine", "fine nudged", "")
    members = {(s, k): run(setting, k) for s, setting in enumerate(settings) for k in range(2)}
    two = {name: ("frame", "cell") for name in tradeoff_result.COMPARED}
    outputs = {n: of._replace(dims=two.get(n, of.dims)) for n, of in tradeoff.OUTPUTS.items()}
    done = tradeoff.ensemble.Ensemble({}, {"setting": settings}, (1, 2), members, [])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tradeoff, "OUTPUTS", outputs)
        why = tradeoff._compare(done, "fine", 0.05, "drift", ()).comparison
    assert "changes drift by" in why and ("the seed changes nothing" in why) == same


def test_a_scene_in_which_nothing_moves_has_nothing_to_compare(tmp_path, few_dials):
    path = tmp_path / "still.toml"
    path.write_text(QUIET.replace(", u = 0.5", ""))
    with pytest.raises(InputError, match="nothing moves in this scene"):
        tradeoff.tradeoff(path, seeds=1, jobs=1, to=tmp_path / "t.nc")


def test_what_a_budget_allows_is_measured_with_forcing_of_the_run_alone(tmp_path):
    """The records of a file may end where the run ends."""
    scene = read_scene(scene_file(tmp_path, QUIET + "[ocean]\n"), ["time.exchange=15"])
    times = []
    water = SimpleNamespace(fill=lambda t, u, v: times.append(t))
    schedule = scene.schedule(30.0)
    length = tradeoff._affordable(schedule, scene.build()._replace(ocean=water), 1e6, 1, 1, 1)
    assert length == 30.0 and times == [0.0, 15.0, 30.0, 30.0]


def test_a_scene_without_floes_at_its_start_has_no_smallest_to_leave_out(tmp_path):
    scene = read_scene(scene_file(tmp_path, SCENE), ["floes.concentration=0"])
    dials = tradeoff.settings(scene, scene.build().model, scene.schedule())
    assert "stiffness" in dials and "smallest floe" not in dials


def test_the_recommendation_is_the_fastest_that_is_accurate_and_never_the_reference():
    assert tradeoff_result.recommended(numbers([0.2, 0.04, 0.0]), 0.05) == "middle"
    assert tradeoff_result.recommended(numbers([0.2, 0.04, 0.0]), 0.3) == "fast"
    assert tradeoff_result.recommended(numbers([0.2, 0.04, 0.0]), 0.01) is None
    assert tradeoff_result.recommended(numbers([0.2, 0.04, 0.0], noise=0.25), 0.01) == "fast"
    assert tradeoff_result.recommended(numbers([np.nan, 0.04, 0.0]), 0.3) == "middle"
    assert tradeoff_result.front(numbers([0.2, 0.04, 0.0])) == ["fast", "middle", "fine"]
    assert tradeoff_result.front(numbers([0.02, 0.04, 0.0])) == ["fast", "fine"]


@pytest.mark.parametrize(
    "how, told",
    [
        ({"error": 0.0}, "error = 0.0: must be between 0 and 1"),
        ({"of": "speed"}, "of = 'speed': must be one of transport, drift"),
        ({"seeds": 0}, "seeds = 0: must be at least 1"),
        ({"budget": np.nan}, "budget = nan minutes: must be greater than 0"),
        ({"duration": -1.0}, "duration = -1.0: must be greater than 0"),
        ({"duration": 9.0}, "duration = 9 s: shorter than the time between frames, 15 s"),
    ],
)
def test_numbers_that_cannot_be_right_are_refused_before_anything_runs(tmp_path, how, told):
    path = scene_file(tmp_path, QUIET)
    with pytest.raises(InputError, match=told):
        tradeoff.tradeoff(path, to=tmp_path / "t.nc", **how)
    assert not list(tmp_path.glob("*.members"))


def test_wind_that_ends_too_early_is_refused_before_anything_runs(tmp_path):
    wind = {name: ("time", [1.0, 1.0], {"units": "m/s"}) for name in ("u10", "v10")}
    hours = np.array(["2016-02-01T00", "2016-02-01T01"], "datetime64[ns]")
    xr.Dataset(wind, {"time": hours}).to_netcdf(tmp_path / "wind.nc")
    path = scene_file(tmp_path, QUIET + '[atmosphere]\nfile = "wind.nc"\n')
    with pytest.raises(InputError, match=r"pack.toml: \[atmosphere\] .*outside the file's times"):
        tradeoff.tradeoff(path, to=tmp_path / "t.nc", duration=7200.0)
    assert not list(tmp_path.glob("*.members"))


def test_runs_of_files_that_have_changed_since_are_refused(tmp_path, few_dials):
    floes = tmp_path / "floes.csv"
    floes.write_text("x,y,radius,thickness,u\n150,150,10,1,0.5\n175,158,15,1,0\n")
    path = scene_file(tmp_path, SCENE.replace(PACK, 'arrangement = "file"\nfile = "floes.csv"\n'))
    how = {"seeds": 1, "jobs": 1, "to": tmp_path / "t.nc"}
    first = tradeoff.tradeoff(path, **how)
    assert tradeoff.tradeoff(path, **how).data.cost_per_day.equals(first.data.cost_per_day)  # kept
    floes.write_text("x,y,radius,thickness,u\n150,150,10,1,0.05\n175,158,15,1,0\n")
    with pytest.raises(InputError, match=r"members of another ensemble \(files = .*floes.csv"):
        tradeoff.tradeoff(path, **how)


def test_a_folder_of_forcing_is_another_one_if_a_file_deep_in_it_is(tmp_path):
    """As a Zarr store is, whose own date stays when numbers in it change."""
    chunk = tmp_path / "wind.zarr" / "u10" / "c" / "0"
    chunk.parent.mkdir(parents=True)
    chunk.write_bytes(b"1.0")
    scene = read_scene(scene_file(tmp_path, QUIET + '[atmosphere]\nfile = "wind.zarr"\n'))
    first = tradeoff_result.files_of(scene)
    assert list(first) == ["wind.zarr"]
    chunk.write_bytes(b"2.0")
    assert tradeoff_result.files_of(scene) != first
    chunk.write_bytes(b"1.0")
    assert tradeoff_result.files_of(scene) == first  # the same wind, of another date
    chunk.rename(chunk.with_name("1"))
    assert tradeoff_result.files_of(scene) != first


def test_only_a_result_is_replaced_by_a_result(tmp_path):
    path = scene_file(tmp_path, QUIET)
    with pytest.raises(InputError, match="pack.toml: must end in .nc"):
        tradeoff.tradeoff(path, to=path)
    assert path.read_text() == QUIET
    wind = tmp_path / "wind.nc"
    xr.Dataset({"u10": ("x", [1.0, 2.0])}).to_netcdf(wind)
    before = wind.read_bytes()
    with pytest.raises(InputError, match="wind.nc"):
        tradeoff.tradeoff(path, to=wind)
    assert wind.read_bytes() == before and not list(tmp_path.glob("*.members"))


def test_settings_are_compared_at_the_same_times_where_the_scene_has_none_for_its_frames(tmp_path):
    path = scene_file(
        tmp_path,
        QUIET.replace("every = 15", "").replace("duration = 60", "duration = 60\nexchange = 10"),
    )
    every = read_scene(path).schedule().every
    assert read_scene(path, ["time.exchange=2.5"]).schedule().every != every
    shared = {
        "scene": str(path), "overrides": [], "duration": 60.0, "exchange": 10.0, "every": every
    }  # fmt: skip
    for setting in ("", "time.exchange=2.5"):
        made = tradeoff.member(shared | {"setting": setting}, seed=1)
        np.testing.assert_array_equal(made["time"], every * np.arange(1, 7))


def test_an_exchange_left_to_the_duration_is_that_of_all_runs(tmp_path, monkeypatch, few_dials):
    wind = "[time]\nduration = 80\n[atmosphere]\nvelocity = [1, 0]"
    path = scene_file(tmp_path, QUIET.split("[time]")[0] + wind)
    asked = []

    def stop(member, shared, sweep, *args, **how):
        asked.append((shared, sweep["setting"]))
        raise InputError("that is all")

    monkeypatch.setattr(tradeoff.ensemble, "run", stop)
    with pytest.raises(InputError, match="that is all"):
        tradeoff.tradeoff(path, to=tmp_path / "t.nc", duration=10.0)
    ((shared, texts),) = asked
    assert (
        texts[0] == "step.fraction=0.1 time.exchange=0.125"
    )  # not of the 4 s that 80 s would have
    ways = []
    monkeypatch.setattr(tradeoff, "_frame", lambda *given: {"velocity": np.zeros(1)})
    monkeypatch.setattr(tradeoff, "_inertia_number", lambda *given: 0.0)
    monkeypatch.setattr(tradeoff, "_way", lambda *given: np.zeros(2))
    monkeypatch.setattr("floebmi.model.Model.advance", lambda model, dt: ways.append(dt))
    for text in texts[:1] + texts[2:3]:
        ways.clear()
        tradeoff.member(shared | {"setting": text}, seed=1)
        assert ways[0] == (0.125 if "exchange" in text else 0.5), text


def test_what_it_takes_to_compile_or_load_kernels_is_no_cost(tmp_path, monkeypatch):
    advance = Model.advance
    shared = {"scene": str(scene_file(tmp_path, QUIET)), "overrides": [], "setting": ""} | {
        "duration": 60.0, "exchange": 20.0, "every": 60.0
    }  # fmt: skip

    def half_a_second():
        until = time.process_time() + 0.5
        while time.process_time() < until:
            pass

    def cost(extra):
        def slow_at_last(model, dt):
            if model.time == 40.0:
                extra()
            advance(model, dt)

        monkeypatch.setattr(Model, "advance", slow_at_last)
        return tradeoff.member(shared, seed=1)["cost"]

    made_for_another = Making.timed(Making.timed(half_a_second))
    assert 0.0 < cost(made_for_another) < 0.5 < cost(half_a_second) < 1.0


@pytest.mark.long
def test_the_reference_is_finer_than_a_step_that_the_scene_gives(tmp_path):
    path = scene_file(tmp_path, QUIET)
    for given, fine in (
        ("step.length=0.4", "step.length=0.1"),
        ("step.epsilon=0.08", "step.epsilon=0.02"),
        ("preset=damsgaard2018", "step.epsilon=0.0175"),
    ):
        scene = read_scene(path, [given])
        model = scene.build().model
        assert tradeoff.reference(model, scene.schedule()) == fine
        finer = read_scene(path, [given, fine]).build().model
        assert finer.longest_step() == pytest.approx(model.longest_step() / 4)


def test_a_reference_that_failed_is_told_with_its_reason(tmp_path, few_dials):
    path = scene_file(tmp_path, QUIET.replace("u = 0.5", "u = 900.0"))
    with (
        pytest.warns(UserWarning, match="member failed"),
        pytest.raises(InputError, match="without its reference .* floe 0"),
    ):
        tradeoff.tradeoff(path, to=tmp_path / "t.nc", seeds=1, jobs=1)


def test_each_dial_of_a_packaged_scene_is_one_that_the_scene_takes():
    for name in ("shear-cell", "strait", "periodic-box", "two-floes"):
        scene = read_scene(name)
        model = scene.build().model
        for texts in tradeoff.settings(scene, model, scene.schedule()).values():
            for text in [*texts, tradeoff.reference(model, scene.schedule())]:
                read_scene(name, text.split())


def test_small_floes_are_left_out_and_their_mass_stays():
    floes = Floes([0.0, 50.0, 90.0], 0.0, [5.0, 10.0, 20.0], [1.0, 2.0, 1.0], u=[1.0, 2.0, 3.0])
    kept = without_small(floes, 8.0)
    assert list(kept.radius) == [10.0, 20.0] and list(kept.u) == [2.0, 3.0]
    assert kept.volume.sum() == pytest.approx(floes.volume.sum(), rel=1e-15)
    assert kept.thickness[0] / kept.thickness[1] == pytest.approx(2.0)
    assert without_small(floes, 5.0) is floes
    with pytest.raises(InputError, match="smallest = 30 m: leaves no floe; must be at most 20 m"):
        without_small(floes, 30.0)


def test_a_calibration_is_kept_for_scenes_of_its_kind(tmp_path, monkeypatch):
    monkeypatch.setenv("FLOEBMI_CACHE", str(tmp_path))
    monkeypatch.setattr(calibration, "MEASURED_FOR", 0.0)
    path = scene_file(tmp_path, QUIET)
    before = CliRunner().invoke(command, ["explain", str(path)]).output
    assert "--calibrate measures it" in before
    after = CliRunner().invoke(command, ["explain", str(path), "--calibrate"]).output
    assert "as measured on this machine" in after
    model = read_scene(path).build().model
    cost = calibration.stored(model)
    assert cost.of(10, 0, 5, 7) == pytest.approx(50 * cost.floe_step)
    assert cost.of(0, 2, 5, 7) == pytest.approx(24 * cost.exchange)
    assert 0 <= cost.floe_step < 1e-3
    [file] = tmp_path.glob("costs-*.json")
    assert list(json.loads(file.read_text())) == [calibration.kind(model)]
    other = read_scene(path, ["contact=none"]).build().model
    assert calibration.stored(other) is None
    for text in ("[]", "null", "", f'{{"{calibration.kind(model)}": [1.0]}}', '{"a": 3}'):
        file.write_text(text)  # of another make, or cut short
        assert calibration.stored(model) is None


def test_the_cost_of_a_run_is_that_of_its_steps_and_of_its_exchanges():
    cost = calibration.Cost(floe_step=1e-8, exchange=1e-6)
    assert cost.of(1000, exchanges=10, floes=50, cells=100) == pytest.approx(0.5e-3 + 1.5e-3)


def test_a_calibration_does_not_run_beyond_the_end_of_its_scene(tmp_path, monkeypatch):
    """After it floes may have left, and steps of no floe cost nothing."""
    monkeypatch.setattr(calibration, "MEASURED_FOR", 0.0)
    path = scene_file(tmp_path, QUIET)
    for duration in (60.0, None):
        built = read_scene(path).build()
        calibration.measure(built, duration)
        assert (built.model.time <= 60.0) == (duration is not None)


def test_the_inertia_number_is_that_of_the_ice_in_cells_that_have_some():
    """I = γ̇ d √(ρ/N): the coast, much thicker than the ice, is no part of it, nor are floes that have left."""
    floes = Floes([5.0, 25.0, 35.0, 60.0], 5.0, [10.0, 30.0, 1.0, 9.0], [2.0, 2.0, 9.0, 4.0], motion=[0, 0, COAST, 0])  # fmt: skip
    floes.active[3] = False
    model = SimpleNamespace(floes=floes, ice_density=900.0, domain=Domain((0.0, 40.0), (0.0, 40.0)))
    grid = Grid.uniform((0.0, 40.0), (0.0, 40.0), shape=(4, 4))
    u = np.array([0.01 * grid.x + 0.02 * grid.y, 0.005 * grid.x - 0.01 * grid.y])
    area, stress = np.full(16, 0.8), np.full(16, 600.0)
    area[0], stress[0] = 0.1, 1e6  # hardly any ice
    frames = {
        "area_fraction": np.array([area, area]),
        "velocity": np.array([900.0 * 2.0 * area * k * u for k in (0.5, 1.5)]),
        "stress": np.array([0.5 * stress, 1.5 * stress]),
    }
    rate, diameter, normal = np.hypot(0.02, 0.025), 40.0, 300.0
    expected = rate * diameter * np.sqrt(900.0 / normal)
    assert tradeoff._inertia_number(model, grid, frames) == pytest.approx(expected)


def test_the_way_of_the_ice_is_a_mean_by_mass_across_the_seam_of_floes_that_stay():
    before = Floes(
        [95.0, 50.0, 20.0, 70.0], 0.0, [1.0, 2.0, 4.0, 4.0], 1.0, motion=[0, 0, 0, COAST]
    )
    now = before.copy()
    now.x[:], now.y[:] = [5.0, 54.0, 99.0, 70.0], [-2.0, 3.0, 0.0, 0.0]
    now.active[2] = False
    now.add(80.0, 80.0, 9.0, 1.0)
    model = SimpleNamespace(
        floes=now, ice_density=900.0, domain=SimpleNamespace(period=(100.0, None))
    )
    assert tradeoff._way(model, before) == pytest.approx([(10 + 4 * 4) / 5, (-2 + 4 * 3) / 5])


def test_an_error_is_relative_to_the_reference_and_its_noise_the_standard_error_over_seeds():
    def runs(*values):
        return xr.DataArray(np.array(values, float), dims=("seed", "frame", "cell"))

    reference = runs([[3.0, 4.0]], [[6.0, 8.0]])
    away = reference + runs([[0.3, 0.4]], [[0.0, 1.0]])
    assert tradeoff._pointwise(away, reference).values == pytest.approx([0.1, 0.1])
    ten = runs([[10.0], [10.0]], [[10.0], [10.0]], [[10.0], [10.0]])
    means = tradeoff._of_means(ten + runs([[1.0], [1.0]], [[0.0], [4.0]], [[3.0], [3.0]]), ten)
    assert means == pytest.approx((0.2, 1.0 / np.sqrt(3) / 10))  # differences of 1, 2 and 3
