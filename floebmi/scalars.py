"""Ice concentration, thickness and land from files, on the cells of a grid.

Thickness has two meanings in files: the mean over the ice, as for a floe, and the mean over the
whole cell (volume per area, "effective" thickness), which is smaller by the factor of the concentration.  Which one a
file has is decided by its name, long_name, comment and cell_methods; if they do not say, the user must.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Literal, NamedTuple, get_args

import numpy as np

from floebmi.clock import Clock
from floebmi.errors import InputError, check_text, check_word, in_line, warn
from floebmi.factors import fraction_factor, is_percent, length_factor
from floebmi.fields import Field, File, Wanted, field, find, holds
from floebmi.grid import Grid, check_grid
from floebmi.masks import choose_mask, water_value
from floebmi.opening import open_files
from floebmi.places import Position, place_of
from floebmi.quantities import is_number
from floebmi.remap import FillLand, around_cells, interpolate

if TYPE_CHECKING:
    from floebmi.clock import Date
    from floebmi.opening import Source

Quantity = Literal["area_fraction", "thickness", "sea_ice_volume", "land_fraction"]
ThicknessOf = Literal["auto", "ice", "cell"]

_CONCENTRATION = Wanted(
    "ice concentration",
    standard=(("sea_ice_area_fraction", None),),
    short=tuple(
        (name, None)
        for name in ("siconc", "aice", "ice_conc", "ileadfra", "SIarea", "ci", "fice", "sic")
    ),
)
_THICKNESS = Wanted(
    "ice thickness",
    standard=(("sea_ice_thickness", None),),
    short=tuple((name, None) for name in ("sithick", "sivol", "hice", "SIheff", "iicethic", "hi")),
)
_LAND = Wanted(
    "land",
    standard=(
        ("land_area_fraction", "fraction"),
        ("sea_area_fraction", "fraction"),
        ("land_binary_mask", "mask"),
        ("sea_binary_mask", "mask"),
    ),
    short=(
        ("land_fraction", "fraction"),
        ("sftlf", "fraction"),
        ("lsm", "mask"),
        ("mask_rho", "mask"),
        ("tmask", "mask"),
        ("mask", "mask"),
        ("wet", "mask"),
    ),
)
_CELL_MEAN = (
    r"effective|grid[- ]?cell[- ]?(mean|average)|(cell|area)[- ]mean|in (the )?(grid[ -]?)?cell"
    r"|volume per|per (unit |grid[- ]?cell )?area"
    r"|where sea_ice over"  # CF: what lies on the ice, over the area of what is named next
)
_ICE_MEAN = r"where sea_ice|actual|in[- ]situ|over (the )?ice|of (the )?(ice )?floes"
# Rounding in a file (packing, advection) reaches this far beyond a bound; more is an error [1 or m].
_ROUNDING = 1e-3
# … and that of the interpolation this far, which is not worth a word.
_ROUND_OFF = 1e-12
# No ice at sea is thicker [m]: a wrong unit, or a fill value that the file does not declare.
_THICKEST = 1000.0
# Less ice than this has no thickness of its own.
_NO_ICE = 1e-3


class _On(NamedTuple):
    """Where and when to read a scalar: the options of `read_scalar` that do not depend on the quantity."""

    files: list[File]
    grid: Grid
    projection: str | None
    position: Position
    file_projection: str | None
    time: Date | None
    select: dict[str, int] | None
    fill_land: FillLand
    mask: str
    outside: float | None


def read_scalar(
    path: Source,
    quantity: Quantity,
    grid: Grid,
    projection: str | None = None,
    *,
    variable: str | None = None,
    concentration: str | None = None,
    thickness_of: ThicknessOf = "auto",
    time: Date | None = None,
    select: dict[str, int] | None = None,
    units: str | None = None,
    mask: str = "auto",
    fill_land: FillLand = "error",
    outside: float | None = None,
    position: Position = "auto",
    file_projection: str | None = None,
) -> np.ndarray:
    """Read one field at the cell centres of a grid, by bilinear interpolation between the file's points on water.

    A missing thickness where the concentration at the same point is 0 means no ice rather than land.

    Parameters
    ----------
    path, grid, projection, select, mask, position, file_projection, fill_land : as for
        `floebmi.forcing.VelocityFile`; land is not masked for quantity "land_fraction"
    quantity : "area_fraction" (ice concentration, 0 to 1), "thickness" (mean over the ice, m), "sea_ice_volume"
        (per area of cell, m), "land_fraction" (0 to 1)
    variable : name of the variable; default: found by standard_name, else by well-known names
    concentration : name of the concentration variable, which converts one kind of thickness to the other and weights the
        points of a cell between ice and open water
    thickness_of : whether the thickness in the file is a mean over the "ice" or the "cell"; "auto": as the file says
    time : a date (or seconds, in a file of durations), also between records; default: the first record
    units : units of the variable, if the file states none or wrong ones
    outside : value for cells outside the file; default: an error if they are wet

    Returns
    -------
    (grid.size,) ; 0 on dry cells without data.  Values beyond a bound by no more than 1e-3 (of 1, or m) are
    taken as rounding errors and set to the bound, with a warning.  Where the concentration is below 1e-3 the thickness
    is 0.

    Raises
    ------
    InputError
        if the variable, its meaning, its units or its position is not clear; for a value out of bounds;
        if wet cells are not covered.
    """
    check_grid("grid", grid)
    check_word("quantity", quantity, get_args(Quantity))
    check_word("thickness_of", thickness_of, get_args(ThicknessOf))
    if not (outside is None or is_number(outside)):
        raise InputError(f"outside = {in_line(outside)}: must be a number, or None")
    check_text("units", units)
    files = open_files(path)
    on = _On(
        files, grid, projection, position, file_projection, time, select, fill_land, mask, outside
    )
    if quantity == "land_fraction":
        return _land(on, variable, units)
    if quantity == "area_fraction":
        return _fraction(_find(_CONCENTRATION, variable, "variable", on), units, on)
    found = _find(_THICKNESS, variable, "variable", on)
    factor = length_factor(_units(found, units), found.label)
    kind = thickness_of if thickness_of != "auto" else _thickness_of(found)
    share, as_wanted = None, (kind == "cell") == (quantity == "sea_ice_volume")
    if not as_wanted or concentration is not None or holds(files, _CONCENTRATION):
        share = _find(_CONCENTRATION, concentration, "concentration", on)
    # Volume and area of ice have means between points; thickness has none where some are open water.
    if kind == "ice" and (share is None or _points(share) != _points(found)):
        there = _interpolated(found, on, lambda h: np.where(np.isnan(h), h, h > 0))
        total = _bounded(
            found.label, factor * _interpolated(found, on, scale=factor, top=_THICKEST), _THICKEST
        )
        thickness = _over(found.label, total, there)
        return thickness if quantity == "thickness" else thickness * _fraction(share, None, on)
    fraction = None if share is None else _fraction(share, None, on)
    here = share if share is not None and _points(share) == _points(found) else None
    values = _interpolated(found, on, share=here, times=kind == "ice", scale=factor, top=_THICKEST)
    volume = _bounded(found.label, factor * values, _THICKEST)
    return volume if quantity == "sea_ice_volume" else _over(found.label, volume, fraction)


def begins(path: Source, concentration: str | None, select: dict[str, int] | None) -> str | None:
    """The date of the first record of a file's ice concentration; None if it has no dates, or a single record."""
    found = find(
        open_files(path), _CONCENTRATION, concentration and (concentration,), "concentration"
    )
    return Clock(field(*found.variables[0], select=select)).first_date


