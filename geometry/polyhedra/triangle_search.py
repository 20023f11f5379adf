"""Searches among triangles: coplanar groups, edges that pierce triangles, points inside."""

from __future__ import annotations

import numpy as np

from geometry.mesh import BoolArray, FloatArray, IntArray
from geometry.polyhedra.box_tree import BoxTree
from geometry.polyhedra.triangle_kernels import flood_planes

#: Triangles belong to one plane if their normals differ by less than this [rad] …
_PLANE_ANGLE = 1e-3
#: … and their corners are this close to the plane of the largest one, in sizes of the body.
_PLANE_DISTANCE = 2e-6
#: A direction along no edge and no face that anyone draws.
_ASKEW = np.array([0.5773, 0.6435, 0.5026])
#: Rays that pass an edge this near may be on either side of it, in sizes of the triangle.
_BESIDE = 1e-9


def distinct_rows(rows: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """First place of each distinct row, in sorted order; the number of each row's; their counts.

    As `numpy.unique` with ``axis=0`` gives them, which takes five times as long.
    """
    order = np.lexsort(rows.T[::-1])
    change = np.ones(len(rows), dtype=bool)
    change[1:] = (rows[order[1:]] != rows[order[:-1]]).any(axis=1)
    start = np.flatnonzero(change)
    inverse = np.empty(len(rows), dtype=np.int64)
    inverse[order] = np.cumsum(change) - 1
    return order[start], inverse, np.diff(np.append(start, len(rows)))


def _neighbours(triangles: IntArray) -> IntArray:
    """Triangles across the three edges, -1 where there is none, (n_triangles, 3)."""
    n = len(triangles)
    directed = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    size = int(triangles.max()) + 1
    key = directed[:, 0] * size + directed[:, 1]
    order = np.argsort(key, kind="stable")
    twin = np.searchsorted(key[order], directed[:, 1] * size + directed[:, 0])
    twin = np.minimum(twin, 3 * n - 1)
    match = key[order][twin] == directed[:, 1] * size + directed[:, 0]
    return np.where(match, order[twin] // 3, -1).reshape(n, 3)


def coplanar_groups(
    points: FloatArray, triangles: IntArray, normals: FloatArray, areas: FloatArray
) -> IntArray:
    """Number the planes of a surface: connected triangles in one plane share a number.

    Planes grow from the largest triangles and are compared with those, so a finely meshed curved
    surface does not drift into one plane.

    Parameters
    ----------
    points, triangles, normals, areas
        The surface, as in `geometry.polyhedra.polyhedron.Polyhedron`.

    Returns
    -------
    IntArray
        (n_triangles,).
    """
    distance = _PLANE_DISTANCE * float(np.linalg.norm(np.ptp(points, axis=0)))
    return flood_planes(
        np.argsort(-areas, kind="stable"),
        _neighbours(triangles),
        normals,
        points[triangles],
        float(np.cos(_PLANE_ANGLE)),
        distance,
    )


def surface_edges(triangles: IntArray) -> IntArray:
    """Undirected edges of a triangulated surface, (n_edges, 2)."""
    directed = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    ends = np.sort(directed, axis=1)
    return ends[distinct_rows(ends)[0]]


def segment_piercings(
    start: FloatArray, end: FloatArray, corners: FloatArray, margin: float, pairs: IntArray
) -> tuple[IntArray, FloatArray]:
    """Find where segments pass through triangles, properly: not along or beside an edge.

    Parameters
    ----------
    start, end
        Segments, (n_segments, 3) [mm].
    corners
        Triangles, (n_triangles, 3, 3) [mm].
    margin
        Both ends of a segment must be at least this far from the triangle's plane [mm].
    pairs
        Segments and triangles to look at, (n, 2).

    Returns
    -------
    IntArray
        (segment, triangle) of each piercing, (n, 2).
    FloatArray
        Position along the segment, in (0, 1); (n,).
    """
    of, triangle = pairs.T
    side_1, side_2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normals = np.cross(side_1, side_2)
    size = np.linalg.norm(normals, axis=1)
    height_a, height_b = (
        np.einsum("ni,ni->n", normals[triangle], ends[of] - corners[triangle, 0]) / size[triangle]
        for ends in (start, end)
    )
    crossing = (height_a * height_b < 0) & (np.minimum(abs(height_a), abs(height_b)) > margin)
    pairs, position = pairs[crossing], height_a[crossing] / (height_a - height_b)[crossing]
    if not len(pairs):
        return pairs, position
    of, triangle = pairs.T
    a, b, p, normal = start[of], end[of], corners[triangle], normals[triangle]
    e1, e2 = side_1[triangle], side_2[triangle]
    arm = a + position[:, None] * (b - a) - p[:, 0]
    square = np.einsum("ni,ni->n", normal, normal)
    u = np.einsum("ni,ni->n", np.cross(arm, e2), normal) / square
    v = np.einsum("ni,ni->n", np.cross(e1, arm), normal) / square
    inside = (u > 1e-6) & (v > 1e-6) & (u + v < 1 - 1e-6)
    return pairs[inside], position[inside]


def piercings(
    points: FloatArray, triangles: IntArray, planes: IntArray, tree: BoxTree, margin: float
) -> FloatArray:
    """Points where a closed surface's edges pierce its own triangles, (n, 3) [mm].

    Parameters
    ----------
    points, triangles
        The surface, (n_points, 3) [mm] and (n_triangles, 3).
    planes
        Of `coplanar_groups`, (n_triangles,): an edge inside a plane pierces nothing of it.
    tree
        Of the triangles, planes as groups.
    margin
        Crossings shallower than this are touches [mm].
    """
    directed = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    ends = np.sort(directed, axis=1)
    first, edge_of, _ = distinct_rows(ends)
    plane = np.repeat(planes, 3)
    between = np.zeros(len(first), dtype=bool)
    between[edge_of[plane != plane[first][edge_of]]] = True
    edges = ends[first]
    start, end = points[edges[:, 0]], points[edges[:, 1]]
    own_plane = np.where(between, -1, plane[first])
    pairs = tree.pairs(np.minimum(start, end), np.maximum(start, end), own_plane)
    edge, corner = edges[pairs[:, 0]], triangles[pairs[:, 1]]
    apart = np.ones(len(pairs), dtype=bool)
    for e in range(2):
        for c in range(3):
            apart &= edge[:, e] != corner[:, c]
    pairs, position = segment_piercings(start, end, points[triangles], margin, pairs[apart])
    first = pairs[:, 0]
    return start[first] + position[:, None] * (end - start)[first]


def enclosed(points: FloatArray, corners: FloatArray, tree: BoxTree, margin: float) -> BoolArray:
    """Whether points may lie deeper than a margin inside a closed surface, (n,).

    No point that deep is left out. Where blocks touch most points lie on the other's surface: a
    point that deep is inside still where it is moved by the margin, this way or that, and one on
    the surface is so one way at most.

    Parameters
    ----------
    points
        (n, 3) [mm].
    corners, tree
        Of the surface, (n_triangles, 3, 3) [mm], in the same frame.
    margin
        [mm]
    """
    inside = np.ones(len(points), dtype=bool)
    for way in (margin, -margin):
        rest = np.flatnonzero(inside)
        inside[rest] = _wound_round(points[rest] + way * _ASKEW, corners, tree)
    return inside


def _wound_round(points: FloatArray, corners: FloatArray, tree: BoxTree) -> BoolArray:
    """Whether a surface has more triangles above points that face up than down, (n,).

    True as well where the ray upward passes so near an edge that nobody can tell.
    """
    above = points.copy()
    above[:, 2] = np.inf
    point, triangle = tree.pairs(points, above).T
    arm = corners[triangle] - points[point, None]
    x, y = arm[:, :, 0], arm[:, :, 1]
    # Twice the areas, seen from above, that the ray makes with the sides opposite each corner.
    area = x[:, [1, 2, 0]] * y[:, [2, 0, 1]] - x[:, [2, 0, 1]] * y[:, [1, 2, 0]]
    total = area.sum(axis=1)
    up = np.sign(total)
    height = np.einsum("nk,nk->n", area, arm[:, :, 2]) * up
    least = (area * up[:, None]).min(axis=1)
    size = np.abs(arm[:, :, :2]).max(axis=(1, 2)) ** 2
    beside = np.abs(least) <= _BESIDE * size
    turns = np.where((least > 0.0) & (height > 0.0), up, 0.0)
    wound = np.bincount(point, weights=turns, minlength=len(points)) > 0.5
    wound[point[beside]] = True
    return wound
