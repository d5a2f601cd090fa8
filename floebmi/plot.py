"""Pictures and animations, from the files of a run and from nothing else.

`frame` draws the floes as true circles among the coast, `field` maps a gridded variable, `ledger` shows where
mass, momentum and energy came from, `animate` makes a film that a browser plays, `page` a page with a slider.
All share one style: light water, land in sand, sequential maps that everyone can read (viridis; PuOr where a
sign matters), axes in km, the time above.

Figures are matplotlib's `Figure` without pyplot: nobody's backend or open windows are touched, and the
style holds only while a picture is drawn.  A film is drawn frame by frame and piped to the ffmpeg binary
that PyPI's imageio-ffmpeg brings; matplotlib's own writers would look for one on the user's path.
"""

import base64
import errno
import json
import textwrap
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from itertools import chain
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, final

import numpy as np

from floebmi.errors import InputError, choose, in_line, is_word
from floebmi.files import check_target, in_one_go, path_of
from floebmi.floes import FIXED, LAND as LAND_BIT
from floebmi.output import open_file
from floebmi.quantities import is_number, two_numbers
from floebmi.variables import VARIABLES, find

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.colors import Colormap, Normalize
    from matplotlib.figure import Figure
    from netCDF4 import Dataset

WATER = "#d3e4ee"
NOWHERE = "#eeeeee"  # outside the grid
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
LETTERS_PER_INCH = 13.0  # about, in labels and titles
TIME_WIDTH = 1.3  # inches for the time, at least, to the right of the title
ROOM = 3.6  # inches, at least, for what stands over and under the domain, which may be narrower
SHORT = 0.3  # inches: such an axis has no room for two numbers
LAND = "#b9ab8e"
COAST = "#7d7159"
INK = "#1d2b36"
PLACES = ("x", "y", "longitude", "latitude")
CONCENTRATION = ["#0c2c4c", "#1f5f8f", "#66a5c9", "#bfdcea", "#ffffff"]  # water to ice
# Okabe and Ito's colours, which differ for all kinds of colour vision.  Named, and not C0, C1 …, which matplotlib
# looks up when it draws, and then in the user's style
LINES = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#6b6b6b"]

Arrows = Literal["ice", "ocean", "wind", "stress"]
_ARROWS = {
    "ice": ("ice_velocity", "m/s", "ice"),
    "ocean": ("ocean_velocity", "m/s", "current"),
    "wind": ("wind", "m/s", "wind"),
    "stress": ("ocean_stress", "Pa", "stress on ocean"),
}


def style() -> dict[str, Any]:
    """The rcParams of all pictures, for `matplotlib.rc_context`."""
    from cycler import cycler

    return {
        "font.family": "sans-serif",
        "font.sans-serif": ["DejaVu Sans"],
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
def graph(width: float, height: float) -> "Iterator[Figure]":
    """An empty figure of width × height inches for curves of one's own, in the style of the others.

    Examples
    --------
    >>> with graph(6, 4) as figure:
    ...     axes = figure.subplots()
    ...     lines = axes.plot([0, 24], [0.1, 0.3], label="floes")
    ...     text = axes.set(xlabel="time [h]", ylabel="speed [m/s]"), axes.legend()
    >>> figure.savefig("speed.png")  # doctest: +SKIP
    """
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context({**style(), "axes.facecolor": "white"}):
        yield Figure(figsize=(width, height), layout="constrained")


def plain_numbers(axis: "Axis") -> None:
    """Write 20, 50, 100 at a logarithmic axis on which all is drawn, or decades if there are many."""
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator

    low, high = axis.get_view_interval()
    if high < 4.0 * low:
        axis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
    else:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 1e3 * low else (1.0,)))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def frame(
    trajectories: str | Path,
    gridded: str | Path | None = None,
    time: int = -1,
    color: str | None = "speed",
    to: str | Path | None = None,
    *,
    arrows: Arrows | None = None,
    limits: tuple[float, float] | None = None,
    title: str | None = None,
    size: int = 1200,
) -> "Figure":
    """Floes as circles at one time, over water and land.

    Parameters
    ----------
    trajectories : file of `TrajectoryWriter`
    gridded : file of `GriddedWriter` of the same run: for its land, the mean wind, the graticule and arrows
    time : number of the frame, negative from the end
    color : "speed" or a variable of the trajectory file ("thickness", "contact_force" …); None: plain ice
    to : file to save (.png, .pdf, .svg)
    arrows : "ice", "ocean", "wind" (velocities) or "stress" (ice on ocean) from the gridded file
    limits : ends of the colour scale; by default they hold all frames' values but the largest 1 %
    title : default: the file's title
    size : width of the picture in pixels; that of a tall domain is narrower

    Returns
    -------
    matplotlib Figure; with `to` given it is saved already.

    Raises
    ------
    InputError
        for files, times, variables or formats that cannot be used.
    """
    import matplotlib

    with matplotlib.rc_context(style()), ExitStack() as files:
        view = _open_view(files, trajectories, gridded)
        k = _frame_number(trajectories, time, len(view.time))
        picture = _FloePicture(view, color, arrows, limits, title, size)
        picture.show(k)
        return save(picture.figure, to)


