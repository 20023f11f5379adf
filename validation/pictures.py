"""Pictures of assemblies, their contact pressures and mechanisms."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
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


@dataclass(frozen=True)
class PressedFacets:
    """Contact facets and the pressures on them, of rigid or deformable blocks."""

    assembly: Assembly
    """The blocks."""
    block_m: IntArray
    """One block of each facet, (n,)."""
    block_s: IntArray
    """The other, (n,)."""
    corners: FloatArray
    """(n, 4, 3) [mm]"""
    pressures: FloatArray
    """(n,) [MPa]"""
    nodes: Callable[[int], FloatArray]
    """Nodes of a block where these facets are, (n_nodes, 3) [mm]."""
    is_tube: bool
    """Whether the blocks stand round the axis, so that one side hides the other."""

    @property
    def highest(self) -> float:
        """Largest pressure, never zero [MPa]."""
        return max(float(self.pressures.max(initial=0.0)), 1e-300)

    def between(self, lower: int) -> IntArray:
        """Facets between a layer and the next one, (n,)."""
        return _between(self.assembly.layer, self.block_m, self.block_s, lower)


def interface_facets(
    assembly: Assembly, contacts: IntArray, pressures: FloatArray
) -> PressedFacets:
    """Facets of an assembly that match, before any displacement.

    Parameters
    ----------
    assembly
        Blocks and interfaces.
    contacts
        Positions in the assembly's interfaces, (n,).
    pressures
        Their contact pressures, (n,) [MPa].
    """
    found = assembly.interfaces
    return PressedFacets(
        assembly=assembly,
        block_m=found.block_m[contacts],
        block_s=found.block_s[contacts],
        corners=interface_surface(assembly, contacts).nodes.reshape(-1, 4, 3),
        pressures=pressures,
        nodes=assembly.nodes,
        is_tube=not assembly.unmatched_allowed,
    )


def _block_surface(assembly: Assembly, block: int, nodes: FloatArray | None = None) -> Any:
    shape = assembly.shape(block)
    placed = assembly.nodes(block) if nodes is None else nodes
    return polydata(placed, np.concatenate(list(shape.faces.values())))


def _block_colour(assembly: Assembly, block: int) -> str:
    if assembly.fixed[block]:
        return GREY
    in_layer = np.flatnonzero(assembly.layer == assembly.layer[block])
    position = int(np.flatnonzero(in_layer == block)[0])
    return (BLUE, SKY)[(position + int(assembly.layer[block])) % 2]


def outline(
    assembly: Assembly,
    plotter: Any,
    blocks: IntArray,
    *,
    nodes: Callable[[int], FloatArray] | None = None,
    **style: Any,
) -> None:
    """Draw the edges of some blocks, as assembled or with the nodes given."""
    for block in blocks.tolist():
        placed = None if nodes is None else nodes(block)
        edges = _block_surface(assembly, block, placed).extract_feature_edges(
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


_LOAD_WORDS: dict[str, str] = {
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
    return _far_side(assembly, points, is_tube=not assembly.unmatched_allowed)


def _far_side(assembly: Assembly, points: FloatArray, *, is_tube: bool) -> npt.NDArray[np.bool_]:
    if not is_tube:
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
    words = _LOAD_WORDS.get(load.name, load.name)
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
    facets: PressedFacets, rows: IntArray, outlined: IntArray, highest: float
) -> Callable[[Any], None]:
    """Contact facets coloured by pressure, with the edges of some blocks.

    Parameters
    ----------
    facets
        All facets.
    rows
        Those that are drawn, (n,).
    outlined
        Blocks whose edges are drawn.
    highest
        Upper end of the colours [MPa].
    """

    def add(plotter: Any) -> None:
        if len(rows):
            quads = np.arange(4 * len(rows)).reshape(-1, 4)
            mesh = polydata(facets.corners[rows].reshape(-1, 3), quads)
            mesh.cell_data["pressure"] = facets.pressures[rows]
            plotter.add_mesh(
                mesh,
                scalars="pressure",
                cmap=PRESSURE_MAP,
                clim=(0.0, highest),
                lighting=False,
                show_scalar_bar=False,
            )
        outline(facets.assembly, plotter, outlined, nodes=facets.nodes, opacity=0.5)

    return add


def between_layers(assembly: Assembly, contacts: IntArray, lower: int) -> IntArray:
    """Rows of ``contacts`` that lie between a layer and the next one."""
    found = assembly.interfaces
    return _between(assembly.layer, found.block_m[contacts], found.block_s[contacts], lower)


def _between(layer: IntArray, block_m: IntArray, block_s: IntArray, lower: int) -> IntArray:
    m, s = layer[block_m], layer[block_s]
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
    """Draw the contact pressures of a rigid result in equilibrium."""
    result = run.result
    facets = interface_facets(run.assembly, result.contact_index, result.contact_pressures)
    draw_pressed_facets(facets, path, title=_pressure_title(run))


def draw_pressed_facets(facets: PressedFacets, path: Path, *, title: str) -> None:
    """Draw contact pressures: the tube cut open, and the middle layer's wavy faces.

    Only faces that can meet another block are shown, as in the paper's figures.

    Parameters
    ----------
    facets
        Contact facets of all blocks.
    path
        PNG to write.
    title
        One line at the top.
    """
    import matplotlib.pyplot as plt
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    assembly, highest = facets.assembly, facets.highest

    def far(points: FloatArray) -> IntArray:
        return np.flatnonzero(_far_side(assembly, points, is_tube=facets.is_tube))

    layer = assembly.n_layers // 2 + 1
    in_layer = np.flatnonzero(assembly.layer == layer)
    tube = coloured_facets(
        facets, far(facets.corners.mean(axis=1)), far(assembly.centroids), highest
    )
    top = coloured_facets(facets, facets.between(layer), in_layer, highest)
    bottom = coloured_facets(facets, facets.between(layer - 1), in_layer, highest)

    cut = "tube cut open" if facets.is_tube else "joints of the wall"
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
    figure.suptitle(title, fontsize=12, x=0.03, ha="left")
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
