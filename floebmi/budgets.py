"""Ledgers: budgets of mass, momentum and energy.

A ledger is a table.  Each row is an account (ocean, walls, friction …) with its contribution to the ice
since the start.  The present amount should equal the initial one plus all accounts; the
difference is printed as the residual, and never corrected.
"""

from typing import NamedTuple

import numpy as np

from floebmi.errors import InputError, choose, is_word

QUANTITIES = ("mass", "momentum_x", "momentum_y", "energy")
UNITS = ("kg", "N s", "N s", "J")


class Balance(NamedTuple):
    """Balance of one quantity: now − start − gained = residual, in its unit.

    relative : |residual| over the largest of the initial amount, the present amount and the turnover in between [1]
    """

    start: float
    gained: float
    now: float
    residual: float
    relative: float


class Ledger:
    """Accounts of mass [kg], momentum along x and y [N s] and energy [J] of the ice.

    Attributes
    ----------
    start, now : (4,) mass, momentum x, momentum y and energy of the ice at the start and now
    accounts : by name, (4,) contribution of each account since the start (negative: a loss)
    """

    def __init__(self) -> None:
        self.start = np.zeros(4)
        self.now = np.zeros(4)
        self.accounts: dict[str, np.ndarray] = {}
        self.turnover = np.zeros(4)  # lower bound on the amounts exchanged, regardless of sign

    def copy(self) -> "Ledger":
        """A copy, for undoing later bookings."""
        other = Ledger()
        other.start, other.now = self.start.copy(), self.now.copy()
        other.turnover = self.turnover.copy()
        other.accounts = {name: row.copy() for name, row in self.accounts.items()}
        return other

    def open(self, stock: np.ndarray) -> None:
        """Start with the initial amounts: (mass, momentum x, momentum y, energy)."""
        self.start = stock.copy()
        self.now = stock.copy()

    def book(
        self, account: str, mass: float = 0.0, x: float = 0.0, y: float = 0.0, energy: float = 0.0
    ) -> None:
        """Add a contribution to an account (negative: a loss of the ice)."""
        row = np.array([mass, x, y, energy])
        self.accounts[account] = self.accounts.get(account, np.zeros(4)) + row
        self.turnover += np.abs(row)

    def saw(self, energy: float) -> None:
        """Record a kinetic energy [J] of the ice between two bookings; it counts as turnover even if it is lost again.

        Opposite momenta of floes cancel in the sum; their turnover is at most √(2 m K) in total.
        """
        self.turnover[3] = max(self.turnover[3], energy)
        self.turnover[1:3] = np.maximum(self.turnover[1:3], np.sqrt(2.0 * self.now[0] * energy))

    def balance(self, quantity: str) -> Balance:
        """The balance of "mass", "momentum_x", "momentum_y" or "energy".

        Raises
        ------
        InputError
            for any other word.
        """
        if not is_word(quantity, QUANTITIES):
            raise InputError(f"balance of {quantity!r}: {choose(quantity, QUANTITIES)}")
        q = QUANTITIES.index(quantity)
        gained = sum(row[q] for row in self.accounts.values())
        residual = self.now[q] - self.start[q] - gained
        # momentum is a vector: one component may be negligible beside the other
        of = slice(1, 3) if quantity.startswith("momentum") else slice(q, q + 1)
        scale = np.abs([self.start[of], self.now[of], self.turnover[of]]).max()
        return Balance(
            float(self.start[q]),
            float(gained),
            float(self.now[q]),
            float(residual),
            float(abs(residual) / scale) if scale else 0.0,
        )

    @property
    def balances(self) -> dict[str, Balance]:
        """All four balances by name."""
        return {quantity: self.balance(quantity) for quantity in QUANTITIES}

    def __str__(self) -> str:
        heads = [f"{name} [{unit}]" for name, unit in zip(QUANTITIES, UNITS, strict=True)]
        lines = [f"{'':<22}" + "".join(f"{head:>20}" for head in heads)]

        def line(name: str, values: np.ndarray) -> str:
            return f"{name:<22}" + "".join(
                f"{value:>20.9g}" if value else f"{'·':>20}" for value in values
            )

        lines.append(line("at the start", self.start))
        lines += [line(f"  {name}", row) for name, row in self.accounts.items() if row.any()]
        lines.append(line("now", self.now))
        balances = list(self.balances.values())
        lines.append(line("residual", np.array([b.residual for b in balances])))
        lines.append(f"{'  relative':<22}" + "".join(f"{b.relative:>20.1e}" for b in balances))
        return "\n".join(lines)

    def state(self) -> dict[str, np.ndarray]:
        """Arrays for a restart file."""
        return {
            "ledger_start": self.start.copy(),
            "ledger_now": self.now.copy(),
            "ledger_turnover": self.turnover.copy(),
            "ledger_accounts": np.array(list(self.accounts), dtype=np.str_),
            "ledger_rows": np.array(list(self.accounts.values())).reshape(-1, 4),
        }

    def restore(self, state: dict[str, np.ndarray]) -> None:
        """Restore the accounts from a restart file."""
        self.start = np.array(state["ledger_start"], float)
        self.now = np.array(state["ledger_now"], float)
        self.turnover = np.array(state["ledger_turnover"], float)
        rows = np.asarray(state["ledger_rows"], float).reshape(-1, 4)
        names = [str(name) for name in np.atleast_1d(state["ledger_accounts"])]
        self.accounts = {name: row.copy() for name, row in zip(names, rows, strict=True)}
