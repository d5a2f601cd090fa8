"""
Barents Sea: the ice edge under two winds
=========================================

Ice and current of an ocean model in February, as floes. Two days of wind off the ice, against the current, just hold the
edge; two days of wind towards the ice drive it back. Ice that leaves in the north is not replaced: the curve falls there."""

import sys
from tempfile import TemporaryDirectory

import numpy as np

import floebmi as fb
from floebmi.forces import DRAG_PRESETS
from floebmi.plot import frame, graph

path = sys.argv[1] if sys.argv[1:] else sys.exit("give it arctic20_ocean_ice_20160201-05.nc")
options = {"position": "mapping", "fill_land": "nearest"}
grid = fb.Grid.uniform(x := (-560e3, -240e3), y := (-1320e3, -880e3), spacing=20e3)
share, thick = (fb.read_scalar(path, of, grid, **options) for of in ("area_fraction", "thickness"))
forces = [*DRAG_PRESETS["constant-cd"], fb.Coriolis(1.43e-4)]
ice = fb.from_field(grid, share * (thick > 0.05), thick, fb.PowerLaw(3e3, 6e3), seed=1)
current = fb.VelocityFile(path, grid, start="2016-02-01 12:00", **options)
km, shares, measured = grid.y.reshape(grid.shape)[:, 0] / 1e3, {}, {}
for name, wind in (("the start", 0), ("wind off the ice", -12), ("wind towards the ice", 12)):
    model = fb.Model(fb.Domain(x, y), ice.copy(), fb.frictional(), forces=forces, grid=grid)
    if wind:
        with TemporaryDirectory() as folder:
            to = {"trajectories": f"{folder}/floes.nc", "gridded": f"{folder}/gridded.nc"}
            fb.run(model, 2 * 86400.0, current, fb.Constant(0, wind), every=10800.0, **to)
            picture = frame(*to.values(), arrows="ocean", title=f"Two days of {name}", size=800)
    share = model.fields()["area_fraction"].reshape(grid.shape)[:, 3:-5].mean(axis=1)
    shares[name] = share
    measured[name] = round(float(np.interp(0.15, share[:16], km[:16])))  # share grows up to there
with graph(7, 3.5) as figure:
    axes = figure.subplots()
    axes.plot(km, np.transpose([*shares.values()]), label=[*shares])
    axes.set(xlabel="y, into the ice [km]", ylabel="area fraction [1]")
    axes.legend()
print(f"ice edge (15 %) at y [km]: {measured}")
