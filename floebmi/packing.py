"""Where the floes lie at the start: scattered, on a lattice, from gridded fields, from files.

Scattering is done in three steps.  *String*: the floes are laid, in random order, along a space-filling
(Hilbert) curve through the places where ice may be, each taking as much of the curve as its area asks
for; so every part of the domain has its share of ice from the start, and no ice has to travel far.
Large floes are laid first, and smaller ones around them.  *Press*: floes that overlap are pushed apart, pair
by pair, in sweeps.  *Swap*: every few sweeps a squeezed floe changes radius with a slightly smaller
one that is less squeezed.  The set of sizes stays as drawn, and discs of a size ratio of 2 reach 0.88, where
pressing alone jams at 0.84.  Floes of a single size are shaken instead, and order into grains.
"""

import csv
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from floebmi.boundaries import Domain, check_domain
from floebmi.coast import Coast, land_geometry, read_features
from floebmi.errors import InputError, choose
from floebmi.floes import FIXED_X, FIXED_Y, Floes
from floebmi.grid import Grid
from floebmi.kernels import jit
from floebmi.neighbours import find_pairs, sort_in_space
from floebmi.sizes import Sizes, check_sizes

SPARE = 0.002  # floes are pressed apart as if this much larger, so that in the end none overlap
OVERSHOOT = 1.5  # push beyond the point of touching: fewer sweeps, as in successive over-relaxation
SKIN = 0.6  # of the pair list, in median radii
SWEEPS = 6000  # after which a packing is given up
CLASS = 4.0  # floes within this ratio of radii are laid together
SHORE_STEP = 0.5  # distance of the points that guard a shore, in smallest radii
CLOSE_ENOUGH = 0.005  # relative error of the concentration that is still what was asked for

Land = Coast | Grid | Sequence[ArrayLike]


class IceNotPlaced(UserWarning):
    """Ice of a field that found no room."""


