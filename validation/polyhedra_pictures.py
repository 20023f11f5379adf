"""Pictures of triangulated blocks: the blocks, the contacts that were found, the mechanism."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from geometry.mesh import FloatArray
from geometry.polyhedral_assembly import PolyhedralAssembly
from validation.rendering import (
    BLUE,
    GREY,
    PRESSURE_MAP,
    SKY,
    VERMILION,
    place,
    render,
    save_figure,
)

if TYPE_CHECKING:
    from validation.polyhedra import PolyhedralRun

_EYE = (1.0, -1.9, 1.5)


def _surface(points: FloatArray, triangles: Any) -> Any:
    import pyvista

    return pyvista.PolyData(points, np.insert(triangles, 0, 3, axis=1).ravel())


def _edges(surface: Any) -> Any:
    return surface.extract_feature_edges(
        feature_angle=25, boundary_edges=False, non_manifold_edges=False
    )


def blocks_drawn(
    assembly: PolyhedralAssembly, places: list[FloatArray] | None = None, *, opacity: float = 1.0
) -> Callable[[Any], None]:
    """Draw blocks: held ones grey, free ones in two blues.

    Parameters
    ----------
    assembly
        Blocks.
    places
        Vertex coordinates of each block [mm]; where they stand by default.
    opacity
        Below 1, what is behind shows through.
    """

    def add(plotter: Any) -> None:
        for block in range(assembly.n_blocks):
            points = assembly.points(block) if places is None else places[block]
            surface = _surface(points, assembly.shape(block).triangles)
            colour = GREY if assembly.fixed[block] else (BLUE, SKY)[block % 2]
            plotter.add_mesh(surface, color=colour, ambient=0.35, opacity=opacity)
            plotter.add_mesh(_edges(surface), color="#303030", line_width=1.2)

    return add


def draw_blocks(assembly: PolyhedralAssembly, path: Path, *, title: str) -> None:
    """Draw the blocks where they stand.

    Parameters
    ----------
    assembly
        Blocks.
    path
        PNG to write.
    title
        One line at the top.
    """
    import matplotlib.pyplot as plt
    from matplotlib.patches import Patch

    figure, axes = plt.subplots(figsize=(9, 7.5))
    place(axes, render(blocks_drawn(assembly), _EYE), f"{assembly.n_blocks} blocks")
    figure.suptitle(title, fontsize=13, x=0.03, ha="left")
    handles = [Patch(color=BLUE, label="free blocks"), Patch(color=GREY, label="held blocks")]
    figure.legend(handles=handles, loc="lower center", ncols=2, frameon=False)
    figure.subplots_adjust(left=0.03, right=0.97, top=0.9, bottom=0.1)
    save_figure(figure, path)


def _contacts_drawn(run: PolyhedralRun, highest: float) -> Callable[[Any], None]:
    import pyvista

    assembly, interfaces = run.assembly, run.assembly.interfaces
    polygons = interfaces.polygons

    def add(plotter: Any) -> None:
        count = np.diff(polygons.start)
        corner = np.arange(len(polygons.corners))
        faces = np.insert(corner, polygons.start[:-1], count)
        mesh = pyvista.PolyData(polygons.corners, faces)
        if highest > 0:
            mesh.cell_data["pressure"] = run.patch_pressures[polygons.patch]
            plotter.add_mesh(
                mesh,
                scalars="pressure",
                cmap=PRESSURE_MAP,
                clim=(0.0, highest),
                lighting=False,
                show_scalar_bar=False,
            )
        else:
            plotter.add_mesh(mesh, color="#9ECAE1", lighting=False)
        bare = interfaces.patch < 0
        if bare.any():
            plotter.add_mesh(
                pyvista.PolyData(interfaces.centroids[bare]),
                color=VERMILION,
                point_size=9,
                render_points_as_spheres=True,
            )
        for block in range(assembly.n_blocks):
            surface = _surface(assembly.points(block), assembly.shape(block).triangles)
            plotter.add_mesh(_edges(surface), color="#303030", line_width=0.8, opacity=0.35)

    return add


def draw_polyhedra(run: PolyhedralRun, path: Path) -> None:
    """Draw the blocks, and beside them the contacts that were found.

    Parameters
    ----------
    run
        A rigid result.
    path
        PNG to write.
    """
    import matplotlib.pyplot as plt
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    result = run.result
    highest = float(run.patch_pressures.max(initial=0.0)) if result.equilibrium.holds else 0.0
    figure, axes = plt.subplots(1, 2, figsize=(14, 6.8))
    place(axes[0], render(blocks_drawn(run.assembly), _EYE), "blocks")
    place(axes[1], render(_contacts_drawn(run, highest), _EYE), "contacts found")
    verdict = "interlocked" if result.classification.locked else "not interlocked"
    figure.suptitle(
        f"{run.name}: {verdict} ({result.mechanism}); {result.n_blocks} free blocks, "
        f"{run.assembly.interfaces.n_contacts} contact points",
        fontsize=13,
        x=0.03,
        ha="left",
    )
    handles: list[Any] = [
        Patch(color=BLUE, label="free blocks"),
        Patch(color=GREY, label="held blocks"),
    ]
    if highest == 0.0:
        handles.append(Patch(color="#9ECAE1", label="contact patches"))
    if (run.assembly.interfaces.patch < 0).any():
        handles.append(
            Line2D([], [], color=VERMILION, marker="o", linestyle="", label="without area")
        )
    figure.legend(handles=handles, loc="lower center", ncols=4, frameon=False)
    figure.subplots_adjust(left=0.02, right=0.88 if highest > 0 else 0.98, top=0.88, bottom=0.1)
    if highest > 0:
        bar = figure.add_axes((0.905, 0.2, 0.016, 0.6))
        colours = ScalarMappable(Normalize(0.0, highest), PRESSURE_MAP)
        figure.colorbar(colours, cax=bar, label="mean pressure of a patch [MPa]")
    save_figure(figure, path)


def draw_polyhedral_mechanism(run: PolyhedralRun, motion: FloatArray, path: Path) -> None:
    """Draw the blocks moved along a mechanism.

    Parameters
    ----------
    run
        A rigid result that is not locked, or whose load drives a mechanism.
    motion
        Of `validation.polyhedra.mechanism_motion`, (n_blocks, 6).
    path
        PNG to write.
    """
    import matplotlib.pyplot as plt

    assembly = run.assembly
    scale = 0.25 * assembly.characteristic_length
    places = []
    for block in range(assembly.n_blocks):
        arm = assembly.points(block) - assembly.centroids[block]
        moved = motion[block, :3] + np.cross(motion[block, 3:], arm)
        places.append(assembly.points(block) + scale * moved)
    figure, axes = plt.subplots(figsize=(9, 7))
    place(
        axes,
        render(blocks_drawn(assembly, places), _EYE),
        f"first-order motion, drawn {scale:.3g} mm at its largest",
    )
    driven = run.result.equilibrium.mechanism is not None
    words = "the load drives it" if driven else "the load does not drive it"
    figure.suptitle(
        f"{run.name}: {run.result.mechanism}; a mechanism exists, {words}",
        fontsize=12,
        x=0.03,
        ha="left",
    )
    figure.subplots_adjust(left=0.03, right=0.97, top=0.88, bottom=0.05)
    save_figure(figure, path)
