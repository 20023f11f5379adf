"""How blocks are drawn, and rigid answers asked for and shown, whatever the blocks are made of."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from validation.scene.polyhedra import PolyhedralScene
from validation.scene.read import SceneFile

if TYPE_CHECKING:
    from rich.console import Console

    from validation.output.outputs import Outputs
    from validation.run.rigid.answer import RigidAnswer


@dataclass(frozen=True)
class RigidOutput:
    """What `tubelock mbd` does with one kind of blocks."""

    files: tuple[str, ...]
    """Names of the files that may be written."""
    run: Callable[[SceneFile, Console], RigidAnswer]
    """Build and analyse; the console tells of what takes long."""
    tell: Callable[[Any, Console], None]
    """Print the answer."""
    write: Callable[[Any, Outputs], None]
    """Write its files."""


def rigid_output(file: SceneFile) -> RigidOutput:
    """Find what asks and shows the answer; what only other blocks need is not loaded."""
    if isinstance(file.scene, PolyhedralScene):
        return _of_triangles(file.scene)
    from validation.output.rigid import assembly
    from validation.run.rigid.answer import run_rigid

    return RigidOutput(
        assembly.FILES, lambda file, _: run_rigid(file), assembly.print_rigid, assembly.write_rigid
    )


def _of_triangles(scene: PolyhedralScene) -> RigidOutput:
    from validation.output.console import status, told_of_compilation
    from validation.output.rigid import polyhedra
    from validation.run.rigid.polyhedra import run_polyhedra

    def run(file: SceneFile, console: Console) -> RigidAnswer:
        words = f"{file.name}: reads the blocks and finds where they touch"
        with contextlib.ExitStack() as stack:
            stack.enter_context(status(console, words))
            stack.enter_context(told_of_compilation())
            return run_polyhedra(file, scene)

    return RigidOutput(polyhedra.FILES, run, polyhedra.print_polyhedra, polyhedra.write_polyhedra)


def draw_scene(file: SceneFile, path: Path) -> None:
    """Draw the blocks before any answer, with load and supports where they are of the scene."""
    title = f"{file.name}: {file.scene.load_words}"
    if isinstance(file.scene, PolyhedralScene):
        from validation.build.polyhedra import build_polyhedra
        from validation.output.pictures.polyhedra import draw_blocks

        draw_blocks(build_polyhedra(file.scene, file.folder), path, title=title)
        return
    from validation.build.blocks import build_scene
    from validation.output.pictures.assemblies import draw_assembly

    built = build_scene(file, command="show")
    draw_assembly(built.assembly, built.load, path, title=title)
