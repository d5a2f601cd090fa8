"""Scene files: what is in the water, in TOML (or YAML), in the words of the Python API.

A scene lists what is modelled; what it does not list is not modelled.  Every number is in SI units (m, s,
m/s, Pa, kg/m³; only angles on the globe are in degrees), and `floebmi scene --keys` prints each key with its
unit, its default and what it means.  Paths are relative to the scene file.

    read_scene("labrador-sea")  →  Scene: checked tables  →  build()  →  Model, forcing, schedule
"""

import contextlib
import datetime
import math
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, PrivateAttr, model_validator

from floebmi.boundaries import Domain, Edge, Inflow, Wall
from floebmi.contact import (
    Contact,
    Coulomb,
    Damsgaard2018Coulomb,
    Elastic,
    Restitution,
    cohesive,
    frictional,
)
from floebmi.bonds import TensileStrength
from floebmi.dynamics import Step
from floebmi.errors import InputError, choose
from floebmi.floes import DRIVEN, FIXED, FIXED_ROTATION, FIXED_X, FIXED_Y, Floes
from floebmi.forces import DRAG_PRESETS, AirDrag, BodyForce, Coriolis, OceanDrag, Tilt
from floebmi.grid import Grid
from floebmi.quantities import Fraction, NonNegative, Positive, PositiveFraction
from floebmi.sizes import Histogram, PowerLaw, SingleSize, UniformSize
from floebmi.tables import (
    Override,
    Table,
    apply_override,
    law_of,
    one_of,
    parse,
    parse_override,
    read_text,
    table_of,
    validate,
    word_or,
)
