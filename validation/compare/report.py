"""A comparison as tables, words, figure and data."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from geometry.mesh import FloatArray, IntArray
from validation.compare.answers import (
    Answer,
    Comparison,
    explanations,
    explicit_errors,
    interface_force_error,
)
from validation.output.console import listing, tabled
from validation.output.pictures.assemblies import ring_panel, unrolled_panel
from validation.output.pictures.bodies import interface_facets
from validation.output.pictures.canvas import Part, View
from validation.output.pictures.gallery import (
    PRESSURE_MAP,
    STRESS_MAP,
    Panel,
    Scale,
    gallery,
    scale_from_zero,
)
from validation.output.pictures.tubes import eye

#: Name of the figure.
PICTURE = "comparison.png"


def _moved(found: Comparison) -> dict[str, float]:
    """Largest displacement of deformable blocks by method [mm]."""
    solved = (run for run in (found.static, found.explicit) if run is not None)
    return {str(run.method): run.largest_displacement for run in solved}


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
        "max_displacement": _moved(found),
        "steps": [asdict(step) for step in found.steps],
        "explanations": explanations(found),
    }


def print_comparison(found: Comparison, console: Console) -> None:
    """Print both tables and the words."""
    moved = {method: f"{u:.5g}" for method, u in _moved(found).items()}
    answers: dict[str, Callable[[Answer], str]] = {
        "answer": lambda answer: answer.method,
        "p_eff [MPa]": lambda answer: f"{answer.p_eff:.4g}",
        "p_max [MPa]": lambda answer: f"{answer.p_max:.4g}",
        "effective elements": lambda answer: f"{answer.effective_count_percent:.1f} %",
        "|u| max [mm]": lambda answer: moved.get(answer.method, "–"),
        "CPU s": lambda answer: f"{answer.cpu_seconds:.2f}",
    }
    console.print(tabled(f"{found.name}: the same mesh, three ways", found.answers, answers))
    title = "Contact pressures against the static answer"
    numbers = ("correlation", "overlap of effective areas", "peaks found", "force")
    table = listing(title, "answer", "faces", numbers=numbers)
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
    """Draw the joints in the static answer, and what each other answer differs by.

    Of a tube the joints of the middle layer, unrolled; of other assemblies all joints.
    """
    reference = next(a for a in found.answers if a.method == "static")
    others = [a for a in found.answers if a is not reference]
    draw = _tube_columns if found.static.is_tube else _wall_columns
    load = found.static.scene.load_words
    title = (
        f"{found.name}: {load}; contact pressure of deformable blocks (static), and what the other "
        "answers differ by"
    )
    columns = draw(found, reference, others)
    gallery(columns, title, path, height=2.7 * max(len(column) for column in columns))


def _difference(reference: Answer, other: Answer, rows: IntArray) -> tuple[FloatArray, Scale]:
    """Pressures of an answer less those of the reference, and their colours."""
    change = other.pressures[rows] - reference.pressures[rows]
    # Differences of the order of round-off show no pattern that means anything.
    least = 1e-6 * float(reference.pressures.max(initial=0.0))
    reach = max(float(np.abs(change).max(initial=0.0)), least, 1e-300)
    reached = (float(change.min(initial=0.0)), float(change.max(initial=0.0)))
    label = f"{other.method} − static [MPa]"
    return change, Scale(label, STRESS_MAP, -reach, reach, reached)


def _tube_columns(
    found: Comparison, reference: Answer, others: Sequence[Answer]
) -> list[list[Panel]]:
    """Pressures of the middle layer's joints, seen and unrolled; differences, unrolled."""
    assembly = found.rigid.assembly
    facets = interface_facets(assembly, found.contacts, reference.pressures)
    layer = assembly.n_layers // 2 + 1
    joints = {"top": layer, "bottom": layer - 1}
    shown = np.concatenate([facets.between(lower) for lower in joints.values()])
    scale = scale_from_zero("contact pressure [MPa]", PRESSURE_MAP, [facets.pressures[shown]])
    columns = [[ring_panel(facets, k, side, scale, layer) for side, k in joints.items()]]
    for side, lower in joints.items():
        flat = unrolled_panel(facets, lower, side, scale, title=f"{side} faces: static")
        column = [replace(flat, scale=scale)]
        for other in others:
            change, colours = _difference(reference, other, shown)
            pressed = interface_facets(assembly, found.contacts[shown], change)
            agreed = {row.faces: row.correlation for row in found.agreement[other.method]}
            words = f"{side} faces: {other.method} − static (correlation {agreed[side]:.3f})"
            panel = unrolled_panel(pressed, lower, side, colours, title=words)
            column.append(replace(panel, scale=colours))
        columns.append(column)
    return columns


def _wall_columns(
    found: Comparison, reference: Answer, others: Sequence[Answer]
) -> list[list[Panel]]:
    """Pressures of all joints, and differences, from above and from below."""
    assembly = found.rigid.assembly
    everything, (x, y, z) = np.arange(len(found.contacts)), eye(assembly)
    blocks = range(assembly.n_blocks)

    def column(name: str, values: FloatArray, scale: Scale) -> list[Panel]:
        facets = interface_facets(assembly, found.contacts, values)
        parts: list[Part] = [facets.surface(everything, scale), facets.outlines(blocks)]
        return [
            Panel(f"{name}, from above", View(parts, (x, y, z))),
            Panel("from below", View(parts, (x, y, -z)), scale=scale),
        ]

    pressed = scale_from_zero("contact pressure [MPa]", PRESSURE_MAP, [reference.pressures])
    columns = [column("static", reference.pressures, pressed)]
    for other in others:
        change, colours = _difference(reference, other, everything)
        columns.append(column(other.method, change, colours))
    return columns
