"""Trade-off between speed and accuracy: a scene run with different settings, each compared with a fine reference.

A setting is a text as for `--set`, such as "step.fraction=0.5 sampling=centre"; the empty text is the scene as it
is.  Each setting runs with several seeds, in an ensemble.  Its cost is the CPU time [s] per simulated day; its
errors are those of quantities of interest (`COMPARED`), relative to the reference.

A scene is quiet if moving its floes by a millionth of a radius hardly changes these quantities; its settings are
then compared pointwise, frame by frame and cell by cell.  Otherwise it is chaotic: no time step is short
enough to follow individual floes, and means over time and seeds are compared.  The seeds are the same for all
settings, and the spread of the differences among seeds gives the uncertainty of the error.

What a result says, and where it is stored, is in `tradeoff_result`.
"""

import json
import shlex
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from floebmi import ensemble
from floebmi.ensemble import Output
from floebmi.errors import InputError, is_word
from floebmi.files import check_new_folder, check_target, path_of
from floebmi.floes import Floes
from floebmi.grid import Grid
from floebmi.gridding import cell_fields, internal_stress, pressure
from floebmi.making import work_of_processor
from floebmi.output import FILE_VERSION
from floebmi.pairs import wrap
from floebmi.running import Forcing
from floebmi.scene import Built, Scene, Schedule, read_scene
from floebmi.scene_physics import Parts
from floebmi.tradeoff_result import (
    COMPARED,
    SUFFIX,
    acceptable,
    digest,
    files_of,
    read,
)
from floebmi.vorticity import gradient_operators

if TYPE_CHECKING:
    import xarray as xr

    from floebmi.model import Model

NUDGED = "nudged"  # end of the name of the reference run whose floes are moved by NUDGE times their radius
NUDGE = 1e-6
# A scene is chaotic if the nudge changes a quantity by more than this fraction of the requested error.
SEES = 0.1
REFERENCE_FRACTION = 0.1
FINER = 4  # ratio of the scene's own step, and of its exchange interval, to those of the reference
OUTPUTS = {
    "transport": Output(("frame",), "kg", "mass that has left through the edges"),
    "drift": Output(("frame", "axis"), "m", "mean displacement of the ice, by mass"),
    "area_fraction": Output(("frame", "cell"), "1", "area of floes over that of the cell"),
    "velocity": Output(("frame", "axis", "cell"), "kg m-1 s-1", "momentum per area of the cell"),
    "stress": Output(("frame", "cell"), "N m-1", "internal pressure"),
    "energy_residual": Output((), "1", "residual of the energy over what was exchanged"),
    "inertia_number": Output((), "1", "I = γ̇ d √(ρ/N), from the gridded strain rate and pressure"),
    "floe_steps": Output((), "1", "floes times steps"),
    "cost": Output((), "s", "CPU time"),
    "cost_per_day": Output((), "s", "CPU time per simulated day"),
}


class Measured(NamedTuple):
    """The result: data set, file, and the runs that failed."""

    data: "xr.Dataset"
    path: Path
    failures: list[ensemble.Failure]

    @property
    def why(self) -> str:
        """Whether the scene is chaotic, what shows it, and how settings were compared."""
        return self.data.attrs["comparison"]


# ---- the dials --------------------------------------------------------------------------------------


def settings(scene: Scene, model: "Model", schedule: Schedule) -> dict[str, list[str]]:
    """The settings to try for each option of a scene, as texts for `--set`; model and schedule are those of the scene."""
    law, step = model.contact, model.step
    dials: dict[str, list[str]] = {}
    bounded = bool(model.wall_edges)
    kind = "none" if law is None else "frictional" if law.friction else "cohesive"
    words = ["frictional", "cohesive"] + ([] if bounded else ["none"])
    dials["contact"] = [f"contact={word}" for word in words if word != kind]
    if law is not None:
        if step.scheme == "verlet" and step.epsilon is None and step.length is None:
            dials["step"] = [f"step.fraction={f:g}" for f in (0.15, 0.3, 0.6) if f < step.fraction]
        table = "contact.elastic" if isinstance(scene.contact, Parts) else "contact"
        modulus = law.elastic.youngs_modulus
        dials["stiffness"] = [f"{table}.youngs_modulus={modulus / by:.4g}" for by in (4, 16, 64)]
        if scene.preset is None:
            dials["preset"] = ["preset=damsgaard2018"]
    if model.forces and step.scheme == "verlet":
        dials["drag"] = [f"step.drag_every={k}" for k in (4, 16)]
    radius = model.floes.radius[model.floes.active & ~model.floes.land]
    if len(scene.floes) == 1 and radius.size:
        cuts = [by * radius.min() for by in (1.5, 2, 4, 8) if 2 * by * radius.min() < radius.max()]
        dials["smallest floe"] = [f"floes.smallest={cut:.4g}" for cut in cuts]
    if model.ocean is not None or model.atmosphere is not None:
        if scene.sampling == "overlap" and scene.grid is not None:
            dials["sampling"] = ["sampling=centre"]
        exchange, every = schedule.exchange, schedule.every
        longer = [by * exchange for by in (2, 3, 4) if every % (by * exchange) == 0]
        dials["exchange"] = [f"time.exchange={e:.12g}" for e in longer]
    return {dial: texts for dial, texts in dials.items() if texts}


