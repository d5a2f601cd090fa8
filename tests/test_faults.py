"""What can happen to a run from outside: nothing that was written is lost, and it can go on."""

import datetime
import os
import shutil
import subprocess
import sys
import threading
import time
from types import SimpleNamespace

import netCDF4
import numpy as np
import pytest
import xarray as xr
from netCDF4 import Dataset

from floebmi import (
    Domain,
    Floes,
    Grid,
    InputError,
    Model,
    OceanDrag,
    files,
    frictional,
    output,
    run,
)
from floebmi.forcing import VelocityFile
from floebmi.output import GriddedWriter, TrajectoryWriter
from floebmi.restarts import load_restart, save_restart

BOX = Domain((0.0, 1000.0), (0.0, 1000.0))
PATIENT = 300.0  # seconds: a run may have to compile first


def drifting():
    floes = Floes([300.0, 335.0], [500.0, 508.0], [20.0, 15.0], 1.0, u=[0.5, 0.0])
    grid = Grid.uniform(BOX.x, BOX.y, spacing=250.0)
    return Model(BOX, floes, frictional(), [OceanDrag()], grid)


def frames(path):
    with xr.open_dataset(path, decode_times=False) as data:
        return data.time.values, data.x.values.reshape(2, -1)


def restored(path):
    model = drifting()
    model.restore(load_restart(path)[0])
    return model


# ---- killed -----------------------------------------------------------------------------------

ENDLESS = """
import sys
sys.path.insert(0, {tests!r})
from floebmi import running
from test_faults import drifting
running.SAVED_EVERY = 0.0
running.run(drifting(), 1e6, every=0.5, trajectories="floes.nc", restart="restart.nc")
"""


def has_begun(path):
    """Whether a run has saved a state later than the one at its start."""
    return path.exists() and load_restart(path)[0]["time"] > 0.0


def killed_after(folder, seconds):
    code = ENDLESS.format(tests=os.path.dirname(__file__))
    process = subprocess.Popen([sys.executable, "-c", code], cwd=folder)
    try:
        while not has_begun(folder / "restart.nc"):
            assert process.poll() is None
            time.sleep(0.02)
        time.sleep(seconds)
    finally:
        process.kill()
        process.wait()


@pytest.mark.parametrize("seconds", [0.3])
def test_a_killed_run_leaves_whole_frames_and_a_state_that_goes_on_with_the_same_bits(
    tmp_path, seconds
):
    killed_after(tmp_path, seconds)
    times, x = frames(tmp_path / "floes.nc")
    assert len(times) > 2 and np.isfinite(x).all()
    assert np.diff(times) == pytest.approx(0.5)
    model = restored(tmp_path / "restart.nc")
    assert times[0] < model.time <= times[-1]  # at most one frame behind
    assert times[-1] - model.time <= 0.5 + 1e-9
    whole = drifting()
    run(whole, model.time + 5.0, every=0.5)
    run(model, 5.0, every=0.5)
    np.testing.assert_array_equal(model.floes.x, whole.floes.x)
    np.testing.assert_array_equal(model.floes.angular_velocity, whole.floes.angular_velocity)


@pytest.mark.long
@pytest.mark.parametrize("seconds", np.linspace(0.0, 2.0, 20))
def test_a_run_killed_at_any_moment_leaves_readable_files(tmp_path, seconds):
    killed_after(tmp_path, seconds)
    times, x = frames(tmp_path / "floes.nc")
    assert np.isfinite(x).all()
    assert restored(tmp_path / "restart.nc").time <= times[-1]


@pytest.mark.parametrize("writer", [GriddedWriter, TrajectoryWriter])
def test_what_grows_in_a_file_is_of_fixed_width_so_that_no_row_points_to_text_not_yet_there(
    tmp_path, writer
):
    with writer(tmp_path / "a.nc", drifting()) as file:
        file.write(drifting())
    with Dataset(tmp_path / "a.nc") as data:
        growing = {name for name, size in data.dimensions.items() if size.isunlimited()}
        kinds = {name: v.dtype for name, v in data.variables.items() if growing & set(v.dimensions)}
    assert "ledger_account" in kinds
    assert str not in kinds.values()


# ---- a full disk ------------------------------------------------------------------------------


def test_a_disk_that_fills_up_ends_a_run_before_a_frame_is_torn(tmp_path, monkeypatch):
    free = iter([10**12] * 5 + [1000] * 100)
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(output.shutil, "disk_usage", lambda path: usage._replace(free=next(free)))
    with pytest.raises(OSError, match="No space left on device: .*floes.nc") as caught:
        run(
            drifting(), 100.0, every=1.0,
            trajectories=tmp_path / "floes.nc", restart=tmp_path / "restart.nc",
        )  # fmt: skip
    assert "is saved in" in caught.value.__notes__[0]
    times, x = frames(tmp_path / "floes.nc")
    assert times.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0] and np.isfinite(x).all()
    assert restored(tmp_path / "restart.nc").time == 6.0


