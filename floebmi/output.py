"""Files of a run: fields on the grid, trajectories of floes, and the state for a restart.

The first two are CF NetCDF, grown frame by frame.  The first frame goes to a file of another name, which
then takes the wanted name: either there is a whole frame, or what was there before is untouched.  After
each frame all of it is handed to the operating system, so a killed run leaves a file that opens.  (While
the run goes on, HDF5 locks the file: set HDF5_USE_FILE_LOCKING=FALSE to look at it with other tools;
`floebmi.plot` does without.)

Stress in a file is the mean since the last frame, by the difference of the running impulse, so Σ τ A Δt
over the frames is the impulse, whatever the frames and the exchange intervals are.  What a single
instant has, is that of the frame's time; `cell_methods` tells which is which.

All numbers are stored as float64.  Missing values are NaN: dry cells, properties of ice where there is no
ice, floes that have left or have not yet come.
"""

import contextlib
import datetime
import errno
import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self, final

import numpy as np

import floebmi
from floebmi.clock import date_of, text_of
from floebmi.coast import land_geometry
from floebmi.errors import InputError, choose
from floebmi.files import check_target, disk_full_told, in_one_go, new_file
from floebmi.floes import FIXED_ROTATION, FIXED_X, FIXED_Y, LAND
from floebmi.projection import check_projection, to_lonlat
from floebmi.variables import AXES, FLOE_VARIABLES, VARIABLES, Variable

if TYPE_CHECKING:
    import shapely
    from netCDF4 import Dataset

    from floebmi.grid import Grid
    from floebmi.model import Model

EPOCH = "2000-01-01 00:00:00"  # for runs without a date; `time:epoch` then says "arbitrary"
CHUNK = 4096  # numbers in a chunk of a small field; larger ones: a compressed chunk per frame
ACCOUNT_LENGTH = 32  # characters of a name in the ledger
FILE_VERSION = 1
RESTART_VERSION = 1

_FLAGS = {
    "motion": {
        "flag_masks": np.array([FIXED_X, FIXED_Y, FIXED_ROTATION, LAND], np.int8),
        "flag_meanings": "x_velocity_prescribed y_velocity_prescribed rotation_prescribed land",
    },
    "land_mask": {"flag_values": np.array([0, 1], np.int8), "flag_meanings": "sea land"},
}


class _Place(NamedTuple):
    """A grid as it stands in a file: the dimensions of its fields, and their common attributes."""

    grid: "Grid"
    dimensions: tuple[str, ...]
    attributes: dict[str, str]


class _GrowingFile:
    """A NetCDF file that is whole after its first frame and after each further one."""

    def __init__(self, path: str | Path, overwrite: bool) -> None:
        self.path, self._overwrite = Path(path), overwrite
        self._data: Dataset | None = None
        self._count = 0
        self._last = -np.inf
        self._closed = False
        check_target(self.path, overwrite)

    def close(self) -> None:
        """Close the file; nothing can be written afterwards."""
        data, self._data, self._closed = self._data, None, True
        if data is not None:
            with disk_full_told(self.path):
                data.close()

    def _check_room(self) -> None:
        """Raise OSError if the disk has no room for a frame, while the frames so far are whole.

        HDF5 leaves a file that nobody can open if the disk is full in the middle of a frame.
        """
        size = self.path.stat().st_size
        self._most, self._size = max(self._most, 2 * (size - self._size)), size
        if shutil.disk_usage(self.path.parent).free < self._most:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self.path))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        with contextlib.suppress(*[OSError] * (error[0] is not None)):  # the first error tells more
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
    model : its grids must stay the same
    attributes : global attributes, texts and numbers: title, scene text, licence of the data …
    reference : date of the run's time 0, such as "1979-01-15 12:00"; None: an arbitrary epoch
    calendar : CF calendar of the reference
    projection : the plane of x and y [m], such as "EPSG:3413" (see projection.py); then latitude and
        longitude are written too
    land : rings of shape (k, 2) [m], as in `coast.Coast.polygons`
    names : short names of the variables to write (see variables.py); None: all that the model has
    overwrite : whether an existing file may be replaced

    Raises
    ------
    InputError
        if the file exists already, its folder does not, or an attribute, a date, a projection or a name is
        unusable, or a ring is none.  Nothing is written then.
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
        super().__init__(path, overwrite)
        self._clock = _time_attributes(reference, calendar)
        self._projection = None if projection is None else check_projection(projection)
        self._land = land_geometry(land, model.domain)
        self._attributes = _global_attributes(model, attributes, "gridded")
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
        values = _values(model, self._rows)
        values.update(_mean_stresses(model, self._before, now, self._rows))
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
            _write_ledger(data, k, model)
        self._before = now

    def _define(self, data: "Dataset", model: "Model") -> None:
        data.setncatts(self._attributes)
        data.createDimension("time", None)
        data.createDimension("bnds", 2)
        _define_time(data, self._clock)
        data["time"].bounds = "time_bnds"
        data.createVariable("time_bnds", "f8", ("time", "bnds"), chunksizes=(512, 2))
        _define_ledger(data)
        _define_projection(data, self._projection)
        _define_land(data, self._land)
        places: dict[int, _Place] = {}
        for row in self._rows:
            grid = _grid_of(model, row)
            if id(grid) not in places:
                suffix = "" if grid is model.grid else f"_{row.grid}"
                places[id(grid)] = _define_grid(data, grid, suffix, self._projection)
            place = places[id(grid)]
            variable = data.createVariable(
                row.file_name,
                "f8",
                ("time", *place.dimensions),
                fill_value=np.nan,
                **_storage(place.grid.size, place.grid.shape),
            )
            variable.setncatts({**_describe(row), **place.attributes})


