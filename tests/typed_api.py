"""Not run but type-checked (`mypy`): a user's script, and what its results are."""

import numpy as np

import floebmi as fb

domain: fb.Domain = fb.Domain((0.0, 1e4), (0.0, 1e4), west="closed")
grid: fb.Grid = fb.Grid.uniform(domain.x, domain.y, spacing=1e3)
floes: fb.Floes = fb.scatter(domain, fb.PowerLaw(100.0, 300.0, -1.8), concentration=0.5, seed=1)
contact: fb.Contact = fb.frictional(friction=0.3)
model: fb.Model = fb.Model(
    domain,
    floes,
    contact=contact,
    forces=[fb.OceanDrag(), fb.AirDrag(), fb.Coriolis(1.4e-4), fb.BodyForce(0.0, 0.0)],
    grid=grid,
    walls=[fb.Wall("north", normal_stress=1e4)],
    step=fb.Step(fraction=0.1),
)
model.advance(60.0)
fraction: np.ndarray = model.fields()["area_fraction"]
residual: float = model.ledger.balance("momentum_x").relative
