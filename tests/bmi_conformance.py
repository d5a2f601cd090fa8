"""What a BMI component of sea ice must do, call by call; each breach is one line.

`bmi-tester` checks that calls return something of the right kind.  This checks that they mean something: that
`update` moves, pointers live, x is x, units and signs are right, what ice and ocean exchange is conserved, a
refused call leaves no trace.  It asks only through BMI, so it works on any component with these names.
"""

import sys
import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
from bmipy import Bmi

OCEAN = tuple(f"sea_surface_water_flowing__{a}_component_of_velocity" for a in "xy")
WIND = tuple(f"sea_surface_air_flowing__{a}_component_of_velocity" for a in "xy")
DRIFT = tuple(f"sea_ice_flowing__{a}_component_of_velocity" for a in "xy")
ON_OCEAN = tuple(f"sea_ice_bottom_water_flowing__{a}_z_component_of_stress" for a in "xy")
PER_ICE = tuple(f"sea_ice_floe_bottom_water_flowing__{a}_z_component_of_stress" for a in "xy")
OF_AIR = tuple(f"sea_ice_top_air_flowing__{a}_z_component_of_stress" for a in "xy")
IMPULSE = tuple(
    f"sea_ice_bottom_water_flowing__time_integral_of_{a}_z_component_of_stress" for a in "xy"
)
MAGNITUDE = "sea_ice_bottom_water_flowing__time_average_of_magnitude_of_stress"
FRACTION, MASS = "sea_ice__area_fraction", "sea_ice__mass-per-area_density"
WHOLE_MASS = "sea_ice__domain_integral_of_mass"
MOMENTUM = tuple(f"sea_ice_flowing__domain_integral_of_{a}_component_of_momentum" for a in "xy")
GIVEN = tuple(
    (
        f"sea_ice_bottom_water_flowing__domain_time_integral_of_{a}_component_of_undelivered_stress",
        f"sea_ice_top_air_flowing__domain_time_integral_of_{a}_z_component_of_stress",
        f"sea_ice_flowing__domain_time_integral_of_{a}_component_of_other_force",
    )
    for a in "xy"
)
UNITS = (  # (part of a name, units); the first that fits
    ("divergence_of_stress", "Pa"),
    ("undelivered_stress", "N s"),
    ("domain_time_integral_of", "N s"),
    ("time_integral_of", "Pa s"),
    ("z_integral_of", "N m-1"),
    ("stress", "Pa"),
    ("linear_drag_coefficient", "kg m-2 s-1"),
    ("component_of_velocity", "m s-1"),
    ("area_fraction", "1"),
    ("mass-per-area", "kg m-2"),
    ("component_of_momentum", "N s"),
    ("thickness", "m"),
    ("count", "1"),
)
TYPES = ("float64", "float32", "int64", "int32")
GRIDS = ("uniform_rectilinear", "rectilinear", "unstructured", "scalar")

Factory = Callable[[], Bmi]


def check_bmi(factory: Factory, config: str) -> list[str]:
    """All breaches of the contract; empty for a component that keeps it."""
    return list(violations(factory, config))


def violations(factory: Factory, config: str, only: str = "") -> Iterator[str]:
    """The same, one after the other, by all checks or one of them."""
    for check in CHECKS:
        if only not in ("", check.__name__):
            continue
        try:
            for text in check(factory, str(config)):
                yield f"{check.__name__}: {text}"
        except Exception as error:  # noqa: BLE001, whatever it is, it is a breach
            yield f"{check.__name__}: raised {type(error).__name__}: {error}"


# ---- helpers ----------------------------------------------------------------------------------


def started(factory: Factory, config: str) -> Bmi:
    bmi = factory()
    bmi.initialize(config)
    return bmi


def names_of(bmi: Bmi) -> tuple[str, ...]:
    return (*bmi.get_input_var_names(), *bmi.get_output_var_names())


def size_of(bmi: Bmi, name: str) -> int:
    grid = bmi.get_var_grid(name)
    if bmi.get_var_location(name) == "face":
        return bmi.get_grid_face_count(grid)
    return bmi.get_grid_size(grid)


