"""Components that are wrong in one way each: `bmi_conformance` must find every one."""

from collections.abc import Callable
from typing import ClassVar

import numpy as np
from bmi_conformance import (
    DRIFT,
    FRACTION,
    IMPULSE,
    MASS,
    MOMENTUM,
    OCEAN,
    OF_AIR,
    ON_OCEAN,
    PER_ICE,
    WIND,
)

from floebmi import FloeBmi

Kind = type[FloeBmi]
MUTANTS: list[tuple[Kind, str]] = []  # with the check that must find it
FACE_MUTANTS: list[tuple[Kind, str]] = []  # the same, for scenes seen as faces


def mutant(check: str) -> Callable[[Kind], Kind]:
    def listed(kind: Kind) -> Kind:
        MUTANTS.append((kind, check))
        return kind

    return listed


def face_mutant(check: str) -> Callable[[Kind], Kind]:
    def listed(kind: Kind) -> Kind:
        FACE_MUTANTS.append((kind, check))
        return kind

    return listed


def swapped(name: str, pair: tuple[str, str]) -> str:
    return pair[1 - pair.index(name)] if name in pair else name


class Spoiled(FloeBmi):
    """Outputs are wrong whenever they are written: `spoil` changes them in place."""

    def spoil(self) -> None: ...

    def initialize(self, config_file: str) -> None:
        super().initialize(config_file)
        show = self._running.show

        def spoiled(fields: dict[str, np.ndarray]) -> None:
            show(fields)
            self.spoil()

        self._running.show = spoiled
        self.spoil()


# ---- control ------------------------------------------------------------------------------------


@mutant("updates")
class UpdateDoesNothing(FloeBmi):
    def update(self) -> None: ...

    def update_until(self, time: float) -> None: ...


@mutant("updates")
class OnlyTheClockMoves(FloeBmi):
    def update(self) -> None:
        self.model.time += self.get_time_step()

    def update_until(self, time: float) -> None:
        self.model.time = float(time)


@mutant("updates")
class UpdateIsOneStepTooFar(FloeBmi):
    def update(self) -> None:
        super().update()
        super().update()


@mutant("updates")
class UpdateUntilOvershoots(FloeBmi):
    def update_until(self, time: float) -> None:
        while self.get_current_time() < time:
            self.update()


@mutant("updates")
class UpdateUntilStopsShort(FloeBmi):
    def update_until(self, time: float) -> None:
        while self.get_current_time() + self.get_time_step() <= time:
            self.update()


@mutant("updates")
class UpdateUntilGoesOnlyByOneUpdate(FloeBmi):
    def update_until(self, time: float) -> None:
        self.update()


@mutant("updates")
class UpdateUntilForgivesThePast(FloeBmi):
    def update_until(self, time: float) -> None:
        if not time < self.get_current_time():
            super().update_until(time)


@mutant("updates")
class UpdateUntilTakesNaN(FloeBmi):
    def update_until(self, time: float) -> None:
        if np.isfinite(time):
            super().update_until(time)


@mutant("updates")
class UpdateReturnsTheTime(FloeBmi):
    def update(self) -> float:
        super().update()
        return self.get_current_time()


@mutant("before_initialize")
class UpdateBeforeInitializeIsSilent(FloeBmi):
    def update(self) -> None:
        if self._running is not None:
            super().update()


@mutant("updates")
class LongUpdateShowsTheLastExchangeOnly(FloeBmi):
    def update_until(self, time: float) -> None:
        super().update_until(time)
        fields = self.model.fields()
        for a, name in zip("xy", ON_OCEAN, strict=True):
            self.get_value_ptr(name)[:] = fields[f"ocean_stress_{a}"]


@mutant("ending")
class FinalizeKeepsRunning(FloeBmi):
    def finalize(self) -> None: ...

    def initialize(self, config_file: str) -> None:
        self._running = None
        super().initialize(config_file)


@mutant("ending")
class SecondInitializeGoesOn(FloeBmi):
    def finalize(self) -> None:
        self.kept, self._running = self._running, None

    def initialize(self, config_file: str) -> None:
        if hasattr(self, "kept"):
            self._running = self.kept
        else:
            super().initialize(config_file)


