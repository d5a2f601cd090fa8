"""The cost of a step in instructions, which unlike its time are the same whenever they are counted; and its form."""

import json
import re
import shutil
from pathlib import Path

import numba
import pytest
from numpy.testing import assert_allclose

from benchmarks.bare import ready
from benchmarks.limit import LAWS, instructions
from floebmi.advance import Advance

ROOT = Path(__file__).parents[1]
STORED = json.loads((ROOT / "tests" / "data" / "instructions.json").read_text())


@pytest.mark.parametrize("path", sorted((ROOT / "benchmarks").rglob("*.py")), ids=lambda p: p.name)
def test_what_a_benchmark_takes_from_inside_an_advance_is_there(path):
    for name in re.findall(r"\b(?:now|Advance)\.(_\w+)", path.read_text(encoding="utf-8")):
        assert hasattr(Advance, name), name


@pytest.mark.long
@pytest.mark.parametrize("law", LAWS)
def test_a_floe_step_takes_no_more_instructions_than_when_it_was_last_counted(law):
    if shutil.which("valgrind") is None:
        pytest.skip(
            "instructions are counted by valgrind, which is not here: apt-get install valgrind"
        )
    if numba.__version__ != STORED["numba"]:
        pytest.skip(
            f"counts are those of numba {STORED['numba']}, this is {numba.__version__}: count "
            "again with `python -m benchmarks.limit --instructions`"
        )
    assert instructions(law) <= 1.02 * STORED[law]


@pytest.mark.long
def test_cohesive_steps_are_those_written_out_by_hand():
    pack = ready(400, speed=2.0)  # bonds form and break
    lost = pack.package(200)
    floes = pack.floes.copy()
    pack.again()
    assert lost > 0
    assert_allclose(pack.hand(200), lost, rtol=1e-12)
    for name in "xyuv":
        assert_allclose(pack.floes[name], floes[name], rtol=0, atol=1e-10)
    pack.again()
    assert abs(pack.hand(200, strength=0.99) - lost) > 1e-3 * lost
