"""Runs of a model: forcing, advance, output, repeated, with a progress meter.

A run does what a host model would do with the component: fill the fluids' arrays, advance by one exchange
interval, read the result.  The forcing of an interval is that at its middle.  Whatever ends a run
early (Ctrl-C, an unstable step, forcing that ends too soon, a full disk), the frames written so far are
readable, and the state at the last exchange is saved if a restart file was named.
"""

import contextlib
import dataclasses
import signal
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np

from floebmi.alone import alone, refuse_another
from floebmi.errors import InputError, in_line
from floebmi.making import Making, work_clock
from floebmi.meter import meter
from floebmi.quantities import check_flag, check_table, is_number

if TYPE_CHECKING:
    from floebmi.budgets import Ledger
    from floebmi.fluid import Fluid
    from floebmi.forcing import VelocitySource
    from floebmi.model import Model
    from floebmi.output import GriddedWriter, TrajectoryWriter
    from floebmi.state import Counters

DAY = 86400.0
SAVED_EVERY = 60.0  # wall-clock time between states saved during a run [s]


class WallTime(NamedTuple):
    """Wall-clock time of the parts of a run [s].

    forcing, ice, output : filling the fluids; advancing the ice; writing files
    steps, lists : the parts of `ice` for time steps, and for neighbour lists with the limit on the step
    making : compiling kernels, or loading compiled ones; not included in the others
    total : everything
    """

    forcing: float
    ice: float
    steps: float
    lists: float
    output: float
    making: float
    total: float

    @property
    def exchange(self) -> float:
        """The rest of `ice` [s]: areas and weights, exchange with the fluids, first forces, ledger."""
        return self.ice - self.steps - self.lists


class Report(NamedTuple):
    """The result of a run.

    Attributes
    ----------
    finished : False if it was stopped before its end
    start, end : simulated time [s]
    wall : wall-clock time, by part of the run
    floe_steps : steps of all floes in this run
    counters : of the model, since its start, at the end of this run
    ledger : mass, momentum and energy of the ice, likewise
    contacts : number of pairs of floes in contact or bonded at the end
    files : files written
    shares : of contacts, other forces and motion in the time of a step at the end [1], if a profile was requested
    """

    finished: bool
    start: float
    end: float
    wall: WallTime
    floe_steps: int
    counters: "Counters"
    ledger: "Ledger"
    contacts: int
    files: tuple[Path, ...]
    shares: Mapping[str, float] = {}

    @property
    def speed(self) -> float:
        """Floe-steps per second of advancing the ice."""
        return _ratio(self.floe_steps, self.wall.ice)

    def __str__(self) -> str:
        return (
            f"{duration_text(self.end - self.start)} simulated in {self.wall.total:.1f} s: "
            f"{self.counters.steps} steps since the start, "
            f"{self.counters.shortest_step:.3g} to {self.counters.longest_step:.3g} s long; "
            f"{self.speed / 1e6:.3g} million floe-steps/s\n{self.ledger}"
        )

    def profile(self) -> str:
        """A table of the time spent, and of the counters."""
        c, wall = self.counters, self.wall
        rest = wall.total - wall.forcing - wall.ice - wall.output - wall.making
        per_floe_step = _ratio(1e9, self.speed)
        rows = [
            (name, f"{seconds:.2f} s", f"{seconds / wall.total:.0%}")
            for name, seconds in (
                ("forcing", wall.forcing),
                ("ice", wall.ice),
                ("  steps", wall.steps),
                ("  neighbour list", wall.lists),
                ("  exchange", wall.exchange),
                ("output", wall.output),
                ("compiling or loading", wall.making),
                ("rest", rest),
            )
        ]  # fmt: skip
        rows += [
            ("time of a floe-step", f"{per_floe_step:.1f} ns", ""),
            *((f"  {name} in a step", f"{share:.0%}", "") for name, share in self.shares.items()),
            ("steps", f"{c.steps}", ""),
            ("floe-steps", f"{c.floe_steps}", ""),
            ("neighbour-list rebuilds", f"{c.rebuilds}", f"{_ratio(c.steps, c.rebuilds):.0f} steps each"),
            ("pairs tested in rebuilds", f"{c.tested}", f"{_ratio(c.listed, c.tested):.0%} listed"),
            ("pairs listed, in all steps", f"{c.pairs}", f"{_ratio(c.pairs, c.floe_steps):.2f} per floe-step"),
            ("contacts at the end", f"{self.contacts}", ""),
            ("bonds broken", f"{c.bonds_broken}", ""),
        ]  # fmt: skip
        return "\n".join(f"{name:<28}{value:>16}  {share}".rstrip() for name, value, share in rows)


