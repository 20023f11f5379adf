"""Searches among triangles: overlapping boxes, coplanar groups, edges that pierce triangles."""

from __future__ import annotations

import numpy as np

from geometry.mesh import FloatArray, IntArray
from geometry.polyhedra.triangle_kernels import boxes_in_tree, flood_planes

#: Triangles belong to one plane if their normals differ by less than this [rad] …
_PLANE_ANGLE = 1e-3
#: … and their corners are this close to the plane of the largest one, in sizes of the body.
_PLANE_DISTANCE = 2e-6


def overlapping_boxes(
    low_a: FloatArray,
    high_a: FloatArray,
    low_b: FloatArray,
    high_b: FloatArray,
    groups: tuple[IntArray, IntArray] | None = None,
) -> IntArray:
    """Pairs (i, j) of boxes a_i, b_j that overlap, sorted; (n, 2).

    A tree of boxes along a space-filling curve: the cost grows with the number of pairs, and with
    that of the boxes times its logarithm.

    Parameters
    ----------
    low_a, high_a, low_b, high_b
        Corners of axis-parallel boxes, (n_a, 3) and (n_b, 3).
    groups
        What each box belongs to, (n_a,) and (n_b,): boxes of one group are no pair. Negative:
        to none.
    """
    if not len(low_a) or not len(low_b):
        return np.empty((0, 2), dtype=np.int64)
    of_a = np.full(len(low_a), -1) if groups is None else groups[0].astype(np.int64)
    of_b = np.full(len(low_b), -1) if groups is None else groups[1].astype(np.int64)
    tree = (*_box_tree(low_b, high_b, of_b),)
    pairs = np.empty((4 * (len(low_a) + len(low_b)), 2), dtype=np.int64)
    found = boxes_in_tree(low_a, high_a, of_a, *tree, pairs)
    if found > len(pairs):
        pairs = np.empty((found, 2), dtype=np.int64)
        boxes_in_tree(low_a, high_a, of_a, *tree, pairs)
    return pairs[:found]


def boxes_of_triangles(corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lower and upper corners of the boxes round triangles (n, 3, 3): (n, 3) each."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    return np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)


def _box_tree(
    low: FloatArray, high: FloatArray, group: IntArray
) -> tuple[FloatArray, FloatArray, IntArray, IntArray]:
    """Boxes and groups of a binary tree's nodes, from the root down, and the box of each leaf."""
    order = _along_curve(0.5 * (low + high))
    n = 1 << max(len(order) - 1, 0).bit_length()
    tree_low, tree_high = np.full((2 * n - 1, 3), np.inf), np.full((2 * n - 1, 3), -np.inf)
    tree_group = np.full(2 * n - 1, -1)
    leaves = slice(n - 1, n - 1 + len(order))
    tree_low[leaves], tree_high[leaves], tree_group[leaves] = low[order], high[order], group[order]
    while n > 1:
        below, here = slice(n - 1, 2 * n - 1), slice(n // 2 - 1, n - 1)
        tree_low[here] = np.minimum(tree_low[below][0::2], tree_low[below][1::2])
        tree_high[here] = np.maximum(tree_high[below][0::2], tree_high[below][1::2])
        left, right = tree_group[below][0::2], tree_group[below][1::2]
        tree_group[here] = np.where(left == right, left, -1)
        n //= 2
    return tree_low, tree_high, tree_group, order


def _along_curve(points: FloatArray) -> IntArray:
    """Order of points along a Morton curve: what is near in it is mostly near in space."""
    low = points.min(axis=0)
    size = float((points.max(axis=0) - low).max())
    cells = ((points - low) * (1023.0 / size if size > 0.0 else 0.0)).astype(np.int64)
    code = np.zeros(len(points), dtype=np.int64)
    for bit in range(10):
        for axis in range(3):
            code |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    return np.argsort(code, kind="stable")


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
    start: FloatArray,
    end: FloatArray,
    corners: FloatArray,
    margin: float,
    pairs: IntArray | None = None,
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
        Segments and triangles to look at, (n, 2); None: all whose boxes overlap.

    Returns
    -------
    IntArray
        (segment, triangle) of each piercing, (n, 2).
    FloatArray
        Position along the segment, in (0, 1); (n,).
    """
    if pairs is None:
        pairs = _near(start, end, corners, None)
    side_1, side_2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normals = np.cross(side_1, side_2)
    size = np.linalg.norm(normals, axis=1)
    of, triangle = pairs.T
    height_a, height_b = (
        np.einsum("ni,ni->n", normals[triangle], ends[of] - corners[triangle, 0]) / size[triangle]
        for ends in (start, end)
    )
    crossing = (height_a * height_b < 0) & (np.minimum(abs(height_a), abs(height_b)) > margin)
    pairs, position = pairs[crossing], height_a[crossing] / (height_a - height_b)[crossing]
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
    points: FloatArray, triangles: IntArray, planes: IntArray, margin: float
) -> FloatArray:
    """Points where a closed surface's edges pierce its own triangles, (n, 3) [mm].

    Parameters
    ----------
    points, triangles
        The surface, (n_points, 3) [mm] and (n_triangles, 3).
    planes
        Of `coplanar_groups`, (n_triangles,): an edge inside a plane pierces nothing of it.
    margin
        Crossings shallower than this are touches [mm].
    """
    directed = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    ends = np.sort(directed, axis=1)
    first, edge_of, _ = distinct_rows(ends)
    plane = np.repeat(planes, 3)
    between = np.zeros(len(first), dtype=bool)
    between[edge_of[plane != plane[first][edge_of]]] = True
    edges, corners = ends[first], points[triangles]
    start, end = points[edges[:, 0]], points[edges[:, 1]]
    pairs = _near(start, end, corners, (np.where(between, -1, plane[first]), planes))
    edge, corner = edges[pairs[:, 0]], triangles[pairs[:, 1]]
    apart = np.ones(len(pairs), dtype=bool)
    for e in range(2):
        for c in range(3):
            apart &= edge[:, e] != corner[:, c]
    pairs, position = segment_piercings(start, end, corners, margin, pairs[apart])
    first = pairs[:, 0]
    return start[first] + position[:, None] * (end - start)[first]


def _near(
    start: FloatArray,
    end: FloatArray,
    corners: FloatArray,
    groups: tuple[IntArray, IntArray] | None,
) -> IntArray:
    """Pairs of a segment and a triangle whose boxes overlap, (n, 2)."""
    return overlapping_boxes(
        np.minimum(start, end), np.maximum(start, end), *boxes_of_triangles(corners), groups
    )
