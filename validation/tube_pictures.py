"""Pictures of deformable tubes: principal stresses, sections, displacements, contact pressures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from geometry.hexagon_block import EDGE_NAMES
from geometry.mesh import FloatArray
from validation.pictures import EYE, PressedFacets, draw_pressed_facets, outline
from validation.rendering import STRESS_MAP, place, polydata, render, save_figure
from validation.scene import TubeScene
from validation.scene_families import HexagonTubeScene

if TYPE_CHECKING:
    from validation.tube_fem import TubeRun


@dataclass(frozen=True)
class Panel:
    """What one picture of the blocks shows."""

    title: str
    values: dict[int, FloatArray]
    """Nodal values of each deformable block."""
    colours: str
    limits: tuple[float, float]
    label: str
    faces: tuple[str, ...]
    scale: float
    """Factor of the displacement in the picture."""


def coloured_blocks(run: TubeRun, panel: Panel) -> Callable[[Any], None]:
    """Named faces of all deformable blocks, moved by the panel's scale of their displacement."""

    def add(plotter: Any) -> None:
        assembly = run.deformable.assembly
        for block in run.deformable.deformable_blocks.tolist():
            shape = assembly.shape(block)
            shown = [shape.faces[face] for face in panel.faces if face in shape.faces]
            if not shown:
                continue
            quads = np.concatenate(shown)
            surface = polydata(run.positions(block) + panel.scale * run.displacement(block), quads)
            surface.point_data["values"] = panel.values[block]
            plotter.add_mesh(
                surface,
                scalars="values",
                cmap=panel.colours,
                clim=panel.limits,
                lighting=False,
                show_scalar_bar=False,
            )
        rigid = np.flatnonzero(run.deformable.group_of < 0)
        outline(assembly, plotter, rigid, opacity=0.6)

    return add


def colour_bar(
    figure: Any,
    axes: Any,
    limits: tuple[float, float],
    colours: str,
    label: str,
    *,
    horizontal: bool = False,
) -> None:
    """Add a colour bar to a figure."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.ticker import MaxNLocator

    bar = figure.colorbar(
        ScalarMappable(Normalize(*limits), colours),
        cax=axes,
        label=label,
        orientation="horizontal" if horizontal else "vertical",
    )
    # 0.00016 beside 0.00008 does not fit: the power of ten stands once, beside the bar.
    bar.formatter.set_powerlimits((-3, 4))
    if horizontal:
        bar.locator = MaxNLocator(5)


def symmetric_limits(values: list[FloatArray]) -> tuple[float, float]:
    """Limits ± the 99.8 % quantile: a few singular nodes must not drown the picture."""
    reach = max(float(np.quantile(np.abs(np.concatenate(values)), 0.998)), 1e-300)
    return (-reach, reach)


def draw_stresses(run: TubeRun, path: Path) -> None:
    """Draw σ₁, σ₃ and the displacement on the outer surface, whole tube."""
    import matplotlib.pyplot as plt

    blocks = run.deformable.deformable_blocks.tolist()
    sigma_1 = {b: run.principal(b)[:, 0] for b in blocks}
    sigma_3 = {b: run.principal(b)[:, 2] for b in blocks}
    moved = {b: np.linalg.norm(run.displacement(b), axis=1) for b in blocks}
    limits_1, limits_3 = (
        symmetric_limits(list(sigma_1.values())),
        symmetric_limits(list(sigma_3.values())),
    )
    limits_u = (0.0, max(float(v.max()) for v in moved.values()) or 1e-300)
    scale, outer = run.drawing_scale, ("outer",)
    shell = ("outer", "inner", "left", "right", *EDGE_NAMES)
    panels = (
        Panel("σ₁, outer surface", sigma_1, STRESS_MAP, limits_1, "σ₁ [MPa]", outer, 1.0),
        Panel("σ₃, outer surface", sigma_3, STRESS_MAP, limits_3, "σ₃ [MPa]", outer, 1.0),
        Panel(f"moved × {scale:g}", moved, "viridis", limits_u, "|u| [mm]", shell, scale),
    )
    images = [render(coloured_blocks(run, panel), EYE) for panel in panels]
    tallest, widest = np.max([image.pixels.shape[:2] for image in images], axis=0)
    # Short tubes fill the width, tall ones the height; bars below never meet the next panel.
    height = min(7.5, 3.6 * tallest / widest)
    width = float(np.clip(height * widest / tallest + 0.4, 2.9, 4.0))
    size = (width * len(panels), height + 2.0)
    figure, axes = plt.subplots(1, len(panels), figsize=size)
    figure.subplots_adjust(
        left=0.03, right=0.97, bottom=1.1 / size[1], top=1 - 0.8 / size[1], wspace=0.15
    )
    for axis, panel, image in zip(axes, panels, images, strict=True):
        place(axis, image, panel.title)
        box = axis.get_position()
        middle, reach = 0.5 * (box.x0 + box.x1), 0.38 * width / size[0]
        bar = figure.add_axes((middle - reach, 0.62 / size[1], 2 * reach, 0.16 / size[1]))
        colour_bar(figure, bar, panel.limits, panel.colours, panel.label, horizontal=True)
    figure.suptitle(run.title, fontsize=13, x=0.02, ha="left")
    save_figure(figure, path)


def draw_displacement(run: TubeRun, path: Path) -> None:
    """Draw the displacement in the zy-plane, with the paper's scale factor for the load case."""
    import matplotlib.pyplot as plt

    from validation.paper.reference import reference

    assert isinstance(run.scene, TubeScene | HexagonTubeScene)
    scale = float(reference()["figures"]["displacement_scale"][str(run.scene.load.case)])
    blocks = run.deformable.deformable_blocks.tolist()
    moved = {b: np.linalg.norm(run.displacement(b), axis=1) for b in blocks}
    limits = (0.0, max(float(v.max()) for v in moved.values()) or 1e-300)
    shell = ("outer", "inner", "left", "right", "top", "bottom", *EDGE_NAMES)
    factors = {f"drawn × {scale:g}, as in the paper": scale}
    # Ours only where the paper's factor shows too little or too much of this tube.
    if not 0.5 < scale / run.drawing_scale < 2.0:
        factors[f"drawn × {run.drawing_scale:g}"] = run.drawing_scale
    panels = [
        Panel(title, moved, "viridis", limits, "|u| [mm]", shell, factor)
        for title, factor in factors.items()
    ]
    size = (3.4 * len(panels) + 1.4, 9.5)
    figure, axes = plt.subplots(1, len(panels), figsize=size, squeeze=False)
    for column, panel in zip(axes[0], panels, strict=True):
        place(column, render(coloured_blocks(run, panel), (1.0, 0.0, 0.0)), panel.title)
    figure.suptitle(f"{run.title}\ndisplacement in the zy-plane", fontsize=11, x=0.03, ha="left")
    figure.subplots_adjust(left=0.03, right=1.0 - 1.4 / size[0], top=0.88, bottom=0.03)
    bar = figure.add_axes((1.0 - 1.2 / size[0], 0.25, 0.2 / size[0], 0.5))
    colour_bar(figure, bar, limits, "viridis", "|u| [mm]")
    save_figure(figure, path)


