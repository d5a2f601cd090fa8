"""floebmi: sea-ice floes as discrete elements, coupled to ocean and atmosphere models.

Names are imported when they are first used, so that `import floebmi` stays quick.
"""

import importlib

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
    "TensileStrength": "bonds",
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
    "FloeBmi": "bmi",
    "InputError": "errors",
    "StabilityError": "errors",
}
__all__ = [*_HOME, "__version__"]
__version__ = "0.1.0"


def __getattr__(name: str) -> object:
    if name in _HOME:
        return getattr(importlib.import_module(f"floebmi.{_HOME[name]}"), name)
    raise AttributeError(f"module 'floebmi' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