def command(folder, *more):
    return [
        sys.executable, "-m", "floebmi", "run", "two-floes", "--to", str(folder), "--quiet",
        "--set", "output.every=0.05", "--set", "time.exchange=0.05", "--set", "time.duration=1000",
        "--set", "output.picture=false", *more,
    ]  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize(
    "most, said",
    [
        (8192, ["could not be written", "disk full"]),
        (0, ["File too large"]),  # NetCDF says "Permission denied", of a full disk too
    ],
)
def test_a_file_that_may_grow_no_further_is_said_in_one_line(tmp_path, most, said):
    resource = pytest.importorskip("resource")

    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))

    short = command(tmp_path / "before", "--set", "time.duration=1", "--set", "output.every=1")
    subprocess.run(short, check=True)  # else code that cannot be kept would be a line of its own
    done = subprocess.run(
        command(tmp_path / "out"), capture_output=True, text=True, preexec_fn=limit, check=False
    )
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "restart.nc: " in done.stderr  # the first that is made
    assert all(text in done.stderr for text in said)
    assert "Permission denied" not in done.stderr and ".part" not in done.stderr
    assert list((tmp_path / "out").iterdir()) == []


@pytest.mark.long
@pytest.mark.skipif(
    subprocess.run(["unshare", "-rm", "true"], capture_output=True, check=False).returncode != 0
    if shutil.which("unshare") else True,
    reason="a small disk of its own needs user namespaces",
)  # fmt: skip
def test_a_disk_that_is_really_full_keeps_the_frames_and_the_state(tmp_path):
    call = " ".join(f"'{word}'" for word in command("disk/out"))
    script = f"mount -t tmpfs -o size=3M tmpfs disk && {call}; echo $? > code; cp -r disk/out kept"
    (tmp_path / "disk").mkdir()
    done = subprocess.run(
        ["unshare", "-rm", "sh", "-c", script], cwd=tmp_path, capture_output=True, text=True, check=False
    )  # fmt: skip
    assert (tmp_path / "code").read_text() == "2\n", done.stderr
    assert done.stderr.count("\n") == 1 and "No space left on device" in done.stderr
    times, _ = frames(tmp_path / "kept" / "floes.nc")
    assert len(times) > 50
    state = load_restart(tmp_path / "kept" / "restart.nc")[0]
    assert state["time"] == pytest.approx(times[-1] + 0.05)


def test_a_run_that_gets_nowhere_leaves_the_state_of_an_earlier_one(tmp_path, monkeypatch):
    files = {"trajectories": tmp_path / "floes.nc", "restart": tmp_path / "restart.nc"}
    run(drifting(), 10.0, **files)

    def refuse(*columns):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(TrajectoryWriter, "write", refuse)
    with pytest.raises(OSError) as caught:
        run(drifting(), 5.0, **files, overwrite=True)
    assert not hasattr(caught.value, "__notes__")
    assert restored(tmp_path / "restart.nc").time == frames(tmp_path / "floes.nc")[0][-1] == 10.0


# ---- damaged and disputed files ---------------------------------------------------------------