def reference(model: "Model", schedule: Schedule) -> str:
    """The fine setting with which the others are compared; model and schedule are those of the scene."""
    fine, step = [], model.step
    if step.length is not None:  # it takes precedence, as epsilon does over a fraction
        fine.append(f"step.length={step.length / FINER:.12g}")
    elif model.contact is not None and step.epsilon is not None:
        fine.append(f"step.epsilon={step.epsilon / FINER:.12g}")
    elif model.contact is not None:
        fine.append(f"step.fraction={REFERENCE_FRACTION:g}")
    if model.ocean is not None or model.atmosphere is not None:
        fine.append(f"time.exchange={schedule.exchange / FINER:.12g}")
    return " ".join(fine)


# ---- one run ----------------------------------------------------------------------------------------


def member(parameters: Mapping[str, Any], seed: int) -> dict[str, np.ndarray]:
    """One run of a setting; returns arrays with the names of `OUTPUTS`."""
    changes = shlex.split(parameters["setting"])
    nudged = NUDGED in changes
    changes = [*parameters["overrides"], *(c for c in changes if c != NUDGED), f"seed={seed}"]
    scene = read_scene(parameters["scene"], changes)
    built = scene.build()
    model = built.model
    if nudged:
        free = model.floes.active & (model.floes.motion == 0)
        model.floes.x[free] += NUDGE * model.floes.radius[free]
    grid = _grid(scene, model)
    # all settings have frames at the same times, even if the scene derives these from its exchange interval; and an
    # exchange interval derived from the duration stays the same in a shorter run
    schedule = Schedule(
        parameters["duration"], scene.time.exchange or parameters["exchange"], parameters["every"]
    )
    drive = Forcing(model, built.ocean, built.atmosphere)
    frames, spent, drift = [], 0.0, np.zeros(2)
    for k in range(1, round(schedule.duration / schedule.exchange) + 1):
        drive.fill((k - 0.5) * schedule.exchange)
        here, begin = model.floes.copy(), work_of_processor()
        model.advance(k * schedule.exchange - model.time)
        spent += work_of_processor() - begin
        drift = drift + _way(model, here)
        if k % round(schedule.every / schedule.exchange) == 0:
            frames.append(_frame(model, grid, drift))
    result = {name: np.array([frame[name] for frame in frames]) for name in frames[0]}
    return {
        "time": schedule.every * np.arange(1, len(frames) + 1),
        **result,
        "energy_residual": np.array(model.ledger.balance("energy").relative),
        "inertia_number": np.array(_inertia_number(model, grid, result)),
        "floe_steps": np.array(float(model.counters.floe_steps)),
        "cost": np.array(spent),
        "cost_per_day": np.array(spent * 86400.0 / schedule.duration),
    }


def _way(model: "Model", before: Floes) -> np.ndarray:
    """Mass-weighted mean displacement [m] of the floes that were active before and are active now."""
    n, now = len(before), model.floes
    stays = before.active & now.active[:n] & ~before.land
    mass = before.mass(model.ice_density)[stays]
    way = []
    for old, new, period in zip(
        (before.x, before.y), (now.x, now.y), model.domain.period, strict=True
    ):
        way.append((mass * wrap(period, new[:n][stays] - old[stays])).sum())
    return np.array(way) / (mass.sum() or 1.0)


def _grid(scene: Scene, model: "Model") -> Grid:
    """The grid on which fields are compared: the scene's exchange grid, or 8 × 8 cells."""
    if scene.grid is not None:
        return model.grid
    return Grid.uniform(model.domain.x, model.domain.y, shape=(8, 8))


