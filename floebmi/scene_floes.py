"""Groups of floes in a scene: the keys of each arrangement, and the floes that it makes."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from floebmi.boundaries import Domain
from floebmi.clock import date_of
from floebmi.errors import InputError, warn
from floebmi.floes import (
    DRIVEN,
    FIXED,
    FIXED_ROTATION,
    FIXED_X,
    FIXED_Y,
    Floes,
    without_small,
)
from floebmi.overlaps import told_outside
from floebmi.quantities import Count, Fraction, NonNegative, Positive, PositiveFraction
from floebmi.scene_keys import (
    FileProjection,
    FillLand,
    Mask,
    Pair,
    Position,
    ScenePath,
    Sea,
    Select,
)
from floebmi.sizes import Histogram, PowerLaw, SingleSize, UniformSize, from_file as sizes_from_file
from floebmi.tables import Table, law_of, one_of

if TYPE_CHECKING:
    from floebmi.coast import Coast

Axis = Literal["x", "y", "rotation"]
Motion = Literal["free", "fixed", "driven"] | list[Axis]
_AXIS_BITS = {"x": FIXED_X, "y": FIXED_Y, "rotation": FIXED_ROTATION}


# ---- sizes --------------------------------------------------------------------------------------


class SizesFromFile(Table):
    """Sizes from a CSV file: one column of radii [m], or two of lower bin edges [m] and counts."""

    distribution: Literal["file"] = "file"
    file: ScenePath = Field(
        description="CSV with a header: radii [m], or lower bin edges [m] and counts"
    )


_SIZE_LAWS = {
    "power_law": PowerLaw,
    "uniform": UniformSize,
    "single": SingleSize,
    "histogram": Histogram,
}
SizeTable = one_of("distribution", {**_SIZE_LAWS, "file": SizesFromFile})


def sizes_of(table: Any, folder: Path) -> Any:
    """The size distribution that a table describes; paths in it are relative to `folder`."""
    if isinstance(table, SizesFromFile):
        return sizes_from_file(folder / table.file)
    return law_of(table, _SIZE_LAWS[table.distribution])


# ---- arrangements -------------------------------------------------------------------------------

WestEast = Annotated[Pair | None, Field(description="west and east bounds of the region [m]; default: the domain's")]  # fmt: skip
SouthNorth = Annotated[Pair | None, Field(description="south and north bounds of the region [m]; default: the domain's")]  # fmt: skip
OwnSeed = Annotated[int | None, Field(ge=0, description="seed of this group; default: derived from the scene's seed")]  # fmt: skip


class Group(Table):
    """Keys that all groups of floes have."""

    velocity: Pair = Field(
        (0.0, 0.0),
        description="initial velocity (along x, along y) [m/s]; default: that in the file or list, or at rest",
    )
    motion: Motion = Field(
        "free",
        description="'free', 'fixed' (stands still), 'driven' (keeps its velocity), or a list of the axes along which the "
        "velocity is kept: ['x', 'y', 'rotation']; default for a file or list: what it gives for each floe",
    )
    smallest: NonNegative = Field(
        0.0,
        description="smallest radius [m]: smaller floes are left out, and the others thickened so that the mass is kept",
    )

    @model_validator(mode="after")
    def _fixed_floes_stand_still(self) -> Self:
        if self.motion == "fixed" and self.velocity != (0.0, 0.0):
            raise InputError("motion = 'fixed' stands still; with a velocity it is 'driven'")
        return self

    def build(self, sea: Sea, seed: int) -> Floes:
        """The floes of the group, drawn with `seed` unless the group has a seed of its own."""
        floes = without_small(self._arranged(sea, seed), self.smallest)
        if "velocity" in self.model_fields_set:
            floes.u, floes.v = self.velocity
        if "motion" in self.model_fields_set:
            floes.motion = _motion_bits(self.motion)
        if told := told_outside(floes, sea.domain):
            raise InputError(told)
        return floes

    def _arranged(self, sea: Sea, seed: int) -> Floes:
        """The floes where this arrangement lays them."""
        raise NotImplementedError


class Scatter(Group):
    """Floes in random places without overlap, at a given concentration or number."""

    arrangement: Literal["scatter"] = "scatter"
    size: SizeTable = Field(description="floe size distribution (by number of floes)")
    concentration: Fraction | None = Field(
        None,
        description="area of the floes over the area of their region [1], 0 (no ice) to about 0.85",
    )
    count: Count | None = Field(None, description="number of floes, instead of concentration")
    thickness: Positive = Field(1.0, description="thickness of the floes [m]")
    x: WestEast = None
    y: SouthNorth = None
    seed: OwnSeed = None

    def _arranged(self, sea: Sea, seed: int) -> Floes:
        from floebmi import packing

        region = _region(sea.domain, self.x, self.y)
        return packing.scatter(
            region,
            sizes_of(self.size, sea.folder),
            concentration=self.concentration,
            count=self.count,
            thickness=self.thickness,
            seed=seed if self.seed is None else self.seed,
            land=_land_in(region, sea),
        )


class Regular(Group):
    """A lattice of equal floes."""

    arrangement: Literal["regular"] = "regular"
    radius: Positive = Field(description="radius of the floes [m]")
    spacing: Positive | None = Field(None, description="distance between neighbouring centres [m]")
    concentration: PositiveFraction | None = Field(
        None,
        description="area of the floes over the area of their region [1], instead of spacing",
    )
    lattice: Literal["hexagonal", "square"] = Field("hexagonal", description="type of lattice")
    thickness: Positive = Field(1.0, description="thickness of the floes [m]")
    x: WestEast = None
    y: SouthNorth = None

    def _arranged(self, sea: Sea, seed: int) -> Floes:
        from floebmi import packing

        return packing.regular(
            _region(sea.domain, self.x, self.y),
            self.radius,
            spacing=self.spacing,
            concentration=self.concentration,
            lattice=self.lattice,
            thickness=self.thickness,
        )


class FromField(Group):
    """Floes that hold the ice of a gridded concentration and thickness."""

    arrangement: Literal["field"] = "field"
    file: ScenePath = Field(description="NetCDF file with concentration and thickness")
    concentration: str | None = Field(
        None, description="variable of the area fraction; default: found by its standard name"
    )
    thickness: str | Positive | None = Field(
        None, description="variable of the thickness, or one thickness for all floes [m]"
    )
    thickness_of: Literal["auto", "ice", "cell"] = Field(
        "auto",
        description="whether the thickness in the file is a mean over the ice or over the whole cell",
    )
    units: str | None = Field(
        None, description="units of the thickness in the file, if it states none or wrong ones"
    )
    time: str | None = Field(
        None,
        description="date of the ice; default: [time] start, or the file's first record without it",
    )
    select: Select = None
    mask: Mask = "auto"
    fill_land: FillLand = "error"
    outside: Literal["error", "open water"] = Field(
        "error", description="what a wet cell outside the file gets"
    )
    position: Position = "auto"
    file_projection: FileProjection = None
    size: SizeTable = Field(description="floe size distribution (by number of floes)")
    seed: OwnSeed = None

    @model_validator(mode="after")
    def _one_thickness(self) -> Self:
        for name, of_file in (("thickness_of", self.thickness_of != "auto"), ("units", self.units)):
            if isinstance(self.thickness, float) and of_file:
                raise InputError(
                    f"{name} applies to a thickness in the file, not to thickness = {self.thickness:g} of all floes:"
                    " leave one of the two out"
                )
        return self

    def _arranged(self, sea: Sea, seed: int) -> Floes:
        from floebmi import packing

        if sea.grid is None:
            raise InputError("arrangement = 'field' needs a [grid]")
        fraction, thickness = self.ice(sea)
        if not fraction[sea.grid.wet].any():
            warn(f"{self.file}: there is no ice in the wet cells")
        return packing.from_field(
            sea.grid,
            fraction,
            thickness,
            sizes_of(self.size, sea.folder),
            seed=seed if self.seed is None else self.seed,
            domain=sea.domain,
            land=sea.land,
        )

    def ice(self, sea: Sea) -> tuple[np.ndarray, np.ndarray]:
        """Area fraction [1] and actual ice thickness [m] on the scene's grid; where the thickness is 0 there is no ice."""
        from floebmi.scalars import read_scalar

        path, plane = sea.folder / self.file, sea.projection
        if self.time is not None:
            date_of(self.time, sea.calendar or "standard", "time")
        of_file = {
            "time": self.time or sea.start, "select": self.select, "mask": self.mask,
            "fill_land": self.fill_land, "outside": None if self.outside == "error" else 0.0,
            "position": self.position, "file_projection": self.file_projection,
        }  # fmt: skip
        fraction = read_scalar(
            path, "area_fraction", sea.grid, plane, variable=self.concentration, **of_file
        )
        if isinstance(self.thickness, float):
            return fraction, np.full(sea.grid.size, self.thickness)
        thickness = read_scalar(
            path, "thickness", sea.grid, plane,
            variable=self.thickness, concentration=self.concentration,
            thickness_of=self.thickness_of, units=self.units, **of_file,
        )  # fmt: skip
        return np.where(thickness > 0, fraction, 0.0), thickness

    def check_begins(self, folder: Path, start: str) -> None:
        """Refuse to take the ice from the file's first record if its date is not that of the wind and current at time 0."""
        from floebmi.scalars import begins

        if self.time is not None:
            return
        ice = begins(folder / self.file, self.concentration, self.select)
        if ice not in (None, start):
            raise InputError(
                f"time is missing: the records of {self.file} begin at {ice}, time 0 is {start}, the first record"
                " of wind or current: say the date of the ice, or [time] start"
            )


