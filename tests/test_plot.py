"""Pictures, films and pages of a run show what its files hold, and can be read."""

import base64
import doctest
import errno
import json
import os
import re
import shutil
import subprocess
import warnings

import matplotlib
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex, to_rgb, to_rgba
from matplotlib.contour import ContourSet
from matplotlib.quiver import Quiver
from matplotlib.text import Annotation, Text
from netCDF4 import Dataset
from small_run import DOMAIN, GRIDS, LAND, small_model, small_run

from floebmi import (
    AirDrag,
    Domain,
    Floes,
    Grid,
    InputError,
    Model,
    OceanDrag,
    Wall,
    frictional,
    plot as draw,
)
from floebmi.floes import COAST
from floebmi.output import GriddedWriter, TrajectoryWriter
from floebmi.running import run as run_model
from floebmi.variables import find


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    return small_run(folder, projection="EPSG:3413", reference="1979-01-15 12:00")


def pixels(figure):
    figure.canvas.draw()
    return np.asarray(figure.canvas.buffer_rgba())[:, :, :3].astype(int)


def seen(figure, color):
    """Area [m²] that has a colour, but for a narrow rim inside the frame line."""
    axes, image = figure.axes[0], pixels(figure)
    box = axes.get_window_extent()
    low, high, rim = round(image.shape[0] - box.y1), round(image.shape[0] - box.y0), 3
    inside = image[low + rim : high - rim, round(box.x0) + rim : round(box.x1) - rim]
    wanted = np.array(matplotlib.colors.to_rgb(color)) * 255
    unit = 1e3 if "km" in axes.get_xlabel() else 1.0
    metres = np.ptp(axes.get_xlim()) * unit / box.width
    return (np.abs(inside - wanted).max(axis=2) <= 6).sum() * metres**2


def written(folder, domain, floes, **how):
    model = Model(domain, floes, frictional())
    path = folder / "floes.nc"
    with TrajectoryWriter(path, model, contacts=False, overwrite=True, **how) as writer:
        writer.write(model)
        model.advance(60.0)
        writer.write(model)
    return path


def test_a_floe_is_a_circle_of_its_true_size(tmp_path):
    domain = Domain((0.0, 1000.0), (0.0, 800.0))
    path = written(tmp_path, domain, Floes(500.0, 400.0, 300.0, 1.0))
    figure = draw.frame(path, color=None, size=1200)
    assert seen(figure, "white") == pytest.approx(np.pi * 300**2, rel=0.01)


def test_a_floe_on_a_periodic_edge_is_seen_on_both_sides(tmp_path):
    floes = Floes([0.0, 500.0], [0.0, 400.0], [170.0, 100.0], 1.0)
    areas = []
    for edge in ("periodic", "inactive"):
        domain = Domain((0.0, 1000.0), (0.0, 800.0), edge, edge, edge, edge)
        path = written(tmp_path, domain, floes.copy())
        figure = draw.frame(path, time=0, color=None)
        areas.append(seen(figure, "white"))
    both = np.pi * (170**2 + 100**2)
    assert areas[0] == pytest.approx(both, rel=0.05)
    assert areas[1] == pytest.approx(both - 0.75 * np.pi * 170**2, rel=0.05)


@pytest.mark.parametrize("motion", [7, COAST])
def test_floes_that_stand_have_the_colour_of_land_and_those_that_are_driven_do_not(
    tmp_path, motion
):
    domain = Domain((0.0, 1000.0), (0.0, 800.0))
    driven = Floes(700.0, 400.0, 150.0, 1.0, u=0.1, motion=7)
    still = Floes(250.0, 400.0, 200.0, 1.0, motion=motion)
    path = written(tmp_path, domain, Floes.concatenate([still, driven]))
    figure = draw.frame(path)
    assert seen(figure, draw.LAND) == pytest.approx(np.pi * 200**2, rel=0.02)


def test_polygons_of_land_and_dry_cells_are_drawn(run, tmp_path):
    figure = draw.frame(run[1], run[0])  # the dry cells: 6 km × 4 km
    assert seen(figure, draw.LAND) == pytest.approx(24e6, rel=0.05)
    lake = 1e3 * np.array([[15.0, 1.0], [17.0, 1.0], [17.0, 3.0], [15.0, 3.0]])
    path = written(tmp_path, DOMAIN, Floes(5e3, 5e3, 500.0, 1.0), land=[*LAND, lake])
    figure = draw.frame(path)
    assert seen(figure, draw.LAND) == pytest.approx(20e6, rel=0.1)


def test_colours_are_those_of_the_quantity(run):
    figure = draw.frame(run[1], time=0, color="thickness")
    circles = figure.axes[0].collections[-1]
    np.testing.assert_array_equal(circles.get_array(), np.linspace(0.5, 2.0, 16)[:15])
    assert figure.axes[1].get_ylabel() == "thickness [m]"
    figure = draw.frame(run[1], time=0, color="speed")
    assert figure.axes[0].collections[-1].get_array()[0] == 1.0
    assert figure.axes[1].get_ylabel() == "speed [m s⁻¹]"


def test_the_colour_scale_holds_all_frames_unless_limits_are_given(run):
    ends = [draw.frame(run[1], time=k).axes[0].collections[-1].get_clim() for k in (0, 3)]
    assert ends[0] == ends[1]
    for limits, beyond in (((0.0, 0.25), ["up"]), ((0.05, 2.0), ["down"]), ((0.0, 2.0), [])):
        figure = draw.frame(run[1], limits=limits)
        assert figure.axes[0].collections[-1].get_clim() == limits
        bar = figure.axes[1]  # with a tip where there are values beyond
        tips = [patch.get_path().get_extents() for patch in bar.patches]
        assert ["up" if tip.y0 >= limits[1] else "down" for tip in tips] == beyond


