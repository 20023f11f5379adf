"""Searches among boxes, and among triangles: coplanar groups, edges that pierce, points inside."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geometry.mesh import BoolArray, FloatArray, IntArray, along_curve, connected_parts
from geometry.polyhedra.near.triangle_kernels import (
    DEEPEST,
    boxes_in_tree,
    enclosed_points,
    flood_planes,
    segments_in_tree,
)

#: Pairs that there is room for at first, for each box.
_ROOM = 16


@dataclass(frozen=True)
class BoxTree:
    """Axis-parallel boxes in a binary tree; node k has the children 2k + 1 and 2k + 2.

    A search costs as much as it finds, and the logarithm of the number of boxes.
    """

    boxes: FloatArray
    """Lower and upper corner of each node's box, empty where it has none, (n_nodes, 6)."""
    group: IntArray
    """What all boxes below a node belong to, -1 where they differ or belong to none; (n_nodes,)."""
    order: IntArray
    """Number of the box at each leaf, (n,)."""

    @classmethod
    def of(cls, low: FloatArray, high: FloatArray, group: IntArray | None = None) -> BoxTree:
        """Make a tree of the boxes between two corners, (n, 3) each; groups as in `pairs`."""
        order = along_curve(0.5 * (low + high))
        n = 1 << (len(order) - 1).bit_length()
        boxes, groups = np.full((2 * n - 1, 6), np.inf), np.full(2 * n - 1, -1)
        boxes[:, 3:] = -np.inf
        leaves = slice(n - 1, n - 1 + len(order))
        boxes[leaves, :3], boxes[leaves, 3:] = low[order], high[order]
        if group is not None:
            groups[leaves] = group[order]
        while n > 1:
            below, here = slice(n - 1, 2 * n - 1), slice(n // 2 - 1, n - 1)
            left, right = boxes[below][0::2], boxes[below][1::2]
            np.minimum(left[:, :3], right[:, :3], out=boxes[here, :3])
            np.maximum(left[:, 3:], right[:, 3:], out=boxes[here, 3:])
            if group is not None:
                one, other = groups[below][0::2], groups[below][1::2]
                groups[here] = np.where(one == other, one, -1)
            n //= 2
        return cls(boxes, groups, order)

    def pairs(self, low: FloatArray, high: FloatArray, group: IntArray | None = None) -> IntArray:
        """Pairs (i, j) of a box between two corners (n, 3) and one of the tree that overlap.

        Sorted; (n_pairs, 2). Boxes of one group (n,) are no pair; negative: of none.
        """
        requested = np.hstack([low, high])
        of = np.full(len(low), -1) if group is None else group.astype(np.int64)
        stack = np.empty(DEEPEST, dtype=np.int64)
        pairs = np.empty((_ROOM * len(low), 2), dtype=np.int64)
        count = boxes_in_tree(requested, of, self.boxes, self.group, self.order, stack, pairs)
        if count > len(pairs):
            pairs = np.empty((count, 2), dtype=np.int64)
            boxes_in_tree(requested, of, self.boxes, self.group, self.order, stack, pairs)
        return pairs[:count]


def overlapping_boxes(
    low_a: FloatArray,
    high_a: FloatArray,
    low_b: FloatArray,
    high_b: FloatArray,
    groups: tuple[IntArray, IntArray] | None = None,
) -> IntArray:
    """Pairs (i, j) of boxes a_i, b_j that overlap, sorted; (n, 2).

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
    of_a, of_b = groups or (None, None)
    return BoxTree.of(low_b, high_b, of_b).pairs(low_a, high_a, of_a)


def boxes_of_triangles(corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lower and upper corners of the boxes round triangles (n, 3, 3): (n, 3) each."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    return np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)


#: Triangles belong to one plane if their normals differ by less than this [rad] …
_PLANE_ANGLE = 1e-3
#: … and their corners are this close to the plane of the largest one, in sizes of the body.
_PLANE_DISTANCE = 2e-6
#: Directions no longer than 1, square to each other, along no edge and no face that anyone draws.
ASKEW = np.array([[0.577, 0.643, 0.502], [-0.744, 0.652, 0.024], [0.311, 0.387, -0.867]])


def distinct_rows(rows: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """First place of each distinct row, in sorted order; the number of each row's; their counts.

    As `numpy.unique` with ``axis=0`` gives them, which takes five times as long.
    """
    size, digits = int(rows.max(initial=0)) + 1, np.arange(rows.shape[1])[::-1]
    if rows.min(initial=0) >= 0 and size ** len(digits) < 2**63:
        keys = rows @ size**digits  # one number sorts in half the time
        order = np.argsort(keys, kind="stable")
        ordered = keys[order]
        change = ordered[1:] != ordered[:-1]
    else:
        order = np.lexsort(rows.T[::-1])
        ordered = rows[order]
        change = (ordered[1:] != ordered[:-1]).any(axis=1)
    start = np.concatenate([[0], np.flatnonzero(change) + 1])[: len(rows)]
    count = np.diff(start, append=len(rows))
    inverse = np.empty(len(rows), dtype=np.int64)
    inverse[order] = np.repeat(np.arange(len(start)), count)
    return order[start], inverse, count


def _neighbours(triangles: IntArray) -> tuple[IntArray, bool]:
    """Triangles across the three edges, -1 where there is none, (n_triangles, 3).

    And whether each edge joins two triangles, turned alike: a plain closed surface.
    """
    n = len(triangles)
    start, end = triangles, triangles[:, [1, 2, 0]]
    size = int(triangles.max(initial=0)) + 1
    key = (start * size + end).ravel()
    order = np.argsort(key, kind="stable")
    ordered, opposite = key[order], (end * size + start).ravel()
    twin = np.minimum(np.searchsorted(ordered, opposite), 3 * n - 1)
    match = ordered[twin] == opposite
    plain = n > 0 and bool(match.all() and (ordered[1:] != ordered[:-1]).all())
    return np.where(match, order[twin] // 3, -1).reshape(n, 3), plain


def ridges(triangles: IntArray, plane_of: IntArray) -> tuple[IntArray, IntArray]:
    """Edges between two planes, (n, 2) as the first of two triangles has them, and those (n, 2).

    Edges of more than two triangles (solids that touch themselves) have no single wedge.
    """
    across, plain = _neighbours(triangles)
    one, side = np.nonzero(np.arange(len(across))[:, None] < across)
    two = across[one, side]
    between = plane_of[one] != plane_of[two]
    one, side, two = one[between], side[between], two[between]
    ends = np.column_stack([triangles[one, side], triangles[one, (side + 1) % 3]])
    if not plain:
        every = np.sort(directed_edges(triangles), axis=1)
        _, edge, count = distinct_rows(np.concatenate([np.sort(ends, axis=1), every]))
        count -= np.bincount(edge[: len(ends)], minlength=len(count))
        single = count[edge[: len(ends)]] == 2
        ends, one, two = ends[single], one[single], two[single]
    return ends, np.column_stack([one, two])


def joined(triangles: IntArray) -> IntArray | None:
    """Pairs of triangles that share an edge, (n_edges, 2), of a plain closed surface; else None."""
    across, plain = _neighbours(triangles)
    if not plain:
        return None
    one, side = np.nonzero(np.arange(len(across))[:, None] < across)
    return np.column_stack([one, across[one, side]])


def in_one_piece(triangles: IntArray) -> bool:
    """Whether triangles bound one plain closed surface: edges join two each, and all of them."""
    across, plain = _neighbours(triangles)
    if not plain:
        return False
    nowhere = np.zeros((len(triangles), 3))  # all lie in this plane
    order, corners = np.arange(len(triangles)), np.zeros((len(triangles), 3, 3))
    return int(flood_planes(order, across, nowhere, corners, -1.0, np.inf).max()) == 0


def coplanar_groups(
    points: FloatArray, triangles: IntArray, normals: FloatArray, areas: FloatArray
) -> IntArray:
    """Number the planes of a surface: connected triangles in one plane share a number.

    Planes grow from the largest triangles and are compared with those, so a finely meshed curved
    surface does not drift into one plane. Numbers follow their centroids along an askew direction:
    they do not depend on the triangles that planes are cut into.

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
    corners = points[triangles]
    group = flood_planes(
        np.argsort(-areas, kind="stable"),
        _neighbours(triangles)[0],
        normals,
        corners,
        float(np.cos(_PLANE_ANGLE)),
        distance,
    )
    weights = np.maximum(areas, np.finfo(np.float64).tiny)
    along = np.bincount(group, weights * (corners.mean(axis=1) @ ASKEW[0]))
    rank = np.empty(len(along), dtype=np.int64)
    rank[np.argsort(along / np.bincount(group, weights), kind="stable")] = np.arange(len(along))
    return rank[group]


def smooth_groups(triangles: IntArray, normals: FloatArray, angle: float) -> IntArray:
    """Number the faces of a surface: triangles joined by edges no sharper than ``angle`` [rad].

    Flat or curved, whatever triangles they are cut into; (n_triangles,).
    """
    across = _neighbours(triangles)[0]
    one, side = np.nonzero(np.arange(len(across))[:, None] < across)
    two = across[one, side]
    blunt = np.einsum("ni,ni->n", normals[one], normals[two]) > np.cos(angle)
    return connected_parts(len(triangles), one[blunt], two[blunt])


def directed_edges(triangles: IntArray) -> IntArray:
    """Sides of triangles as each has them, one triangle after the other, (3 n_triangles, 2)."""
    return triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)


