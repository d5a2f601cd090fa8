"""Boundaries: the edges of the domain, walls, and inflow of floes along an edge."""

from collections.abc import Sequence, Sized
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike

from floebmi.arrays import all_within
from floebmi.dynamics import WALL
from floebmi.errors import InputError, check_word, in_line
from floebmi.floes import FIXED_X, FIXED_Y, Floes
from floebmi.kernels import in_place
from floebmi.quantities import FARTHEST, NonNegative, Positive, check, is_number, unmasked
from floebmi.sizes import Sizes, check_sizes

Edge = Literal["inactive", "periodic", "closed"]
EDGES = ("west", "east", "south", "north")
_AXIS = {"west": 0, "east": 0, "south": 1, "north": 1}
_SIDE = {"west": 1.0, "east": -1.0, "south": 1.0, "north": -1.0}


class Domain(NamedTuple):
    """The rectangle in which the floes move, and what happens at each of its edges.

    Parameters
    ----------
    x, y : west and east edge, south and north edge [m]
    west, east, south, north : "inactive": a floe whose centre crosses the edge is deactivated, and its mass booked as lost;
        "periodic" (opposite edges together): floes re-enter on the other side; "closed": a fixed frictionless wall

    Examples
    --------
    >>> Domain(x=(0.0, 40e3), y=(0.0, 20e3), west="periodic", east="periodic").period
    (40000.0, None)
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
            float(self.x[1] - self.x[0]) if self.west == "periodic" else None,
            float(self.y[1] - self.y[0]) if self.south == "periodic" else None,
        )

    @property
    def area(self) -> float:
        """Area of the rectangle [m²]."""
        return (self.x[1] - self.x[0]) * (self.y[1] - self.y[0])

    @property
    def origin(self) -> tuple[float, float]:
        """The point of the domain closest to (0, 0) [m], from which the kernels measure x and y.

        So round-off is no larger in a domain far from (0, 0), as in a map projection.
        """
        return min(max(0.0, self.x[0]), self.x[1]), min(max(0.0, self.y[0]), self.y[1])

    def brought_back(self, x: ArrayLike, y: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Positions [m], with those beyond periodic edges moved to their images in the domain."""
        found = []
        for values, (low, high), length in zip((x, y), (self.x, self.y), self.period, strict=True):
            values = unmasked(values)
            if length is not None:
                out = (values < low) | (values > high)
                values = np.where(out, low + np.mod(values - low, length), values)
            found.append(values)
        return found[0], found[1]

    def bring_back(self, x: np.ndarray, y: np.ndarray) -> None:
        """The same in place, to within round-off; where no place is out, as in most exchanges, it only looks."""
        for values, (low, _), length in zip((x, y), (self.x, self.y), self.period, strict=True):
            if length is not None and not all_within(values, low, low + length):
                values -= length * np.floor((values - low) / length)

    def position(self, edge: str) -> float:
        """Coordinate of an edge [m]."""
        check_word("edge", edge, EDGES)
        return float((self.x, self.y)[_AXIS[edge]][0 if _SIDE[edge] > 0 else 1])


class Wall(NamedTuple):
    """A straight frictionless wall that bounds the ice towards one edge of the domain (eq. wall).

    Without a normal stress the wall stands still or moves at `velocity`.  With one it has a mass and moves freely
    along its normal, loaded with N × length × mean thickness of the ice.  Its length is that of the domain's edge, wherever
    other walls stand.  Floes still leave at an inactive edge behind the wall, so make the domain large enough for a
    wall that may move outwards.

    Parameters
    ----------
    edge : edge that the wall replaces, "west", "east", "south" or "north"; the ice is on its inner side
    position : coordinate along the normal [m]; default: the edge of the domain
    velocity : velocity along +x or +y [m/s]; for a loaded wall the initial one
    normal_stress : normal stress N on the wall [Pa], positive compresses the ice
    mass : mass of a loaded wall [kg]; default: the mass of all floes
    damping : damping of a loaded wall, as a fraction of critical damping [1]
    """

    edge: Literal["west", "east", "south", "north"]
    position: float | None = None
    velocity: float = 0.0
    normal_stress: float | None = None
    mass: Positive | None = None
    damping: NonNegative = 1.0


