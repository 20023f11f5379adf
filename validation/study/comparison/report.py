"""A comparison as tables, words and figure."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console, RenderableType

from geometry.answer import Answer, Measure
from geometry.mesh import FloatArray, IntArray
from validation.errors import InputError
from validation.output.console import Printed, tabled
from validation.output.pictures.assemblies import ring_panels, unrolled_panel
from validation.output.pictures.bodies import PressedFacets, above_and_below, eye
from validation.output.pictures.gallery import Panel, gallery, save_figure
from validation.output.pictures.scales import DIFFERENCE_MAP, PRESSURE_MAP, Scale, scale_from_zero
from validation.study.comparison.answers import ComparedAnswers, shared_facets

#: Columns of the two tables, a line each.
_COLUMNS = """p_max at a point: largest contact pressure of deformable blocks [MPa]; needs no facets
p_max of a facet: largest mean pressure over a facet of all blocks
p_max: largest mean pressure over a facet of a block, mean over blocks
p_eff: mean pressure on the effective facets of a block, mean over blocks
effective: participation ratio of the facet pressures, (Σ p)² / Σ p² over their number: the facets
  that would carry the load if all of them pressed alike"""
_AGREEMENT = """correlation: Pearson correlation of the facet pressures, weighted by area
overlap of loaded areas: shared loaded area over the union of both
peaks located: static pressure within two facets of the peak of the other analysis, over the
  largest static pressure (mean over blocks; 100 %: the peaks coincide)
