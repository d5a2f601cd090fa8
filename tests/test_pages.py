"""What README and documentation tell the reader to write and run works, block by block.

A page is walked from top to bottom in an empty folder: a block under a line that ends with a file's name and a colon is
written to that file, Python is run, and so is each line of a block without a language and each command in the text.
The suite shortens what would be long; `-m long` runs what is long even so.
"""

import inspect
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import textwrap
import tomllib
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace

import click
import numpy as np
import pytest
from click.testing import CliRunner
from test_examples import REAL, ROOT, example

import floebmi as fb
from coupling import regrid, slab, vectors
from floebmi import bmi_check, contact, forces, projection
from floebmi.cli import floebmi
from floebmi.scene import copy_scene

DOCS = ROOT / "docs"
MADE = {"_build", "gallery", "made"}  # with the site
PAGES = [
    path.relative_to(ROOT).as_posix()
    for path in (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.rglob("*.md")))
    if not MADE & set(path.relative_to(ROOT).parts)
]

PROGRAMS = {"floebmi", "python", "mpirun", "bmi-test"}
# Options at the end of a command that make it short: the last word counts.
SHORTER = {
    "floebmi run labrador-sea": "--duration 7200",
    "floebmi run strait ": "--duration 600",
    "floebmi tradeoff": "--seeds 1 --jobs 1 --budget 0.5",
    "floebmi tradeoff benchmarks/wide.toml": "--set floes.concentration=0.1 --set output.every=120 --duration 120",
    "floebmi validate": "area-budget",
    "floebmi experiment shear": "--seeds 1 --jobs 1 --floes 70 --height 150 --radius-max 8 --held 16"
    " --settling 40 --consolidation 30 --duration 20",
    "floebmi experiment strait": "--seeds 1 --jobs 1 --funnel 6e3 --channel 1e3 --hours 1",
    "python -m benchmarks.bare": "--floes 300 --repeats 1 --steps 20",
    "python -m benchmarks.cohesive": "--floes 300 --repeats 1",
    "python -m benchmarks.dense": "--floes 300 --repeats 1",
    "python -m benchmarks.engines": "--sizes 100 --ratios 2 --packs loose --repeats 1 --steps 20",
    "python -m benchmarks.exchange": "--floes 300 --cells 10 --repeats 1",
    "python -m benchmarks.fuzz": "--scenes 1",
    "python -m benchmarks.growth": "--largest 1000 --repeats 1",
    "python -m benchmarks.limit": "--floes 1000",
    "python -m benchmarks.stability": "--steps 2",
    "python -m benchmarks.start": "--repeats 1",
    "python -m benchmarks.threads": "--floes 1000 --steps 5 --repeats 1",
    "python -m pytest": "--collect-only -q",
    "python examples/paper.py": "--quick --seeds 1",
    "python examples/shallow_water.py": "--hours 1",
    "python examples/two_processes.py": "--hours 0.5",
    "python examples/veros_fram_strait.py": "--days 0.05",
}
# Long even so, or of kernels that nothing else in the suite compiles.
LONG = re.compile(
    "floebmi (tradeoff|validate .|experiment (shear|strait)|run strait |plot .*tradeoff|run .* --accuracy|explain .* --calibrate)"
    "|python -m (benchmarks|examples|pytest)|python examples|mpirun|bmi-test"
)
# Pages that take long however short their commands are: kernels of laws of their own, processes one after the other.
LONG_PAGES = {"docs/howto/a-law-of-your-own.md", "docs/hosts/any-bmi-host.md"}
# Not run from a page: the file that runs it, and by which words.
ELSEWHERE = {
    r"python -m venv venv": (".ci/run", "python3 -m venv"),
    r"\. venv/bin/activate": (".ci/run", "/bin/activate"),
    r"python -m pip install .*": (".ci/run", "python -m pip install"),
    r"ruff check \.": (".ci/run", "\nruff check .\n"),
    r"ruff format --check \.": (".ci/run", "\nruff format --check .\n"),
    r"mypy": (".ci/run", "\nmypy\n"),
    r"python -m sphinx .*docs docs/_build": (".ci/run", "python -m sphinx -W --keep-going"),
    r"run-bmi-server --name floebmi\.FloeBmi .*": (
        "examples/two_processes.py",
        'BmiClientSubProcess("floebmi.FloeBmi"',
    ),
}
# What stands for something of the reader's.
READERS = {
    "SCENE": "two-floes",
    "NAME": "two-floes",
    "FILE": "two-floes",
    "DATA_FOLDER": str(REAL),
    "package.module:Host": "coupling.slab:TwoSlabOcean",
    "config.toml": "two-processes/ocean.toml",
    **dict(zip(("U", "V", "TAU_X", "TAU_Y"), slab.SURFACE + bmi_check.STRESS, strict=True)),
}
PACKAGES = {  # that a page is about
    "docs/tutorials/landlab.md": "landlab",
    "docs/hosts/landlab.md": "landlab",
    "docs/hosts/veros.md": "veros",
    "docs/hosts/shallowwater.md": "shallowwater",
    "docs/hosts/yac.md": "yac",
    "docs/hosts/grpc.md": "grpc4bmi",
}
ENVIRONMENT = os.environ | {
    "PATH": os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]]),
    "PYTHONPATH": str(ROOT),
    "MPLBACKEND": "Agg",
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "OMPI_MCA_rmaps_base_oversubscribe": "1",
}