@final
class TrajectoryWriter(_GrowingFile):
    """The floes as CF trajectories, one frame per `write`; trajectory k is floe k for ever.

    Radius, thickness and prescribed motion have no time dimension.  Floes that come in later get new
    trajectories.

    Parameters
    ----------
    path : the file to make
    model : any model
    attributes, reference, calendar, projection, land, overwrite : as for `GriddedWriter`
    changing : which of "radius", "thickness" and "motion" change in time, and then get a time dimension
    contacts : whether contact count, bond count and contact force are written

    Raises
    ------
    InputError
        as `GriddedWriter`.
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
        super().__init__(path, overwrite)
        self._clock = _time_attributes(reference, calendar)
        self._projection = None if projection is None else check_projection(projection)
        self._land = land_geometry(land, model.domain)
        self._attributes = _global_attributes(model, attributes, "trajectories")
        self._attributes["featureType"] = "trajectory"
        constant = {"radius", "thickness", "motion"}
        for name in changing:
            if name not in constant:
                raise InputError(f"{path}: changing = {name!r}; {choose(name, constant)}")
        self._constant = tuple(sorted(constant - set(changing)))
        self._written = {name: np.empty(0) for name in self._constant}
        self._contacts = contacts

    def write(self, model: "Model") -> None:
        """Append the floes at the model's time.

        Raises
        ------
        InputError
            if the time is not later than that of the last frame, or if a property has changed that was said
            to be constant.
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
                _define_walls(data, model.wall_edges)
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
            _write_ledger(data, k, model)
        self._written = {name: values[name].copy() for name in self._constant}

    def _values(self, model: "Model") -> dict[str, np.ndarray]:
        floes = model.floes
        names = ("x", "y", "u", "v", "radius", "thickness", "angle", "angular_velocity", "motion")
        values = {name: getattr(floes, name) for name in names}
        values = {name: value for name, value in values.items() if value is not None}
        if self._contacts:
            values.update(_contact_sums(model))
        if self._projection is not None:
            values.update(_geographic(self._projection, floes.x, floes.y))
        return values

    def _define(self, data: "Dataset", values: Mapping[str, np.ndarray], n: int) -> None:
        data.setncatts(self._attributes)
        data.createDimension("time", None)
        data.createDimension("trajectory", None)
        _define_time(data, self._clock)
        _define_ledger(data)
        _define_projection(data, self._projection)
        _define_land(data, self._land)
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
                    **_storage(width, (width,)),
                )
                if name not in places:
                    variable.coordinates = " ".join(places)
                if self._projection is not None:
                    variable.grid_mapping = "crs"
            variable.setncatts(_describe(rows[name]) if name in rows else _GEOGRAPHIC[name])
            variable.setncatts(_FLAGS.get(name, {}))
        data["x"].axis, data["y"].axis = "X", "Y"


