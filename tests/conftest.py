"""How the suite is run."""

import gc
from pathlib import Path

import pytest

# Two processes that begin with the same machine code would both compile it: while one begins with the command, the other has
# files that need little of it, or their own.  Then come those that take longest, so that both end at about the same time.
ORDER = (
    "cli", "symmetry", "own_laws", "ensemble", "faults", "forcing", "statistics", "regrid", "encodings", "geometry",
    "model", "boundaries", "validate", "pages", "contact", "plot", "dynamics", "experiments", "scene", "plain",
    "tradeoff", "laws", "sequences", "threads", "bmi_conformance", "packing", "output", "driver",
)  # fmt: skip


def pytest_configure() -> None:
    # Compiling makes millions of objects that stay: to look through them for garbage took a twelfth of the time.
    gc.set_threshold(100_000, 20, 20)


@pytest.hookimpl(tryfirst=True)
def pytest_cmdline_main(config: pytest.Config) -> None:
    """The whole suite is shared by two processes, file by file, since the tests of a file share machine code.

    A choice of one's own (`-n`, `--pdb`, some tests by name) is left as it is; so is all without pytest-xdist.
    """
    options, whole = config.option, config.args_source is config.ArgsSource.TESTPATHS
    if not whole or hasattr(config, "workerinput") or not config.pluginmanager.hasplugin("xdist"):
        return
    if options.numprocesses is None and not (options.usepdb or options.collectonly):
        options.numprocesses, options.dist, options.loadscopereorder = 2, "loadfile", False


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    place = {f"test_{name}.py": place for place, name in enumerate(ORDER)}
    items.sort(key=lambda item: place.get(Path(item.fspath).name, len(place)))
