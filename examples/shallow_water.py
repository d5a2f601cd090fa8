"""Floes and a shallow-water model, coupled both ways: the seiche of a basin is slowed by the ice that it moves.

The host is `shallowwater` (a free surface on a C grid, in metres).  Its velocities are on the faces of its cells; the ice
gives its stress at their centres.  `coupling.vectors.Staggered` interpolates both ways with one matrix, so that the open
faces get all that the ice gives, at the shore too.

    python examples/shallow_water.py [--folder shallow-water] [--hours 6] [--concentration 0.7]

The momentum budget of an exchange along an axis is the line of the ledger, and that of the water itself:

    Σ ρ H u A  after − before  =  Σ A τ Δt  +  what the basin does alone (pressure on its shores, Coriolis force)

The last term is summed over the host's own Runge-Kutta stages, so that the budget closes to round-off.
"""

import argparse
from pathlib import Path
from typing import Any, NamedTuple, final

import numpy as np
import shallowwater as sw
from shallowwater.dynamics import tendencies

import floebmi as fb
from coupling.books import Books
from coupling.ledger import HEADER, Exchange
from coupling.vectors import Staggered
from floebmi.errors import InputError
from floebmi.forces import DRAG_PRESETS
from floebmi.plot import graph

STAGES = (1 / 6, 1 / 6, 2 / 3)  # weights of the host's third-order Runge-Kutta scheme
SIDE = (40e3, 30e3)
DEPTH = 10.0