def test_the_colour_scale_is_of_the_fastest_whenever_it_is(tmp_path):
    model, path = (
        Model(DOMAIN, Floes(5e3, 5e3, 500.0, 1.0, u=0.1), frictional()),
        tmp_path / "floes.nc",
    )
    with TrajectoryWriter(path, model) as writer:
        for model.time, model.floes.u[0] in ((0.0, 0.1), (1.0, 0.7), (2.0, 0.3)):
            writer.write(model)
    assert draw.frame(path).axes[0].collections[-1].get_clim() == (0.0, 0.7)


def test_whole_numbers_have_a_colour_each_and_many_share_the_last(run, tmp_path):
    circles = draw.frame(run[1], time=0, color="contact_count").axes[0].collections[-1]
    assert circles.norm.boundaries.tolist() == [-0.5, 0.5, 1.5]
    angle = np.linspace(0.0, 2 * np.pi, 9)[:-1]
    x, y = 5e3 + 1590.0 * np.cos(angle), 5e3 + 1590.0 * np.sin(angle)
    model = Model(DOMAIN, Floes([5e3, *x], [5e3, *y], [1e3, *8 * [600.0]], 1.0), frictional())
    with TrajectoryWriter(tmp_path / "floes.nc", model) as writer:
        writer.write(model)
    scale = draw.frame(tmp_path / "floes.nc", color="contact_count").axes[0].collections[-1].norm
    assert scale.boundaries.tolist() == [k - 0.5 for k in range(8)] and scale.extend == "max"


def test_a_scale_cuts_off_what_stands_out_and_nothing_else(tmp_path):
    for fastest, end in ((0.12, 0.12), (0.101, 0.101), (9.0, 0.1)):
        floes = Floes(np.arange(1.0, 201.0) * 1e3, 1e3, 400.0, 1.0, u=[fastest, *199 * [0.1]])
        path = tmp_path / f"{fastest}.nc"
        model = Model(Domain((0, 202e3), (0, 2e3)), floes, frictional())
        with TrajectoryWriter(path, model) as writer:
            writer.write(model)
        clim = draw.frame(path).axes[0].collections[-1].get_clim()
        assert clim == (0.0, end)


def test_the_scale_of_a_place_is_where_the_floes_are(tmp_path):
    domain = Domain((-400e3, 400e3), (-3e6, -2e6))
    floes = Floes([-300e3, 350e3, 10e3], [-2.9e6, -2.1e6, -2.5e6], 5e3, 1.0)
    path = written(tmp_path, domain, floes, projection="EPSG:3413")  # about 45 degrees west
    with Dataset(path) as data:
        for name in ("x", "y", "longitude", "latitude"):
            ends = data[name][:].min(), data[name][:].max()
            circles = draw.frame(path, color=name).axes[0].collections[-1]
            assert circles.get_clim() == pytest.approx(ends), name
            assert circles.get_cmap().name == "viridis"


def test_a_map_without_values_has_no_colour_bar_and_says_so(tmp_path):
    model = Model(DOMAIN, Floes([], [], [], []), frictional(), [OceanDrag()], GRIDS["uniform"]())
    gridded, _, _ = small_run(tmp_path, model, frames=1)
    figure = draw.field(gridded, "thickness")
    assert len(figure.axes) == 1
    said = [text.get_text() for text in figure.findobj(Text)]
    assert any(text.endswith(": no values at this time") for text in said)
    assert len(draw.field(gridded, "area_fraction").axes) == 2
    assert len(draw.field(gridded, "thickness", limits=(0.0, 1.0)).axes) == 2


def test_a_title_is_cut_into_lines_of_about_the_same_length(run):
    title = "A box of the open pack: wind, current and the turning of the Earth"
    lines = draw.frame(run[1], title=title, size=900).axes[0].get_title("left").split("\n")
    assert " ".join(lines) == title and len(lines) == 2
    assert abs(len(lines[0]) - len(lines[1])) < 10


def test_signs_that_the_font_lacks_are_drawn_in_the_fonts_of_the_users_style(run, tmp_path):
    sign, to = "\N{CONICAL TAPER}", tmp_path / "a.png"
    with pytest.warns(UserWarning, match="missing from font"):
        draw.frame(run[1], title=sign, to=to)
    with warnings.catch_warnings(action="error"), matplotlib.rc_context():
        matplotlib.rcParams["font.sans-serif"] = ["STIXGeneral"]
        draw.frame(run[1], title=sign, to=to)


def test_title_time_axes_and_size_are_right(run):
    figure = draw.frame(run[1], run[0], time=1, size=800)
    axes = figure.axes[0]
    assert axes.get_title("left") == "A small run"
    assert axes.get_title("right") == "1979-01-15 12:01"
    assert axes.get_xlabel() == "x [km]" and axes.get_xlim() == (0.0, 20.0)
    assert axes.get_ylim() == (0.0, 16.0)
    assert pixels(figure).shape[1] == 800
    assert axes.get_ylabel() == "y [km]"
    texts = {text.get_text(): text for text in axes.texts}
    assert "mean wind 8.9 m/s" in texts and "2 km" in texts
    (bar,) = (line for line in axes.lines if len(line.get_xdata()) == 2)
    ends = axes.transData.inverted().transform(bar.get_transform().transform(bar.get_xydata()))
    assert np.ptp(ends[:, 0]) == pytest.approx(2.0)
    (arrow,) = (text for text in axes.texts if isinstance(text, Annotation))
    way = np.subtract(arrow.xy, arrow.xyann)
    assert way / np.hypot(*way) == pytest.approx(np.array([8.0, -4.0]) / 80**0.5)


def test_a_long_title_does_not_run_into_the_time(tmp_path):
    title = "A very long title that tells everything about the run, its ice and its weather"
    model = Model(DOMAIN, Floes(5e3, 5e3, 500.0, 1.0), frictional())
    with TrajectoryWriter(
        tmp_path / "a.nc", model, {"title": title}, contacts=False, reference="1979-01-15"
    ) as writer:
        writer.write(model)
    for size in (500, 1200):
        figure = draw.frame(tmp_path / "a.nc", size=size)
        figure.canvas.draw()
        axes = figure.axes[0]
        boxes = [
            text.get_window_extent()
            for text in axes.get_children()
            if isinstance(text, Text) and text.get_text().startswith(("A very long", "1979-01-15"))
        ]
        assert len(boxes) == 2
        assert not boxes[0].overlaps(boxes[1]), size
        assert max(box.y1 for box in boxes) < figure.bbox.y1