def test_a_truncated_restart_file_is_refused_wherever_it_ends(tmp_path):
    whole, part = tmp_path / "restart.nc", tmp_path / "part.nc"
    save_restart(whole, drifting().state())
    data = whole.read_bytes()
    for length in (0, 7, 100, len(data) // 2, len(data) - 1):
        part.write_bytes(data[:length])
        with pytest.raises(InputError, match="damaged one; take an older one"):
            load_restart(part)


class NewYear(datetime.datetime):
    @classmethod
    def now(cls, tz=None):
        return cls(2026, 1, 1, tzinfo=tz)


@pytest.mark.skipif(
    netCDF4.__hdf5libversion__.startswith("1."), reason="HDF5 1 ends the process at some of these"
)
def test_a_restart_file_with_a_flipped_bit_is_refused_or_gives_the_same_state(
    tmp_path, monkeypatch
):
    """The same bits of the same file each time, since now and then reading such a file ends the process in HDF5 2, too."""
    monkeypatch.setattr(files, "datetime", SimpleNamespace(datetime=NewYear, UTC=datetime.UTC))
    path, state = tmp_path / "restart.nc", drifting().state()
    save_restart(path, state)
    data, rng = bytearray(path.read_bytes()), np.random.default_rng(0)
    refused = 0
    for _ in range(40):
        place, bit = int(rng.integers(len(data))), 1 << int(rng.integers(8))
        data[place] ^= bit
        path.write_bytes(data)
        try:
            read = load_restart(path)[0]
        except InputError:
            refused += 1
        else:
            assert all(np.array_equal(read[name], state[name]) for name in ("floes_x", "pair_slip"))
        data[place] ^= bit
    assert refused


class Waits:
    """A current; the run that asks for it waits in the middle."""

    span = None

    def __init__(self):
        self.there, self.go = threading.Event(), threading.Event()

    def fill(self, t, u, v):
        if t > 5.0:
            self.there.set()
            self.go.wait(PATIENT)


@pytest.mark.long
def test_a_file_that_another_run_is_writing_is_not_replaced_not_even_by_force(tmp_path):
    path, current = tmp_path / "floes.nc", Waits()
    first = threading.Thread(target=run, args=(drifting(), 10.0, current), kwargs=dict(every=1.0, trajectories=path))  # fmt: skip
    first.start()
    assert current.there.wait(PATIENT)
    code = (
        f"import sys; sys.path.insert(0, {os.path.dirname(__file__)!r})\n"
        "from test_faults import drifting; from floebmi import run\n"
        f"run(drifting(), 10.0, trajectories={str(path)!r}, overwrite=True)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    current.go.set()
    first.join()
    assert "another run is writing it; choose another name" in done.stderr
    assert frames(path)[0].tolist() == list(range(11))


def test_of_two_runs_that_begin_the_same_file_at_once_the_second_gives_way(tmp_path):
    path = tmp_path / "floes.nc"
    one, other = TrajectoryWriter(path, drifting()), TrajectoryWriter(path, drifting())
    model = drifting()
    with one, other:
        one.write(model)
        with pytest.raises(InputError, match="another run has made it meanwhile"):
            other.write(model)
        model.advance(1.0)
        one.write(model)
    assert frames(path)[0].tolist() == [0.0, 1.0]
    assert [file.name for file in tmp_path.iterdir()] == ["floes.nc"]


# ---- forcing ----------------------------------------------------------------------------------


def currents(path, hole):
    """Eleven records of a current of 0.2 m/s; a hole of NaN in record 6, on the water."""
    x = np.arange(-1000.0, 2001.0, 500.0)
    u = np.full((11, 7, 7), 0.2)
    if hole:
        u[6, 2:5, 2:5] = np.nan
    attrs = {"units": "m s-1"}
    xr.Dataset(
        {
            "uo": (("time", "y", "x"), u, attrs | {"standard_name": "sea_water_x_velocity"}),
            "vo": (("time", "y", "x"), 0 * np.nan_to_num(u), attrs | {"standard_name": "sea_water_y_velocity"}),
        },
        {
            "time": ("time", 10.0 * np.arange(11), {"units": "seconds since 2000-01-01"}),
            "x": ("x", x, {"units": "m", "standard_name": "projection_x_coordinate"}),
            "y": ("y", x, {"units": "m", "standard_name": "projection_y_coordinate"}),
        },
    ).to_netcdf(path)  # fmt: skip
    return path


def test_nan_in_the_middle_of_a_forcing_file_stops_the_run_which_goes_on_with_a_mended_file(
    tmp_path,
):
    def water(name, hole):
        return VelocityFile(currents(tmp_path / name, hole), drifting().grid)

    with pytest.raises(
        InputError, match=r"holed.nc: uo\[\d, \d\] at 2000-01-01T00:01: nan on water"
    ) as caught:
        run(
            drifting(), 100.0, water("holed.nc", True), every=10.0, exchange=5.0,
            trajectories=tmp_path / "floes.nc", restart=tmp_path / "restart.nc",
        )  # fmt: skip
    assert "\n" not in str(caught.value)
    assert "is saved in" in caught.value.__notes__[0]
    assert frames(tmp_path / "floes.nc")[0].tolist() == [0.0, 10.0, 20.0, 30.0, 40.0, 50.0]
    model = restored(tmp_path / "restart.nc")
    run(model, 100.0 - model.time, water("mended.nc", False), every=10.0, exchange=5.0)
    whole = drifting()
    run(whole, 100.0, water("whole.nc", False), every=10.0, exchange=5.0)
    np.testing.assert_array_equal(model.floes.x, whole.floes.x)


# ---- the streams ------------------------------------------------------------------------------


def with_streams(*words, **streams):
    return subprocess.run([sys.executable, "-m", "floebmi", *words], check=False, **streams)


full = pytest.mark.skipif(not os.path.exists("/dev/full"), reason="a disk that is always full")


@full
@pytest.mark.parametrize("words", [["--version"], ["--help"], ["scene"]])
def test_an_output_stream_that_takes_nothing_is_named(words):
    with open("/dev/full", "w") as disk:
        done = with_streams(*words, stdout=disk, stderr=subprocess.PIPE, text=True)
    assert done.stderr == "floebmi: standard output: No space left on device\n"
    assert done.returncode == 2


@pytest.mark.long
@full
def test_an_error_stream_that_takes_nothing_changes_no_exit_code(tmp_path):
    with open("/dev/full", "w") as disk:
        assert with_streams("run", "nowhere", stderr=disk).returncode == 2
        done = with_streams(
            "run", "two-floes", "--to", "out", "--set", "time.duration=15",
            cwd=tmp_path, stdout=subprocess.PIPE, stderr=disk, text=True,
        )  # fmt: skip
    assert done.returncode == 0 and "wrote out/floes.nc" in done.stdout.replace(os.sep, "/")


@pytest.mark.long
def test_signs_that_an_output_stream_does_not_have_are_no_reason_to_stop():
    latin = os.environ | {"PYTHONIOENCODING": "latin-1", "PYTHONUTF8": "0"}
    done = with_streams("explain", "two-floes", env=latin, capture_output=True)
    assert done.returncode == 0, done.stderr
    assert "floes" in done.stdout.decode("latin-1")
