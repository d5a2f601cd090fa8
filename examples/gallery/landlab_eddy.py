"""
Landlab: floes in an eddy
=========================

``SeaIceFloes`` is a Landlab component: it reads the current from fields at nodes and writes concentration, velocity and
stress there. An eddy turns the ice for half a day and, with no slope of the sea surface to hold it, flings it out.
"""

import numpy as np
from landlab import RasterModelGrid

from coupling.landlab import SeaIceFloes
from floebmi.forces import DRAG_PRESETS
from floebmi.plot import LINES, graph

grid = RasterModelGrid((21, 21), xy_spacing=1000.0)
x, y = grid.x_of_node - 10e3, grid.y_of_node - 10e3
rate = 0.3 / 4e3 * np.exp(0.5 - 0.5 * (x**2 + y**2) / 4e3**2)  # 0.3 m/s at 4 km
for axis, values in (("x", -y * rate), ("y", x * rate)):
    name = f"sea_surface_water_flowing__{axis}_component_of_velocity"
    grid.add_field(name, values, at="node")
laws = DRAG_PRESETS["constant-cd"]
ice = SeaIceFloes(grid, concentration=0.6, sizes=(300, 800), forces=laws, edges="closed", seed=1)
for _ in range(12):
    ice.run_one_step(3600.0)
names = ["sea_ice__area_fraction", *(f"sea_ice_flowing__{a}_component_of_velocity" for a in "xy")]
fraction, u, v = (grid.at_node[name].reshape(21, 21)[1:-1, 1:-1] for name in names)  # with a cell
km = np.arange(1.0, 20.0)
with graph(6.4, 5.2) as figure:
    axes = figure.subplots()
    cells = axes.pcolormesh(km, km, fraction, cmap="Blues_r", vmin=0, vmax=1)
    axes.quiver(km[::2], km[::2], u[::2, ::2], v[::2, ::2], color=LINES[1])
    axes.set_title(f"Ice velocity, at most {np.hypot(u, v).max():.2f} m/s")
    axes.set(xlabel="x [km]", ylabel="y [km]", aspect="equal")
    figure.colorbar(cells, label="sea-ice area fraction [1]")
measured = float(fraction.sum())  # cells of 1 km²
print(f"ice in all cells: {measured:.1f} km²")
