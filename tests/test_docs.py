"""The documentation is whole and true: its code runs, nothing public is left out, no link leads nowhere."""

import ast
import inspect
import re
import runpy
import shlex
import subprocess
import sys
import zipfile
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import get_args, get_type_hints

import click
import numpy as np
import pytest
from click.testing import CliRunner

import floebmi
from coupling import regrid, vectors
from floebmi import forces, plot, projection, sizes
from floebmi.bonds import TensileStrength
from floebmi.cli import floebmi as program
from floebmi.contact import Contact, Dashpot
from floebmi.scene import Scene
from floebmi.tables import keys, parameter_texts

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = sorted(
    [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *DOCS.rglob("*.md")],
    key=lambda path: path.relative_to(ROOT),
)
PAGES = [
    path for path in PAGES if not {"_build", "gallery", "made"} & set(path.relative_to(ROOT).parts)
]
FENCE = re.compile(r"(?:^([^\n]*)\n\n)?^```(\w*)\n(.*?)^```$", re.S | re.M)
WALKED = ["getting-started", "howto/forcing", "howto/floes-and-coast", "howto/restart", "howto/ensembles", "hosts/landlab"]  # fmt: skip
NOTEBOOKS = ["tutorials/namelist", "tutorials/landlab"]  # each block goes on from the one above


def name(path):
    return str(path.relative_to(ROOT))


# ---- what a page tells the reader to do ----------------------------------------------------------


def test_no_block_of_a_page_is_passed_over():
    for page in WALKED + NOTEBOOKS:
        text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
        assert 2 * len(FENCE.findall(text)) == len(re.findall("^```", text, re.M)), page


@pytest.mark.parametrize("page", WALKED + NOTEBOOKS)
def test_what_a_page_tells_the_reader_to_write_and_run_works(page, tmp_path, monkeypatch):
    if "landlab" in page:
        pytest.importorskip("landlab", reason="the extra `landlab` is not installed")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    ran, names = 0, {}
    blocks = FENCE.findall((DOCS / f"{page}.md").read_text(encoding="utf-8"))
    for above, kind, text in blocks:
        if (file := re.search(r"`(\w+\.\w+)`", above)) and above.endswith(":"):
            Path(file[1]).write_text(text, encoding="utf-8")
        elif kind == "python":
            Path("script.py").write_text(text, encoding="utf-8")
            left = runpy.run_path("script.py", init_globals=names, run_name="__main__")
            names = left if page in NOTEBOOKS else {}
            ran += 1
        elif not kind:
            for line in text.splitlines():
                if line.startswith("floebmi "):
                    done = CliRunner().invoke(program, shlex.split(line, comments=True)[1:])
                    assert done.exit_code == 0, f"{line}: {done.output}"
                    ran += 1
    assert ran >= 1


def blocks(page, kind):
    text = page.read_text(encoding="utf-8")
    text = re.sub(r"^```\{.*?^```$", "", text, flags=re.S | re.M)  # MyST's own
    return [text for _, found, text in FENCE.findall(text) if found == kind]


def test_the_parts_of_a_host_that_couple_md_shows_run():
    grid = floebmi.Grid.uniform((1e6, 1.006e6), (0, 4e3), spacing=1e3)
    tau_x, tau_y = np.ones((2, grid.size))
    names = {
        **vars(vectors), **vars(regrid), **vars(projection), "grid": grid,
        "longitude": np.full(grid.size, -30.0), "latitude": np.full(grid.size, 80.0),
        "regrid": regrid.Regrid(grid, grid), "projection": "EPSG:3413", "VELOCITY": ["u", "v"],
        "ice": SimpleNamespace(set_value=lambda name, values: names.update({name: values})),
        "u": np.ones(4 * 6), "stress_x": np.arange(24.0),
        "east": tau_x, "north": tau_y, "tau_x": tau_x, "tau_y": tau_y,
    }  # fmt: skip
    _, faces, turns = blocks(DOCS / "couple.md", "python")
    exec(faces, names)
    assert names["taux"].sum() == pytest.approx(24 * 23 / 2) and names["lost"] == 0
    exec(turns, names)
    back = vectors.turn(names["tau_east"], names["tau_north"], names["angle"])
    np.testing.assert_allclose(back, [tau_x, tau_y])


