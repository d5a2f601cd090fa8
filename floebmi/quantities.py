"""Number types that carry their constraint: one declaration serves Python, scene files and docs."""

import math
from collections.abc import Iterable
from typing import Annotated, get_type_hints

from annotated_types import Ge, Gt, Le, Lt

from floebmi.errors import InputError

Positive = Annotated[float, Gt(0)]
NonNegative = Annotated[float, Ge(0)]
Fraction = Annotated[float, Ge(0), Le(1)]
PositiveFraction = Annotated[float, Gt(0), Le(1)]
PoissonRatio = Annotated[float, Ge(0), Le(0.5)]

_WORDS = {Gt: "greater than", Ge: "at least", Lt: "less than", Le: "at most"}


def check(values: Iterable[object], where: str = "") -> None:
    """Check each law (a NamedTuple of annotated numbers) against its own declaration.

    Raises
    ------
    InputError
        naming the law, the parameter, its value and the bound.
    """
    for law in values:
        if law is None:
            continue
        hints = get_type_hints(type(law), include_extras=True)
        for name, value in law._asdict().items():
            place = f"{where}{type(law).__name__}.{name}"
            for bound in getattr(hints[name], "__metadata__", ()):
                limit = next(iter(vars_of(bound).values()))
                if not isinstance(value, (int, float)) or not math.isfinite(value):
                    raise InputError(f"{place} = {value!r}: must be a finite number")
                inside = {
                    Gt: value > limit,
                    Ge: value >= limit,
                    Lt: value < limit,
                    Le: value <= limit,
                }[type(bound)]
                if not inside:
                    raise InputError(f"{place} = {value!r}: must be {_WORDS[type(bound)]} {limit}")


def vars_of(bound: object) -> dict[str, float]:
    return {name: getattr(bound, name) for name in bound.__slots__ or bound.__dataclass_fields__}
