"""Runs: forcing, advance, frames, and what is left when a run ends early."""

import errno
import os
import signal
import sys
import threading

import numpy as np
import pytest
import xarray as xr

from floebmi import (
    Contact,
    Coulomb,
    Domain,
    Floes,
    Function,
    Grid,
    InputError,
    Model,
    OceanDrag,
    StabilityError,
    Step,
    frictional,
    run,
    running,
)
from floebmi.restarts import load_restart
from floebmi.running import Report, WallTime, duration_text
from floebmi.state import Counters
from floebmi.validate import hexagonal_pack

BOX = Domain((0.0, 1000.0), (0.0, 1000.0))


def drifting(u=0.0):
    """Two floes that will meet, in an ocean."""
    floes = Floes([300.0, 340.0], [500.0, 508.0], [20.0, 15.0], 1.0, u=[u, 0.0])
    return Model(
        BOX,
        floes,
        contact=frictional(),
        forces=[OceanDrag()],
        grid=Grid.uniform(BOX.x, BOX.y, spacing=100.0),
    )


class Ramp:
    """A current that grows with time; remembers when it was asked for."""

    span = None

    def __init__(self, fails_at=np.inf, error=InputError("no data")):
        self.times, self.fails_at, self.error = [], fails_at, error

    def fill(self, t, u, v):
        self.times.append(t)
        if t > self.fails_at:
            raise self.error
        u[:] = 1e-3 * t
        v[:] = 0.0


def test_frames_and_exchanges_come_at_their_times_and_the_end_is_hit_exactly(tmp_path):
    model, ramp = drifting(), Ramp()
    report = run(
        model, 70.0, ocean=ramp, exchange=10.0, every=20.0,
        gridded=tmp_path / "grid.nc", trajectories=tmp_path / "floes.nc",
    )  # fmt: skip
    assert model.time == 70.0
    assert report.finished
    assert (report.start, report.end) == (0.0, 70.0)
    frames = [0.0, 20.0, 40.0, 60.0, 70.0]
    for name in ("grid.nc", "floes.nc"):
        with xr.open_dataset(tmp_path / name, decode_times=False) as data:
            assert data.time.values.tolist() == frames
    assert report.files == (tmp_path / "grid.nc", tmp_path / "floes.nc")
    # the forcing of an exchange is the one in its middle; that of a frame is the one at its time
    assert sorted(set(ramp.times)) == sorted({*frames, 5.0, 15.0, 25.0, 35.0, 45.0, 55.0, 65.0})


def test_a_frame_holds_the_forcing_of_its_own_time(tmp_path):
    run(drifting(), 40.0, ocean=Ramp(), exchange=10.0, every=20.0, gridded=tmp_path / "grid.nc")
    with xr.open_dataset(tmp_path / "grid.nc", decode_times=False) as data:
        current = data["surface_sea_water_x_velocity"]
        np.testing.assert_allclose(current[:, 0, 0], 1e-3 * data.time)


def test_a_run_in_two_parts_gives_the_bits_of_one_run(tmp_path):
    whole = drifting(u=0.5)
    run(whole, 60.0, ocean=Ramp(), exchange=10.0, every=30.0)
    first = drifting(u=0.5)
    run(first, 30.0, ocean=Ramp(), exchange=10.0, every=30.0, restart=tmp_path / "half.nc")
    second = drifting(u=0.5)
    second.restore(load_restart(tmp_path / "half.nc")[0])
    run(second, 30.0, ocean=Ramp(), exchange=10.0, every=30.0)
    assert second.time == whole.time
    for name in ("x", "y", "u", "v", "angle", "angular_velocity"):
        np.testing.assert_array_equal(getattr(second.floes, name), getattr(whole.floes, name))
    np.testing.assert_array_equal(second.ocean.impulse_x, whole.ocean.impulse_x)