def field(
    gridded: str | Path,
    variable: str = "area_fraction",
    time: int = -1,
    to: str | Path | None = None,
    *,
    arrows: Arrows | None = None,
    limits: tuple[float, float] | None = None,
    title: str | None = None,
    size: int = 1200,
) -> "Figure":
    """Map of a gridded variable at one time.

    Parameters
    ----------
    gridded : file of `GriddedWriter`
    variable : short, CSDMS or CF name (see variables.py)
    time, to, arrows, limits, title, size : as for `frame`

    Raises
    ------
    InputError
        for files, times, variables or formats that cannot be used.
    """
    import matplotlib

    row = find(variable)
    with matplotlib.rc_context(style()), ExitStack() as files:
        data = files.enter_context(open_file(gridded, "gridded"))
        if row.file_name not in data.variables:
            have = [row.name for row in VARIABLES if row.file_name in data.variables]
            raise InputError(f"{gridded}: has no {row.name}; {choose(row.name, have)}")
        k = _frame_number(gridded, time, len(data.dimensions["time"]))
        values = _filled(data[row.file_name][k])
        view = _View(data, data, _length_unit(data), _Clock(data))
        label = _label(row.text, row.units)
        scale = _scale_of(row.name, values, limits)
        some = bool(np.isfinite(values).any())
        title = str(getattr(data, "title", "")) if title is None else title
        bar = _Bar(label, scale) if some or limits is not None else None
        figure, axes = _canvas(view, size, title, bar, arrows is not None)
        if not row.needs_ice:
            axes.set_facecolor(NOWHERE)
        _draw_cells(axes, view, data[row.file_name].dimensions[1:], values, scale)
        _draw_dry_cells(axes, view)
        _draw_land(axes, view)
        _draw_graticule(axes, view)
        if arrows is not None:
            _draw_arrows(axes, view, arrows, k)
        _draw_scale_bar(axes, view)
        if not some:
            told = f"{row.text}: no values at this time"
            axes.text(0.5, 0.5, told, ha="center", wrap=True, transform=axes.transAxes)
        axes.set_title(view.clock.text(k), loc="right", pad=7)
        return save(figure, to)


def ledger(
    path: str | Path,
    to: str | Path | None = None,
    *,
    title: str | None = None,
    size: int = 1200,
) -> "Figure":
    """Where mass, momentum and energy of the ice came from, in time.

    Each panel shows what the ice has gained since the start, the accounts that it came from (their sum is
    the gain), and the residual.

    Parameters
    ----------
    path : file of `TrajectoryWriter` or `GriddedWriter`
    to, title, size : as for `frame`

    Raises
    ------
    InputError
        for a file that is not one of those.
    """
    import matplotlib

    with matplotlib.rc_context({**style(), "axes.facecolor": "white"}), ExitStack() as files:
        data = files.enter_context(open_file(path, "trajectories", "gridded"))
        if not len(data.dimensions["time"]):
            raise InputError(f"{path}: has no frame yet")
        return save(_ledger_figure(data, title, size), to)


