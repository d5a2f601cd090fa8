"""A state as named entries that a file can hold: each an array, and a word for what it was, to the last bit."""

import hashlib
import json
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from floebmi.errors import InputError

Entry = tuple[str, np.ndarray]  # the word, and the array


def entries_of(state: Mapping[str, Any]) -> dict[str, Entry]:
    """The entries of a state by their paths: "a/b" is what the mapping at key "a" has at "b".

    Raises
    ------
    InputError
        for a key that cannot be part of a path, or a value that is not one of those `restarts.save_restart` takes.
    """
    return {path: _packed(path, value) for path, value in _flatten(state, ())}


def state_of(entries: Mapping[str, Entry]) -> dict[str, Any]:
    """The state whose entries these are."""
    state: dict[str, Any] = {}
    for path, (kind, array) in entries.items():
        *folders, last = path.split("/")
        into = state
        for folder in folders:
            into = into.setdefault(folder, {})
        if kind != "mapping":
            into[last] = _unpacked(kind, array)
        else:
            into.setdefault(last, {})
    return state


def checksum(entries: Mapping[str, Entry], attributes: Mapping[str, Any]) -> str:
    """SHA-256 of entries and attributes, whatever their order."""
    digest = hashlib.sha256()
    for name in sorted(attributes):
        digest.update(f"{name} {attributes[name]}\n".encode())
    for name in sorted(entries):
        kind, array = entries[name]
        digest.update(f"{name} {kind} {array.dtype.str} {array.shape}\n".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def _flatten(state: Mapping[str, Any], above: tuple[str, ...]) -> Iterator[tuple[str, Any]]:
    for name, value in state.items():
        if not isinstance(name, str) or not name or "/" in name:
            raise InputError(f"restart: key {name!r}: must be a text without '/'")
        path = (*above, name)
        if isinstance(value, Mapping) and value:
            yield from _flatten(value, path)
        else:
            yield "/".join(path), value


def _packed(path: str, value: Any) -> Entry:
    """A word for what the value is, and an array that holds it to the last bit."""
    if isinstance(value, Mapping):
        return "mapping", np.zeros(0, np.uint8)
    if value is None:
        return "none", np.zeros(0, np.uint8)
    if isinstance(value, bytes):
        return "bytes", np.frombuffer(value, np.uint8)
    if isinstance(value, str):
        return "text", _as_bytes(value)
    if isinstance(value, bool):
        return "bool", np.array(value, np.uint8)
    if isinstance(value, int):  # may be longer than 64 bits, as in the state of a random generator
        return "int", _as_bytes(str(value))
    if isinstance(value, float):
        return "float", np.array(value)
    try:
        array = np.asarray(value)
    except ValueError as error:  # rows of unlike lengths
        raise InputError(f"restart: {path}: cannot be saved ({error})") from None
    if array.dtype.kind == "U":
        told = {"shape": array.shape, "dtype": array.dtype.str, "texts": array.ravel().tolist()}
        return "texts", _as_bytes(json.dumps(told))
    if array.dtype == np.bool_:
        return "bools", array.astype(np.uint8)
    if array.dtype.kind in "iuf" and array.dtype.itemsize <= 8 and array.dtype.isnative:
        return "array", array
    raise InputError(f"restart: {path} is {type(value).__name__} {array.dtype}: cannot be saved")


def _unpacked(kind: str, array: np.ndarray) -> Any:
    if kind == "none":
        return None
    if kind == "bytes":
        return array.tobytes()
    if kind == "text":
        return array.tobytes().decode()
    if kind == "bool":
        return bool(array)
    if kind == "int":
        return int(array.tobytes().decode())
    if kind == "float":
        return float(array)
    if kind == "texts":
        told = json.loads(array.tobytes())
        return np.array(told["texts"], told["dtype"]).reshape(told["shape"])
    return array.astype(np.bool_) if kind == "bools" else array


def _as_bytes(text: str) -> np.ndarray:
    return np.frombuffer(text.encode(), np.uint8)