class Inflow(NamedTuple):
    """New floes along an edge of the domain, each as soon as there is room for it; their mass is booked.

    A new floe is placed at random where it touches the edge from inside and overlaps no other floe.  Of land a model
    knows only the fixed floes on the shore, so keep `span` away from land (scenes, which have the polygons, refuse it).
    Room is looked for at the start of each exchange and, in a long one, whenever floes have moved by about a tenth of the
    smallest radius.

    Floes enter in the order in which they are drawn, and one that waits for room holds back all that follow.  The inflowing
    ice is therefore looser for a wider size distribution.  For an edge as long as twenty of the largest floes, and ice that
    moves away at a steady speed, its concentration is about 0.74 for floes of one radius, 0.34 for a power law over a factor
    of 10 in radius (exponent -1.8), and 0.17 over a factor of 100.

    Parameters
    ----------
    edge : edge where floes enter, "west", "east", "south" or "north"
    sizes : floe size distribution
    thickness : thickness of a new floe [m]
    velocity : velocity of a new floe along x and y [m/s], not outwards; default: at rest
    span : open part of the edge, from and to, as coordinates along it [m]; default: all of it
    """

    edge: Literal["west", "east", "south", "north"]
    sizes: Sizes
    thickness: Positive = 1.0
    velocity: tuple[float, float] = (0.0, 0.0)
    span: tuple[float, float] | None = None


def check_domain(domain: Domain) -> None:
    """Refuse an empty rectangle, coordinates beyond 1e9 m, unknown words, and a periodic edge without its partner."""
    if not isinstance(domain, Domain):
        raise InputError(f"domain = {domain!r}: must be a Domain")
    for name in ("x", "y"):
        pair = getattr(domain, name)
        row = isinstance(pair, Sequence | np.ndarray) and not isinstance(pair, bytes)
        two = row and np.iterable(pair) and len(pair) == 2
        if not two or not all(map(is_number, pair)):
            raise InputError(
                f"domain.{name} = {in_line(pair)}: must be two numbers (low, high) [m]"
            )
        low, high = pair
        if not high > low:
            raise InputError(f"domain.{name} = ({low}, {high}): the second must be larger")
        if max(abs(low), abs(high)) > FARTHEST:
            raise InputError(f"domain.{name} = ({low}, {high}): must be within {FARTHEST:g} m")
    for edge in EDGES:
        check_word(f"domain.{edge}", getattr(domain, edge), get_args(Edge))
    for one, other in (("west", "east"), ("south", "north")):
        if (getattr(domain, one) == "periodic") != (getattr(domain, other) == "periodic"):
            raise InputError(f"domain.{one} and domain.{other}: both or neither must be 'periodic'")


def leaving(floes: Floes, domain: Domain) -> np.ndarray:
    """The numbers of the floes whose centres are beyond an inactive edge, who leave for good."""
    gone = np.zeros(len(floes), bool)
    for place, (low, high), edges in (
        (floes.x, domain.x, (domain.west, domain.east)),
        (floes.y, domain.y, (domain.south, domain.north)),
    ):
        if edges[0] == "inactive":
            gone |= place < low
        if edges[1] == "inactive":
            gone |= place > high
    return (
        np.flatnonzero(gone & floes.active & ~floes.land) if gone.any() else np.empty(0, np.int64)
    )


def _check_edge(what: str, edge: str, domain: Domain) -> None:
    check_word(f"{what}.edge", edge, EDGES)
    if getattr(domain, edge) == "periodic":
        raise InputError(f"{what}.edge = {edge!r}: the domain is periodic there; use another edge")


def build_walls(
    domain: Domain, walls: tuple[Wall, ...], floes: Floes, density: float, youngs_modulus: float
) -> np.ndarray:
    """Records of dtype `WALL`, relative to the domain's origin: the listed walls, and a fixed one at each closed edge.

    Raises
    ------
    InputError
        for an unknown or periodic edge, two walls at one edge, a mass or damping without a load, or a loaded wall without
        ice to load.
    """
    check(walls)
    listed = {}
    for wall in walls:
        _check_edge("wall", wall.edge, domain)
        if wall.edge in listed:
            raise InputError(
                f"wall.edge = {wall.edge!r}: there are two walls at this edge; use one"
            )
        for name in ("mass", "damping") if wall.normal_stress is None else ():
            if getattr(wall, name) != Wall._field_defaults[name]:
                raise InputError(
                    f"wall.{name} = {getattr(wall, name)!r}: applies only to a loaded wall; give it a normal_stress, or leave it out"
                )
        listed[wall.edge] = wall
    for edge in EDGES:
        if getattr(domain, edge) == "closed":
            listed.setdefault(edge, Wall(edge))
    records = np.zeros(len(listed), WALL).view(np.recarray)
    ice = floes.active & ~floes.land
    for record, wall in zip(records, listed.values(), strict=True):
        axis = _AXIS[wall.edge]
        record.axis, record.side = axis, _SIDE[wall.edge]
        position = domain.position(wall.edge) if wall.position is None else wall.position
        record.position = position - domain.origin[axis]
        record.speed = wall.velocity
        if wall.normal_stress is None:
            continue
        volume = floes.volume[ice].sum()
        if not volume:
            raise InputError(
                "wall.normal_stress: there is no ice to load; add floes or leave it out"
            )
        thickness = volume / floes.area[ice].sum()
        sides = np.ptp([domain.x, domain.y], axis=1)
        across, along = sides[axis], sides[1 - axis]
        mass = density * volume if wall.mass is None else wall.mass
        record.inverse_mass = 1.0 / mass
        record.press = wall.normal_stress * along * thickness
        # the pack as a spring: E h in series across it, in parallel along it
        spring = youngs_modulus * thickness * along / across
        record.damping = 2.0 * wall.damping * np.sqrt(spring / mass)
    return records


