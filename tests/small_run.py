"""A small run for the tests of files and pictures: sixteen floes, some of which leave, come and stand."""

import numpy as np

from floebmi import AirDrag, Domain, Floes, Grid, Model, OceanDrag, frictional
from floebmi.floes import FIXED
from floebmi.output import GriddedWriter, TrajectoryWriter

DOMAIN = Domain((0.0, 20e3), (0.0, 16e3))
LAND = [np.array([[14e3, 0.0], [20e3, 0.0], [20e3, 4e3], [14e3, 4e3]])]


def uniform():
    return Grid.uniform(DOMAIN.x, DOMAIN.y, spacing=2e3)


def rectilinear():
    return Grid.rectilinear([0.0, 1e3, 5e3, 12e3, 20e3], [0.0, 6e3, 16e3])


def curvilinear():
    x, y = np.meshgrid(np.linspace(0, 20e3, 7), np.linspace(0, 16e3, 5))
    return Grid.curvilinear(x + 0.1 * y, y + 500 * np.sin(x / 5e3))


def unstructured():
    x, y = [0, 20e3, 20e3, 0, 9e3, 30e3], [0, 0, 16e3, 16e3, 7e3, 8e3]
    return Grid.unstructured(x, y, [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4], [1, 5, 2]])


GRIDS = {make.__name__: make for make in (uniform, rectilinear, curvilinear, unstructured)}


def small_model(grid=None, atmosphere_grid=None):
    """Floe 0 leaves in the east soon, floe 15 is fixed; floes 5 and 6 touch; one corner of the grid is dry."""
    x, y = np.meshgrid(np.linspace(2e3, 18e3, 4), np.linspace(2e3, 14e3, 4))
    x, y = x.ravel(), y.ravel()
    x[0], x[6] = 19.96e3, x[5] + 1199.0
    u = np.zeros(16)
    u[0] = 1.0
    floes = Floes(x, y, 600.0, np.linspace(0.5, 2.0, 16), u=u, motion=FIXED * (np.arange(16) == 15))
    grid = uniform() if grid is None else grid
    grid = grid.with_wet((grid.x < 14e3) | (grid.y > 4e3))
    forces = [OceanDrag(), AirDrag()]
    model = Model(DOMAIN, floes, frictional(), forces, grid, atmosphere_grid=atmosphere_grid)
    model.ocean.v[:] = 0.1
    model.atmosphere.u[:], model.atmosphere.v[:] = 8.0, -4.0
    return model


def small_run(folder, model=None, frames=4, interval=100.0, exchanges=2, **how):
    """Run it, write both files, and add two floes before the last frame."""
    model = small_model() if model is None else model
    gridded, trajectories = folder / "gridded.nc", folder / "floes.nc"
    with (
        GriddedWriter(gridded, model, {"title": "A small run"}, **how) as fields,
        TrajectoryWriter(trajectories, model, {"title": "A small run"}, **how) as floes,
    ):
        for k in range(frames):
            if k:
                if k == frames - 1:
                    model.floes.add([5e3, 7e3], 8e3, 500.0, 1.0)
                for _ in range(exchanges):
                    model.advance(interval / exchanges)
            fields.write(model)
            floes.write(model)
    return gridded, trajectories, model
