"""The picture of the floes of a run, which can show any frame: for `frame`, `animate` and `page` alike."""

from collections.abc import Sequence
from typing import Any, final

import numpy as np

from floebmi.canvas import INK, LAND, Bar, label_of, map_figure, scale_of
from floebmi.drawing import (
    draw_arrows,
    draw_circles,
    draw_graticule,
    draw_land,
    draw_scale_bar,
    draw_walls,
    draw_wind,
)
from floebmi.errors import check_word
from floebmi.floes import FIXED, LAND as LAND_BIT
from floebmi.reading import View, filled

SAMPLE = 20  # frames whose values make the colour scale


@final
class FloePicture:
    """A figure that can show any of some frames: what stands still is drawn once, the rest anew for each frame.

    The colour scale is that of a sample of all frames, so that pictures of one run are alike; values beyond it in the
    frames to be shown are seen at its ends.
    """

    def __init__(
        self,
        view: View,
        frames: Sequence[int],
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
            sample = np.unique(np.linspace(0, len(view.times.seconds) - 1, SAMPLE).astype(int))
            values = np.concatenate(
                [
                    *(self.values(k)[~self.still] for k in sample),
                    *(self._extremes(k) for k in np.setdiff1d(frames, sample)),
                ]
            )
            whole = color != "speed" and data[color].dtype.kind == "i"
            self.bar = Bar(self._label(color), scale_of(color, values, limits, whole))
        self.title = str(getattr(data, "title", "")) if title is None else title
        self.figure, self.axes = map_figure(view, size, self.title, self.bar, arrows is not None)
        draw_land(self.axes, view)
        self._numbers = draw_graticule(self.axes, view)
        draw_scale_bar(self.axes, view)
        self._time = self.axes.set_title("", loc="right", pad=7)  # where `map_figure` has put it
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
        self._moving += draw_walls(self.axes, self._view, k)
        self._moving += draw_wind(self.axes, self._view, k)
        if self._arrows is not None:
            self._moving += draw_arrows(self.axes, self._view, self._arrows, k)
        self._time.set_text(self._view.times.text(k))

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
        number, x, y = self._images(x, y, radius, np.flatnonzero(which))
        if array is not None:
            look["array"] = array[number]
        return draw_circles(self.axes, x, y, radius[number], self._view.length[0], zorder=3, **look)

    def _images(
        self, x: np.ndarray, y: np.ndarray, radius: np.ndarray, number: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Floes, and copies of those that reach across a periodic edge: number, x and y [m]."""
        data = self._view.data
        place = np.stack([x, y], axis=1)[number]
        for axis, (low, high), edge in (
            (0, data.domain_x, data.domain_west),
            (1, data.domain_y, data.domain_south),
        ):
            if edge != "periodic":
                continue
            period = (high - low) * np.eye(2)[axis]
            above = place[:, axis] + radius[number] > high
            below = place[:, axis] - radius[number] < low
            number = np.concatenate([number, number[above], number[below]])
            place = np.concatenate([place, place[above] - period, place[below] + period])
        return number, place[:, 0], place[:, 1]

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
        """A variable of all floes at frame k."""
        variable = self._view.data[name]
        return filled(variable[k] if variable.ndim == 2 else variable[:])

    def _never_moves(self) -> np.ndarray:
        """Floes at rest in the first frame, and in the last one where they were then."""
        first, last = 0, len(self._view.times.seconds) - 1
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
        check_word("color", color, have)

    def values(self, k: int) -> np.ndarray:
        """What the colours of the floes show at frame k."""
        if self._color == "speed":
            return np.hypot(self.read("u", k), self.read("v", k))
        return self.read(self._color, k)

    def _extremes(self, k: int) -> np.ndarray:
        """Smallest and largest of these values, of floes that do not stand still; none without floes."""
        values = self.values(k)[~self.still]
        values = values[np.isfinite(values)]
        return np.array([values.min(), values.max()]) if values.size else values

    def _label(self, color: str) -> str:
        if color == "speed":
            return label_of("speed", "m s-1")
        variable = self._view.data[color]
        return label_of(variable.long_name, getattr(variable, "units", "1"))
