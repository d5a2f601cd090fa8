"""The figures of the paper, made with this model.

| figure | shows |
|---|---|
| 1 | the shear cell |
| 2 | the strait, with its current |
| 3 | shear stress and friction against normal stress, with fits of τ = C + μ_u N |
| 4 | displacement against height |
| 5 | the strait at several times, with force chains |
| 6, 7 | transport, survival and T against friction, against tensile strength |
| 8, 9, 10 | the same against width, spread of sizes, thickness; both models |
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from floebmi.canvas import INK, LAND, LINES, WATER, blank, in_style, plain_numbers, save
from floebmi.drawing import draw_circles
from floebmi.ensemble import Failure
from floebmi.errors import InputError
from floebmi.experiments import campaign, shear, statistics, strait
from floebmi.experiments.parameters import NORMAL_STRESSES, Experiment, Shear, Strait, make
from floebmi.files import check_target, path_of

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FRICTIONAL = {"friction": (0.3,), "tensile_strength": (0.0,)}
COHESIVE = {"friction": (0.0,), "tensile_strength": (200e3,)}
NEITHER = {"friction": (0.0,), "tensile_strength": (0.0,)}
TWO = {"frictional": FRICTIONAL, "cohesive": COHESIVE}
THREE = {**TWO, "neither": NEITHER}
COLOURS = {"frictional": LINES[0], "cohesive": LINES[1], "neither": LINES[-1]}
OUTLINED: dict[str, Any] = {"edgecolor": INK, "linewidth": 0.3, "zorder": 2}  # floes on a map
KPA, KM, HOUR = 1e3, 1e3, 3600.0


class Sweep(NamedTuple):
    """The parameter that a figure varies: its values, for which models, and how it is shown."""

    name: str
    values: tuple[float, ...]
    models: Mapping[str, Mapping[str, tuple[float, ...]]]
    label: str
    unit: float = 1.0


SWEEPS = {  # the paper gives no values; chosen: its baseline, and what lies on both sides of it
    6: Sweep("friction", (0.0, 0.1, 0.2, 0.3, 0.4, 0.5), {"frictional": {"tensile_strength": (0.0,)}}, "friction coefficient $μ$ [1]"),
    7: Sweep("tensile_strength", (0.0, 50e3, 100e3, 200e3, 300e3, 400e3), {"cohesive": {"friction": (0.0,)}}, "tensile strength $σ_c$ [kPa]", KPA),
    8: Sweep("width", (5e3, 6e3, 7e3, 8e3), TWO, "width of the strait $W$ [km]", KM),
    9: Sweep("spread", (0.0, 0.5, 1.0, 1.4), TWO, "range of radii over 750 m [1]"),
    10: Sweep("thickness", (0.5, 1.0, 2.0, 3.0), TWO, "thickness $h$ [m]"),
}  # fmt: skip
KINDS: dict[int, type[Experiment]] = {n: Shear if n in (1, 3, 4) else Strait for n in range(1, 11)}


class Drawn(NamedTuple):
    """A figure, its data, the members that failed, and a summary as text."""

    figure: "Figure"
    files: list[Path]
    failures: list[Failure]
    text: str


def make_figure(
    number: int,
    kind: type[Experiment],
    values: Mapping[str, Sequence[Any]],
    seeds: Sequence[int],
    to: Path | None = None,
    **how: Any,
) -> Drawn:
    """Run the experiments of a figure of the paper, and draw it.

    Parameters
    ----------
    number : number of the figure, 1 to 10
    kind : the experiment; must be the one that the figure shows
    values : values of parameters, instead of those of the table and of the figure
    seeds : seeds of the members; figures 1, 2 and 5 show the first of them
    to : file of the picture; default: figure-N.png.  The files of the runs go beside it
    how : jobs, on, progress: see `ensemble.run`
    """
    if kind is not KINDS[number]:
        right = KINDS[number].__name__.lower()
        raise InputError(
            f"figure {number}: belongs to the other experiment; use floebmi experiment {right}"
        )
    to = Path(f"figure-{number}.png") if to is None else path_of("to", to)
    if to.suffix not in (".png", ".pdf", ".svg"):
        raise InputError(f"{to}: a figure is a .png, .pdf or .svg file")
    check_target(to, overwrite=True)
    maps = number in (1, 2, 5)  # drawn on water; graphs on white
    with in_style(WATER if maps else "white"):
        if maps:
            one = _single(kind, values, number)
            figure = {1: _shear_cell, 2: _strait_map, 5: _strait_in_time}[number](one, seeds[0])
            drawn = Drawn(figure, [], [], "")
        else:
            drawn = _from_ensembles(number, kind, values, seeds, to, how)
        save(drawn.figure, to)
    return drawn._replace(files=[*drawn.files, to])


def _panels(
    width: float, height: float, rows: int = 1, columns: int = 1, **how: Any
) -> tuple["Figure", Any]:
    """A figure of width × height inches, and its axes."""
    figure = blank(width, height, dpi=160)
    return figure, figure.subplots(rows, columns, **how)


def _single(kind: type[Experiment], values: Mapping[str, Sequence[Any]], number: int) -> Experiment:
    several = [name for name, v in values.items() if len(v) > 1]
    if several:
        raise InputError(f"{several[0]}: figure {number} shows one run; give one value")
    return make(kind, {name: v[0] for name, v in values.items()})


def _from_ensembles(number, kind, values, seeds, to, how) -> Drawn:
    if kind is Shear:
        swept, models, stem = {"normal_stress": NORMAL_STRESSES}, THREE, "shear"
    else:
        sweep = SWEEPS[number]
        swept, models, stem = {sweep.name: sweep.values}, sweep.models, f"figure-{number}"
    for name in swept:
        if len(values.get(name, swept[name])) < 2:
            raise InputError(
                f"{name}: figure {number} shows several values of it; give two or more"
            )
    made = {}
    for model, laws in models.items():
        # the figures of one experiment share what they can: 3 and 4 are of the same runs
        path = to.with_name(f"{stem}-{model}.nc")
        chosen = {**laws, **swept, **values}
        extra = [k for k, v in chosen.items() if len(v) > 1 and k not in swept]
        if extra:
            raise InputError(
                f"{extra[0]}: figure {number} sweeps {', '.join(swept)}; give one value"
            )
        made[model] = campaign.run(kind, chosen, seeds, path, **how)
    data = {model: one.data for model, one in made.items()}
    if kind is Shear:
        figure = _stresses(data) if number == 3 else _profiles(data)
    else:
        figure = _jamming(data, sweep)
    return Drawn(
        figure,
        [path for one in made.values() for path in one.files],
        [failure for one in made.values() for failure in one.failures],
        "\n".join(f"{model}\n{one.text}" for model, one in made.items()),
    )


# ---- shear ------------------------------------------------------------------------------------


def _shear_cell(p: Shear, seed: int) -> "Figure":
    cell = shear.consolidate(p, seed)
    figure, axes = _panels(7.2, 5.6, 1, 2, sharey=True)
    time = 0.25 * p.duration
    for ax, title in zip(axes, ("consolidated", f"after {time:g} s of shear"), strict=True):
        f = cell.model.floes
        colours = np.where(cell.standing, "#9a9a9a", np.where(cell.driven, LINES[4], "#ffffff"))
        wall = float(cell.model.wall_positions[0])
        for shift in (-cell.length, 0.0, cell.length):
            draw_circles(ax, f.x + shift, f.y, f.radius, 1.0, facecolor=colours, **OUTLINED)
            chains(ax, cell.model, 1.0, shift)
        ax.axhline(wall, color=INK, lw=2.5)
        ax.set(
            title=title,
            xlabel="x [m]",
            xlim=(0, cell.length),
            ylim=(0, 1.12 * wall),
            aspect="equal",
        )
        if ax is axes[0]:
            ax.set_ylabel("y [m]")
            cell.model.advance(time)
    axes[0].text(
        0.5 * cell.length, 1.04 * wall, f"$N$ = {p.normal_stress / KPA:g} kPa  ↓", ha="center"
    )
    axes[1].text(0.5 * cell.length, 1.04 * wall, f"{p.speed:g} m/s  →", ha="center")
    return figure


def _stresses(data: "Mapping[str, xr.Dataset]") -> "Figure":
    figure, (left, right) = _panels(7.6, 3.4, 1, 2)
    for model, one in data.items():
        colour, n = COLOURS[model], one.normal_stress.values / KPA
        each = one.shear_stress.transpose("normal_stress", "seed").values
        dots, *_ = left.plot(n, each / KPA, "o", color=colour, ms=3.5, alpha=0.6, mew=0)
        f, c = float(one.bulk_friction), float(one.bulk_cohesion) / KPA
        if np.isfinite(f):
            low, high = one.bulk_friction_bounds.values
            clow, chigh = one.bulk_cohesion_bounds.values / KPA
            label = f"{model}: $μ_u$ = {f:.2f} ({low:.2f} … {high:.2f}),\n$C$ = {c:.2f} kPa ({clow:.2f} … {chigh:.2f})"
            label = label.replace("-", "−")  # a minus, not a hyphen
            line = np.linspace(0, n.max(), 60)
            left.plot(line, c + f * line, color=colour, label=label)
            middle, band = _band(np.repeat(n, each.shape[1]), each.ravel() / KPA, line)
            left.fill_between(line, middle - band, middle + band, color=colour, alpha=0.15, lw=0)
        else:
            dots.set_label(model)
        ratio = each / KPA / n[:, None]
        right.errorbar(
            n, np.nanmean(ratio, axis=1), np.nanstd(ratio, axis=1), fmt="o-", ms=4, color=colour,
            label=model, capsize=2,
        )  # fmt: skip
    left.set(xlabel="normal stress $N$ [kPa]", ylabel="shear stress $τ$ [kPa]", xlim=(0, None))
    right.set(xlabel="normal stress $N$ [kPa]", ylabel="$τ/N$ [1]", xscale="log")
    ticks = next(iter(data.values())).normal_stress.values / KPA
    right.set_xticks(ticks, [f"{t:g}" for t in ticks], minor=False)
    right.minorticks_off()
    left.legend(fontsize=6.5, loc="upper left")
    right.legend(title="mean and spread of seeds", title_fontsize=7)
    left.set_ylim(min(0.0, left.get_ylim()[0]), 1.35 * left.get_ylim()[1])
    right.set_ylim(0, 1.15 * right.get_ylim()[1])
    return figure


def _band(x: np.ndarray, y: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least-squares line, and the half width of its 95 % confidence band."""
    from scipy.stats import linregress, t

    good = np.isfinite(x) & np.isfinite(y)
    x, y = x[good], y[good]
    if len(x) < 3:
        return np.full(at.shape, np.nan), np.full(at.shape, np.nan)
    fit = linregress(x, y)
    error = fit.stderr * np.sqrt(x.var() + (at - x.mean()) ** 2)  # least at the mean of x
    return fit.intercept + fit.slope * at, t.ppf(0.975, len(x) - 2) * error


