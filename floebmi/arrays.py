"""Questions about whole arrays, answered in one pass: an exchange asks them of all that it takes over."""

import hashlib

import numpy as np

from floebmi.kernels import in_place


def all_finite(values: np.ndarray, below: float = np.inf) -> bool:
    """Whether every number is finite, and of a size below a bound."""
    return _all_below(np.ascontiguousarray(values, np.float64).reshape(-1), below)


@in_place
def _all_below(values, bound):
    small = True
    for k in range(values.size):
        small &= abs(values[k]) < bound
    return small


def all_within(values: np.ndarray, low: float, high: float) -> bool:
    """Whether every number is at least `low` and less than `high`."""
    return _all_within(values, low, high)


@in_place
def _all_within(values, low, high):
    within = True
    for k in range(values.size):
        within &= (values[k] >= low) & (values[k] < high)
    return within


def same_bits(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two arrays of one kind and length, each in one piece, are the same bit by bit."""
    return _same_bits(one.view(np.uint8), other.view(np.uint8))


@in_place
def _same_bits(one, other):
    same = True
    for k in range(one.size):
        same &= one[k] == other[k]
    return same


def digest(*arrays: np.ndarray) -> str:
    """SHA-256 over the bytes of arrays: the same numbers of the same kinds, the same text."""
    found = hashlib.sha256()
    for array in arrays:
        found.update(np.ascontiguousarray(array).tobytes())
    return found.hexdigest()
