"""The command behind `make demo`: the main job from start to end, in about two minutes."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rich.console import Console

#: The reduced-layer case: two layers, 960 elements per block.
REDUCED = ("assembly.layers=2", "mesh.around=24", "mesh.radial=4", "mesh.axial=10")


def demo(
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for the pictures.")
    ] = Path("out/demo"),
) -> None:
    """Run the main job: the paper's tables beside ours, and pictures of the tubes."""
    from validation.output.console import text_console
    from validation.output.files import prepare_folder

    console = text_console()
    prepare_folder(output)
    written = [*_tables(output, console), *_rigid(output), *_deformable(output, console)]
    written += _decks(output)
    console.print("Written:")
    for path in written:
        console.print(f"  {path}")


def _tables(folder: Path, console: Console) -> Iterator[Path]:
    """Reproduce the paper's tables."""
    from validation.output.files import write_json
    from validation.output.provenance import Provenance, stamped
    from validation.paper.tables import compute_tables, print_tables, tables_json

    console.print("The paper's tables next to ours (rigid blocks, frictionless contact):")
    found = compute_tables(console)
    print_tables(found, console)
    write_json(str(folder / "tables.json"), stamped(tables_json(found), Provenance()))
    yield folder / "tables.json"


def _rigid(folder: Path) -> Iterator[Path]:
    """Draw three tubes of rigid blocks, and write their contact pressures."""
    from validation.output.pictures.assemblies import draw_assembly, draw_pressures
    from validation.output.rigid.assembly import write_pressures
    from validation.run.rigid.answer import run_rigid
    from validation.scene.read import load_scene

    for name in ("tsb1-pipe", "tsb2-pipe", "tsb1-pillar"):
        run = run_rigid(load_scene(name))
        scene, pressures, vtu = (
            folder / f"{name}-{what}" for what in ("scene.png", "pressures.png", "pressures.vtu")
        )
        title = f"{name}: {run.scene.load_words}"
        draw_assembly(run.assembly, run.load, scene, title=title)
        draw_pressures(run, pressures)
        write_pressures(run, vtu)
        yield from (scene, pressures, vtu)


def _deformable(folder: Path, console: Console) -> Iterator[Path]:
    """Solve the reduced-layer case by statics and explicit dynamics, and compare."""
    from validation.compare.answers import compare
    from validation.compare.report import draw_comparison, print_comparison
    from validation.output.pictures.tubes import draw_sections, draw_stresses
    from validation.scene.read import load_scene, require_deformable

    console.print(
        "The same tube with two layers of deformable blocks, static and explicit, against the "
        "rigid answer (the first run compiles the kernels, about half a minute):"
    )
    scene = require_deformable(load_scene("tsb1-pipe", REDUCED), "demo")
    found = compare("tsb1-pipe", scene)
    print_comparison(found, console)
    names = ("compare-rigid-fem.png", "fem-stresses.png", "fem-sections.png")
    comparison, stresses, sections = (folder / name for name in names)
    draw_comparison(found, comparison)
    draw_stresses(found.static, stresses)
    draw_sections(found.static, sections)
    yield from (comparison, stresses, sections)


def _decks(folder: Path) -> Iterator[Path]:
    """Write the reduced-layer case as input decks for Abaqus and CalculiX."""
    from fem.decks.statement import Flavour
    from validation.output.decks import export_deck
    from validation.scene.read import load_scene

    file = load_scene("tsb1-pipe", REDUCED)
    names = {Flavour.GENERAL: "tsb1-pipe-abaqus.inp", Flavour.CALCULIX: "tsb1-pipe-calculix.inp"}
    for kind, name in names.items():
        yield export_deck(file, kind, folder / name).path
