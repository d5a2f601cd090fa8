"""Where the floes lie at the start: scattered, on a lattice, from gridded fields, from files.

Scattering is done in three steps.  *String*: the floes are laid, in random order, along a
space-filling (Hilbert) curve through the places where ice may be, each taking as much of the curve
as its area asks for; so every part of the domain has its share of ice from the start, and no ice
has to travel far. Large floes are laid first, and smaller ones around them.  *Press* and *swap*
are in pressing.py.
"""

import itertools
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from floebmi.boundaries import Domain, check_domain
from floebmi.coast import Coast, land_geometry, read_features
from floebmi.errors import InputError, choose
from floebmi.floes import FIXED_X, FIXED_Y, Floes, check_floes
from floebmi.grid import Grid, following_nodes
from floebmi.kernels import jit
from floebmi.neighbours import find_pairs, sort_in_space
from floebmi.pressing import SPARE, distances, press, some_free
from floebmi.quantities import FARTHEST, flat, is_number, number_in, unmasked
from floebmi.sampling import check_images
from floebmi.sizes import Sizes, check_sizes, csv_lines

ROUNDS = 6  # in which floes that found no room are laid elsewhere
CLASS = 4.0  # floes within this ratio of radii are laid together
SHORE_STEP = 0.5  # distance of the points that guard a shore, in smallest radii
WHOLE_ROWS = 0.03  # the same on a lattice
CLOSE_ENOUGH = 0.005  # relative error of the concentration that is still what was asked for

EDGES_KEPT = ("closed", "inactive")  # edges that floes are laid inside of

Land = Coast | Grid | Sequence[ArrayLike]


class IceNotPlaced(UserWarning):
    """Ice of a field that found no room."""


def scatter(
    domain: Domain,
    sizes: Sizes,
    concentration: float | None = None,
    count: int | None = None,
    thickness: float = 1.0,
    seed: int = 0,
    land: Land | None = None,
) -> Floes:
    """Floes in random places that do not overlap.

    Parameters
    ----------
    domain : floes cross periodic edges, and lie wholly inside the others
    sizes : the distribution of radii
    concentration : area of floes over the area of the domain that is not land, met within 0.5 %.
        About 0.85 is reached by any sizes, 0.88 by radii that differ by a factor of 2
    count : number of floes, in place of a concentration
    thickness : of all floes [m]
    seed : of the random numbers; the same seed gives the same floes, bit for bit
    land : kept free, as is its shore: a `Coast`, a `Grid` (its dry cells), or rings as in
        `from_polygons`; a coast's own floes are not part of the result

    Returns
    -------
    Floes, numbered in the order of space, so that neighbours have numbers close to each other

    Raises
    ------
    InputError
        if the floes do not fit, or no number of floes comes within 0.5 % of the concentration.

    Examples
    --------
    >>> from floebmi.sizes import UniformSize
    >>> box = Domain((0.0, 2000.0), (0.0, 1000.0), west="periodic", east="periodic")
    >>> floes = scatter(box, UniformSize(10.0, 20.0), concentration=0.8, seed=1)
    >>> round(float(floes.area.sum() / box.area), 2)
    0.8
    """
    check_domain(domain)
    check_sizes(sizes)
    if (concentration is None) == (count is None):
        raise InputError(
            f"concentration = {concentration}, count = {count}: give one of them, not both"
        )
    rng = _generator(seed)
    if not (is_number(thickness) and thickness > 0):
        raise InputError(f"thickness = {thickness!r} m; must be greater than 0")
    barrier = _barrier(land, domain, sizes.range[0])
    room = domain.area - barrier.area
    if room <= 1e-9 * domain.area:
        raise InputError("land covers the whole domain; must leave room for floes")
    if count is not None:
        if not is_number(count) or int(count) != count or count < 0:
            raise InputError(f"count = {count!r}; must be a whole number, at least 0")
        radius = sizes.draw(int(count), rng)
    else:
        if not (is_number(concentration) and 0 < concentration < 1):
            raise InputError(f"concentration = {concentration!r}; must be between 0 and 1")
        radius = _draw_area(sizes, concentration * room, rng)
    asked = f"concentration = {concentration:g}" if count is None else f"count = {count}"
    filled = float(np.pi * np.sum(radius**2)) / room
    if filled > 0.95:
        raise InputError(
            f"{asked}: the floes would cover {filled:.3g} of the room; about 0.85 can be packed"
        )
    _check_fit(radius, domain)
    ground = _ground(domain, barrier, len(radius))
    sea = ground.group >= 0
    if not sea.any():
        raise InputError(f"land leaves {room:.4g} m², too little to find a place for floes")
    ground.ice[sea] = filled * room / np.count_nonzero(sea)
    x, y, _, left = _settle(radius, ground, domain, rng)
    if left.any():
        raise InputError(
            f"{asked}: {np.count_nonzero(left)} of {len(left)} floes find no room of their own; "
            "choose less, or smaller floes, or a wider range of sizes"
        )
    order = sort_in_space(x, y, radius) if len(x) else slice(None)
    return Floes(x[order], y[order], radius[order], thickness)


