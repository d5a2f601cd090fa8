"""Ensembles: a function of (parameters, seed), run for every point of a parameter sweep and every seed.

A member is a call of a function `member(parameters, seed) → {name: array}` that a worker process can import.  Members run
in local processes, on any `concurrent.futures` executor, or on a `dask.distributed` Client.  Each finished member is
saved in a folder at once, as a whole, and not run again; a failed member is reported in one line, and its
values stay missing.  `gather` makes one data set of all members, with a dimension for each swept
parameter and one for the seeds.

    sweep = {"friction": (0.1, 0.3), "width": (5e3, 6e3)}
    done = run(member, {"hours": 24.0}, sweep, range(20), "strait.members")
    gather(done, {"jam_time": Output((), "s", "time of jamming")})
"""

import itertools
import json
import multiprocessing
import os
import signal
import threading
import warnings
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from floebmi import __version__
from floebmi.errors import InputError, in_line, warn
from floebmi.files import attributes_of, check_new_folder, check_target, in_one_go, path_of
from floebmi.meter import meter, say
from floebmi.quantities import check_flag, check_table

if TYPE_CHECKING:
    import distributed
    import xarray as xr

Member = Callable[[Mapping[str, Any], int], Mapping[str, np.ndarray]]
Key = tuple[int, int]  # of a member: its place in the sweep, and among the seeds
Arguments = Callable[[Key], tuple[Member, dict[str, Any], int]]  # of the call of a member
Keep = Callable[[Key, Mapping[str, np.ndarray] | Exception], None]
THREADS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


class Output(NamedTuple):
    """An array that a member returns: its own dimensions, its units, and its meaning."""

    dims: tuple[str, ...]
    units: str
    long_name: str


class Failure(NamedTuple):
    """A member that failed: its point in the sweep, its seed, and the reason in one line."""

    point: dict[str, Any]
    seed: int
    reason: str

    def __str__(self) -> str:
        return f"{_words(self.point, self.seed)}: {self.reason}"


class Ensemble(NamedTuple):
    """The finished members, by (index of the point in the sweep, index of the seed), and those that failed."""

    parameters: dict[str, Any]
    sweep: dict[str, tuple[Any, ...]]
    seeds: tuple[int, ...]
    members: dict[Key, dict[str, np.ndarray]]
    failures: list[Failure]

    def points(self) -> list[dict[str, Any]]:
        """All points of the sweep; the last parameter varies fastest."""
        return points_of(self.sweep)


def run(
    member: Member,
    parameters: Mapping[str, Any],
    sweep: Mapping[str, Sequence[Any]],
    seeds: Sequence[int],
    folder: str | Path,
    *,
    jobs: int | None = None,
    on: "Executor | distributed.Client | None" = None,
    code: Callable[[Mapping[str, Any]], object] | None = None,
    progress: bool = False,
) -> Ensemble:
    """Run all members that have not finished yet.

    Parameters
    ----------
    member : function of (parameters, seed) that returns arrays; importable by name
    parameters : parameters that all members share
    sweep : values of each swept parameter; members are run for all combinations
    seeds : seeds of the members, integers
    folder : folder for finished members, one file each
    jobs : number of local processes; default: the number of cores that this process may use; with 1 they run in this process
    on : an executor, or a Client of `dask.distributed`, to run the members on instead
    code : function of a member's parameters whose value is equal for members with the same machine code; the first member
        of each runs before the others start, so that numba compiles once rather than once per process
    progress : show a progress bar

    Raises
    ------
    InputError
        if the folder holds members with other parameters or of another function, if two members would have the same
        file name, and for fewer than one job.
    """
    folder = path_of("folder", folder)
    _check(member, parameters, sweep, seeds, jobs, on, code)
    check_flag("progress", progress)
    sweep = {name: tuple(values) for name, values in sweep.items()}
    seeds = tuple(seeds)
    points = points_of(sweep)
    files = _files(folder, points, seeds)
    _claim(folder, member, parameters)
    done = Ensemble(dict(parameters), sweep, seeds, {}, [])
    done.members.update({key: _load(path) for key, path in files.items() if path.exists()})
    left = [key for key in files if key not in done.members]

    def arguments(key: Key) -> tuple[Member, dict[str, Any], int]:
        return member, {**parameters, **points[key[0]]}, seeds[key[1]]

    with _bar(len(files), len(done.members), progress) as bar:

        def keep(key: Key, result: Mapping[str, np.ndarray] | Exception) -> None:
            if isinstance(result, Exception):
                failure = Failure(points[key[0]], seeds[key[1]], _reason(result))
                done.failures.append(failure)
                bar.write(f"member failed: {failure}")
            else:
                arrays = {name: np.asarray(value) for name, value in result.items()}
                _store(files[key], arrays)
                done.members[key] = arrays
            bar.update()

        try:
            if on is None and (jobs or cores()) == 1:
                for key in left:
                    keep(key, _attempt(*arguments(key))[0])
            elif left:
                for some in _in_waves(left, lambda key: code and code(arguments(key)[1])):
                    _spread(some, arguments, keep, jobs or cores(), on)
        except KeyboardInterrupt as error:
            error.add_note(
                f"{len(done.members)} of {len(files)} members are finished, and will not be run again"
            )
            raise
    return done


