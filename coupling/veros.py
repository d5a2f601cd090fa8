"""Floes on the primitive-equation ocean model Veros: currents act on the ice, and its stress on U and V points.

Veros has a C grid: T cell i has U point i on its east face and V point i on its north face.  The exchange grid of the ice
consists of the T cells of the surface layer (`surface_cells`), with Veros' own mask; `coupling.vectors.Staggered` transfers
currents from open U and V points to T cells and impulses back, with one matrix and with Veros' own areas of U and V cells.

A setup calls `SeaIce.force` at the end of its `set_forcing`, which Veros calls at the start of each step:

    @veros_routine
    def set_initial_conditions(self, state):
        …
        self.ice = SeaIce(state, make_model(surface_cells(state)), every=3600.0)

    @veros_routine
    def set_forcing(self, state):
        self.ice.force(state, self.wind_taux, self.wind_tauy)       # stress of the air on open water, [N m-2]

which writes, at U and V points,

    surface_tau = (1 − a) τ_wind + τ_ice            a: ice fraction, mean of the two T cells of a point

and where TKE is on, at T cells,

    forc_tke_surface = (1 − a) (|τ_wind| / ρ₀)^1.5 + a (|τ_ice| / (a ρ₀))^1.5        |τ_ice|: mean over time and floes

The stress of the air is an argument, and not read from `surface_taux`, because that array holds the blend of the previous
step.  When ice and ocean are at the same time, the ice advances first, by one exchange; the ocean follows with the mean
stress.  Without ice this reduces to Veros alone.

This module imports nothing from Veros; it writes arrays of its numpy backend.
"""

import time
from pathlib import Path
from typing import Any, NamedTuple, final

import numpy as np
from scipy.sparse import diags_array

from coupling.books import Books
from coupling.ledger import Exchange
from coupling.vectors import Staggered
from floebmi.arrays import digest
from floebmi.errors import InputError
from floebmi.grid import Grid
from floebmi.model import Model
from floebmi.quantities import is_number

SAME_TIME = 1e-9  # of an exchange
INNER = slice(2, -2)  # without the two ghost cells


def surface_cells(state: Any) -> Grid:
    """The T cells of Veros' surface layer, order (y, x), land dry.

    Raises
    ------
    InputError
        for a grid in degrees: floes move in a plane.
    """
    vs, settings = state.variables, state.settings
    if settings.coord_degree:
        raise InputError(
            "Veros: coord_degree = True: floes need metres in a plane; set coord_degree = False, and"
            " the Coriolis parameter of the place in set_coriolis"
        )
    edges = []
    for last, width in ((vs.xu, vs.dxt), (vs.yu, vs.dyt)):
        last, width = (np.asarray(values)[INNER].astype(float) for values in (last, width))
        edges.append(np.concatenate([[last[0] - width[0]], last]))
    wet = np.asarray(vs.maskT)[INNER, INNER, -1].T > 0
    return Grid.rectilinear(*edges, wet)


class Seconds(NamedTuple):
    """Wall-clock time spent since the start [s], by task."""

    ice: float  # floes moving
    coupling: float  # weights, regridding, exchange, blending, ledger


