"""Random scenes: each runs within its ledgers, or is refused in one line."""

from collections import Counter

import pytest
from hypothesis import HealthCheck, Phase, given, seed, settings

from benchmarks.fuzz import FEW, MANY, outcome, scenes


def ends_of(laws, count, number):
    """How many scenes ended in which way; the first that broke fails."""
    ends = Counter()

    @seed(number)
    @settings(
        max_examples=count, deadline=None, database=None, phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip
    @given(scenes(laws))
    def each(scene):
        end = outcome(scene)
        assert end.word != "broken", f"{end.text}\n{scene}"
        ends[end.word] += 1

    each()
    return ends


def test_a_random_scene_runs_within_its_ledgers_or_is_refused_in_one_line():
    ends = ends_of(FEW, 60, 6)
    assert ends["ran"] > 20 and ends["refused"] > 5


@pytest.mark.long
@pytest.mark.parametrize("number", range(4))
def test_random_scenes_of_all_laws_run_within_their_ledgers_or_are_refused(number):
    ends = ends_of(MANY, 1000, number)
    assert ends["ran"] > 300
