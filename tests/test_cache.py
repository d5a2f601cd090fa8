"""Code is compiled no more often than it must be, is kept from run to run, and no run fails because it cannot be."""

import os
import warnings
from pathlib import Path

import numba
import numpy as np
import pytest

from floebmi import advance, files, fluid, kept_code, kernels, sampling, stable_step, survey
from floebmi.boundaries import Domain
from floebmi.contact import frictional
from floebmi.dynamics import Step
from floebmi.floes import Floes
from floebmi.forces import AirDrag, Coriolis, OceanDrag
from floebmi.model import Model


def half(x):
    return x / 2 if x > 0 else x


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty one for code; this process has not told yet that it cannot be written to."""
    monkeypatch.setattr(kept_code, "FOLDER", tmp_path / "kernels")
    monkeypatch.setattr(kept_code.Cache, "_told", False)
    monkeypatch.setattr(kernels.numba.config, "DISABLE_JIT", 0)
    return tmp_path / "kernels"


def loads(function):
    """How often code of it was read from the disk."""
    return sum(function.stats.cache_hits.values())


def test_code_is_read_where_an_earlier_run_left_it(folder):
    assert kernels.jit(half)(3.0) == 1.5
    later = kernels.jit(half)
    assert later(3.0) == 1.5 and loads(later) == 1
    assert {file.suffix for file in folder.rglob("*.nb?")} == {".nbi", ".nbc"}


@pytest.mark.parametrize("length", [0, 40])
@pytest.mark.parametrize("damaged", ["*.nbi", "*.nbc"])
def test_damaged_files_are_made_anew(folder, damaged, length):
    kernels.jit(half)(3.0)
    (file,) = folder.rglob(damaged)
    file.write_bytes(file.read_bytes()[:length])
    again = kernels.jit(half)
    assert again(3.0) == 1.5 and loads(again) == 0
    later = kernels.jit(half)
    assert later(3.0) == 1.5 and loads(later) == 1


def test_a_folder_that_cannot_be_written_to_is_told_of_once_and_no_other_is_taken(folder):
    beside = Path(__file__).parent / "__pycache__"
    folder.write_text("a file")
    with pytest.warns(UserWarning, match="kernels: compiled code cannot be kept here .Not a dir.*FLOEBMI_CACHE"):  # fmt: skip
        assert kernels.jit(half)(3.0) == 1.5
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert kernels.jit(half)(3.0) == 1.5
    assert not list(beside.glob("*half*"))


def test_a_folder_that_can_only_be_read_is_read(folder, monkeypatch):
    def refuse(place):
        raise OSError(30, os.strerror(30))

    kernels.jit(half)(3.0)
    monkeypatch.setattr(kept_code._Locator, "ensure_cache_path", refuse)
    monkeypatch.setattr(
        kept_code.numba.core.caching.tempfile, "TemporaryFile", lambda dir: refuse(dir)
    )
    later = kernels.jit(half)
    assert later(3.0) == 1.5 and loads(later) == 1


def test_two_processes_that_keep_code_at_once_do_not_take_each_others(folder):
    kernels.jit(half)(3.0)
    (index,) = folder.rglob("*.nbi")
    of_first = index.read_bytes()
    index.unlink()  # the second one looked before the first one wrote
    kernels.jit(half)(3)
    index.write_bytes(of_first)  # and the first one wrote last
    later = kernels.jit(half)
    assert later(0.5) == 0.25 and loads(later) == 1


def test_the_folder_is_one_place_whatever_the_current_folder_becomes(monkeypatch):
    monkeypatch.setenv("FLOEBMI_CACHE", "here")
    assert files.cache_folder() == Path.cwd() / "here"


def test_a_user_without_a_home_gets_no_folder_called_tilde(monkeypatch):
    monkeypatch.delenv("FLOEBMI_CACHE", raising=False)
    monkeypatch.setattr(
        files.platformdirs, "user_cache_dir", lambda name: f"~/.cache/{name}", raising=True
    )
    folder = files.cache_folder()
    assert "~" not in str(folder)
    with pytest.raises(OSError):
        folder.mkdir(parents=True)


SHARED = {
    advance: ("touch_all", "deepest"), fluid: ("give_back", "sizes_of_drag"), sampling: ("_gather_each",),
    stable_step: ("_stiffest",), survey: ("_touching_pairs",),
}  # fmt: skip


@pytest.fixture
def kinds(monkeypatch):
    """For each of these kernels, the kinds of arguments for which it is compiled."""
    found = {}

    def listens(name, kernel):
        def called(*arguments):
            found.setdefault(name, set()).add(numba.typeof(arguments))
            return kernel(*arguments)

        return called

    for module, names in SHARED.items():
        for name in names:
            monkeypatch.setattr(module, name, listens(name, getattr(module, name)))
    return found


def touching_floes(n, edges="inactive", step=Step()):
    domain = Domain((0.0, 1000.0), (0.0, 1000.0), *[edges] * 4)
    x, y = (
        place.ravel() for place in np.meshgrid(np.arange(10) * 39.99 + 20.0, np.arange(10) * 90.0)
    )
    forces = [OceanDrag(), AirDrag(), Coriolis(1e-4)]
    return Model(domain, Floes(x[:n], y[:n] + 20.0, 20.0, 1.0), frictional(), forces, step=step)


def test_what_is_called_once_an_exchange_is_compiled_once_for_few_floes_or_many_and_any_period(
    kinds,
):
    for model in (touching_floes(3), touching_floes(80, "periodic")):
        model.advance(0.01)
        assert model.ocean.magnitude.any() and len(model.contacts().i)
    of_touch = kinds.pop("touch_all")  # which asks for the period of each pair
    assert len(of_touch) == 2 and len(kinds) == sum(map(len, SHARED.values())) - 1
    assert all(len(of) == 1 for of in kinds.values())


def test_the_first_forces_of_an_exchange_are_compiled_once_whatever_the_scheme(kinds):
    for step in (Step(), Step("taylor3", epsilon=0.07)):
        assert len(touching_floes(3, step=step).contacts().i)
    assert len(kinds["touch_all"]) == 1
