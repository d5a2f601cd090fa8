"""The model as a BMI 2.0 component: the interface for hosts, without physics.

A host exchanges numbers through arrays that are allocated once, at `initialize`, and live until `finalize`.
Inputs are the model's own arrays (`model.ocean.u` …).  An output is written in place on its first request,
and from then on after each update, so a host's pointer stays valid; outputs that no host requests are not
computed.  Edits of `model.floes` between two updates appear in the outputs requested after them.
Names, units and signs come from `variables`, and from `bmi_totals` for numbers of the whole domain.

The configuration file is a scene, or one table that names a scene and defines the host's view of it:

    [bmi]
    scene = "labrador-sea"            # a packaged name, or a path relative to this file
    set = ["time.exchange=3600"]      # changes of the scene, as `floebmi run --set`
    cells = "faces"                   # default "nodes"
    floe_capacity = 2000              # room for single floes; default 0, no floe-level variables
    restart = "state.nc"              # what `save_state` wrote; default: start at 0 s
    checkpoint = "state.nc"           # the state after each update, for hosts that cannot call `save_state`

Cells.  The nodes of a structured grid are the *centres* of cells, order (y, x).  Where a structured BMI
grid cannot say what the cells are (curvilinear and unstructured exchange grids, or `cells = "faces"`),
the grid is "unstructured", one face per cell, corners counter-clockwise, numbered
from 0.  The atmosphere has its own grid if the scene gives it one.

Forcing.  Velocities that the scene lists (constants, files) fill the inputs at `initialize`, and before
each exchange with those at its middle, as in a run without a host.  A host that writes a velocity of the
ocean or of the air, by `set_value` or through a pointer, takes over that fluid: from then on the scene
does not fill it.  The default is still water and no wind.

Time.  One exchange is `get_time_step` long, `[time] exchange` of the scene.  `update` makes one;
`update_until` as many as fit and a shorter last one, and stresses are then means over all of them.

A call that fails raises an error of one line, and leaves the component unchanged.

This module imports little, so that `floebmi.FloeBmi` is available as soon as the package is imported.
"""

import os
import sys
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, final

import numpy as np
from bmipy import Bmi

from floebmi import variables
from floebmi.bmi_buffers import copied, indices_of, numbers_of
from floebmi.bmi_layout import Layout
from floebmi.bmi_running import FLOES, TYPES, Running, is_input
from floebmi.bmi_totals import SCALARS, Scalar
from floebmi.errors import InputError, choose, in_line
from floebmi.quantities import flat, is_number
from floebmi.variables import VARIABLES, Variable

if TYPE_CHECKING:
    from floebmi.model import Model

MOST_EXCHANGES = 1e9  # in one update: they would take days without a single floe


def table() -> str:
    """All variables as Markdown, for the documentation."""
    lines = [
        f"| | {row.csdms} | | {row.units} | {row.text} | | one number, out | from the start |\n"
        for row in SCALARS
    ]
    return variables.table() + "".join(lines)


