"""The paper, repeated: Figures 1 to 10 of Damsgaard, Adcroft & Sergienko (2018) from this model.

    python examples/paper.py [--to paper] [--seeds 20] [--jobs N] [--figures 3,4,7] [--quick]

Each figure goes into the folder, with the files that it is drawn from.  Finished members are kept there and not run
again, so the script may be stopped and started anew.  `--quick` makes small versions of all figures, with fewer and
larger floes, short runs and two seeds; they are not results.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from floebmi.experiments import figures

SHEAR_SEEDS = 3
QUICK = {
    "Shear": {
        "floes": (70,), "height": (150.0,), "radius_max": (8.0,), "held": (16.0,), "settling": (40.0,),
        "consolidation": (30.0,), "duration": (20.0,), "normal_stress": (1e4, 4e4),
    },
    "Strait": {"funnel": (6e3,), "hours": (2.0,), "channel": (1e3,)},
}  # fmt: skip


def main(
    to: Path = Path("paper"),
    seeds: int = 20,
    jobs: int | None = None,
    numbers: Sequence[int] = tuple(figures.KINDS),
    quick: bool = False,
) -> list[Path]:
    """Make the figures; returns the pictures."""
    to.mkdir(parents=True, exist_ok=True)
    pictures = []
    for number in numbers:
        kind = figures.KINDS[number]
        values: dict[str, Any] = dict(QUICK[kind.__name__]) if quick else {}
        if quick and number in (1, 2, 5):
            values.pop("normal_stress", None)
        if quick and number in figures.SWEEPS:  # the ends of the sweep
            sweep = figures.SWEEPS[number]
            values[sweep.name] = (sweep.values[0], sweep.values[-1])
        many = range(1, 1 + min(seeds, SHEAR_SEEDS if kind.__name__ == "Shear" else seeds))
        print(f"figure {number}", flush=True)
        drawn = figures.make_figure(
            number, kind, values, many, to / f"figure-{number}.png", jobs=jobs, progress=not quick
        )
        print(drawn.text, flush=True)
        pictures.append(drawn.files[-1])
    return pictures


if __name__ == "__main__":
    words = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    words.add_argument("--to", type=Path, default=Path("paper"))
    words.add_argument("--seeds", type=int, default=None, help="default: 20; 2 with --quick")
    words.add_argument("--jobs", type=int, help="processes; default: all cores")
    words.add_argument("--figures", default=",".join(map(str, figures.KINDS)))
    words.add_argument("--quick", action="store_true")
    given = words.parse_args()
    main(
        given.to,
        given.seeds or (2 if given.quick else 20),
        1 if given.quick else given.jobs,
        [int(number) for number in given.figures.split(",")],
        given.quick,
    )
