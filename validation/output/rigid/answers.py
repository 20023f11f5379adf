"""How blocks are drawn, and rigid answers asked for and shown, whatever the blocks are made of."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console

from validation.output.outputs import Outputs
from validation.run.rigid.answer import RigidAnswer
from validation.run.words import load_words
from validation.scene.polyhedra import PolyhedralScene
from validation.scene.read import SceneFile


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
    draw: Callable[[SceneFile, Path], None]
    """Draw the blocks before any answer, with load and supports where they are of the scene."""


def rigid_output(file: SceneFile) -> RigidOutput:
    """Find what asks and shows the answer; what only other blocks need is not loaded."""
    if isinstance(file.scene, PolyhedralScene):
        return _of_triangles(file.scene)
    from validation.output.rigid import assembly
    from validation.run.rigid.assembly import build_scene, run_rigid

    def draw(file: SceneFile, path: Path) -> None:
        from validation.output.pictures.assemblies import draw_assembly

        built = build_scene(file, command="show")
        draw_assembly(built.assembly, built.load, path, title=_title(file))

    return RigidOutput(
        assembly.FILES,
        lambda file, _: run_rigid(file),
        assembly.print_rigid,
        assembly.write_rigid,
        draw,
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

    def draw(file: SceneFile, path: Path) -> None:
        from validation.build.polyhedra import build_polyhedra
        from validation.output.pictures.polyhedra import draw_blocks

        draw_blocks(build_polyhedra(scene, file.folder), path, title=_title(file))

    return RigidOutput(
        polyhedra.FILES, run, polyhedra.print_polyhedra, polyhedra.write_polyhedra, draw
    )


def _title(file: SceneFile) -> str:
    return f"{file.name}: {load_words(file.scene)}"
