"""
Labrador Sea
============

Floes from the ice of an ocean model, among its land, under its currents and winds: the packaged scene of the README,
``floebmi run labrador-sea``, for one day of its five.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import floebmi as fb
from floebmi import plot

scene = fb.read_scene("labrador-sea")
built = scene.build()
with TemporaryDirectory() as folder:
    floes, gridded = Path(folder, "floes.nc"), Path(folder, "gridded.nc")
    fb.run(
        built.model, 86400.0, built.ocean, built.atmosphere, exchange=7200.0, every=21600.0,
        trajectories=floes, gridded=gridded, land=built.land, reference=scene.time.start,
        projection=scene.domain.projection, attributes={"title": scene.title},
    )  # fmt: skip
    figure = plot.frame(floes, gridded, arrows="ice")
    concentration = plot.field(gridded, "area_fraction")
ice = built.model.floes
free = ice.active & ~ice.land
measured = float(np.hypot(ice.u, ice.v)[free].mean() * 100)
print(f"mean speed of the floes: {measured:.1f} cm/s")
