"""The ledger of a run as arrays, for the files of the experiments."""

import numpy as np

from floebmi.ensemble import Output
from floebmi.model import Model

OUTPUTS = {
    "ledger": Output(
        ("account", "quantity"), "", "ice: mass [kg], momentum along x and y [N s], energy [J]"
    ),
    "relative_residual": Output(
        ("quantity",), "1", "residual of the ledger over what was exchanged"
    ),
}
COORDINATES = {
    "account": Output(("account",), "", "line of the ledger; now = start + accounts + residual"),
    "quantity": Output(("quantity",), "", "quantity of the ledger"),
}


def books(model: Model, accounts: tuple[str, ...]) -> dict[str, np.ndarray]:
    """The ledger as an array: rows for the start, each account, now, and the residual; unused accounts are 0."""
    ledger, none = model.ledger, np.zeros(4)
    balances = ledger.balances
    rows = [ledger.start, *(ledger.accounts.get(name, none) for name in accounts), ledger.now]
    rows.append(np.array([balance.residual for balance in balances.values()]))
    return {
        "account": np.array(["start", *accounts, "now", "residual"]),
        "quantity": np.array(list(balances)),
        "ledger": np.array(rows),
        "relative_residual": np.array([balance.relative for balance in balances.values()]),
    }
