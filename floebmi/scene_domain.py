"""Where a scene takes place: the tables of domain, grid, coast and inflow, and what each of them makes."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from floebmi.boundaries import EDGES, Domain, Edge, Feeder, Inflow, check_domain
from floebmi.errors import InputError
from floebmi.grid import Grid
from floebmi.projection import check_projection
from floebmi.quantities import Count, Positive, unmasked
from floebmi.scene_floes import SizeTable, sizes_of
from floebmi.scene_keys import FileProjection, Pair, Position, ScenePath, Sea, Select
from floebmi.tables import Table, law_of, one_of, table_of

if TYPE_CHECKING:
    from netCDF4 import Variable

    from floebmi.coast import Coast


# ---- domain and grid ----------------------------------------------------------------------------

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
        given = self.model_fields_set & {*EDGES}
        if self.edges is not None and given:
            raise InputError(f"edges and {min(given)} exclude each other; give one")
        return self

    def build(self) -> Domain:
        domain = law_of(self, Domain)
        if self.edges is not None:
            domain = domain._replace(**dict.fromkeys(EDGES, self.edges))
        check_domain(domain)
        if self.projection is not None:
            check_projection(self.projection)
        return domain


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

    def build(self, sea: Sea) -> Grid:
        return Grid.uniform(
            self.x or sea.domain.x, self.y or sea.domain.y, self.spacing, self.shape
        )


class Rectilinear(Table):
    """Rectangles between given edges."""

    kind: Literal["rectilinear"] = "rectilinear"
    x_edges: list[float] = Field(description="edges of the columns [m], increasing")
    y_edges: list[float] = Field(description="edges of the rows [m], increasing")

    def build(self, sea: Sea) -> Grid:
        return Grid.rectilinear(self.x_edges, self.y_edges)


class Curvilinear(Table):
    """Quadrilaterals, from a NetCDF file with x_corners and y_corners (ny + 1, nx + 1), in metres or the units that the file states."""

    kind: Literal["curvilinear"] = "curvilinear"
    file: ScenePath = Field(
        description="NetCDF file with x_corners and y_corners (ny + 1, nx + 1) [m]"
    )

    def build(self, sea: Sea) -> Grid:
        return Grid.curvilinear(*_arrays(sea.folder / self.file, "x_corners", "y_corners"))


class Unstructured(Table):
    """Polygons, from a NetCDF file with node_x, node_y and face_nodes (cells, corners), padded with −1 or its _FillValue."""

    kind: Literal["unstructured"] = "unstructured"
    file: ScenePath = Field(
        description="NetCDF file with node_x, node_y [m] and face_nodes (cells, corners), padded with -1"
    )

    def build(self, sea: Sea) -> Grid:
        x, y, faces = _arrays(sea.folder / self.file, "node_x", "node_y", "face_nodes")
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
    select: Select = None
    outside: Literal["error", "land", "water"] = Field(
        "error", description="what a cell outside the file counts as"
    )
    position: Position = "auto"
    file_projection: FileProjection = None
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

    def build(self, sea: Sea) -> "Coast":
        """The land, of a scene whose sea has none yet."""
        from floebmi import coast

        if self.geojson is not None:
            return coast.from_geojson(
                sea.folder / self.geojson, self.radius, self.thickness, sea.projection
            )
        from floebmi.scalars import read_scalar

        grid = sea.grid
        if grid is None or len(grid.shape) != 2:
            raise InputError("file: needs a [grid] of rows and columns, on which land is found")
        land = read_scalar(
            sea.folder / self.file, "land_fraction", grid, sea.projection,
            variable=self.variable, select=self.select, position=self.position,
            file_projection=self.file_projection,
            outside={"error": None, "land": 1.0, "water": 0.0}[self.outside],
        )  # fmt: skip
        # a grid that does not span the whole period ends within it, and so does its land
        period = tuple(
            length if length is not None and _goes_round(grid, axis, length) else None
            for axis, length in enumerate(sea.domain.period)
        )
        x, y, land = (values.reshape(grid.shape) for values in (grid.x, grid.y, land))
        return coast.from_land_fraction(x, y, land, self.radius, self.thickness, period=period)


def _goes_round(grid: Grid, axis: int, length: float) -> bool:
    """Whether a grid of rows and columns ends, along x (0) or y (1), at the image of its begin, straight or not."""
    ny, nx = grid.shape
    corners = np.stack([grid.node_x, grid.node_y]).reshape(2, ny + 1, nx + 1)
    way = np.abs(corners.take(-1, 2 - axis) - corners.take(0, 2 - axis))
    way[axis] -= length
    return bool(np.abs(way).max() < 1e-4 * length)  # places in a file may be in single precision


_Inflow: Any = table_of(Inflow)


class InflowTable(_Inflow):
    """New floes along an edge of the domain, each as soon as there is room for it."""

    sizes: SizeTable = Field(description="floe size distribution (by number of floes)")

    def build(self, sea: Sea) -> Inflow:
        return law_of(self, Inflow)._replace(sizes=sizes_of(self.sizes, sea.folder))


def check_open(inflow: Inflow, sea: Sea) -> None:
    """Refuse land along a stretch where floes come in: only its shore is lined, new floes would come in behind it."""
    if sea.land is None or not sea.land.polygons:
        return
    import shapely

    from floebmi.coast import land_geometry

    feeder = Feeder(inflow, sea.domain)
    ends = np.full((2, 2), feeder.across(1e-3 * inflow.sizes.range[0]))  # the edge may be a shore
    ends[:, 1 - feeder.axis] = feeder.span
    land = land_geometry(sea.land.polygons, sea.domain)
    land = shapely.intersection(land, shapely.LineString(ends))
    if land.length > 0:
        low, high = shapely.bounds(land).reshape(2, 2)[:, 1 - feeder.axis]
        raise InputError(
            f"land lies along the edge {inflow.edge} between {low:g} and {high:g} m; give open water as span, one "
            "table for each stretch"
        )
