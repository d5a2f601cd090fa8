"""Opening of NetCDF files and Zarr stores; unreadable ones are refused, with the reason in one line."""

from __future__ import annotations

import difflib
import os
import re
import struct
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from floebmi.classic import length_by_header
from floebmi.errors import InputError, in_line
from floebmi.fields import File, coordinate, role
from floebmi.files import path_of

if TYPE_CHECKING:
    import xarray as xr

    Source = str | os.PathLike | xr.Dataset | Sequence[str | os.PathLike | xr.Dataset]


def open_files(path: Source) -> list[File]:
    """Open NetCDF files or Zarr stores for lazy reading; data sets that are already open are passed through.

    Raises
    ------
    InputError
        for a file that is missing, unreadable, or shorter than its header says, and for one with a missing time in a
        calendar other than the standard one.
    """
    import xarray as xr

    if isinstance(path, (str, os.PathLike, xr.Dataset)):
        path = [path]
    if not np.iterable(path):
        raise InputError(
            f"path = {in_line(path)}: must be a file, several, or a data set of xarray"
        )
    files = [_open(one) for one in path]
    if not files:
        raise InputError("path = []: must be a file, several, or a data set of xarray")
    return files


def _open(path: str | os.PathLike | xr.Dataset) -> File:
    import xarray as xr

    if isinstance(path, xr.Dataset):
        return File(Path(str(path.encoding.get("source", "data set"))).name, path)
    path = path_of("path", path)
    if not path.exists():
        beside = [p.name for p in path.parent.glob("*")]
        near = difflib.get_close_matches(path.name, beside, n=1)
        hint = f"did you mean {near[0]!r}?" if near else ""
        if re.search(r"[*?\[]", path.name):
            hint = "no patterns are read: name the file, or those that hold its parts; a series is joined first"
        elif re.search(r"https?:/", str(path)):
            hint = "no addresses are read: load the file down first"
        raise InputError(f"{path}: no such file" + (f"; {hint}" if hint else ""))
    zarr = path.is_dir()
    engine = "zarr" if zarr else None
    if not zarr:
        _refuse_if_cut(path)
    try:
        with warnings.catch_warnings():  # what cannot be read is refused below, in one line
            warnings.filterwarnings("ignore", ".* fails while guessing", RuntimeWarning)
            data = xr.open_dataset(path, engine=engine, cache=False, decode_timedelta=False)
    except Exception as error:  # each engine raises its own types
        reason = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
        if not zarr and "did not find a match" in reason:
            raise InputError(f"{path}: {_kind(path)}") from error
        if zarr and "unrecognized engine" in reason:
            reason = "reading Zarr needs the package zarr (python -m pip install zarr)"
        if "HDF error" in reason:
            reason = "it is damaged, was cut short, or another process is writing it"
        if "decode time units" in reason:
            reason = f"{reason.partition('. Try')[0]}; must be seconds, minutes, hours or days since a date, in a calendar of CF"
        raise InputError(
            f"{path}: cannot be read as {'Zarr' if zarr else 'NetCDF'}: {reason}"
        ) from error
    if not zarr and not data.data_vars:
        _refuse_groups(path)
    file = File(path.name, data)
    times = [found for d in data.dims if (found := coordinate(file, str(d)))]
    if any(a.dtype.kind == "O" and role(name, a) == "time" for name, a in times):
        with xr.open_dataset(path, engine=engine, decode_times=False) as numbers:
            _refuse_missing_times(File(path.name, numbers), [name for name, _ in times])
    return file


def _kind(path: Path) -> str:
    """A description of a file that is not NetCDF."""
    with open(path, "rb") as file:
        begin = file.read(100)
    for sign, kind in (
        (b"GRIB", "is GRIB: convert it to NetCDF first (cdo -f nc copy)"),
        (b"\x1f\x8b", "is compressed by gzip: unpack it first"),
        (b"PK", "is a zip archive: unpack it first"),
        (b"<", "is a web page or XML, as of a download that failed"),
    ):
        if begin.lstrip().startswith(sign):
            return kind
    return "is no NetCDF file, or a damaged one" if begin else "is empty"


def _refuse_groups(path: Path) -> None:
    """InputError for a file whose variables are all in groups, which xarray does not read by default."""
    import netCDF4

    try:
        with netCDF4.Dataset(path) as file:
            groups = list(file.groups)
    except OSError:  # a file read by another library, which has no groups
        return
    if groups:
        raise InputError(
            f"{path}: its variables are in groups ({', '.join(groups)}), and none outside: take them out of the groups"
            " first (ncks -G : in.nc out.nc)"
        )


def _refuse_missing_times(file: File, names: list[str]) -> None:
    """InputError for a missing time, in coordinates whose dates are not yet decoded.

    cftime has no missing dates: it decodes them to the reference date.
    """
    for name in names:
        values = file.data[name].values
        missing = np.isnan(values) if values.dtype.kind == "f" else np.zeros(values.shape, bool)
        if missing.any():
            raise InputError(f"{file.label}: {name}[{int(missing.argmax())}] is not a time")


def _refuse_if_cut(path: Path) -> None:
    """InputError for a truncated file in one of NetCDF's classic formats.

    The library reads the missing part as zeros, which are plausible currents or ice; for NetCDF-4 files, HDF5
    detects it.
    """
    try:
        with open(path, "rb") as file:
            told, size = length_by_header(file), path.stat().st_size
    except struct.error:
        raise InputError(f"{path}: was cut short within its header") from None
    except (OSError, IndexError):
        return  # unreadable, or no such header: leave the error to the library
    if size < told:
        raise InputError(f"{path}: was cut short: it has {size} bytes of {told}")
