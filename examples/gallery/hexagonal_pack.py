"""
A hexagonal pack under a wall
=============================

Equal floes on a hexagonal lattice, closed in on three sides; from the north a wall presses with 20 kPa. The pack
comes to rest where its own stress is the wall's: the mean over a band from side to side is 20 kPa again.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import floebmi as fb
from floebmi import plot

columns, rows, radius = 20, 20, 10.0
width, height = (2 * columns + 1) * radius, (2 + 3**0.5 * (rows - 1)) * radius
domain = fb.Domain((0, width), (0, height + 5), "closed", "closed", "closed")
floes = fb.regular(fb.Domain((0, width), (0, height)), radius, spacing=2 * radius)

law = fb.frictional(friction=0.3)._replace(dashpot=fb.Restitution(0.3))
wall = fb.Wall("north", position=height, normal_stress=20e3)
grid = fb.Grid.uniform(domain.x, (100, 260), shape=(2, 2))
model = fb.Model(domain, floes, contact=law, grid=grid, walls=[wall])
with TemporaryDirectory() as folder:
    path = Path(folder, "floes.nc")
    fb.run(model, 60.0, trajectories=path, attributes={"title": "A pack under 20 kPa"})
    figure = plot.frame(path, color="pressure")
stress = model.internal_stress_fields()["internal_stress_yy"]  # × thickness, 1 m [N/m]
measured = float(-stress.mean() / 1e3)  # along y, within the pack
print(f"pressure along y in the pack: {measured:.1f} kPa")
