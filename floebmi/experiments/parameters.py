"""The parameters of the two experiments: every value with its unit and where it comes from.

"stated" means that the paper gives the value; "chosen" that it does not, followed by the reason for this value; "reference
code" that it is from the paper's own code, Granular.jl, its examples or its defaults.  A field is a row of the table, an
option of `floebmi experiment`, and a parameter of an ensemble member.
"""

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal, NamedTuple, get_args, get_type_hints

from annotated_types import Ge, Gt, Lt

from floebmi import quantities
from floebmi.errors import InputError, check_word, choose
from floebmi.quantities import NonNegative, PoissonRatio, Positive, PositiveFraction

Preset = Literal["default", "damsgaard2018", "granular.jl-0.3.2", "constant-cd"]
PRESETS: tuple[str, ...] = get_args(Preset)
# presets that run as the paper's code did: three-term Taylor scheme, time step of Eq. 4, lever arms R_ij
AS_THE_PAPER = ("damsgaard2018", "granular.jl-0.3.2")
NORMAL_STRESSES = (5e3, 10e3, 20e3, 40e3, 80e3)  # [Pa], of a sweep in shear: stated, 5 to 80 kPa


class Row(NamedTuple):
    """Unit, meaning and source of a parameter."""

    unit: str
    meaning: str
    source: str


Share = Annotated[float, Gt(0), Lt(1)]

FRICTION = Row(
    "1",
    "friction coefficient μ; 0 turns friction and rotation off",
    "stated: 0.3, sections 3, 4",
)
TENSILE = Row(
    "Pa", "tensile strength σ_c; 0 turns bonds off", "stated: 0 (frictional) or 200 kPa (cohesive)"
)
YOUNG = Row("Pa", "Young's modulus E", "stated: 20 MPa")
POISSON = Row("1", "Poisson's ratio ν", "stated: 0.185")
DENSITY = Row("kg m-3", "ice density", "reference code")
EXPONENT = Row("1", "exponent of the power law of floe radii", "stated: −1.8")
THICKNESS = Row("m", "floe thickness", "chosen: 1 m; the paper does not give it")
RESTITUTION = Row(
    "1", "coefficient of restitution; 1 turns dashpots off", "the paper has no dashpots"
)
PRESET = Row(
    "",
    "default: velocity Verlet, true lever arms; damsgaard2018: scheme, step and lever arms of the paper; "
    "granular.jl-0.3.2: the same with the drag of that code; constant-cd: default with drag on the floe's area",
    "chosen: the default scheme; the printed drag",
)


class Shear(NamedTuple):
    """A pack in simple shear under a loaded wall (Figs 1, 3, 4 of the paper)."""

    friction: Annotated[NonNegative, FRICTION] = 0.3
    tensile_strength: Annotated[NonNegative, TENSILE] = 0.0
    normal_stress: Annotated[Positive, Row("Pa", "normal stress N on the top wall", "stated: 5 to 80 kPa")] = 20e3  # fmt: skip
    floes: Annotated[float, Ge(1), Row("1", "number of floes", "chosen: at least 1000")] = 1000
    height: Annotated[Positive, Row("m", "approximate height of the settled pack", "chosen: gives an inertia number of 2e-3 to 1e-2 for 80 to 5 kPa")] = 1300.0  # fmt: skip
    radius_min: Annotated[Positive, Row("m", "smallest radius", "stated: 5 m")] = 5.0
    radius_max: Annotated[Positive, Row("m", "largest radius", "stated: 50 m")] = 50.0
    exponent: Annotated[float, EXPONENT] = -1.8
    thickness: Annotated[Positive, THICKNESS] = 1.0
    speed: Annotated[
        Positive, Row("m s-1", "speed of the driven floes along +x", "stated: 1 m/s")
    ] = 1.0
    held: Annotated[Positive, Row("m", "distance from the bottom within which floes are fixed, and from the top within which they are driven", "stated: one floe size; taken as the largest diameter")] = 100.0  # fmt: skip
    concentration: Annotated[Share, Row("1", "expected area fraction of floes in the box before settling; that of a seed depends on the sizes drawn", "chosen: the densest that settles quickly")] = 0.75  # fmt: skip
    settling: Annotated[Positive, Row("s", "settling time, in water that flows along −y", "chosen: all floes have come to rest")] = 200.0  # fmt: skip
    settling_speed: Annotated[Positive, Row("m s-1", "speed of that water", "chosen: small compared with elastic waves")] = 2.0  # fmt: skip
    consolidation: Annotated[Positive, Row("s", "time under the loaded wall before shearing", "chosen: the wall has come to rest")] = 150.0  # fmt: skip
    wall_damping: Annotated[NonNegative, Row("1", "damping of the wall, relative to critical damping with the pack as a spring", "chosen: small, since a damped wall that sinks with the pack carries part of N itself")] = 0.1  # fmt: skip
    duration: Annotated[
        Positive, Row("s", "duration of shearing", "chosen: a strain of three quarters")
    ] = 900.0
    steady: Annotated[Share, Row("1", "final fraction of the shearing, over which means are taken", "chosen: the stress has levelled off")] = 0.6  # fmt: skip
    interval: Annotated[Positive, Row("s", "interval between measurements", "chosen: shorter than the oscillation of the wall")] = 2.0  # fmt: skip
    youngs_modulus: Annotated[Positive, YOUNG] = 2e7
    poisson_ratio: Annotated[PoissonRatio, POISSON] = 0.185
    restitution: Annotated[PositiveFraction, RESTITUTION] = 1.0
    ice_density: Annotated[Positive, DENSITY] = 934.0
    preset: Annotated[Preset, PRESET] = "default"


