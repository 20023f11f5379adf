"""The paper's figures that need deformable blocks, from the static state without initial gaps."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from geometry.assembly import Assembly
from geometry.mesh import FloatArray
from validation.paper.claims_fem import PressurePair, block_grid, pressure_pairs
from validation.paper.evidence import Evidence
from validation.pictures import EYE, outline
from validation.rendering import PRESSURE_MAP, STRESS_MAP, place, polydata, render, save_figure
from validation.tube_fem import TubeRun

CASES = ("pipe", "tunnel", "pillar", "beam", "shaft")
BLOCKS = ("TSB1", "TSB2")


def _runs(evidence: Evidence) -> Iterator[tuple[int, int, TubeRun]]:
    """Row, column and run of the five cases of both blocks."""
    for row, block in enumerate(BLOCKS):
        for column, case in enumerate(CASES):
            run = evidence.fem(block, case)
            if run is not None:
                yield row, column, run


# ---------------------------------------------------------------------------------------------
# Contact pressures of layer 7


def facet_outlines(assembly: Assembly, pair: PressurePair) -> FloatArray:
    """Corners of facets seen along the axis, (n, 4, 2) [mm]."""
    interfaces = assembly.interfaces
    blocks, quads = interfaces.block_m[pair.contacts], interfaces.quads_m[pair.contacts]
    corners = np.empty((len(quads), 4, 2))
    for block in np.unique(blocks).tolist():
        mine = blocks == block
        corners[mine] = assembly.nodes(block)[quads[mine]][:, :, :2]
    return corners


def draw_layer_comparison(evidence: Evidence, path: Path) -> list[PressurePair]:
    """Draw figure pc_MBD_FEM: rigid beside deformable, each in units of its own largest pressure.

    Returns
    -------
    list[PressurePair]
        The twelve comparisons drawn.
    """
    import matplotlib.pyplot as plt
    from matplotlib.cm import ScalarMappable
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import Normalize

    pairs = pressure_pairs(evidence)
    figure, axes = plt.subplots(6, 4, figsize=(11, 16.5))
    for number, pair in enumerate(pairs):
        block, case, side = pair.name.split()
        run = evidence.fem(block, case)
        assert run is not None
        corners = facet_outlines(run.deformable.assembly, pair)
        for offset, (words, values) in enumerate(
            (("rigid", pair.rigid), ("deformable", pair.deformable))
        ):
            panel = axes[number // 2, 2 * (number % 2) + offset]
            largest = float(values.max())
            faces = PolyCollection(list(corners), array=values / largest, cmap=PRESSURE_MAP)
            faces.set_clim(0.0, 1.0)
            faces.set_edgecolor("face")
            faces.set_linewidth(0.2)
            panel.add_collection(faces)
            panel.set_xlim(-165, 165)
            panel.set_ylim(-165, 165)
            panel.set_aspect("equal")
            panel.set_axis_off()
            panel.set_title(
                f"{block} {case}, {side}, {words}\nlargest {largest:.3g} MPa",
                fontsize=9,
                loc="left",
            )
    bar = figure.add_axes((0.93, 0.35, 0.015, 0.3))
    colours = ScalarMappable(Normalize(0.0, 1.0), PRESSURE_MAP)
    figure.colorbar(colours, cax=bar, label="contact pressure / largest in the panel [–]")
    figure.suptitle(
        "Contact pressures on the top and bottom faces of layer 7, seen along the axis",
        fontsize=13,
        x=0.03,
        ha="left",
    )
    figure.subplots_adjust(left=0.02, right=0.91, top=0.935, bottom=0.01, hspace=0.2, wspace=0.02)
    save_figure(figure, path)
    return pairs


# ---------------------------------------------------------------------------------------------
# Principal stresses on the outer surface


def outer_surface(
    run: TubeRun, component: int
) -> Iterator[tuple[FloatArray, FloatArray, FloatArray]]:
    """Arc length, height [mm] and principal stress [MPa] of every free block's outer face."""
    for block in run.deformable.assembly.free_blocks.tolist():
        nodes = block_grid(run, run.deformable.assembly.nodes(block))[-1]
        theta = np.unwrap(np.arctan2(nodes[..., 1], nodes[..., 0]), axis=0)
        radius = np.linalg.norm(nodes[..., :2], axis=2)
        values = block_grid(run, run.principal(block))[-1, ..., component]
        yield theta * radius, nodes[..., 2], values


