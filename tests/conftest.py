"""How the suite is run."""

import gc

import pytest


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
        options.numprocesses, options.dist = 2, "loadfile"