@final
class IcyBasin:
    """A shallow-water model and floes that advance together.

    Parameters
    ----------
    grid, params : of shallowwater; a linear model, for its momentum is Σ ρ H u A
    state : its eta, u, v at the start
    model : the ice, with closed edges around the basin
    dt : step of the host [s]
    rescue : file for the state of both if an exchange fails

    Attributes
    ----------
    state : eta (Ny, Nx), u (Ny, Nx + 1), v (Ny + 1, Nx) of the water now
    own : (2,) impulse that the basin gave to its water since the start, by pressure and Coriolis force [N s]
    """

    def __init__(
        self,
        grid: sw.Grid,
        params: sw.ModelParams,
        state: dict[str, np.ndarray],
        model: fb.Model,
        dt: float,
        rescue: Path | None = None,
    ) -> None:
        self.grid, self.params, self.dt, self.rescue = grid, params, dt, rescue
        self.state = {name: values.copy() for name, values in state.items()}
        self.model, self.books = model, Books(model)
        self.faces = {name: Staggered(model.grid, name) for name in ("u", "v")}
        self.own = np.zeros(2)
        self.stress = {name: np.zeros(faces.shape) for name, faces in self.faces.items()}

    def exchange(self, until: float) -> Exchange:
        """Advance to a time [s]: the ice first, then the water under the mean stress of the ice; both or neither."""
        before = self.snapshot()
        with self.books.unchanged_on_failure(self.rescue, before):
            try:
                return self._exchange(until)
            except BaseException:
                self.put(before)
                raise

    def _exchange(self, until: float) -> Exchange:
        model, ocean = self.model, self.model.ocean
        duration = until - model.time
        steps = round(duration / self.dt)
        if steps < 1 or abs(steps * self.dt - duration) > 1e-9 * self.dt:
            raise InputError(
                f"exchange from {model.time:g} to {until:g} s: must be a whole number of the host's steps of"
                f" {self.dt:g} s, at least 1"
            )
        for name in ("u", "v"):
            getattr(ocean, name)[:] = self.faces[name].state(self.state[name])
        self.books.open()
        model.advance(duration)
        delivered, missed = np.zeros(2), np.zeros(2)
        for axis, (name, last) in enumerate(zip("uv", (ocean.last_x, ocean.last_y), strict=True)):
            faces, mean = self.faces[name], last / model.grid.area / duration
            self.stress[name] = faces.flux(mean).reshape(faces.shape)
            delivered[axis] = (self.stress[name].ravel() * faces.area).sum() * duration
            missed[axis] = faces.undelivered(mean) * duration
        start = self.momentum()
        self._run(steps)
        return self.books.close(delivered, missed, self.momentum() - start)

    def _run(self, steps: int) -> None:
        still = np.zeros_like(self.state["eta"])
        calls = 0

        def count_own(state: Any, t: float, grid: sw.Grid, params: sw.ModelParams) -> tuple:
            nonlocal calls
            _, du, dv = tendencies(state, t, grid, params, sw.zero_forcing)
            self.own += STAGES[calls % 3] * self.dt * self._sum(du, dv)
            calls += 1
            return None, None, None

        out = sw.run_model(
            steps * self.dt, self.dt, self.grid, self.params,
            forcing_fn=lambda t, grid, params: (self.stress["u"], self.stress["v"], still),
            ic_fn=lambda grid, params: tuple(self.state[name] for name in ("eta", "u", "v")),
            save_every=steps, hooks=[count_own],
        )  # fmt: skip
        self.state = {name: out[name][-1] for name in ("eta", "u", "v")}
        if not all(np.isfinite(values).all() for values in self.state.values()):
            raise InputError(
                "the water is not finite after the exchange: is the host's step too long?"
            )

    def _sum(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Σ ρ H (u, v) A over the faces between cells; the rim has no flow."""
        weight = self.params.rho * self.params.H * self.grid.dx * self.grid.dy
        return weight * np.array([u[:, 1:-1].sum(), v[1:-1, :].sum()])

    def momentum(self) -> np.ndarray:
        """Momentum of the water along x and y [N s]."""
        return self._sum(self.state["u"], self.state["v"])

    def volume(self) -> float:
        """Volume of the water above its level at rest [m³]."""
        return float(self.state["eta"].sum()) * self.grid.dx * self.grid.dy

    # ---- state

    def snapshot(self) -> dict[str, Any]:
        """State of the host, for `Books.save`."""
        return {
            **{name: values.copy() for name, values in self.state.items()},
            "own": self.own.copy(),
        }

    def put(self, host: dict[str, Any]) -> None:
        """Restore what `snapshot` gave."""
        self.state = {name: np.array(host[name]) for name in ("eta", "u", "v")}
        self.own = np.array(host["own"])


def basin(
    shape: tuple[int, int],
    concentration: float,
    radius: tuple[float, float],
    rescue: Path | None = None,
) -> IcyBasin:
    """A tilted surface at rest in a closed basin, and floes at rest on it."""
    ny, nx = shape
    grid = sw.make_grid(nx, ny, *SIDE)
    params = sw.ModelParams(H=DEPTH, f0=1.3e-4, beta=0.0, linear=True)
    eta = np.broadcast_to(0.4 * np.sin(np.pi * (grid.x_c / SIDE[0] - 0.5)), shape)
    state = {"eta": eta.copy(), "u": np.zeros((ny, nx + 1)), "v": np.zeros((ny + 1, nx))}
    edges = dict.fromkeys(("west", "east", "south", "north"), "closed")
    domain = fb.Domain((0.0, SIDE[0]), (0.0, SIDE[1]), **edges)
    floes = fb.Floes([], [], [], [])
    if concentration > 0:
        floes = fb.scatter(domain, fb.UniformSize(*radius), concentration, thickness=2.0, seed=4)
    ocean, air = DRAG_PRESETS["constant-cd"]
    model = fb.Model(
        domain, floes, contact=fb.frictional(youngs_modulus=2e6), forces=(ocean, air, fb.Coriolis(1.3e-4)),
        grid=fb.Grid.uniform(domain.x, domain.y, shape=shape),
    )  # fmt: skip
    model.atmosphere.u[:] = 6.0
    dt = 60.0 * np.floor(sw.compute_dt_cfl(grid, params, cfl=0.6) / 60.0)
    return IcyBasin(grid, params, state, model, dt, rescue)


class Found(NamedTuple):
    """worst : residual of the ledger; water : of the water's own budget; volume : lost, over that of the basin; seiche : with ice over without."""

    worst: float
    water: float
    volume: float
    seiche: float


def main(
    folder: Path,
    hours: float = 6.0,
    concentration: float = 0.7,
    shape: tuple[int, int] = (30, 40),
    radius: tuple[float, float] = (250.0, 600.0),
    every: float = 600.0,
) -> Found:
    """Run the basin with and without ice; ledger and figure."""
    folder.mkdir(parents=True, exist_ok=True)
    icy, free = basin(shape, concentration, radius), basin(shape, 0.0, radius)
    start, volume = icy.momentum(), icy.volume()
    print(HEADER)
    lines, rows = [], [(0.0, _middle(icy), _middle(free))]
    for k in range(1, round(hours * 3600.0 / every) + 1):
        lines.append(icy.exchange(k * every))
        free.exchange(k * every)
        rows.append((k * every, _middle(icy), _middle(free)))
        print(lines[-1])
    given = sum(line.to_host for line in lines)
    turnover = lines[-1].turnover
    water = np.abs(icy.momentum() - start - icy.own - given).max() / turnover
    of = np.array(rows)
    last = len(of) // 2
    _draw(folder / "shallow-water.png", icy, of, max(line.relative for line in lines), water)
    return Found(
        max(line.relative for line in lines),
        float(water),
        abs(icy.volume() - volume) / (SIDE[0] * SIDE[1] * DEPTH),
        float(np.ptp(of[last:, 1]) / np.ptp(of[last:, 2])),
    )


def _middle(basin: IcyBasin) -> float:
    """Current along x in the middle [m/s]."""
    ny, nx = basin.state["eta"].shape
    return float(basin.state["u"][ny // 2, nx // 2])


def _draw(path: Path, icy: IcyBasin, rows: np.ndarray, worst: float, water: float) -> None:
    from matplotlib import colormaps
    from matplotlib.collections import EllipseCollection
    from matplotlib.colors import ListedColormap

    light = ListedColormap(colormaps["Blues"](np.linspace(0, 0.6, 256)))  # what is on it is legible
    with graph(12.5, 4.4) as figure:
        (left, right) = figure.subplots(1, 2)
        grid, floes = icy.grid, icy.model.floes
        x, y = grid.x_c / 1e3, grid.y_c / 1e3
        diameter = 2 * floes.radius / 1e3
        ice = EllipseCollection(
            diameter, diameter, 0 * diameter, units="xy", offsets=np.c_[floes.x, floes.y] / 1e3,
            transOffset=left.transData, cmap=light, ec="0.5", lw=0.2,
        )  # fmt: skip
        ice.set_array(np.hypot(floes.u, floes.v))
        ice.set_clim(0, None)
        left.add_collection(ice)
        levels = left.contour(x, y, icy.state["eta"], 7, colors="#d55e00", linewidths=1.2)
        left.clabel(levels, fmt="%.2f m", fontsize=8)
        step = max(1, len(x) // 12)
        u, v = (icy.faces[name].state(icy.state[name]).reshape(grid.Ny, grid.Nx) for name in "uv")
        some = (slice(step // 2, None, step),) * 2
        arrows = left.quiver(
            x[some[1]], y[some[0]], u[some], v[some], color="black", scale=4.0, width=3e-3, zorder=3
        )
        left.quiverkey(arrows, 0.8, -0.095, 0.2, "current 0.2 m/s", labelpos="E")
        left.set(
            xlabel="x [km]", ylabel="y [km]", aspect="equal", xlim=(0, SIDE[0] / 1e3), ylim=(0, SIDE[1] / 1e3),
            title=f"after {rows[-1, 0] / 3600:g} h; lines: elevation of the surface",
        )  # fmt: skip
        figure.colorbar(ice, ax=left, label="speed of the ice [m/s]", aspect=30, pad=0.01)
        right.plot(rows[:, 0] / 3600, rows[:, 2], color="black", lw=1, label="without ice")
        right.plot(rows[:, 0] / 3600, rows[:, 1], color="#0072b2", lw=2, label="under the ice")
        most = 1.3 * np.abs(rows[:, 1:]).max()
        right.set(
            xlabel="time [h]", ylabel="current along x in the middle [m/s]", ylim=(-most, most),
            title=f"ledger closes to {worst:.0e}, the water's own books to {water:.0e}",
        )  # fmt: skip
        right.grid(alpha=0.3)
        right.legend(loc="upper center", ncol=2)
        figure.savefig(path, dpi=130)


if __name__ == "__main__":
    words = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    words.add_argument("--folder", type=Path, default=Path("shallow-water"))
    words.add_argument("--hours", type=float, default=6.0)
    words.add_argument("--concentration", type=float, default=0.7)
    print(main(**vars(words.parse_args())))
