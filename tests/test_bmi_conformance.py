"""The BMI contract, kept by FloeBmi and by none of the components that break it."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from bmi_conformance import check_bmi, violations
from bmi_mutants import FACE_MUTANTS, MUTANTS

from floebmi import FloeBmi

SCENE = """
[domain]
x = [0.0, 8000.0]
y = [0.0, 6000.0]
edges = "periodic"

[grid]
{grid}

[[floes]]
arrangement = "scatter"
count = 24
seed = 3
size = {{distribution = "uniform", radius_min = 200.0, radius_max = 500.0}}

[contact]
model = "frictional"

[ocean]
velocity = [0.1, 0.05]

[atmosphere]
velocity = [8.0, -4.0]
{air}

[coriolis]
parameter = 1e-4

[time]
exchange = 60.0
"""
UNIFORM = "shape = [3, 4]"
RECTILINEAR = """kind = "rectilinear"
x_edges = [0.0, 1000.0, 3000.0, 8000.0]
y_edges = [0.0, 2500.0, 6000.0]"""
AIR = 'grid = {kind = "uniform_rectilinear", shape = [2, 3]}'
WARPED_AIR = 'grid = {kind = "curvilinear", file = "corners.nc"}'


def write_corners(folder: Path) -> None:
    """A warped grid on the domain, as quadrilaterals and as polygons with three to six corners."""
    x, y = np.meshgrid(np.linspace(0.0, 8000.0, 5), np.linspace(0.0, 6000.0, 4))
    bend = np.sin(np.pi * x / 8000.0) * np.sin(np.pi * y / 6000.0)
    x, y = x + 500.0 * bend, y - 300.0 * bend
    corners = {"x_corners": (("j", "i"), x), "y_corners": (("j", "i"), y)}
    xr.Dataset(corners).to_netcdf(folder / "corners.nc")
    quads = [
        [5 * j + i, 5 * j + i + 1, 5 * j + i + 6, 5 * j + i + 5] for j in range(3) for i in range(4)
    ]
    a, b, c, d = quads[0]
    first, second = quads[5], quads[6]
    joined = [first[0], first[1], second[1], second[2], first[2], first[3]]
    faces = [[a, b, c], [a, c, d], joined, *quads[1:5], *quads[7:]]
    padded = np.array([face + [-1] * (6 - len(face)) for face in faces])
    xr.Dataset(
        {
            "node_x": ("node", x.ravel()),
            "node_y": ("node", y.ravel()),
            "face_nodes": (("face", "corner"), padded),
        }
    ).to_netcdf(folder / "faces.nc")


SCENES = {  # grid of exchange, grid of the wind
    "uniform": (UNIFORM, AIR),
    "rectilinear": (RECTILINEAR, AIR),
    "curvilinear": ('kind = "curvilinear"\nfile = "corners.nc"', AIR),
    "unstructured": ('kind = "unstructured"\nfile = "faces.nc"', AIR),
    "one-grid": (UNIFORM, ""),
    "unstructured-under-curvilinear": ('kind = "unstructured"\nfile = "faces.nc"', WARPED_AIR),
}
FACES = ("uniform", "rectilinear", "unstructured-under-curvilinear")  # also with `cells = "faces"`


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("scenes")
    write_corners(folder)
    for name, (grid, air) in SCENES.items():
        (folder / f"{name}.toml").write_text(SCENE.format(grid=grid, air=air))
    for name in FACES:
        (folder / f"{name}-faces.toml").write_text(
            f'[bmi]\nscene = "{name}.toml"\ncells = "faces"\nfloe_capacity = 30\n'
        )
    return folder


@pytest.mark.parametrize("name", [*SCENES, *(f"{name}-faces" for name in FACES)])
def test_FloeBmi_keeps_the_contract(scenes: Path, name: str) -> None:
    assert check_bmi(FloeBmi, scenes / f"{name}.toml") == []


def found(mutant: type[FloeBmi], config: Path, check: str) -> bool:
    """Whether the check tells a breach; an error that is not the component's own does not count."""
    first = next(violations(mutant, config, check), "")
    return bool(first) and (": raised" not in first or ": raised InputError" in first)


def test_there_are_many_mutants() -> None:
    assert len(MUTANTS) + len(FACE_MUTANTS) >= 30


@pytest.mark.parametrize(("mutant", "check"), MUTANTS, ids=lambda it: getattr(it, "__name__", it))
def test_this_breach_is_found(scenes: Path, mutant: type[FloeBmi], check: str) -> None:
    assert found(mutant, scenes / "uniform.toml", check)


@pytest.mark.parametrize(
    ("mutant", "check"), FACE_MUTANTS, ids=lambda it: getattr(it, "__name__", it)
)
def test_this_breach_of_faces_is_found(scenes: Path, mutant: type[FloeBmi], check: str) -> None:
    assert found(mutant, scenes / "uniform-faces.toml", check)