def test_elapsed_time_is_shown_where_the_run_has_no_date(tmp_path):
    path = written(tmp_path, DOMAIN, Floes(5e3, 5e3, 500.0, 1.0))
    assert draw.frame(path).axes[0].get_title("right") == "t = 60 s"
    model = Model(DOMAIN, Floes(5e3, 5e3, 500.0, 1.0), frictional())
    for end, told, unit in ((7200.0, "t = 120 min", "min"), (9e4, "t = 25 h", "h"), (864e3, "t = 10 d", "d")):  # fmt: skip
        with TrajectoryWriter(path, model, overwrite=True) as writer:
            for model.time in (0.0, end):
                writer.write(model)
        assert draw.frame(path).axes[0].get_title("right") == told
        curves = draw.ledger(path).axes[2]
        assert curves.get_xlabel() == f"time [{unit}]"
        assert f"t = {curves.lines[0].get_xdata()[-1]:g} {unit}" == told


@pytest.mark.parametrize("arrows, vector", [("wind", (8.0, -4.0)), ("ocean", (0.0, 0.1))])
def test_arrows_are_those_of_the_field(run, arrows, vector):
    axes = draw.frame(run[1], run[0], arrows=arrows).axes[0]
    quiver, grid = axes.collections[-1], run[2].grid
    np.testing.assert_allclose(np.stack([quiver.U, quiver.V], axis=1), [vector] * quiver.N)
    places = np.stack([grid.x, grid.y], axis=1)[grid.wet] / 1e3
    np.testing.assert_allclose(sorted(quiver.XY.tolist()), sorted(places.tolist()))
    assert quiver.scale == pytest.approx(np.hypot(*vector) / (0.045 * 20.0))  # a usual one: 0.9 km
    key = axes.artists[-1]
    word = {"wind": "wind 5 m/s", "ocean": "current 0.1 m/s"}[arrows]
    assert key.text.get_text() == word and f" {key.U:g} " in word


def test_arrows_of_stress_are_of_the_stress_on_the_ocean_and_of_the_nearest_time(run, tmp_path):
    quiver = draw.field(run[0], arrows="stress").axes[0].collections[-1]
    with Dataset(run[0]) as data:
        name = find("ocean_stress_x").file_name
        assert set(quiver.U) <= set(data[name][-1].compressed())
    model = small_model()
    floes, fields = tmp_path / "floes.nc", tmp_path / "gridded.nc"
    with TrajectoryWriter(floes, model) as each, GriddedWriter(fields, model) as seldom:
        for k, current in enumerate((0.1, 0.2, 0.3, 0.4, 0.5)):
            model.time, model.ocean.u[:] = 100.0 * k, current
            each.write(model)
            if k % 2 == 0:
                seldom.write(model)
    for time, current in ((0, 0.1), (2, 0.3), (4, 0.5)):
        quiver = draw.frame(floes, fields, time=time, arrows="ocean").axes[0].collections[-1]
        np.testing.assert_allclose(quiver.U, current)


def test_a_graticule_says_on_which_side_of_the_equator_and_of_greenwich_its_lines_are(tmp_path):
    for projection, west_south in (("EPSG:3413", "WN"), ("EPSG:3031", "WS")):
        north = projection == "EPSG:3413"
        y = (-3e6, -2.6e6) if north else (2.6e6, 3e6)
        domain = Domain((-1.4e6, -1.0e6), y)
        grid = Grid.uniform(domain.x, domain.y, spacing=100e3)
        model = Model(domain, Floes(-1.2e6, np.mean(y), 5e3, 1.0), forces=[OceanDrag()], grid=grid)
        path = tmp_path / f"{north}.nc"
        with GriddedWriter(path, model, projection=projection) as writer:
            writer.write(model)
        told = {text.get_text()[-1] for text in draw.field(path).axes[0].texts if "°" in text.get_text()}  # fmt: skip
        assert told == set(west_south), projection


def shown(figure):
    """What is written in a picture, with the boxes that it takes."""
    figure.canvas.draw()
    texts = []
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            ticks = [tick for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high]
            texts += [text for tick in ticks for text in (tick.label1, tick.label2)]
            texts += [axis.label, axis.get_offset_text()]
        texts += [one for one in axes.get_children() if isinstance(one, Text)]
    texts = [text for text in texts if text.get_visible() and text.get_text()]
    return [(text.get_text(), text.get_window_extent()) for text in texts]


def faults(figure):
    """Texts that are cut off, and those that lie on each other."""
    texts, (width, height) = shown(figure), figure.bbox.size
    cut = [
        text
        for text, box in texts
        if box.x0 < -1 or box.y0 < -1 or box.x1 > width + 1 or box.y1 > height + 1
    ]
    return cut + [
        (one, other)
        for k, (one, box) in enumerate(texts)
        for other, its in texts[:k]
        if min(box.x1, its.x1) - max(box.x0, its.x0) > 1
        and min(box.y1, its.y1) - max(box.y0, its.y0) > 1
    ]


