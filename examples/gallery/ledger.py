"""
Where momentum and energy came from
===================================

Every file of a run carries its ledger: mass, momentum and energy of the ice, what gave them, and what is left
unexplained, the residual. Here the shear cell: the driven floes put in what friction takes out.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import floebmi as fb
from floebmi import plot

scene = fb.read_scene("shear-cell")
model = scene.build().model
with TemporaryDirectory() as folder:
    path = Path(folder, "floes.nc")
    fb.run(model, 60.0, every=1.0, trajectories=path, attributes={"title": "A shear cell"})
    figure = plot.ledger(path)
measured = model.ledger.balance("energy").relative
print(f"residual of the energy, over all that passed: {measured:.1e}")
