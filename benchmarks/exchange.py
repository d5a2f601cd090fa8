"""What one exchange costs, in steps of the floes: `python -m benchmarks.exchange [--floes 10000] [--cells 200]`.

A host sets four velocities, updates, and reads the two stresses on the ocean, or all outputs.  A series of short exchanges
alternates with one long exchange.  Their difference gives the cost of a step, rebuilds of the neighbour list included; the
rest of the mean short exchange is its overhead.  A profile of exchanges of one step then shows where the overhead goes.
"""

import argparse
import cProfile
import pstats
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.options import run, whole
from floebmi import FloeBmi, PowerLaw

SCENE = """
contact = "{contact}"
[domain]
x = [0.0, {side}]
y = [0.0, {side}]
edges = "periodic"
[grid]
shape = [{cells}, {cells}]
[floes]
concentration = {concentration}
size = {{ distribution = "power_law", radius_min = 200.0, radius_max = 400.0, exponent = -1.8 }}
seed = 1
[ocean]
[atmosphere]
[time]
exchange = 600.0
"""
CASES = {
    "dilute, packing 0.5, cohesive": ("cohesive", 0.5),
    "dilute, packing 0.5, frictional": ("frictional", 0.5),
    "dense, packing 0.85, frictional": ("frictional", 0.85),
}
INPUTS = [
    f"sea_surface_{fluid}_flowing__{a}_component_of_velocity"
    for fluid in ("water", "air")
    for a in "xy"
]
SHORT = 20  # short exchanges in a row
OUTPUTS = [f"sea_ice_bottom_water_flowing__{a}_z_component_of_stress" for a in "xy"]
PARTS = {  # function: what it is; parts of the one above are set in
    "set_value": "set the inputs",
    "state": "keep the state, should the call fail",
    "refuse_not_finite": "look for NaN in the fluids",
    "check": "look for NaN in the floes",
    "_allocate": "drag of each floe",
    "sample": "read the fluids at the floes",
    "coverage": "  areas of floes in cells",
    "shares": "  weights",
    "half_curl": "  curl of the fluids",
    "_now": "pack the floes, list their neighbours, find their forces",
    "in_space": "  sort them, for a fresh list",
    "_list_pairs": "  list their pairs",
    "stiffest": "the stable step",
    "_kernel": "one step",
    "finish": "unpack, keep the list",
    "give_impulses_back": "give the impulses back",
    "stock": "the books",
    "show": "make and write the outputs",
    "ice_fields": "  state of the ice",
    "internal_stress_fields": "  internal stress",
    "fluid_stress_fields": "  stresses of the fluids",
    "get_value": "get them",
}


def start(contact: str, concentration: float, floes: int, cells: int) -> FloeBmi:
    """The component, with its machine code compiled."""
    side = float(np.sqrt(floes * PowerLaw(200.0, 400.0, -1.8).mean_area() / concentration))
    text = SCENE.format(
        contact=contact, concentration=concentration, side=round(side, 1), cells=cells
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.toml"
        path.write_text(text)
        ice = FloeBmi()
        ice.initialize(str(path))
    exchange(ice, 5 * ice.model.longest_step(), velocities(ice), OUTPUTS)
    return ice


def velocities(ice: FloeBmi) -> list[np.ndarray]:
    """A smooth current of 0.2 m/s and a smooth wind of 10 m/s."""
    grid = ice.model.grid
    phase = 2 * np.pi * np.array([grid.x, grid.y]) / (grid.bounds[1] - grid.bounds[0])
    shear = np.sin(phase[1]), np.cos(phase[0])
    return [0.2 * shear[0], 0.2 * shear[1], 10.0 + shear[0], 2.0 * shear[1]]


def exchange(
    ice: FloeBmi, duration: float, given: list[np.ndarray], outputs: Sequence[str]
) -> tuple[int, float]:
    """One exchange as a host makes it: the steps taken, and the wall time [s]."""
    cells, one = np.empty(ice.model.grid.size), np.empty(1)
    before, begin = ice.model.counters.steps, time.perf_counter()
    for name, values in zip(INPUTS, given, strict=True):
        ice.set_value(name, values)
    ice.update_until(ice.get_current_time() + duration)
    for name in outputs:
        ice.get_value(name, one if ice.get_var_grid(name) == 1 else cells)
    return ice.model.counters.steps - before, time.perf_counter() - begin


def measure(ice: FloeBmi, outputs: Sequence[str], repeats: int) -> np.ndarray:
    """The overhead [s] and the cost of a step [s], of each repeat."""
    given, rows, step = velocities(ice), [], ice.model.longest_step()
    for _ in range(repeats):
        several = [exchange(ice, 2 * step, given, outputs) for _ in range(SHORT)]
        few, short = np.mean(several, axis=0)
        many, long = exchange(ice, 150 * step, given, outputs)
        cost = (long - short) / (many - few)
        rows.append((short - few * cost, cost))
    return np.array(rows)


def profile(ice: FloeBmi, outputs: Sequence[str], times: int) -> dict[str, float]:
    """Seconds per short exchange in each part."""
    given, step = velocities(ice), ice.model.longest_step()
    watch = cProfile.Profile()
    watch.enable()
    for _ in range(times):
        exchange(ice, step, given, outputs)
    watch.disable()
    spent: dict[str, float] = {}
    for (file, _, name), (_, _, _, total, _) in pstats.Stats(watch).stats.items():
        if name in PARTS and "floebmi" in file:
            spent[name] = max(spent.get(name, 0.0), total / times)
    return spent


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--floes", type=whole, default=10_000)
    parser.add_argument("--cells", type=whole, default=200, help="along a side")
    parser.add_argument("--repeats", type=whole, default=15)
    options = parser.parse_args()
    components = {name: start(*case, options.floes, options.cells) for name, case in CASES.items()}
    for name, ice in components.items():
        print(f"{name}: {len(ice.model.floes)} floes, {options.cells} × {options.cells} cells")
        for what, outputs in (
            ("two stresses", OUTPUTS),
            ("all outputs", ice.get_output_var_names()),
        ):
            measure(ice, outputs, 1)
            rows = measure(ice, outputs, options.repeats)
            ratio = rows[:, 0] / rows[:, 1]
            print(
                f"  {what}: overhead {1e3 * np.median(rows[:, 0]):.1f} ms, "
                f"step {1e3 * np.median(rows[:, 1]):.2f} ms, "
                f"ratio {np.median(ratio):.1f} ({ratio.min():.1f} … {ratio.max():.1f})"
            )
    for name, ice in components.items():
        print(f"{name}, ms per exchange of one step, all outputs:")
        spent = profile(ice, ice.get_output_var_names(), options.repeats)
        for part, what in PARTS.items():
            if part in spent:
                print(f"  {1e3 * spent[part]:6.2f}  {what}")


if __name__ == "__main__":
    run(main)
