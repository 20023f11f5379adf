"""`tubelock compare`: run, table, words, figure, JSON."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from validation.block_pictures import eye
from validation.compare import (
    Comparison,
    build_comparable,
    compare,
    explanations,
    explicit_errors,
    interface_force_error,
)
from validation.errors import InputError
from validation.fem_command import progress_bar
from validation.files import output_folder, prepare_json, write_json
from validation.pictures import between_layers, coloured_facets, interface_facets
from validation.rendering import PRESSURE_MAP, place, render, save_figure
from validation.scene import DeformableScene, SceneFile


def run_compare(
    file: SceneFile, *, json: str | None, output: Path | None, explicit: bool, console: Console
) -> None:
    """Compare the answers to a scene.

    Raises
    ------
    InputError
        For a scene without deformable blocks.
    """
    scene, name = file.scene, file.name
    if not isinstance(scene, DeformableScene):
        raise InputError(
            f"{name}: block.type {scene.block.type!r} cannot be compared; expected blocks with "
            "hexahedra, such as tsb1-pipe"
        )
    build_comparable(scene, name)
    prepare_json(json)
    folder = Path("out") / f"{name}-compare" if output is None and json is None else output
    with output_folder(folder):
        with progress_bar() as progress:
            found = compare(name, scene, explicit=explicit, progress=progress)
        print_comparison(found, console)
        if folder is not None:
            picture = folder / "comparison.png"
            draw_comparison(found, picture)
            console.print(f"picture   {picture}")
        write_json(json, comparison_json(found))


def comparison_json(found: Comparison) -> dict[str, Any]:
    """Return the comparison as plain data."""
    return {
        "scene": found.name,
        "n_contacts": len(found.contacts),
        "answers": [
            {key: value for key, value in asdict(a).items() if key != "pressures"}
            for a in found.answers
        ],
        "agreement_with_static": {
            method: [asdict(a) for a in rows] for method, rows in found.agreement.items()
        },
        "interface_force_error": {
            method: interface_force_error(found, method) for method in found.agreement
        },
        "explicit_errors": explicit_errors(found),
        "max_displacement": {
            str(run.method): run.largest_displacement
            for run in (found.static, found.explicit)
            if run is not None
        },
        "steps": [asdict(step) for step in found.steps],
        "explanations": explanations(found),
    }


def print_comparison(found: Comparison, console: Console) -> None:
    """Print both tables and the words."""
    table = Table(title=f"{found.name}: the same mesh, three ways", title_justify="left")
    heads = ("answer", "p_eff [MPa]", "p_max [MPa]", "effective elements", "|u| max [mm]", "CPU s")
    for head in heads:
        table.add_column(head, justify="left" if head == "answer" else "right")
    moved = {
        str(run.method): f"{run.largest_displacement:.5g}"
        for run in (found.static, found.explicit)
        if run is not None
    }
    for answer in found.answers:
        table.add_row(
            answer.method,
            f"{answer.p_eff:.4g}",
            f"{answer.p_max:.4g}",
            f"{answer.effective_count_percent:.1f} %",
            moved.get(answer.method, "–"),
            f"{answer.cpu_seconds:.2f}",
        )
    console.print(table)
    table = Table(title="Contact pressures against the static answer", title_justify="left")
    heads = ("answer", "faces", "correlation", "overlap of effective areas", "peaks found", "force")
    for head in heads:
        table.add_column(head, justify="left" if head in ("answer", "faces") else "right")
    layer = found.static.deformable.assembly.n_layers // 2 + 1
    joints = "whole tube" if found.static.is_tube else "all joints"
    for method, rows in found.agreement.items():
        for row in rows:
            words = joints if row.faces == "all" else f"layer {layer} {row.faces}"
            table.add_row(
                method,
                words,
                f"{row.correlation:.3f}",
                f"{100 * row.overlap:.0f} %",
                f"{100 * row.peaks_found:.0f} %",
                f"{100 * (row.force_ratio - 1):+.1f} %",
            )
    console.print(table)
    console.print("From rigid blocks to deformable ones, one assumption at a time:")
    for line in explanations(found):
        console.print(f"• {line}")


def draw_comparison(found: Comparison, path: Path) -> None:
    """Draw the joints of each answer on one scale: rigid beside static (and explicit).

    Of a tube top and bottom faces of the middle layer, of other assemblies all joints.
    """
    import matplotlib.pyplot as plt
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    assembly = found.static.deformable.assembly
    layer = assembly.n_layers // 2 + 1
    if found.static.is_tube:
        shown_blocks = np.flatnonzero(assembly.layer == layer)
        above, below = (between_layers(assembly, found.contacts, k) for k in (layer, layer - 1))
        rows = {
            "top faces, from above": (above, (1.2, -0.8, 1.6)),
            "bottom faces, from below": (below, (1.2, -0.8, -1.6)),
        }
        where = f"in layer {layer}"
    else:
        shown_blocks, everything = np.arange(assembly.n_blocks), np.arange(len(found.contacts))
        rows = {"all joints": (everything, eye(found.static))}
        where = "in all joints"
    shown = np.concatenate([r for r, _ in rows.values()])
    # One colour scale: the largest of any answer, so that differences in magnitude are seen too.
    highest = max(float(a.pressures[shown].max(initial=0.0)) for a in found.answers) or 1e-300
    columns = len(found.answers)
    height = 0.4 + 3.6 * len(rows)
    size = (3.6 * columns + 1.2, height)
    figure, axes = plt.subplots(len(rows), columns, figsize=size, squeeze=False)
    for line, (words, (facets, direction)) in enumerate(rows.items()):
        for column, answer in enumerate(found.answers):
            pressed = interface_facets(assembly, found.contacts[facets], answer.pressures[facets])
            draw = coloured_facets(pressed, np.arange(len(facets)), shown_blocks, highest)
            title = f"{answer.method}: {words}" if column == 0 else answer.method
            place(axes[line, column], render(draw, direction, height=1000), title)
    figure.suptitle(
        f"{found.name}: contact pressure {where}, rigid blocks and finite elements",
        fontsize=13,
        x=0.02,
        ha="left",
    )
    figure.subplots_adjust(left=0.02, right=0.9, top=0.88, bottom=0.03, wspace=0.08, hspace=0.18)
    bar = figure.add_axes((0.925, 0.15, 0.012, 0.65))
    colours = ScalarMappable(Normalize(0.0, highest), PRESSURE_MAP)
    figure.colorbar(colours, cax=bar, label="contact pressure [MPa]")
    save_figure(figure, path)
