"""The paper's figures that need deformable blocks, from the static state without initial gaps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from geometry import Answer
from validation.output.pictures.bodies import EYE
from validation.output.pictures.canvas import Polygons, View, merged
from validation.output.pictures.gallery import (
    Numbers,
    Panel,
    gallery,
    round_numbers,
    save_figure,
)
from validation.output.pictures.scales import (
    PRESSURE_MAP,
    STRESS_MAP,
    Scale,
    drawing_scale,
    symmetric_scale,
)
from validation.output.pictures.tubes import moved_panel
from validation.paper.claims.deformable import (
    BLOCKS,
    CASES,
    block_grid,
    pressure_pairs,
)
from validation.paper.evidence import FloatArray, PaperEvidence

#: Width of a figure with a colour bar and its extremes below each of five columns [in].
_WIDEST = 22.0


def _runs(evidence: PaperEvidence) -> Iterator[tuple[int, int, Answer]]:
    """Row, column and run of the five cases of both blocks."""
    for row, block in enumerate(BLOCKS):
        for column, case in enumerate(CASES):
            yield row, column, evidence.fem(block, case)


# ---------------------------------------------------------------------------------------------
# Contact pressures of layer 7


def draw_layer_comparison(evidence: PaperEvidence, path: Path) -> None:
    """Draw figure pc_MBD_FEM: rigid beside deformable, each in units of its own largest pressure.

    All twelve of `pressure_pairs`.
    """
    label, ends = "contact pressure / largest in the panel [–]", (0.0, 1.0)
    scale = Scale(label, PRESSURE_MAP, *ends, reached=ends, nothing="open joint")
    columns: list[list[Panel]] = [[] for _ in range(4)]
    for number, pair in enumerate(pressure_pairs(evidence)):
        block, case, side = pair.name.split()
        corners = pair.corners
        for offset, (words, values) in enumerate(
            (("rigid", pair.rigid), ("deformable", pair.deformable))
        ):
            largest = float(values.max())
            title = f"{block} {case}, {side}\n{words}, largest {largest:.3g} MPa"
            quads = np.arange(corners.size // 3).reshape(-1, 4)
            colours = scale.of(values / largest)
            facets = Polygons(corners.reshape(-1, 3), quads, colours, lit=False)
            view = View([facets], (0.0, 0.0, 1.0))
            columns[2 * (number % 2) + offset].append(Panel(title, view))
    title = "Contact pressures on the top and bottom faces of layer 7, seen along the axis"
    save_figure(gallery(columns, title, height=16.0, scale=scale), path)


# ---------------------------------------------------------------------------------------------
# Principal stresses on the outer surface


def outer_surface(
    answer: Answer, component: int
) -> Iterator[tuple[FloatArray, FloatArray, FloatArray]]:
    """Arc length, height [mm] and principal stress [MPa] of every free block's outer face."""
    principal = answer.fields["principal_stress"][:, component]
    for block in answer.problem.blocks.free_blocks.tolist():
        nodes = block_grid(answer, answer.points, block)[-1]
        theta = np.unwrap(np.arctan2(nodes[..., 1], nodes[..., 0]), axis=0)
        radius = np.linalg.norm(nodes[..., :2], axis=2)
        values = block_grid(answer, principal, block)[-1]
        yield theta * radius, nodes[..., 2], values


def draw_principal(evidence: PaperEvidence, component: int, path: Path) -> None:
    """Draw σ₁ (component 0) or σ₃ (2) on the unrolled outer surface, five cases, both blocks."""
    symbol = ("σ₁", "σ₂", "σ₃")[component]
    columns: list[list[Panel]] = [[] for _ in CASES]
    for row, column, answer in _runs(evidence):
        faces = list(outer_surface(answer, component))
        scale = symmetric_scale(f"{symbol} [MPa]", STRESS_MAP, [f[2] for f in faces])
        circle = 2 * np.pi * float(np.linalg.norm(answer.problem.blocks.nodes(0)[-1, :2]))
        view, numbers = _outer_view(faces, scale, circle)
        name = f"{BLOCKS[row]} {CASES[column]}"
        columns[column].append(Panel(name, view, scale=scale, numbers=numbers))
    title = f"{symbol} [MPa] on the outer surface, unrolled: red tension, blue compression"
    save_figure(gallery(columns, title, height=14.0, widest=_WIDEST), path)


def _outer_view(
    faces: list[tuple[FloatArray, FloatArray, FloatArray]], scale: Scale, circle: float
) -> tuple[View, Numbers]:
    """Outer faces over arc length and height; a block that crosses the cut shows on both sides."""
    bodies, shades = [], []
    for x, z, values in faces:
        for turn in (-1, 0, 1):
            corners = np.arange(x.size).reshape(x.shape)
            quads = [corners[:-1, :-1], corners[1:, :-1], corners[1:, 1:], corners[:-1, 1:]]
            places = np.stack([x + turn * circle, z, np.zeros_like(x)], axis=-1)
            bodies.append((places.reshape(-1, 3), np.stack(quads, axis=-1).reshape(-1, 4)))
            shades.append(scale.of(values.ravel()))
    heights = np.concatenate([z.ravel() for _, z, _ in faces])
    low, high = float(heights.min()), float(heights.max())
    window = np.array([0.0, low]), np.array([circle, high])
    surface = Polygons(*merged(bodies, 4), np.concatenate(shades), lit=False)
    ticks = round_numbers(0.0, circle), round_numbers(low, high)
    numbers = Numbers("arc length [mm]", "z [mm]", *ticks)
    return View([surface], (0.0, 0.0, 1.0), margin=0.0, window=window), numbers


# ---------------------------------------------------------------------------------------------
# Displacements


def draw_displacements(evidence: PaperEvidence, path: Path) -> None:
    """Draw figure disp: deformed tubes, five cases, both blocks."""
    columns: list[list[Panel]] = [[] for _ in CASES]
    for row, column, answer in _runs(evidence):
        words = (
            f"{BLOCKS[row]} {CASES[column]}\ndeformed, "
            f"scale factor {drawing_scale(answer.details):g}"
        )
        columns[column].append(replace(moved_panel(answer.details, EYE), title=words))
    title = "Displacements at 0.01 MPa, static state, no initial gaps"
    save_figure(gallery(columns, title, height=14.5), path)
