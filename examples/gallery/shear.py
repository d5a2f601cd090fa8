"""
Shear
=====

The bottom row stands still, the top row is dragged along at 1 m/s, and a wall presses with 20 kPa: the shear cell of
Damsgaard, Adcroft & Sergienko (2018) in small, ``floebmi run shear-cell``. How much shear does the pack bear?
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import xarray as xr

import floebmi as fb
from floebmi import plot

scene = fb.read_scene("shear-cell")
model = scene.build().model
with TemporaryDirectory() as folder:
    floes, gridded = Path(folder, "floes.nc"), Path(folder, "gridded.nc")
    fb.run(
        model, 120.0, every=5.0, trajectories=floes, gridded=gridded, attributes={"title": scene.title}
    )  # fmt: skip
    figure = plot.frame(floes, color="speed")
    stress = xr.load_dataset(gridded, decode_times=False).isel(y=slice(1, 3))  # within the pack
late = stress.sel(time=slice(40, None)).mean()
measured = float(late.internal_stress_xy / -late.internal_stress_yy)
print(f"shear stress over normal stress: {measured:.2f}")
