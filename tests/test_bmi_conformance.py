"""The BMI contract, kept by FloeBmi and by none of the components that break it."""

from pathlib import Path

import pytest
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
grid = {{kind = "uniform_rectilinear", shape = [2, 3]}}

[coriolis]
parameter = 1e-4

[time]
exchange = 60.0
"""
UNIFORM = "shape = [3, 4]"
RECTILINEAR = """kind = "rectilinear"
x_edges = [0.0, 1000.0, 3000.0, 8000.0]
y_edges = [0.0, 2500.0, 6000.0]"""


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("scenes")
    (folder / "uniform.toml").write_text(SCENE.format(grid=UNIFORM))
    (folder / "rectilinear.toml").write_text(SCENE.format(grid=RECTILINEAR))
    for name in ("uniform", "rectilinear"):
        (folder / f"{name}-faces.toml").write_text(
            f'[bmi]\nscene = "{name}.toml"\ncells = "faces"\nfloe_capacity = 30\n'
        )
    return folder


@pytest.mark.parametrize("name", ["uniform", "rectilinear", "uniform-faces", "rectilinear-faces"])
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