# ---- reading a page ----------------------------------------------------------------------------------

FENCE = re.compile(r"^ *```(\S*)\n(.*?)^ *```$", re.S | re.M)
IN_TEXT = re.compile(r"`((?:floebmi|python) [^`]+)`")


def read(name):
    return (ROOT / name).read_text(encoding="utf-8")


def parts(page):
    """(line above, kind, text) of each block, and of each command in the text, whose kind is "`"."""
    prose, *rest = FENCE.split(read(page))
    while True:
        yield from (("", "`", command) for command in IN_TEXT.findall(prose))
        if not rest:
            return
        above = prose.rstrip().rpartition("\n")[2]
        kind, text, prose, *rest = rest
        yield above, kind, textwrap.dedent(text)


def blocks(page, kind):
    return [text for _, found, text in parts(page) if found == kind]


def commands(line):
    line = line.partition("  #")[0]  # a comment
    return [one.strip() for one in re.split(r" && |[()]", line) if one.strip()]


def every_command(page):
    return [
        command
        for _, kind, text in parts(page)
        if kind in ("", "`")
        for line in text.splitlines()
        for command in commands(line)
    ]


# ---- doing what it tells -------------------------------------------------------------------------------


def walk(page, given, long):
    """Do it all in this folder; returns the names that its Python leaves, and what is not installed.

    Where names are `given` blocks go on from the one above, else each stands alone.
    """
    left, absent = {}, {}  # of each command, which may be told twice
    for above, kind, text in parts(page):
        if kind and (file := re.search(r"`(\w+\.(?:py|toml|csv|geojson))`.*:$", above)):
            Path(file[1]).write_text(text, encoding="utf-8")
        elif kind == "python":
            left = {"__name__": "__main__"} | ({} if given is None else left | given)
            exec(compile(text, page, "exec"), left)
        elif kind == "toml":  # a part of a scene
            tables = tomllib.loads(text).items()
            pairs = [(f"{name}.{key}", value) for name, table in tables for key, value in table.items()]  # fmt: skip
            changes = [f"{key}={json.dumps(value)}" for key, value in pairs]
            fb.read_scene("periodic-box", changes).build()
        elif kind in ("", "`"):
            for line in text.splitlines():
                folder = "."
                for command in commands(line):
                    if command.startswith("cd "):
                        folder = words_of(command)[1]
                    elif command not in absent:
                        absent[command] = do(command, folder, kind == "`", long)
        else:  # what a program prints; what Sphinx reads
            assert kind == "text" or kind.startswith("{"), f"a block of {kind!r} is not run"
            assert text.split()[0] not in PROGRAMS, f"a block of text is not run: {text}"
    return left, set().union(*absent.values())