@mutant("independence")
class InstancesShareTheirModel(FloeBmi):
    shared: ClassVar[dict] = {}

    def initialize(self, config_file: str) -> None:
        if config_file not in self.shared:
            super().initialize(config_file)
            self.shared[config_file] = self._running
        self._running = self.shared[config_file]


@mutant("independence")
class InitializeIsRandom(FloeBmi):
    def initialize(self, config_file: str) -> None:
        super().initialize(config_file)
        floes = self.model.floes
        floes.x += np.random.default_rng().uniform(-1, 1, len(floes))
        self._running.show({})


@mutant("variables")
class OutputsAreEmptyUntilTheFirstUpdate(FloeBmi):
    def initialize(self, config_file: str) -> None:
        super().initialize(config_file)
        for name in (FRACTION, MASS):
            self.get_value_ptr(name)[:] = np.nan


# ---- time ---------------------------------------------------------------------------------------


@mutant("clock")
class StartIsNotZero(FloeBmi):
    def get_start_time(self) -> float:
        return 1.0


@mutant("clock")
class TimesAreIntegers(FloeBmi):
    def get_current_time(self) -> int:
        return int(super().get_current_time())


@mutant("updates")
class TimeStepIsTheContactStep(FloeBmi):
    def get_time_step(self) -> float:
        return self.model.longest_step()


@mutant("updates")
class TimeIsOneStepLate(FloeBmi):
    def get_current_time(self) -> float:
        return max(0.0, super().get_current_time() - self.get_time_step())


@mutant("clock")
class TimeIsInHours(FloeBmi):
    def get_time_units(self) -> str:
        return "h"


@mutant("clock")
class EndIsTheStart(FloeBmi):
    def get_end_time(self) -> float:
        return 0.0


# ---- names, types, units ------------------------------------------------------------------------


@mutant("clock")
class CountIsOffByOne(FloeBmi):
    def get_output_item_count(self) -> int:
        return super().get_output_item_count() - 1


@mutant("clock")
class OutputIsAlsoInput(FloeBmi):
    def get_input_var_names(self) -> tuple[str, ...]:
        return (*super().get_input_var_names(), FRACTION)


@mutant("before_initialize")
class NoNamesBeforeInitialize(FloeBmi):
    def get_input_var_names(self) -> tuple[str, ...]:
        return () if self._running is None else super().get_input_var_names()


@mutant("variables")
class VelocityIsInCentimetres(FloeBmi):
    def get_var_units(self, name: str) -> str:
        return "cm s-1" if name in DRIFT else super().get_var_units(name)


@mutant("variables")
class RunningImpulseIsCalledAStress(FloeBmi):
    def get_var_units(self, name: str) -> str:
        return "Pa" if name in IMPULSE else super().get_var_units(name)


@mutant("variables")
class ItemsizeIsInBits(FloeBmi):
    def get_var_itemsize(self, name: str) -> int:
        return 8 * super().get_var_itemsize(name)


@mutant("variables")
class NbytesIsTheCount(FloeBmi):
    def get_var_nbytes(self, name: str) -> int:
        return super().get_var_nbytes(name) // 8


@mutant("variables")
class TypeIsFloat32(FloeBmi):
    def get_var_type(self, name: str) -> str:
        return "float32"

    def get_var_itemsize(self, name: str) -> int:
        return 4


@mutant("variables")
class UnknownNameIsTheFirstVariable(FloeBmi):
    def get_value_ptr(self, name: str) -> np.ndarray:
        return super().get_value_ptr(name if name in self._rows() else FRACTION)


@mutant("variables")
class ErrorsHaveManyLines(FloeBmi):
    def get_var_units(self, name: str) -> str:
        if name not in self._rows():
            raise ValueError("unknown name\n" + "\n".join(self._rows()))
        return super().get_var_units(name)


# ---- grids --------------------------------------------------------------------------------------


@mutant("grids")
class ShapeIsXThenY(FloeBmi):
    def get_grid_shape(self, grid: int, shape: np.ndarray) -> np.ndarray:
        super().get_grid_shape(grid, shape)
        shape[:] = shape[::-1].copy()
        return shape


