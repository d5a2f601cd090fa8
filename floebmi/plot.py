"""Pictures and animations, made from the output files of a run alone.

`frame` draws the floes to scale with the coast, `field` maps a gridded variable, `ledger` shows the budgets of
mass, momentum and energy, `animate` makes a film that plays in a browser, `page` an HTML page with a slider;
`graph` is for your own curves.
All share one style: light water, sand-coloured land, colour maps readable by colour-blind people (viridis; PuOr for
signed quantities), axes in km, the time above.

Figures are matplotlib `Figure` objects made without pyplot: your backend and open windows are not affected, and the
style applies only while a picture is drawn.
"""

import textwrap
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from floebmi.canvas import (
    INK,
    LAND,
    LETTERS_PER_INCH,
    LINES,
    NOWHERE,
    WATER,
    Bar,
    blank,
    in_powers_of,
    in_style,
    inches_of,
    label_of,
    map_figure,
    plain_numbers,
    power_of,
    save,
    scale_of,
    style,
    with_power,
)
from floebmi.drawing import (
    Arrows,
    draw_arrows,
    draw_cells,
    draw_dry_cells,
    draw_graticule,
    draw_land,
    draw_scale_bar,
)
from floebmi.errors import InputError, check_text, choose, in_line
from floebmi.files import check_kind, in_one_go, path_of
from floebmi.film import FASTEST_GIF, write_gif, write_mp4
from floebmi.output import open_file
from floebmi.page import page_of, write_page
from floebmi.picture import FloePicture
from floebmi.quantities import is_number
from floebmi.reading import FrameTimes, check_every, filled, frame_number, open_view, view_of
from floebmi.variables import VARIABLES, find

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from netCDF4 import Dataset

__all__ = [
    "frame", "field", "ledger", "animate", "page", "graph", "save", "style", "plain_numbers",
    "INK", "LAND", "LINES", "NOWHERE", "WATER",
]  # fmt: skip


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
    """Draw the floes as circles at one time, over water and land.

    Parameters
    ----------
    trajectories : trajectory file of a run (`TrajectoryWriter`)
    gridded : gridded file of the same run (`GriddedWriter`), for the land, the mean wind, the graticule and arrows
    time : number of the frame, negative from the end
    color : "speed" or a variable of the trajectory file ("thickness", "contact_force" …); None: plain ice
    to : file to save (.png, .pdf, .svg)
    arrows : "ice", "ocean", "wind" (velocities) or "stress" (of the ice on the ocean) from the gridded file
    limits : ends of the colour scale; default: the range of the values of 20 frames without the largest
        1 %; the scale ends in an arrow where the frames shown have values beyond it
    title : title of the picture; default: the file's title
    size : width of the picture in pixels; pictures of tall domains are narrower

    Returns
    -------
    matplotlib Figure, already saved if `to` is given

    Raises
    ------
    InputError
        for files, times, variables or formats that cannot be used.
    """
    with in_style(), ExitStack() as files:
        view = open_view(files, trajectories, gridded)
        k = frame_number(trajectories, time, len(view.times.seconds))
        picture = FloePicture(view, [k], color, arrows, limits, title, size)
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
    """Draw a map of a gridded variable at one time.

    Parameters
    ----------
    gridded : gridded file of a run (`GriddedWriter`)
    variable : short, CSDMS or CF name (see variables.py)
    time, to, arrows, limits, title, size : as for `frame`

    Raises
    ------
    InputError
        for files, times, variables or formats that cannot be used.
    """
    row = find(variable)
    with in_style(), ExitStack() as files:
        data = files.enter_context(open_file(gridded, "gridded"))
        if row.file_name not in data.variables:
            have = [row.name for row in VARIABLES if row.file_name in data.variables]
            raise InputError(f"{gridded}: has no {row.name}; {choose(row.name, have)}")
        k = frame_number(gridded, time, len(data.dimensions["time"]))
        values = filled(data[row.file_name][k])
        view = view_of(data, data)
        label = label_of(row.text, row.units)
        scale = scale_of(row.name, values, limits)
        some = bool(np.isfinite(values).any())
        title = str(getattr(data, "title", "")) if title is None else title
        bar = Bar(label, scale) if some or limits is not None else None
        figure, axes = map_figure(view, size, title, bar, arrows is not None)
        if not row.needs_ice:
            axes.set_facecolor(NOWHERE)
        draw_cells(axes, view, data[row.file_name].dimensions[1:], values, scale)
        draw_dry_cells(axes, view)
        draw_land(axes, view)
        draw_graticule(axes, view)
        if arrows is not None:
            draw_arrows(axes, view, arrows, k)
        draw_scale_bar(axes, view)
        if not some:
            told = f"{row.text}: no values at this time"
            axes.text(0.5, 0.5, told, ha="center", wrap=True, transform=axes.transAxes)
        axes.set_title(view.times.text(k), loc="right", pad=7)
        return save(figure, to)


