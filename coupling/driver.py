"""Two BMI models, one clock: the host and the ice, coupled both ways, with the books open.

    couple(host, floes, every=600.0, until=86400.0, show=print)

One exchange over [t, t + every]:

    get    the host's fields at t                  (velocity of the water, wind, tilt …)
    regrid to the floes' grid, and set them
    update the floes to t + every
    get    what the ice gave: the impulse since the last exchange over the interval, J(t + every) − J(t)
    regrid to the host's grid, and set it
    update the host to t + every
    book   one line of the ledger

The ice goes first, so that the host feels exactly the stress that the ice felt from it.  The running
impulse is differenced because it cannot be wrong: a mean over "the last step" is the mean over the exchange
only for a component that takes one step per exchange.

Only BMI calls are made, so either model may be in another process (grpc4bmi).  Nothing is guessed:

- *Names.*  An explicit `to_floes` or `to_host` comes first; then equal CSDMS names; what finds no partner is listed.
- *Units.*  UDUNITS (through cf_units) compares them; convertible units are converted, others refused.
- *Kind.*  What is per cell area (stress, flux, area fraction, mass) crosses with its integral kept; velocities, tilt
  and the like with their mean kept; ice thickness and velocity are means over the ice, and weighted so.
  A floes' cell that lies over the host's land in part gives all of its ice to the wet part, as it gives its
  stress: an area fraction may pass 1 there.  Equal coasts avoid it; a host that can take no more than 1 says
  `Link(fraction, "mean")`, and gets the mean over what the floes' cells cover of its own.
- *Cells.*  BMI says where nodes are.  Nodes of a uniform rectilinear grid are taken for cell centres (faces,
  where the location says so); where cells do not follow from what BMI says, a `Grid` must be given.
  Coordinates are metres in one plane for both models; masks come with a given `Grid`, BMI has none.
- *Time.*  Units of both clocks are compared; a model that does not land on the exchange time ends the run.

The ledger of momentum [N s], per exchange and axis:

    from host    taken by the floes from the water, on their own grid:  −Σ A ΔJ
    to host      put into the host's cells:                              Σ A_host F Δt
    undelivered  of −from host, what found no wet cell of the host
    exchange     from host + to host + undelivered = 0                                   (a residual)
    floes        change in the floes' momentum
    other        given to the floes by all else: wind, walls, fixed floes, Coriolis …
    budget       floes − from host − other + what the floes' own grid could not deliver = 0  (a residual)

    host         change in the momentum of the host's water

A host may take the stress along an axis by several inputs (one moves the water, one stirs it): the lines count the first
of them in the order of its inputs.
A host that takes the stress per ice area, or as a mean, makes the force of it itself, unseen from here: along such
an axis the first four are nan, and so is the line's residual.
`floes` and `other` are read from scalar outputs of the floes, `host` from those of the host; what a model does not offer
is left open, and so is `budget` without the first two.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, final

import numpy as np
from bmipy import Bmi

from coupling.regrid import Regrid, checksum
from floebmi.errors import InputError, choose
from floebmi.grid import Grid
from floebmi.quantities import is_number

if TYPE_CHECKING:
    import cf_units

Kind = Literal["integral", "mean"]

SAME_TIME = 1e-9  # of an exchange interval, beside what a clock can tell at all
PER_AREA = ("stress", "flux", "area_fraction", "mass-per-area", "coefficient")
OVER_ICE = {  # means over the ice, and what weights them
    "sea_ice__thickness": "sea_ice__area_fraction",
    "sea_ice_flowing__x_component_of_velocity": "sea_ice__mass-per-area_density",
    "sea_ice_flowing__y_component_of_velocity": "sea_ice__mass-per-area_density",
    "sea_ice_floe_bottom_water_flowing__x_z_component_of_stress": "sea_ice__area_fraction",
    "sea_ice_floe_bottom_water_flowing__y_z_component_of_stress": "sea_ice__area_fraction",
}
ON_WATER = "sea_ice_bottom_water_flowing__"  # stresses with this beginning are in the ledger
BOTTOM = "_bottom_water_flowing__"  # stresses on the water, per cell area and per ice area
MOMENTUM = "__domain_integral_of_{a}_component_of_momentum"  # ends of names of scalar outputs
OTHERS = (
    "sea_ice_top_air_flowing__domain_time_integral_of_{a}_z_component_of_stress",
    "sea_ice_flowing__domain_time_integral_of_{a}_component_of_other_force",
)
NO_WATER = (
    "sea_ice_bottom_water_flowing__domain_time_integral_of_{a}_component_of_undelivered_stress"
)


class CouplingError(RuntimeError):
    """A model failed in the middle of a coupled run; the line says which, when, and where the state is."""


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


class Exchange(NamedTuple):
    """One line of the ledger; pairs are (x, y) [N s], None where no model says it (see the module's text).

    The first four are NaN along an axis whose stress on the water the host takes in another way than per cell area.
    """

    number: int
    time: float  # of the floes, at the end [s]
    duration: float  # [s]
    from_host: np.ndarray
    to_host: np.ndarray
    undelivered: np.ndarray
    exchange_residual: np.ndarray
    floes: np.ndarray | None
    other: np.ndarray | None
    budget_residual: np.ndarray | None
    host: np.ndarray | None
    turnover: float  # Σ |A ΔJ| over cells and axes since the start of the run [N s]

    @property
    def relative(self) -> float:
        """The larger residual over the turnover; NaN where the stress of an axis is not seen."""
        worst = np.abs(self.exchange_residual).max()
        if self.budget_residual is not None:
            worst = max(worst, np.abs(self.budget_residual).max())
        return float(worst / self.turnover) if self.turnover else float(worst)

    def __str__(self) -> str:
        def pair(values: np.ndarray | None) -> str:
            return f"{'–':>23}" if values is None else f"{values[0]:11.4e} {values[1]:11.4e}"

        columns = (
            self.from_host, self.to_host, self.undelivered, self.floes, self.other, self.host
        )  # fmt: skip
        return f"{self.time:10.6g}  {'  '.join(map(pair, columns))}  {self.relative:9.1e}"


HEADER = "  ".join(
    [f"{'time [s]':>10}"]
    + [
        f"{f'{name} x, y':>23}"
        for name in ("from host", "to host", "undelivered", "floes", "other", "host")
    ]
    + [f"{'residual':>9}"]
)


def couple(
    host: Bmi,
    floes: Bmi,
    *,
    every: float,
    until: float,
    to_floes: Mapping[str, str | Link | None] | None = None,
    to_host: Mapping[str, str | Link | None] | None = None,
    units: Mapping[str, str] | None = None,
    host_grids: Mapping[int, Grid] | None = None,
    floes_grids: Mapping[int, Grid] | None = None,
    regrids: Mapping[tuple[int, int], Regrid] | None = None,
    offset: float | None = None,
    rescue: str | Path | None = None,
    show: Callable[[str], object] | None = None,
) -> list[Exchange]:
    """Couple two initialized BMI models until a time; returns the ledger, one `Exchange` each.

    Parameters
    ----------
    host, floes : models whose `initialize` was called
    every : exchange interval [s]
    until : end, on the floes' clock [s]; a whole number of exchanges from now
    to_floes : input of the floes → output of the host; None leaves the input alone
    to_host : input of the host → output of the floes; None leaves the input alone
    units : units of variables that do not tell them, or tell them wrong
    host_grids, floes_grids : BMI grid number → `Grid`, where BMI does not tell cells or mask
    regrids : (host grid number, floes grid number) → weights made before, from host to floes
    offset : time of the host minus time of the floes [s]; None: their start times are the same moment
    rescue : file for the floes' state if something fails, where the floes have `save_state`
    show : is given the coupling in words, then each line of the ledger (`print`)

    Raises
    ------
    InputError
        before the run: unknown names, units that do not fit, cells that BMI does not tell, clocks that differ.
    CouplingError
        values that are not finite, a grid that changed, a clock that went back, a model that failed, or
        that does not answer to begin with.  The line says when, and in the run where the floes' state is.
    """
    coupling = Coupling(
        host,
        floes,
        every,
        to_floes,
        to_host,
        units,
        host_grids,
        floes_grids,
        regrids,
        offset,
        rescue,
    )
    return coupling.run(until, show)


@final
class Coupling:
    """A host and a floe model with what connects them; parameters as for `couple`.

    Attributes
    ----------
    to_floes, to_host : the connections
    unmatched : inputs of either model that nobody fills
    ledger : one `Exchange` each, so far

    Raises
    ------
    InputError, CouplingError
        as `couple` before the run.
    """

    def __init__(
        self,
        host: Bmi,
        floes: Bmi,
        every: float,
        to_floes: Mapping[str, str | Link | None] | None = None,
        to_host: Mapping[str, str | Link | None] | None = None,
        units: Mapping[str, str] | None = None,
        host_grids: Mapping[int, Grid] | None = None,
        floes_grids: Mapping[int, Grid] | None = None,
        regrids: Mapping[tuple[int, int], Regrid] | None = None,
        offset: float | None = None,
        rescue: str | Path | None = None,
    ) -> None:
        if not (is_number(every) and every > 0):
            raise InputError(f"couple: every = {every!r} s: must be greater than 0")
        if offset is not None and not is_number(offset):
            raise InputError(f"couple: offset = {offset!r} s: must be a finite number")
        _check_kind("host_grids", host_grids, Grid)
        _check_kind("floes_grids", floes_grids, Grid)
        _check_kind("regrids", regrids, Regrid)
        self.every, self.rescue = float(every), rescue
        self.host = _Side("host", host, units or {}, host_grids or {})
        self.floes = _Side("floes", floes, units or {}, floes_grids or {})
        self._regrids = dict(regrids or {})
        starts = self.host.start_time() - self.floes.start_time()
        self.offset = starts if offset is None else float(offset)
        self.to_floes = self._connect(self.host, self.floes, to_floes or {})
        self.to_host = self._connect(self.floes, self.host, to_host or {})
        if not self.to_floes and not self.to_host:
            raise InputError(
                "couple: no output of one model has the name of an input of the other; say what belongs"
                f" together in to_floes and to_host: floes want {', '.join(self.floes.inputs)}; host"
                f" wants {', '.join(self.host.inputs) or 'nothing'}"
            )
        self._refuse_idle(units or {}, regrids or {})
        filled = {connection.target for connection in self.to_floes + self.to_host}
        self.unmatched = tuple(
            f"{side.name}: {name}"
            for side in (self.host, self.floes)
            for name in side.inputs
            if name not in filled
        )
        self._turnover = 0.0
        self.ledger: list[Exchange] = []

    def _refuse_idle(
        self, units: Mapping[str, str], regrids: Mapping[tuple[int, int], Regrid]
    ) -> None:
        """What was given for a name or grid that is nowhere was given for another."""
        names = {name for side in (self.host, self.floes) for name in (*side.inputs, *side.outputs)}
        for name in units:
            if name not in names:
                raise InputError(
                    f"couple: units of {name!r}: no such variable; {choose(name, names)}"
                )
        self.host.refuse_idle_grids()
        self.floes.refuse_idle_grids()
        pairs = {c.grids for c in self.to_floes + self.to_host}
        for pair in regrids:
            if pair not in pairs:
                raise InputError(
                    f"couple: regrids of {pair!r}: nothing goes between these grids; (host, floes) are"
                    f" {', '.join(map(str, sorted(pairs)))}"
                )

    def _connect(
        self, giver: _Side, taker: _Side, explicit: Mapping[str, str | Link | None]
    ) -> list[_Connection]:
        for name in explicit:
            if name not in taker.inputs:
                raise InputError(
                    f"couple: {name!r} is not an input of the {taker.name};"
                    f" {choose(name, taker.inputs)}"
                )
        connections = []
        for name in taker.inputs:
            likely = (_running(name), name) if giver is self.floes else (name,)
            by_name = next((output for output in likely if output in giver.outputs), None)
            wanted = explicit.get(name, by_name)
            if wanted is None:
                continue
            link = Link(wanted) if isinstance(wanted, str) else wanted
            if not isinstance(link, Link):
                raise InputError(f"couple: {name}: {link!r}: must be a name, a Link or None")
            for output in filter(None, (link.source, link.weight)):
                if output not in giver.outputs:
                    raise InputError(
                        f"couple: {output!r} is not an output of the {giver.name};"
                        f" {choose(output, giver.outputs)}"
                    )
            connections.append(self._connection(giver, taker, name, link))
        return connections

    def _connection(self, giver: _Side, taker: _Side, target: str, link: Link) -> _Connection:
        running = "time_integral_of" in link.source and "time_integral_of" not in target
        if running and giver is self.host:
            raise InputError(
                f"couple: {link.source} → {target}: only running integrals of the floes are differenced; give an"
                " output of the host that is a value at the time"
            )
        if np.dtype(taker.model.get_var_type(target)).kind != "f":
            raise InputError(
                f"couple: {target} of the {taker.name} is of type {taker.model.get_var_type(target)}, which"
                f" would cut {link.source}; must be of a floating type"
            )
        convert = _converter(
            giver.units(link.source), taker.units(target), running, link.source, target
        )
        weight = link.weight or OVER_ICE.get(link.source)
        per_area = weight is None and any(word in link.source for word in PER_AREA)
        kind = link.kind or ("integral" if per_area else "mean")
        if kind not in ("integral", "mean"):
            raise InputError(f"couple: kind = {kind!r} of {target}: allowed: integral, mean")
        if weight is not None and (kind == "integral" or weight not in giver.outputs):
            raise InputError(
                f"couple: {target}: weight {weight!r} must be an output of the {giver.name}, and is for"
                " means only"
            )
        mean_names = ("_of_count", "_of_radius", "__count")
        if giver is self.floes and link.kind is None and link.source.endswith(mean_names):
            raise InputError(
                f"couple: {link.source} → {target}: a number or mean over floes; say how it is to be"
                " averaged with Link(source, kind, weight)"
            )
        grids = giver.grid_number(link.source), taker.grid_number(target)
        giver.know_grid(link.source)
        taker.know_grid(target)
        pair = grids if giver is self.host else grids[::-1]
        sides = (link.source, target) if giver is self.host else (target, link.source)
        return _Connection(
            giver, taker, link.source, target, kind, weight, running, convert,
            _pascals(taker.units(target), target), pair, self._regrid(pair, sides),
        )  # fmt: skip

    def _regrid(self, pair: tuple[int, int], names: tuple[str, str]) -> Regrid | None:
        """Weights between a grid of the host and one of the floes; None where they are the same cells."""
        if pair not in self._regrids:
            source, target = self.host.know_grid(names[0]), self.floes.know_grid(names[1])
            all_wet = source.wet.all() and target.wet.all()
            if all_wet and checksum(source) == checksum(target):
                return None
            self._regrids[pair] = Regrid(source, target)
        regrid = self._regrids[pair]
        for side, grid, name in (
            (self.host, regrid.source, names[0]), (self.floes, regrid.target, names[1])
        ):  # fmt: skip
            if grid.size != side.size(name):
                raise InputError(
                    f"couple: weights for {grid.size} cells, but {name} of the {side.name} has"
                    f" {side.size(name)}"
                )
        return regrid

    # ---- running -----------------------------------------------------------------------------------

    def run(self, until: float, show: Callable[[str], object] | None = None) -> list[Exchange]:
        """Exchange until a time of the floes' clock [s]; returns the ledger so far.  Raises as `couple` does."""
        known = len(self.ledger)
        with _in_one_line("couple: before the first exchange"):
            count, start = self._prepare(until)
        if show is not None:
            show(repr(self))
            show(HEADER)
            for line in self.ledger[known:]:
                show(str(line))
        for k in range(1, count + 1):
            line = self.exchange(start + k * self.every if k < count else float(until))
            if show is not None:
                show(str(line))
        return self.ledger

    def _prepare(self, until: float) -> tuple[int, float]:
        """How many exchanges there are to come, and from when [s]; host and floes then stand together."""
        if not is_number(until):
            raise InputError(f"couple: until = {until!r} s: must be a finite number")
        start = self.floes.time()
        count = round((until - start) / self.every)
        if count < 0 or not _same_time(start + count * self.every, until, self.every):
            raise InputError(
                f"couple: until = {until:g} s is not a whole number of exchanges of {self.every:g} s"
                f" from now, {start:g} s"
            )
        for side, end in ((self.floes, until), (self.host, until + self.offset)):
            if end > side.end_time() and not _same_time(end, side.end_time(), self.every):
                raise InputError(
                    f"couple: until = {until:g} s is after the end of the {side.name},"
                    f" {side.end_time():g} s"
                )
        self._catch_up()
        return count, start

    def exchange(self, until: float) -> Exchange:
        """One exchange, to a time of the floes' clock [s]; CouplingError, in one line, if anything fails in it."""
        begin = ""
        try:
            now = self.floes.time()
            begin = f"{now:g} "
            line = self._exchange(now, until)
        except Exception as error:
            raise CouplingError(
                f"exchange {len(self.ledger) + 1}, {begin}… {until:g} s: {_first_line(error)}"
                f"; {self._save()}"
            ) from error
        self.ledger.append(line)
        return line

    def _exchange(self, now: float, until: float) -> Exchange:
        host_now = self.host.time()
        if not _same_time(host_now, now + self.offset, self.every):
            raise InputError(
                f"the host is at {host_now:.12g} s, where it should be at {now + self.offset:.12g} s"
            )
        before = self._accounts()
        self._give_states()
        self.floes.update_until(until, self.every)
        stress = self._give_back(until - now, lambda c: c.scaled(c.since(), until - now))
        self.host.update_until(until + self.offset, self.every)
        after = self._accounts()
        change = {name: after[name] - before[name] for name in after}
        return self._line(until, until - now, stress, change)

    def _line(
        self, time: float, duration: float, stress: _Impulse, change: dict[str, np.ndarray]
    ) -> Exchange:
        floes, other = change.get("floes"), change.get("other")
        budget = None
        if floes is not None and other is not None and stress.axes == {0, 1}:
            budget = floes + stress.given + change.get("no water", np.zeros(2)) - other
        return Exchange(
            number=len(self.ledger) + 1,
            time=time,
            duration=duration,
            from_host=-stress.given,
            to_host=stress.taken,
            undelivered=stress.missed,
            exchange_residual=stress.taken + stress.missed - stress.given,
            floes=floes,
            other=other,
            budget_residual=budget,
            host=change.get("host"),
            turnover=self._turnover,
        )

    def _save(self) -> str:
        """Save the floes' state after a failure; what came of it, in words."""
        try:
            place = f"floes at {self.floes.time():g} s"
        except Exception:  # noqa: BLE001  the floes are gone; the first error is the one to tell
            return "floes do not answer"
        save = getattr(self.floes.model, "save_state", None)
        if save is None or self.rescue is None:
            return place
        try:
            save(str(self.rescue))
        except Exception as error:  # noqa: BLE001
            return f"{place}; their state could not be saved ({error})"
        return f"{place}, their state saved in {self.rescue}"

    def _catch_up(self) -> None:
        """After a fault the floes may stand one exchange ahead: give the host what it has missed, and book it.

        What the floes have become in it nobody knows any more; the line leaves that out.
        """
        now, host_now = self.floes.time(), self.host.time()
        if _same_time(host_now, now + self.offset, self.every):
            return
        single = [c for c in self.to_host if c.running]
        mean = [_instant(c.source) for c in single]
        ahead = _same_time(host_now + self.every, now + self.offset, self.every)
        if not ahead or not all(name in self.floes.outputs for name in mean):
            raise InputError(
                f"couple: the host is at {host_now:.12g} s, the floes at {now:.12g} s, which should be"
                f" {now + self.offset:.12g} s of the host; say otherwise with offset"
            )
        before = self._accounts()
        stress = self._give_back(
            self.every, lambda c: c.scaled(c.instant(), self.every, was_mean=True)
        )
        self.host.update_until(now + self.offset, self.every)
        after = self._accounts()
        change = {name: after[name] - before[name] for name in after if name == "host"}
        self.ledger.append(self._line(now, self.every, stress, change))

    def _give_states(self) -> None:
        for side in (self.host, self.floes):
            side.refuse_changed_grids()
        for connection in self.to_floes:
            values = connection.giver.get(connection.source)
            connection.put(connection.carry(connection.scaled(values, self.every)))
        for connection in self.to_host:
            connection.remember()

    def _give_back(self, duration: float, means: Callable[[_Connection], np.ndarray]) -> _Impulse:
        """Give the host the means over an exchange.  The floes lost it once, however many inputs take it."""
        total = _Impulse(np.zeros(2), np.zeros(2), np.zeros(2), set())
        unseen: set[int] = set()
        for connection in self.to_host:
            values = means(connection)
            carried = connection.put(connection.carry(values))
            axis = _axis(connection.source)
            of_water = connection.kind == "integral" and connection.source.startswith(ON_WATER)
            if of_water and axis is not None and axis not in total.axes:
                given, taken, missed, turned = connection.force(values, carried)
                total.given[axis] += given * duration
                total.taken[axis] += taken * duration
                total.missed[axis] += missed * duration
                total.axes.add(axis)
                self._turnover += turned * duration
            elif axis is not None and not of_water and BOTTOM in connection.source:
                unseen.add(axis)
        for axis in unseen - total.axes:
            total.given[axis] = total.taken[axis] = total.missed[axis] = np.nan
        return total

    def _accounts(self) -> dict[str, np.ndarray]:
        """Running totals that the models offer [N s]."""
        totals = {}
        for side in (self.host, self.floes):
            ends = [name for name in side.outputs if name.endswith(MOMENTUM.format(a="x"))]
            if len(ends) == 1:
                totals[side.name] = side.pair(ends[0][: -len(MOMENTUM.format(a="x"))] + MOMENTUM)
        found = [name for name in OTHERS if name.format(a="x") in self.floes.outputs]
        if found:
            totals["other"] = sum(self.floes.pair(name) for name in found)
        if NO_WATER.format(a="x") in self.floes.outputs:
            totals["no water"] = self.floes.pair(NO_WATER)
        return totals

    def __repr__(self) -> str:
        lines = [f"{self.host.title()} ⇄ {self.floes.title()}, every {self.every:g} s"]
        for connection in self.to_floes + self.to_host:
            lines.append(f"├─ {connection!r}")
        lines += [f"├─ {regrid!r}" for regrid in self._regrids.values()]
        lines.append(f"└─ nobody fills: {', '.join(self.unmatched) or 'nothing'}")
        return "\n".join(lines)


@contextmanager
def _in_one_line(where: str) -> Iterator[None]:
    """A model that fails in here, or whose process is gone, is told of in one line."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        raise CouplingError(f"{where}: {_first_line(error)}") from error


def _same_time(one: float, other: float, every: float) -> bool:
    """Whether two times [s] are one, but for round-off: a clock that counts from long ago has coarse seconds."""
    return abs(one - other) <= SAME_TIME * every + 8 * np.spacing(max(abs(one), abs(other)))


def _check_kind(name: str, given: Mapping[Any, Any] | None, kind: type) -> None:
    for key, value in (given or {}).items():
        if not isinstance(value, kind):
            raise InputError(f"couple: {name}[{key!r}] = {value!r}: must be a {kind.__name__}")


def _first_line(error: Exception) -> str:
    details = getattr(error, "details", None)  # where gRPC has its text
    text = str(details() if callable(details) else error) or type(error).__name__
    return text.splitlines()[0]


class _Impulse(NamedTuple):
    """Of ice on water in one exchange: on the floes' grid, on the host's, lost between them [N s]."""

    given: np.ndarray
    taken: np.ndarray
    missed: np.ndarray
    axes: set[int]


class _Side:
    """One of the two models, asked through BMI only; what it says is checked."""

    def __init__(
        self, name: str, model: Bmi, units: Mapping[str, str], grids: Mapping[int, Grid]
    ) -> None:
        self.name, self.model = name, model
        self._units, self._given = units, grids
        self._grids: dict[tuple[int, str], tuple[Grid, str, str]] = {}
        with _in_one_line(f"couple: the {name}"):
            self.inputs = tuple(model.get_input_var_names())
            self.outputs = tuple(model.get_output_var_names())
            self._second = _seconds(model.get_time_units(), name)

    def title(self) -> str:
        return f"{self.name} {self.model.get_component_name()!r}"

    def time(self) -> float:
        # float: a clock in single precision would have all that is reckoned with it in single precision
        return float(self.model.get_current_time()) * self._second

    def start_time(self) -> float:
        return float(self.model.get_start_time()) * self._second

    def end_time(self) -> float:
        return float(self.model.get_end_time()) * self._second

    def update_until(self, time: float, every: float) -> None:
        """To a time [s]; a model without update_until is stepped.  It must land there."""
        try:
            self.model.update_until(time / self._second)
        except NotImplementedError:
            while self.time() < time and not _same_time(self.time(), time, every):
                before = self.time()
                self.model.update()
                if self.time() <= before:
                    break
        landed = self.time()
        if not _same_time(landed, time, every):
            went = "went back" if landed < time - every else "stands"
            raise InputError(
                f"the {self.name} {went} at {landed:.12g} s after an update to {time:.12g} s"
                f" (its own step is {self.model.get_time_step() * self._second:g} s)"
            )

    def units(self, name: str) -> str:
        return self._units.get(name) or self.model.get_var_units(name) or ""

    def grid_number(self, name: str) -> int:
        return self.model.get_var_grid(name)

    def size(self, name: str) -> int:
        return self.model.get_var_nbytes(name) // self.model.get_var_itemsize(name)

    def get(self, name: str) -> np.ndarray:
        values = np.empty(self.size(name), self.model.get_var_type(name))
        self.model.get_value(name, values)
        return values.astype(np.float64)

    def set(self, name: str, values: np.ndarray) -> np.ndarray:
        given = values.astype(self.model.get_var_type(name))
        self.model.set_value(name, given)
        return given.astype(np.float64)

    def pair(self, template: str) -> np.ndarray:
        return np.array([self.get(template.format(a=a))[0] for a in "xy"])

    def know_grid(self, name: str) -> Grid:
        """The cells of a variable; made once, and watched from then on."""
        number, location = self.grid_number(name), self.model.get_var_location(name)
        key = number, location
        if key not in self._grids:
            told = _told(self.model, number, location)
            grid = self._given.get(number)
            if grid is None:
                grid = _grid_of(told, number, location, f"{name} of the {self.name}")
            if grid.size != self.size(name):
                raise InputError(
                    f"couple: {name} of the {self.name} has {self.size(name)} values, its grid"
                    f" {number} {grid.size} cells"
                )
            self._grids[key] = grid, _digest(told), name
        return self._grids[key][0]

    def refuse_idle_grids(self) -> None:
        """A grid that was given for a number that no variable has."""
        if not self._given:
            return
        numbers = sorted({self.grid_number(name) for name in (*self.inputs, *self.outputs)})
        for number in self._given:
            if number not in numbers:
                raise InputError(
                    f"couple: {self.name}_grids: no variable of the {self.name} is on grid {number!r}; its grids"
                    f" are {', '.join(map(str, numbers))}"
                )

    def refuse_changed_grids(self) -> None:
        for (number, location), (_, known, name) in self._grids.items():
            if _digest(_told(self.model, number, location)) != known:
                raise InputError(
                    f"grid {number} of the {self.name} ({name}) is not what it was at the start: weights"
                    " are made for fixed grids; start a new coupling"
                )


class _Connection:
    """One variable on its way from one model to the other."""

    def __init__(
        self,
        giver: _Side,
        taker: _Side,
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
            self._before = self.giver.get(self.source)

    def instant(self) -> np.ndarray:
        """The value now; of a running integral the mean over the giver's last update."""
        return self.giver.get(_instant(self.source) if self.running else self.source)

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
        wet = self._giver_grid_wet(values.size)
        bad = np.flatnonzero(~np.isfinite(values) & wet)
        if bad.size:
            raise InputError(
                f"{self.source} of the {self.giver.name} is {values[bad[0]]} in cell {bad[0]}"
                f" ({bad.size} such cells) at {self.giver.time():g} s"
            )
        return values

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


# ---- names and units --------------------------------------------------------------------------


def _running(name: str) -> str:
    """The name of the running time integral of a variable."""
    return name.replace("__", "__time_integral_of_", 1)


def _instant(name: str) -> str:
    return name.replace("__time_integral_of_", "__", 1)


def _axis(name: str) -> int | None:
    """0 for an x component, 1 for a y component."""
    found = re.search(r"_([xy])_(?:z_)?component", name)
    return None if found is None else "xy".index(found[1])


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


def _converter(
    given: str, wanted: str, running: bool, source: str, target: str
) -> Callable[[np.ndarray], np.ndarray]:
    """From the giver's units (per second, for a running integral) to the taker's."""
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


def _pascals(units: str, of: str) -> float:
    """Pascals in a unit of stress, 0 for other quantities."""
    unit = _unit(units, of)
    return float(unit.convert(1.0, "Pa")) if unit.is_convertible("Pa") else 0.0


def _seconds(units: str | None, side: str) -> float:
    """Seconds in a model's unit of time; a reference date is left aside."""
    text = (units or "").split(" since ")[0]
    unit = _unit(text, f"the {side}'s time")
    if not unit.is_time():
        raise InputError(f"couple: time of the {side} is in {units!r}, which is no unit of time")
    return float(unit.convert(1.0, "s"))


# ---- what BMI says about a grid ---------------------------------------------------------------


def bmi_grid(model: Bmi, name: str) -> Grid:
    """The cells [m] on which a BMI variable lives, as far as BMI tells them (add a mask with `with_wet`).

    Raises
    ------
    InputError
        where they do not follow from what BMI tells.
    """
    number, location = model.get_var_grid(name), model.get_var_location(name)
    return _grid_of(_told(model, number, location), number, location, name)


def _told(model: Bmi, number: int, location: str) -> dict[str, Any]:
    """Everything that BMI says about a grid and that cells are made of."""
    kind = model.get_grid_type(number)
    told: dict[str, Any] = {"type": kind, "size": model.get_grid_size(number)}
    if kind in ("uniform_rectilinear", "rectilinear", "structured_quadrilateral"):
        rank = model.get_grid_rank(number)
        told["shape"] = model.get_grid_shape(number, np.empty(rank, np.int32)).copy()
    if kind == "uniform_rectilinear":
        told["spacing"] = model.get_grid_spacing(number, np.empty(rank)).copy()
        told["origin"] = model.get_grid_origin(number, np.empty(rank)).copy()
    elif kind == "rectilinear":
        ny, nx = told["shape"][-2:]
        told["x"] = model.get_grid_x(number, np.empty(nx)).copy()
        told["y"] = model.get_grid_y(number, np.empty(ny)).copy()
    elif kind == "structured_quadrilateral":
        nodes = int(np.prod(told["shape"]))
        told["x"] = model.get_grid_x(number, np.empty(nodes)).copy()
        told["y"] = model.get_grid_y(number, np.empty(nodes)).copy()
    elif kind == "unstructured" and location == "face":
        nodes = model.get_grid_node_count(number)
        faces = model.get_grid_face_count(number)
        told["x"] = model.get_grid_x(number, np.empty(nodes)).copy()
        told["y"] = model.get_grid_y(number, np.empty(nodes)).copy()
        per_face = model.get_grid_nodes_per_face(number, np.empty(faces, np.int32)).copy()
        told["nodes_per_face"] = per_face
        told["face_nodes"] = model.get_grid_face_nodes(
            number, np.empty(int(per_face.sum()), np.int32)
        ).copy()
    return told


def _digest(told: Mapping[str, Any]) -> str:
    digest = hashlib.sha256()
    for name, value in told.items():
        digest.update(name.encode())
        digest.update(value.tobytes() if isinstance(value, np.ndarray) else str(value).encode())
    return digest.hexdigest()


def _grid_of(told: Mapping[str, Any], number: int, location: str, of: str) -> Grid:
    """Cells out of what BMI says; refuses to invent what it does not."""
    kind = told["type"]
    unclear = (
        f"couple: grid {number} of {of} ({kind}, location {location}): BMI does not tell its cells;"
        " give a Grid in host_grids or floes_grids"
    )
    if kind == "unstructured" and location == "face":
        ends = np.cumsum(told["nodes_per_face"])
        faces = np.split(told["face_nodes"], ends[:-1])
        return Grid.unstructured(told["x"], told["y"], faces)
    if len(told.get("shape", ())) != 2 or location not in ("node", "face"):
        raise InputError(unclear)
    ny, nx = (int(n) for n in told["shape"])
    if kind == "uniform_rectilinear":
        (dy, dx), (y0, x0) = told["spacing"], told["origin"]
        if location == "face":  # the nodes are corners
            ny, nx = ny - 1, nx - 1
        else:
            x0, y0 = x0 - 0.5 * dx, y0 - 0.5 * dy
        x, y = (x0, x0 + nx * dx), (y0, y0 + ny * dy)
        if dx > 0 and dy > 0:
            return Grid.uniform(x, y, shape=(ny, nx))
        return _between(np.linspace(*x, nx + 1), np.linspace(*y, ny + 1))
    if location == "face":
        if kind == "rectilinear":
            return _between(told["x"], told["y"])
        return Grid.curvilinear(told["x"].reshape(ny, nx), told["y"].reshape(ny, nx))
    if kind == "rectilinear":
        edges = [_even_edges(told[axis]) for axis in ("x", "y")]
        if edges[0] is not None and edges[1] is not None:
            return _between(*edges)
    raise InputError(unclear)


def _between(x: np.ndarray, y: np.ndarray) -> Grid:
    """Cells between edges that may fall, as those of rows from north to south do: cells keep the host's order."""
    if x[0] < x[-1] and y[0] < y[-1]:
        return Grid.rectilinear(x, y)
    return Grid.curvilinear(*np.meshgrid(x, y))


def _even_edges(centres: np.ndarray) -> np.ndarray | None:
    """Edges around evenly spaced centres; None if uneven: then more than one set of edges would fit."""
    if centres.size < 2:
        return None
    step = np.diff(centres)
    if np.ptp(step) > 1e-9 * abs(step[0]):
        return None
    return np.concatenate([centres - 0.5 * step[0], centres[-1:] + 0.5 * step[0]])
