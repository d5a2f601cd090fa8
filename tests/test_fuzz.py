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


@pytest.mark.long
def test_a_random_scene_runs_within_its_ledgers_or_is_refused_in_one_line():
    ends = ends_of(FEW, 60, 6)
    assert ends["ran"] > 20 and ends["refused"] > 5


@pytest.mark.long
@pytest.mark.parametrize("number", range(4))
def test_random_scenes_of_all_laws_run_within_their_ledgers_or_are_refused(number):
    ends = ends_of(MANY, 1000, number)
    assert ends["ran"] > 300


KEPT = {
    # the paper's step of a scene whose floes are all of land
    "no floe that moves": {
        "edges": ("inactive", "inactive"), "wall": "", "contact": True, "friction": True, "bonds": False,
        "dashpot": False, "ocean": True, "wind": True, "others": False, "rotation": False, "scheme": "verlet",
        "seed": 473013, "n": 1, "side": 16228.4, "shape": 2.2, "origin": 1000.0, "largest": 0.001,
        "size_ratio": 1.0, "thickness": (0.009, 1.0), "speed": 0.0, "relaxed": True, "held": 1.0, "inflow": True,
        "youngs_modulus": 1e4, "coefficient": 10.0, "strength": 2e5, "restitution": 0.001, "current": 4.0,
        "wind_speed": 0.0, "cells": (5, 1), "dry": 0.3, "sampling": "centre", "epsilon": 0.07, "fraction": 0.3,
        "exchanges": 5, "steps": 1.0,
    },
    # taylor3: a wall took the force of the ice, but not, as the floes did, its change since the step before
    "momentum that a wall did not take": {
        "edges": ("closed", "inactive"), "wall": "moving", "contact": True, "friction": True, "bonds": True,
        "dashpot": False, "ocean": False, "wind": False, "others": False, "rotation": False, "scheme": "taylor3",
        "seed": 23, "n": 0, "side": 43.275431342627016, "shape": 1.4849200618749454, "origin": 0.0,
        "largest": 0.046492920322381434, "size_ratio": 908.2769707496045, "thickness": (0.0019, 5.2), "speed": 0.0,
        "relaxed": False, "held": 0.3, "inflow": True, "youngs_modulus": 1e4, "coefficient": 10.0,
        "strength": 1e7, "restitution": 0.5, "current": 4.0, "wind_speed": 10.0, "cells": (2, 4), "dry": 0.0,
        "sampling": "centre", "epsilon": None, "fraction": 0.05, "exchanges": 5, "steps": 1.9839831449991818,
    },
}  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize("name", KEPT)
def test_what_was_found_once_runs_within_its_ledgers(name):
    assert outcome(KEPT[name]) == ("ran", "")
