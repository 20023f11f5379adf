"""`tubelock cell`: what the periodic cell of a tube answers, and its error against the tube."""

from __future__ import annotations

from rich.console import Console

from validation.cell_error import CellError, cell_error, cell_table
from validation.errors import InputError
from validation.files import prepare_json, write_json
from validation.scene import DeformableScene, SceneFile
from validation.tube_fem import fem_section


def run_cell(file: SceneFile, *, json: str | None, console: Console) -> CellError:
    """Solve cell and tube on the mesh of the scene, print and write them.

    Raises
    ------
    InputError
        For a scene whose layers do not repeat.
    """
    if not isinstance(file.scene, DeformableScene):
        raise InputError(f"{file.name}: is no tube; expected one such as tsb1-pipe")
    fem_section(file.scene, file.name)
    prepare_json(json)
    with console.status(f"{file.name}: periodic cell and whole tube"):
        found = cell_error(file.scene, file.name)
    console.print(cell_table(file.name, found))
    write_json(json, found.as_json())
    return found
