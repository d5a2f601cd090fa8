"""Every extreme keeps its pass mark: the same cases as `floebmi validate`."""

import errno
import json
import math
import os
import pathlib

import numpy as np
import pytest
from click.testing import CliRunner

from floebmi import __version__
from floebmi.advance import Advance
from floebmi.cli import floebmi
from floebmi.errors import StabilityError
from floebmi.measures import Case, Measure, save
from floebmi.validate import CASES


def missed(measures):
    return [f"{m.what}: {m.value:.4g}, must be {m.mark}" for m in measures if not m.passed]


SLOW = {
    "softened-modulus",
    "fast-spin",
    "threads",
}  # they need machine code that no other test does


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.long) if n in SLOW else n for n in CASES]
)
def test_the_case_keeps_its_mark(name):
    measures = CASES[name].run()
    assert any(m.relation for m in measures)
    assert not missed(measures)


@pytest.mark.long
@pytest.mark.parametrize("name", CASES)
def test_the_long_case_keeps_its_mark(name):
    assert not missed(CASES[name].run(long=True))


def test_there_is_a_case_for_each_row_of_the_extremes():
    assert [case.number for case in CASES.values()] == list(range(1, 23))
    assert all(case.title and case.source for case in CASES.values())


def test_a_full_disk_leaves_the_earlier_measures(tmp_path, monkeypatch):
    path = tmp_path / "a.json"
    save({}, path)

    def torn(self, text, **how):
        self.write_bytes(text[: len(text) // 2].encode())
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(pathlib.Path, "write_text", torn)
    with pytest.raises(OSError, match="No space left on device: .*a.json"):
        save({CASES["restart"]: [Measure("floes", 1.0)]}, path)
    assert json.loads(path.read_bytes())["cases"] == {}
    assert os.listdir(tmp_path) == ["a.json"]


def test_lists_that_are_never_renewed_miss_the_mark_of_stale_neighbours(monkeypatch):
    monkeypatch.setattr(Advance, "_half_skin", lambda self: np.inf)
    assert missed(CASES["stale-neighbours"].run())


def test_floes_that_pass_through_each_other_miss_the_mark_of_fast_collisions(monkeypatch):
    for check in ("_check", "_check_pace"):  # of ways and overlaps
        monkeypatch.setattr(Advance, check, lambda *of: None)
    monkeypatch.setattr("floebmi.model.RESIDUAL_ALLOWED", np.inf)
    assert missed(CASES["fast-collisions"].run())


def test_places_that_are_rounded_at_each_exchange_miss_the_mark_far_from_the_origin(monkeypatch):
    forget = Advance.finish

    def finish(self):
        forget(self)
        if self.state.remainder is not None:
            self.state.remainder[:] = 0.0

    monkeypatch.setattr(Advance, "finish", finish)
    assert missed(CASES["far-from-the-origin"].run())


@pytest.mark.parametrize(
    ("measure", "passed"),
    [
        (Measure("", 1.0, "≤", 1.0), True),
        (Measure("", 1.1, "≤", 1.0), False),
        (Measure("", 0.9, "≥", 1.0), False),
        (Measure("", 2.0, "=", 1.0), False),
        (Measure("", math.nan, "≤", 1.0), False),
        (Measure("", math.nan, "≥", 1.0), False),
        (Measure("", math.nan, "=", 1.0), False),
        (Measure("", 3.0), True),
    ],
)
def test_a_measure_passes_by_its_number_alone_and_never_if_it_is_none(measure, passed):
    assert measure.passed == passed


def cli(*args):
    return CliRunner().invoke(floebmi, ["validate", *map(str, args)], prog_name="floebmi")


def test_the_command_prints_a_table_and_saves_it(tmp_path):
    result = cli("lagged-ocean", 16, "--save", tmp_path / "a.json")
    assert result.exit_code == 0, result.output
    lines = result.stdout.splitlines()
    assert lines[0].split() == ["case", "what", "measured", "pass", "mark", "source"]
    assert lines[1].startswith("15 lagged-ocean") and "eq. lagged-stress" in lines[1]
    assert sum(" pass" in line for line in lines[1:]) >= 8
    saved = json.loads((tmp_path / "a.json").read_text())
    assert list(saved["cases"]) == ["lagged-ocean", "area-budget"]
    assert saved["cases"]["area-budget"]["passed"] is True
    assert saved["source"] == f"floebmi {__version__}" and saved["source"] in saved["history"]
    again = cli("area-budget", "--save", tmp_path / "a.json")
    assert again.exit_code == 2 and "exists already" in again.stderr


@pytest.mark.parametrize(("name", "near"), [("bond-brake", "bond-break"), ("99", "area-budget")])
def test_an_unknown_case_is_refused_with_near_names(name, near):
    result = cli(name)
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 1 and near in result.stderr


def test_a_case_that_fails_or_stops_ends_the_command_with_1(monkeypatch):
    def too_much(long):
        yield Measure("something", 2.0, "≤", 1.0)

    def stops(long):
        yield Measure("something", 1.0, "≤", 1.0)
        raise StabilityError("floe 3: left")

    for name, measure in (("one", too_much), ("two", stops)):
        monkeypatch.setitem(CASES, name, Case(98, name, "A case", "here", measure))
        result = cli(name)
        assert result.exit_code == 1
        assert "FAIL" in result.stdout
        assert result.stderr.splitlines()[-1].endswith(f"1 of 1 cases miss their mark: {name}")
    assert "stopped: floe 3: left" in result.stdout
