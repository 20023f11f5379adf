"""Pictures of triangulated blocks: the blocks, their contacts, mechanisms, and explosions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from geometry.answer import Answer
from geometry.mesh import FloatArray
from geometry.parts.measures import chain
from geometry.polyhedra.assembly import PolyhedralAssembly
from geometry.polyhedra.near.triangle_search import overlapping_boxes
from geometry.polyhedra.overlap import SignedDistance
from validation.output.pictures.bodies import (
    EYE,
    block_legend,
    blocks,
    eye,
    turn_colours,
    with_labels,
)
from validation.output.pictures.canvas import (
    Dots,
    Lines,
    Part,
    Polygons,
    View,
)
from validation.output.pictures.gallery import Panel, gallery
from validation.output.pictures.scales import PALE, VERMILION, Scale, pressure_scale

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from validation.output.explosion import Explosion

#: Panels of an explosion, in wall thicknesses.
PANELS = (0.0, 0.25, 0.5, 1.0)


def draw_blocks(
    assembly: PolyhedralAssembly, *, title: str, weight: Sequence[float] | None = None
) -> Figure:
    """Draw the blocks where they stand."""
    free, fixed = int((~assembly.fixed).sum()), int(assembly.fixed.sum())
    view = View(blocks(assembly, turn_colours(assembly)), eye(assembly), weight=weight)
    words = f"{_count(free, 'free block')}, {fixed} fixed"
    panel = with_labels(Panel(words, view), assembly, range(assembly.n_blocks))
    return gallery([[panel]], title, height=6.5, legend=block_legend())


def _count(n: int, what: str) -> str:
    return f"{n} {what}{'' if n == 1 else 's'}"


def contact_parts(run: Answer) -> tuple[list[Part], Scale]:
    """Contact interfaces in the colours of their pressures, within the edges of the blocks."""
    interfaces = run.details.blocks.interfaces
    pressures = run.details.patch_pressures if run.details.holds else np.zeros(0)
    joints = np.arange(len(pressures))
    scale = pressure_scale("mean contact pressure [MPa]", pressures, joints)
    triangles, owner = interfaces.polygons.triangles
    colour: Any = PALE
    if scale.reached[1] > 0.0:
        colour = scale.of(pressures[interfaces.polygons.patch[owner]])
    parts = blocks(run.details.blocks, None, edges=0.35)
    if len(triangles):
        parts.append(Polygons(interfaces.polygons.corners, triangles, colour, lit=False))
    return parts, scale


def draw_polyhedra(run: Answer) -> Figure:
    """Draw the blocks, and beside them the contacts that were found."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    assembly, interfaces, result = run.details.blocks, run.details.blocks.interfaces, run.details
    contacts, scale = contact_parts(run)
    pressed = scale.reached[1] > 0.0
    legend = block_legend()
    row = chain(run.details.joints) if pressed else None
    if row is not None:
        ends = np.column_stack([np.arange(len(row) - 1), np.arange(1, len(row))])
        points = run.details.joints.points[row]
        # In front of the interfaces, which would hide it.
        nearer = np.ptp(interfaces.polygons.corners, axis=0).max() * np.array(eye(assembly))
        contacts.append(Lines(points + nearer, ends, VERMILION, width=3.0))
        legend.append(Line2D([], [], color=VERMILION, label="thrust line"))
    bare = interfaces.patch < 0
    if not pressed:
        legend.append(Patch(color=PALE, label="contact interfaces"))
    if bare.any():
        # Hundreds of large dots would hide the pressures.
        size = float(np.clip(100.0 / np.sqrt(bare.sum()), 4.0, 10.0))
        contacts.append(Dots(interfaces.centroids[bare], VERMILION, size))
        legend.append(
            Line2D(
                [], [], color=VERMILION, marker="o", linestyle="", label="edge or corner contact"
            )
        )
    weight = run.problem.gravity
    whole = View(blocks(assembly, turn_colours(assembly)), eye(assembly), weight=weight)
    words = "contact interfaces"
    if not pressed:
        words += f"\n{'no force between blocks' if result.holds else 'no forces: not carried'}"
    counts = (result.n_blocks, "free block"), (interfaces.n_contacts, "contact point")
    return gallery(
        [
            [with_labels(Panel("blocks", whole), assembly, range(assembly.n_blocks))],
            [Panel(words, View(contacts, eye(assembly), weight=weight))],
        ],
        f"{run.title}\n{', '.join(_count(*count) for count in counts)}",
        height=6.0,
        scale=scale if pressed else None,
        legend=legend,
    )


