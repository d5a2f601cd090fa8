"""What contacts, other forces and motion take of a step: timed by leaving out the one and the other, in turn.

A step is one loop, in which no watch could tell them apart.  So from where a model is, some steps are taken whole, some as
if no floe were near another one, and some without the other forces, all with the same machine code: what is missing each
time is what that part takes.
"""

import time

import numpy as np

from floebmi.model import Model

FLOE_STEPS = 400_000  # timed in a row: some ten milliseconds
LEAST_STEPS, LEAST_TURNS = 10, 3
LEAST_SECONDS = 1.0  # of all turns


def shares_of_a_step(model: Model) -> dict[str, float]:
    """The shares of "contacts", "forces" (all but those) and "motion" in the time of a step from here [1]; they sum to 1.

    A share that noise would make negative is 0; if contacts and forces would take more than all, they are scaled to 1.
    Those that the model has; in the paper's schemes the forces are part of the motion.  Empty before the first step and
    without floes.  Takes about a second, and leaves the model as it is.
    """
    if not model.counters.steps or not model.floes.active.any():
        return {}
    parts = []
    if model.contact is not None:
        parts.append("contacts")
    if model.forces and model.step.scheme == "verlet":
        parts.append("forces")
    steps = max(LEAST_STEPS, FLOE_STEPS // max(len(model.floes), 1))
    turns, begin = [], time.perf_counter()
    while len(turns) < LEAST_TURNS or time.perf_counter() - begin < LEAST_SECONDS:
        turns.append([model.seconds_per_step(steps, without) for without in (None, *parts)])
    whole, *others = np.array(turns).T
    shares = {  # a part that takes nothing may be timed at less than that
        name: max(0.0, 1.0 - float(np.median(other / whole)))
        for name, other in zip(parts, others, strict=True)
    }
    shares["motion"] = max(0.0, 1.0 - sum(shares.values()))
    total = sum(shares.values())
    return {name: share / total for name, share in shares.items()}
