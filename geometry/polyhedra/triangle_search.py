"""Searches among triangles: overlapping boxes, coplanar groups, edges that pierce triangles."""

from __future__ import annotations

import numpy as np

from geometry.mesh import FloatArray, IntArray
from geometry.polyhedra.triangle_kernels import flood_planes, sweep_boxes

#: Triangles belong to one plane if their normals differ by less than this [rad] …
_PLANE_ANGLE = 1e-3
#: … and their corners are this close to the plane of the largest one, in sizes of the body.
_PLANE_DISTANCE = 2e-6


def overlapping_boxes(
    low_a: FloatArray, high_a: FloatArray, low_b: FloatArray, high_b: FloatArray
) -> IntArray:
    """Pairs (i, j) of boxes a_i, b_j that overlap, sorted; (n, 2).

    A sweep along the longest direction of the scene, so the cost grows with the number of
    boxes that overlap in that direction.

    Parameters
    ----------
    low_a, high_a, low_b, high_b
        Corners of axis-parallel boxes, (n_a, 3) and (n_b, 3).
    """
    low, high = np.concatenate([low_a, low_b]), np.concatenate([high_a, high_b])
    if not len(low_a) or not len(low_b):
        return np.empty((0, 2), dtype=np.int64)
    side = np.repeat([0, 1], [len(low_a), len(low_b)])
    axis = int(np.argmax(high.max(axis=0) - low.min(axis=0)))
    order = np.argsort(low[:, axis], kind="stable")
    none = np.empty((0, 2), dtype=np.int64)
    pairs = np.empty((sweep_boxes(order, side, low, high, axis, none, False), 2), dtype=np.int64)
    sweep_boxes(order, side, low, high, axis, pairs, True)
    pairs[:, 1] -= len(low_a)
    return pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]


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
    groups: IntArray = flood_planes(
        np.argsort(-areas, kind="stable"),
        _neighbours(triangles),
        normals,
        points[triangles],
        float(np.cos(_PLANE_ANGLE)),
        distance,
    )
    return groups


def surface_edges(triangles: IntArray) -> IntArray:
    """Undirected edges of a triangulated surface, (n_edges, 2)."""
    directed = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    edges: IntArray = np.unique(np.sort(directed, axis=1), axis=0)
    return edges


def segment_piercings(
    start: FloatArray, end: FloatArray, corners: FloatArray, margin: float
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

    Returns
    -------
    IntArray
        (segment, triangle) of each piercing, (n, 2).
    FloatArray
        Position along the segment, in (0, 1); (n,).
    """
    pairs = overlapping_boxes(
        np.minimum(start, end), np.maximum(start, end), corners.min(axis=1), corners.max(axis=1)
    )
    a, b = start[pairs[:, 0]], end[pairs[:, 0]]
    p = corners[pairs[:, 1]]
    e1, e2 = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    normal = np.cross(e1, e2)
    size = np.linalg.norm(normal, axis=1)
    height_a = np.einsum("ni,ni->n", normal, a - p[:, 0]) / size
    height_b = np.einsum("ni,ni->n", normal, b - p[:, 0]) / size
    crossing = (height_a * height_b < 0) & (np.minimum(abs(height_a), abs(height_b)) > margin)
    pairs, a, b, p = pairs[crossing], a[crossing], b[crossing], p[crossing]
    e1, e2, normal = e1[crossing], e2[crossing], normal[crossing]
    position = height_a[crossing] / (height_a[crossing] - height_b[crossing])
    arm = a + position[:, None] * (b - a) - p[:, 0]
    square = np.einsum("ni,ni->n", normal, normal)
    u = np.einsum("ni,ni->n", np.cross(arm, e2), normal) / square
    v = np.einsum("ni,ni->n", np.cross(e1, arm), normal) / square
    inside = (u > 1e-6) & (v > 1e-6) & (u + v < 1 - 1e-6)
    return pairs[inside], position[inside]


def piercings(points: FloatArray, triangles: IntArray, margin: float) -> FloatArray:
    """Points where a surface's edges pierce its own triangles, (n, 3) [mm].

    Parameters
    ----------
    points, triangles
        The surface, (n_points, 3) [mm] and (n_triangles, 3).
    margin
        Crossings shallower than this are touches [mm].
    """
    edges = surface_edges(triangles)
    start, end = points[edges[:, 0]], points[edges[:, 1]]
    pairs, position = segment_piercings(start, end, points[triangles], margin)
    edge, corner = edges[pairs[:, 0]], triangles[pairs[:, 1]]
    apart = (edge[:, :, None] != corner[:, None, :]).all(axis=(1, 2))
    first, position = pairs[apart, 0], position[apart, None]
    where: FloatArray = start[first] + position * (end - start)[first]
    return where
