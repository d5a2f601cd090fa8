"""Ocean and atmosphere as seen by the ice: the fields on a grid that drive it, and the impulse returned to them.

A host, a file or a constant provides the values in these arrays; `Model.advance` samples them at the floes, and
adds the opposite of the drag impulse to the cells in which they were sampled.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from floebmi.arrays import all_finite
from floebmi.errors import InputError, in_line
from floebmi.forces import (
    FLUID_U,
    FLUID_V,
    HALF_CURL,
    RATE,
    READS,
    SPIN_RATE,
    AirDrag,
    Force,
    OceanDrag,
    X,
    Y,
    lanes,
)
from floebmi.grid import Grid
from floebmi.gridding import give_back, sizes_of_drag
from floebmi.kernels import BLOCK
from floebmi.quantities import flat, is_number, unmasked
from floebmi.sampling import Period, Weights, gather_each, without_cell
from floebmi.vorticity import Vorticity

FASTEST = 1e3  # m/s: a fluid's velocity beyond this is a fill value, or in other units


class _Cells:
    """An input field; assignment writes into the existing array, to which there may be other references."""

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __get__(self, fluid: "Fluid", owner: type | None = None) -> np.ndarray:
        if fluid is None:
            return self  # type: ignore[return-value]
        return fluid.fields.get(self.name)

    def __set__(self, fluid: "Fluid", values: ArrayLike) -> None:
        cells = fluid.fields.get(self.name)
        if cells is None:
            raise InputError(f"{self.name}: no force of the model reads it; list the one that does")
        try:
            given = unmasked(values)
        except (TypeError, ValueError):
            raise InputError(
                f"{self.name} = {in_line(values)}: must be numbers, without a unit"
            ) from None
        if given.ndim and given.size != cells.size:
            raise InputError(
                f"{self.name} has shape {given.shape}: must be one number or {cells.size} values, one a cell"
            )
        cells[:] = flat(self.name, given, fluid.grid.shape) if given.ndim else given


class Fluid:
    """Ocean or atmosphere as seen by the ice, on a grid; all arrays are flat, and written in place.

    Attributes
    ----------
    grid : Grid
    u, v : velocity at the cells' centres along x and y [m/s], set by a host or a forcing
    tilt_x, tilt_y : slope of the sea surface [1], or None
    coriolis : Coriolis parameter [1/s], or None
    fields : all input fields by name: those above, and any that a user's own force reads
    impulse_x, impulse_y : impulse that the ice gave to the fluid in each cell since the start [N s]
    last_x, last_y : the part of it from the last exchange [N s]
    magnitude : magnitude of each floe's impulse over the last exchange, summed per cell area [N s/m²];
        None for the atmosphere
    coefficient : stress on the ocean over (ice − ocean velocity), Σ K |Δu| per cell area for drags K |Δu| Δu, at the end
        of the last exchange, with the water velocity used in it [kg m-2 s-1]; None for the atmosphere
    undelivered : impulse (x, y) of floes that touch no wet cell [N s]
    layer_thickness : thickness of the ocean's uppermost layer [m], if set by a host or a scene: the model then warns
        when exchanges are too infrequent for a lagged stress (eq. lagged-stress); default None
    """

    __slots__ = (
        "grid", "impulse_x", "impulse_y", "last_x", "last_y", "undelivered", "layer_thickness",
        "fields", "_sizes", "_drag", "_curl", "_period",
    )  # fmt: skip

    u, v, tilt_x, tilt_y, coriolis = _Cells(), _Cells(), _Cells(), _Cells(), _Cells()

    def __init__(
        self,
        grid: Grid,
        fields: Iterable[str] = (),
        ocean: bool = False,
        period: Period = (None, None),
    ) -> None:
        def zeros() -> np.ndarray:
            return np.zeros(grid.size)

        self.grid = grid
        self.fields = {name: zeros() for name in dict.fromkeys(("u", "v", *fields))}
        self.impulse_x, self.impulse_y = zeros(), zeros()
        self.last_x, self.last_y = zeros(), zeros()
        self._sizes = (zeros(), zeros()) if ocean else (None, None)
        # weights, order, table of the drag, floes and their density in the last exchange; None once `_sizes` are computed
        self._drag: tuple | None = None
        self.undelivered = np.zeros(2)
        self.layer_thickness: float | None = None
        self._curl: Vorticity | None = None
        self._period = period

    @property
    def magnitude(self) -> np.ndarray | None:
        return self._sizes_of_drag()[0]

    @property
    def coefficient(self) -> np.ndarray | None:
        return self._sizes_of_drag()[1]

    def _sizes_of_drag(self) -> tuple[np.ndarray | None, np.ndarray | None]:
        """Magnitude and coefficient, computed on request only, as few hosts need them."""
        if self._drag is not None:
            w, number, at, floes, density = self._drag
            mass = np.where(floes.active, floes.mass(density), 0.0)
            of_each = (lanes(at, name) for name in (X, Y, FLUID_U, FLUID_V, RATE))
            sizes_of_drag(
                *w[:-1], number, *of_each, floes.u, floes.v, mass, self.grid.area, *self._sizes
            )
            self._drag = None
        return self._sizes

    def arrays(self) -> dict[str, np.ndarray]:
        """All persistent arrays, by name."""
        names = (
            "impulse_x", "impulse_y", "last_x", "last_y", "magnitude", "coefficient", "undelivered",
        )  # fmt: skip
        found = self.fields | {name: getattr(self, name) for name in names}
        return {name: values for name, values in found.items() if values is not None}

    def refuse_not_finite(self, name: str, time: float) -> None:
        """Raise InputError for a value in a wet cell that is not finite, naming the fluid and the time [s]."""
        thickness = self.layer_thickness
        if thickness is not None and not (is_number(thickness) and thickness > 0):
            raise InputError(f"{name}.layer_thickness = {thickness!r}: must be greater than 0 m")
        for field, values in self.fields.items():
            bound = FASTEST if field in ("u", "v") else np.inf
            if all_finite(values, bound):
                continue
            wrong = ~(np.abs(values) < bound) & self.grid.wet
            if wrong.any():
                cell = int(np.argmax(wrong))
                right = "finite"
                if np.isfinite(values[cell]):
                    right = f"a velocity below {bound:g} m/s (a fill value, or wrong units?)"
                raise InputError(
                    f"{name}.{field}: {values[cell]} in wet cell {cell} at t = {time:g} s; must be {right}"
                )

    def half_curl(self) -> np.ndarray:
        """Rotation rate of the fluid, ½ (∂v/∂x − ∂u/∂y) [1/s], shape (grid.size,)."""
        if self._curl is None:
            self._curl = Vorticity(self.grid, self._period)
        curl = self._curl(self.u, self.v)
        curl *= 0.5
        return curl


# ---- between fluids and forces -----------------------------------------------------------------


def fluids_for(
    forces: Sequence[Force], grid: Grid, atmosphere_grid: Grid, period: Period
) -> dict[str, Fluid]:
    """The fluids that forces read, "ocean" and "atmosphere", at rest; period : of the domain, along x and y [m]."""
    read: dict[str, list[str]] = {}
    for force in forces:
        if type(force) in READS:
            name, fields = READS[type(force)]
            read.setdefault(name, []).extend(fields)
    fluids = {}
    if "ocean" in read:
        fluids["ocean"] = Fluid(grid, read["ocean"], ocean=True, period=period)
    if "atmosphere" in read:
        fluids["atmosphere"] = Fluid(atmosphere_grid, read["atmosphere"], period=period)
    return fluids


def fluid_of(force: Force, fluids: Mapping[str, Fluid]) -> Fluid | None:
    """The fluid that a force reads."""
    name, _ = READS.get(type(force), ("", {}))
    return fluids.get(name)


def sample(
    forces: Sequence[Force],
    tables: Sequence[np.ndarray],
    fluids: Mapping[str, Fluid],
    weights_on: Callable[[Grid], Weights],
    order: np.ndarray,
    rotation: bool,
) -> dict[Grid, Weights]:
    """Sample the fluids at the floes for each force; returns the weights used, by grid.

    tables : of each force, by block of floes; order : numbers of these floes; rotation : whether floes rotate
    """
    weights: dict[Grid, Weights] = {}
    nowhere: dict[Grid, tuple[np.ndarray, ...]] = {}  # block, lane of floes without a wet cell
    reads: dict[Grid, list[tuple[np.ndarray, np.ndarray]]] = {}  # fields, and where they go
    for force, at in zip(forces, tables, strict=True):
        fluid = fluid_of(force, fluids)
        if fluid is None:
            continue
        grid = fluid.grid
        if grid not in weights:
            weights[grid], reads[grid] = weights_on(grid), []
            dry = without_cell(weights[grid])
            dry = np.flatnonzero(dry[order]) if dry.any() else np.empty(0, np.int64)
            nowhere[grid] = np.divmod(dry, BLOCK)
        _, fields = READS[type(force)]
        reads[grid] += [(fluid.fields[name], lanes(at, row)) for name, row in fields.items()]
        if not isinstance(force, OceanDrag | AirDrag):
            continue
        lanes(at, RATE)[nowhere[grid]] = 0.0  # no water, no drag
        if rotation:
            reads[grid] += [(fluid.half_curl(), lanes(at, HALF_CURL))]
            lanes(at, SPIN_RATE)[nowhere[grid]] = 0.0
    for grid, each in reads.items():
        gather_each(weights[grid], order, *zip(*each, strict=True))
    return weights


def impulses_of_drag(
    forces: Sequence[Force],
    tables: Sequence[np.ndarray],
    fluids: Mapping[str, Fluid],
    weights: Mapping[Grid, Weights],
    order: np.ndarray,
) -> list[tuple]:
    """The impulses of drag on the floes, prepared for `give_impulses_back`; parameters as for `sample`.

    For each grid: its weights with the order of the floes, and for each fluid on it the impulses and their destination.
    """
    by_grid: dict[Grid, list[tuple[np.ndarray, ...]]] = {}
    for force, at in zip(forces, tables, strict=True):
        if isinstance(force, OceanDrag | AirDrag):
            f = fluid_of(force, fluids)
            by_grid.setdefault(f.grid, []).append((
                lanes(at, X), lanes(at, Y), f.last_x, f.last_y, f.impulse_x, f.impulse_y, f.undelivered
            ))  # fmt: skip
    return [((*weights[grid][:-1], order), tuple(each)) for grid, each in by_grid.items()]


def give_impulses_back(impulses: list[tuple]) -> None:
    """Give the fluids the opposite of the impulse of their drag."""
    for weights, each in impulses:
        give_back(*weights, each)
