"""Files of a run: fields on the grid and trajectories of floes; restart files are in restarts.py.

Both are CF NetCDF files, extended frame by frame.  The first frame is written under another name, and the
file is then renamed: so either a complete frame exists, or any earlier file is untouched.  After
each frame the file is flushed to the operating system, so a killed run leaves a file that opens.  (During
the run HDF5 locks the file: set HDF5_USE_FILE_LOCKING=FALSE to open it with other tools;
`floebmi.plot` does not need this.)

Stress in a file is the mean since the last frame, from the difference of the running impulse, so Σ τ A Δt
over the frames is the impulse for any frames and exchange intervals; per ice area, it is the same over the area
of ice at the frame's time.  All other fields are values at the time of the frame; see `cell_methods`.

All numbers are stored as float64.  Missing values are NaN: dry cells, properties of ice where there is no
ice, floes that have left or have not yet entered.
"""

import contextlib
import errno
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, final

import numpy as np

import floebmi
from floebmi.cf import (
    FLAGS,
    GEOGRAPHIC,
    GridInFile,
    define_grid,
    define_land,
    define_ledger,
    define_projection,
    define_time,
    define_walls,
    describe,
    geographic,
    storage,
    time_attributes,
    write_ledger,
)
from floebmi.coast import land_geometry
from floebmi.errors import InputError, choose, in_line, is_word
from floebmi.files import (
    attributes_of,
    check_attribute,
    check_target,
    disk_full_told,
    in_one_go,
    new_file,
    path_of,
)
from floebmi.projection import check_projection
from floebmi.quantities import check_flag, check_table
from floebmi.variables import AXES, FLOE_VARIABLES, PER_ICE_AREA, VARIABLES, Variable

if TYPE_CHECKING:
    from netCDF4 import Dataset

    from floebmi.grid import Grid
    from floebmi.model import Model

FILE_VERSION = 1
CACHE = 2**20  # bytes


class _GrowingFile:
    """A NetCDF file that is complete after each frame.

    kind : "gridded" or "trajectories"; the others as for `GriddedWriter`
    """

    def __init__(
        self,
        path: str | Path,
        model: "Model",
        kind: str,
        attributes: Mapping[str, Any] | None,
        reference: str | None,
        calendar: str,
        projection: str | None,
        land: Sequence[np.ndarray],
        overwrite: bool,
    ) -> None:
        if not hasattr(model, "ledger"):
            raise InputError(f"model = {in_line(model)}: must be a Model")
        check_flag("overwrite", overwrite)
        self.path, self._overwrite = path_of("path", path), overwrite
        self._data: Dataset | None = None
        self._count = 0
        self._last = -np.inf
        self._closed = False
        check_target(self.path, overwrite)
        self._of_time = time_attributes(reference, calendar)
        self._projection = None if projection is None else check_projection(projection)
        self._land = land_geometry(land, model.domain)
        self._attributes = _global_attributes(model, attributes, kind)

    def close(self) -> None:
        """Close the file; nothing can be written afterwards."""
        data, self._data, self._closed = self._data, None, True
        if data is not None:
            with disk_full_told(self.path):
                data.close()

    def _check_room(self) -> None:
        """Raise OSError if the disk has no room for a frame, while the frames so far are intact.

        If the disk fills up during a frame, HDF5 leaves a file that cannot be opened.
        """
        size = self.path.stat().st_size
        self._most, self._size = max(self._most, 2 * (size - self._size)), size
        if shutil.disk_usage(self.path.parent).free < self._most:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self.path))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        with contextlib.suppress(*[OSError] * (error[0] is not None)):  # keep the first error
            self.close()

    @contextlib.contextmanager
    def _frame(self, time: float) -> Iterator[tuple["Dataset", int]]:
        """The open file, and the number of the frame to write into it."""
        from netCDF4 import Dataset

        if self._closed:
            raise InputError(f"{self.path}: already closed; make a new writer to write more")
        if not time > self._last:
            raise InputError(f"{self.path}: frame at {time} s, but the last is at {self._last} s")
        with disk_full_told(self.path):
            if self._data is None:
                with in_one_go(self.path, self._overwrite) as part, new_file(part) as data:
                    yield data, 0
                self._size = self._most = self.path.stat().st_size
                self._data = Dataset(self.path, "a")
                _keep_few_chunks(self._data)
            else:
                self._check_room()
                yield self._data, self._count
                self._data.sync()
        self._count += 1
        self._last = time