def _ratio(a: float, b: float) -> float:
    return a / b if b else 0.0


def run(
    model: "Model",
    duration: float,
    ocean: "VelocitySource | None" = None,
    atmosphere: "VelocitySource | None" = None,
    *,
    exchange: float | None = None,
    every: float | None = None,
    gridded: str | Path | None = None,
    trajectories: str | Path | None = None,
    restart: str | Path | None = None,
    attributes: Mapping[str, Any] | None = None,
    reference: str | None = None,
    calendar: str = "standard",
    projection: str | None = None,
    land: Sequence[np.ndarray] = (),
    overwrite: bool = False,
    progress: bool = False,
    profile: bool = False,
) -> Report:
    """Run a model for some time under some forcing.

    Parameters
    ----------
    model : continues from its present state
    duration : length of the run [s]
    ocean, atmosphere : sources of the velocities of the ocean and of the wind (`forcing.Constant`,
        `forcing.Function`, `forcing.VelocityFile`); if omitted, the arrays of `model.ocean` and
        `model.atmosphere` stay as they are
    exchange : time between exchanges of momentum with the fluids [s]; default: `every`
    every : time between frames [s]; default: a twentieth of the duration
    gridded, trajectories : NetCDF files to make, see `output`
    restart : file for the state at the end, or at the last exchange of a run that was cut short; also saved
        with a frame once a minute, in case the run is killed. If it does not exist, it is made at the start, so that no
        other run takes its name meanwhile
    attributes, reference, calendar, projection, land : see `output.GriddedWriter`
    overwrite : whether files may be replaced
    progress : show a meter
    profile : measure the shares of contacts, drag and motion in a step at the end of the run, for `Report.profile`; takes
        about a second more, and leaves the model unchanged

    Returns
    -------
    Report : also when Ctrl-C, SIGTERM or SIGHUP stopped the run, then `finished` is False

    Raises
    ------
    InputError
        for an invalid duration or interval, a file that exists or is named twice, forcing that does not cover the run
        or was made for other cells, and while another thread works on the model.
    StabilityError
        if the step no longer resolves the motion of the floes.

    Examples
    --------
    >>> from floebmi import Domain, Floes, Model
    >>> model = Model(Domain((0.0, 100.0), (0.0, 100.0)), Floes(50.0, 50.0, 10.0, 1.0, u=0.5))
    >>> report = run(model, 20.0)
    >>> model.floes.x
    array([60.])
    """
    from floebmi.clock import text_of
    from floebmi.files import check_target
    from floebmi.model import Model
    from floebmi.restarts import save_restart
    from floebmi.timing import shares_of_a_step

    if not isinstance(model, Model):
        raise InputError(f"run: model = {in_line(model)}: must be a Model")
    refuse_another(model, "run")
    for name, flag in (("overwrite", overwrite), ("progress", progress), ("profile", profile)):
        check_flag(name, flag)
    check_table("attributes", attributes)
    total = _positive("duration", duration)
    every = _positive("every", total / 20 if every is None else every)
    exchange = every if exchange is None else _positive("exchange", exchange)
    exchanges = check_intervals(every, exchange)
    start, end, before = model.time, model.time + total, model.counters.floe_steps
    _check_sources(model, {"ocean": ocean, "atmosphere": atmosphere}, start, end)
    drive = Forcing(model, ocean, atmosphere)
    clock = _Stopwatch()
    files = _files_of({"gridded": gridded, "trajectories": trajectories, "restart": restart})
    restart = files.get("restart")
    if restart is not None:
        check_target(restart, overwrite)
    claim = restart is not None and not restart.exists()
    state, saved_at = model.state(), time.monotonic()
    of_state = dict(attributes or {})
    if reference is not None:
        of_state |= {"start": text_of(reference), "calendar": calendar}
    how = {
        "attributes": attributes, "reference": reference, "calendar": calendar,
        "projection": projection, "land": land, "overwrite": overwrite,
    }  # fmt: skip
    with contextlib.ExitStack() as stack:
        stack.enter_context(alone(model, "run"))
        interrupts = stack.enter_context(_gentle_interrupt())
        writers = _writers(stack, model, files, how)
        shown = stack.enter_context(_Meter(model, total, progress))
        if claim:
            with clock.of("output"):
                save_restart(restart, state, of_state, overwrite=False)
        try:
            with clock.of("output"):
                _write(writers, model)
            for k, target in _exchange_ends(start, end, exchange):
                with clock.of("forcing"):
                    drive.fill(0.5 * (model.time + target))
                with clock.of_ice(model):
                    model.advance(target - model.time)
                model.time = target  # a sum of many intervals would accumulate rounding errors
                state = model.state()
                if k % exchanges == 0 or target == end or interrupts:
                    with clock.of("output"):
                        drive.fill(model.time)
                        _write(writers, model)
                        if restart is not None and time.monotonic() - saved_at >= SAVED_EVERY:
                            save_restart(restart, state, of_state)
                            saved_at = time.monotonic()
                shown.update(model)
                if interrupts:
                    break
        except BaseException as error:
            # a run without progress does not replace the state of an earlier one
            if restart is not None and (state["time"] > start or claim or not restart.exists()):
                _save(restart, state, of_state, error)
            raise
    if restart is not None:
        with clock.of("output"):
            save_restart(restart, state, of_state)
    wall = clock.wall_time()
    return Report(
        model.time == end, start, model.time, wall, model.counters.floe_steps - before,
        dataclasses.replace(model.counters), model.ledger.copy(), len(model.contacts().i), tuple(files.values()),
        shares_of_a_step(model) if profile else {},
    )  # fmt: skip


