"""The style of all pictures: colours and colour scales, figures that fit their domain, axes and their tick labels."""

import textwrap
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from floebmi.errors import InputError, check_text
from floebmi.files import check_kind, in_one_go, path_of
from floebmi.quantities import is_number, two_numbers
from floebmi.reading import View

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.colors import Colormap, Normalize
    from matplotlib.figure import Figure

WATER = "#d3e4ee"
NOWHERE = "#eeeeee"  # outside the grid
LAND = "#b9ab8e"
COAST = "#7d7159"
INK = "#1d2b36"
CONCENTRATION = ["#0c2c4c", "#1f5f8f", "#66a5c9", "#bfdcea", "#ffffff"]  # water to ice
# Okabe and Ito's colours, which differ for all kinds of colour vision.  Named, and not C0, C1 …, which matplotlib
# looks up when it draws, and then in the user's style
LINES = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#6b6b6b"]
PLACES = ("x", "y", "longitude", "latitude")
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
LETTERS_PER_INCH = 13.0  # about, in labels and titles
TIME_WIDTH = 1.3  # inches for the time, at least, to the right of the title
ROOM = 3.6  # inches, at least, for what stands over and under the domain, which may be narrower
SHORT = 0.3  # inches: such an axis has no room for two numbers


def style() -> dict[str, Any]:
    """The rcParams of all pictures, for `matplotlib.rc_context`."""
    from cycler import cycler
    from matplotlib import rcParams
    from matplotlib.font_manager import fontManager

    here = set(fontManager.get_font_names())
    users = [font for font in rcParams["font.family"] + rcParams["font.sans-serif"] if font in here]
    return {
        # the user's, for signs that the first lacks
        "font.family": list(dict.fromkeys(["DejaVu Sans", *users])),
        "font.size": 9,
        "axes.titlesize": 10,
        "axes.titlelocation": "left",
        "axes.labelcolor": INK,
        "axes.edgecolor": INK,
        "axes.linewidth": 0.8,
        "axes.facecolor": WATER,
        "axes.prop_cycle": cycler(color=LINES),
        "axes.formatter.useoffset": False,
        "axes.formatter.limits": (-4, 5),
        "figure.facecolor": "white",
        "savefig.dpi": "figure",
        "text.color": INK,
        "xtick.color": INK,
        "ytick.color": INK,
        "xtick.labelsize": 8,
        "ytick.labelsize": 8,
        "legend.fontsize": 8,
        "legend.frameon": False,
        "lines.linewidth": 1.4,
    }


@contextmanager
def in_style(ground: str = WATER) -> Iterator[None]:
    """Context in which drawings have the style of all pictures: maps on water, graphs on white."""
    import matplotlib

    with matplotlib.rc_context({**style(), "axes.facecolor": ground}):
        yield