# ---- what stands in the files -----------------------------------------------------------------


def _global_attributes(
    model: "Model", given: Mapping[str, Any] | None, kind: str
) -> dict[str, Any]:
    now = datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    source = f"floebmi {floebmi.__version__}"
    made = {
        "Conventions": "CF-1.11",
        "title": "Sea-ice floes as discrete elements",
        "source": source,
        "history": f"{now}: written by {source}",
        "floebmi_version": floebmi.__version__,
        "floebmi_file": f"{kind} {FILE_VERSION}",
        "contact": repr(model.contact),
        "forces": repr(tuple(model.forces)),
        "step": repr(model.step),
        "seed": model.seed,
        "ice_density": float(model.ice_density),
        "domain_x": np.array(model.domain.x, float),
        "domain_y": np.array(model.domain.y, float),
    }
    made.update((f"domain_{edge}", getattr(model.domain, edge)) for edge in _EDGES)
    if kind == "gridded" and model.grid.kind == "unstructured":
        made["Conventions"] += " UGRID-1.0"
    for name, value in (given or {}).items():
        if name in ("Conventions", "featureType", "floebmi_file"):
            raise InputError(f"attribute {name!r}: is set by the writer; leave it out")
        if not isinstance(value, str | int | float | np.number):
            raise InputError(f"attribute {name!r} = {value!r}: must be a text or a number")
        made[name] = value
    return made


_EDGES = ("west", "east", "south", "north")


def _time_attributes(reference: str | None, calendar: str) -> dict[str, str]:
    date = text_of(reference or EPOCH)
    date_of(date, calendar, "reference")
    attributes = {
        "standard_name": "time",
        "long_name": "time",
        "units": f"seconds since {date}",
        "calendar": calendar,
        "axis": "T",
    }
    if calendar == "standard":
        attributes["units_metadata"] = "leap_seconds: none"
    if reference is None:
        attributes["epoch"] = "arbitrary"
        attributes["comment"] = "the run has no date; these are seconds since its start"
    return attributes


def _define_time(data: "Dataset", attributes: Mapping[str, str]) -> None:
    data.createVariable("time", "f8", ("time",), chunksizes=(512,)).setncatts(attributes)


def _define_walls(data: "Dataset", edges: tuple[str, ...]) -> None:
    if not edges:
        return
    data.createDimension("wall", len(edges))
    data.createVariable("wall", str, ("wall",))[:] = np.array(edges, object)
    data["wall"].long_name = "edge of the domain at which the wall stands"
    for name, units, text in (
        ("wall_position", "m", "coordinate of the wall along its normal"),
        ("wall_normal_stress", "Pa", "normal stress of the ice on the wall, positive presses"),
    ):
        variable = data.createVariable(name, "f8", ("time", "wall"), **_storage(512, (len(edges),)))
        variable.setncatts({"units": units, "long_name": text})


# pyproj knows the CF name of this method on an ellipsoid only
SPHERICAL = "Lambert Azimuthal Equal Area (Spherical)"


def _define_projection(data: "Dataset", projection: str | None) -> None:
    if projection is None:
        return
    import pyproj

    crs = pyproj.CRS.from_user_input(projection)
    attributes = crs.to_cf()
    name = attributes.get(
        "grid_mapping_name"
    )  # a projection that CF does not know is told by its crs_wkt
    if name is None and crs.coordinate_operation.method_name == SPHERICAL:
        values = {p.name: p.value for p in crs.coordinate_operation.params}
        attributes |= {
            "grid_mapping_name": "lambert_azimuthal_equal_area",
            "latitude_of_projection_origin": values["Latitude of natural origin"],
            "longitude_of_projection_origin": values["Longitude of natural origin"],
            "false_easting": values["False easting"],
            "false_northing": values["False northing"],
            "earth_radius": crs.ellipsoid.semi_major_metre,
        }
    if name == "polar_stereographic":
        # CF asks for the pole beside the standard parallel; pyproj leaves it out
        pole = np.copysign(90.0, attributes.get("standard_parallel", 90.0))
        attributes.setdefault("latitude_of_projection_origin", pole)
    _container(data, "crs", attributes)


