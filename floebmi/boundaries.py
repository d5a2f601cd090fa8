"""Where the ice ends: edges of the domain, walls, and an edge where floes come in."""

from typing import Literal, NamedTuple

from floebmi.errors import InputError, choose

Edge = Literal["inactive", "periodic", "closed"]


class Domain(NamedTuple):
    """The rectangle in which floes live [m], and what each of its edges does.

    An `inactive` edge disables a floe whose centre leaves (its mass is booked), `periodic` edges come in
    pairs, a `closed` edge is a fixed frictionless wall.
    """

    x: tuple[float, float]
    y: tuple[float, float]
    west: Edge = "inactive"
    east: Edge = "inactive"
    south: Edge = "inactive"
    north: Edge = "inactive"

    @property
    def period(self) -> tuple[float | None, float | None]:
        """Length of the period along x and y [m], None where the edges are not periodic."""
        return (
            self.x[1] - self.x[0] if self.west == "periodic" else None,
            self.y[1] - self.y[0] if self.south == "periodic" else None,
        )

    @property
    def area(self) -> float:
        """Area of the rectangle [m²]."""
        return (self.x[1] - self.x[0]) * (self.y[1] - self.y[0])


def check_domain(domain: Domain) -> None:
    """Refuse an empty rectangle, unknown words, and a periodic edge without its partner."""
    for name in ("x", "y"):
        low, high = getattr(domain, name)
        if not high > low:
            raise InputError(f"domain.{name} = ({low}, {high}): the second must be larger")
    for edge in ("west", "east", "south", "north"):
        word = getattr(domain, edge)
        allowed = ("inactive", "periodic", "closed")
        if word not in allowed:
            raise InputError(f"domain.{edge} = {word!r}: {choose(word, allowed)}")
    for one, other in (("west", "east"), ("south", "north")):
        if (getattr(domain, one) == "periodic") != (getattr(domain, other) == "periodic"):
            raise InputError(f"domain.{one} and domain.{other}: both or neither must be 'periodic'")
