"""One variable on its way from one model to the other: in what units, between which cells, and what of it is kept.

Names say what is kept, the integral or a mean (see *Kind* in `coupling.driver`), unless a `Link` does.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np

from coupling.regrid import Regrid
from coupling.side import Side
from coupling.units import converter, in_pascals
from floebmi.errors import InputError, is_word

Kind = Literal["integral", "mean"]

PER_AREA = ("stress", "flux", "area_fraction", "mass-per-area", "coefficient")
OVER_ICE = {  # means over the ice, and what weights them
    "sea_ice__thickness": "sea_ice__area_fraction",
    "sea_ice_flowing__x_component_of_velocity": "sea_ice__mass-per-area_density",
    "sea_ice_flowing__y_component_of_velocity": "sea_ice__mass-per-area_density",
    "sea_ice_floe_bottom_water_flowing__x_z_component_of_stress": "sea_ice__area_fraction",
    "sea_ice_floe_bottom_water_flowing__y_z_component_of_stress": "sea_ice__area_fraction",
}


class Link(NamedTuple):
    """How one input is filled, where equal names do not say it.

    Parameters
    ----------
    source : the giver's output; a running `time_integral_of` of the floes is differenced into a mean over
        the exchange
    kind : "integral" (per cell area) or "mean"; None: by the name
    weight : output of the giver that weights the mean (area fraction, mass); None: by the name
    """

    source: str
    kind: Kind | None = None
    weight: str | None = None


def running_name(name: str) -> str:
    """The name of the running time integral of a variable."""
    return name.replace("__", "__time_integral_of_", 1)


def instant_name(name: str) -> str:
    """The name of what a running time integral is of."""
    return name.replace("__time_integral_of_", "__", 1)


def axis_of(name: str) -> int | None:
    """0 for an x component, 1 for a y component."""
    found = re.search(r"_([xy])_(?:z_)?component", name)
    return None if found is None else "xy".index(found[1])


def is_per_area(name: str) -> bool:
    """Whether a variable is per cell area, by its name: its integral is kept, not its mean."""
    return name not in OVER_ICE and any(word in name for word in PER_AREA)


class Connection:
    """One variable on its way from one model to the other."""

    def __init__(
        self,
        giver: Side,
        taker: Side,
        source: str,
        target: str,
        kind: Kind,
        weight: str | None,
        running: bool,
        convert: Callable[[np.ndarray], np.ndarray],
        pascals: float,
        grids: tuple[int, int],
        regrid: Regrid | None,
    ) -> None:
        self.giver, self.taker, self.source, self.target = giver, taker, source, target
        self.kind, self.weight, self.running, self.regrid = kind, weight, running, regrid
        self._convert, self._pascals, self.grids = convert, pascals, grids
        self._before: np.ndarray | None = None

    @property
    def _downstream(self) -> bool:
        """Whether it runs from host to floes, as the weights do."""
        return self.giver.name == "host"

    def remember(self) -> None:
        """Keep a running integral as it is before the interval."""
        if self.running:
            values = self.giver.get(self.source)
            self._refuse_not_finite(values)
            self._before = values

    def instant(self) -> np.ndarray:
        """The value now; of a running integral the mean over the giver's last update."""
        return self.giver.get(instant_name(self.source) if self.running else self.source)

    def since(self) -> np.ndarray:
        """The value now, or the change of a running integral since `remember`."""
        values = self.giver.get(self.source)
        return values - self._before if self.running else values

    def scaled(self, values: np.ndarray, duration: float, was_mean: bool = False) -> np.ndarray:
        """In the taker's units; the change of a running integral becomes a mean over the interval."""
        if self.running:
            values = self._convert(values if was_mean else values / duration)
        else:
            values = self._convert(values)
        self._refuse_not_finite(values)
        return values

    def _refuse_not_finite(self, values: np.ndarray) -> None:
        wet = self._giver_grid_wet(values.size)
        bad = np.flatnonzero(~np.isfinite(values) & wet)
        if bad.size:
            raise InputError(
                f"{self.source} of the {self.giver.name} is {values[bad[0]]} in cell {bad[0]}"
                f" ({bad.size} such cells) at {self.giver.time():g} s"
            )

    def _giver_grid_wet(self, size: int) -> np.ndarray:
        if self.regrid is None:
            return np.ones(size, bool)
        return (self.regrid.source if self._downstream else self.regrid.target).wet

    def carry(self, values: np.ndarray) -> np.ndarray:
        """To the taker's grid."""
        regrid = self.regrid
        if regrid is None:
            return values
        if self.kind == "integral":
            return (regrid.reverse if self._downstream else regrid).flux(values)
        along = regrid if self._downstream else regrid.reverse
        if self.weight is None:
            return along.state(values)
        # eq. regrid-state, with the ice that stands behind each value
        weight = np.where(np.isfinite(values), self.giver.get(self.weight), 0.0)
        total = along.state(weight)
        mean = along.state(weight * np.where(weight > 0, values, 0.0))
        return np.where(total > 0, mean / np.where(total > 0, total, 1.0), 0.0)

    def put(self, values: np.ndarray) -> np.ndarray:
        """Give them to the taker; returns them as it has them, in its own precision."""
        return self.taker.set(self.target, values)

    def force(self, values: np.ndarray, carried: np.ndarray) -> tuple[float, float, float, float]:
        """A stress summed over the giver's cells, over the taker's, what is lost, and Σ |.| [N]."""
        r = self.regrid
        if r is None:
            area = self.giver.know_grid(self.source).area
            given = values * area
            taken, missed = (carried * area).sum(), 0.0
        else:
            given = np.where(r.target.wet, values, 0.0) * r.target_area
            taken, missed = (carried * r.source_area).sum(), r.undelivered(values)
        scale = self._pascals
        return (
            float(given.sum()) * scale, float(taken) * scale, missed * scale,
            float(np.abs(given).sum()) * scale,
        )  # fmt: skip

    def __repr__(self) -> str:
        how = f"{self.kind} kept" + (f", weighted by {self.weight}" if self.weight else "")
        how += ", differenced" if self.running else ""
        return (
            f"{self.giver.name} {self.source} [{self.giver.units(self.source)}]"
            f" → {self.taker.name} {self.target} [{self.taker.units(self.target)}]: {how}"
        )


