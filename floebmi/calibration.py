"""What a floe-step and an exchange cost on this machine: measured on a scene, kept for scenes of its kind.

Scenes are of one kind if they run the same machine code: the same parts of a contact law, the same forces.  Those of
a few floes are of another kind: a step costs them more than its floes do.
"""

import json
import platform
import time
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from floebmi.files import cache_folder, in_one_go
from floebmi.running import Forcing

if TYPE_CHECKING:
    from floebmi.model import Model
    from floebmi.scene import Built

MEASURED_FOR = 3.0  # [s]
SHORT, LONG = 2, 60  # steps of the exchanges that are compared; more of few floes
FLOE_STEPS = 2e5  # at least, of the long one
FEW = 100  # floes


class Cost(NamedTuple):
    """CPU time [s] for a step of one floe, and for an exchange of one floe or cell."""

    floe_step: float
    exchange: float

    def of(self, steps: float, exchanges: float, floes: int, cells: int) -> float:
        """Of a run [s]: ice alone, without forcing from files, output and pictures."""
        return self.floe_step * steps * floes + self.exchange * exchanges * (floes + cells)


def kind(model: "Model") -> str:
    """What sets the machine code of a model, in words, and whether it has few floes."""
    contact = () if model.contact is None else model.contact
    names = [type(part).__name__ for part in (*contact, *model.forces) if part is not None]
    words = ["rotation"] * model.floes.rotation + [model.step.scheme, model.sampling]
    every = [f"drag every {model.step.drag_every}"] * (model.step.drag_every > 1)
    few = ["few floes"] * bool(np.count_nonzero(model.floes.active) < FEW)
    return ", ".join([*names, *words, *every, *few])


def measure(built: "Built", duration: float | None) -> Cost:
    """Run a scene for a few seconds, from its start again where it is over sooner; the model is then used up.

    duration : of the scene [s]: after it there may be no ice left that costs anything
    """
    model = built.model
    Forcing(model, built.ocean, built.atmosphere).fill(0.0)
    step = model.longest_step()
    step = step if np.isfinite(step) else 60.0
    beginning = model.state()
    model.advance(SHORT * step)  # compiles
    floes = max(int(np.count_nonzero(model.floes.active)), 1)
    more = max(LONG, min(int(FLOE_STEPS / floes), 5000))
    end = max(duration or np.inf, (2 * SHORT + LONG) * step)
    spans = SHORT * step, min(more * step, end - 2 * SHORT * step)
    rows, begin = [], time.perf_counter()
    while time.perf_counter() - begin < MEASURED_FOR or len(rows) < 3:
        if model.time + sum(spans) > end:
            model.restore(beginning)
            model.advance(SHORT * step)  # lists neighbours, as a run does once
        pair = []
        for span in spans:
            before, start = model.counters.floe_steps, time.perf_counter()
            model.advance(span)
            pair.append((time.perf_counter() - start, model.counters.floe_steps - before))
        rows.append(pair)
    (short, few), (long, many) = np.mean(rows, axis=0)  # now and then neighbours are listed anew
    floe_step = max(long - short, 0.0) / (many - few) if many > few else 0.0
    cells = sum(fluid.grid.size for fluid in (model.ocean, model.atmosphere) if fluid is not None)
    return Cost(float(floe_step), float(max(short - few * floe_step, 0.0) / (floes + cells)))


def _file() -> Path:
    return cache_folder() / f"costs-{platform.node()}.json"


def _all() -> dict[str, list[float]]:
    try:
        found = json.loads(_file().read_text(encoding="utf-8"))
        return {name: [float(v) for v in pair] for name, pair in found.items() if len(pair) == 2}
    except (OSError, ValueError, TypeError, AttributeError):
        return {}  # none yet, cut short, or of another make: it is measured again


def stored(model: "Model") -> Cost | None:
    """What was measured on this machine for models of this kind."""
    found = _all().get(kind(model))
    return None if found is None else Cost(*found)


def keep(model: "Model", cost: Cost) -> Path:
    """Store a measurement for models of this kind; returns the file."""
    path = _file()
    path.parent.mkdir(parents=True, exist_ok=True)
    with in_one_go(path) as part:
        part.write_text(json.dumps(_all() | {kind(model): list(cost)}, indent=1), encoding="utf-8")
    return path
