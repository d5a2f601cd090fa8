"""Parameter sweeps of an experiment: check the values, run the members, fit, save.

A parameter has one value or several; those with several are swept, and become dimensions of the result.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from floebmi import ensemble
from floebmi.errors import InputError
from floebmi.experiments import shear, statistics, strait
from floebmi.experiments.parameters import Experiment, Shear, code, make, rows
from floebmi.files import check_new_folder, check_target, path_of

if TYPE_CHECKING:
    from concurrent.futures import Executor

    import distributed
    import xarray as xr

REFERENCE = "Damsgaard, Adcroft & Sergienko (2018), doi:10.1029/2018MS001299"
BOUNDS = ("low", "high")
TIMES = ("duration", "hours", "interval")  # parameters that set the coordinate `time` of the result


class Made(NamedTuple):
    """The result: data set, files, members that failed, and a summary as text."""

    data: "xr.Dataset"
    files: list[Path]
    failures: list[ensemble.Failure]

    @property
    def text(self) -> str:
        """A summary of the result in a few lines."""
        return _told_shear(self.data) if "shear_stress" in self.data else _told_strait(self.data)


def run(
    kind: type[Experiment],
    values: Mapping[str, Sequence[Any]],
    seeds: Sequence[int],
    path: str | Path,
    *,
    jobs: int | None = None,
    on: "Executor | distributed.Client | None" = None,
    progress: bool = False,
) -> Made:
    """Run an experiment for all combinations of values and seeds, fit, and save the result as NetCDF.

    Parameters
    ----------
    kind : `Shear` or `Strait`
    values : one or more values for each named parameter; the others have the values of the table
    seeds : seeds of the random numbers, integers
    path : file to write; finished members are kept beside it, in `path`.members, and not run again
    jobs, on, progress : see `ensemble.run`

    Returns
    -------
    Made

    Raises
    ------
    InputError
        before anything runs, for an invalid value or a path that is already in use.
    """
    path = path_of("path", path)
    members = path.with_name(f"{path.name}.members")
    check_target(path, overwrite=True)
    check_new_folder(members)
    if path.exists() and not members.exists():
        raise InputError(f"{path}: exists already, and is not of an ensemble; give another file")
    if not seeds:
        raise InputError("seeds: there are none; must be at least 1")
    table = {name: tuple(values.get(name, (default,))) for name, default, _ in rows(kind)}
    for name, several in values.items():
        if name not in table:
            make(kind, {name: None})  # says what is allowed
        if len(set(several)) < len(several) or not several:
            raise InputError(
                f"{kind.__name__}.{name} = {several}: must be one or more different values"
            )
        if name in TIMES and len(several) > 1:
            raise InputError(
                f"{kind.__name__}.{name} = {several}: must be one value, since all members of a file share its times"
            )
    sweep = {name: v for name, v in table.items() if len(v) > 1}
    if kind is Shear:  # lines are fitted over the stress: the last dimension
        sweep["normal_stress"] = sweep.pop("normal_stress", table["normal_stress"])
    parameters = {name: v[0] for name, v in table.items() if name not in sweep}
    module = shear if kind is Shear else strait
    for point in ensemble.points_of(sweep):
        make(kind, {**parameters, **point})
    done = ensemble.run(
        module.member, parameters, sweep, seeds, members,
        jobs=jobs, on=on, code=code, progress=progress,
    )  # fmt: skip
    units = {name: (row.unit, row.meaning) for name, _, row in rows(kind)}
    data = ensemble.gather(done, module.OUTPUTS, module.COORDINATES, units)
    (_fit_shear if kind is Shear else _fit_strait)(data)
    data.attrs = {
        "title": (kind.__doc__ or "").split("(")[0].strip(),
        "references": REFERENCE,
        "members_failed": len(done.failures),
        **parameters,
    }
    ensemble.save(data, path)
    return Made(data, [path], done.failures)


def _fit_shear(data: "xr.Dataset") -> None:
    stress = data.shear_stress.transpose(..., "normal_stress", "seed")
    shape = stress.shape[:-2]
    x = np.broadcast_to(data.normal_stress.values[:, None], stress.shape[-2:])
    lines = [statistics.fit_line(x, y) for y in stress.values.reshape(-1, *stress.shape[-2:])]
    table = np.array(lines).reshape(*shape, 6)
    dims = stress.dims[:-2]
    for k, name, unit, what in (
        (0, "bulk_cohesion", "Pa", "cohesion C of τ = C + μ_u N"),
        (3, "bulk_friction", "1", "friction μ_u of τ = C + μ_u N"),
    ):
        data[name] = dims, table[..., k], {"units": unit, "long_name": what}
        data[f"{name}_bounds"] = (
            (*dims, "bound"), table[..., k + 1 : k + 3],
            {"units": unit, "long_name": f"95 % confidence interval of the {what}"},
        )  # fmt: skip
    data.coords["bound"] = list(BOUNDS)


def _fit_strait(data: "xr.Dataset") -> None:
    dims = data.jam_time.dims[:-1]
    shape, n = data.jam_time.shape[:-1], data.sizes["seed"]
    jam, start, end = (
        data[name].values.reshape(-1, n) for name in ("jam_time", "flow_start", "watched_until")
    )
    start = np.where(end > start, start, np.nan)  # a run that is too short is not used
    likely = [statistics.timescale(*one) for one in zip(jam, start, end, strict=True)]
    fitted = [
        statistics.fit_survival(one[np.isfinite(s)]) for one, s in zip(jam, start, strict=True)
    ]

    def put(name: str, values: Sequence[float], what: str, unit: str = "s") -> None:
        values = np.array(values, float).reshape(shape)
        data[name] = dims, values, {"units": unit, "long_name": what}

    put("jamming_timescale", [t.value for t in likely], "mean time T until the strait jams, by maximum likelihood; inf: no run jammed")  # fmt: skip
    data["jamming_timescale_bounds"] = (
        (*dims, "bound"), np.array([(t.low, t.high) for t in likely]).reshape(*shape, 2),
        {"units": "s", "long_name": "95 % confidence interval of T"},
    )  # fmt: skip
    put("jamming_timescale_fit", [f.value for f in fitted], "T of P_s = exp(−(t − t₀)/T) by least squares, as in the paper")  # fmt: skip
    put("jamming_timescale_fit_deviation", [f.deviation for f in fitted], "standard deviation of that fit")  # fmt: skip
    put("first_jam", [f.start for f in fitted], "t₀, time of the first jam")
    put("jammed", np.isfinite(jam).sum(axis=1), "number of runs that jammed", "1")
    data.coords["bound"] = list(BOUNDS)


def _each(data: "xr.Dataset", dims: Sequence[str]) -> Iterator[tuple["xr.Dataset", str]]:
    for index in np.ndindex(*(data.sizes[dim] for dim in dims)):
        at = dict(zip(dims, index, strict=True))
        one = data.isel(at)
        yield one, ", ".join(f"{d} = {_plain(one[d].item())}" for d in dims)


def _plain(value: Any) -> str:
    return f"{value:g}" if isinstance(value, int | float) else str(value)


def _told_shear(data: "xr.Dataset") -> str:
    lines = []
    for one, words in _each(data, [d for d in data.shear_stress.dims if d not in ("normal_stress", "seed")]):  # fmt: skip
        lines += [words] if words else []
        lines.append("  normal stress   shear stress    ratio   inertia number")
        for n, stress in one.groupby("normal_stress"):
            tau = stress.shear_stress
            lines.append(
                f"  {n / 1e3:8.3g} kPa {float(tau.mean()) / 1e3:10.3g} kPa {float(tau.mean()) / n:9.3f}"
                f"   {float(stress.inertia_number.mean()):.1e}"
            )
        f, c = one.bulk_friction_bounds.values, one.bulk_cohesion_bounds.values / 1e3
        lines.append(
            f"  τ = C + μ_u N: μ_u = {float(one.bulk_friction):.3f} ({f[0]:.3f} … {f[1]:.3f}), "
            f"C = {float(one.bulk_cohesion) / 1e3:.3g} kPa ({c[0]:.3g} … {c[1]:.3g})"
        )
    return "\n".join([*lines, _told_books(data)])


def _told_strait(data: "xr.Dataset") -> str:
    lines = []
    for one, words in _each(data, data.jam_time.dims[:-1]):
        low, high = one.jamming_timescale_bounds.values / 3600.0
        n = int((one.flow_start < one.watched_until).sum())  # of these the fit is made
        shut = one.sizes["seed"] - n
        T = float(one.jamming_timescale) / 3600.0
        fit, spread = float(one.jamming_timescale_fit) / 3600, float(one.jamming_timescale_fit_deviation) / 3600  # fmt: skip
        text = f"T > {low:.3g} h" if np.isinf(T) else f"T = {T:.3g} h ({low:.3g} … {high:.3g})"
        text += "" if np.isnan(fit) else f"; fit as in the paper {fit:.3g} ± {spread:.2g} h"
        text += f"; {shut} let no floe out or were too short to tell" if shut else ""
        lines.append(f"{words + ': ' if words else ''}{int(one.jammed)} of {n} jammed, {text}")
    return "\n".join([*lines, _told_books(data)])


def _told_books(data: "xr.Dataset") -> str:
    worst = data.relative_residual.max([d for d in data.relative_residual.dims if d != "quantity"])
    return "ledger, largest residual over what was exchanged: " + ", ".join(
        f"{str(q.item())} {float(worst.sel(quantity=q)):.0e}" for q in data["quantity"]
    )
