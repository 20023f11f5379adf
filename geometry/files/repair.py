"""What can be mended in a surface without guessing its shape, and what was changed.

Triangles that are there twice are dropped, those turned against their neighbours are turned back,
and flat holes are closed. Nothing else: cuts through itself need whoever drew it.
"""

from __future__ import annotations

import numpy as np

from geometry.files.vtu import as_surface
from geometry.mesh import FloatArray, IntArray
from geometry.polyhedra.near.triangle_search import directed_edges, distinct_rows, undirected_edges

#: Largest distance of a hole's corners from its plane, in sizes of the hole.
_FLAT = 1e-3


def repaired(
    points: FloatArray, triangles: IntArray
) -> tuple[FloatArray, IntArray, tuple[str, ...]]:
    """Mend one surface.

    Parameters
    ----------
    points, triangles
        Coinciding points merged, (n_points, 3) and (n_triangles, 3).

    Returns
    -------
    FloatArray
        The points, and middles of holes that were closed.
    IntArray
        Triangles that are each there once, turned alike, without flat holes.
    tuple[str, ...]
        What was changed.
    """
    changes = []
    once, _, _ = distinct_rows(np.sort(triangles, axis=1))
    if len(once) < len(triangles):
        changes.append(f"{len(triangles) - len(once)} triangles that were there twice dropped")
        triangles = triangles[np.sort(once)]
    alike = turned_alike(triangles)
    turned = int((alike != triangles).any(axis=1).sum())
    if turned:
        changes.append(f"{min(turned, len(triangles) - turned)} triangles turned")
    points, closed, holes = _without_holes(points, alike)
    if holes:
        changes.append(f"{holes} flat hole{'s' if holes > 1 else ''} closed")
    return points, closed, tuple(changes)


def turned_alike(triangles: IntArray) -> IntArray:
    """Turn the triangles of each connected surface all as its first one, (n_triangles, 3) (VTK).

    Neighbours are found across edges of two triangles; at others the surface may part.
    """
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkFiltersCore import vtkPolyDataNormals

    if not len(triangles):
        return triangles
    # VTK turns cells on the way to their normals, for which any points do.
    turn = vtkPolyDataNormals()
    turn.SetInputData(as_surface(np.zeros((int(triangles.max()) + 1, 3)), triangles))
    turn.SplittingOff()
    turn.NonManifoldTraversalOff()
    turn.ComputePointNormalsOff()
    turn.ComputeCellNormalsOn()
    turn.Update()
    corners = vtk_to_numpy(turn.GetOutput().GetPolys().GetConnectivityArray())
    return corners.reshape(-1, 3).astype(np.int64)


def _without_holes(points: FloatArray, triangles: IntArray) -> tuple[FloatArray, IntArray, int]:
    """Close holes whose edge is one flat loop by triangles round its middle; how many were."""
    _, edge, count = undirected_edges(triangles)
    once = directed_edges(triangles)[count[edge] == 1]
    follows = {int(end): int(start) for start, end in once}
    filled = [triangles]
    middles: list[FloatArray] = []
    while follows:
        loop = [min(follows)]
        while loop[-1] in follows:
            loop.append(follows.pop(loop[-1]))
        if loop[0] != loop[-1] or len(loop) < 4:
            continue
        corners = points[loop[:-1]]
        arms = corners - corners.mean(axis=0)
        _, extent, _ = np.linalg.svd(arms)
        # A slit, where a corner lies on an edge of a neighbour, has no area to close.
        if extent[2] <= _FLAT * extent[0] < extent[1]:
            middle = np.full(len(loop) - 1, len(points) + len(middles))
            middles.append(corners.mean(axis=0))
            filled.append(np.column_stack([loop[:-1], loop[1:], middle]))
    if not middles:
        return points, triangles, 0
    return np.concatenate([points, middles]), np.concatenate(filled), len(middles)
