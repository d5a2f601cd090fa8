"""Initial positions of floes: scattered, on a lattice, from gridded fields, or from files.

The algorithm for scattered floes is in laying.py, the land that they keep clear of in barrier.py.
"""

from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from floebmi.barrier import Land, area_inside, barrier_of
from floebmi.boundaries import Domain, check_domain
from floebmi.coast import read_features
from floebmi.errors import InputError, check_word, choose, warn
from floebmi.files import path_of
from floebmi.floes import FIXED_X, FIXED_Y, Floes, check_floes
from floebmi.grid import Grid, check_grid
from floebmi.laying import ground_of, settle, spread, thin_out
from floebmi.neighbours import sort_in_space
from floebmi.pressing import SPARE, press
from floebmi.quantities import FARTHEST, check_length, flat, is_number, number_in, unmasked
from floebmi.sampling import check_images
from floebmi.sizes import Sizes, check_sizes, csv_lines

CLOSE_ENOUGH = 0.005  # accepted relative error of the concentration
WHOLE_ROWS = 0.03  # accepted relative error of the concentration of a lattice
HEIGHT = {"hexagonal": np.sqrt(0.75), "square": 1.0}  # of a row of a lattice, in spacings


class IceNotPlaced(UserWarning):
    """Warning: part of the ice in a field could not be placed as floes."""


