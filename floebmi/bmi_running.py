"""The BMI component between `initialize` and `finalize`: the model, its arrays, and the sources that fill them."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import numpy as np

from floebmi.alone import alone
from floebmi.bmi_layout import Layout, layout_of
from floebmi.bmi_totals import SCALARS, Scalar
from floebmi.errors import InputError
from floebmi.variables import FLOE_VARIABLES, PER_ICE_AREA, VARIABLES, Variable

if TYPE_CHECKING:
    from floebmi.fluid import Fluid
    from floebmi.forcing import VelocitySource
    from floebmi.grid import Grid
    from floebmi.model import Model
    from floebmi.scene import Scene

CELLS, WHOLE, AIR, FLOES = range(4)  # BMI grids: exchange cells, one number, the air's cells, floes
SAME_TIME = 1e-9  # of an exchange: a remainder below this is round-off
TYPES = {"float64": "float64", "bool": "int32", "int8": "int32"}  # what BMI hosts can take

_FLOE_ROWS = tuple(row for row in FLOE_VARIABLES if row.intent == "restart")


@final
class Running:
    """See the top of this file.

    Attributes
    ----------
    model : the ice
    step, end : exchange interval, and end of the scene [s]
    rows, values : by CSDMS name, the variables of this scene and their arrays
    layouts : of the BMI grids, by number
    sources : sources of the scene by fluid, of those fluids that no host has taken over
    """

    def __init__(self, config_file: str) -> None:
        from floebmi.hosting import read_config

        scene, view = read_config(config_file)
        self.step = _interval(scene)
        self.end = sys.float_info.max if scene.time.duration is None else scene.time.duration
        built = scene.build()
        self.start, self.calendar = built.start, built.calendar
        self.model: Model = built.model
        self.capacity, self.checkpoint = view.floe_capacity, view.checkpoint
        found = {"ocean": built.ocean, "atmosphere": built.atmosphere}
        self.of_scene = {name: source for name, source in found.items() if source is not None}
        self.sources: dict[str, VelocitySource] = dict(self.of_scene)  # not replaced by a host
        self.filled: dict[str, np.ndarray] = {}  # last values written by a source, as bits
        self.lay_out_sea, self.laid = scene.lay_out_sea, self._sea()
        for name in self.sources:
            with scene.place(name):
                self.fill(name, 0.0)
        self.layouts = self._lay_out(view.cells == "faces")
        self.rows: dict[str, Variable | Scalar] = {}
        self.values: dict[str, np.ndarray] = {}
        self.parts: dict[str, Callable[..., dict[str, np.ndarray]]] = {}  # computes an output
        self.asked: set[str] = set()
        self.shown: object = None  # the model's `_Seen` when outputs were last written
        self._list()
        self.show({})
        if view.restart is not None:
            self.load(Path(view.restart))

    def _lay_out(self, faces: bool) -> dict[int, Layout]:
        model = self.model
        layouts = {CELLS: layout_of(model.grid, faces), WHOLE: Layout("scalar", 0, 1, 1, "node")}
        if model.atmosphere is not None and model.atmosphere.grid is not model.grid:
            layouts[AIR] = layout_of(model.atmosphere.grid, faces)
        return layouts

    def _list(self) -> None:
        """List the variables of this scene and allocate their arrays, once."""
        model = self.model
        for part in (model.ice_fields, model.internal_stress_fields, model.fluid_stress_fields):
            self.parts |= dict.fromkeys(part(), part)
        for row in VARIABLES:
            values = None
            if row.intent == "in":
                values = row.array_in(model)
            elif row.name in self.parts:
                values = np.zeros(self.layouts[self.grid_of(row)].values)
            if values is not None:
                self.rows[row.csdms], self.values[row.csdms] = row, values
        for scalar in SCALARS:
            if not scalar.fluid or getattr(model, scalar.fluid) is not None:
                self.rows[scalar.csdms], self.values[scalar.csdms] = scalar, np.zeros(1)
        if self.capacity:
            self._list_floes()

    def _list_floes(self) -> None:
        """Allocate the arrays of single floes, for hosts that want them; they are kept up to date from the start."""
        self._check_capacity()
        for row in _FLOE_ROWS:
            if getattr(self.model.floes, row.name) is not None:
                self.rows[row.csdms] = row
                self.values[row.csdms] = np.zeros(self.capacity, TYPES[row.dtype])
                self.asked.add(row.csdms)
        x, y = (self.values[row.csdms] for row in _FLOE_ROWS if row.name in ("x", "y"))
        none = np.zeros(0, np.int64)
        self.layouts[FLOES] = Layout(
            "unstructured", 2, self.capacity, self.capacity, "node", x=x, y=y,
            edge_nodes=none, face_edges=none, face_nodes=none, nodes_per_face=none,
        )  # fmt: skip

    def _check_capacity(self) -> None:
        """InputError if there are more floes than the arrays of single floes can hold."""
        count = len(self.model.floes)
        if self.capacity and count > self.capacity:
            raise InputError(
                f"[bmi] floe_capacity = {self.capacity}: there are {count} floes; must be at least that"
            )

    def grid_of(self, row: Variable | Scalar) -> int:
        """The number of a variable's BMI grid."""
        if isinstance(row, Scalar):
            return WHOLE
        if row.grid == "floe":
            return FLOES
        return AIR if row.grid == "atmosphere" and AIR in self.layouts else CELLS

    def shape_of(self, row: Variable | Scalar) -> tuple[int, ...]:
        """Rows and columns of a variable's values, or their number where there are none."""
        grids = {CELLS: self.model.grid, AIR: getattr(self.model.atmosphere, "grid", None)}
        grid = grids.get(self.grid_of(row))
        return self.values[row.csdms].shape if grid is None else grid.shape

    def cells_of(self, row: Variable) -> "Grid":
        """The grid on which a host sets an input."""
        return self._fluid(row.home.partition(".")[0]).grid

    def _fluid(self, name: str) -> "Fluid":
        return getattr(self.model, name)

    # ---- who fills the inputs

    def fill(self, name: str, time: float) -> None:
        """Fill a fluid from the scene's own source at `time` [s], unless a host has written there."""
        fluid = self._fluid(name)
        if name in self.filled and not self.drives(name):
            self.sources.pop(name, None)
        if name in self.sources:
            self.sources[name].fill(time, fluid.u, fluid.v)
            self.filled[name] = self._velocity(name)

    def drives(self, name: str) -> bool:
        """Whether the scene's own source fills a fluid: no host has written there, not even through a pointer."""
        return name in self.sources and np.array_equal(self.filled[name], self._velocity(name))

    def _velocity(self, name: str) -> np.ndarray:
        fluid = self._fluid(name)
        return _bits(fluid.u, fluid.v)

    def _sea(self) -> np.ndarray:
        """Slope of the sea and Coriolis parameter, which a scene lays out once and a host may set, as bits."""
        fields = {} if self.model.ocean is None else self.model.ocean.fields
        return _bits(*(values for name, values in fields.items() if name not in ("u", "v")))

    def taken_over(self, row: Variable) -> None:
        """Note that a host has set this variable."""
        fluid, _, component = row.home.partition(".")
        if component in ("u", "v"):
            self.sources.pop(fluid, None)

    # ---- stepping

    def advance(self, until: float) -> None:
        """Advance by exchanges of the scene's length and a shorter last one, exactly to `until` [s].

        On failure everything is left unchanged.
        """
        with alone(self.model, "update"):
            rest = until - self.model.time
            count = max(1, int(np.ceil(rest / self.step - SAME_TIME)))
            # the model itself undoes one failed exchange; a copy of everything costs as much as two steps
            plain = (
                count == 1 and not self.sources and not self.capacity and self.checkpoint is None
            )
            with nullcontext() if plain else self.unchanged_on_failure():
                self._exchanges(until, rest, count)

    def _exchanges(self, until: float, rest: float, count: int) -> None:
        model = self.model
        sums: dict[str, Any] = {}
        for k in range(count):
            whole = k < count - 1 or model.time + self.step == until
            duration = self.step if whole else until - model.time
            for name in ("ocean", "atmosphere"):
                self.fill(name, model.time + 0.5 * duration)  # as in a run
            model.advance(duration)
            if count > 1:
                for name, values in self._means().items():
                    sums[name] = sums.get(name, 0.0) + values * (duration / rest)
        model.time = until
        if count > 1 and model.ocean is not None:
            sums |= self._per_ice_area(sums)
        self._check_capacity()
        if self.checkpoint is not None:
            self.save(self.checkpoint, sums)
        self.show(sums)

    def _means(self) -> dict[str, np.ndarray]:
        """Means over the last exchange of the model."""
        means = {row.name for row in self.rows.values() if _is_mean(row)}
        return {n: v for n, v in self.model.fluid_stress_fields().items() if n in means}

    # ---- outputs

    def show(self, means: dict[str, np.ndarray]) -> None:
        """Write the outputs that the host has requested, in place; the others wait until requested.

        means : of the mean variables over the last update, where that was not one exchange
        """
        self.means, self.shown = means, self.model._seen
        asked = {name: self.rows[name] for name in self.asked}
        fields = {row.name: self.values[name] for name, row in asked.items() if _is_field(row)}
        for part in {self.parts[name] for name in fields}:
            part(out=fields)
        for name in means.keys() & fields.keys():
            fields[name][:] = means[name]
        for name in self.asked:
            if not _is_field(self.rows[name]):
                self._write(name)

    def array(self, name: str) -> np.ndarray:
        """The array of a variable; an output is kept up to date from its first request."""
        if self._is_of_the_floes(name):
            self.follow_edits()
        if name not in self.asked:
            with alone(self.model, name):  # an update in another thread loops over `asked`
                self._write(name)
                self.asked.add(name)
        return self.values[name]

    def _is_of_the_floes(self, name: str) -> bool:
        """Whether an output changes with edits of the floes; stresses on fluids and ledger totals change only in an update."""
        row = self.rows[name]
        if isinstance(row, Scalar) or row.intent == "in":
            return False
        given = self.parts.get(row.name) == self.model.fluid_stress_fields
        return not given or row.name in PER_ICE_AREA

    def follow_edits(self) -> None:
        """Rewrite the outputs if the floes were edited since, so that they describe the floes as they are."""
        if self.model._known() is self.shown:
            return
        means = dict(self.means)
        if any(name in means for name in PER_ICE_AREA):
            means |= self._per_ice_area(means)
        with alone(self.model, "get_value"):
            self.show(means)

    def _per_ice_area(self, means: dict[str, Any]) -> dict[str, np.ndarray]:
        """Mean stresses over the area of ice now; multiplied by the concentration they give those per cell area."""
        over = self.model.grid.area * self.model.over_ice_area()
        return {name: means[per_cell] * over for name, per_cell in PER_ICE_AREA.items()}

    def _write(self, name: str) -> None:
        """Write a single output."""
        row, values = self.rows[name], self.values[name]
        if isinstance(row, Scalar):
            values[0] = row.value(self.model)
        elif row.grid == "floe":
            values[:] = 0  # a loaded state may have fewer floes
            values[: len(self.model.floes)] = getattr(self.model.floes, row.name)
        elif row.intent == "out":
            made = self.means if row.name in self.means else self.parts[row.name]()
            values[:] = made[row.name]

    # ---- the whole state

    def save(self, path: str | Path, means: dict[str, np.ndarray]) -> None:
        """Save all that `load` needs; `means` as for `show`."""
        from floebmi.restarts import save_restart

        state = {
            "model": self.model.state(),
            "mean": self._means() | means,
            "driven_by_scene": {
                **{name: self.drives(name) for name in ("ocean", "atmosphere")},
                "sea": np.array_equal(self._sea(), self.laid),
            },
        }
        date = {} if self.start is None else {"start": self.start, "calendar": self.calendar}
        save_restart(path, state, {"time": self.model.time} | date)

    def load(self, path: str | Path) -> None:
        """Restore a state that `save` wrote; InputError for any other file, which changes nothing."""
        from floebmi.clock import refuse_other_start
        from floebmi.restarts import load_restart

        state, told = load_restart(path)
        if set(state) != {"model", "mean", "driven_by_scene"}:
            raise InputError(f"{path}: not a state that save_state of this component wrote")
        refuse_other_start(self.start, self.calendar, told)
        with alone(self.model, "load_state"), self.unchanged_on_failure():
            self.model.restore(state["model"])
            self._check_capacity()
            self.sources = {
                name: source
                for name, source in self.of_scene.items()
                if state["driven_by_scene"][name]
            }
            self.filled = {name: self._velocity(name) for name in self.sources}
            if state["driven_by_scene"].get("sea"):  # older states do not tell
                self.lay_out_sea(self.model)
            self.show(state["mean"])

    @contextmanager
    def unchanged_on_failure(self) -> Iterator[None]:
        """Undo everything if the body fails; `show` is the last step that can fail, so outputs need no copies."""
        before, sources, filled = self.model.state(), dict(self.sources), dict(self.filled)
        up_to_date = self.shown is self.model._seen
        try:
            yield
        except BaseException:
            self.model.restore(before)
            self.sources, self.filled = sources, filled
            self.shown = self.model._seen if up_to_date else None
            raise


def _interval(scene: "Scene") -> float:
    """The exchange interval of a scene [s]."""
    for told in (scene.time.exchange, scene.output.every):
        if told is not None:
            return float(told)
    if scene.time.duration is None:
        raise InputError(
            f"{scene.file}: [time] exchange is missing: seconds between exchanges with the host"
        )
    return float(scene.schedule().exchange)


def is_input(row: Variable | Scalar) -> bool:
    """Whether a variable is set by a host."""
    return isinstance(row, Variable) and row.intent == "in"


def _is_field(row: Variable | Scalar) -> bool:
    return isinstance(row, Variable) and row.intent == "out" and row.grid != "floe"


def _is_mean(row: Variable | Scalar) -> bool:
    return isinstance(row, Variable) and row.intent == "out" and "time: mean" in row.mean


def _bits(*fields: np.ndarray) -> np.ndarray:
    """Fields as bits, so that NaN in dry cells equals itself."""
    return np.concatenate([np.empty(0), *fields]).view(np.int64)
