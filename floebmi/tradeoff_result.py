"""The result of a trade-off: what it recommends, its table and its picture, and the file beside a scene that it is kept in."""

import hashlib
import json
import shlex
import textwrap
from decimal import ROUND_CEILING, Context
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from floebmi.canvas import LINES, plain_numbers
from floebmi.errors import InputError
from floebmi.files import contents
from floebmi.output import open_file
from floebmi.plot import graph
from floebmi.scene import Scene, read_scene

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SUFFIX = ".tradeoff.nc"
FRONT, OTHERS = LINES[1], LINES[0]
RING = 11.0  # points across, with the number of a setting in it
GRAPH_WIDTH = 5.6  # of a figure, beside its list of settings [inches]
LIST_LETTERS_PER_INCH = 17.0  # about: they are smaller than those of labels
AS_IT_IS = "(the scene as it is)"
COMPARED = {  # quantities that are compared in each frame, and their meaning
    "transport": "mass that has left through the edges",
    "drift": "mean displacement of the ice, by mass",
    "area_fraction": "concentration in the cells",
    "velocity": "momentum of the ice in the cells",
    "stress": "internal pressure in the cells",
}


# ---- what to say ------------------------------------------------------------------------------------


def acceptable(data: "xr.Dataset", error: float) -> "xr.DataArray":
    """Settings whose error is not above the requested one, or not above its uncertainty."""
    here = data.sel(quantity=data.attrs["of"])
    return (here.error <= error) | (here.error <= here.noise)


def recommended(data: "xr.Dataset", error: float) -> str | None:
    """The fastest setting whose error is at most `error`, or None."""
    good = [
        str(s) for s in data.setting.values[acceptable(data, error).values]
        if s != data.attrs["reference"]
    ]  # fmt: skip
    cost = data.cost_per_day
    return min(good, key=lambda s: float(cost.sel(setting=s))) if good else None


def setting_text(data: "xr.Dataset", setting: str) -> str:
    """A setting as command-line options, its error, and the uncertainty of the error."""
    of = data.attrs["of"]
    one = data.sel(setting=setting, quantity=of)
    told = " ".join(f"--set {change}" for change in setting.split()) or AS_IT_IS
    noise = (
        f", which {data.attrs['seeds']} seeds know to ± {float(one.noise):.2g}"
        if one.noise > 0
        else ""
    )
    return f"{told} (error of {of} {float(one.error):.2g}{noise})"


def front(data: "xr.Dataset") -> list[str]:
    """Pareto front: settings that no other beats in both cost and error, the fastest first."""
    errors, found, least = data.error.sel(quantity=data.attrs["of"]), [], np.inf
    for k in np.argsort(data.cost_per_day.values):
        if errors.values[k] < least and np.isfinite(data.cost_per_day.values[k]):
            found.append(str(data.setting.values[k]))
            least = float(errors.values[k])
    return found


def table(data: "xr.Dataset") -> str:
    """Settings in order of cost, one line each."""
    names = [str(q) for q in data["quantity"].values]
    base = float(data.cost_per_day.sel(setting=""))
    on_front = front(data)
    width = max(len(AS_IT_IS), *(len(str(s)) for s in data.setting.values))
    head = f"  {'setting':<{width}}  {'s/day':>8}  {'× speed':>8}" + "".join(
        f"{n:>22}" for n in names
    )
    lines = [f"{head}{'energy':>10}{'I':>9}"]
    for k in np.argsort(data.cost_per_day.values):
        one = data.isel(setting=k)
        text = str(one.setting.item())
        mark = "*" if text in on_front else " "
        cells = "".join(f"{_with_noise(one.sel(quantity=n)):>22}" for n in names)
        cost = float(one.cost_per_day)
        inertia = float(one.inertia_number)
        lines.append(
            f"{mark} {text or AS_IT_IS:<{width}}  {cost:>8.3g}  {base / cost:>8.2f}{cells}"
            f"{float(one.energy_residual):>10.0e}" + (f"{inertia:>9.0e}" if np.isfinite(inertia) else f"{'–':>9}")
        )  # fmt: skip
    return "\n".join(lines)