def edge_of(wall: np.void) -> str:
    """The edge of the domain that a wall's record belongs to."""
    return next(e for e in EDGES if _AXIS[e] == wall["axis"] and _SIDE[e] == wall["side"])


def walls_of_state(walls: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """The walls of a scene with the state of a restart file; loads, and speeds of unloaded walls, stay those of the scene.

    rows : (walls, columns of `WALL`)
    """
    saved = walls.copy()
    names = walls.dtype.names
    for record, row in zip(saved, rows.reshape(len(walls), len(names)), strict=True):
        of_state = dict(zip(names, row, strict=True))
        for name in ("position", "speed", "force", "previous", "impulse", "work"):
            if record["inverse_mass"] > 0.0 or name != "speed":
                record[name] = of_state[name]
    return saved


def over_walls(walls: np.ndarray, floes: Floes, origin: tuple[float, float]) -> np.ndarray:
    """Overlap of floes with walls, over the radius [1]: (floes, walls), at most 0 where they do not touch.

    It is 0 for pairs without a force: land, inactive floes, and floes whose motion across an unloaded wall is prescribed.
    """
    reach = np.zeros((len(floes), len(walls)))
    for w, wall in enumerate(walls):
        place, held = ((floes.x, FIXED_X), (floes.y, FIXED_Y))[int(wall["axis"])]
        position = wall["position"] + origin[int(wall["axis"])]
        meets = floes.active & ~floes.land
        if wall["inverse_mass"] == 0.0:
            meets &= (floes.motion & held) == 0
        reach[meets, w] = (1.0 - wall["side"] * (place - position) / floes.radius)[meets]
    return reach


def check_way_in(inflow: Inflow, walls: np.ndarray, domain: Domain) -> None:
    """Refuse a wall into which, or behind which, an inflow would place its floes."""
    edge = domain.position(inflow.edge)
    for wall in walls:
        if edge_of(wall) != inflow.edge:
            continue
        side, position = wall["side"], wall["position"] + domain.origin[int(wall["axis"])]
        if (
            wall["inverse_mass"] > 0.0
            or side * wall["speed"] > 0.0
            or side * (position - edge) > 0.0
        ):
            raise InputError(
                f"inflow.edge = {inflow.edge!r}: floes come in at {edge:g} m, and the wall there stands or goes further in; "
                "it must stay at the edge or beyond, or leave one of the two out"
            )


def check_reach(wall: Wall, largest: float, domain: Domain) -> None:
    """Refuse a wall so far beyond an inactive edge that even the largest floe (radius [m]) leaves before it touches the wall."""
    if wall.position is None or getattr(domain, wall.edge) != "inactive":
        return
    side, edge = _SIDE[wall.edge], domain.position(wall.edge)
    comes_in = wall.normal_stress is not None or side * wall.velocity > 0.0
    if side * (edge - wall.position) >= largest and not comes_in:
        raise InputError(
            f"wall.position = {wall.position:g}: lies beyond the {wall.edge} edge at {edge:g} m, which is inactive: floes of at "
            f"most {largest:g} m leave there before they meet the wall; put it at the edge or inside, or widen the domain"
        )


class Feeder:
    """Adds the floes of an inflow; its random numbers come from a generator that is part of the model's state."""

    def __init__(self, inflow: Inflow, domain: Domain) -> None:
        _check_edge("inflow", inflow.edge, domain)
        for name in ("velocity", "span"):
            pair = getattr(inflow, name)
            sized = isinstance(pair, Sized) and np.iterable(pair)  # one number of numpy is not
            if pair is not None and not (sized and len(pair) == 2):
                raise InputError(f"inflow.{name} = {pair!r}: must be two numbers, (…, …)")
        check([inflow])
        check_sizes(inflow.sizes, "inflow.sizes.")
        self.inflow, self.domain = inflow, domain
        self.axis = _AXIS[inflow.edge]
        if _SIDE[inflow.edge] * inflow.velocity[self.axis] < 0.0:
            raise InputError(
                f"inflow.velocity = {inflow.velocity}: points out of the domain at its {inflow.edge} edge; must point in"
            )
        edge = (domain.y, domain.x)[self.axis]
        along = edge if inflow.span is None else inflow.span
        self.span = float(along[0]), float(along[1])
        if not edge[0] <= self.span[0] < self.span[1] <= edge[1]:
            raise InputError(
                f"inflow.span = {self.span}: must be a stretch of the edge, from {edge[0]:g} to {edge[1]:g} m"
            )
        widest = 2 * inflow.sizes.range[1]
        if self.span[1] - self.span[0] < widest:
            raise InputError(
                f"inflow.span = {self.span}: narrower than the largest floe; must be at least {widest:g} m"
            )
        self.seamless = self.domain.period[1 - self.axis] == self.span[1] - self.span[0]
        self.waiting: float | None = None  # radius of the floe that found no room yet

    def feed(self, floes: Floes, walls: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Add floes until the next one finds no room; returns the numbers of the new floes.

        walls : records of dtype `WALL`, where they are now
        """
        added = []
        while True:
            if self.waiting is None:
                self.waiting = float(self.inflow.sizes.draw(1, rng)[0])
            place = self._room(floes, walls, self.waiting, rng)
            if place is None:
                return np.concatenate(added) if added else np.empty(0, np.int64)
            u, v = self.inflow.velocity
            added.append(floes.add(*place, self.waiting, self.inflow.thickness, u, v))
            self.waiting = None

    def across(self, depth: float) -> float:
        """The coordinate, along the edge's normal, of a place at this depth inside the edge [m]."""
        return self.domain.position(self.inflow.edge) + _SIDE[self.inflow.edge] * depth

    def _room(
        self, floes: Floes, walls: np.ndarray, radius: float, rng: np.random.Generator
    ) -> tuple[float, float] | None:
        """A random free place for a disc that touches the edge from inside, if there is one."""
        across = self.across(radius)
        other, along = (floes.x, floes.y) if self.axis == 0 else (floes.y, floes.x)
        begin, end = _free(
            other - across, along, floes.radius + radius, floes.active,
            *self._stretch(walls, radius), self.domain.period[1 - self.axis] or np.inf,
        )  # fmt: skip
        lengths = end - begin
        if not lengths.sum() > 0:
            return None
        spot = rng.uniform(0.0, lengths.sum())
        for first, length in zip(begin, lengths, strict=True):
            if spot <= length:
                place = float(first + spot)
                return (across, place) if self.axis == 0 else (place, across)
            spot -= length
        return None

    def _stretch(self, walls: np.ndarray, radius: float) -> tuple[float, float]:
        """The lowest and the highest place of a new disc along the edge, between walls; without room the lowest is higher."""
        # a floe may lie across a seam, but not over an end
        within = 0.0 if self.seamless else radius
        low, high = self.span[0] + within, self.span[1] - within
        for wall in walls:
            axis, side = int(wall["axis"]), wall["side"]
            touching = wall["position"] + self.domain.origin[axis] + side * radius
            if axis != self.axis and side > 0.0:
                low = max(low, touching)
            elif axis != self.axis:
                high = min(high, touching)
            elif side != _SIDE[self.inflow.edge] and side * (self.across(radius) - touching) < 0.0:
                return np.inf, -np.inf  # the wall opposite has come as far as the edge
        return low, high


def _free(
    apart: np.ndarray, along: np.ndarray, reach: np.ndarray, active: np.ndarray, low: float, high: float, period: float
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Beginnings and ends of the free stretches of a line between low and high, where no floe is within its reach.

    apart : distances of the floes from the line; along : their positions along it; period : of the line, or inf
    """
    begin, end = np.empty((2, 3 * apart.size))
    n = _taken(apart, along, reach, active, period, begin, end)
    order = np.argsort(begin[:n])  # compiled, it would take seconds at first use
    first = np.maximum.accumulate(np.append(low, end[order]))
    last = np.minimum(np.append(begin[order], high), high)
    free = last > first
    return first[free], last[free]


@in_place
def _taken(apart, along, reach, active, period, begin, end):
    """Fill in the stretches of the line within reach of a floe; returns their number."""
    n = 0
    images = 1 if period < np.inf else 0  # across a seam, too
    for k in range(apart.size):
        if active[k] and abs(apart[k]) < reach[k]:
            half = np.sqrt(reach[k] * reach[k] - apart[k] * apart[k])
            for image in range(-images, images + 1):
                centre = along[k] + image * period if image else along[k]
                begin[n], end[n], n = centre - half, centre + half, n + 1
    return n
