"""Veros and floes, coupled both ways, in a box like Fram Strait or in a channel; nothing is downloaded.

The box is 400 km wide and long, with Greenland in the west, Svalbard in the east and shelves along both; ice comes
from the north under a northerly wind.  The channel is periodic, has a flat bottom without friction, and does not
rotate: only the surface stress changes the ocean's momentum along it, so Veros' own velocities can be checked against the
stress.

    python examples/veros_fram_strait.py [--folder veros-fram-strait] [--days 7] [--channel] [--restart 96]

makes two runs, each with Veros' progress bar: one in which the ocean feels the ice, one in which it does not; and two short
ones, of the ocean alone and with an ice model without floes, which must be the same.  It prints the ledger on Veros' own U
and V points, and draws what two-way coupling changes.  Veros and the ice save their states once a day; a two-way run that
was cut off resumes at the step with number --restart.
"""

import argparse
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from veros import runtime_settings

runtime_settings.backend = "numpy"  # before anything else of Veros
runtime_settings.loglevel = "error"

from veros import VerosSetup, veros_routine  # noqa: E402

import floebmi as fb  # noqa: E402
from coupling.ledger import HEADER, Exchange  # noqa: E402
from coupling.veros import SeaIce, Seconds, surface_cells  # noqa: E402
from floebmi.coast import Coast, from_land_fraction  # noqa: E402
from floebmi.forces import DRAG_PRESETS  # noqa: E402
from floebmi.plot import LAND, graph  # noqa: E402

LENGTH = 400e3  # of a side [m]
CORIOLIS = 1.43e-4  # at 79° N [1/s]
WIND = {False: (1.0, -7.0), True: (7.0, 0.0)}  # in the box, in the channel [m/s]
DRAG = 1.3 * 1.3e-3  # ρ C_d of open water under the wind [kg m-3]
# From the bottom.  Veros wants thicknesses and puts T points so that W points are midway between them: thicknesses
# that do not vary smoothly give it distances below 0, and mixing that un-mixes.  So the distances come first.
DISTANCES = np.array([400, 400, 300, 220, 160, 110, 75, 50, 32, 20, 15], float)  # [m]
LAYERS = 0.5 * (DISTANCES[1:] + DISTANCES[:-1])  # [m]

MakeIce = Callable[[fb.Grid], fb.Model]


