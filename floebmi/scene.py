"""Scene files: a description of a run in TOML (or YAML), with the names of the Python API.

A scene lists the processes to model; what it does not list is not modelled.  All numbers are in SI units (m, s,
m/s, Pa, kg/m³), except for longitudes and latitudes in degrees.  `floebmi scene --keys` prints each key with its
unit, default and meaning.  Paths are relative to the scene file.

    read_scene("labrador-sea")  →  Scene: checked tables  →  build()  →  Model, forcing, schedule

Most tables are declared in `scene_domain`, `scene_physics` and `scene_floes`, beside what each of them makes.
"""

import contextlib
import math
import os
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, PrivateAttr, model_validator

from floebmi.boundaries import Wall
from floebmi.clock import Calendar, date_of
from floebmi.contact import Contact, Damsgaard2018Coulomb
from floebmi.dynamics import Step
from floebmi.errors import InputError, choose, in_line
from floebmi.files import check_new_folder, check_target, in_one_go
from floebmi.floes import Floes
from floebmi.forces import DRAG_PRESETS, BodyForce, Force
from floebmi.grid import Grid
from floebmi.quantities import Count, Positive
from floebmi.running import check_forcing, check_intervals
from floebmi.scene_domain import CoastTable, DomainTable, GridTable, InflowTable, check_open
from floebmi.scene_floes import FromField, GroupTable
from floebmi.scene_keys import Sea
from floebmi.scene_physics import (
    CONTACTS,
    Atmosphere,
    ContactTable,
    CoriolisTable,
    Ice,
    Ocean,
    Parts,
    TiltTable,
    contact_of,
)
from floebmi.scenes import file_of, packaged
from floebmi.tables import (
    Table,
    apply_override,
    keyed,
    law_of,
    parse,
    parse_override,
    read_text,
    table_of,
    validate,
)
from floebmi.taylor import PAPERS_STEP

if TYPE_CHECKING:
    from floebmi.forcing import VelocitySource
    from floebmi.model import Model

SUFFIXES = {".toml": False, ".yaml": True, ".yml": True}  # of scene files → whether it is YAML


# ---- time and output --------------------------------------------------------------------------


class Time(Table):
    """Start, duration, and how often the ice and the fluids exchange momentum."""

    duration: Positive | None = Field(
        None, description="length of the run [s]; a coupled run needs none"
    )
    exchange: Positive | None = Field(
        None,
        description="time between exchanges with ocean and atmosphere [s]; default: output.every",
    )
    start: str | None = Field(
        None,
        description="date of time 0, such as '1980-01-01' or '1980-01-01 12:00'; default: the first record of dated files",
    )
    calendar: Calendar | None = Field(
        None,
        description="CF calendar of the dates; files of velocities must have the same; default: 'standard' for the scene, "
        "and each file's own calendar for its dates",
    )

    @model_validator(mode="after")
    def _start_is_a_date(self) -> Self:
        if self.start is not None:
            date_of(self.start, self.calendar or "standard")
        return self


class Output(Table):
    """Files that a run writes."""

    every: Positive | None = Field(
        None, description="time between frames [s]; default: a twentieth of the run"
    )
    gridded: bool | None = Field(
        None,
        description="write fields on the grid as NetCDF; default: true if there is a [grid]",
    )
    trajectories: bool = Field(True, description="write the floes' trajectories as NetCDF")
    picture: bool = Field(True, description="draw the last frame of the trajectories as PNG")
    paraview: bool = Field(False, description="write ParaView files of all frames")

    @model_validator(mode="after")
    def _made_from_trajectories(self) -> Self:
        for name in ("picture", "paraview"):
            if name in self.model_fields_set and getattr(self, name) and not self.trajectories:
                raise InputError(f"{name} = true: needs trajectories = true")
        return self


class Schedule(NamedTuple):
    """Length of a run, and the intervals between exchanges and between frames [s]."""

    duration: float
    exchange: float
    every: float