def words_of(command):
    words = shlex.split(command.replace("[", "").replace("]", ""), comments=True)
    return [READERS.get(word, word) for word in words]


def do(command, folder, mentioned, long):
    """Run a command, or see that it is run elsewhere; returns what it needs and is not installed."""
    for pattern, (file, text) in ELSEWHERE.items():
        if re.fullmatch(pattern, command):
            assert text in read(file), f"{file} does not run {command!r}"
            return set()
    words = words_of(command)
    assert words[0] in PROGRAMS, f"{command!r} is not run, nor said to be run elsewhere"
    if words[0] == "floebmi" and not understood(words) and mentioned:  # the name of a command
        return set()
    if words[0] == "python":
        found = find_spec(words[2]) if words[1] == "-m" else (ROOT / words[1]).is_file()
        assert found, f"{command}: there is no such thing"
    if LONG.match(command) and not long:
        return set()
    for start, more in SHORTER.items():
        words += shlex.split(more) if command.startswith(start) else []
    if words[0] == "floebmi":
        done = CliRunner().invoke(floebmi, words[1:])
        assert done.exit_code == 0, f"{command}: {done.output}"
        return set()
    folder = ROOT if command.startswith("python -m pytest") else folder  # there it writes nothing
    needed = {words[0], *(["valgrind"] if "--instructions" in words else [])}
    absent = {one for one in needed if shutil.which(one, path=ENVIRONMENT["PATH"]) is None}
    absent |= {str(REAL)} if str(REAL) in words and not REAL.is_dir() else set()
    if not absent:
        done = subprocess.run(words, cwd=folder, env=ENVIRONMENT, capture_output=True, text=True)
        assert done.returncode == 0, f"{command}: {done.stdout}{done.stderr}"
    return absent


def understood(words):
    """Whether click reads a line to its end; False where an argument is missing, an error for a wrong word."""
    command, rest = floebmi, words[1:]
    while isinstance(command, click.Group) and rest and not rest[0].startswith("-"):
        command = command.commands[rest.pop(0)]
    try:
        command.make_context(command.name, rest)
    except (click.MissingParameter, click.exceptions.NoArgsIsHelpError):
        return False
    except click.exceptions.Exit:  # --help
        pass
    return True


# ---- what the reader has, and what must come of a page -------------------------------------------------


def a_host():
    grid = fb.Grid.uniform((1e6, 1.006e6), (0, 4e3), spacing=1e3)
    tau_x, tau_y = np.ones((2, grid.size))
    return {
        **vars(vectors), **vars(regrid), **vars(projection), "grid": grid,
        "longitude": np.full(grid.size, -30.0), "latitude": np.full(grid.size, 80.0),
        "regrid": regrid.Regrid(grid, grid), "projection": "EPSG:3413", "VELOCITY": ["u", "v"],
        "ice": SimpleNamespace(set_value=lambda name, values: None),
        "u": np.ones(4 * 6), "stress_x": np.arange(24.0),
        "east": tau_x, "north": tau_y, "tau_x": tau_x, "tau_y": tau_y,
    }  # fmt: skip


def the_host_keeps_momentum(left):
    water, momentum = left["water"], np.ravel(left["momentum"])
    now = left["COLUMN"] * left["cell"] * water.sum(axis=1) + momentum
    assert np.abs(now - left["start"]).max() < 1e-12 * left["start"][0]
    assert 0.1 < water[0].mean() < 0.3  # the ice took some
    assert left["taux"].sum() == pytest.approx(24 * 23 / 2) and left["lost"] == 0
    back = vectors.turn(left["tau_east"], left["tau_north"], left["angle"])
    np.testing.assert_allclose(back, [left["tau_x"], left["tau_y"]])
    again = fb.FloeBmi()
    again.initialize("ice.toml")
    assert again.get_current_time() == 6 * 3600.0
    grid = again.get_var_grid("sea_ice__area_fraction")
    assert again.get_grid_type(grid) == "unstructured"


