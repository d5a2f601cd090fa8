"""
Two floes collide
=================

A floe at 0.5 m/s strikes another off centre. Friction makes both spin, and the momentum of the pair stays what
it was. The scene comes with the package: ``floebmi run two-floes``.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import xarray as xr
from matplotlib.patches import Circle

import floebmi as fb
from floebmi.plot import LINES, graph

# a pack does well with steps as long as they come; what one contact does, short steps tell more exactly
model = fb.read_scene("two-floes", ["step.fraction=0.1"]).build().model
with TemporaryDirectory() as folder:
    fb.run(model, 150.0, every=2.5, trajectories=Path(folder, "floes.nc"))
    floes = xr.load_dataset(Path(folder, "floes.nc"), decode_times=False)

with graph(7.5, 6) as figure:
    where, spin = figure.subplots(2, 1, height_ratios=(2, 1))
    for floe, color in enumerate(LINES[:2]):
        one = floes.isel(trajectory=floe)
        for k in range(0, one.time.size, 12):
            centre = float(one.x[k]), float(one.y[k])
            alpha = 0.2 + 0.6 * k / one.time.size
            where.add_patch(Circle(centre, float(one.radius), fc=color, ec="black", alpha=alpha))
        spin.plot(one.time, np.degrees(one.angular_velocity), color=color, label=f"floe {floe + 1}")
    where.set(xlim=(30, 170), ylim=(15, 95), aspect="equal", xlabel="x [m]", ylabel="y [m]")
    spin.set(xlabel="time [s]", ylabel="angular velocity [°/s]")
    spin.legend()
measured = float(np.degrees(floes.angular_velocity.isel(trajectory=0, time=-1)))  # of floe 1
print(f"floe 1 turns at {measured:.3f} °/s in the end")
