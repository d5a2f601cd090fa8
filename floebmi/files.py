"""Files and folders: where one can be made, by whom, what it says of itself, and that it is whole or not there."""

import contextlib
import datetime
import errno
import hashlib
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import platformdirs

from floebmi import __version__
from floebmi.errors import InputError, choose, in_line

if TYPE_CHECKING:
    from netCDF4 import Dataset

try:
    import fcntl
except ImportError:  # where a file that is open cannot be replaced anyway
    fcntl = None

LONGEST = 255  # bytes that file systems allow a name


def attributes_of(title: str) -> dict[str, str]:
    """Global attributes that each NetCDF file of results has: what it is, and what made it, when."""
    now = datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    source = f"floebmi {__version__}"
    return {
        "Conventions": "CF-1.11",
        "title": title,
        "source": source,
        "history": f"{now}: written by {source}",
    }


def check_attribute(name: object, value: object) -> None:
    """InputError for an attribute that a NetCDF file cannot have."""
    kinds = str | int | float | np.integer | np.floating
    fits = isinstance(value, kinds) and not isinstance(value, bool)
    if isinstance(value, int):
        fits &= -(2**63) <= value < 2**63
    if not (isinstance(name, str) and fits):
        raise InputError(f"attribute {name!r} = {in_line(value)}: must be a text or a number")


def contents(path: Path) -> str:
    """Size and digest of a file, or of all files of a folder such as a Zarr store: whatever their dates, of others they differ."""
    if not path.exists():
        return "missing"
    files = [path] if path.is_file() else sorted(file for file in path.rglob("*") if file.is_file())
    size, digest = 0, hashlib.sha256()
    for one in files:
        with open(one, "rb") as file:
            own = hashlib.file_digest(file, "sha256").hexdigest()
        digest.update(f"{one.relative_to(path).as_posix()} {own}\n".encode())
        size += one.stat().st_size
    return f"{size} bytes, {digest.hexdigest()[:16]}"


def cache_folder() -> Path:
    """Where what saves time is kept from one run to the next: the user's cache folder, unless FLOEBMI_CACHE names one."""
    folder = os.environ.get("FLOEBMI_CACHE") or platformdirs.user_cache_dir("floebmi")
    if folder.startswith("~"):  # a user without a home; a folder here of that name would be a trap
        folder = os.path.join(os.devnull, "floebmi")
    return Path(os.path.abspath(folder))


def path_of(what: str, value: object) -> Path:
    """The path that an argument is; InputError for what is none."""
    if not isinstance(value, str | os.PathLike) or "\0" in str(value):
        raise InputError(f"{what} = {in_line(value)}: must be the path of a file or folder")
    return Path(value)


def check_kind(path: Path, kinds: Sequence[str]) -> None:
    """InputError for a file of another kind than those, or in a place where none can be made."""
    if path.suffix not in kinds:
        raise InputError(f"{path}: {choose(path.suffix, kinds)}")
    check_target(path, overwrite=True)


def check_target(path: Path, overwrite: bool) -> None:
    """InputError for a place where no file can be made, or where one stands that may not be replaced."""
    if not _is_folder(path.parent):
        raise InputError(f"{path}: there is no folder {path.parent}")
    if _is_folder(path):
        raise InputError(f"{path}: is a folder; give the name of a file")
    _refuse_dangling(path)
    if path.exists() and not overwrite:
        raise InputError(f"{path}: exists already; choose another name or overwrite=True")
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise InputError(f"{path}: its folder is read-only; choose another place")
    if path.exists():
        if not os.access(path, os.W_OK):
            raise InputError(f"{path}: is read-only; choose another name, or make it writable")
        _refuse_if_being_written(path)


def check_new_folder(path: Path) -> None:
    """InputError for a place where no folder is or can be made, or where files cannot be made in it."""
    if _is_folder(path):
        if not os.access(path, os.W_OK | os.X_OK):
            raise InputError(f"{path}: is read-only; choose another place, or make it writable")
        return
    _refuse_dangling(path)
    if path.exists():
        raise InputError(f"{path}: is a file; give the name of a folder")
    if path.parent != path:
        check_new_folder(path.parent)