def animate(
    trajectories: str | Path,
    gridded: str | Path | None = None,
    to: str | Path = "floes.mp4",
    *,
    color: str | None = "speed",
    arrows: Arrows | None = None,
    limits: tuple[float, float] | None = None,
    title: str | None = None,
    size: int = 1000,
    fps: int = 12,
    every: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """A film of the floes, as `frame` draws them.

    Parameters
    ----------
    trajectories, gridded, color, arrows, limits, title : as for `frame`
    to : .mp4 (H.264, plays in browsers) or .gif
    size : width in pixels
    fps : frames per second
    every : take each n-th frame of the file
    progress : called with (frames done, all frames)

    Returns
    -------
    The file; it appears when it is whole.

    Raises
    ------
    InputError
        as `frame`, and for another ending of the name, fps < 1 or every < 1.
    """
    import matplotlib

    to = path_of("to", to)
    _check_kind(to, (".mp4", ".gif"))
    if not (is_number(fps) and fps >= 1):
        raise InputError(f"fps = {fps!r}: must be at least 1")
    _check_every(every)
    with matplotlib.rc_context(style()), ExitStack() as files:
        view = _open_view(files, trajectories, gridded)
        picture = _FloePicture(view, color, arrows, limits, title, size)
        numbers = range(0, len(view.time), every)

        def images() -> Iterator[np.ndarray]:
            for done, k in enumerate(numbers, 1):
                yield picture.pixels(k)
                if progress is not None:
                    progress(done, len(numbers))

        with in_one_go(to) as part:
            part.touch()  # what ffmpeg says of a place that cannot be written to is long
            (_write_mp4 if to.suffix == ".mp4" else _write_gif)(part, images(), fps)
    return to


def page(
    trajectories: str | Path,
    to: str | Path = "floes.html",
    *,
    color: str = "speed",
    limits: tuple[float, float] | None = None,
    title: str | None = None,
    every: int = 1,
) -> Path:
    """A page with all frames and a slider for the time; one file, which needs no network.

    Parameters
    ----------
    trajectories, color, limits, title : as for `frame`
    to : .html
    every : take each n-th frame of the file

    Returns
    -------
    The file.

    Raises
    ------
    InputError
        as `frame`, and for another ending of the name or every < 1.
    """
    to = path_of("to", to)
    _check_kind(to, (".html",))
    _check_every(every)
    with ExitStack() as files:
        view = _open_view(files, trajectories, None)
        run = _page_of(_FloePicture(view, color, None, limits, title, 400), view, every)
    blank = Path(__file__).with_name("view.html").read_text(encoding="utf-8")
    # "</" would end the script that holds the data
    told = json.dumps(run, ensure_ascii=False).replace("</", "<\\/")
    with in_one_go(to) as part:
        part.write_text(blank.replace("{{ run }}", told), encoding="utf-8")
    return to


# ---- files ------------------------------------------------------------------------------------


def _check_kind(to: Path, kinds: Sequence[str]) -> None:
    """InputError for a file of another kind than those, or in a place where none can be made."""
    if to.suffix not in kinds:
        raise InputError(f"{to}: {choose(to.suffix, kinds)}")
    check_target(to, overwrite=True)


class _Clock:
    """Times of a file in words; elapsed time if the run has no date."""

    def __init__(self, data: "Dataset") -> None:
        import cftime

        self.seconds = _filled(data["time"][:])
        self._dates = None
        if getattr(data["time"], "epoch", "") != "arbitrary":
            self._dates = cftime.num2date(self.seconds, data["time"].units, data["time"].calendar)
        span = np.abs(self.seconds).max(initial=0.0)
        # frames of one minute would have one date
        close = np.diff(self.seconds).min(initial=np.inf) < 60.0
        self._form = "%Y-%m-%d %H:%M:%S" if close else "%Y-%m-%d %H:%M"
        units = ((1.0, "s", 300), (60.0, "min", 180), (3600.0, "h", 96), (86400.0, "d", np.inf))
        self.unit, self.name = next((u, name) for u, name, most in units if span <= most * u)

    def text(self, k: int) -> str:
        if self._dates is not None:
            return self._dates[k].strftime(self._form)
        value = self.seconds[k] / self.unit
        number = f"{value:.4g}" if abs(value) < 1e4 else f"{value:.0f}"
        return f"t = {number.replace('-', '−')} {self.name}"


class _View(NamedTuple):
    """The files of a run, the length that is one unit of the axes, and the clock."""

    data: "Dataset"  # with the domain, and the land polygons
    gridded: "Dataset | None"
    length: tuple[float, str]
    clock: _Clock

    @property
    def time(self) -> np.ndarray:
        return self.clock.seconds

    @property
    def box(self) -> tuple[float, float, float, float]:
        """West, east, south, north in units of the axes."""
        (west, east), (south, north) = self.data.domain_x, self.data.domain_y
        return tuple(float(value) / self.length[0] for value in (west, east, south, north))


def _open_view(files: ExitStack, trajectories: str | Path, gridded: str | Path | None) -> _View:
    floes = files.enter_context(open_file(trajectories, "trajectories"))
    fields = None
    if gridded is not None:
        fields = files.enter_context(open_file(gridded, "gridded"))
    if not len(floes.dimensions["time"]):
        raise InputError(f"{trajectories}: has no frame yet")
    return _View(floes, fields, _length_unit(floes), _Clock(floes))


def _length_unit(data: "Dataset") -> tuple[float, str]:
    widest = max(np.ptp(data.domain_x), np.ptp(data.domain_y))
    return (1000.0, "km") if widest > 2000.0 else (1.0, "m")


def _frame_number(path: str | Path, time: int, n: int) -> int:
    if not (_is_whole(time) and -n <= time < n):
        raise InputError(f"{path}: time = {time!r}: it has {n} frames; give {-n} to {n - 1}")
    return int(time) % n


def _check_every(every: int) -> None:
    if not (_is_whole(every) and every >= 1):
        raise InputError(f"every = {every!r}: must be at least 1, and whole")


def _is_whole(value: object) -> bool:
    return isinstance(value, Integral) and is_number(value)


def _filled(values: np.ndarray) -> np.ndarray:
    """Plain array; what is missing is NaN."""
    if np.ma.isMaskedArray(values):
        return values.astype(float).filled(np.nan) if values.mask.any() else values.data
    return np.asarray(values)


def _label(text: str, units: str) -> str:
    """Text and units, with the exponents raised."""
    words = []
    for word in units.split():
        letters = word.rstrip("-0123456789") or word  # the unit 1 is no exponent
        words.append(letters + word[len(letters) :].translate(RAISED))
    return f"{text} [{' '.join(words)}]"


# ---- colours ----------------------------------------------------------------------------------


class _Scale(NamedTuple):
    """How numbers become colours."""

    cmap: "Colormap"
    norm: "Normalize"
    extend: str = "neither"
    ticks: np.ndarray | None = None


class _Bar(NamedTuple):
    """A colour bar: its label and its scale."""

    label: str
    scale: _Scale


def _scale_of(
    name: str, values: np.ndarray, limits: tuple[float, float] | None, whole: bool = False
) -> _Scale:
    """A scale that fits the values; whole numbers get a colour each, and places have no zero to show."""
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
        return _Scale(cmap, Normalize(*(limits or (0.0, 1.0))))
    if whole and limits is None:
        top = max(int(high), 1)
        levels = np.arange(min(top, 6) + 2) - 0.5
        cmap = matplotlib.colormaps["viridis"]
        extend = "max" if top > 6 else "neither"
        norm = BoundaryNorm(levels, cmap.N, extend=extend)
        return _Scale(cmap, norm, extend, np.arange(min(top, 6) + 1))
    place = name in PLACES
    signed = low < 0.0 < high and not place
    if limits is None:
        largest = float(np.percentile(np.abs(values), 99)) if values.size else 1.0
        most = max(abs(low), abs(high))
        if most < 1.25 * largest or not largest:  # nothing stands out, so nothing is cut off
            largest = most or 1.0
        if signed:
            limits = -largest, largest
        elif place or (  # far from zero: show the differences
            min(abs(low), abs(high)) > 0.5 * most and name != "speed"
        ):
            most = most or 1.0
            spread = 0.02 * most if high - low < 1e-6 * most else 0.0
            limits = low - spread, high + spread
        else:
            limits = (-largest, 0.0) if low < 0.0 else (0.0, largest)
    beyond = {(True, True): "both", (True, False): "min", (False, True): "max"}
    shown = beyond.get((low < limits[0], high > limits[1]), "neither")
    cmap = matplotlib.colormaps["PuOr_r" if signed else "viridis"]
    return _Scale(cmap, Normalize(*limits), shown)


# ---- canvas -----------------------------------------------------------------------------------


def _canvas(
    view: _View, size: int, title: str, bar: _Bar | None, key: bool
) -> tuple["Figure", "Axes"]:
    """A figure that fits the domain: true proportions, margins in inches, even numbers of pixels."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    west, east, south, north = view.box
    aspect = (north - south) / (east - west)
    left, right, bottom = 0.75, 1.15 if bar else 0.25, 0.85 if key else 0.65
    width, dpi = _inches(size)
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
    beside = _beside(across)
    time = max(TIME_WIDTH, 0.08 * max(map(len, map(view.clock.text, (0, -1)))))
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
        from matplotlib.cm import ScalarMappable

        box = (
            (left + across + 0.12) / width,
            bottom / height,
            0.16 / width,
            1 - (bottom + top) / height,
        )
        shades = figure.colorbar(
            ScalarMappable(bar.scale.norm, bar.scale.cmap),
            cax=figure.add_axes(box),
            extend=bar.scale.extend,
            ticks=bar.scale.ticks,
        )
        if power:
            shades.formatter = _in_powers_of(power)
        letters = int((height - bottom - top) * LETTERS_PER_INCH)
        shades.set_label("\n".join(_lines(label, letters)))
        shades.outline.set_linewidth(0.6)
    return figure, axes


def _beside(across: float) -> float:
    """Inches on either side of a domain that is drawn so many inches wide, which its title and its scale need."""
    return 0.5 * max(ROOM - across, 0.0)


def _number_axes(axes: "Axes", unit: str) -> int:
    """Numbers along both axes, in full; returns how many letters the longest at the side has."""
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


def _written(bar: _Bar) -> tuple[str, int, int]:
    """Label of a colour bar, the power of ten in it, and the letters of its longest number.

    At the end of the bar the power would run into the time.
    """
    from matplotlib.ticker import AutoLocator, ScalarFormatter

    if bar.scale.ticks is not None:
        return bar.label, 0, 1
    low, high = bar.scale.norm.inverse([0.0, 1.0])
    if power := _power(low, high):
        return _with_power(bar.label, power), power, 1
    numbers = ScalarFormatter(useOffset=False)
    numbers.create_dummy_axis()
    numbers.axis.set_view_interval(low, high)
    told = numbers.format_ticks(AutoLocator().tick_values(low, high))
    return bar.label, 0, max(map(len, told))


def _height_of(label: str) -> float:
    """Inches in which the label of a colour bar has room in two lines."""
    letters = range(1 + len(label) // 2, len(label) + 1)
    return (
        1 + next((n for n in letters if len(textwrap.wrap(label, n)) <= 2), 0)
    ) / LETTERS_PER_INCH


def _power(low: float, high: float) -> int:
    """The power of ten, in steps of three, that makes long numbers short; 0 for numbers that are."""
    largest = max(abs(low), abs(high))
    if largest == 0.0 or 1e-3 <= largest < 1e5:
        return 0
    return 3 * int(np.floor(np.log10(largest) / 3))


def _in_powers_of(power: int) -> Callable[[float, int], str]:
    return lambda value, _: f"{value / 10.0**power:.10g}".replace("-", "−")


def _with_power(label: str, power: int) -> str:
    """A label whose unit has a power of ten."""
    return label.replace("[", f"[10{str(power).translate(RAISED)} ", 1) if power else label


def _lines(text: str, letters: int) -> list[str]:
    """Text in as few lines as have room for so many letters, about equally long."""
    if not isinstance(text, str):
        raise InputError(f"title = {in_line(text)}: must be a text")
    lines = textwrap.wrap(text, letters) or [""]
    narrow = (textwrap.wrap(text, n) for n in range(1 + len(text) // len(lines), letters))
    return next((found for found in narrow if len(found) == len(lines)), lines)


def _inches(size: int) -> tuple[float, float]:
    """Width in inches, and pixels per inch: small pictures get smaller letters, but not in proportion."""
    if not (is_number(size) and size >= 200):
        raise InputError(f"size = {size!r}: must be at least 200 pixels")
    width = float(np.clip(size / 150, 5.5, 8.0))
    return width, (size + 0.01) / width  # matplotlib cuts off fractions of a pixel


def save(figure: "Figure", to: str | Path | None) -> "Figure":
    """The figure, saved in a file that appears when it is whole.

    Parameters
    ----------
    to : the picture's file, of a kind that matplotlib writes; None: it is not saved

    Raises
    ------
    InputError
        for another kind of file, or a folder that is not there.
    """
    if to is not None:
        to = path_of("to", to)
        _check_kind(to, [f".{kind}" for kind in figure.canvas.get_supported_filetypes()])
        with in_one_go(to) as part:
            figure.savefig(part, format=to.suffix[1:])
    return figure


# ---- what is drawn ----------------------------------------------------------------------------


def _shores(data: "Dataset") -> list[np.ndarray]:
    """Rings of the land's outline [m], each of shape (nodes, 2); none if the file has no land."""
    if "land_polygons" not in data.variables:
        return []
    nodes = np.stack([_filled(data[f"land_{a}"][:]) for a in "xy"], axis=1)
    return np.split(nodes, np.cumsum(data["land_ring_node_count"][:])[:-1])


def _draw_land(axes: "Axes", view: _View) -> None:
    """Land polygons if the file has them, else the dry cells."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Outline

    if rings := _shores(view.data):
        nodes = np.concatenate(rings) / view.length[0]
        codes = np.full(len(nodes), Outline.LINETO, Outline.code_type)
        ends = np.cumsum([len(ring) for ring in rings])
        codes[ends - 1] = Outline.CLOSEPOLY
        codes[0] = codes[ends[:-1]] = Outline.MOVETO
        shores = Outline(nodes, codes)  # lakes run the other way round, which leaves them open
        axes.add_patch(PathPatch(shores, facecolor=LAND, edgecolor=COAST, linewidth=0.6, zorder=2))
    else:
        _draw_dry_cells(axes, view)


def _draw_dry_cells(axes: "Axes", view: _View) -> None:
    from matplotlib.colors import ListedColormap, Normalize

    if view.gridded is not None and "land_mask" in view.gridded.variables:
        mask = view.gridded["land_mask"]
        dry = np.where(mask[:] == 1, 1.0, np.nan)
        scale = _Scale(ListedColormap([LAND]), Normalize(0, 2))
        _draw_cells(axes, view, mask.dimensions, dry, scale, zorder=2)


def _draw_cells(
    axes: "Axes",
    view: _View,
    dimensions: tuple[str, ...],
    values: np.ndarray,
    scale: _Scale,
    zorder: float = 1,
) -> None:
    """Cells in the colours of their values; NaN stays open."""
    from matplotlib.collections import PolyCollection

    corners = _cell_corners(view, dimensions)
    look = {"cmap": scale.cmap, "norm": scale.norm, "zorder": zorder}
    if isinstance(corners, tuple):
        axes.pcolormesh(*corners, np.ma.masked_invalid(values), **look)
        axes.set(xlim=view.box[:2], ylim=view.box[2:])
        return
    there = np.isfinite(values.ravel())
    cells = PolyCollection(
        [corner for corner, drawn in zip(corners, there, strict=True) if drawn],
        array=values.ravel()[there],
        edgecolor="none",
        antialiased=False,  # else the water shines through between the cells
        **look,
    )
    axes.add_collection(cells, autolim=False)


def _cell_corners(
    view: _View, dimensions: tuple[str, ...]
) -> tuple[np.ndarray, np.ndarray] | list[np.ndarray]:
    """Edges along x and y of a rectilinear grid, or the corners of each cell; in units of the axes."""
    data, unit = view.gridded, view.length[0]
    if data is None:
        return []
    suffix = "".join(dimensions[0].partition("_")[1:])
    if f"face_nodes{suffix}" in data.variables:
        data.set_auto_mask(False)
        faces = data[f"face_nodes{suffix}"][:]
        data.set_auto_mask(True)
        nodes = np.stack([data[f"node_{a}{suffix}"][:] for a in "xy"], axis=-1) / unit
        return [nodes[face[face >= 0]] for face in faces]
    bounds = [_filled(data[f"{a}{suffix}_bnds"][:]) / unit for a in "xy"]
    if bounds[0].ndim == 2:
        return tuple(np.append(b[:, 0], b[-1, 1]) for b in bounds)
    return list(np.stack(bounds, axis=-1).reshape(-1, 4, 2))


def _draw_graticule(axes: "Axes", view: _View) -> list[Any]:
    """Lines of latitude and longitude, where the grid is on the globe; returns their numbers, which stand on the floes."""
    from matplotlib.patheffects import withStroke
    from matplotlib.ticker import MaxNLocator

    data = view.gridded
    numbers: list[Any] = []
    if data is None or "latitude" not in data.variables:
        return numbers
    x, y = _centres(data, data["latitude"].dimensions, view.length[0])
    if min(np.shape(x)) < 3:
        return numbers
    draw = axes.contour if np.ndim(x) == 2 else axes.tricontour
    for name, signs in (("latitude", "NS"), ("longitude", "EW")):
        values = _filled(data[name][:])
        span = np.ptp(values)
        if name == "longitude" and span > 180:  # the date line inside: count on beyond 180°
            values = values % 360.0
            span = np.ptp(values)
        if name == "longitude" and (span > 180 or np.abs(data["latitude"][:]).max() > 89):
            continue  # the pole inside
        levels = MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]).tick_values(values.min(), values.max())
        lines = draw(x, y, values, levels, colors=INK, linewidths=0.4, alpha=0.45, zorder=2.5)
        # seen on dark fields, too
        lines.set_path_effects([withStroke(linewidth=1.0, foreground="white", alpha=0.25)])

        def text(value: float, signs: str = signs) -> str:
            value = value - 360.0 if value > 180.0 else value
            side = signs[int(value < 0)] if value and abs(value) != 180.0 else ""
            return f"{abs(value):.4g}°{side}"

        for number in axes.clabel(lines, fmt=text, fontsize=6.5, colors=INK, zorder=4):
            box = number.get_window_extent()
            if any(box.overlaps(other.get_window_extent()) for other in numbers):
                number.remove()  # neither could be read
            else:
                numbers.append(number)
    for number in numbers:
        number.set(alpha=1.0, path_effects=[withStroke(linewidth=2.0, foreground="white")])
    return numbers


def _centres(
    data: "Dataset", dimensions: tuple[str, ...], unit: float
) -> tuple[np.ndarray, np.ndarray]:
    """Centres of the cells, of the shape of a field."""
    suffix = "".join(dimensions[0].partition("_")[1:])
    x, y = (_filled(data[f"{a}{suffix}"][:]) / unit for a in "xy")
    if len(dimensions) == 2 and x.ndim == 1:
        x, y = np.meshgrid(x, y)
    return x, y


def _field_frame(view: _View, k: int) -> int:
    """The frame of the gridded file nearest in time to frame k of the view."""
    return int(np.argmin(np.abs(_filled(view.gridded["time"][:]) - view.time[k])))


def _vectors(
    view: _View, name: str, k: int
) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]] | None:
    files = [find(f"{name}_{a}").file_name for a in "xy"]
    if view.gridded is None or files[0] not in view.gridded.variables:
        return None
    at = _field_frame(view, k)
    u, v = (_filled(view.gridded[file][at]) for file in files)
    return u, v, view.gridded[files[0]].dimensions[1:]


def _draw_arrows(axes: "Axes", view: _View, arrows: str, k: int) -> list[Any]:
    """Arrows on the grid, at most about 25 across, with a key under the lower right corner."""
    if not is_word(arrows, _ARROWS):
        raise InputError(f"arrows = {arrows!r}: {choose(arrows, _ARROWS)}")
    name, units, word = _ARROWS[arrows]
    found = _vectors(view, name, k)
    if found is None:
        raise InputError(f"arrows = {arrows!r}: there is no gridded file with {name}_x")
    u, v, dimensions = found
    x, y = _centres(view.gridded, dimensions, view.length[0])
    step = max(1, round(max(np.shape(x)) / 25)) if x.ndim == 2 else 1
    take = (slice(step // 2, None, step),) * x.ndim
    x, y, u, v = (values[take].ravel() for values in (x, y, u, v))
    speed = np.nan_to_num(np.hypot(u, v))
    if not speed.any():
        return []
    usual = float(np.percentile(speed[speed > 0.0], 95))
    there = speed > 0.02 * usual  # the rest would be dots
    key = _round_down(usual)
    west, east, south, north = view.box
    width = max(east - west, 0.5 * (north - south))  # those of a tall domain would be dots, too
    drawn = axes.quiver(
        *(values[there] for values in (x, y, u, v)),
        color=INK, edgecolor="white", linewidth=0.3, units="inches", width=0.015, headwidth=4, zorder=5,
        angles="xy", scale_units="xy", scale=usual / (0.045 * width),
    )  # fmt: skip
    corner = axes.get_position()
    inches = axes.figure.get_size_inches()
    right = corner.x1 * inches[0] + _beside(corner.width * inches[0])
    axes.quiverkey(
        drawn, right - 0.2, corner.y0 * inches[1] - 0.66, key,
        f"{word} {key:g} {units}", labelpos="W", labelsep=0.12, coordinates="inches",
        fontproperties={"size": 8},
    )  # fmt: skip
    return [drawn, axes.artists[-1]]


def _below(axes: "Axes", side: Literal["left", "right"]) -> Any:
    """Coordinates in inches from a lower corner of the domain's room, for what stands under the picture."""
    from matplotlib.transforms import ScaledTranslation

    across = axes.get_position().width * axes.figure.get_figwidth()
    beside = _beside(across) / across
    corner = ScaledTranslation(1.0 + beside if side == "right" else -beside, 0.0, axes.transAxes)
    return axes.figure.dpi_scale_trans + corner


def _draw_scale_bar(axes: "Axes", view: _View) -> None:
    west, east, _, _ = view.box
    across = axes.get_position().width * axes.figure.get_figwidth()
    per_inch = (east - west) / across
    length = _round_down(0.2 * (across + 2 * _beside(across)) * per_inch)
    inches = length / per_inch
    under = {"transform": _below(axes, "left"), "clip_on": False}
    axes.plot(
        [0.0, inches], [-0.43, -0.43], color=INK, lw=2.5, solid_capstyle="butt",
        scalex=False, scaley=False, **under,
    )  # fmt: skip
    text = f"{length:g} {view.length[1]}"
    axes.text(inches + 0.06, -0.43, text, va="center", fontsize=8, **under)


def _round_down(value: float) -> float:
    """The largest of 1, 2, 5 × 10^n that is not above the value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(m for m in (1, 2, 5) if m * power <= value * (1 + 1e-9)))


def _draw_wind(axes: "Axes", view: _View, k: int) -> list[Any]:
    """The mean wind as one arrow under the lower right corner."""
    found = _vectors(view, "wind", k)
    if found is None or not np.isfinite(found[0]).any():
        return []
    u, v = (float(np.nanmean(values)) for values in found[:2])
    speed = np.hypot(u, v)
    if speed < 0.05:
        return []
    under = _below(axes, "right")
    along, across = (0.15 * part / speed for part in (u, v))
    arrow = axes.annotate(
        "",
        xy=(-0.16 + along, -0.43 + across),
        xytext=(-0.16 - along, -0.43 - across),
        xycoords=under,
        textcoords=under,
        arrowprops={"arrowstyle": "-|>", "color": INK, "lw": 1.3, "shrinkA": 0, "shrinkB": 0},
        annotation_clip=False,
    )
    text = f"mean wind {speed:.1f} m/s"
    label = axes.text(
        -0.38, -0.43, text, ha="right", va="center", fontsize=8, transform=under, clip_on=False
    )
    return [arrow, label]


def _draw_walls(axes: "Axes", view: _View, k: int) -> list[Any]:
    """Walls that stand away from the edge of the picture."""
    if "wall_position" not in view.data.variables:
        return []
    edges = ("west", "east", "south", "north")
    artists = []
    for edge, position in zip(view.data["wall"][:], view.data["wall_position"][k], strict=True):
        place = float(position) / view.length[0]
        if place != view.box[edges.index(edge)]:
            line = axes.axvline if edge in ("west", "east") else axes.axhline
            artists.append(line(place, color=INK, linewidth=2.0))
    return artists


@final
class _FloePicture:
    """A figure that can show any frame: what stands still is drawn once, the rest anew for each frame."""

    def __init__(
        self,
        view: _View,
        color: str | None,
        arrows: str | None,
        limits: tuple[float, float] | None,
        title: str | None,
        size: int,
    ) -> None:
        self._view, self._color, self._arrows = view, color, arrows
        data = view.data
        motion = self.read("motion", 0).astype(int)
        held = (motion & FIXED) == FIXED
        self.still = ((motion & LAND_BIT) != 0) | (held & self._never_moves())
        self.bar = None
        if color is not None:
            self._check_color(color)
            sample = np.unique(np.linspace(0, len(view.time) - 1, 20).astype(int))
            values = np.concatenate([self.values(k)[~self.still] for k in sample])
            whole = color != "speed" and data[color].dtype.kind == "i"
            self.bar = _Bar(self._label(color), _scale_of(color, values, limits, whole))
        self.title = str(getattr(data, "title", "")) if title is None else title
        self.figure, self.axes = _canvas(view, size, self.title, self.bar, arrows is not None)
        _draw_land(self.axes, view)
        self._numbers = _draw_graticule(self.axes, view)
        _draw_scale_bar(self.axes, view)
        self._time = self.axes.set_title("", loc="right", pad=7)  # where `_canvas` has put it
        self._moving: list[Any] = []
        self._background: Any = None

    def show(self, k: int) -> None:
        """Draw frame k."""
        for artist in self._moving:
            artist.remove()
        x, y = self.read("x", k), self.read("y", k)
        here = np.isfinite(x)
        radius = self.read("radius", k)
        land, ice = here & self.still, here & ~self.still
        self._moving = [self._circles(x, y, radius, land, facecolor=LAND, edgecolor=LAND)]
        if self.bar is None:
            look = {"facecolor": "white"}
        else:
            scale = self.bar.scale
            look = {"cmap": scale.cmap, "norm": scale.norm, "array": self.values(k)}
        usual = np.median(radius[ice]) / self._view.length[0] if ice.any() else 0.0
        pixels = usual * self._per_unit()
        edge: dict[str, Any] = {"edgecolor": "none"}  # outlines would hide floes of a few pixels
        if pixels > 3.0:
            edge = {"edgecolor": INK, "linewidth": min(0.05 * pixels, 0.5)}
        self._moving.append(self._circles(x, y, radius, ice, **look, **edge))
        self._moving += _draw_walls(self.axes, self._view, k)
        self._moving += _draw_wind(self.axes, self._view, k)
        if self._arrows is not None:
            self._moving += _draw_arrows(self.axes, self._view, self._arrows, k)
        self._time.set_text(self._view.clock.text(k))

    def pixels(self, k: int) -> np.ndarray:
        """Frame k as RGB, shape (height, width, 3), uint8; what stands still is not drawn anew."""
        canvas = self.figure.canvas
        if self._background is None:
            canvas.draw()
            self._background = canvas.copy_from_bbox(self.figure.bbox)
        self.show(k)
        canvas.restore_region(self._background)
        for artist in sorted(
            (*self._moving, *self._numbers, self._time), key=lambda one: one.zorder
        ):
            self.axes.draw_artist(artist)
        return np.array(np.asarray(canvas.buffer_rgba())[:, :, :3])

    def _circles(
        self,
        x: np.ndarray,
        y: np.ndarray,
        radius: np.ndarray,
        which: np.ndarray,
        array: np.ndarray | None = None,
        **look: Any,
    ) -> Any:
        from matplotlib.collections import EllipseCollection

        number, shift_x, shift_y = self._images(x, y, radius, np.flatnonzero(which))
        unit = self._view.length[0]
        across = 2 * radius[number] / unit
        circles = EllipseCollection(
            across, across, np.zeros(len(number)), units="xy", zorder=3,
            offsets=np.stack([x[number] + shift_x, y[number] + shift_y], axis=1) / unit,
            offset_transform=self.axes.transData, **look,
        )  # fmt: skip
        if array is not None:
            circles.set_array(array[number])
        return self.axes.add_collection(circles, autolim=False)

    def _images(
        self, x: np.ndarray, y: np.ndarray, radius: np.ndarray, number: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Floes, and copies of those that reach across a periodic edge: number and shift [m]."""
        data = self._view.data
        shift_x, shift_y = np.zeros(len(number)), np.zeros(len(number))
        for place, (low, high), edge in (
            ("x", data.domain_x, data.domain_west),
            ("y", data.domain_y, data.domain_south),
        ):
            if edge != "periodic":
                continue
            centre = (x[number] + shift_x) if place == "x" else (y[number] + shift_y)
            for beyond, way in (
                (centre + radius[number] > high, low - high),
                (centre - radius[number] < low, high - low),
            ):
                copies = np.flatnonzero(beyond)
                number = np.append(number, number[copies])
                shift_x = np.append(shift_x, shift_x[copies] + (way if place == "x" else 0.0))
                shift_y = np.append(shift_y, shift_y[copies] + (way if place == "y" else 0.0))
                centre = np.append(centre, np.full(len(copies), 0.5 * (low + high)))
        return number, shift_x, shift_y

    def _per_unit(self) -> float:
        """Pixels per unit of the axes."""
        west, east = self._view.box[:2]
        return (
            self.axes.get_position().width
            * self.figure.get_figwidth()
            * self.figure.dpi
            / (east - west)
        )

    def read(self, name: str, k: int) -> np.ndarray:
        variable = self._view.data[name]
        return _filled(variable[k] if variable.ndim == 2 else variable[:])

    def _never_moves(self) -> np.ndarray:
        """Floes at rest in the first frame, and in the last one where they were then."""
        first, last = 0, len(self._view.time) - 1
        speed2 = (
            np.nan_to_num(self.read("u", first)) ** 2 + np.nan_to_num(self.read("v", first)) ** 2
        )
        moved = np.abs(self.read("x", last) - self.read("x", first))
        moved += np.abs(self.read("y", last) - self.read("y", first))
        return (speed2 == 0) & ~(moved > 0)

    def _check_color(self, color: str) -> None:
        have = ["speed"] + [
            name
            for name, variable in self._view.data.variables.items()
            if variable.dimensions in (("time", "trajectory"), ("trajectory",))
        ]
        if not is_word(color, have):
            raise InputError(f"color = {color!r}: {choose(color, have)}")

    def values(self, k: int) -> np.ndarray:
        if self._color == "speed":
            return np.hypot(self.read("u", k), self.read("v", k))
        return self.read(self._color, k)

    def _label(self, color: str) -> str:
        if color == "speed":
            return _label("speed", "m s-1")
        variable = self._view.data[color]
        return _label(variable.long_name, getattr(variable, "units", "1"))


# ---- page -------------------------------------------------------------------------------------


def _page_of(picture: _FloePicture, view: _View, every: int) -> dict[str, Any]:
    """What `view.html` shows; lengths in m, arrays (frame, floe) in base 64: float32, and RGB as bytes.

    Places are those from the south-western corner, since float32 has seven digits.
    """
    from matplotlib.colors import to_hex, to_rgb

    data, bar = view.data, picture.bar
    frames = range(0, len(view.time), every)
    (west, east), (south, north) = data.domain_x, data.domain_y
    x, y = (
        np.array([picture.read(name, k) - corner for k in frames], "<f4")
        for name, corner in (("x", west), ("y", south))
    )
    rgb = np.array([bar.scale.cmap(bar.scale.norm(picture.values(k)), bytes=True) for k in frames])
    rgb[:, picture.still, :3] = np.round(255 * np.array(to_rgb(LAND)))
    walls = []
    if "wall_position" in data.variables:
        positions = data["wall_position"][::every].T
        walls = [
            {
                "edge": str(edge),
                "position": (position - (west if edge in ("west", "east") else south)).tolist(),
            }
            for edge, position in zip(data["wall"][:], positions, strict=True)
        ]
    low, high = bar.scale.norm.vmin, bar.scale.norm.vmax
    # three digits of the difference
    apart = max(abs(low), abs(high)) / (high - low)
    digits = 3 + int(np.log10(apart)) if apart > 1.0 else 3
    length, unit = view.length
    return {
        "title": picture.title,
        "box": [0.0, float(east - west), 0.0, float(north - south)],
        "width": f"{(east - west) / length:g} {unit}",
        "period": [
            float(high - low) if edge == "periodic" else 0.0
            for edge, low, high in (
                (data.domain_west, west, east), (data.domain_south, south, north)
            )
        ],
        "times": [view.clock.text(k) for k in frames],
        "radius": np.nan_to_num(picture.read("radius", len(view.time) - 1)).tolist(),
        "still": picture.still.tolist(),
        "x": _base64(x), "y": _base64(y), "rgb": _base64(rgb[:, :, :3]),
        "shores": [(ring - (west, south)).tolist() for ring in _shores(data)],
        "walls": walls,
        "bar": {
            "low": f"{low:.{digits}g}", "high": f"{high:.{digits}g}", "label": bar.label,
            "colours": [to_hex(bar.scale.cmap(share)) for share in np.linspace(0, 1, 9)],
        },
        "water": WATER, "land": LAND, "ink": INK,
    }  # fmt: skip


def _base64(values: np.ndarray) -> str:
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode("ascii")


# ---- ledger -----------------------------------------------------------------------------------


def _ledger_figure(data: "Dataset", title: str | None, size: int) -> "Figure":
    from matplotlib.figure import Figure

    from floebmi.budgets import QUANTITIES, UNITS

    clock = _Clock(data)
    time = clock.seconds / clock.unit
    stock = _filled(data["ledger_stock"][:])
    gained = np.nan_to_num(_filled(data["ledger_gained"][:]))
    accounts = [str(name) for name in data["ledger_account"][:]]
    width, dpi = _inches(size)
    figure = Figure(figsize=(width, 0.85 * width), dpi=dpi, layout="constrained")
    panels = figure.subplots(2, 2, sharex=True)
    for q, (axes, name, unit) in enumerate(zip(panels.flat, QUANTITIES, UNITS, strict=True)):
        gain = stock[:, q] - stock[0, q]
        accounts_of = gained[:, :, q] - gained[0, :, q]
        residual = gain - accounts_of.sum(axis=1)
        # as in `budgets.Ledger.balance`, both components of the momentum have one measure
        of = slice(1, 3) if name.startswith("momentum") else slice(q, q + 1)
        largest = max(np.abs(stock[:, of]).max(), np.abs(gained[:, :, of]).max(initial=0.0))
        moved = max(np.abs(accounts_of).max(initial=0.0), np.abs(gain).max())
        axes.plot(time, gain, color="0.75", lw=5.0, solid_capstyle="butt", label="gain of the ice")
        for a in np.flatnonzero(accounts_of.any(axis=0)):
            dashes, color = divmod(int(a), len(LINES))
            pen = {"color": LINES[color], "ls": ("-", "--", "-.")[dashes % 3]}
            axes.plot(time, accounts_of[:, a], label=accounts[a], **pen)
        axes.plot(time, residual, color="black", ls=":", label="residual")
        if moved > 1e-12 * largest:
            share = np.abs(residual).max() / largest
            axes.set_title(f"residual: {share:.1g} of the largest", loc="right", fontsize=8)
        else:  # nothing but round-off, which has no scale
            axes.set(ylim=(-1.0, 1.0), yticks=[0.0])
            told = f"no change from {stock[0, q]:.6g} {unit}"
            axes.text(0.5, 0.58, told, ha="center", fontsize=8, transform=axes.transAxes)
        power = _power(*axes.get_ylim())
        if power:
            axes.yaxis.set_major_formatter(_in_powers_of(power))
        axes.set_ylabel(_with_power(f"{name.replace('_', ' along ')} [{unit}]", power))
        axes.spines[["top", "right"]].set_visible(False)
    for axes in panels[1]:
        axes.set_xlabel(f"time [{clock.name}]")
    lines = {line.get_label(): line for axes in panels.flat for line in axes.lines}
    figure.legend(lines.values(), lines, loc="outside lower center", ncols=4)
    title = f"{getattr(data, 'title', '')}: gains since the first frame" if title is None else title
    title = "\n".join(textwrap.wrap(title, int(0.95 * width * LETTERS_PER_INCH)))
    figure.suptitle(title, ha="left", x=0.02, fontsize=10, parse_math=False)
    return figure


# ---- film -------------------------------------------------------------------------------------


def _write_mp4(path: Path, images: Iterator[np.ndarray], fps: int) -> None:
    import imageio_ffmpeg

    first = next(images)
    height, width = first.shape[:2]
    pipe = imageio_ffmpeg.write_frames(
        path, (width, height), fps=fps, codec="libx264", quality=None, macro_block_size=2,
        output_params=["-crf", "20", "-movflags", "+faststart", "-f", "mp4"], ffmpeg_log_level="quiet",
    )  # fmt: skip
    pipe.send(None)
    sent, whole = 0, True
    try:
        for image in chain([first], images):
            pipe.send(image)
            sent += 1
    except OSError:  # ffmpeg has ended
        whole = False
    finally:
        pipe.close()
    if not whole or _frames_in(path) != sent:  # what went wrong at the end, ffmpeg does not tell
        with open(path, "ab", buffering=0) as file:  # the system does
            file.write(bytes(1 << 20))
        raise OSError(errno.EIO, "ffmpeg could not write the film: is the disk full?")


def _frames_in(film: Path) -> int:
    import imageio_ffmpeg

    try:
        return imageio_ffmpeg.count_frames_and_secs(film)[0]
    except RuntimeError:  # it is torn
        return 0


def _write_gif(path: Path, images: Iterator[np.ndarray], fps: int) -> None:
    from PIL import Image

    def indexed(image: np.ndarray) -> "Image.Image":
        return Image.fromarray(image).quantize(255, dither=Image.Dither.NONE)

    first = indexed(next(images))
    first.save(
        path,
        format="GIF",
        save_all=True,
        append_images=(indexed(image) for image in images),
        duration=round(1000 / fps),
        loop=0,
    )