def _profiles(data: "Mapping[str, xr.Dataset]") -> "Figure":
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LogNorm

    figure, axes = _panels(2.6 * len(data), 3.4, 1, len(data), sharey=True, squeeze=False)
    stresses = next(iter(data.values())).normal_stress.values / KPA
    norm = LogNorm(0.8 * stresses.min(), 1.25 * stresses.max())
    for ax, (model, one) in zip(axes[0], data.items(), strict=True):
        for n in one.normal_stress.values:
            mean = one.displacement.sel(normal_stress=n).mean("seed")
            ax.plot(mean, one.layer, color=colormaps["viridis"](norm(n / KPA)))
        ax.set(
            title=model, xlabel="displacement over the top's [1]", xlim=(-0.03, 1.03), ylim=(0, 1)
        )
    axes[0, 0].set_ylabel("height over the wall's [1]")
    bar = figure.colorbar(
        ScalarMappable(norm, "viridis"), ax=list(axes[0]), label="normal stress $N$ [kPa]"
    )
    bar.set_ticks(stresses, labels=[f"{n:g}" for n in stresses])
    bar.minorticks_off()
    return figure


# ---- strait -----------------------------------------------------------------------------------


def _strait_map(p: Strait, seed: int) -> "Figure":
    model = strait.build(p, seed)
    figure, ax = _panels(6.4, 3.7)
    _funnel(ax, model, p)
    ny, nx = model.grid.shape
    u, v = (c.reshape(ny, nx)[1::2, ::2] for c in (model.ocean.u, model.ocean.v))
    x, y = (np.reshape(c, (ny, nx))[1::2, ::2] / KM for c in (model.grid.x, model.grid.y))
    moving = np.hypot(u, v) > 0.03 * p.current  # slower ones would be dots
    # an arrow's middle is its place: those of the outlet reach down to the edge, and not beyond
    arrows = ax.quiver(
        x[moving], y[moving], u[moving], v[moving], color=LINES[0], scale=15 * p.current + 1e-9,
        width=0.003, pivot="mid", minlength=0.5, zorder=4,
    )  # fmt: skip
    ax.quiverkey(arrows, 0.88, 0.08, p.current, f"current {p.current:g} m/s", labelpos="N")
    ax.set_title(f"wind {p.wind:g} m/s towards −y, strait {p.width / KM:g} km wide")
    return figure


