"""The comparison with other engines takes hours: what is wrong with a request is said before the first run."""

import json
import sys

import pytest

from benchmarks import engines


def ask(monkeypatch, *words):
    def runs(*arguments):
        raise AssertionError("an engine was run")

    monkeypatch.setattr(sys, "argv", ["engines", "--engines", "floebmi", *words])
    monkeypatch.setattr(engines, "take_turn", runs)
    engines.main()


@pytest.mark.parametrize(
    "option, value, why",
    [
        ("--sizes", "1000,0", "must be a number, at least 1"),
        ("--ratios", "nan", "must be a number, at least 1"),
        ("--repeats", "0", "must be a whole number, at least 1"),
        ("--steps", "-3", "must be a whole number, at least 1"),
        ("--packs", "tight", "tight; known: loose, jammed"),
        ("--engines", "lamps", "lamps; known: floebmi"),
        ("--json", "nowhere/rows.json", "there is no such folder"),
        ("--json", "notes.json", "holds no rows of this command"),
        ("--figure", "nowhere/bars.png", "there is no such folder"),
        ("--figure", "bars.doc", "must end with .png"),
    ],
)
def test_a_request_that_cannot_be_met_is_refused_at_once(
    option, value, why, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "notes.json").write_text('["a note"]')
    with pytest.raises(SystemExit) as stop:
        ask(monkeypatch, option, value)
    assert stop.value.code == 2
    assert why in capsys.readouterr().err.splitlines()[-1]
    assert (tmp_path / "notes.json").read_text() == '["a note"]'


def test_without_any_of_the_engines_there_is_nothing_to_compare(monkeypatch, capsys):
    with pytest.raises(SystemExit, match="nothing to compare"):
        ask(monkeypatch, "--engines", "lammps", "--lammps", "not-here")
    assert "not-here is not here" in capsys.readouterr().out


def test_memory_is_told_of_packs_that_outgrow_a_bare_process_and_not_of_others(monkeypatch):
    look = {"energy": 1.0, "spin": 0.0, "contacts": 2.0}
    turn = engines.Turn(2.0, 0.5, 3, look, look, memory=400_000_000)
    monkeypatch.setattr(engines, "take_turn", lambda *arguments: turn)
    for floes, memory in ((100_000, 3000.0), (1_000, None)):
        scene = engines.Scene("a pack", engines.DECKS, floes, 2.0, 1e-3, 10, 10)
        (row,) = engines.measure(scene, {"floebmi": ""}, 5, {"floebmi": 100_000_000})
        assert json.loads(json.dumps(row))["memory_per_floe"] == memory
        engines.show([row])
