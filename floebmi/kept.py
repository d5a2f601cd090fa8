"""What an exchange keeps for the next one: the memory of pairs, and their list while it is valid.

A list of neighbours is a function of the positions of the floes when it was made.  So a restart file holds only
these positions: rebuilt from them, the list is the same, pair by pair, and a run that is restarted at an exchange
continues with the same bits as one that never stopped.
"""

from typing import NamedTuple

import numpy as np

from floebmi.dynamics import Lists
from floebmi.floes import Floes
from floebmi.listing import Listed
from floebmi.pack import Packed
from floebmi.stable_step import Stiffest
from floebmi.survey import Survey

# Columns that determine which floes are listed as neighbours; the step also depends on the thickness.
DECISIVE = "x", "y", "radius", "active", "motion", "tensile_strength"


class Kept(NamedTuple):
    """A list of neighbours that the next exchange continues with; its memory is `State.memory`.

    listed : where and how widely it was made
    lists : its tiles, and room for short lists
    room, travelled : displacement at which it becomes stale, and displacement so far [m]
    stiffest : the limit on the step meanwhile, if known
    floes : as the exchange left them
    packed : the same floes packed; the next exchange reuses these arrays, rewrites positions and velocities, and keeps
        what follows from radius, thickness and prescribed motion; None: pack them again
    survey : their largest speed, kinetic energy …, if known
    """

    listed: Listed
    lists: Lists
    room: float
    travelled: float
    stiffest: Stiffest | None
    floes: Floes
    packed: Packed | None
    survey: Survey | None

    def of(self, floes: Floes) -> "Kept | None":
        """The part that is still valid for floes that may have been edited since; None: rebuild the list."""
        if floes is self.floes:
            return self
        if not floes.same(self.floes, DECISIVE):
            return None
        if not floes.same(self.floes, ("thickness",)):
            return self._replace(stiffest=None, packed=None, survey=None)
        return self if floes.same(self.floes) else self._replace(survey=None)


class Marks(NamedTuple):
    """The part of a list in a restart file: enough to rebuild it, bit for bit; empty where none is kept.

    number, x, y : its floes in its order, and their positions when it was made (m,) [m]; walls : (w,) [m]
    way : room and travelled of `Kept` [m]; stiffest : its numbers, or none
    """

    number: np.ndarray
    x: np.ndarray
    y: np.ndarray
    walls: np.ndarray
    way: np.ndarray
    stiffest: np.ndarray


def marks(kept: Kept | None, number: np.ndarray) -> Marks:
    """The marks of a list of floes with these numbers."""
    if kept is None:
        return Marks(np.zeros(0, np.int64), *np.zeros((5, 0)))
    way = np.array([kept.room, kept.travelled])
    return Marks(number, *kept.listed[:3], way, np.array(kept.stiffest or (), float))
