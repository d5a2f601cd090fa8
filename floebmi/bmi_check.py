"""Is a host connected rightly?  One cell of ice, and one cell of stress.

    python -m floebmi.bmi_check                                   what the ice gives in one cell: signs and units
    python -m floebmi.bmi_check package.module:Host config.toml   pushes a BMI host in one cell, and looks

The first says what a host must receive from a floe that is held in a known current.  The second takes a host with a
Basic Model Interface, wherever it runs, gives it a stress in one cell of its own and looks at what its velocity does:

    units      velocity is a velocity, stress is a stress, by what the host itself says
    axes       a stress along x does not push along y (in one step, but for rotation: less than f Δt)
    sign       a stress along +x (+y) on the ocean accelerates the ocean along +x (+y)
    size       Δu = τ Δt / (ρ h) gives a depth h; it should be that of the layer which the ice pushes
    staggering the velocity changes where the stress is, not half a cell beside it

A host without a BMI can be wrapped in the few functions that are called here: initialize, update, get_var_units,
get_var_grid, get_grid_size, get_grid_shape, get_time_step, get_value, set_value.
"""

import argparse
import importlib
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from bmipy import Bmi

from floebmi.bmi import FloeBmi
from floebmi.errors import InputError, choose

VELOCITY = tuple(f"sea_surface_water_flowing__{a}_component_of_velocity" for a in "xy")
STRESS = tuple(f"sea_ice_bottom_water_flowing__{a}_z_component_of_stress" for a in "xy")
PUSH = 0.1  # [Pa]
SEA_WATER = 1026.0  # [kg m-3]
CURRENT = (0.1, -0.05)  # [m s-1]
ASIDE = 0.2  # of a response: more than this across the push is no rotation of the earth
BESIDE = 0.25  # of a cell: a response that is further away is staggered

SCENE = """
[domain]
x = [0.0, 2000.0]
y = [0.0, 2000.0]
edges = "inactive"
[grid]
shape = [1, 1]
[floes]
arrangement = "list"
each = [{ x = 1000.0, y = 1000.0, radius = 500.0, thickness = 1.0, motion = "fixed" }]
[ocean]
drag = "constant-cd"
[time]
exchange = 600.0
"""


class Answer(NamedTuple):
    """One thing that was looked at: passed, and what was found, in words."""

    what: str
    passed: bool
    text: str


def one_cell() -> list[Answer]:
    """A floe held in one cell of moving water: what the ice reads, and what it gives back.

    The stress per cell area must be −ρ C_d a |u| u (eq. ocean-drag), and its integral over time the same impulse.
    """
    ice = FloeBmi()
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "one-cell.toml"
        scene.write_text(SCENE, encoding="utf-8")
        ice.initialize(str(scene))
    for name, value in zip(VELOCITY, CURRENT, strict=True):
        ice.set_value(name, np.array([value]))
    ice.update()
    fraction = ice.get_value("sea_ice__area_fraction", np.empty(1))[0]
    speed = np.hypot(*CURRENT)
    answers = []
    for name, current in zip(STRESS, CURRENT, strict=True):
        stress = ice.get_value(name, np.empty(1))[0]
        expected = -SEA_WATER * 5.5e-3 * fraction * speed * current
        answers.append(
            Answer(
                name,
                bool(abs(stress - expected) <= 1e-12 * abs(expected)),
                f"{stress:+.6g} {ice.get_var_units(name)} in a current of {current:+g} m s-1 along the same axis:"
                f" held ice holds the water back (a = {fraction:.4f}; expected {expected:+.6g})",
            )
        )
    return answers


def check_host(
    make: Callable[[], Bmi],
    config: str,
    velocity: Sequence[str] = VELOCITY,
    stress: Sequence[str] = STRESS,
    density: float = SEA_WATER,
) -> list[Answer]:
    """Push a host in one cell along x, then along y, for one of its steps, and look at its velocity.

    Parameters
    ----------
    make : gives a new host, not initialized
    config : its configuration file
    velocity, stress : its outputs and inputs along (x, y)
    density : of its water [kg m-3], for the depth

    Raises
    ------
    InputError
        for a name that the host does not have, or a host that cannot be pushed.
    """
    answers = []
    host = _started(make, config)
    for names, all_names in (
        (velocity, host.get_output_var_names()),
        (stress, host.get_input_var_names()),
    ):
        for name in names:
            if name not in all_names:
                raise InputError(f"host: {name!r}: not there; {choose(name, all_names)}")
    for names, right in ((velocity, "m s-1"), (stress, "Pa")):
        for name in names:
            answers.append(_units(host, name, right))
    if not all(answer.passed for answer in answers):
        return answers
    shape = _shape(host, stress[0])
    quiet = _after(make, config, velocity, stress, None, shape)
    for axis, letter in enumerate("xy"):
        pushed = _after(make, config, velocity, stress, axis, shape)
        change = pushed - quiet
        along, across = change[axis], change[1 - axis]
        total, aside = along.sum(), across.sum()
        right = bool(abs(aside) < ASIDE * abs(total) or total == aside == 0)
        answers.append(
            Answer(
                f"axes, push along {letter}", right,
                f"{PUSH:g} Pa along +{letter} changes the water's velocity by {total:+.4g} m s-1 along it and"
                f" {aside:+.4g} m s-1 across it, in one step" + ("" if right else ": x and y are exchanged"),
            )
        )  # fmt: skip
        if not right:
            continue
        answers.append(
            Answer(
                f"sign along {letter}", bool(total > 0),
                "a positive stress accelerates the water" if total > 0
                else "the sign is turned: the host wants the stress on the ice" if total < 0
                else "nothing moves: the stress is not used",
            )
        )  # fmt: skip
        if not total > 0:
            continue
        depth = PUSH * host.get_time_step() / (density * total)
        answers.append(
            Answer(
                f"size along {letter}", bool(np.isfinite(depth)),
                f"as a layer of {depth:.4g} m with {density:g} kg m-3 would: is that the layer that the ice pushes?",
            )
        )  # fmt: skip
        j, i = np.indices(shape)
        middle = shape[0] // 2, shape[1] // 2
        offset = np.array(
            [(i * along).sum() / total - middle[1], (j * along).sum() / total - middle[0]]
        )
        answers.append(
            Answer(
                f"staggering along {letter}", bool(np.abs(offset).max() < BESIDE),
                f"the response is {offset[0]:+.3f}, {offset[1]:+.3f} cells (x, y) from the push"
                + ("" if np.abs(offset).max() < BESIDE else ": bring stress and velocity to the same points"),
            )
        )  # fmt: skip
    return answers


