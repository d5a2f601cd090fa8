"""Time from the start of Python to the end of the first step: `python -m benchmarks.start [SCENE] [--repeats 3]`.

New processes import the package, build a packaged scene and advance it by one step (60 s at most), with an empty
compile cache and with a filled one.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time

from benchmarks.options import run, whole
from floebmi.scene import read_scene

RUN = """
import time
start = time.perf_counter()
import floebmi
imported = time.perf_counter()
from floebmi.scene import read_scene
built = read_scene({scene!r}).build()
ready = time.perf_counter()
model = built.model
for source, fluid in ((built.ocean, model.ocean), (built.atmosphere, model.atmosphere)):
    if source is not None:
        source.fill(0.0, fluid.u, fluid.v)
model.advance(min(model.longest_step(), 60.0))
print(imported - start, ready - imported, time.perf_counter() - ready)
"""


def start(scene: str, cache: str) -> list[float]:
    """Seconds from the start of a process to the end of its first step; and those for import, building and the step."""
    began = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", RUN.format(scene=scene)],
        env=os.environ | {"FLOEBMI_CACHE": cache}, check=True, capture_output=True, text=True,
    )  # fmt: skip
    return [time.perf_counter() - began, *map(float, done.stdout.split())]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", nargs="?", default="labrador-sea")
    parser.add_argument("--repeats", type=whole, default=3)
    options = parser.parse_args()
    read_scene(options.scene)  # what is wrong with it is said here
    print(f"{options.scene:<16}{'in all':>10}{'import':>10}{'build':>10}{'first step':>12}   [s]")
    with tempfile.TemporaryDirectory() as cache:
        rows = [("cold cache", start(options.scene, cache))]
        warm = [start(options.scene, cache) for _ in range(options.repeats)]
        rows.append(("warm, the best", min(warm)))
    for name, row in rows:
        print(f"{name:<16}{row[0]:>10.1f}{row[1]:>10.1f}{row[2]:>10.1f}{row[3]:>12.1f}")


if __name__ == "__main__":
    run(main)
