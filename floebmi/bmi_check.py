"""Is a host connected correctly?  A check in one cell.

    python -m floebmi.bmi_check                                   what the ice gives in one cell: signs and units
    python -m floebmi.bmi_check package.module:Host config.toml   applies a stress to one cell of a BMI host

The first prints the stress that a host must receive from a floe held still in a known current.  The second takes a host
with a Basic Model Interface, in this process or another, applies a stress to one of its cells, and checks the change of
its velocity:

    units      velocity and stress have units of a velocity and of a stress
    repeats    two runs without the stress give the same velocities, before and after a step; they are numbers
    axes       a stress along x does not act along y (in one step, except for rotation, less than f Δt)
    sign       a stress along +x (+y) on the ocean accelerates the ocean along +x (+y), in the same step
    size       prints the depth h from Δu = τ Δt / (ρ h); it should be that of the layer that the ice drags
    staggering the velocity changes where the stress is, not half a cell beside it, nor in a mirrored row or column
    per        for a host that also takes the ice fraction: whether it multiplies by it, as the name of its stress says

Cells whose velocity is not finite are land.  If waves cross the basin within a time step of the host, the response is
that of the waves: use a shorter step or a larger basin.  A host without a BMI can be wrapped in the few functions
that are called here: initialize, update, finalize, get_input_var_names, get_output_var_names, get_var_units,
get_var_type, get_var_grid, get_grid_type, get_grid_rank, get_grid_size, get_grid_shape, get_time_step, get_time_units,
get_value, set_value.
"""

import argparse
import importlib
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from bmipy import Bmi

from floebmi.bmi import FloeBmi
from floebmi.errors import InputError, choose
from floebmi.quantities import is_number
from floebmi.variables import find

if TYPE_CHECKING:
    import cf_units

VELOCITY = tuple(find(f"ocean_velocity_{a}").csdms for a in "xy")
STRESS = tuple(find(f"ocean_stress_{a}").csdms for a in "xy")
PER_ICE_AREA = tuple(find(f"ocean_stress_per_ice_area_{a}").csdms for a in "xy")
FRACTION = find("area_fraction").csdms
PUSH = 0.1  # [Pa]
SEA_WATER = 1026.0  # [kg m-3]
CURRENT = (0.1, -0.05)  # [m s-1]
ASIDE = 0.2  # of a response: more than this across the push is no rotation of the earth
BESIDE = 0.25  # of a cell: a response that is further away is staggered
LIKE = 0.1  # of a response under full ice: as near as that one under half of the ice is all, or half, of it

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
    fraction = ice.get_value(FRACTION, np.empty(1))[0]
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
    fraction: str | None = None,
    cell: Sequence[int] | None = None,
) -> list[Answer]:
    """Push a host in one cell along x, then along y, for one of its steps, and look at its velocity.

    Parameters
    ----------
    make : gives a new host, not initialized
    config : its configuration file
    velocity, stress : its outputs and inputs along (x, y)
    density : of its water [kg m-3], for the depth
    fraction : its input of the ice fraction; None: `sea_ice__area_fraction`, if it has that
    cell : (row, column) to push, a wet one; None: near the middle

    Raises
    ------
    InputError
        for a name that the host does not have, or a host that cannot be pushed.
    """
    if not (is_number(density) and density > 0):
        raise InputError(f"density = {density!r} kg m-3: must be greater than 0")
    host = _started(make, config)
    inputs = host.get_input_var_names()
    asked = (*stress,) if fraction is None else (*stress, fraction)
    for names, all_names in ((velocity, host.get_output_var_names()), (asked, inputs)):
        for name in names:
            if name not in all_names:
                raise InputError(f"host: {name!r}: not there; {choose(name, all_names)}")
    answers = [
        _units(host, name, right)
        for names, right in ((velocity, "m s-1"), (stress, "Pa"))
        for name in names
    ]
    if not all(answer.passed for answer in answers):
        return answers
    if fraction is None and FRACTION in inputs:
        fraction = FRACTION
    trial = _Trial(make, config, velocity, stress, fraction, _shape(host, stress[0]))
    row, column = place = trial.cell(cell)
    start, quiet = trial.run(None, place)
    same = all(
        np.array_equal(one, other, equal_nan=True)
        for one, other in zip((start, quiet), trial.run(None, place), strict=True)
    )
    wet = np.isfinite(quiet).all(axis=0)
    answers.append(
        Answer(
            "repeats", same and bool(wet[place]),
            "two starts without a push differ: velocities that nobody has set, or chance" if not same
            else f"two starts without a push give the same velocities, numbers in {wet.sum()} of {wet.size} cells"
            if wet[place]
            else f"the velocity in row {row}, column {column} is no number after a step ({(~wet).sum()} such cells of"
            f" {wet.size}): never set, or land; a wet cell can be chosen",
        )
    )  # fmt: skip
    if not answers[-1].passed:
        return answers
    step = host.get_time_step() * _unit(host.get_time_units()).convert(1.0, "s")
    for axis in (0, 1):
        answers += _along(trial, axis, place, quiet, step, density)
    return answers