def scatter(
    domain: Domain,
    sizes: Sizes,
    concentration: float | None = None,
    count: int | None = None,
    thickness: float = 1.0,
    seed: int = 0,
    land: Land | None = None,
) -> Floes:
    """Floes in random places without overlap.

    The ice is spread evenly over the domain, up to within a radius of its edges: floes that would
    reach over an edge that is not periodic are pushed back until they touch it, so that even in
    loose packs some floes lie along the edges.

    Parameters
    ----------
    domain : floes may lie across its periodic edges, and lie wholly inside the others
    sizes : floe size distribution
    concentration : area of floes over the area of the domain that is not land [1], met within 0.5 %; 0 is no ice.
        With periodic edges, or with thousands of floes, about 0.85 is reached for any sizes and 0.88 for
        radii that differ by a factor of 2; a few hundred floes between other edges reach some hundredths
        less, and whether equal floes do depends on the seed
    count : number of floes, instead of a concentration
    thickness : thickness of all floes [m]
    seed : seed of the random numbers; the same seed gives the same floes, bit for bit
    land : land and shore to keep free: a `Coast`, a `Grid` (its dry cells), or rings as in
        `from_polygons`; a coast's own floes are not part of the result

    Returns
    -------
    Floes, numbered in spatial order, so that neighbours have similar numbers

    Raises
    ------
    InputError
        if the floes do not fit, or no number of drawn floes comes within 0.5 % of the concentration.

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
        raise InputError("give either concentration or count")
    rng = _generator(seed)
    check_length("thickness", thickness)
    barrier = barrier_of(land, domain, sizes.range[0])
    room = domain.area - barrier.area
    if room <= 1e-9 * domain.area:
        raise InputError("land covers the whole domain; must leave room for floes")
    if count is not None:
        if not is_number(count) or int(count) != count or count < 0:
            raise InputError(f"count = {count!r}; must be a whole number, at least 0")
        _refuse_too_full(
            f"count = {count}", np.pi * sizes.range[0] ** 2 * count / room, "at least "
        )
        radius = sizes.draw(int(count), rng)
    elif is_number(concentration) and concentration == 0:
        radius = np.empty(0)
    else:
        _check_concentration(concentration)
        radius = _draw_area(sizes, concentration * room, rng)
    asked = f"concentration = {concentration:g}" if count is None else f"count = {count}"
    filled = float(np.pi * np.sum(radius**2)) / room
    _refuse_too_full(asked, filled)
    _check_fit(radius, domain)
    ground = ground_of(barrier, len(radius))
    sea = ground.group >= 0
    if not sea.any():
        raise InputError(f"land leaves {room:.4g} m², too little to find a place for floes")
    ground.ice[sea] = filled * room / np.count_nonzero(sea)
    x, y, _, left = settle(radius, ground, rng)
    if left.any():
        raise InputError(
            f"{asked}: the floes would cover {filled:.3g} of the area, and {np.count_nonzero(left)} of {len(left)} floes find no room; "
            "choose less ice, smaller floes, or a wider range of sizes"
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
    """Floes that represent the ice of gridded fields.

    Floes are drawn until their area equals the ice area inside the domain.  Each cell gets floes for its own
    ice area, to within about half a floe, and the remainder is carried to a neighbouring cell.  Floes do not
    reach into dry cells or land.  The total area is met, the volume only approximately: cells at
    `max_concentration`, where discs cannot pack more densely, and cells beside land pass ice on to looser
    cells, where floes have another thickness (labrador-sea: cells below 0.7 get a fifth more, denser ones
    5 % less, and the volume is 2 % short).

    Floes belong to the cell of their centre; up to half of one may lie in the next cell.  Parts of the domain
    outside the grid are open water, into which floes of the outermost cells may reach.  Where a pack jams, as
    equal floes often do above 0.8, a few floes are left out until the others fit.

    Parameters
    ----------
    grid : grid of the fields; its dry cells are land
    area_fraction : ice area fraction of each cell [1], shape (grid.size,) or grid.shape, or one number
    thickness : thickness of the ice in each cell [m] (not its mean over ice and water), same shapes, or one
        number; a floe gets the thickness of the cell that it was drawn for
    sizes : floe size distribution
    domain : domain of the floes; default: the box around the grid's nodes, with inactive edges
    seed : seed of the random numbers; the same seed gives the same floes, bit for bit
    max_concentration : upper limit of the area fraction [1]; cells with more ice get only this much, because
        discs do not pack much denser than 0.85 (at most 0.88)
    land : further land to keep free, as in `scatter`

    Warns
    -----
    IceNotPlaced
        with the area left out because of `max_concentration`, the area of floes that found no room, or an
        ice area of less than half a floe.

    Returns
    -------
    Floes, numbered in spatial order

    Raises
    ------
    InputError
        for an unusable value in a wet cell, with its index, and for a period shorter than the grid.
    """
    check_sizes(sizes)
    check_grid("grid", grid)
    if domain is None:
        domain = Domain(
            (float(grid.node_x.min()), float(grid.node_x.max())),
            (float(grid.node_y.min()), float(grid.node_y.max())),
        )
    check_domain(domain)
    if not (is_number(max_concentration) and 0 < max_concentration <= 0.88):
        raise InputError(f"max_concentration = {max_concentration!r}; must be in (0, 0.88]")
    fraction = _field("area_fraction", area_fraction, grid)
    depth = _field("thickness", thickness, grid)
    _check_ice(fraction, depth, grid)
    rng = _generator(seed)
    fraction = np.where(grid.wet, fraction, 0.0)
    check_images(grid, domain.period)
    inside = area_inside(grid, domain)
    wanted = float(np.sum(fraction * inside))
    ice = np.minimum(fraction, max_concentration) * inside
    radius = _draw_area(sizes, float(ice.sum()), rng, strict=False)
    _check_fit(radius, domain)
    barrier = barrier_of(land, domain, sizes.range[0], grid)
    ground = ground_of(barrier, len(radius), grid)
    spread(ground, ice)
    x, y, cell, left = settle(radius, ground, rng)
    if left.any():
        left = thin_out(x, y, radius, ground)
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
        warn(f"ice not placed: {', '.join(told)}; of {wanted:.4g} m²", IceNotPlaced)
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

    Rows run along x; in a hexagonal lattice they are √3/2 spacings apart, and every other row is
    shifted.  Between edges that are not periodic the lattice is centred, with all floes wholly
    inside.  In a periodic direction the lattice is stretched or squeezed to the nearest whole number of
    rows or columns (hexagonal, along y: an even one), and to meet a concentration, by up to a tenth along x relative to y.

    Parameters
    ----------
    domain : domain to fill; its size and periodic edges matter
    radius : radius of all floes [m]
    spacing : distance between neighbouring centres [m], at least 2 radii
    concentration : area of floes over that of the domain [1], instead of a spacing; met as closely
        as whole rows allow, and within 3 %
    lattice : "hexagonal" or "square"
    thickness : thickness of all floes [m]

    Returns
    -------
    Floes, row by row from the south-west

    Raises
    ------
    InputError
        if floes would overlap, if none fits, or if no whole number of rows gives the concentration
        (the message gives the nearest).
    """
    check_domain(domain)
    check_word("lattice", lattice, HEIGHT)
    if (spacing is None) == (concentration is None):
        raise InputError("give either concentration or spacing")
    check_length("radius", radius)
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
        best = _rows_of_concentration(domain, radius, concentration, lattice)
    x, y = _on_rows(best, domain)
    if not len(x):
        raise InputError(
            f"radius = {radius:g} m; no floe has room in the domain; choose a smaller one"
        )
    return Floes(x, y, radius, thickness)


