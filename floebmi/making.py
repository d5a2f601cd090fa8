"""Clocks that stand still while kernels are compiled or loaded.

Making kernels takes from milliseconds to a minute, once, wherever one is first called: a profile or a cost that had it in
would tell of the state of a cache, not of the work.
"""

import functools
import time
from collections.abc import Callable
from typing import Any


class Making:
    """What it has taken this process to make kernels [s]: on the clock, and of a processor."""

    clock = 0.0
    processor = 0.0
    _depth = 0  # kernels are made while another is

    @classmethod
    def timed(cls, make: Callable) -> Callable:
        """A function that makes kernels, with its time counted."""

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
    """Seconds on the clock since some moment, without those for making kernels."""
    return time.perf_counter() - Making.clock


def work_of_processor() -> float:
    """Seconds of a processor that this process has taken, without those for making kernels."""
    return time.process_time() - Making.processor