def draw_principal(evidence: Evidence, component: int, path: Path) -> None:
    """Draw σ₁ (component 0) or σ₃ (2) on the unrolled outer surface, five cases, both blocks."""
    import matplotlib.pyplot as plt
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    symbol = ("σ₁", "σ₂", "σ₃")[component]
    figure, axes = plt.subplots(2, 5, figsize=(13, 14), sharex=True, sharey=True)
    for row, column, run in _runs(evidence):
        panel = axes[row, column]
        faces = list(outer_surface(run, component))
        reach = float(np.quantile(np.abs(np.concatenate([f[2].ravel() for f in faces])), 0.995))
        circle = 2 * np.pi * float(np.linalg.norm(run.deformable.assembly.nodes(0)[-1, :2]))
        for x, z, values in faces:
            for turn in (-1, 0, 1):  # a block that crosses the cut shows on both sides
                panel.pcolormesh(
                    x + turn * circle,
                    z,
                    values,
                    cmap=STRESS_MAP,
                    vmin=-reach,
                    vmax=reach,
                    shading="gouraud",
                    rasterized=True,
                )
        panel.set_xlim(0, circle)
        panel.set_ylim(-60, 2460)
        panel.set_aspect("equal")
        panel.set_title(f"{BLOCKS[row]} {CASES[column]}", fontsize=10, loc="left")
        if column == 0:
            panel.set_ylabel("z [mm]")
        if row == 1:
            panel.set_xlabel("arc length [mm]")
        colours = ScalarMappable(Normalize(-reach, reach), STRESS_MAP)
        bar = figure.colorbar(colours, ax=panel, orientation="horizontal", pad=0.07, fraction=0.03)
        bar.set_ticks([-reach, 0, reach], labels=[f"{-reach:.2g}", "0", f"{reach:.2g}"])
    figure.suptitle(
        f"{symbol} [MPa] on the outer surface, unrolled: red tension, blue compression",
        fontsize=13,
        x=0.03,
        ha="left",
    )
    figure.subplots_adjust(left=0.06, right=0.98, top=0.95, bottom=0.03, wspace=0.12, hspace=0.05)
    save_figure(figure, path)


# ---------------------------------------------------------------------------------------------
# Displacements


def _deformed(run: TubeRun, largest: float) -> Callable[[Any], None]:
    """Blocks moved by the drawing scale times their displacement, coloured by its size."""

    def add(plotter: Any) -> None:
        assembly = run.deformable.assembly
        for block in run.deformable.deformable_blocks.tolist():
            moved = run.displacement(block)
            quads = np.concatenate(list(assembly.shape(block).faces.values()))
            surface = polydata(run.positions(block) + run.drawing_scale * moved, quads)
            surface.point_data["size"] = np.linalg.norm(moved, axis=1)
            plotter.add_mesh(
                surface,
                scalars="size",
                cmap="viridis",
                clim=(0.0, largest),
                ambient=0.5,
                show_scalar_bar=False,
            )
        held = np.flatnonzero(run.deformable.group_of < 0)
        outline(assembly, plotter, held, opacity=0.6)

    return add


def draw_displacements(evidence: Evidence, path: Path) -> None:
    """Draw figure disp: deformed tubes, five cases, both blocks."""
    import matplotlib.pyplot as plt
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    figure, axes = plt.subplots(2, 5, figsize=(13, 15))
    for row, column, run in _runs(evidence):
        panel = axes[row, column]
        largest = run.largest_displacement
        image = render(_deformed(run, largest), EYE, height=1000)
        place(panel, image, f"{BLOCKS[row]} {CASES[column]}, drawn × {run.drawing_scale:g}")
        colours = ScalarMappable(Normalize(0.0, 1e3 * largest), "viridis")
        bar = figure.colorbar(colours, ax=panel, orientation="horizontal", pad=0.02, fraction=0.03)
        bar.set_ticks([0, 1e3 * largest], labels=["0", f"{1e3 * largest:.3g} µm"])
    figure.suptitle(
        "Displacements at 0.01 MPa, static state, no initial gaps", fontsize=13, x=0.03, ha="left"
    )
    figure.subplots_adjust(left=0.01, right=0.99, top=0.94, bottom=0.02, wspace=0.05, hspace=0.08)
    save_figure(figure, path)