def read_floes(
    path: str | Path, thickness: float | None = None, projection: str | None = None
) -> Floes:
    """Floes from a CSV or GeoJSON file.

    CSV: a header line with the columns x, y, radius or area, and optionally thickness, u, v,
    motion, angle, angular_velocity, in SI units, in any order and case; other columns are ignored.
    GeoJSON: Points with the property radius or area, or Polygons, which become discs of the same
    area about their centroid; the other columns are properties.

    Parameters
    ----------
    path : file whose name ends in .csv, .geojson or .json
    thickness : thickness of all floes [m], for a file that has none
    projection : map projection for a GeoJSON file in longitude and latitude, see `coast.from_geojson`

    Returns
    -------
    Floes, in the order of the file; they rotate if it has an angle or angular velocity

    Raises
    ------
    InputError
        naming file, row or feature, column and value.
    """
    path = path_of("path", path)
    if thickness is not None:
        check_length("thickness", thickness)
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
    """Push floes apart, in place, until none overlap or they are jammed.

    Floes with a prescribed motion are not moved, and velocities are not changed.  At closed
    edges floes are moved wholly inside; across inactive edges they may be pushed out, and a floe whose
    centre lies outside leaves when a run begins.

    Parameters
    ----------
    floes : the floes; x and y of the active ones are changed
    domain : their domain; its periodic and closed edges matter
    land : land to keep free, as in `scatter`

    Returns
    -------
    The largest remaining overlap over the smaller radius [1]: 0 unless the floes are jammed

    Raises
    ------
    InputError
        for invalid floes, domain or land.
    """
    check_domain(domain)
    check_floes(floes)
    if not floes.active.any():
        return 0.0
    here = np.flatnonzero(floes.active)
    x, y, radius = floes.x[here], floes.y[here], floes.radius[here]
    free = (floes.motion[here] & (FIXED_X | FIXED_Y)) == 0
    shore = barrier_of(land, domain, float(radius.min())).discs
    worst = press(x, y, radius, free, shore, domain, ("closed",))
    floes.x[here], floes.y[here] = x, y
    return worst