def _exchange_ends(start: float, end: float, exchange: float) -> Iterator[tuple[int, float]]:
    """Number and end [s] of each exchange: multiples of `exchange`, whenever the run starts, and the end of the run."""
    k, now = int(start / exchange * (1 + 1e-12)), start
    while now < end:
        k += 1
        target = min(k * exchange, end)
        if end - target < 1e-9 * exchange:
            target = end
        if target > now:
            yield k, target
            now = target


def _check_sources(
    model: "Model", sources: "Mapping[str, VelocitySource | None]", start: float, end: float
) -> None:
    """InputError for a source that cannot fill its fluid from `start` to `end` [s]; leaves the fluids as at the start."""
    given = {name: source for name, source in sources.items() if source is not None}
    for name, source in given.items():
        if not (hasattr(source, "fill") and hasattr(source, "span")):
            raise InputError(
                f"run: {name} = {in_line(source)}: must be a Constant, Function, VelocityFile or the like"
            )
        if getattr(model, name) is None:
            law = "OceanDrag" if name == "ocean" else "AirDrag"
            raise InputError(f"{name}: the model has none to force; list {law} among its forces")
    for name, source in given.items():
        check_forcing(source, getattr(model, name), start, end)


def _files_of(named: Mapping[str, str | Path | None]) -> dict[str, Path]:
    """The files given under these names; InputError for one that is given twice."""
    from floebmi.files import path_of

    files = {name: path_of(name, path) for name, path in named.items() if path is not None}
    places = [path.resolve() for path in files.values()]
    for k, path in enumerate(files.values()):
        if places[k] in places[:k]:
            raise InputError(
                f"run: {path}: is named twice; gridded, trajectories and restart must be files of their own"
            )
    return files


def check_forcing(source: "VelocitySource", fluid: "Fluid", start: float, end: float) -> None:
    """InputError if forcing does not fit, or does not reach from `start` to `end` [s].

    A source with a `grid` must fill the cells of the fluid; the same number of cells elsewhere would go unnoticed.
    Leaves the velocity of the fluid as at the start.
    """
    grid = getattr(source, "grid", None)
    if grid is not None and not (
        np.array_equal(grid.x, fluid.grid.x) and np.array_equal(grid.y, fluid.grid.y)
    ):
        raise InputError(
            f"{type(source).__name__}: fills the cells of {grid!r}, the model's are those of {fluid.grid!r}: "
            "make it with the model's grid"
        )
    if source.span is not None:
        source.fill(end, fluid.u, fluid.v)
    source.fill(start, fluid.u, fluid.v)


def check_intervals(every: float, exchange: float, where: str = "exchange") -> int:
    """Exchanges per frame; InputError if the one interval does not divide the other."""
    times = every / exchange
    if not np.isfinite(times):
        raise InputError(f"{where} = {exchange:g} s: must be longer, for frames {every:g} s apart")
    if round(times) < 1 or abs(times - round(times)) > 1e-9 * times:
        fitting = every / max(1, np.ceil(times))
        raise InputError(
            f"{where} = {exchange:g}: must divide the time between frames, {every:g} s; "
            f"{fitting:g} would"
        )
    return round(times)


def duration_text(seconds: float) -> str:
    """A duration in a suitable unit."""
    for unit, size in (("days", DAY), ("hours", 3600.0), ("minutes", 60.0)):
        if seconds >= 2 * size:
            return f"{seconds / size:.4g} {unit}"
    return f"{seconds:.4g} s"


def _positive(name: str, value: float) -> float:
    if not (is_number(value) and value > 0):
        raise InputError(f"run: {name} = {value!r}: must be greater than 0 s")
    return float(value)