def a_setup_of_veros():
    veros = example("veros_fram_strait")
    return vars(veros) | {"make_model": veros.make_ice((8e3, 14e3), 0.6, channel=False)}


def veros_carries_the_ice(left):
    class Setup(left["Ocean"]):
        @left["veros_routine"]
        def set_initial_conditions(self, state):
            super().set_initial_conditions(state)
            self.wind_taux, self.wind_tauy = self.wind
            left["set_initial_conditions"](self, state)

        set_forcing = left["set_forcing"]

    ocean = Setup(12, 900.0)
    ocean.setup()
    for _ in range(4):
        ocean.step(ocean.state)
    ledger = ocean.ice.ledger
    assert max(line.relative for line in ledger) <= 1e-12
    assert np.abs(ledger[-1].to_host).min() > 0


def the_readmes_run_conserves(left):
    assert left["model"].ledger.balance("momentum_x").relative < 1e-12
    assert 0.5 < float(left["ice"].sea_ice_area_fraction[-1].mean()) < 0.7
    assert Path("floes.nc").exists()


def an_ocean_in_another_process():
    Path("two-processes").mkdir()
    text = example("two_processes").OCEAN
    Path("two-processes/ocean.toml").write_text(text, encoding="utf-8")


def a_scene_in_a_folder():
    Path("FOLDER").mkdir()
    copy_scene("periodic-box", Path("FOLDER/scene.toml"))


def all_but_the_laws_that_the_page_makes():
    made = {"Damsgaard2018Coulomb", "BodyForce"}
    known = vars(forces) | vars(contact)
    return {name: one for name, one in known.items() if name not in made}


GIVEN = {
    "CONTRIBUTING.md": a_scene_in_a_folder,
    "docs/couple.md": a_host,
    "docs/hosts/any-bmi-host.md": an_ocean_in_another_process,
    "docs/hosts/veros.md": a_setup_of_veros,
    "docs/howto/add-a-law.md": all_but_the_laws_that_the_page_makes,
    "docs/tutorials/landlab.md": dict,
    "docs/tutorials/namelist.md": dict,
}


def nothing_of_a_law_stays(left):
    for table in (forces.ACCOUNTS, forces.READS):
        del table[left["WaveStress"]]


AFTER = {
    "docs/howto/a-law-of-your-own.md": nothing_of_a_law_stays,
    "README.md": the_readmes_run_conserves,
    "docs/couple.md": the_host_keeps_momentum,
    "docs/hosts/veros.md": veros_carries_the_ice,
}


# ---- the tests --------------------------------------------------------------------------------------------