class _Rows(NamedTuple):
    """A lattice, as rows of floes along x."""

    dx: float  # from floe to floe in a row [m]
    dy: float  # from row to row [m]
    even: int  # floes in an even row
    odd: int
    rows: int
    shift: float  # of the odd rows [m]
    stretch: float  # of the lattice along x against y, 0 if there is none

    @property
    def floes(self) -> int:
        return self.even * ((self.rows + 1) // 2) + self.odd * (self.rows // 2)

    @property
    def nearest(self) -> float:
        """Distance between the nearest centres [m]."""
        between = np.hypot(self.shift, self.dy) if self.rows > 1 else np.inf
        return min(self.dx if self.even > 1 else np.inf, between)


def _rows(
    domain: Domain, radius: float, spacing: float, lattice: str, stretch: float = 1.0
) -> _Rows:
    long_x, long_y = domain.x[1] - domain.x[0], domain.y[1] - domain.y[0]
    periodic_x, periodic_y = (length is not None for length in domain.period)
    hexagonal, height = lattice == "hexagonal", HEIGHT[lattice]
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


def _rows_of_concentration(
    domain: Domain, radius: float, concentration: float | None, lattice: str
) -> _Rows:
    """The fitting lattice whose concentration is nearest to the given one, stretched as little as that allows."""
    _check_concentration(concentration)
    ideal = np.sqrt(np.pi * radius**2 / (HEIGHT[lattice] * concentration))
    # edges leave bare strips, so the spacing that gives the concentration can be far below the ideal
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
    return best


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


_FLOE_COLUMNS = (
    "x", "y", "radius", "area", "thickness", "u", "v", "motion", "angle", "angular_velocity",
)  # fmt: skip
_FARTHEST = {"x": FARTHEST, "y": FARTHEST, "radius": FARTHEST, "area": FARTHEST**2}  # [m], [m²]


def _floe_columns(path: Path, rows: list[tuple[str, dict[str, object]]]) -> dict[str, np.ndarray]:
    """The columns from which floes are made, as numbers; all rows must have the same columns."""
    names = [name for name in _FLOE_COLUMNS if any(name in row for _, row in rows)]
    if ("radius" in names) == ("area" in names):
        raise InputError(f"{path}: must have a column 'radius' or 'area', and not both")
    columns: dict[str, list[float]] = {name: [] for name in names}
    for place, row in rows:
        for name in names:
            columns[name].append(_floe_number(name, row.get(name), f"{path}: {place}"))
    return {name: np.array(values) for name, values in columns.items()}


def _floe_number(name: str, value: object, where: str) -> float:
    try:
        number = number_in(value)
    except (TypeError, ValueError):
        right = "must be a number"
    else:
        if not np.isfinite(number):
            right = "must be a finite number"
        elif abs(number) > _FARTHEST.get(name, np.inf):
            right = f"must be within {_FARTHEST[name]:g}"
        elif number <= 0 and name in ("radius", "area", "thickness"):
            right = "must be greater than 0"
        else:
            return number
    raise InputError(f"{where}, column {name!r}: {value!r} {right}")


def _field(name: str, values: ArrayLike, grid: Grid) -> np.ndarray:
    values = unmasked(values)
    if values.ndim and values.size != grid.size:
        raise InputError(
            f"{name} has shape {values.shape}; must be one number or {grid.size} values, one per cell"
        )
    return np.broadcast_to(flat(name, values, grid.shape) if values.ndim else values, grid.size)


def _check_ice(fraction: np.ndarray, depth: np.ndarray, grid: Grid) -> None:
    """Refuse a wet cell whose area fraction is not between 0 and 1, or whose ice has no thickness."""
    share = (fraction >= 0) & (fraction <= 1)
    thick = (depth > 0) & np.isfinite(depth) | ~(fraction > 0)
    for name, values, good, right in (
        ("area_fraction", fraction, share, "must be between 0 and 1"),
        ("thickness", depth, thick, "must be greater than 0 where there is ice"),
    ):
        cells = np.flatnonzero(~good & grid.wet)
        if cells.size:
            raise InputError(f"{name} of cell {cells[0]} = {values[cells[0]]}; {right}")


def _check_concentration(concentration: object) -> None:
    if not (is_number(concentration) and 0 < concentration < 1):
        raise InputError(f"concentration = {concentration!r}; must be between 0 and 1")


def _refuse_too_full(asked: str, filled: float, least: str = "") -> None:
    if filled > 0.95:
        raise InputError(
            f"{asked}: the floes would cover {least}{filled:.3g} of the room; about 0.85 can be packed"
        )


def _generator(seed: int) -> np.random.Generator:
    if not isinstance(seed, (int, np.integer)) or seed < 0:
        raise InputError(f"seed = {seed!r}; must be a whole number, at least 0")
    return np.random.Generator(np.random.PCG64(seed))


def _draw_area(
    sizes: Sizes, area: float, rng: np.random.Generator, strict: bool = True
) -> np.ndarray:
    """Radii whose discs have the given total area, within half a floe, and if `strict` within 0.5 %."""
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
    # few floes: choose the last one to fill the remaining area
    for others in (count, max(count - 1, 0)):
        last = sizes.draw(1000, rng)
        error = abs(total[others] + np.pi * last**2 - area)
        best = int(np.argmin(error))
        if error[best] <= CLOSE_ENOUGH * area:
            return np.append(radius[:others], last[best])
    raise InputError(
        f"no number of the floes drawn comes within 0.5 % of {area:.4g} m² ({count} floes: "
        f"{total[count] / area - 1:+.1%}); give a count, smaller floes or, if sizes differ, another seed"
    )


def _check_fit(radius: np.ndarray, domain: Domain) -> None:
    largest = float(radius.max(initial=0.0))
    for axis, length in zip("xy", domain.period, strict=True):
        low, high = getattr(domain, axis)
        side, radii = high - low, 2 if length is None else 4
        if largest * radii * (1 + SPARE) > side:
            raise InputError(
                f"{axis} from {low:g} to {high:g} m: must be at least {largest * radii:g} m long, "
                f"{radii} radii of the largest floe"
            )