def _along(
    trial: "_Trial",
    axis: int,
    place: tuple[int, int],
    quiet: np.ndarray,
    step: float,
    density: float,
) -> Iterator[Answer]:
    """What a push along an axis does to the water, for a step [s]: up to the first thing that is wrong.

    quiet : velocities (2, rows, columns) [m s-1] after a step without a push, no numbers on land
    density : of the water [kg m-3]
    """
    letter, wet, (row, column) = "xy"[axis], np.isfinite(quiet).all(axis=0), place
    pushed = trial.run(axis, place)[1]
    if not np.isfinite(pushed[:, wet]).all():
        yield Answer(
            f"axes, push along {letter}", False, "after the push velocities are no numbers"
        )
        return
    change = np.where(wet, pushed - quiet, 0.0)
    along, across = change[axis], change[1 - axis]
    total, aside = along.sum(), across.sum()
    right = bool(abs(aside) < ASIDE * abs(total) or total == aside == 0)
    yield Answer(
        f"axes, push along {letter}", right,
        f"{PUSH:g} Pa along +{letter} changes the water's velocity by {total:+.4g} m s-1 along it and"
        f" {aside:+.4g} m s-1 across it, in one step" + ("" if right else ": x and y are exchanged"),
    )  # fmt: skip
    if not right:
        return
    yield Answer(
        f"sign along {letter}", bool(total > 0),
        "a positive stress accelerates the water" if total > 0
        else "the sign is turned: the host wants the stress on the ice" if total < 0
        else "nothing moves in the step of the push, but in the next: the stress acts one step late"
        if trial.late(axis, place)
        else f"nothing moves: the stress is not used, or row {row}, column {column} is land",
    )  # fmt: skip
    if not total > 0:
        return
    depth = PUSH * step / (density * total)
    yield Answer(
        f"size along {letter}", bool(np.isfinite(depth)),
        f"as a layer of {depth:.4g} m with {density:g} kg m-3 would: is that the layer that the ice pushes?",
    )  # fmt: skip
    j, i = np.indices(trial.shape)
    offset = np.array([(i * along).sum() / total - column, (j * along).sum() / total - row])
    there = bool(np.abs(offset).max() < BESIDE)
    yield Answer(
        f"staggering along {letter}", there,
        f"the response is {offset[0]:+.3f}, {offset[1]:+.3f} cells (x, y) from the push"
        + ("" if there else ": bring stress and velocity to the same points"),
    )  # fmt: skip
    yield from _per(trial, axis, place, total)


def _per(trial: "_Trial", axis: int, place: tuple[int, int], total: float) -> list[Answer]:
    """Whether the host multiplies by the ice fraction; `total` is its response under full ice."""
    name, letter = trial.stress[axis], "xy"[axis]
    per_ice_area = name in PER_ICE_AREA
    if trial.fraction is None:
        text = (
            "is per ice area, and no ice fraction is told to the host that it could multiply it by"
        )
        return [Answer(f"per, along {letter}", False, f"{name} {text}")] if per_ice_area else []
    half = np.nansum(trial.run(axis, place, 0.5)[1][axis] - trial.run(None, place, 0.5)[1][axis])
    share = half / total
    found = next((right for right in (1.0, 0.5) if abs(share - right) < LIKE), None)
    known = per_ice_area or name in STRESS
    right = found is not None and not (known and per_ice_area != (found == 0.5))
    text = (
        f"under half of the ice the same stress does {share:.3g} of what it does under full ice: "
    )
    text += {
        1.0: "the host takes it per cell area",
        0.5: "the host multiplies by the fraction, and takes it per ice area",
    }.get(found, "that is neither per cell area (1) nor per ice area (0.5)")
    return [
        Answer(f"per, along {letter}", right, text + ("" if right else f"; its name is {name}"))
    ]


