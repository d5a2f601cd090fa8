"""What several tables of a scene share: the sea that they are built in, pairs, paths, and how a gridded file is read."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple

from pydantic import AfterValidator, Field

from floebmi.boundaries import Domain
from floebmi.clock import Calendar
from floebmi.errors import InputError
from floebmi.grid import Grid

if TYPE_CHECKING:
    from floebmi.coast import Coast


class Sea(NamedTuple):
    """What a table needs from the rest of the scene to build its own part.

    domain, grid, land : grid and land are None where the scene has none, or none yet
    folder : folder of the scene file, to which paths are relative
    projection, start, calendar : those of the scene, for reading files; None where it has none
    """

    domain: Domain
    grid: Grid | None
    land: "Coast | None"
    folder: Path
    projection: str | None
    start: str | None
    calendar: Calendar | None


Pair = tuple[float, float]


def _path(text: str) -> str:
    if any(letter < " " for letter in text):  # an error would take several lines to name it
        raise InputError("must be the path of a file, without control characters")
    return text


ScenePath = Annotated[str, AfterValidator(_path)]  # of a file, relative to the scene file

# ---- keys of the tables that read a gridded file --------------------------------------------------------

Select = Annotated[dict[str, int] | None, Field(description="index along any other dimension, such as {member = 3}")]  # fmt: skip
Mask = Annotated[str, Field(description="name of the file's land-sea mask; with 'none' only missing values count as land")]  # fmt: skip
FileProjection = Annotated[str | None, Field(description="projection of the file's own x and y, if the file states none or a wrong one")]  # fmt: skip
# the same words as in places.py and remap.py, which import scipy: scenes are read without it
Position = Annotated[Literal["auto", "mapping", "lonlat"], Field(
    description="coordinates to use where a file has both: 'mapping', x and y with their projection (or axes of longitude and "
    "latitude); 'lonlat', 2-D longitude and latitude"
)]  # fmt: skip
FillLand = Annotated[Literal["error", "nearest", "dry"], Field(
    description="what a wet cell gets where the file has only land: an error, the value of the 'nearest' water, or 0 with 'dry' "
    "(fluid at rest, no ice); the cell stays wet"
)]  # fmt: skip
