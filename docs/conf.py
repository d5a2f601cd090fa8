"""The documentation site: python -m sphinx -W -b html docs docs/_build"""

import inspect
import re
import sys
import warnings
from importlib.util import find_spec
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

import click  # noqa: E402
from matplotlib.figure import Figure  # noqa: E402
from sphinx_gallery.scrapers import figure_rst  # noqa: E402
from sphinx_gallery.sorting import ExplicitOrder  # noqa: E402

import floebmi  # noqa: E402
from floebmi import cli, scene, tables, variables  # noqa: E402

project = "floebmi"
author = "The floebmi developers"
project_copyright = author
release = floebmi.__version__
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
    "sphinx_gallery.gen_gallery",
    "sphinx-mathjax-offline",  # formulas without a network, too
]
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = f"floebmi {release}"
html_static_path = ["site.css"]
html_css_files = ["site.css"]
myst_enable_extensions = ["deflist", "dollarmath"]
myst_heading_anchors = 3

# Hosts are heavy, and not needed to read about them.
autodoc_mock_imports = ["landlab", "veros", "yac", "grpc4bmi"]
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_typehints = "none"  # the docstrings say shapes and units
suppress_warnings = ["config.cache"]  # the gallery takes a function
default_role = "code"  # docstrings quote code as `this`


# ---- the gallery --------------------------------------------------------------------------------


def pictures(block, block_vars, gallery_conf):
    """The matplotlib figures that a script has made; floebmi's are not known to pyplot."""
    made = gallery_conf.setdefault("_drawn", set())
    paths = []
    for figure in block_vars["example_globals"].values():
        if isinstance(figure, Figure) and id(figure) not in made:
            made.add(id(figure))
            path = next(block_vars["image_path_iterator"])
            figure.savefig(path, dpi="figure")
            paths.append(path)
    return "\n".join(figure_rst([path], gallery_conf["src_dir"]) for path in paths)


ORDER = (
    "two_floes", "hexagonal_pack", "principal_stress", "shear", "strait", "nares_strait", "labrador_sea",
    "barents_miz", "drift_29_days", "size_distribution", "ledger", "accuracy_cost", "landlab_eddy", "veros_box",
)  # fmt: skip
BARENTS = ROOT.parent / "shared" / "data" / "arctic20_ocean_ice_20160201-05.nc"  # not shipped
NEEDED = {
    "landlab_eddy": find_spec("landlab"), "veros_box": find_spec("veros"), "barents_miz": BARENTS.exists(),
}  # fmt: skip
NOT_RUN = "|".join(["no script", *(name for name, found in NEEDED.items() if not found)])
warnings.filterwarnings("ignore", "ice not placed")
warnings.filterwarnings("ignore", ".*set to the bound")


def words(gallery_conf, script):
    """What a script is given on its command line."""
    return [str(BARENTS)] if Path(script["src_file"]).stem == "barents_miz" else []


sphinx_gallery_conf = {
    "examples_dirs": str(ROOT / "examples" / "gallery"),
    "gallery_dirs": "gallery",
    "filename_pattern": rf"^((?!{NOT_RUN}).)*$",
    "image_scrapers": (pictures,),
    "within_subsection_order": ExplicitOrder([f"{name}.py" for name in ORDER]),
    "capture_repr": (),
    "reset_modules": (),
    "reset_argv": words,
    "show_memory": False,
    "show_signature": False,
    "write_computation_times": False,
    "download_all_examples": False,
    "remove_config_comments": True,
}


def to_gallery(app, page, source):
    """A link to the scripts of the gallery, which a viewer of files shows, leads to their pages on the site."""
    here = "../" * page.count("/")
    source[0] = source[0].replace(f"]({here}../examples/gallery)", f"]({here}gallery/index.rst)")


# ---- pages that are made from the package -----------------------------------------------------


def keys_page():
    """Every key of a scene file, from the declarations that read it."""
    lines = [
        "# Keys of a scene file",
        "",
        "Generated from the declarations that read the file; `floebmi scene --keys` prints the same. SI units (m, s, m/s, Pa,"
        " kg/m³), angles on the globe in degrees. A key without a default that is not required may be left out: what it describes is then not modelled, or its meaning says what holds.",
        "",
        "A table that may be of several kinds has a heading for each kind, with the word that selects it.",
    ]
    above = None
    for table, key, default, text in tables.keys(scene.Scene):
        picks = default.startswith("= ")
        if table != above or picks:
            word = f" {key} {default}" if picks else ""
            lines += ["", f"## `[{table}]{word}`" if table else "## At the top", ""]
            lines += [text, ""] if picks else []
            lines += ["| key | default | meaning |", "|---|---|---|"]
            above = table
        if picks:
            continue
        told = f"`{default}`" if default not in ("", "required") else default
        lines.append(f"| `{key}` | {told} | {_cell(text)} |")
    return lines


