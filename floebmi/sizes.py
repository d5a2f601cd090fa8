"""Floe size distributions: distributions of the radius, by number of floes.

A distribution is a NamedTuple of numbers, so that scene files, the Python API and the attributes of
output files use the same names.  Each one draws radii and has a mean disc area, from which
a packing estimates how many floes it needs.
"""

import csv
import math
import re
import reprlib
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
from annotated_types import Ge, Le, MinLen

from floebmi.errors import InputError
from floebmi.files import path_of
from floebmi.quantities import NonNegative, Positive, check, number_in, unmasked

# What a header may say that is no radius [m].
_NO_RADII = {"diameter", "diameters", "area", "areas", "perimeter", "length", "width", "caliper"}
_OTHER_UNITS = {"km", "km2", "m2", "cm", "mm", "ft"}

Exponent = Annotated[float, Ge(-20), Le(20)]


class PowerLaw(NamedTuple):
    """Power-law number density n(r) ~ r**exponent between two radii (eq. power-law-sizes).

    Parameters
    ----------
    radius_min : smallest radius [m]
    radius_max : largest radius [m]
    exponent : exponent of the number density [1]; the cumulative number of larger floes has exponent + 1.  The
        default is that of doi:10.1029/2018MS001299.
    """

    radius_min: Positive
    radius_max: Positive
    exponent: Exponent = -1.8

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest radius [m]."""
        return self.radius_min, self.radius_max

    def draw(self, n: int, rng: np.random.Generator) -> np.ndarray:
        """n radii [m]."""
        chance = rng.random(n)
        power = self.exponent + 1.0
        span = math.log(self.radius_max / self.radius_min)
        # the inverse of the cumulative distribution, written so that it holds at exponent = -1 and
        # near it
        if power == 0.0:
            log_r = chance * span
        else:
            log_r = np.log1p(chance * math.expm1(power * span)) / power
        return np.clip(self.radius_min * np.exp(log_r), *self.range)

    def mean_area(self) -> float:
        """Mean of π r² [m²]."""
        span = math.log(self.radius_max / self.radius_min)

        def moment(power: float) -> float:  # ∫ (r/r_min)**(power - 1) dr/r_min
            if power * span == 0.0:
                return span or 1.0
            return math.expm1(power * span) / power

        ratio = moment(self.exponent + 3.0) / moment(self.exponent + 1.0)
        return math.pi * self.radius_min**2 * ratio


class UniformSize(NamedTuple):
    """Uniform distribution: all radii between two bounds are equally likely.

    Parameters
    ----------
    radius_min : smallest radius [m]
    radius_max : largest radius [m]
    """

    radius_min: Positive
    radius_max: Positive

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest radius [m]."""
        return self.radius_min, self.radius_max

    def draw(self, n: int, rng: np.random.Generator) -> np.ndarray:
        """n radii [m]."""
        return rng.uniform(self.radius_min, self.radius_max, n)

    def mean_area(self) -> float:
        """Mean of π r² [m²]."""
        a, b = self.range
        return math.pi * (a * a + a * b + b * b) / 3.0


class SingleSize(NamedTuple):
    """All floes have one radius.

    Parameters
    ----------
    radius : radius of every floe [m]
    """

    radius: Positive

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest radius [m]: the same."""
        return self.radius, self.radius

    def draw(self, n: int, rng: np.random.Generator) -> np.ndarray:
        """n radii [m]."""
        return np.full(n, float(self.radius))

    def mean_area(self) -> float:
        """π r² [m²]."""
        return math.pi * self.radius**2


class Histogram(NamedTuple):
    """Histogram of the radius: counts of floes in bins; within a bin all radii are equally likely.

    Parameters
    ----------
    edges : edges of the bins [m], increasing, one more than counts
    counts : number of floes (or a weight) in each bin
    """

    edges: Annotated[tuple[Positive, ...], MinLen(2)]
    counts: Annotated[tuple[NonNegative, ...], MinLen(1)]

    def __repr__(self) -> str:
        return _in_short(self)

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest edge [m] of bins that are not empty."""
        filled = np.flatnonzero(self.counts)
        return float(self.edges[filled[0]]), float(self.edges[filled[-1] + 1])

    def draw(self, n: int, rng: np.random.Generator) -> np.ndarray:
        """n radii [m]."""
        edges, counts = np.asarray(self.edges, float), np.asarray(self.counts, float)
        cell = rng.choice(len(counts), n, p=counts / counts.sum())
        return rng.uniform(edges[cell], edges[cell + 1])

    def mean_area(self) -> float:
        """Mean of π r² [m²]."""
        edges, counts = np.asarray(self.edges, float), np.asarray(self.counts, float)
        a, b = edges[:-1], edges[1:]
        return float(math.pi * np.average((a * a + a * b + b * b) / 3.0, weights=counts))


