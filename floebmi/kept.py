"""What an exchange leaves to the next one: what pairs remember, and their list while it lasts.

A list of neighbours is a function of where the floes were when it was made.  So the places are all that a restart
file has of it: made there again, it is the same list, pair by pair, and a run that restarts at an exchange
goes on with the same bits as one that never stopped.
"""

from typing import NamedTuple

import numpy as np

from floebmi.dynamics import Lists
from floebmi.floes import Floes
from floebmi.pack import Packed, Stiffest, Survey, remembered
from floebmi.pairs import PairList

# What decides which floes are listed as neighbours; the step depends on the thickness as well.
DECISIVE = "x", "y", "radius", "active", "motion", "tensile_strength"


class Memory(NamedTuple):
    """What pairs remember, in the slots of a list or of a restart file.

    pairs : never changed in place; number : of the floe of each row
    """

    pairs: PairList
    number: np.ndarray

    def by_number(self, floes: int) -> "Memory":
        """Of the pairs that remember anything, in an order that depends on nothing but the numbers of so many floes."""
        return Memory(remembered(self.pairs, self.number, floes), np.arange(floes))


class Kept(NamedTuple):
    """A list of neighbours that the next exchange goes on with; its memory is `State.memory`.

    x, y : where its floes were when it was made, in its order, from the domain's origin (m,) [m]
    walls : where the walls were (w,) [m]
    lists : its tiles, and room for short lists; wall_floe, wall_number : see `dynamics.Walls`
    skin, closing : see `Advance` [m]
    room, travelled : how far floes may stray until it is stale, and how far they have [m]
    stiffest : what sets the step meanwhile, if that is known
    floes : as the exchange left them
    packed : the same floes packed; the next exchange works in these arrays, writes places and velocities anew, and takes
        over what follows from radius, thickness and prescribed motion; None: pack them anew
    survey : their largest speed, kinetic energy …, if that is known
    """

    x: np.ndarray
    y: np.ndarray
    walls: np.ndarray
    lists: Lists
    wall_floe: np.ndarray
    wall_number: np.ndarray
    skin: float
    closing: float
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
    return Marks(number, kept.x, kept.y, kept.walls, way, np.array(kept.stiffest or (), float))