def _strait_in_time(p: Strait, seed: int) -> "Figure":
    given = p._asdict()
    figure, axes = _panels(8.4, 3.9, 2, 3, sharex=True, sharey=True)
    for row, (model_name, laws) in zip(axes, TWO.items(), strict=True):
        one = make(Strait, {**given, **{name: v[0] for name, v in laws.items()}})
        model = strait.build(one, seed)
        when, k = np.array([0.05, 0.15, 0.4]) * one.hours * HOUR, 0
        for _ in strait.evolve(model, one):
            if k < 3 and model.time >= when[k]:
                _snapshot(row[k], model, one, f"{model_name}, {model.time / HOUR:.1f} h")
                k += 1
        if k < 3:
            jam = "jammed" if model.time < one.hours * HOUR else "end"
            _snapshot(row[k], model, one, f"{model_name}, {jam}, {model.time / HOUR:.1f} h")
        for ax in row[k + 1 :]:
            ax.set_axis_off()  # it had jammed by then
    for ax, below in zip(*axes, strict=True):
        if below.axison:
            ax.set_xlabel("")
        else:
            ax.tick_params(labelbottom=True)
    for ax in axes[:, 1:].flat:
        ax.set_ylabel("")
    return figure


def _snapshot(ax: "Axes", model: Any, p: Strait, title: str) -> None:
    _funnel(ax, model, p)
    chains(ax, model, KM)
    ax.set_title(title, fontsize=8.5)