def test_no_file_of_a_run_takes_the_place_of_another(tmp_path):
    file, state = tmp_path / "a.nc", tmp_path / "b.nc"
    for names in (("gridded", "trajectories"), ("gridded", "restart"), ("trajectories", "restart")):
        with pytest.raises(InputError, match="a.nc: is named twice"):
            run(drifting(), 10.0, **dict.fromkeys(names, file), overwrite=True)
    told = {"reference": np.datetime64("2001-02-03T04"), "attributes": {"title": "two floes"}}
    run(drifting(), 10.0, gridded=file, restart=state, calendar="noleap", **told)
    said = {"start": "2001-02-03T04:00:00", "calendar": "noleap", "title": "two floes"}
    assert load_restart(state)[1].items() >= said.items()
    with xr.open_dataset(file) as data:
        assert data.time.values[0].isoformat() == "2001-02-03T04:00:00"
    for path in (file, state):
        before = path.read_bytes()
        with pytest.raises(InputError, match=f"{path.name}: exists already"):
            run(drifting(), 20.0, restart=path)
        assert path.read_bytes() == before
    run(drifting(), 20.0, restart=state, overwrite=True)
    assert load_restart(state)[0]["time"] == 20.0


def test_a_second_run_with_the_same_restart_file_is_refused_while_the_first_goes_on(tmp_path):
    state, refused = tmp_path / "restart.nc", []

    class Meanwhile:
        span = None

        def fill(self, t, u, v):
            if 0.0 < t < 10.0:
                with pytest.raises(InputError, match="restart.nc: exists already") as caught:
                    run(drifting(), 50.0, restart=state)
                refused.append(str(caught.value))

    run(drifting(), 20.0, ocean=Meanwhile(), every=10.0, restart=state)
    assert len(refused) == 1 and "\n" not in refused[0]
    assert load_restart(state)[0]["time"] == 20.0


def test_of_two_runs_that_begin_at_once_the_second_leaves_the_restart_file_of_the_first(
    tmp_path, monkeypatch
):
    state = tmp_path / "restart.nc"
    writers = running._writers

    def first_another(*given):  # after the name was found free, before it is taken
        monkeypatch.setattr(running, "_writers", writers)
        run(drifting(), 20.0, restart=state)
        return writers(*given)

    monkeypatch.setattr(running, "_writers", first_another)
    with pytest.raises(InputError, match="restart.nc: (exists already|another run has made it)"):
        run(drifting(), 50.0, restart=state)
    assert load_restart(state)[0]["time"] == 20.0


def test_a_run_that_is_told_no_more_has_twenty_frames_and_an_exchange_for_each(tmp_path):
    ramp = Ramp()
    run(drifting(), 100.0, ocean=ramp, trajectories=tmp_path / "floes.nc")
    with xr.open_dataset(tmp_path / "floes.nc", decode_times=False) as data:
        np.testing.assert_allclose(data.time, np.linspace(0.0, 100.0, 21))
    assert sorted(set(ramp.times)) == [2.5 * k for k in range(41)]  # middles, and frames


def test_round_off_of_the_clock_is_no_exchange(tmp_path):
    """0.3 / 0.1 is less than 3, and 49 × (1 / 49) less than 1: neither leaves an exchange of 1e-17 s."""
    for start, duration, every in ((0.3, 0.2, 0.1), (0.0, 1.0, 1.0 / 49)):
        model = Model(BOX, Floes(500.0, 500.0, 10.0, 1.0), frictional())
        model.time = start
        run(model, duration, every=every, trajectories=tmp_path / f"{start}.nc")
        with xr.open_dataset(tmp_path / f"{start}.nc", decode_times=False) as data:
            np.testing.assert_allclose(np.diff(data.time), every, rtol=1e-9)
        assert model.time == start + duration