def _container(data: "Dataset", name: str, attributes: Mapping[str, Any]) -> None:
    """A variable whose number means nothing: its attributes count."""
    container = data.createVariable(name, "i4")
    container.setncatts(attributes)
    container[...] = 0


_GEOGRAPHIC = {
    "latitude": {
        "standard_name": "latitude",
        "long_name": "latitude",
        "units": "degrees_north",
    },
    "longitude": {
        "standard_name": "longitude",
        "long_name": "longitude",
        "units": "degrees_east",
    },
}


def _geographic(projection: str, x: np.ndarray, y: np.ndarray) -> dict[str, np.ndarray]:
    longitude, latitude = to_lonlat(projection, x, y)
    return {"latitude": latitude, "longitude": longitude}


def _define_land(data: "Dataset", land: "shapely.Geometry") -> None:
    """Land as CF polygons (CF 7.5): shores counter-clockwise, lakes clockwise."""
    import shapely

    shapes = [shapely.geometry.polygon.orient(part) for part in shapely.get_parts(land)]
    if not shapes:
        return
    rings = [shapely.get_rings(shape) for shape in shapes]
    nodes = [shapely.get_coordinates(ring) for of_shape in rings for ring in of_shape]
    data.createDimension("land", len(shapes))
    data.createDimension("land_ring", len(nodes))
    data.createDimension("land_node", sum(map(len, nodes)))
    _container(
        data,
        "land_polygons",
        {
            "geometry_type": "polygon",
            "node_coordinates": "land_x land_y",
            "node_count": "land_node_count",
            "part_node_count": "land_ring_node_count",
            "interior_ring": "land_interior_ring",
        },
    )
    for name, dimension, text, values in (
        (
            "node_count",
            "land",
            "corners of each piece of land",
            map(shapely.count_coordinates, shapes),
        ),
        ("ring_node_count", "land_ring", "corners of each ring", map(len, nodes)),
        (
            "interior_ring",
            "land_ring",
            "0 for a shore, 1 for the shore of a lake",
            (int(k > 0) for of_shape in rings for k in range(len(of_shape))),
        ),
    ):
        variable = data.createVariable(f"land_{name}", "i4", (dimension,), fill_value=False)
        variable.long_name = text
        variable[:] = list(values)
    for axis, values in zip("xy", np.concatenate(nodes).T, strict=True):
        corner = data.createVariable(f"land_{axis}", "f8", ("land_node",))
        corner.setncatts({"axis": axis.upper(), "units": "m", "long_name": "corner of land"})
        corner[:] = values


def _define_grid(data: "Dataset", grid: "Grid", suffix: str, projection: str | None) -> _Place:
    """Dimensions, coordinates, bounds, areas and mask of a grid."""
    if grid.kind == "unstructured":
        dimensions = (f"cell{suffix}",)
        corners = _define_mesh
    elif grid.x_edges is None:
        dimensions = (f"j{suffix}", f"i{suffix}")
        corners = _define_corners
    else:
        dimensions = (f"y{suffix}", f"x{suffix}")
        corners = _define_edges
    for name, size in zip(dimensions, grid.shape, strict=True):
        data.createDimension(name, size)
    attributes = corners(data, grid, suffix, dimensions)
    if projection is not None:
        attributes["grid_mapping"] = "crs"
        for name, values in _geographic(projection, grid.x, grid.y).items():
            place = data.createVariable(name + suffix, "f8", dimensions)
            place.setncatts(_GEOGRAPHIC[name])
            place[:] = values.reshape(grid.shape)
            attributes["coordinates"] = (
                f"{attributes.get('coordinates', '')} {name}{suffix}".strip()
            )
    area = data.createVariable(f"cell_area{suffix}", "f8", dimensions)
    area.setncatts({"standard_name": "cell_area", "long_name": "area of the cell", "units": "m2"})
    area.setncatts(attributes)
    area[:] = grid.area.reshape(grid.shape)
    if not grid.wet.all():
        mask = data.createVariable(f"land_mask{suffix}", "i1", dimensions, fill_value=False)
        mask.setncatts({"standard_name": "land_binary_mask", "long_name": "1 on land, 0 on sea"})
        mask.setncatts({"units": "1", **_FLAGS["land_mask"], **attributes})
        mask[:] = ~grid.wet.reshape(grid.shape)
    return _Place(grid, dimensions, {"cell_measures": f"area: cell_area{suffix}", **attributes})