def from_field(
    grid: Grid,
    area_fraction: ArrayLike,
    thickness: ArrayLike,
    sizes: Sizes,
    domain: Domain | None = None,
    seed: int = 0,
    max_concentration: float = 0.85,
    land: Land | None = None,
) -> Floes:
    """Floes that hold the ice of gridded fields.

    Floes are drawn until the ice area inside the domain is met; each cell gets the floes for its
    own ice area, within about half a floe, and what is over or short is carried to a neighbouring
    cell.  Floes do not reach into dry cells or land.  The area is met, the volume is not: beside
    cells at `max_concentration`, where discs are as dense as they get, and beside land, looser
    cells get more than their share, and floes there have the thickness of those (labrador-sea:
    cells below 0.7 get a fifth more, denser ones 5 % less, and the volume is 2 % short).

    Parameters
    ----------
    grid : of the fields; its dry cells are land
    area_fraction : of each cell [1], shape (grid.size,) or grid.shape, or one number
    thickness : of the ice in each cell [m] (not its mean over ice and water), same shapes, or one
        number. A floe gets the thickness of the cell that it was drawn for
    sizes : the distribution of radii
    domain : default the box around the grid's nodes, with inactive edges
    seed : of the random numbers; the same seed gives the same floes, bit for bit
    max_concentration : cells with more ice than this get only this much, for discs do not pack much
        denser than 0.85 (at most 0.88)
    land : further land to keep free, as in `scatter`

    Warns
    -----
    IceNotPlaced
        with the area that was left out because of `max_concentration`, and that of floes that found
        no room, or that of less than half a floe.

    Returns
    -------
    Floes, numbered in the order of space

    Raises
    ------
    InputError
        for a value in a wet cell that is not usable, with its index; a period shorter than the grid.
    """
    check_sizes(sizes)
    if domain is None:
        domain = Domain(
            (float(grid.node_x.min()), float(grid.node_x.max())),
            (float(grid.node_y.min()), float(grid.node_y.max())),
        )
    check_domain(domain)
    if not 0 < max_concentration <= 0.88:
        raise InputError(f"max_concentration = {max_concentration!r}; must be in (0, 0.88]")
    fraction = _field("area_fraction", area_fraction, grid)
    depth = _field("thickness", thickness, grid)
    for name, wrong, values, right in (
        (
            "area_fraction",
            ~((fraction >= 0) & (fraction <= 1)),
            fraction,
            "must be between 0 and 1",
        ),
        (
            "thickness",
            ~((depth > 0) & np.isfinite(depth)) & (fraction > 0),
            depth,
            "must be greater than 0 where there is ice",
        ),
    ):
        if (wrong & grid.wet).any():
            cell = int(np.flatnonzero(wrong & grid.wet)[0])
            raise InputError(f"{name} of cell {cell} = {values[cell]}; {right}")
    rng = _generator(seed)
    fraction = np.where(grid.wet, fraction, 0.0)
    check_images(grid, domain.period)
    x, y = (
        (low - (length or 0.0), high + (length or 0.0))
        for (low, high), length in zip((domain.x, domain.y), domain.period, strict=True)
    )
    inside = _area_inside(grid, domain._replace(x=x, y=y))  # what is across a seam is inside, too
    wanted = float(np.sum(fraction * inside))
    ice = np.minimum(fraction, max_concentration) * inside
    radius = _draw_area(sizes, float(ice.sum()), rng, strict=False)
    _check_fit(radius, domain)
    barrier = _barrier(land, domain, sizes.range[0], grid)
    ground = _ground(domain, barrier, len(radius), grid)
    _spread(ground, grid, ice)
    x, y, cell, left = _settle(radius, ground, domain, rng)
    if left.any():
        left = _thin_out(x, y, radius, ground, domain)
    capped = wanted - float(ice.sum())
    lost = float(np.pi * np.sum(radius[left] ** 2))
    told = [
        f"{area:.4g} m² ({area / wanted:.2%}) {why}"
        for area, why in (
            (capped, f"above max_concentration = {max_concentration:g}"),
            (lost, f"in {np.count_nonzero(left)} floes that found no room"),
            (0.0 if radius.size else float(ice.sum()), "less than half a floe"),
        )
        if area > 1e-9 * wanted
    ]
    if told:
        warnings.warn(
            f"ice not placed: {', '.join(told)}; of {wanted:.4g} m²", IceNotPlaced, stacklevel=2
        )
    x, y, radius, cell = (values[~left] for values in (x, y, radius, cell))
    order = sort_in_space(x, y, radius) if len(x) else slice(None)
    return Floes(x[order], y[order], radius[order], depth[cell[order]])


