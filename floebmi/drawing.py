"""Elements of the maps: land, cells, graticule, arrows, wind, scale bar, walls, circles."""

from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from floebmi.canvas import COAST, INK, LAND, Scale, beside_of
from floebmi.errors import InputError, check_word
from floebmi.reading import View, cell_corners, centres, filled, shores, vectors

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Arrows = Literal["ice", "ocean", "wind", "stress"]
ARROWS = {
    "ice": ("ice_velocity", "m/s", "ice"),
    "ocean": ("ocean_velocity", "m/s", "current"),
    "wind": ("wind", "m/s", "wind"),
    "stress": ("ocean_stress", "Pa", "stress on ocean"),
}


def draw_land(axes: "Axes", view: View) -> None:
    """Draw land polygons if the file has them, else the dry cells."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Outline

    if rings := shores(view.data):
        nodes = np.concatenate(rings) / view.length[0]
        codes = np.full(len(nodes), Outline.LINETO, Outline.code_type)
        ends = np.cumsum([len(ring) for ring in rings])
        codes[ends - 1] = Outline.CLOSEPOLY
        codes[0] = codes[ends[:-1]] = Outline.MOVETO
        land = Outline(nodes, codes)  # lakes run the other way round, which leaves them open
        axes.add_patch(PathPatch(land, facecolor=LAND, edgecolor=COAST, linewidth=0.6, zorder=2))
    else:
        draw_dry_cells(axes, view)


def draw_dry_cells(axes: "Axes", view: View) -> None:
    """Draw the dry cells of the grid, if there is a gridded file."""
    from matplotlib.colors import ListedColormap, Normalize

    if view.gridded is not None and "land_mask" in view.gridded.variables:
        mask = view.gridded["land_mask"]
        dry = np.where(mask[:] == 1, 1.0, np.nan)
        scale = Scale(ListedColormap([LAND]), Normalize(0, 2))
        draw_cells(axes, view, mask.dimensions, dry, scale, zorder=2)


def draw_cells(
    axes: "Axes",
    view: View,
    dimensions: tuple[str, ...],
    values: np.ndarray,
    scale: Scale,
    zorder: float = 1,
) -> None:
    """Draw cells in the colours of their values; cells with NaN stay empty."""
    from matplotlib.collections import PolyCollection

    corners = cell_corners(view, dimensions)
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


def draw_graticule(axes: "Axes", view: View) -> list[Any]:
    """Draw lines of latitude and longitude, if the grid has them; returns their labels, which are drawn above the floes."""
    from matplotlib.patheffects import withStroke
    from matplotlib.ticker import MaxNLocator

    data = view.gridded
    numbers: list[Any] = []
    if data is None or "latitude" not in data.variables:
        return numbers
    x, y = centres(data, data["latitude"].dimensions, view.length[0])
    if min(np.shape(x)) < 3:
        return numbers
    draw = axes.contour if np.ndim(x) == 2 else axes.tricontour
    for name, signs in (("latitude", "NS"), ("longitude", "EW")):
        values = filled(data[name][:])
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


def draw_arrows(axes: "Axes", view: View, arrows: str, k: int) -> list[Any]:
    """Draw arrows on the grid, at most about 25 across, with a key under the lower right corner."""
    check_word("arrows", arrows, ARROWS)
    name, units, word = ARROWS[arrows]
    found = vectors(view, name, k)
    if found is None:
        raise InputError(f"arrows = {arrows!r}: there is no gridded file with {name}_x")
    u, v, dimensions = found
    x, y = centres(view.gridded, dimensions, view.length[0])
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
    right = corner.x1 * inches[0] + beside_of(corner.width * inches[0])
    axes.quiverkey(
        drawn, right - 0.2, corner.y0 * inches[1] - 0.66, key,
        f"{word} {key:g} {units}", labelpos="W", labelsep=0.12, coordinates="inches",
        fontproperties={"size": 8},
    )  # fmt: skip
    return [drawn, axes.artists[-1]]


def _below(axes: "Axes", side: Literal["left", "right"]) -> Any:
    """Coordinates in inches from a lower corner of the domain, for elements below the map."""
    from matplotlib.transforms import ScaledTranslation

    across = axes.get_position().width * axes.figure.get_figwidth()
    beside = beside_of(across) / across
    corner = ScaledTranslation(1.0 + beside if side == "right" else -beside, 0.0, axes.transAxes)
    return axes.figure.dpi_scale_trans + corner


def draw_scale_bar(axes: "Axes", view: View) -> None:
    """Draw a scale bar of a round length under the lower left corner."""
    west, east, _, _ = view.box
    across = axes.get_position().width * axes.figure.get_figwidth()
    per_inch = (east - west) / across
    length = _round_down(0.2 * (across + 2 * beside_of(across)) * per_inch)
    inches = length / per_inch
    under = {"transform": _below(axes, "left"), "clip_on": False}
    axes.plot(
        [0.0, inches], [-0.43, -0.43], color=INK, lw=2.5, solid_capstyle="butt",
        scalex=False, scaley=False, **under,
    )  # fmt: skip
    text = f"{length:g} {view.length[1]}"
    axes.text(inches + 0.06, -0.43, text, va="center", fontsize=8, **under)


def _round_down(value: float) -> float:
    """The largest number of the form 1, 2 or 5 × 10^n that does not exceed the value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(m for m in (1, 2, 5) if m * power <= value * (1 + 1e-9)))


def draw_wind(axes: "Axes", view: View, k: int) -> list[Any]:
    """Draw the mean wind as one arrow under the lower right corner."""
    found = vectors(view, "wind", k)
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


def draw_walls(axes: "Axes", view: View, k: int) -> list[Any]:
    """Draw walls that are not at the edge of the picture."""
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


def draw_circles(
    axes: "Axes", x: np.ndarray, y: np.ndarray, radius: np.ndarray, unit: float, **look: Any
) -> Any:
    """Draw floes as circles of their true size; `unit` is the length [m] of one unit of the axes."""
    from matplotlib.collections import EllipseCollection

    across = 2 * radius / unit
    circles = EllipseCollection(
        across, across, np.zeros(len(x)), units="xy", offsets=np.stack([x, y], axis=1) / unit,
        offset_transform=axes.transData, **look,
    )  # fmt: skip
    return axes.add_collection(circles, autolim=False)
