"""The command `floebmi`; error handling and exit codes are in `one_line`.

Commands import what they need only when called, so that help appears at once.
"""

import contextlib
import shlex
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import click
from click.core import ParameterSource
from click.shell_completion import CompletionItem

from floebmi import __version__
from floebmi.errors import InputError, choose
from floebmi.experiments.commands import experiment
from floebmi.meter import meter, say
from floebmi.one_line import PATH, Group, fail

if TYPE_CHECKING:
    from floebmi.scene import Scene

HELP = """A discrete-element model of sea-ice floes, driven by wind and currents.

\b
Try:
  floebmi run labrador-sea                  run a packaged scene; less than a minute
  floebmi scene                             list the packaged scenes
  floebmi scene two-floes --to mine.toml    copy one, edit it, then:
  floebmi explain mine.toml                 what will be modelled, and what it will cost
  floebmi run mine.toml --set contact.friction=0.5
  floebmi animate mine/floes.nc             an animation of the run
  floebmi validate                          is the model stable in extreme cases?
  floebmi experiment strait --figure 5      a figure of Damsgaard et al. (2018)
"""


def main() -> None:
    """Entry point of the command line."""
    floebmi()


def _scenes(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Completion of a scene: packaged names that start with these letters, else files."""
    from floebmi.scenes import packaged

    names = [name for name in packaged() if incomplete and name.startswith(incomplete)]
    return [CompletionItem(name) for name in names] or [CompletionItem(incomplete, type="file")]


# ---- the commands -----------------------------------------------------------------------------


def _set_option(function: Callable) -> Callable:
    return click.option(
        "--set", "overrides", multiple=True, metavar="TABLE.KEY=VALUE",
        help="Change a value of the scene; may be repeated.",
    )(function)  # fmt: skip


@click.group(cls=Group, help=HELP, no_args_is_help=True)
@click.version_option(__version__, prog_name="floebmi", message="%(prog)s %(version)s")
def floebmi() -> None:
    pass


@floebmi.command()
@click.argument("scene", shell_complete=_scenes)
@_set_option
@click.option(
    "--to", "folder", type=PATH, metavar="FOLDER",
    help="Folder for the output (default: one here with the scene's name).",
)  # fmt: skip
@click.option("--force", is_flag=True, help="Replace the output of an earlier run.")
@click.option(
    "--restart", type=PATH, metavar="FILE",
    help="Continue from a restart file, to the end time of the run.",
)  # fmt: skip
@click.option(
    "--duration",
    type=float,
    metavar="SECONDS",
    help="End time of the run, instead of the scene's duration.",
)
@click.option(
    "--accuracy", type=float, metavar="ERROR",
    help="Use the fastest setting with an error below this, such as 0.02, as measured by tradeoff in SCENE.tradeoff.nc "
    "beside the scene.",
)  # fmt: skip
@click.option(
    "--profile", is_flag=True, help="Print where the time went, and counts of steps and pairs."
)
@click.option("--quiet", is_flag=True, help="Print nothing but errors.")
def run(
    scene: str,
    overrides: tuple[str, ...],
    folder: Path | None,
    force: bool,
    restart: Path | None,
    duration: float | None,
    accuracy: float | None,
    profile: bool,
    quiet: bool,
) -> None:
    """Run a scene.

    SCENE is a TOML or YAML file, or the name of a packaged scene.

    \b
    Output, in a folder with the scene's name:
      gridded.nc    fields on the exchange grid, if the scene has one (CF NetCDF)
      floes.nc      floe trajectories (CF NetCDF)
      NAME.png      a picture of the last frame
      restart.nc    the state at the end, or when the run was stopped
      paraview/     ParaView files, if [output] paraview = true
    """
    from floebmi.clock import refuse_other_start
    from floebmi.explain import notes
    from floebmi.files import alone_in
    from floebmi.restarts import load_restart
    from floebmi.running import run as run_model
    from floebmi.scene import read_scene

    read = read_scene(scene, overrides)
    if accuracy is not None:
        read = _as_accurate(read, scene, overrides, accuracy, quiet)
    schedule = read.schedule(duration)
    folder = Path(read.name) if folder is None else folder
    targets = _targets(read, folder)
    _refuse_to_overwrite(folder, targets, force)
    state, told = (None, {}) if restart is None else load_restart(restart)

    built = read.build()
    model = built.model
    if state is not None:
        with _of(f"--restart {restart}"):
            model.restore(state)
            refuse_other_start(built.start, built.calendar, told)
        read.lay_out_sea(model)
    left = schedule.duration - model.time
    if left <= 0:
        raise InputError(
            f"--restart {restart}: is at t = {model.time:g} s, the run ends at {schedule.duration:g} s; "
            "give a longer --duration"
        )
    read.check_forcing(built, model.time, schedule.duration)
    folder.mkdir(parents=True, exist_ok=True)
    click.get_current_context().with_resource(alone_in(folder))
    _refuse_to_overwrite(folder, targets, force)  # another may have ended meanwhile
    if not quiet:
        click.echo(f"{read.name}: {read.title}\n{model!r}")
        for line in notes(model):
            click.echo(f"note: {line}")
    report = run_model(
        model, left, built.ocean, built.atmosphere,
        exchange=schedule.exchange, every=schedule.every,
        gridded=targets.gridded, trajectories=targets.trajectories, restart=targets.restart,
        attributes={"title": read.title or read.name, "scene": read.text},
        reference=built.start, calendar=built.calendar,
        projection=read.domain.projection, land=built.land,
        overwrite=force, progress=not quiet, profile=profile,
    )  # fmt: skip
    files = [*report.files, *_draw(targets)]
    if not quiet:
        click.echo(str(report))
        if profile:
            click.echo(report.profile())
        click.echo("\n".join(f"wrote {path}" for path in files))
    if not report.finished:
        command = _going_on(scene, overrides, duration, accuracy, targets.restart)
        say(f"floebmi: stopped at t = {report.end:g} s; go on with: {command}")
        sys.exit(130)


def _going_on(
    scene: str,
    overrides: tuple[str, ...],
    duration: float | None,
    accuracy: float | None,
    state: Path,
) -> str:
    """The command that continues an interrupted run with these options, up to the same end."""
    words = ["floebmi", "run", scene]
    words += [word for change in overrides for word in ("--set", change)]
    for option, value in (("--duration", duration), ("--accuracy", accuracy)):
        if value is not None:
            words += [option, repr(value)]
    return shlex.join([*words, "--restart", str(state), "--to", "ANOTHER_FOLDER"])


def _as_accurate(
    read: "Scene", scene: str, overrides: tuple[str, ...], accuracy: float, quiet: bool
) -> "Scene":
    """The scene with the setting that a stored result recommends.

    A result is of the scene with what was set by hand, or of the scene alone: then nothing may be set by hand that
    the setting sets, for its error would be another's.
    """
    from floebmi.scene import read_scene
    from floebmi.tables import parse_override
    from floebmi.tradeoff_result import chosen, result, setting_text

    alone = result(read) is None
    measured = read_scene(scene) if alone else read
    setting = chosen(measured, accuracy)
    for change in setting.split() if alone else ():
        for override in overrides:
            if parse_override(change).meets(parse_override(override)):
                raise InputError(
                    f"--accuracy {accuracy:g} takes {change}, which --set {override} changes: leave one of them out, "
                    f"or measure with it: floebmi tradeoff {scene} --set {override}"
                )
    if not quiet:
        click.echo(f"accuracy {accuracy:g}: {setting_text(result(measured), setting)}")
    changes = setting.split()
    return read_scene(scene, (*changes, *overrides) if alone else (*overrides, *changes))


class _Targets(NamedTuple):
    """What a run writes: files, and a folder of ParaView files; None is not asked for."""

    gridded: Path | None
    trajectories: Path | None
    picture: Path | None
    restart: Path
    paraview: Path | None


def _targets(scene: "Scene", folder: Path) -> _Targets:
    """What a run of a scene writes into a folder."""
    output = scene.output
    gridded = scene.grid is not None if output.gridded is None else output.gridded
    return _Targets(
        gridded=folder / "gridded.nc" if gridded else None,
        trajectories=folder / "floes.nc" if output.trajectories else None,
        picture=folder / f"{scene.name}.png" if output.picture and output.trajectories else None,
        restart=folder / "restart.nc",
        paraview=folder / "paraview" if output.paraview else None,
    )


def _refuse_to_overwrite(folder: Path, targets: _Targets, force: bool) -> None:
    """Raise InputError, before the run, for an output folder or files that cannot be written."""
    from floebmi.files import check_new_folder, check_target

    with _of("--to"):
        check_new_folder(folder)
    if not folder.is_dir():
        return
    asked = [path for path in targets if path is not None]
    for path in asked:
        if path.exists() and not force:
            raise InputError(f"{path}: exists already; give another folder with --to, or --force")
    for path in asked:
        if path == targets.paraview:
            check_new_folder(path)
        else:
            check_target(path, overwrite=True)


def _draw(targets: _Targets) -> list[Path]:
    """Draw the picture and write the ParaView files of a run that has ended; returns what was made."""
    files = []
    if targets.picture is not None:
        from floebmi.plot import frame

        frame(targets.trajectories, targets.gridded, to=targets.picture)
        files.append(targets.picture)
    if targets.paraview is not None:
        from floebmi.paraview import export

        outputs = (targets.trajectories, targets.gridded)
        files += [export(path, targets.paraview) for path in outputs if path is not None]
    return files


@contextlib.contextmanager
def _of(what: str) -> Iterator[None]:
    try:
        yield
    except InputError as error:
        raise InputError(f"{what}: {error}") from error


@floebmi.command()
@click.argument("scene", shell_complete=_scenes)
@_set_option
@click.option(
    "--calibrate", is_flag=True,
    help="Run the scene for some seconds, and store what a step costs on this machine.",
)  # fmt: skip
def explain(scene: str, overrides: tuple[str, ...], calibrate: bool) -> None:
    """Say what a scene models and what it will cost.

    Also says why, what is left out, and the time step and memory. SCENE is a TOML or YAML file, or the name of a packaged
    scene.
    """
    from floebmi import calibration
    from floebmi.explain import explain as explain_scene
    from floebmi.scene import read_scene

    read = read_scene(scene, overrides)
    built = read.build()
    if calibrate:
        calibration.keep(built.model, calibration.measure(read.build(), read.time.duration))
    if read.time.duration is not None:
        read.check_forcing(built, 0.0, read.time.duration)
    click.echo(explain_scene(read, built))


@floebmi.command()
@click.argument("scene", shell_complete=_scenes)
@_set_option
@click.option(
    "--error", type=float, default=0.05, metavar="ERROR",
    help="Error allowed for the recommended setting, relative to the reference (default: 0.05).",
)  # fmt: skip
@click.option(
    "--of", metavar="QUANTITY",
    help="Quantity whose error counts: transport, drift, area_fraction, velocity or stress.",
)  # fmt: skip
@click.option(
    "--seeds",
    type=int,
    default=3,
    help="Number of seeds, that is, runs of each setting (default: 3).",
)
@click.option(
    "--duration",
    type=float,
    metavar="SECONDS",
    help="Duration of each run, instead of the scene's.",
)
@click.option(
    "--budget",
    type=float,
    metavar="MINUTES",
    help="Shorten the runs so that all of them fit into this time.",
)
@click.option("--jobs", type=click.IntRange(1), help="Number of processes (default: all cores).")
@click.option(
    "--to", "target", type=PATH, metavar="FILE",
    help="NetCDF file to write, with a .png beside it (default: SCENE.tradeoff.nc here). `run --accuracy` reads the file "
    "beside the scene.",
)  # fmt: skip
@click.option("--quiet", is_flag=True, help="Print nothing but errors.")
def tradeoff(
    scene: str,
    overrides: tuple[str, ...],
    error: float,
    of: str | None,
    seeds: int,
    duration: float | None,
    budget: float | None,
    jobs: int | None,
    target: Path | None,
    quiet: bool,
) -> None:
    """Measure cost and error of a scene's settings.

    The settings are numerical ones, such as step, stiffness and exchange interval, and one of them is recommended.

    Every setting runs with the same seeds and is compared with a fine reference. An asterisk marks settings that no other beats in
    both cost and error. Finished runs are kept beside the file and not run again.
    """
    from floebmi import plot as draw, tradeoff_result as results
    from floebmi.files import check_target
    from floebmi.scene import read_scene
    from floebmi.tradeoff import tradeoff as measure

    if target is None:
        target = Path(f"{read_scene(scene, overrides).name}{results.SUFFIX}")
    if target.parent.is_dir():
        check_target(target.with_suffix(".png"), overwrite=True)
    made = measure(
        scene, overrides, error=error, of=of, seeds=seeds, duration=duration, budget=budget, to=target,
        jobs=jobs, progress=not quiet,
    )  # fmt: skip
    picture = made.path.with_suffix(".png")
    draw.save(results.figure(made.data), picture)
    if not quiet:
        of, best = made.data.attrs["of"], results.recommended(made.data, error)
        click.echo(f"{made.why}\n{results.table(made.data)}")
        if best is None:
            click.echo(f"no setting has an error of {of} below {error:g}")
        else:
            click.echo(
                f"for an error of {of} below {error:g}, or that the seeds cannot tell: "
                f"{results.setting_text(made.data, best)}"
            )
        click.echo(f"wrote {made.path}\nwrote {picture}")
    if made.failures:
        fail(
            f"{len(made.failures)} runs failed, for the reasons above; the same command runs them again,"
            " in vain if the scene is the reason",
            3,
        )


@floebmi.command()
@click.argument("name", required=False)
@click.option(
    "--to", "target", type=PATH, metavar="FILE",
    help="Copy the scene to this file (or into this folder), with its data files.",
)  # fmt: skip
@click.option("--force", is_flag=True, help="Replace existing files.")
@click.option(
    "--keys", is_flag=True, help="List all keys of a scene file, with units and defaults."
)
def scene(name: str | None, target: Path | None, force: bool, keys: bool) -> None:
    """List, print or copy the packaged scenes.

    Without NAME, list them; with NAME, print that scene, or copy it with --to.
    """
    from floebmi.scenes import file_of, packaged, titles

    if keys:
        if name is not None or target is not None:
            raise InputError("--keys lists the keys of any scene: leave NAME and --to out")
        _print_keys()
    elif name is None:
        if target is not None:
            raise InputError(f"--to {target}: say which scene; {choose('', packaged())}")
        width = max(map(len, titles()))
        click.echo("\n".join(f"{each:<{width}}  {title}" for each, title in titles().items()))
        click.echo(
            "\nfloebmi run NAME runs one; floebmi scene NAME --to FILE.toml copies it to edit."
        )
    elif target is None:
        click.echo(file_of(name).read_text(encoding="utf-8"), nl=False)
    else:
        from floebmi.scene import copy_scene

        for path in copy_scene(name, target, force):
            click.echo(f"wrote {path}")


def _print_keys() -> None:
    from floebmi.scene import Scene
    from floebmi.tables import keys

    click.echo(
        "Every number is in SI units (m, s, m/s, Pa, kg/m³); angles on the globe in degrees."
    )
    above = None
    for table, key, default, text in keys(Scene):
        if table != above:
            click.echo(f"\n[{table}]" if table else "")
            above = table
        click.echo(f"  {key:<18} {default:<22} {text}".rstrip())


class _Pictured(NamedTuple):
    """The files of a run that a picture is made of."""

    trajectories: Path | None
    gridded: Path | None

    @property
    def first(self) -> Path:
        return self.trajectories or self.gridded or Path()


def _outputs(path: Path) -> _Pictured:
    """Trajectory and gridded file of a run, from its folder or one of the two; else InputError."""
    from floebmi.output import open_file

    if path.is_dir():
        files = _Pictured(path / "floes.nc", path / "gridded.nc")
        have = _Pictured(*(file if file.exists() else None for file in files))
        if not any(have):
            raise InputError(f"{path}: holds neither floes.nc nor gridded.nc, the output of a run")
        return have
    with open_file(path, "trajectories", "gridded") as data:
        kind = str(data.floebmi_file)
    if kind.startswith("gridded"):
        return _Pictured(None, path)
    beside = path.with_name("gridded.nc")  # of the same run: has the wind, and degrees
    return _Pictured(path, beside if path.name == "floes.nc" and beside.exists() else None)


def _is_tradeoff(path: Path) -> bool:
    from floebmi.output import open_file

    if path.is_dir():
        return False
    with open_file(path, "trajectories", "gridded", "tradeoff") as data:
        return str(data.floebmi_file).startswith("tradeoff")


def _target(target: Path | None, default: Path, force: bool, folder: bool = False) -> Path:
    """Where to write; InputError before anything is made for a place where that cannot be."""
    from floebmi.files import check_new_folder, check_target

    target = default if target is None else target
    if target.exists() and not force and target.is_dir() == folder:
        raise InputError(f"{target}: exists already; give another place with --to, or --force")
    if folder:
        check_new_folder(target)
    else:
        check_target(target, overwrite=True)
    return target


def _to_option(metavar: str, text: str) -> Callable:
    return click.option("--to", "target", type=PATH, metavar=metavar, help=text)


_force_option = click.option("--force", is_flag=True, help="Replace existing output.")
_color_option = click.option(
    "--color", default="speed", metavar="NAME",
    help="Variable of floes.nc to colour floes by: speed (default), thickness, pressure, contact_force, bond_count …",
)  # fmt: skip
_arrows_option = click.option(
    "--arrows", type=click.Choice(["ice", "ocean", "wind", "stress"]),
    help="Draw arrows of this velocity, or of the stress of the ice on the ocean.",
)  # fmt: skip


@floebmi.command()
@click.argument("file", type=PATH)
@_to_option("FILE", "Picture to write (.png, .pdf, .svg; default: a .png beside FILE).")
@_force_option
@click.option(
    "--time",
    "number",
    default=-1,
    help="Index of the frame, from 0; negative counts from the end (default: the last).",
)
@_color_option
@click.option(
    "--variable",
    metavar="NAME",
    help="Draw a map of this variable of gridded.nc instead of the floes.",
)
@click.option("--ledger", is_flag=True, help="Draw mass, momentum and energy against time instead.")
@_arrows_option
def plot(
    file: Path,
    target: Path | None,
    force: bool,
    number: int,
    color: str,
    variable: str | None,
    ledger: bool,
    arrows: str | None,
) -> None:
    """Draw one frame of a run.

    FILE is the folder of the run, its floes.nc or its gridded.nc. For the NetCDF file of a trade-off, draws error against cost
    of its settings.
    """
    from floebmi import plot as draw

    if _is_tradeoff(file):
        from floebmi.tradeoff_result import figure, read

        _refuse("a trade-off", "number", "color", "variable", "ledger", "arrows")
        target = _target(target, file.with_suffix(".png"), force)
        draw.save(figure(read(file)), target)
        click.echo(f"wrote {target}")
        return
    files = _outputs(file)
    if ledger:
        _refuse("--ledger", "color", "variable", "number", "arrows")
        target = _target(target, files.first.with_name("ledger.png"), force)
        draw.ledger(files.first, target)
    elif variable is not None or files.trajectories is None:
        if files.gridded is None:
            raise InputError(f"{file}: --variable {variable}: needs the gridded.nc of the run")
        _refuse("a map of gridded.nc", "color")
        name = variable or "area_fraction"
        target = _target(target, files.gridded.with_name(f"{name}.png"), force)
        draw.field(files.gridded, name, number, target, arrows=arrows)
    else:
        target = _target(target, files.trajectories.with_suffix(".png"), force)
        draw.frame(files.trajectories, files.gridded, number, color, target, arrows=arrows)
    click.echo(f"wrote {target}")


def _refuse(what: str, *parameters: str) -> None:
    """InputError for one of these parameters on the command line: `what` would not show it."""
    ctx = click.get_current_context()
    for parameter in ctx.command.params:
        given = parameter.name in parameters and ctx.get_parameter_source(parameter.name)
        if given is ParameterSource.COMMANDLINE:
            raise InputError(f"{parameter.opts[0]}: {what} does not show it; leave it out")


@floebmi.command()
@click.argument("file", type=PATH)
@_to_option("FILE", "Animation to write (.mp4 or .gif; default: an .mp4 beside FILE).")
@_force_option
@_color_option
@_arrows_option
@click.option("--fps", default=12, help="Frames per second (default: 12).")
@click.option("--every", default=1, help="Use only every n-th frame.")
def animate(
    file: Path,
    target: Path | None,
    force: bool,
    color: str,
    arrows: str | None,
    fps: int,
    every: int,
) -> None:
    """Make an animation of a run.

    FILE is the folder of the run, or its floes.nc.
    """
    from floebmi import plot as draw

    files = _outputs(file)
    if files.trajectories is None:
        raise InputError(f"{file}: a film needs the floes.nc of the run")
    target = _target(target, files.trajectories.with_suffix(".mp4"), force)
    with _progress("frames") as show:
        draw.animate(
            files.trajectories, files.gridded, target,
            color=color, arrows=arrows, fps=fps, every=every, progress=show,
        )  # fmt: skip
    click.echo(f"wrote {target}")


@floebmi.command()
@click.argument("file", type=PATH)
@_to_option("FILE", "Page to write (.html; default: an .html beside FILE).")
@_force_option
@_color_option
@click.option("--every", default=1, help="Use only every n-th frame.")
def view(file: Path, target: Path | None, force: bool, color: str, every: int) -> None:
    """Make an HTML page of a run, with a time slider.

    FILE is the folder of the run, or its floes.nc.
    """
    from floebmi import plot as draw

    files = _outputs(file)
    if files.trajectories is None:
        raise InputError(f"{file}: a page needs the floes.nc of the run")
    target = _target(target, files.trajectories.with_suffix(".html"), force)
    click.echo(f"wrote {draw.page(files.trajectories, target, color=color, every=every)}")


@floebmi.command()
@click.argument("file", type=PATH)
@_to_option("FOLDER", "Folder for the files (default: paraview, beside FILE).")
@_force_option
def export(file: Path, target: Path | None, force: bool) -> None:
    """Write ParaView files of a run.

    FILE is the folder of the run, its floes.nc or its gridded.nc.
    """
    from floebmi.paraview import export as write

    files = [path for path in _outputs(file) if path is not None]
    if not file.is_dir():
        files = [file]
    target = _target(target, files[0].with_name("paraview"), force, folder=True)
    for path in files:
        with _progress("frames") as show:
            click.echo(f"wrote {write(path, target, show)}")


@contextlib.contextmanager
def _progress(unit: str) -> Iterator[Callable[[int, int], None]]:
    bar = None  # none before there is something to count: an error stands alone

    def show(done: int, total: int) -> None:
        nonlocal bar
        if bar is None:
            bar = meter(total=total, unit=f" {unit}")
        bar.update(done - bar.n)

    try:
        yield show
    finally:
        if bar is not None:
            bar.close()


@floebmi.command()
@click.argument("cases", nargs=-1, metavar="[CASE]...")
@click.option("--long", is_flag=True, help="More steps, more floes, wider ranges; takes minutes.")
@click.option(
    "--save", "target", type=PATH, metavar="FILE.json",
    help="Also write the results as JSON.",
)  # fmt: skip
@_force_option
def validate(cases: tuple[str, ...], long: bool, target: Path | None, force: bool) -> None:
    """Run extreme cases against their pass marks.

    Runs all cases, or each CASE named, and prints what was measured, the pass mark and its source.
    """
    from floebmi.measures import save, table
    from floebmi.validate import find

    chosen = find(cases)
    if target is not None:
        target = _target(target, target, force)
    results = {}
    with _progress("cases") as show:
        for k, case in enumerate(chosen):
            show(k, len(chosen))
            results[case] = case.run(long)
        show(len(chosen), len(chosen))
    click.echo(table(results))
    if target is not None:
        save(results, target)
        click.echo(f"wrote {target}")
    failed = [c.name for c, measures in results.items() if not all(m.passed for m in measures)]
    if failed:
        fail(f"{len(failed)} of {len(results)} cases miss their mark: {', '.join(failed)}", 1)


floebmi.add_command(experiment)
