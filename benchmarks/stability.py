"""The step at which packs become unstable: `python -m benchmarks.stability [--to docs/stability.png] [--steps 2000]`.

Measures the growth of kinetic energy per step against the step over the predicted limit, 2 (√(1 + ζ²) − ζ)/ω_max from the
floes' own stiffness sums (docs/theory.md, eq. stable-step), for each scheme, contact law and pack.  The packs are pressed
together and at rest except for random velocities of 1e-8 m/s, so that all contacts stay closed and the system is
linear.  The onset is the shortest step tried at which energy grows by more than 0.1 % per step.
"""

import argparse
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

import floebmi as fb
from benchmarks.options import picture, run, whole
from floebmi.validate import hexagonal_pack, kinetic_energy

GROWS = 1e-3  # per step
# of the limit
SHARES = (0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 1.0, 1.05, 1.1, 1.2, 1.4)
SCHEMES = ("verlet", "taylor2", "taylor3")
LAWS = {
    "elastic": fb.Contact(),
    "sticking": fb.frictional(friction=1e3),
    "elastic, e = 0.5": fb.Contact(dashpot=fb.Restitution(0.5)),
    "sticking, e = 0.1": fb.frictional(friction=1e3, restitution=0.1),
}


def hexagonal() -> tuple[fb.Domain, fb.Floes]:
    """64 equal floes in a hexagonal pack."""
    model = hexagonal_pack(8, fb.Contact())
    return model.domain, model.floes


def random_pack(ratio: float) -> tuple[fb.Domain, fb.Floes]:
    """About 150 floes at random positions in a periodic square, pressed together and brought to rest."""
    side = 24.0 if ratio < 5 else 50.0
    domain = fb.Domain((0.0, side), (0.0, side), *["periodic"] * 4)
    sizes = fb.UniformSize(1.0, ratio) if ratio < 5 else fb.PowerLaw(1.0, ratio, -1.8)
    floes = fb.scatter(domain, sizes, concentration=0.85, seed=1)
    law = fb.Contact(dashpot=fb.Restitution(0.01))
    for _ in range(12):  # grown together, a little at a time
        floes.radius *= 1.002
        fb.Model(domain, floes, law).advance(10.0)
    fb.Model(domain, floes, law).advance(100.0)
    return domain, floes


PACKS: dict[str, Callable[[], tuple[fb.Domain, fb.Floes]]] = {
    "hexagonal": hexagonal,
    "random, 1:1.5": lambda: random_pack(1.5),
    "random, 1:10": lambda: random_pack(10.0),
}


def growth(domain: fb.Domain, floes: fb.Floes, law: fb.Contact, step: fb.Step, steps: int) -> float:
    """Growth of kinetic energy per step, over the second half of the steps or of those that can be followed."""
    floes = floes.copy()
    rng = np.random.default_rng(0)
    floes.u[:], floes.v[:] = rng.normal(0.0, 1e-8, (2, len(floes)))
    model = fb.Model(domain, floes, law, step=step)
    chunk, energies = 20, []
    for _ in range(steps // chunk):
        try:
            model.step_by(chunk)
        except fb.StabilityError:
            break
        energies.append(kinetic_energy(floes))
        if energies[-1] > 1e12 * energies[0]:
            break
    if len(energies) < 2:
        return math.inf
    half, n = len(energies) // 2, max(1, len(energies) // 4)
    late, early = np.mean(energies[-n:]), np.mean(energies[half - min(half, n) : half or 1])
    return float(np.log(late / early) / (chunk * (len(energies) - half)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--to", type=picture, metavar="FILE.png", help="also draw it")
    parser.add_argument("--steps", type=whole, default=2000)
    options = parser.parse_args()
    packs = {name: make() for name, make in PACKS.items()}
    rates: dict[tuple[str, str, str], np.ndarray] = {}
    print(
        f"{'pack':<15}{'contact':<20}{'scheme':<9}{'onset/limit':>12}  growth per step at a share of the limit of"
    )
    print(" " * 58 + "".join(f"{share:>9g}" for share in SHARES))
    for pack, (domain, floes) in packs.items():
        for name, law in LAWS.items():
            limit = fb.Model(domain, floes.copy(), law, step=fb.Step(fraction=1.0)).longest_step()
            for scheme in SCHEMES:
                values = np.array([
                    growth(domain, floes, law, fb.Step(scheme, length=share * limit), options.steps)
                    for share in SHARES
                ])  # fmt: skip
                rates[pack, name, scheme] = values
                grows = values > GROWS
                onset = f"{SHARES[int(np.argmax(grows))]:g}" if grows.any() else f"> {SHARES[-1]:g}"
                numbers = "".join(f"{value:>9.1e}" for value in values)
                print(f"{pack:<15}{name:<20}{scheme:<9}{onset:>12}  {numbers}", flush=True)
    if options.to is not None:
        draw(rates, options.to)
        print(f"wrote {options.to}")


def draw(rates: dict[tuple[str, str, str], np.ndarray], path: Path) -> None:
    """Growth per step against the step over its limit, a panel for each scheme."""
    from matplotlib.lines import Line2D

    from floebmi.plot import graph

    with graph(11, 4.4) as figure:
        axes = figure.subplots(1, len(SCHEMES), sharey=True)
        colors = dict(zip(LAWS, ("#0072B2", "#E69F00", "#009E73", "#CC79A7"), strict=True))
        marks = dict(zip(PACKS, ("o", "s", "^"), strict=True))
        for axis, scheme in zip(axes, SCHEMES, strict=True):
            for (pack, law, of), values in rates.items():
                if of == scheme:
                    shown = np.where(np.isfinite(values), values, 1.0)
                    axis.plot(SHARES, shown, color=colors[law], marker=marks[pack], ms=4, lw=1)
            axis.axvline(1.0, color="black", ls="--", lw=1)
            axis.axhline(GROWS, color="gray", ls=":", lw=1)
            axis.set(title=scheme, xlabel="step over the predicted limit [1]", xlim=(0, SHARES[-1]))
            axis.set_yscale("symlog", linthresh=1e-4)
            axis.set_ylim(-3e-3, 2.0)
            axis.grid(alpha=0.3)
        axes[0].set_ylabel("growth of kinetic energy per step [1]")
        axes[0].text(0.99, 0.97, "predicted limit", rotation=90, ha="right", va="top", fontsize=8,
                     transform=axes[0].get_xaxis_transform())  # fmt: skip
        handles = [Line2D([], [], color=color, label=law) for law, color in colors.items()]
        handles += [
            Line2D([], [], color="black", marker=mark, ls="", ms=4, label=pack)
            for pack, mark in marks.items()
        ]
        figure.legend(handles=handles, fontsize=8, loc="outside lower center", ncols=len(handles))
        figure.savefig(path, dpi=130)


if __name__ == "__main__":
    run(main)
