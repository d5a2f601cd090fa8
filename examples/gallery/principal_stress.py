"""
Force chains and principal stress
=================================

A mixed pack under a wall that presses with 20 kPa. Lines from centre to centre show the contact forces, as wide as
they are strong; crosses of bars show both principal stresses of the gridded stress tensor, which a host model reads.
"""

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.patches import Circle

import floebmi as fb
from floebmi.plot import INK, LINES, WATER, graph

domain = fb.Domain((0, 600), (0, 420), "closed", "closed", "closed")
floes = fb.scatter(domain._replace(y=(0, 400)), fb.PowerLaw(8, 25), concentration=0.84, seed=1)
law = fb.frictional()._replace(dashpot=fb.Restitution(0.3))
grid = fb.Grid.uniform(domain.x, domain.y, spacing=60.0)
wall = fb.Wall("north", 400.0, normal_stress=20e3)
model = fb.Model(domain, floes, law, grid=grid, walls=[wall])
fb.run(model, 60.0)
one, fields = model.contacts(), model.fields()
start, wide = np.c_[floes.x[one.i], floes.y[one.i]], np.hypot(one.fx, one.fy)
chains = np.stack([start, start + np.c_[one.dx, one.dy]], axis=1)
xx, xy, yy = (fields[f"internal_stress_{axes}"] for axes in ("xx", "xy", "yy"))
size, turned = np.linalg.eigh(np.moveaxis([[xx, xy], [xy, yy]], -1, 0))
with graph(8, 5.6) as figure:
    axes = figure.subplots()
    for x, y, radius in zip(floes.x, floes.y, floes.radius, strict=True):
        axes.add_patch(Circle((x, y), radius, fc="white", ec="0.75"))
    axes.add_collection(LineCollection(chains, linewidths=4 * wide / wide.max(), colors=LINES[1]))
    for arm in np.moveaxis(size[:, None] * turned / 1600, -1, 0):
        ends = [np.c_[grid.x, grid.y] + way * arm for way in (-1, 1)]
        axes.add_collection(LineCollection(np.stack(ends, axis=1), colors=INK))
    axes.set(xlim=domain.x, ylim=domain.y, aspect="equal", xlabel="x [m]", ylabel="y [m]", fc=WATER)
    axes.set_title("Contact forces; principal stresses: a bar of 25 m is 20 kPa")
measured = float(-yy.reshape(grid.shape)[1:-1].mean() / 1e3)  # thickness 1 m
print(f"pressure along y in the pack: {measured:.1f} kPa")
