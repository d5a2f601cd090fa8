"""The order of the house: imports go one way, equations that are cited exist, numba is set up in one place."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "floebmi"
FILES = sorted(PACKAGE.glob("*.py"))
EXPERIMENTS = sorted(
    (PACKAGE / "experiments").glob("*.py")
)  # above all of them but the command line


def imports_at_the_top(path):
    """The files of the package that one imports, however it is written."""
    names = set()
    for node in ast.parse(path.read_text()).body:
        if isinstance(node, ast.ImportFrom) and node.module == "floebmi":
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith("floebmi."):
            names.add(node.module.split(".")[1])
        elif isinstance(node, ast.Import):
            names |= {a.name.split(".")[1] for a in node.names if a.name.startswith("floebmi.")}
    return names & {path.stem for path in FILES}


def test_imports_go_one_way():
    graph = {path.stem: imports_at_the_top(path) for path in FILES}
    placed = set()
    while graph:
        free = {name for name, needs in graph.items() if needs <= placed}
        assert free, f"these files import each other in a circle: {sorted(graph)}"
        placed |= free
        graph = {name: needs for name, needs in graph.items() if name not in free}


@pytest.mark.parametrize(
    "below, above",
    [
        ("contact", {"model", "scene", "bmi", "cli", "output", "plot", "running"}),
        ("forces", {"model", "scene", "bmi", "cli", "output", "plot", "running"}),
        ("dynamics", {"model", "scene", "bmi", "cli", "output", "plot", "running"}),
        ("model", {"scene", "bmi", "cli", "plot", "running", "output"}),
        ("plot", {"model", "advance", "dynamics", "bmi"}),
    ],
)
def test_physics_does_not_know_who_runs_it(below, above):
    reached, rest = set(), {below}
    while rest:
        path = PACKAGE / f"{rest.pop()}.py"
        new = imports_at_the_top(path) - reached
        reached |= new
        rest |= new
    assert not reached & above


def test_every_file_has_its_group_in_the_design():
    groups = (ROOT / "docs/design.md").read_text().partition("| group | files |")[2]
    named = re.findall(r"`(\w+)`", groups.partition("\n\n")[0])
    assert sorted(named) == [path.stem for path in FILES if not path.stem.startswith("__")]


def test_the_package_does_not_import_the_couplings():
    for path in [*FILES, *EXPERIMENTS]:
        assert not re.search(r"^\s*(from|import) coupling", path.read_text(), re.MULTILINE), (
            path.name
        )


def test_nothing_but_the_command_line_knows_the_experiments():
    for path in FILES:
        if path.stem != "cli":
            assert not re.search(r"(from|import) floebmi\.experiments", path.read_text()), path.name


def test_numba_is_set_up_in_kernels_alone():
    for path in [*FILES, *EXPERIMENTS]:
        if path.stem != "kernels":
            assert not re.search(r"njit|numba\.jit|prange|numba\.config", path.read_text()), (
                path.name
            )


def test_what_kernels_compile_in_is_of_files_that_their_cache_is_named_after():
    sources = {path.stem: path.read_text() for path in FILES}
    hashed = {
        name
        for name, source in sources.items()
        if "kernels import" in source or "from numba" in source  # as in `kept_code._folder`
    }
    compiled = {"jit", "in_place", "inlined", "inner", "dispatched", "register", "overload"}
    for file in sorted(hashed):
        tree = ast.parse(sources[file])
        foreign = {
            alias.asname or alias.name: node.module
            for node in tree.body
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("floebmi.")
            for alias in node.names
            if node.module.split(".")[1] not in hashed
        }
        for function in ast.walk(tree):
            if not isinstance(function, ast.FunctionDef):
                continue
            words = re.findall(r"\w+", " ".join(map(ast.unparse, function.decorator_list)))
            if compiled & set(words):
                used = {node.id for node in ast.walk(function) if isinstance(node, ast.Name)}
                assert not used & foreign.keys(), f"{file}.{function.name} would go on as it was"


def test_every_equation_that_is_cited_is_defined_in_the_theory():
    defined = set(re.findall(r"\*\*([a-z0-9-]+)\*\*", (ROOT / "docs/theory.md").read_text()))
    for path in [*FILES, *EXPERIMENTS, *sorted((ROOT / "coupling").glob("*.py"))]:
        for group in re.findall(r"\(eqs?\. ([a-z0-9, -]+)\)", path.read_text()):
            for name in re.split(r",\s*", group):
                assert name in defined, f"{path.name} cites eq. {name}"


def test_importing_the_package_touches_neither_numba_nor_xarray():
    import subprocess
    import sys

    code = "import sys, floebmi; print([m for m in ('numba', 'xarray', 'matplotlib') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert done.stdout.strip() == "[]", done.stderr