@final
class GriddedWriter(_GrowingFile):
    """Fields on the model's grids, one frame per `write`.

    Parameters
    ----------
    path : the file to make
    model : its grids must not change
    attributes : global attributes, texts and numbers: title, scene text, licence of the data …
    reference : date of the run's time 0, such as "1979-01-15 12:00"; None: an arbitrary epoch
    calendar : CF calendar of the reference
    projection : the plane of x and y [m], such as "EPSG:3413" (see projection.py); then latitude and
        longitude are written too
    land : rings of shape (k, 2) [m], as in `coast.Coast.polygons`
    names : short names of the variables to write (see variables.py); None: all of the model
    overwrite : whether an existing file may be replaced

    Raises
    ------
    InputError
        if the file already exists, its folder does not, or an attribute, a date, a projection, a name or a ring
        is invalid.  Nothing is written then.
    """

    def __init__(
        self,
        path: str | Path,
        model: "Model",
        attributes: Mapping[str, Any] | None = None,
        *,
        reference: str | None = None,
        calendar: str = "standard",
        projection: str | None = None,
        land: Sequence[np.ndarray] = (),
        names: Sequence[str] | None = None,
        overwrite: bool = False,
    ) -> None:
        super().__init__(
            path, model, "gridded", attributes, reference, calendar, projection, land, overwrite
        )  # fmt: skip
        self._rows = _rows_of(model, names)
        self._before = model.time, _impulses(model)

    def write(self, model: "Model") -> None:
        """Append the fields at the model's time.

        Raises
        ------
        InputError
            if the time is not later than that of the last frame.
        """
        now = model.time, _impulses(model)
        values = {
            **model.fields(),
            **{row.name: row.array_in(model) for row in self._rows if row.intent == "in"},
            **_mean_stresses(model, self._before, now, self._rows),
        }
        with self._frame(model.time) as (data, k):
            if k == 0:
                self._define(data, model)
            data["time"][k] = now[0]
            data["time_bnds"][k] = self._before[0], now[0]
            for row in self._rows:
                grid = _grid_of(model, row)
                field = np.where(grid.wet, values[row.name], np.nan)
                if row.needs_ice:
                    field[values["area_fraction"] == 0.0] = np.nan
                data[row.file_name][k] = field.reshape(grid.shape)
            write_ledger(data, k, model.ledger)
        self._before = now

    def _define(self, data: "Dataset", model: "Model") -> None:
        data.setncatts(self._attributes)
        data.createDimension("time", None)
        data.createDimension("bnds", 2)
        define_time(data, self._of_time)
        data["time"].bounds = "time_bnds"
        data.createVariable("time_bnds", "f8", ("time", "bnds"), chunksizes=(512, 2))
        define_ledger(data)
        define_projection(data, self._projection)
        define_land(data, self._land, self._projection)
        grids: dict[int, GridInFile] = {}
        for row in self._rows:
            grid = _grid_of(model, row)
            if id(grid) not in grids:
                suffix = "" if grid is model.grid else f"_{row.grid}"
                grids[id(grid)] = define_grid(data, grid, suffix, self._projection)
            in_file = grids[id(grid)]
            variable = data.createVariable(
                row.file_name,
                "f8",
                ("time", *in_file.dimensions),
                fill_value=np.nan,
                **storage(grid.size, grid.shape),
            )
            variable.setncatts({**describe(row), **in_file.attributes})