@pytest.mark.parametrize("x, y", [(1e3, 1e6), (1e3, 30e3), (8e3, 30e3), (30e3, 1e3), (1e6, 1e3)])
def test_a_narrow_or_a_flat_domain_leaves_room_for_all_that_is_written(tmp_path, x, y):
    domain = Domain((0.0, x), (0.0, y))
    grid = Grid.uniform(domain.x, domain.y, spacing=(x / min(30, x / 500), y / min(30, y / 500)))
    model = Model(domain, Floes(x / 2, y / 2, 400.0, 1.0), None, [AirDrag()], grid)
    model.atmosphere.u[:] = 20.0
    paths = tmp_path / "gridded.nc", tmp_path / "floes.nc"
    title = {"title": "A title that tells a little of the run and its ice"}
    with (
        GriddedWriter(paths[0], model, title, reference="1979-01-15") as fields,
        TrajectoryWriter(paths[1], model, title, reference="1979-01-15") as floes,
    ):
        fields.write(model)
        floes.write(model)
    figures = draw.frame(paths[1], paths[0], arrows="wind"), draw.field(paths[0])
    for figure in figures:
        assert not faults(figure)
    bar = figures[1].axes[1].get_ylabel()
    assert " ".join(bar.split("\n")) == find("area_fraction").text + " [1]"  # no word is broken
    (arrows,) = (one for one in figures[0].axes[0].collections if isinstance(one, Quiver))
    inches = np.ptp(arrows.get_window_extent().intervalx) / figures[0].dpi
    assert arrows.width * arrows._dots_per_unit(arrows.units) > 1.5 and inches > 0.1
    (scale,) = (line for line in figures[0].axes[0].lines if len(line.get_xdata()) == 2)
    assert np.ptp(scale.get_xdata()) > 0.25  # inches


def test_places_far_from_the_origin_are_written_in_full(tmp_path):
    for width, told in ((8e3, ("100000", "−99992")), (80.0, ("100000000", "−99999920"))):
        domain = Domain((1e8, 1e8 + width), (-1e8, -1e8 + width))
        floe = Floes(1e8 + width / 2, -1e8 + width / 2, width / 10, 1.0)
        figure = draw.frame(written(tmp_path, domain, floe))
        assert not faults(figure)
        texts = [text for text, _ in shown(figure)]
        assert set(told) <= set(texts)
        assert pixels(figure).shape[1] == 1200
        assert not any("e" in text for text in texts if text[-1].isdigit())
    domain = Domain((5.123e6, 5.125e6), (-7.2e6, -7.16e6))  # no room for three numbers along x
    figure = draw.frame(written(tmp_path, domain, Floes(5.124e6, -7.18e6, 400.0, 1.0)))
    assert not faults(figure)
    assert figure.axes[0].get_xlabel() == "x [km]: 5123 to 5125"


def test_long_numbers_at_a_colour_bar_leave_room_for_its_label(tmp_path):
    for thickness in ([2.0, 2.00001], [2.0, 2.5], [-0.2, 0.1]):
        floes = Floes([5e3, 9e3], 5e3, 500.0, np.abs(thickness), u=thickness)
        path = written(tmp_path, DOMAIN, floes)
        for color in ("thickness", "u"):
            assert not faults(draw.frame(path, color=color))


def test_no_numbers_of_a_graticule_lie_on_each_other_and_it_goes_over_the_date_line(tmp_path):
    domain = Domain((-6e5, 6e5), (-5e5, 5e5))
    grid = Grid.uniform(domain.x, domain.y, spacing=50e3)
    model = Model(domain, Floes(3e5, 1e5, 5e3, 1.0), forces=[OceanDrag()], grid=grid)
    for middle, west, east in (("180", "170°E", "170°W"), ("0", "10°W", "10°E")):
        path = tmp_path / f"{middle}.nc"
        projection = f"+proj=laea +lon_0={middle} +lat_0=66"
        with GriddedWriter(path, model, projection=projection) as writer:
            writer.write(model)
        figure = draw.field(path)
        assert not faults(figure)
        numbers = [text for text, _ in shown(figure) if "°" in text]
        assert {west, east, "66°N"} <= set(numbers)
        lines = [one for one in figure.axes[0].collections if isinstance(one, ContourSet)]
        assert len(lines) == 2 and all(one.get_path_effects() for one in lines)  # on dark water
        x = {text.get_text(): text.get_position()[0] for text in figure.axes[0].texts}
        assert x[west] < 0.0 < x[east]


def test_the_times_of_a_file_differ_in_its_pictures(tmp_path):
    path, model = tmp_path / "floes.nc", Model(DOMAIN, Floes(5e3, 5e3, 500.0, 1.0), frictional())
    year = 365 * 86400.0
    for times, how, told in (
        ((-7200.0, -3600.0), {}, "t = −120 min"),
        ((-20 * 86400.0, 0.0), {}, "t = −20 d"),
        ((30 * year - 86400.0, 30 * year), {}, "t = 10949 d"),
        ((10.0, 20.0), {"reference": "1979-01-15"}, "1979-01-15 00:00:10"),
        ((60.0, 120.0), {"reference": "1979-01-15"}, "1979-01-15 00:01"),
    ):
        with TrajectoryWriter(path, model, overwrite=True, **how) as writer:
            for model.time in times:
                writer.write(model)
        first, last = (draw.frame(path, time=k).axes[0].get_title("right") for k in (0, 1))
        assert first == told and last != told


def test_a_field_that_is_negative_has_the_scale_of_one_that_is_not(tmp_path):
    floes, ends = Floes(5e3, 5e3, 500.0, 1.0), []
    model = Model(DOMAIN, floes, forces=[OceanDrag()], grid=GRIDS["uniform"]())
    for sign in (1.0, -1.0):
        model.ocean.u[:] = sign * np.linspace(0.3, 0.4, 80)
        with GriddedWriter(tmp_path / f"{sign}.nc", model) as writer:
            writer.write(model)
        figure = draw.field(tmp_path / f"{sign}.nc", "ocean_velocity_x")
        ends.append(figure.axes[0].collections[0].get_clim())
    assert ends[0] == pytest.approx((0.3, 0.4)) and ends[1] == pytest.approx((-0.4, -0.3))


