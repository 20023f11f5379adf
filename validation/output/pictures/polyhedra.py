"""Pictures of triangulated blocks: the blocks, the contacts that were found, the mechanism."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from geometry.measures import chain
from geometry.mesh import FloatArray
from geometry.polyhedra.assembly import PolyhedralAssembly
from validation.output.pictures.assemblies import draw_motion
from validation.output.pictures.bodies import sharp_edges
from validation.output.pictures.canvas import Direction, Dots, Lines, Part, Surface, View, merged
from validation.output.pictures.gallery import (
    BLUE,
    GREY,
    PRESSURE_MAP,
    SKY,
    VERMILION,
    Panel,
    gallery,
    scale_from_zero,
)
from validation.run.rigid.polyhedra import contact_triangles

if TYPE_CHECKING:
    from validation.run.rigid.polyhedra import PolyhedralRun

_EYE: Direction = (1.0, -1.9, 1.5)
_PALE = "#9ECAE1"


def polyhedra_parts(
    assembly: PolyhedralAssembly, places: list[FloatArray] | None = None, *, opacity: float = 1.0
) -> list[Part]:
    """Blocks and their edges: held ones grey, free ones in two blues.

    ``places`` are the vertices of each block [mm]; by default where they stand.
    """
    points = [assembly.points(b) for b in range(assembly.n_blocks)] if places is None else places
    parts: list[Part] = []
    for colour in (GREY, BLUE, SKY):
        chosen = [b for b in range(assembly.n_blocks) if _colour(assembly, b) == colour]
        bodies = merged(((points[b], assembly.shape(b).triangles) for b in chosen), 3)
        if chosen:
            parts.append(Surface(*bodies, colour, opacity=opacity))
    return [*parts, _edges(assembly, points)]


def _colour(assembly: PolyhedralAssembly, block: int) -> str:
    return GREY if assembly.fixed[block] else (BLUE, SKY)[block % 2]


def _edges(
    assembly: PolyhedralAssembly,
    points: list[FloatArray],
    *,
    width: float = 2.0,
    opacity: float = 1.0,
) -> Lines:
    """Sharp edges of all blocks."""
    own = [sharp_edges(shape.points, shape.triangles, angle=25.0) for shape in assembly.shapes]
    of_blocks = (own[int(k)] for k in assembly.shape_of)
    every, segments = merged(zip(points, of_blocks, strict=True), 2)
    used, places = np.unique(segments, return_inverse=True)
    return Lines(every[used], places.reshape(segments.shape), width=width, opacity=opacity)


def _block_legend() -> list[Any]:
    from matplotlib.patches import Patch

    return [Patch(color=BLUE, label="free blocks"), Patch(color=GREY, label="held blocks")]


def draw_blocks(assembly: PolyhedralAssembly, path: Path, *, title: str) -> None:
    """Draw the blocks where they stand."""
    view = View(polyhedra_parts(assembly), _EYE)
    panel = Panel(f"{assembly.n_blocks} blocks", view)
    gallery([[panel]], title, path, height=6.5, legend=_block_legend())


def draw_polyhedra(run: PolyhedralRun, path: Path) -> None:
    """Draw the blocks, and beside them the contacts that were found."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    assembly, interfaces, result = run.assembly, run.assembly.interfaces, run.result
    pressures = run.patch_pressures if run.carried.holds else np.zeros(0)
    scale = scale_from_zero("mean pressure of a patch [MPa]", PRESSURE_MAP, [pressures])
    pressed = scale.reached[1] > 0.0
    triangles, owner = contact_triangles(run)
    colour: Any = _PALE
    if pressed:
        colour = scale.of(pressures[interfaces.polygons.patch[owner]])
    points = [assembly.points(b) for b in range(assembly.n_blocks)]
    contacts: list[Part] = [_edges(assembly, points, width=1.4, opacity=0.35)]
    if len(triangles):
        contacts.append(Surface(interfaces.polygons.corners, triangles, colour, lit=False))
    legend = _block_legend()
    row = chain(run.joints) if pressed else None
    if row is not None:
        ends = np.column_stack([np.arange(len(row) - 1), np.arange(1, len(row))])
        contacts.append(Lines(run.joints.points[row], ends, VERMILION, width=5.0))
        legend.append(Line2D([], [], color=VERMILION, label="thrust line"))
    bare = interfaces.patch < 0
    if not pressed:
        legend.append(Patch(color=_PALE, label="contact patches"))
    if bare.any():
        contacts.append(Dots(interfaces.centroids[bare], VERMILION))
        legend.append(
            Line2D([], [], color=VERMILION, marker="o", linestyle="", label="without area")
        )
    verdict = "interlocked" if result.classification.locked else "not interlocked"
    asked = run.scene.rigid.friction is not None
    answer = run.carried.words if asked else f"{verdict} ({result.mechanism})"
    gallery(
        [
            [Panel("blocks", View(polyhedra_parts(assembly), _EYE))],
            [Panel("contacts found", View(contacts, _EYE))],
        ],
        f"{run.name}: {run.scene.load_words}; {answer}\n"
        f"{result.n_blocks} free blocks, {interfaces.n_contacts} contact points",
        path,
        height=6.0,
        scale=scale if pressed else None,
        legend=legend,
    )


def draw_polyhedral_mechanism(run: PolyhedralRun, motion: FloatArray, path: Path) -> None:
    """Draw the blocks moved along a mechanism, (n_blocks, 6), as `mechanism_motion` scales it."""
    assembly = run.assembly
    scale = 0.25 * assembly.characteristic_length
    places = []
    for block in range(assembly.n_blocks):
        arm = assembly.points(block) - assembly.centroids[block]
        moved = motion[block, :3] + np.cross(motion[block, 3:], arm)
        places.append(assembly.points(block) + scale * moved)
    view = View(polyhedra_parts(assembly, places), _EYE)
    draw_motion(run, view, scale, path, height=6.5, legend=_block_legend())