def _save(path: Path, state: Mapping[str, Any], attributes: Any, error: BaseException) -> None:
    """Save the last valid state, and add a note about it to the error that ended the run."""
    from floebmi.restarts import save_restart

    try:
        save_restart(path, state, attributes)
    except (OSError, InputError) as failure:
        error.add_note(f"the state at t = {state['time']:g} s could not be saved: {failure}")
    else:
        error.add_note(f"the state at t = {state['time']:g} s is saved in {path}")


class Forcing:
    """Sources that fill the velocities of those fluids of a model that have one."""

    def __init__(
        self, model: "Model", ocean: "VelocitySource | None", atmosphere: "VelocitySource | None"
    ) -> None:
        pairs = ((ocean, model.ocean), (atmosphere, model.atmosphere))
        self._pairs = [
            (source, fluid) for source, fluid in pairs if source is not None and fluid is not None
        ]

    def fill(self, t: float) -> None:
        """Fill the velocities with those at time t [s]."""
        for source, fluid in self._pairs:
            source.fill(t, fluid.u, fluid.v)


def _writers(
    stack: contextlib.ExitStack, model: "Model", files: Mapping[str, Path], how: Mapping[str, Any]
) -> "list[GriddedWriter | TrajectoryWriter]":
    """The writers of the files of a run, closed with the stack; how : see `output.GriddedWriter`."""
    from floebmi.output import GriddedWriter, TrajectoryWriter

    kinds = {"gridded": GriddedWriter, "trajectories": TrajectoryWriter}
    return [
        stack.enter_context(writer(files[name], model, **how))
        for name, writer in kinds.items()
        if name in files
    ]


def _write(writers: "list[GriddedWriter | TrajectoryWriter]", model: "Model") -> None:
    """Write a frame into each file."""
    for writer in writers:
        writer.write(model)


class _Stopwatch:
    """Wall-clock time of a run, by part."""

    def __init__(self) -> None:
        self._begin, self._made = time.perf_counter(), Making.clock
        self._spent = {"forcing": 0.0, "ice": 0.0, "steps": 0.0, "lists": 0.0, "output": 0.0}

    @contextlib.contextmanager
    def of(self, what: str) -> Iterator[None]:
        begin = work_clock()
        yield
        self._spent[what] += work_clock() - begin

    @contextlib.contextmanager
    def of_ice(self, model: "Model") -> Iterator[None]:
        before = dataclasses.replace(model.seconds)
        with self.of("ice"):
            yield
        self._spent["steps"] += model.seconds.steps - before.steps
        self._spent["lists"] += model.seconds.lists - before.lists

    def wall_time(self) -> WallTime:
        total = time.perf_counter() - self._begin
        return WallTime(**self._spent, making=Making.clock - self._made, total=total)


@contextlib.contextmanager
def _gentle_interrupt() -> Iterator[list[int]]:
    """Let Ctrl-C, SIGTERM and SIGHUP stop a run after the present exchange; a second one stops it at once.

    Yields the list of the signals received so far.
    """
    came: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield came  # only the main thread handles signals
        return

    def ask(number: int, frame: object) -> None:
        if came:
            raise KeyboardInterrupt
        came.append(number)

    numbers = [signal.SIGINT, signal.SIGTERM]
    # Windows has no SIGHUP, and nohup ignores it
    if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:
        numbers.append(signal.SIGHUP)
    before = {number: signal.signal(number, ask) for number in numbers}
    try:
        yield came
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class _Meter:
    """Progress meter: simulated time, floe-steps per second, simulated days per wall-clock hour, time left."""

    def __init__(self, model: "Model", total: float, show: bool) -> None:
        self._start, self._total = model.time, total
        self._last: tuple[float, float, int] | None = None
        self._bar = None
        if show:
            self._bar = meter(
                total=total,
                desc="first step: compiling if need be",
                bar_format="{desc} {percentage:3.0f}%|{bar}| {elapsed} (left {remaining}){postfix}",
                dynamic_ncols=True,
            )

    def update(self, model: "Model") -> None:
        if self._bar is None:
            return
        now = (time.perf_counter(), model.time, model.counters.floe_steps)
        if self._last is not None and now[0] > self._last[0]:
            clock, simulated, steps = (b - a for a, b in zip(self._last, now, strict=True))
            self._bar.set_postfix_str(
                f"{steps / clock / 1e6:.3g} M floe-steps/s, {simulated / clock / 24:.3g} days/h",
                refresh=False,
            )
        if self._last is None or now[0] - self._last[0] > 0.5:
            self._last = now
        done = model.time - self._start
        self._bar.set_description_str(
            f"{duration_text(done)} of {duration_text(self._total)}", refresh=False
        )
        self._bar.update(done - self._bar.n)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        if self._bar is not None:
            self._bar.close()