def test_a_logarithmic_axis_within_a_decade_has_numbers_enough():
    with draw.graph(3, 3) as figure:
        axes = figure.subplots()
        axes.set(yscale="log", ylim=(1.8, 5.9))
        draw.plain_numbers(axes.yaxis)
    figure.canvas.draw()
    low, high = axes.get_ylim()
    shown = [
        text.get_text()
        for at, text in zip(axes.get_yticks(), axes.get_yticklabels(), strict=True)
        if low < at < high
    ]
    assert shown == ["2", "3", "4", "5"]


def test_the_numbers_of_a_graticule_stand_on_the_floes_with_a_rim(run):
    axes = draw.frame(run[1], run[0]).axes[0]
    numbers = [text for text in axes.texts if "°" in text.get_text()]
    assert numbers
    for number in numbers:
        assert number.get_zorder() > max(one.get_zorder() for one in axes.collections)
        assert to_rgba(number.get_color(), number.get_alpha()) == to_rgba(draw.INK)
        assert number.get_path_effects()


@pytest.mark.parametrize("kind", GRIDS)
def test_a_field_is_drawn_on_each_kind_of_grid(tmp_path, kind):
    gridded, _, model = small_run(tmp_path, small_model(GRIDS[kind]()), frames=2)
    figure = draw.field(gridded, "area_fraction", arrows="ice", to=tmp_path / "a.png")
    drawn = figure.axes[0].collections[0].get_array().compressed()
    np.testing.assert_array_equal(drawn, model.fields()["area_fraction"][model.grid.wet])
    assert (tmp_path / "a.png").stat().st_size > 10_000


def test_a_field_is_of_its_time_and_says_what_it_is(run):
    figure = draw.field(run[0], "ice_velocity_x", time=1, title="before all")
    axes, bar = figure.axes
    with Dataset(run[0]) as data:
        shown, last = (data[find("ice_velocity_x").file_name][k].compressed() for k in (1, -1))
    assert axes.collections[0].get_array().compressed().tolist() == shown.tolist() != last.tolist()
    assert axes.get_title("left") == "before all"
    assert axes.get_title("right") == "1979-01-15 12:01"
    assert bar.get_ylabel().endswith("[m s⁻¹]")
    assert axes.get_facecolor() == to_rgba(draw.WATER)  # where there is no ice
    assert draw.field(run[0], "ocean_velocity_y").axes[0].get_facecolor() == to_rgba(draw.NOWHERE)
    assert draw.field(run[0], "area_fraction").axes[0].collections[0].get_clim() == (0.0, 1.0)


def test_fields_with_a_sign_get_a_scale_with_zero_in_the_middle(run):
    figure = draw.field(run[0], "wind_y", time=0)
    assert figure.axes[0].collections[0].get_clim()[1] <= 0.0
    figure = draw.field(run[0], "ocean_stress_x")
    low, high = figure.axes[0].collections[0].get_clim()
    assert low == -high or low == 0.0


def test_the_ledger_shows_gains_accounts_and_a_residual_of_round_off(run):
    figure = draw.ledger(run[1])
    mass, along_x = figure.axes[0], figure.axes[1]
    lines = {line.get_label().partition(" (")[0]: line.get_ydata() for line in along_x.lines}
    assert {"gain of the ice", "wind", "ocean drag", "residual"} <= set(lines)
    accounts = [y for label, y in lines.items() if label not in ("gain of the ice", "residual")]
    np.testing.assert_allclose(sum(accounts), lines["gain of the ice"], rtol=1e-9)
    assert abs(lines["residual"]).max() < 1e-9 * abs(lines["wind"]).max()
    assert mass.get_ylabel() == "mass [10⁹ kg]"
    assert along_x.get_ylabel() == "momentum along x [10⁶ N s]"


def test_the_powers_of_ten_of_a_ledger_stand_with_its_units(tmp_path):
    model, path = Model(DOMAIN, Floes(5e3, 5e3, 500.0, 1.0), frictional()), tmp_path / "floes.nc"
    with TrajectoryWriter(path, model) as writer:
        writer.write(model)
        model.floes.add([9e3], 9e3, 500.0, 1.0, u=0.01)
        model.advance(60.0)
        writer.write(model)
    figure = draw.ledger(path)
    FigureCanvasAgg(figure)
    assert not any("e" in text for text, _ in shown(figure) if text[-1].isdigit())
    with Dataset(path) as data:
        gain = float(np.diff(data["ledger_stock"][:, 0])[0])
    (mass,) = (one for one in figure.axes if one.get_ylabel().startswith("mass"))
    assert mass.get_ylabel() == "mass [10⁶ kg]"
    end, top = mass.lines[0].get_ydata()[-1], mass.yaxis.get_major_formatter()(gain, 0)
    assert end == pytest.approx(gain) and float(top) == pytest.approx(gain / 1e6)


def test_the_ledger_of_a_run_that_goes_on_begins_with_its_first_frame(tmp_path):
    model, path = small_model(), tmp_path / "floes.nc"
    model.advance(100.0)
    with TrajectoryWriter(path, model) as writer:
        writer.write(model)
        model.advance(100.0)
        writer.write(model)
    for axes in draw.ledger(path).axes[1:3]:
        assert {line.get_ydata()[0] for line in axes.lines} == {0.0}
        assert max(abs(line.get_ydata()[1]) for line in axes.lines) > 0.0


def test_no_two_accounts_of_a_ledger_are_drawn_alike(run, tmp_path):
    path = tmp_path / "floes.nc"
    path.write_bytes(run[1].read_bytes())
    with Dataset(path, "a") as data:
        data["ledger_account"][:12] = np.array([f"account {k}" for k in range(12)], "U32")
        rows = np.arange(float(len(data["time"])))[:, None, None]
        data["ledger_gained"][:, :12, :] = np.broadcast_to(rows, (rows.size, 12, 4))
    lines = draw.ledger(path).axes[1].lines
    assert len(lines) == 14
    assert len({(line.get_color(), line.get_linestyle()) for line in lines}) == 14


