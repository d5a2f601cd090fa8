"""Land-sea masks: which points of a source are water.

In ocean models 1 means water (`mask_rho`, `tmask`, `wet`), in atmosphere models 1 means land (`lsm`).  What the
file states (flag_meanings, standard_name) takes precedence over the variable's name.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from floebmi.errors import InputError, check_text, choose
from floebmi.factors import is_percent
from floebmi.fields import Box, File, refuse_other_points, with_same_points

_STANDARD = {
    "sea_binary_mask": 1.0, "sea_area_fraction": 1.0,
    "land_binary_mask": 0.0, "land_area_fraction": 0.0,
}  # fmt: skip
_WATER = {"mask", "mask_rho", "mask_u", "mask_v", "tmask", "umask", "vmask", "tmaskutil", "wet", "wet_c",
          "maskc", "maskw", "masks", "hfacc", "sea_mask", "ocean_mask"}  # fmt: skip
_LAND = {"lsm", "land_mask", "landmask", "land_binary_mask", "sftlf", "land_fraction"}
_NOTES = ("long_name", "comment", "description")
_LAND_WORD, _WATER_WORD = r"\bland\b", r"\b(sea|water|ocean)\b"


class Mask(NamedTuple):
    """A land-sea mask along the dimensions (rows, columns) of a file."""

    file: File
    name: str
    dims: tuple[str, ...]
    water: float  # its value where there is water

    def read(self, box: Box) -> np.ndarray:
        """True where there is water, in a box; a missing value is land."""
        array = self.file.data[self.name]
        index: dict[str, object] = {d: 0 for d in array.dims if d not in self.dims}
        index |= dict(zip(self.dims, box, strict=True))
        values = np.asarray(array.isel(index).transpose(*self.dims).values, float)
        values = values * (0.01 if is_percent(array.attrs.get("units")) else 1.0)
        part = 0.0 if self.name.lower().startswith("hfac") else 0.5  # hFacC is a share of the depth
        return (values if self.water == 1 else 1 - values) > part


def find_mask(
    file: File, dims: tuple[str, ...], names: tuple[str, ...] | None = None
) -> Mask | None:
    """The mask along `dims` (rows, columns), the first of `names` that fits, or None.

    Without names, masks are recognised by standard_name, then by well-known names; masks for other points of a
    staggered grid have other dimensions.
    """
    fitting = [
        str(name)
        for name, a in file.data.variables.items()
        if set(dims) <= set(a.dims)
        and (
            str(name).lower() in _WATER | _LAND or all(a.sizes[d] == 1 for d in {*a.dims} - {*dims})
        )
    ]
    if names is not None:
        found = next((n for n in names if n in fitting), None)
    else:
        found = next(
            (n for n in fitting if file.data[n].attrs.get("standard_name") in _STANDARD), None
        ) or next((n for n in fitting if n.lower() in _WATER | _LAND), None)
    if found is None:
        return None
    water = water_value(file, found)
    return Mask(file, found, dims, 1.0 if water is None else water)


def choose_mask(
    mask: str, file: File, files: Sequence[File], dims: tuple[str, ...], auto: bool
) -> Mask | None:
    """The mask of the given name, or the one found by "auto" (if `auto` allows one), or None for "none".

    It is looked for in `file`, then in those of `files` with the same points.

    Raises
    ------
    InputError
        if no variable of that name lies along `dims`.
    """
    check_text("mask", mask)
    if mask == "none" or not dims or (mask == "auto" and not auto):
        return None
    names = None if mask == "auto" else (mask,)
    candidates = (find_mask(f, dims, names) for f in with_same_points(file, files, dims))
    found = next((m for m in candidates if m is not None), None)
    if found is not None:
        refuse_other_points(file, found.file, dims)
    elif mask != "auto":
        fitting = [str(n) for n, a in file.data.data_vars.items() if set(a.dims) == set(dims)]
        raise InputError(
            f"{file.label}: mask = {mask!r}: no such variable along {', '.join(dims)};"
            f" {choose(mask, ['auto', 'none', *fitting])}"
        )
    return found


def water_value(file: File, name: str) -> float | None:
    """The value, 1 or 0, of a mask or fraction where there is water; None if the file does not say."""
    attrs = file.data[name].attrs
    meanings = str(attrs.get("flag_meanings", "")).lower().split()
    flags = attrs.get("flag_values", [])
    if isinstance(flags, str):  # "0b, 1b", as some tools write them
        flags = [float(number) for number in re.findall(r"-?\d+", flags)]
    flagged = dict(zip(np.atleast_1d(flags).tolist(), meanings, strict=False))
    flagged |= {
        float(k): str(attrs[f"option_{k}"]).lower() for k in (0, 1) if f"option_{k}" in attrs
    }
    standard = attrs.get("standard_name")
    if not flagged and standard not in _STANDARD:
        flagged = _values_in_words(attrs)
    flagged = {value: words.replace("_", " ") for value, words in flagged.items()}
    for value, other in ((1.0, 0.0), (0.0, 1.0)):
        if re.search(_WATER_WORD, flagged.get(value, "")) or re.search(
            _LAND_WORD, flagged.get(other, "")
        ):
            return value
    if standard in _STANDARD:
        return _STANDARD[standard]
    if name.lower() in _LAND:
        return 0.0
    return 1.0 if name.lower() in _WATER else None


def _values_in_words(attrs: dict[str, object]) -> dict[float, str]:
    """The meaning of 0 and 1, from words such as "1 = land, 0 = sea" or "land: 1"."""
    text = " ".join(str(attrs.get(name, "")) for name in _NOTES).lower()
    kind = "land|sea|water|ocean"
    found = re.findall(rf"\b([01]) ?(?:=|:|is|for) ?({kind})\b", text)
    found += [(v, k) for k, v in re.findall(rf"\b({kind}) ?(?:=|:|is) ?([01])\b", text)]
    return {float(value): word for value, word in found}
