"""Number types that carry their constraint: one declaration serves Python, scene files and docs."""

import math
import numbers
import operator
from collections.abc import Iterable, Iterator, Mapping
from typing import Annotated, get_args, get_type_hints

import numpy as np
from annotated_types import Ge, Gt, Le
from numpy.typing import ArrayLike

from floebmi.errors import InputError, in_line

Positive = Annotated[float, Gt(0)]
NonNegative = Annotated[float, Ge(0)]
Fraction = Annotated[float, Ge(0), Le(1)]
PositiveFraction = Annotated[float, Gt(0), Le(1)]
Count = Annotated[int, Ge(1)]
PoissonRatio = Annotated[float, Ge(0), Le(0.5)]

# From (0, 0) [m]: beyond all maps of the Earth, and as far as numbers tell 0.1 µm apart.
FARTHEST = 1e9

_BOUNDS = {
    Gt: ("gt", operator.gt, "greater than"),
    Ge: ("ge", operator.ge, "at least"),
    Le: ("le", operator.le, "at most"),
}


def check(laws: Iterable[object]) -> None:
    """Check each law (a NamedTuple of annotated numbers) against its own declaration; None passes.

    Raises
    ------
    InputError
        naming the law, the parameter, its value and what would be right.
    """
    for law in laws:
        if law is None:
            continue
        hints = get_type_hints(type(law), include_extras=True)
        laws_of = {name: _laws(hint) for name, hint in hints.items()}
        known = [kind for kinds in laws_of.values() for kind in kinds]
        for name, value in law._asdict().items():
            place = f"{type(law).__name__}.{name}"
            if not laws_of[name]:
                _check_number(place, value, hints[name])
            elif value is not None or type(None) not in type_parts(hints[name]):
                _check_law(place, value, laws_of[name], known)


def _check_law(place: str, value: object, kinds: list[type], known: list[type]) -> None:
    """A law within a law is of these kinds, or of one that somebody added, not of another known one."""
    kind = type(value)
    if not hasattr(kind, "_fields") or (kind in known and kind not in kinds):
        names = " or ".join(kind.__name__ for kind in kinds)
        raise InputError(f"{place} = {value!r}: must be of the kind {names}")
    check([value])


def unmasked(values: ArrayLike) -> np.ndarray:
    """Numbers as float64, NaN where a masked array, as netCDF4 gives, or a column of objects has none (a mask, None).

    Raises
    ------
    InputError
        for what is not real, or has a unit: numpy would take numbers out of texts, and leave out an imaginary part or
        a unit; and for rows of unlike lengths.
    """
    if _has_unit(values):
        raise InputError(f"{in_line(values)}: must be numbers without a unit")
    if values is None:  # numpy would take it for NaN
        raise InputError("None: must be real numbers")
    try:
        array = np.asanyarray(values)
    except ValueError as error:  # rows of unlike lengths
        raise InputError(
            f"{in_line(values)}: must be numbers, in rows of one length ({error})"
        ) from None
    if array.dtype.kind not in "fiubO":  # objects may be numbers, as in columns of pandas
        raise InputError(f"values of type {array.dtype}: must be real numbers")
    if array.dtype.kind == "O" and any(isinstance(value, str | bytes) for value in array.flat):
        raise InputError("texts among the values: must be real numbers")
    try:
        if isinstance(array, np.ma.MaskedArray):
            return array.astype(np.float64).filled(np.nan)
        return np.asarray(array, np.float64)
    except (TypeError, ValueError, OverflowError) as error:  # objects that are none, or too large
        raise InputError(f"{in_line(values)}: must be real numbers ({error})") from None


def _has_unit(values: object) -> bool:
    """Whether it is a quantity of astropy, pint or unyt."""
    return hasattr(values, "to") and (hasattr(values, "unit") or hasattr(values, "units"))


