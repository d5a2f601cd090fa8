"""The laws that an experiment's parameters ask for, and no others."""

from floebmi.bonds import TensileStrength
from floebmi.contact import Contact, Coulomb, Damsgaard2018Coulomb, Elastic, Restitution
from floebmi.dynamics import Step
from floebmi.experiments.parameters import AS_THE_PAPER, Experiment
from floebmi.forces import DRAG_PRESETS, AirDrag, OceanDrag
from floebmi.taylor import PAPERS_STEP


def contact(p: Experiment) -> Contact:
    """The contact law: friction, bonds and dashpots only where a parameter asks for them."""
    friction = bonds = dashpot = None
    if p.friction > 0:
        kind = Damsgaard2018Coulomb if p.preset in AS_THE_PAPER else Coulomb
        friction = kind(p.friction, p.poisson_ratio)
    if p.tensile_strength > 0:
        bonds = TensileStrength(p.tensile_strength)
    if p.restitution < 1:
        dashpot = Restitution(p.restitution)
    return Contact(Elastic(p.youngs_modulus), friction, bonds, dashpot)


def step(p: Experiment) -> Step:
    """Integration scheme and time step."""
    return PAPERS_STEP if p.preset in AS_THE_PAPER else Step()


def drag(p: Experiment) -> tuple[OceanDrag, AirDrag]:
    """The drag laws of a preset; those of the default are the ones printed in the paper."""
    return DRAG_PRESETS["damsgaard2018" if p.preset == "default" else p.preset]
