"""Units of files as factors to SI; unknown units are refused, with those allowed."""

import re

from floebmi.errors import InputError

LENGTHS = {
    **dict.fromkeys(("m", "meter", "meters", "metre", "metres"), 1.0),
    **dict.fromkeys(("km", "kilometer", "kilometers", "kilometre", "kilometres"), 1000.0),
    **dict.fromkeys(("cm", "centimeter", "centimeters", "centimetre", "centimetres"), 0.01),
    **dict.fromkeys(("mm", "millimeter", "millimeters", "millimetre", "millimetres"), 0.001),
}
DURATIONS = {
    **dict.fromkeys(("s", "sec", "second", "seconds"), 1.0),
    **dict.fromkeys(("min", "minute", "minutes"), 60.0),
    **dict.fromkeys(("h", "hr", "hour", "hours"), 3600.0),
    **dict.fromkeys(("d", "day", "days"), 86400.0),
}
_KNOTS = {"kt", "kts", "kn", "knot", "knots"}
# Remedies for unknown units: where an option can give them, and where none can.
BY_OPTION, IN_FILE = "say which with units", "put right its attribute units"
_FRACTIONS = {
    **dict.fromkeys(
        ("", "1", "fraction", "-", "none", "dimensionless", "unitless", "nondimensional"), 1.0
    ),
    **dict.fromkeys(("0-1", "(0-1)", "(0 - 1)", "m2 m-2", "m2/m2"), 1.0),
    **dict.fromkeys(("%", "percent", "1e-2", "0.01"), 0.01),
}


def _tidy(units: object) -> str:
    return " ".join(str(units if units is not None else "").strip().lower().split())


def velocity_factor(units: str | None, where: str) -> float:
    """Factor from `units` to m s-1: any length per time ("m s-1", "cm/s", "km h**-1"), or knots."""
    text = _tidy(units)
    if text in _KNOTS:
        return 1852.0 / 3600.0
    match = re.fullmatch(r"([a-z]+) ?(?:/|per) ?([a-z]+)", text)
    match = match or re.fullmatch(r"([a-z]+)[ .*]+([a-z]+) ?(?:\^|\*\*)? ?\(?-1\)?", text)
    if match and match[1] in LENGTHS and match[2] in DURATIONS:
        return LENGTHS[match[1]] / DURATIONS[match[2]]
    raise InputError(_unknown(units, where, "a velocity: m s-1, cm s-1, km h-1, knots"))


def length_factor(units: str | None, where: str, remedy: str = BY_OPTION) -> float:
    """Factor from `units` to m."""
    if _tidy(units) not in LENGTHS:
        raise InputError(_unknown(units, where, "a length: m, km, cm", remedy))
    return LENGTHS[_tidy(units)]


def fraction_factor(units: str | None, where: str) -> float:
    """Factor from `units` to 1; missing units count as 1."""
    if _tidy(units) not in _FRACTIONS:
        raise InputError(_unknown(units, where, "a fraction: 1 or %", IN_FILE))
    return _FRACTIONS[_tidy(units)]


def is_percent(units: str | None) -> bool:
    """Whether these units are percent: full cover is 100."""
    return _FRACTIONS.get(_tidy(units)) == 0.01


def _unknown(units: str | None, where: str, right: str, remedy: str = BY_OPTION) -> str:
    said = "it has no units" if units is None else f"units = {units!r}"
    return f"{where}: {said}; must be {right} ({remedy})"