def undirected_edges(triangles: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """Edges (n_edges, 2), the one of each of `directed_edges`, and how many of those it is."""
    ends = np.sort(directed_edges(triangles), axis=1)
    first, edge_of, count = distinct_rows(ends)
    return ends[first], edge_of, count


def grouped_edges(triangles: IntArray, group: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """Edges, the one of each side, and the group of triangles that each is in; -1 between two."""
    edges, edge_of, _ = undirected_edges(triangles)
    of_side, own = np.repeat(group, 3), np.empty(len(edges), dtype=np.int64)
    own[edge_of] = of_side
    own[edge_of[of_side != own[edge_of]]] = -1
    return edges, edge_of, own


@dataclass(frozen=True)
class Surface:
    """Triangles ready to be searched."""

    triangles: IntArray
    """Corners, (n_triangles, 3)."""
    corners: FloatArray
    """(n_triangles, 3, 3) [mm]"""
    area_vectors: FloatArray
    """(n_triangles, 3) [mm²]"""
    tree: BoxTree
    """Of the triangles, planes as groups."""


def segment_piercings(
    start: FloatArray,
    end: FloatArray,
    surface: Surface,
    margin: float = 0.0,
    own: tuple[IntArray, IntArray] | None = None,
) -> tuple[IntArray, FloatArray]:
    """Find where segments pass through triangles, properly: not along or beside an edge.

    Parameters
    ----------
    start, end
        Segments, (n_segments, 3) [mm].
    surface
        The triangles, in the same frame.
    margin
        Both ends of a segment must be at least this far from the triangle's plane [mm].
    own
        Corners (n_segments, 2) and planes (n_segments,) that segments share with the surface, -1
        for none: what has one of these is not pierced.

    Returns
    -------
    IntArray
        (segment, triangle) of each piercing, (n, 2), sorted.
    FloatArray
        Position along the segment, in (0, 1); (n,).
    """
    n, room, tree = len(start), len(start), surface.tree
    ends, plane = own or (np.full((n, 2), -1), np.full(n, -1))
    while True:
        pairs, at = np.empty((room, 2), dtype=np.int64), np.empty(room)
        result = segments_in_tree(
            *(start, end, ends, plane, surface.corners, surface.area_vectors, surface.triangles),
            *(tree.boxes, tree.group, tree.order, margin, pairs, at),
        )
        if result <= room:
            order = np.lexsort(pairs[:result].T[::-1])
            return pairs[order], at[order]
        room = result


def piercings(points: FloatArray, surface: Surface, planes: IntArray, margin: float) -> FloatArray:
    """Points where a closed surface's edges pierce its own triangles, (n, 3) [mm].

    Parameters
    ----------
    points, surface
        (n_points, 3) [mm], and the triangles between them.
    planes
        Of `coplanar_groups`, (n_triangles,): an edge inside a plane pierces nothing of it.
    margin
        Crossings shallower than this are touches [mm].
    """
    edges, _, own_plane = grouped_edges(surface.triangles, planes)
    start, end = points[edges].swapaxes(0, 1)
    pairs, position = segment_piercings(start, end, surface, margin, (edges, own_plane))
    first = pairs[:, 0]
    return start[first] + position[:, None] * (end - start)[first]


def enclosed(points: FloatArray, surface: Surface, margin: float, ways: int = 6) -> BoolArray:
    """Whether points may lie deeper than a margin inside a closed surface, (n,).

    No point that deep is left out: it is inside still where it is moved by the margin, whichever
    way. Where blocks touch most points lie on the other's surface, and one way leads out of it.

    Parameters
    ----------
    points
        (n, 3) [mm].
    surface
        The triangles, in the same frame.
    margin
        [mm]
    ways
        How many are looked at: one sorts out most points outside, in a sixth of the time.
    """
    inside, stack = np.empty(len(points), dtype=bool), np.empty(DEEPEST, dtype=np.int64)
    tree, shifts = surface.tree, margin * np.concatenate([ASKEW, -ASKEW])[:ways]
    of_tree = tree.boxes, tree.group, tree.order
    enclosed_points(points, shifts, surface.corners, *of_tree, stack, inside)
    return inside