def regular(
    domain: Domain,
    radius: float,
    spacing: float | None = None,
    concentration: float | None = None,
    lattice: Literal["hexagonal", "square"] = "hexagonal",
    thickness: float = 1.0,
) -> Floes:
    """Equal floes on a lattice.

    Rows run along x; of a hexagonal lattice they are √3/2 spacings apart, and every other one is
    shifted. Between edges that are not periodic the lattice is centred, with all floes wholly
    inside.  Along a period the lattice is stretched or squeezed to the nearest whole (hexagonal,
    along y: even) number of rows, and to meet a concentration, by up to a tenth along x against y.

    Parameters
    ----------
    domain : its size, and which edges are periodic
    radius : of all floes [m]
    spacing : of neighbours [m], at least 2 radii
    concentration : area of floes over that of the domain, in place of a spacing, met as closely
        as whole rows allow, and within 3 %
    lattice : "hexagonal" or "square"
    thickness : of all floes [m]

    Returns
    -------
    Floes, row by row from the south-west

    Raises
    ------
    InputError
        if floes would overlap, or no whole number of rows gives the concentration; it says the
        nearest.
    """
    check_domain(domain)
    if lattice not in ("hexagonal", "square"):
        raise InputError(f"lattice = {lattice!r}: {choose(lattice, ('hexagonal', 'square'))}")
    if (spacing is None) == (concentration is None):
        raise InputError(
            f"spacing = {spacing}, concentration = {concentration}: give one of them, not both"
        )
    if not (is_number(radius) and radius > 0):
        raise InputError(f"radius = {radius!r} m; must be greater than 0")
    if spacing is not None:
        if not (is_number(spacing) and spacing >= 2 * radius):
            raise InputError(f"spacing = {spacing!r} m; must be at least 2 radii, {2 * radius:g} m")
        best = _rows(domain, radius, spacing, lattice)
        if best.nearest < 2 * radius * (1 - 1e-12):
            raise InputError(
                f"spacing = {spacing} m: whole rows along the period are {best.nearest:.6g} m "
                f"apart, less than 2 radii, {2 * radius:g} m; choose a larger spacing"
            )
    else:
        if not (is_number(concentration) and 0 < concentration < 1):
            raise InputError(f"concentration = {concentration!r}; must be between 0 and 1")
        per_floe = np.sqrt(0.75) if lattice == "hexagonal" else 1.0  # area / spacing²
        ideal = np.sqrt(np.pi * radius**2 / (per_floe * concentration))
        # edges leave bare strips, so the spacing that gives the concentration can be far below the
        # ideal
        trials = [
            _rows(domain, radius, ideal * factor, lattice, stretch)
            for factor in np.linspace(1.1, 0.6, 251)
            for stretch in np.linspace(0.95, 1.05, 11)
        ]
        target = concentration * domain.area / (np.pi * radius**2)
        fitting = [rows for rows in trials if rows.nearest >= 2 * radius * (1 - 1e-12)]
        best = min(
            fitting,
            key=lambda rows: (max(abs(rows.floes / target - 1), CLOSE_ENOUGH), rows.stretch),
            default=None,
        )
        if best is None or abs(best.floes / target - 1) > WHOLE_ROWS:
            nearest = 0.0 if best is None else best.floes / target * concentration
            raise InputError(
                f"concentration = {concentration:g}: no whole number of rows comes within 3 % "
                f"without overlap; nearest that fits: {nearest:.4g}"
            )
    x, y = _on_rows(best, domain)
    return Floes(x, y, radius, thickness)


def read_floes(
    path: str | Path, thickness: float | None = None, projection: str | None = None
) -> Floes:
    """Floes from a CSV or GeoJSON file.

    CSV: a header line with the columns x, y, radius or area, and, where wanted, thickness, u, v,
    motion, angle, angular_velocity, in SI units, in any order and case; other columns are not read.
    GeoJSON: Points with the property radius or area, or Polygons, which become discs of the same
    area about their centroid; the other columns are properties.

    Parameters
    ----------
    path : ends in .csv, .geojson or .json
    thickness : of all floes [m], for a file that has none
    projection : for a GeoJSON file in longitude and latitude, see `coast.from_geojson`

    Returns
    -------
    Floes, in the order of the file; they rotate where it has an angle or angular velocity

    Raises
    ------
    InputError
        naming file, row or feature, column and value.
    """
    path = Path(path)
    if thickness is not None and not (is_number(thickness) and thickness > 0):
        raise InputError(f"thickness = {thickness!r} m; must be greater than 0")
    suffix = path.suffix.lower()
    if suffix == ".csv":
        if projection is not None:
            raise InputError(
                f"{path}: a projection is for GeoJSON; x and y of a CSV file are in metres"
            )
        rows = _csv_rows(path)
    elif suffix in (".geojson", ".json"):
        rows = _geojson_rows(path, projection)
    else:
        raise InputError(f"{path}: must end in .csv, .geojson or .json")
    if not rows:
        return Floes([], [], [], [])
    columns = _floe_columns(path, rows)
    if (thickness is None) == ("thickness" not in columns):
        raise InputError(
            f"{path}: has no thickness; give one"
            if thickness is None
            else f"{path}: has a thickness of its own; give none beside it"
        )
    if "area" in columns:
        columns["radius"] = np.sqrt(columns.pop("area") / np.pi)
    columns.setdefault("thickness", np.float64(0.0 if thickness is None else thickness))
    rotation = "angle" in columns or "angular_velocity" in columns
    try:
        return Floes(**columns, rotation=rotation)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def relax(floes: Floes, domain: Domain, land: Land | None = None) -> float:
    """Press floes apart, in place, until none overlap or they are jammed.

    Floes with a prescribed motion stay where they are, velocities stay as they are.  At closed
    edges floes are moved wholly inside.

    Parameters
    ----------
    floes : changed are x and y of the active ones
    domain : its periodic and closed edges
    land : kept free, as in `scatter`

    Returns
    -------
    The largest overlap left, over the smaller radius: 0 unless the floes are jammed.

    Raises
    ------
    InputError
        for floes, a domain, or rings of land, that cannot be.
    """
    check_domain(domain)
    check_floes(floes)
    if not floes.active.any():
        return 0.0
    here = np.flatnonzero(floes.active)
    x, y, radius = floes.x[here], floes.y[here], floes.radius[here]
    free = (floes.motion[here] & (FIXED_X | FIXED_Y)) == 0
    shore = _barrier(land, domain, float(radius.min())).discs
    worst = press(x, y, radius, free, shore, domain, ("closed",))
    floes.x[here], floes.y[here] = x, y
    return worst


