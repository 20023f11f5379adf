"""`tubelock mbd` and `show` around scenes of triangulated blocks: checks, text and files."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console

from validation.build_polyhedra import build_polyhedra
from validation.files import output_folder, prepare_file, prepare_json, write_json
from validation.polyhedra import (
    PolyhedralRun,
    mechanism_motion,
    polyhedra_json,
    print_polyhedra,
    run_polyhedra,
    write_contacts,
)
from validation.scene import SceneFile
from validation.scene_polyhedra import PolyhedralScene


def write_polyhedra(run: PolyhedralRun, folder: Path) -> list[tuple[str, Path]]:
    """Write what the result shows into ``folder``; returns what each file is, and its path."""
    from validation.polyhedra_pictures import draw_polyhedra, draw_polyhedral_mechanism

    contacts, picture = folder / "contacts.vtu", folder / "contacts.png"
    write_contacts(run, contacts)
    draw_polyhedra(run, picture)
    written = [("contacts", contacts), ("picture", picture)]
    motion = mechanism_motion(run)
    if motion is not None:
        picture = folder / "mechanism.png"
        draw_polyhedral_mechanism(run, motion, picture)
        written.append(("picture", picture))
    return written


def mbd_polyhedra(
    file: SceneFile,
    scene: PolyhedralScene,
    *,
    console: Console,
    json: str | None,
    folder: Path | None,
) -> None:
    """Analyse, print and write; bad input is refused before anything is written."""
    prepare_json(json)
    run = run_polyhedra(file, scene)
    with output_folder(folder):
        print_polyhedra(run, console)
        if folder is not None:
            for words, path in write_polyhedra(run, folder):
                console.print(f"{words:9} {path}")
        write_json(json, polyhedra_json(run))


def show_polyhedra(file: SceneFile, scene: PolyhedralScene, picture: Path) -> None:
    """Draw the blocks of a scene, free and held."""
    from validation.polyhedra_pictures import draw_blocks

    assembly = build_polyhedra(scene, file.folder)
    prepare_file(picture)
    draw_blocks(assembly, picture, title=file.name)
