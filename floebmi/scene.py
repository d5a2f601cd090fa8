"""Scene files: a description of a run in TOML (or YAML), with the names of the Python API.

A scene lists the processes to model; what it does not list is not modelled.  All numbers are in SI units (m, s,
m/s, Pa, kg/m³), except for longitudes and latitudes in degrees.  `floebmi scene --keys` prints each key with its
unit, default and meaning.  Paths are relative to the scene file.

    read_scene("labrador-sea")  →  Scene: checked tables  →  build()  →  Model, forcing, schedule
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

from floebmi.bonds import TensileStrength
from floebmi.boundaries import Domain, Edge, Feeder, Inflow, Wall, check_domain
from floebmi.clock import BeyondSpan, Calendar, date_of
from floebmi.contact import (
    CompressiveFailure,
    Contact,
    Coulomb,
    Damsgaard2018Coulomb,
    Elastic,
    Restitution,
    cohesive,
    frictional,
)
from floebmi.dynamics import Step
from floebmi.errors import InputError, choose, in_line
from floebmi.files import check_new_folder, check_target, in_one_go
from floebmi.floes import Floes
from floebmi.fluid import FASTEST
from floebmi.forces import (
    DRAG_PRESETS,
    AirDrag,
    BodyForce,
    Coriolis,
    CoriolisField,
    Force,
    OceanDrag,
    Tilt,
)
from floebmi.grid import Grid
from floebmi.projection import check_projection
from floebmi.quantities import Count, NonNegative, Positive, PositiveFraction, unmasked
from floebmi.running import check_forcing, check_intervals
from floebmi.scene_floes import FromField, GroupTable, Sea, SizeTable, sizes_of
from floebmi.scene_keys import (
    FILE_PROJECTION,
    FILL_LAND,
    MASK,
    POSITION,
    SELECT,
    FillLand,
    Pair,
    Position,
    ScenePath,
)
from floebmi.scenes import packaged
from floebmi.tables import (
    Table,
    apply_override,
    keyed,
    law_of,
    one_of,
    parse,
    parse_override,
    read_text,
    table_of,
    validate,
    word_or,
)
from floebmi.taylor import PAPERS_STEP

if TYPE_CHECKING:
    from netCDF4 import Variable

    from floebmi.coast import Coast
    from floebmi.fluid import Fluid
    from floebmi.forcing import VelocitySource
    from floebmi.model import Model

_SUFFIXES = {".toml": False, ".yaml": True, ".yml": True}  # suffix → whether it is YAML
_DRAG = f"a preset ({', '.join(DRAG_PRESETS)}), or a table of coefficients"
_EARTH_ROTATION = 7.2921159e-5  # rotation of the Earth [rad/s]


# ---- where: domain and grid -------------------------------------------------------------------

_Domain: Any = table_of(Domain)


class DomainTable(_Domain):
    """The rectangle in which the floes move, and what happens at its edges."""

    x: Pair = Field(description="west and east edge [m]")
    y: Pair = Field(description="south and north edge [m]")
    edges: Edge | None = Field(
        None, description="one behaviour for all four edges, instead of west, east, south and north"
    )
    projection: str | None = Field(
        None,
        description="map projection of x and y, for data in longitude and latitude: 'EPSG:3413', '+proj=laea …'",
    )

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        given = self.model_fields_set & {"west", "east", "south", "north"}
        if self.edges is not None and given:
            raise InputError(f"edges and {min(given)} exclude each other; give one")
        return self

    def build(self) -> Domain:
        domain = law_of(self, Domain)
        if self.edges is None:
            return domain
        return domain._replace(west=self.edges, east=self.edges, south=self.edges, north=self.edges)


class Uniform(Table):
    """Equal rectangles."""

    kind: Literal["uniform_rectilinear"] = "uniform_rectilinear"
    spacing: Positive | tuple[Positive, Positive] | None = Field(
        None, description="cell size, or (along x, along y) [m]; must divide the extent of the grid"
    )
    shape: tuple[Count, Count] | None = Field(
        None, description="number of cells (along y, along x), instead of spacing"
    )
    x: Pair | None = Field(
        None, description="west and east edge of the grid [m]; default: those of the domain"
    )
    y: Pair | None = Field(
        None, description="south and north edge of the grid [m]; default: those of the domain"
    )

    def build(self, domain: Domain, folder: Path) -> Grid:
        return Grid.uniform(self.x or domain.x, self.y or domain.y, self.spacing, self.shape)


class Rectilinear(Table):
    """Rectangles between given edges."""

    kind: Literal["rectilinear"] = "rectilinear"
    x_edges: list[float] = Field(description="edges of the columns [m], increasing")
    y_edges: list[float] = Field(description="edges of the rows [m], increasing")

    def build(self, domain: Domain, folder: Path) -> Grid:
        return Grid.rectilinear(self.x_edges, self.y_edges)


class Curvilinear(Table):
    """Quadrilaterals, from a NetCDF file with x_corners and y_corners (ny + 1, nx + 1), in metres or the units that the file states."""

    kind: Literal["curvilinear"] = "curvilinear"
    file: ScenePath = Field(
        description="NetCDF file with x_corners and y_corners (ny + 1, nx + 1) [m]"
    )

    def build(self, domain: Domain, folder: Path) -> Grid:
        return Grid.curvilinear(*_arrays(folder / self.file, "x_corners", "y_corners"))


class Unstructured(Table):
    """Polygons, from a NetCDF file with node_x, node_y and face_nodes (cells, corners), padded with −1 or its _FillValue."""

    kind: Literal["unstructured"] = "unstructured"
    file: ScenePath = Field(
        description="NetCDF file with node_x, node_y [m] and face_nodes (cells, corners), padded with -1"
    )

    def build(self, domain: Domain, folder: Path) -> Grid:
        x, y, faces = _arrays(folder / self.file, "node_x", "node_y", "face_nodes")
        return Grid.unstructured(x, y, faces)


GridTable = one_of(
    "kind",
    {
        "uniform_rectilinear": Uniform,
        "rectilinear": Rectilinear,
        "curvilinear": Curvilinear,
        "unstructured": Unstructured,
    },
    "uniform_rectilinear",
)


def _arrays(path: Path, *names: str) -> list[np.ndarray]:
    from netCDF4 import Dataset

    if not path.is_file():
        raise InputError(f"file = {str(path)!r}: no such file")
    try:
        with Dataset(path) as data:
            missing = [name for name in names if name not in data.variables]
            if missing:
                raise InputError(f"file = {str(path)!r}: has no variable {missing[0]!r}")
            return [_values(data[name], f"file = {str(path)!r}: {name}") for name in names]
    except OSError as error:
        raise InputError(f"file = {str(path)!r}: not a NetCDF file ({error.strerror})") from None


def _values(variable: "Variable", where: str) -> np.ndarray:
    """Coordinates [m], NaN where missing; or node numbers counted from 0, -1 where missing."""
    values = variable[:]
    if variable.name == "face_nodes":
        nodes = np.ma.filled(values, -1).astype(np.int64)
        return np.maximum(nodes - int(getattr(variable, "start_index", 0)), -1)
    from floebmi.factors import IN_FILE, length_factor

    factor = length_factor(variable.units, where, IN_FILE) if hasattr(variable, "units") else 1.0
    return factor * unmasked(values)


# ---- coast and inflow ---------------------------------------------------------------------------


class CoastTable(Table):
    """Land: its shore is lined with fixed floes, and the grid cells on it are dry."""

    file: ScenePath | None = Field(
        None, description="NetCDF file with a land fraction or a sea mask"
    )
    variable: str | None = Field(
        None, description="variable to read; default: found by its standard name"
    )
    select: dict[str, int] | None = Field(None, description=SELECT)
    outside: Literal["error", "land", "water"] = Field(
        "error", description="what a cell outside the file counts as"
    )
    position: Position = Field("auto", description=POSITION)
    file_projection: str | None = Field(None, description=FILE_PROJECTION)
    geojson: ScenePath | None = Field(
        None, description="GeoJSON file with land polygons, instead of file"
    )
    radius: Positive = Field(
        description="radius of the fixed floes on the shore [m]; capes too narrow for them get smaller ones, down to an eighth"
    )
    thickness: Positive = Field(10.0, description="thickness of the fixed floes on the shore [m]")

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if (self.file is None) == (self.geojson is None):
            raise InputError("give either file or geojson")
        idle = self.model_fields_set - {"file", "geojson", "radius", "thickness"}
        if self.file is None and idle:
            raise InputError(f"{min(idle)} applies to file, not to geojson: leave it out")
        return self


_Inflow: Any = table_of(Inflow)


class InflowTable(_Inflow):
    """New floes along an edge of the domain, each as soon as there is room for it."""

    sizes: SizeTable = Field(description="floe size distribution (by number of floes)")


# ---- contact and forces -----------------------------------------------------------------------

_FRICTIONS = {"coulomb": Coulomb, "damsgaard2018": Damsgaard2018Coulomb}


class Parts(Table):
    """A contact law composed of parts; a part that is left out is not modelled."""

    model: Literal["parts"] = "parts"
    elastic: keyed(Elastic) = Field(Elastic(), description="normal elasticity")
    friction: one_of("law", _FRICTIONS, "coulomb") | None = Field(
        None, description="friction, which also makes the floes rotate"
    )
    bonds: keyed(TensileStrength) | None = Field(None, description="bonds with a tensile strength")
    dashpot: keyed(Restitution) | None = Field(None, description="normal damping")
    failure: keyed(CompressiveFailure) | None = Field(
        None, description="compressive failure, followed by sliding of one floe over the other"
    )

    def build(self) -> Contact:
        friction = None
        if self.friction is not None:
            friction = law_of(self.friction, _FRICTIONS[self.friction.law])
        return Contact(self.elastic, friction, self.bonds, self.dashpot, self.failure)


_CONTACTS = {"frictional": frictional, "cohesive": cohesive}
ContactTable = word_or(
    Literal["frictional", "cohesive", "none"],
    one_of("model", {**_CONTACTS, "parts": Parts}, "parts"),
)


class FluidTable(Table):
    """The velocity of the ocean or the air, as the ice feels it."""

    velocity: Pair | None = Field(
        None,
        description="uniform, constant velocity (along x, along y) [m/s]; without it and without file: at rest",
    )
    file: ScenePath | list[ScenePath] | None = Field(
        None,
        description="NetCDF or Zarr file with the velocity in space and time, or several files that hold its parts",
    )
    variables: tuple[str, str] | None = Field(
        None, description="variables of u and v, if their names and attributes do not identify them"
    )
    vectors: Literal["auto", "east-north", "grid"] = Field(
        "auto", description="direction of the components: east and north, or the file's own axes"
    )
    stagger: Literal["auto", "none", "before", "after"] = Field(
        "auto", description="position of u and v on a C grid, see `floebmi.cgrid`"
    )
    depth: NonNegative | None = Field(
        None,
        description="depth (for wind: height) [m]; the level nearest to it is read; default: the surface, 10 m for wind",
    )
    select: dict[str, int] | None = Field(None, description=SELECT)
    units: str | None = Field(
        None, description="units of the velocity, if the file states none or wrong ones"
    )
    mask: str = Field("auto", description=MASK)
    fill_land: FillLand = Field("error", description=FILL_LAND)
    position: Position = Field("auto", description=POSITION)
    file_projection: str | None = Field(None, description=FILE_PROJECTION)
    beyond_span: BeyondSpan = Field(
        "error",
        description="what to do before the first and after the last record",
    )

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if self.velocity is not None and self.file is not None:
            raise InputError("velocity and file exclude each other; give one")
        if self.velocity is not None and not max(map(abs, self.velocity)) < FASTEST:
            raise InputError(f"velocity = {list(self.velocity)}: must be below {FASTEST:g} m/s")
        if self.file is None:
            idle = self.model_fields_set - {"velocity", "drag", "grid", "layer_thickness"}
            if idle:
                raise InputError(f"{min(idle)} applies to a file: give file, or leave it out")
        return self


class Ocean(FluidTable):
    """The ocean: its velocity, and its drag on the bottoms and sides of the floes."""

    drag: word_or(Literal[*DRAG_PRESETS], OceanDrag) = Field("damsgaard2018", description=_DRAG)
    layer_thickness: Positive | None = Field(
        None,
        description="thickness of the host's uppermost layer [m]; with it, exchanges that are too rare raise a warning",
    )


class Atmosphere(FluidTable):
    """The wind: its velocity, and its drag on the tops and freeboards of the floes."""

    drag: word_or(Literal[*DRAG_PRESETS], AirDrag) = Field("damsgaard2018", description=_DRAG)
    grid: GridTable | None = Field(None, description="separate grid for the wind; default: [grid]")


class CoriolisTable(Table):
    """Coriolis acceleration."""

    parameter: float | None = Field(None, description="Coriolis parameter f [1/s]")
    latitude: float | None = Field(
        None,
        ge=-90,
        le=90,
        description="latitude [degrees], instead of parameter: f = 2 Ω sin(latitude)",
    )
    field: bool = Field(
        False,
        description="let a host set a Coriolis parameter for each cell; until it does, parameter or latitude holds everywhere",
    )

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if (self.parameter is None) == (self.latitude is None):
            raise InputError("give either parameter or latitude")
        return self

    @property
    def f(self) -> float:
        """The Coriolis parameter [1/s]; with a field its initial value."""
        if self.latitude is not None:
            return 2 * _EARTH_ROTATION * math.sin(math.radians(self.latitude))
        return self.parameter

    def build(self) -> Coriolis | CoriolisField:
        return CoriolisField() if self.field else Coriolis(self.f)


_Tilt: Any = table_of(Tilt)


class TiltTable(_Tilt):
    """Sea-surface tilt."""

    slope: Pair = Field((0.0, 0.0), description="slope of the sea surface (∂η/∂x, ∂η/∂y) [1]")


class Ice(Table):
    """Material properties of the ice."""

    density: Positive = Field(934.0, description="density of the ice ρ_ice [kg/m³]")
    draft: Literal["hydrostatic"] | PositiveFraction = Field(
        0.9,
        description="ratio of draft to thickness [1], or 'hydrostatic': ρ_ice over the ocean's density",
    )
    rotation: bool = Field(
        False,
        description="let floes rotate even if the contact law does not need it (torque from the fluids' vorticity)",
    )


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
    picture: bool = Field(True, description="draw the last frame as PNG")
    paraview: bool = Field(False, description="write ParaView files of all frames")


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

        with self.place("domain"):
            domain = self.domain.build()
            check_domain(domain)
            if self.domain.projection is not None:
                check_projection(self.domain.projection)
        grid = self._grid("grid", self.grid, domain)
        wind_grid = None
        if self.atmosphere is not None:
            wind_grid = self._grid("atmosphere.grid", self.atmosphere.grid, domain) or grid
        coast = None
        if self.coast is not None:
            with self.place("coast"):
                coast = self._coast(self.coast, grid, domain)
            if grid is not None:
                from floebmi.coast import on_land

                grid = grid.with_wet(~on_land(coast.polygons, grid.x, grid.y, domain))
        land = [] if coast is None else coast.polygons
        sea = Sea(
            domain, grid, coast, self._file.parent, self.domain.projection, self.time.start,
            self.time.calendar,
        )  # fmt: skip
        floes = self._floes(sea)
        with self.place(""):
            model = Model(
                domain,
                floes,
                contact=self.contact_law(),
                forces=self.forces(),
                grid=grid,
                walls=self.walls,
                inflow=[
                    law_of(table, Inflow)._replace(sizes=sizes_of(table.sizes, self._file.parent))
                    for table in self.inflow
                ],
                step=self.step_law(),
                sampling=self.sampling,
                ice_density=self.ice.density,
                draft_fraction=self._draft_fraction(),
                rotation=self.ice.rotation,
                seed=self.seed,
                atmosphere_grid=wind_grid,
                threads=self.threads,
            )
        with self.place("inflow"):
            for inflow in model.inflow:
                _check_open(inflow, domain, land)
        self.lay_out_sea(model)
        if self.ocean is not None:
            model.ocean.layer_thickness = self.ocean.layer_thickness
        with self.place("ocean"):
            ocean = self._source(self.ocean, model.ocean)
        with self.place("atmosphere"):
            atmosphere = self._source(self.atmosphere, model.atmosphere)
        with self.place("time"):
            start, calendar = self._begin(ocean, atmosphere)
        if self.time.start is None and start is not None:
            for k, group in enumerate(self.floes):
                if isinstance(group, FromField):
                    with self._place_of_group(k):
                        group.check_begins(self._file.parent, start)
        return Built(model, ocean, atmosphere, land, start, calendar)

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
        if self.tilt is not None:
            model.ocean.tilt_x[:], model.ocean.tilt_y[:] = self.tilt.slope
        if self.coriolis is not None and self.coriolis.field:
            model.ocean.coriolis[:] = self.coriolis.f

    def contact_law(self) -> Contact | None:
        """The contact law that the scene lists, or None."""
        table = self.contact
        if table is None or table == "none":
            return None
        if isinstance(table, str):
            law = _CONTACTS[table]()
        elif isinstance(table, Parts):
            law = table.build()
        else:
            law = law_of(table, _CONTACTS[table.model])
        if self.preset is None or law.friction is None:
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
            found.append(law_of(self.tilt, Tilt))
        if self.body_force is not None:
            found.append(self.body_force)
        return found

    def _draft_fraction(self) -> float:
        if self.ice.draft != "hydrostatic":
            return self.ice.draft
        water = [law.density for law in self.forces() if isinstance(law, OceanDrag)]
        if not water:
            raise InputError("[ice] draft = 'hydrostatic': needs [ocean], whose density sets it")
        return self.ice.density / water[0]

    def _grid(self, name: str, table: Any, domain: Domain) -> Grid | None:
        if table is None:
            return None
        with self.place(name):
            return table.build(domain, self._file.parent)

    def _coast(self, table: CoastTable, grid: Grid | None, domain: Domain) -> "Coast":
        from floebmi import coast

        folder = self._file.parent
        if table.geojson is not None:
            return coast.from_geojson(
                folder / table.geojson, table.radius, table.thickness, self.domain.projection
            )
        from floebmi.scalars import read_scalar

        if grid is None or len(grid.shape) != 2:
            raise InputError("file: needs a [grid] of rows and columns, on which land is found")
        land = read_scalar(
            folder / table.file, "land_fraction", grid, self.domain.projection,
            variable=table.variable, select=table.select, position=table.position,
            file_projection=table.file_projection,
            outside={"error": None, "land": 1.0, "water": 0.0}[table.outside],
        )  # fmt: skip
        shape = grid.shape
        # a grid that does not span the whole period ends within it, and so does its land
        period = tuple(
            length if length is not None and _goes_round(grid, axis, length) else None
            for axis, length in enumerate(domain.period)
        )
        return coast.from_land_fraction(
            grid.x.reshape(shape), grid.y.reshape(shape), land.reshape(shape),
            table.radius, table.thickness, period=period,
        )  # fmt: skip

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

    def _source(self, table: FluidTable | None, fluid: "Fluid | None") -> "VelocitySource | None":
        if table is None:
            return None
        from floebmi import forcing

        if table.file is None:
            return forcing.Constant(*(table.velocity or (0.0, 0.0)))
        names = [table.file] if isinstance(table.file, str) else table.file
        paths = [self._file.parent / name for name in names]
        return forcing.VelocityFile(
            paths[0] if len(paths) == 1 else paths,
            fluid.grid,
            kind="ocean" if isinstance(table, Ocean) else "wind",
            projection=self.domain.projection,
            variables=table.variables,
            start=self.time.start,
            vectors=table.vectors,
            stagger=table.stagger,
            depth=table.depth,
            select=table.select,
            units=table.units,
            mask=table.mask,
            fill_land=table.fill_land,
            position=table.position,
            file_projection=table.file_projection,
            beyond_span=table.beyond_span,
            calendar=self.time.calendar,
        )


def _seed_of_group(seed: int, k: int) -> int:
    """What group k of floes, from 0, draws from: no other group's, nor that of any group of another scene's seed."""
    if k == 0:
        return seed
    return int(np.random.SeedSequence(seed, spawn_key=(k,)).generate_state(1, np.uint64)[0])


def _goes_round(grid: Grid, axis: int, length: float) -> bool:
    """Whether a grid of rows and columns ends, along x (0) or y (1), at the image of its begin, straight or not."""
    ny, nx = grid.shape
    corners = np.stack([grid.node_x, grid.node_y]).reshape(2, ny + 1, nx + 1)
    way = np.abs(corners.take(-1, 2 - axis) - corners.take(0, 2 - axis))
    way[axis] -= length
    return bool(np.abs(way).max() < 1e-4 * length)  # places in a file may be in single precision


def _check_open(inflow: Inflow, domain: Domain, polygons: list[np.ndarray]) -> None:
    """Refuse land along a stretch where floes come in: only its shore is lined, new floes would come in behind it."""
    if not polygons:
        return
    import shapely

    from floebmi.coast import land_geometry

    feeder = Feeder(inflow, domain)
    ends = np.full((2, 2), feeder.across(1e-3 * inflow.sizes.range[0]))  # the edge may be a shore
    ends[:, 1 - feeder.axis] = feeder.span
    land = shapely.intersection(land_geometry(polygons, domain), shapely.LineString(ends))
    if land.length > 0:
        low, high = shapely.bounds(land).reshape(2, 2)[:, 1 - feeder.axis]
        raise InputError(
            f"land lies along the edge {inflow.edge} between {low:g} and {high:g} m; give open water as span, one "
            "table for each stretch"
        )


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
    if path.is_file() or path.suffix in _SUFFIXES or len(path.parts) > 1:
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
    if path.suffix not in _SUFFIXES:
        raise InputError(f"{path}: must end in {', '.join(_SUFFIXES)}")
    text = read_text(path)
    tables = parse(text, str(path), yaml=_SUFFIXES[path.suffix])
    changes = tuple(parse_override(override) for override in overrides)
    _as_lists(tables)
    for change in changes:
        apply_override(tables, change, {"contact": ("model", _CONTACTS)})
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
    if name not in packaged():
        raise InputError(f"{name}: no packaged scene; {choose(name, packaged())}")
    source = packaged()[name]
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
