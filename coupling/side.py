"""One of the two models of a coupling, used through BMI only; its answers are checked."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np
from bmipy import Bmi

from coupling.cells import digest, grid_of, told_of
from coupling.units import in_seconds, read
from floebmi.errors import InputError, choose, is_word
from floebmi.grid import Grid

if TYPE_CHECKING:
    import cf_units

PART = 250_000  # values, with their indices, that fit into a gRPC message of 4 MiB
SAME_TIME = 1e-9  # of an exchange interval, in addition to the resolution of a clock


class CouplingError(RuntimeError):
    """Failure of a model in a coupled run; the line says which, when, and where the state is."""


@contextmanager
def in_one_line(where: str) -> Iterator[None]:
    """Report in one line a model that fails in the body, or whose process is gone."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        raise CouplingError(f"{where}: {first_line(error)}") from error


def same_time(one: float, other: float, every: float) -> bool:
    """Whether two times [s] are equal up to round-off; a clock that counts from long ago has coarse seconds."""
    return abs(one - other) <= SAME_TIME * every + 8 * np.spacing(max(abs(one), abs(other)))


def first_line(error: Exception) -> str:
    """The first line of an error, without what a server adds below it."""
    details = getattr(error, "details", None)  # where gRPC has its text
    text = str(details() if callable(details) else error) or type(error).__name__
    return text.splitlines()[0]


def is_too_long(error: Exception) -> bool:
    """Whether gRPC refused a message for its length."""
    code = getattr(error, "code", None)
    return callable(code) and getattr(code(), "name", "") == "RESOURCE_EXHAUSTED"


class Side:
    """One of the two models, used through BMI only; its answers are checked.

    Parameters
    ----------
    name : "host" or "floes"
    model : initialized
    units : of variables that report none or wrong ones
    grids : BMI grid number → `Grid`, where BMI does not give cells or mask

    Attributes
    ----------
    inputs, outputs : names of its variables
    """

    def __init__(
        self, name: str, model: Bmi, units: Mapping[str, str], grids: Mapping[int, Grid]
    ) -> None:
        self.name, self.model = name, model
        self._units, self._given = units, grids
        self._grids: dict[tuple[int, str], tuple[Grid, str, str]] = {}
        self._longest = np.inf  # number of values that may be set at once
        with in_one_line(f"couple: the {name}"):
            self.inputs = tuple(model.get_input_var_names())
            self.outputs = tuple(model.get_output_var_names())
            self._second = in_seconds(model.get_time_units(), name)

    def title(self) -> str:
        """The name of this side and that of the component."""
        return f"{self.name} {self.model.get_component_name()!r}"

    def time(self) -> float:
        """The time of its clock [s]."""
        # float: a time in single precision would make all further arithmetic single precision
        return float(self.model.get_current_time()) * self._second

    def start_time(self) -> float:
        """The start time of its clock [s]."""
        return float(self.model.get_start_time()) * self._second

    def end_time(self) -> float:
        """The latest time that it can reach [s]."""
        return float(self.model.get_end_time()) * self._second

    def update_until(self, time: float, every: float) -> None:
        """Update it to a time [s], step by step if it has no update_until; InputError if it does not stop there.

        every : the exchange interval [s]
        """
        try:
            self.model.update_until(time / self._second)
        except NotImplementedError:
            while self.time() < time and not same_time(self.time(), time, every):
                before = self.time()
                self.model.update()
                if self.time() <= before:
                    break
        landed = self.time()
        if not same_time(landed, time, every):
            went = "went back" if landed < time - every else "stands"
            raise InputError(
                f"the {self.name} {went} at {landed:.12g} s after an update to {time:.12g} s"
                f" (its own step is {self.model.get_time_step() * self._second:g} s)"
            )

    def units(self, name: str) -> str:
        """UDUNITS text, empty if unknown."""
        return self._units.get(name) or self.model.get_var_units(name) or ""

    def unit(self, name: str) -> cf_units.Unit:
        """The unit of a variable; InputError for invalid units."""
        cure = f"; say them with {self.name}_units={{{name!r}: …}}"
        return read(self.units(name), f"{name} of the {self.name}", cure)

    def grid_number(self, name: str) -> int:
        """The BMI number of a variable's grid."""
        return self.model.get_var_grid(name)

    def size(self, name: str) -> int:
        """Number of values of a variable."""
        return self.model.get_var_nbytes(name) // self.model.get_var_itemsize(name)

    def get(self, name: str) -> np.ndarray:
        """A copy of the values of a variable (size,), as float64."""
        values = np.empty(self.size(name), self.model.get_var_type(name))
        self.model.get_value(name, values)
        return values.astype(np.float64)

    def set(self, name: str, values: np.ndarray) -> np.ndarray:
        """Set an input; returns the values as the model has them, in its own precision."""
        given = values.astype(self.model.get_var_type(name))
        if given.size <= self._longest:
            try:
                self.model.set_value(name, given)
                return given.astype(np.float64)
            except Exception as error:
                if not (given.size > PART and is_too_long(error)):
                    raise
                self._longest = PART
        for first in range(0, given.size, PART):
            part = np.arange(first, min(first + PART, given.size))
            self.model.set_value_at_indices(name, part, given[part])
        return given.astype(np.float64)

    def pair(self, template: str) -> np.ndarray:
        """The scalar outputs along x and y, with x and y in place of {a} in the name: (2,)."""
        return np.array([self.get(template.format(a=a))[0] for a in "xy"])

    def know_grid(self, name: str) -> Grid:
        """The cells of a variable; made once, and watched for changes from then on."""
        number, location = self.grid_number(name), self.model.get_var_location(name)
        key = number, location
        if key not in self._grids:
            told = told_of(self.model, number, location)
            grid = self._given.get(number)
            if grid is None:
                grid = grid_of(told, number, location, f"{name} of the {self.name}")
            if grid.size != self.size(name):
                raise InputError(
                    f"couple: {name} of the {self.name} has {self.size(name)} values, its grid"
                    f" {number} {grid.size} cells"
                )
            self._grids[key] = grid, digest(told), name
        return self._grids[key][0]

    def refuse_idle_units(self) -> None:
        """InputError for units given for a name that no variable has."""
        names = (*self.inputs, *self.outputs)
        for name in self._units:
            if not is_word(name, names):
                raise InputError(
                    f"couple: {self.name}_units of {name!r}: the {self.name} has no such variable;"
                    f" {choose(name, names)}"
                )

    def refuse_idle_grids(self) -> None:
        """InputError for a grid given for a number that no variable has."""
        if not self._given:
            return
        numbers = sorted({self.grid_number(name) for name in (*self.inputs, *self.outputs)})
        for number in self._given:
            if number not in numbers:
                raise InputError(
                    f"couple: {self.name}_grids: no variable of the {self.name} is on grid {number!r}; its grids"
                    f" are {', '.join(map(str, numbers))}"
                )

    def refuse_changed_grids(self) -> None:
        """InputError if a grid has changed since `know_grid` first requested it."""
        for (number, location), (_, known, name) in self._grids.items():
            if digest(told_of(self.model, number, location)) != known:
                raise InputError(
                    f"grid {number} of the {self.name} ({name}) is not what it was at the start: weights"
                    " are made for fixed grids; start a new coupling"
                )
