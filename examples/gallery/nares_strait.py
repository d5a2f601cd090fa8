"""
Nares Strait: an ice arch
=========================

Where the Arctic Ocean opens into Nares Strait, floes are driven in by 17 m/s of wind along it and a current of 0.2 m/s.
With friction alone (0.1 or 0.3) they flow through; with bonds of 200 kPa an arch spans the entrance, for all of the seeds
1 to 6. At 20 m/s (14.1 for 12.0 below) it is chance: the arch holds for one of these six and breaks for five."""

# sphinx_gallery_thumbnail_number = 2
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import xarray as xr

import floebmi as fb
from floebmi.coast import from_land_fraction
from floebmi.forces import DRAG_PRESETS
from floebmi.plot import frame

file = xr.open_dataset(Path(sys.argv[0]).with_name("nares_strait.nc"))  # axes of EPSG:3413
domain = fb.Domain((-420e3, -160e3), (-960e3, -740e3))
grid = fb.Grid.uniform(domain.x, domain.y, spacing=20e3)
coast = from_land_fraction(file.x, file.y, file.land_fraction, radius=2e3)
sea = fb.Domain((-260e3, -160e3), (-845e3, -740e3))
ice = fb.scatter(sea, fb.PowerLaw(1.5e3, 3e3), concentration=0.8, seed=1, land=coast)
ice, forces = fb.Floes.concatenate([ice, coast.floes]), DRAG_PRESETS["constant-cd"]
measured, flows, arch = {}, None, None
for name, law in (("friction 0.1", fb.frictional(0.1)), ("bonds of 200 kPa", fb.cohesive(200e3))):
    model, inside = fb.Model(domain, ice.copy(), law, forces=forces, grid=grid), []
    model.atmosphere.u[:] = model.atmosphere.v[:] = -12.0  # m/s
    model.ocean.u[:] = model.ocean.v[:] = -0.14
    with TemporaryDirectory() as folder:
        for day in ("first", "second"):
            path = Path(folder, f"{day}.nc")
            fb.run(model, 86400.0, every=7200.0, trajectories=path, land=coast.polygons)
            inside.append(ice.area[model.floes.x + model.floes.y < -1.1e6].sum() / 1e6)
        flows, arch = arch, frame(path, title=f"Nares Strait: {name}", limits=(0, 0.6), size=900)
    measured[name] = round(float(inside[1] - inside[0]))
print(f"through the entrance on the second day [km²]: {measured}")
