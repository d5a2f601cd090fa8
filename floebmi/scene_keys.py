"""What keys of several tables of a scene are: pairs, paths, and how a gridded file is read."""

from typing import Annotated, Literal

from pydantic import AfterValidator

from floebmi.errors import InputError

Pair = tuple[float, float]


def _path(text: str) -> str:
    if any(letter < " " for letter in text):  # an error would take several lines to name it
        raise InputError("must be the path of a file, without control characters")
    return text


ScenePath = Annotated[str, AfterValidator(_path)]  # of a file, relative to the scene file

# ---- of all tables that read a gridded file ------------------------------------------------------

# those of places.py and remap.py, which need scipy: scenes are read without it
Position = Literal["auto", "mapping", "lonlat"]
FillLand = Literal["error", "nearest", "dry"]
POSITION = (
    "by x, y with their projection (or axes of longitude and latitude), or by 2-D longitude and latitude, "
    "where a file has both"
)
FILE_PROJECTION = "plane of the file's own x and y, if it does not say or says it wrong"
SELECT = "index along any other dimension, as {member = 3}"
MASK = "its land-sea mask; 'none' takes missing values alone"
FILL_LAND = (
    "what a wet cell gets where the file has only land: an error, what the 'nearest' water has, or 'dry', 0 "
    "(water or air at rest, no ice); the cell stays wet"
)