def _check(
    member: object,
    parameters: object,
    sweep: Any,
    seeds: object,
    jobs: object,
    on: object,
    code: object,
) -> None:
    """InputError for an argument that `run` cannot use."""
    for name, table in (("parameters", parameters), ("sweep", sweep)):
        if table is None:
            raise InputError(f"{name} = None: must be a dict")
        check_table(name, table)
    for name, function in (("member", member), ("code", code)):
        if not callable(function) and (name == "member" or function is not None):
            raise InputError(f"{name} = {in_line(function)}: must be a function")
    if not (on is None or isinstance(on, Executor) or hasattr(on, "get_executor")):
        raise InputError(
            f"on = {in_line(on)}: must be an executor, or a Client of dask.distributed"
        )
    if jobs is not None and not (isinstance(jobs, Integral) and jobs >= 1):
        raise InputError(f"jobs = {jobs!r}: must be a whole number, at least 1")
    for name, values in {**sweep, "seeds": seeds}.items():
        if name == "seed" or isinstance(values, str) or not np.iterable(values):
            raise InputError(
                f"{name} = {values!r}: must be several values, as (1, 2), under a name that is not seed"
            )


def gather(
    done: Ensemble,
    outputs: Mapping[str, Output],
    coordinates: Mapping[str, Output] | None = None,
    units: Mapping[str, tuple[str, str]] | None = None,
) -> "xr.Dataset":
    """One data set of all members, with dimensions (swept parameters …, seed, own dimensions …).

    Parameters
    ----------
    outputs : the arrays to include; values of members that did not finish are NaN
    coordinates : arrays that are equal for all members, such as times; taken from one of them
    units : unit and meaning of each parameter, for the attributes

    Raises
    ------
    InputError
        if no member has finished, or if an array is missing or differs in shape between members.
    """
    import xarray as xr

    if not isinstance(done, Ensemble):
        raise InputError(f"done = {in_line(done)}: must be what `run` returns")
    for name, table, parts in (
        ("outputs", outputs, Output._fields),
        ("coordinates", coordinates, Output._fields),
        ("units", units, ("units", "long_name")),
    ):
        check_table(name, table)
        for key, row in (table or {}).items():
            if not (isinstance(row, tuple) and len(row) == len(parts)):
                raise InputError(f"{name}[{key!r}] = {in_line(row)}: must be ({', '.join(parts)})")
    if outputs is None:
        raise InputError("outputs = None: must be a dict")
    if not done.members:
        first = f": {done.failures[0]}" if done.failures else ""
        raise InputError(f"ensemble: no member has finished{first}")
    one = next(iter(done.members.values()))
    points = done.points()
    dims = (*done.sweep, "seed")
    shape = tuple(len(values) for values in done.sweep.values()) + (len(done.seeds),)
    data = xr.Dataset(
        coords={**{k: list(v) for k, v in done.sweep.items()}, "seed": list(done.seeds)}
    )
    for name in done.sweep:
        unit, meaning = (units or {}).get(name, ("", ""))
        data[name].attrs = _described(unit, meaning)
    data["seed"].attrs = _described("1", "seed of the random numbers")
    coordinates = coordinates or {}
    for name in {**outputs, **coordinates}:
        for (p, s), arrays in done.members.items():
            which = _words(points[p], done.seeds[s])
            if name not in arrays:
                raise InputError(f"{name}: {which} has none, only {', '.join(arrays)}")
            if arrays[name].shape != one[name].shape:
                raise InputError(
                    f"{name}: {which} has the shape {arrays[name].shape}, another member {one[name].shape}; must be one shape"
                )
            if name in coordinates and not np.array_equal(arrays[name], one[name]):
                raise InputError(
                    f"{name}: {which} has others than another member; must be an output"
                )
    for name, (own, unit, meaning) in coordinates.items():
        data.coords[name] = own, one[name], _described(unit, meaning)
    for name, (own, unit, meaning) in outputs.items():
        values = np.full((len(points), len(done.seeds), *one[name].shape), np.nan)
        for (p, s), arrays in done.members.items():
            values[p, s] = arrays[name]
        values = values.reshape(*shape, *one[name].shape)
        data[name] = (*dims, *own), values, _described(unit, meaning)
    return data