def _with_noise(one: "xr.Dataset") -> str:
    error, noise = float(one.error), float(one.noise)
    if error == 0.0:
        return "0"
    return f"{error:.2g}" + (f" ± {noise:.2g}" if noise > 0 else "")


def figure(data: "xr.Dataset") -> "Figure":
    """Figure of error against cost of each setting, with the Pareto front."""
    of, on_front = data.attrs["of"], front(data)
    here = data.sel(quantity=of)
    here = here.isel(setting=np.argsort(here.cost_per_day.values))
    here = here.where(here.error > 0, drop=True)
    words = [
        textwrap.fill(str(s) or AS_IT_IS, 58, subsequent_indent=6 * " ")
        for s in here.setting.values
    ]
    letters = max((len(line) for text in words for line in text.splitlines()), default=0)
    column = 0.6 + letters / LIST_LETTERS_PER_INCH
    with graph(GRAPH_WIDTH + column, 4.6) as drawn:
        drawn.dpi = 160
        ax, names = drawn.subplots(1, 2, width_ratios=(GRAPH_WIDTH, column))
        line = [s for s in on_front if s in here.setting.values]
        ax.plot(
            here.cost_per_day.sel(setting=line), here.error.sel(setting=line), "-", color=FRONT,
            lw=1.2, zorder=1, label="front: nothing is both faster and better",
        )  # fmt: skip
        names.axis("off")
        for k, s in enumerate(here.setting.values):
            one = here.sel(setting=s)
            place = float(one.cost_per_day), float(one.error)
            colour = FRONT if s in on_front else OTHERS
            noise = float(one.noise)
            if noise > 0:
                low = min(noise, 0.7 * place[1])
                ax.errorbar(*place, [[low], [noise]], fmt="none", ecolor="#b0b0b0", elinewidth=0.8)
            ax.plot(*place, "o", ms=3, color=colour, zorder=2)
            names.text(
                0.0, 1.0 - (k + 0.5) / len(here.setting), f"{k + 1:>2}  {words[k]}", fontsize=7,
                color=colour, va="center", transform=names.transAxes,
            )  # fmt: skip
        ax.set(
            xscale="log", yscale="log", title=data.attrs["title"], xlabel="CPU time per simulated day [s]",
            ylabel=f"error of {of} [1]\n({COMPARED[of]})",
        )  # fmt: skip
        plain_numbers(ax.xaxis)
        plain_numbers(ax.yaxis)
        ax.legend(loc="best", fontsize=7)
        _draw_marks(ax)
    return drawn


def _draw_marks(ax: "Axes") -> None:
    """A numbered ring for each point: around it, or beside it where rings would overlap."""
    from matplotlib.transforms import ScaledTranslation

    figure = ax.figure
    figure.draw_without_rendering()  # from here on it is known where the dots are
    ax.autoscale(False)
    dots = [line for line in ax.lines if line.get_marker() == "o"]
    places = [ax.transData.transform(dot.get_xydata()[0]) * 72 / figure.dpi for dot in dots]
    angles = np.radians([90, 270, 45, 225, 135, 315, 0, 180])
    around = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    shifts = np.concatenate([np.zeros((1, 2)), *(r * around for r in (16.0, 28.0, 40.0))])
    taken: list[np.ndarray] = []
    for k, dot in enumerate(dots):
        others = np.array([*places[:k], *places[k + 1 :], *taken]).reshape(-1, 2)
        free = (
            shift
            for shift in shifts  # neither on another ring or dot, nor with a dot in between
            if (np.hypot(*(places[k] + shift - others).T) > 0.85 * RING).all()
            and (np.hypot(*(places[k] + 0.5 * shift - others).T) > 0.4 * RING).all()
        )
        shift = next(free, shifts[0])
        taken.append(places[k] + shift)
        colour = dot.get_color()
        at = {"xy": dot.get_xydata()[0], "xytext": shift, "textcoords": "offset points"}
        line = {"arrowstyle": "-", "color": colour, "lw": 0.6, "shrinkA": 0, "shrinkB": 0}
        ax.annotate("", **at, arrowprops=line, zorder=2)
        beside = ax.transData + ScaledTranslation(*shift / 72, figure.dpi_scale_trans)
        ax.plot(*at["xy"], "o", ms=RING, mfc="white", mec=colour, zorder=3, transform=beside)
        ax.annotate(
            str(k + 1), **at, ha="center", va="center", fontsize=6.5, color=colour, zorder=4
        )