def test_the_calls_of_the_page_on_veros_are_those_of_the_package():
    source = ast.walk(ast.parse((ROOT / "coupling" / "veros.py").read_text(encoding="utf-8")))
    takes = {}
    for one in source:
        if isinstance(one, ast.ClassDef) and one.name == "SeaIce":
            one = next(each for each in one.body if getattr(each, "name", "") == "__init__")
            takes["SeaIce"] = one.args
        elif isinstance(one, ast.FunctionDef):
            takes[one.name] = one.args
    (block,) = blocks(DOCS / "hosts" / "veros.md", "python")
    calls = [one for one in ast.walk(ast.parse(block)) if isinstance(one, ast.Call)]
    for call in calls:
        name = getattr(call.func, "attr", getattr(call.func, "id", None))
        if name != "make_model":  # the reader's
            words = [each.arg for each in takes[name].args + takes[name].kwonlyargs]
            assert len(call.args) <= len(words)
            assert {each.arg for each in call.keywords} <= set(words), name
    assert len(calls) == 4


def told_commands(page):
    """Commands of a page, a line each: those of its blocks, and those in its text."""
    text = page.read_text(encoding="utf-8")
    for block in blocks(page, ""):
        yield from (line for line in block.splitlines() if line.strip())
    yield from re.findall(r"`(floebmi [^`]+|python [^`]+)`", re.sub(r"^```.*?^```$", "", text, flags=re.S | re.M))  # fmt: skip


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_every_command_of_a_page_is_understood(page):
    for told in told_commands(page):
        for line in re.split(r" && |[()]", told.partition("  #")[0]):
            words = shlex.split(line.replace("[", "").replace("]", ""), comments=True)
            if words[:2] == ["mpirun", "-n"]:
                words = words[3:]
            if not words:
                continue
            if words[0] == "floebmi":
                understood(program, words[1:])
            elif words[0] == "python" and words[1] == "-m":
                assert find_spec(words[2]) or words[2] in {"sphinx", "grpc4bmi"}, told
            elif words[0] == "python":
                assert (ROOT / words[1]).is_file(), told
            else:
                known = {"cd", ".", "bmi-test", "ruff", "mypy", "run-bmi-server", "pip"}
                assert words[0] in known, told


def understood(command, words):
    """Let click read a command line, options and all, without running it."""
    context = click.Context(command)
    while isinstance(command, click.Group) and words and not words[0].startswith("-"):
        command = command.commands[words[0]]
        words = words[1:]
        context = click.Context(command, parent=context)
    if words or not isinstance(command, click.Group):
        with suppress(
            click.MissingParameter, click.exceptions.Exit
        ):  # a command's name alone; --help
            command.make_context(command.name, [*words])


@pytest.mark.parametrize("page, file", [("contact-law", "contact"), ("force", "forces")])
def test_the_code_that_a_how_to_shows_is_the_packages_own(page, file):
    source = (ROOT / "floebmi" / f"{file}.py").read_text(encoding="utf-8")
    text = (DOCS / "howto" / f"add-a-{page}.md").read_text(encoding="utf-8")
    shown = re.findall(r"^ *((?:@\w+\.register|def _|class \w+|return .+).*)$", text, re.M)
    assert len(shown) >= 3
    for line in shown:
        assert line in source, line


# ---- nothing is left out -----------------------------------------------------------------------


def test_every_public_name_is_in_the_reference():
    told = (DOCS / "reference" / "api.md").read_text(encoding="utf-8")
    for one in set(floebmi.__all__) - {"__version__"}:
        assert re.search(rf"\.{one}$", told, re.M), one


def test_everything_that_draws_is_in_the_reference():
    told = (DOCS / "reference" / "api.md").read_text(encoding="utf-8")
    shown = re.search(r"automodule:: floebmi\.plot\n +:members: (.+)", told)[1].split(", ")
    for name, one in inspect.getmembers(plot, inspect.isfunction):
        if one.__module__ == plot.__name__ and not name.startswith("_"):
            assert name in shown, name


def laws():
    """Every law that a model takes."""
    found = [*get_args(forces.Force), *get_args(sizes.Sizes)]
    for part in (Contact, TensileStrength):
        for hint in get_type_hints(part).values():
            found += [one for one in get_args(hint) or [hint] if hasattr(one, "_fields")]
    made = {Dashpot, sizes.Empirical}  # by the model, out of others
    return sorted(set(found) - made, key=lambda law: law.__name__)


