"""ParaView files from the output files of a run: floes as points, fields as cells, one file per frame.

A `.pvd` file lists the frames with their times; open that one.  Floes are points with a radius: show
them with the filter "Glyph" (a cylinder or a 2-D circle, scaled by `radius`), or as "Point Gaussian".

The XML of VTK is written here, in a few lines, for lack of a light package: `meshio` writes neither
PolyData nor collections (its time series are XDMF), and `pyvista` and `vtk` can do it but are a
hundred megabytes in size.  Numbers are base64 of the raw bytes, so they are
exact, and VTK readers need no decompression.
"""

import base64
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from floebmi.errors import InputError, in_line
from floebmi.files import check_new_folder, in_one_go, path_of
from floebmi.output import open_file
from floebmi.variables import FLOE_VARIABLES, VARIABLES

if TYPE_CHECKING:
    from netCDF4 import Dataset

_POLYGON = 7  # VTK's number of this cell type
_TYPES = {"f8": "Float64", "i8": "Int64", "i4": "Int32", "i1": "Int8", "u1": "UInt8"}


class _Mesh(NamedTuple):
    """The part of a VTK file that stays the same from frame to frame."""

    kind: str
    suffix: str
    attributes: str
    blocks: list[str]


def export(
    path: str | Path, folder: str | Path, progress: Callable[[int, int], None] | None = None
) -> Path:
    """Write a trajectory file as `floes_*.vtp`, or a gridded file as `fields_*.vtr` or `.vtu`.

    A frame holds only floes that are active at its time.  A vector is one array of three
    components (the third is 0); missing values are NaN.  Fields on an atmosphere grid with other cells are
    left out.

    Parameters
    ----------
    path : trajectory or gridded file of a run
    folder : folder for the files, created if necessary; files of an earlier export in it are replaced
    progress : function called with (frames done, number of frames)

    Returns
    -------
    The path of the `.pvd` file, the one to open

    Raises
    ------
    InputError
        if `path` is not such a file, or `folder` is a file.
    """
    folder = path_of("folder", folder)
    check_new_folder(folder)
    if not (progress is None or callable(progress)):
        raise InputError(f"progress = {in_line(progress)}: must be a function, or None")
    with open_file(path, "trajectories", "gridded") as data:
        data.set_auto_mask(False)
        floes = data.floebmi_file.startswith("trajectories")
        name, frames = ("floes", _floe_frames(data)) if floes else ("fields", _field_frames(data))
        times = [float(t) for t in data["time"][:]]
        folder.mkdir(parents=True, exist_ok=True)
        entries = []
        for k, (suffix, text) in enumerate(frames):
            file = folder / f"{name}_{k:05d}.{suffix}"
            with in_one_go(file) as part:
                part.write_text(text, encoding="utf-8")
            entries.append(f'<DataSet timestep="{times[k]!r}" file="{file.name}"/>')
            if progress is not None:
                progress(k + 1, len(times))
    collection = folder / f"{name}.pvd"
    with in_one_go(collection) as part:
        part.write_text(_document("Collection", entries), encoding="utf-8")
    return collection


def _floe_frames(data: "Dataset") -> Iterator[tuple[str, str]]:
    names = [row.name for row in FLOE_VARIABLES if row.name in data.variables]
    for k in range(len(data.dimensions["time"])):
        frame = {name: data[name][k] if data[name].ndim == 2 else data[name][:] for name in names}
        here = np.isfinite(frame["x"])
        frame = {name: values[here] for name, values in frame.items()}
        place = _vector(frame.pop("x"), frame.pop("y"))
        frame["velocity"] = _vector(frame.pop("u"), frame.pop("v"))
        frame["number"] = np.flatnonzero(here)
        n = len(place)
        points = np.arange(n)
        blocks = [
            _block("Points", {"place": place}),
            _block("Verts", {"connectivity": points, "offsets": points + 1}),
            _block("PointData", frame),
        ]
        mesh = _Mesh("PolyData", "vtp", f'NumberOfPoints="{n}" NumberOfVerts="{n}"', blocks)
        yield mesh.suffix, _piece(mesh, [])