def test_many_exchanges_do_not_drift_from_the_clock():
    model = Model(BOX, Floes(500.0, 500.0, 10.0, 1.0), frictional())
    run(model, 10.0, exchange=0.1, every=1.0)
    assert np.cumsum(np.full(100, 0.1))[-1] != 10.0  # as a clock would that adds up
    assert model.time == 10.0


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"duration": 0.0}, "duration = 0.0: must be greater than 0"),
        ({"duration": np.nan}, "duration = nan"),
        ({"every": -1.0}, "every = -1.0"),
        ({"exchange": 7.0, "every": 10.0}, "must divide the time between frames, 10 s; 5 would"),
        ({"exchange": 20.0, "every": 10.0}, "must divide"),
        ({"atmosphere": Ramp()}, "list AirDrag among its forces"),
        ({"reference": "yesterday"}, "yesterday"),
    ],
)
def test_what_cannot_be_run_is_refused_before_a_file_is_made(tmp_path, settings, said):
    settings = {"duration": 10.0, "trajectories": tmp_path / "floes.nc"} | settings
    with pytest.raises(InputError, match=said):
        run(drifting(), **settings)
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_exists_is_not_replaced_unless_asked(tmp_path):
    path = tmp_path / "floes.nc"
    path.write_text("dear")
    with pytest.raises(InputError, match="floes.nc"):
        run(drifting(), 10.0, trajectories=path)
    assert path.read_text() == "dear"
    run(drifting(), 10.0, trajectories=path, overwrite=True)
    assert path.read_bytes() != b"dear"


def test_forcing_that_ends_too_soon_leaves_readable_frames_and_a_state_to_go_on_from(tmp_path):
    with pytest.raises(InputError, match="no data") as caught:
        run(
            drifting(), 60.0, ocean=Ramp(fails_at=40.0), exchange=10.0, every=20.0,
            trajectories=tmp_path / "floes.nc", restart=tmp_path / "restart.nc",
        )  # fmt: skip
    assert "saved in" in caught.value.__notes__[0]
    with xr.open_dataset(tmp_path / "floes.nc", decode_times=False) as data:
        assert data.time.values.tolist() == [0.0, 20.0, 40.0]
    state, _ = load_restart(tmp_path / "restart.nc")
    assert state["time"] == 40.0


def too_fast():
    floes = Floes([10.0, 29.9], [10.0, 10.0], 10.0, 1.0, u=[30.0, -30.0])
    return Model(BOX, floes, contact=frictional(), step=Step(length=1.0))


def too_explicit():
    box = Domain((0.0, 1e3), (0.0, 1e3), "periodic", "periodic", "periodic", "periodic")
    scheme = Step("taylor2", length=3600.0)
    model = Model(box, Floes(500.0, 500.0, 1.0, 1.0), forces=[OceanDrag()], step=scheme)
    model.ocean.u[:] = 2.0
    return model


def too_soft():
    floes = Floes([10.0, 29.9], [10.0, 10.0], 10.0, 1.0, u=[40.0, -40.0])
    return Model(BOX, floes, contact=frictional(youngs_modulus=2e6), step=Step(fraction=0.3))


def too_coarse():
    law = Contact(friction=Coulomb(1e3))
    limit = hexagonal_pack(6, law, Step(fraction=1.0)).longest_step()
    return hexagonal_pack(6, law, Step(length=1.1 * limit))


@pytest.mark.parametrize(
    ("start", "exchange", "said"),
    [
        (too_fast, 1.0, r"floe \d: moves \d+ of its radius in one step .* a step of .* would hold"),
        (too_explicit, 3.6e5, r"floe 0: position or velocity is no longer finite at t = \d+ s"),
        (too_soft, 1.0, r"floes 0 and 1: overlap by .* of the smaller radius at t = .* may hold"),
        (
            too_coarse,
            0.01,
            r"energy residual of .* J at t = .* 0.1 is allowed; a step of .* may hold",
        ),
    ],
)
def test_a_run_that_leaves_its_bounds_stops_with_one_line_and_its_last_good_state(
    tmp_path, start, exchange, said
):
    model = start()
    with pytest.raises(StabilityError, match=said) as caught:
        run(
            model, 1000 * exchange, exchange=exchange, every=exchange,
            trajectories=tmp_path / "floes.nc", restart=tmp_path / "restart.nc",
        )  # fmt: skip
    assert "\n" not in str(caught.value)
    assert caught.value.__notes__[0].endswith(f"is saved in {tmp_path / 'restart.nc'}")
    state, _ = load_restart(tmp_path / "restart.nc")
    again = start()
    again.restore(state)
    assert all(np.isfinite(value).all() for value in (again.floes.x, again.floes.u))
    with xr.open_dataset(tmp_path / "floes.nc", decode_times=False) as data:
        assert data.time.values[-1] == pytest.approx(state["time"], abs=1e-9)