class Built(NamedTuple):
    """The model of a scene and its forcing, the arguments of `run`.

    start : date of time 0, from the scene or from the first record of dated files; None if there is none
    calendar : CF calendar of `start`
    """

    model: "Model"
    ocean: "VelocitySource | None"
    atmosphere: "VelocitySource | None"
    land: list[np.ndarray]
    start: str | None
    calendar: str


StepTable: Any = table_of(Step)


class Scene(Table):
    """A scene: the ice, and what moves it."""

    title: str = Field("", description="title of the scene, one line")
    seed: int = Field(
        0,
        ge=0,
        description="seed of all random numbers; the same seed gives bit-identical results. Each group of floes draws its own numbers",
    )
    preset: Literal["damsgaard2018"] | None = Field(
        None,
        description="'damsgaard2018': time step, integration scheme and lever arms as in the paper's runs",
    )
    threads: Count = Field(
        1,
        description="number of threads, which take effect from 50 000 floes on; results are bit-identical for any number",
    )
    sampling: Literal["overlap", "centre"] = Field(
        "overlap",
        description="weights between floes and grid: exact areas of overlap, or the paper's bilinear interpolation at the "
        "floe's centre (on cells that are not rectangles: the cell that holds it)",
    )
    domain: DomainTable = Field(description="the rectangle in which the floes move")
    grid: GridTable | None = Field(
        None, description="exchange grid between the ice, the ocean and the atmosphere"
    )
    ice: Ice = Field(Ice(), description="material properties of the ice")
    floes: list[GroupTable] = Field([], description="groups of floes, [floes] or [[floes]]")
    contact: ContactTable | None = Field(
        None, description="contact law: 'frictional', 'cohesive', 'none', or a table"
    )
    coast: CoastTable | None = Field(None, description="land and its shore")
    ocean: Ocean | None = Field(None, description="ocean velocity and drag")
    atmosphere: Atmosphere | None = Field(None, description="wind velocity and drag")
    coriolis: CoriolisTable | None = Field(None, description="Coriolis acceleration")
    tilt: TiltTable | None = Field(None, description="sea-surface tilt")
    body_force: keyed(BodyForce) | None = Field(None, description="uniform acceleration")
    walls: list[keyed(Wall)] = Field([], description="frictionless walls, [[walls]]")
    inflow: list[InflowTable] = Field([], description="edges where new floes enter, [[inflow]]")
    step: StepTable = Field(StepTable(), description="time step and integration scheme")
    time: Time = Field(Time(), description="start, duration and exchange interval")
    output: Output = Field(Output(), description="files that a run writes")

    @model_validator(mode="after")
    def _fields_have_a_grid(self) -> Self:
        if self.output.gridded and self.grid is None:
            raise InputError("[output] gridded = true: needs a [grid]")
        return self

    _file: Path = PrivateAttr(default=Path("scene"))
    _text: str = PrivateAttr(default="")

    @property
    def file(self) -> Path:
        """Path of the file that the scene was read from."""
        return self._file

    @property
    def name(self) -> str:
        """Name of the scene file without its suffix; the output is named after it."""
        return self._file.stem

    @property
    def text(self) -> str:
        """Text of the scene file, with any overrides as comments at its end."""
        return self._text

    def paths(self) -> list[str]:
        """Files that the scene reads, with paths as written in it."""
        return list(dict.fromkeys(_paths_in(self)))

    def schedule(self, duration: float | None = None) -> Schedule:
        """Length of the run and its intervals [s]; `duration` replaces the scene's.

        Raises
        ------
        InputError
            if there is no duration, or the exchange interval does not divide the output interval.
        """
        total = self.time.duration if duration is None else duration
        if total is None:
            raise InputError(
                f"{self._file}: [time] duration is missing: give it there, or with --duration SECONDS"
            )
        if not (math.isfinite(total) and total > 0):
            raise InputError(f"duration = {total!r}: must be greater than 0 s")
        every, exchange = self.output.every, self.time.exchange
        if every is None:
            every = total / 20
            if exchange is not None:
                every = exchange * max(1, round(every / exchange))
        if exchange is None:
            exchange = every
        check_intervals(every, exchange, f"{self._file}: [time] exchange")
        return Schedule(float(total), float(exchange), float(every))

    def check_forcing(self, built: Built, start: float, end: float) -> None:
        """Raise InputError, naming file and table, unless the forcing covers start to end [s]."""
        for table, source, fluid in (
            ("ocean", built.ocean, built.model.ocean),
            ("atmosphere", built.atmosphere, built.model.atmosphere),
        ):
            if source is not None:
                with self.place(table):
                    check_forcing(source, fluid, start, end)

    def _place_of_group(self, k: int) -> contextlib.AbstractContextManager[None]:
        return self.place("floes" if len(self.floes) == 1 else f"floes number {k + 1}")

    @contextlib.contextmanager
    def place(self, table: str) -> Iterator[None]:
        """Context in which an InputError gets the file and the table in front of its message."""
        try:
            yield
        except InputError as error:
            where = f"{self._file}: [{table}]" if table else f"{self._file}:"
            raise InputError(f"{where} {error}") from error

    def build(self) -> Built:
        """Build the model at time 0, its forcing, and its land.

        Raises
        ------
        InputError
            one line that names file and table.
        """
        from floebmi.model import Model

        sea, wind_grid = self._sea()
        floes = self._floes(sea)
        forces = self.forces()
        with self.place(""):
            model = Model(
                sea.domain,
                floes,
                contact=self.contact_law(),
                forces=forces,
                grid=sea.grid,
                walls=self.walls,
                inflow=[table.build(sea) for table in self.inflow],
                step=self.step_law(),
                sampling=self.sampling,
                ice_density=self.ice.density,
                draft_fraction=self.ice.draft_fraction(forces),
                rotation=self.ice.rotation,
                seed=self.seed,
                atmosphere_grid=wind_grid,
                threads=self.threads,
            )
        with self.place("inflow"):
            for inflow in model.inflow:
                check_open(inflow, sea)
        self.lay_out_sea(model)
        ocean = atmosphere = None
        if self.ocean is not None:
            model.ocean.layer_thickness = self.ocean.layer_thickness
            with self.place("ocean"):
                ocean = self.ocean.source(sea, model.ocean.grid)
        if self.atmosphere is not None:
            with self.place("atmosphere"):
                atmosphere = self.atmosphere.source(sea, model.atmosphere.grid)
        with self.place("time"):
            start, calendar = self._begin(ocean, atmosphere)
        if self.time.start is None and start is not None:
            for k, group in enumerate(self.floes):
                if isinstance(group, FromField):
                    with self._place_of_group(k):
                        group.check_begins(sea.folder, start)
        land = [] if sea.land is None else sea.land.polygons
        return Built(model, ocean, atmosphere, land, start, calendar)

    def _sea(self) -> tuple[Sea, Grid | None]:
        """The domain with its grid and land, and the grid of the wind, which blows over land as well."""
        with self.place("domain"):
            domain = self.domain.build()
        sea = Sea(
            domain, None, None, self._file.parent, self.domain.projection, self.time.start,
            self.time.calendar,
        )  # fmt: skip
        if self.grid is not None:
            with self.place("grid"):
                sea = sea._replace(grid=self.grid.build(sea))
        wind_grid = None if self.atmosphere is None else sea.grid
        if self.atmosphere is not None and self.atmosphere.grid is not None:
            with self.place("atmosphere.grid"):
                wind_grid = self.atmosphere.grid.build(sea)
        if self.coast is None:
            return sea, wind_grid
        with self.place("coast"):
            sea = sea._replace(land=self.coast.build(sea))
        if sea.grid is not None:
            from floebmi.coast import on_land

            dry = on_land(sea.land.polygons, sea.grid.x, sea.grid.y, domain)
            sea = sea._replace(grid=sea.grid.with_wet(~dry))
        return sea, wind_grid

    def _floes(self, sea: Sea) -> Floes:
        """The floes of all groups, and those that line the shore."""
        parts = []
        for k, group in enumerate(self.floes):
            with self._place_of_group(k):
                parts.append(group.build(sea, _seed_of_group(self.seed, k)))
        if sea.land is not None:
            parts.append(sea.land.floes)
        return Floes.concatenate(parts)

    def lay_out_sea(self, model: "Model") -> None:
        """Set the ocean's surface slope and Coriolis parameter to this scene's; needed again after a restart, which restores those of its own scene."""
        if self.tilt is not None and not self.tilt.geostrophic:
            model.ocean.tilt_x[:], model.ocean.tilt_y[:] = self.tilt.slope
        if self.coriolis is not None and self.coriolis.field:
            model.ocean.coriolis[:] = self.coriolis.f

    def contact_law(self) -> Contact | None:
        """The contact law that the scene lists, or None."""
        law, table = contact_of(self.contact), self.contact
        if self.preset is None or law is None or law.friction is None:
            return law
        if isinstance(table, Parts) and "law" in table.friction.model_fields_set:
            return law
        return law._replace(friction=Damsgaard2018Coulomb(*law.friction))

    def step_law(self) -> Step:
        """Time step and scheme; what the scene leaves open is taken from its preset."""
        step = law_of(self.step, Step)
        given = {name: getattr(step, name) for name in self.step.model_fields_set}
        for name in given.keys() & {"epsilon", "length"} if step.fraction is not None else ():
            raise InputError(
                f"[step] fraction = {step.fraction:g} and {name} = {given[name]:g} exclude each other; give one"
            )
        if self.preset is None:
            return step
        if given.keys() & {"fraction", "length"}:  # the user's own step instead of Eq. 4's
            given.setdefault("epsilon", None)
        return PAPERS_STEP._replace(**given)

    def forces(self) -> list[Force]:
        """The forces that the scene lists."""
        found: list[Force] = []
        for table, k in ((self.ocean, 0), (self.atmosphere, 1)):
            if table is not None:
                word = table.drag
                found.append(DRAG_PRESETS[word][k] if isinstance(word, str) else word)
        if self.coriolis is not None:
            found.append(self.coriolis.build())
        if self.tilt is not None:
            with self.place("tilt"):
                found.append(self.tilt.build(self.ocean, self.coriolis))
        if self.body_force is not None:
            found.append(self.body_force)
        return found

    def _begin(
        self, ocean: "VelocitySource | None", atmosphere: "VelocitySource | None"
    ) -> tuple[str | None, str]:
        """The date of time 0, and its calendar.

        If the scene gives no date, time 0 is the first record of each dated file; two files whose first records
        have different dates are then refused.
        """
        calendar = self.time.calendar or "standard"
        if self.time.start is not None:
            return self.time.start, calendar
        currents, wind = (getattr(source, "first_date", None) for source in (ocean, atmosphere))
        if None not in (currents, wind) and currents != wind:
            raise InputError(
                f"start is missing: the records of [ocean] begin at {currents}, those of [atmosphere] at {wind}, and both"
                " would be time 0: say its date"
            )
        for source, first in ((ocean, currents), (atmosphere, wind)):
            if first is not None:
                return first, source.calendar
        return None, calendar