def _over(label: str, volume: np.ndarray, area: np.ndarray) -> np.ndarray:
    """Thickness of the ice [m], 0 where there is none."""
    thickness = np.divide(volume, area, out=np.zeros(len(area)), where=area >= _NO_ICE)
    return _bounded(label, thickness, _THICKEST)


def _find(wanted: Wanted, name: str | None, option: str, on: _On) -> Field:
    found = find(on.files, wanted, None if name is None else (name,), option)
    return field(*found.variables[0], select=on.select)


def _fraction(part: Field, units: str | None, on: _On) -> np.ndarray:
    said = _units(part, units)
    factor = fraction_factor(said, part.label)
    values = factor * _interpolated(part, on, scale=factor, top=1.0)
    if is_percent(said) and 0 < values.max() <= 0.01:
        warn(
            f"{part.label}: units = {said!r}, but nowhere is it more than {100 * values.max():.2g}: is it a fraction of 1?"
        )
    return _bounded(part.label, values, 1.0)


def _units(part: Field, given: str | None = None) -> str | None:
    """The units that the user gives, else those of the file."""
    return given or part.array.attrs.get("units")


def _thickness_of(found: Field) -> str:
    attrs = found.array.attrs
    words = " ".join(
        str(attrs.get(k, "")) for k in ("long_name", "comment", "cell_methods")
    ).lower()
    name = found.name.lower()
    if name in ("sivol", "siheff") or re.search(_CELL_MEAN, words):
        return "cell"
    if name == "sithick" or re.search(_ICE_MEAN, words):
        return "ice"
    raise InputError(
        f"{found.label}: nothing says whether it is the mean over the ice or over the cell: say"
        " thickness_of = 'ice' or 'cell'"
    )