def test_a_ledger_says_what_has_not_changed_instead_of_showing_round_off(run, tmp_path):
    path = written(tmp_path, DOMAIN, Floes(5e3, 5e3, 500.0, 1.0, u=0.1))
    mass, along_x = draw.ledger(path).axes[:2]
    for axes, told in ((mass, "7.33562e+08 kg"), (along_x, "7.33562e+07 N s")):
        assert [one.get_text() for one in axes.texts] == [f"no change from {told}"]
        assert list(axes.get_yticks()) == [0.0]
    blown = draw.ledger(run[1]).axes[1]
    assert not blown.texts and "residual" in blown.get_title("right")


def test_the_colours_of_a_figure_are_not_those_of_the_readers_style(run):
    lines = [line for axes in draw.ledger(run[1]).axes for line in axes.lines]
    assert {line.get_color() for line in lines} <= {*draw.LINES, "0.75", "black"}


def test_a_power_of_ten_stands_with_the_unit(run):
    bar = draw.frame(run[1], limits=(0.0, 2e6)).axes[1]
    assert bar.get_ylabel() == "speed [10⁶ m s⁻¹]"
    bar.figure.canvas.draw()
    assert bar.get_yticklabels()[-1].get_text() == "2"


def test_a_graph_of_ones_own_has_the_style_and_leaves_none_behind():
    assert doctest.testmod(draw).failed == 0
    with draw.graph(3, 2) as figure:
        (line,) = figure.subplots().plot([0, 1], [0, 1])
    assert line.get_color() == draw.LINES[0] and line.axes.get_facecolor() == (1, 1, 1, 1)
    assert matplotlib.rcParams["axes.prop_cycle"].by_key()["color"][0] != draw.LINES[0]


def test_mp4_is_h264_that_browsers_play(run, tmp_path):
    import imageio_ffmpeg

    steps = []
    path = draw.animate(
        run[1], run[0], tmp_path / "a.mp4", size=401, fps=5, progress=lambda *at: steps.append(at)
    )
    frames = imageio_ffmpeg.read_frames(path)
    about = next(frames)
    assert about["codec"] == "h264" and about["pix_fmt"].startswith("yuv420p")
    assert all(length % 2 == 0 for length in about["size"]) and about["fps"] == 5
    images = list(frames)
    assert len(images) == 4 and images[0] != images[-1]
    assert steps == [(1, 4), (2, 4), (3, 4), (4, 4)]
    assert list(tmp_path.iterdir()) == [path]


def test_a_frame_of_a_film_is_the_picture_of_that_frame(run, tmp_path):
    from PIL import Image

    draw.animate(run[1], run[0], tmp_path / "a.gif", size=500, arrows="ice")
    for k in (0, 3):
        picture = pixels(draw.frame(run[1], run[0], time=k, size=500, arrows="ice"))
        with Image.open(tmp_path / "a.gif") as film:
            film.seek(k)
            shown = np.asarray(film.convert("RGB")).astype(int)
        assert shown.shape == picture.shape
        differs = np.abs(shown - picture).max(axis=2) > 40  # a gif has 256 colours
        assert differs.mean() < 0.002, k


def test_values_of_each_frame_that_is_shown_are_on_the_colour_scale(tmp_path):
    """Of a long series only some frames make the scale."""
    path, fast = tmp_path / "floes.nc", 21
    model = Model(Domain((0.0, 100.0), (0.0, 100.0)), Floes(50.0, 50.0, 10.0, 1.0))
    with TrajectoryWriter(path, model) as writer:
        for k in range(50):
            model.time, model.floes.u[:] = float(k), 1.0 if k == fast else 0.1
            writer.write(model)
    for k, highest in ((fast, 1.0), (fast + 1, 0.1)):
        _, bar = draw.frame(path, time=k, size=200).axes
        assert bar.get_ylim() == (0.0, highest)
    page = draw.page(path, tmp_path / "floes.html").read_text(encoding="utf-8")
    assert '"low": "0", "high": "1"' in page


def test_a_gif_of_many_floes_of_one_colour_shows_the_colour_scale_and_rare_colours_too(tmp_path):
    from PIL import Image

    from floebmi.film import write_gif

    colours = (255 * matplotlib.colormaps["viridis"](np.linspace(0, 1, 400))[:, :3]).astype("u1")
    shares = np.random.default_rng(1).random((400, 390, 1))  # of fast floes over water, in a pixel
    floes = shares * colours[-1] + (1 - shares) * np.array([211, 228, 238])
    picture = np.concatenate([floes.astype("u1"), np.tile(colours[:, None], (1, 10, 1))], axis=1)
    write_gif(tmp_path / "a.gif", iter([picture]), 12)
    with Image.open(tmp_path / "a.gif") as film:
        shown = np.asarray(film.convert("RGB"))
    assert np.abs(shown.astype(int) - picture).max() < 20


def test_gif_has_each_nth_frame(run, tmp_path):
    from PIL import Image

    draw.animate(run[1], to=tmp_path / "a.gif", size=300, every=2)
    with Image.open(tmp_path / "a.gif") as film:
        assert film.n_frames == 2
        assert (
            film.info["duration"] == 80 and film.info["loop"] == 0
        )  # 12 frames a second, for ever


def test_a_film_that_fails_leaves_nothing_behind(run, tmp_path):
    def fail(done, total):
        if done == 2:
            raise KeyboardInterrupt

    for name in ("a.mp4", "a.gif"):
        with pytest.raises(KeyboardInterrupt):
            draw.animate(run[1], to=tmp_path / name, size=300, progress=fail)
    assert not list(tmp_path.iterdir())


def test_a_film_that_the_disk_has_no_room_for_is_told_of_in_a_line(run, tmp_path, capfd):
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    try:
        with pytest.raises(OSError) as error:
            draw.animate(run[1], to=tmp_path / "a.mp4", size=300)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert (error.value.errno, error.value.filename) == (errno.EFBIG, str(tmp_path / "a.mp4"))
    assert capfd.readouterr() == ("", "")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("kind", ["mp4", "gif"])