def value(bmi: Bmi, name: str) -> np.ndarray:
    return bmi.get_value(name, np.empty(size_of(bmi, name), bmi.get_var_type(name)))


def everything(bmi: Bmi) -> dict[str, np.ndarray]:
    return {name: value(bmi, name) for name in names_of(bmi)} | {
        "time": np.array([bmi.get_current_time()])
    }


def differing(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> list[str]:
    if set(one) != set(other):
        return sorted(set(one) ^ set(other))
    return [name for name in one if not np.array_equal(one[name], other[name], equal_nan=True)]


def refusal(call: Callable[[], object], *words: str) -> list[str]:
    """Breaches of: the call raises, and its one line has these words."""
    try:
        call()
    except Exception as error:  # noqa: BLE001, any kind, the text counts
        text = str(error)
        if not text or "\n" in text:
            return [f"its error is not one line: {text!r}"]
        return [f"{word!r} is not in its error {text!r}" for word in words if word not in text]
    return ["was not refused"]


def areas(bmi: Bmi, name: str) -> np.ndarray | None:
    """Areas of the cells under a variable, None where BMI does not tell them."""
    grid = bmi.get_var_grid(name)
    if bmi.get_grid_type(grid) == "uniform_rectilinear":
        return np.full(bmi.get_grid_size(grid), bmi.get_grid_spacing(grid, np.empty(2)).prod())
    if bmi.get_var_location(name) == "face":
        return signed_areas(bmi, grid)
    return None


def mesh(bmi: Bmi, grid: int, kind: type = np.int64) -> dict[str, np.ndarray]:
    faces, edges = bmi.get_grid_face_count(grid), bmi.get_grid_edge_count(grid)
    count = np.empty(faces, kind)
    bmi.get_grid_nodes_per_face(grid, count)
    corners = int(count.sum())
    return {
        "count": count,
        "face_nodes": bmi.get_grid_face_nodes(grid, np.empty(corners, kind)),
        "face_edges": bmi.get_grid_face_edges(grid, np.empty(corners, kind)),
        "edge_nodes": bmi.get_grid_edge_nodes(grid, np.empty(2 * edges, kind)),
    }


def next_corner(count: np.ndarray) -> np.ndarray:
    """For each corner of each face, the place of the corner that follows it."""
    end = np.cumsum(count)
    following = np.arange(1, count.sum() + 1)
    following[end - 1] = end - count
    return following


def signed_areas(bmi: Bmi, grid: int) -> np.ndarray:
    parts, nodes = mesh(bmi, grid), bmi.get_grid_node_count(grid)
    x, y = bmi.get_grid_x(grid, np.empty(nodes)), bmi.get_grid_y(grid, np.empty(nodes))
    here = parts["face_nodes"]
    there = here[next_corner(parts["count"])]
    cross = x[here] * y[there] - x[there] * y[here]
    return 0.5 * np.add.reduceat(cross, np.cumsum(parts["count"]) - parts["count"])


# ---- the checks -------------------------------------------------------------------------------


def before_initialize(factory: Factory, config: str) -> Iterator[str]:
    bmi = factory()
    yield from names(bmi)
    if not bmi.get_component_name():
        yield "no component name"
    for what, call in {
        "update": bmi.update,
        "update_until": lambda: bmi.update_until(1e9),
        "get_value": lambda: bmi.get_value(FRACTION, np.empty(1)),
        "get_current_time": bmi.get_current_time,
        "set_value": lambda: bmi.set_value(OCEAN[0], np.zeros(1)),
    }.items():
        for breach in refusal(call, "initialize"):
            yield f"{what}: {breach}"


def names(bmi: Bmi) -> Iterator[str]:
    inputs, outputs = bmi.get_input_var_names(), bmi.get_output_var_names()
    if not inputs or not outputs:
        yield "no names"
    if len(inputs) != bmi.get_input_item_count() or len(outputs) != bmi.get_output_item_count():
        yield "item counts are not the numbers of names"
    if len(set(inputs) | set(outputs)) != len(inputs) + len(outputs):
        yield "a name stands twice, or is input and output"
    for name in (*OCEAN, *WIND):
        if name not in inputs:
            yield f"{name} is not an input"
    for name in (*DRIFT, *ON_OCEAN, *PER_ICE, *OF_AIR, *IMPULSE, FRACTION, MASS, *MOMENTUM):
        if name not in outputs:
            yield f"{name} is not an output"


def clock(factory: Factory, config: str) -> Iterator[str]:
    bmi = started(factory, config)
    yield from names(bmi)
    times = bmi.get_start_time(), bmi.get_current_time(), bmi.get_end_time(), bmi.get_time_step()
    if any(type(time) is not float for time in times):
        yield f"times are not Python floats: {times}"
    start, current, end, step = times
    if start != 0.0 or current != start or not step > 0 or not end > start:
        yield f"start, current, end, step = {times}"
    if bmi.get_time_units() != "s":
        yield f"time units {bmi.get_time_units()!r}"


def variables(factory: Factory, config: str) -> Iterator[str]:
    bmi = started(factory, config)
    for name in names_of(bmi):
        kind, size = bmi.get_var_type(name), size_of(bmi, name)
        if kind not in TYPES:
            yield f"{name}: type {kind!r}"
        if bmi.get_var_itemsize(name) != np.dtype(kind).itemsize:
            yield f"{name}: itemsize {bmi.get_var_itemsize(name)} of {kind}"
        if bmi.get_var_nbytes(name) != np.dtype(kind).itemsize * size:
            yield f"{name}: nbytes {bmi.get_var_nbytes(name)} of {size} {kind}"
        pointer = bmi.get_value_ptr(name)
        if pointer.dtype != kind or pointer.shape != (size,) or not pointer.flags.c_contiguous:
            yield f"{name}: pointer {pointer.dtype} {pointer.shape} where {kind} ({size},) is promised"
        if bmi.get_var_location(name) not in ("node", "face"):
            yield f"{name}: location {bmi.get_var_location(name)!r}"
        units = next((units for part, units in UNITS if part in name), None)
        if units is not None and bmi.get_var_units(name) != units:
            yield f"{name}: units {bmi.get_var_units(name)!r}, not {units!r}"
        if not np.isfinite(value(bmi, name)).all():
            yield f"{name}: not finite right after initialize"
    for call in (bmi.get_var_units, bmi.get_var_type, bmi.get_var_grid, bmi.get_value_ptr):
        for breach in refusal(lambda call=call: call("sea_ice__thicknes"), "sea_ice__thicknes"):
            yield f"{call.__name__} of an unknown name: {breach}"
    if len({bmi.get_var_grid(name) for name in (*ON_OCEAN, *OCEAN, FRACTION)}) > 1:
        yield "the ocean's variables are on several grids"


def grids(factory: Factory, config: str) -> Iterator[str]:
    bmi = started(factory, config)
    found = {bmi.get_var_grid(name) for name in names_of(bmi)}
    for grid in found:
        kind = bmi.get_grid_type(grid)
        if type(grid) is not int or kind not in GRIDS:
            yield f"grid {grid!r} of type {kind!r}"
        if type(bmi.get_grid_size(grid)) is not int or bmi.get_grid_size(grid) < 1:
            yield f"grid {grid}: size {bmi.get_grid_size(grid)!r}"
        if bmi.get_grid_rank(grid) != (0 if kind == "scalar" else 2):
            yield f"grid {grid}: rank {bmi.get_grid_rank(grid)} of {kind}"
        if bmi.get_grid_node_count(grid) != bmi.get_grid_size(grid):
            yield f"grid {grid}: node count is not the size"
        if kind == "unstructured":
            yield from polygons(bmi, grid)
        elif kind != "scalar":
            yield from rectangles(bmi, grid)
    for breach in refusal(lambda: bmi.get_grid_type(max(found) + 17)):
        yield f"unknown grid: {breach}"


def rectangles(bmi: Bmi, grid: int) -> Iterator[str]:
    for kind in (np.int32, np.int64):
        shape = np.zeros(2, kind)
        if bmi.get_grid_shape(grid, shape) is not shape or shape.prod() != bmi.get_grid_size(grid):
            yield f"grid {grid}: shape {shape} of {bmi.get_grid_size(grid)} nodes"
    axes = []
    for call, size in ((bmi.get_grid_y, shape[0]), (bmi.get_grid_x, shape[1])):
        buffer = np.full(size, np.nan)
        if call(grid, buffer) is not buffer:
            yield f"grid {grid}: {call.__name__} did not return its buffer"
        if not (np.diff(buffer) > 0).all() or not np.isfinite(buffer).all():
            yield f"grid {grid}: {call.__name__} does not grow"
        axes.append(buffer)
    if bmi.get_grid_type(grid) != "uniform_rectilinear":
        return
    spacing, origin = np.full(2, np.nan), np.full(2, np.nan)
    if bmi.get_grid_spacing(grid, spacing) is not spacing or not (spacing > 0).all():
        yield f"grid {grid}: spacing {spacing}"
    if bmi.get_grid_origin(grid, origin) is not origin:
        yield f"grid {grid}: origin is not in its buffer"
    for axis, step, first in zip(axes, spacing, origin, strict=True):
        if not np.allclose(axis, first + step * np.arange(axis.size), rtol=1e-12, atol=1e-9 * step):
            yield f"grid {grid}: {axis} is not from {first} by {step}"


def polygons(bmi: Bmi, grid: int) -> Iterator[str]:
    nodes, edges = bmi.get_grid_node_count(grid), bmi.get_grid_edge_count(grid)
    for parts in (mesh(bmi, grid, np.int32), mesh(bmi, grid)):
        if not parts["count"].size:  # floes are points
            return
        if (parts["count"] < 3).any():
            yield f"grid {grid}: a face with fewer than 3 nodes"
        for name, top in (("face_nodes", nodes), ("edge_nodes", nodes), ("face_edges", edges)):
            if parts[name].min() < 0 or parts[name].max() >= top:
                yield f"grid {grid}: {name} beyond 0 … {top - 1}"
    if not (signed_areas(bmi, grid) > 0).all():
        yield f"grid {grid}: faces are not counter-clockwise"
    ends = np.sort(parts["edge_nodes"].reshape(-1, 2), axis=1)
    if len(np.unique(ends, axis=0)) != edges:
        yield f"grid {grid}: an edge stands twice"
    here = parts["face_nodes"]
    there = here[next_corner(parts["count"])]
    if not np.array_equal(ends[parts["face_edges"]], np.sort(np.stack([here, there], 1), axis=1)):
        yield f"grid {grid}: face_edges do not join the face_nodes"
    if len(np.unique(parts["face_edges"])) != edges:
        yield f"grid {grid}: an edge of no face"


def getters(factory: Factory, config: str) -> Iterator[str]:
    bmi = started(factory, config)
    for name in names_of(bmi):
        size, pointer = size_of(bmi, name), bmi.get_value_ptr(name)
        if not np.shares_memory(pointer, bmi.get_value_ptr(name)):
            yield f"{name}: two pointers to two arrays"
        buffer = np.full(size, -7.25).astype(pointer.dtype)
        if bmi.get_value(name, buffer) is not buffer or not np.array_equal(buffer, pointer):
            yield f"{name}: get_value did not fill and return its buffer"
        buffer += 1
        if np.array_equal(buffer, pointer) or np.shares_memory(buffer, pointer):
            yield f"{name}: get_value gave the array itself"
        for breach in refusal(
            lambda name=name, size=size: bmi.get_value(name, np.empty(size + 1)), name
        ):
            yield f"{name}: a buffer too long {breach}"
        inds = np.array([size - 1, 0], np.int32)
        some = np.empty(2, pointer.dtype)
        if bmi.get_value_at_indices(name, some, inds) is not some:
            yield f"{name}: get_value_at_indices did not return its buffer"
        if not np.array_equal(some, pointer[inds]):
            yield f"{name}: get_value_at_indices {some}, not {pointer[inds]}"
        for wrong in (-1, size):
            call = partial(bmi.get_value_at_indices, name, np.empty(1), np.array([wrong]))
            for breach in refusal(call, name, str(wrong)):
                yield f"{name}: index {wrong} {breach}"


def setters(factory: Factory, config: str) -> Iterator[str]:
    bmi, rng = started(factory, config), np.random.default_rng(1)
    pointers = {name: bmi.get_value_ptr(name) for name in bmi.get_input_var_names()}
    outputs = {name: value(bmi, name) for name in bmi.get_output_var_names()}
    for name, pointer in pointers.items():
        others = {other: value(bmi, other) for other in pointers if other != name}
        given = rng.uniform(-1e-3, 1e-3, pointer.size)
        source = given.copy()
        bmi.set_value(name, source)
        source[:] = 99.0
        if not np.array_equal(value(bmi, name), given) or not np.array_equal(pointer, given):
            yield f"{name}: set_value did not copy the values into the live array"
        bmi.set_value(name, given.astype(np.float32))
        if not np.array_equal(pointer, given.astype(np.float32).astype(float)):
            yield f"{name}: set_value did not cast float32"
        bmi.set_value_at_indices(name, np.array([pointer.size - 1, 1]), np.array([2e-3, 3e-3]))
        if pointer[-1] != 2e-3 or pointer[1] != 3e-3:
            yield f"{name}: set_value_at_indices"
        before = value(bmi, name)
        bad, nan = np.zeros(pointer.size), np.zeros(pointer.size)
        nan[2] = np.nan
        every, some = bmi.set_value, bmi.set_value_at_indices
        for what, call, given, words in (
            ("too few values", every, (bad[1:],), ()),
            ("NaN", every, (nan,), ("2",)),
            ("infinity", every, (np.full(bad.size, np.inf),), ()),
            ("text", every, (bad.astype(str),), ()),
            ("index −1", some, ([-1], [0.0]), ("-1",)),
            ("NaN at index 2", some, ([2], [np.nan]), ("2",)),
            ("two values for one index", some, ([0], [0.0, 1.0]), ()),
        ):
            for breach in refusal(partial(call, name, *given), name, *words):
                yield f"{name}: {what} {breach}"
        if not np.array_equal(value(bmi, name), before):
            yield f"{name}: a refused set_value left its trace"
        if differing(others, {other: value(bmi, other) for other in others}):
            yield f"{name}: set_value changed another input"
    if differing(outputs, {name: value(bmi, name) for name in outputs}):
        yield "set_value changed outputs"
    for breach in refusal(lambda: bmi.set_value(FRACTION, value(bmi, FRACTION)), FRACTION):
        yield f"set_value of an output {breach}"
    given = {name: value(bmi, name) for name in pointers}
    bmi.update()
    if differing(given, {name: value(bmi, name) for name in given}):
        yield "update changed what the host had set"


def updates(factory: Factory, config: str) -> Iterator[str]:
    bmi = started(factory, config)
    step, pointers = bmi.get_time_step(), {n: bmi.get_value_ptr(n) for n in names_of(bmi)}
    before = everything(bmi)
    if bmi.update() is not None or bmi.get_current_time() != step:
        yield f"update: from 0 to {bmi.get_current_time()}, not {step}"
    still = set(before) - set(differing(before, everything(bmi)))
    for name in (*DRIFT, *ON_OCEAN, *OF_AIR, *IMPULSE, *MOMENTUM):
        if name in still:
            yield f"update: {name} did not move"
    bmi.update()
    for name, pointer in pointers.items():
        if not np.array_equal(pointer, value(bmi, name)):
            yield f"{name}: the pointer is dead after update"
    odd = 2 * step + 0.3 * step
    bmi.update_until(odd)
    if bmi.get_current_time() != odd:
        yield f"update_until({odd}) landed on {bmi.get_current_time()}"
    now = everything(bmi)
    bmi.update_until(odd)
    for text in differing(now, everything(bmi)):
        yield f"update_until(now) changed {text}"
    for time in (0.0, np.nextafter(odd, 0.0), np.nan, np.inf, -1.0):
        for breach in refusal(lambda time=time: bmi.update_until(time)):
            yield f"update_until({time}): {breach}"
    for text in differing(now, everything(bmi)):
        yield f"a refused update_until changed {text}"
    old = {name: value(bmi, name) for name in IMPULSE}
    bmi.update_until(odd + 2.5 * step)
    for stress, impulse in zip(ON_OCEAN, IMPULSE, strict=True):
        mean = (value(bmi, impulse) - old[impulse]) / (2.5 * step)
        if not np.allclose(value(bmi, stress), mean, rtol=1e-9, atol=1e-12 * np.abs(mean).max()):
            yield f"{stress}: not the mean since the last update"
    one, other = started(factory, config), started(factory, config)
    one.update()
    one.update()
    other.update_until(2 * step)
    for name in (*IMPULSE, *DRIFT, *MOMENTUM):
        if not np.array_equal(value(one, name), value(other, name)):
            yield f"update twice and update_until differ in {name}"


def signs(factory: Factory, config: str) -> Iterator[str]:
    for q in (0, 1):
        for given, stress, sense in ((OCEAN, ON_OCEAN, -1.0), (WIND, OF_AIR, 1.0)):
            bmi = started(factory, config)
            for name in bmi.get_input_var_names():
                bmi.set_value(name, np.zeros(size_of(bmi, name)))
            strength = 0.5 if given is OCEAN else 20.0
            bmi.set_value(given[q], np.full(size_of(bmi, given[q]), strength))
            before = value(bmi, MOMENTUM[q])[0]
            bmi.update()
            total = [value(bmi, name).sum() for name in stress]
            if not sense * total[q] > 0 or abs(total[1 - q]) > 0.3 * abs(total[q]):
                yield f"{given[q]} = {strength}: sums of {stress} are {total}"
            if not value(bmi, MOMENTUM[q])[0] > before:
                yield f"{given[q]} = {strength}: {MOMENTUM[q]} did not grow"
            mass = value(bmi, MASS)
            if not (value(bmi, DRIFT[q]) * mass).sum() > 0:
                yield f"{given[q]} = {strength}: {DRIFT[q]} does not follow"
            if (
                np.abs(value(bmi, ON_OCEAN[q])) > value(bmi, MAGNITUDE) * (1 + 1e-12) + 1e-300
            ).any():
                yield f"|{ON_OCEAN[q]}| is larger than {MAGNITUDE}"


def conservation(factory: Factory, config: str) -> Iterator[str]:
    bmi, rng = started(factory, config), np.random.default_rng(2)
    for name in (*OCEAN, *WIND):
        scale = 0.5 if name in OCEAN else 15.0
        bmi.set_value(name, rng.uniform(-scale, scale, size_of(bmi, name)))
    cells = areas(bmi, FRACTION)
    for k in range(3):
        old = everything(bmi)
        bmi.update()
        new = everything(bmi)
        dt = new["time"][0] - old["time"][0]
        fraction = new[FRACTION]
        if (fraction < 0).any() or (fraction > 1).any():
            yield f"{FRACTION} is not in 0 … 1"
        for q in (0, 1):
            mean = (new[IMPULSE[q]] - old[IMPULSE[q]]) / dt
            scale = np.abs(new[IMPULSE[q]]).max() / dt
            if not np.allclose(mean, new[ON_OCEAN[q]], rtol=1e-9, atol=1e-11 * scale):
                yield f"{ON_OCEAN[q]} is not the change of {IMPULSE[q]} over time"
            per_ice = new[PER_ICE[q]] * fraction
            full = (fraction >= 1.0) | (fraction <= 0.0)
            if not np.allclose(
                per_ice[~full], new[ON_OCEAN[q]][~full], rtol=1e-9, atol=1e-12 * scale
            ):
                yield f"{PER_ICE[q]} × {FRACTION} is not {ON_OCEAN[q]}"
            if cells is None:
                continue
            lost = -((new[IMPULSE[q]] - old[IMPULSE[q]]) * cells).sum()
            unplaced, wind, other = ((new[n] - old[n])[0] for n in GIVEN[q])
            change = (new[MOMENTUM[q]] - old[MOMENTUM[q]])[0]
            turnover = sum(map(abs, (lost, unplaced, wind, other, change)))
            turnover += max(np.abs(new[MOMENTUM[q]])[0], np.abs(new[IMPULSE[q]] * cells).sum())
            if not abs(change - (lost - unplaced + wind + other)) <= 1e-11 * turnover:
                yield f"update {k + 1}: momentum along {'xy'[q]} is not conserved"
            wind_cells = areas(bmi, OF_AIR[q])
            if wind_cells is not None:
                given = (new[OF_AIR[q]] * wind_cells).sum() * dt
                if not abs(given - wind) <= 1e-9 * (np.abs(new[OF_AIR[q]]) * wind_cells).sum() * dt:
                    yield f"{OF_AIR[q]}: its integral is not what the wind gave"
        if cells is not None:
            whole = new[WHOLE_MASS][0]
            if not abs((new[MASS] * cells).sum() - whole) <= 1e-10 * whole:
                yield f"{MASS}: its integral is not {WHOLE_MASS}"


def independence(factory: Factory, config: str) -> Iterator[str]:
    one, other = started(factory, config), started(factory, config)
    first = everything(one)
    for text in differing(first, everything(other)):
        yield f"two instances start with different {text}"
    one.set_value(OCEAN[0], np.full(size_of(one, OCEAN[0]), 0.3))
    one.update()
    for text in differing(first, everything(other)):
        yield f"another instance changed {text}"
    other.set_value(OCEAN[0], np.full(size_of(other, OCEAN[0]), 0.3))
    other.update()
    for text in differing(everything(one), everything(other)):
        yield f"the same calls gave different {text}"
    one.finalize()
    other.update()
    if other.get_current_time() != 2 * other.get_time_step():
        yield "finalize of one instance stopped the other"


def ending(factory: Factory, config: str) -> Iterator[str]:
    bmi = started(factory, config)
    first = everything(bmi)
    bmi.update()
    bmi.finalize()
    for what, call in {
        "update": bmi.update,
        "update_until": lambda: bmi.update_until(sys.float_info.max),
        "get_value_ptr": lambda: bmi.get_value_ptr(FRACTION),
        "get_current_time": bmi.get_current_time,
    }.items():
        for breach in refusal(call, "initialize"):
            yield f"{what} after finalize: {breach}"
    bmi.initialize(config)
    for text in differing(first, everything(bmi)):
        yield f"initialize after finalize starts with another {text}"
    bmi.finalize()


def restart(factory: Factory, config: str) -> Iterator[str]:
    bmi = started(factory, config)
    bmi.update_until(1.5 * bmi.get_time_step())
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "state.nc"
        bmi.save_state(file)
        saved = everything(bmi)
        bmi.update()
        after = everything(bmi)
        fresh = started(factory, config)
        for other in (bmi, fresh):
            pointers = {name: other.get_value_ptr(name) for name in names_of(other)}
            other.load_state(file)
            for text in differing(saved, everything(other)):
                yield f"load_state: another {text}"
            other.update()
            for text in differing(after, everything(other)):
                yield f"load_state: after an update another {text}"
            for name, pointer in pointers.items():
                if not np.array_equal(pointer, value(other, name)):
                    yield f"{name}: the pointer is dead after load_state"
        for breach in refusal(lambda: fresh.load_state(Path(folder) / "none.nc"), "none.nc"):
            yield f"load_state of a missing file: {breach}"
        for text in differing(after, everything(fresh)):
            yield f"a refused load_state changed {text}"


CHECKS = (
    before_initialize,
    clock,
    variables,
    grids,
    getters,
    setters,
    updates,
    signs,
    conservation,
    independence,
    ending,
    restart,
)
