"""How this package uses numba; no other file sets it up.

`jit` compiles with a disk cache, which is that of `kept_code`: numba's own would go on running an edited law.

`dispatched` picks the code of a law by the *type* of its first argument, when the kernel is compiled.
A law is a NamedTuple of numbers; `None` is the law that is not there, and compiles to nothing.
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
# Inlined into what Python calls.  Else each kernel would bring its own compiled copy of a function that several call,
# each optimised in its own way, and which copy a process runs, and so the last bits, would depend on what it has
# compiled before.
OPTIONS = {
    "fastmath": FASTMATH,
    "error_model": "numpy",
    "forceinline": True,
    "no_cfunc_wrapper": True,
}
# Counting references to arrays that somebody else owns would take a fifth of the time of compiling.
IN_PLACE = {**OPTIONS, "_nrt": False}
BLOCK = 64  # floes or pairs at a time: buffers stay in the nearest cache, and what is done to them vectorises


class _PartCode(JITCodeLibrary):
    """The code of a part of kernels, as it comes: kernels take it in, optimise it and make it into machine code.

    numba does that to each part by itself as well, which takes time and makes no step faster.  Should it come not to call
    these methods, it will do so again, and nothing else will change.
    """

    def _optimize_functions(self, module: Any) -> None:
        module.data_layout = self._codegen._data_layout

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        """Python gets nothing of it but the place where the texts that it prints are to be found."""
        code = self._final_module
        places = [str(v) for v in code.global_variables if v.linkage is binding.Linkage.common]
        empty = str(self._codegen._create_empty_module(self.name))
        self._final_module = binding.parse_assembly("\n".join([empty, *places]))
        super()._finalize_final_module()
        self._final_module = code


class _Part(Compiler):
    """numba's own way to make code, into a `_PartCode`."""

    def __init__(self, typing: Any, target: Any, library: None, *rest: Any) -> None:
        super().__init__(typing, target, _PartCode(target.codegen(), "part"), *rest)


PART = {**IN_PLACE, "pipeline_class": _Part}

_dispatched: list[Any] = []  # all functions whose code is picked by type


def has_code(law: type) -> bool:
    """Whether any code is registered for a kind of law itself."""
    return any(law in one.registry for one in _dispatched)


def _compiled(function: Callable, options: dict) -> Any:
    kernel = numba.njit(nogil=True, **options)(function)
    if not numba.config.DISABLE_JIT:
        kernel._cache = Cache(function)
        kernel.compile = Making.timed(kernel.compile)
    return kernel


def jit(function: Callable) -> Callable:
    """Compile for the machine; cached on disk, NaN-safe fast mathematics, no GIL."""
    return _compiled(function, OPTIONS)


def in_place(function: Callable) -> Callable:
    """`jit` for what works on the arrays it is given and makes none: faster to compile and to call."""
    return _compiled(function, IN_PLACE)


def inlined(function: Callable) -> Callable:
    """`in_place` whose source becomes part of the kernel that calls it: not compiled by itself as well."""
    return _compiled(function, {**IN_PLACE, "inline": "always"})


def inner(function: Callable) -> Callable:
    """Plain Python for Python, and a part of the kernels that call it.

    For what only kernels call.  It compiles sooner than with `jit`: without the wrapper by which Python calls a kernel,
    and once for all kernels that call it.
    """
    return register_jitable(**PART)(function)


def as_records(array: np.ndarray) -> np.ndarray:
    """An array of records whose fields kernels read as attributes.

    Compiled kernels read them of any structured array, and take a plain one sooner than a recarray; kernels that are not
    compiled need the recarray.
    """
    return array.view(np.recarray) if numba.config.DISABLE_JIT else array


def _python_type(numba_type: numba.types.Type) -> type:
    if isinstance(numba_type, numba.types.BaseNamedTuple):
        return numba_type.instance_class
    if isinstance(numba_type, (numba.types.NoneType, numba.types.Omitted)):
        return type(None)
    return object


def dispatched(default: Callable) -> Any:
    """A function whose code is picked by the type of its first argument, in Python and in kernels."""
    generic: Any = functools.singledispatch(default)
    picked: set[type] = set()  # by kernels that are compiled
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
