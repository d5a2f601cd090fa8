"""A meter on the error stream: whatever becomes of that stream, what it measures goes on.

The disk that a log is written to may be full, the terminal gone, or no stream there at all.
"""

import contextlib
import sys
from typing import Any


class _Errors:
    """sys.stderr as it is at the time; what cannot be written is left out."""

    def write(self, text: str) -> None:
        with contextlib.suppress(OSError, ValueError, AttributeError):
            sys.stderr.write(text)

    def flush(self) -> None:
        with contextlib.suppress(OSError, ValueError, AttributeError):
            sys.stderr.flush()

    def __getattr__(self, name: str) -> Any:
        return getattr(sys.stderr, name)


def say(text: str) -> None:
    """A line on the error stream."""
    errors = _Errors()
    errors.write(f"{text}\n")
    errors.flush()


def meter(**settings: Any) -> Any:
    """A bar of tqdm, with its settings; `write` writes a line beside it."""
    from tqdm import tqdm

    class Bar(tqdm):
        monitor_interval = 0  # no thread of its own: it would outlive the bar, and a host may fork

        def write(self, text: str) -> None:
            super().write(text, file=self.fp)

    terminal = sys.stderr is not None and not sys.stderr.closed and sys.stderr.isatty()
    return Bar(file=_Errors(), miniters=0, mininterval=0.2 if terminal else 5.0, **settings)
