"""`tubelock compare`: run, table, words, figure, JSON."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape
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
from validation.fem_box import peak_memory_mb
from validation.fem_command import progress_bar
from validation.files import output_folder, prepare_json, write_json
from validation.periodic_cell import refuse_cell
from validation.pictures import between_layers, coloured_facets, interface_facets
from validation.rendering import PRESSURE_MAP, place, render, save_figure
from validation.scene import DeformableScene, SceneFile
from validation.tube_command import decided

#: Largest ratio of the answers' peaks that one colour scale is shared by.
_COMMON_SCALE = 4.0


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
    scene, decision = decided(scene, name, console)
    refuse_cell(scene, name, "compare")
    build_comparable(scene, name)
    prepare_json(json)
    folder = Path("out") / f"{name}-compare" if output is None and json is None else output
    with output_folder(folder):
        with progress_bar() as progress:
            found = compare(name, scene, explicit=explicit, progress=progress)
        print_comparison(found, console)
        peak = peak_memory_mb()
        console.print(f"peak memory {peak:.0f} MB")
        if folder is not None:
            picture = folder / "comparison.png"
            draw_comparison(found, picture)
            console.print(f"picture   {picture}")
        data = comparison_json(found) | {"peak_memory_mb": peak}
        if decision is not None:
            data["effects_decision"] = decision.as_json()
        write_json(json, data)


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
        table.add_column(escape(head), justify="left" if head == "answer" else "right")
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
    """Draw the joints of each answer: rigid beside static (and explicit).

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
    highest = [float(a.pressures[shown].max(initial=0.0)) or 1e-300 for a in found.answers]
    # One colour scale shows differences in magnitude; where they are too large for it, one each.
    common = max(highest) <= _COMMON_SCALE * min(highest)
    if common:
        highest = [max(highest)] * len(highest)
    columns = len(found.answers)
    size = (3.6 * columns + 1.2, 0.9 + 3.6 * len(rows))
    figure, axes = plt.subplots(len(rows), columns, figsize=size, squeeze=False)
    for line, (words, (facets, direction)) in enumerate(rows.items()):
        for column, answer in enumerate(found.answers):
            pressures = answer.pressures[facets]
            pressed = interface_facets(assembly, found.contacts[facets], pressures)
            draw = coloured_facets(pressed, np.arange(len(facets)), shown_blocks, highest[column])
            name = f"{answer.method}: {words}" if column == 0 else answer.method
            title = f"{name}\nmax {pressures.max(initial=0.0):.3g} MPa"
            place(axes[line, column], render(draw, direction, height=1000), title)
    scales = "" if common else "; each answer has its own colour scale"
    figure.suptitle(
        f"{found.name}: contact pressure {where}, rigid blocks and finite elements{scales}",
        fontsize=13,
        x=0.02,
        ha="left",
    )
    figure.subplots_adjust(left=0.02, right=0.98, top=0.86, bottom=0.13, wspace=0.08, hspace=0.2)
    for column in range(columns) if not common else (0,):
        first, last = (axes[-1, k].get_position() for k in ((0, -1) if common else (column,) * 2))
        width = 0.5 * (last.x1 - first.x0) if common else 0.8 * (last.x1 - first.x0)
        middle = 0.5 * (first.x0 + last.x1)
        bar = figure.add_axes((middle - 0.5 * width, 0.075, width, 0.016))
        colours = ScalarMappable(Normalize(0.0, highest[column]), PRESSURE_MAP)
        label = "contact pressure [MPa]"
        figure.colorbar(colours, cax=bar, label=label, orientation="horizontal")
    save_figure(figure, path)
