"""Kernels that are not compiled (NUMBA_DISABLE_JIT=1, to step through a law in a debugger) find the same."""

import numba
import numpy as np
import pytest
from small_run import curvilinear, small_model
from test_laws import ALL, jostle
from uncompiled import in_plain_python

from floebmi import columns
from floebmi.pack import FLOE, FORCE, FORCE_AND_TORQUE

SCENES = {  # as other tests have them, so that their kernels are compiled once
    "drag, coast and friction on a bent grid": lambda: small_model(curvilinear()),
    "all that contacts can be": lambda: jostle(ALL),
}


def found(name):
    """What a scene leaves behind, as numbers."""
    model = SCENES[name]()
    for _ in range(2):
        model.advance(12 * model.longest_step())
    state = {name: getattr(model.floes, name) for name in ("x", "y", "u", "v")}
    state |= {"ledger": model.ledger.now, "contacts": model.contacts().fx}
    return {what: np.ravel(values).tolist() for what, values in (state | model.fields()).items()}


@pytest.fixture(scope="module")
def plain():
    """The same in a process that compiles nothing."""
    return in_plain_python("test_plain", "{name: t.found(name) for name in t.SCENES}")


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_goes_the_same_way_without_being_compiled(plain, name):
    compiled = found(name)
    assert compiled.keys() == plain[name].keys()
    for what, values in compiled.items():
        error = (
            1e-9 * np.abs(values).max(initial=0.0) + 1e-12
        )  # a full cell has a porosity of 1e-14
        np.testing.assert_allclose(plain[name][what], values, rtol=0, atol=error)


def packed(kind, rng):
    values = rng.normal(size=(6, len(kind.names)))
    return np.array([tuple(row) for row in values], kind).view(np.recarray)


@numba.njit
def gather(*arguments):
    columns.gather(*arguments)


@numba.njit
def scatter(*arguments):
    columns.scatter(*arguments)


PAIRS = np.array([0, 5, 3, 1, 2, 2, 4], np.uint32), np.array([1, 2, 4, 0, 2, 5, 0], np.uint32)


def test_four_pairs_become_columns_as_it_says():
    rng = np.random.default_rng(3)
    floes, begun = packed(FLOE, rng), rng.normal(size=columns.PAIR_BUFFER)
    said, done = begun.copy(), begun.copy()
    columns.gather(floes, *PAIRS, 2, said, 1)
    gather(floes, *PAIRS, 2, done, 1)
    assert np.array_equal(said, done) and not np.array_equal(said, begun)
    assert said[columns.DX + 1] == floes.x[PAIRS[1][3]] - floes.x[PAIRS[0][3]]


@pytest.mark.parametrize("kind", [FORCE_AND_TORQUE, FORCE])
def test_columns_of_forces_reach_their_floes_as_it_says(kind):
    rng = np.random.default_rng(4)
    begun, buffer = packed(kind, rng), rng.normal(size=columns.PAIR_BUFFER)
    said, done = begun.copy(), begun.copy()
    columns.scatter(said, *PAIRS, 3, buffer, 0)
    scatter(done, *PAIRS, 3, buffer, 0)
    for name in set(kind.names) - {"unused"}:
        np.testing.assert_allclose(said[name], done[name], rtol=1e-14)
        assert not np.allclose(said[name], begun[name])
