"""The strait: how soon does the ice jam?

Floes drift through a funnel of fixed floes into a strait, driven by wind and by a current given by a stream
function.  New floes enter at the top as soon as there is room; floes leave at the bottom, where their mass is
counted.  A run ends when no floe has left for the time `patience`, an hour by default.

        y = funnel + channel   ────────────────────  inflow
                                ╲                ╱
                                 ╲     wind     ╱
        y = channel               ╲      ↓     ╱
                                   │ current  │
        y = 0                      │← width  →│       outflow
"""

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from floebmi.boundaries import Domain, Inflow
from floebmi.coast import Coast
from floebmi.ensemble import Output
from floebmi.experiments import books
from floebmi.experiments.laws import contact, drag, step
from floebmi.experiments.parameters import Strait, make, radii
from floebmi.floes import COAST, Floes
from floebmi.grid import Grid
from floebmi.model import Model
from floebmi.packing import scatter
from floebmi.sizes import PowerLaw

ACCOUNTS = (
    "ocean drag", "wind", "inflow", "outflow", "held floes and coast", "friction", "dashpots",
    "broken bonds",
)  # fmt: skip
OUTPUTS = {
    "jam_time": Output((), "s", "time when the last floe left before the strait jammed"),
    "flow_start": Output((), "s", "time when the first floe left"),
    "watched_until": Output(
        (), "s", "a jam before this time would have been seen; its end less the patience"
    ),
    "transport": Output(("time",), "kg", "mass that has left the strait"),
    "floe_steps": Output((), "1", "floes times steps"),
    **books.OUTPUTS,
}
COORDINATES = {"time": Output(("time",), "s", "time since the start"), **books.COORDINATES}


class Geometry(NamedTuple):
    """The funnel, symmetric about x = 0."""

    width: float
    channel: float
    slope: float
    domain: Domain

    def half_width(self, y: np.ndarray) -> np.ndarray:
        """Distance of the walls from the centre line [m]."""
        return 0.5 * self.width + self.slope * np.maximum(y - self.channel, 0.0)

    @property
    def area(self) -> float:
        """Area between the walls [m²]."""
        funnel = self.domain.y[1] - self.channel
        return self.width * self.channel + (self.width + self.slope * funnel) * funnel


def geometry(p: Strait) -> Geometry:
    """The funnel and strait for the given parameters."""
    top = p.funnel + p.channel
    half = 0.5 * p.width + p.slope * p.funnel
    return Geometry(p.width, p.channel, p.slope, Domain((-half, half), (0.0, top)))


def walls(p: Strait) -> Coast:
    """Fixed floes side by side along both walls, and the land behind them."""
    shape = geometry(p)
    bend = np.hypot(1.0, p.slope)
    along = np.arange(0.0, p.channel + bend * p.funnel + p.wall_radius, 2 * p.wall_radius)
    beyond = np.maximum(along - p.channel, 0.0) / bend  # way along y in the funnel
    y = np.minimum(along, p.channel) + beyond
    x = 0.5 * p.width + p.slope * beyond
    in_funnel = beyond > 0
    # the floes stand behind the wall's line
    x += p.wall_radius * np.where(in_funnel, 1.0 / bend, 1.0)
    y -= p.wall_radius * np.where(in_funnel, p.slope / bend, 0.0)
    floes = Floes(
        np.concatenate([x, -x]), np.concatenate([y, y]), p.wall_radius, p.thickness, motion=COAST
    )
    half, top = shape.domain.x[1], shape.domain.y[1]
    east = np.array([(0.5 * p.width, 0.0), (half, 0.0), (half, top), (0.5 * p.width, p.channel)])
    return Coast(floes, [east, east * (-1, 1)])


