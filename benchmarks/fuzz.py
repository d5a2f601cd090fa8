"""Runs many random scenes: `python -m benchmarks.fuzz [--scenes 1000] [--seed 0]`.

A scene is drawn at random: floes of wide ranges of position, size, thickness and velocity, some held, driven or land;
edges, walls and inflow; contact laws and their numbers; fluids, their grids and masks; schemes, steps and
exchanges.  It must run with mass and momentum closed to round-off, the energy residual within its bound, all numbers
finite and all fields within their bounds; or InputError or StabilityError must refuse or stop it in one line.  Anything
else is printed with the scene, which `tests/test_fuzz.py` can then keep as a case.
"""

import argparse
import random
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple
from unittest import mock

import numpy as np
from hypothesis import HealthCheck, Phase, given, seed, settings, strategies as st

import floebmi as fb
from benchmarks.options import run, whole, whole_from
from floebmi.floes import COAST, FIXED, FIXED_X, FIXED_Y

TOLD_EVERY = 100  # scenes: a run that is killed has told what it found
CLOSED = {"mass": 1e-12, "momentum_x": 1e-9, "momentum_y": 1e-9}


def _logarithmic(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(np.log10(low), np.log10(high)).map(lambda e: float(10.0**e))


class Laws(NamedTuple):
    """What a scene is made of.  Each combination is compiled once, so there are few of them."""

    edges: tuple[str, str]  # west and east, south and north
    wall: str
    contact: bool
    friction: bool
    bonds: bool
    dashpot: bool
    ocean: bool
    wind: bool
    others: bool
    rotation: bool
    scheme: str


FEW = (
    Laws(
        ("inactive", "inactive"), "", True, True, False, False, True, True, False, False, "verlet"
    ),
    Laws(("periodic", "closed"), "", True, True, True, False, True, True, False, False, "verlet"),
)


def _many(count: int) -> tuple[Laws, ...]:
    rng = random.Random(0)
    edges = ["inactive", "closed", "periodic"]
    return tuple(
        Laws(
            (rng.choice(edges), rng.choice(edges)), rng.choice(["", "", "still", "moving", "loaded"]),
            rng.random() < 0.9, *(rng.random() < 0.5 for _ in range(7)),
            rng.choice(["verlet", "verlet", "verlet", "taylor2", "taylor3"]),
        )
        for _ in range(count)
    )  # fmt: skip


MANY = FEW + _many(46)


@st.composite
def scenes(draw: st.DrawFn, laws: Sequence[Laws] = MANY) -> dict[str, Any]:
    """A scene as numbers and words; `model_of` makes the model."""
    return {
        **draw(st.sampled_from(laws))._asdict(),
        "seed": draw(st.integers(0, 2**31)),
        "n": draw(st.integers(0, 40)),
        "side": draw(_logarithmic(10.0, 1e5)),
        "shape": draw(_logarithmic(0.3, 3.0)),
        "origin": draw(st.sampled_from([0.0, -0.5, 1e3, -1e3])),  # in sides
        "largest": draw(_logarithmic(1e-3, 0.3)),  # radius over side
        "size_ratio": draw(_logarithmic(1.0, 1e3)),
        "thickness": (draw(_logarithmic(1e-3, 10.0)), draw(_logarithmic(1.0, 100.0))),
        "speed": draw(st.sampled_from([0.0, 1e-3, 0.3, 3.0])),
        "relaxed": draw(st.booleans()),
        "held": draw(st.sampled_from([0.0, 0.3, 1.0])),
        "inflow": draw(st.booleans()),
        "youngs_modulus": draw(_logarithmic(1e4, 1e9)),
        "coefficient": draw(st.sampled_from([0.0, 0.3, 10.0])),
        "strength": draw(st.sampled_from([0.0, 2e5, 1e7])),
        "restitution": draw(st.sampled_from([1e-3, 0.5, 1.0])),
        "current": draw(st.sampled_from([0.0, 0.3, 4.0])),
        "wind_speed": draw(st.sampled_from([0.0, 10.0, 60.0])),
        "cells": (draw(st.integers(1, 6)), draw(st.integers(1, 6))),
        "dry": draw(st.sampled_from([0.0, 0.3, 1.0])),
        "sampling": draw(st.sampled_from(["overlap", "centre"])),
        "epsilon": draw(st.sampled_from([None, None, 0.07])),
        "fraction": draw(st.sampled_from([0.3, 0.3, 0.05, 1.0])),
        "exchanges": draw(st.integers(1, 5)),
        "steps": draw(_logarithmic(0.1, 300.0)),
    }


def model_of(s: dict[str, Any]) -> fb.Model:
    """The model of a scene; InputError if there can be none."""
    rng, n, side = np.random.default_rng(s["seed"]), s["n"], s["side"]
    low = s["origin"] * side
    x, y = (low, low + side), (low, low + side * s["shape"])
    domain = fb.Domain(x, y, s["edges"][0], s["edges"][0], s["edges"][1], s["edges"][1])
    largest = s["largest"] * side
    thin, range_of_thickness = s["thickness"]
    u, v = rng.normal(0.0, 1.0, (2, n)) * s["speed"]
    kinds = rng.choice([FIXED, FIXED_X, FIXED_Y, COAST], n)
    motion = np.where(rng.random(n) < s["held"], kinds, 0)
    u[motion == COAST] = v[motion == COAST] = 0.0
    floes = fb.Floes(
        rng.uniform(*x, n), rng.uniform(*y, n), largest * s["size_ratio"] ** -rng.random(n),
        thin * range_of_thickness ** rng.random(n), u, v, motion,
    )  # fmt: skip
    if s["relaxed"]:
        fb.relax(floes, domain)
    contact = None
    if s["contact"]:
        contact = fb.Contact(
            fb.Elastic(s["youngs_modulus"]),
            fb.Coulomb(s["coefficient"]) if s["friction"] else None,
            fb.TensileStrength(s["strength"]) if s["bonds"] else None,
            fb.Restitution(s["restitution"]) if s["dashpot"] else None,
        )
    forces: list[Any] = []
    forces += [fb.OceanDrag()] if s["ocean"] else []
    forces += [fb.AirDrag()] if s["wind"] else []
    forces += [fb.Coriolis(1.4e-4), fb.BodyForce(1e-3, -2e-3)] if s["others"] else []
    walls = {
        "": [],
        "still": [fb.Wall("north")],
        "moving": [fb.Wall("north", velocity=-1e-3 * side)],
        "loaded": [fb.Wall("north", normal_stress=1e4)],
    }[s["wall"]]
    feed = fb.PowerLaw(0.5 * largest, largest)
    grid = fb.Grid.uniform(x, y, shape=s["cells"])
    model = fb.Model(
        domain, floes, contact, forces, grid.with_wet(rng.random(grid.size) >= s["dry"]), walls,
        [fb.Inflow("west", feed, velocity=(0.1, 0.0))] if s["inflow"] else (),
        fb.Step(s["scheme"], s["fraction"], s["epsilon"]), s["sampling"], rotation=s["rotation"],
    )  # fmt: skip
    for fluid, speed in ((model.ocean, s["current"]), (model.atmosphere, s["wind_speed"])):
        if fluid is not None:
            fluid.u[:], fluid.v[:] = speed * rng.uniform(-1.0, 1.0, (2, grid.size))
    return model


@contextmanager
def unwritten_memory() -> Iterator[None]:
    """Fill new arrays that numpy leaves uninitialised with what none should hold: NaN, integers of −1.  Nothing compiles meanwhile."""

    def spoiling(make: Callable[..., np.ndarray]) -> Callable[..., np.ndarray]:
        def make_and_spoil(*args: Any, **options: Any) -> np.ndarray:
            array = make(*args, **options)
            if array.size and not array.dtype.hasobject and array.flags.c_contiguous:
                array.reshape(-1).view(np.uint8)[:] = 0xFF
            return array

        return make_and_spoil

    with (
        mock.patch.object(np, "empty", spoiling(np.empty)),
        mock.patch.object(np, "empty_like", spoiling(np.empty_like)),
    ):
        yield


class Outcome(NamedTuple):
    """How a scene ended: "ran", "refused", "stopped" or "broken", and the message."""

    word: str
    text: str


def outcome(scene: dict[str, Any]) -> Outcome:
    """Run a scene and check the result."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            model = model_of(scene)
            model.advance(1e-12 * scene["side"])  # who comes in sets the step
            step = min(model.longest_step(), 1e-2 * scene["side"], _coming_in(scene))
            for _ in range(scene["exchanges"]):
                model.advance(scene["steps"] * step / scene["exchanges"])
            wrong = _wrong(model)
            return Outcome("broken" if wrong else "ran", wrong)
    except (fb.InputError, fb.StabilityError) as refusal:
        text = str(refusal)
        if "\n" in text or not text:
            return Outcome("broken", f"refused in more than a line: {text}")
        return Outcome("refused" if isinstance(refusal, fb.InputError) else "stopped", text)
    except Exception as error:  # noqa: BLE001  whatever it is, it is what is looked for
        return Outcome("broken", f"{type(error).__name__}: {error}")


def _coming_in(scene: dict[str, Any]) -> float:
    """A hundred √(m/k) of the smallest floe [s], so that no inflow makes an exchange of millions of steps."""
    smallest = scene["largest"] / scene["size_ratio"]
    return 100.0 * smallest * float(np.sqrt(934.0 * np.pi / scene["youngs_modulus"]))


def _wrong(model: fb.Model) -> str:
    floes, fields = model.floes, model.fields()
    for name in ("x", "y", "u", "v", "angle", "angular_velocity"):
        values = getattr(floes, name)
        if values is not None and not np.isfinite(values).all():
            return f"floes.{name} is not finite"
    for name, values in fields.items():
        if not np.isfinite(values).all():
            return f"field {name} is not finite"
    for quantity, bound in CLOSED.items():
        balance = model.ledger.balance(quantity)
        if balance.relative > bound:
            return f"{quantity}: {balance}"
    covered = model.coverage()
    ice = floes.active & ~floes.land
    both = model.grid.area * (fields["area_fraction"] + fields["overlap_fraction"])
    total = both.sum() + covered.outside.sum()
    if abs(total - floes.area[ice].sum()) > 1e-11 * floes.area[ice].sum():
        return f"area: {total} in the cells and outside, {floes.area[ice].sum()} of floes"
    state = model.state()
    model.restore(state)
    return ""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=whole, default=1000)
    parser.add_argument("--seed", type=whole_from(0), default=0)
    parser.add_argument("--show", choices=["ran", "refused", "stopped"], help="print these too")
    options = parser.parse_args()
    ends: Counter[str] = Counter()

    @seed(options.seed)
    @settings(
        max_examples=options.scenes, deadline=None, database=None, phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip
    @given(scenes())
    def each(scene: dict[str, Any]) -> None:
        end = outcome(scene)
        ends[end.word] += 1
        if end.word == "broken" or options.show == end.word:
            print(f"{end.text[:300]}\n  {scene}", flush=True)
        if sum(ends.values()) % TOLD_EVERY == 0:
            tell()

    def tell() -> None:
        counts = ", ".join(f"{n} {word}" for word, n in sorted(ends.items()))
        print(f"seed {options.seed}, {sum(ends.values())} scenes: {counts}", flush=True)

    each()
    tell()
    raise SystemExit(1 if ends["broken"] else 0)


if __name__ == "__main__":
    run(main)
