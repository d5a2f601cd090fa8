"""Ensembles: members once and for all, failures in one line, one data set."""

import os
import pathlib
import re
import signal
import subprocess
import sys
import time
import warnings
from concurrent.futures import ThreadPoolExecutor

import netCDF4
import numpy as np
import pytest
import xarray as xr

from floebmi import __version__, ensemble
from floebmi.ensemble import Output
from floebmi.errors import InputError

SWEEP = {"a": (1.0, 2.0), "b": (10.0, 20.0, 30.0)}
OUTPUTS = {"sum": Output((), "m", "a + b + seed"), "row": Output(("t",), "s", "a row")}
COORDINATES = {"t": Output(("t",), "s", "time")}


def member(p, seed):
    value = p["a"] + p["b"] + seed
    return {"sum": np.array(value), "row": value * np.arange(3.0), "t": np.arange(3.0)}


def noted(p, seed):
    with open(p["log"], "a") as log:
        log.write(f"{p['a']:g} {seed}\n")
    return {"sum": np.array(p["a"] + seed)}


def moody(p, seed):
    if p["a"] == 2.0 and seed == 1:
        raise ValueError("two\nlines")
    return {"sum": np.array(p["a"] + seed)}


def deadly(p, seed):
    if p["a"] == 2.0 and seed == 1:
        os._exit(1)
    return {"sum": np.array(p["a"] + seed)}


def interrupted(p, seed):
    if p["a"] == 2.0:
        raise KeyboardInterrupt
    return {"sum": np.array(p["a"] + seed)}


def wary(p, seed):
    warnings.warn("thin ice", stacklevel=1)
    return {"sum": np.array(p["a"] + seed)}


def wary_of_two(p, seed):
    return wary(p, seed) if p["a"] == 2.0 and seed == 1 else moody(p, seed)


def endless(p, seed):
    part = f"{p['log']}.part"
    with open(part, "w") as log:
        log.write(str(os.getpid()))
    os.rename(part, p["log"])
    time.sleep(200.0)


def within(seconds, true):
    """Whether it comes true so soon."""
    end = time.monotonic() + seconds
    while not true() and time.monotonic() < end:
        time.sleep(0.05)
    return true()