# ---- the file of a scene ----------------------------------------------------------------------------


def stored(scene: Scene) -> Path:
    """The path of the result for a scene, beside it."""
    return scene.file.with_suffix(SUFFIX)


def digest(text: str) -> str:
    """What a text of a scene is known by in runs and results."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def files_of(scene: Scene) -> dict[str, str]:
    """Contents of the files that a scene reads; runs and results are valid only for the same contents."""
    return {name: contents(scene.file.parent / name) for name in scene.paths()}


def result(scene: Scene) -> "xr.Dataset | None":
    """The result stored beside a scene; None if there is none for its text, these overrides and its current files."""
    path = stored(scene)
    data = read(path) if path.exists() else None
    return data if data is not None and _is_of(data, scene) and not _changed(data, scene) else None


def _is_of(data: "xr.Dataset", scene: Scene) -> bool:
    return data.attrs.get("scene_hash") == digest(scene.text)


def _changed(data: "xr.Dataset", scene: Scene) -> list[str]:
    """The files of a scene that have changed since a result was measured."""
    then = json.loads(data.attrs.get("files", "{}"))
    return [name for name, now in files_of(scene).items() if then.get(name) != now]


def read(path: Path) -> "xr.Dataset":
    """Read a result from its file.

    Raises
    ------
    InputError
        if the file is missing, damaged, or not a result of `floebmi tradeoff`.
    """
    import xarray as xr

    with open_file(path, "tradeoff"), xr.open_dataset(path) as data:
        return data.load()


def chosen(scene: Scene, accuracy: float) -> str:
    """The setting that a stored result recommends for a given error.

    Raises
    ------
    InputError
        if there is no result beside the scene, if it is for another text of the scene, other overrides or files that
        have changed since, or if no setting is that accurate.
    """
    path, data = stored(scene), result(scene)
    make = f"floebmi tradeoff {scene.file} --to {path}"
    if not path.exists():
        raise InputError(
            f"--accuracy: there is no {path.name} beside {scene.file}; {make} makes it"
        )
    if data is None:
        other = read(path)
        overrides = json.loads(other.attrs.get("overrides", "[]"))
        same = "".join(f" --set {shlex.quote(override)}" for override in overrides)
        own = read_scene(scene.file, overrides)
        if _is_of(other, own) and _changed(other, own):
            changed = ", ".join(_changed(other, own))
            raise InputError(
                f"{path}: {changed} changed since it was measured; {make}{same} makes it anew"
            )
        if _is_of(other, own) and overrides:
            raise InputError(
                f"{path}: was measured with{same}: give these too and first, or {make} makes it anew"
            )
        raise InputError(
            f"{path}: was measured for another text of {scene.file}; {make} makes it anew"
        )
    setting = recommended(data, accuracy)
    if setting is None:
        least = float(data.error.sel(quantity=data.attrs["of"]).where(data.error > 0).min())
        told = Context(prec=2, rounding=ROUND_CEILING).create_decimal_from_float(least)
        raise InputError(
            f"--accuracy {accuracy:g}: no setting in {path} is so accurate; must be at least {told:g}"
        )
    return setting
