"""Host and ice in two processes: `FloeBmi` behind gRPC (grpc4bmi), with the host's loop unchanged.

    python examples/two_processes.py [--folder two-processes] [--hours 3]

starts `run-bmi-server` with the ice in a process of its own, couples a two-slab ocean to it with the same `couple` as in one
process, and repeats the run without gRPC: the numbers are the same, bit for bit.  Then it kills the process of the ice
half-way; a new one resumes from its checkpoint (key `checkpoint` of the config file), with the same result again.

Limits of grpc4bmi that we met:

- No pointers: `get_value_ptr` raises NotImplementedError.  Use `get_value`, again after each update.
- No extra methods: the host's side has neither `save_state` nor `model`.  With the keys `checkpoint` and `restart` of the
  config file the server saves its state after each update, and resumes from it.
- Of an error only the text arrives, as `details()` of a `grpc.RpcError`; that is why each is one line.  The server prints the rest.
- Arrays are copied into messages; gRPC limits a message to 4 MB by default, half a million float64 values.
- Location `none` is not supported: scalars are at `node`, on a grid of type `scalar` and size 1.
- The config file is read by the server, on its disk.
"""

import argparse
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from coupling.driver import HEADER, Coupling, CouplingError
from coupling.side import first_line
from coupling.slab import SURFACE, TwoSlabOcean
from floebmi import FloeBmi
from floebmi.plot import graph

FLOES = """
seed = 3
contact = "frictional"
[domain]
x = [0.0, 12e3]
y = [0.0, 10e3]
edges = "periodic"
[grid]
shape = [9, 11]
[ocean]
drag = "constant-cd"
[time]
exchange = 600.0
"""
ICE = """
[floes]
concentration = 0.5
size = { distribution = "uniform", radius_min = 500.0, radius_max = 900.0 }
"""
BMI = """
[bmi]
scene = "floes.toml"
checkpoint = "checkpoint.nc"
"""
EVERY = 600.0

OCEAN = """
[grid]
x = [0.0, 12e3]
y = [0.0, 10e3]
spacing = 2e3
[ocean]
surface_thickness = 5.0
deep_thickness = 30.0
quadratic_drag = 1e-3
surface_velocity = [0.4, 0.1]
"""


class Found(NamedTuple):
    """same : both runs end with the same bits; resumed : so does one whose ice was killed; alone : without ice the ocean is
    as when it runs alone; worst : residual of the ledger; refusal, fault : the host's message of an error, and of a death."""

    same: bool
    resumed: bool
    alone: bool
    worst: float
    refusal: str
    fault: str


@contextmanager
def another_process(wait: float = 60.0) -> Iterator[Any]:
    """A `FloeBmi` in a server of its own, seen here as a BMI object."""
    from grpc4bmi.bmi_client_subproc import BmiClientSubProcess

    beside = str(Path(sys.executable).parent)  # where run-bmi-server is, if it is not on the path
    os.environ["PATH"] = os.environ["PATH"] + os.pathsep + beside
    client = BmiClientSubProcess("floebmi.FloeBmi", timeout=600)
    try:
        until = time.monotonic() + wait
        while True:
            try:
                client.get_component_name()
                break
            except Exception:  # noqa: BLE001  the server is not up yet
                if time.monotonic() > until or client.pipe.poll() is not None:
                    raise
                time.sleep(0.3)
        yield client
    finally:
        client.pipe.terminate()


def start(folder: Path, ice: Any, config: str = "floes.toml") -> tuple[Coupling, TwoSlabOcean]:
    """The ice from its config file, an ocean, and what couples them."""
    ocean = TwoSlabOcean()
    ocean.initialize(str(folder / "ocean.toml"))
    ice.initialize(str(folder / config))
    return Coupling(ocean, ice, EVERY), ocean


def current(ocean: TwoSlabOcean) -> np.ndarray:
    return np.array([ocean.get_value_ptr(name) for name in SURFACE])


