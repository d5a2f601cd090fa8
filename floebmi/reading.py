"""A run's files as pictures read them: the domain, the times in words, land, cells and vectors."""

from contextlib import ExitStack
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from floebmi.errors import InputError
from floebmi.output import open_file
from floebmi.quantities import is_number
from floebmi.variables import find

if TYPE_CHECKING:
    from netCDF4 import Dataset


class FrameTimes:
    """Times of the frames of a file, also in words: dates, or elapsed time if the run has no date."""

    def __init__(self, data: "Dataset") -> None:
        import cftime

        self.seconds = filled(data["time"][:])
        self._dates = None
        if getattr(data["time"], "epoch", "") != "arbitrary":
            self._dates = cftime.num2date(self.seconds, data["time"].units, data["time"].calendar)
        span = np.abs(self.seconds).max(initial=0.0)
        # frames of one minute would have one date
        close = np.diff(self.seconds).min(initial=np.inf) < 60.0
        self._form = "%Y-%m-%d %H:%M:%S" if close else "%Y-%m-%d %H:%M"
        units = ((1.0, "s", 300), (60.0, "min", 180), (3600.0, "h", 96), (86400.0, "d", np.inf))
        self.unit, self.name = next((u, name) for u, name, most in units if span <= most * u)

    def text(self, k: int) -> str:
        if self._dates is not None:
            return self._dates[k].strftime(self._form)
        value = self.seconds[k] / self.unit
        number = f"{value:.4g}" if abs(value) < 1e4 else f"{value:.0f}"
        return f"t = {number.replace('-', '−')} {self.name}"


class View(NamedTuple):
    """The files of a run, the length that is one unit of the axes, and the times of the frames."""

    data: "Dataset"  # with the domain, and the land polygons
    gridded: "Dataset | None"
    length: tuple[float, str]  # [m], and its name
    times: FrameTimes

    @property
    def box(self) -> tuple[float, float, float, float]:
        """West, east, south, north in units of the axes."""
        (west, east), (south, north) = self.data.domain_x, self.data.domain_y
        return tuple(float(value) / self.length[0] for value in (west, east, south, north))


def open_view(files: ExitStack, trajectories: str | Path, gridded: str | Path | None) -> View:
    """The files of a run with at least one frame, which `files` closes."""
    floes = files.enter_context(open_file(trajectories, "trajectories"))
    fields = None
    if gridded is not None:
        fields = files.enter_context(open_file(gridded, "gridded"))
    if not len(floes.dimensions["time"]):
        raise InputError(f"{trajectories}: has no frame yet")
    return view_of(floes, fields)


def view_of(data: "Dataset", gridded: "Dataset | None") -> View:
    """The view of a file, and of a gridded one with it; in km if the domain is wide."""
    wide = max(np.ptp(data.domain_x), np.ptp(data.domain_y)) > 2000.0
    return View(data, gridded, (1000.0, "km") if wide else (1.0, "m"), FrameTimes(data))


def frame_number(path: str | Path, time: int, n: int) -> int:
    """Number of one of n frames, counted from the first."""
    if not (_is_whole(time) and -n <= time < n):
        raise InputError(f"{path}: time = {time!r}: it has {n} frames; give {-n} to {n - 1}")
    return int(time) % n


def check_every(every: int) -> None:
    if not (_is_whole(every) and every >= 1):
        raise InputError(f"every = {every!r}: must be at least 1, and whole")


def _is_whole(value: object) -> bool:
    return isinstance(value, Integral) and is_number(value)


def filled(values: np.ndarray) -> np.ndarray:
    """Plain array; what is missing is NaN."""
    if np.ma.isMaskedArray(values):
        return values.astype(float).filled(np.nan) if values.mask.any() else values.data
    return np.asarray(values)


def shores(data: "Dataset") -> list[np.ndarray]:
    """Rings of the land's outline [m], each of shape (nodes, 2); none if the file has no land."""
    if "land_polygons" not in data.variables:
        return []
    nodes = np.stack([filled(data[f"land_{a}"][:]) for a in "xy"], axis=1)
    return np.split(nodes, np.cumsum(data["land_ring_node_count"][:])[:-1])


def _suffix_of(dimensions: tuple[str, ...]) -> str:
    """What the names of a grid's coordinates end with: "_atmosphere" for that grid, nothing for the exchange grid."""
    return "".join(dimensions[0].partition("_")[1:])


def cell_corners(
    view: View, dimensions: tuple[str, ...]
) -> tuple[np.ndarray, np.ndarray] | list[np.ndarray]:
    """Edges along x and y of a rectilinear grid, or the corners of each cell; in units of the axes."""
    data, unit = view.gridded, view.length[0]
    suffix = _suffix_of(dimensions)
    if f"face_nodes{suffix}" in data.variables:
        faces = data[f"face_nodes{suffix}"][:]  # masked where a cell has fewer corners
        nodes = np.stack([data[f"node_{a}{suffix}"][:] for a in "xy"], axis=-1) / unit
        return [nodes[face.compressed()] for face in faces]
    bounds = [filled(data[f"{a}{suffix}_bnds"][:]) / unit for a in "xy"]
    if bounds[0].ndim == 2:
        return tuple(np.append(b[:, 0], b[-1, 1]) for b in bounds)
    return list(np.stack(bounds, axis=-1).reshape(-1, 4, 2))


def centres(
    data: "Dataset", dimensions: tuple[str, ...], unit: float
) -> tuple[np.ndarray, np.ndarray]:
    """Centres of the cells, of the shape of a field."""
    suffix = _suffix_of(dimensions)
    x, y = (filled(data[f"{a}{suffix}"][:]) / unit for a in "xy")
    if len(dimensions) == 2 and x.ndim == 1:
        x, y = np.meshgrid(x, y)
    return x, y


def vectors(view: View, name: str, k: int) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]] | None:
    """Both components of a gridded vector, and their dimensions, at the time nearest to frame k; None if no file has them."""
    files = [find(f"{name}_{a}").file_name for a in "xy"]
    if view.gridded is None or files[0] not in view.gridded.variables:
        return None
    nearest = int(np.argmin(np.abs(filled(view.gridded["time"][:]) - view.times.seconds[k])))
    u, v = (filled(view.gridded[file][nearest]) for file in files)
    return u, v, view.gridded[files[0]].dimensions[1:]
