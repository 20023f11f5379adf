"""Pictures of assemblies, their contact pressures and mechanisms."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from geometry.assembly import Assembly
from geometry.load_case import LoadCase, LoadCaseName
from geometry.mesh import FloatArray, IntArray
from geometry.mesh_io import interface_surface
from validation.rendering import (
    BLUE,
    GREY,
    PRESSURE_MAP,
    SKY,
    VERMILION,
    place,
    polydata,
    render,
    save_figure,
)

if TYPE_CHECKING:
    from validation.rigid import RigidRun


def _block_surface(assembly: Assembly, block: int) -> Any:
    shape = assembly.shape(block)
    return polydata(assembly.nodes(block), np.concatenate(list(shape.faces.values())))


def _block_colour(assembly: Assembly, block: int) -> str:
    if assembly.fixed[block]:
        return GREY
    in_layer = np.flatnonzero(assembly.layer == assembly.layer[block])
    position = int(np.flatnonzero(in_layer == block)[0])
    return (BLUE, SKY)[(position + int(assembly.layer[block])) % 2]


def outline(assembly: Assembly, plotter: Any, blocks: IntArray, **style: Any) -> None:
    """Draw the edges of some blocks."""
    for block in blocks.tolist():
        edges = _block_surface(assembly, block).extract_feature_edges(
            feature_angle=40, boundary_edges=False, non_manifold_edges=False
        )
        plotter.add_mesh(edges, color="#303030", line_width=1.2, **style)


def _add_load(assembly: Assembly, load: LoadCase, plotter: Any) -> None:
    """Arrows on a sample of the loaded facets, along the force."""
    import pyvista

    force = load.facet_forces
    size = np.linalg.norm(force, axis=1)
    pushed = np.flatnonzero(size > 0)
    if not pushed.size:
        return
    cell = assembly.characteristic_length * 0.45
    key = np.floor(load.centroids[pushed] / cell).astype(np.int64)
    _, first = np.unique(key, axis=0, return_index=True)
    chosen = pushed[first]
    direction = force[chosen] / size[chosen, None]
    length = 0.5 * assembly.characteristic_length
    into_body = np.einsum("ij,ij->i", direction, load.area_vectors[chosen]) < 0
    start = load.centroids[chosen] - np.where(into_body, length, 0.0)[:, None] * direction
    arrows = pyvista.PolyData(start)
    arrows["direction"] = direction
    glyph = arrows.glyph(orient="direction", scale=False, factor=length)
    plotter.add_mesh(glyph, color=VERMILION, lighting=False)


_LOAD_WORDS = {
    LoadCaseName.PIPE: "internal pressure",
    LoadCaseName.TUNNEL: "external pressure",
    LoadCaseName.PILLAR: "axial pressure",
    LoadCaseName.BEAM: "pressure on one block",
    LoadCaseName.SHAFT: "tangential traction",
}


#: The eye is outside, a little above the horizontal.
EYE = (2.4, -1.6, 0.9)


def beyond_axis(assembly: Assembly, points: FloatArray) -> npt.NDArray[np.bool_]:
    """Whether points lie on the far side of the tube axis, seen from `EYE`; all do in a wall."""
    if assembly.unmatched_allowed:
        return np.ones(len(points), dtype=bool)
    arm = points - assembly.origin
    far: npt.NDArray[np.bool_] = arm[:, :2] @ np.array(EYE[:2]) < (
        1e-6 * assembly.characteristic_length
    )
    return far


def draw_assembly(assembly: Assembly, load: LoadCase, path: Path, *, title: str) -> None:
    """Draw blocks, fixed frame, and load: from outside, and with the near side removed.

    Parameters
    ----------
    assembly, load
        What is built, held and loaded.
    path
        PNG to write.
    title
        One line at the top.
    """
    import matplotlib.pyplot as plt
    from matplotlib.patches import Patch

    def draw(blocks: IntArray) -> Callable[[Any], None]:
        def add(plotter: Any) -> None:
            for block in blocks.tolist():
                plotter.add_mesh(
                    _block_surface(assembly, block),
                    color=GREY if load.fixed[block] else _block_colour(assembly, block),
                    smooth_shading=False,
                    ambient=0.35,
                )
            outline(assembly, plotter, blocks)
            _add_load(assembly, load, plotter)

        return add

    everything = np.arange(assembly.n_blocks)
    far = np.flatnonzero(beyond_axis(assembly, assembly.centroids))
    wall = assembly.unmatched_allowed
    behind = (-EYE[0], -EYE[1], EYE[2])
    images = [render(draw(everything), EYE), render(draw(far), behind if wall else EYE)]
    ratios = [max(i.pixels.shape[1] / i.pixels.shape[0], 0.18) for i in images]
    figure, axes = plt.subplots(
        1, 2, figsize=(max(6.5, 9 * sum(ratios) + 1), 9.5), width_ratios=ratios
    )
    place(axes[0], images[0], "from outside")
    place(axes[1], images[1], "from the other side" if wall else "near side removed")
    words = _LOAD_WORDS.get(LoadCaseName(load.name), load.name)
    figure.suptitle(title, fontsize=14, x=0.03, ha="left")
    figure.legend(
        handles=[
            Patch(color=BLUE, label="free blocks"),
            Patch(color=GREY, label="held blocks (frame)"),
            Patch(color=VERMILION, label=f"load: {words}"),
        ],
        loc="lower center",
        ncols=3,
        frameon=False,
        fontsize=10,
    )
    figure.subplots_adjust(left=0.04, right=0.97, top=0.9, bottom=0.08, wspace=0.15)
    save_figure(figure, path)


def coloured_facets(
    assembly: Assembly,
    contacts: IntArray,
    pressures: FloatArray,
    outlined: IntArray,
    highest: float,
) -> Callable[[Any], None]:
    """Contact facets coloured by pressure, with the edges of some blocks.

    Parameters
    ----------
    assembly
        Blocks and interfaces.
    contacts
        Positions in the assembly's interfaces, (n,).
    pressures
        Their contact pressures, (n,) [MPa].
    outlined
        Blocks whose edges are drawn.
    highest
        Upper end of the colours [MPa].
    """

    def add(plotter: Any) -> None:
        surface = interface_surface(assembly, contacts)
        mesh = polydata(surface.nodes, surface.quads)
        mesh.cell_data["pressure"] = pressures
        plotter.add_mesh(
            mesh,
            scalars="pressure",
            cmap=PRESSURE_MAP,
            clim=(0.0, highest),
            lighting=False,
            show_scalar_bar=False,
        )
        outline(assembly, plotter, outlined, opacity=0.5)

    return add


def between_layers(assembly: Assembly, contacts: IntArray, lower: int) -> IntArray:
    """Rows of ``contacts`` that lie between a layer and the next one."""
    interfaces, layer = assembly.interfaces, assembly.layer
    m, s = layer[interfaces.block_m[contacts]], layer[interfaces.block_s[contacts]]
    return np.flatnonzero((np.minimum(m, s) == lower) & (np.maximum(m, s) == lower + 1))


def _pressure_title(run: RigidRun) -> str:
    measures = run.result.measures
    text = f"{run.name}{', as printed' if getattr(run.scene.load, 'as_printed', False) else ''}"
    text += f": {run.result.mechanism}"
    if measures is not None:
        text += (
            f"; mean of block maxima {measures.p_max:.3g} MPa, effective mean "
            f"{measures.p_eff:.3g} MPa, effective elements {measures.effective_count_percent:.1f} %"
        )
    return text


def draw_pressures(run: RigidRun, path: Path) -> None:
    """Draw the contact pressures: the tube cut open, and the middle layer's wavy faces.

    Only faces that can meet another block are shown, as in the paper's figures.

    Parameters
    ----------
    run
        A rigid result in equilibrium.
    path
        PNG to write.
    """
    import matplotlib.pyplot as plt
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    assembly, result = run.assembly, run.result
    index, pressures = result.contact_index, result.contact_pressures
    points = assembly.interfaces.centroids[index]
    highest = max(float(pressures.max(initial=0.0)), 1e-300)
    far_blocks = np.flatnonzero(beyond_axis(assembly, assembly.centroids))
    layer = assembly.n_layers // 2 + 1
    in_layer = np.flatnonzero(assembly.layer == layer)

    def facets(rows: IntArray, blocks: IntArray) -> Callable[[Any], None]:
        return coloured_facets(assembly, index[rows], pressures[rows], blocks, highest)

    tube = facets(np.flatnonzero(beyond_axis(assembly, points)), far_blocks)
    top = facets(between_layers(assembly, index, layer), in_layer)
    bottom = facets(between_layers(assembly, index, layer - 1), in_layer)

    cut = "joints of the wall" if assembly.unmatched_allowed else "tube cut open"
    figure = plt.figure(figsize=(10.5, 10))
    grid = figure.add_gridspec(2, 2, width_ratios=[0.5, 1], left=0.03, right=0.86, bottom=0.03)
    place(figure.add_subplot(grid[:, 0]), render(tube, EYE), cut)
    place(
        figure.add_subplot(grid[0, 1]),
        render(top, (1.2, -0.8, 1.6)),
        f"layer {layer}: top faces, seen from above",
    )
    place(
        figure.add_subplot(grid[1, 1]),
        render(bottom, (1.2, -0.8, -1.6)),
        f"layer {layer}: bottom faces, seen from below",
    )
    figure.suptitle(_pressure_title(run), fontsize=12, x=0.03, ha="left")
    bar = figure.add_axes((0.89, 0.15, 0.02, 0.7))
    colours = ScalarMappable(Normalize(0.0, highest), PRESSURE_MAP)
    figure.colorbar(colours, cax=bar, label="contact pressure [MPa]")
    save_figure(figure, path)


def draw_mechanism(run: RigidRun, path: Path) -> None:
    """Draw the certified mechanism: blocks moved along it, coloured by how far they move.

    Parameters
    ----------
    run
        A rigid result that is not locked, or whose load drives a mechanism.
    path
        PNG to write.
    """
    import matplotlib.pyplot as plt
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    from validation.rigid import mechanism_displacements

    assembly = run.assembly
    displacement = mechanism_displacements(run)
    if displacement is None:
        raise ValueError("a locked assembly has no mechanism to draw")
    scale = 0.3 * assembly.characteristic_length
    counts = [assembly.shape(block).mesh.n_nodes for block in range(assembly.n_blocks)]
    start = np.concatenate([[0], np.cumsum(counts)])

    def add(plotter: Any) -> None:
        for block in range(assembly.n_blocks):
            moved = displacement[start[block] : start[block + 1]]
            surface = _block_surface(assembly, block)
            surface.points = surface.points + scale * moved
            surface.point_data["motion"] = np.linalg.norm(moved, axis=1)
            plotter.add_mesh(
                surface,
                scalars="motion",
                cmap=PRESSURE_MAP,
                clim=(0.0, 1.0),
                ambient=0.4,
                show_scalar_bar=False,
            )
            edges = surface.extract_feature_edges(
                feature_angle=40, boundary_edges=False, non_manifold_edges=False
            )
            plotter.add_mesh(edges, color="#303030", line_width=1.2)

    figure, axes = plt.subplots(figsize=(8, 9.5))
    place(axes, render(add, EYE), f"first-order motion, drawn {scale:.3g} mm at its largest")
    result = run.result
    driven = (
        "the load drives it"
        if result.equilibrium.mechanism is not None
        else ("the load does not drive it")
    )
    figure.suptitle(
        f"{run.name}: {result.mechanism}; a mechanism exists, {driven}",
        fontsize=12,
        x=0.03,
        ha="left",
    )
    figure.subplots_adjust(left=0.03, right=0.84, top=0.9, bottom=0.04)
    bar = figure.add_axes((0.87, 0.2, 0.025, 0.6))
    colours = ScalarMappable(Normalize(0.0, 1.0), PRESSURE_MAP)
    figure.colorbar(colours, cax=bar, label="displacement / largest displacement [–]")
    save_figure(figure, path)
