"""Nothing is read that was not written: a run is the same, to the bit, whatever was in the memory it is given."""

import numpy as np
import pytest

import floebmi as fb
from benchmarks.fuzz import unwritten_memory
from floebmi.contact import Contact, Elastic

LAWS = {
    "elastic floes that turn": (Contact(Elastic()), True),
    "cohesive, without walls": (fb.cohesive(), False),
    "frictional, with bonds": (fb.frictional()._replace(bonds=fb.TensileStrength(1e3)), True),
}
ALONE = "elastic floes that turn"


def run(contact, rotation):
    """The floes and the fields of a pack that is fed, stirred and squeezed, after three exchanges.

    Laws and edges are such that other tests have machine code for all packs but `ALONE`.
    """
    rng = np.random.default_rng(5)
    walls = rotation
    rim = "closed" if walls else "inactive"
    domain = fb.Domain((0.0, 400.0), (0.0, 400.0), "inactive", "inactive", rim, rim)
    floes = fb.Floes(
        *rng.uniform(20.0, 380.0, (2, 120)), rng.uniform(12.0, 20.0, 120), 1.0, *rng.normal(0.0, 0.3, (2, 120))
    )  # fmt: skip
    fb.relax(floes, domain)
    forces = [fb.OceanDrag(), fb.AirDrag(), *([fb.Coriolis(1.4e-4)] if contact.friction else [])]
    model = fb.Model(
        domain, floes, contact, forces, fb.Grid.uniform(*domain[:2], shape=(7, 7)),
        [fb.Wall("north", velocity=-0.5)] if walls else [], [fb.Inflow("west", fb.PowerLaw(10.0, 20.0), velocity=(0.3, 0.0))],
        rotation=rotation,
    )  # fmt: skip
    for fluid, speed in ((model.ocean, 0.3), (model.atmosphere, 10.0)):
        fluid.u[:], fluid.v[:] = speed * rng.uniform(-1.0, 1.0, (2, model.grid.size))
    for _ in range(3):
        model.advance(10.0)
    assert model.counters.rebuilds > 1 and "inflow" in model.ledger.accounts
    names = ("x", "y", "u", "v", *(("angle", "angular_velocity") if rotation else ()))
    assert model.fields()["internal_stress_xx"].any()
    return [getattr(model.floes, name).copy() for name in names] + [*model.fields().values()]


@pytest.mark.filterwarnings("ignore:.* lie outside the domain")  # to where they are pressed
@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.long) if n == ALONE else n for n in LAWS]
)
def test_a_run_does_not_depend_on_what_was_in_its_memory(name):
    clean = run(*LAWS[name])
    with unwritten_memory():
        assert np.isnan(np.empty(1)).all()
        spoilt = run(*LAWS[name])
    for one, other in zip(clean, spoilt, strict=True):
        assert np.isfinite(one).all()
        assert np.array_equal(one, other)