def test_a_film_that_cannot_be_written_is_told_of_as_the_system_does(run, tmp_path, kind, capfd):
    path = tmp_path / f"a.{kind}"
    # the name it is written under leads to where nothing is
    (tmp_path / f"a.{kind}.{os.getpid()}.part").symlink_to(tmp_path / "no" / "where")
    with pytest.raises(OSError) as error:
        draw.animate(run[1], to=path, size=300)
    assert error.value.errno == errno.ENOENT
    assert error.value.filename == str(path)
    assert capfd.readouterr() == ("", "")


def test_the_users_settings_are_left_alone(run, tmp_path):
    with matplotlib.rc_context({"font.size": 17.0, "axes.facecolor": "red"}):
        before = dict(matplotlib.rcParams)
        draw.frame(run[1], run[0], to=tmp_path / "a.png")
        with pytest.raises(InputError):
            draw.frame(run[1], color="nonsense")
        assert dict(matplotlib.rcParams) == before


@pytest.mark.parametrize(
    "call, message",
    [
        (lambda f, g: draw.frame(f, color="sped"), "color = 'sped'.*did you mean 'speed'"),
        (lambda f, g: draw.frame(f, time=4), "time = 4: it has 4 frames; give -4 to 3"),
        (lambda f, g: draw.frame(g), "is 'gridded 1'; must be 'trajectories 1'"),
        (lambda f, g: draw.frame(f, arrows="ice"), "there is no gridded file with ice_velocity_x"),
        (lambda f, g: draw.frame(f, g, arrows="ise"), "arrows = 'ise'.*did you mean 'ice'"),
        (lambda f, g: draw.frame(f, to="a.xyz"), "a.xyz: allowed:.*.png"),
        (lambda f, g: draw.frame(f, to="no/a.png"), "there is no folder no"),
        (lambda f, g: draw.frame(f, size=10), "size = 10"),
        (lambda f, g: draw.frame(f, limits=(1.0, 1.0)), "limits = .*the smaller one first"),
        (lambda f, g: draw.field(g, limits=(1.0, 0.0)), "limits = .*the smaller one first"),
        (lambda f, g: draw.page(f, limits=(np.nan, 1.0)), "limits = .*two finite numbers"),
        (lambda f, g: draw.field(g, "thicknes"), "'thicknes'.*did you mean 'thickness'"),
        (lambda f, g: draw.field(g, "sea_surface_tilt_x"), "has no sea_surface_tilt_x"),
        (lambda f, g: draw.animate(f, to="a.avi"), "a.avi: allowed: .gif, .mp4"),
        (lambda f, g: draw.animate(f, to="a.gif", fps=0), "fps = 0: must be at least 1"),
        (
            lambda f, g: draw.animate(f, to="a.gif", fps=60),
            "fps = 60: must be at most 50 for a .gif",
        ),
    ],
)
def test_unusable_words_are_refused_in_one_line(run, call, message):
    with pytest.raises(InputError, match=message) as error:
        call(run[1], run[0])
    assert "\n" not in str(error.value)


def told_by(page):
    """The data of a page, with the arrays of its frames in shape."""
    text = page.read_text(encoding="utf-8")
    run = json.loads(re.search(r'type="application/json">(.*?)</script>', text, re.S)[1])
    shape = len(run["times"]), len(run["radius"])
    for name, kind in (("x", "<f4"), ("y", "<f4"), ("rgb", "u1")):
        values = np.frombuffer(base64.b64decode(run[name]), kind)
        run[name] = values.reshape(*shape, 3) if name == "rgb" else values.reshape(shape)
    return run


def test_a_page_holds_the_floes_of_every_frame_and_asks_for_nothing(run, tmp_path):
    _, trajectories, _ = run
    page = draw.page(trajectories, tmp_path / "run.html", title="</script> & more")
    told = told_by(page)
    with Dataset(trajectories) as data:
        for name in "xy":
            np.testing.assert_allclose(told[name], data[name][:].filled(np.nan), rtol=1e-6)
        here = ~np.ma.getmaskarray(data["x"][-1])
        radius = data["radius"][:]
        radius = radius[-1] if radius.ndim == 2 else radius
        np.testing.assert_allclose(np.array(told["radius"])[here], radius[here])
        assert np.ptp(np.array(told["radius"])[here]) > 0  # those that came later have their own
    assert told["title"] == "</script> & more" and len(told["times"]) == 4
    bar, viridis = told["bar"], matplotlib.colormaps["viridis"]
    high = draw.frame(trajectories).axes[0].collections[-1].get_clim()[1]
    assert (bar["low"], bar["high"], told["width"]) == ("0", f"{high:.3g}", "20 km")
    assert [bar["colours"][k] for k in (0, -1)] == [to_hex(viridis(end)) for end in (0.0, 1.0)]
    land = (np.array(to_rgb(draw.LAND)) * 255).round()
    assert (told["rgb"][:, 15] == land).all() and told["still"][15]
    speeds = {tuple(color) for color in told["rgb"][0, :15]}
    assert len(speeds) > 1  # floe 0 is the only one that moves at the start
    text = page.read_text(encoding="utf-8")
    assert not re.search(r"https?:|src=|@import|fetch\(", text)
    assert "{{" not in text and text.count("</script>") == 2


CLICKS = """
<script>
const found = [], note = () => found.push([get("clock").textContent, slider.value, get("play").textContent, sea.toDataURL()]);
const later = (ms, act) => setTimeout(() => { act(); note(); }, ms);
note();
later(100, () => { slider.value = slider.max; slider.dispatchEvent(new Event("input")); });
later(200, () => { slider.value = 0; slider.dispatchEvent(new Event("input")); });
later(300, () => get("play").click());
later(550, () => get("play").click());
later(1000, () => {});
setTimeout(() => { document.body.innerHTML = `<pre>${JSON.stringify(found)}</pre>`; }, 1100);
</script>
"""


