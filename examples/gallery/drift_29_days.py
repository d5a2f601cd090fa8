"""
29 days in a periodic box
=========================

Hourly wind and current of an ocean model at 80° N 37° E. Thick floes are turned more than thin ones, so they meet, yet the
pack drifts as one floe in free drift would. ``examples/drift_in_a_box.py`` adds floes aground, which do hold it."""

import sys
from pathlib import Path

import numpy as np
import xarray as xr

import floebmi as fb
from floebmi.forces import DRAG_PRESETS
from floebmi.plot import graph

path = Path(sys.argv[0]).with_name("drift_29_days.nc")
box = fb.Domain((0, 30e3), (0, 30e3), "periodic", "periodic", "periodic", "periodic")
forces = [*DRAG_PRESETS["constant-cd"], fb.Coriolis(1.437e-4)]
grid, tracks = fb.Grid.uniform(box.x, box.y, shape=(2, 2)), {}
current, wind = fb.VelocityFile(path, grid), fb.VelocityFile(path, grid, kind="wind")
pack = fb.scatter(box, fb.PowerLaw(1e3, 2.5e3), concentration=0.7, seed=1)
pack.thickness = float(xr.open_dataset(path).hice.mean()) * np.linspace(0.4, 1.6, len(pack))
alone = fb.Floes(15e3, 15e3, 1.5e3, float(pack.thickness.mean()))
for name, floes, law in (("pack", pack, fb.frictional(0.3, 2e5)), ("free drift", alone, None)):
    model, track = fb.Model(box, floes, contact=law, forces=forces, grid=grid), [0.0]
    while model.time < 695 * 3600.0:  # of 696 records
        fb.run(model, 3600.0, current, wind, every=3600.0)
        mass, along_x, along_y, _ = model.ledger.now
        track.append(track[-1] + 3.6 * complex(along_x, along_y) / mass)  # [km]
    tracks[name] = np.array(track)
with graph(6, 5) as figure:
    axes = figure.subplots()
    for (name, track), width in zip(tracks.items(), (3.5, 1.2), strict=True):
        axes.plot(track.real, track.imag, lw=width, label=name)
    axes.set(xlabel="to the east [km]", ylabel="to the north [km]", aspect="equal")
    axes.legend()
measured = abs(tracks["pack"][-1] - tracks["free drift"][-1])
print(f"apart after 29 days: {measured:.2f} km")
