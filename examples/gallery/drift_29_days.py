"""
29 days in a periodic box
=========================

A box of 30 km under a wind that turns once in four days; what leaves on one side comes in on the other. Thick floes
are turned more than thin ones, so they meet, yet the pack drifts as one floe in free drift would.
"""

import matplotlib
import numpy as np
from matplotlib.figure import Figure

import floebmi as fb
from floebmi.forces import DRAG_PRESETS
from floebmi.plot import style

box = fb.Domain((0, 30e3), (0, 30e3), "periodic", "periodic", "periodic", "periodic")
forces = [*DRAG_PRESETS["constant-cd"], fb.Coriolis(1.4e-4)]
grid = fb.Grid.uniform(box.x, box.y, shape=(2, 2))
tracks, turn = {}, 2 * np.pi / (4 * 86400.0)
u, v = lambda x, y, t: 4 + 6 * np.cos(turn * t), lambda x, y, t: 6 * np.sin(turn * t)
wind = fb.Function(u, v, grid)
pack = fb.scatter(box, fb.PowerLaw(1e3, 2.5e3), concentration=0.7, seed=1)
pack.thickness = np.random.default_rng(1).uniform(0.5, 2.5, len(pack))
alone = fb.Floes(15e3, 15e3, 1.5e3, float(pack.thickness.mean()))
for name, floes, law in (("pack", pack, fb.frictional(0.3, 2e5)), ("free drift", alone, None)):
    model, track = fb.Model(box, floes, contact=law, forces=forces, grid=grid), [0.0]
    while model.time < 29 * 86400.0:
        fb.run(model, 7200.0, atmosphere=wind, every=7200.0)
        mass, along_x, along_y, _ = model.ledger.now
        track.append(track[-1] + 7.2 * complex(along_x, along_y) / mass)  # [km]
    tracks[name] = np.array(track)
with matplotlib.rc_context({**style(), "axes.facecolor": "white"}):
    axes = (figure := Figure(figsize=(8, 2.6), layout="constrained")).subplots()
    for (name, track), width in zip(tracks.items(), (3.5, 1.2), strict=True):
        axes.plot(track.real, track.imag, lw=width, label=name)
    axes.set(xlabel="to the east [km]", ylabel="to the north [km]", aspect="equal")
    axes.legend(loc="lower left")
measured = abs(tracks["pack"][-1] - tracks["free drift"][-1])
print(f"apart after 29 days: {measured:.1f} km")