class FromFile(Group):
    """Floes from a CSV or GeoJSON file."""

    arrangement: Literal["file"] = "file"
    file: ScenePath = Field(description="CSV or GeoJSON file of floes")
    thickness: Positive | None = Field(
        None, description="thickness of all floes [m], for a file that has none"
    )

    def _arranged(self, sea: Sea, seed: int) -> Floes:
        from floebmi import packing

        path = sea.folder / self.file
        plane = None if path.suffix.lower() == ".csv" else sea.projection
        floes = packing.read_floes(path, self.thickness, plane)
        if not len(floes):
            warn(f"{self.file}: there are no floes in it")
        return floes


class OneFloe(Table):
    """One floe of a list."""

    x: float = Field(description="x of the centre [m]")
    y: float = Field(description="y of the centre [m]")
    radius: Positive = Field(description="radius of the floe [m]")
    thickness: Positive = Field(1.0, description="thickness of the floe [m]")
    u: float = Field(0.0, description="velocity along x [m/s]")
    v: float = Field(0.0, description="velocity along y [m/s]")
    motion: Motion = Field("free", description="as `motion` of a group of floes")


class Listed(Group):
    """Floes listed one by one."""

    arrangement: Literal["list"] = "list"
    each: list[OneFloe] = Field(description="tables of x, y, radius, thickness, u, v, motion")

    def _arranged(self, sea: Sea, seed: int) -> Floes:
        for k, row in enumerate(self.each):
            if row.motion == "fixed" and (row.u, row.v) != (0.0, 0.0):
                raise InputError(
                    f"each[{k}]: motion = 'fixed' stands still; with u, v it is 'driven'"
                )
        columns = {
            name: [getattr(row, name) for row in self.each]
            for name in ("x", "y", "radius", "thickness", "u", "v")
        }
        return Floes(**columns, motion=[_motion_bits(row.motion) for row in self.each])


