"""The documentation is whole: nothing public is left out, no link leads nowhere.  Its code: test_pages."""

import importlib
import inspect
import re
import subprocess
import sys
import zipfile
from typing import get_args, get_type_hints

import click
import pytest
from test_pages import DOCS, PAGES, ROOT, read

import floebmi
from benchmarks.options import run
from floebmi import forces, plot, sizes
from floebmi.bonds import TensileStrength
from floebmi.cli import floebmi as program
from floebmi.contact import Contact, Dashpot
from floebmi.scene import Scene
from floebmi.tables import keys, parameter_texts

# ---- nothing is left out -----------------------------------------------------------------------


def test_every_public_name_is_in_the_reference():
    told = read("docs/reference/api.md")
    for one in set(floebmi.__all__) - {"__version__"}:
        assert re.search(rf"\.{one}$", told, re.M), one


def test_everything_that_draws_is_in_the_reference():
    told = read("docs/reference/api.md")
    shown = re.search(r"automodule:: floebmi\.plot\n +:members: (.+)", told)[1].split(", ")
    for name, one in inspect.getmembers(plot, inspect.isfunction):
        own = one.__module__ == plot.__name__ and not name.startswith("_")
        if own or name in plot.__all__:
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
    told = read("docs/reference/api.md")
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
        assert re.search(rf"`{path}\b", read("README.md"))


def test_every_example_and_every_page_is_reached():
    told = "".join(map(read, PAGES))
    for script in (ROOT / "examples").glob("*.py"):
        assert f"examples/{script.name}" in told
    index = read("docs/index.md")
    for page in PAGES:
        if page.startswith("docs/") and page != "docs/index.md":
            entry = page.removeprefix("docs/").removesuffix(".md")
            assert re.search(rf"^{entry}$", index, re.M), page


# ---- links -----------------------------------------------------------------------------------------


def anchors(page):
    """The anchors of a page's headings, as GitHub and MyST make them."""
    heads = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.M)
    return {re.sub(r"[^\w -]", "", head.lower()).replace(" ", "-") for head in heads}


@pytest.mark.parametrize(
    "path",
    [path for path in sorted((ROOT / "benchmarks").glob("*.py")) if "def main" in path.read_text(encoding="utf-8")],
    ids=lambda path: path.stem,
)  # fmt: skip
def test_every_benchmark_answers_a_call_for_help_and_does_not_run(path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", [str(path), "--help"])
    with pytest.raises(SystemExit):
        importlib.import_module(f"benchmarks.{path.stem}").main()
    assert f"python -m benchmarks.{path.stem}" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(
    "line, why",
    [
        ("bare --floes 0", "0: must be a whole number, at least 1"),
        ("cohesive --repeats -2", "-2: must be a whole number, at least 1"),
        ("dense --ratio 0.5", "0.5: must be a number, at least 1"),
        ("exchange --cells 0", "0: must be a whole number, at least 1"),
        ("fuzz --seed -1", "-1: must be a whole number, at least 0"),
        ("growth --largest 10", "10: must be a whole number, at least 1000"),
        ("limit --floes x", "x: must be a whole number, at least 1"),
        ("stability --to nowhere/growth.png", "there is no such folder"),
        ("start nowhere", "nowhere: neither a file here nor a packaged scene"),
        ("threads --floes 1000,0", "0: must be a whole number, at least 1"),
        ("threads --figure gains.doc", "must end with .png"),
        ("dense --floes 1", "radii of the largest floe"),
    ],
)
def test_a_benchmark_refuses_a_wrong_option_in_one_line(line, why, monkeypatch, capsys):
    name, *options = line.split()
    monkeypatch.setattr(sys, "argv", [name, *options])
    with pytest.raises(SystemExit) as stop:
        run(importlib.import_module(f"benchmarks.{name}").main)
    assert stop.value.code == 2
    assert why in capsys.readouterr().err.splitlines()[-1]


@pytest.mark.parametrize("page", PAGES)
def test_relative_links_lead_somewhere(page):
    prose = re.sub(r"^```.*?^```$", "", read(page), flags=re.S | re.M)
    page = ROOT / page
    for target in re.findall(r"\]\(([^)\s]+)\)", prose):
        if re.match(r"\w+:", target):
            continue
        path, _, anchor = target.partition("#")
        to = page.parent / path if path else page
        if to.parent.name == "made":  # with the site
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
    for page, link in (
        ("index", "gallery/index.html"),
        ("tutorials/landlab", "../gallery/index.html"),
    ):
        main = re.sub(r".*<article|</article>.*", "", read(tmp_path / f"{page}.html"), flags=re.S)
        assert f'href="{link}"' in main, page


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
