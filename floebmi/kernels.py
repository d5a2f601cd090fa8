"""How this package uses numba; no other file sets it up.

`jit` compiles with a disk cache whose folder is named after a hash of the package's sources: numba's own
cache watches only the file of the cached function, and would go on running an edited law of another file.
A cache is there to save time, and no run fails for it: where code cannot be kept or read, it is compiled anew.

`dispatched` picks the code of a law by the *type* of its first argument, when the kernel is compiled.
A law is a NamedTuple of numbers; `None` is the law that is not there, and compiles to nothing.
"""

import functools
import hashlib
import inspect
import os
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

import numba
import numpy as np
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile
from numba.extending import overload, register_jitable

from floebmi.files import cache_folder

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


def _folder_of_code() -> Path:
    sources = (path.read_bytes() for path in sorted(Path(__file__).parent.glob("*.py")))
    jitted = [
        source for source in sources if b"kernels import" in source or b"from numba" in source
    ]
    told = b"".join([numba.__version__.encode(), *jitted])
    return cache_folder() / "kernels" / hashlib.sha256(told).hexdigest()[:16]


CACHE_FOLDER = _folder_of_code()


class _Place:
    """Where the code of a function is kept, as numba asks for it: in CACHE_FOLDER, be it writable or not.

    Left to itself, numba takes a folder beside the source instead of one that it cannot write to; nothing there tells
    that a law in another file has changed.
    """

    def __init__(self, function: Callable, file: str) -> None:
        self._py_file, self._line = file, function.__code__.co_firstlineno

    @classmethod
    def from_function(cls, function: Callable, file: str) -> Self | None:
        return cls(function, file) if os.path.exists(file) else None  # a notebook's has none

    def get_cache_path(self) -> str:
        folder = Path(self._py_file).resolve().parent
        digest = hashlib.sha256(os.fsencode(folder)).hexdigest()[:16]
        return str(CACHE_FOLDER / f"{folder.name}_{digest}")

    def get_source_stamp(self) -> str:
        return hashlib.sha256(Path(self._py_file).read_bytes()).hexdigest()

    def get_disambiguator(self) -> str:
        return str(self._line)

    def ensure_cache_path(self) -> None:
        os.makedirs(self.get_cache_path(), exist_ok=True)


class _Places(CompileResultCacheImpl):
    _locator_classes = [_Place, *CompileResultCacheImpl._locator_classes]


class _Files(IndexDataCacheFile):
    """Two processes that keep code for other arguments at the same time do not call their files the same."""

    def save(self, key: tuple, data: Any) -> None:
        digest = hashlib.sha256(repr(key).encode()).hexdigest()[:16]
        name = self._index_name.removesuffix(".nbi")
        self._data_name_pattern = f"{name}.{digest}.{{number:d}}.nbc"
        super().save(key, data)


class _Cache(FunctionCache):
    """numba's, but a full disk, a folder that is not writable, or a damaged file costs time and no more."""

    _impl_class = _Places
    _told = False  # that code cannot be kept: once is enough

    def __init__(self, function: Callable) -> None:
        super().__init__(function)
        locator = self._impl.locator
        self._cache_file = _Files(
            self._cache_path, self._impl.filename_base, locator.get_source_stamp()
        )

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # noqa: BLE001  what is read of a damaged file may raise anything
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        try:
            try:
                super().save_overload(sig, data)
            except OSError:
                raise
            except Exception:  # noqa: BLE001  the index is damaged
                self.flush()
                super().save_overload(sig, data)
        except OSError as error:
            if not _Cache._told:
                _Cache._told = True
                warnings.warn(
                    f"{CACHE_FOLDER}: compiled code cannot be kept here ({error.strerror}), each run compiles it anew; "
                    "the environment variable FLOEBMI_CACHE may name another folder",
                    stacklevel=2,
                )


def _compiled(function: Callable, options: dict) -> Callable:
    compiled = numba.njit(nogil=True, **options)(function)
    if not numba.config.DISABLE_JIT:
        compiled._cache = _Cache(function)
    return compiled


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