@mutant("grids")
class SpacingIsXThenY(FloeBmi):
    def get_grid_spacing(self, grid: int, spacing: np.ndarray) -> np.ndarray:
        super().get_grid_spacing(grid, spacing)
        spacing[:] = spacing[::-1].copy()
        return spacing


@mutant("grids")
class OriginIsTheCorner(FloeBmi):
    def get_grid_origin(self, grid: int, origin: np.ndarray) -> np.ndarray:
        super().get_grid_origin(grid, origin)
        origin -= 0.5 * self.get_grid_spacing(grid, np.empty(2))
        return origin


@mutant("grids")
class ShapeIsANewArray(FloeBmi):
    def get_grid_shape(self, grid: int, shape: np.ndarray) -> np.ndarray:
        return super().get_grid_shape(grid, shape).copy()


@mutant("grids")
class GridRankCountsTheScalar(FloeBmi):
    def get_grid_rank(self, grid: int) -> int:
        return 2


@mutant("variables")
class EachVariableHasItsOwnGrid(FloeBmi):
    def get_var_grid(self, name: str) -> int:
        return list(self._rows()).index(name)


@mutant("variables")
class StressesAreOnTheWindsGrid(FloeBmi):
    def get_var_grid(self, name: str) -> int:
        return super().get_var_grid(WIND[0] if name in ON_OCEAN else name)


@mutant("grids")
class UnknownGridIsTheFirst(FloeBmi):
    def get_grid_type(self, grid: int) -> str:
        return super().get_grid_type(grid if grid in self._running.layouts else 0)


@mutant("grids")
class RowsRunFromNorthToSouth(FloeBmi):
    def get_grid_y(self, grid: int, y: np.ndarray) -> np.ndarray:
        super().get_grid_y(grid, y)
        y[:] = y[::-1].copy()
        return y


# ---- faces, for scenes with `cells = "faces"` ------------------------------------------------------


@face_mutant("grids")
class FacesAreClockwise(FloeBmi):
    def get_grid_face_nodes(self, grid: int, face_nodes: np.ndarray) -> np.ndarray:
        super().get_grid_face_nodes(grid, face_nodes)
        face_nodes[:] = face_nodes.reshape(-1, 4)[:, ::-1].ravel()
        return face_nodes


@face_mutant("grids")
class NodesAreCountedFromOne(FloeBmi):
    def get_grid_face_nodes(self, grid: int, face_nodes: np.ndarray) -> np.ndarray:
        super().get_grid_face_nodes(grid, face_nodes)
        face_nodes += 1
        return face_nodes


@face_mutant("grids")
class EdgesAreRotated(FloeBmi):
    def get_grid_face_edges(self, grid: int, face_edges: np.ndarray) -> np.ndarray:
        super().get_grid_face_edges(grid, face_edges)
        face_edges[:] = np.roll(face_edges.reshape(-1, 4), 1, axis=1).ravel()
        return face_edges


@face_mutant("variables")
class FacesAreSaidToBeNodes(FloeBmi):
    def get_var_location(self, name: str) -> str:
        return "node"


