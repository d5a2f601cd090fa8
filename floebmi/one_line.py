"""Commands whose errors and warnings are one line each.

Bad input ends with exit code 2; a run that left its bounds with 3; an error of the program itself with 1, unless `--debug`
asks for the traceback.
"""

import contextlib
import sys
import traceback
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import click

from floebmi.errors import InputError, StabilityError, choose
from floebmi.meter import say


class Command(click.Command):
    """A command whose errors are one line each."""

    def __init__(self, *args: Any, **settings: Any) -> None:
        super().__init__(*args, **settings)
        self.params.append(
            click.Option(["--debug"], is_flag=True, help="Show the traceback of an error.")
        )

    def invoke(self, ctx: click.Context) -> Any:
        debug = ctx.params.pop("debug")
        errors = contextlib.nullcontext() if debug else _errors_in_one_line()
        with _warnings_in_one_line(), errors:
            return super().invoke(ctx)


class Group(click.Group):
    """The commands; what is wrong with a command line is said in one line as well."""

    command_class = Command

    def main(self, args: Sequence[str] | None = None, **settings: Any) -> Any:
        if not settings.pop("standalone_mode", True):
            return super().main(args, standalone_mode=False, **settings)
        with contextlib.suppress(AttributeError):  # such as Latin-1: a lost sign is no lost run
            sys.stdout.reconfigure(errors="replace")
        try:
            settings["prog_name"] = "floebmi"
            code = super().main(args, standalone_mode=False, **settings)
        except click.exceptions.NoArgsIsHelpError as error:
            click.echo(error.ctx.get_help() if error.ctx else "")
            code = 0
        except click.ClickException as error:
            fail(_usage(error), error.exit_code)
        except click.Abort:
            fail("stopped", 130)
        except OSError as error:  # of what is printed before a command begins, such as its help
            fail(_of_the_system(error), 2)
        sys.exit(code if isinstance(code, int) else 0)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args and self.get_command(ctx, args[0]) is None and not args[0].startswith("-"):
            allowed = choose(args[0], self.list_commands(ctx))
            raise click.UsageError(f"no command {args[0]!r}; {allowed}", ctx)
        return super().resolve_command(ctx, args)


def _usage(error: click.ClickException) -> str:
    text = " ".join(error.format_message().split())
    ctx = getattr(error, "ctx", None)
    where = f" ({ctx.command_path} --help)" if ctx is not None else ""
    return text.rstrip(".") + where


@contextlib.contextmanager
def _errors_in_one_line() -> Iterator[None]:
    try:
        yield
    except InputError as error:
        fail(_with_notes(error), 2)
    except StabilityError as error:
        fail(_with_notes(error), 3)
    except OSError as error:
        fail(_of_the_system(error), 2)
    except MemoryError as error:
        fail(
            f"not enough memory: {_with_notes(error)}; must be fewer cells or floes (sizes are in m)",
            2,
        )
    except KeyboardInterrupt as error:
        fail(f"stopped{_notes(error)}", 130)
    except (click.ClickException, click.exceptions.Exit, click.Abort):
        raise
    except Exception as error:  # noqa: BLE001  a bug of ours: the user gets one line all the same
        text = _with_notes(error)
        fail(f"error in the program: {type(error).__name__}: {text}; --debug shows where", 1)


def _of_the_system(error: OSError) -> str:
    name = f"{error.filename}: " if error.filename else ""
    *_, (last, _) = traceback.walk_tb(error.__traceback__)
    if not name and last.f_code is click.echo.__code__:
        name = "standard output: "
    return f"{name}{error.strerror or error}{_notes(error)}"


def _with_notes(error: BaseException) -> str:
    return f"{error}{_notes(error)}"


def _notes(error: BaseException) -> str:
    return "".join(f"; {note}" for note in getattr(error, "__notes__", ()))


def fail(text: str, code: int) -> None:
    """End the program with one line and an exit code."""
    say(f"floebmi: {' '.join(text.split())}")
    sys.exit(code)


@contextlib.contextmanager
def _warnings_in_one_line() -> Iterator[None]:
    told = set()  # two fields of one file may give the same cause

    def show(message: Warning | str, category: type[Warning], *place: object) -> None:
        line = " ".join(str(message).split())
        if line not in told:
            say(f"floebmi: warning: {line}")
        told.add(line)

    with warnings.catch_warnings():
        warnings.simplefilter("default", UserWarning)
        warnings.showwarning = show
        yield


class _PathType(click.Path):
    """A path; an empty one, as of a variable of the shell that is not set, would be the folder here."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if not str(value):
            self.fail("is empty; must be a path", param, ctx)
        return super().convert(value, param, ctx)


PATH = _PathType(path_type=Path)