def _centre(axis: str) -> dict[str, str]:
    return {
        "standard_name": f"projection_{axis}_coordinate",
        "long_name": f"{axis} of the cell's centre",
        "units": "m",
    }


def _define_edges(
    data: "Dataset", grid: "Grid", suffix: str, dimensions: tuple[str, ...]
) -> dict[str, str]:
    ny, nx = grid.shape
    centres = {"y": grid.y.reshape(ny, nx)[:, 0], "x": grid.x.reshape(ny, nx)[0]}
    edges = {"y": grid.y_edges, "x": grid.x_edges}
    for axis, name in zip("yx", dimensions, strict=True):
        centre = data.createVariable(name, "f8", (name,))
        centre.setncatts({**_centre(axis), "axis": axis.upper(), "bounds": f"{name}_bnds"})
        centre[:] = centres[axis]
        bounds = data.createVariable(f"{name}_bnds", "f8", (name, "bnds"))
        bounds[:] = np.stack([edges[axis][:-1], edges[axis][1:]], axis=1)
    return {}


def _define_corners(
    data: "Dataset", grid: "Grid", suffix: str, dimensions: tuple[str, ...]
) -> dict[str, str]:
    data.createDimension(f"corner{suffix}", 4)
    for axis in "xy":
        name = axis + suffix
        centre = data.createVariable(name, "f8", dimensions)
        centre.setncatts({**_centre(axis), "bounds": f"{name}_bnds"})
        centre[:] = getattr(grid, axis).reshape(grid.shape)
        bounds = data.createVariable(f"{name}_bnds", "f8", (*dimensions, f"corner{suffix}"))
        bounds[:] = getattr(grid, f"node_{axis}")[grid.face_nodes].reshape(*grid.shape, 4)
    return {"coordinates": f"x{suffix} y{suffix}"}


def _define_mesh(
    data: "Dataset", grid: "Grid", suffix: str, dimensions: tuple[str, ...]
) -> dict[str, str]:
    """Polygons by the UGRID conventions."""
    (cell,) = dimensions
    data.createDimension(f"node{suffix}", grid.node_x.size)
    data.createDimension(f"corner{suffix}", grid.face_nodes.shape[1])
    _container(
        data,
        f"mesh{suffix}",
        {
            "cf_role": "mesh_topology",
            "long_name": "cells of the exchange grid",
            "topology_dimension": np.int32(2),
            "node_coordinates": f"node_x{suffix} node_y{suffix}",
            "face_coordinates": f"x{suffix} y{suffix}",
            "face_node_connectivity": f"face_nodes{suffix}",
            "face_dimension": cell,
        },
    )
    faces = data.createVariable(
        f"face_nodes{suffix}", "i4", (cell, f"corner{suffix}"), fill_value=-1
    )
    faces.setncatts(
        {
            "cf_role": "face_node_connectivity",
            "long_name": "nodes of each cell, counter-clockwise",
            "start_index": np.int32(0),
        }
    )
    faces[:] = grid.face_nodes
    for axis in "xy":
        node = data.createVariable(f"node_{axis}{suffix}", "f8", (f"node{suffix}",))
        node.setncatts({**_centre(axis), "long_name": f"{axis} of the node"})
        node[:] = getattr(grid, f"node_{axis}")
        centre = data.createVariable(axis + suffix, "f8", dimensions)
        centre.setncatts(_centre(axis))
        centre[:] = getattr(grid, axis)
    return {
        "coordinates": f"x{suffix} y{suffix}",
        "mesh": f"mesh{suffix}",
        "location": "face",
    }