class _Trial(NamedTuple):
    """A host that can be started again and again: once for each push."""

    make: Callable[[], Bmi]
    config: str
    velocity: Sequence[str]
    stress: Sequence[str]
    fraction: str | None
    shape: tuple[int, int]

    def cell(self, asked: Sequence[int] | None) -> tuple[int, int]:
        """Row and column to push: near the middle, and not where a mirrored or transposed field has it as well."""
        rows, columns = self.shape
        if asked is None:
            return max(rows // 2 - 1, 1), columns - 1 - max(columns // 2 - 1, 1)
        row, column = asked
        if not (0 <= row < rows and 0 <= column < columns):
            raise InputError(
                f"cell = {row}, {column}: must be a row and a column from 0 of {rows} × {columns}"
            )
        return row, column

    def run(
        self, axis: int | None, place: tuple[int, int], share: float = 1.0, more: int = 0
    ) -> tuple[np.ndarray, np.ndarray]:
        """Velocities (2, rows, columns) [m s-1] at the start, and after a step with a push along an axis, or none.

        `share` is the ice fraction everywhere, `more` a number of steps after that one, without a push.
        """
        host = _started(self.make, self.config)
        start = self._velocities(host)
        if self.fraction is not None:
            size = host.get_grid_size(host.get_var_grid(self.fraction))
            told = _unit("1").convert(share, _unit(host.get_var_units(self.fraction)))
            host.set_value(self.fraction, np.full(size, told, host.get_var_type(self.fraction)))
        self._set(host, axis, place)
        host.update()
        for _ in range(more):
            self._set(host, None, place)
            host.update()
        after = self._velocities(host)
        host.finalize()
        return start, after

    def late(self, axis: int, place: tuple[int, int]) -> bool:
        """Whether a push moves something in the step after the one that it was for."""
        pushed, quiet = (self.run(which, place, more=1)[1] for which in (axis, None))
        return bool((np.nan_to_num(pushed - quiet) != 0).any())

    def _set(self, host: Bmi, axis: int | None, place: tuple[int, int]) -> None:
        for k, name in enumerate(self.stress):
            push = np.zeros(self.shape)
            if k == axis:
                push[place] = _unit("Pa").convert(PUSH, _unit(host.get_var_units(name)))
            host.set_value(name, push.ravel().astype(host.get_var_type(name)))

    def _velocities(self, host: Bmi) -> np.ndarray:
        found = []
        for name in self.velocity:
            size = host.get_grid_size(host.get_var_grid(name))
            if size != self.shape[0] * self.shape[1]:
                raise InputError(
                    f"host: {name} has {size} values, the stress {self.shape[0]} × {self.shape[1]}: for a one-cell"
                    " test both must be on the same cells"
                )
            # a host that leaves this as it is has set nothing
            values = np.full(size, np.nan, host.get_var_type(name))
            host.get_value(name, values)
            told = _unit(host.get_var_units(name)).convert(values.astype(np.float64), "m s-1")
            found.append(told.reshape(self.shape))
        return np.array(found)


def _started(make: Callable[[], Bmi], config: str) -> Bmi:
    host = make()
    host.initialize(config)
    return host


def _unit(text: str | None) -> "cf_units.Unit":
    import cf_units

    return cf_units.Unit((text or "").split(" since ")[0])


def _units(host: Bmi, name: str, right: str) -> Answer:
    told = host.get_var_units(name)
    try:
        fits = _unit(told).is_convertible(_unit(right))
    except ValueError:
        fits = False
    return Answer(
        f"units of {name}", fits, f"{told!r}" + ("" if fits else f": must be as {right!r}")
    )


def _shape(host: Bmi, name: str) -> tuple[int, int]:
    grid = host.get_var_grid(name)
    kind, rank = host.get_grid_type(grid), host.get_grid_rank(grid)
    if kind not in ("uniform_rectilinear", "rectilinear", "structured_quadrilateral") or rank != 2:
        raise InputError(
            f"host: grid {grid} is of type {kind!r} and rank {rank}: needs rows and columns to push a cell of them"
        )
    rows, columns = (int(n) for n in host.get_grid_shape(grid, np.empty(2, np.int32)))
    if min(rows, columns) < 3:
        raise InputError(
            f"host: grid {grid} is {rows} × {columns}: needs 3 cells each way to push one"
        )
    return rows, columns


def main(words: Sequence[str] | None = None) -> int:
    """The command; 0 if all is well, 1 if something is wrong, 2 for wrong input."""
    parser = argparse.ArgumentParser(
        prog="python -m floebmi.bmi_check", description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument(
        "host",
        nargs="?",
        help="class of a BMI host, as package.module:Class; without it, check the ice alone",
    )
    parser.add_argument("config", nargs="?", help="configuration file of the host")
    parser.add_argument(
        "--velocity",
        nargs=2,
        default=VELOCITY,
        metavar=("X", "Y"),
        help="outputs of the host: surface velocity along x and y",
    )
    parser.add_argument(
        "--stress",
        nargs=2,
        default=STRESS,
        metavar=("X", "Y"),
        help="inputs of the host: stress on the water along x and y",
    )
    parser.add_argument(
        "--density", type=float, default=SEA_WATER, help="density of its water [kg m-3]"
    )
    parser.add_argument("--fraction", metavar="A", help="input of the host for the ice fraction")
    parser.add_argument(
        "--cell",
        nargs=2,
        type=int,
        metavar=("ROW", "COLUMN"),
        help="cell to apply the stress to (default: near the middle)",
    )
    asked = parser.parse_args(words)
    try:
        answers = one_cell()
        if asked.host is not None:
            if asked.config is None:
                raise InputError("a host needs its configuration file: HOST CONFIG")
            answers += check_host(
                _found(asked.host),
                asked.config,
                asked.velocity,
                asked.stress,
                asked.density,
                asked.fraction,
                asked.cell,
            )
    except InputError as error:
        print(f"floebmi.bmi_check: {error}", file=sys.stderr)
        return 2
    except Exception as error:  # noqa: BLE001  whatever a host raises
        text = (str(error).splitlines() or [""])[0]
        print(
            f"floebmi.bmi_check: the host failed: {type(error).__name__}: {text}", file=sys.stderr
        )
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
