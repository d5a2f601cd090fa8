"""One thread at a time at a model: kernels let other threads run, and two in one model would spoil it."""

import contextlib
import threading
from collections.abc import Iterator
from typing import TYPE_CHECKING

from floebmi.errors import InputError

if TYPE_CHECKING:
    from floebmi.model import Model

_MARK = "_thread"  # in a model: the thread that has it to itself, if one has


@contextlib.contextmanager
def alone(model: "Model", call: str) -> Iterator[None]:
    """Nobody else at this model meanwhile; calls within it are of the same thread, and may ask for the same.

    Raises
    ------
    InputError
        where another thread has it to itself; nothing has happened then.
    """
    inner = vars(model).get(_MARK) == threading.get_ident()
    try:
        # in one go, so of two threads that ask at once one gets it
        vars(model).setdefault(_MARK, threading.get_ident())
        refuse_another(model, call)
        yield
    finally:
        if not inner and vars(model).get(_MARK) == threading.get_ident():
            del vars(model)[_MARK]


def free(model: "Model") -> None:
    """A copy belongs to no thread yet, whoever made it."""
    vars(model).pop(_MARK, None)


def refuse_another(model: "Model", call: str) -> None:
    """InputError where another thread has this model to itself."""
    if vars(model).get(_MARK, threading.get_ident()) != threading.get_ident():
        raise InputError(
            f"{call}: another thread is at work on this model; wait for it, or give each thread a model of its own"
        )