class Interrupts(Ramp):
    """Presses Ctrl-C in the middle of a run, once or twice, or sends another signal."""

    def __init__(self, times, number=signal.SIGINT):
        super().__init__()
        self.presses, self.number = times, number

    def fill(self, t, u, v):
        super().fill(t, u, v)
        if t > 30.0 and self.presses:
            self.presses -= 1
            os.kill(os.getpid(), self.number)


STOPS = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]


@pytest.mark.parametrize("number", STOPS)
def test_a_stop_ends_a_run_after_its_exchange_with_files_and_a_state(tmp_path, number):
    model = drifting(u=0.5)
    own = signal.signal(number, signal.default_int_handler)  # the tests may be under nohup
    try:
        report = run(
            model, 1000.0, ocean=Interrupts(1, number), exchange=10.0, every=100.0,
            trajectories=tmp_path / "floes.nc", restart=tmp_path / "restart.nc",
        )  # fmt: skip
        assert signal.getsignal(number) is signal.default_int_handler
    finally:
        signal.signal(number, own)
    assert not report.finished
    assert report.end == model.time == 40.0
    with xr.open_dataset(tmp_path / "floes.nc", decode_times=False) as data:
        assert data.time.values.tolist() == [0.0, 40.0]
    assert load_restart(tmp_path / "restart.nc")[0]["time"] == 40.0


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="Windows has no SIGHUP")
def test_under_nohup_a_run_does_not_end_with_its_terminal():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        report = run(drifting(), 100.0, ocean=Interrupts(1, signal.SIGHUP), every=10.0)
    finally:
        signal.signal(signal.SIGHUP, before)
    assert report.finished


def test_a_second_ctrl_c_ends_a_run_at_once_and_still_saves_a_state(tmp_path):
    with pytest.raises(KeyboardInterrupt):
        run(
            drifting(), 1000.0, ocean=Interrupts(2), exchange=10.0, every=100.0,
            restart=tmp_path / "restart.nc",
        )  # fmt: skip
    assert load_restart(tmp_path / "restart.nc")[0]["time"] in (30.0, 40.0)


def test_a_run_works_in_a_thread_where_signals_cannot_be_caught():
    model, done = drifting(), []
    thread = threading.Thread(target=lambda: done.append(run(model, 20.0)))
    thread.start()
    thread.join()
    assert done[0].finished


def test_a_run_is_silent_unless_asked_and_the_meter_shows_time_and_speed(capsys):
    run(drifting(), 10.0)
    out, err = capsys.readouterr()
    assert (out, err) == ("", "")
    run(drifting(), 7200.0, every=1800.0, progress=True)
    err = capsys.readouterr().err
    assert "2 hours of 2 hours" in err
    assert "floe-steps/s" in err
    model = drifting()
    model.time = 86400.0
    run(model, 7200.0, every=1800.0, progress=True)
    assert "2 hours of 2 hours" in capsys.readouterr().err


def test_the_report_and_its_profile_say_what_was_done():
    report = run(drifting(u=0.5), 60.0)
    assert report.floe_steps == report.counters.floe_steps > 0
    wall = report.wall
    assert wall.total >= wall.ice > wall.steps > 0 and wall.lists > 0 and wall.exchange > 0
    assert report.shares == {}  # nobody asked
    assert report.contacts == 0
    assert "simulated in" in str(report)
    assert "ocean drag" in str(report)
    assert "neighbour-list rebuilds" in report.profile()
    energy = report.ledger.balance("energy")
    assert energy.relative < 1e-3


def test_the_report_counts_the_steps_of_its_own_run():
    model = drifting(u=0.5)
    first = run(model, 60.0)
    told = str(first), first.profile()
    second = run(model, 60.0, exchange=3.0)
    assert (str(first), first.profile()) == told  # the model goes on, the report does not
    assert second.floe_steps == second.counters.floe_steps - first.floe_steps