def land(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """1 on Greenland and Svalbard, 0 in the strait."""
    x, y = x / LENGTH, y / LENGTH
    west = 0.17 + 0.06 * np.cos(np.pi * y)
    east = 0.83 + 0.08 * np.abs(y - 0.55)
    return ((x < west) | ((x > east) & (y > 0.3))).astype(float)


class Ocean(VerosSetup):
    """A box or a channel under a steady wind, stratified by temperature, with ice if `make_ice` is given."""

    def __init__(
        self, size: int, step: float, channel: bool = False, make_ice: MakeIce | None = None,
        two_way: bool = True, every: float = 3600.0, folder: Path | None = None, save_every: float = 86400.0,
        restart: int | None = None,
    ) -> None:  # fmt: skip
        self.size, self.time_step, self.channel = size, step, channel
        self.make_ice, self.two_way, self.every = make_ice, two_way, every
        self.folder, self.save_every, self.restart = folder, save_every, restart  # of saved states
        self.ice: SeaIce | None = None
        self.momentum_in = np.zeros(2)  # surface stress as Veros' time scheme weighs it [N s]
        self._last = np.zeros(2)
        self.until = 0.0
        self.took, self.spent = 0.0, Seconds(0.0, 0.0)  # wall clock: of the run, of its ice
        self.currents: list[tuple[np.ndarray, np.ndarray]] = []  # of the last day, at the surface
        super().__init__()

    @veros_routine
    def set_parameter(self, state):
        settings = state.settings
        settings.identifier = "floebmi"
        settings.nx, settings.ny, settings.nz = self.size, self.size, LAYERS.size
        settings.dt_mom = settings.dt_tracer = self.time_step
        settings.runlen = self.time_step
        settings.restart_output_filename = ""
        if self.folder is not None:
            settings.restart_output_filename = str(self.folder / "veros-{itt}.h5")
            settings.restart_frequency = self.save_every
        if self.restart is not None:
            settings.restart_input_filename = str(self.folder / f"veros-{self.restart}.h5")
        settings.coord_degree = False
        settings.enable_cyclic_x = self.channel
        settings.enable_streamfunction = False
        settings.enable_implicit_vert_friction = True
        settings.enable_hor_friction = True
        settings.A_h = 2000.0
        settings.enable_bottom_friction = not self.channel
        settings.r_bot = 1e-5
        settings.enable_tke = True
        settings.c_k, settings.c_eps, settings.alpha_tke = 0.1, 0.7, 30.0
        settings.mxl_min, settings.tke_mxl_choice = 1e-8, 2
        settings.kappaM_min, settings.kappaH_min = 2e-4, 2e-5
        settings.enable_kappaH_profile = False
        settings.eq_of_state_type = 3
        settings.enable_superbee_advection = True

    @veros_routine
    def set_grid(self, state):
        vs = state.variables
        vs.dxt = np.full_like(vs.dxt, LENGTH / self.size)
        vs.dyt = np.full_like(vs.dyt, LENGTH / self.size)
        vs.dzt = LAYERS.copy()

    @veros_routine
    def set_coriolis(self, state):
        vs = state.variables
        vs.coriolis_t = np.full_like(vs.coriolis_t, 0.0 if self.channel else CORIOLIS)

    @veros_routine
    def set_topography(self, state):
        vs = state.variables
        x, y = np.meshgrid(vs.xt, vs.yt, indexing="ij")
        bottom = np.ones(x.shape, int)
        if not self.channel:
            dry = land(x, y) > 0
            near = sum(land(x + dx, y) for dx in (-4e4, -2e4, 2e4, 4e4))  # shelves
            bottom = np.where(dry, 0, np.where(near > 0, 4 + near.astype(int), 1))
        vs.kbot = bottom.astype(vs.kbot.dtype)

    @veros_routine
    def set_initial_conditions(self, state):
        vs = state.variables
        cold = -1.5 + 3.0 * (1 - np.exp(vs.zt / 300.0))  # warmer below, held down by salt
        salt = 34.9 - 1.0 * np.exp(vs.zt / 100.0) - 0.6 * np.exp(vs.zt / 800.0)
        vs.temp = np.broadcast_to((cold * vs.maskT)[..., None], vs.temp.shape).copy()
        vs.salt = np.broadcast_to((salt * vs.maskT)[..., None], vs.salt.shape).copy()
        stress = DRAG * np.hypot(*WIND[self.channel]) * np.array(WIND[self.channel])
        self.wind = [
            stress[0] * np.asarray(vs.maskU[..., -1], float),
            stress[1] * np.asarray(vs.maskV[..., -1], float),
        ]
        if self.make_ice is not None:
            model = self.make_ice(surface_cells(state))
            files = [None, None]
            if self.folder is not None:
                files = [self.folder / "ice-rescue.nc", self.folder / "ice-{itt}.nc"]
            self.ice = SeaIce(state, model, self.every, self.two_way, *files)
            if self.restart is not None:
                self.ice.load_state(self.folder / f"ice-{self.restart}.nc")

    @veros_routine
    def set_forcing(self, state):
        vs, settings = state.variables, state.settings
        if self.ice is not None:
            self.ice.force(state, *self.wind)
            return
        vs.surface_taux, vs.surface_tauy = (tau.copy() for tau in self.wind)
        inner, before = slice(2, -2), slice(1, -3)
        magnitude = np.hypot(
            0.5 * (vs.surface_taux[inner, inner] + vs.surface_taux[before, inner]),
            0.5 * (vs.surface_tauy[inner, inner] + vs.surface_tauy[inner, before]),
        )
        tke = np.array(vs.forc_tke_surface)
        tke[inner, inner] = (magnitude / settings.rho_0) ** 1.5
        vs.forc_tke_surface = tke

    @veros_routine
    def after_timestep(self, state):
        vs, settings = state.variables, state.settings
        inner = (slice(2, -2), slice(2, -2))
        force = np.array(
            [
                (tau * mask[..., -1] * area)[inner].sum()
                for tau, mask, area in (
                    (vs.surface_taux, vs.maskU, vs.area_u), (vs.surface_tauy, vs.maskV, vs.area_v)
                )
            ]
        )  # fmt: skip
        ab = 0.5 + settings.AB_eps
        self.momentum_in += float(settings.dt_mom) * ((1 + ab) * force - ab * self._last)
        self._last = force
        if vs.time > self.until - 86400.0:
            self.currents.append(tuple(np.array(u[..., -1, vs.tau]) for u in (vs.u, vs.v)))

    @veros_routine
    def set_diagnostics(self, state):
        state.diagnostics.clear()

    def momentum(self) -> np.ndarray:
        """Momentum of the ocean along x and y [N s]; after a step its newest velocity is at `tau`."""
        vs, inner = self.state.variables, (slice(2, -2), slice(2, -2))
        return self.state.settings.rho_0 * np.array(
            [
                (u[..., vs.tau] * mask * area[..., None] * vs.dzt)[inner].sum()
                for u, mask, area in ((vs.u, vs.maskU, vs.area_u), (vs.v, vs.maskV, vs.area_v))
            ]
        )

    def go(self, days: float, show: bool) -> "Ocean":
        """Set up and run with Veros' own progress bar."""
        self.until = days * 86400.0
        self.setup()
        with self.state.settings.unlock():
            self.state.settings.runlen = self.until - float(self.state.variables.time)
        before, began = self.ice.seconds if self.ice else (0.0, 0.0), time.perf_counter()
        self.run(show_progress_bar=show)
        self.took = time.perf_counter() - began
        if self.ice is not None:  # the first exchange is made in `setup`
            self.spent = Seconds(*np.subtract(self.ice.seconds, before).tolist())
            if self.folder is not None:  # beside the restart file that Veros writes at the end
                self.ice.save_state(self.folder / f"ice-{self.state.variables.itt}.nc")
        return self


def make_ice(radius: tuple[float, float], concentration: float, channel: bool) -> MakeIce:
    """Floes at rest in the north of the box, or in the middle of the channel, and the coast of the box."""

    def made(grid: fb.Grid) -> fb.Model:
        west, east, south, north = grid.bounds
        word = "periodic" if channel else "closed"
        domain = fb.Domain((west, east), (south, north), word, word, "closed", "closed")
        coast: Coast | None = None
        floes = fb.Floes([], [], [], [])
        if not channel:
            x, y = np.linspace(west, east, 161), np.linspace(south, north, 161)
            coast = from_land_fraction(x, y, land(*np.meshgrid(x, y)), radius[0])
        if concentration > 0:
            ice = np.where(
                grid.wet & (grid.y > (0.25 if channel else 0.45) * north), concentration, 0.0
            )
            if channel:
                ice[grid.y > 0.75 * north] = 0.0
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # what found no room beside the coast
                floes = fb.from_field(
                    grid, ice, 1.5, fb.UniformSize(*radius), domain=domain, seed=3, land=coast
                )
        if coast is not None:
            floes = fb.Floes.concatenate([floes, coast.floes])
        ocean, air = DRAG_PRESETS["constant-cd"]
        forces = [ocean, air, fb.CoriolisField(), fb.Tilt()]
        soft = fb.frictional(youngs_modulus=1e6)
        model = fb.Model(domain, floes, contact=soft, forces=forces, grid=grid)
        model.atmosphere.u[:], model.atmosphere.v[:] = WIND[channel]
        return model

    return made


class Found(NamedTuple):
    """worst : largest residual of the ledger over the impulse exchanged; same : ocean without ice = ocean alone;
    momentum : in the channel, what Veros' own momentum along x is off, over what was put in; overhead : share of the wall
    clock that goes into reading the current, giving impulses back, regridding, blending and the ledger."""

    worst: float
    momentum: float | None
    same: float
    ledger: list[Exchange]
    overhead: float
    floes: int


def main(
    folder: Path, days: float = 7.0, channel: bool = False, size: int = 40, step: float = 900.0,
    radius: tuple[float, float] = (1.8e3, 4e3), concentration: float = 0.75, show: bool = True,
    restart: int | None = None,
) -> Found:  # fmt: skip
    """Run two-way, one-way, the ocean alone and the ocean with an empty ice model; ledger and figure."""
    folder.mkdir(parents=True, exist_ok=True)
    maker = make_ice(radius, concentration, channel)
    both = Ocean(size, step, channel, maker, folder=folder, restart=restart).go(days, show)
    one = Ocean(size, step, channel, maker, two_way=False).go(days, show)
    short = min(days, 0.25)
    alone = Ocean(size, step, channel).go(short, False)
    empty = Ocean(size, step, channel, make_ice(radius, 0.0, channel)).go(short, False)
    a, b = alone.state.variables, empty.state.variables
    same = max(
        float(np.abs(np.asarray(getattr(a, n)) - np.asarray(getattr(b, n))).max())
        for n in ("u", "v", "temp")
    )
    ice = both.ice
    print(HEADER)
    for line in ice.ledger[-3:]:
        print(line)
    worst = max(line.relative for line in ice.ledger)
    picture = folder / f"veros-{'channel' if channel else 'fram-strait'}.png"
    _draw(picture, both, one, days, worst)
    moving = int((ice.model.floes.active & ~ice.model.floes.land).sum())
    inside = (len(ice.ledger) - 1) * exchange_cost(ice.model, ice.every)
    overhead = (inside + both.spent.coupling) / both.took
    print(
        f"{moving} floes, {days:g} days both ways in {both.took:.1f} s: ocean"
        f" {both.took - sum(both.spent):.1f}, floes moving {both.spent.ice - inside:.1f}, floes reading the"
        f" current and giving it back {inside:.2f}, coupling {both.spent.coupling:.2f} s; the last two are"
        f" {overhead:.1%}"
    )
    momentum = None
    if channel and restart is None:
        put_in = both.momentum_in
        momentum = float(abs(both.momentum()[0] - put_in[0]) / np.abs(put_in).sum())
    return Found(worst, momentum, same, ice.ledger, overhead, moving)


def exchange_cost(model: fb.Model, every: float) -> float:
    """Seconds of an exchange that do not grow with its length: for reading the current, returning the impulse, the weights
    (also counted in the coupling's time) and the ledger.  Measured from short and long exchanges in turn, which advance the model."""
    found = []
    for _ in range(5):
        points = []
        for duration in (2 * model.longest_step(), every):
            before, began = model.counters.steps, time.perf_counter()
            model.advance(duration)
            points.append((model.counters.steps - before, time.perf_counter() - began))
        (few, short), (many, long) = points
        found.append(short - few * (long - short) / (many - few))
    return float(np.median(found))


def _draw(path: Path, both: Ocean, one: Ocean, days: float, worst: float) -> None:
    from matplotlib import colormaps
    from matplotlib.collections import EllipseCollection
    from matplotlib.colors import ListedColormap

    with graph(15, 5) as figure:
        panels = figure.subplots(1, 3, sharex=True, sharey=True)
        grid = both.ice.model.grid
        shape, wet = grid.shape, grid.wet.reshape(grid.shape)
        x, y = grid.x_edges / 1e3, grid.y_edges / 1e3
        speeds = [run.ice.at_cells(*np.mean(run.currents, axis=0)) for run in (both, one)]
        fastest = max(np.hypot(*pair).max() for pair in speeds)
        difference = np.hypot(*speeds[0]) - np.hypot(*speeds[1])
        most = np.abs(difference[grid.wet]).max()
        light = ListedColormap(colormaps["Blues"](np.linspace(0, 0.65, 256)))  # arrows stay legible
        every = max(1, shape[0] // 16)
        for panel, run, (u, v), title in zip(
            panels, (both, one), speeds, ("both ways", "one way: the ocean does not feel the ice"), strict=False
        ):  # fmt: skip
            speed = np.where(wet, np.hypot(u, v).reshape(shape), np.nan)
            sea = panel.pcolormesh(x, y, speed, vmin=0, vmax=fastest, cmap=light, rasterized=True)
            floes = run.ice.model.floes
            ice = floes.active & ~floes.land
            diameter = 2 * floes.radius[ice] / 1e3
            panel.add_collection(
                EllipseCollection(
                    diameter, diameter, 0 * diameter, units="xy", transOffset=panel.transData,
                    offsets=np.c_[floes.x[ice], floes.y[ice]] / 1e3, fc="none", ec="0.35", lw=0.4,
                )
            )  # fmt: skip
            some = np.zeros(shape, bool)
            some[every // 2 :: every, every // 2 :: every] = True
            some = some.ravel() & grid.wet
            arrows = panel.quiver(
                *(values[some] for values in (grid.x / 1e3, grid.y / 1e3, u, v)),
                scale=22 * fastest, width=3e-3, zorder=3,
            )  # fmt: skip
            panel.set_title(title)
        length = float(f"{fastest:.1g}")
        panels[0].quiverkey(arrows, 0.8, -0.1, length, f"{length:g} m/s", labelpos="E")
        change = panels[2].pcolormesh(
            x, y, np.where(wet, difference.reshape(shape), np.nan), cmap="RdBu_r", vmin=-most, vmax=most,
            rasterized=True,
        )  # fmt: skip
        panels[2].set_title("speed of the current: both ways − one way")
        for panel in panels:
            panel.set(xlabel="x [km]", aspect="equal", facecolor=LAND)
        panels[0].set_ylabel("y [km]")
        figure.colorbar(
            sea, ax=panels[1], label="surface current, mean of the last day [m/s]", aspect=30
        )
        figure.colorbar(change, ax=panels[2], label="difference [m/s]", aspect=30)
        figure.suptitle(
            f"Veros and floes after {days:g} d of wind; the momentum ledger closes to {worst:.0e}"
        )
        figure.savefig(path, dpi=130)


if __name__ == "__main__":
    words = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    words.add_argument("--folder", type=Path, default=Path("veros-fram-strait"))
    words.add_argument("--days", type=float, default=7.0)
    words.add_argument("--channel", action="store_true")
    words.add_argument("--restart", type=int, help="number of the step to go on from")
    words.add_argument("--radius", type=float, nargs=2, default=(1.8e3, 4e3), help="of floes [m]")
    given = vars(words.parse_args())
    print(*(f"{k} = {v}" for k, v in main(**given)._asdict().items() if k != "ledger"), sep="\n")
