"""The commands `floebmi experiment …`, with an option for each parameter and those of an ensemble."""

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import click

from floebmi.errors import InputError
from floebmi.experiments.parameters import (
    NORMAL_STRESSES,
    Experiment,
    Shear,
    Strait,
    rows,
    table,
)
from floebmi.one_line import PATH, Group, fail


class _Several(click.ParamType):
    """One value, or several separated by commas."""

    name = "several"

    def __init__(self, word: bool) -> None:
        self.word = word

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if not isinstance(value, str):
            return value
        parts = tuple(part.strip() for part in value.split(","))
        if self.word:
            return parts
        try:
            return tuple(float(part) for part in parts)
        except ValueError:
            self.fail(
                f"{value!r}: must be a number, or numbers with commas between them", param, ctx
            )


def _experiment_options(kind: type[Experiment]) -> Callable:
    """An option for each parameter of the experiment's table."""

    def add(function: Callable) -> Callable:
        for name, default, row in reversed(list(rows(kind))):
            unit = f" [{row.unit}]" if row.unit not in ("", "1") else ""
            usual = NORMAL_STRESSES if name == "normal_stress" else (default,)
            shown = ",".join(one if isinstance(one, str) else f"{one:g}" for one in usual)
            function = click.option(
                f"--{name.replace('_', '-')}", name, type=_Several(isinstance(default, str)),
                metavar="VALUE[,…]", help=f"{row.meaning}{unit} (default: {shown}).",
            )(function)  # fmt: skip
        return function

    return add


SEEDS = {"shear": 3, "strait": 20}  # default number of seeds of an experiment


def _ensemble_options(function: Callable) -> Callable:
    for option in reversed(
        [
            click.option(
                "--seeds", type=click.IntRange(1),
                help=f"Number of seeds at each point of the sweep (default: {', '.join(f'{k} {n}' for k, n in SEEDS.items())}).",
            ),
            click.option(
                "--save", type=PATH, metavar="FILE",
                help="NetCDF file to write (default: shear.nc or strait.nc), or with --figure the picture (default: figure-N.png). "
                "Finished members are kept beside it and not run again.",
            ),
            click.option(
                "--figure", type=click.IntRange(1, 10), metavar="N",
                help="Run the experiment of figure N of the paper, and draw it.",
            ),
            click.option("--jobs", type=click.IntRange(1), help="Number of processes (default: all cores)."),
            click.option(
                "--cluster", metavar="ADDRESS", help="Run on the Dask cluster with this scheduler."
            ),
            click.option("--quiet", is_flag=True, help="Print nothing but errors."),
        ]
    ):  # fmt: skip
        function = option(function)
    return function


@click.group(cls=Group)
def experiment() -> None:
    """Repeat the experiments of the paper.

    Several values separated by commas make a sweep.
    """


@experiment.command("table")
def _table() -> None:
    """Print all parameters and their sources."""
    for kind in (Shear, Strait):
        click.echo(f"{kind.__name__}: {kind.__doc__}\n{table(kind)}\n")


@experiment.command("shear")
@_experiment_options(Shear)
@_ensemble_options
def _shear(**options: Any) -> None:
    """Shear a pack under a loaded wall (Figs 1, 3, 4)."""
    _run(Shear, **options)


@experiment.command("strait")
@_experiment_options(Strait)
@_ensemble_options
def _strait(**options: Any) -> None:
    """Drive floes through a strait until it jams (Figs 2, 5 to 10)."""
    _run(Strait, **options)


def _run(
    kind: type[Experiment],
    *,
    seeds: int | None,
    save: Path | None,
    figure: int | None,
    jobs: int | None,
    cluster: str | None,
    quiet: bool,
    **given: tuple[Any, ...] | None,
) -> None:
    from floebmi.experiments import campaign, figures

    name = kind.__name__.lower()
    values = {key: several for key, several in given.items() if several is not None}
    numbers = range(1, (seeds or SEEDS[name]) + 1)
    with _cluster(cluster) as on:
        how = {"jobs": jobs, "on": on, "progress": not quiet}
        if figure is not None:
            made = figures.make_figure(figure, kind, values, numbers, save, **how)
        else:
            if kind is Shear:
                values.setdefault("normal_stress", NORMAL_STRESSES)
            made = campaign.run(kind, values, numbers, save or Path(f"{name}.nc"), **how)
    if not quiet:
        told = [made.text] if made.text else []
        click.echo("\n".join([*told, *(f"wrote {path}" for path in made.files)]))
    if made.failures:
        fail(
            f"{len(made.failures)} members failed, for the reasons above; the same command runs them again,"
            " in vain if a parameter is the reason",
            3,
        )


@contextlib.contextmanager
def _cluster(address: str | None) -> Iterator[Any]:
    if address is None:
        yield None
        return
    try:
        from distributed import Client
    except ImportError:
        raise InputError(
            "--cluster: needs dask.distributed, pip install 'floebmi[ensemble]'"
        ) from None
    try:
        client = Client(address, timeout=10)
    except (OSError, ValueError) as error:
        raise InputError(f"--cluster {address}: {error}; must be a running scheduler") from None
    with client:
        yield client
