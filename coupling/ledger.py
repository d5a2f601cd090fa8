"""The ledger of momentum between a host and the ice, one line per exchange, for every kind of coupling.

Per axis [N s]:

    from host    taken by the floes from the water, on their own grid:  −Σ A ΔJ
    to host      put into the host's cells:                              Σ A_host F Δt
    undelivered  part of −from host without a wet cell of the host
    exchange     from host + to host + undelivered = 0                                   (a residual)
    floes        change in the floes' momentum
    other        given to the floes by all else: wind, walls, fixed floes, Coriolis …
    budget       floes − from host − other + impulse undelivered on the floes' own grid = 0  (a residual)

    host         change in the momentum of the host's water

Values that a model does not provide are left open, and so is `budget` without `floes` and `other`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Exchange(NamedTuple):
    """One line of the ledger; pairs are (x, y) [N s], None where no model provides them (see the module's text).

    The first four are NaN along an axis whose stress on the water the host takes in a form other than per cell area; where
    it takes none, all but `to_host`, which is 0.
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

    @classmethod
    def balanced(
        cls,
        number: int,
        time: float,
        duration: float,
        *,
        given: np.ndarray,
        taken: np.ndarray,
        missed: np.ndarray,
        turnover: float,
        floes: np.ndarray | None = None,
        other: np.ndarray | None = None,
        no_water: np.ndarray | None = None,
        host: np.ndarray | None = None,
        seen: bool = True,
    ) -> Exchange:
        """A line with its residuals, from impulses (x, y) [N s].

        Parameters
        ----------
        given, taken, missed : of ice on water: on the floes' grid, on the host's, lost between them
        no_water : of ice on water, undelivered on the floes' own grid; None: nothing
        seen : whether `given` is the complete impulse on the water along both axes; else the budget is left open
        """
        budget = None
        if floes is not None and other is not None and seen:
            budget = floes + given + (np.zeros(2) if no_water is None else no_water) - other
        return cls(
            number=number,
            time=time,
            duration=duration,
            from_host=-given,
            to_host=taken,
            undelivered=missed,
            exchange_residual=taken + missed - given,
            floes=floes,
            other=other,
            budget_residual=budget,
            host=host,
            turnover=turnover,
        )

    @property
    def relative(self) -> float:
        """The larger residual over the turnover; NaN where the stress along an axis is unknown."""
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