class _Rows(NamedTuple):
    """A lattice: steps [m], floes in even and odd rows, number of rows, shift of odd rows."""

    dx: float
    dy: float
    even: int
    odd: int
    rows: int
    shift: float
    stretch: float  # of the lattice along x against y, 0 if there is none

    @property
    def floes(self) -> int:
        return self.even * ((self.rows + 1) // 2) + self.odd * (self.rows // 2)

    @property
    def nearest(self) -> float:
        between = np.hypot(self.shift, self.dy) if self.rows > 1 else np.inf
        return min(self.dx if self.even > 1 else np.inf, between)


def _rows(
    domain: Domain, radius: float, spacing: float, lattice: str, stretch: float = 1.0
) -> _Rows:
    long_x, long_y = domain.x[1] - domain.x[0], domain.y[1] - domain.y[0]
    periodic_x, periodic_y = (length is not None for length in domain.period)
    hexagonal = lattice == "hexagonal"
    height = np.sqrt(0.75) if hexagonal else 1.0
    dx, dy = spacing * stretch, spacing * height / stretch
    if periodic_x:
        even = odd = max(1, round(long_x / dx))
        dx = long_x / even
    else:
        steps = (long_x - 2 * radius) / dx + 1e-9
        even = int(np.floor(steps)) + 1
        odd = int(np.floor(steps - 0.5)) + 1 if hexagonal else even
    if periodic_y:
        together = 2 if hexagonal else 1
        rows = together * max(1, round(long_y / dy / together))
        dy = long_y / rows
    else:
        rows = int(np.floor((long_y - 2 * radius) / dy + 1e-9)) + 1
    even, odd, rows = (max(0, number) for number in (even, odd, rows))
    return _Rows(dx, dy, even, odd, rows, dx / 2 if hexagonal else 0.0, abs(dx * height / dy - 1))


def _on_rows(rows: _Rows, domain: Domain) -> tuple[np.ndarray, np.ndarray]:
    counts = np.where(np.arange(rows.rows) % 2, rows.odd, rows.even)
    row = np.repeat(np.arange(rows.rows), counts)
    column = np.arange(len(row)) - np.repeat(np.cumsum(counts) - counts, counts)
    x = column * rows.dx + (row % 2) * rows.shift
    y = row * rows.dy
    if not len(x):
        return x, y
    # the middle of the lattice lies in the middle of the domain, also along a period
    return (
        x + (sum(domain.x) - x.min() - x.max()) / 2,
        y + (sum(domain.y) - y.min() - y.max()) / 2,
    )


def _csv_rows(path: Path) -> list[tuple[str, dict[str, object]]]:
    (_, first), *lines = csv_lines(path)
    header = [name.strip().lower() for name in first]
    for name in ("x", "y"):
        if name not in header:
            raise InputError(f"{path}: has no column {name!r}; {choose(name, header)}")
    for name in _FLOE_COLUMNS:
        if header.count(name) > 1:
            raise InputError(f"{path}: has {header.count(name)} columns {name!r}; must be one")
    rows = []
    for number, line in lines:
        if len(line) != len(header):
            raise InputError(f"{path}: row {number} has {len(line)} values; must be {len(header)}")
        rows.append((f"row {number}", dict(zip(header, line, strict=True))))
    return rows


def _geojson_rows(path: Path, projection: str | None) -> list[tuple[str, dict[str, object]]]:
    rows = []
    for number, (name, geometry, properties) in enumerate(read_features(path, projection)):
        row = {key.strip().lower(): value for key, value in properties.items()}
        if {"x", "y"} & row.keys():
            raise InputError(
                f"{name}: property 'x' or 'y' beside a geometry; must be one or the other"
            )
        if geometry.geom_type in ("Polygon", "MultiPolygon"):
            if {"radius", "area"} & row.keys():
                raise InputError(
                    f"{name}: a polygon has its own area; radius and area are for points"
                )
            row["area"] = geometry.area
        elif geometry.geom_type != "Point":
            raise InputError(f"{name}: {geometry.geom_type}; must be a Point or a Polygon")
        row["x"], row["y"] = geometry.centroid.x, geometry.centroid.y
        rows.append((f"feature {number}", row))
    return rows


_FLOE_COLUMNS = ("x", "y", "radius", "area", "thickness", "u", "v", "motion") + (
    "angle",
    "angular_velocity",
)
_FARTHEST = {"x": FARTHEST, "y": FARTHEST, "radius": FARTHEST, "area": FARTHEST**2}  # [m], [m²]


def _floe_columns(path: Path, rows: list[tuple[str, dict[str, object]]]) -> dict[str, np.ndarray]:
    """The columns that floes are made of, as numbers; all rows must have the same."""
    names = [name for name in _FLOE_COLUMNS if any(name in row for _, row in rows)]
    if ("radius" in names) == ("area" in names):
        raise InputError(f"{path}: must have a column 'radius' or 'area', and not both")
    columns: dict[str, list[float]] = {name: [] for name in names}
    for place, row in rows:
        for name in names:
            value = row.get(name)
            try:
                number = number_in(value)
                right = "must be a finite number"
                if np.isfinite(number) and abs(number) > _FARTHEST.get(name, np.inf):
                    right = f"must be within {_FARTHEST[name]:g}"
                elif name in ("radius", "area", "thickness") and np.isfinite(number):
                    right = "must be greater than 0" if number <= 0 else ""
                elif np.isfinite(number):
                    right = ""
            except (TypeError, ValueError):
                right = "must be a number"
            if right:
                raise InputError(f"{path}: {place}, column {name!r}: {value!r} {right}")
            columns[name].append(number)
    return {name: np.array(values) for name, values in columns.items()}


class _Barrier(NamedTuple):
    """Land: its area in the domain [m²], discs (k, 3) of x, y, radius that guard it, its place."""

    area: float
    discs: np.ndarray
    geometry: object
    grid: Grid | None
    domain: Domain

    def holds(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Whether points lie on land."""
        inside = np.zeros(len(x), bool)
        x, y = self.domain.brought_back(x, y)
        if self.geometry is not None:
            import shapely

            inside |= shapely.contains_xy(self.geometry, x, y)
        if self.grid is not None:
            cell = self.grid.locate(x, y)
            inside |= (cell >= 0) & ~self.grid.wet[cell]
        return inside


def _barrier(
    land: Land | None, domain: Domain, smallest: float, grid: Grid | None = None
) -> _Barrier:
    """What floes of radius `smallest` and more must keep clear of."""
    area, geometry, segments = 0.0, None, []
    fixed = [np.zeros((0, 3))]
    if isinstance(land, Grid):
        if grid is not None:
            raise InputError(
                "land: the grid's own dry cells are land; give a Coast or rings beside it"
            )
        grid, land = land, None
    if grid is not None and grid.wet.all():
        grid = None
    if isinstance(land, Coast):
        floes = land.floes
        fixed.append(np.stack([floes.x, floes.y, floes.radius], axis=1))
    if land is not None:
        import shapely

        geometry = land_geometry(land.polygons if isinstance(land, Coast) else land, domain)
        shapely.prepare(geometry)
        box = shapely.box(domain.x[0], domain.y[0], domain.x[1], domain.y[1])
        area += geometry.intersection(box).area
        for ring in shapely.get_rings(shapely.get_parts(geometry)):
            points = shapely.get_coordinates(ring)
            segments.append(np.concatenate([points[:-1], points[1:]], axis=1))
    if grid is not None:
        area += float(np.sum(_area_inside(grid, domain)[~grid.wet]))
        segments.append(_dry_edges(grid))
    if segments:
        fixed.append(_guards(np.concatenate(segments), domain, smallest))
    return _Barrier(area, np.concatenate(fixed), geometry, grid, domain)


def _guards(segments: np.ndarray, domain: Domain, smallest: float) -> np.ndarray:
    """Small discs along a shore such that a floe that overlaps none of them does not cross it.

    Between two points a distance 2q apart a disc of radius r could reach √(r² + q²) − r ≤ q²/2r
    across: that is the radius of the guards.
    """
    step = SHORE_STEP * smallest
    west, south, east, north = segments.T
    low = np.minimum(west, east), np.minimum(south, north)
    high = np.maximum(west, east), np.maximum(south, north)
    near = np.ones(len(segments), bool)
    for axis, (first, last) in enumerate((domain.x, domain.y)):
        margin = (
            last - first
        )  # floes reach less far across an edge, and nothing is lost by more guards
        near &= (high[axis] > first - margin) & (low[axis] < last + margin)
    segments = segments[near]
    lengths = np.hypot(segments[:, 2] - segments[:, 0], segments[:, 3] - segments[:, 1])
    counts = np.maximum(1, np.ceil(lengths / step).astype(int)) + 1
    share = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    share = (share / np.repeat(counts - 1, counts))[:, None]
    starts, ends = (np.repeat(part, counts, axis=0) for part in (segments[:, :2], segments[:, 2:]))
    points = starts + share * (ends - starts)
    return np.column_stack([points, np.full(len(points), (step / 2) ** 2 / (2 * smallest))])


def _dry_edges(grid: Grid) -> np.ndarray:
    """Edges of dry cells that are not between two dry cells, shape (k, 4): x, y of both ends."""
    nodes = grid.face_nodes[~grid.wet]
    following = following_nodes(nodes)
    pairs = np.sort(np.stack([nodes[nodes >= 0], following[nodes >= 0]], axis=1), axis=1)
    pairs, count = np.unique(pairs, axis=0, return_counts=True)
    a, b = pairs[count == 1].T
    return np.stack([grid.node_x[a], grid.node_y[a], grid.node_x[b], grid.node_y[b]], axis=1)


def _area_inside(grid: Grid, domain: Domain) -> np.ndarray:
    """Area of each cell inside the domain [m²], shape (grid.size,)."""
    import shapely

    corner_x, corner_y = grid.corner_x, grid.corner_y
    low = np.minimum(corner_x.min(axis=1) - domain.x[0], corner_y.min(axis=1) - domain.y[0])
    high = np.minimum(domain.x[1] - corner_x.max(axis=1), domain.y[1] - corner_y.max(axis=1))
    area = np.array(grid.area)
    cut = np.minimum(low, high) < 0
    rings = np.stack([corner_x[cut], corner_y[cut]], axis=2)
    box = (domain.x[0], domain.y[0], domain.x[1], domain.y[1])
    area[cut] = shapely.area(shapely.clip_by_rect(shapely.polygons(rings), *box))
    return area


def _field(name: str, values: ArrayLike, grid: Grid) -> np.ndarray:
    values = unmasked(values)
    if values.ndim and values.size != grid.size:
        raise InputError(
            f"{name} has shape {values.shape}; must be one number or {grid.size} values, one a cell"
        )
    return np.broadcast_to(flat(name, values, grid.shape) if values.ndim else values, grid.size)


def _generator(seed: int) -> np.random.Generator:
    if not isinstance(seed, (int, np.integer)) or seed < 0:
        raise InputError(f"seed = {seed!r}; must be a whole number, at least 0")
    return np.random.Generator(np.random.PCG64(seed))


def _draw_area(
    sizes: Sizes, area: float, rng: np.random.Generator, strict: bool = True
) -> np.ndarray:
    """Radii whose discs have a total area, within half a floe, and if `strict` within 0.5 %."""
    mean = sizes.mean_area()
    radius = np.zeros(0)
    total = np.zeros(1)
    while total[-1] < area:
        more = int(np.ceil(1.02 * (area - total[-1]) / mean)) + 8
        radius = np.concatenate([radius, sizes.draw(more, rng)])
        total = np.concatenate([[0.0], np.cumsum(np.pi * radius**2)])
    count = int(np.argmin(abs(total - area)))
    if not strict or abs(total[count] - area) <= CLOSE_ENOUGH * area:
        return radius[:count]
    # few floes: let the last one fill what the others leave
    for others in (count, max(count - 1, 0)):
        last = sizes.draw(1000, rng)
        error = abs(total[others] + np.pi * last**2 - area)
        best = int(np.argmin(error))
        if error[best] <= CLOSE_ENOUGH * area:
            return np.append(radius[:others], last[best])
    raise InputError(
        f"no number of floes of these sizes comes within 0.5 % of {area:.4g} m² ({count} floes: "
        f"{total[count] / area - 1:+.1%}); give a count, or smaller floes"
    )


def _check_fit(radius: np.ndarray, domain: Domain) -> None:
    largest = float(radius.max(initial=0.0))
    for axis, length in zip("xy", domain.period, strict=True):
        low, high = getattr(domain, axis)
        side, diameters = high - low, 2 if length is None else 4
        if largest * diameters * (1 + SPARE) / 2 > side / 2:
            raise InputError(
                f"domain.{axis}: {side:g} m; must be at least {diameters} radii of the largest "
                f"floe, {largest * diameters:g} m"
            )


class _Ground(NamedTuple):
    """A raster over the domain, along a Hilbert curve: cell k of the curve has column[k], row[k].

    `group` is the grid cell that holds the raster cell's centre (0 without a grid), -1 where no ice
    may be; `ice` is the area of ice wanted there [m²]; `clear` the distance to land [m], or None
    without land.
    """

    shape: tuple[int, int]
    origin: tuple[float, float]
    step: tuple[float, float]
    column: np.ndarray
    row: np.ndarray
    group: np.ndarray
    ice: np.ndarray
    clear: np.ndarray | None
    barrier: _Barrier
    grid: Grid | None
    period: tuple[float | None, float | None]

    def group_of(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """The group of any points, -1 where no ice may be."""
        group = np.zeros(len(x), np.int64) if self.grid is None else self.grid.locate(x, y)
        # Where a seam is not straight, a place beyond the last cell is in one at the other end.
        shifts = ((0.0,) if length is None else (0.0, length, -length) for length in self.period)
        for along, across in itertools.product(*shifts):
            left = group < 0
            if self.grid is not None and left.any():
                group[left] = self.grid.locate(x[left] + along, y[left] + across)
        return np.where(self.barrier.holds(x, y), -1, group)

    def centres(self, k: np.ndarray) -> np.ndarray:
        """x, y of raster cells [m], shape (len(k), 2)."""
        corner = np.stack([self.column[k], self.row[k]], axis=1)
        return np.array(self.origin) + (corner + 0.5) * self.step


def _ground(domain: Domain, barrier: _Barrier, n: int, grid: Grid | None = None) -> _Ground:
    from scipy import ndimage

    cells = max(64, 2 * n)
    if grid is not None:  # fine enough to see the cells, as far as memory is no matter
        cells = max(cells, min(1_000_000, int(4 * domain.area / grid.area.min())))
    side = np.sqrt(domain.area / cells)
    long_x, long_y = domain.x[1] - domain.x[0], domain.y[1] - domain.y[0]
    nx, ny = max(1, round(long_x / side)), max(1, round(long_y / side))
    column, row = np.meshgrid(np.arange(nx), np.arange(ny))
    along = _hilbert(column.ravel(), row.ravel(), int(max(nx, ny) - 1).bit_length())
    order = np.argsort(along, kind="stable")
    column, row = column.ravel()[order], row.ravel()[order]
    step = long_x / nx, long_y / ny
    n = len(column)
    origin, no_group = (domain.x[0], domain.y[0]), np.zeros(n, np.int64)
    ground = _Ground(
        (ny, nx), origin, step, column, row, no_group, np.zeros(n), None, barrier, grid,
        domain.period,
    )  # fmt: skip
    x, y = ground.centres(np.arange(n)).T.copy()
    clear, blocked = None, barrier.holds(x, y)
    if blocked.any():
        free = np.ones((ny, nx), bool)
        free[row[blocked], column[blocked]] = False
        clear = ndimage.distance_transform_edt(free, sampling=step[::-1])[row, column]
    ground = ground._replace(group=ground.group_of(x, y), clear=clear)
    if grid is None:
        return ground
    # the curve visits a grid cell once, so that a cell shares floes with two others only
    first = np.full(grid.size + 1, n)
    np.minimum.at(first, ground.group, np.arange(n))
    first[-1] = n  # -1: where no ice may be
    order = np.argsort(first[ground.group], kind="stable")
    along_curve = ("column", "row", "group", "ice") + (() if clear is None else ("clear",))
    return ground._replace(**{name: getattr(ground, name)[order] for name in along_curve})


def _spread(ground: _Ground, grid: Grid, ice: np.ndarray) -> None:
    """Spread the ice of each grid cell [m²] over its raster cells."""
    from scipy.spatial import cKDTree

    here = np.flatnonzero(ground.group >= 0)
    count = np.bincount(ground.group[here], minlength=grid.size)
    ground.ice[here] = (ice / np.maximum(count, 1))[ground.group[here]]
    missed = np.flatnonzero((count == 0) & (ice > 0))
    if not len(missed):
        return
    # cells smaller than the raster's give their ice to the nearest raster cell that has some
    some = here[ground.ice[here] > 0]
    if not len(some):
        raise InputError("area_fraction: the cells with ice are too small beside the domain")
    nearest = cKDTree(ground.centres(some)).query(
        np.stack([grid.x[missed], grid.y[missed]], axis=1)
    )
    np.add.at(ground.ice, some[nearest[1]], ice[missed])


@jit
def _hilbert(column, row, order):
    """Place along the Hilbert curve of a square of 2**order cells a side."""
    place = np.empty(column.size, np.int64)
    for k in range(column.size):
        x, y, d = column[k], row[k], 0
        for level in range(order - 1, -1, -1):
            s = 1 << level
            right, upper = (x >> level) & 1, (y >> level) & 1
            d += s * s * ((3 * right) ^ upper)
            x &= s - 1
            y &= s - 1
            if upper == 0:
                if right == 1:
                    x, y = s - 1 - x, s - 1 - y
                x, y = y, x
        place[k] = d
    return place


def _settle(
    radius: np.ndarray,
    ground: _Ground,
    domain: Domain,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Pack, and lay floes that found no room elsewhere nearby: x, y, grid cell, and who is left."""
    from scipy.spatial import cKDTree

    x, y, group = _pack(radius, ground, domain, rng)
    free = np.ones(len(x), bool)
    left = _unplaced(x, y, radius, ground.barrier, domain) > 0
    for _ in range(ROUNDS):
        # many floes without room are no bad luck
        if not left.any() or np.count_nonzero(left) > max(10, 0.1 * len(left)):
            break
        for k in np.flatnonzero(left):
            clear = ground.ice > 0
            if ground.clear is not None:
                clear &= ground.clear >= radius[k]
            place = np.flatnonzero(clear)
            if not len(place):
                continue
            at = ground.centres(place)
            near = cKDTree(at).query([x[k], y[k]], k=min(64, len(at)))[1]
            x[k], y[k] = at[rng.choice(np.atleast_1d(near))]
        press(
            x,
            y,
            radius,
            free,
            ground.barrier.discs,
            domain,
            EDGES_KEPT,
            rng=rng,
            idle=ground.grid is None,
        )
        left = _unplaced(x, y, radius, ground.barrier, domain) > 0
    return x, y, group, left


def _thin_out(
    x: np.ndarray, y: np.ndarray, radius: np.ndarray, ground: _Ground, domain: Domain
) -> np.ndarray:
    """Take floes away, the worst first, and press the others apart: which are gone in the end."""
    gone = np.zeros(len(x), bool)
    while True:
        kept = np.flatnonzero(~gone)
        here = x[kept], y[kept], radius[kept]
        bad = _unplaced(*here, ground.barrier, domain)
        if not bad.any():
            return gone
        gone[kept[(bad > 0) & (bad >= np.median(bad[bad > 0]))]] = True
        kept = np.flatnonzero(~gone)
        here, free = (x[kept], y[kept], radius[kept]), np.ones(len(kept), bool)
        if len(kept):
            press(*here, free, ground.barrier.discs, domain, EDGES_KEPT)
        x[kept], y[kept] = here[:2]


def _pack(
    radius: np.ndarray,
    ground: _Ground,
    domain: Domain,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places of floes, and the grid cell that each was laid in; radii are swapped in place."""
    n = len(radius)
    x, y, group = np.empty(n), np.empty(n), np.zeros(n, np.int64)
    if n == 0:
        return x, y, group
    size_class = np.floor(np.log(radius.max() / radius) / np.log(CLASS) + 1e-9).astype(int)
    laid = np.zeros(0, np.int64)
    classes = np.unique(size_class)
    for number in classes:
        new = np.flatnonzero(size_class == number)
        x[new], y[new], group[new] = _lay(
            radius[new], ground, x[laid], y[laid], radius[laid], domain, rng
        )
        laid = np.concatenate([laid, new])
        here = x[laid], y[laid], radius[laid]
        free = np.ones(len(laid), bool)
        shore = ground.barrier.discs
        if number != classes[-1]:
            press(*here, free, shore, domain, EDGES_KEPT, sweeps=100)
        else:
            press(*here, free, shore, domain, EDGES_KEPT, rng=rng, idle=ground.grid is None)
        x[laid], y[laid], radius[laid] = here
    return x, y, group


def _lay(
    radius: np.ndarray,
    ground: _Ground,
    other_x: np.ndarray,
    other_y: np.ndarray,
    other_radius: np.ndarray,
    domain: Domain,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """String floes along the curve, over the ice that the floes laid before have left."""
    ny, nx = ground.shape
    taken = np.zeros((ny, nx), bool)
    periodic = tuple(length is not None for length in domain.period)
    _cover(
        taken, (other_x - domain.x[0]) / ground.step[0], (other_y - domain.y[0]) / ground.step[1],
        other_radius, *ground.step, *periodic,
    )  # fmt: skip
    taken = taken[ground.row, ground.column]
    here = ground.group >= 0
    group = ground.group[here]
    ice = np.bincount(group, ground.ice[here])
    left = np.maximum(ice - np.bincount(group, taken[here] * np.prod(ground.step)), 0.0)
    open_ice = np.where(here & ~taken, ground.ice, 0.0)
    share = left / np.maximum(np.bincount(group, open_ice[here]), np.finfo(float).tiny)
    weight = np.zeros(len(taken))
    weight[here] = open_ice[here] * share[group]
    if ground.clear is not None:
        roomy = weight * (ground.clear >= np.median(radius))
        weight = roomy if roomy.any() else weight
    if not weight.any():
        weight = ground.ice
    reached = np.cumsum(weight)
    area = radius**2
    middle = (np.cumsum(area) - area / 2) / area.sum() * reached[-1]
    place = np.searchsorted(reached, middle, side="right")
    place = np.minimum(place, np.flatnonzero(weight)[-1])
    x, y = ground.centres(place).T.copy()
    moved = np.zeros(len(place), bool)
    for _ in range(4):  # off the raster's rows, but within the same cell and off the land
        off_x, off_y = 2.0 * rng.random((2, len(place))) - 1.0
        new_x, new_y = x + off_x * ground.step[0], y + off_y * ground.step[1]
        good = ~moved & (ground.group_of(new_x, new_y) == ground.group[place])
        x[good], y[good], moved[good] = new_x[good], new_y[good], True
    return x, y, np.maximum(ground.group[place], 0)


@jit
def _cover(taken, x, y, radius, step_x, step_y, periodic_x, periodic_y):
    """Mark raster cells whose centres lie in a disc; x and y in raster cells."""
    ny, nx = taken.shape
    for k in range(x.size):
        reach_x, reach_y = radius[k] / step_x, radius[k] / step_y
        for row in range(
            int(np.ceil(y[k] - reach_y - 0.5)), int(np.floor(y[k] + reach_y - 0.5)) + 1
        ):
            if not periodic_y and (row < 0 or row >= ny):
                continue
            dy = (row + 0.5 - y[k]) / reach_y
            half = reach_x * np.sqrt(max(0.0, 1.0 - dy * dy))
            for column in range(
                int(np.ceil(x[k] - half - 0.5)), int(np.floor(x[k] + half - 0.5)) + 1
            ):
                if periodic_x or (column >= 0 and column < nx):
                    taken[row % ny, column % nx] = True


def _unplaced(
    x: np.ndarray, y: np.ndarray, radius: np.ndarray, barrier: _Barrier, domain: Domain
) -> np.ndarray:
    """How bad the place of each floe is, 0 for those that may stay.

    If the others are taken away, none of those that stay overlap or lie on land.  Of a pair it is
    the smaller floe that goes, the worst pair first; bad is the overlap over its radius, and
    infinite on land.
    """
    n = len(x)
    if n == 0:
        return np.zeros(0)
    left = barrier.holds(x, y)
    all_x, all_y, size = (
        np.concatenate(pair) for pair in zip((x, y, radius), barrier.discs.T, strict=True)
    )
    for centre, (low, high), length in zip(
        (x, y), (domain.x, domain.y), domain.period, strict=True
    ):
        if length is None:
            left |= (centre - radius < low) | (centre + radius > high)
    bad = np.where(left, np.inf, 0.0)
    _, i, j, _ = find_pairs(all_x, all_y, size, domain.period)
    i, j = some_free(i, j, np.arange(len(size)) < n)
    overlap = size[i] + size[j] - distances(all_x, all_y, i, j, domain)
    for k in np.argsort(-overlap, kind="stable"):
        if overlap[k] <= 0:
            break
        a, b = (i[k], j[k]) if size[i[k]] < size[j[k]] else (j[k], i[k])
        smaller, larger = (a, b) if a < n else (b, a)
        if bad[smaller] == 0 and (larger >= n or bad[larger] == 0):
            bad[smaller] = overlap[k] / size[smaller]
    return bad