def current(p: Strait, grid: Grid) -> tuple[np.ndarray, np.ndarray]:
    """u, v [m/s] in the cells, from differences of ψ between their corners, so that the flow is free of divergence.

    ψ = −Q (3 s − s³)/4 with s = x over the half width: a parabolic profile, at rest along the walls, with the
    same flow Q through each section; the largest speed is in the middle of the strait.
    """
    shape = geometry(p)
    ny, nx = grid.shape
    x, y = np.meshgrid(np.linspace(*shape.domain.x, nx + 1), np.linspace(*shape.domain.y, ny + 1))
    s = np.clip(x / shape.half_width(y), -1.0, 1.0)
    flow = p.current * p.width / 1.5
    psi = -0.25 * flow * (3 * s - s**3)
    dx, dy = x[0, 1] - x[0, 0], y[1, 0] - y[0, 0]
    on_columns, on_rows = psi[1:] + psi[:-1], psi[:, 1:] + psi[:, :-1]
    v = np.diff(on_columns, axis=1) / (2 * dx)
    u = -np.diff(on_rows, axis=0) / (2 * dy)
    return u.ravel(), v.ravel()


def build(p: Strait, seed: int) -> Model:
    """The model at the start of a run."""
    shape, coast = geometry(p), walls(p)
    sizes = PowerLaw(*radii(p), exponent=p.exponent)
    count = round(p.concentration * shape.area / sizes.mean_area())
    ice = scatter(shape.domain, sizes, count=count, thickness=p.thickness, seed=seed, land=coast)
    above = ice.y - ice.radius > p.channel  # the strait itself is open water at first
    ice = Floes(ice.x[above], ice.y[above], ice.radius[above], p.thickness)
    cells = [
        max(1, round((high - low) / p.spacing)) for low, high in (shape.domain.y, shape.domain.x)
    ]
    grid = Grid.uniform(shape.domain.x, shape.domain.y, shape=tuple(cells))
    water = p.current * p.width / 1.5 / (shape.domain.x[1] - shape.domain.x[0])  # mean at the top
    model = Model(
        shape.domain, Floes.concatenate([coast.floes, ice]), contact(p), drag(p), grid,
        inflow=Inflow("north", sizes, p.thickness, velocity=(0.0, -water)),
        step=step(p), sampling="centre", ice_density=p.ice_density, seed=seed,
    )  # fmt: skip
    model.ocean.u[:], model.ocean.v[:] = current(p, grid)
    model.atmosphere.v[:] = -p.wind
    return model


def evolve(model: Model, p: Strait) -> Iterator[float]:
    """Advance until the end, or until the strait has jammed; yields the mass that has left [kg] after each exchange."""
    left, last = 0.0, None
    for k in range(1, round(p.hours * 3600.0 / p.exchange) + 1):
        model.advance(k * p.exchange - model.time)
        now = -float(model.ledger.accounts.get("outflow", np.zeros(4))[0])
        if now > left:
            left, last = now, model.time
        yield left
        if last is not None and model.time - last > p.patience:
            return


def member(parameters: Mapping[str, Any], seed: int) -> dict[str, np.ndarray]:
    """One run; returns arrays with the names of `OUTPUTS` and `COORDINATES`."""
    p = make(Strait, parameters)
    model = build(p, seed)
    times, mass = [0.0], [0.0]
    for left in evolve(model, p):
        times.append(model.time)
        mass.append(left)
    t, m = np.array(times), np.array(mass)
    moved = np.flatnonzero(np.diff(m) > 0) + 1
    start, last = (t[moved[0]], t[moved[-1]]) if len(moved) else (np.nan, np.nan)
    jammed = model.time - last > p.patience  # never true before the first floe has left
    time = np.arange(0.0, p.hours * 3600.0 + 0.5 * p.interval, p.interval)
    return {
        "time": time,
        "jam_time": np.array(last if jammed else np.nan),
        "flow_start": np.array(start),
        "watched_until": np.array(model.time - p.patience),
        "transport": m[np.searchsorted(t, time, side="right") - 1],  # after a jam it stays
        "floe_steps": np.array(float(model.counters.floe_steps)),
        **books.books(model, ACCOUNTS),
    }
