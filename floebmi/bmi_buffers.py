"""Checks of the arrays that a host passes in a BMI call, with errors of one line."""

import numpy as np

from floebmi.errors import InputError, in_line
from floebmi.quantities import flat, unmasked


def copied(
    values: np.ndarray, dest: np.ndarray, what: str, shape: tuple[int, ...] | None = None
) -> np.ndarray:
    """Copy values into the caller's buffer, of any real type that holds them, and return it.

    shape : rows and columns of the values, which a buffer that is not flat must have
    """
    if not isinstance(dest, np.ndarray):
        raise InputError(f"{what}: the buffer is a {type(dest).__name__}; must be a numpy array")
    if dest.size != values.size:
        raise InputError(f"{what}: the buffer has {dest.size} places; must have {values.size}")
    wrong = dest.dtype.kind not in "if" or dest.dtype.itemsize < 4  # integers would overflow
    if wrong or not np.can_cast(values.dtype, dest.dtype, "same_kind"):
        raise InputError(f"{what}: the buffer is of type {dest.dtype}; must hold {values.dtype}")
    if not dest.flags.writeable:
        raise InputError(f"{what}: the buffer is read-only; must be writable")
    if shape is not None:
        flat(f"{what}: the buffer", dest, shape)
    np.copyto(dest, values.reshape(dest.shape), casting="same_kind")
    return dest


def numbers_of(name: str, src: np.ndarray, size: int) -> np.ndarray:
    """The host's numbers as float64."""
    given = _array(name, src)
    if given.dtype.kind not in "fiub":
        raise InputError(f"{name}: values of type {given.dtype}; must be real numbers")
    if given.size != size:
        raise InputError(f"{name}: {given.size} values; must be {size}")
    return unmasked(src)


def indices_of(name: str, inds: np.ndarray, size: int) -> np.ndarray:
    """The host's indices, flat, each from 0 to size − 1."""
    if np.ma.is_masked(inds):
        raise InputError(f"{name}: masked indices; must be integers from 0 to {size - 1}")
    inds = _array(name, inds)
    if inds.size and inds.dtype.kind not in "iu":
        raise InputError(f"{name}: indices of type {inds.dtype}; must be integers")
    inds = inds.ravel()
    wrong = (inds < 0) | (inds >= size)
    if wrong.any():
        raise InputError(f"{name}: index {inds[wrong][0]}: must be from 0 to {size - 1}")
    return inds.astype(np.int64)


def _array(name: str, values: np.ndarray) -> np.ndarray:
    try:
        return np.asarray(values)
    except ValueError:  # rows of unlike lengths
        raise InputError(
            f"{name}: {in_line(values)}: must be numbers, in rows of one length"
        ) from None
