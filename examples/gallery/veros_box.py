"""
Veros: what the ocean feels of the ice
======================================

The ocean model Veros in a box like Fram Strait, under a northerly wind, with floes on it: once it feels their stress,
once the wind blows on it as if there were none. The setup is that of ``examples/veros_fram_strait.py``.
"""

import io
import sys
from contextlib import redirect_stdout
from pathlib import Path

import numpy as np
from matplotlib.collections import EllipseCollection

from floebmi.plot import graph

sys.path.append(str(Path(sys.argv[0]).resolve().parents[1]))
from veros_fram_strait import Ocean, make_ice  # noqa: E402

ice = make_ice(radius=(4e3, 8e3), concentration=0.75, channel=False)
with redirect_stdout(io.StringIO()):  # Veros counts its steps
    both = Ocean(20, 1800.0, make_ice=ice).go(2.0, True)
    one = Ocean(20, 1800.0, make_ice=ice, two_way=False).go(2.0, True)
grid, floes = both.ice.model.grid, both.ice.model.floes
feels, alone = (np.hypot(*run.ice.at_cells(*np.mean(run.currents, axis=0))) for run in (both, one))
change = 100 * np.where(grid.wet, feels - alone, np.nan).reshape(grid.shape)  # [cm/s]
with graph(6.4, 5.2) as figure:
    axes = figure.subplots()
    x, y, most = grid.x_edges / 1e3, grid.y_edges / 1e3, np.nanmax(np.abs(change))
    cells = axes.pcolormesh(x, y, change, cmap="RdBu_r", vmin=-most, vmax=most)
    ice = ~floes.land
    size, centres = floes.radius[ice] / 500, np.c_[floes.x, floes.y][ice] / 1e3  # diameter [km]
    look = {"units": "xy", "transOffset": axes.transData, "fc": "none", "ec": "0.3", "lw": 0.5}
    axes.add_collection(EllipseCollection(size, size, 0 * size, offsets=centres, **look))
    axes.set(xlabel="x [km]", ylabel="y [km]", aspect="equal", facecolor="#b8ab8c")
    figure.colorbar(cells, label="change of the current's speed by the ice [cm s⁻¹]")
measured = float(np.nanmin(change))
print(f"the current is slower by up to {-measured:.1f} cm/s")
