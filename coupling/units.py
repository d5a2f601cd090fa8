"""Units of a model's variables, read and converted by UDUNITS (through cf_units); incompatible units are refused."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from floebmi.errors import InputError

if TYPE_CHECKING:
    import cf_units


def _unit(text: str, of: str) -> cf_units.Unit:
    import cf_units

    try:
        unit = cf_units.Unit(text)
    except ValueError:
        unit = cf_units.Unit("unknown")
    if unit.is_unknown() or unit.is_no_unit():
        raise InputError(
            f"couple: units {text!r} of {of} are not units that UDUNITS knows; say them with"
            f" units={{{of!r}: …}}"
        )
    return unit


def converter(
    given: str, wanted: str, running: bool, source: str, target: str
) -> Callable[[np.ndarray], np.ndarray]:
    """Conversion from the units of one model (per second, for a running integral) to those of another."""
    one, other = _unit(given, source), _unit(wanted, target)
    if running:
        one = one / _unit("s", "time")
    if not one.is_convertible(other):
        per = " per second" if running else ""
        raise InputError(
            f"couple: {source} is in {given!r}{per}, {target} wants {wanted!r}: not the same quantity"
        )
    if one == other:
        return lambda values: values
    return lambda values: one.convert(values, other)


def in_pascals(units: str, of: str) -> float:
    """A unit of stress in pascals; 0 for units of other quantities."""
    unit = _unit(units, of)
    return float(unit.convert(1.0, "Pa")) if unit.is_convertible("Pa") else 0.0


def in_seconds(units: str | None, side: str) -> float:
    """A model's unit of time in seconds; a reference date in it is ignored."""
    text = (units or "").split(" since ")[0]
    unit = _unit(text, f"the {side}'s time")
    if not unit.is_time():
        raise InputError(f"couple: time of the {side} is in {units!r}, which is no unit of time")
    return float(unit.convert(1.0, "s"))
