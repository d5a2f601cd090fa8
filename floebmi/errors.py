"""What goes wrong is said in one line.

`InputError` is for what a person wrote (a scene, a file, an argument): the line names the place, the
value and what would be right.  `StabilityError` is for a run that left its bounds.
"""

import difflib
from collections.abc import Collection, Iterable


class InputError(ValueError):
    """Input that cannot be used; its text is one line that says what would be right."""

    def __init__(self, text: str) -> None:
        # values that stand in the text may take several lines: arrays, tables, texts of other libraries
        super().__init__(" ".join(text.splitlines()))


class StabilityError(RuntimeError):
    """A run left its bounds; its text names floe, time, step, and what would hold."""


def in_line(value: object) -> str:
    """A value as Python shows it, in one line: arrays and tables take several."""
    return " ".join(repr(value).split())


def is_word(word: object, allowed: Iterable[object]) -> bool:
    """Whether it is one of these words; an array in the place of a word is none, nor is what cannot be looked up."""
    return isinstance(word, str) and word in allowed


def check_word(name: str, value: object, allowed: Collection[str]) -> None:
    """InputError for what is none of the allowed words."""
    if not is_word(value, allowed):
        raise InputError(f"{name} = {value!r}: {choose(value, allowed)}")


def check_text(name: str, value: object) -> None:
    """InputError for what is neither a text nor None."""
    if not isinstance(value, str | None):
        raise InputError(f"{name} = {in_line(value)}: must be a text")


def choose(word: object, allowed: Iterable[str]) -> str:
    """The end of an error message: the allowed words, and the nearest one if one is near.

    Of more words than fit a line only the nearest is told, if there is one.
    """
    words = sorted(allowed)
    near = difflib.get_close_matches(str(word), words, n=1)
    if near and len(words) > 20:
        return f"did you mean {near[0]!r}?"
    hint = f"; did you mean {near[0]!r}?" if near else ""
    return f"allowed: {', '.join(words)}{hint}"