@final
class TrajectoryWriter(_GrowingFile):
    """The floes as CF trajectories, one frame per `write`; trajectory k is always floe k.

    Radius, thickness and prescribed motion have no time dimension.  Floes that enter later get new
    trajectories.

    Parameters
    ----------
    path : the file to make
    model : any model
    attributes, reference, calendar, projection, land, overwrite : as for `GriddedWriter`
    changing : which of "radius", "thickness" and "motion" change in time, and so get a time dimension
    contacts : whether contact count, bond count and contact force are written

    Raises
    ------
    InputError
        as for `GriddedWriter`.
    """

    def __init__(
        self,
        path: str | Path,
        model: "Model",
        attributes: Mapping[str, Any] | None = None,
        *,
        reference: str | None = None,
        calendar: str = "standard",
        projection: str | None = None,
        land: Sequence[np.ndarray] = (),
        changing: Sequence[str] = (),
        contacts: bool = True,
        overwrite: bool = False,
    ) -> None:
        super().__init__(
            path, model, "trajectories", attributes, reference, calendar, projection, land, overwrite
        )  # fmt: skip
        self._attributes["featureType"] = "trajectory"
        constant = {"radius", "thickness", "motion"}
        check_flag("contacts", contacts)
        changing = _several("changing", changing)
        for name in changing:
            if not is_word(name, constant):
                raise InputError(f"{path}: changing = {name!r}; {choose(name, constant)}")
        self._constant = tuple(sorted(constant - set(changing)))
        self._written = {name: np.empty(0) for name in self._constant}
        self._contacts = contacts

    def write(self, model: "Model") -> None:
        """Append the floes at the model's time.

        Raises
        ------
        InputError
            if the time is not later than that of the last frame, or if a property declared constant has
            changed.
        """
        values = self._values(model)
        n = len(model.floes)
        for name, old in self._written.items():
            changed = np.flatnonzero(values[name][: len(old)] != old)
            if changed.size:
                raise InputError(
                    f"{self.path}: {name} of floe {changed[0]} has changed; say changing=({name!r},)"
                )
        gone = ~model.floes.active
        with self._frame(model.time) as (data, k):
            if k == 0:
                self._define(data, values, n)
                define_walls(data, model.wall_edges)
            data["time"][k] = model.time
            first = len(data.dimensions["trajectory"])
            data["trajectory"][first:n] = np.arange(first, n)
            for name, value in values.items():
                if name in self._constant:
                    data[name][first:n] = value[first:]
                else:
                    missing = np.nan if value.dtype == np.float64 else -1
                    data[name][k, :n] = np.where(gone, missing, value)
            if model.wall_edges:
                data["wall_position"][k] = model.wall_positions
                data["wall_normal_stress"][k] = model.wall_stress()
            write_ledger(data, k, model.ledger)
        self._written = {name: values[name].copy() for name in self._constant}

    def _values(self, model: "Model") -> dict[str, np.ndarray]:
        floes = model.floes
        names = ("x", "y", "u", "v", "radius", "thickness", "angle", "angular_velocity", "motion")
        values = {name: getattr(floes, name) for name in names}
        values = {name: value for name, value in values.items() if value is not None}
        if self._contacts:
            values.update(_contact_sums(model))
        if self._projection is not None:
            values.update(geographic(self._projection, floes.x, floes.y))
        return values

    def _define(self, data: "Dataset", values: Mapping[str, np.ndarray], n: int) -> None:
        data.setncatts(self._attributes)
        data.createDimension("time", None)
        data.createDimension("trajectory", None)
        define_time(data, self._of_time)
        define_ledger(data)
        define_projection(data, self._projection)
        define_land(data, self._land, self._projection)
        width = min(max(n, 64), 65536)
        number = data.createVariable("trajectory", "i4", ("trajectory",), chunksizes=(width,))
        number.setncatts({"cf_role": "trajectory_id", "long_name": "number of the floe"})
        rows = {row.name: row for row in FLOE_VARIABLES}
        places = [name for name in ("x", "y", "latitude", "longitude") if name in values]
        for name, value in values.items():
            if name in self._constant:
                variable = data.createVariable(
                    name, value.dtype, ("trajectory",), fill_value=False, chunksizes=(width,)
                )
            else:
                variable = data.createVariable(
                    name,
                    value.dtype,
                    ("time", "trajectory"),
                    fill_value=np.nan if value.dtype == np.float64 else -1,
                    **storage(width, (width,)),
                )
                if name not in places:
                    variable.coordinates = " ".join(places)
                if self._projection is not None:
                    variable.grid_mapping = "crs"
            variable.setncatts(describe(rows[name]) if name in rows else GEOGRAPHIC[name])
            variable.setncatts(FLAGS.get(name, {}))
        data["x"].axis, data["y"].axis = "X", "Y"


