"""Errors with messages of one line, and warnings at the user's line.

`InputError` is for wrong input (a scene, a file, an argument): the message names the place, the
value and what would be right.  `StabilityError` is for a run that left the limits of the model.
"""

import difflib
import sys
import warnings
from collections.abc import Collection, Iterable


class InputError(ValueError):
    """Input that cannot be used; the message is one line that says what would be right."""

    def __init__(self, text: str) -> None:
        # values that stand in the text may take several lines: arrays, tables, texts of other libraries
        super().__init__(" ".join(text.splitlines()))


class StabilityError(RuntimeError):
    """A run left the limits of the model, mostly by a time step that is too long; the message names floe, time and step, and what would help."""


def warn(text: str | Warning, kind: type[Warning] = UserWarning) -> None:
    """Warn at the line of the user's program that led here, from however deep in this package."""
    level, frame = 2, sys._getframe(1)
    while frame and _is_ours(str(frame.f_globals.get("__name__"))):
        level, frame = level + 1, frame.f_back
    warnings.warn(text, kind, stacklevel=level)


def _is_ours(module: str) -> bool:
    return module.partition(".")[0] in ("floebmi", "coupling")


def in_line(value: object) -> str:
    """The repr of a value in one line; that of arrays and tables may have several."""
    return " ".join(repr(value).split())


def is_word(word: object, allowed: Iterable[object]) -> bool:
    """Whether a value is one of these words; False for arrays and values that cannot be hashed."""
    return isinstance(word, str) and word in allowed


def check_word(name: str, value: object, allowed: Collection[str]) -> None:
    """Raise InputError for anything but one of the allowed words."""
    if not is_word(value, allowed):
        raise InputError(f"{name} = {value!r}: {choose(value, allowed)}")


def check_text(name: str, value: object) -> None:
    """Raise InputError for anything but a string or None."""
    if not isinstance(value, str | None):
        raise InputError(f"{name} = {in_line(value)}: must be a text")


def choose(word: object, allowed: Iterable[str]) -> str:
    """The end of an error message: the allowed words, and the most similar one if there is one.

    If the words do not fit into a line, only the most similar one is given, if there is one.
    """
    words = sorted(allowed)
    near = difflib.get_close_matches(str(word), words, n=1)
    if near and len(words) > 20:
        return f"did you mean {near[0]!r}?"
    hint = f"; did you mean {near[0]!r}?" if near else ""
    return f"allowed: {', '.join(words)}{hint}"
