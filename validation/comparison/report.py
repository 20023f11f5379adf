"""A comparison as tables, words, figure and data."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from geometry.answer import Measure
from geometry.mesh import FloatArray, IntArray
from validation.comparison.answers import (
    Answer,
    Comparison,
    conclusion,
    explanations,
    explicit_errors,
    interface_force_error,
)
from validation.output.console import listing, tabled
from validation.output.pictures.assemblies import ring_panel, unrolled_panel
from validation.output.pictures.bodies import above_and_below, eye, interface_facets
from validation.output.pictures.canvas import Part
from validation.output.pictures.gallery import Panel, gallery
from validation.output.pictures.scales import PRESSURE_MAP, STRESS_MAP, Scale, scale_from_zero

#: Columns of the two tables, a line each.
_COLUMNS = """p_eff: mean pressure on the effective facets of a block, mean over blocks
p_max: largest mean pressure over a facet of a block, mean over blocks
p_max of a facet: the largest of these over all blocks
p_max at a point: largest contact pressure of deformable blocks [MPa], independent of facets
effective: share of the contact facets that carry load (participation ratio)"""
_AGREEMENT = """correlation: Pearson correlation of the facet pressures, weighted by area
overlap of effective areas: shared loaded area over the union of both
peaks located: static pressure within two facets of the peak of the other analysis, over the
  largest static pressure (mean over blocks; 100 %: the peaks coincide)
