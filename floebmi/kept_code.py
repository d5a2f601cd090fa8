"""The disk cache of compiled kernels, named after all sources that they depend on.

numba's own cache checks only the file of the cached function, and would keep running the old code of an edited law in
another file.  Here the folder is named after a hash of the package's sources; kernels with a law from outside the
package have separate subfolders, named after the code of that law.
The cache only saves time, and no run fails because of it: code that cannot be stored or read is compiled again.
"""

import functools
import hashlib
import marshal
import os
import warnings
from collections.abc import Callable
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any, Self

import numba
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile

from floebmi.files import cache_folder

PACKAGE = Path(__file__).parent

laws_from_outside: dict[type, list[str]] = {}  # with digests of the code registered for each


def _short(*parts: bytes) -> str:
    return hashlib.sha256(b"".join(parts)).hexdigest()[:16]


def _folder() -> Path:
    sources = (path.read_bytes() for path in sorted(PACKAGE.glob("*.py")))
    jitted = (
        source for source in sources if b"kernels import" in source or b"from numba" in source
    )
    return cache_folder() / "kernels" / _short(numba.__version__.encode(), *jitted)


FOLDER = _folder()


class _Locator:
    """The location of the cached code of a function, in numba's interface: in FOLDER, whether writable or not.

    By default numba would replace a folder that it cannot write to by one beside the source, where a change of a law in
    another file goes unnoticed.
    """

    def __init__(self, function: Callable, file: str) -> None:
        self._file, self._line = Path(file).resolve(), function.__code__.co_firstlineno
        self.apart = ""  # folder of kernels with laws from outside

    @classmethod
    def from_function(cls, function: Callable, file: str) -> Self | None:
        return cls(function, file) if os.path.exists(file) else None  # None in a notebook

    def get_cache_path(self) -> str:
        of_sources = self._file.parent
        name = f"{of_sources.name}_{_short(os.fsencode(of_sources))}"
        return str(FOLDER / self.apart / name)

    def get_source_stamp(self) -> str:
        return _stamp(self._file)

    def get_disambiguator(self) -> str:
        return str(self._line)

    def ensure_cache_path(self) -> None:
        os.makedirs(self.get_cache_path(), exist_ok=True)


@functools.cache
def _stamp(file: Path) -> str:
    return _short(file.read_bytes())


class _CacheImpl(CompileResultCacheImpl):
    _locator_classes = [_Locator, *CompileResultCacheImpl._locator_classes]


class _Files(IndexDataCacheFile):
    """Cache files whose names differ for processes that store code for different arguments at the same time."""

    def save(self, key: tuple, data: Any) -> None:
        name = self._index_name.removesuffix(".nbi")
        self._data_name_pattern = f"{name}.{_short(repr(key).encode())}.{{number:d}}.nbc"
        super().save(key, data)


class Cache(FunctionCache):
    """numba's cache, except that a full disk, a read-only folder, or a damaged file costs only time."""

    _impl_class = _CacheImpl
    _told = False  # whether the user was warned that code cannot be stored

    def __init__(self, function: Callable, apart: str = "") -> None:
        super().__init__(function)
        locator = self._impl.locator
        locator.apart = self._apart = apart
        self._cache_path = locator.get_cache_path()
        self._cache_file = _Files(
            self._cache_path, self._impl.filename_base, locator.get_source_stamp()
        )

    def _of(self, sig: Any) -> "Cache":
        """The cache to which a kernel with these arguments belongs.

        The index of a folder can only be read where the modules of all its laws can be imported.
        """
        apart = _apart(sig)
        return self if apart == self._apart else Cache(self._py_func, apart)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            return super(Cache, self._of(sig)).load_overload(sig, target_context)
        except Exception:  # noqa: BLE001  reading a damaged file may raise anything
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        cache = self._of(sig)
        keep = super(Cache, cache).save_overload
        try:
            try:
                keep(sig, data)
            except OSError:
                raise
            except Exception:  # noqa: BLE001  the index is damaged
                cache.flush()
                keep(sig, data)
        except OSError as error:
            if not Cache._told:
                Cache._told = True
                warnings.warn(
                    f"{FOLDER}: compiled code cannot be kept here ({error.strerror}), each run compiles it anew; "
                    "the environment variable FLOEBMI_CACHE may name another folder",
                    stacklevel=2,
                )


def _apart(sig: Any) -> str:
    """The subfolder of kernels with these arguments: a separate one if they include a law from outside."""
    words = str(sig) if laws_from_outside else ""
    laws = [kind for kind in laws_from_outside if f"{kind.__name__}(" in words]
    code = [[kind.__module__, kind.__qualname__, *laws_from_outside[kind]] for kind in laws]
    return _short(repr(code).encode()) if code else ""


def is_ours(code: FunctionType | type) -> bool:
    """Whether a function, or a type of law, belongs to this package, after whose sources FOLDER is named."""
    if isinstance(code, FunctionType):
        return PACKAGE in Path(code.__code__.co_filename).parents
    return code.__module__.startswith("floebmi.")


def digest_of(function: FunctionType) -> str:
    """Digest of the file of a function from outside the package and of all that it refers to, the inputs of its machine code."""
    digest, seen, left = hashlib.sha256(), set(), [function]
    while left:
        one: Any = left.pop()
        one = getattr(one, "py_func", one)  # the Python function of a compiled one
        if id(one) in seen:
            continue
        seen.add(id(one))
        if isinstance(one, FunctionType) and not is_ours(one):
            file = Path(one.__code__.co_filename)
            digest.update(file.read_bytes() if file.is_file() else marshal.dumps(one.__code__))
            left += [one.__globals__.get(name) for name in one.__code__.co_names]
            left += [cell.cell_contents for cell in one.__closure__ or ()]
        elif isinstance(one, ModuleType) and (file := getattr(one, "__file__", None)):
            digest.update(Path(file).read_bytes())
        elif isinstance(one, int | float | tuple | str):
            digest.update(repr(one).encode())
    return digest.hexdigest()
