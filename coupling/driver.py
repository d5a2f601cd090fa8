"""Two-way coupling of two BMI models, a host and the ice, with a momentum ledger.

    couple(host, floes, every=600.0, until=86400.0, show=print)

One exchange over [t, t + every]:

    get    the host's fields at t                  (velocity of the water, wind, tilt …)
    regrid to the floes' grid, and set them
    update the floes to t + every
    get    the impulse from the ice over the interval, J(t + every) − J(t)
    regrid to the host's grid, and set it
    update the host to t + every
    book   one line of the ledger

The ice goes first, so that the stress on the host is exactly opposite to that on the ice.  The running
impulse is differenced because that is always right: a mean over "the last step" is the mean over the exchange
only for a component that takes one step per exchange.

Only BMI calls are made, so either model may be in another process (grpc4bmi).  Nothing is guessed:

- *Names.*  An explicit `to_floes` or `to_host` comes first; then equal CSDMS names; inputs without a match are listed.
- *Units.*  UDUNITS (through cf_units) compares them; convertible units are converted, others refused.
  `host_units` and `floes_units` give those of a model that reports none or wrong ones.
- *Kind.*  Variables per cell area (stress, flux, area fraction, mass) are regridded with their integral conserved, the
  number of floes with its sum; velocities, tilt and the like with their mean.  Means over the ice (thickness, velocity)
  and over floes (radius, contacts) are weighted so that the volume and momentum of the ice, and sums over floes, are
  conserved.  A floes' cell that lies partly over the host's land gives all of its ice to the wet part, as it does with
  its stress: an area fraction may exceed 1 there.  Equal coasts avoid this; for a host that accepts no more than 1, use
  `Link(fraction, "mean")`: it gets the mean over the part of its cells that the floes' cells cover.
- *Cells.*  BMI gives the positions of nodes.  Nodes of a uniform rectilinear grid are taken as cell centres (faces,
  where the location says so); where cells do not follow from BMI, a `Grid` must be given.
  Coordinates are metres in one plane for both models; masks come with a given `Grid`, BMI has none.
- *Time.*  Units of both clocks are compared; a model that does not reach the exchange time exactly ends the run.
- *After a fault.*  If the floes are one exchange ahead, the host first gets what it missed: the same `Coupling`
  knows the impulse, a new one uses the floes' mean over their last update.  An exchange that the host has completed
  gets its line even if something fails right after it.

The ledger has a line for each exchange, of momentum [N s] along x and y (`coupling.ledger`).  `floes` and `other` are
read from scalar outputs of the floes, `host` from those of the host.
A host may take the stress along an axis by several inputs (one moves the water, one stirs it): the lines count the first
of them in the order of its inputs.
A host that takes the stress per ice area, or as a mean, computes the force itself, unknown here: along such
an axis the first four are nan, and so is the line's residual.  Where it takes no stress, only "to host" is known: 0.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NamedTuple, final

import numpy as np
from bmipy import Bmi

from coupling.cells import bmi_grid as bmi_grid
from coupling.connection import Connection, Link, axis_of, instant_name, running_name
from coupling.ledger import HEADER, Exchange
from coupling.regrid import Regrid, checksum
from coupling.side import CouplingError, Side, first_line, in_one_line, same_time
from floebmi.errors import InputError, choose, in_line, is_word
from floebmi.files import path_of
from floebmi.grid import Grid
from floebmi.quantities import check_table, is_number

ON_WATER = "sea_ice_bottom_water_flowing__"  # stresses with this beginning are in the ledger
BOTTOM = "_bottom_water_flowing__"  # stresses on the water, per cell area and per ice area
MOMENTUM = "__domain_integral_of_{a}_component_of_momentum"  # ends of names of scalar outputs
OTHERS = (
    "sea_ice_top_air_flowing__domain_time_integral_of_{a}_z_component_of_stress",
    "sea_ice_flowing__domain_time_integral_of_{a}_component_of_other_force",
)
ELSEWHERE = 1e-3  # of a cell's side: centres further apart are those of different cells
NO_WATER = (
    "sea_ice_bottom_water_flowing__domain_time_integral_of_{a}_component_of_undelivered_stress"
)


def couple(
    host: Bmi,
    floes: Bmi,
    *,
    every: float,
    until: float,
    to_floes: Mapping[str, str | Link | None] | None = None,
    to_host: Mapping[str, str | Link | None] | None = None,
    host_units: Mapping[str, str] | None = None,
    floes_units: Mapping[str, str] | None = None,
    host_grids: Mapping[int, Grid] | None = None,
    floes_grids: Mapping[int, Grid] | None = None,
    regrids: Mapping[tuple[int, int], Regrid] | None = None,
    offset: float | None = None,
    rescue: str | Path | None = None,
    show: Callable[[str], object] | None = None,
) -> list[Exchange]:
    """Couple two initialized BMI models until a time; returns the ledger, one `Exchange` per exchange.

    Parameters
    ----------
    host, floes : initialized models
    every : exchange interval [s]
    until : end, on the floes' clock [s]; a whole number of exchanges from now
    to_floes : input of the floes → output of the host; None leaves the input alone
    to_host : input of the host → output of the floes; None leaves the input alone
    host_units, floes_units : units of that model's variables, where it reports none or wrong ones
    host_grids, floes_grids : BMI grid number → `Grid`, where BMI does not give cells or mask
    regrids : (host grid number, floes grid number) → weights made earlier, from host to floes; their target must be
        the floes' cells as BMI (`bmi_grid`) or `floes_grids` give them
    offset : time of the host minus time of the floes [s]; None: their start times are the same moment
    rescue : file for the floes' state if something fails, where the floes have `save_state`
    show : function called with a description of the coupling, then with each line of the ledger (`print`)

    Raises
    ------
    InputError
        before the run: unknown names, units that do not fit, cells not given by BMI, clocks that differ.
    CouplingError
        values that are not finite, a grid that changed, a clock that went back, a model that failed or
        did not answer from the start.  The line gives the time and, during the run, where the floes' state is.
    """
    coupling = Coupling(
        host, floes, every, to_floes, to_host, host_units, floes_units, host_grids, floes_grids, regrids,
        offset, rescue,
    )  # fmt: skip
    return coupling.run(until, show)


@final
class Coupling:
    """A host and a floe model with their connections; parameters as for `couple`.

    Attributes
    ----------
    to_floes, to_host : the connections
    unmatched : inputs of either model that are not filled
    ledger : one `Exchange` per exchange so far

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
        host_units: Mapping[str, str] | None = None,
        floes_units: Mapping[str, str] | None = None,
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
        for name, table, kind in (
            ("to_floes", to_floes, None), ("to_host", to_host, None), ("host_units", host_units, None),
            ("floes_units", floes_units, None), ("host_grids", host_grids, Grid),
            ("floes_grids", floes_grids, Grid), ("regrids", regrids, Regrid),
        ):  # fmt: skip
            check_table(f"couple: {name}", table)
            for key, value in (table or {}).items():
                if kind is not None and not isinstance(value, kind):
                    raise InputError(
                        f"couple: {name}[{key!r}] = {value!r}: must be a {kind.__name__}"
                    )
        if rescue is not None:
            path_of("couple: rescue", rescue)
        self.every, self.rescue = float(every), rescue
        self.host = Side("host", host, host_units or {}, host_grids or {})
        self.floes = Side("floes", floes, floes_units or {}, floes_grids or {})
        self._regrids = dict(regrids or {})
        with in_one_line("couple: as the models were asked for their variables and grids"):
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
        self._refuse_idle(regrids or {})
        filled = {connection.target for connection in self.to_floes + self.to_host}
        self.unmatched = tuple(
            f"{side.name}: {name}"
            for side in (self.host, self.floes)
            for name in side.inputs
            if name not in filled
        )
        self._turnover = 0.0
        self._begun: float | None = None  # time of the floes at the last `remember` [s]
        self._unbooked: _Unbooked | None = None  # last exchange given to the host, until booked
        self.ledger: list[Exchange] = []

    def _refuse_idle(self, regrids: Mapping[tuple[int, int], Regrid]) -> None:
        """InputError for units, grids or weights of a variable or grid that does not exist, which must be a mistake."""
        for side in (self.host, self.floes):
            side.refuse_idle_units()
            side.refuse_idle_grids()
        pairs = {c.grids for c in self.to_floes + self.to_host}
        for pair in regrids:
            if pair not in pairs:
                raise InputError(
                    f"couple: regrids of {pair!r}: nothing goes between these grids; (host, floes) are"
                    f" {', '.join(map(str, sorted(pairs)))}"
                )

    def _connect(
        self, giver: Side, taker: Side, explicit: Mapping[str, str | Link | None]
    ) -> list[Connection]:
        """Connect the inputs of the taker: as given, else to the giver's output of the same name."""
        for name in explicit:
            if not is_word(name, taker.inputs):
                raise InputError(
                    f"couple: {name!r} is not an input of the {taker.name};"
                    f" {choose(name, taker.inputs)}"
                )
        connections = []
        for name in taker.inputs:
            likely = (running_name(name), name) if giver is self.floes else (name,)
            by_name = next((output for output in likely if output in giver.outputs), None)
            wanted = explicit.get(name, by_name)
            if wanted is None:
                continue
            link = Link(wanted) if isinstance(wanted, str) else wanted
            if not isinstance(link, Link):
                raise InputError(f"couple: {name}: {link!r}: must be a name, a Link or None")
            connections.append(Connection(giver, taker, name, link, self._regrid))
        return connections

    def _regrid(self, pair: tuple[int, int], names: tuple[str, str]) -> Regrid | None:
        """Weights between a grid of the host and one of the floes; None if they have the same cells."""
        if pair not in self._regrids:
            source, target = self.host.know_grid(names[0]), self.floes.know_grid(names[1])
            all_wet = source.wet.all() and target.wet.all()
            if all_wet and checksum(source) == checksum(target):
                return None
            self._regrids[pair] = Regrid(source, target)
        self._refuse_other_weights(self._regrids[pair], names)
        return self._regrids[pair]

    def _refuse_other_weights(self, regrid: Regrid, names: tuple[str, str]) -> None:
        """InputError for weights made earlier for other cells than those of the two variables."""
        for side, grid, name in (
            (self.host, regrid.source, names[0]), (self.floes, regrid.target, names[1])
        ):  # fmt: skip
            if grid.size != side.size(name):
                raise InputError(
                    f"couple: weights for {grid.size} cells, but {name} of the {side.name} has"
                    f" {side.size(name)}"
                )
            shapes = side.know_grid(name).shape, grid.shape
            if shapes[0] != shapes[1] and len(shapes[0]) == len(shapes[1]):
                raise InputError(
                    f"couple: weights for cells of shape {shapes[1]}, but those of {name} of the {side.name} have"
                    f" {shapes[0]}"
                )
        # The host's own cells may be in degrees, and those of the weights projected; the floes' are in metres.
        known = self.floes.know_grid(names[1])
        away = np.hypot(regrid.target.x - known.x, regrid.target.y - known.y)
        if (away > ELSEWHERE * np.sqrt(known.area)).any():
            k = int(np.argmax(away))
            raise InputError(
                f"couple: weights for other cells than those of {names[1]} of the floes: cell {k} is at"
                f" ({known.x[k]:g}, {known.y[k]:g}) m, that of the weights at ({regrid.target.x[k]:g},"
                f" {regrid.target.y[k]:g}) m; make them with bmi_grid"
            )

    # ---- running -----------------------------------------------------------------------------------

    def run(self, until: float, show: Callable[[str], object] | None = None) -> list[Exchange]:
        """Run exchanges until a time of the floes' clock [s]; returns the ledger so far.  Raises as `couple` does."""
        if not (show is None or callable(show)):
            raise InputError(f"couple: show = {in_line(show)}: must be a function, such as print")
        show = show or (lambda line: None)
        before = "couple: before the first exchange"
        with in_one_line(before):
            count, start = self._count(until)
            heading = repr(self), HEADER
        for line in heading:
            show(line)
        with self._shown(show), in_one_line(before):
            self._catch_up()
        for k in range(1, count + 1):
            with self._shown(show):
                self.exchange(start + k * self.every if k < count else float(until))
        return self.ledger

    @contextmanager
    def _shown(self, show: Callable[[str], object]) -> Iterator[None]:
        """Show the lines added to the ledger in the body, even if something fails after an exchange."""
        known = len(self.ledger)
        try:
            yield
        finally:
            for line in self.ledger[known:]:
                show(str(line))

    def _count(self, until: float) -> tuple[int, float]:
        """Number of exchanges until a time, and the time now [s]; InputError for a time that cannot be reached."""
        _check_time(until)
        start = self.floes.time()
        count = round((until - start) / self.every)
        if count < 0 or not same_time(start + count * self.every, until, self.every):
            raise InputError(
                f"couple: until = {until:g} s is not a whole number of exchanges of {self.every:g} s"
                f" from now, {start:g} s"
            )
        for side, end in ((self.floes, until), (self.host, until + self.offset)):
            if end > side.end_time() and not same_time(end, side.end_time(), self.every):
                raise InputError(
                    f"couple: until = {until:g} s is after the end of the {side.name},"
                    f" {side.end_time():g} s"
                )
        return count, start

    def exchange(self, until: float) -> Exchange:
        """Make one exchange, to a time of the floes' clock [s]; CouplingError, in one line, if anything fails."""
        _check_time(until)
        begin, number = "", len(self.ledger) + 1
        try:
            now = self.floes.time()
            begin = f"{now:g} "
            self._exchange(now, until)
        except Exception as error:
            raise CouplingError(
                f"exchange {number}, {begin}… {until:g} s: {first_line(error)}; {self._save()}"
            ) from error
        return self.ledger[-1]

    def _exchange(self, now: float, until: float) -> None:
        self._book()
        host_now = self.host.time()
        if not same_time(host_now, now + self.offset, self.every):
            raise InputError(
                f"the host is at {host_now:.12g} s, where it should be at {now + self.offset:.12g} s"
            )
        before = self._accounts()
        self._give_states()
        self.floes.update_until(until, self.every)
        stress = self._give_back(until - now)
        self._step_host(_Unbooked(until, until - now, stress, before))

    def _step_host(self, exchange: _Unbooked) -> None:
        """Advance the host with the stress that it was given, and book it, even if the host fails right after its step."""
        self._unbooked = exchange
        try:
            self.host.update_until(exchange.time + self.offset, self.every)
        except Exception:
            with suppress(Exception):  # report the first error
                self._book()
            raise
        self._book()

    def _book(self) -> None:
        """Add the line of the last exchange to the ledger, once the host's clock shows that it was completed.

        Values that a failing model cannot give are left open.
        """
        exchange = self._unbooked
        if exchange is None:
            return
        time, duration, stress, before = exchange
        if not same_time(self.host.time(), time + self.offset, self.every):
            return
        change: dict[str, np.ndarray] = {}
        try:
            after = self._accounts()
            change = {name: after[name] - before[name] for name in before.keys() & after.keys()}
        finally:
            self._turnover += stress.turned  # an exchange repeated after a failure counts once
            self._unbooked = None
            line = Exchange.balanced(
                len(self.ledger) + 1, time, duration,
                given=stress.given, taken=stress.taken, missed=stress.missed, turnover=self._turnover,
                floes=change.get("floes"), other=change.get("other"), no_water=change.get("no water"),
                host=change.get("host"), seen=stress.axes == {0, 1},
            )  # fmt: skip
            self.ledger.append(line)

    def _save(self) -> str:
        """Save the floes' state after a failure; returns the outcome in words."""
        try:
            place = f"floes at {self.floes.time():g} s"
        except Exception:  # noqa: BLE001  the floes are gone; report the first error
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
        """If the floes are one exchange ahead after a fault, give the host what it has missed, and book it.

        If this coupling began that exchange, it knows the running integrals at its start; else the floes' mean over their
        last update is used.  The change of the floes in that exchange is no longer known; the line leaves it out.
        """
        self._book()  # the clock of a host that did not answer now shows whether it completed its step
        now, host_now = self.floes.time(), self.host.time()
        if same_time(host_now, now + self.offset, self.every):
            return
        means = [instant_name(c.source) for c in self.to_host if c.running]
        ahead = same_time(host_now + self.every, now + self.offset, self.every)
        known = self._begun is not None and same_time(self._begun + self.every, now, self.every)
        if not ahead or not (known or all(name in self.floes.outputs for name in means)):
            raise InputError(
                f"couple: the host is at {host_now:.12g} s, the floes at {now:.12g} s, which should be"
                f" {now + self.offset:.12g} s of the host; say otherwise with offset"
            )
        before = {name: total for name, total in self._accounts().items() if name == "host"}
        stress = self._give_back(self.every, known)
        self._step_host(_Unbooked(now, self.every, stress, before))

    def _give_states(self) -> None:
        for side in (self.host, self.floes):
            side.refuse_changed_grids()
        for connection in self.to_floes:
            connection.put(connection.carry(connection.latest()))
        for connection in self.to_host:
            connection.remember()
        self._begun = self.floes.time()

    def _give_back(self, duration: float, known: bool = True) -> _Impulse:
        """Give the host the means over an exchange of this duration [s]; an impulse counts once, however many inputs take it.

        known : whether running integrals were remembered at the start of the exchange; else the floes' own means are used
        """
        given, taken, missed, turned = np.zeros(2), np.zeros(2), np.zeros(2), 0.0
        axes: set[int] = set()
        unseen: set[int] = set()
        for connection in self.to_host:
            values = connection.mean(duration) if known else connection.latest()
            carried = connection.put(connection.carry(values))
            axis, source = axis_of(connection.source), connection.source
            of_water = connection.kind == "integral" and source.startswith(ON_WATER)
            if of_water and axis is not None and axis not in axes:
                force = connection.force(values, carried)
                given[axis], taken[axis], missed[axis] = (duration * part for part in force[:3])
                turned += duration * force[3]
                axes.add(axis)
            elif axis is not None and not of_water and BOTTOM in source:
                unseen.add(axis)
        for axis in {0, 1} - axes:  # the impulse that the floes took from the water is unknown
            given[axis] = missed[axis] = np.nan
            if axis in unseen:
                taken[axis] = np.nan
        return _Impulse(given, taken, missed, axes, turned)

    def _accounts(self) -> dict[str, np.ndarray]:
        """Running totals that the models provide [N s]."""
        totals = {}
        of_x = MOMENTUM.format(a="x")
        for side in (self.host, self.floes):
            names = [name for name in side.outputs if name.endswith(of_x)]
            if len(names) == 1:
                totals[side.name] = side.pair(names[0].removesuffix(of_x) + MOMENTUM)
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


def _check_time(until: float) -> None:
    if not is_number(until):
        raise InputError(f"couple: until = {in_line(until)} s: must be a finite number")


class _Impulse(NamedTuple):
    """Impulse of ice on water in one exchange: on the floes' grid, on the host's, lost between them [N s]."""

    given: np.ndarray
    taken: np.ndarray
    missed: np.ndarray
    axes: set[int]  # along which these are known
    turned: float  # Σ |.| over cells and axes


class _Unbooked(NamedTuple):
    """An exchange given to the host: its end and length [s], its impulse, and the accounts before it [N s]."""

    time: float
    duration: float
    stress: _Impulse
    before: dict[str, np.ndarray]