def section_heights(run: TubeRun) -> tuple[float, ...]:
    """Heights of the paper's sections through the middle layer: 10 and 20 mm from its ends."""
    assembly = run.deformable.assembly
    layer = assembly.n_layers // 2 + 1
    # Where a layer begins depends on the tube: layers of hexagons reach into each other.
    centres = (assembly.centroids @ assembly.axis)[assembly.layer == layer]
    middle = round(float(centres.mean()), 6)
    low, high = middle - 0.5 * _pitch(assembly), middle + 0.5 * _pitch(assembly)
    return (low + 10.0, low + 20.0, high - 20.0, high - 10.0)


def _pitch(assembly: Any) -> float:
    """Distance of the layers along the axis [mm]."""
    centres = assembly.centroids @ assembly.axis
    free = np.unique(assembly.layer[~assembly.fixed])
    if len(free) > 1:
        means = [centres[assembly.layer == k].mean() for k in free]
        return float(np.mean(np.diff(means)))
    block = int(assembly.free_blocks[0])
    along = assembly.nodes(block) @ assembly.axis
    inner = np.unique(assembly.shape(block).faces["inner"])
    return float(np.ptp(along[inner]))


def draw_sections(run: TubeRun, path: Path) -> None:
    """Draw σ₁ and σ₃ in four sections through the middle layer, as the paper's figures."""
    import matplotlib.pyplot as plt
    from matplotlib.tri import Triangulation

    heights = section_heights(run)
    cuts = [run.section(z) for z in heights]
    limits_1 = symmetric_limits([c.values[:, 0] for c in cuts if len(c.values)] or [np.ones(1)])
    limits_3 = symmetric_limits([c.values[:, 2] for c in cuts if len(c.values)] or [np.ones(1)])
    figure, axes = plt.subplots(2, 4, figsize=(14, 7.2), sharex=True, sharey=True)
    for row, (component, limits) in enumerate(((0, limits_1), (2, limits_3))):
        for column, (z, cut) in enumerate(zip(heights, cuts, strict=True)):
            panel = axes[row, column]
            panel.set_aspect("equal")
            panel.set_title(f"z = {z:.4g} mm", fontsize=10, loc="left")
            if len(cut.triangles):
                mesh = Triangulation(cut.points[:, 0], cut.points[:, 1], cut.triangles)
                panel.tripcolor(
                    mesh,
                    cut.values[:, component],
                    cmap=STRESS_MAP,
                    vmin=limits[0],
                    vmax=limits[1],
                    shading="gouraud",
                )
            if row == 1:
                panel.set_xlabel("x [mm]")
        axes[row, 0].set_ylabel("y [mm]")
        bar = figure.add_axes((0.93, 0.55 - 0.46 * row, 0.012, 0.32))
        colour_bar(figure, bar, limits, STRESS_MAP, ("σ₁ [MPa]", "", "σ₃ [MPa]")[component])
    layer = run.deformable.assembly.n_layers // 2 + 1
    figure.suptitle(f"{run.title}: sections through layer {layer}", fontsize=13, x=0.03, ha="left")
    figure.subplots_adjust(left=0.06, right=0.91, top=0.9, bottom=0.08, wspace=0.08, hspace=0.15)
    save_figure(figure, path)


def run_facets(run: TubeRun) -> PressedFacets:
    """Contact facets of a run where they ended."""
    group_of = run.deformable.group_of

    def nodes(block: int) -> FloatArray:
        placed = run.positions(block)
        return placed + run.displacement(block) if group_of[block] >= 0 else placed

    found = run.contact_state
    return PressedFacets(
        assembly=run.deformable.assembly,
        block_m=found.block_m,
        block_s=found.block_s,
        corners=found.corners,
        pressures=found.pressures,
        nodes=nodes,
        is_tube=run.is_tube,
    )


def draw_contact(run: TubeRun, path: Path) -> None:
    """Draw the contact pressures as those of rigid blocks are drawn."""
    draw_pressed_facets(run_facets(run), path, title=run.title)
