"""ParaView files out of the files of a run: floes as points, fields as cells, one file per frame.

A `.pvd` file lists the frames with their times; open that one.  Floes come as points with a radius: show
them with the filter "Glyph" (a cylinder or a 2-D circle, scaled by `radius`), or as "Point Gaussian".

The XML of VTK is written here, in a few lines, because nothing lighter serves: PyPI `meshio` writes no
PolyData and no collections (its time series are XDMF), `pyvista` and `vtk` do all of it but weigh a
hundred megabytes, and a run needs nothing else of them.  Numbers are base64 of the raw bytes, so they are
exact and every reader of VTK takes them without a compressor.
"""

import base64
import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from floebmi.errors import InputError
from floebmi.output import file_kind, open_file
from floebmi.variables import FLOE_VARIABLES, VARIABLES

if TYPE_CHECKING:
    from netCDF4 import Dataset

POLYGON = 7  # VTK's number of this cell type
_TYPES = {"f8": "Float64", "i8": "Int64", "i4": "Int32", "i1": "Int8", "u1": "UInt8"}


def export(
    path: str | Path, folder: str | Path, progress: Callable[[int, int], None] | None = None
) -> Path:
    """Write a trajectory file as `floes*.vtp`, or a gridded file as `fields*.vtr` or `.vtu`.

    Floes that have left, or have not yet come, are not in a frame.  A vector is one array of three
    components (the third is 0); missing values are NaN.  Fields on an atmosphere grid of its own are left
    out.

    Parameters
    ----------
    path : file of `TrajectoryWriter` or `GriddedWriter`
    folder : made if it is not there; files of an earlier export in it are replaced
    progress : called with (frames done, all frames)

    Returns
    -------
    The `.pvd` file, the one to open.

    Raises
    ------
    InputError
        if `path` is no such file, or `folder` is a file.
    """
    folder = Path(folder)
    if folder.is_file():
        raise InputError(f"{folder}: is a file; give the name of a folder")
    kind = file_kind(path)
    with open_file(path, kind) as data:
        data.set_auto_mask(False)
        frames = _floe_frames(data) if kind == "trajectories" else _field_frames(data)
        name = "floes" if kind == "trajectories" else "fields"
        folder.mkdir(parents=True, exist_ok=True)
        times = data["time"][:]
        entries = []
        for k, (suffix, text) in enumerate(frames):
            file = folder / f"{name}_{k:05d}.{suffix}"
            file.write_text(text)
            entries.append(f'<DataSet timestep="{times[k]!r}" file="{file.name}"/>')
            if progress is not None:
                progress(k + 1, len(times))
    entries = [entry.replace("np.float64(", "").replace(')"', '"') for entry in entries]
    collection = folder / f"{name}.pvd"
    part = collection.with_name(collection.name + ".part")
    part.write_text(_document("Collection", "\n".join(entries)))
    os.replace(part, collection)
    return collection


def _floe_frames(data: "Dataset") -> Iterator[tuple[str, str]]:
    names = [row.name for row in FLOE_VARIABLES if row.name in data.variables]
    shown = [name for name in names if name not in ("x", "y", "u", "v")]
    for k in range(len(data.dimensions["time"])):
        frame = {
            name: data[name][k] if data[name].ndim == 2 else data[name][:] for name in names
        }
        here = np.isfinite(frame["x"])
        n = int(here.sum())
        points = {"velocity": _vector(frame["u"][here], frame["v"][here])}
        points["number"] = np.flatnonzero(here).astype(np.int32)
        points.update((name, frame[name][here]) for name in shown)
        order = np.arange(n)
        piece = [
            _block("Points", {"points": _vector(frame["x"][here], frame["y"][here])}),
            _block("Verts", {"connectivity": order, "offsets": order + 1}),
            _block("PointData", points),
        ]
        yield "vtp", _piece("PolyData", f'NumberOfPoints="{n}" NumberOfVerts="{n}"', piece)


def _field_frames(data: "Dataset") -> Iterator[tuple[str, str]]:
    dimensions = data["sea_ice_area_fraction" if False else _any_field(data)].dimensions[1:]
    rows = [
        row
        for row in VARIABLES
        if row.file_name in data.variables and data[row.file_name].dimensions[1:] == dimensions
    ]
    geometry = _rectangles if dimensions == ("y", "x") else _polygons
    kind, suffix, attributes, blocks = geometry(data)
    for k in range(len(data.dimensions["time"])):
        values = {row.name: data[row.file_name][k].ravel() for row in rows}
        yield suffix, _piece(kind, attributes, [*blocks, _block("CellData", _join(values))])