class Overlaps(NamedTuple):
    """Pairs of floes that overlap, the worst first.

    Attributes
    ----------
    i, j : floe numbers
    overlap : [m]
    relative : overlap over the smaller radius
    """

    i: np.ndarray
    j: np.ndarray
    overlap: np.ndarray
    relative: np.ndarray


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
    concentration : area of floes over the area of the domain that is not land, met within 0.5 %.  About 0.85
        is reached by any sizes, 0.88 by radii that differ by a factor of 2
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
    >>> round(floes.area.sum() / box.area, 3)
    0.8
    """
    check_domain(domain)
    check_sizes(sizes)
    if (concentration is None) == (count is None):
        raise InputError(
            f"concentration = {concentration}, count = {count}: give one of them, not both"
        )
    rng = np.random.Generator(np.random.PCG64(seed))
    barrier = _barrier(land, domain, sizes.range[0])
    room = domain.area - barrier.area
    if count is not None:
        if int(count) != count or count < 0:
            raise InputError(f"count = {count!r}; must be a whole number, at least 0")
        radius = sizes.draw(int(count), rng)
    else:
        if not 0 < concentration < 1:
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
    ground.ice[ground.group >= 0] = 1.0
    ground.ice *= filled * room / max(ground.ice.sum(), 1.0)
    x, y, _ = _pack(radius, ground, barrier, domain, rng)
    left = _unplaced(x, y, radius, barrier, domain)
    if left.any():
        raise InputError(
            f"{asked}: {np.count_nonzero(left)} of {len(left)} floes do not fit; choose less, or "
            "smaller floes, or a wider range of sizes"
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

    Floes are drawn until the ice area inside the domain is met; each cell gets the floes for its own ice
    area, within about half a floe, and what is over or short is carried to a neighbouring cell.  Floes do not
    reach into dry cells or land.

    Parameters
    ----------
    grid : of the fields; its dry cells are land
    area_fraction : of each cell [1], shape (grid.size,) or grid.shape
    thickness : of the ice in each cell [m] (not its mean over ice and water), same shapes, or one number.
        A floe gets the thickness of the cell that it was drawn for
    sizes : the distribution of radii
    domain : default the box around the grid's nodes, with inactive edges
    seed : of the random numbers; the same seed gives the same floes, bit for bit
    max_concentration : cells with more ice than this get only this much, for discs do not pack much
        denser than 0.85 (at most 0.88)
    land : further land to keep free, as in `scatter`

    Warns
    -----
    IceNotPlaced
        with the area that was left out because of `max_concentration`, and that of floes that found no room.

    Raises
    ------
    InputError
        for a value in a wet cell that is not usable, with its index.
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
        ("area_fraction", ~((fraction >= 0) & (fraction <= 1)), fraction, "must be between 0 and 1"),
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
    rng = np.random.Generator(np.random.PCG64(seed))
    fraction = np.where(grid.wet, fraction, 0.0)
    inside = _area_inside(grid, domain)
    wanted = float(np.sum(fraction * inside))
    ice = np.minimum(fraction, max_concentration) * inside
    radius = _draw_area(sizes, float(ice.sum()), rng, strict=False)
    _check_fit(radius, domain)
    barrier = _barrier(land, domain, sizes.range[0], grid)
    ground = _ground(domain, barrier, len(radius), grid)
    _spread(ground, grid, ice)
    x, y, cell = _pack(radius, ground, barrier, domain, rng)
    left = _unplaced(x, y, radius, barrier, domain)
    capped = wanted - float(ice.sum())
    lost = float(np.pi * np.sum(radius[left] ** 2))
    told = [
        f"{area:.4g} m² ({area / wanted:.2%}) {why}"
        for area, why in (
            (capped, f"above max_concentration = {max_concentration:g}"),
            (lost, f"in {np.count_nonzero(left)} floes that found no room"),
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

    Rows run along x.  Between edges that are not periodic the lattice is centred, with all floes
    wholly inside.

    Parameters
    ----------
    domain : a period must hold a whole number of spacings (along y of a hexagonal lattice, an even number
        of rows, which are √3/2 spacings apart)
    radius : of all floes [m]
    spacing : of neighbours [m], at least 2 radii
    concentration : area of floes over that of the domain, in place of a spacing; met within 0.5 % by
        stretching the lattice a little along the periods
    lattice : "hexagonal" or "square"
    thickness : of all floes [m]

    Raises
    ------
    InputError
        if the spacing does not fit the period or the floes overlap; it says which nearest value would fit.
    """
    check_domain(domain)
    if lattice not in ("hexagonal", "square"):
        raise InputError(f"lattice = {lattice!r}: {choose(lattice, ('hexagonal', 'square'))}")
    if (spacing is None) == (concentration is None):
        raise InputError(
            f"spacing = {spacing}, concentration = {concentration}: give one of them, not both"
        )
    if not (np.isfinite(radius) and radius > 0):
        raise InputError(f"radius = {radius} m; must be greater than 0")
    if spacing is not None:
        if not spacing >= 2 * radius:
            raise InputError(f"spacing = {spacing} m; must be at least 2 radii, {2 * radius:g} m")
        x, y, stretch = _lattice(domain, radius, spacing, lattice)
        if stretch > 1e-9:
            fitting = _fitting_spacing(domain, radius, spacing, lattice)
            raise InputError(
                f"spacing = {spacing} m does not divide the period; nearest that fits: {fitting}"
            )
        return Floes(x, y, radius, thickness)
    if not 0 < concentration < 1:
        raise InputError(f"concentration = {concentration!r}; must be between 0 and 1")
    packed = np.sqrt(3.0) / 2 if lattice == "hexagonal" else 1.0
    ideal = np.sqrt(np.pi * radius**2 / (packed * concentration))
    best = None
    # walls leave bare strips, so the spacing that gives the concentration can be far below the ideal
    for trial in ideal * np.concatenate([[1.0], np.linspace(1.1, 0.6, 501)]):
        x, y, _ = _lattice(domain, radius, trial, lattice)
        found = len(x) * np.pi * radius**2 / domain.area
        if best is None or abs(found - concentration) < abs(best[0] - concentration):
            floes = Floes(x, y, radius, thickness)
            if not len(overlapping(floes, domain).i):
                best = found, floes
    if best is None or abs(best[0] / concentration - 1) > CLOSE_ENOUGH:
        nearest = "none fits" if best is None else f"nearest that fits: {best[0]:.4g}"
        raise InputError(
            f"concentration = {concentration:g}: no whole number of rows comes within 0.5 % without "
            f"overlap; {nearest}"
        )
    return best[1]