def flat(name: str, values: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Values of cells or points (size,), which came so, or in the rows and columns of `shape`.

    Raises
    ------
    InputError
        for rows and columns of another shape, as of an array that is turned over: its values would come to other cells.
    """
    given, right = ([n for n in lengths if n != 1] for lengths in (values.shape, shape))
    if len(given) > 1 and given != right:
        size = math.prod(shape)
        raise InputError(
            f"{name} has shape {values.shape}: must be {shape}, rows and columns, or ({size},)"
        )
    return values.ravel()


def is_number(value: object) -> bool:
    """Whether it is one finite real number, be it of numpy or another array library: no text, no flag, no row, no unit."""
    if _has_unit(value):
        return False
    try:
        array = np.asarray(value)
    except ValueError:  # rows of unlike lengths
        return False
    real = array.ndim == 0 and array.dtype.kind in "iuf" and value is not np.ma.masked
    return real and bool(np.isfinite(array))


def check_length(name: str, value: object) -> None:
    """InputError for what is no length [m] greater than 0."""
    if not (is_number(value) and value > 0):
        raise InputError(f"{name} = {value!r} m; must be greater than 0")


def two_numbers(pair: object) -> tuple[float, float] | None:
    """The two numbers of a tuple, a list, an array or a column of a table; None of all else."""
    row = np.iterable(pair) and hasattr(pair, "__getitem__") and not isinstance(pair, bytes)
    row = list(pair) if row else []
    return (float(row[0]), float(row[1])) if len(row) == 2 and all(map(is_number, row)) else None


def check_flag(name: str, value: object) -> None:
    """InputError for what is neither True nor False: a text such as "no" would be true."""
    if not isinstance(value, bool | np.bool_):
        raise InputError(f"{name} = {value!r}: must be True or False")


def check_table(name: str, value: object) -> None:
    """InputError for what is neither a dict or the like nor None."""
    if not isinstance(value, Mapping | None):
        raise InputError(f"{name} = {in_line(value)}: must be a dict")


def number_in(value: object) -> float:
    """The number that a cell of a CSV file or a value of GeoJSON is.

    Raises
    ------
    ValueError, TypeError
        for what is none; Python would take `1_000` for a thousand, and true for 1.
    """
    if isinstance(value, bool) or (isinstance(value, str) and "_" in value):
        raise ValueError(value)
    return float(value)  # type: ignore[arg-type]


def as_python(law: tuple) -> str:
    """A law as one would write it in Python, without what is absent."""
    parts = [
        f"{name}={as_python(value) if hasattr(value, '_asdict') else repr(value)}"
        for name, value in law._asdict().items()
        if value is not None
    ]
    return f"{type(law).__name__}({', '.join(parts)})"


def _check_number(place: str, value: object, hint: object) -> None:
    parts = list(type_parts(hint))
    whole = int in parts
    if not (whole or float in parts) or (value is None and type(None) in parts):
        return
    values = value if tuple in parts and isinstance(value, tuple) else (value,)
    for one in values:
        number = isinstance(one, numbers.Integral if whole else numbers.Real)
        # kernels take what numpy has a type for: no fraction, no integer without end, no long double
        if isinstance(one, bool) or not (
            number and is_number(one) and np.asarray(one).itemsize <= 8
        ):
            what = "whole" if whole else "finite"
            raise InputError(f"{place} = {value!r}: must be a {what} number")
        for part in parts:
            if type(part) in _BOUNDS:
                name, holds, relation = _BOUNDS[type(part)]
                limit = getattr(part, name)
                if not holds(one, limit):
                    raise InputError(f"{place} = {value!r}: must be {relation} {limit}")


def _laws(hint: object) -> list[type]:
    """The kinds of law that a type allows."""
    return [
        part for part in type_parts(hint) if isinstance(part, type) and hasattr(part, "_fields")
    ]


def type_parts(hint: object) -> Iterator[object]:
    """A type, what it is made of, and the bounds that it carries."""
    yield getattr(hint, "__origin__", hint)
    yield from getattr(hint, "__metadata__", ())
    for inner in get_args(hint):
        yield from type_parts(inner)