def ledger(
    path: str | Path,
    to: str | Path | None = None,
    *,
    title: str | None = None,
    size: int = 1200,
) -> "Figure":
    """Draw the budgets of mass, momentum and energy of the ice over time.

    Each panel shows the gain of the ice since the start, the accounts that contribute to it (their sum is
    the gain), and the residual.

    Parameters
    ----------
    path : trajectory or gridded file of a run
    to, title, size : as for `frame`

    Raises
    ------
    InputError
        for any other file.
    """
    check_text("title", title)
    with in_style("white"), ExitStack() as files:
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
    """Make a film of the floes, as `frame` draws them.

    Parameters
    ----------
    trajectories, gridded, color, arrows, limits, title : as for `frame`
    to : file to write, .mp4 (H.264, plays in browsers) or .gif
    size : width in pixels
    fps : frames per second
    every : use every n-th frame of the file
    progress : function called with (frames done, number of frames)

    Returns
    -------
    The path of the film; the file appears only when it is complete

    Raises
    ------
    InputError
        as `frame`, and for another file name extension, fps < 1, fps > 50 for a .gif, or every < 1.
    """
    to = path_of("to", to)
    check_kind(to, (".mp4", ".gif"))
    if not (is_number(fps) and fps >= 1):
        raise InputError(f"fps = {fps!r}: must be at least 1")
    if to.suffix == ".gif" and fps > FASTEST_GIF:
        raise InputError(f"fps = {fps!r}: must be at most {FASTEST_GIF} for a .gif; write an .mp4")
    check_every(every)
    if not (progress is None or callable(progress)):
        raise InputError(f"progress = {in_line(progress)}: must be a function, or None")
    with in_style(), ExitStack() as files:
        view = open_view(files, trajectories, gridded)
        numbers = range(0, len(view.times.seconds), every)
        picture = FloePicture(view, numbers, color, arrows, limits, title, size)

        def images() -> Iterator[np.ndarray]:
            for done, k in enumerate(numbers, 1):
                yield picture.pixels(k)
                if progress is not None:
                    progress(done, len(numbers))

        with in_one_go(to) as part:
            part.touch()  # what ffmpeg says of a place that cannot be written to is long
            (write_mp4 if to.suffix == ".mp4" else write_gif)(part, images(), fps)
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
    """Make an HTML page with all frames and a time slider; a single file that needs no network.

    Parameters
    ----------
    trajectories, color, limits, title : as for `frame`
    to : file to write, .html
    every : use every n-th frame of the file

    Returns
    -------
    The path of the page

    Raises
    ------
    InputError
        as `frame`, and for another file name extension or every < 1.
    """
    to = path_of("to", to)
    check_kind(to, (".html",))
    check_every(every)
    if color is None:
        raise InputError("color = None: must be speed or a variable of the file")
    with ExitStack() as files:
        view = open_view(files, trajectories, None)
        numbers = range(0, len(view.times.seconds), every)
        run = page_of(FloePicture(view, numbers, color, None, limits, title, 400), view, every)
    with in_one_go(to) as part:
        write_page(part, run)
    return to


@contextmanager
def graph(width: float, height: float) -> "Iterator[Figure]":
    """An empty figure of width × height inches for your own curves, in the style of the other pictures.

    Examples
    --------
    >>> with graph(6, 4) as figure:
    ...     axes = figure.subplots()
    ...     lines = axes.plot([0, 24], [0.1, 0.3], label="floes")
    ...     text = axes.set(xlabel="time [h]", ylabel="speed [m/s]"), axes.legend()
    >>> figure.savefig("speed.png")  # doctest: +SKIP
    """
    with in_style("white"):
        yield blank(width, height)


def _ledger_figure(data: "Dataset", title: str | None, size: int) -> "Figure":
    from floebmi.budgets import QUANTITIES, UNITS

    times = FrameTimes(data)
    time = times.seconds / times.unit
    stock = filled(data["ledger_stock"][:])
    gained = np.nan_to_num(filled(data["ledger_gained"][:]))
    accounts = [str(name) for name in data["ledger_account"][:]]
    width, dpi = inches_of(size)
    figure = blank(width, 0.85 * width, dpi)
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
        power = power_of(*axes.get_ylim())
        if power:
            axes.yaxis.set_major_formatter(in_powers_of(power))
        axes.set_ylabel(with_power(f"{name.replace('_', ' along ')} [{unit}]", power))
        axes.spines[["top", "right"]].set_visible(False)
    for axes in panels[1]:
        axes.set_xlabel(f"time [{times.name}]")
    lines = {line.get_label(): line for axes in panels.flat for line in axes.lines}
    figure.legend(lines.values(), lines, loc="outside lower center", ncols=4)
    title = f"{getattr(data, 'title', '')}: gains since the first frame" if title is None else title
    title = "\n".join(textwrap.wrap(title, int(0.95 * width * LETTERS_PER_INCH)))
    figure.suptitle(title, ha="left", x=0.02, fontsize=10, parse_math=False)
    return figure
