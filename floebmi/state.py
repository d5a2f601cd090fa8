"""The state of a model besides its floes: walls, memory of contacts, ledger, counters, random-number generator.

An advance starts from it and updates it.  All that must survive a restart, or be restored after a failed step,
is in here or in the floes.
"""

import json
from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from floebmi.boundaries import Feeder, walls_of_state
from floebmi.budgets import Ledger
from floebmi.floes import Floes
from floebmi.kept import Kept, Marks, marks
from floebmi.listing import Memory
from floebmi.pairs import MEMORIES, PairList

_OF_FLOES = {"previous": 3, "remainder": 2}  # columns of arrays per floe outside `Floes`


@dataclass
class Counters:
    """Counts of the work done since the start, for reports and profiling."""

    steps: int = 0
    floe_steps: int = 0
    rebuilds: int = 0
    pairs: int = 0  # candidate pairs, summed over steps
    bonds_broken: int = 0
    shortest_step: float = np.inf
    longest_step: float = 0.0
    last_step: float = 0.0
    tested: int = 0  # pairs tested to make the lists, and
    listed: int = 0  # those that were listed; keep these two last: older restart files lack them


@dataclass
class Seconds:
    """Wall-clock time of parts of the exchanges in this process [s]."""

    steps: float = 0.0
    lists: float = 0.0  # of neighbours, and the limit on the step


@dataclass
class State:
    """The state that an advance starts from and updates, besides the floes.

    walls : records of `dynamics.WALL`
    memory : memory of pairs, in the slots of `kept` where a list is kept
    previous : contact forces and torques of the last step (n, 3), only for the paper's schemes; see `pack.pack`
    remainder : rounding error of positions, (n, 2) [m]; None if the domain's origin is (0, 0)
    seconds : wall-clock time of steps and lists so far
    drawn : in a copy, which shares the generator: the generator's state when it was copied
    """

    walls: np.ndarray
    memory: Memory
    previous: np.ndarray | None
    remainder: np.ndarray | None
    rng: np.random.Generator
    feeders: tuple[Feeder, ...] = ()
    ledger: Ledger = field(default_factory=Ledger)
    counters: Counters = field(default_factory=Counters)
    kept: Kept | None = None
    seconds: Seconds = field(default_factory=Seconds)
    drawn: dict | None = None

    def copy(self) -> "State":
        """A copy to go back to; what is never changed in place is shared."""
        rows = {name: getattr(self, name) for name in _OF_FLOES}
        rows = {name: None if values is None else values.copy() for name, values in rows.items()}
        return replace(
            self, walls=self.walls.copy(), feeders=tuple(map(copy, self.feeders)),
            ledger=self.ledger.copy(), counters=replace(self.counters),
            seconds=replace(self.seconds), drawn=self.rng.bit_generator.state, **rows,
        )  # fmt: skip

    def go_back(self, earlier: "State") -> None:
        """Return to an earlier copy; walls, ledger and counters are updated in place."""
        self.walls[:] = earlier.walls
        self.memory, self.feeders = earlier.memory, earlier.feeders
        self.rng.bit_generator.state = earlier.drawn
        self.previous, self.remainder = earlier.previous, earlier.remainder
        self.kept, self.seconds = earlier.kept, earlier.seconds
        vars(self.ledger).update(vars(earlier.ledger))
        vars(self.counters).update(vars(earlier.counters))

    def fit(self, floes: int) -> None:
        """Extend the arrays per floe outside `Floes` to the present number of floes."""
        for name in _OF_FLOES:
            rows = getattr(self, name)
            if rows is not None and len(rows) < floes:
                more = np.zeros((floes - len(rows), rows.shape[1]))
                setattr(self, name, np.vstack([rows, more]))

    def kept_for(self, floes: Floes) -> Kept | None:
        """The list of the last exchange, as far as it is valid for the floes as they are now."""
        return None if self.kept is None else self.kept.of(floes)

    # ---- restart -----------------------------------------------------------------------------------

    def saved(self, floes: Floes) -> dict[str, object]:
        """The part that a restart needs, by name: arrays and text that will not be changed.

        floes : as they are now
        """
        pairs, _ = self.memory.by_number(len(floes))
        listed = marks(self.kept_for(floes), self.memory.number)
        of_floes = {name: getattr(self, name) for name in _OF_FLOES}
        return {
            "walls": np.array(self.walls.tolist()).reshape(-1, len(self.walls.dtype)),
            "pair_start": pairs.start,
            "pair_i": pairs.i,
            "pair_j": pairs.j,
            **{f"pair_{name}": values for name, values in pairs.memory().items()},
            **{f"list_{name}": values.copy() for name, values in listed._asdict().items()},
            **{name: rows.copy() for name, rows in of_floes.items() if rows is not None},
            "rng": json.dumps(self.rng.bit_generator.state),
            "waiting": np.array([np.nan if x.waiting is None else x.waiting for x in self.feeders]),
            "counters": np.array([float(value) for value in vars(self.counters).values()]),
            **self.ledger.state(),
        }

    def restore(self, saved: Mapping[str, Any]) -> Marks:
        """Restore what `saved` gave, from a state of the same scene; returns the marks to rebuild the list from."""
        self.walls[:] = walls_of_state(self.walls, np.asarray(saved["walls"]))
        memory = {name: saved[f"pair_{name}"] for name in MEMORIES if f"pair_{name}" in saved}
        pairs = PairList(
            np.asarray(saved["pair_start"], np.int64),
            np.asarray(saved["pair_i"], np.uint32),
            np.asarray(saved["pair_j"], np.uint32),
            **{name: np.asarray(values, float) for name, values in memory.items()},
        )
        self.memory, self.kept = Memory(pairs, np.arange(len(pairs.start) - 1)), None
        for name, columns in _OF_FLOES.items():
            if getattr(self, name) is not None:
                setattr(self, name, np.array(saved[name], float).reshape(-1, columns))
        self.rng.bit_generator.state = json.loads(str(saved["rng"]))
        for feeder, waiting in zip(self.feeders, np.atleast_1d(saved["waiting"]), strict=True):
            feeder.waiting = None if np.isnan(waiting) else float(waiting)
        counters = self.counters
        # counters that an older floebmi did not have start at 0
        counted = np.zeros(len(vars(counters)))
        counted[: np.size(saved["counters"])] = np.ravel(saved["counters"])
        for name, value in zip(vars(counters), counted, strict=True):
            setattr(counters, name, type(getattr(counters, name))(value))
        self.ledger.restore(saved)
        return Marks(*(np.array(saved[f"list_{name}"]) for name in Marks._fields))
