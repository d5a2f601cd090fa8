"""How times, grids, land, projections and the ledger stand in a NetCDF file, by the CF and UGRID conventions.

A `define_…` makes dimensions and variables of a file that is open for writing, and fills those that do not grow.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from floebmi.budgets import QUANTITIES, UNITS, Ledger
from floebmi.clock import date_of, text_of
from floebmi.floes import FIXED_ROTATION, FIXED_X, FIXED_Y, LAND
from floebmi.projection import to_lonlat
from floebmi.variables import Variable

if TYPE_CHECKING:
    import shapely
    from netCDF4 import Dataset

    from floebmi.grid import Grid

EPOCH = "2000-01-01 00:00:00"  # for runs without a date; `time:epoch` then says "arbitrary"
CHUNK = 4096  # numbers in a chunk of a small field; larger ones: a compressed chunk per frame
ACCOUNT_LENGTH = 32  # characters of a name in the ledger

FLAGS = {
    "motion": {
        "flag_masks": np.array([FIXED_X, FIXED_Y, FIXED_ROTATION, LAND], np.int8),
        "flag_meanings": "x_velocity_prescribed y_velocity_prescribed rotation_prescribed land",
    },
    "land_mask": {"flag_values": np.array([0, 1], np.int8), "flag_meanings": "sea land"},
}


class GridInFile(NamedTuple):
    """A grid as it stands in a file: the dimensions of its fields, and the attributes that they share."""

    dimensions: tuple[str, ...]
    attributes: dict[str, str]


def time_attributes(reference: str | None, calendar: str) -> dict[str, str]:
    """Of the variable `time`; InputError for a reference that is no date of the calendar."""
    date = text_of(EPOCH if reference is None else reference)
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


def define_time(data: "Dataset", attributes: Mapping[str, str]) -> None:
    data.createVariable("time", "f8", ("time",), chunksizes=(512,)).setncatts(attributes)


def define_walls(data: "Dataset", edges: tuple[str, ...]) -> None:
    """Position and stress in time of walls that stand at these edges of the domain."""
    if not edges:
        return
    data.createDimension("wall", len(edges))
    data.createVariable("wall", str, ("wall",))[:] = np.array(edges, object)
    data["wall"].long_name = "edge of the domain at which the wall stands"
    for name, units, text in (
        ("wall_position", "m", "coordinate of the wall along its normal"),
        ("wall_normal_stress", "Pa", "normal stress of the ice on the wall, positive presses"),
    ):
        variable = data.createVariable(name, "f8", ("time", "wall"), **storage(512, (len(edges),)))
        variable.setncatts({"units": units, "long_name": text})


# pyproj knows the CF name of this method on an ellipsoid only
SPHERICAL = "Lambert Azimuthal Equal Area (Spherical)"


def define_projection(data: "Dataset", projection: str | None) -> None:
    """The grid mapping `crs`."""
    if projection is None:
        return
    import pyproj

    crs = pyproj.CRS.from_user_input(projection)
    attributes = crs.to_cf()
    name = attributes.get("grid_mapping_name")  # else its crs_wkt tells what CF does not know
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


GEOGRAPHIC = {
    name: {"standard_name": name, "long_name": name, "units": units}
    for name, units in (("latitude", "degrees_north"), ("longitude", "degrees_east"))
}


def geographic(projection: str, x: np.ndarray, y: np.ndarray) -> dict[str, np.ndarray]:
    """Latitude and longitude [degrees] of points of the plane, by name; `GEOGRAPHIC` has their attributes."""
    longitude, latitude = to_lonlat(projection, x, y)
    return {"latitude": latitude, "longitude": longitude}


def define_land(data: "Dataset", land: "shapely.Geometry", projection: str | None) -> None:
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
            **({} if projection is None else {"grid_mapping": "crs"}),
        },
    )
    corners = map(shapely.count_coordinates, shapes)
    lakes = (int(k > 0) for of_shape in rings for k in range(len(of_shape)))
    for name, dimension, text, values in (
        ("node_count", "land", "corners of each piece of land", corners),
        ("ring_node_count", "land_ring", "corners of each ring", map(len, nodes)),
        ("interior_ring", "land_ring", "0 for a shore, 1 for the shore of a lake", lakes),
    ):
        variable = data.createVariable(f"land_{name}", "i4", (dimension,), fill_value=False)
        variable.long_name = text
        variable[:] = list(values)
    for axis, values in zip("xy", np.concatenate(nodes).T, strict=True):
        corner = data.createVariable(f"land_{axis}", "f8", ("land_node",))
        corner.setncatts({"axis": axis.upper(), "units": "m", "long_name": "corner of land"})
        corner[:] = values


def define_grid(data: "Dataset", grid: "Grid", suffix: str, projection: str | None) -> GridInFile:
    """Dimensions, coordinates, bounds, areas and mask of a grid."""
    if grid.kind == "unstructured":
        dimensions = (f"cell{suffix}",)
        define = _define_mesh
    elif grid.x_edges is None:
        dimensions = (f"j{suffix}", f"i{suffix}")
        define = _define_corners
    else:
        dimensions = (f"y{suffix}", f"x{suffix}")
        define = _define_edges
    for name, size in zip(dimensions, grid.shape, strict=True):
        data.createDimension(name, size)
    attributes = define(data, grid, suffix, dimensions)
    if projection is not None:
        attributes["grid_mapping"] = "crs"
        _define_geographic(data, grid, suffix, dimensions, projection)
        known = attributes.get("coordinates", "")
        attributes["coordinates"] = f"{known} latitude{suffix} longitude{suffix}".strip()
    area = data.createVariable(f"cell_area{suffix}", "f8", dimensions)
    area.setncatts({"standard_name": "cell_area", "units": "m2"})
    area.long_name = "area of the cell in the plane of x and y"
    area.setncatts(attributes)
    area[:] = grid.area.reshape(grid.shape)
    if not grid.wet.all():
        mask = data.createVariable(f"land_mask{suffix}", "i1", dimensions, fill_value=False)
        mask.setncatts({"standard_name": "land_binary_mask", "long_name": "1 on land, 0 on sea"})
        mask.setncatts({"units": "1", **FLAGS["land_mask"], **attributes})
        mask[:] = ~grid.wet.reshape(grid.shape)
    return GridInFile(dimensions, {"cell_measures": f"area: cell_area{suffix}", **attributes})


def _define_geographic(
    data: "Dataset", grid: "Grid", suffix: str, dimensions: tuple[str, ...], projection: str
) -> None:
    """Latitude and longitude of the centres, with those of the corners as bounds: conservative remapping asks for them."""
    nodes = geographic(projection, grid.node_x, grid.node_y)
    faces = grid.face_nodes
    corners = np.sum(faces >= 0, axis=1)
    # a cell with fewer corners than others repeats its last one: a side of no length changes no area
    which = np.minimum(np.arange(faces.shape[1]), corners[:, None] - 1)
    faces = np.take_along_axis(faces, which, axis=1)
    corner = f"corner{suffix}"
    if corner not in data.dimensions:  # rectilinear: x and y have edges instead
        data.createDimension(corner, faces.shape[1])
    for name, values in geographic(projection, grid.x, grid.y).items():
        place = data.createVariable(name + suffix, "f8", dimensions)
        place.setncatts({**GEOGRAPHIC[name], "bounds": f"{name}{suffix}_bnds"})
        place[:] = values.reshape(grid.shape)
        bounds = data.createVariable(f"{name}{suffix}_bnds", "f8", (*dimensions, corner))
        bounds[:] = nodes[name][faces].reshape(*grid.shape, -1)


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
    return {"coordinates": f"x{suffix} y{suffix}", "mesh": f"mesh{suffix}", "location": "face"}


def describe(row: Variable) -> dict[str, str]:
    """The attributes of a variable of the table."""
    attributes = {"long_name": row.text, "units": row.units, "csdms_name": row.csdms}
    if row.cf is not None:
        attributes["standard_name"] = row.cf
    if row.positive:
        attributes["comment"] = row.positive
    if row.grid != "floe":
        attributes["cell_methods"] = row.mean
    return attributes


def storage(size: int, shape: tuple[int, ...]) -> dict[str, Any]:
    """Large fields: one compressed chunk per frame; small ones: plain chunks of several frames."""
    if size >= CHUNK:
        return {"chunksizes": (1, *shape), "compression": "zlib", "complevel": 1}
    return {"chunksizes": (CHUNK // size, *shape)}


def define_ledger(data: "Dataset") -> None:
    """The ledger in time; its accounts get their names as they come up."""
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
        "ledger_account", "S1", ("ledger_account", "ledger_name"), chunksizes=(16, ACCOUNT_LENGTH)
    )
    account.long_name = "accounts of the ledger"
    account.setncattr("_Encoding", "utf-8")
    gained = data.createVariable(
        "ledger_gained", "f8", ("time", "ledger_account", "ledger_quantity"),
        fill_value=np.nan, chunksizes=(64, 4, len(QUANTITIES)),
    )  # fmt: skip
    gained.long_name = "what each account has brought to the ice since the start"
    stock = data.createVariable(
        "ledger_stock", "f8", ("time", "ledger_quantity"), chunksizes=(128, len(QUANTITIES))
    )
    stock.long_name = "what the ice has"


def write_ledger(data: "Dataset", k: int, ledger: Ledger) -> None:
    """The ledger as it is now, into frame k."""
    accounts = ledger.accounts
    data["ledger_stock"][k] = ledger.now
    if accounts:
        data["ledger_account"][: len(accounts)] = np.array(list(accounts), f"U{ACCOUNT_LENGTH}")
        data["ledger_gained"][k, : len(accounts)] = np.array(list(accounts.values()))
