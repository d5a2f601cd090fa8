"""Scenes that come with the package, and the data that they read (licences beside the data)."""

import tomllib
from pathlib import Path

from floebmi.errors import InputError, choose

FOLDER = Path(__file__).parent


def packaged() -> dict[str, Path]:
    """The packaged scenes: name → file."""
    return {path.stem: path for path in sorted(FOLDER.glob("*.toml"))}


def file_of(name: str) -> Path:
    """The file of a packaged scene; InputError for a name that none has."""
    if name not in packaged():
        raise InputError(f"{name}: no packaged scene; {choose(name, packaged())}")
    return packaged()[name]


def titles() -> dict[str, str]:
    """The packaged scenes: name → title."""
    return {
        name: tomllib.loads(path.read_text(encoding="utf-8"))["title"]
        for name, path in packaged().items()
    }
