"""A two-slab ocean: the simplest ocean model for testing a coupling.

Each column of cells is a surface slab of thickness H₁ over a deep slab of thickness H₂, with the velocities
u₁ and u₂.  The ice acts on the upper slab, and drag between the slabs transfers momentum downwards:

    ρ H₁ ∂u₁/∂t = τ − r        ρ H₂ ∂u₂/∂t = r        r = ρ (k + C |u₁ − u₂|) (u₁ − u₂)    (eq. two-slab)

τ is the stress of the ice ON the ocean per cell area [N m-2], positive accelerates the ocean along +x (+y).
There is no pressure, rotation or advection: the total momentum can change only by τ, and the model outputs
both the momentum (`…momentum`) and the impulse that it received (`…time_integral…`), so that errors of a coupler show.

The drag is implicit in u₁ − u₂, with |u₁ − u₂| taken after the stress has acted, so any time step is stable; the
momentum that leaves one slab enters the other, so the step conserves momentum to round-off.

A configuration file (TOML):

    [grid]
    x = [0.0, 40e3]              # m
    y = [0.0, 20e3]
    spacing = 2e3                # or [dx, dy]

    [ocean]                      # all optional
    density = 1000.0             # kg m-3
    surface_thickness = 10.0     # H₁, m
    deep_thickness = 90.0        # H₂, m
    linear_drag = 0.0            # k, m s-1
    quadratic_drag = 2.5e-3      # C
    surface_velocity = [0.2, 0.0]  # at the start, m s-1
    deep_velocity = [0.0, 0.0]

    [time]
    step = 600.0                 # s
    end = 86400.0                # s, optional
"""

from __future__ import annotations

import sys
from numbers import Integral
from typing import final

import numpy as np
from bmipy import Bmi
from pydantic import Field

from floebmi.bmi_buffers import copied, indices_of, numbers_of
from floebmi.errors import InputError, choose, is_word
from floebmi.files import path_of
from floebmi.grid import Grid
from floebmi.quantities import NonNegative, Positive, flat, is_number
from floebmi.tables import Table, parse, read_text, validate

MOST_STEPS = 1e9  # in one update: they would take days
FIELDS, WHOLE = 0, 1  # the two BMI grids: cells, and the ocean as one number

STRESS = tuple(f"sea_ice_bottom_water_flowing__{a}_z_component_of_stress" for a in "xy")
SURFACE = tuple(f"sea_surface_water_flowing__{a}_component_of_velocity" for a in "xy")
DEEP = tuple(f"sea_deep_water_flowing__{a}_component_of_velocity" for a in "xy")
MOMENTUM = tuple(f"sea_water_flowing__domain_integral_of_{a}_component_of_momentum" for a in "xy")
RECEIVED = tuple(
    f"sea_ice_bottom_water_flowing__domain_time_integral_of_{a}_z_component_of_stress" for a in "xy"
)
INPUTS, OUTPUTS = STRESS, (*SURFACE, *DEEP, *MOMENTUM, *RECEIVED)
UNITS = {
    **dict.fromkeys(STRESS, "N m-2"),
    **dict.fromkeys(SURFACE + DEEP, "m s-1"),
    **dict.fromkeys(MOMENTUM + RECEIVED, "N s"),
}


class GridTable(Table):
    """Extent and spacing of the grid [m]."""

    x: tuple[float, float]
    y: tuple[float, float]
    spacing: Positive | tuple[Positive, Positive]


class OceanTable(Table):
    """Parameters of the water (units and meaning in the module's text)."""

    density: Positive = 1000.0
    surface_thickness: Positive = 10.0
    deep_thickness: Positive = 90.0
    linear_drag: NonNegative = 0.0
    quadratic_drag: NonNegative = 2.5e-3
    surface_velocity: tuple[float, float] = (0.0, 0.0)
    deep_velocity: tuple[float, float] = (0.0, 0.0)


class TimeTable(Table):
    """Time step and end time [s]."""

    step: Positive = 600.0
    end: Positive = sys.float_info.max


class Settings(Table):
    """Contents of a configuration file."""

    grid: GridTable = Field(description="extent and spacing of the grid")
    ocean: OceanTable = OceanTable()
    time: TimeTable = TimeTable()