class Strait(NamedTuple):
    """Floes that wind and current drive through a funnel into a strait (Figs 2, 5 to 10)."""

    friction: Annotated[NonNegative, FRICTION] = 0.3
    tensile_strength: Annotated[NonNegative, TENSILE] = 0.0
    width: Annotated[Positive, Row("m", "width W of the strait", "stated: 6000 m")] = 6000.0
    thickness: Annotated[Positive, THICKNESS] = 1.0
    radius_min: Annotated[Positive, Row("m", "smallest radius", "stated: 600 m")] = 600.0
    radius_max: Annotated[Positive, Row("m", "largest radius", "stated: 1350 m")] = 1350.0
    spread: Annotated[NonNegative, Row("1", "factor by which the range of radii is widened about its middle", "chosen: the paper varies the range (Fig. 9)")] = 1.0  # fmt: skip
    exponent: Annotated[float, EXPONENT] = -1.8
    hours: Annotated[
        Positive, Row("h", "duration of a run that does not jam", "chosen: one day")
    ] = 24.0
    slope: Annotated[Positive, Row("1", "slope of the funnel walls, Δx/Δy", "chosen: 45°, near the 39° of the reference code")] = 1.0  # fmt: skip
    funnel: Annotated[Positive, Row("m", "length of the funnel", "chosen: holds about a hundred floes")] = 18e3  # fmt: skip
    channel: Annotated[Positive, Row("m", "length of the strait below the funnel", "chosen: two large floes")] = 3e3  # fmt: skip
    wall_radius: Annotated[Positive, Row("m", "radius of the fixed floes that line the walls", "reference code: that of the smallest floe")] = 600.0  # fmt: skip
    current: Annotated[NonNegative, Row("m s-1", "maximum speed of the ocean, in mid-strait", "stated: 0 to 4 m/s")] = 4.0  # fmt: skip
    wind: Annotated[NonNegative, Row("m s-1", "wind speed, towards −y", "stated: 30 m/s")] = 30.0
    concentration: Annotated[Share, Row("1", "area fraction of floes in the funnel at the start", "chosen: dense, but not yet in contact")] = 0.7  # fmt: skip
    patience: Annotated[Positive, Row("s", "time without a floe through the outlet after which a run counts as jammed", "stated: 1 h")] = 3600.0  # fmt: skip
    exchange: Annotated[Positive, Row("s", "interval at which the current is sampled at the floes", "chosen: a floe moves at most half a cell")] = 300.0  # fmt: skip
    spacing: Annotated[Positive, Row("m", "spacing of the grid that carries the current", "chosen: about the size of a floe")] = 1000.0  # fmt: skip
    interval: Annotated[
        Positive, Row("s", "interval between values of the transport", "chosen")
    ] = 600.0
    youngs_modulus: Annotated[Positive, YOUNG] = 2e7
    poisson_ratio: Annotated[PoissonRatio, POISSON] = 0.185
    restitution: Annotated[PositiveFraction, RESTITUTION] = 1.0
    ice_density: Annotated[Positive, DENSITY] = 934.0
    preset: Annotated[Preset, PRESET] = "default"


Experiment = Shear | Strait


def rows(kind: type[Experiment]) -> Iterator[tuple[str, Any, Row]]:
    """Name, default and row of each parameter."""
    hints = get_type_hints(kind, include_extras=True)
    for name, default in kind._field_defaults.items():
        row = next(part for part in hints[name].__metadata__ if isinstance(part, Row))
        yield name, default, row


def table(kind: type[Experiment]) -> str:
    """The table of an experiment's parameters, in Markdown."""
    lines = ["| parameter | value | unit | meaning | source |", "|---|---|---|---|---|"]
    for name, default, row in rows(kind):
        shown = default if isinstance(default, str) else f"{default:g}"
        lines.append(f"| `{name}` | {shown} | {row.unit} | {row.meaning} | {row.source} |")
    return "\n".join(lines)


def make(kind: type[Experiment], values: Mapping[str, Any]) -> Experiment:
    """The parameters of a member, checked.

    Raises
    ------
    InputError
        naming the parameter, its value and what would be right.
    """
    for name in values:
        if name not in kind._fields:
            raise InputError(f"{kind.__name__}.{name}: {choose(name, kind._fields)}")
    made = kind(**values)
    check_word(f"{kind.__name__}.preset", made.preset, PRESETS)
    quantities.check([made])
    if isinstance(made, Shear) and made.floes != int(made.floes):
        raise InputError(f"Shear.floes = {made.floes!r}: must be a whole number")
    if made.radius_max < made.radius_min:
        raise InputError(
            f"{kind.__name__}.radius_max = {made.radius_max!r}: must be at least radius_min, {made.radius_min!r}"
        )
    if isinstance(made, Strait) and not radii(made)[0] > 0:
        raise InputError(
            f"Strait.spread = {made.spread!r}: the smallest radius would not be positive"
        )
    return made


def radii(p: Strait) -> tuple[float, float]:
    """Smallest and largest radius [m], with their range widened about its middle by `spread`."""
    middle, half = 0.5 * (p.radius_min + p.radius_max), 0.5 * (p.radius_max - p.radius_min)
    return middle - p.spread * half, middle + p.spread * half


def code(values: Mapping[str, Any]) -> tuple[bool, ...]:
    """A key for the compiled code: members with equal keys run the same machine code."""
    return (
        values["friction"] > 0,
        values["tensile_strength"] > 0,
        values["restitution"] < 1,
        values["preset"] in AS_THE_PAPER,
    )