# ---- from the model to its files --------------------------------------------------------------


def _global_attributes(
    model: "Model", given: Mapping[str, Any] | None, kind: str
) -> dict[str, Any]:
    made = {
        **attributes_of("Sea-ice floes as discrete elements"),
        "floebmi_version": floebmi.__version__,
        "floebmi_file": f"{kind} {FILE_VERSION}",
        "contact": repr(model.contact),
        "forces": repr(tuple(model.forces)),
        "step": repr(model.step),
        # NetCDF has no integers beyond 64 bits
        "seed": int(model.seed) if model.seed < 2**63 else str(model.seed),
        "ice_density": float(model.ice_density),
        "domain_x": np.array(model.domain.x, float),
        "domain_y": np.array(model.domain.y, float),
    }
    for edge in ("west", "east", "south", "north"):
        made[f"domain_{edge}"] = getattr(model.domain, edge)
    if kind == "gridded" and model.grid.kind == "unstructured":
        made["Conventions"] += " UGRID-1.0"
    check_table("attributes", given)
    for name, value in (given or {}).items():
        if name in ("Conventions", "featureType", "floebmi_file"):
            raise InputError(f"attribute {name!r}: is set by the writer; leave it out")
        check_attribute(name, value)
        made[name] = value
    return made


def _grid_of(model: "Model", row: Variable) -> "Grid":
    fluid = {"ocean": model.ocean, "atmosphere": model.atmosphere}.get(row.grid)
    return model.grid if fluid is None else fluid.grid


def _rows_of(model: "Model", names: Sequence[str] | None) -> list[Variable]:
    """The requested rows of the table, of those that the model has."""
    fields = model.fields()
    has = [
        row
        for row in VARIABLES
        if (row.name in fields if row.intent == "out" else row.array_in(model) is not None)
    ]
    if names is None:
        return has
    known = [row.name for row in has]
    names = _several("names", names)
    for name in names:
        if not is_word(name, known):
            raise InputError(
                f"names = {name!r}: this model has no such field; {choose(name, known)}"
            )
    return [row for row in has if row.name in names]


def _several(name: str, words: Sequence[str]) -> list[str]:
    """A list of words; InputError for a single one, whose letters would be taken for words, and for anything else."""
    if isinstance(words, str | bytes) or not np.iterable(words):
        raise InputError(f"{name} = {in_line(words)}: must be a list of names")
    return list(words)


def _impulses(model: "Model") -> dict[str, np.ndarray]:
    """The running impulses now [N s per cell], with the sign of the stresses in the table."""
    now = {}
    for a, _ in AXES:
        for stress, fluid, sign in (("ocean", model.ocean, 1.0), ("air", model.atmosphere, -1.0)):
            if fluid is not None:
                now[f"{stress}_stress_{a}"] = sign * getattr(fluid, f"impulse_{a}")
    return now


