"""The command line: what it prints, what it leaves, and how it refuses."""

import json
import os
import re
import shlex
import signal
import subprocess
import sys
import tracemalloc

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner

from floebmi import (
    Coriolis,
    Domain,
    Floes,
    Model,
    __version__,
    ensemble,
    files,
    measures,
    paraview,
    plot,
    read_scene,
    running,
)
from floebmi.cli import floebmi
from floebmi.explain import explain, notes
from floebmi.restarts import load_restart
from floebmi.scene import Scene
from floebmi.scenes import packaged


@pytest.fixture
def cli(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def call(*args):
        return CliRunner().invoke(floebmi, [str(arg) for arg in args], prog_name="floebmi")

    return call


def land(path, ring):
    path.write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))


def fast(*more):
    """Two floes for a quarter of a minute."""
    return ["run", "two-floes", "--set", "time.duration=15", "--quiet", *more]


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """The folder of a finished run."""
    folder = tmp_path_factory.mktemp("ran") / "two"
    result = CliRunner().invoke(floebmi, fast("--to", str(folder)))
    assert result.exit_code == 0, result.output
    return folder


# ---- help -------------------------------------------------------------------------------------


@pytest.mark.parametrize("args", [[], ["--help"]])
def test_without_arguments_it_shows_what_to_try(cli, args):
    result = cli(*args)
    assert result.exit_code == 0
    assert "floebmi run labrador-sea" in result.stdout
    for command in ("run", "explain", "scene", "plot", "animate", "export"):
        assert f"\n  {command} " in result.stdout


def test_it_tells_its_version(cli):
    assert cli("--version").stdout == f"floebmi {__version__}\n"


@pytest.mark.parametrize(
    "typed, offered",
    [
        ("floebmi ani", "plain,animate"),
        ("floebmi run lab", "plain,labrador-sea"),
        ("floebmi run mine", "file,mine"),
        ("floebmi tradeoff --see", "plain,--seeds"),
        ("floebmi plot run --arrows o", "plain,ocean"),
    ],
)
def test_a_shell_completes_commands_options_words_and_scenes(cli, monkeypatch, typed, offered):
    monkeypatch.setenv("_FLOEBMI_COMPLETE", "bash_complete")
    monkeypatch.setenv("COMP_WORDS", typed)
    monkeypatch.setenv("COMP_CWORD", str(typed.count(" ")))
    assert cli().stdout == f"{offered}\n"


