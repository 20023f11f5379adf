"""The explosion of a tube as a strip of growing outward displacements."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from geometry.mesh import FloatArray
from geometry.polyhedra.assembly import PolyhedralAssembly
from geometry.polyhedra.box_tree import overlapping_boxes
from geometry.polyhedra.overlap import SignedDistance
from validation.output.pictures.bodies import EYE
from validation.output.pictures.canvas import Surface, View
from validation.output.pictures.gallery import BLUE, GREY, VERMILION, Panel, gallery
from validation.output.pictures.polyhedra import polyhedra_parts
from validation.run.rigid.explosion import Explosion

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Panels of the strip, in wall thicknesses.
PANELS = (0.0, 0.25, 0.5, 1.0)


def _inside_corners(
    surfaces: PolyhedralAssembly,
    points: list[FloatArray],
    translations: FloatArray,
    tolerance: float,
) -> list[FloatArray]:
    """Corners of the triangles of each block that lie inside another, (n_triangles, 3, 3)."""
    low = np.array([p.min(axis=0) for p in points])
    high = np.array([p.max(axis=0) for p in points])
    pairs = overlapping_boxes(low, high, low, high)
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    distance = [SignedDistance(shape) for shape in surfaces.shapes]
    parts = []
    for a, b in pairs.tolist():
        local = (points[a] - translations[b]) @ surfaces.rotations[b]
        near = ((points[a] > low[b]) & (points[a] < high[b])).all(axis=1)
        deep = np.zeros(len(local), dtype=bool)
        deep[near] = distance[int(surfaces.shape_of[b])](local[near]) < -tolerance
        triangles = surfaces.shape(a).triangles
        inside = triangles[deep[triangles].all(axis=1)]
        if len(inside):
            parts.append(points[a][inside])
    return parts


def _view(run: Explosion, distance: float) -> View:
    """Blocks moved outward, seen through where some are in each other."""
    surfaces = run.surfaces
    translations = surfaces.translations + distance * run.directions
    places = [
        surfaces.shape(b).points @ surfaces.rotations[b].T + translations[b]
        for b in range(surfaces.n_blocks)
    ]
    inside = []
    if distance > 0:
        inside = _inside_corners(surfaces, places, translations, run.finite.tolerance)
    parts = polyhedra_parts(surfaces, places, opacity=0.35 if inside else 1.0)
    if inside:
        corners = np.concatenate(inside).reshape(-1, 3)
        triangles = np.arange(len(corners)).reshape(-1, 3)
        parts.append(Surface(corners, triangles, VERMILION, lit=False))
    return View(parts, EYE)


def draw_explosion(run: Explosion, path: Path) -> None:
    """Draw a strip of growing outward displacements, and the depth over the displacement."""
    from matplotlib.patches import Patch

    def depths(axes: Axes) -> None:
        x = np.concatenate([[0.0], run.finite.distances])
        y = np.concatenate([[0.0], run.finite.depths])
        axes.plot(x, y, marker="o", color=VERMILION, clip_on=False)
        axes.set_xlabel("outward displacement of every block [mm]")
        axes.set_ylabel("depth of the deepest overlap [mm]")
        axes.set_xlim(0.0, None)
        axes.set_ylim(0.0, max(1.0, 1.05 * float(run.finite.depths.max())))
        axes.spines[["top", "right"]].set_visible(False)

    distances = [part * run.thickness for part in PANELS]
    columns = [[Panel(f"{d:g} mm outward", _view(run, d))] for d in distances]
    columns.append([Panel("how deep blocks get into each other", plot=depths, shape=0.7)])
    verdict = "explodes" if run.explodes else "does not explode"
    gallery(
        columns,
        f"{run.name}: {verdict}; first-order gap rate {run.first.smallest_gap_rate:.3g}, free up "
        f"to {run.finite.free_distance:.3g} mm",
        path,
        height=7.0,
        widest=17.0,
        legend=[
            Patch(color=BLUE, label="blocks"),
            Patch(color=GREY, label="frame, released"),
            Patch(color=VERMILION, label="surface inside another block"),
        ],
    )