@face_mutant("grids")
class EdgesOfEachFaceAreItsOwn(FloeBmi):
    def get_grid_edge_count(self, grid: int) -> int:
        return 4 * self.get_grid_face_count(grid)

    def get_grid_edge_nodes(self, grid: int, edge_nodes: np.ndarray) -> np.ndarray:
        nodes = np.empty(edge_nodes.size // 2, np.int64)
        super().get_grid_face_nodes(grid, nodes)
        edge_nodes[0::2] = nodes
        edge_nodes[1::2] = np.roll(nodes.reshape(-1, 4), -1, axis=1).ravel()
        return edge_nodes

    def get_grid_face_edges(self, grid: int, face_edges: np.ndarray) -> np.ndarray:
        face_edges[:] = np.arange(face_edges.size)
        return face_edges


# ---- values -------------------------------------------------------------------------------------


@mutant("getters")
class PointersAreCopies(FloeBmi):
    def get_value_ptr(self, name: str) -> np.ndarray:
        return super().get_value_ptr(name).copy()


@mutant("updates")
class OutputsAreNewArraysAfterEachUpdate(FloeBmi):
    def update(self) -> None:
        super().update()
        self._running.values |= {
            n: self.get_value_ptr(n).copy() for n in self.get_output_var_names()
        }


@mutant("getters")
class GetValueReturnsANewArray(FloeBmi):
    def get_value(self, name: str, dest: np.ndarray) -> np.ndarray:
        return super().get_value(name, dest).copy()


@mutant("getters")
class GetValueLeavesTheBufferAlone(FloeBmi):
    def get_value(self, name: str, dest: np.ndarray) -> np.ndarray:
        return self.get_value_ptr(name)


@mutant("getters")
class GetValueBroadcasts(FloeBmi):
    def get_value(self, name: str, dest: np.ndarray) -> np.ndarray:
        dest[:] = np.resize(self.get_value_ptr(name), dest.size)
        return dest


@mutant("getters")
class NegativeIndicesCountFromTheEnd(FloeBmi):
    def get_value_at_indices(self, name: str, dest: np.ndarray, inds: np.ndarray) -> np.ndarray:
        dest[:] = self.get_value_ptr(name)[inds]
        return dest


@mutant("getters")
class IndicesAreCountedFromOne(FloeBmi):
    def get_value_at_indices(self, name: str, dest: np.ndarray, inds: np.ndarray) -> np.ndarray:
        return super().get_value_at_indices(name, dest, np.maximum(np.asarray(inds) - 1, 0))


@mutant("getters")
class IndicesAreSorted(FloeBmi):
    def get_value_at_indices(self, name: str, dest: np.ndarray, inds: np.ndarray) -> np.ndarray:
        return super().get_value_at_indices(name, dest, np.sort(inds))


@mutant("setters")
class SetValueKeepsTheHostsArray(FloeBmi):
    def set_value(self, name: str, src: np.ndarray) -> None:
        super().set_value(name, src)
        self._running.values[name] = src


@mutant("setters")
class SetValueIsIgnored(FloeBmi):
    def set_value(self, name: str, src: np.ndarray) -> None: ...


@mutant("setters")
class SetValueSwapsXAndY(FloeBmi):
    def set_value(self, name: str, src: np.ndarray) -> None:
        super().set_value(swapped(swapped(name, OCEAN), WIND), src)


@mutant("setters")
class SetValueTakesNaN(FloeBmi):
    def _refuse_not_finite(self, row, given: np.ndarray, inds: np.ndarray) -> None: ...


@mutant("setters")
class SetValueTurnsNaNIntoZero(FloeBmi):
    def set_value(self, name: str, src: np.ndarray) -> None:
        super().set_value(name, np.nan_to_num(src) if src.dtype.kind == "f" else src)


@mutant("setters")
class SetValueBroadcasts(FloeBmi):
    def set_value(self, name: str, src: np.ndarray) -> None:
        super().set_value(name, np.resize(src, self.get_value_ptr(name).size))


@mutant("setters")
class RefusedSetValueLeavesHalf(FloeBmi):
    def set_value(self, name: str, src: np.ndarray) -> None:
        src = np.asarray(src)
        if src.dtype.kind == "f" and src.size == self.get_value_ptr(name).size:
            self.get_value_ptr(name)[:2] = src[:2]
        super().set_value(name, src)


@mutant("setters")
class ErrorDoesNotNameTheVariable(FloeBmi):
    def set_value(self, name: str, src: np.ndarray) -> None:
        try:
            super().set_value(name, src)
        except ValueError:
            raise ValueError("bad values") from None


@mutant("setters")
class OutputsCanBeSet(FloeBmi):
    def set_value(self, name: str, src: np.ndarray) -> None:
        if name in self.get_output_var_names():
            self.get_value_ptr(name)[:] = src
        else:
            super().set_value(name, src)


@mutant("setters")
class SceneOverwritesTheHost(FloeBmi):
    def set_value(self, name: str, src: np.ndarray) -> None:
        sources = dict(self._running.sources)
        super().set_value(name, src)
        self._running.sources.update(sources)
        self._running.filled.clear()

    def set_value_at_indices(self, name: str, inds: np.ndarray, src: np.ndarray) -> None:
        sources = dict(self._running.sources)
        super().set_value_at_indices(name, inds, src)
        self._running.sources.update(sources)
        self._running.filled.clear()


# ---- physics ------------------------------------------------------------------------------------


@mutant("signs")
class StressIsOnTheIce(Spoiled):
    def spoil(self) -> None:
        for name in (*ON_OCEAN, *IMPULSE):
            self.get_value_ptr(name)[:] *= -1.0


@mutant("signs")
class AirStressIsOnTheAir(Spoiled):
    def spoil(self) -> None:
        for name in OF_AIR:
            self.get_value_ptr(name)[:] *= -1.0


@mutant("signs")
class StressesAreSwapped(Spoiled):
    def spoil(self) -> None:
        for pair in (ON_OCEAN, IMPULSE, PER_ICE):
            x, y = map(self.get_value_ptr, pair)
            x[:], y[:] = y.copy(), x.copy()


@mutant("conservation")
class StressIsPerIceArea(Spoiled):
    """What another model does: too large by one over the concentration."""

    def spoil(self) -> None:
        for cell, ice in zip(ON_OCEAN, PER_ICE, strict=True):
            self.get_value_ptr(cell)[:] = self.get_value_ptr(ice)


@mutant("conservation")
class ImpulseIsWeightedTwice(Spoiled):
    def spoil(self) -> None:
        for name in (*ON_OCEAN, *IMPULSE):
            self.get_value_ptr(name)[:] *= self.get_value_ptr(FRACTION)


@mutant("updates")
class ImpulseStartsAnewAtEachUpdate(Spoiled):
    def spoil(self) -> None:
        for stress, impulse in zip(ON_OCEAN, IMPULSE, strict=True):
            self.get_value_ptr(impulse)[:] = self.get_value_ptr(stress) * self.get_time_step()


@mutant("conservation")
class StressIsOfTheLastStep(Spoiled):
    """The drag on the velocity at the end of the exchange, not the mean of what was used."""

    def spoil(self) -> None:
        coefficient = self.get_value_ptr("sea_ice_bottom_water_flowing__linear_drag_coefficient")
        for stress, drift, water in zip(ON_OCEAN, DRIFT, OCEAN, strict=True):
            slip = self.get_value_ptr(drift) - self.get_value_ptr(water)
            self.get_value_ptr(stress)[:] = coefficient * slip


@mutant("conservation")
class ImpulseLeaksAtOneCell(Spoiled):
    def spoil(self) -> None:
        for name in IMPULSE:
            self.get_value_ptr(name)[3] = 0.0


@mutant("conservation")
class WindFeelsHalfTheArea(Spoiled):
    def spoil(self) -> None:
        for name in OF_AIR:
            self.get_value_ptr(name)[:] *= 0.5


@mutant("signs")
class MomentumForgetsItsSign(Spoiled):
    def spoil(self) -> None:
        for name in MOMENTUM:
            self.get_value_ptr(name)[:] *= -1.0


@mutant("conservation")
class AreaFractionIsInPercent(Spoiled):
    def spoil(self) -> None:
        self.get_value_ptr(FRACTION)[:] *= 100.0


@mutant("conservation")
class MassIsPerIceArea(Spoiled):
    def spoil(self) -> None:
        self.get_value_ptr(MASS)[:] /= np.maximum(self.get_value_ptr(FRACTION), 1e-3)


@mutant("conservation")
class CellsRunXFirst(Spoiled):
    """Fortran order in the outputs only."""

    def spoil(self) -> None:
        shape = self.get_grid_shape(0, np.empty(2, int))
        for name in (*ON_OCEAN,):
            values = self.get_value_ptr(name)
            values[:] = values.reshape(shape).T.ravel()


# ---- restart ------------------------------------------------------------------------------------


@mutant("restart")
class LoadForgetsTheTime(FloeBmi):
    def load_state(self, path) -> None:
        time = self.get_current_time()
        super().load_state(path)
        self.model.time = time


@mutant("restart")
class LoadShowsStaleOutputs(FloeBmi):
    def load_state(self, path) -> None:
        old = {name: self.get_value_ptr(name).copy() for name in self.get_output_var_names()}
        super().load_state(path)
        for name, values in old.items():
            self.get_value_ptr(name)[:] = values


@mutant("restart")
class LoadOfNothingIsSilent(FloeBmi):
    def load_state(self, path) -> None:
        if path.exists():
            super().load_state(path)
