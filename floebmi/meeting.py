"""Barriers at which threads wait for each other inside a kernel; a return to Python would cost as much as a step.

numba has no atomic operations on CPUs, so they are written in LLVM, like the columns of pairs.
"""

import os

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from floebmi.kernels import inner

SPINS = 500_000  # reads of the counter, about a millisecond, before a thread yields its core
REST = 20  # length of one sleep [µs]


def _first(context, builder, kind, value):
    return context.make_array(kind)(context, builder, value).data


@intrinsic
def _arrive(typing, counter):
    """Count one more arrival in the first number of an array."""

    def generate(context, builder, signature, arguments):
        place = _first(context, builder, signature.args[0], arguments[0])
        builder.atomic_rmw("add", place, ir.IntType(64)(1), "seq_cst")
        return context.get_dummy_value()

    return types.void(counter), generate


@intrinsic
def _arrived(typing, counter):
    """The number of arrivals, read atomically."""

    def generate(context, builder, signature, arguments):
        place = _first(context, builder, signature.args[0], arguments[0])
        return builder.load_atomic(place, "seq_cst", 8)

    return types.int64(counter), generate


@intrinsic
def _rest(typing):
    """Sleep for `REST`, where the system has a call for it."""

    def generate(context, builder, signature, arguments):
        if os.name == "posix":
            kind = ir.FunctionType(ir.IntType(32), [ir.IntType(32)])
            name = "usleep"
            found = builder.module.globals.get(name) or ir.Function(builder.module, kind, name)
            builder.call(found, [ir.IntType(32)(REST)])
        return context.get_dummy_value()

    return types.void(), generate


@inner
def meet(counter, threads, times):
    """Wait until all threads are here; what each wrote before, all see afterwards.

    counter : (1,) int64, initially 0; times : how often they have met so far.  Returns times + 1.
    """
    _arrive(counter)
    spins = 0
    while _arrived(counter) < threads * (times + 1):
        spins += 1
        if spins > SPINS:
            _rest()
    return times + 1