def _mean_stresses(
    model: "Model",
    before: tuple[float, dict[str, np.ndarray]],
    now: tuple[float, dict[str, np.ndarray]],
    rows: list[Variable],
) -> dict[str, np.ndarray]:
    """Mean stress since the last frame [Pa]; NaN if no time has passed.

    Per ice area it is that mean over the area of ice now, so that multiplied by the concentration of the same frame it
    gives the stress per cell area, as for a host (docs/couple.md).
    """
    span = now[0] - before[0]
    means = {}
    for row in rows:
        name, over = row.name, 1.0 / _grid_of(model, row).area
        if name in PER_ICE_AREA:
            name, over = PER_ICE_AREA[name], model.over_ice_area()
        if name in now[1]:
            given = (now[1][name] - before[1][name]) * over
            means[row.name] = given / span if span > 0.0 else np.full(given.size, np.nan)
    return means


def _contact_sums(model: "Model") -> dict[str, np.ndarray]:
    """Contacts, bonds, sum of |force| and pressure of each floe (eq. floe-pressure)."""
    f, n = model.floes, len(model.floes)
    pairs = model.contacts()
    ends = np.concatenate([pairs.i, pairs.j])

    def per_floe(values: np.ndarray) -> np.ndarray:
        sums = np.bincount(ends, values, minlength=n)
        return sums.astype(np.float64)  # without any contact they are integers

    push = -(pairs.fx * pairs.dx + pairs.fy * pairs.dy) / np.hypot(pairs.dx, pairs.dy)
    arms = f.radius[ends] - 0.5 * np.tile(pairs.overlap, 2)
    sums = {
        "contact_count": np.bincount(ends, minlength=n).astype(np.int32),
        "contact_force": per_floe(np.tile(np.hypot(pairs.fx, pairs.fy), 2)),
        "pressure": per_floe(np.tile(push, 2) * arms) / (2 * f.volume),
    }
    if model.contact is not None and model.contact.bonds is not None:
        sums["bond_count"] = per_floe(np.tile(pairs.bonded, 2)).astype(np.int32)
    return sums


# ---- reading ----------------------------------------------------------------------------------


def _keep_few_chunks(data: "Dataset") -> None:
    """Limit what HDF5 keeps of each variable in memory to `CACHE`; by default 64 MB, gigabytes in all.

    Frames are written and read one after the other, so older ones are not needed again.  Of floes, of which many may
    have come in, a frame may have more chunks than `CACHE` holds, each of them with other frames, too: those stay.
    """
    for variable in data.variables.values():
        if "trajectory" not in variable.dimensions or variable.chunking()[0] == 1:
            variable.set_var_chunk_cache(CACHE)


@contextlib.contextmanager
def open_file(path: str | Path, *kinds: str) -> Iterator["Dataset"]:
    """Open a file of this module for reading, even while a run still writes it.

    Parameters
    ----------
    path : the file
    kinds : kinds that may be opened: "gridded", "trajectories", "tradeoff"

    Raises
    ------
    InputError
        if there is no such file, or it is no NetCDF file of these kinds and this version.
    """
    from netCDF4 import Dataset

    path = path_of("path", path)
    if not path.is_file():
        raise InputError(f"{path}: there is no such file")
    with contextlib.ExitStack() as stack:
        try:
            data = stack.enter_context(Dataset(path))
        except OSError:
            # HDF5 locks a file that is being written; a copy of it is not locked
            copy = Path(stack.enter_context(tempfile.TemporaryDirectory())) / path.name
            shutil.copyfile(path, copy)
            try:
                data = stack.enter_context(Dataset(copy))
            except OSError:
                raise InputError(f"{path}: is no NetCDF file, or a damaged one") from None
        other = "a restart file" if "floebmi_restart" in data.ncattrs() else "none of floebmi's"
        found = str(getattr(data, "floebmi_file", other))
        wanted = [f"{kind} {FILE_VERSION}" for kind in kinds]
        if found not in wanted:
            raise InputError(f"{path}: is {found!r}; must be {' or '.join(map(repr, wanted))}")
        _keep_few_chunks(data)
        yield data
