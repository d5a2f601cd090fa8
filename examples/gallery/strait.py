"""
A strait jams
=============

A wind of 30 m/s drives floes from the north into a strait 6 km wide, ``floebmi run strait --set seed=3``. Held together
by friction alone they flow; with bonds of 400 kPa the ice forms an arch above the strait, and nothing comes through.
Friction jams by chance, too: of seeds 1 to 8, two end at less than 10 Mt.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import xarray as xr

import floebmi as fb
from floebmi import plot

measured, through, bonds = {}, {}, ["contact=cohesive", "contact.tensile_strength=400e3"]
for name, changes in (("friction 0.3", []), ("bonds of 400 kPa", bonds)):
    built = fb.read_scene("strait", ["seed=3", *changes]).build()
    with TemporaryDirectory() as folder:
        path = Path(folder, "floes.nc")
        fb.run(
            built.model, 18 * 3600.0, built.ocean, built.atmosphere, exchange=600.0, every=1800.0,
            trajectories=path, land=built.land, attributes={"title": f"A strait: {name}"},
        )  # fmt: skip
        arch = plot.frame(path, color="speed")
        run = xr.load_dataset(path, decode_times=False)
    of_outflow = run.ledger_gained[:, run.ledger_account == "outflow", 0]
    out = -of_outflow.sum("ledger_account") / 1e9  # mass [Mt]
    through[name] = out
    measured[name] = round(abs(float(out[-1])), 1)
with plot.graph(7, 3) as figure:
    axes = figure.subplots()
    for name, out in through.items():
        axes.plot(run.time / 3600, out, label=name)
    axes.set(xlabel="time [h]", ylabel="ice gone through [Mt]", xlim=(0, 18))
    axes.legend()
print(f"gone through [Mt]: {measured}")
