"""What a scene models: the tables of contact, ocean, wind, Coriolis force, tilt and ice, and what each of them makes."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal, Self

from pydantic import Field, model_validator

from floebmi.bonds import TensileStrength
from floebmi.clock import BeyondSpan
from floebmi.contact import (
    CompressiveFailure,
    Contact,
    Coulomb,
    Damsgaard2018Coulomb,
    Elastic,
    Restitution,
    cohesive,
    frictional,
)
from floebmi.errors import InputError
from floebmi.fluid import FASTEST
from floebmi.forces import (
    DRAG_PRESETS,
    AirDrag,
    Coriolis,
    CoriolisField,
    Force,
    GeostrophicTilt,
    OceanDrag,
    Tilt,
)
from floebmi.quantities import NonNegative, Positive, PositiveFraction
from floebmi.scene_domain import GridTable
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
from floebmi.tables import Table, keyed, law_of, one_of, table_of, word_or

if TYPE_CHECKING:
    from floebmi.forcing import VelocitySource
    from floebmi.grid import Grid

_DRAG = f"a preset ({', '.join(DRAG_PRESETS)}), or a table of coefficients"
EARTH_ROTATION = 7.2921159e-5  # rotation of the Earth [rad/s]


# ---- contact ----------------------------------------------------------------------------------

_FRICTIONS = {"coulomb": Coulomb, "damsgaard2018": Damsgaard2018Coulomb}


class Parts(Table):
    """A contact law composed of parts; a part that is left out is not modelled."""

    model: Literal["parts"] = "parts"
    elastic: keyed(Elastic) = Field(Elastic(), description="normal elasticity")
    friction: one_of("law", _FRICTIONS, "coulomb") | None = Field(
        None, description="friction, which also makes the floes rotate"
    )
    bonds: keyed(TensileStrength) | None = Field(None, description="bonds with a tensile strength")
    dashpot: keyed(Restitution) | None = Field(None, description="normal damping")
    failure: keyed(CompressiveFailure) | None = Field(
        None, description="compressive failure, followed by sliding of one floe over the other"
    )

    def build(self) -> Contact:
        friction = None
        if self.friction is not None:
            friction = law_of(self.friction, _FRICTIONS[self.friction.law])
        return Contact(self.elastic, friction, self.bonds, self.dashpot, self.failure)


CONTACTS = {"frictional": frictional, "cohesive": cohesive}
ContactTable = word_or(
    Literal["frictional", "cohesive", "none"],
    one_of("model", {**CONTACTS, "parts": Parts}, "parts"),
)


def contact_of(table: Any) -> Contact | None:
    """The contact law that a word or a table describes."""
    if table is None or table == "none":
        return None
    if isinstance(table, str):
        return CONTACTS[table]()
    return table.build() if isinstance(table, Parts) else law_of(table, CONTACTS[table.model])


# ---- fluids and other forces --------------------------------------------------------------------


class FluidTable(Table):
    """The velocity of the ocean or the air, as the ice feels it."""

    velocity: Pair | None = Field(
        None,
        description="uniform, constant velocity (along x, along y) [m/s]; without it and without file: at rest",
    )
    file: ScenePath | list[ScenePath] | None = Field(
        None,
        description="NetCDF or Zarr file with the velocity in space and time, or several files that hold its parts",
    )
    variables: tuple[str, str] | None = Field(
        None, description="variables of u and v, if their names and attributes do not identify them"
    )
    vectors: Literal["auto", "east-north", "grid"] = Field(
        "auto", description="direction of the components: east and north, or the file's own axes"
    )
    stagger: Literal["auto", "none", "before", "after"] = Field(
        "auto", description="position of u and v on a C grid, see `floebmi.cgrid`"
    )
    depth: NonNegative | None = Field(
        None,
        description="depth (for wind: height) [m]; the level nearest to it is read; default: the surface, 10 m for wind",
    )
    select: Select = None
    units: str | None = Field(
        None, description="units of the velocity, if the file states none or wrong ones"
    )
    mask: Mask = "auto"
    fill_land: FillLand = "error"
    position: Position = "auto"
    file_projection: FileProjection = None
    beyond_span: BeyondSpan = Field(
        "error",
        description="what to do before the first and after the last record",
    )

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if self.velocity is not None and self.file is not None:
            raise InputError("velocity and file exclude each other; give one")
        if self.velocity is not None and not max(map(abs, self.velocity)) < FASTEST:
            raise InputError(f"velocity = {list(self.velocity)}: must be below {FASTEST:g} m/s")
        if self.file is None:
            idle = self.model_fields_set - {"velocity", "drag", "grid", "layer_thickness"}
            if idle:
                raise InputError(f"{min(idle)} applies to a file: give file, or leave it out")
        return self

    def source(self, sea: Sea, grid: "Grid") -> "VelocitySource":
        """The source that fills the velocity in the cells of the fluid's grid."""
        from floebmi import forcing

        if self.file is None:
            return forcing.Constant(*(self.velocity or (0.0, 0.0)))
        names = [self.file] if isinstance(self.file, str) else self.file
        return forcing.VelocityFile(
            [sea.folder / name for name in names], grid,
            kind="ocean" if isinstance(self, Ocean) else "wind",
            projection=sea.projection, start=sea.start, calendar=sea.calendar,
            variables=self.variables, vectors=self.vectors, stagger=self.stagger,
            depth=self.depth, select=self.select, units=self.units, mask=self.mask,
            fill_land=self.fill_land, position=self.position,
            file_projection=self.file_projection, beyond_span=self.beyond_span,
        )  # fmt: skip