@pytest.mark.long
def test_a_browser_plays_a_page_and_moves_its_slider(run, tmp_path):
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser is None:
        pytest.skip("needs chromium")
    page = draw.page(run[1], tmp_path / "run.html")
    times = told_by(page)["times"]
    page.write_text(page.read_text(encoding="utf-8") + CLICKS, encoding="utf-8")
    words = [
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--virtual-time-budget=3000",
        "--dump-dom",
    ]
    done = subprocess.run([browser, *words, page], capture_output=True, text=True, timeout=120)
    start, end, back, played, paused, later = json.loads(
        re.search(r"<pre>(.*)</pre>", done.stdout)[1]
    )
    last = str(len(times) - 1)
    assert start[:3] == [times[0], "0", "▶"]
    assert end[:3] == [times[-1], last, "▶"] and end[3] != start[3]
    assert back == start
    assert played == [*start[:2], "❚❚", start[3]]
    assert paused[1] != "0" and paused[2] == "▶" and paused[3] != start[3]
    assert later == paused


def test_a_page_shows_shores_walls_and_periods(tmp_path):
    domain = Domain((0.0, 1000.0), (0.0, 800.0), "periodic", "periodic", "closed")
    floes = Floes([100.0, 500.0], [200.0, 400.0], 50.0, 1.0)
    wall = Wall("north", position=700.0, velocity=-1.0)
    model = Model(domain, floes, frictional(), walls=[wall])
    path, shore = tmp_path / "floes.nc", np.array([[0.0, 0.0], [9.0, 0.0], [0.0, 9.0]])
    run_model(model, 20.0, every=10.0, trajectories=path, land=[shore])
    told = told_by(draw.page(path, tmp_path / "run.html"))
    assert told["box"] == [0.0, 1000.0, 0.0, 800.0] and told["period"] == [1000.0, 0.0]
    assert {tuple(node) for node in told["shores"][0]} == {tuple(node) for node in shore}
    walls = {wall["edge"]: wall["position"] for wall in told["walls"]}
    np.testing.assert_allclose(walls["north"], [700.0, 690.0, 680.0])
    other = told_by(draw.page(path, tmp_path / "other.html", every=2))
    assert len(other["times"]) == 2 and other["times"][1] == told["times"][2]
    walls = {wall["edge"]: wall["position"] for wall in other["walls"]}
    np.testing.assert_allclose(walls["north"], [700.0, 680.0])
    line = draw.frame(path, time=1).axes[0].lines[-1].get_xydata()
    np.testing.assert_allclose(line, [[0.0, 690.0], [1.0, 690.0]])  # across the picture


def test_a_page_far_from_the_origin_has_floes_where_they_are_and_a_scale_with_two_ends(tmp_path):
    domain = Domain((1e8, 1e8 + 100.0), (-1e8, -1e8 + 80.0))
    floes = Floes(
        1e8 + np.array([51.0, 81.0]), -1e8 + np.array([41.0, 33.0]), 8.0, [2.0001, 2.0003]
    )
    shore = np.array([[1e8, -1e8], [1e8 + 9.0, -1e8], [1e8, -1e8 + 9.0]])
    model = Model(domain, floes, frictional(), walls=[Wall("east", position=1e8 + 95.0)])
    with TrajectoryWriter(tmp_path / "floes.nc", model, land=[shore]) as writer:
        writer.write(model)
    told = told_by(draw.page(tmp_path / "floes.nc", tmp_path / "run.html", color="thickness"))
    west, _, south, _ = told["box"]
    np.testing.assert_allclose(told["x"][0] - west, [51.0, 81.0], rtol=1e-6)
    np.testing.assert_allclose(told["y"][0] - south, [41.0, 33.0], rtol=1e-6)
    assert {(x - west, y - south) for x, y in told["shores"][0]} == {(0, 0), (9, 0), (0, 9)}
    assert told["walls"] == [{"edge": "east", "position": [west + 95.0]}]
    assert (told["bar"]["low"], told["bar"]["high"]) == ("2.0001", "2.0003")


@pytest.mark.parametrize(
    "how, message",
    [
        ({"to": "a.htm"}, r"a.htm: .*\.html"),
        ({"to": "no/a.html"}, "no folder no"),
        ({"to": "a.html", "every": 0}, "every = 0: must be at least 1"),
        ({"to": "a.html", "color": "sped"}, "color = 'sped': .*speed"),
    ],
)
def test_a_page_that_cannot_be_made_is_refused(run, how, message):
    with pytest.raises(InputError, match=message):
        draw.page(run[1], **how)


def test_the_unit_1_is_not_raised_as_an_exponent(run):
    label = draw.field(run[0], "area_fraction").axes[1].get_ylabel()
    assert label.endswith("[1]")


@pytest.mark.parametrize(
    "wrong",
    [
        {"time": 1.5}, {"time": "last"}, {"time": None}, {"size": np.nan}, {"size": "large"},
        {"limits": (0.0, 1.0, 2.0)}, {"limits": 3.0},
        {"limits": "01"},
    ],
    ids=str,
)  # fmt: skip
def test_numbers_of_a_picture_that_cannot_be_are_refused(run, wrong):
    for picture in (lambda: draw.frame(run[1], **wrong), lambda: draw.field(run[0], **wrong)):
        with pytest.raises(InputError, match=next(iter(wrong))):
            picture()


@pytest.mark.parametrize("every", [0, 1.5, "2", None])
def test_frames_are_left_out_by_whole_numbers(run, tmp_path, every):
    with pytest.raises(InputError, match="every"):
        draw.page(run[1], tmp_path / "floes.html", every=every)
    with pytest.raises(InputError, match="every"):
        draw.animate(run[1], to=tmp_path / "floes.gif", every=every)


@pytest.mark.parametrize("fps", [0, np.nan, "12", None])
def test_a_film_has_frames_in_a_second(run, tmp_path, fps):
    with pytest.raises(InputError, match="fps"):
        draw.animate(run[1], to=tmp_path / "floes.gif", fps=fps)
