"""floebmi: a discrete-element model of sea-ice floes that couples to ocean and atmosphere models.

Names are imported when they are first used, so that `import floebmi` is fast.
"""

import importlib
from typing import TYPE_CHECKING

from floebmi.bmi import FloeBmi  # at once: BMI tools look classes up in a module's __dict__

if TYPE_CHECKING:
    from floebmi.bonds import (
        Beam as Beam,
        Healing as Healing,
        TensileStrength as TensileStrength,
    )
    from floebmi.boundaries import (
        Domain as Domain,
        Inflow as Inflow,
        Wall as Wall,
    )
    from floebmi.coast import (
        Coast as Coast,
    )
    from floebmi.contact import (
        CompressiveFailure as CompressiveFailure,
        Contact as Contact,
        Coulomb as Coulomb,
        Damsgaard2018Coulomb as Damsgaard2018Coulomb,
        Elastic as Elastic,
        Restitution as Restitution,
        cohesive as cohesive,
        frictional as frictional,
    )
    from floebmi.dynamics import (
        Step as Step,
    )
    from floebmi.errors import (
        InputError as InputError,
        StabilityError as StabilityError,
    )
    from floebmi.floes import (
        Floes as Floes,
    )
    from floebmi.forces import (
        AirDrag as AirDrag,
        BodyForce as BodyForce,
        Coriolis as Coriolis,
        CoriolisField as CoriolisField,
        GeostrophicTilt as GeostrophicTilt,
        OceanDrag as OceanDrag,
        Tilt as Tilt,
    )
    from floebmi.forcing import (
        Constant as Constant,
        Function as Function,
        VelocityFile as VelocityFile,
    )
    from floebmi.grid import (
        Grid as Grid,
    )
    from floebmi.model import (
        Model as Model,
    )
    from floebmi.overlaps import (
        overlapping as overlapping,
    )
    from floebmi.packing import (
        from_field as from_field,
        read_floes as read_floes,
        regular as regular,
        relax as relax,
        scatter as scatter,
    )
    from floebmi.running import (
        run as run,
    )
    from floebmi.scalars import (
        read_scalar as read_scalar,
    )
    from floebmi.scene import (
        read_scene as read_scene,
    )
    from floebmi.sizes import (
        Histogram as Histogram,
        PowerLaw as PowerLaw,
        SingleSize as SingleSize,
        UniformSize as UniformSize,
    )

_HOME = {
    "Domain": "boundaries",
    "Wall": "boundaries",
    "Inflow": "boundaries",
    "Grid": "grid",
    "Floes": "floes",
    "PowerLaw": "sizes",
    "UniformSize": "sizes",
    "SingleSize": "sizes",
    "Histogram": "sizes",
    "scatter": "packing",
    "regular": "packing",
    "from_field": "packing",
    "read_floes": "packing",
    "Contact": "contact",
    "Elastic": "contact",
    "Coulomb": "contact",
    "Damsgaard2018Coulomb": "contact",
    "Restitution": "contact",
    "frictional": "contact",
    "cohesive": "contact",
    "CompressiveFailure": "contact",
    "TensileStrength": "bonds",
    "Healing": "bonds",
    "Beam": "bonds",
    "OceanDrag": "forces",
    "AirDrag": "forces",
    "Coriolis": "forces",
    "CoriolisField": "forces",
    "Tilt": "forces",
    "GeostrophicTilt": "forces",
    "BodyForce": "forces",
    "Step": "dynamics",
    "Model": "model",
    "run": "running",
    "read_scene": "scene",
    "InputError": "errors",
    "StabilityError": "errors",
    "relax": "packing",
    "overlapping": "overlaps",
    "Coast": "coast",
    "VelocityFile": "forcing",
    "Constant": "forcing",
    "Function": "forcing",
    "read_scalar": "scalars",
}
__all__ = [*_HOME, "FloeBmi", "__version__"]
__version__ = "0.1.0"


def __getattr__(name: str) -> object:
    if name in _HOME:
        return getattr(importlib.import_module(f"floebmi.{_HOME[name]}"), name)
    raise AttributeError(f"module 'floebmi' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