def run(coupling: Coupling, ocean: TwoSlabOcean, until: float) -> list[np.ndarray]:
    """The surface current of the ocean after each exchange."""
    currents = []
    while ocean.get_current_time() < until:
        coupling.exchange(ocean.get_current_time() + EVERY)
        currents.append(current(ocean))
    return currents


def main(folder: Path, hours: float = 3.0) -> Found:
    """Run both ways; send a value that is refused; kill a process and resume."""
    folder = folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in (
        ("ocean", OCEAN), ("floes", FLOES + ICE), ("no-floes", FLOES), ("bmi", BMI),
        ("again", BMI + 'restart = "checkpoint.nc"\n'),
    ):  # fmt: skip
        (folder / f"{name}.toml").write_text(text, encoding="utf-8")
    until = hours * 3600.0
    here_side = start(folder, FloeBmi())
    here = run(*here_side, until)
    print(" " * 16, HEADER)
    print("in one process  ", here_side[0].ledger[-1])
    with another_process() as ice:
        coupling, ocean = start(folder, ice)
        there = run(coupling, ocean, until)
        print("in two processes", coupling.ledger[-1])
        worst = max(line.relative for line in coupling.ledger)
        size = ice.get_grid_size(ice.get_var_grid(SURFACE[0]))
        refusal = fault = ""
        try:
            ice.set_value(SURFACE[0], np.full(size, np.nan))
        except Exception as error:  # noqa: BLE001  whatever gRPC makes of it
            refusal = first_line(error)
        ice.finalize()
        without = run(*start(folder, ice, "no-floes.toml"), until)
        ice.finalize()
        alone = TwoSlabOcean()
        alone.initialize(str(folder / "ocean.toml"))
        alone.update_until(until)
        coupling, ocean = start(folder, ice, "bmi.toml")
        run(coupling, ocean, EVERY * round(0.5 * until / EVERY))
        ice.pipe.kill()
        try:
            run(coupling, ocean, until)
        except CouplingError as error:
            fault = str(error)
    with another_process() as ice:
        ice.initialize(str(folder / "again.toml"))
        resumed = run(Coupling(ocean, ice, EVERY), ocean, until)
    found = Found(
        np.array_equal(here, there), np.array_equal(resumed[-1], here[-1]),
        np.array_equal(without[-1], current(alone)), worst, refusal, fault,
    )  # fmt: skip
    print(f"same bits: {found.same}; a NaN is answered: {refusal}")
    print(f"a death is told as: {fault}; from the checkpoint on, same bits: {found.resumed}")
    _draw(folder / "two-processes.png", here, there, without, found.worst)
    return found


def _draw(
    path: Path, here: list[np.ndarray], there: list[np.ndarray], without: list[np.ndarray], worst: float
) -> None:  # fmt: skip
    with graph(7, 4.2) as figure:
        panel = figure.subplots()
        hours = np.arange(1, len(here) + 1) * EVERY / 3600.0
        for currents, style, label in (
            (without, dict(color="black", lw=1), "without ice"),
            (here, dict(color="#0072b2", lw=2), "with ice, one process"),
            (there, dict(color="#d55e00", marker="o", mfc="none", ls="none"), "with ice, two processes"),
        ):  # fmt: skip
            panel.plot(hours, [speed[0].mean() for speed in currents], label=label, **style)
        panel.set(xlabel="time [h]", ylabel="surface current along x, mean [m/s]")
        panel.set_title(
            f"same bits: {np.array_equal(here, there)}; the ledger closes to {worst:.0e}"
        )
        panel.grid(alpha=0.3)
        panel.legend()
        figure.savefig(path, dpi=130)


if __name__ == "__main__":
    words = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    words.add_argument("--folder", type=Path, default=Path("two-processes"))
    words.add_argument("--hours", type=float, default=3.0)
    main(**vars(words.parse_args()))
