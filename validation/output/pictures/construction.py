"""A strip of the stages of a construction: what is new, what is propped, with which force."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np

from geometry.answer import Answer
from geometry.parts.placed import AnyBlocks
from geometry.parts.rows import number
from mbd.building.stages import Stands
from validation.output.pictures.bodies import arrows, blocks, eye
from validation.output.pictures.canvas import INK, Part, View
from validation.output.pictures.gallery import Panel, gallery
from validation.output.pictures.scales import BLUE, GREY, ORANGE, SKY, VERMILION

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from mbd.building.stages import Stage, StageResults

#: Stages that are drawn at most, and in one row where there are no more.
_MOST, _ROW = 8, 3
#: Length of the longest arrow, and of the shortest, in lengths of a block.
_LONGEST, _SHORTEST = 1.3, 0.6


def _view(stage: Stage, assembly: AnyBlocks, largest: float, whole: list[Part]) -> View:
    """What is placed, over pale edges of the whole, and arrows of the props from below."""
    new, moving = set(stage.new), set[int]()
    if stage.stands is Stands.FALLS and (motion := stage.moves) is not None:
        moving = {one.block for one in motion.blocks}
    there = np.flatnonzero(stage.there).tolist()
    fixed = assembly.fixed

    def colour(block: int) -> str:
        if block in moving:
            return VERMILION
        if block in new:
            return ORANGE
        return GREY if fixed[block] else (BLUE, SKY)[block % 2]

    parts = [*whole, *blocks(assembly, colour, only=there)]
    propped = stage.propped
    if propped:
        force = stage.props[propped]
        size = np.linalg.norm(force, axis=1, keepdims=True)
        length = np.clip(size / largest, _SHORTEST / _LONGEST, 1.0) * _LONGEST
        along = force / size * length * assembly.characteristic_length
        # Arrows end inside of their blocks; they are drawn in front of them.
        towards = np.array(eye(assembly)) / np.linalg.norm(eye(assembly))
        front = 2.0 * assembly.characteristic_length * towards
        parts.append(arrows(assembly.centroids[propped] - along + front, along, INK))
    return View(parts, eye(assembly))


def draw_stages(answer: Answer) -> Figure:
    """Draw up to eight stages of a construction, in two rows."""
    from matplotlib.patches import Patch

    results, assembly = cast("StageResults", answer.parts["stages"]), answer.details.blocks
    chosen = results.shown(_MOST)
    if len(chosen) > _ROW and len(chosen) % 2:  # no place of two rows is empty
        chosen = results.shown(len(chosen) - 1)
    sizes = [np.linalg.norm(stage.props, axis=1).max(initial=0.0) for stage in results]
    largest = float(max(sizes, default=0.0)) or 1.0
    whole = blocks(assembly, None, edges=0.25)
    panels = []
    for stage in chosen:
        words = str(stage.stands).partition(":")[0].partition(" (")[0]
        props = f", {number(stage.propping)} N" if stage.propped else ""
        panels.append(
            Panel(f"stage {stage.number}: {words}{props}", _view(stage, assembly, largest, whole))
        )
    across = len(panels) if len(panels) <= _ROW or len(panels) % 2 else len(panels) // 2
    columns = [panels[k::across] for k in range(across)]
    colours = {"placed in this stage": ORANGE, "placed before": BLUE, "fixed": GREY}
    if any(stage.stands is Stands.FALLS for stage in chosen):
        colours["moves most"] = VERMILION
    if any(sizes):
        colours[f"prop; the longest {number(largest)} N"] = INK
    legend = [Patch(color=colour, label=name) for name, colour in colours.items()]
    title = f"{answer.case.name}, rigid blocks: stages of the construction, weight alone"
    return gallery(columns, f"{title}\n{results.words}", height=6.5, legend=legend)