def variables_page():
    """The table of variables, as a list."""
    rule = inspect.cleandoc(variables.__doc__).split("\n\n", 2)[2]
    lines = ["# Variables", "", rule]
    who = {"in": "set by a host", "out": "computed", "restart": "state of the floes"}
    for title, rows in (("Fields", variables.VARIABLES), ("Floes", variables.FLOE_VARIABLES)):
        lines += ["", f"## {title}"]
        for row in rows:
            sign = f"; {row.positive}" if row.positive else ""
            cf = f", CF `{row.cf}`" if row.cf else ""
            where = "each floe" if row.grid == "floe" else f"the {row.grid} grid"
            lines += [
                "",
                f"`{row.name}` [{row.units}]",
                f": {row.text}{sign}",
                "",
                f"  BMI `{row.csdms}`{cf}",
            ]
            lines += ["", f"  {who[row.intent]}; on {where}; valid {row.valid}"]
    return lines


def cli_page():
    """Help of every command, as the command line prints it."""
    lines = ["# Command line", ""]
    for path, command in cli_commands():
        context = click.Context(command, info_name=path, max_content_width=86, terminal_width=86)
        level = "#" * min(3, 1 + len(path.split()))
        lines += [f"{level} `{path}`", "", "```text", command.get_help(context), "```", ""]
    return lines


def cli_commands(command=cli.floebmi, path="floebmi"):
    """(words, command) of the program and of each of its commands."""
    yield path, command
    if isinstance(command, click.Group):
        for name, inner in command.commands.items():
            yield from cli_commands(inner, f"{path} {name}")


def _cell(text):
    return text.replace("|", r"\|")


PAGES = {"scene-keys": keys_page, "variables": variables_page, "cli": cli_page}


def write_pages():
    """Write the made pages where they differ from what is there."""
    for name, make in PAGES.items():
        path = Path(__file__).parent / "reference" / "made" / f"{name}.md"
        text = "\n".join(make()).rstrip() + "\n"
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.parent.mkdir(exist_ok=True)
            path.write_text(text, encoding="utf-8")


write_pages()


# ---- docstrings -----------------------------------------------------------------------------------

SECTIONS = {"Parameters", "Attributes", "Returns", "Raises", "Warns", "Examples", "Notes"}
BAR, ESCAPED = re.compile(r"\|(?=(?:[^`]*`[^`]*`)*[^`]*$)"), r"\\|"  # outside `code`
DEFINED = re.compile(r"(\w[\w, *()]*) : (.+)")
REFERENCE = (Path(__file__).parent / "reference" / "api.md").read_text(encoding="utf-8")
LINKED = {
    path.rpartition(".")[2]: path for path in re.findall(r":: (floebmi\.\w+\.\w+)\n", REFERENCE)
}
NAME = re.compile(r"(?<!`)`([A-Z]\w+)`(?!`)")  # a class, in the text of another


def sections(app, what, name, obj, options, lines):
    """NumPy's sections as reStructuredText, with `name : what it is, and its unit` as a definition."""
    made, section = [], None
    for k, line in enumerate(lines):
        below = lines[k + 1] if k + 1 < len(lines) else ""
        if line in SECTIONS and below and set(below) == {"-"}:
            section = line
            made += ["", f".. rubric:: {line}", ""]
        elif line and set(line) == {"-"} and lines[k - 1] in SECTIONS:
            continue
        elif section in (None, "Parameters", "Attributes") and (found := DEFINED.match(line)):
            made += [f"``{found[1]}``", f"    {BAR.sub(ESCAPED, found[2])}"]
        else:
            made.append(line if line.lstrip().startswith(">>>") else BAR.sub(ESCAPED, line))
    made = [NAME.sub(lambda found: _link(found[1], name), line) for line in made]
    lines[:] = _formulas(made) if what == "module" else made


def _link(word, here):
    """A class that the reference has, as a link to it."""
    known = word in LINKED and LINKED[word] != here
    return f":py:obj:`{word} <{LINKED[word]}>`" if known else f"`{word}`"


def _formulas(lines):
    """Indented lines of a module's docstring stand as they are; a list item's go on with it."""
    made, apart = [], False
    for line in lines:
        before = next((one for one in reversed(made) if one), "")
        indented = line.startswith("    ")
        if indented and not apart:
            made += ["", "::", ""]
        elif apart and line and not indented:
            made.append("")
        apart = indented or (apart and not line and before.startswith("    "))
        made.append(line.replace("\\|", "|") if indented else line)
    return made


def setup(app):
    app.connect("autodoc-process-docstring", sections)
    app.connect("source-read", to_gallery)