def _started(make: Callable[[], Bmi], config: str) -> Bmi:
    host = make()
    host.initialize(config)
    return host


def _units(host: Bmi, name: str, right: str) -> Answer:
    import cf_units

    told = host.get_var_units(name)
    try:
        fits = cf_units.Unit(told).is_convertible(cf_units.Unit(right))
    except ValueError:
        fits = False
    return Answer(
        f"units of {name}", fits, f"{told!r}" + ("" if fits else f": must be as {right!r}")
    )


def _shape(host: Bmi, name: str) -> tuple[int, int]:
    grid = host.get_var_grid(name)
    rows, columns = (int(n) for n in host.get_grid_shape(grid, np.empty(2, np.int32)))
    if min(rows, columns) < 3:
        raise InputError(
            f"host: grid {grid} is {rows} × {columns}: needs 3 cells each way to push one"
        )
    return rows, columns


def _after(
    make: Callable[[], Bmi],
    config: str,
    velocity: Sequence[str],
    stress: Sequence[str],
    axis: int | None,
    shape: tuple[int, int],
) -> np.ndarray:
    """Velocity (2, rows, columns) [m s-1] one step after a push in the middle cell, or after none."""
    import cf_units

    host = _started(make, config)
    for k, name in enumerate(stress):
        push = np.zeros(shape)
        if k == axis:
            unit = cf_units.Unit(host.get_var_units(name))
            push[shape[0] // 2, shape[1] // 2] = cf_units.Unit("Pa").convert(PUSH, unit)
        host.set_value(name, push.ravel())
    host.update()
    found = []
    for name in velocity:
        size = host.get_grid_size(host.get_var_grid(name))
        if size != shape[0] * shape[1]:
            raise InputError(
                f"host: {name} has {size} values, the stress {shape[0]} × {shape[1]}: for a one-cell test both"
                " must be on the same cells"
            )
        values = host.get_value(name, np.empty(size))
        found.append(
            cf_units.Unit(host.get_var_units(name)).convert(values, "m s-1").reshape(shape)
        )
    host.finalize()
    return np.array(found)


def main(words: Sequence[str] | None = None) -> int:
    """The command; 0 if all is well, 1 if something is wrong, 2 for wrong input."""
    parser = argparse.ArgumentParser(
        prog="python -m floebmi.bmi_check", description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("host", nargs="?", help="package.module:Class of a BMI host")
    parser.add_argument("config", nargs="?", help="its configuration file")
    parser.add_argument(
        "--velocity", nargs=2, default=VELOCITY, metavar=("X", "Y"), help="its outputs"
    )
    parser.add_argument("--stress", nargs=2, default=STRESS, metavar=("X", "Y"), help="its inputs")
    parser.add_argument("--density", type=float, default=SEA_WATER, help="of its water [kg m-3]")
    asked = parser.parse_args(words)
    try:
        answers = one_cell()
        if asked.host is not None:
            if asked.config is None:
                raise InputError("a host needs its configuration file: HOST CONFIG")
            answers += check_host(
                _found(asked.host), asked.config, asked.velocity, asked.stress, asked.density
            )
    except InputError as error:
        print(f"floebmi.bmi_check: {error}", file=sys.stderr)
        return 2
    for answer in answers:
        print(f"{'ok   ' if answer.passed else 'WRONG'} {answer.what}: {answer.text}")
    return 0 if all(answer.passed for answer in answers) else 1


def _found(place: str) -> type[Bmi]:
    module, _, name = place.partition(":")
    try:
        return getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError, ValueError) as error:
        raise InputError(f"host = {place!r}: {error}; must be package.module:Class") from None


if __name__ == "__main__":
    raise SystemExit(main())
