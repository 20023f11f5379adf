"""`make demo`: the main job from start to end, in about two minutes."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console

from fem.decks.statement import Flavour
from validation.compare import compare
from validation.compare_command import draw_comparison, print_comparison
from validation.deck_command import export_deck
from validation.files import prepare_folder, write_json
from validation.paper.tables import compute_tables, print_tables, tables_json
from validation.pictures import draw_assembly, draw_pressures
from validation.rigid import run_rigid, write_pressures
from validation.scene import DeformableScene, load_scene
from validation.tube_pictures import draw_sections, draw_stresses

#: The reduced-layer case of the demo: two layers, 960 elements per block.
REDUCED = ("assembly.layers=2", "mesh.around=24", "mesh.radial=4", "mesh.axial=10")


def run_demo(folder: Path, console: Console) -> None:
    """Reproduce the tables, draw the tubes, compare rigid with deformable, say where it all is."""
    prepare_folder(folder)
    console.print("The paper's tables next to ours (rigid blocks, frictionless contact):")
    rows = compute_tables(console)
    print_tables(rows, console)
    write_json(str(folder / "tables.json"), tables_json(rows))
    written = [folder / "tables.json"]
    for name in ("tsb1-pipe", "tsb2-pipe", "tsb1-pillar"):
        run = run_rigid(load_scene(name))
        scene, pressures = folder / f"{name}-scene.png", folder / f"{name}-pressures.png"
        vtu = folder / f"{name}-pressures.vtu"
        draw_assembly(run.assembly, run.load, scene, title=name)
        draw_pressures(run, pressures)
        write_pressures(run, vtu)
        written += [scene, pressures, vtu]
    written += _deformable(folder, console)
    written += _decks(folder)
    console.print("Written:")
    for path in written:
        console.print(f"  {path}")


def _deformable(folder: Path, console: Console) -> list[Path]:
    """Solve the reduced-layer case by statics and explicit dynamics, and compare."""
    file = load_scene("tsb1-pipe", REDUCED)
    scene = file.scene
    assert isinstance(scene, DeformableScene)
    console.print(
        "The same tube with two layers of deformable blocks, static and explicit, against the "
        "rigid answer (the first run compiles the kernels, about half a minute):"
    )
    found = compare("tsb1-pipe", scene)
    print_comparison(found, console)
    names = ("compare-rigid-fem.png", "fem-stresses.png", "fem-sections.png")
    paths = [folder / name for name in names]
    draw_comparison(found, paths[0])
    draw_stresses(found.static, paths[1])
    draw_sections(found.static, paths[2])
    return paths


def _decks(folder: Path) -> list[Path]:
    """Write the reduced-layer case as input decks for Abaqus and CalculiX."""
    file = load_scene("tsb1-pipe", REDUCED)
    names = {Flavour.GENERAL: "tsb1-pipe-abaqus.inp", Flavour.CALCULIX: "tsb1-pipe-calculix.inp"}
    return [export_deck(file, kind, folder / name).path for kind, name in names.items()]