class Ocean(FluidTable):
    """The ocean: its velocity, and its drag on the bottoms and sides of the floes."""

    drag: word_or(Literal[*DRAG_PRESETS], OceanDrag) = Field("damsgaard2018", description=_DRAG)
    layer_thickness: Positive | None = Field(
        None,
        description="thickness of the host's uppermost layer [m]; with it, exchanges that are too rare raise a warning",
    )


class Atmosphere(FluidTable):
    """The wind: its velocity, and its drag on the tops and freeboards of the floes."""

    drag: word_or(Literal[*DRAG_PRESETS], AirDrag) = Field("damsgaard2018", description=_DRAG)
    grid: GridTable | None = Field(None, description="separate grid for the wind; default: [grid]")


class CoriolisTable(Table):
    """Coriolis acceleration."""

    parameter: float | None = Field(None, description="Coriolis parameter f [1/s]")
    latitude: float | None = Field(
        None,
        ge=-90,
        le=90,
        description="latitude [degrees], instead of parameter: f = 2 Ω sin(latitude)",
    )
    field: bool = Field(
        False,
        description="let a host set a Coriolis parameter for each cell; until it does, parameter or latitude holds in every cell",
    )

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if (self.parameter is None) == (self.latitude is None):
            raise InputError("give either parameter or latitude")
        return self

    @property
    def f(self) -> float:
        """The Coriolis parameter [1/s]; with a field its initial value."""
        if self.latitude is not None:
            return 2 * EARTH_ROTATION * math.sin(math.radians(self.latitude))
        return self.parameter

    def build(self) -> Coriolis | CoriolisField:
        return CoriolisField() if self.field else Coriolis(self.f)


_Tilt: Any = table_of(Tilt)


class TiltTable(_Tilt):
    """Sea-surface tilt."""

    slope: Pair = Field((0.0, 0.0), description="slope of the sea surface (∂η/∂x, ∂η/∂y) [1]")
    geostrophic: bool = Field(
        False,
        description="take the slope that is in geostrophic balance with the velocity of [ocean], instead of `slope`",
    )

    @model_validator(mode="after")
    def _one_slope(self) -> Self:
        if self.geostrophic and self.model_fields_set & {"slope", "gravity"}:
            raise InputError(
                "geostrophic takes the place of slope and gravity; give one or the other"
            )
        return self

    def build(self, ocean: Ocean | None, coriolis: CoriolisTable | None) -> Tilt | GeostrophicTilt:
        if not self.geostrophic:
            return law_of(self, Tilt)
        if ocean is None or coriolis is None or coriolis.field:
            raise InputError(
                "geostrophic: needs [ocean], and [coriolis] with one parameter or latitude, not a field"
            )
        return GeostrophicTilt(coriolis.f)


class Ice(Table):
    """Material properties of the ice."""

    density: Positive = Field(934.0, description="density of the ice ρ_ice [kg/m³]")
    draft: Literal["hydrostatic"] | PositiveFraction = Field(
        0.9,
        description="ratio of draft to thickness [1], or 'hydrostatic': ρ_ice over the ocean's density",
    )
    rotation: bool = Field(
        False,
        description="let floes rotate even if the contact law does not need it (torque from the fluids' vorticity)",
    )

    def draft_fraction(self, forces: Sequence[Force]) -> float:
        """Ratio of draft to thickness [1], afloat in the water whose drag is among the forces."""
        if self.draft != "hydrostatic":
            return self.draft
        water = [law.density for law in forces if isinstance(law, OceanDrag)]
        if not water:
            raise InputError("[ice] draft = 'hydrostatic': needs [ocean], whose density sets it")
        if self.density > water[0]:
            raise InputError(
                f"[ice] density = {self.density:g}: sinks in water of [ocean] drag, of density {water[0]:g};"
                " draft = 'hydrostatic' needs ice that floats"
            )
        return self.density / water[0]