def read_floes(
    path: str | Path, thickness: float | None = None, projection: str | None = None
) -> Floes:
    """Floes from a CSV or GeoJSON file.

    CSV: a header line with the columns x, y, radius or area, and, where wanted, thickness, u, v,
    motion, angle, angular_velocity, in SI units, in any order and case; other columns are not read.
    GeoJSON: Points with the property radius or area, or Polygons, which become discs of the same area
    about their centroid; the other columns are properties.

    Parameters
    ----------
    path : ends in .csv, .geojson or .json
    thickness : of all floes [m], for a file that has none
    projection : for a GeoJSON file in longitude and latitude, see `coast.from_geojson`

    Raises
    ------
    InputError
        naming file, row or feature, column and value.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix == ".csv":
        if projection is not None:
            raise InputError(f"{path}: a projection is for GeoJSON; x and y of a CSV file are in metres")
        rows = _csv_rows(path)
    elif suffix in (".geojson", ".json"):
        rows = _geojson_rows(path, projection)
    else:
        raise InputError(f"{path}: must end in .csv, .geojson or .json")
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


def overlapping(floes: Floes, domain: Domain) -> Overlaps:
    """Pairs of active floes that overlap, the worst first; pairs of fixed floes do not count.

    Examples
    --------
    >>> pairs = overlapping(Floes([0.0, 15.0], 0.0, 10.0, 1.0), Domain((0.0, 100.0), (0.0, 100.0)))
    >>> pairs.overlap
    array([5.])
    """
    here = np.flatnonzero(floes.active)
    x, y, radius = floes.x[here], floes.y[here], floes.radius[here]
    free = (floes.motion[here] & (FIXED_X | FIXED_Y)) == 0
    _, i, j = find_pairs(x, y, radius, domain.period)
    i, j = _some_free(i, j, free)
    overlap = radius[i] + radius[j] - _distance(x, y, i, j, domain)
    relative = overlap / np.minimum(radius[i], radius[j])
    order = np.argsort(-relative, kind="stable")
    order = order[relative[order] > 0]
    return Overlaps(here[i[order]], here[j[order]], overlap[order], relative[order])


def refuse_overlaps(floes: Floes, domain: Domain, tolerance: float) -> None:
    """Refuse floes of which some overlap by more than `tolerance` times the smaller radius.

    Raises
    ------
    InputError
        with the number of such pairs and the worst three.
    """
    pairs = overlapping(floes, domain)
    count = int(np.count_nonzero(pairs.relative > tolerance))
    if count:
        worst = "; ".join(
            f"floes {i} and {j} by {overlap:.4g} m ({relative:.1%})"
            for i, j, overlap, relative in zip(*(column[:3] for column in pairs), strict=True)
        )
        raise InputError(
            f"{count} pairs of floes overlap by more than {tolerance:.1%} of the smaller radius, the "
            f"worst: {worst}; relax(floes, domain) presses them apart"
        )


def relax(floes: Floes, domain: Domain, land: Land | None = None) -> float:
    """Press floes apart, in place, until none overlap or they are jammed.

    Floes with a prescribed motion stay where they are, velocities stay as they are.  At closed edges floes are
    moved wholly inside.

    Parameters
    ----------
    floes : changed are x and y of the active ones
    domain : its periodic and closed edges
    land : kept free, as in `scatter`

    Returns
    -------
    The largest overlap left, over the smaller radius: 0 unless the floes are jammed.
    """
    check_domain(domain)
    if not floes.active.any():
        return 0.0
    here = np.flatnonzero(floes.active)
    x, y, radius = floes.x[here], floes.y[here], floes.radius[here]
    free = (floes.motion[here] & (FIXED_X | FIXED_Y)) == 0
    shore = _barrier(land, domain, float(radius.min())).discs
    worst = _press(x, y, radius, free, shore, domain, ("closed",))
    floes.x[here], floes.y[here] = x, y
    return worst