def blank(width: float, height: float, dpi: float | None = None) -> "Figure":
    """An empty figure of width × height inches, with automatic layout of panels and labels."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), dpi=dpi, layout="constrained")


def save(figure: "Figure", to: str | Path | None) -> "Figure":
    """Save a figure, in a file that appears only when it is complete; returns the figure.

    Parameters
    ----------
    to : file to write, in a format that matplotlib supports; None: the figure is not saved

    Raises
    ------
    InputError
        for another format, or a folder that does not exist.
    """
    if to is not None:
        to = path_of("to", to)
        check_kind(to, [f".{kind}" for kind in figure.canvas.get_supported_filetypes()])
        with in_one_go(to) as part:
            figure.savefig(part, format=to.suffix[1:])
    return figure


# ---- colours ----------------------------------------------------------------------------------


class Scale(NamedTuple):
    """A mapping from numbers to colours."""

    cmap: "Colormap"
    norm: "Normalize"
    extend: str = "neither"
    ticks: np.ndarray | None = None


class Bar(NamedTuple):
    """A colour bar: its label and its scale."""

    label: str
    scale: Scale


def scale_of(
    name: str, values: np.ndarray, limits: tuple[float, float] | None, whole: bool = False
) -> Scale:
    """A colour scale that fits the values; integers get a colour each, and coordinates need not include zero."""
    import matplotlib
    from matplotlib.colors import BoundaryNorm, LinearSegmentedColormap, Normalize

    if limits is not None:
        ends = two_numbers(limits)
        if ends is None or not ends[0] < ends[1]:
            raise InputError(
                f"limits = {limits!r}: must be two finite numbers, the smaller one first"
            )
        limits = ends
    values = values[np.isfinite(values)]
    low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 1.0)
    if name == "area_fraction":
        cmap = LinearSegmentedColormap.from_list("concentration", CONCENTRATION)
        return Scale(cmap, Normalize(*(limits or (0.0, 1.0))))
    if whole and limits is None:
        top = max(int(high), 1)
        levels = np.arange(min(top, 6) + 2) - 0.5
        cmap = matplotlib.colormaps["viridis"]
        extend = "max" if top > 6 else "neither"
        norm = BoundaryNorm(levels, cmap.N, extend=extend)
        return Scale(cmap, norm, extend, np.arange(min(top, 6) + 1))
    place = name in PLACES
    signed = low < 0.0 < high and not place
    if limits is None:
        most = max(abs(low), abs(high)) or 1.0
        largest = float(np.percentile(np.abs(values), 99)) if values.size else 1.0
        if most < 1.25 * largest or not largest:  # nothing stands out, so nothing is cut off
            largest = most
        far = min(abs(low), abs(high)) > 0.5 * most and name != "speed"
        if signed:
            limits = -largest, largest
        elif place or far:  # show the differences
            spread = 0.02 * most if high - low < 1e-6 * most else 0.0
            limits = low - spread, high + spread
        else:
            limits = (-largest, 0.0) if low < 0.0 else (0.0, largest)
    beyond = {(True, True): "both", (True, False): "min", (False, True): "max"}
    shown = beyond.get((low < limits[0], high > limits[1]), "neither")
    cmap = matplotlib.colormaps["PuOr_r" if signed else "viridis"]
    return Scale(cmap, Normalize(*limits), shown)


# ---- a figure that fits its domain ------------------------------------------------------------


def map_figure(
    view: View, size: int, title: str, bar: Bar | None, key: bool
) -> tuple["Figure", "Axes"]:
    """A figure that fits the domain, with true proportions, margins in inches and even numbers of pixels.

    key : whether there is room for the key of arrows, below
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    west, east, south, north = view.box
    aspect = (north - south) / (east - west)
    left, right, bottom = 0.75, 1.15 if bar else 0.25, 0.85 if key else 0.65
    width, dpi = inches_of(size)
    label, power, letters = _written(bar) if bar else ("", 0, 0)
    right += 0.075 * max(letters - 7, 0)

    def drawn() -> tuple[float, float]:  # a tall domain makes a narrower picture
        up = min((width - left - right) * aspect, 1.25 * width)
        return up / aspect, up

    figure = Figure(figsize=drawn(), dpi=dpi)
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(west, east), ylim=(south, north))
    left += 0.075 * max(_number_axes(axes, view.length[1]) - 5, 0)
    across, up = drawn()
    # a tall domain sits in the middle of its room, and so does a flat one
    beside = beside_of(across)
    time = max(TIME_WIDTH, 0.08 * max(map(len, map(view.times.text, (0, -1)))))
    lines = _lines(title, max(20, int((across + 2 * beside - time) * LETTERS_PER_INCH)))
    top = 0.3 + 0.17 * len(lines)
    width = across + 2 * beside + left + right
    height = max(up, 1.2, _height_of(label)) + bottom + top
    width, height = (2 * round(length * dpi / 2) / dpi for length in (width, height))
    left += beside
    rise = bottom + 0.5 * (height - bottom - top - up)
    figure.set_size_inches(width, height)
    axes.set_position((left / width, rise / height, across / width, up / height))
    axes.set_aspect("equal")
    # "$" is a dollar
    axes.set_title("\n".join(lines), loc="left", x=-beside / across, pad=7, parse_math=False)
    axes.set_title("", loc="right", x=1.0 + beside / across, pad=7)
    axes.set_axisbelow(False)
    if bar is not None:
        long = height - bottom - top
        box = (left + across + 0.12) / width, bottom / height, 0.16 / width, long / height
        text = "\n".join(_lines(label, int(long * LETTERS_PER_INCH)))
        _draw_bar(figure.add_axes(box), bar.scale, text, power)
    return figure, axes


def _draw_bar(axes: "Axes", scale: Scale, label: str, power: int) -> None:
    """Draw a colour bar that fills its axes."""
    from matplotlib.cm import ScalarMappable

    shades = axes.figure.colorbar(
        ScalarMappable(scale.norm, scale.cmap), cax=axes, extend=scale.extend, ticks=scale.ticks
    )
    if power:
        shades.formatter = in_powers_of(power)
    shades.set_label(label)
    shades.outline.set_linewidth(0.6)


def beside_of(across: float) -> float:
    """Margin [inches] that title and colour scale need on either side of a domain drawn at a given width."""
    return 0.5 * max(ROOM - across, 0.0)


