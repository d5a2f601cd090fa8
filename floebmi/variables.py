"""THE table of variables: inputs and outputs with their names, units and signs.

BMI, NetCDF files, Landlab and the documentation read it, so that they cannot disagree.  `VARIABLES` are
the fields on the grids that a host sees, `FLOE_VARIABLES` the properties of single floes (trajectory
files, floe-level BMI arrays).  A new variable is a new row here.

Sign convention: a stress by A on B is positive where it accelerates B along +x or +y.  The
ocean's stress is by ice ON ocean; the air's is by air ON ice.  Both are per area of the whole cell,
already weighted by concentration; only the rows whose name says so are per area of ice.

In gridded.nc a field has its CF standard name, or its short name where CF has none of at most 40 letters; in floes.nc
all have short names.  `model.fields()` uses short names, BMI and Landlab CSDMS names; `floebmi plot --variable` accepts any.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Literal, NamedTuple

from floebmi.errors import InputError, choose, is_word

if TYPE_CHECKING:
    import numpy as np

    from floebmi.model import Model

LONGEST_NAME = 40  # letters, of a variable in a file


class Variable(NamedTuple):
    """One row of the table.

    Parameters
    ----------
    name : the key in `model.fields()`, or the attribute of `Floes`
    csdms : CSDMS standard name, or one built by its grammar; used by BMI and Landlab
    cf : CF standard name, None where none fits
    units : UDUNITS text
    text : description, for labels and `long_name`
    positive : the sign, in a sentence; empty where there is no choice
    grid : grid of the values; "floe" has one value per floe
    intent : "in": a host sets it; "out": computed; "restart": part of the floes' state
    dtype : NumPy name of the type
    valid : when the value is meaningful
    home : for "in", its array in the model: fluid.field; empty for computed variables
    needs_ice : where there is no ice, 0 in memory and missing in files
    mean : the CF `cell_methods` of its value in a file
    """

    name: str
    csdms: str
    cf: str | None
    units: str
    text: str
    positive: str = ""
    grid: Literal["ocean", "atmosphere", "exchange", "floe"] = "exchange"
    intent: Literal["in", "out", "restart"] = "out"
    dtype: str = "float64"
    valid: str = "from the start"
    home: str = ""
    needs_ice: bool = False
    mean: str = "area: mean time: point"

    @property
    def file_name(self) -> str:
        """Its name in a NetCDF file: the CF standard name if there is one of at most `LONGEST_NAME` letters."""
        if self.grid == "floe" or self.cf is None or len(self.cf) > LONGEST_NAME:
            return self.name
        return self.cf

    def array_in(self, model: "Model") -> "np.ndarray | None":
        """The array of a model that holds this input; None if the model does not read it."""
        name, _, field = self.home.partition(".")
        fluid = getattr(model, name)
        return None if fluid is None else fluid.fields.get(field)


class Axis(NamedTuple):
    """One of the two directions, as spelled in names."""

    letter: str  # as in `wind_x`
    velocity: str  # as in `ocean.u`


AXES = (Axis("x", "u"), Axis("y", "v"))

_ON_OCEAN = "by ice on ocean: positive accelerates the ocean along +{a}"
_ON_ICE = "by air on ice: positive accelerates the ice along +{a}"
_ALONG = "positive along +{a}"
_HOST = "once the host or a forcing sets it; {before} until then"
_EXCHANGE = "after the first update, 0 before: mean over the last exchange interval"
_ENDED = "after the first update, 0 before: as the last exchange ended, in the water that it read"
_RUNNING = "from the start, where it is 0; never reset"
# in a file: the mean since the last frame, over the ice alone, without the stress on open water
_OVER_FRAMES = "area: mean where sea_ice over all_area_types time: mean"
_OVER_EXCHANGE = "area: mean time: mean (over the last exchange interval)"
_OVER_ICE = "area: mean where sea_ice time: mean (comment: over the area of ice at the end)"
_ICE_MEAN = "area: mean where sea_ice time: point"


def _vectors(rows: list[Variable]) -> Iterator[Variable]:
    """The rows, once per direction each; {a} stands for x or y, {u} for u or v."""
    for row in rows:
        for a, u in AXES:
            filled = {
                column: value.format(a=a, u=u)
                for column, value in row._asdict().items()
                if isinstance(value, str)
            }
            yield row._replace(**filled)


_INPUTS = (
    *_vectors(
        [
            Variable(
                "ocean_velocity_{a}",
                "sea_surface_water_flowing__{a}_component_of_velocity",
                "surface_sea_water_{a}_velocity",
                "m s-1",
                "ocean surface velocity along {a}",
                _ALONG,
                grid="ocean",
                intent="in",
                valid=_HOST.format(before="still water"),
                home="ocean.{u}",
            ),
            Variable(
                "wind_{a}",
                "sea_surface_air_flowing__{a}_component_of_velocity",
                "{a}_wind",
                "m s-1",
                "wind at 10 m along {a}",
                _ALONG,
                grid="atmosphere",
                intent="in",
                valid=_HOST.format(before="no wind"),
                home="atmosphere.{u}",
            ),
            Variable(
                "sea_surface_tilt_{a}",
                "sea_water_surface__{a}_derivative_of_elevation",
                None,
                "1",
                "slope of the sea surface along {a}",
                "positive where the surface rises along +{a}",
                grid="ocean",
                intent="in",
                valid=_HOST.format(before="level water"),
                home="ocean.tilt_{a}",
            ),
        ]
    ),
    Variable(
        "coriolis_parameter",
        "earth__coriolis_frequency",
        "coriolis_parameter",
        "s-1",
        "Coriolis parameter",
        "positive in the northern hemisphere",
        grid="ocean",
        intent="in",
        valid=_HOST.format(before="no rotation"),
        home="ocean.coriolis",
    ),
)

_STATE = (
    Variable(
        "area_fraction",
        "sea_ice__area_fraction",
        "sea_ice_area_fraction",
        "1",
        "sea-ice concentration: ice area over cell area",
        "at most 1; what is beyond is the overlap fraction",
    ),
    Variable(
        "overlap_fraction",
        "sea_ice_floe_overlap__area_fraction",
        None,
        "1",
        "area of floes over cell area, beyond the concentration",
        "area fraction + overlap fraction = exact area of all discs in the cell over its area",
    ),
    Variable(
        "porosity",
        "sea_ice__porosity",
        None,
        "1",
        "porosity of the pack: open water over cell area",
        "porosity + area fraction = 1 where there is ice; porosity 0 where there is none",
        needs_ice=True,
    ),
    Variable(
        "thickness",
        "sea_ice__thickness",
        "sea_ice_thickness",
        "m",
        "ice thickness, mean over the ice",
        needs_ice=True,
        mean=_ICE_MEAN,
    ),
    Variable(
        "mass_per_area",
        "sea_ice__mass-per-area_density",
        "sea_ice_amount",
        "kg m-2",
        "ice mass per cell area",
    ),
    *_vectors(
        [
            Variable(
                "ice_velocity_{a}",
                "sea_ice_flowing__{a}_component_of_velocity",
                "sea_ice_{a}_velocity",
                "m s-1",
                "ice velocity along {a}, mean by mass",
                _ALONG,
                needs_ice=True,
                mean=_ICE_MEAN,
            )
        ]
    ),
    Variable(
        "floe_count",
        "sea_ice_floe__count",
        None,
        "1",
        "number of floes, each shared out among cells by its area",
        mean="area: sum time: point",
    ),
    Variable(
        "mean_radius",
        "sea_ice_floe__mean_of_radius",
        None,
        "m",
        "radius, mean over the floes",
        needs_ice=True,
        mean="area: mean (over floes) time: point",
    ),
    Variable(
        "coordination_number",
        "sea_ice_floe_contact__mean_of_count",
        None,
        "1",
        "contacts per floe, mean over the floes",
        needs_ice=True,
        mean="area: mean (over floes) time: point",
    ),
)

# the stress per ice area, and the stress per cell area of the same impulse
PER_ICE_AREA = {
    f"ocean_stress_per_ice_area_{axis.letter}": f"ocean_stress_{axis.letter}" for axis in AXES
}

_STRESSES = (
    *_vectors(
        [
            Variable(
                "ocean_stress_{a}",
                "sea_ice_bottom_water_flowing__{a}_z_component_of_stress",
                "downward_{a}_stress_at_sea_ice_base",
                "Pa",
                "ice-to-ocean stress along {a}, per cell area",
                _ON_OCEAN,
                valid=_EXCHANGE,
                mean=_OVER_FRAMES,
            ),
            Variable(
                "ocean_stress_per_ice_area_{a}",
                "sea_ice_floe_bottom_water_flowing__{a}_z_component_of_stress",
                None,
                "Pa",
                "ice-to-ocean stress along {a}, per ice area",
                _ON_OCEAN,
                valid=_EXCHANGE,
                needs_ice=True,
                mean=_OVER_ICE,
            ),
        ]
    ),
    Variable(
        "ocean_stress_magnitude",
        "sea_ice_bottom_water_flowing__time_average_of_magnitude_of_stress",
        None,
        "Pa",
        "magnitude of each floe's mean stress on the ocean in an exchange, summed per cell area",
        valid=_EXCHANGE,
        mean=_OVER_EXCHANGE,
    ),
    Variable(
        "ocean_drag_coefficient",
        "sea_ice_bottom_water_flowing__linear_drag_coefficient",
        None,
        "kg m-2 s-1",
        "linear coefficient of the ice-ocean stress, per cell area",
        "stress on ocean = coefficient × (ice velocity − ocean velocity)",
        valid=_ENDED,
    ),
    *_vectors(
        [
            Variable(
                "air_stress_{a}",
                "sea_ice_top_air_flowing__{a}_z_component_of_stress",
                "surface_downward_{a}_stress",
                "Pa",
                "air-to-ice stress along {a}, per cell area",
                _ON_ICE,
                grid="atmosphere",
                valid=_EXCHANGE,
                mean=_OVER_FRAMES,
            ),
            Variable(
                "ocean_impulse_{a}",
                "sea_ice_bottom_water_flowing__time_integral_of_{a}_z_component_of_stress",
                None,
                "Pa s",
                "running impulse of ice on ocean along {a}, per cell area",
                _ON_OCEAN,
                valid=_RUNNING,
            ),
            Variable(
                "air_impulse_{a}",
                "sea_ice_top_air_flowing__time_integral_of_{a}_z_component_of_stress",
                None,
                "Pa s",
                "running impulse of air on ice along {a}, per cell area",
                _ON_ICE,
                grid="atmosphere",
                valid=_RUNNING,
            ),
        ]
    ),
    *(
        Variable(
            f"internal_stress_{a}{b}",
            f"sea_ice_flowing__z_integral_of_{a}_{b}_component_of_stress",
            None,
            "N m-1",
            f"internal stress σ_{a}{b}, summed over the thickness",
            "tension positive" if a == b else "",
        )
        for a, b in ("xx", "xy", "yy")
    ),
    *_vectors(
        [
            Variable(
                "internal_stress_divergence_{a}",
                "sea_ice_flowing__z_integral_of_{a}_component_of_divergence_of_stress",
                "sea_ice_{a}_internal_stress",
                "Pa",
                "divergence of the internal stress along {a}",
                "on the ice: positive accelerates the ice along +{a}; "
                "an alternative to the ice-ocean stress for some hosts, never added to it",
            )
        ]
    ),
    Variable(
        "internal_pressure",
        "sea_ice_flowing__z_integral_of_pressure",
        None,
        "N m-1",
        "internal pressure, −(σ_xx + σ_yy)/2",
        "compression positive",
    ),
    Variable(
        "maximum_shear",
        "sea_ice_flowing__z_integral_of_max_of_shear_stress",
        "maximum_over_coordinate_rotation_of_sea_ice_horizontal_shear_stress",
        "N m-1",
        "largest shear stress over all directions, √(((σ_xx − σ_yy)/2)² + σ_xy²)",
        "never negative",
    ),
)

VARIABLES: tuple[Variable, ...] = (*_INPUTS, *_STATE, *_STRESSES)
"""The gridded variables; `name`, `csdms` and `cf` are each unique."""


_FLOES = (
    *_vectors(
        [
            Variable(
                "{a}",
                "sea_ice_floe_center__{a}_coordinate",
                "projection_{a}_coordinate",
                "m",
                "{a} of the floe's centre",
                _ALONG,
                intent="restart",
            ),
            Variable(
                "{u}",
                "sea_ice_floe__{a}_component_of_velocity",
                "sea_ice_{a}_velocity",
                "m s-1",
                "velocity of the floe along {a}",
                _ALONG,
                intent="restart",
            ),
        ]
    ),
    Variable("radius", "sea_ice_floe__radius", None, "m", "radius", intent="restart"),
    Variable(
        "thickness",
        "sea_ice_floe__thickness",
        "sea_ice_thickness",
        "m",
        "thickness",
        intent="restart",
    ),
    Variable(
        "angle",
        "sea_ice_floe__rotation_angle",
        None,
        "rad",
        "angle that the floe has turned",
        "counter-clockwise positive",
        intent="restart",
        valid="where floes rotate",
    ),
    Variable(
        "angular_velocity",
        "sea_ice_floe__angular_velocity",
        None,
        "rad s-1",
        "angular velocity",
        "counter-clockwise positive",
        intent="restart",
        valid="where floes rotate",
    ),
    Variable(
        "active",
        "sea_ice_floe__active_flag",
        None,
        "1",
        "1 while the floe is in the domain, 0 once it has left",
        intent="restart",
        dtype="bool",
    ),
    Variable(
        "motion",
        "sea_ice_floe__prescribed_motion_flag",
        None,
        "1",
        "sum of what is prescribed: 1 velocity along x, 2 along y, 4 rotation; 8: a piece of coast",
        intent="restart",
        dtype="int8",
    ),
    Variable(
        "contact_count",
        "sea_ice_floe_contact__count",
        None,
        "1",
        "number of contacts: the floe's coordination number",
        dtype="int32",
    ),
    Variable(
        "bond_count",
        "sea_ice_floe_bond__count",
        None,
        "1",
        "number of bonds",
        dtype="int32",
        valid="where the contact law has bonds",
    ),
    Variable(
        "contact_force",
        "sea_ice_floe_contact__sum_of_magnitude_of_force",
        None,
        "N",
        "contact force, sum of magnitudes",
        "never negative",
    ),
    Variable(
        "pressure",
        "sea_ice_floe__pressure",
        None,
        "Pa",
        "pressure in the floe, from its contact forces",
        "compression positive",
    ),
)

FLOE_VARIABLES: tuple[Variable, ...] = tuple(
    row._replace(grid="floe", mean="time: point") for row in _FLOES
)
"""The variables of single floes."""


def find(name: str) -> Variable:
    """The gridded variable with this short, CSDMS, CF or file name.

    Raises
    ------
    InputError
        if there is none; the message names similar ones.
    """
    for row in VARIABLES:
        if is_word(name, (row.name, row.csdms, row.cf)):
            return row
    raise InputError(f"variable {name!r}: unknown; {choose(name, [row.name for row in VARIABLES])}")


def inputs() -> tuple[Variable, ...]:
    """The gridded variables that a host sets."""
    return tuple(row for row in VARIABLES if row.intent == "in")


def outputs() -> tuple[Variable, ...]:
    """The gridded variables that the model computes; `model.fields()` has those of the model's laws."""
    return tuple(row for row in VARIABLES if row.intent == "out")


def table() -> str:
    """The table as Markdown, for the documentation."""
    head = ("name", "BMI (CSDMS) name", "CF name", "units", "what", "sign", "grid", "valid")
    lines = [head, ("---",) * len(head)]
    for row in (*VARIABLES, *FLOE_VARIABLES):
        cells = (row.name, row.csdms, row.cf or "", row.units, row.text, row.positive)
        lines.append((*cells, f"{row.grid}, {row.intent}", row.valid))
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"
