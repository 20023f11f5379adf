"""Pictures of deformable blocks that make no tube: walls, columns, own blocks."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from geometry.mesh import FloatArray
from validation.pictures import EYE, coloured_facets
from validation.rendering import PRESSURE_MAP, STRESS_MAP, place, render, save_figure
from validation.tube_pictures import (
    Panel,
    colour_bar,
    coloured_blocks,
    run_facets,
    symmetric_limits,
)

if TYPE_CHECKING:
    from validation.tube_fem import TubeRun


def eye(run: TubeRun) -> tuple[float, float, float]:
    """Direction from which all blocks are seen: against the assembly's smallest extent."""
    assembly = run.deformable.assembly
    points = np.concatenate([assembly.nodes(b) for b in range(assembly.n_blocks)])
    extent = np.ptp(points, axis=0)
    if extent[1] < 0.5 * min(extent[0], extent[2]):
        return (0.9, 2.4, 0.9)
    if extent[2] < 0.5 * min(extent[0], extent[1]):
        return (0.9, -1.2, 2.4)
    return EYE


def draw_block_stresses(run: TubeRun, path: Path) -> None:
    """Draw σ₁, σ₃ and the displacement on the surfaces of all deformable blocks.

    Stresses are drawn where the blocks are, the displacement enlarged.
    """
    import matplotlib.pyplot as plt

    blocks = run.deformable.deformable_blocks.tolist()
    sigma_1 = {b: run.principal(b)[:, 0] for b in blocks}
    sigma_3 = {b: run.principal(b)[:, 2] for b in blocks}
    moved: dict[int, FloatArray] = {b: np.linalg.norm(run.displacement(b), axis=1) for b in blocks}
    limits_u = (0.0, max(float(v.max()) for v in moved.values()) or 1e-300)
    faces = tuple(dict.fromkeys(f for b in blocks for f in run.deformable.assembly.shape(b).faces))
    scale = run.drawing_scale
    one, three = symmetric_limits(list(sigma_1.values())), symmetric_limits(list(sigma_3.values()))
    panels = (
        Panel("σ₁", sigma_1, STRESS_MAP, one, "σ₁ [MPa]", faces, 1.0),
        Panel("σ₃", sigma_3, STRESS_MAP, three, "σ₃ [MPa]", faces, 1.0),
        Panel(
            f"displacement, drawn × {scale:g}", moved, "viridis", limits_u, "|u| [mm]", faces, scale
        ),
    )
    figure, axes = plt.subplots(1, 3, figsize=(14, 6.2))
    for column, (cell, panel) in enumerate(zip(axes, panels, strict=True)):
        place(cell, render(coloured_blocks(run, panel), eye(run)), panel.title)
        bar = figure.add_axes((0.06 + 0.32 * column, 0.09, 0.22, 0.025))
        colour_bar(figure, bar, panel.limits, panel.colours, panel.label, horizontal=True)
    figure.suptitle(run.title, fontsize=13, x=0.02, ha="left")
    figure.subplots_adjust(left=0.02, right=0.98, top=0.87, bottom=0.17, wspace=0.06)
    save_figure(figure, path)


def draw_block_contact(run: TubeRun, path: Path) -> None:
    """Draw the pressure on every contact facet, with the outlines of all blocks."""
    import matplotlib.pyplot as plt

    facets = run_facets(run)
    everything = np.arange(len(facets.pressures))
    blocks = np.arange(run.deformable.assembly.n_blocks)
    draw = coloured_facets(facets, everything, blocks, facets.highest)
    x, y, z = eye(run)
    figure, axes = plt.subplots(1, 2, figsize=(13, 6.2))
    place(axes[0], render(draw, (x, y, z)), "from above")
    place(axes[1], render(draw, (x, y, -z)), "from below")
    figure.suptitle(f"{run.title}: contact pressure", fontsize=13, x=0.02, ha="left")
    figure.subplots_adjust(left=0.02, right=0.89, top=0.88, bottom=0.03, wspace=0.06)
    bar = figure.add_axes((0.92, 0.15, 0.014, 0.65))
    colour_bar(figure, bar, (0.0, facets.highest), PRESSURE_MAP, "contact pressure [MPa]")
    save_figure(figure, path)