force: total contact force, relative to the static one"""
#: Name of the figure.
PICTURE = "comparison.png"


def comparison_json(found: Comparison) -> dict[str, Any]:
    """Return the comparison as plain data."""
    return {
        "scene": found.name,
        "n_contacts": len(found.contacts),
        "answers": [_plain(a) for a in found.answers],
        "agreement_with_static": {
            method: [asdict(a) for a in rows] for method, rows in found.agreement.items()
        },
        "interface_force_error": {
            method: interface_force_error(found, method) for method in found.agreement
        },
        "explicit_errors": explicit_errors(found),
        "max_displacement": {
            a.method: a.max_displacement.value for a in found.answers if a.max_displacement
        },
        "steps": [asdict(step) for step in found.steps],
        "explanations": explanations(found),
        "conclusion": conclusion(found),
    }


def _plain(answer: Answer) -> dict[str, Any]:
    """Numbers of an answer; those at a point with error and unit."""
    numbers = {k: v for k, v in vars(answer).items() if k not in ("pressures", "max_displacement")}
    at_point = answer.p_max_point
    return numbers | {"p_max_point": None if at_point is None else at_point.as_json()}


def print_comparison(found: Comparison, console: Console) -> None:
    """Print both tables and the words."""
    answers: dict[str, Callable[[Answer], str]] = {
        "answer": lambda answer: answer.method,
        "p_eff [MPa]": partial(_facet_mean, "p_eff"),
        "p_max [MPa]": partial(_facet_mean, "p_max"),
        "p_max of a facet": partial(_facet_mean, "p_max_facet"),
        "p_max at a point": lambda answer: _number(answer.p_max_point),
        "effective": lambda answer: f"{answer.effective_count_percent:.1f} %",
        "|u| max [mm]": lambda answer: _number(answer.max_displacement),
        "CPU s": lambda answer: f"{answer.cpu_seconds:.2f}",
    }
    title = f"{found.name}: contact pressures over the facets of [mesh]"
    console.print(tabled(title, found.answers, answers))
    for answer in found.answers:
        console.print(f"• {answer.method}: {answer.words}")
    console.print(_COLUMNS)
    title = "Contact pressures relative to the static analysis"
    numbers = ("correlation", "overlap of effective areas", "peaks located", "force")
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
    console.print(_AGREEMENT)
    console.print("Influence of each modelling assumption, from rigid to deformable blocks:")
    for line in explanations(found):
        console.print(f"• {line}")
    console.print(f"Conclusion: {conclusion(found)}")


def _facet_mean(name: str, answer: Answer) -> str:
    """Value and error bar; facet means of rigid blocks have four digits and no bar."""
    value, error = getattr(answer, name), answer.errors.get(name)
    return f"{value:.4g}" if error is None else _number(Measure(value, "MPa", error))


def _number(measure: Measure | None) -> str:
    """Value and error bar without the unit, which the head of the column has."""
    return "–" if measure is None else measure.value_words.removesuffix(f" {measure.unit}")


def draw_comparison(found: Comparison, path: Path) -> None:
    """Draw the joints in the static answer, and what each other answer differs by.

    Of a tube the joints of the middle layer, unrolled; of other assemblies all joints.
    """
    reference = next(a for a in found.answers if a.method == "static")
    others = [a for a in found.answers if a is not reference]
    draw = _tube_columns if found.static.is_tube else _wall_columns
    load = found.static.scene.load_words
    title = (
        f"{found.name}: {load}; contact pressure of deformable blocks (static), and differences "
        "from it; r: Pearson correlation of the facet pressures"
    )
    columns = draw(found, reference, others)
    gallery(columns, title, path, height=2.7 * max(len(column) for column in columns))


def _difference(
    reference: Answer, other: Answer, others: Sequence[Answer], rows: IntArray
) -> tuple[FloatArray, Scale]:
    """Pressures of an answer less those of the reference, and the colours of all differences."""
    changes = {a.method: a.pressures[rows] - reference.pressures[rows] for a in others}
    # Differences of the order of round-off show no pattern that means anything.
    least = 1e-6 * float(reference.pressures.max(initial=0.0))
    every = np.concatenate([np.zeros(1), *changes.values()])
    reach = max(float(np.abs(every).max()), least, 1e-300)
    change = changes[other.method]
    reached = (float(change.min(initial=0.0)), float(change.max(initial=0.0)))
    label = f"{other.method} − static [MPa]"
    return change, Scale(label, STRESS_MAP, -reach, reach, reached, diverging=True)


def _tube_columns(
    found: Comparison, reference: Answer, others: Sequence[Answer]
) -> list[list[Panel]]:
    """Pressures of the middle layer's joints, seen and unrolled; differences, unrolled."""
    assembly = found.rigid.assembly
    facets = interface_facets(assembly, found.contacts, reference.pressures)
    layer = assembly.n_layers // 2 + 1
    joints = {"top": layer, "bottom": layer - 1}
    shown = np.concatenate([facets.between(lower) for lower in joints.values()])
    label = "contact pressure [MPa]"
    scale = scale_from_zero(label, PRESSURE_MAP, [facets.pressures[shown]], nothing="open joint")
    columns = [[ring_panel(facets, k, side, scale, layer) for side, k in joints.items()]]
    for side, lower in joints.items():
        flat = unrolled_panel(facets, lower, side, scale, title=f"{side} faces: static")
        column = [replace(flat, scale=scale)]
        for other in others:
            change, colours = _difference(reference, other, others, shown)
            pressed = interface_facets(assembly, found.contacts[shown], change)
            agreed = {row.faces: row.correlation for row in found.agreement[other.method]}
            words = f"{side} faces: {other.method} − static, r = {agreed[side]:.3f}"
            panel = unrolled_panel(pressed, lower, side, colours, title=words)
            column.append(replace(panel, scale=colours))
        columns.append(column)
    return columns


def _wall_columns(
    found: Comparison, reference: Answer, others: Sequence[Answer]
) -> list[list[Panel]]:
    """Pressures of all joints, and differences, from above and from below."""
    assembly = found.rigid.assembly
    everything, blocks = np.arange(len(found.contacts)), range(assembly.n_blocks)

    def column(name: str, values: FloatArray, scale: Scale) -> list[Panel]:
        facets = interface_facets(assembly, found.contacts, values)
        parts: list[Part] = [facets.surface(everything, scale), facets.outlines(blocks)]
        above, below = above_and_below(parts, eye(assembly), title=name, scale=scale)
        return [replace(above, scale=None), below]

    label, found_pressures = "contact pressure [MPa]", [reference.pressures]
    pressed = scale_from_zero(label, PRESSURE_MAP, found_pressures, nothing="open joint")
    columns = [column("static", reference.pressures, pressed)]
    for other in others:
        change, colours = _difference(reference, other, others, everything)
        columns.append(column(other.method, change, colours))
    return columns
