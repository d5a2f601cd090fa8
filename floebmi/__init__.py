"""floebmi: sea-ice floes as discrete elements, coupled to ocean and atmosphere models.

Names are imported when they are first used, so that `import floebmi` stays quick.
"""

import importlib
from typing import TYPE_CHECKING

from floebmi.bmi import FloeBmi  # at once: BMI tools look classes up in a module's __dict__

if TYPE_CHECKING:
    from floebmi.bonds import (
        Beam as Beam,
    )
    from floebmi.bonds import (
        Healing as Healing,
    )
    from floebmi.bonds import (
        TensileStrength as TensileStrength,
    )
    from floebmi.boundaries import (
        Domain as Domain,
    )
    from floebmi.boundaries import (
        Inflow as Inflow,
    )
    from floebmi.boundaries import (
        Wall as Wall,
    )
    from floebmi.coast import (
        Coast as Coast,
    )
    from floebmi.contact import (
        CompressiveFailure as CompressiveFailure,
    )
    from floebmi.contact import (
        Contact as Contact,
    )
    from floebmi.contact import (
        Coulomb as Coulomb,
    )
    from floebmi.contact import (
        Damsgaard2018Coulomb as Damsgaard2018Coulomb,
    )
    from floebmi.contact import (
        Elastic as Elastic,
    )
    from floebmi.contact import (
        Restitution as Restitution,
    )
    from floebmi.contact import (
        cohesive as cohesive,
    )
    from floebmi.contact import (
        frictional as frictional,
    )
    from floebmi.dynamics import (
        Step as Step,
    )
    from floebmi.errors import (
        InputError as InputError,
    )
    from floebmi.errors import (
        StabilityError as StabilityError,
    )
    from floebmi.floes import (
        Floes as Floes,
    )
    from floebmi.forces import (
        AirDrag as AirDrag,
    )
    from floebmi.forces import (
        BodyForce as BodyForce,
    )
    from floebmi.forces import (
        Coriolis as Coriolis,
    )
    from floebmi.forces import (
        CoriolisField as CoriolisField,
    )
    from floebmi.forces import (
        OceanDrag as OceanDrag,
    )
    from floebmi.forces import (
        Tilt as Tilt,
    )
    from floebmi.forcing import (
        Constant as Constant,
    )
    from floebmi.forcing import (
        Function as Function,
    )
    from floebmi.forcing import (
        VelocityFile as VelocityFile,
    )
    from floebmi.forcing import (
        read_scalar as read_scalar,
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
    )
    from floebmi.packing import (
        read_floes as read_floes,
    )
    from floebmi.packing import (
        regular as regular,
    )
    from floebmi.packing import (
        relax as relax,
    )
    from floebmi.packing import (
        scatter as scatter,
    )
    from floebmi.running import (
        run as run,
    )
    from floebmi.scene import (
        read_scene as read_scene,
    )
    from floebmi.sizes import (
        Histogram as Histogram,
    )
    from floebmi.sizes import (
        PowerLaw as PowerLaw,
    )
    from floebmi.sizes import (
        SingleSize as SingleSize,
    )
    from floebmi.sizes import (
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
    "read_scalar": "forcing",
}
__all__ = [*_HOME, "FloeBmi", "__version__"]
__version__ = "0.1.0"


def __getattr__(name: str) -> object:
    if name in _HOME:
        return getattr(importlib.import_module(f"floebmi.{_HOME[name]}"), name)
    raise AttributeError(f"module 'floebmi' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
