"""Clocks that stop while kernels are compiled or loaded.

This takes from milliseconds to a minute, once, wherever a kernel is first called: a profile or a cost that included it
would measure the state of a cache, not the work.
"""

import functools
import time
from collections.abc import Callable
from typing import Any


class Making:
    """Time that this process has spent compiling or loading kernels [s]: wall-clock and CPU time."""

    clock = 0.0
    processor = 0.0
    _depth = 0  # a kernel may be made during another

    @classmethod
    def timed(cls, make: Callable) -> Callable:
        """Wrap a function that makes kernels, to count its time."""

        @functools.wraps(make)
        def made(*args: Any) -> Any:
            clock, processor = time.perf_counter(), time.process_time()
            cls._depth += 1
            try:
                return make(*args)
            finally:
                cls._depth -= 1
                if not cls._depth:
                    cls.clock += time.perf_counter() - clock
                    cls.processor += time.process_time() - processor

        return made


def work_clock() -> float:
    """Wall-clock time since an arbitrary moment [s], without that for making kernels."""
    return time.perf_counter() - Making.clock


def work_of_processor() -> float:
    """CPU time of this process [s], without that for making kernels."""
    return time.process_time() - Making.processor
