"""Host and ice in two processes: `FloeBmi` behind gRPC (grpc4bmi), the loop of the host unchanged.

    python examples/two_processes.py [--folder two-processes] [--hours 3]

starts `run-bmi-server` with the ice in a process of its own, couples a two-slab ocean to it with the same `couple` as in one
process, and does the run again without gRPC: the numbers are the same, bit for bit.

Limits of grpc4bmi, as found:

- No pointers: `get_value_ptr` raises NotImplementedError.  Use `get_value`, again after each update.
- Extra methods do not cross: no `save_state` and no `model` on the host's side.  Let the server's side load a state with the
  key `restart`, and save it there.
- Of an error only the text crosses, inside a `RemoteException`; that is why each is one line.  The server prints the rest.
- Arrays are copied into messages; gRPC's own default limit of a message is 4 MB, half a million float64 values.
- Location `none` cannot cross: scalars are at `node`, on a grid of type `scalar` and size 1.
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

from coupling.driver import Exchange, couple
from coupling.slab import SURFACE, TwoSlabOcean
from floebmi import FloeBmi

VELOCITY = "sea_surface_water_flowing__x_component_of_velocity"

FLOES = """
seed = 3
contact = "frictional"
[domain]
x = [0.0, 12e3]
y = [0.0, 10e3]
edges = "periodic"
[grid]
shape = [9, 11]
[floes]
concentration = 0.5
size = { distribution = "uniform", radius_min = 500.0, radius_max = 900.0 }
[ocean]
drag = "constant-cd"
[time]
exchange = 600.0
"""

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
    """same : both runs end with the same bits; worst : residual of the ledger; refusal : what an error says across."""

    same: bool
    worst: float
    refusal: str


@contextmanager
def another_process(wait: float = 60.0) -> Iterator[Any]:
    """A `FloeBmi` in a server of its own, as a BMI object here."""
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


def run(ice: Any, folder: Path, hours: float) -> tuple[np.ndarray, list[Exchange]]:
    """The surface current of the ocean at the end, and the ledger."""
    ocean = TwoSlabOcean()
    (folder / "ocean.toml").write_text(OCEAN)
    (folder / "floes.toml").write_text(FLOES)
    ocean.initialize(str(folder / "ocean.toml"))
    ice.initialize(str(folder / "floes.toml"))
    lines = couple(ocean, ice, every=600.0, until=hours * 3600.0)
    return np.concatenate([ocean.get_value_ptr(name) for name in SURFACE]), lines


def main(folder: Path, hours: float = 3.0) -> Found:
    """Both ways of running, and a refused value across the wire."""
    folder = folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    here, lines = run(FloeBmi(), folder, hours)
    print("in one process  ", lines[-1])
    with another_process() as ice:
        there, lines = run(ice, folder, hours)
        print("in two processes", lines[-1])
        size = ice.get_grid_size(ice.get_var_grid(VELOCITY))
        refusal = ""
        try:
            ice.set_value(VELOCITY, np.full(size, np.nan))
        except Exception as error:  # noqa: BLE001  whatever gRPC makes of it
            details = getattr(error, "details", None)
            refusal = str(details() if callable(details) else error)
        ice.finalize()
    print(f"same bits: {np.array_equal(here, there)}; a NaN is answered: {refusal}")
    return Found(np.array_equal(here, there), max(line.relative for line in lines), refusal)


if __name__ == "__main__":
    words = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    words.add_argument("--folder", type=Path, default=Path("two-processes"))
    words.add_argument("--hours", type=float, default=3.0)
    main(**vars(words.parse_args()))