def connect(
    giver: Side,
    taker: Side,
    target: str,
    link: Link,
    regrid_of: Callable[[tuple[int, int], tuple[str, str]], Regrid | None],
) -> Connection:
    """How an input of the taker is filled from a link; what cannot be is refused.

    regrid_of : the weights between a grid of the host and one of the floes, for variables of these names on them
    """
    from_host = giver.name == "host"
    differenced = "time_integral_of" in link.source and "time_integral_of" not in target
    if differenced and from_host:
        raise InputError(
            f"couple: {link.source} → {target}: only running integrals of the floes are differenced; give an"
            " output of the host that is a value at the time"
        )
    if np.dtype(taker.model.get_var_type(target)).kind != "f":
        raise InputError(
            f"couple: {target} of the {taker.name} is of type {taker.model.get_var_type(target)}, which"
            f" would cut {link.source}; must be of a floating type"
        )
    convert = converter(
        giver.units(link.source), taker.units(target), differenced, link.source, target
    )
    weight = link.weight or OVER_ICE.get(link.source)
    per_area = weight is None and is_per_area(link.source)
    kind = link.kind or ("integral" if per_area else "mean")
    if not is_word(kind, ("integral", "mean")):
        raise InputError(f"couple: kind = {kind!r} of {target}: allowed: integral, mean")
    if weight is not None and (kind == "integral" or weight not in giver.outputs):
        raise InputError(
            f"couple: {target}: weight {weight!r} must be an output of the {giver.name}, and is for"
            " means only"
        )
    mean_names = ("_of_count", "_of_radius", "__count")
    if not from_host and link.kind is None and link.source.endswith(mean_names):
        raise InputError(
            f"couple: {link.source} → {target}: a number or mean over floes; say how it is to be"
            " averaged with Link(source, kind, weight)"
        )
    grids = giver.grid_number(link.source), taker.grid_number(target)
    giver.know_grid(link.source)
    taker.know_grid(target)
    pair = grids if from_host else grids[::-1]
    sides = (link.source, target) if from_host else (target, link.source)
    return Connection(
        giver, taker, link.source, target, kind, weight, differenced, convert,
        in_pascals(taker.units(target), target), pair, regrid_of(pair, sides),
    )  # fmt: skip
