"""What an exchange leaves to the next one: what pairs remember, and their list while it lasts.

A list of neighbours is a function of where the floes were when it was made.  So the places are all that a restart
file has of it: made there again, it is the same list, pair by pair, and a run that restarts at an exchange
goes on with the same bits as one that never stopped.
"""

from typing import NamedTuple

import numpy as np

from floebmi.dynamics import Lists
from floebmi.floes import Floes
from floebmi.listing import Listed
from floebmi.pack import Packed
from floebmi.stable_step import Stiffest
from floebmi.survey import Survey

# What decides which floes are listed as neighbours; the step depends on the thickness as well.
DECISIVE = "x", "y", "radius", "active", "motion", "tensile_strength"


class Kept(NamedTuple):
    """A list of neighbours that the next exchange goes on with; its memory is `State.memory`.

    listed : where and how widely it was made
    lists : its tiles, and room for short lists
    room, travelled : how far floes may stray until it is stale, and how far they have [m]
    stiffest : what sets the step meanwhile, if that is known
    floes : as the exchange left them
    packed : the same floes packed; the next exchange works in these arrays, writes places and velocities anew, and takes
        over what follows from radius, thickness and prescribed motion; None: pack them anew
    survey : their largest speed, kinetic energy …, if that is known
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
        """As much of it as holds for floes that somebody may have changed since; None: list them anew."""
        if not floes.same(self.floes, DECISIVE):
            return None
        if not floes.same(self.floes, ("thickness",)):
            return self._replace(stiffest=None, packed=None, survey=None)
        return self if floes.same(self.floes) else self._replace(survey=None)


class Marks(NamedTuple):
    """What a restart file has of a list: enough to make it anew, bit for bit; empty where none is kept.

    number, x, y : its floes in its order, and where they were when it was made (m,) [m]; walls : (w,) [m]
    way : room and travelled of `Kept` [m]; stiffest : its numbers, or none
    """

    number: np.ndarray
    x: np.ndarray
    y: np.ndarray
    walls: np.ndarray
    way: np.ndarray
    stiffest: np.ndarray


def marks(kept: Kept | None, number: np.ndarray) -> Marks:
    """The marks of a list of floes of these numbers."""
    if kept is None:
        return Marks(np.zeros(0, np.int64), *np.zeros((5, 0)))
    way = np.array([kept.room, kept.travelled])
    return Marks(number, *kept.listed[:3], way, np.array(kept.stiffest or (), float))
