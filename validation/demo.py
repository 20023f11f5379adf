"""`make demo`: the main job from start to end, in about a minute."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console

from validation.files import prepare_folder, write_json
from validation.paper.tables import compute_tables, print_tables, tables_json
from validation.pictures import draw_assembly, draw_pressures
from validation.rigid import run_rigid, write_pressures
from validation.scene import load_scene


def run_demo(folder: Path, console: Console) -> None:
    """Reproduce the tables, draw the tubes, and say where everything is."""
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
    console.print("Written:")
    for path in written:
        console.print(f"  {path}")
