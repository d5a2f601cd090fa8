"""The cost of a step in instructions, which unlike its time are the same whenever they are counted."""

import json
import shutil
from pathlib import Path

import numba
import pytest

from benchmarks.limit import LAWS, instructions

STORED = json.loads((Path(__file__).parent / "data" / "instructions.json").read_text())


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