def _seed_of_group(seed: int, k: int) -> int:
    """What group k of floes, from 0, draws from: no other group's, nor that of any group of another scene's seed."""
    if k == 0:
        return seed
    return int(np.random.SeedSequence(seed, spawn_key=(k,)).generate_state(1, np.uint64)[0])


def _paths_in(table: Table) -> Iterator[str]:
    for name in type(table).model_fields:
        value = getattr(table, name)
        if name in ("file", "geojson") and value is not None:
            yield from [value] if isinstance(value, str) else value
        for inner in value if isinstance(value, list) else [value]:
            if isinstance(inner, Table):
                yield from _paths_in(inner)


# ---- reading ----------------------------------------------------------------------------------


def find_scene(scene: str | Path) -> Path:
    """Find the file of a scene, given its path or the name of a packaged scene.

    Raises
    ------
    InputError
        if there is neither; the message lists the packaged scenes and suggests the nearest name.
    """
    if not isinstance(scene, str | os.PathLike) or "\0" in str(scene):
        raise InputError(f"scene = {in_line(scene)}: must be the path of a file or a packaged name")
    path = Path(scene)
    if path.is_file() or path.suffix in SUFFIXES or len(path.parts) > 1:
        return path
    if str(scene) in packaged():
        return packaged()[str(scene)]
    raise InputError(
        f"{scene}: neither a file here nor a packaged scene; {choose(scene, packaged())}"
    )