def save(data: "xr.Dataset", path: str | Path) -> None:
    """Write a data set as NetCDF, completely or not at all; the file states its `title` and when it was made."""
    import xarray as xr

    if not isinstance(data, xr.Dataset):
        raise InputError(f"data = {in_line(data)}: must be what `gather` returns")
    data = data.assign_attrs(attributes_of("an ensemble of runs") | data.attrs)
    path = path_of("path", path)
    check_target(path, overwrite=True)
    # CF has no missing values in coordinates; xarray would declare one for each of floats
    encoding = {name: {"_FillValue": None} for name in data.coords}
    with in_one_go(path) as part:
        data.to_netcdf(part, engine="netcdf4", encoding=encoding)


def _described(unit: str, meaning: str) -> dict[str, str]:
    return {key: text for key, text in (("units", unit), ("long_name", meaning)) if text}


# ---- the folder of finished members -----------------------------------------------------------


def points_of(sweep: Mapping[str, Sequence[Any]]) -> list[dict[str, Any]]:
    """All combinations of the values of a sweep; the last parameter varies fastest."""
    return [dict(zip(sweep, values, strict=True)) for values in itertools.product(*sweep.values())]


def _words(point: Mapping[str, Any], seed: int) -> str:
    return ",".join([f"{name}={value:.12g}" if isinstance(value, float) else f"{name}={value}"
                     for name, value in point.items()] + [f"seed={seed}"])  # fmt: skip


def _files(
    folder: Path, points: Sequence[Mapping[str, Any]], seeds: Sequence[int]
) -> dict[Key, Path]:
    """The file of each member; InputError if two members would have the same file."""
    files = {
        (p, s): folder / f"{_words(point, seed).replace('/', '%2F')}.npz"  # a value may be a path
        for p, point in enumerate(points)
        for s, seed in enumerate(seeds)
    }
    twice = [path for path, times in Counter(files.values()).items() if times > 1]
    if twice:
        raise InputError(
            f"ensemble: several members are {twice[0].stem}: values and seeds must differ, numbers in their first 12 digits"
        )
    return files


def _claim(folder: Path, member: Member, parameters: Mapping[str, Any]) -> None:
    """Record the common parameters of a folder's members; refuse a folder whose members have others."""
    check_new_folder(folder)
    note = folder / "ensemble.json"
    ours = {
        "floebmi": __version__,
        "member": f"{member.__module__}.{member.__qualname__}",
        "parameters": dict(parameters),
    }
    try:
        text = json.dumps(ours, indent=1)
    except TypeError as error:
        raise InputError(
            f"parameters = {dict(parameters)}: must be numbers, texts, and lists of these ({error})"
        ) from None
    if note.exists():
        try:
            theirs = json.loads(note.read_text(encoding="utf-8"))
        except ValueError:
            raise InputError(f"{note}: is damaged; remove the folder, or give another") from None
        differ = [
            f"{name} = {theirs['parameters'].get(name)!r} there, {parameters.get(name)!r} here"
            for name in sorted({*theirs["parameters"], *parameters})
            if theirs["parameters"].get(name) != json.loads(json.dumps(parameters.get(name)))
        ]
        differ += [f"{key} {theirs[key]} there" for key in ours if key != "parameters" and theirs[key] != ours[key]]  # fmt: skip
        if differ:
            raise InputError(
                f"{folder}: holds members of another ensemble ({'; '.join(differ)}); "
                "give another place, or remove the folder"
            )
        return
    if folder.exists() and any(folder.iterdir()):
        raise InputError(
            f"{folder}: exists, and is not the folder of an ensemble; give another place"
        )
    folder.mkdir(parents=True, exist_ok=True)
    with in_one_go(note) as part:
        part.write_text(text, encoding="utf-8")