class Empirical(NamedTuple):
    """Measured radii [m]; each draw picks one of them."""

    radii: Annotated[tuple[Positive, ...], MinLen(1)]

    def __repr__(self) -> str:
        return _in_short(self)

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest radius [m]."""
        return float(min(self.radii)), float(max(self.radii))

    def draw(self, n: int, rng: np.random.Generator) -> np.ndarray:
        """n radii [m]."""
        return rng.choice(np.asarray(self.radii, float), n)

    def mean_area(self) -> float:
        """Mean of π r² [m²]."""
        return math.pi * float(np.mean(np.square(self.radii)))


def _in_short(sizes: Histogram | Empirical) -> str:
    """The repr of a distribution, with only the first numbers of a long array (as from a file)."""
    rows = (f"{name}={reprlib.repr(row)}" for name, row in sizes._asdict().items())
    return f"{type(sizes).__name__}({', '.join(rows)})"


Sizes = PowerLaw | UniformSize | SingleSize | Histogram | Empirical


def check_sizes(sizes: Sizes, place: str = "") -> None:
    """Refuse a distribution that cannot be drawn from; place : what stands before the names of its parameters in an error.

    Raises
    ------
    InputError
        naming the parameter and its value.
    """
    if not isinstance(sizes, Sizes):
        raise InputError(
            f"sizes = {sizes!r}: must be a PowerLaw, UniformSize, SingleSize, Histogram or "
            "Empirical"
        )
    if isinstance(sizes, Histogram):
        edges, counts = _row(f"{place}edges", sizes.edges), _row(f"{place}counts", sizes.counts)
        if len(edges) != len(counts) + 1:
            raise InputError(
                f"{place}edges: {len(edges)}, with {len(counts)} counts; must be one more than counts"
            )
        falls = np.flatnonzero(np.diff(edges, prepend=0.0) <= 0)
        if falls.size:
            k = int(falls[0])
            raise InputError(
                f"{place}edges[{k}] = {edges[k]:g} m; must be greater than 0, and increase"
            )
        if counts.min() < 0 or counts.sum() == 0:
            k = int(counts.argmin())
            raise InputError(f"{place}counts[{k}] = {counts[k]:g}; at least 0 each, not all 0")
    elif isinstance(sizes, Empirical):
        radii = _row(f"{place}radii", sizes.radii)
        if radii.min() <= 0:
            row = int(radii.argmin())
            raise InputError(f"{place}radii[{row}] = {radii[row]:g} m; must be greater than 0")
    else:
        check([sizes])
        low, high = sizes.range
        if low > high:
            raise InputError(
                f"{place}radius_max = {high:g} m; must be at least radius_min, {low:g} m"
            )


def _row(name: str, values: tuple[float, ...]) -> np.ndarray:
    row = unmasked(values)
    if row.ndim != 1 or not len(row) or not np.isfinite(row).all():
        raise InputError(f"{name} = {values!r}: must be a row of finite numbers")
    return row


def csv_lines(path: Path) -> list[tuple[int, list[str]]]:
    """The lines of a CSV file that are not blank, with their line numbers, the header first.

    InputError if it cannot be read.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file)
            lines = [(reader.line_num, row) for row in reader if any(map(str.strip, row))]
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not a text file in UTF-8 ({error.reason})") from None
    except csv.Error as error:
        raise InputError(f"{path}: not a CSV file ({error})") from None
    if not lines:
        raise InputError(f"{path}: empty; must have a header line")
    header = lines[0][1]
    if len(header) == 1 and (other := re.search(r"[;\t]", header[0])):
        raise InputError(
            f"{path}: its columns are separated by {other[0]!r}; must be separated by commas"
        )
    return lines


def from_file(path: str | Path) -> Histogram | Empirical:
    """Sizes from a CSV file with one header line.

    One column holds radii [m] (`Empirical`).  Two columns hold the lower edge of each bin [m] and its
    count (`Histogram`); the edge in the last row closes the last bin, and its count is empty or 0.

    Raises
    ------
    InputError
        naming file, row, column and value.
    """
    path = path_of("path", path)
    (first, header), *rows = csv_lines(path)
    if len(header) > 2 or len(rows) < len(header):
        raise InputError(
            f"{path}: {len(header)} columns and {len(rows)} rows; must be one column of radii, or "
            "two columns of edge and count with at least two rows"
        )
    if _is_number(header[0]):
        raise InputError(f"{path}: row {first} = {header[0]!r}; must be a header, such as 'radius'")
    words = set(re.findall(r"[a-z]+2?", header[0].lower()))
    if words & _OTHER_UNITS or (words & _NO_RADII and not words & {"radius", "radii"}):
        raise InputError(
            f"{path}: column {header[0].strip()!r}: must be radii in metres, as 'radius'"
        )
    if len(header) == 2 and re.search(r"radi(us|i)|edge", header[1].lower()):
        raise InputError(
            f"{path}: column {header[1].strip()!r}: must be counts, after the edges of the bins"
        )
    columns: list[list[float]] = [[] for _ in header]
    last, end = rows[-1]
    if len(header) == 2 and [text.strip() for text in end[1:]] in ([], [""]):
        rows[-1] = last, [end[0], "0"]
    for number, row in rows:
        if len(row) != len(header):
            raise InputError(f"{path}: row {number} has {len(row)} values; must be {len(header)}")
        for name, text, column in zip(header, row, columns, strict=True):
            if not _is_number(text):
                raise InputError(
                    f"{path}: row {number}, column {name.strip()!r}: {text!r} must be a number"
                )
            column.append(number_in(text))
    sizes: Histogram | Empirical
    if len(header) == 1:
        sizes = Empirical(tuple(columns[0]))
    else:
        if columns[1][-1] != 0:
            raise InputError(
                f"{path}: row {last}, column {header[1].strip()!r}: {columns[1][-1]:g} "
                "must be 0 or empty, for the last row only closes the last bin"
            )
        sizes = Histogram(tuple(columns[0]), tuple(columns[1][:-1]))
    try:
        check_sizes(sizes)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return sizes


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(number_in(text))
    except ValueError:
        return False
