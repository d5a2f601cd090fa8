"""
A strait jams
=============

A wind of 30 m/s drives floes into a strait 6 km wide, ``floebmi run strait``. With friction alone they flow until chance
jams them, each pack at another time (eight seeds). With bonds of 400 kPa the ice forms an arch, and nothing comes through.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import xarray as xr

import floebmi as fb
from floebmi import plot

through = {"friction 0.3": [], "bonds of 400 kPa": []}
straits = [("friction 0.3", [f"seed={seed}"]) for seed in range(1, 9)]
straits += [("bonds of 400 kPa", ["contact=cohesive", "contact.tensile_strength=400e3"])]
for name, changes in straits:
    built = fb.read_scene("strait", changes).build()
    with TemporaryDirectory() as folder:
        path = Path(folder, "floes.nc")
        fb.run(
            built.model, 18 * 3600.0, built.ocean, built.atmosphere, exchange=600.0, every=1800.0,
            trajectories=path, land=built.land, attributes={"title": f"A strait: {name}"},
        )  # fmt: skip
        run = xr.load_dataset(path, decode_times=False)
        arch = plot.frame(path, color="speed") if "bonds" in name else None
    of_outflow = run.ledger_gained[:, run.ledger_account == "outflow", 0]
    through[name].append(-of_outflow.sum("ledger_account") / 1e9)  # mass [Mt]
measured = {name: round(float(np.mean(each, axis=0)[-1]), 1) for name, each in through.items()}
with plot.graph(7, 3) as figure:
    axes = figure.subplots()
    for (name, each), color in zip(through.items(), ("tab:blue", "tab:red"), strict=True):
        axes.plot(run.time / 3600, np.transpose(each), color=color)[0].set_label(name)
    axes.set(xlabel="time [h]", ylabel="ice gone through [Mt]", xlim=(0, 18))
    axes.legend()
print(f"gone through, mean [Mt]: {measured}")
