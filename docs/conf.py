"""The documentation site: python -m sphinx -W -b html docs docs/_build"""

import inspect
import os
import sys
import warnings
from importlib.util import find_spec
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

import click  # noqa: E402
from matplotlib.figure import Figure  # noqa: E402
from sphinx_gallery.scrapers import figure_rst  # noqa: E402

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
    "sphinx.ext.napoleon",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = f"floebmi {release}"
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3

# Hosts are not needed to read about them.
autodoc_mock_imports = [
    name for name in ("landlab", "veros", "yac", "grpc4bmi") if find_spec(name) is None
]
autodoc_typehints = "none"  # the docstrings say shapes and units
napoleon_google_docstring = False


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
    return figure_rst(paths, gallery_conf["src_dir"])


warnings.filterwarnings("ignore", "ice not placed")
sphinx_gallery_conf = {
    "examples_dirs": str(ROOT / "examples" / "gallery"),
    "gallery_dirs": "gallery",
    "filename_pattern": r".*" if find_spec("landlab") else r"^((?!landlab).)*$",
    "image_scrapers": (pictures,),
    "capture_repr": (),
    "reset_modules": (),
    "show_memory": False,
    "show_signature": False,
    "min_reported_time": 1e9,
    "download_all_examples": False,
    "remove_config_comments": True,
}


# ---- pages that are made from the package -----------------------------------------------------


def keys_page():
    """Every key of a scene file, from the declarations that read it."""
    lines = [
        "# Keys of a scene file",
        "",
        "Made from the declarations that read the file; `floebmi scene --keys` prints the same. SI units (m, s, m/s, Pa,"
        " kg/m³), angles on the globe in degrees. `{}` stands for a table.",
    ]
    above = None
    for table, key, default, text in tables.keys(scene.Scene):
        if table != above:
            lines += ["", f"## `[{table}]`" if table else "## At the top", ""]
            lines += ["| key | default | meaning |", "|---|---|---|"]
            above = table
        told = f"`{default}`" if default not in ("", "required") else default
        lines.append(f"| `{key}` | {told} | {_cell(text)} |")
    return lines


def variables_page():
    """The table of variables."""
    text = inspect.cleandoc(variables.__doc__).split("\n\n", 2)[2]
    return ["# Variables", "", text, "", *variables.table().splitlines()]


def cli_page():
    """Help of every command, as the command line prints it."""
    lines = ["# Command line", ""]
    for path, command in cli_commands():
        context = click.Context(command, info_name=path, max_content_width=96, terminal_width=96)
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
os.environ.setdefault("MPLBACKEND", "Agg")