# ---------------------------------------------------------------------------------------------
# Explosions


def _inside_corners(
    assembly: PolyhedralAssembly,
    points: list[FloatArray],
    translations: FloatArray,
    tolerance: float,
) -> list[FloatArray]:
    """Corners of the triangles of each block that lie inside another, (n_triangles, 3, 3)."""
    low = np.array([p.min(axis=0) for p in points])
    high = np.array([p.max(axis=0) for p in points])
    pairs = overlapping_boxes(low, high, low, high)
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    distance = [SignedDistance(shape) for shape in assembly.shapes]
    parts = []
    for a, b in pairs.tolist():
        local = (points[a] - translations[b]) @ assembly.rotations[b]
        near = ((points[a] > low[b]) & (points[a] < high[b])).all(axis=1)
        deep = np.zeros(len(local), dtype=bool)
        deep[near] = distance[int(assembly.shape_of[b])](local[near]) < -tolerance
        triangles = assembly.shape(a).triangles
        inside = triangles[deep[triangles].all(axis=1)]
        if len(inside):
            parts.append(points[a][inside])
    return parts


def _exploded(run: Explosion, distance: float) -> View:
    """Blocks moved outward, seen through where some are in each other."""
    assembly = run.surfaces
    translations = assembly.translations + distance * run.directions
    places = [
        assembly.shape(b).points @ assembly.rotations[b].T + translations[b]
        for b in range(assembly.n_blocks)
    ]
    inside = []
    if distance > 0:
        inside = _inside_corners(assembly, places, translations, run.finite.tolerance)
    seen_through = 0.35 if inside else 1.0
    parts = blocks(assembly, turn_colours(assembly), places.__getitem__, opacity=seen_through)
    if inside:
        corners = np.concatenate(inside).reshape(-1, 3)
        triangles = np.arange(len(corners)).reshape(-1, 3)
        parts.append(Polygons(corners, triangles, VERMILION, lit=False))
    return View(parts, EYE)


def draw_explosion(run: Explosion) -> Figure:
    """Draw a strip of growing outward displacements, and the depth over the displacement."""
    from matplotlib.patches import Patch

    def depths(axes: Axes) -> None:
        x = np.concatenate([[0.0], run.finite.distances])
        y = np.concatenate([[0.0], run.finite.depths])
        axes.plot(x, y, marker="o", color=VERMILION, clip_on=False)
        axes.set_xlabel("outward displacement of every block [mm]")
        axes.set_ylabel("depth [mm]")
        axes.set_xlim(0.0, None)
        axes.set_ylim(0.0, max(1.0, 1.05 * float(run.finite.depths.max())))
        axes.spines[["top", "right"]].set_visible(False)

    distances = [part * run.thickness for part in PANELS]
    columns = [[Panel(f"{d:g} mm outward", _exploded(run, d))] for d in distances]
    columns.append([Panel("depth of the deepest overlap", plot=depths, shape=0.7)])
    verdict = "disassembles" if run.explodes else "does not disassemble"
    return gallery(
        columns,
        f"{run.name}, rigid blocks: all move outward, no load; {verdict}; first-order gap rate "
        f"{run.first.smallest_gap_rate:.3g}, free up to {run.finite.free_distance:.3g} mm",
        height=7.0,
        widest=17.0,
        legend=[
            *block_legend("end rings, released", "blocks"),
            Patch(color=VERMILION, label="surface inside another block"),
        ],
    )