def _field_frames(data: "Dataset") -> Iterator[tuple[str, str]]:
    if "cell_area" not in data.variables:
        raise InputError(f"{data.filepath()}: has no field on the exchange grid")
    dimensions = data["cell_area"].dimensions
    mesh = _rectangles(data) if dimensions == ("y", "x") else _polygons(data)
    grids = [dimensions]
    if _same_cells(data):
        grids.append(tuple(f"{name}_atmosphere" for name in dimensions))
    rows = [
        row
        for row in VARIABLES
        if row.file_name in data.variables and data[row.file_name].dimensions[1:] in grids
    ]
    for k in range(len(data.dimensions["time"])):
        values = {row.name: data[row.file_name][k].ravel() for row in rows}
        for name in [name for name in values if name.endswith("_x")]:
            if (other := name[:-1] + "y") in values:
                values[name[:-2]] = _vector(values.pop(name), values.pop(other))
        yield mesh.suffix, _piece(mesh, [_block("CellData", values)])


def _same_cells(data: "Dataset") -> bool:
    """Whether an atmosphere grid of its own (land is not dry to the wind) has the exchange grid's cells."""
    pairs = [(f"{axis}_bnds", f"{axis}_atmosphere_bnds") for axis in "xy"]
    return all(
        own in data.variables and other in data.variables
        and np.array_equal(data[own][:], data[other][:])
        for own, other in pairs
    )  # fmt: skip


def _rectangles(data: "Dataset") -> _Mesh:
    edges = {}
    for axis in "xy":
        bounds = data[f"{axis}_bnds"][:]
        edges[axis] = np.append(bounds[:, 0], bounds[-1, 1])
    extent = f"0 {len(edges['x']) - 1} 0 {len(edges['y']) - 1} 0 0"
    blocks = [_block("Coordinates", {**edges, "z": np.zeros(1)})]
    return _Mesh("RectilinearGrid", "vtr", f'Extent="{extent}"', blocks)


def _polygons(data: "Dataset") -> _Mesh:
    if "face_nodes" in data.variables:
        x, y, faces = data["node_x"][:], data["node_y"][:], data["face_nodes"][:]
        corners = (faces >= 0).sum(axis=1)
        connectivity = faces[faces >= 0]
    else:  # each cell with corners of its own
        x, y = data["x_bnds"][:].ravel(), data["y_bnds"][:].ravel()
        corners = np.full(x.size // 4, 4)
        connectivity = np.arange(x.size)
    cells = {
        "connectivity": connectivity,
        "offsets": np.cumsum(corners),
        "types": np.full(len(corners), _POLYGON, np.uint8),
    }
    attributes = f'NumberOfPoints="{len(x)}" NumberOfCells="{len(corners)}"'
    blocks = [_block("Points", {"nodes": _vector(x, y)}), _block("Cells", cells)]
    return _Mesh("UnstructuredGrid", "vtu", attributes, blocks)


def _vector(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.stack([x, y, np.zeros(len(x))], axis=1)


def _block(tag: str, arrays: Mapping[str, np.ndarray]) -> str:
    return "\n".join([f"<{tag}>", *(_array(*item) for item in arrays.items()), f"</{tag}>"])


def _array(name: str, values: np.ndarray) -> str:
    raw = np.ascontiguousarray(values, values.dtype.newbyteorder("<")).tobytes()
    text = base64.b64encode(np.array([len(raw)], "<u8").tobytes() + raw).decode()
    components = f' NumberOfComponents="{values.shape[1]}"' if values.ndim == 2 else ""
    kind = _TYPES[values.dtype.str[1:]]
    return f'<DataArray type="{kind}" Name="{name}"{components} format="binary">{text}</DataArray>'


def _piece(mesh: _Mesh, blocks: list[str]) -> str:
    whole = ""
    if mesh.kind == "RectilinearGrid":
        whole = mesh.attributes.replace("Extent", "WholeExtent")
    lines = [f"<Piece {mesh.attributes}>", *mesh.blocks, *blocks, "</Piece>"]
    return _document(mesh.kind, lines, whole)


def _document(kind: str, lines: list[str], attributes: str = "") -> str:
    head = f'type="{kind}" version="1.0" byte_order="LittleEndian" header_type="UInt64"'
    inner = [f"<{kind} {attributes}>".replace(" >", ">"), *lines, f"</{kind}>"]
    return "\n".join(['<?xml version="1.0"?>', f"<VTKFile {head}>", *inner, "</VTKFile>", ""])