def test_python_m_floebmi_is_the_same_command_and_starts_without_numba():
    code = (
        "import sys, runpy; sys.argv = ['floebmi', 'scene']\n"
        "try: runpy.run_module('floebmi', run_name='__main__')\n"
        "except SystemExit as end: assert not end.code\n"
        "print([m for m in ('numba', 'xarray', 'matplotlib', 'pydantic') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "two-floes" in done.stdout
    assert done.stdout.endswith("[]\n")
    wrong = subprocess.run(
        [sys.executable, "-m", "floebmi", "run", "two-flos"], capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert wrong.returncode == 2
    assert wrong.stdout == ""
    assert wrong.stderr.count("\n") == 1
    assert "did you mean 'two-floes'?" in wrong.stderr


# ---- errors -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (["rnu"], "did you mean 'run'?"),
        (["run"], "Missing argument 'SCENE'"),
        (["run", "two-floes", "--too", "a"], "--to"),
        (["run", "two-floes", "--duration", "long"], "'long' is not a valid float"),
        (["run", "two-floes", "--duration", "-1"], "must be greater than 0"),
        (["run", "nowhere.toml"], "nowhere.toml: no such file"),
        (["run", "two-floes", "--set", "time.duration=0"], "--set time.duration=0: must be greater"),
        (["run", "two-floes", "--set", "tim.duration=1"], "did you mean 'time'?"),
        (["run", "two-floes", "--set", "output.gridded=true"], "[output] gridded = true: needs a [grid]"),
        (
            ["run", "two-floes", "--set", "output.trajectories=false", "--set", "output.paraview=true"],
            "[output] paraview = true: needs trajectories = true",
        ),
        (["run", "two-floes", "--restart", "no.nc"], "no.nc"),
        (
            ["run", "periodic-box", "--accuracy", "1e-3", "--set", "contact.friction=0.4"],
            "--accuracy 0.001 takes contact=none, which --set contact.friction=0.4 changes",
        ),
        (["explain", "two-flos"], "did you mean 'two-floes'?"),
        (["scene", "two-flos"], "did you mean 'two-floes'?"),
        (["scene", "--to", "a.toml"], "say which scene"),
        (["scene", "two-floes", "--to", "a.txt"], "must end in .toml"),
        (["plot", "no.nc"], "no.nc"),
        (["animate", "no.nc"], "no.nc"),
        (["export", "no.nc"], "no.nc"),
        (["plot", "."], "neither floes.nc nor gridded.nc"),
        (["run", "two-floes", "--to", "/proc/no"], "/proc/no"),
        (["run", "two-floes", "--set", "time.start=soon"], "[time] start = 'soon': not a date of the calendar 'standard'; give"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_in_one_line_with_exit_code_2_and_nothing_is_written(
    cli, tmp_path, args, said
):
    result = cli(*args)
    assert result.exit_code == 2, result.output
    assert result.stderr.startswith("floebmi: ")
    assert result.stderr.count("\n") == 1
    assert said in result.stderr
    assert result.stdout == ""
    assert list(tmp_path.iterdir()) == []


def test_forcing_that_ends_before_the_run_does_is_refused_at_once_with_its_table(cli, tmp_path):
    hours = np.array(["2000-01-01T00", "2000-01-01T01"], "datetime64[ns]")
    current = {"standard_name": "eastward_sea_water_velocity", "units": "m s-1"}
    across = current | {"standard_name": "northward_sea_water_velocity"}
    xr.Dataset(
        {"u": ("time", [0.1, 0.2], current), "v": ("time", [0.0, 0.0], across)}, {"time": hours}
    ).to_netcdf("point.nc")
    (tmp_path / "scene.toml").write_text(
        "[domain]\nx = [0, 1e3]\ny = [0, 1e3]\nedges = 'periodic'\n[grid]\nspacing = 500\n"
        "[ocean]\nfile = 'point.nc'\n[time]\nduration = 7200\n"
    )
    before = sorted(tmp_path.iterdir())
    for command in ("run", "explain"):
        result = cli(command, "scene.toml")
        assert result.exit_code == 2, result.output
        assert result.stdout == "" and result.stderr.count("\n") == 1
        assert (
            "scene.toml: [ocean] point.nc: u: t = 7200 s (2000-01-01T02:00) is out" in result.stderr
        )
        assert "2000-01-01 … 2000-01-01T01:00 (t = 0 … 3600 s, 2 records)" in result.stderr
    assert sorted(tmp_path.iterdir()) == before


def test_a_film_that_cannot_be_made_is_refused_before_its_meter_is_shown(cli, ran):
    for more, said in (
        (["--to", "a.avi"], "allowed: .gif, .mp4"),
        (["--fps", "0"], "fps = 0: must"),
    ):
        result = cli("animate", ran, *more)
        assert result.exit_code == 2, result.output
        assert result.stderr.count("\n") == 1 and said in result.stderr
        assert result.stderr.startswith("floebmi: ")


def test_debug_shows_the_traceback(cli):
    result = cli("run", "two-flos", "--debug")
    assert "did you mean" in str(result.exception)
    assert result.exc_info[2].tb_next is not None


def test_floes_that_overlap_are_refused_with_the_scene_s_name(cli):
    result = cli("run", "two-floes", "--set", "floes.each.2.x=51")
    assert result.exit_code == 2
    assert "two-floes.toml: " in result.stderr
    assert "overlap" in result.stderr


def test_a_run_that_leaves_its_bounds_ends_with_3_and_says_where_its_state_is(cli, tmp_path):
    result = cli(
        "run", "two-floes", "--quiet", "--set", "step.length=5", "--set", "time.duration=200",
        "--set", "time.exchange=5", "--set", "output.every=5", "--set", "floes.each.1.u=9",
    )  # fmt: skip
    assert result.exit_code == 3, result.output
    assert result.stderr.count("\n") == 1
    assert "saved in two-floes/restart.nc" in result.stderr
    assert (tmp_path / "two-floes" / "restart.nc").exists()
    with xr.open_dataset(tmp_path / "two-floes" / "floes.nc", decode_times=False) as data:
        assert data.sizes["time"] >= 1


def test_more_cells_than_memory_holds_are_the_users(cli, monkeypatch):
    def full(*args):
        raise MemoryError("Unable to allocate 29.1 TiB")

    monkeypatch.setattr("floebmi.scene.read_scene", full)
    result = cli("explain", "two-floes")
    assert result.exit_code == 2
    assert "not enough memory: Unable to allocate 29.1 TiB; must be fewer cells" in result.stderr


def test_an_error_of_the_program_is_one_line_as_well(cli, monkeypatch):
    monkeypatch.setattr("floebmi.scene.read_scene", lambda *args: 1 / 0)
    result = cli("run", "two-floes")
    assert result.exit_code == 1
    assert "error in the program: ZeroDivisionError" in result.stderr
    assert result.stderr.count("\n") == 1


# ---- run --------------------------------------------------------------------------------------


def test_a_run_prints_what_is_modelled_the_ledgers_and_the_files_it_wrote(cli, tmp_path):
    result = cli("run", "two-floes", "--set", "time.duration=15", "--profile")
    assert result.exit_code == 0, result.output
    for said in (
        "Two floes collide", "Coulomb(coefficient=0.3", "absent: bonds", "floe-steps/s",
        "residual", "neighbour-list rebuilds", "motion in a step",
    ):  # fmt: skip
        assert said in result.stdout
    names = ["floes.nc", "restart.nc", "two-floes.png"]
    assert sorted(path.name for path in (tmp_path / "two-floes").iterdir()) == names
    for name in names:
        assert f"wrote two-floes/{name}\n" in result.stdout
    with xr.open_dataset(tmp_path / "two-floes" / "floes.nc", decode_times=False) as data:
        assert data.title.startswith("Two floes collide")
        assert "# --set time.duration=15" in data.attrs["scene"]
        assert float(data.time[-1]) == 15.0


def test_quiet_prints_nothing(cli):
    result = cli(*fast())
    assert (result.exit_code, result.output) == (0, "")


def test_output_is_not_replaced_without_force(cli, ran):
    before = (ran / "floes.nc").read_bytes()
    result = cli(*fast("--to", ran))
    assert result.exit_code == 2
    assert str(ran / "floes.nc") in result.stderr
    assert (ran / "floes.nc").read_bytes() == before
    assert cli(*fast("--to", ran, "--force")).exit_code == 0


def dangling(place):
    place.symlink_to("nowhere")


def other_kind(place):
    place.write_text("mine") if place.name == "paraview" else place.mkdir()


def read_only(place):
    place.mkdir() if place.name == "paraview" else place.write_text("mine")
    place.chmod(0o555)


def in_a_read_only_folder(place):
    place.parent.chmod(0o555)


REFUSED = {
    dangling: "is a link to nowhere, which is not there; remove the link, or choose another name",
    other_kind: "is a folder; give the name of a file",
    read_only: "is read-only; choose another",
    in_a_read_only_folder: "is read-only; choose another place",
}


@pytest.fixture
def modes_count(monkeypatch):
    """Those of a file say who may write, also to a superuser."""
    access = os.access
    monkeypatch.setattr(
        os, "access", lambda path, how: access(path, how) and not (how & os.W_OK and not os.stat(path).st_mode & 0o200)
    )  # fmt: skip


def assert_refused_in_a_line(result, bad, name):
    assert result.exit_code == 2 and len(result.stderr.splitlines()) == 1, result.output
    file_for_folder = bad is other_kind and name == "paraview"
    assert (
        "is a file; give the name of a folder" if file_for_folder else REFUSED[bad]
    ) in result.stderr


@pytest.mark.parametrize("bad", REFUSED)
@pytest.mark.parametrize(
    "name", ["gridded.nc", "floes.nc", "restart.nc", "two-floes.png", "paraview"]
)
def test_a_place_where_no_output_can_be_made_is_refused_before_the_run(
    cli, tmp_path, monkeypatch, modes_count, name, bad
):
    monkeypatch.setattr(Scene, "build", lambda self: pytest.fail("the run has begun"))
    folder = tmp_path / "out"
    folder.mkdir()
    bad(folder / name)
    more = ["output.gridded=true", "output.paraview=true", "grid.shape=[2, 2]"]
    sets = [word for change in more for word in ("--set", change)]
    result = cli(*fast("--force", "--to", folder, *sets))
    assert_refused_in_a_line(result, bad, name)


@pytest.mark.parametrize("bad", REFUSED)
@pytest.mark.parametrize(
    "command, name",
    [
        ("plot {ran} --to {place}", "a.png"),
        ("plot {ran} --ledger --to {place}", "a.svg"),
        ("animate {ran} --to {place}", "a.gif"),
        ("view {ran} --to {place}", "a.html"),
        ("export {ran} --to {place}", "paraview"),
        ("validate 1 --save {place}", "a.json"),
        ("tradeoff two-floes --to {place}", "a.nc"),
        ("tradeoff two-floes --to {place.parent}/a.nc", "a.png"),
        ("experiment strait --save {place}", "a.nc"),
        ("experiment strait --figure 6 --save {place}", "a.png"),
        ("scene two-floes --to {place.parent}", "two-floes.toml"),
    ],
)
def test_such_a_place_is_refused_by_every_command_before_its_work(
    cli, ran, tmp_path, monkeypatch, modes_count, command, name, bad
):
    for module, work in (
        (ensemble, "run"),
        (measures, "table"),
        (plot, "open_view"),
        (paraview, "open_file"),
    ):
        monkeypatch.setattr(module, work, lambda *a, **k: pytest.fail("work has begun"))
    place = tmp_path / "here" / name
    place.parent.mkdir()
    bad(place)
    force = (
        ["--force"]
        if command.split()[0] in ("plot", "animate", "view", "export", "validate", "scene")
        else []
    )
    result = cli(*command.format(ran=ran, place=place).split(), *force)
    assert_refused_in_a_line(result, bad, name)


def test_a_scene_with_the_longest_name_a_file_can_have_runs_to_its_picture(cli, tmp_path):
    name = "n" * 250
    assert cli("scene", "two-floes", "--to", f"{name}.toml").exit_code == 0
    result = cli("run", f"{name}.toml", "--set", "time.duration=15", "--quiet")
    assert result.exit_code == 0, result.output
    assert (tmp_path / name / f"{name}.png").exists()
    assert not list((tmp_path / name).glob("*.part"))
    result = cli("tradeoff", f"{name}.toml")
    assert result.exit_code == 2 and result.stderr.rstrip().endswith("File name too long")


def test_a_second_run_in_a_folder_is_refused_and_leaves_the_first_ones_files(cli, tmp_path):
    folder = tmp_path / "out"
    folder.mkdir()
    with files.alone_in(folder):
        for more in ([], ["--force"], ["--set", "output.trajectories=false"]):
            result = cli(*fast("--to", folder, *more))
            assert result.exit_code == 2 and not list(folder.iterdir())
            assert result.stderr == f"floebmi: {folder}: another run is going on in it; give another folder with --to\n"  # fmt: skip
    assert cli(*fast("--to", folder)).exit_code == 0
    assert {"floes.nc", "restart.nc"} <= {path.name for path in folder.iterdir()}


def test_a_run_can_go_on_from_its_restart_file_to_the_same_bits(cli, ran, tmp_path):
    assert cli(*fast("--to", "half", "--duration", 7.5)).exit_code == 0
    result = cli(*fast("--restart", "half/restart.nc", "--to", "rest"))
    assert result.exit_code == 0, result.output
    whole, _ = load_restart(ran / "restart.nc")
    rest, _ = load_restart(tmp_path / "rest" / "restart.nc")
    assert rest["time"] == 15.0
    for name in ("floes_x", "floes_u", "floes_angle"):
        assert (whole[name] == rest[name]).all()
    result = cli(*fast("--restart", "rest/restart.nc", "--to", "more"))
    assert result.exit_code == 2
    assert "give a longer --duration" in result.stderr


def test_a_restart_file_of_another_scene_is_refused(cli, ran):
    result = cli(*fast("--restart", ran / "restart.nc", "--set", "contact=none", "--duration", 60))
    assert result.exit_code == 2
    assert f"--restart {ran / 'restart.nc'}: " in result.stderr


@pytest.mark.parametrize(
    "args", [["run", "two-floes", "--to"], ["scene", "two-floes", "--to"], ["plot"]]
)
def test_an_empty_path_is_not_the_folder_here(cli, tmp_path, args):
    result = cli(*args, "")
    assert result.exit_code == 2
    assert "is empty; must be a path" in result.stderr and not list(tmp_path.iterdir())


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="a pipe with a name, which Windows has not")
def test_a_pipe_is_no_scene(tmp_path):
    os.mkfifo(tmp_path / "scene.toml")
    call = [sys.executable, "-m", "floebmi", "run", "scene.toml"]
    done = subprocess.run(
        call, cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 2
    assert (
        done.stderr
        == "floebmi: scene.toml: is no regular file; save what comes from there in one\n"
    )


STARTED = """
contact = "frictional"
[domain]
x = [0, 200]
y = [0, 100]
[floes]
arrangement = "list"
each = [{ x = 50, y = 50, radius = 10 }]
[ocean]
[time]
start = "1980-01-01"
duration = 60
[output]
every = 30
picture = false
"""


@pytest.mark.parametrize(
    "change, said",
    [
        ("time.start=1980-01-02", "[time] start = 1980-01-02, the restart's is 1980-01-01; must be the same"),
        ("time.calendar=noleap", "[time] calendar = noleap, the restart's is standard; must be the same"),
    ],
)  # fmt: skip
def test_a_restart_at_another_date_is_refused(cli, tmp_path, change, said):
    (tmp_path / "a.toml").write_text(STARTED)
    assert cli("run", "a.toml", "--to", "first", "--quiet").exit_code == 0
    on = ["run", "a.toml", "--restart", "first/restart.nc", "--duration", 90, "--quiet"]
    result = cli(*on, "--set", change)
    assert result.exit_code == 2
    assert result.stderr.strip().endswith(f"--restart first/restart.nc: restart: {said}")
    assert not (tmp_path / "a").exists()
    # the same date in other words, and a scene that has lost its date
    assert cli(*on, "--set", "time.start=1980-01-01T00:00").exit_code == 0
    (tmp_path / "a.toml").write_text(STARTED.replace('start = "1980-01-01"', ""))
    assert "[time] start = none, the restart's is 1980-01-01" in cli(*on, "--force").stderr


def test_without_a_start_the_first_record_is_the_date_of_what_is_written_and_of_restarts(
    cli, tmp_path
):
    times = xr.date_range("1980-02-27", periods=9, freq="D", calendar="noleap", use_cftime=True)
    speed = {"units": "m s-1"}
    series = xr.Dataset(
        {"uo": ("time", 0.1 * np.arange(9), speed), "vo": ("time", np.zeros(9), speed)},
        {"time": times},
    )
    series.to_netcdf(tmp_path / "sea.nc")
    series.isel(time=slice(1, None)).to_netcdf(tmp_path / "next.nc")
    scene = STARTED.replace("[ocean]", "[ocean]\nfile = 'sea.nc'")
    (tmp_path / "a.toml").write_text(scene.replace('start = "1980-01-01"', ""))
    assert cli("run", "a.toml", "--to", "first", "--quiet").exit_code == 0
    with xr.open_dataset(tmp_path / "first" / "floes.nc", decode_times=False) as floes:
        assert floes.time.units.startswith("seconds since 1980-02-27")
        assert floes.time.calendar == "noleap" and "comment" not in floes.time.attrs
    on = ["run", "a.toml", "--restart", "first/restart.nc", "--duration", 90, "--quiet", "--set"]
    result = cli(*on, "ocean.file=next.nc")  # of the next day, whose current would hold now
    assert result.exit_code == 2
    assert (
        "[time] start = 1980-02-28, the restart's is 1980-02-27; must be the same" in result.stderr
    )
    assert cli(*on, "ocean.file=sea.nc").exit_code == 0


def test_at_a_restart_the_tilt_of_the_scene_holds(cli, tmp_path):
    # forces whose machine code other tests have
    laws = "[coriolis]\nparameter = 0\n[tilt]\nslope = [1e-6, 0]\n[body_force]\n"
    scene = STARTED.replace('contact = "frictional"\n', "").replace("[ocean]\n", laws)
    (tmp_path / "a.toml").write_text(scene)
    assert cli("run", "a.toml", "--to", "first", "--quiet").exit_code == 0
    on = ["run", "a.toml", "--restart", "first/restart.nc", "--duration", 90, "--quiet"]
    assert cli(*on, "--set", "tilt.slope=[2e-6, 0]").exit_code == 0
    assert load_restart(tmp_path / "a" / "restart.nc")[0]["ocean_tilt_x"] == [2e-6]


def _press_ctrl_c(monkeypatch):
    """As soon as the run has shown how far it is."""
    update = running._Meter.update

    def press(meter, model):
        update(meter, model)
        os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(running._Meter, "update", press)


def test_ctrl_c_ends_with_130_readable_files_and_the_command_that_goes_on(
    cli, tmp_path, monkeypatch
):
    _press_ctrl_c(monkeypatch)
    result = cli(*fast())
    assert result.exit_code == 130
    assert "--restart two-floes/restart.nc" in result.stderr
    with xr.open_dataset(tmp_path / "two-floes" / "floes.nc", decode_times=False) as data:
        assert data.sizes["time"] >= 2
    state, _ = load_restart(tmp_path / "two-floes" / "restart.nc")
    assert 0.0 < state["time"] < 15.0


def test_the_command_that_goes_on_ends_the_run_where_and_as_it_would_have_ended(
    cli, tmp_path, monkeypatch
):
    options = ["--set", "time.duration=15", "--set", 'title="two of them"', "--duration", 20]
    with monkeypatch.context() as pressing:
        _press_ctrl_c(pressing)
        stopped = cli("run", "two-floes", "--quiet", "--to", "a folder", *options)
    command = shlex.split(stopped.stderr.partition("go on with: floebmi ")[2])
    assert cli(*command).exit_code == 0
    whole, attributes = load_restart(tmp_path / "ANOTHER_FOLDER" / "restart.nc")
    assert (whole["time"], attributes["title"]) == (20.0, "two of them")


# ---- explain, scene ---------------------------------------------------------------------------


def test_one_warning_is_told_once(cli, tmp_path, monkeypatch):
    copied = tmp_path / "mine.toml"
    assert cli("scene", "labrador-sea", "--to", copied).exit_code == 0
    data = tmp_path / "data" / "labsea_mitgcm_1979.nc"
    with xr.open_dataset(data) as ice:
        ice.load()
    ice.siconc[:] = np.where(ice.siconc > 0, 1 + 1e-5, ice.siconc)
    data.unlink()
    ice.to_netcdf(data)
    told = cli("explain", copied).stderr.splitlines()
    assert sum("siconc: " in line and "are set to the bound" in line for line in told) == 1
    assert len(told) == len(set(told))


def test_explain_says_what_is_modelled_what_is_absent_and_what_it_costs(cli):
    result = cli("explain", "two-floes")
    assert result.exit_code == 0, result.output
    for said in (
        "Coulomb", "because friction turns floes", "left out", "bonds", "6 velocity components",
        "0.85 of the stability limit", "MB", "exchanges: about",
    ):  # fmt: skip
        assert said in result.stdout
    free = cli("explain", "two-floes", "--set", "contact=none", "--set", "ocean.velocity=[1,0]")
    assert "rotation" in free.stdout.partition("left out")[2]
    assert "4 velocity components" in free.stdout
    assert "one per exchange" in free.stdout
    assert "note: ocean drag" in free.stdout


def test_a_coast_that_stops_no_floe_is_noted(cli):
    note = "note: without [contact] the coast stops no floe"
    assert note in cli("explain", "labrador-sea", "--set", "contact=none").stdout
    assert note not in cli("explain", "labrador-sea").stdout


def test_floes_over_dry_cells_are_noted(cli, tmp_path):
    """They had no drag, in silence: floes of a list behind a shore, and where no coast lines the dry cells."""
    land(tmp_path / "land.geojson", [[0, 0], [600, 0], [600, 1000], [0, 1000], [0, 0]])
    (tmp_path / "scene.toml").write_text(
        "contact = 'frictional'\n[domain]\nx = [0, 1e3]\ny = [0, 1e3]\n[grid]\nspacing = 100\n"
        "[coast]\ngeojson = 'land.geojson'\nradius = 20\n[ocean]\nvelocity = [0.1, 0]\n"
        "[floes]\narrangement = 'list'\neach = [{x = X, y = 500, radius = 10}, {x = 800, y = 500, radius = 10}]\n"
        "[time]\nduration = 60\n".replace("X", "300")
    )
    note = "note: a floe over dry cells alone has no ocean drag (1 of 2 floes now)\n"
    assert note in cli("explain", "scene.toml").stdout and note in cli("run", "scene.toml").stdout
    beside = "--set", "floes.each.1.x=700"
    assert "dry cells" not in cli("explain", "scene.toml", *beside).stdout
    scene = read_scene("scene.toml")
    model = scene.build().model
    lined = ~model.floes.land
    floes = Floes(*(getattr(model.floes, n)[lined] for n in ("x", "y", "radius", "thickness")))
    bare = Model(model.domain, floes, forces=model.forces, grid=model.grid)
    [line] = [line for line in notes(bare) if "dry cells" in line]
    assert line.endswith("(1 of 2 floes now); no [coast] keeps floes off them")
    bare.floes.x[0] = 700.0
    assert any("(0 of 2 floes now); no [coast]" in line for line in notes(bare))


@pytest.mark.parametrize("parameter, told", [(1.45e-4, False), (-1.45e-4, False), (-1.5, True)])
def test_a_coriolis_parameter_that_is_not_of_the_earth_is_noted(parameter, told):
    model = Model(
        Domain((0.0, 1e3), (0.0, 1e3)), Floes(5e2, 5e2, 9.0, 1.0), forces=[Coriolis(parameter)]
    )
    beyond = [line for line in notes(model) if "-1.5 1/s is beyond ±0.0001458 1/s" in line]
    assert len(beyond) == len(notes(model)) == told


@pytest.mark.parametrize("edges, share", [("inactive", "50"), ("periodic", "25"), ("periodic", "")])
def test_a_grid_that_leaves_a_part_of_the_domain_out_is_told_of(cli, tmp_path, edges, share):
    """Floes there had no drag, and were in no field, in silence: a grid that lies askew never covers a rectangle."""
    x = "[-250, 500]" if share else "[-250, 750]"
    (tmp_path / "scene.toml").write_text(
        f"[domain]\nx = [0, 1e3]\ny = [0, 1e3]\nedges = '{edges}'\n[grid]\nshape = [4, 3]\nx = {x}\n"
        "[ocean]\nvelocity = [0.1, 0]\n"
    )
    told = "% of the domain lies outside the cells of the ocean: floes have no ocean drag there"
    notes = cli("explain", "scene.toml").stdout.partition("note: ")[2]
    assert (f"about {share} {told}" in notes) if share else (told not in notes)


def test_tilt_and_coriolis_force_by_cell_are_noted_where_there_are_no_cells(cli, tmp_path):
    """They had been lost there in silence, in a scene without drag."""
    (tmp_path / "scene.toml").write_text(
        "[domain]\nx = [0, 1e3]\ny = [0, 1e3]\n[grid]\nshape = [4, 3]\nx = [0, 500]\n"
        "[coriolis]\nlatitude = 70\nfield = true\n[tilt]\nslope = [1e-6, 0]\n"
    )
    notes = cli("explain", "scene.toml").stdout.partition("note: ")[2]
    assert "the cells of the ocean: floes have no Coriolis force or tilt there" in notes


@pytest.mark.parametrize(
    ("more", "times"),
    [
        ("", 1),
        ("[coast]\ngeojson = 'land.geojson'\nradius = 20\n", 1),  # wind blows over land, too
        ("[atmosphere.grid]\nshape = [4, 3]\nx = [0, 500]\n", 2),
    ],
)
def test_ocean_and_air_on_one_grid_are_noted_once(cli, tmp_path, more, times):
    land(tmp_path / "land.geojson", [[0, 0], [300, 0], [300, 1000], [0, 1000], [0, 0]])
    (tmp_path / "scene.toml").write_text(
        "contact = 'cohesive'\n[domain]\nx = [0, 1e3]\ny = [0, 1e3]\n[grid]\nshape = [4, 3]\nx = [-250, 500]\n"
        "[ocean]\nvelocity = [0.1, 0]\n[atmosphere]\nvelocity = [5, 0]\n" + more
    )
    notes = cli("explain", "scene.toml").stdout.partition("note: ")[2]
    both = "outside the cells of the ocean and the air: floes have no ocean drag or air drag there"
    assert notes.count("outside the cells") == times and (both in notes) == (times == 1)


def test_explain_counts_the_memory_of_all_arrays():
    """At least what numpy counts, which does not see the pairs that kernels find."""
    changes = ["floes.size.radius_min=100.0", "floes.size.radius_max=300.0"]
    scene = read_scene("periodic-box", changes)
    explain(scene, scene.build())  # what stays from the first time, such as code
    tracemalloc.start()
    try:
        built = scene.build()
        told = explain(scene, built)
        numpys = tracemalloc.DomainFilter(True, np.lib.tracemalloc_domain)
        kept = tracemalloc.take_snapshot().filter_traces([numpys]).traces
    finally:
        tracemalloc.stop()
    megabytes = float(re.search(r"memory +about (\S+) MB", told)[1])
    assert 0.99 < megabytes * 1e6 / sum(one.size for one in kept) < 1.2


@pytest.mark.parametrize("name", packaged())
def test_every_packaged_scene_can_be_built_and_explained(cli, name):
    result = cli("explain", name)
    assert result.exit_code == 0, result.output
    assert "steps of" in result.stdout


def test_scene_lists_prints_and_copies(cli, tmp_path):
    listed = cli("scene").stdout
    assert all(name in listed for name in packaged())
    assert cli("scene", "two-floes").stdout == packaged()["two-floes"].read_text()
    assert cli("scene", "strait", "--to", "mine.toml").exit_code == 0
    assert (tmp_path / "data" / "strait.geojson").exists()
    assert cli("scene", "strait", "--to", "mine.toml").exit_code == 0  # the same again
    (tmp_path / "mine.toml").write_text("edited")
    assert cli("scene", "strait", "--to", "mine.toml").exit_code == 2
    assert (tmp_path / "mine.toml").read_text() == "edited"
    assert cli("scene", "strait", "--to", "mine.toml", "--force").exit_code == 0
    keys = cli("scene", "--keys").stdout
    assert "[floes.size]" in keys
    assert "SI units" in keys
    result = cli("scene", "strait", "--keys")
    assert result.exit_code == 2 and "--keys lists the keys of any scene" in result.output


def test_a_copied_scene_runs(cli, tmp_path):
    assert cli("scene", "two-floes", "--to", tmp_path).exit_code == 0
    result = cli("run", "two-floes.toml", "--duration", "5", "--quiet")
    assert result.exit_code == 0, result.output
    assert (tmp_path / "two-floes" / "floes.nc").exists()


# ---- pictures ---------------------------------------------------------------------------------


def test_plot_animate_and_export_work_on_a_run(cli, ran, tmp_path):
    for args, file in (
        (["plot", ran, "--to", "a.png"], "a.png"),
        (["plot", ran / "floes.nc", "--color", "thickness", "--time", 0, "--to", "b.svg"], "b.svg"),
        (["plot", ran, "--ledger", "--to", "c.png"], "c.png"),
        (["animate", ran, "--to", "d.gif", "--every", 3], "d.gif"),
        (["export", ran, "--to", "e"], "e/floes.pvd"),
    ):
        result = cli(*args)
        assert result.exit_code == 0, result.output
        assert f"wrote {file}" in result.stdout
        assert (tmp_path / file).exists()
    again = cli("plot", ran, "--to", "a.png")
    assert again.exit_code == 2
    assert "--force" in again.stderr
    assert cli("plot", ran, "--to", "a.png", "--force").exit_code == 0
    wrong = cli("plot", ran, "--color", "sped", "--to", "f.png")
    assert wrong.exit_code == 2
    assert "did you mean 'speed'?" in wrong.stderr
    assert "gridded.nc" in cli("plot", ran, "--variable", "area_fraction").stderr


def test_plot_refuses_options_that_the_picture_would_not_show(cli, ran, tmp_path):
    for args, said in (
        (["--ledger", "--variable", "area_fraction"], "--variable: --ledger does not show it"),
        (["--ledger", "--time", "0"], "--time: --ledger does not show it"),
        (["--ledger", "--color", "speed"], "--color: --ledger does not show it"),
    ):
        result = cli("plot", ran, "--to", "a.png", *args)
        assert (result.exit_code, said in result.stderr) == (2, True), result.stderr
    assert cli("run", "periodic-box", "--quiet", "--to", "box", "--duration", 1).exit_code == 0
    result = cli("plot", "box", "--to", "a.png", "--variable", "thickness", "--color", "thickness")
    assert "--color: a map of gridded.nc does not show it" in result.stderr
    assert not (tmp_path / "a.png").exists()


def test_a_title_with_dollars_is_written_as_it_stands(cli, tmp_path):
    dollars = r"""title='a $\frac$ of 5'"""
    assert cli(*fast("--set", dollars)).exit_code == 0
    assert (tmp_path / "two-floes" / "two-floes.png").exists()
    assert cli("plot", "two-floes", "--ledger").exit_code == 0


def test_a_run_writes_floes_and_fields_for_paraview(cli, tmp_path):
    result = cli(*fast("--to", "r", "--set", "output.paraview=true", "--set", "grid.shape=[1, 2]"))
    assert result.exit_code == 0, result.output
    assert {path.name for path in (tmp_path / "r/paraview").glob("*.pvd")} == {
        "floes.pvd", "fields.pvd",
    }  # fmt: skip


def test_a_picture_a_page_and_paraview_files_are_whole_or_not_there(cli, ran, tmp_path):
    resource = pytest.importorskip("resource")
    assert cli("plot", ran, "--to", "a.png").exit_code == 0
    earlier = (tmp_path / "a.png").read_bytes()
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    for args, file in (
        (["plot", ran, "--to", "a.png", "--force"], "a.png"),
        (["plot", ran, "--ledger", "--to", "b.svg"], "b.svg"),
        (["view", ran, "--to", "c.html"], "c.html"),
        (["export", ran, "--to", "d"], "d/floes_00000.vtp"),
    ):
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))  # a disk that is full
        try:
            result = cli(*args)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        assert (result.exit_code, result.stderr) == (2, f"floebmi: {file}: File too large\n")
    assert [path.name for path in sorted(tmp_path.rglob("*")) if path.is_file()] == ["a.png"]
    assert (tmp_path / "a.png").read_bytes() == earlier


# ---- the main job -----------------------------------------------------------------------------


def test_labrador_sea_runs_end_to_end_on_real_data(cli, tmp_path):
    result = cli(
        "run", "labrador-sea", "--duration", 14400, "--set", "output.every=7200",
        "--set", "time.exchange=3600",
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    folder = tmp_path / "labrador-sea"
    names = {path.name for path in folder.iterdir()}
    assert names == {"gridded.nc", "floes.nc", "restart.nc", "labrador-sea.png"}
    with xr.open_dataset(folder / "gridded.nc") as data:
        assert data.sizes["time"] == 3
        assert 0.3 < float(data.sea_ice_area_fraction[-1].max()) <= 1.0
        wind = (data.x_wind**2 + data.y_wind**2) ** 0.5
        assert 0.5 < float(wind.max()) < 10.0  # monthly means
    with xr.open_dataset(folder / "floes.nc") as data:
        assert data.sizes["trajectory"] > 1000
        assert str(data.time.values[0]).startswith("1980-01")
        moved = ((data.x[-1] - data.x[0]) ** 2 + (data.y[-1] - data.y[0]) ** 2) ** 0.5
        assert 10.0 < float(moved.max()) < 14400 * 0.5
    ledger = next(line for line in result.stdout.splitlines() if "relative" in line).split()
    assert all(float(value) < 1e-3 for value in ledger[1:])