def _frame(model: "Model", grid: Grid, drift: np.ndarray) -> dict[str, np.ndarray]:
    f, contacts = model.floes, model.contacts()
    fields = cell_fields(
        grid, model.coverage(grid), f.thickness, f.u, f.v, f.radius, model.ice_density
    )
    stress = internal_stress(
        grid, f.x[contacts.i], f.y[contacts.i], contacts.dx, contacts.dy, contacts.fx, contacts.fy,
        model.domain.period,
    )  # fmt: skip
    velocity = np.array([fields["ice_velocity_x"], fields["ice_velocity_y"]])
    return {
        "transport": -model.ledger.accounts.get("outflow", np.zeros(4))[0],
        "drift": drift,
        "area_fraction": fields["area_fraction"] + fields["overlap_fraction"],
        "velocity": fields["mass_per_area"] * velocity,
        "stress": pressure(stress.xx, stress.yy),
    }


def _inertia_number(model: "Model", grid: Grid, frames: Mapping[str, np.ndarray]) -> float:
    """I = γ̇ d √(ρ/N) (Eq. 3), γ̇ the largest shear rate of the mean gridded velocity, N the mean pressure."""
    f = model.floes
    ice = f.active & ~f.land
    if not ice.any():
        return np.nan
    thickness = f.volume[ice].sum() / f.area[ice].sum()
    mass = model.ice_density * thickness * frames["area_fraction"]
    u, v = np.moveaxis(frames["velocity"] / np.maximum(mass, 1e-12)[:, None], 1, 0).mean(axis=1)
    along_x, along_y = gradient_operators(grid, model.domain.period)
    rate = np.hypot(along_x @ u - along_y @ v, along_y @ u + along_x @ v)
    iced = frames["area_fraction"].mean(axis=0) > 0.15
    normal = frames["stress"].mean(axis=0)[iced].mean() / thickness if iced.any() else 0.0
    if not normal > 0:
        return np.nan
    diameter = 2 * f.radius[ice].mean()
    return float(np.sqrt((rate[iced] ** 2).mean()) * diameter * np.sqrt(model.ice_density / normal))


# ---- many runs --------------------------------------------------------------------------------------


def tradeoff(
    scene_file: str | Path,
    overrides: Sequence[str] = (),
    *,
    error: float = 0.05,
    of: str | None = None,
    seeds: int = 3,
    duration: float | None = None,
    budget: float | None = None,
    to: str | Path | None = None,
    jobs: int | None = None,
    progress: bool = False,
) -> Measured:
    """Measure cost and error of the settings of a scene, alone and combined.

    Parameters
    ----------
    scene_file, overrides : as for `read_scene`
    error : largest error of a recommended setting [1], relative to the reference
    of : the quantity whose error counts, one of `COMPARED`; default: transport if floes leave, drift if
        wind or water moves them, else velocity
    seeds : number of seeds, 1, 2, …
    duration : simulated time of each run [s]; default: the scene's, or what the budget allows
    budget : time for all runs together [min]; the runs are shortened to fit
    to : NetCDF file to write, replacing an earlier result; finished runs are kept beside it
    jobs : number of processes

    Raises
    ------
    InputError
        for an invalid scene or number, forcing that does not cover the run, an existing file that is not a result, and
        finished runs of another scene, or of files that have changed since.
    """
    overrides = list(overrides)
    scene = read_scene(scene_file, overrides)
    to = Path(f"{scene.name}{SUFFIX}") if to is None else path_of("to", to)
    if of is not None and not is_word(of, COMPARED):
        raise InputError(f"of = {of!r}: must be one of {', '.join(COMPARED)}")
    if not 0 < error < 1:
        raise InputError(f"error = {error!r}: must be between 0 and 1")
    if seeds < 1:
        raise InputError(f"seeds = {seeds!r}: must be at least 1")
    if budget is not None and not 0 < budget < np.inf:
        raise InputError(f"budget = {budget!r} minutes: must be greater than 0")
    members = to.with_name(f"{to.name}.members")
    _check_places(to, members)
    built, schedule = scene.build(), scene.schedule(duration)
    if schedule.duration < schedule.every:
        raise InputError(
            f"duration = {schedule.duration:g} s: shorter than the time between frames, {schedule.every:g} s"
        )
    dials = settings(scene, built.model, schedule)
    fine = reference(built.model, schedule)
    if not fine:
        raise InputError(f"{scene.file}: has neither contacts nor fluids: there is no dial to turn")
    tried = [fine, f"{fine} {NUDGED}", "", *(text for texts in dials.values() for text in texts)]
    # floes are moved by forces, or move freely and keep their momentum
    usual = ("transport", "drift", "velocity") if scene.forces() else ("transport", "velocity")
    if budget is not None:
        length = _affordable(schedule, built, budget, len(tried), seeds, jobs)
        schedule = schedule._replace(duration=length)
    scene.check_forcing(built, 0.0, schedule.duration)
    shared = {
        "scene": str(scene.file),
        "text": digest(scene.text),
        "files": files_of(scene),
        "overrides": overrides,
        "duration": schedule.duration,
        "exchange": schedule.exchange,
        "every": schedule.every,
    }

    def measure() -> tuple[ensemble.Ensemble, "xr.Dataset"]:
        done = ensemble.run(
            member, shared, {"setting": tried}, range(1, 1 + seeds), members,
            jobs=jobs, code=lambda p: p["setting"], progress=progress,
        )  # fmt: skip
        return done, _compare(done, fine, error, of, usual)

    done, data = measure()
    for text in _combined(dials, data, error):
        tried.append(text)
        done, data = measure()
        if acceptable(data, error).sel(setting=text):
            break
    data.attrs |= {
        "floebmi_file": f"tradeoff {FILE_VERSION}",
        "title": f"speed against accuracy of the scene {scene.name}",
        "scene_hash": shared["text"],
        "files": json.dumps(shared["files"]),
        "duration": schedule.duration,
        "overrides": json.dumps(overrides),
    }
    ensemble.save(data, to)
    return Measured(data, to, done.failures)


