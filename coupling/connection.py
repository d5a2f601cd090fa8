"""One variable passed from one model to the other: units, cells, and the conserved quantity.

Its name decides whether the integral or a mean is conserved (see *Kind* in `coupling.driver`), unless a `Link` does.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np

from coupling.regrid import Regrid
from coupling.side import Side
from coupling.units import converter, in_pascals
from floebmi.errors import InputError, choose, is_word

PER_AREA = (
    "stress",
    "z_integral_of_pressure",
    "flux",
    "area_fraction",
    "mass-per-area",
    "coefficient",
)
COUNT = "sea_ice_floe__count"  # a number per cell, whatever its area
OVER_ICE = {  # means over the ice or its floes, and their weights
    "sea_ice__thickness": "sea_ice__area_fraction",
    "sea_ice_flowing__x_component_of_velocity": "sea_ice__mass-per-area_density",
    "sea_ice_flowing__y_component_of_velocity": "sea_ice__mass-per-area_density",
    "sea_ice_floe_bottom_water_flowing__x_z_component_of_stress": "sea_ice__area_fraction",
    "sea_ice_floe_bottom_water_flowing__y_z_component_of_stress": "sea_ice__area_fraction",
    "sea_ice_floe__mean_of_radius": COUNT,
    "sea_ice_floe_contact__mean_of_count": COUNT,
}


class Link(NamedTuple):
    """The source of one input, where equal names do not determine it.

    Parameters
    ----------
    source : the giver's output; a running `time_integral_of` of the floes is differenced into a mean over
        the exchange
    kind : "integral" (per cell area; for the number of floes the sum) or "mean"; None: by the name
    weight : output of the giver that weights the mean (area fraction, mass); None: by the name
    """

    source: str
    kind: Literal["integral", "mean"] | None = None
    weight: str | None = None


def running_name(name: str) -> str:
    """The name of the running time integral of a variable."""
    return name.replace("__", "__time_integral_of_", 1)


def instant_name(name: str) -> str:
    """The name of the variable of a running time integral."""
    return name.replace("__time_integral_of_", "__", 1)


def axis_of(name: str) -> int | None:
    """0 for an x component, 1 for a y component."""
    found = re.search(r"_([xy])_(?:z_)?component", name)
    return None if found is None else "xy".index(found[1])


def is_per_area(name: str) -> bool:
    """Whether a variable is per cell area, by its name: then its integral is conserved, not its mean."""
    return name == COUNT or name not in OVER_ICE and any(word in name for word in PER_AREA)


class Connection:
    """One variable passed from one model to the other.

    Parameters
    ----------
    giver, taker : the two models
    target : the input of the taker
    link : how it is filled
    regrid_of : weights between a grid of the host and one of the floes, for variables of these names on them; None where
        they are the same cells

    Attributes
    ----------
    source, weight : outputs of the giver, see `Link`
    kind : the conserved quantity, "integral" or "mean"
    running : whether a running integral is differenced into a mean over the exchange
    grids : BMI numbers of the grids, (host, floes)

    Raises
    ------
    InputError
        for an invalid link.
    """

    def __init__(
        self,
        giver: Side,
        taker: Side,
        target: str,
        link: Link,
        regrid_of: Callable[[tuple[int, int], tuple[str, str]], Regrid | None],
    ) -> None:
        source, from_host = link.source, giver.name == "host"
        for output in filter(None, (source, link.weight)):
            if not is_word(output, giver.outputs):
                raise InputError(
                    f"couple: {output!r} is not an output of the {giver.name}; {choose(output, giver.outputs)}"
                )
        running = "time_integral_of" in source and "time_integral_of" not in target
        if running and from_host:
            raise InputError(
                f"couple: {source} → {target}: only running integrals of the floes are differenced; give an"
                " output of the host that is a value at the time"
            )
        type_of_target = taker.model.get_var_type(target)
        if np.dtype(type_of_target).kind != "f":
            raise InputError(
                f"couple: {target} of the {taker.name} is of type {type_of_target}, which would cut {source};"
                " must be of a floating type"
            )
        self._convert = converter(
            giver.unit(source), taker.unit(target), running,
            f"{source} of the {giver.name}", f"{target} of the {taker.name}",
        )  # fmt: skip
        self.giver, self.taker, self.source, self.target = giver, taker, source, target
        self.kind, self.weight = _kept(giver, target, link)
        self.running = running
        grids, names = (giver.grid_number(source), taker.grid_number(target)), (source, target)
        giver.know_grid(source)
        taker.know_grid(target)
        self._downstream = from_host  # in the direction of the weights, from host to floes
        self.grids = grids if from_host else grids[::-1]
        self._pascals = in_pascals(taker.unit(target))
        self.regrid = regrid_of(self.grids, names if from_host else names[::-1])
        self._before: np.ndarray | None = None

    def remember(self) -> None:
        """Store a running integral at the start of the interval."""
        if self.running:
            values = self.giver.get(self.source)
            self._refuse_not_finite(values)
            self._before = values

    def latest(self) -> np.ndarray:
        """The value now, in the taker's units; for a running integral the mean over the giver's last update."""
        return self._converted(
            self.giver.get(instant_name(self.source) if self.running else self.source)
        )

    def mean(self, duration: float) -> np.ndarray:
        """The value now, in the taker's units; for a running integral the mean over the duration since `remember` [s]."""
        values = self.giver.get(self.source)
        return self._converted((values - self._before) / duration if self.running else values)

    def _converted(self, values: np.ndarray) -> np.ndarray:
        values = self._convert(values)
        self._refuse_not_finite(values)
        return values

    def _refuse_not_finite(self, values: np.ndarray) -> None:
        bad = ~np.isfinite(values)
        if self.regrid is not None:
            bad &= (self.regrid.source if self._downstream else self.regrid.target).wet
        if bad.any():
            cell = int(np.argmax(bad))
            raise InputError(
                f"{self.source} of the {self.giver.name} is {values[cell]} in cell {cell}"
                f" ({np.count_nonzero(bad)} such cells) at {self.giver.time():g} s"
            )

    def carry(self, values: np.ndarray) -> np.ndarray:
        """Regrid values to the taker's grid."""
        regrid = self.regrid
        if regrid is None:
            return values
        across = (regrid.reverse if self._downstream else regrid).flux
        areas = regrid.source_area, regrid.target_area
        given, taken = areas if self._downstream else areas[::-1]
        if self.kind == "integral":
            return across(values / given) * taken if self.source == COUNT else across(values)
        if self.weight is None:
            return (regrid if self._downstream else regrid.reverse).state(values)
        # Weight and weighted value are regridded with their integrals conserved: so volume and momentum
        # of the ice are conserved even where one of its cells lies partly over the taker's land.
        weight = np.where(np.isfinite(values), self.giver.get(self.weight), 0.0)
        if self.weight == COUNT:
            weight = weight / given
        total = across(weight)
        whole = across(weight * np.where(weight > 0, values, 0.0))
        return np.where(total > 0, whole / np.where(total > 0, total, 1.0), 0.0)

    def put(self, values: np.ndarray) -> np.ndarray:
        """Set the taker's input; returns the values in its own precision."""
        return self.taker.set(self.target, values)

    def force(self, values: np.ndarray, carried: np.ndarray) -> tuple[float, float, float, float]:
        """Force of a stress: the sum over the giver's cells, over the taker's, the part lost, and Σ |.| [N]."""
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


def _kept(giver: Side, target: str, link: Link) -> tuple[str, str | None]:
    """The conserved quantity of a variable, "integral" or "mean", and the output that weights a mean."""
    source = link.source
    weight = link.weight or OVER_ICE.get(source)
    per_area = weight is None and is_per_area(source)
    kind = link.kind or ("integral" if per_area else "mean")
    if not is_word(kind, ("integral", "mean")):
        raise InputError(f"couple: kind = {kind!r} of {target}: allowed: integral, mean")
    if weight is not None and (kind == "integral" or weight not in giver.outputs):
        raise InputError(
            f"couple: {target}: weight {weight!r} must be an output of the {giver.name}, and is for"
            " means only"
        )
    known = weight is not None or per_area or link.kind is not None
    of_floes = source.endswith(("_of_count", "_of_radius", "__count"))
    if of_floes and giver.name != "host" and not known:
        raise InputError(
            f"couple: {source} → {target}: a number or mean over floes; say how it is to be"
            " averaged with Link(source, kind, weight)"
        )
    return kind, weight