def inches_of(size: int) -> tuple[float, float]:
    """Width in inches, and pixels per inch; text shrinks in small pictures, but less than in proportion."""
    if not (is_number(size) and size >= 200):
        raise InputError(f"size = {size!r}: must be at least 200 pixels")
    width = float(np.clip(size / 150, 5.5, 8.0))
    return width, (size + 0.01) / width  # matplotlib cuts off fractions of a pixel


def _number_axes(axes: "Axes", unit: str) -> int:
    """Tick labels of both axes, in full; returns the number of letters of the longest one on the y axis."""
    axes.ticklabel_format(style="plain", useOffset=False)
    letters = []
    for name, axis, length in zip(
        "xy", (axes.xaxis, axes.yaxis), axes.figure.get_size_inches(), strict=True
    ):
        numbers = axis.get_major_formatter().format_ticks(axis.get_majorticklocs())
        letters.append(max(map(len, numbers)))
        room = 0.12 + 0.075 * letters[0]  # of a number along x
        axis.set_label_text(f"{name} [{unit}]")
        if length < max(SHORT, 1.5 * room if name == "x" else 0.0):
            low, high = (f"{end:.9g}".replace("-", "−") for end in axis.get_view_interval())
            axis.set_label_text(f"{name} [{unit}]: {low} to {high}")
            axis.labelpad = 15.0
            axis.set_ticks([])
            letters[-1] = 0
        elif name == "x":
            axis.get_major_locator().set_params(nbins=int(np.clip(length / room, 1, 9)))
    return letters[1]


def _written(bar: Bar) -> tuple[str, int, int]:
    """Label of a colour bar with its power of ten, and the number of letters of its longest tick label.

    The power is in the label, because at the end of the bar it would overlap the time.
    """
    from matplotlib.ticker import AutoLocator, ScalarFormatter

    if bar.scale.ticks is not None:
        return bar.label, 0, 1
    low, high = bar.scale.norm.inverse([0.0, 1.0])
    if power := power_of(low, high):
        return with_power(bar.label, power), power, 1
    numbers = ScalarFormatter(useOffset=False)
    numbers.create_dummy_axis()
    numbers.axis.set_view_interval(low, high)
    told = numbers.format_ticks(AutoLocator().tick_values(low, high))
    return bar.label, 0, max(map(len, told))


def _height_of(label: str) -> float:
    """Height [inches] in which the label of a colour bar fits in two lines."""
    letters = range(1 + len(label) // 2, len(label) + 1)
    return (
        1 + next((n for n in letters if len(textwrap.wrap(label, n)) <= 2), 0)
    ) / LETTERS_PER_INCH


def _lines(text: str, letters: int) -> list[str]:
    """Text wrapped into as few lines of at most so many letters as possible, of about equal length."""
    check_text("title", text)
    lines = textwrap.wrap(text, letters) or [""]
    narrow = (textwrap.wrap(text, n) for n in range(1 + len(text) // len(lines), letters))
    return next((found for found in narrow if len(found) == len(lines)), lines)


# ---- words and numbers ------------------------------------------------------------------------


def plain_numbers(axis: "Axis") -> None:
    """Label a logarithmic axis with plain numbers (20, 50, 100), or with decades if there are many; call it after drawing."""
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator

    low, high = axis.get_view_interval()
    if high < 4.0 * low:
        axis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
    else:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 1e3 * low else (1.0,)))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def label_of(text: str, units: str) -> str:
    """Text and units, with the exponents as superscripts."""
    words = []
    for word in units.split():
        letters = word.rstrip("-0123456789") or word  # the unit 1 is no exponent
        words.append(letters + word[len(letters) :].translate(RAISED))
    return f"{text} [{' '.join(words)}]"


def power_of(low: float, high: float) -> int:
    """The power of ten, a multiple of three, that shortens long numbers; 0 for numbers that are short."""
    largest = max(abs(low), abs(high))
    if largest == 0.0 or 1e-3 <= largest < 1e5:
        return 0
    return 3 * int(np.floor(np.log10(largest) / 3))


def in_powers_of(power: int) -> Callable[[float, int], str]:
    """Formatter for the tick labels of an axis whose unit has a power of ten."""
    return lambda value, _: f"{value / 10.0**power:.10g}".replace("-", "−")


def with_power(label: str, power: int) -> str:
    """A label whose unit has a power of ten."""
    return label.replace("[", f"[10{str(power).translate(RAISED)} ", 1) if power else label
