"""What a model is besides its floes: walls, what contacts remember, books, counters, the generator of random numbers.

An advance starts from it and leaves it behind.  Whatever has to survive a restart, or to be put back after a step that
failed, is in here or in the floes.
"""

from copy import copy
from dataclasses import dataclass, field, replace

import numpy as np

from floebmi.boundaries import Feeder
from floebmi.budgets import Ledger
from floebmi.kept import Kept, Memory


@dataclass
class Counters:
    """What was done since the start: for reports, and to see where time goes."""

    steps: int = 0
    floe_steps: int = 0
    rebuilds: int = 0
    pairs: int = 0  # candidate pairs, summed over steps
    bonds_broken: int = 0
    shortest_step: float = np.inf
    longest_step: float = 0.0
    last_step: float = 0.0
    tested: int = 0  # pairs tested to make the lists, and
    listed: int = 0  # those of them that were listed; both last, since restart files of before end without them


@dataclass
class Seconds:
    """Seconds on the clock in this process, of what an exchange spends its time on besides itself."""

    steps: float = 0.0
    lists: float = 0.0  # of neighbours, and what sets the step


@dataclass
class State:
    """What an advance starts from and leaves behind, besides the floes.

    walls : records of `dynamics.WALL`
    memory : what pairs remember, in the slots of `kept` where a list is kept
    previous : contact forces and torques of the last step (n, 3), for the paper's schemes alone; see `pack.pack`
    remainder : what rounding took from places far from (0, 0), (n, 2) [m]; None near it
    seconds : what steps and lists took so far
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
        """The same, to go back to; what is never changed in place is shared."""
        rows = (None if kept is None else kept.copy() for kept in (self.previous, self.remainder))
        return State(
            self.walls.copy(), self.memory, *rows, self.rng, tuple(map(copy, self.feeders)),
            self.ledger.copy(), replace(self.counters), self.kept,
            replace(self.seconds), self.rng.bit_generator.state,
        )  # fmt: skip

    def go_back(self, earlier: "State") -> None:
        """Become an earlier copy; whoever holds the walls, the ledger or the counters sees it."""
        self.walls[:] = earlier.walls
        self.memory, self.feeders = earlier.memory, earlier.feeders
        self.rng.bit_generator.state = earlier.drawn
        self.previous, self.remainder = earlier.previous, earlier.remainder
        self.kept, self.seconds = earlier.kept, earlier.seconds
        vars(self.ledger).update(vars(earlier.ledger))
        vars(self.counters).update(vars(earlier.counters))

    def fit(self, floes: int) -> None:
        """Room for new floes in what is kept per floe outside of `Floes`: so many there are now."""
        for name in ("previous", "remainder"):
            rows = getattr(self, name)
            if rows is not None and len(rows) < floes:
                more = np.zeros((floes - len(rows), rows.shape[1]))
                setattr(self, name, np.vstack([rows, more]))