def read_scene(scene: str | Path, overrides: Sequence[str] = ()) -> Scene:
    """Read and check a scene.

    Parameters
    ----------
    scene : path of a TOML or YAML file, or the name of a packaged scene
    overrides : strings such as "time.duration=3600", as given to `--set`

    Returns
    -------
    Scene : the checked tables; `build()` returns `model`, `ocean` and `atmosphere` (sources of their velocities, or
        None) and `land` (rings [m]), the arguments of `run`

    Raises
    ------
    InputError
        one line with file (or `--set`), table, key, value, and what is allowed.
    """
    several = isinstance(overrides, Sequence) and not isinstance(overrides, str)
    if not several or not all(isinstance(text, str) for text in overrides):
        raise InputError(
            f"overrides = {in_line(overrides)}: must be a list of texts, such as ['time.duration=3600']"
        )
    path = find_scene(scene)
    if path.suffix not in SUFFIXES:
        raise InputError(f"{path}: must end in {', '.join(SUFFIXES)}")
    text = read_text(path)
    tables = parse(text, str(path), yaml=SUFFIXES[path.suffix])
    changes = tuple(parse_override(override) for override in overrides)
    _as_lists(tables)
    for change in changes:
        apply_override(tables, change, {"contact": ("model", CONTACTS)})
    _as_lists(tables)  # an override may have made the table
    read: Scene = validate(Scene, tables, str(path), changes)
    read._file = path
    read._text = text + "".join(f"\n# --set {change.text}" for change in changes)
    return read