def _is_folder(path: Path) -> bool:
    """Whether a folder is there; InputError for what can be the name of nothing."""
    try:
        os.stat(path)
    except (FileNotFoundError, NotADirectoryError):
        return False
    except (OSError, ValueError) as error:  # a name too long, links in a circle, a NUL in it
        raise InputError(f"{path!s}: {getattr(error, 'strerror', None) or error}") from None
    return path.is_dir()


def _refuse_dangling(path: Path) -> None:
    if path.is_symlink() and not path.exists():
        raise InputError(
            f"{path}: is a link to {os.readlink(path)}, which is not there; remove the link, or choose another name"
        )


def _refuse_if_being_written(path: Path) -> None:
    """HDF5 locks a file that another run writes: it must not be replaced, not even by force."""
    if fcntl is None:
        return
    with open(path, "rb") as file:
        if _is_taken(file.fileno(), fcntl.LOCK_SH):
            raise InputError(f"{path}: another run is writing it; choose another name")


@contextlib.contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """No other run in this folder meanwhile; InputError if one is going on. A run that ends, be it killed, leaves no trace."""
    if fcntl is None:
        yield
        return
    here = os.open(folder, os.O_RDONLY)
    try:
        if _is_taken(here, fcntl.LOCK_EX):
            raise InputError(
                f"{folder}: another run is going on in it; give another folder with --to"
            )
        yield
    finally:
        os.close(here)


def _is_taken(number: int, how: int) -> bool:
    """Whether another process has locked what is open here; if none has, this one locks it until it is closed."""
    try:
        fcntl.flock(number, how | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:  # a file system without locks
        pass
    return False


@contextlib.contextmanager
def disk_full_told(path: Path) -> Iterator[None]:
    """NetCDF says `HDF error` for a full disk: OSError with the file's name instead."""
    try:
        yield
    except RuntimeError as error:
        text = f"could not be written ({error}): is the disk full?"
        raise OSError(errno.EIO, text, str(path)) from error


@contextlib.contextmanager
def in_one_go(path: Path, overwrite: bool = True) -> Iterator[Path]:
    """A name to write a file under, which takes its own name when it is whole.

    Another process may be making the same file: it has a name of its own, and the second to be whole does not
    replace the first unasked.  An OSError that names no file, or that name, gets the name of this one.
    """
    part = path.with_name(_name_meanwhile(path.name))
    try:
        yield part
        if overwrite:
            os.replace(part, path)
        else:
            _rename(part, path)
    except OSError as error:
        if error.errno is not None and error.filename in (None, part, str(part)):
            error.filename = str(path)
        raise
    finally:
        if part.exists():  # on a read-only disk to take away what is not there is an error, too
            part.unlink()


def _name_meanwhile(name: str) -> str:
    """Of a file that is being made, for this process alone; no longer than file systems allow, as long as the name may be."""
    end = f".{os.getpid()}.part"
    if len(os.fsencode(name + end)) > LONGEST:
        name = hashlib.sha256(os.fsencode(name)).hexdigest()[:16]
    return name + end


@contextlib.contextmanager
def new_file(part: Path) -> Iterator["Dataset"]:
    """A new NetCDF file to write.

    NetCDF says `Permission denied` whatever it is that it cannot make a file for, a full disk for one; the system
    says what is true.
    """
    from netCDF4 import Dataset

    try:
        data = Dataset(part, "w")
    except OSError:
        with open(part, "wb", buffering=0) as file:
            file.write(bytes(4096))
        raise
    with data:
        yield data


def _rename(part: Path, path: Path) -> None:
    """As os.replace, but a file that is there stays."""
    try:
        os.link(part, path)
    except FileExistsError:
        text = f"{path}: another run has made it meanwhile; choose another name"
        raise InputError(text) from None
    except OSError:  # a file system without links
        os.replace(part, path)
