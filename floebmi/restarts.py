"""Restart files: the state of a run in a NetCDF file, which gives back the same bits."""

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import floebmi
from floebmi.entries import checksum, entries_of, state_of
from floebmi.errors import InputError
from floebmi.files import (
    attributes_of,
    check_attribute,
    check_target,
    disk_full_told,
    in_one_go,
    new_file,
    path_of,
)
from floebmi.quantities import check_flag, check_table

if TYPE_CHECKING:
    from netCDF4 import Dataset

RESTART_VERSION = 1


def save_restart(
    path: str | Path,
    state: Mapping[str, Any],
    attributes: Mapping[str, Any] | None = None,
    overwrite: bool = True,
) -> None:
    """Save a state so that `load_restart` gives back the same bits.

    The file is written under another name and renamed once it is complete and on the disk; only then is an
    older restart file of that name replaced.

    Parameters
    ----------
    path : the file to make
    state : arrays of numbers, bools or texts of any shape, texts, bytes, numbers, bools, None, and
        mappings of such
    attributes : texts and numbers that describe the state, for readers
    overwrite : whether an older file of that name may be replaced

    Raises
    ------
    InputError
        for a value of another type, a missing folder, or a file that may not be replaced.
    """
    path = path_of("path", path)
    if state is None:
        raise InputError("state = None: must be a dict")
    check_table("state", state)
    check_table("attributes", attributes)
    for name, value in (attributes or {}).items():
        if name in ("floebmi_restart", "checksum"):
            raise InputError(f"attribute {name!r}: is set by save_restart; leave it out")
        check_attribute(name, value)
    check_flag("overwrite", overwrite)
    check_target(path, overwrite)
    entries = entries_of(state)
    made = attributes_of("State of sea-ice floes, to go on from")
    del made["Conventions"]  # CF covers only fields and trajectories
    told = {**made, "floebmi_version": floebmi.__version__, **(attributes or {})}
    with disk_full_told(path), in_one_go(path, overwrite) as part:
        with new_file(part) as data:
            data.setncatts(told)
            data.floebmi_restart = np.int32(RESTART_VERSION)
            data.checksum = checksum(entries, told)
            for name, (kind, array) in entries.items():
                _write_entry(data, name, kind, array)
        with open(part, "rb") as file:
            os.fsync(file.fileno())


def load_restart(path: str | Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """The state and the attributes that `save_restart` wrote.

    Raises
    ------
    InputError
        if there is no such file, or it is damaged or of another version.
    """
    from netCDF4 import Dataset

    path = path_of("path", path)
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
            entries = {
                name: (variable.kind, _read_entry(variable))
                for name, variable in _variables(data, "")
            }
            intact = attributes.pop("checksum") == checksum(entries, attributes)
    except (OSError, RuntimeError, KeyError, AttributeError):
        raise damaged from None
    if not intact:
        raise damaged
    return state_of(entries), attributes


def _write_entry(data: "Dataset", name: str, kind: str, array: np.ndarray) -> None:
    """Write a variable of this path; arrays of length n share the dimension n of the file."""
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


def _variables(group: Any, above: str) -> Iterator[tuple[str, Any]]:
    """The variables of a group and of the groups within it, with their paths."""
    for name, variable in group.variables.items():
        yield above + name, variable
    for name, inner in group.groups.items():
        yield from _variables(inner, f"{above}{name}/")


def _read_entry(variable: Any) -> np.ndarray:
    variable.set_auto_maskandscale(False)
    return np.ascontiguousarray(variable[...]).reshape(variable.shape)