def _check_places(to: Path, members: Path) -> None:
    """InputError for a file that cannot be written, or is there and no result, and for a folder that cannot be made."""
    if to.suffix != ".nc":
        raise InputError(f"--to {to}: must end in .nc")
    check_new_folder(to.parent)
    if to.parent.is_dir():
        check_target(to, overwrite=True)
    check_new_folder(members)
    if to.exists():
        read(to)  # replaced by a newer result is a result, and nothing else


def _affordable(
    schedule: Schedule, built: Built, budget: float, settings: int, seeds: int, jobs: int | None
) -> float:
    """The duration [s], in whole frames of the scene, for which all runs fit into `budget` minutes."""
    model, drive = built.model, Forcing(built.model, built.ocean, built.atmosphere)
    ended = []
    for _ in range(4):
        drive.fill(min(model.time, schedule.duration))  # forcing may end with the run
        model.advance(schedule.exchange)
        ended.append(time.perf_counter())
    each = (ended[-1] - ended[0]) / 3  # the first compiled
    runs = seeds * (settings + 8)  # reference and preset take longer, combinations follow
    frame = each * schedule.every / schedule.exchange * runs / (jobs or ensemble.cores())
    frames = int(60.0 * budget / frame)
    if frames < 2:
        raise InputError(
            f"budget = {budget:g} minutes: too few for two frames of {runs} runs; must be at least {2 * frame / 60:.2g}"
        )
    return min(schedule.duration, frames * schedule.every)