@final
class SeaIce:
    """A floe model on the surface of a Veros state.

    Parameters
    ----------
    state : state of a VerosSetup, once its masks exist (in `set_initial_conditions`)
    model : floe model with `grid=surface_cells(state)` and ocean drag.  If `CoriolisField` is among its forces it gets
        Veros' Coriolis parameter, if `Tilt` is, the slope of Veros' surface pressure
    every : time between exchanges [s], a whole number of Veros' time steps
    two_way : if False, the ocean does not feel the ice and is forced by the wind as if there were none
    rescue : file to which the state of the ice is saved if an exchange fails
    checkpoint : file to which the state of the ice is saved whenever Veros writes its restart file (every
        `restart_frequency`); `{itt}` in it stands for Veros' step number, as in `restart_output_filename`

    Attributes
    ----------
    ledger : momentum ledger on Veros' own U and V points, one line per exchange
    open_water : (2,) impulse of the air on open water since the start [N s]

    Raises
    ------
    InputError
        for a model with another grid or without ocean drag, an `every` that is not a whole number of steps, and layers
        for which Veros' distances between points are not greater than 0.
    """

    def __init__(
        self,
        state: Any,
        model: Model,
        every: float,
        two_way: bool = True,
        rescue: str | Path | None = None,
        checkpoint: str | Path | None = None,
    ) -> None:
        vs, settings = state.variables, state.settings
        distances = np.asarray(vs.dzw)
        if not (distances > 0).all():
            raise InputError(
                f"Veros: distances between the points of its layers, dzw = {distances.tolist()} m, are not all above"
                " 0 and would un-mix the ocean: thicknesses dzt must vary smoothly"
            )
        step = float(settings.dt_mom)
        if float(settings.dt_tracer) != step:
            raise InputError(
                f"Veros: dt_tracer = {settings.dt_tracer:g} s, dt_mom = {step:g} s: must be equal, for the"
                " ice has one clock"
            )
        steps = round(every / step) if is_number(every) else 0
        if steps < 1 or abs(steps * step - every) > SAME_TIME * every:
            raise InputError(
                f"every = {every!r} s: must be a whole number of Veros' steps, {step:g} s"
            )
        cells = surface_cells(state)
        if (
            model.ocean is None
            or model.grid.shape != cells.shape
            or (model.grid.x != cells.x).any()
        ):
            raise InputError(
                "Veros: the model's grid must be surface_cells(state), and OceanDrag among its forces"
            )
        self.model, self.every, self.two_way = model, float(every), two_way
        self.rescue, self.checkpoint = rescue, checkpoint
        self._known_grid = _digest(state)
        self._books = Books(model)
        self._cyclic = bool(settings.enable_cyclic_x)
        points = {}
        for name, mask, area in (
            ("u", vs.maskU[..., -1], vs.area_u),
            ("v", vs.maskV[..., -1], vs.area_v),
        ):
            points[name] = Staggered(
                model.grid, name, periodic=(self._cyclic, False),
                open=self._points(mask, name) > 0, area=self._points(area, name),
            )  # fmt: skip
        self._on = points
        self._mean = {name: _mean_of_cells(of) for name, of in points.items()}
        self._fraction = np.zeros(cells.size)
        self._stress = [np.zeros(points[name].open.size) for name in "uv"]
        self._magnitude = np.zeros(cells.size)
        if model.ocean.coriolis is not None:
            model.ocean.coriolis[:] = np.asarray(vs.coriolis_t)[INNER, INNER].T.ravel()
        self.ledger: list[Exchange] = []
        self.open_water = np.zeros(2)
        self._counted = -np.inf  # up to this time of Veros; setup and first step both call
        self._ice_seconds = self._coupling_seconds = 0.0
        model.ocean.layer_thickness = float(np.asarray(vs.dzt)[-1])

    # ---- Veros' arrays ---------------------------------------------------------------------------------

    def _points(self, array: Any, name: str) -> np.ndarray:
        """U points west of T cells, or V points south of them, and the last ones: flat (y, x)."""
        values = np.asarray(array)
        if name == "v":
            return values[INNER, 1:-2].T.ravel()
        return values[1 : -3 if self._cyclic else -2, INNER].T.ravel()

    def _to_veros(self, values: np.ndarray, name: str, into: np.ndarray) -> None:
        """The inverse of `_points`; ghost points that Veros does not read are left unchanged."""
        points = values.reshape(self._on[name].shape).T
        if name == "v":
            into[INNER, 1:-2] = points
        elif self._cyclic:
            into[1:-3, INNER] = points
            into[-3, INNER] = points[0]  # east of the last cell is west of the first
        else:
            into[1:-2, INNER] = points

    def at_cells(self, u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Surface velocity at the ice's cells, flat (y, x), from Veros' U and V points with ghost cells."""
        return tuple(
            self._on[name].state(self._points(of, name)) for name, of in (("u", u), ("v", v))
        )

    # ---- coupling -----------------------------------------------------------------------------------------

    def force(self, state: Any, taux: np.ndarray, tauy: np.ndarray) -> None:
        """Exchange if it is due, and write the surface stress of this step; positive accelerates the ocean.

        Parameters
        ----------
        taux, tauy : stress of the air on open water at U and V points [N m-2], Veros' shapes with ghost cells

        Raises
        ------
        InputError
            for stresses of another shape, a current that is not finite, a changed grid, or a time that is not the one
            that the ice expects.  The ice is then as before the exchange; its state is saved in `rescue`.
        """
        start, ice_before = time.perf_counter(), self._ice_seconds
        vs, settings = state.variables, state.settings
        for name, values in (("taux", taux), ("tauy", tauy)):
            if np.shape(values) != vs.maskT.shape[:2]:
                raise InputError(
                    f"{name} has shape {np.shape(values)}; must have Veros' own, {vs.maskT.shape[:2]}"
                )
        now, ice = float(vs.time), self.model.time
        if (
            self.checkpoint is not None and settings.restart_frequency and vs.itt > 0
            and now % settings.restart_frequency < settings.dt_tracer
        ):  # fmt: skip  # as Veros does, a moment ago
            self.save_state(str(self.checkpoint).format(itt=vs.itt))
        tolerance = SAME_TIME * self.every
        if abs(now - ice) <= tolerance:
            with self._books.unchanged_on_failure(self.rescue):
                self._exchange(state)
        elif not ice - self.every - tolerance <= now < ice:
            with self._books.unchanged_on_failure(self.rescue):
                raise InputError(
                    f"Veros is at {now:g} s, where the exchange of {max(0.0, ice - self.every):g} … {ice:g} s"
                    " is under way: a clock went back or jumped"
                )
        self._blend(state, np.array(taux, float), np.array(tauy, float))
        self._coupling_seconds += time.perf_counter() - start - (self._ice_seconds - ice_before)

    def _exchange(self, state: Any) -> None:
        vs, model = state.variables, self.model
        if _digest(state) != self._known_grid:
            raise InputError(
                "Veros: masks or areas of the surface layer have changed since SeaIce was made; make a new one"
            )
        currents = (np.asarray(of)[..., -1, vs.tau] for of in (vs.u, vs.v))
        model.ocean.u[:], model.ocean.v[:] = self.at_cells(*currents)
        if model.ocean.tilt_x is not None:
            self._tilt(state)
        self._books.open()
        model.weights(model.grid)  # a part of the exchange; `advance` finds it made
        before = time.perf_counter()
        model.advance(self.every)
        self._ice_seconds += time.perf_counter() - before
        delivered, missed = np.zeros(2), np.zeros(2)
        for axis, (name, last) in enumerate(
            zip("uv", (model.ocean.last_x, model.ocean.last_y), strict=True)
        ):
            points, mean = self._on[name], last / model.grid.area / self.every
            self._stress[axis] = points.flux(mean)
            delivered[axis] = (self._stress[axis] * points.area).sum() * self.every
            missed[axis] = points.undelivered(mean) * self.every
        ice = model.coverage().in_cells
        self._fraction = np.where(model.grid.wet, np.minimum(1.0, ice / model.grid.area), 0.0)
        self._magnitude = model.ocean.magnitude / self.every
        self.ledger.append(self._books.close(delivered, missed))

    def _tilt(self, state: Any) -> None:
        """Slope of the surface from the difference of surface pressure across open points."""
        vs, settings = state.variables, state.settings
        if settings.enable_streamfunction:
            raise InputError(
                "Veros: Tilt needs the surface pressure; set enable_streamfunction = False, or leave Tilt out"
            )
        height = np.asarray(vs.psi)[..., vs.tau] / settings.grav
        for name, axis, distance in (("u", 0, vs.dxu[:, None]), ("v", 1, vs.dyu[None, :])):
            slope = np.zeros_like(height)
            inner = (slice(None, -1), slice(None)) if axis == 0 else (slice(None), slice(None, -1))
            slope[inner] = (
                np.diff(height, axis=axis) / np.broadcast_to(distance, height.shape)[inner]
            )
            getattr(self.model.ocean, f"tilt_{'xy'[axis]}")[:] = self._on[name].state(
                self._points(slope, name)
            )

    def _blend(self, state: Any, taux: np.ndarray, tauy: np.ndarray) -> None:
        """Write the surface stress, blended in place from the air's in `taux` and `tauy`, and the forcing of TKE."""
        vs, settings = state.variables, state.settings
        new_step = float(vs.time) >= self._counted
        if new_step:
            self._counted = float(vs.time) + 0.5 * float(settings.dt_mom)
        if settings.enable_tke:
            vs.forc_tke_surface = self._stirring(state, taux, tauy)
        for axis, (name, stress) in enumerate((("u", taux), ("v", tauy))):
            points, air = self._on[name], self._points(stress, name)
            if self.two_way:
                air = (1.0 - self._mean[name] @ self._fraction) * air
            here = np.where(points.open, air, 0.0)
            if new_step:
                self.open_water[axis] += (here * points.area).sum() * float(settings.dt_mom)
            self._to_veros(air + self._stress[axis] if self.two_way else air, name, stress)
        vs.surface_taux, vs.surface_tauy = taux, tauy

    def _stirring(self, state: Any, taux: np.ndarray, tauy: np.ndarray) -> np.ndarray:
        """`forc_tke_surface` of this step, from the stress of the air and that of the ice."""
        vs, settings = state.variables, state.settings
        air = np.hypot(
            0.5 * (taux[INNER, INNER] + taux[1:-3, INNER]),
            0.5 * (tauy[INNER, INNER] + tauy[INNER, 1:-3]),
        )
        tke = (air / settings.rho_0) ** 1.5
        if self.two_way:
            cover = self.fraction.T
            per_ice = np.divide(
                self._magnitude, self._fraction, out=np.zeros_like(self._fraction), where=self._fraction > 0
            ).reshape(self.model.grid.shape).T  # fmt: skip
            tke = (1.0 - cover) * tke + cover * (per_ice / settings.rho_0) ** 1.5
        surface = np.array(vs.forc_tke_surface, float)
        surface[INNER, INNER] = tke
        return surface

    # ---- to look at, and restart ------------------------------------------------------------------------

    @property
    def seconds(self) -> Seconds:
        """Wall-clock time spent since the start [s]."""
        return Seconds(self._ice_seconds, self._coupling_seconds)

    @property
    def fraction(self) -> np.ndarray:
        """Ice area fraction as used by the ocean, (ny, nx) [1]."""
        return self._fraction.reshape(self.model.grid.shape)

    def save_state(self, path: str | Path) -> None:
        """Save a restart file of the ice and the stress of the current exchange; Veros writes its own restart file."""
        host = {
            "stress_u": self._stress[0], "stress_v": self._stress[1], "fraction": self._fraction,
            "magnitude": self._magnitude, "open_water": self.open_water, "counted": self._counted,
        }  # fmt: skip
        self._books.save(path, host)

    def load_state(self, path: str | Path) -> None:
        """Continue from `save_state`, on the same grid and at the same time of Veros.

        With Veros' own restart file, call it in `set_initial_conditions`, because `setup` calls `set_forcing` before the
        first step.
        """
        host = self._books.load(path)
        if not host:  # saved by a failed exchange: the next call makes it anew
            return
        self._stress = [np.array(host[f"stress_{name}"]) for name in "uv"]
        self._fraction, self._magnitude = np.array(host["fraction"]), np.array(host["magnitude"])
        self.open_water, self._counted = np.array(host["open_water"]), float(host["counted"])


def _digest(state: Any) -> str:
    """Checksum of the part of Veros' state from which the weights were made."""
    vs = state.variables
    masks = (mask[..., -1] for mask in (vs.maskT, vs.maskU, vs.maskV))
    return digest(*masks, vs.area_u, vs.area_v)


def _mean_of_cells(points: Staggered) -> Any:
    """Mean of the cells beside each open point, as a sparse matrix (points, cells)."""
    beside = points.weights > 0
    return diags_array(1.0 / np.maximum(beside.sum(axis=1), 1)) @ beside
