"""The values that the benchmarks' options take, and how a benchmark says in one line what is wrong with its input."""

import argparse
import math
import sys
from collections.abc import Callable, Collection
from pathlib import Path
from typing import TypeVar

from floebmi import InputError

T = TypeVar("T")


def whole_from(least: int) -> Callable[[str], int]:
    def whole(text: str) -> int:
        if not text.isdecimal() or int(text) < least:
            raise argparse.ArgumentTypeError(f"{text}: must be a whole number, at least {least}")
        return int(text)

    return whole


whole = whole_from(1)


def number_from(least: float) -> Callable[[str], float]:
    def number(text: str) -> float:
        if not least <= float(text) < math.inf:
            raise argparse.ArgumentTypeError(f"{text}: must be a number, at least {least:g}")
        return float(text)

    return number


def several(one: Callable[[str], T]) -> Callable[[str], list[T]]:
    """Values with commas between them."""

    def values(text: str) -> list[T]:
        return [one(part) for part in text.split(",")]

    return values


def name_of(known: Collection[str]) -> Callable[[str], str]:
    def name(text: str) -> str:
        if text not in known:
            raise argparse.ArgumentTypeError(f"{text}; known: {', '.join(known)}")
        return text

    return name


def file_to_write(text: str) -> Path:
    """Looked at before the runs, which take hours."""
    if not Path(text).parent.is_dir():
        raise argparse.ArgumentTypeError(f"{text}: there is no such folder")
    return Path(text)


def picture(text: str) -> Path:
    if Path(text).suffix not in (".png", ".pdf", ".svg"):
        raise argparse.ArgumentTypeError(f"{text}: must end with .png, .pdf or .svg")
    return file_to_write(text)


def run(main: Callable[[], None]) -> None:
    """Call it; what the package refuses, such as a pack of too few floes, ends it with one line and exit code 2."""
    try:
        main()
    except InputError as error:
        print(error, file=sys.stderr)
        raise SystemExit(2) from None