def _store(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    with in_one_go(path) as part, part.open("wb") as file:
        np.savez(file, **arrays)


def _load(path: Path) -> dict[str, np.ndarray]:
    try:
        with np.load(path) as arrays:
            return dict(arrays)
    except (OSError, EOFError, ValueError, zipfile.BadZipFile):
        raise InputError(f"{path}: not a finished member; remove it to run it again") from None


# ---- processes --------------------------------------------------------------------------------


def cores() -> int:
    """Number of processor cores that this process may use, at least 1; the default number of jobs."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


_heard: list[Warning] = []  # in a worker: warnings that have not been reported yet


def _start_worker() -> None:
    """Prepare a worker: one thread, with interrupts and warnings left to the parent process.

    A worker ends when its parent process is gone, even if that was killed.
    """
    threading.Thread(target=_end_with_parent, daemon=True).start()
    for name in THREADS:
        os.environ[name] = "1"
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    warnings.simplefilter("default", UserWarning)
    warnings.showwarning = lambda message, *place: _heard.append(message)


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _attempt(
    member: Member, parameters: dict[str, Any], seed: int
) -> tuple[Mapping[str, np.ndarray] | Exception, list[Warning]]:
    """Run a member; returns its result or its exception, and the warnings of the worker."""
    try:
        result = member(parameters, seed)
        if not isinstance(result, Mapping):
            raise InputError(f"it returned {type(result).__name__}, must be a dict of arrays")
    except Exception as error:  # noqa: BLE001  whatever it is, the others go on
        result = error
    heard = _heard[:]
    _heard.clear()
    return result, heard


def _reason(error: Exception) -> str:
    """Why a member failed, in one line; only of wrong input the text alone says it."""
    text = " ".join(str(error).split()) or type(error).__name__
    return text if type(error) is InputError else f"{type(error).__name__}: {text}"


def _in_waves(keys: Sequence[Key], code: Callable[[Key], object]) -> Iterator[list[Key]]:
    """Run one member for each compiled code first, then all others."""
    first: dict[object, Key] = {}
    for key in keys:
        first.setdefault(code(key), key)
    pioneers = list(first.values())
    yield pioneers
    yield [key for key in keys if key not in pioneers]


def _spread(
    keys: list[Key],
    arguments: Arguments,
    keep: Keep,
    jobs: int,
    on: "Executor | distributed.Client | None",
) -> None:
    """Run members on an executor, and save each as it finishes."""
    if on is not None:
        executor = on if isinstance(on, Executor) else on.get_executor()
        _collect(executor, keys, arguments, keep)
        return
    lost = _in_a_pool(keys, arguments, keep, jobs)
    for key in lost:  # a process died, and with it other members: run each of them separately now
        for _ in _in_a_pool([key], arguments, keep, 1):
            keep(key, RuntimeError("the process ended without a word (out of memory?)"))


def _in_a_pool(
    keys: list[Key],
    arguments: Arguments,
    keep: Keep,
    jobs: int,
) -> list[Key]:
    """Run members in processes of their own; returns those that were lost with their process."""
    context = multiprocessing.get_context("spawn")
    workers = min(jobs, len(keys)) or 1
    others = set(multiprocessing.active_children())
    with ProcessPoolExecutor(workers, context, _start_worker) as pool:
        try:
            return _collect(pool, keys, arguments, keep)
        except KeyboardInterrupt:  # unfinished members would not be kept
            for worker in set(multiprocessing.active_children()) - others:
                worker.terminate()
            raise


def _collect(
    executor: Executor,
    keys: list[Key],
    arguments: Arguments,
    keep: Keep,
) -> list[Key]:
    """Run members on an executor; returns those that were lost with their process."""
    futures = {executor.submit(_attempt, *arguments(key)): key for key in keys}
    lost = []
    try:
        for future in as_completed(futures):
            heard: list[Warning] = []
            try:
                result, heard = future.result()
            except BrokenProcessPool:
                lost.append(futures[future])
                continue
            except Exception as error:  # noqa: BLE001  of the executor, such as a worker that was lost
                result = error
            for warning in heard:
                try:
                    warn(warning)
                except Warning as error:  # python -W error; here it would end all members
                    result = error
            keep(futures[future], result)
    except KeyboardInterrupt:
        for future in futures:
            future.cancel()
        raise
    return lost


class _Quiet:
    """A progress bar that shows nothing but failures."""

    def __enter__(self) -> "_Quiet":
        return self

    def __exit__(self, *problem: object) -> None:
        pass

    def update(self) -> None:
        pass

    def write(self, text: str) -> None:
        try:
            warn(text)
        except UserWarning:  # python -W error; the other members go on all the same
            say(text)


def _bar(total: int, initial: int, progress: bool) -> Any:
    if not progress:
        return _Quiet()
    return meter(total=total, initial=initial, unit=" members")