def alive(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    stat = pathlib.Path(f"/proc/{pid}/stat")
    return not stat.exists() or stat.read_text().rpartition(")")[2].split()[0] != "Z"


def tell_threads(p, seed):
    time.sleep(0.2)
    return {
        "sum": np.array(float(os.environ["NUMBA_NUM_THREADS"])),
        "process": np.array(os.getpid()),
    }


def test_members_become_one_data_set_with_a_dimension_for_each_parameter_and_the_seeds(tmp_path):
    done = ensemble.run(member, {}, SWEEP, (5, 3), tmp_path / "m", jobs=1)
    data = ensemble.gather(done, OUTPUTS, COORDINATES, {"a": ("m", "first")})
    assert data["sum"].dims == ("a", "b", "seed")
    assert float(data["sum"].sel(a=2.0, b=30.0, seed=5)) == 37.0
    assert data["row"].sel(a=1.0, b=10.0, seed=3).values.tolist() == [0.0, 14.0, 28.0]
    assert data["row"].attrs == {"units": "s", "long_name": "a row"}
    assert data["a"].attrs["units"] == "m"


def test_coordinates_of_a_saved_data_set_have_no_missing_value_as_cf_has_it(tmp_path):
    done = ensemble.run(member, {}, SWEEP, (5,), tmp_path / "m", jobs=1)
    data = ensemble.gather(done, OUTPUTS, COORDINATES).assign_coords(word=("b", ["x", "y", "z"]))
    ensemble.save(data, tmp_path / "a.nc")
    with netCDF4.Dataset(tmp_path / "a.nc") as file:
        declared = {name for name, one in file.variables.items() if "_FillValue" in one.ncattrs()}
    assert declared == {"sum", "row"}
    loaded = xr.load_dataset(tmp_path / "a.nc")
    loaded.attrs.clear()
    xr.testing.assert_identical(loaded, data)


def test_a_saved_data_set_says_what_it_is_and_what_made_it_when(tmp_path):
    numbers = {"a": ("x", [1.0, 2.0])}
    data = xr.Dataset(numbers, attrs={"title": "two numbers"})
    for one, title in ((data, "two numbers"), (xr.Dataset(numbers), "an ensemble of runs")):
        ensemble.save(one, tmp_path / "a.nc")
        told = xr.load_dataset(tmp_path / "a.nc").attrs
        assert (told["Conventions"], told["title"]) == ("CF-1.11", title)
        assert told["source"].startswith("floebmi ")
        assert re.fullmatch(r"\d{4}-\d\d-\d\dT[\d:]{8}Z: written by floebmi \S+", told["history"])
    assert data.attrs == {"title": "two numbers"}


def test_processes_give_the_same_as_this_one_with_one_thread_each(tmp_path):
    here = ensemble.run(member, {}, SWEEP, (1,), tmp_path / "here", jobs=1)
    there = ensemble.run(member, {}, SWEEP, (1,), tmp_path / "there", jobs=2, code=lambda p: p["a"])
    assert here.members.keys() == there.members.keys()
    for key, arrays in here.members.items():
        assert np.array_equal(arrays["row"], there.members[key]["row"])
    threads = ensemble.run(tell_threads, {}, {"a": (1.0, 2.0)}, (1,), tmp_path / "t", jobs=2)
    assert [one["sum"] for one in threads.members.values()] == [1.0, 1.0]
    assert os.getpid() not in [one["process"] for one in threads.members.values()]


def test_finished_members_are_not_run_again_and_more_can_be_asked_for(tmp_path):
    log = tmp_path / "log"
    shared = {"log": str(log)}
    ensemble.run(noted, shared, {"a": (1.0, 2.0)}, (1, 2), tmp_path / "m", jobs=1)
    done = ensemble.run(noted, shared, {"a": (1.0, 2.0, 3.0)}, (1, 2, 3), tmp_path / "m", jobs=1)
    lines = log.read_text().split("\n")[:-1]
    assert len(lines) == len(set(lines)) == len(done.members) == 9


def test_members_of_other_parameters_are_refused(tmp_path):
    ensemble.run(member, {"c": 1.0}, SWEEP, (1,), tmp_path / "m", jobs=1)
    with pytest.raises(InputError, match=r"c = 1.0 there, 2.0 here"):
        ensemble.run(member, {"c": 2.0}, SWEEP, (1,), tmp_path / "m", jobs=1)
    with pytest.raises(InputError, match=r"c = 1.0 there, None here"):
        ensemble.run(member, {}, SWEEP, (1,), tmp_path / "m", jobs=1)
    with pytest.raises(InputError, match="moody|member"):
        ensemble.run(moody, {"c": 1.0}, SWEEP, (1,), tmp_path / "m", jobs=1)
    note = tmp_path / "m" / "ensemble.json"
    note.write_text(note.read_text().replace(__version__, "0.0.1"))
    with pytest.raises(InputError, match="floebmi 0.0.1 there"):
        ensemble.run(member, {"c": 1.0}, SWEEP, (1,), tmp_path / "m", jobs=1)


def test_a_parameter_of_several_numbers_is_the_same_when_it_is_read_again(tmp_path):
    for _ in range(2):
        done = ensemble.run(member, {"c": (1.0, 2.0)}, SWEEP, (1,), tmp_path / "m", jobs=1)
    assert len(done.members) == 6


def test_a_folder_of_something_else_is_left_alone(tmp_path):
    (tmp_path / "thesis.txt").write_text("years")
    with pytest.raises(InputError, match="not the folder of an ensemble"):
        ensemble.run(member, {}, SWEEP, (1,), tmp_path, jobs=1)


@pytest.mark.parametrize("jobs", [1, pytest.param(2, marks=pytest.mark.long)])
def test_a_member_that_fails_is_told_in_one_line_and_the_others_go_on(tmp_path, jobs):
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        done = ensemble.run(moody, {}, {"a": (1.0, 2.0)}, (1, 2), tmp_path / "m", jobs=jobs)
    assert [str(w.message) for w in told] == ["member failed: a=2,seed=1: ValueError: two lines"]
    data = ensemble.gather(done, {"sum": OUTPUTS["sum"]})
    assert np.isnan(data["sum"].sel(a=2.0, seed=1))
    assert np.isfinite(data["sum"]).sum() == 3


@pytest.mark.parametrize("jobs", [1, pytest.param(2, marks=pytest.mark.long)])
def test_a_warning_that_is_an_error_fails_its_member_alone(tmp_path, capsys, jobs):
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # as python -W error does
        done = ensemble.run(wary_of_two, {}, {"a": (1.0, 2.0)}, (1, 2), tmp_path / "m", jobs=jobs)
    assert [str(one) for one in done.failures] == ["a=2,seed=1: UserWarning: thin ice"]
    assert len(done.members) == 3
    assert capsys.readouterr().err == f"member failed: {done.failures[0]}\n"
    with pytest.warns(UserWarning, match="thin ice"):
        again = ensemble.run(wary_of_two, {}, {"a": (1.0, 2.0)}, (1, 2), tmp_path / "m", jobs=1)
    assert len(again.members) == 4


@pytest.mark.long
def test_what_members_in_processes_warn_of_is_told_once_and_here(tmp_path, capfd):
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("default")
        ensemble.run(wary, {}, {"a": (1.0, 2.0)}, (1, 2), tmp_path / "m", jobs=2)
    assert [str(one.message) for one in told] == ["thin ice"]
    assert capfd.readouterr().err == ""


@pytest.mark.long
def test_a_process_that_dies_takes_no_other_member_with_it(tmp_path):
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        done = ensemble.run(deadly, {}, {"a": (1.0, 2.0)}, (1, 2), tmp_path / "m", jobs=2)
    assert len(done.members) == 3
    assert len(told) == 1 and "a=2,seed=1: RuntimeError: the process ended" in str(told[0].message)


def test_a_member_that_was_cut_short_leaves_nothing_that_looks_finished(tmp_path):
    ensemble.run(member, {}, SWEEP, (1,), tmp_path / "m", jobs=1)
    one = next((tmp_path / "m").glob("*.npz"))
    one.write_bytes(one.read_bytes()[:40])
    with pytest.raises(InputError, match="not a finished member"):
        ensemble.run(member, {}, SWEEP, (1,), tmp_path / "m", jobs=1)
    assert not list((tmp_path / "m").glob("*.part"))


def named(p, s):
    return {"length": np.array(float(len(p["file"]))), "t": np.arange(len(p["file"]))}


def unlike(p, s):
    return {"t": s * np.arange(2.0), "row": np.zeros(s), "sum": np.array(s)}


def shapeless(p, s):
    return np.array(1.0)


def test_a_path_may_be_swept(tmp_path):
    sweep = {"file": ("data/a.nc", "/data/longer.nc")}
    for _ in range(2):  # the second finds what the first has kept
        done = ensemble.run(named, {}, sweep, (1,), tmp_path / "m", jobs=1)
    data = ensemble.gather(done, {"length": Output((), "1", "of the name")})
    assert [float(data.length.sel(file=name, seed=1)) for name in sweep["file"]] == [9, 15]


def test_members_that_one_cannot_tell_apart_are_refused_before_any_runs(tmp_path):
    for sweep, seeds in (({"a": (0.1, 0.1 + 1e-14)}, (1,)), ({"a": (1, 1.0)}, (1,)), ({}, (1, 1))):
        with pytest.raises(InputError, match="several members are .*seed=1: values and seeds must"):
            ensemble.run(member, {}, sweep, seeds, tmp_path / "m", jobs=1)
    for sweep, seeds in (({"a": 0.3}, (1,)), ({"a": "abc"}, (1,)), ({}, 3), ({"seed": (1,)}, (2,))):
        with pytest.raises(InputError, match="must be several values, as"):
            ensemble.run(member, {}, sweep, seeds, tmp_path / "m", jobs=1)
    with pytest.raises(InputError, match="parameters = .* must be numbers, texts"):
        ensemble.run(member, {"b": np.arange(3)}, {"a": (1.0,)}, (1,), tmp_path / "m", jobs=1)
    assert not (tmp_path / "m").exists()


def test_what_members_return_is_checked(tmp_path):
    with pytest.warns(UserWarning, match="seed=1: it returned ndarray, must be a dict of arrays"):
        done = ensemble.run(shapeless, {}, {}, (1,), tmp_path / "s", jobs=1)
    assert not done.members
    done = ensemble.run(unlike, {}, {}, (1, 2), tmp_path / "m", jobs=1)
    with pytest.raises(InputError, match="spin: seed=1 has none, only t, row, sum"):
        ensemble.gather(done, {"spin": Output((), "1", "spin")})
    with pytest.raises(
        InputError, match=r"row: seed=2 has the shape \(2,\), another member \(1,\)"
    ):
        ensemble.gather(done, {"row": OUTPUTS["row"]})
    with pytest.raises(InputError, match="t: seed=2 has others than another member"):
        ensemble.gather(done, {"sum": OUTPUTS["sum"]}, COORDINATES)


def test_files_that_a_full_disk_left_are_told(tmp_path):
    ensemble.run(member, {}, SWEEP, (1,), tmp_path / "m", jobs=1)
    next((tmp_path / "m").glob("*.npz")).write_bytes(b"")
    with pytest.raises(InputError, match="not a finished member"):
        ensemble.run(member, {}, SWEEP, (1,), tmp_path / "m", jobs=1)
    (tmp_path / "m" / "ensemble.json").write_text("{")
    with pytest.raises(InputError, match="ensemble.json: is damaged"):
        ensemble.run(member, {}, SWEEP, (1,), tmp_path / "m", jobs=1)


def test_an_interrupt_stops_it_and_what_is_finished_stays(tmp_path):
    with pytest.raises(KeyboardInterrupt) as stop:
        ensemble.run(interrupted, {}, {"a": (1.0, 2.0)}, (1, 2), tmp_path / "m", jobs=1)
    assert stop.value.__notes__ == ["2 of 4 members are finished, and will not be run again"]
    assert len(list((tmp_path / "m").glob("*.npz"))) == 2


@pytest.mark.long
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="of POSIX")
@pytest.mark.parametrize("how", ["SIGINT", "SIGTERM", "SIGKILL"])
def test_workers_end_with_the_process_that_they_work_for(tmp_path, how):
    code = (
        f"import sys; sys.path.insert(0, {os.path.dirname(__file__)!r})\n"
        "from test_ensemble import endless; from floebmi import ensemble\n"
        f"ensemble.run(endless, {{'log': {str(tmp_path / 'pid')!r}}}, {{}}, (1, 2), 'm', jobs=2)"
    )
    caller = subprocess.Popen(
        [sys.executable, "-c", code], cwd=tmp_path, stderr=subprocess.DEVNULL,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )  # fmt: skip
    try:
        assert within(100.0, (tmp_path / "pid").exists)
        worker = int((tmp_path / "pid").read_text())
        caller.send_signal(getattr(signal, how))
        assert caller.wait(20.0) != 0
        assert within(20.0, lambda: not alive(worker))
    finally:
        caller.kill()


def test_an_ensemble_of_failures_only_makes_no_data_set(tmp_path):
    with pytest.warns(UserWarning, match="failed"):
        done = ensemble.run(moody, {}, {"a": (2.0,)}, (1,), tmp_path / "m", jobs=1)
    with pytest.raises(InputError, match="no member has finished"):
        ensemble.gather(done, OUTPUTS)


def test_the_same_call_runs_on_an_executor(tmp_path):
    with ThreadPoolExecutor(2) as threads:
        done = ensemble.run(member, {}, SWEEP, (1, 2), tmp_path / "m", on=threads)
    assert len(done.members) == 12


def test_the_same_call_runs_on_a_dask_client(tmp_path):
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        done = ensemble.run(member, {}, SWEEP, (1, 2), tmp_path / "m", on=client)
    assert len(done.members) == 12


@pytest.mark.parametrize("jobs", [0, -1, 1.5, "2"])
def test_less_than_one_job_is_refused(tmp_path, jobs):
    with pytest.raises(InputError, match="jobs"):
        ensemble.run(member, {}, SWEEP, range(2), tmp_path / "members", jobs=jobs)