@pytest.fixture
def elsewhere(tmp_path, monkeypatch):
    """An empty folder but for what a command names that stands in the sources."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    Path("docs").mkdir()
    for name in ("benchmarks", "examples"):
        Path(name).symlink_to(ROOT / name)


def works(page, long):
    if page in PACKAGES and find_spec(PACKAGES[page]) is None:  # YAC is no bare import
        pytest.skip(f"{PACKAGES[page]} is not installed")
    left, absent = walk(page, GIVEN.get(page, lambda: None)(), long)
    if page in AFTER:
        AFTER[page](left)
    if absent:
        pytest.skip(f"the rest has run; not here: {', '.join(sorted(absent))}")


@pytest.mark.parametrize("page", PAGES)
def test_no_block_of_a_page_is_passed_over(page):
    ends = re.findall(r"^ *(?:```|~~~)", read(page), re.M)
    assert len(ends) == 2 * len(FENCE.findall(read(page)))


@pytest.mark.parametrize(
    "page",
    [pytest.param(page, marks=[pytest.mark.long] * (page in LONG_PAGES)) for page in PAGES],
)
def test_what_a_page_tells_the_reader_to_write_and_run_works(page, elsewhere):
    works(page, long=False)


@pytest.mark.long
@pytest.mark.parametrize("page", [one for one in PAGES if any(map(LONG.match, every_command(one)))])
def test_what_takes_long_on_a_page_works_too(page, elsewhere):
    works(page, long=True)


def test_the_extras_that_a_page_installs_are_those_of_the_package():
    have = tomllib.loads(read("pyproject.toml"))["project"]["optional-dependencies"]
    told = [command for page in PAGES for command in every_command(page)]
    found = re.findall(r"pip install [^\n]*\.\[([\w,]+)\]", "\n".join(told))
    assert len(found) > 5 and {one for each in found for one in each.split(",")} <= set(have)


def test_no_entry_of_the_tables_is_without_its_command():
    told = [command for page in PAGES for command in every_command(page)]
    for start in SHORTER:
        assert any(command.startswith(start) for command in told), start
    for pattern in ELSEWHERE:
        assert any(re.fullmatch(pattern, command) for command in told), pattern
    words = {word.strip("[]") for command in told for word in command.split()}
    assert set(READERS) <= words


@pytest.mark.parametrize("page, longest", [("README.md", 20), ("docs/couple.md", 30)])
def test_the_first_script_of_a_page_is_short(page, longest):
    assert len(blocks(page, "python")[0].splitlines()) <= longest


# ---- a law of one's own ---------------------------------------------------------------------------------


def shown(law):
    """The code of a law of the package, as the how-to shows it."""
    (code,) = (one for one in blocks("docs/howto/add-a-law.md", "python") if f"class {law}(" in one)
    return code


@pytest.mark.parametrize("module, law", [(contact, "Damsgaard2018Coulomb"), (forces, "BodyForce")])
def test_the_code_that_a_how_to_shows_is_the_packages_own_and_all_of_it(module, law):
    source = inspect.getsource(module)
    for one in re.split("\n\n\n+", shown(law).strip()):
        assert one in source, one
    registered = re.compile(rf"^def _\(\w+: {law},", re.M)
    assert len(registered.findall(shown(law))) == len(registered.findall(source)) >= 1


OF_ONES_OWN = {
    ("contact", "Damsgaard2018Coulomb"): """
import floebmi as fb

def ends(law):
    domain = fb.Domain((0, 100.0), (0, 100.0), *["periodic"] * 4)
    floes = fb.Floes([20.0, 41.0], [50.0, 55.0], [10.0, 12.0], 1.0, u=[1.0, 0.0])
    model = fb.Model(domain, floes, contact=fb.Contact(friction=law))
    model.advance(20.0)
    return [*model.floes.u, *model.floes.v, *model.floes.angular_velocity]

assert ends(Damsgaard2018Coulomb()) == ends(fb.Damsgaard2018Coulomb())
assert ends(Damsgaard2018Coulomb()) != ends(fb.Coulomb())
""",
    ("forces", "BodyForce"): """
import floebmi as fb

ACCOUNTS[BodyForce] = "body force"
domain = fb.Domain((0, 100.0), (0, 100.0), *["periodic"] * 4)
model = fb.Model(domain, fb.Floes([50.0], [50.0], [10.0], 1.0), forces=[BodyForce(1e-3, -2e-3)])
model.advance(10.0)
assert abs(model.floes.u[0] - 1e-2) < 1e-12 and abs(model.floes.v[0] + 2e-2) < 1e-12
assert model.ledger.accounts["body force"][1] > 0
""",
}


@pytest.mark.long
@pytest.mark.parametrize("module, law", OF_ONES_OWN)
def test_what_a_how_to_adds_runs_as_a_law_of_ones_own(module, law, tmp_path):
    script = tmp_path / "script.py"
    checks = OF_ONES_OWN[module, law]
    script.write_text(f"from floebmi.{module} import *\n{shown(law)}{checks}", "utf-8")
    apart = ENVIRONMENT | {"FLOEBMI_CACHE": str(tmp_path)}  # nothing of it stays
    done = subprocess.run([sys.executable, script], env=apart, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
