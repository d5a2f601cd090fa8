"""Compiled code is kept from run to run, and no run fails because it cannot be."""

import os
import warnings
from pathlib import Path

import pytest

from floebmi import files, kept_code, kernels


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
