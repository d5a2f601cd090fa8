"""Scalar outputs of the component, for the whole model: ledger totals and time steps."""

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, NamedTuple

from floebmi.variables import AXES

if TYPE_CHECKING:
    from floebmi.model import Model


class Scalar(NamedTuple):
    """A scalar output for the whole model; it exists only if the model has `fluid`."""

    csdms: str
    units: str
    text: str
    value: "Callable[[Model], float]"
    fluid: str = ""


def _gained(column: int, counts: Callable[[str], bool]) -> "Callable[[Model], float]":
    """The sum of a column of the ledger over those accounts that count."""
    return lambda model: sum(
        float(row[column]) for name, row in model.ledger.accounts.items() if counts(name)
    )


def _per_axis() -> Iterator[Scalar]:
    for q, axis in enumerate(AXES):
        a = axis.letter
        yield Scalar(
            f"sea_ice_flowing__domain_integral_of_{a}_component_of_momentum",
            "N s",
            f"momentum of the ice along {a}",
            lambda model, q=q: float(model.ledger.now[1 + q]),
        )
        yield Scalar(
            f"sea_ice_bottom_water_flowing__domain_time_integral_of_{a}_component_of_undelivered_stress",
            "N s",
            f"impulse of ice on ocean along {a} that found no wet cell, since the start",
            lambda model, q=q: float(model.ocean.undelivered[q]),
            "ocean",
        )
        yield Scalar(
            f"sea_ice_top_air_flowing__domain_time_integral_of_{a}_z_component_of_stress",
            "N s",
            f"impulse of air on ice along {a}, since the start",
            _gained(1 + q, lambda name: name == "wind"),
            "atmosphere",
        )
        yield Scalar(
            f"sea_ice_flowing__domain_time_integral_of_{a}_component_of_other_force",
            "N s",
            f"impulse on ice along {a} by all but ocean drag and wind, since the start",
            _gained(1 + q, lambda name: name not in ("wind", "ocean drag")),
        )
        yield Scalar(
            f"sea_ice_flowing__{a}_component_of_momentum_balance_residual",
            "N s",
            f"momentum along {a} that no account explains",
            lambda model, a=a: model.ledger.balance(f"momentum_{a}").residual,
        )


SCALARS: tuple[Scalar, ...] = (
    Scalar(
        "sea_ice__domain_integral_of_mass",
        "kg",
        "mass of the ice",
        lambda model: float(model.ledger.now[0]),
    ),
    *_per_axis(),
    Scalar(
        "sea_ice__mass_balance_residual",
        "kg",
        "mass that no account explains",
        lambda model: model.ledger.balance("mass").residual,
    ),
    Scalar(
        "sea_ice__energy_balance_residual",
        "J",
        "energy that no account explains; the time step's own error is in it",
        lambda model: model.ledger.balance("energy").residual,
    ),
    Scalar(
        "model__min_of_time_step",
        "s",
        "shortest step between contacts so far, 0 before the first",
        lambda model: model.counters.shortest_step if model.counters.steps else 0.0,
    ),
    Scalar(
        "model_time_step__count",
        "1",
        "steps between contacts since the start",
        lambda model: float(model.counters.steps),
    ),
)
"""Outputs that are one number each: grid type `scalar`, rank 0, size 1."""
