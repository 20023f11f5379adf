"""The command behind `make demo`: a complete example in about two minutes."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from validation.output.outputs import Outputs

#: The reduced-layer case: two layers, 960 elements per block.
REDUCED = ("assembly.layers=2", "mesh.around=24", "mesh.radial=4", "mesh.axial=10")


def demo(
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for the pictures.")
    ] = Path("out/demo"),
) -> None:
    """Run the example: the paper's tables, the tubes, input decks."""
    from validation.output.outputs import Outputs

    with Outputs(folder=output, names=("*.json", "*.png", "*.vtu", "*.inp")) as outputs:
        _tables(outputs)
        _rigid(outputs)
        _deformable(outputs)
        _decks(outputs)


def _tables(outputs: Outputs) -> None:
    """Reproduce the paper's tables."""
    from validation.output.files import write_json
    from validation.output.provenance import stamped
    from validation.paper.tables import compute_tables, print_tables, tables_json

    outputs.console.print("The paper's tables and tubelock (rigid blocks, frictionless contact):")
    found = compute_tables(outputs.console)
    print_tables(found, outputs.console)
    data = stamped(tables_json(found), outputs.origin)
    outputs.write("tables", "tables.json", lambda path: write_json(str(path), data))


def _rigid(outputs: Outputs) -> None:
    """Draw three tubes of rigid blocks, and write their contact pressures."""
    from validation.output.answer_files import write_contacts
    from validation.output.pictures.assemblies import draw_assembly, draw_pressures
    from validation.run.rigid.answer import run_rigid
    from validation.scene.read import load_scene

    for name in ("tsb1-pipe", "tsb2-pipe", "tsb1-pillar"):
        run = run_rigid(load_scene(name))
        draw = partial(draw_assembly, run.assembly, run.load)
        title = f"{name}: {run.scene.load_words}"
        outputs.write("picture", f"{name}-scene.png", partial(draw, title=title))
        outputs.write("picture", f"{name}-pressures.png", partial(draw_pressures, run))
        outputs.write("pressures", f"{name}-pressures.vtu", partial(write_contacts, run.answer))


def _deformable(outputs: Outputs) -> None:
    """Solve the reduced-layer case by statics and compare it with rigid blocks."""
    from validation.calls import compare
    from validation.comparison.report import print_comparison
    from validation.comparison.scene import compared_runs
    from validation.output.pictures.tubes import draw_sections, draw_stresses
    from validation.scene.read import load_scene, require_deformable

    outputs.console.print(
        "The same tube with two layers, rigid blocks and deformable ones (static, refined until "
        "the error bars are small; about half a minute):"
    )
    scene = require_deformable(load_scene("tsb1-pipe", REDUCED), "demo")
    rigid, (static,) = compared_runs("tsb1-pipe", scene)
    found = compare(*(run.answer for run in rigid), static.answer)
    print_comparison(found, outputs.console)
    outputs.write("picture", "compare-rigid-fem.png", found.draw)
    outputs.write("picture", "fem-stresses.png", partial(draw_stresses, static))
    outputs.write("picture", "fem-sections.png", partial(draw_sections, static))


def _decks(outputs: Outputs) -> None:
    """Write the reduced-layer case as input decks for Abaqus and CalculiX."""
    from fem.decks.statement import Flavour
    from validation.output.decks import export_deck
    from validation.scene.read import load_scene

    file = load_scene("tsb1-pipe", REDUCED)
    names = {Flavour.GENERAL: "tsb1-pipe-abaqus.inp", Flavour.CALCULIX: "tsb1-pipe-calculix.inp"}
    for kind, name in names.items():
        outputs.write("deck", name, partial(export_deck, file, kind))