@final
class FloeBmi(Bmi):
    """Sea-ice floes as a BMI 2.0 component (see the module's text for grids, forcing and time).

    The configuration file is a scene, TOML or YAML, or the name of a packaged one, or a table [bmi] that
    names one.  Names of variables, their units and types are available before `initialize`; afterwards only those that
    the scene models.

    Raises
    ------
    InputError
        one line: unknown names and grids, wrong sizes, values that are not finite in wet cells (with the
        variable and the cell), times in the past, calls before `initialize` or after `finalize`.
    StabilityError
        from an update, if the step no longer resolves the motion of the floes.

    Examples
    --------
    >>> from floebmi import FloeBmi
    >>> floes = FloeBmi()
    >>> floes.get_var_units("sea_ice__thickness")
    'm'
    """

    METADATA = "metadata"  # folder in this package, for pymt

    def __init__(self) -> None:
        self._running: Running | None = None

    # ---- control ------------------------------------------------------------------------------

    def initialize(self, config_file: str) -> None:
        """Build the scene; outputs are valid afterwards.

        Parameters
        ----------
        config_file : path of a scene (TOML or YAML), or the name of a packaged one; paths in it are
            relative to it
        """
        if self._running is not None:
            raise InputError(
                "initialize: this component is initialized already; call finalize first"
            )
        if config_file is None or isinstance(config_file, str) and not config_file:
            raise InputError("initialize: needs a scene, a TOML or YAML file or a packaged name")
        if not isinstance(config_file, str | os.PathLike):
            raise InputError(f"initialize: {in_line(config_file)}: must be the path of a scene")
        self._running = Running(str(config_file))

    def update(self) -> None:
        """Advance by one exchange interval, `get_time_step` seconds."""
        now = self._now("update")
        now.advance(now.model.time + now.step)

    def update_until(self, time: float) -> None:
        """Advance exactly to `time` [s]; the current time has no effect."""
        now = self._now("update_until")
        if not is_number(time):
            raise InputError(f"update_until: time = {time!r}: must be a number of seconds")
        time = float(time)
        if time < now.model.time:
            raise InputError(
                f"update_until: time = {time:.17g} s: must be at least the current time, {now.model.time:.17g} s"
            )
        count = (time - now.model.time) / now.step
        if count > MOST_EXCHANGES:
            raise InputError(
                f"update_until: time = {time:.17g} s: is {count:.2g} exchanges of {now.step:g} s away; "
                f"at most {MOST_EXCHANGES:g} are allowed"
            )
        if time > now.model.time:
            now.advance(time)

    def finalize(self) -> None:
        """Release everything; `initialize` may follow."""
        self._running = None

    def save_state(self, path: str | Path) -> None:
        """Save the state from which `load_state`, or the key `restart`, continues with the same bits."""
        now = self._now("save_state")
        now.save(path, now.means)

    def load_state(self, path: str | Path) -> None:
        """Restore a state that `save_state` wrote, of a component with the same scene."""
        self._now("load_state").load(path)

    @property
    def model(self) -> "Model":
        """The model itself, for hosts in the same process (masks, floes, ledger)."""
        return self._now("model").model

    # ---- variables ----------------------------------------------------------------------------

    def get_component_name(self) -> str:
        """`floebmi`."""
        return "floebmi"

    def get_input_item_count(self) -> int:
        """Number of inputs."""
        return len(self.get_input_var_names())

    def get_output_item_count(self) -> int:
        """Number of outputs."""
        return len(self.get_output_var_names())

    def get_input_var_names(self) -> tuple[str, ...]:
        """CSDMS names of the inputs; before `initialize` those of all scenes."""
        return tuple(name for name, row in self._rows().items() if is_input(row))

    def get_output_var_names(self) -> tuple[str, ...]:
        """CSDMS names of the outputs; before `initialize` all but those of single floes."""
        return tuple(name for name, row in self._rows().items() if not is_input(row))

    def get_var_grid(self, name: str) -> int:
        """Grid of a variable: 0 cells, 1 one number, 2 the air's own cells, 3 floes."""
        row = self._row(name)
        return self._now("get_var_grid").grid_of(row)

    def get_var_type(self, name: str) -> str:
        """NumPy name of the type."""
        row = self._row(name)
        return "float64" if isinstance(row, Scalar) else TYPES[row.dtype]

    def get_var_units(self, name: str) -> str:
        """UDUNITS text."""
        return self._row(name).units

    def get_var_itemsize(self, name: str) -> int:
        """Bytes of one value."""
        return np.dtype(self.get_var_type(name)).itemsize

    def get_var_nbytes(self, name: str) -> int:
        """Bytes of all values."""
        self._row(name)
        return self._now(name).values[name].nbytes

    def get_var_location(self, name: str) -> str:
        """`node`, or `face` where the grid's faces are the cells."""
        grid = self.get_var_grid(name)
        return self._layout(grid).location

    # ---- time ---------------------------------------------------------------------------------

    def get_start_time(self) -> float:
        """0.0 [s]."""
        return 0.0

    def get_current_time(self) -> float:
        """Seconds since the start."""
        return float(self._now("get_current_time").model.time)

    def get_end_time(self) -> float:
        """`[time] duration` of the scene [s], else the largest float; updates may go beyond it."""
        return sys.float_info.max if self._running is None else float(self._running.end)

    def get_time_units(self) -> str:
        """Seconds."""
        return "s"

    def get_time_step(self) -> float:
        """Length of an exchange [s]; the floes' own steps are shorter."""
        return float(self._now("get_time_step").step)

    # ---- values -------------------------------------------------------------------------------

    def get_value(self, name: str, dest: np.ndarray) -> np.ndarray:
        """Copy the values into `dest`, flat or in the rows and columns of the grid; returns it."""
        values = self._array(name)
        return copied(values, dest, name, self._now(name).shape_of(self._row(name)))

    def get_value_ptr(self, name: str) -> np.ndarray:
        """The array itself, which every update overwrites until `finalize`."""
        return self._array(name)

    def get_value_at_indices(self, name: str, dest: np.ndarray, inds: np.ndarray) -> np.ndarray:
        """Copy single values into `dest`; returns it."""
        values = self._array(name)
        return copied(values[indices_of(name, inds, values.size)], dest, name)

    def set_value(self, name: str, src: np.ndarray) -> None:
        """Set an input everywhere from numbers of any real type, size as `get_grid_size` (or faces)."""
        now, row, values = self._input(name)
        given = flat(name, numbers_of(name, src, values.size), now.cells_of(row).shape)
        self._refuse_not_finite(row, given, None)
        values[:] = given
        now.taken_over(row)

    def set_value_at_indices(self, name: str, inds: np.ndarray, src: np.ndarray) -> None:
        """Set an input in some cells."""
        now, row, values = self._input(name)
        inds = indices_of(name, inds, values.size)
        given = numbers_of(name, src, inds.size).ravel()
        self._refuse_not_finite(row, given, inds)
        values[inds] = given
        now.taken_over(row)

    def _refuse_not_finite(self, row: Variable, given: np.ndarray, inds: np.ndarray | None) -> None:
        from floebmi.arrays import all_finite

        if all_finite(given):
            return
        finite = np.isfinite(given)
        wet = self._now(row.csdms).cells_of(row).wet
        wrong = ~finite & (wet if inds is None else wet[inds])
        if wrong.any():
            k = int(np.argmax(wrong))
            place = k if inds is None else inds[k]
            raise InputError(
                f"{row.csdms}: {given[k]} at index {place}, a wet cell: must be finite"
            )

    # ---- grids --------------------------------------------------------------------------------

    def get_grid_type(self, grid: int) -> str:
        """`uniform_rectilinear`, `rectilinear`, `unstructured` or `scalar`."""
        return self._layout(grid).type

    def get_grid_rank(self, grid: int) -> int:
        """2, or 0 for one number."""
        return self._layout(grid).rank

    def get_grid_size(self, grid: int) -> int:
        """Number of nodes."""
        return int(self._layout(grid).size)

    def get_grid_shape(self, grid: int, shape: np.ndarray) -> np.ndarray:
        """Rows and columns (y, x)."""
        return self._fill(grid, "shape", shape)

    def get_grid_spacing(self, grid: int, spacing: np.ndarray) -> np.ndarray:
        """Sides of a cell (y, x) [m]."""
        return self._fill(grid, "spacing", spacing)

    def get_grid_origin(self, grid: int, origin: np.ndarray) -> np.ndarray:
        """Centre of the first cell (y, x) [m]."""
        return self._fill(grid, "origin", origin)

    def get_grid_x(self, grid: int, x: np.ndarray) -> np.ndarray:
        """x of columns of cell centres, or of the nodes of an unstructured grid [m]."""
        return self._fill(grid, "x", x)

    def get_grid_y(self, grid: int, y: np.ndarray) -> np.ndarray:
        """y of rows of cell centres, or of the nodes of an unstructured grid [m]."""
        return self._fill(grid, "y", y)

    def get_grid_z(self, grid: int, z: np.ndarray) -> np.ndarray:
        """Not available: grids have two dimensions."""
        self._layout(grid)
        raise NotImplementedError(f"grid {grid}: no z, grids have two dimensions")

    def get_grid_node_count(self, grid: int) -> int:
        """Number of nodes."""
        return int(self._layout(grid).size)

    def get_grid_edge_count(self, grid: int) -> int:
        """Number of edges of an unstructured grid."""
        return self._part(grid, "edge_nodes").size // 2

    def get_grid_face_count(self, grid: int) -> int:
        """Number of faces of an unstructured grid: its cells."""
        return self._part(grid, "nodes_per_face").size

    def get_grid_edge_nodes(self, grid: int, edge_nodes: np.ndarray) -> np.ndarray:
        """Two nodes per edge, from 0."""
        return self._fill(grid, "edge_nodes", edge_nodes)

    def get_grid_face_edges(self, grid: int, face_edges: np.ndarray) -> np.ndarray:
        """Edges of each face; edge k leads from its node k to the next."""
        return self._fill(grid, "face_edges", face_edges)

    def get_grid_face_nodes(self, grid: int, face_nodes: np.ndarray) -> np.ndarray:
        """Nodes of each face counter-clockwise, face after face, from 0."""
        return self._fill(grid, "face_nodes", face_nodes)

    def get_grid_nodes_per_face(self, grid: int, nodes_per_face: np.ndarray) -> np.ndarray:
        """Number of corners of each cell."""
        return self._fill(grid, "nodes_per_face", nodes_per_face)

    # ---- look-up ------------------------------------------------------------------------------

    def _now(self, call: str) -> Running:
        if self._running is None:
            raise InputError(f"{call}: this component is not initialized; call initialize first")
        return self._running

    def _rows(self) -> dict[str, Variable | Scalar]:
        if self._running is None:
            return {row.csdms: row for row in (*VARIABLES, *SCALARS)}
        return self._running.rows

    def _row(self, name: str) -> Variable | Scalar:
        rows = self._rows()
        if not isinstance(name, str) or name not in rows:
            raise InputError(f"variable {name!r}: not in this component; {choose(name, rows)}")
        return rows[name]

    def _array(self, name: str) -> np.ndarray:
        self._row(name)
        return self._now(name).array(name)

    def _input(self, name: str) -> tuple[Running, Variable, np.ndarray]:
        row, values = self._row(name), self._array(name)
        if not is_input(row):
            inputs = ", ".join(self.get_input_var_names()) or "none"
            raise InputError(f"{name}: is an output, and cannot be set; inputs: {inputs}")
        return self._now(name), row, values

    def _layout(self, grid: int) -> Layout:
        layouts = self._now("grid").layouts
        if not isinstance(grid, Integral) or grid not in layouts:
            raise InputError(f"grid {grid!r}: unknown; allowed: {', '.join(map(str, layouts))}")
        return layouts[grid]

    def _part(self, grid: int, name: str) -> np.ndarray:
        layout = self._layout(grid)
        if grid == FLOES:  # at their present positions
            self._now("grid").follow_edits()
        part = getattr(layout, name)
        if part is None:
            raise NotImplementedError(f"grid {grid}: a grid of type {layout.type!r} has no {name}")
        return part

    def _fill(self, grid: int, name: str, buffer: np.ndarray) -> np.ndarray:
        return copied(self._part(grid, name), buffer, f"grid {grid}: {name}")
