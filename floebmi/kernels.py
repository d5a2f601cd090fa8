"""The set-up of numba for this package; no other file configures it.

`jit` compiles with the disk cache of `kept_code`: numba's own would keep running the old code of an edited law.

`dispatched` selects the code of a law by the *type* of its first argument, when the kernel is compiled.
A law is a NamedTuple of numbers; `None` is an absent law, and compiles to nothing.
"""

import functools
import inspect
from collections.abc import Callable
from types import FunctionType
from typing import Any, get_type_hints

import numba
import numpy as np
from llvmlite import binding
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.extending import overload, register_jitable

from floebmi.errors import InputError
from floebmi.kept_code import Cache, digest_of, is_ours, laws_from_outside
from floebmi.making import Making

FASTMATH = {"contract", "reassoc", "arcp", "nsz"}  # not nnan/ninf: they would defeat the NaN guards
# Inlined into the kernels that Python calls.  Otherwise each kernel would have its own compiled copy of a shared function,
# each optimised differently; which copy a process runs, and so the last bits of results, would depend on what it
# compiled before.
OPTIONS = {
    "fastmath": FASTMATH,
    "error_model": "numpy",
    "forceinline": True,
    "no_cfunc_wrapper": True,
}
# Reference counting of arrays owned by the caller would take a fifth of the compile time.
IN_PLACE = {**OPTIONS, "_nrt": False}
BLOCK = 64  # floes or pairs at a time: buffers stay in the first-level cache, and loops over them vectorise


class _PartCode(JITCodeLibrary):
    """Unoptimised code of a part of kernels; the kernels include it, optimise it and compile it to machine code.

    By default numba also does this for each part alone, which takes time and makes no step faster.  If a future numba
    does not call these methods, only that time is lost again.
    """

    def _optimize_functions(self, module: Any) -> None:
        module.data_layout = self._codegen._data_layout

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        """Give Python only the environment globals, which lead to the texts that the code prints, not the code."""
        code = self._final_module
        places = [str(v) for v in code.global_variables if v.linkage is binding.Linkage.common]
        empty = str(self._codegen._create_empty_module(self.name))
        self._final_module = binding.parse_assembly("\n".join([empty, *places]))
        super()._finalize_final_module()
        self._final_module = code


class _Part(Compiler):
    """numba's compiler, with a `_PartCode` as its target library."""

    def __init__(self, typing: Any, target: Any, library: None, *rest: Any) -> None:
        super().__init__(typing, target, _PartCode(target.codegen(), "part"), *rest)


PART = {**IN_PLACE, "pipeline_class": _Part}

_dispatched: list[Any] = []  # all functions whose code is selected by type


def has_code(law: type) -> bool:
    """Whether any code is registered for this type of law itself."""
    return any(law in one.registry for one in _dispatched)


def _compiled(function: Callable, options: dict) -> Any:
    kernel = numba.njit(nogil=True, **options)(function)
    if not numba.config.DISABLE_JIT:
        kernel._cache = Cache(function)
        kernel.compile = Making.timed(kernel.compile)
    return kernel


def jit(function: Callable) -> Callable:
    """Compile to machine code: cached on disk, NaN-safe fast-math, without the GIL."""
    return _compiled(function, OPTIONS)


def in_place(function: Callable) -> Callable:
    """`jit` for functions that only use the arrays passed to them: faster to compile and to call."""
    return _compiled(function, IN_PLACE)


def inlined(function: Callable) -> Callable:
    """`in_place`, with the source inlined into the calling kernel and not compiled separately."""
    return _compiled(function, {**IN_PLACE, "inline": "always"})


def inner(function: Callable) -> Callable:
    """Plain Python when called from Python, and a part of the kernels that call it.

    For functions that only kernels call.  They compile faster than with `jit`: without the wrapper for calls from Python,
    and once for all kernels that call them.
    """
    return register_jitable(**PART)(function)


def as_records(array: np.ndarray) -> np.ndarray:
    """An array of records whose fields kernels read as attributes.

    Compiled kernels can do so with any structured array, and accept a plain one faster than a recarray; kernels that are
    not compiled need the recarray.
    """
    return array.view(np.recarray) if numba.config.DISABLE_JIT else array


def _python_type(numba_type: numba.types.Type) -> type:
    if isinstance(numba_type, numba.types.BaseNamedTuple):
        return numba_type.instance_class
    if isinstance(numba_type, (numba.types.NoneType, numba.types.Omitted)):
        return type(None)
    return object


def dispatched(default: Callable) -> Any:
    """A function whose code is selected by the type of its first argument, in Python and in kernels."""
    generic: Any = functools.singledispatch(default)
    picked: set[type] = set()  # by compiled kernels
    register = generic.register

    @overload(generic, strict=False, jit_options=PART)
    def pick(*args):
        kind = _python_type(args[0])
        picked.add(kind)
        return generic.dispatch(kind)

    def register_once(function: FunctionType) -> FunctionType:
        kind = next(iter(get_type_hints(function).values()))
        if kind in generic.registry or kind in picked:
            raise InputError(
                f"{default.__name__}: kernels have code for {kind.__name__} already, and would go on with it; "
                f"define {kind.__name__} anew before (in a notebook: in the same cell)"
            )
        if not is_ours(function):
            laws_from_outside.setdefault(kind, []).append(digest_of(function))
        return register(function)

    pick.__signature__ = inspect.signature(default)
    generic.register = register_once
    _dispatched.append(generic)
    return generic