force: total contact force, relative to the static one"""
#: Names of the figure, the data and the printed text.
PICTURE, DATA, TEXT = "comparison.png", "comparison.json", "comparison.txt"
FILES = (PICTURE, DATA, TEXT)


@dataclass(frozen=True, repr=False)
class Comparison(ComparedAnswers, Printed):
    """Answers to one problem; the repr is its tables and its conclusion."""

    def draw(self, path: str | Path) -> None:
        """Draw the joints in the reference and how each other answer differs, as PNG."""
        _draw(self, Path(path))

    def print(self, console: Console) -> None:
        """Print both tables and the words."""
        for part in _parts(self):
            console.print(part)


def compare_answers(answers: Sequence[Answer]) -> Comparison:
    """Compare answers to one problem on the contact facets that they share."""
    return Comparison(tuple(answers), shared_facets(answers))


def _parts(compared: ComparedAnswers) -> Iterator[RenderableType]:
    """Tables and lines, one after the other."""

    def column(name: str) -> Callable[[int], str]:
        return lambda k: _number(compared.answers[k].measures.get(name))

    columns: dict[str, Callable[[int], str]] = {
        "answer": lambda k: compared.names[k],
        "p_max at a point": column("p_max_point"),
        "p_max of a facet": column("p_max_facet"),
        "|u| max [mm]": column("max_displacement"),
        "p_max [MPa]": column("p_max"),
        "p_eff [MPa]": column("p_eff"),
        "effective": lambda k: (
            f"{compared.answers[k].report['contact']['effective_count_percent']:.1f} %"
        ),
        "CPU s": lambda k: f"{_seconds(compared.answers[k].report['cpu_seconds']):.2f}",
    }
    first = compared.answers[0]  # a problem without a scene has the name of its blocks
    scene = first.report.get("scene", first.title.partition(":")[0])
    load = f"{first.report['load']}; " if "load" in first.report else ""
    title = f"{scene}: {load}{compared.friction_words}contact pressures over the facets of [mesh]"
    yield tabled(title, range(len(compared.answers)), columns)
    for name, words in zip(compared.names, compared.words, strict=True):
        yield f"• {name}: {words}"
    assumed = {"; ".join(a.report["assumptions"]) for a in compared.answers if a.method != "rigid"}
    yield from (f"• deformable blocks: {words}" for words in sorted(assumed))
    yield _COLUMNS
    title = f"Contact pressures relative to the {compared.names[compared.reference]} analysis"
    rows = [
        {"answer": name, **row} for name, of_faces in compared.agreement.items() for row in of_faces
    ]
    agreements: dict[str, str | Callable[[dict[str, Any]], str]] = {
        "answer": "{answer}",
        "faces": lambda row: _faces_words(compared, row["faces"]),
        "correlation": "{correlation:.3f}",
        "overlap of loaded areas": lambda row: f"{100 * row['overlap']:.0f} %",
        "peaks located": lambda row: f"{100 * row['peaks_found']:.0f} %",
        "force": lambda row: f"{100 * (row['force_ratio'] - 1):+.1f} %",
    }
    yield tabled(title, rows, agreements, words=2)
    yield _AGREEMENT
    if compared.steps:
        yield (
            "Influence of each modelling assumption, from rigid to deformable blocks (one mesh, "
            "without error bars):"
        )
    yield from (f"• {line}" for line in compared.explanations)
    yield f"Conclusion: {compared.conclusion}"


def _faces_words(compared: ComparedAnswers, faces: str) -> str:
    if faces == "all":
        return "whole tube" if compared.is_tube else "all joints"
    return f"layer {compared.layer} {faces}"


def _seconds(stages: dict[str, float]) -> float:
    """CPU time from the built problem to the pressures [s]."""
    return next(stages[name] for name in ("solve", "total", "loop") if name in stages)


def _number(measure: Measure | None) -> str:
    """Value and error bar without the unit, which the head of the column has."""
    if measure is None:
        return "–"
    if measure.error is None and not measure.remark and measure.resolved:
        return f"{measure.value:.4g}"
    return measure.value_words.removesuffix(f" {measure.unit}")


def _draw(compared: ComparedAnswers, path: Path) -> None:
    """Draw a comparison.

    Of a tube the joints of the middle layer, unrolled; of other assemblies all joints.
    """
    if compared.static.problem is None:
        raise InputError(
            f"{compared.static.title}: was pickled or read and does not hold its blocks; expected "
            "an answer as its solver returns it"
        )
    draw = _tube_columns if compared.is_tube else _wall_columns
    title = (
        f"{compared.static.title}; contact pressure ({compared.names[compared.reference]}), and "
        "differences from it; r: Pearson correlation of the facet pressures"
    )
    others = [k for k in range(len(compared.names)) if k != compared.reference]
    columns, scales = draw(compared, others)
    figure = gallery(columns, title, height=2.7 * max(map(len, columns)), scale=scales)
    save_figure(figure, path)


def _pressed(compared: ComparedAnswers, rows: IntArray, pressures: FloatArray) -> PressedFacets:
    """Some of the shared facets with some pressures (n,), before any displacement."""
    blocks = compared.contacts["blocks"][rows]
    assembly = compared.static.problem.blocks
    return PressedFacets(
        assembly=assembly,
        block_m=blocks[:, 0],
        block_s=blocks[:, 1],
        corners=compared.contacts["corners"][rows],
        pressures=pressures,
        nodes=assembly.nodes,
    )


def _difference(
    compared: ComparedAnswers, other: int, others: Sequence[int], rows: IntArray
) -> tuple[FloatArray, Scale]:
    """Pressures of an answer less those of the reference, and the colours of all differences."""
    reference = compared.pressures[compared.reference]
    changes = {k: compared.pressures[k][rows] - reference[rows] for k in others}
    # Differences of the order of round-off show no pattern that means anything.
    least = 1e-6 * float(reference.max(initial=0.0))
    every = np.concatenate([np.zeros(1), *changes.values()])
    reach = max(float(np.abs(every).max()), least, 1e-300)
    change = changes[other]
    reached = (float(every.min()), float(every.max()))
    label = f"difference from {compared.names[compared.reference]} [MPa]"
    return change, Scale(label, DIFFERENCE_MAP, -reach, reach, reached, diverging=True)


def _tube_columns(
    compared: ComparedAnswers, others: Sequence[int]
) -> tuple[list[list[Panel]], list[Scale] | None]:
    """Pressures of the middle layer's joints, in 3-D and unrolled; differences, unrolled.

    With the colours of each row.
    """
    pressures, name = compared.pressures[compared.reference], compared.names[compared.reference]
    facets = _pressed(compared, compared.faces["all"], pressures)
    joints = {"top": compared.layer, "bottom": compared.layer - 1}
    shown = np.concatenate([compared.faces[side] for side in joints])
    label = "contact pressure [MPa]"
    scale = scale_from_zero(label, PRESSURE_MAP, [pressures[shown]], nothing="open joint")
    panels = ring_panels(facets, scale, compared.layer)
    columns, scales = [panels], [scale]
    for number, (side, lower) in enumerate(joints.items()):
        flat = unrolled_panel(facets, lower, side, scale, title=f"{side} faces: {name}")
        column = [flat]
        for other in others:
            change, colours = _difference(compared, other, others, shown)
            agreed = compared.agreement[compared.names[other]][1 + number]["correlation"]
            words = f"{side} faces: {compared.names[other]} − {name}, r = {agreed:.3f}"
            pressed = _pressed(compared, shown, change)
            column.append(unrolled_panel(pressed, lower, side, colours, title=words))
            scales += [] if number else [colours]
        columns.append(column)
    return columns, scales


def _wall_columns(
    compared: ComparedAnswers, others: Sequence[int]
) -> tuple[list[list[Panel]], list[Scale] | None]:
    """Pressures of all joints, and differences, from above and from below."""
    everything = compared.faces["all"]

    def column(name: str, values: FloatArray, scale: Scale) -> list[Panel]:
        facets = _pressed(compared, everything, values)
        blocks = range(facets.assembly.n_blocks)
        parts = [facets.surface(everything, scale), *facets.outlines(blocks)]
        look_at = eye(facets.assembly)
        above, below = above_and_below(parts, look_at, title=name, scale=scale)
        return [replace(above, scale=None), below]

    label, pressures = "contact pressure [MPa]", compared.pressures[compared.reference]
    scale = scale_from_zero(label, PRESSURE_MAP, [pressures], nothing="open joint")
    columns = [column(compared.names[compared.reference], pressures, scale)]
    for other in others:
        change, colours = _difference(compared, other, others, everything)
        columns.append(column(compared.names[other], change, colours))
    return columns, None