def _land(on: _On, name: str | None, units: str | None) -> np.ndarray:
    found = find(on.files, _LAND, None if name is None else (name,), "variable")
    part = field(*found.variables[0], select=on.select)
    water = water_value(part.file, part.name)
    if water is None:
        raise InputError(
            f"{part.label}: nothing says whether 1 is land or water (standard_name, flag_meanings, a"
            " well-known name)"
        )
    said = _units(part, units)
    factor = (
        1.0 if found.word == "mask" and not is_percent(said) else fraction_factor(said, part.label)
    )
    everywhere = on._replace(grid=on.grid.with_wet(np.ones(on.grid.size, bool)), mask="none")

    def to_land(values: np.ndarray) -> np.ndarray:
        if np.isnan(values).any():
            j, i = np.argwhere(np.isnan(values))[0]
            raise InputError(f"{part.label}: no value at [{j}, {i}] of the part around the grid")
        return factor * values if water == 0 else 1 - factor * values

    return _bounded(part.label, _interpolated(part, everywhere, to_land, top=1.0), 1.0)


def _interpolated(
    part: Field,
    on: _On,
    convert: Callable[[np.ndarray], np.ndarray] = np.array,
    share: Field | None = None,
    times: bool = False,
    scale: float = 1.0,
    top: float = np.inf,
) -> np.ndarray:
    """A field at the cells of the grid (grid.size,), after `convert` of the points' values.

    scale, top : each point in use must have a value within 0 … top / scale, because a mean that includes a fill value may look
        valid
    share : the concentration at the same points: where it says that there is no ice the field is 0, whether the
        file has 0 there or no value
    times : whether the field is multiplied by `share` there
    """
    place = place_of(
        part.file, part.array, part.dims, on.projection, on.position, on.file_projection, on.files
    )
    needed = on.grid.wet if on.outside is None else np.zeros(on.grid.size, bool)
    around, box = around_cells(place, on.grid, needed, on.fill_land, part.label)
    clock = Clock(part, on.time)
    try:
        before, after, weight = clock.bracket(0.0)
    except InputError:
        raise InputError(f"{part.label}: time = {on.time!r}: the file has {clock}") from None

    def read(record: int | None) -> np.ndarray:
        values = convert(part.read(record, box))
        if share is None:
            return values
        area = fraction_factor(_units(share), share.label) * share.read(record, box)
        values = np.where(np.isnan(values) & (area < _NO_ICE), 0.0, values)
        return values * area if times else values

    points = read(before)
    wet = np.isfinite(points)
    if weight:
        points = (1 - weight) * points + weight * read(after)
    land = choose_mask(on.mask, part.file, on.files, part.dims, auto=True)
    if land is not None:
        wet &= land.read(box)
    rows, _ = interpolate(around, box, place, on.grid, wet, on.fill_land, part.label)
    points = np.where(wet, points, 0.0).ravel()
    used = np.unique(rows.indices)
    beyond = np.maximum(-points[used], points[used] - top / scale)
    if not (beyond <= _ROUNDING / scale).all():
        k = int(used[beyond.argmax()])
        j, i = np.unravel_index(k, box.shape)
        name = (
            f"{part.label}[{box.rows.start + j}, {box.columns.start + i}]"
            if part.dims
            else part.label
        )
        raise _out_of_bounds(name, scale * points[k], top)
    values = rows @ points
    if on.outside is not None:
        values[around.outside] = on.outside
    return values


def _points(part: Field) -> tuple[object, ...]:
    return part.dims, part.shape, part.time, part.array.sizes.get(part.time)


def _bounded(label: str, values: np.ndarray, top: float) -> np.ndarray:
    """Values within 0 … top; rounding beyond is set to the bound with a warning, more is an error."""
    beyond = np.maximum(-values, values - top)
    if not (beyond <= _ROUNDING).all():
        c = int(np.argmax(np.where(np.isnan(beyond), np.inf, beyond)))
        raise _out_of_bounds(f"{label} at cell {c}", values[c], top)
    if (beyond > _ROUND_OFF).any():
        warn(
            f"{label}: {int((beyond > _ROUND_OFF).sum())} cells beyond 0 … {top:g} by at most"
            f" {beyond.max():.1g} are set to the bound"
        )
    return np.clip(values, 0, top)


def _out_of_bounds(name: str, value: float, top: float) -> InputError:
    return InputError(
        f"{name}: {value:g}; must lie in 0 … {top:g} (a fill value that is not its _FillValue, or wrong units?)"
    )