def test_the_speed_is_that_of_the_ice_and_the_profile_adds_up():
    wall = WallTime(forcing=1.0, ice=9.0, steps=6.0, lists=1.0, output=2.0, making=5.0, total=20.0)
    counters = Counters(
        steps=50, floe_steps=5000, rebuilds=5, pairs=10_000, tested=4000, listed=1000
    )
    shares = {"contacts": 0.5, "motion": 0.5}
    report = Report(True, 0.0, 60.0, wall, 4500, counters, None, 7, (), shares)
    assert report.speed == 500.0
    rows = {line[:28].strip(): line[28:].split() for line in report.profile().splitlines()}
    assert rows["rest"] == ["3.00", "s", "15%"]
    assert rows["compiling or loading"] == ["5.00", "s", "25%"]
    assert rows["steps"] == ["50"]
    assert rows["contacts in a step"] == rows["motion in a step"] == ["50%"]
    assert rows["neighbour list"] == ["1.00", "s", "5%"]
    assert rows["exchange"] == ["2.00", "s", "10%"]
    assert rows["contacts at the end"] == ["7"]
    assert rows["time of a floe-step"] == ["2000000.0", "ns"]
    assert rows["neighbour-list rebuilds"] == ["5", "10", "steps", "each"]
    assert rows["pairs tested in rebuilds"] == ["4000", "25%", "listed"]
    assert rows["pairs listed, in all steps"] == ["10000", "2.00", "per", "floe-step"]


def test_a_scene_without_floes_runs_and_writes_files(tmp_path):
    model = Model(BOX, Floes([], [], [], []), forces=[OceanDrag()])
    run(model, 10.0, gridded=tmp_path / "grid.nc", trajectories=tmp_path / "floes.nc")
    with xr.open_dataset(tmp_path / "floes.nc", decode_times=False) as data:
        assert data.sizes["trajectory"] == 0


def test_durations_are_told_in_a_unit_that_suits_them():
    told = [duration_text(seconds) for seconds in (0.5, 90.0, 300.0, 7200.0, 864000.0)]
    assert told == ["0.5 s", "90 s", "5 minutes", "2 hours", "10 days"]


def test_forcing_made_for_other_cells_is_refused_though_they_are_as_many():
    model = drifting()
    for x, y in (((0.0, 2000.0), (0.0, 1000.0)), ((0.0, 1000.0), (0.0, 2000.0))):
        other = Grid.uniform(x, y, shape=(10, 10))
        assert other.size == model.ocean.grid.size
        with pytest.raises(
            InputError, match="^Function: fills the cells of .* 2000 m.*the model's"
        ):
            run(model, 10.0, Function(lambda x, y, t: 1e-4 * x, 0.0, other))
    assert model.time == 0.0
    assert (model.ocean.u == 0).all()


def test_what_is_no_model_or_no_forcing_is_refused_in_one_line():
    with pytest.raises(InputError, match="^run: model = None: must be a Model$"):
        run(None, 10.0)
    for wrong in (1.0, (0.1, 0.0), "u.nc", np.zeros(100)):
        with pytest.raises(InputError, match="^run: ocean = .*: must be a Constant, Function"):
            run(drifting(), 10.0, wrong)
    with pytest.raises(InputError, match="^grid = None: must be a Grid$"):
        Function(0.1, 0.0, None)


# ---- the meter --------------------------------------------------------------------------------


class Full:
    """An error stream whose disk is full."""

    encoding = "utf-8"
    closed = False

    def write(self, text):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    flush = isatty = lambda self: self.write("")


@pytest.mark.parametrize("stream", [Full(), None], ids=["full", "none"])
@pytest.mark.parametrize("progress", [True, False])
def test_a_run_does_not_end_for_want_of_an_error_stream(monkeypatch, stream, progress):
    monkeypatch.setattr(Full, "isatty", lambda self: False)
    monkeypatch.setattr(sys, "stderr", stream)
    assert run(drifting(), 10.0, every=1.0, progress=progress).finished


@pytest.mark.parametrize("progress", [True, False])
def test_a_run_leaves_no_thread_behind(progress):
    before = threading.active_count()
    run(drifting(), 10.0, every=1.0, progress=progress)
    assert threading.active_count() == before