def _as_lists(tables: dict) -> None:
    """Turn a single table of floes or inflow into a list of one."""
    for name in ("floes", "inflow"):
        if isinstance(tables.get(name), dict):
            tables[name] = [tables[name]]


def copy_scene(name: str, to: Path, force: bool = False) -> list[Path]:
    """Copy a packaged scene with the data that it reads, so that the copy runs; returns the new files.

    Parameters
    ----------
    name : name of the packaged scene
    to : file to write, or folder to write it in
    force : whether existing files may be replaced

    Raises
    ------
    InputError
        if a file with other contents would be replaced.
    """
    source = file_of(name)
    target = to / source.name if to.is_dir() else to
    if target.suffix != source.suffix:
        raise InputError(f"--to {target}: must end in {source.suffix}, or be a folder")
    copies = {source: target}
    for data in read_scene(source).paths():
        for part in (source.parent / data, (source.parent / data).with_suffix(".LICENSE")):
            if part.exists():
                copies[part] = target.parent / part.relative_to(source.parent)
    for old, new in copies.items():
        check_new_folder(new.parent)
        if new.parent.is_dir():
            check_target(new, overwrite=True)
        if new.exists() and not force and new.read_bytes() != old.read_bytes():
            raise InputError(
                f"{new}: exists already; choose another place, or replace it with --force"
            )
    for old, new in copies.items():
        try:
            new.parent.mkdir(parents=True, exist_ok=True)
            with in_one_go(new) as part:
                shutil.copyfile(old, part)
        except OSError as error:
            raise InputError(f"{new}: cannot be written ({error.strerror})") from None
    return list(copies.values())
