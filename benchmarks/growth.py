"""Cost and memory against number, sizes and packing of floes: `python -m benchmarks.growth [--figure FILE]`.

Frictional discs in a periodic square with random velocities, double precision, one core: 10 000 floes, size ratio 2,
packing 0.85, with one of the three varied.  Scenes take turns.  Memory is that of the arrays which a model and its neighbour list hold between two
rebuilds, counted one by one, per floe and per listed pair; and the growth of the process at its peak.
"""

import argparse
import resource
from pathlib import Path

import floebmi as fb
from benchmarks.options import picture, run, whole, whole_from
from benchmarks.packs import cost, scattered
from floebmi.advance import Advance
from floebmi.explain import arrays_of
from floebmi.plot import LINES, graph

FLOES, RATIO, PACKING = 10_000, 2.0, 0.85
RATIOS, PACKINGS = (2, 10, 100), (0.85, 0.6, 0.3, 0.1)
LAWS = {"frictional": fb.frictional, "cohesive": fb.cohesive}


def pack(
    n: int = FLOES,
    ratio: float = RATIO,
    packing: float = PACKING,
    contact: fb.Contact | None = None,
) -> fb.Model:
    """Discs of radii from 1 m to `ratio`, frictional where no contact law is given."""
    model = fb.Model(*scattered(n, ratio, packing), contact=contact or fb.frictional())
    model.advance(20 * model.longest_step())  # compiles
    return model


def table(what: str, spent: dict[float, float]) -> None:
    print(f"{what:<39}ns per floe-step   to the first")
    first, *_ = spent.values()
    for name, value in spent.items():
        print(f"  {name:>34,}{value:>18.1f}{value / first:>15.2f}")


def draw(costs: dict[str, dict[float, float]], to: Path) -> None:
    """Cost of a floe-step against each quantity that is varied, in panels."""
    with graph(9, 3) as figure:
        panels = figure.subplots(1, len(costs), sharey=True)
        for panel, (what, spent), color in zip(panels, costs.items(), LINES, strict=False):
            panel.plot([*spent], [*spent.values()], "o-", color=color)
            panel.set_xlabel(f"{what} [1]")
            if max(spent) > 1:
                panel.set_xscale("log")
        panels[0].set(ylabel="time of a floe-step [ns]", ylim=(0, None))
        figure.savefig(to, dpi=130)


def memory(model: fb.Model) -> tuple[float, float, float]:
    """Bytes per floe, per listed pair, and pairs per floe, in the middle of an advance."""
    now: Advance = model._now()
    n, pairs = len(model.floes), len(now.pairs.i)
    listed = arrays_of(now.pairs[1:])
    held = arrays_of(model, now)
    per_pair = sum(array.nbytes for array in listed.values())
    per_floe = sum(array.nbytes for key, array in held.items() if key not in listed)
    return per_floe / n, per_pair / pairs, pairs / n


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--largest", type=whole_from(1_000), default=1_000_000)
    parser.add_argument("--repeats", type=whole, default=5)
    parser.add_argument("--figure", type=picture, metavar="FILE.png", help="draw the costs")
    options = parser.parse_args()
    numbers = [n for n in (1_000, 10_000, 100_000, 1_000_000) if n <= options.largest]

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    models = {n: pack(n) for n in numbers}
    costs = {"number of floes": cost(models, options.repeats)}
    grown = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - peak)
    costs["size ratio"] = cost({ratio: pack(ratio=ratio) for ratio in RATIOS}, options.repeats)
    costs["packing"] = cost({share: pack(packing=share) for share in PACKINGS}, options.repeats)
    for what, spent in costs.items():
        table(what, spent)
    if options.figure:
        draw(costs, options.figure)

    print("memory                                    bytes a floe   bytes a pair   pairs a floe")
    for name, law in LAWS.items():
        model = models[numbers[-1]] if name == "frictional" else pack(contact=law())
        row = memory(model)
        print(f"  {name:>34}{row[0]:>18.0f}{row[1]:>15.1f}{row[2]:>15.2f}")
    total = sum(len(model.floes) for model in models.values())
    print(f"the process grew by {grown / total:.0f} bytes a floe at its peak, packing included")


if __name__ == "__main__":
    run(main)
