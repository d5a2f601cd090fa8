"""How this package uses numba; no other file sets it up.

`jit` compiles with a disk cache whose folder is named after a hash of the package's sources: numba's own
cache watches only the file of the cached function, and would go on running an edited law of another file.
Kernels with a law from outside the package lie in folders of their own, by the sources of that law.

`dispatched` picks the code of a law by the *type* of its first argument, when the kernel is compiled.
A law is a NamedTuple of numbers; `None` is the law that is not there, and compiles to nothing.
"""

import functools
import hashlib
import inspect
import marshal
import os
from collections.abc import Callable
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any, get_type_hints

import numba
import numpy as np
import platformdirs
from numba.core.caching import FunctionCache
from numba.extending import overload, register_jitable

from floebmi.errors import InputError

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
PACKAGE = str(Path(__file__).parent) + os.sep

_dispatched: list[Any] = []  # all functions whose code is picked by type
_added: dict[type, list[str]] = {}  # laws from outside the package, and digests of their code


class _Cache(FunctionCache):
    """Kernels on disk; those with a law from outside the package lie apart, by its code.

    What lists the kernels of a folder can be read only where the modules of all their laws are found.
    """

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        return _beside(self, sig, super().load_overload)(sig, target_context)

    def save_overload(self, sig: Any, data: Any) -> None:
        _beside(self, sig, super().save_overload)(sig, data)


def _beside(cache: _Cache, sig: Any, method: Callable) -> Callable:
    """The method of a kernel's cache, or that of the cache in which it lies with laws from outside."""
    words = str(sig)
    laws = [kind for kind in _added if f"{kind.__name__}(" in words]
    if not laws:
        return method
    code = [[kind.__module__, kind.__qualname__, *_added[kind]] for kind in laws]
    folder = Path(CACHE_FOLDER) / hashlib.sha256(repr(code).encode()).hexdigest()[:16]
    return getattr(_cache_in(str(folder), FunctionCache, cache._py_func), method.__name__)


def _cache_in(folder: str, kind: type[FunctionCache], function: Callable) -> FunctionCache:
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = folder
    try:
        return kind(function)
    finally:
        numba.config.CACHE_DIR = before


def _digest(function: FunctionType) -> str:
    """Of the file of a function from outside the package, and of all that it names: what its machine code is made of."""
    digest, seen, left = hashlib.sha256(), set(), [function]
    while left:
        one: Any = left.pop()
        one = getattr(one, "py_func", one)  # what numba has compiled
        if id(one) in seen:
            continue
        seen.add(id(one))
        if isinstance(one, FunctionType) and not one.__code__.co_filename.startswith(PACKAGE):
            file = Path(one.__code__.co_filename)
            digest.update(file.read_bytes() if file.is_file() else marshal.dumps(one.__code__))
            left += [one.__globals__.get(name) for name in one.__code__.co_names]
            left += [cell.cell_contents for cell in one.__closure__ or ()]
        elif isinstance(one, ModuleType) and (file := getattr(one, "__file__", None)):
            digest.update(Path(file).read_bytes())
        elif isinstance(one, int | float | tuple | str):
            digest.update(repr(one).encode())
    return digest.hexdigest()


def has_code(law: type) -> bool:
    """Whether any code is registered for a kind of law itself."""
    return any(law in one.registry for one in _dispatched)


def _compiled(function: Callable, options: dict) -> Any:
    kernel = numba.njit(nogil=True, **options)(function)
    if not numba.config.DISABLE_JIT:
        kernel._cache = _cache_in(CACHE_FOLDER, _Cache, function)
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


def dispatched(default: Callable) -> Any:
    """A function whose code is picked by the type of its first argument, in Python and in kernels."""
    generic: Any = functools.singledispatch(default)
    picked: set[type] = set()  # by kernels that are compiled
    register = generic.register

    @overload(generic, strict=False, jit_options=IN_PLACE)
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
        if not function.__code__.co_filename.startswith(PACKAGE):
            _added.setdefault(kind, []).append(_digest(function))
        return register(function)

    pick.__signature__ = inspect.signature(default)
    generic.register = register_once
    _dispatched.append(generic)
    return generic