def _describe(row: Variable) -> dict[str, str]:
    attributes = {"long_name": row.text, "units": row.units, "csdms_name": row.csdms}
    if row.cf is not None:
        attributes["standard_name"] = row.cf
    if row.positive:
        attributes["comment"] = row.positive
    if row.grid != "floe":
        attributes["cell_methods"] = row.mean
    return attributes


def _storage(size: int, shape: tuple[int, ...]) -> dict[str, Any]:
    """Large fields: one compressed chunk per frame; small ones: plain chunks of several frames."""
    if size >= CHUNK:
        return {"chunksizes": (1, *shape), "compression": "zlib", "complevel": 1}
    return {"chunksizes": (CHUNK // size, *shape)}


def _grid_of(model: "Model", row: Variable) -> "Grid":
    fluid = {"ocean": model.ocean, "atmosphere": model.atmosphere}.get(row.grid)
    return model.grid if fluid is None else fluid.grid


def _rows_of(model: "Model", names: Sequence[str] | None) -> list[Variable]:
    """The rows of the table that the model has and that were asked for."""
    fields = model.fields()
    has = [
        row
        for row in VARIABLES
        if (row.name in fields if row.intent == "out" else row.array_in(model) is not None)
    ]
    if names is None:
        return has
    known = [row.name for row in has]
    for name in names:
        if name not in known:
            raise InputError(
                f"names = {name!r}: this model has no such field; {choose(name, known)}"
            )
    return [row for row in has if row.name in names]


def _values(model: "Model", rows: list[Variable]) -> dict[str, np.ndarray]:
    values = dict(model.fields())
    values.update((row.name, row.array_in(model)) for row in rows if row.intent == "in")
    return values


def _impulses(model: "Model") -> dict[str, np.ndarray]:
    """What the running impulses are now [N s per cell], with the sign of the stresses in the table."""
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
    """Mean stress since the last frame [Pa]; NaN if no time has passed."""
    span = now[0] - before[0]
    return {
        row.name: (now[1][row.name] - before[1][row.name]) / (_grid_of(model, row).area * span)
        if span > 0.0
        else np.full(_grid_of(model, row).size, np.nan)
        for row in rows
        if row.name in now[1]
    }


def _contact_sums(model: "Model") -> dict[str, np.ndarray]:
    """Contacts, bonds, the sum of |force| and the pressure of each floe (eq. floe-pressure)."""
    f, n = model.floes, len(model.floes)
    pairs = model.contacts()
    ends = np.concatenate([pairs.i, pairs.j])

    def per_floe(values: np.ndarray) -> np.ndarray:
        sums = np.bincount(ends, values, minlength=n)
        return sums.astype(np.float64)  # without any contact they come as integers

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


# ---- ledger -----------------------------------------------------------------------------------


def _define_ledger(data: "Dataset") -> None:
    from floebmi.budgets import QUANTITIES, UNITS

    data.createDimension("ledger_account", None)
    data.createDimension("ledger_quantity", len(QUANTITIES))
    quantity = data.createVariable("ledger_quantity", str, ("ledger_quantity",))
    quantity.long_name = "what is booked: " + ", ".join(
        f"{name} [{unit}]" for name, unit in zip(QUANTITIES, UNITS, strict=True)
    )
    quantity[:] = np.array(QUANTITIES, object)
    # characters, not strings: HDF5 keeps strings of a variable length apart from the rows that point to
    # them, and a run that is killed while both go to the disk would leave rows that point to nothing
    data.createDimension("ledger_name", ACCOUNT_LENGTH)
    account = data.createVariable(
        "ledger_account",
        "S1",
        ("ledger_account", "ledger_name"),
        chunksizes=(16, ACCOUNT_LENGTH),
    )
    account.long_name = "accounts of the ledger"
    account.setncattr("_Encoding", "utf-8")
    gained = data.createVariable(
        "ledger_gained",
        "f8",
        ("time", "ledger_account", "ledger_quantity"),
        fill_value=np.nan,
        chunksizes=(64, 4, len(QUANTITIES)),
    )
    gained.long_name = "what each account has brought to the ice since the start"
    stock = data.createVariable(
        "ledger_stock",
        "f8",
        ("time", "ledger_quantity"),
        chunksizes=(128, len(QUANTITIES)),
    )
    stock.long_name = "what the ice has"


def _write_ledger(data: "Dataset", k: int, model: "Model") -> None:
    accounts = model.ledger.accounts
    data["ledger_stock"][k] = model.ledger.now
    if accounts:
        data["ledger_account"][: len(accounts)] = np.array(list(accounts), f"U{ACCOUNT_LENGTH}")
        data["ledger_gained"][k, : len(accounts)] = np.array(list(accounts.values()))


# ---- reading ----------------------------------------------------------------------------------


@contextlib.contextmanager
def open_file(path: str | Path, *kinds: str) -> Iterator["Dataset"]:
    """A file of this module for reading, also while a run still writes it.

    Parameters
    ----------
    path : the file
    kinds : which may be opened: "gridded", "trajectories", "tradeoff"

    Raises
    ------
    InputError
        if there is no such file, it is no NetCDF file, or not one of these kinds and of this version.
    """
    from netCDF4 import Dataset

    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: there is no such file")
    with contextlib.ExitStack() as stack:
        try:
            data = stack.enter_context(Dataset(path))
        except OSError:
            # HDF5 locks a file that is being written; a copy of it is not locked
            copy = Path(stack.enter_context(tempfile.TemporaryDirectory())) / path.name
            copy.write_bytes(path.read_bytes())
            try:
                data = stack.enter_context(Dataset(copy))
            except OSError:
                raise InputError(f"{path}: is no NetCDF file, or a damaged one") from None
        other = "a restart file" if "floebmi_restart" in data.ncattrs() else "none of floebmi's"
        found = str(getattr(data, "floebmi_file", other))
        wanted = [f"{kind} {FILE_VERSION}" for kind in kinds]
        if found not in wanted:
            raise InputError(f"{path}: is {found!r}; must be {' or '.join(map(repr, wanted))}")
        yield data


# ---- restart ----------------------------------------------------------------------------------


def save_restart(
    path: str | Path, state: Mapping[str, Any], attributes: Mapping[str, Any] | None = None
) -> None:
    """Save a state so that `load_restart` gives back the same bits.

    The file is written under another name and takes its own name when it is whole and on the disk; an
    older restart file of that name is replaced then, and not before.

    Parameters
    ----------
    path : the file to make
    state : arrays of numbers, bools or texts of any shape, texts, bytes, numbers, bools, None, and
        mappings of such
    attributes : texts and numbers that describe the state, for people

    Raises
    ------
    InputError
        for a value of another kind, or a missing folder.
    """

    path = Path(path)
    check_target(path, overwrite=True)
    flat = dict(_flatten(state, ()))
    packed = {name: _pack(name, value) for name, value in flat.items()}
    told = {"floebmi_version": floebmi.__version__, **(attributes or {})}
    with disk_full_told(path), in_one_go(path, overwrite=True) as part:
        with new_file(part) as data:
            data.setncatts(told)
            data.floebmi_restart = np.int32(RESTART_VERSION)
            data.checksum = _checksum(packed, told)
            for name, (kind, array) in packed.items():
                _write_entry(data, name, kind, array)
        with open(part, "rb") as file:
            os.fsync(file.fileno())


def load_restart(path: str | Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """The state and the attributes that `save_restart` wrote.

    Raises
    ------
    InputError
        if there is no such file, it is damaged, or of another version.
    """
    from netCDF4 import Dataset

    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: there is no such restart file")
    damaged = InputError(f"{path}: is no restart file, or a damaged one; take an older one")
    try:
        with Dataset(path) as data:
            data.set_auto_mask(False)
            attributes = {name: data.getncattr(name) for name in data.ncattrs()}
            version = attributes.pop("floebmi_restart", None)
            if version is None:
                raise damaged
            if version != RESTART_VERSION:
                raise InputError(
                    f"{path}: restart file of version {version}; this floebmi reads {RESTART_VERSION}"
                )
            packed = {
                name: (variable.kind, _read_entry(variable))
                for name, variable in _entries(data, "")
            }
            intact = attributes.pop("checksum") == _checksum(packed, attributes)
    except (OSError, RuntimeError, KeyError, AttributeError):
        raise damaged from None
    if not intact:
        raise damaged
    state: dict[str, Any] = {}
    for name, (kind, array) in packed.items():
        *folders, last = name.split("/")
        into = state
        for folder in folders:
            into = into.setdefault(folder, {})
        if kind != "mapping":
            into[last] = _unpack(kind, array)
        else:
            into.setdefault(last, {})
    return state, attributes


def _flatten(state: Mapping[str, Any], above: tuple[str, ...]) -> Iterator[tuple[str, Any]]:
    for name, value in state.items():
        if not isinstance(name, str) or not name or "/" in name:
            raise InputError(f"restart: key {name!r}: must be a text without '/'")
        path = (*above, name)
        if isinstance(value, Mapping) and value:
            yield from _flatten(value, path)
        else:
            yield "/".join(path), value


def _pack(name: str, value: Any) -> tuple[str, np.ndarray]:
    """A word for what the value is, and an array that holds it to the last bit."""
    if isinstance(value, Mapping):
        return "mapping", np.zeros(0, np.uint8)
    if value is None:
        return "none", np.zeros(0, np.uint8)
    if isinstance(value, bytes):
        return "bytes", np.frombuffer(value, np.uint8)
    if isinstance(value, str):
        return "text", _as_bytes(value)
    if isinstance(value, bool):
        return "bool", np.array(value, np.uint8)
    if isinstance(value, int):  # may be longer than 64 bits, as in the state of a random generator
        return "int", _as_bytes(str(value))
    if isinstance(value, float):
        return "float", np.array(value)
    array = np.asarray(value)
    if array.dtype.kind == "U":
        told = {"shape": array.shape, "dtype": array.dtype.str, "texts": array.ravel().tolist()}
        return "texts", _as_bytes(json.dumps(told))
    if array.dtype == np.bool_:
        return "bools", array.astype(np.uint8)
    if array.dtype.kind in "iuf" and array.dtype.itemsize <= 8 and array.dtype.isnative:
        return "array", array
    raise InputError(f"restart: {name} is {type(value).__name__} {array.dtype}: cannot be saved")


def _unpack(kind: str, array: np.ndarray) -> Any:
    if kind == "none":
        return None
    if kind == "bytes":
        return array.tobytes()
    if kind == "text":
        return array.tobytes().decode()
    if kind == "bool":
        return bool(array)
    if kind == "int":
        return int(array.tobytes().decode())
    if kind == "float":
        return float(array)
    if kind == "texts":
        told = json.loads(array.tobytes())
        return np.array(told["texts"], told["dtype"]).reshape(told["shape"])
    return array.astype(np.bool_) if kind == "bools" else array


def _as_bytes(text: str) -> np.ndarray:
    return np.frombuffer(text.encode(), np.uint8)


def _write_entry(data: "Dataset", name: str, kind: str, array: np.ndarray) -> None:
    """A variable of this path; numbers of a length n share the dimension n of the file."""
    dimensions = []
    for size in array.shape:
        if (dimension := f"n{size}") not in data.dimensions:
            data.createDimension(dimension, size)  # of size 0: an unlimited one that stays empty
        dimensions.append(dimension)
    variable = data.createVariable(name, array.dtype, dimensions, fill_value=False)
    variable.kind = kind
    variable.set_auto_maskandscale(False)
    if array.size:
        variable[...] = array


def _entries(group: Any, above: str) -> Iterator[tuple[str, Any]]:
    for name, variable in group.variables.items():
        yield above + name, variable
    for name, inner in group.groups.items():
        yield from _entries(inner, f"{above}{name}/")


def _read_entry(variable: Any) -> np.ndarray:
    variable.set_auto_maskandscale(False)
    return np.ascontiguousarray(variable[...]).reshape(variable.shape)


def _checksum(packed: Mapping[str, tuple[str, np.ndarray]], attributes: Mapping[str, Any]) -> str:
    digest = hashlib.sha256()
    for name in sorted(attributes):
        digest.update(f"{name} {attributes[name]}\n".encode())
    for name in sorted(packed):
        kind, array = packed[name]
        digest.update(f"{name} {kind} {array.dtype.str} {array.shape}\n".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