def _funnel(ax: "Axes", model: Any, p: Strait) -> None:
    for ring in strait.walls(p).polygons:
        ax.fill(*ring.T / KM, color=LAND, lw=0, zorder=1)
    f = model.floes
    here = f.active
    colours = np.where(f.land, LAND, "#ffffff")[here]
    draw_circles(ax, f.x[here], f.y[here], f.radius[here], KM, facecolor=colours, **OUTLINED)
    d = model.domain
    ax.set(
        xlabel="x [km]", ylabel="y [km]", aspect="equal",
        xlim=(d.x[0] / KM, d.x[1] / KM), ylim=(d.y[0] / KM, d.y[1] / KM),
    )  # fmt: skip


def chains(ax: "Axes", model: Any, unit: float, shift: float = 0.0) -> None:
    """Force chains: contacts as lines between centres, of a width that grows with the force; compression dark, tension of bonds red.

    shift : shift along x [m], for contacts across a periodic edge
    """
    from matplotlib.collections import LineCollection

    c, f = model.contacts(), model.floes
    force = np.hypot(c.fx, c.fy)
    if not len(force):
        return
    start = np.stack([f.x[c.i] + shift, f.y[c.i]], axis=1)
    ends = np.stack([start, start + np.stack([c.dx, c.dy], axis=1)], axis=1) / unit
    strong = np.quantile(force, 0.95)
    width = 2.6 * np.minimum(force / strong, 1.5) if strong > 0 else force
    colours = np.where(c.overlap < 0, "#CC3311", INK)
    ax.add_collection(
        LineCollection(ends, linewidths=width, colors=colours, zorder=3, capstyle="round"),
        autolim=False,
    )