def _compare(
    done: ensemble.Ensemble, fine: str, error: float, of: str | None, usual: Sequence[str]
) -> "xr.Dataset":
    """Costs and errors of all settings; its attribute `comparison` tells how they were compared."""
    import xarray as xr

    lost = [one for one in done.failures if one.point["setting"] in (fine, f"{fine} {NUDGED}")]
    if lost:
        raise InputError(f"tradeoff: without its reference nothing can be compared: {lost[0]}")
    times = {"time": Output(("frame",), "s", "since the start")}
    runs = ensemble.gather(done, OUTPUTS, times)
    base = runs.sel(setting=fine)
    nudged = runs.sel(setting=f"{fine} {NUDGED}")
    quantities = [q for q in COMPARED if np.abs(base[q]).max() > 0]
    moving = [q for q in usual if q in quantities]
    if not moving and of not in quantities:
        raise InputError("tradeoff: nothing moves in this scene: there is nothing to compare")
    of = of or moving[0]
    if of not in quantities:
        raise InputError(
            f"of = {of!r}: is zero in this scene; must be one of {', '.join(quantities)}"
        )
    grown = {q: float(_pointwise(nudged[q], base[q]).max()) for q in quantities}
    worst = max(grown, key=lambda q: np.nan_to_num(grown[q]))
    chaotic = grown[worst] > SEES * error
    n = runs.sizes["seed"]
    # floes of a list, of a file or with a seed of their own are the same for every seed, and so is then the whole run
    same = all(_same_for_all_seeds(base[q]) for q in quantities)
    why = (
        f"a nudge of the floes by {NUDGE:g} of their radius changes {worst} by {grown[worst]:.1g}: "
        + (f"chaotic, so means over time and {n} seeds are compared" if chaotic else "quiet, so frames and cells are compared one by one")
    )  # fmt: skip
    if chaotic and same:
        cause = "the seed changes nothing in this scene" if n > 1 else "that takes more seeds"
        why += f"; how much of an error is chance is not known, for {cause}"
    kept = [str(s) for s in runs.setting.values if not str(s).endswith(NUDGED)]
    data = xr.Dataset(coords={"setting": kept, "quantity": quantities})
    errors = np.full((len(kept), len(quantities), 2), np.nan)
    for s, setting in enumerate(kept):
        for q, name in enumerate(quantities):
            one, other = runs[name].sel(setting=setting), base[name]
            errors[s, q] = (
                _of_means(one, other) if chaotic else (_pointwise(one, other).mean(), 0.0)
            )
    if chaotic and same:
        errors[..., 1] = np.nan
    data["error"] = ("setting", "quantity"), errors[..., 0], {"units": "1", "long_name": "relative to the reference"}  # fmt: skip
    data["noise"] = ("setting", "quantity"), errors[..., 1], {"units": "1", "long_name": "of the error, from the spread over seeds"}  # fmt: skip
    one = runs.sel(setting=kept)
    for name in ("cost_per_day", "energy_residual", "inertia_number"):
        data[name] = one[name].median("seed")
    data["speed"] = (one.floe_steps / one.cost).median("seed")
    data["speed"].attrs = {"units": "s-1", "long_name": "floe-steps per second"}
    data["cost_per_day"].attrs = {"units": "s", "long_name": OUTPUTS["cost_per_day"].long_name}
    data.attrs = {"reference": fine, "of": of, "seeds": n, "comparison": why}
    return data


def _same_for_all_seeds(field: "xr.DataArray") -> bool:
    values = field.transpose("seed", ...).values
    return np.array_equal(values, np.broadcast_to(values[0], values.shape), equal_nan=True)


def _pointwise(one: "xr.DataArray", other: "xr.DataArray") -> "xr.DataArray":
    """‖one − other‖/‖other‖ over frames and cells, for each seed."""
    dims = [d for d in other.dims if d != "seed"]
    return np.sqrt(((one - other) ** 2).sum(dims, skipna=False) / (other**2).sum(dims))


def _of_means(one: "xr.DataArray", other: "xr.DataArray") -> tuple[float, float]:
    """‖mean of differences‖/‖mean‖ over time and seeds, and its uncertainty from the spread among seeds."""
    other = other.mean("frame")
    difference = one.mean("frame") - other
    size = np.sqrt(float((other.mean("seed") ** 2).sum()))
    n = difference.sizes["seed"]
    mean = np.sqrt(float((difference.mean("seed", skipna=False) ** 2).sum(skipna=False)))
    spread = float(difference.var("seed", ddof=1).sum()) if n > 1 else np.nan
    return mean / size, np.sqrt(spread / n) / size


def _combined(
    dials: Mapping[str, Sequence[str]], data: "xr.Dataset", error: float
) -> Iterator[str]:
    """The best setting of each option combined; then without the one with the largest error, and so on."""
    cost = data.cost_per_day / data.cost_per_day.sel(setting="")
    fine, best = acceptable(data, error), {}
    for dial, texts in dials.items():
        good = [t for t in texts if fine.sel(setting=t) and cost.sel(setting=t) < 0.95]
        if good and dial != "preset":
            best[dial] = min(good, key=lambda t: float(cost.sel(setting=t)))
    errors = data.error.sel(quantity=data.attrs["of"])
    if best.get("contact") == "contact=none":
        for dial in best.keys() & {"step", "stiffness", "drag"}:  # no use without contacts
            del best[dial]
    while len(best) > 1:
        yield " ".join(best.values())
        best.pop(max(best, key=lambda dial: float(errors.sel(setting=best[dial]))))
