"""How this package uses numba; no other file sets it up.

`jit` compiles with a disk cache whose folder is named after a hash of the package's sources: numba's own
cache watches only the file of the cached function, and would go on running an edited law of another file.

`dispatched` picks the code of a law by the *type* of its first argument, when the kernel is compiled.
A law is a NamedTuple of numbers; `None` is the law that is not there, and compiles to nothing.
"""

import functools
import hashlib
import inspect
import os
from collections.abc import Callable
from pathlib import Path

import numba
import numpy as np
import platformdirs
from numba.extending import overload, register_jitable

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


def _cache_folder() -> str:
    sources = (path.read_bytes() for path in sorted(Path(__file__).parent.glob("*.py")))
    jitted = b"".join(
        source for source in sources if b"kernels import" in source or b"from numba" in source
    )
    digest = hashlib.sha256(jitted).hexdigest()[:16]
    root = os.environ.get("FLOEBMI_CACHE") or platformdirs.user_cache_dir("floebmi")
    return str(Path(root) / "kernels" / digest)


CACHE_FOLDER = _cache_folder()


def _compiled(function: Callable, options: dict) -> Callable:
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = CACHE_FOLDER
    try:
        return numba.njit(cache=True, nogil=True, **options)(function)
    finally:
        numba.config.CACHE_DIR = before


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
    return register_jitable(**IN_PLACE)(function)


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


def dispatched(default: Callable) -> Callable:
    """A function whose code is picked by the type of its first argument, in Python and in kernels."""
    generic = functools.singledispatch(default)

    @overload(generic, strict=False, jit_options=IN_PLACE)
    def pick(*args):
        return generic.dispatch(_python_type(args[0]))

    pick.__signature__ = inspect.signature(default)
    return generic