def _jamming(data: "Mapping[str, xr.Dataset]", sweep: Sweep) -> "Figure":
    from matplotlib import colormaps

    rows = len(data)
    figure, axes = _panels(9.2, 3.2 * rows, rows, 3, squeeze=False)
    shades = colormaps["viridis"](np.linspace(0.0, 0.9, len(next(iter(data.values()))[sweep.name])))
    for (mass, share, scale), (model, one) in zip(axes, data.items(), strict=True):
        for colour, value in zip(shades, one[sweep.name].values, strict=True):
            at = one.sel({sweep.name: value})
            hours = at.time.values / HOUR
            mass.plot(
                hours, at.transport.transpose("time", "seed") / 1e9, color=colour, lw=0.5, alpha=0.5
            )
            mass.plot(hours, at.transport.mean("seed") / 1e9, color=colour, lw=1.8, label=f"{value / sweep.unit:g}")  # fmt: skip
            _survival(share, at, colour)
        _timescales(scale, one, sweep)
        mass.set(title=model, xlabel="time [h]", ylabel="mass through the strait [Mt]")
        share.set(xlabel="time [h]", ylabel="share that flows $P_s$ [1]", ylim=(-0.03, 1.03), xlim=mass.get_xlim())  # fmt: skip
    # beside the curves: they fill their panels
    shades_of = axes[0, 0].get_legend_handles_labels()
    figure.legend(*shades_of, title=sweep.label, loc="outside lower left", ncols=6)
    marks = {label: mark for ax in axes[:, 2] for mark, label in zip(*ax.get_legend_handles_labels(), strict=True)}  # fmt: skip
    figure.legend(marks.values(), marks, loc="outside lower right", ncols=1)
    return figure


def _survival(ax: "Axes", one: "xr.Dataset", colour: Any) -> None:
    """P_s as a step curve, and the maximum-likelihood curve, dashed."""
    n = int(np.isfinite(one.flow_start).sum())
    if not n:
        return
    end = float(one.time[-1]) / HOUR
    times, share = statistics.survival(one.jam_time.values[np.isfinite(one.flow_start.values)])
    ax.step([0.0, *times / HOUR, end], [1.0, *share, share[-1] if len(share) else 1.0], where="post", color=colour)  # fmt: skip
    T = float(one.jamming_timescale) / HOUR
    if np.isfinite(T) and T > 0:
        start = float(one.flow_start.mean()) / HOUR
        t = np.linspace(start, end, 100)
        ax.plot(t, np.exp(-(t - start) / T), "--", color=colour, lw=0.8)


def _timescales(ax: "Axes", one: "xr.Dataset", sweep: Sweep) -> None:
    """T with its confidence interval; arrows: lower bounds where no run jammed; crosses: the fit as in the paper."""
    x, colour = one[sweep.name].values / sweep.unit, LINES[0]  # one legend is of all models
    T, fit = one.jamming_timescale.values / HOUR, one.jamming_timescale_fit.values / HOUR
    low, high = (one.jamming_timescale_bounds.sel(bound=b).values / HOUR for b in campaign.BOUNDS)
    some = np.isfinite(T)
    if some.any():
        bars = np.stack([T[some] - low[some], high[some] - T[some]])
        ax.errorbar(x[some], T[some], bars, fmt="o", color=colour, capsize=3, label="maximum likelihood, 95 %")  # fmt: skip
    above = ~some & (low > 0)  # a bound of 0 tells nothing
    if above.any():
        ax.plot(x[above], low[above], "^", color=colour, mfc="none", label="no run jammed: T above this, 95 %")  # fmt: skip
    fitted = np.isfinite(fit) & (fit > 0)
    if fitted.any():
        error = one.jamming_timescale_fit_deviation.values[fitted] / HOUR
        ax.errorbar(x[fitted], fit[fitted], error, fmt="x", color=INK, ms=5, capsize=2, lw=0.8, label="least squares, as the paper")  # fmt: skip
    ax.set(xlabel=sweep.label, ylabel="time until it jams $T$ [h]", yscale="log")
    plain_numbers(ax.yaxis)