GroupTable = one_of(
    "arrangement",
    {"scatter": Scatter, "regular": Regular, "field": FromField, "file": FromFile, "list": Listed},
    "scatter",
)


def _motion_bits(motion: Motion) -> int:
    if isinstance(motion, str):
        return {"free": 0, "fixed": FIXED, "driven": DRIVEN}[motion]
    return sum({_AXIS_BITS[axis] for axis in motion})


def _region(domain: Domain, x: Pair | None, y: Pair | None) -> Domain:
    """Part of a domain; a direction in which it is cut is no longer periodic."""
    for name, pair in (("x", x), ("y", y)):
        if pair is not None and not pair[1] > pair[0]:
            raise InputError(f"{name} = {list(pair)}: the second must be larger")
    if x is not None:
        domain = domain._replace(x=x, west="inactive", east="inactive")
    if y is not None:
        domain = domain._replace(y=y, south="inactive", north="inactive")
    return domain


def _land_in(region: Domain, sea: Sea) -> "Coast | None":
    """The land that floes in a region of the domain have to keep clear of."""
    if sea.land is None or region.period == sea.domain.period:
        return sea.land
    from floebmi.coast import within

    # one period from where the region begins: it may lie across the seam
    spans = {
        name: (low, low + length)
        for name, (low, _), length in zip("xy", region[:2], sea.domain.period, strict=True)
        if length is not None
    }
    return within(sea.land, sea.domain._replace(**spans))