@final
class TwoSlabOcean(Bmi):
    """The two-slab ocean as a BMI 2.0 component (see the module's text for equations and configuration).

    Inputs: `sea_ice_bottom_water_flowing__x_z_component_of_stress` and its y counterpart [N m-2], the stress of the
    ice on the ocean per cell area; 0 until set, then kept until set again.  Outputs on the cells: velocities of both
    slabs [m s-1].  Outputs for the whole ocean (grid type `scalar`): momentum, and the impulse received
    since the start [N s].

    The grid is uniform_rectilinear; a node is the centre of a cell.  Time starts at 0.0 s.

    Raises
    ------
    InputError
        for a wrong configuration, an unknown variable, values of a wrong size or not finite, a time in the
        past, and any call that needs `initialize` first.
    """

    def __init__(self) -> None:
        self._values: dict[str, np.ndarray] = {}

    # ---- the model --------------------------------------------------------------------------------

    def initialize(self, config_file: str) -> None:
        """Read the configuration (TOML) and start with the velocities that it gives (default: at rest)."""
        if config_file is None or isinstance(config_file, str) and not config_file:
            raise InputError(
                "initialize: a configuration file (TOML) is needed, with a table [grid]"
            )
        path = path_of("config_file", config_file)
        settings = validate(Settings, parse(read_text(path), str(path)), str(path))
        grid = Grid.uniform(settings.grid.x, settings.grid.y, settings.grid.spacing)
        self._settings, self._grid, self._time = settings, grid, 0.0
        sizes = {name: grid.size if self._grid_of(name) == FIELDS else 1 for name in UNITS}
        self._values = {name: np.zeros(size) for name, size in sizes.items()}
        for axis in (0, 1):
            self._values[SURFACE[axis]][:] = settings.ocean.surface_velocity[axis]
            self._values[DEEP[axis]][:] = settings.ocean.deep_velocity[axis]
        self._count_momentum()

    def update(self) -> None:
        """Advance by one time step."""
        self.update_until(self.get_current_time() + self._settings.time.step)

    def update_until(self, time: float) -> None:
        """Advance to exactly `time` [s], in whole steps and a shorter last one."""
        now = self.get_current_time()
        if not is_number(time):
            raise InputError(f"update_until: time = {time!r}: must be a number of seconds")
        if time < now:
            raise InputError(f"update_until: time = {time} s is before the current time, {now} s")
        step = self._settings.time.step
        if time - now > MOST_STEPS * step:
            raise InputError(
                f"update_until: time = {time} s is {(time - now) / step:.2g} steps of {step:g} s away; at most"
                f" {MOST_STEPS:g} are allowed"
            )
        steps = int(np.ceil((time - now) / step - 1e-9))
        for k in range(1, steps + 1):
            after = time if k == steps else now + k * step
            self._advance(after - self._time)
            self._time = float(after)
        self._time = float(time)
        self._count_momentum()

    def finalize(self) -> None:
        """Discard the state; `initialize` starts again."""
        self._values = {}

    def _advance(self, dt: float) -> None:
        ocean, values = self._settings.ocean, self._values
        upper = ocean.density * ocean.surface_thickness
        lower = ocean.density * ocean.deep_thickness
        for axis in (0, 1):
            values[SURFACE[axis]] += values[STRESS[axis]] * (dt / upper)
            values[RECEIVED[axis]] += (values[STRESS[axis]] * self._grid.area).sum() * dt
        difference = [values[SURFACE[axis]] - values[DEEP[axis]] for axis in (0, 1)]
        speed = np.hypot(*difference)
        # eq. two-slab: r = coefficient · difference
        coefficient = ocean.density * (ocean.linear_drag + ocean.quadratic_drag * speed)
        share = coefficient * dt / (1 + coefficient * dt * (1 / upper + 1 / lower))
        for axis in (0, 1):
            handed_down = share * difference[axis]
            values[SURFACE[axis]] -= handed_down / upper
            values[DEEP[axis]] += handed_down / lower

    def _count_momentum(self) -> None:
        ocean, area = self._settings.ocean, self._grid.area
        for axis in (0, 1):
            column = (
                ocean.surface_thickness * self._values[SURFACE[axis]]
                + ocean.deep_thickness * self._values[DEEP[axis]]
            )
            self._values[MOMENTUM[axis]][0] = ocean.density * (column * area).sum()

    def _array(self, name: str) -> np.ndarray:
        self._grid_of(name)
        if not self._values:
            raise InputError(f"{name}: call initialize first")
        return self._values[name]

    @staticmethod
    def _grid_of(name: str) -> int:
        if not is_word(name, UNITS):
            raise InputError(f"variable {name!r}: unknown; {choose(name, UNITS)}")
        return WHOLE if name in MOMENTUM + RECEIVED else FIELDS

    def _cells(self, grid: int) -> Grid:
        if not isinstance(grid, Integral) or grid != FIELDS:
            raise InputError(f"grid {grid}: not a grid of cells; {choose(grid, ['0'])}")
        if not self._values:
            raise InputError("grid 0: call initialize first")
        return self._grid

    # ---- what BMI asks ----------------------------------------------------------------------------

    def get_component_name(self) -> str:
        return "Two-slab ocean"

    def get_input_item_count(self) -> int:
        return len(INPUTS)

    def get_output_item_count(self) -> int:
        return len(OUTPUTS)

    def get_input_var_names(self) -> tuple[str, ...]:
        return INPUTS

    def get_output_var_names(self) -> tuple[str, ...]:
        return OUTPUTS

    def get_var_grid(self, name: str) -> int:
        return self._grid_of(name)

    def get_var_type(self, name: str) -> str:
        self._grid_of(name)
        return "float64"

    def get_var_units(self, name: str) -> str:
        self._grid_of(name)
        return UNITS[name]

    def get_var_itemsize(self, name: str) -> int:
        self._grid_of(name)
        return 8

    def get_var_nbytes(self, name: str) -> int:
        return self._array(name).nbytes

    def get_var_location(self, name: str) -> str:
        self._grid_of(name)
        return "node"

    def get_start_time(self) -> float:
        return 0.0

    def get_current_time(self) -> float:
        if not self._values:
            raise InputError("current time: call initialize first")
        return self._time

    def get_end_time(self) -> float:
        return self._settings.time.end if self._values else sys.float_info.max

    def get_time_units(self) -> str:
        return "s"

    def get_time_step(self) -> float:
        if not self._values:
            raise InputError("time step: call initialize first")
        return self._settings.time.step

    def get_value(self, name: str, dest: np.ndarray) -> np.ndarray:
        values = self._array(name)
        return copied(values, dest, name, None if values.size == 1 else self._grid.shape)

    def get_value_ptr(self, name: str) -> np.ndarray:
        return self._array(name)

    def get_value_at_indices(self, name: str, dest: np.ndarray, inds: np.ndarray) -> np.ndarray:
        values = self._array(name)
        return copied(values[indices_of(name, inds, values.size)], dest, name)

    def set_value(self, name: str, src: np.ndarray) -> None:
        size = self._array(name).size
        if name in INPUTS:
            src = flat(name, numbers_of(name, src, size), self._grid.shape)
        self.set_value_at_indices(name, np.arange(size), src)

    def set_value_at_indices(self, name: str, inds: np.ndarray, src: np.ndarray) -> None:
        array = self._array(name)
        if name not in INPUTS:
            raise InputError(f"{name}: an output; inputs are {', '.join(INPUTS)}")
        inds = indices_of(name, inds, array.size)
        values = numbers_of(name, src, inds.size).ravel()
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise InputError(
                f"{name}: value {values[bad[0]]} at cell {inds[bad[0]]}: must be finite"
            )
        array[inds] = values

    def get_grid_type(self, grid: int) -> str:
        if not isinstance(grid, Integral) or grid not in (FIELDS, WHOLE):
            raise InputError(f"grid {grid}: unknown; allowed: {FIELDS}, {WHOLE}")
        return "uniform_rectilinear" if grid == FIELDS else "scalar"

    def get_grid_rank(self, grid: int) -> int:
        return 2 if self.get_grid_type(grid) == "uniform_rectilinear" else 0

    def get_grid_size(self, grid: int) -> int:
        return 1 if self.get_grid_type(grid) == "scalar" else self._cells(grid).size

    def get_grid_shape(self, grid: int, shape: np.ndarray) -> np.ndarray:
        return copied(np.array(self._cells(grid).shape), shape, f"grid {grid}: shape")

    def get_grid_spacing(self, grid: int, spacing: np.ndarray) -> np.ndarray:
        cells = self._cells(grid)
        west, east, south, north = cells.bounds
        sides = np.array([(north - south) / cells.shape[0], (east - west) / cells.shape[1]])
        return copied(sides, spacing, f"grid {grid}: spacing")

    def get_grid_origin(self, grid: int, origin: np.ndarray) -> np.ndarray:
        cells = self._cells(grid)
        return copied(np.array([cells.y[0], cells.x[0]]), origin, f"grid {grid}: origin")

    def get_grid_x(self, grid: int, x: np.ndarray) -> np.ndarray:
        cells = self._cells(grid)
        return copied(cells.x[: cells.shape[1]], x, f"grid {grid}: x")

    def get_grid_y(self, grid: int, y: np.ndarray) -> np.ndarray:
        cells = self._cells(grid)
        return copied(cells.y[:: cells.shape[1]], y, f"grid {grid}: y")

    def get_grid_z(self, grid: int, z: np.ndarray) -> np.ndarray:
        raise NotImplementedError("get_grid_z: the grids are two-dimensional")

    def get_grid_node_count(self, grid: int) -> int:
        return self.get_grid_size(grid)

    def get_grid_edge_count(self, grid: int) -> int:
        raise NotImplementedError("get_grid_edge_count: only for unstructured grids")

    def get_grid_face_count(self, grid: int) -> int:
        raise NotImplementedError("get_grid_face_count: only for unstructured grids")

    def get_grid_edge_nodes(self, grid: int, edge_nodes: np.ndarray) -> np.ndarray:
        raise NotImplementedError("get_grid_edge_nodes: only for unstructured grids")

    def get_grid_face_edges(self, grid: int, face_edges: np.ndarray) -> np.ndarray:
        raise NotImplementedError("get_grid_face_edges: only for unstructured grids")

    def get_grid_face_nodes(self, grid: int, face_nodes: np.ndarray) -> np.ndarray:
        raise NotImplementedError("get_grid_face_nodes: only for unstructured grids")

    def get_grid_nodes_per_face(self, grid: int, nodes_per_face: np.ndarray) -> np.ndarray:
        raise NotImplementedError("get_grid_nodes_per_face: only for unstructured grids")