def test_the_laws_are_found():
    assert {"OceanDrag", "Coulomb", "Beam", "Healing", "CompressiveFailure", "PowerLaw"} <= {
        law.__name__ for law in laws()
    }


@pytest.mark.parametrize("law", laws(), ids=lambda law: law.__name__)
def test_every_law_says_what_its_numbers_are(law):
    assert inspect.getdoc(law)
    told = (DOCS / "reference" / "api.md").read_text(encoding="utf-8")
    assert re.search(rf"\.{law.__name__}$", told, re.M)
    for one in law._fields:
        assert parameter_texts(law).get(one), one


def test_every_key_of_a_scene_is_explained():
    for table, key, _, text in keys(Scene):
        said = re.sub(r"\[[^]]*\]|\([^)]*\)$", "", text)  # beside unit and allowed words
        assert said.strip(" ;"), f"[{table}] {key}"


def commands(command=program, path="floebmi"):
    yield path, command
    if isinstance(command, click.Group):
        for word, inner in command.commands.items():
            yield from commands(inner, f"{path} {word}")


@pytest.mark.parametrize("path, command", list(commands()), ids=lambda one: one if isinstance(one, str) else "")  # fmt: skip
def test_every_command_and_option_says_what_it_does_and_is_in_the_readme(path, command):
    assert command.help
    for option in command.params:
        assert not isinstance(option, click.Option) or option.help, option.name
    words = path.split()
    if len(words) == 2:
        assert re.search(rf"`{path}\b", (ROOT / "README.md").read_text(encoding="utf-8"))


def test_every_example_and_every_page_is_reached():
    told = "".join(path.read_text(encoding="utf-8") for path in PAGES)
    for script in (ROOT / "examples").glob("*.py"):
        assert f"examples/{script.name}" in told
    index = (DOCS / "index.md").read_text(encoding="utf-8")
    for page in PAGES:
        if page.is_relative_to(DOCS) and page.name != "index.md":
            assert re.search(rf"^{page.relative_to(DOCS).with_suffix('')}$", index, re.M), page


# ---- links -----------------------------------------------------------------------------------------


def anchors(page):
    """The anchors of a page's headings, as GitHub and MyST make them."""
    heads = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.M)
    return {re.sub(r"[^\w -]", "", head.lower()).replace(" ", "-") for head in heads}


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_relative_links_lead_somewhere(page):
    prose = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.S | re.M)
    for target in re.findall(r"\]\(([^)\s]+)\)", prose):
        if re.match(r"\w+:", target):
            continue
        path, _, anchor = target.partition("#")
        to = page.parent / path if path else page
        if to.parts[-2:] == ("gallery", "index.rst"):  # made with the site
            to = ROOT / "examples" / "gallery" / "GALLERY_HEADER.rst"
        if to.parent.name == "made":  # too
            assert to.stem in (DOCS / "conf.py").read_text(encoding="utf-8"), target
            continue
        assert to.exists(), target
        assert not anchor or anchor in anchors(to), target


def test_the_citation_is_of_this_version():
    lines = (ROOT / "CITATION.cff").read_text(encoding="utf-8").splitlines()
    assert f"version: {floebmi.__version__}" in lines


# ---- the site, and the package ------------------------------------------------------------------


@pytest.mark.long
def test_the_site_is_built_without_a_warning(tmp_path):
    pytest.importorskip("sphinx_gallery")
    words = ["-m", "sphinx", "-W", "-q", "-b", "html", "-D", "plot_gallery=0", DOCS, tmp_path]
    done = subprocess.run([sys.executable, *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for page in ("index", "reference/made/scene-keys", "gallery/two_floes"):
        assert (tmp_path / f"{page}.html").exists()


@pytest.mark.long
def test_a_wheel_holds_licences_data_types_and_the_page(tmp_path):
    words = ["-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", tmp_path, ROOT]
    subprocess.run([sys.executable, *words], check=True)
    (wheel,) = tmp_path.glob("*.whl")
    have = zipfile.ZipFile(wheel).namelist()
    data = ROOT / "floebmi" / "scenes" / "data"
    for file in ("py.typed", "view.html", "scenes/labrador-sea.toml"):
        assert f"floebmi/{file}" in have
    assert "coupling/py.typed" in have
    for licence in (
        "LICENSE",
        *(f"floebmi/scenes/data/{one.name}" for one in data.glob("*.LICENSE")),
    ):
        assert any(name.endswith(f".dist-info/licenses/{licence}") for name in have), licence
