"""The momentum ledger of a `Model`'s exchanges with a host in the same process: lines of `coupling.ledger`.

`coupling.driver` keeps it for two BMI models.  Where the host's code calls the ice itself (Landlab, Veros,
shallowwater) the exchange looks like this:

    books.open()
    model.advance(duration)
    line = books.close(to_host=…, undelivered=…)     # as the host counts it, on its own faces and masks

The line has two residuals: the impulse from the ice's cells against that into the host's cells, and the budget of the ice.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, final

import numpy as np

from coupling.ledger import Exchange
from floebmi.errors import InputError, StabilityError
from floebmi.model import Model
from floebmi.restarts import load_restart, save_restart


@final
class Books:
    """The ledger of a model's exchanges with one host.

    Attributes
    ----------
    last : the line of the last exchange, None before the first
    """

    def __init__(self, model: Model) -> None:
        self._model = model
        self._turnover, self._number = 0.0, 0
        self.last: Exchange | None = None

    def open(self) -> None:
        """Start a line, before the ice is advanced."""
        self._before = self._totals()
        self._start = self._model.time

    def close(
        self, to_host: np.ndarray, undelivered: np.ndarray, host: np.ndarray | None = None
    ) -> Exchange:
        """Return the line of this exchange, after the ice is advanced.

        Parameters
        ----------
        to_host : (x, y) Σ A τ Δt over the host's own cells or faces [N s]
        undelivered : (x, y) part of the impulse on the ice's wet cells without a wet cell of the host [N s]
        host : (x, y) change of the host's own momentum [N s], if known
        """
        model, after = self._model, self._totals()
        momentum, other, nowhere = after - self._before
        given = np.zeros(2)
        if model.ocean is not None and model.time > self._start:  # else `last` is of another step
            given[:] = model.ocean.last_x.sum(), model.ocean.last_y.sum()
            self._turnover += float(np.abs([model.ocean.last_x, model.ocean.last_y]).sum())
        self._number += 1
        self.last = Exchange.balanced(
            self._number, model.time, model.time - self._start,
            given=given, taken=to_host, missed=undelivered, turnover=self._turnover,
            floes=momentum, other=other, no_water=nowhere, host=host,
        )  # fmt: skip
        return self.last

    def _totals(self) -> np.ndarray:
        """Momentum of the ice, impulse on it by all but the water, impulse without a wet cell: rows of (x, y) [N s]."""
        model = self._model
        other = [row[1:3] for name, row in model.ledger.accounts.items() if name != "ocean drag"]
        nowhere = np.zeros(2) if model.ocean is None else model.ocean.undelivered
        return np.array([model.ledger.now[1:3], np.sum([np.zeros(2), *other], axis=0), nowhere])

    # ---- state and faults ---------------------------------------------------------------------------

    @contextmanager
    def unchanged_on_failure(
        self, rescue: str | Path | None, more: Mapping[str, Any] | None = None
    ) -> Iterator[None]:
        """Restore the model if the body fails; its state is saved, and the error says where, in one line.

        more : state of the host, as for `save`; only for callers that also restore their own side
        """
        model = self._model
        before = {
            name: value.copy() if isinstance(value, np.ndarray) else value
            for name, value in model.state().items()
        }
        try:
            yield
        except Exception as error:
            model.restore(before)
            place = f"floes at {model.time:g} s"
            if rescue is not None:
                self.save(rescue, more)
                place += f", their state saved in {rescue}"
            text = f"{str(error).splitlines()[0] if str(error) else type(error).__name__}; {place}"
            kind = type(error) if isinstance(error, InputError | StabilityError) else RuntimeError
            raise kind(text) from error

    def save(self, path: str | Path, more: Mapping[str, Any] | None = None) -> None:
        """Save the model, this ledger's totals, and `more`, the state of the host."""
        books = {"turnover": self._turnover, "number": self._number}
        state = {"model": self._model.state(), "books": books, "host": dict(more or {})}
        save_restart(path, state, {"time": self._model.time})

    def load(self, path: str | Path) -> dict[str, Any]:
        """Continue from a state that `save` wrote; returns the `more` passed to it.

        Raises
        ------
        InputError
            for a file of another kind, or a state that does not fit the model.
        """
        state, _ = load_restart(path)
        if set(state) != {"model", "books", "host"}:
            raise InputError(f"{path}: not a state of a model that is coupled in one process")
        self._model.restore(state["model"])
        self._turnover = float(state["books"]["turnover"])
        self._number = int(state["books"]["number"])
        return state["host"]
