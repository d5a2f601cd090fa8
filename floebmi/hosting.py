"""What a host writes to start the component: a scene, or one table that names a scene and how to see it."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from floebmi.errors import InputError
from floebmi.files import check_target
from floebmi.scene import SUFFIXES, Scene, find_scene, read_scene
from floebmi.tables import Table, parse, read_text, validate

MOST_FLOES = 1_000_000_000  # more would not fit into memory


class BmiTable(Table):
    """How a host sees a scene."""

    scene: str = Field(description="name of a packaged scene, or a path relative to this file")
    set: list[str] = Field([], description="changes of the scene: ['table.key=value']")
    cells: Literal["nodes", "faces"] = Field(
        "nodes",
        description="cells of a rectilinear grid: nodes of it, or faces of an unstructured one",
    )
    floe_capacity: Annotated[int, Field(ge=0, le=MOST_FLOES)] = Field(
        0, description="room for single floes, fixed for the run; 0: no floe-level variables"
    )
    restart: str | None = Field(
        None, description="file that save_state wrote, relative to this file"
    )
    checkpoint: str | None = Field(
        None, description="file, relative to this file, that holds the state after each update"
    )


class BmiFile(Table):
    """A configuration file that is not a scene itself."""

    bmi: BmiTable


def read_config(config_file: str) -> tuple[Scene, BmiTable]:
    """The scene of a configuration file, and how a host sees it.

    Raises
    ------
    InputError
        one line with file, table, key and value.
    """
    path = find_scene(config_file)
    text = read_text(path) if path.suffix in SUFFIXES else ""
    tables = parse(text, str(path), yaml=SUFFIXES.get(path.suffix, False))
    if "bmi" not in tables:
        return read_scene(config_file), BmiTable(scene=str(path))
    table = validate(BmiFile, tables, str(path)).bmi
    named = path.parent / table.scene
    scene = read_scene(named if named.exists() else table.scene, table.set)
    files = {"restart": table.restart, "checkpoint": table.checkpoint}
    beside = {key: str(path.parent / name) for key, name in files.items() if name is not None}
    if table.checkpoint is not None:
        try:
            check_target(Path(beside["checkpoint"]), overwrite=True)
        except InputError as error:
            raise InputError(f"{path}: [bmi] checkpoint = {error}") from None
    return scene, table.model_copy(update=beside)
