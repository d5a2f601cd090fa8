"""Units of a model's variables, read and converted by UDUNITS (through cf_units); incompatible units are refused."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from floebmi.errors import InputError

if TYPE_CHECKING:
    import cf_units


def read(text: str, of: str, cure: str) -> cf_units.Unit:
    """The unit that a text tells; an error ends with what cures it."""
    import cf_units

    try:
        unit = cf_units.Unit(text)
    except ValueError:
        unit = cf_units.Unit("unknown")
    if unit.is_unknown() or unit.is_no_unit():
        raise InputError(f"couple: units {text!r} of {of} are not units that UDUNITS knows{cure}")
    return unit


def converter(
    given: cf_units.Unit, wanted: cf_units.Unit, running: bool, source: str, target: str
) -> Callable[[np.ndarray], np.ndarray]:
    """Conversion from the unit of one model (per second, for a running integral) to that of another."""
    one = given / "s" if running else given
    if not one.is_convertible(wanted):
        per = " per second" if running else ""
        raise InputError(
            f"couple: {source} is in {str(given)!r}{per}, {target} wants {str(wanted)!r}: not the same quantity"
        )
    if one == wanted:
        return lambda values: values
    return lambda values: one.convert(values, wanted)


def in_pascals(unit: cf_units.Unit) -> float:
    """A unit of stress in pascals; 0 for units of other quantities."""
    return float(unit.convert(1.0, "Pa")) if unit.is_convertible("Pa") else 0.0


def in_seconds(units: str | None, side: str) -> float:
    """A model's unit of time in seconds; a reference date in it is ignored."""
    text = (units or "").split(" since ")[0]
    unit = read(text, f"the {side}'s time", "")
    if not unit.is_time():
        raise InputError(f"couple: time of the {side} is in {units!r}, which is no unit of time")
    return float(unit.convert(1.0, "s"))
