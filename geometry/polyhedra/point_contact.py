"""Contacts without area: an edge that crosses an edge, a corner or edge that stands on a face.

Layers of tetrahedra, for instance, do not interlock by their faces alone: where four of them meet,
sharp edges of diagonal neighbours cross, and only that stops the layer from sliding apart. Such a
contact has a point and a unique normal: e_m × e_s for crossing edges, the face's for a corner.
Where a corner meets an edge or a corner the normal is not unique; those contacts are left out,
which can only make a verdict more cautious: what is found locked is locked.

A corner or an edge in the interior of a face bears as a ball or a knife edge does, friction
included. At the border of the face it meets an edge, and a chamfer takes the contact away.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geometry.mesh import BoolArray, FloatArray, IntArray
from geometry.polyhedra.near.triangle_search import overlapping_boxes
from geometry.polyhedra.placed_shapes import PlacedShapes
from geometry.polyhedra.polyhedron import Polyhedron

#: Edges closer to parallel than this do not cross (sine of the angle).
_PARALLEL = 0.02
#: How far beside an edge a corner may be that stands on it, over the tolerance of contact: it lies
#: in one of the two triangles there, wherever the origin is.
_ON_EDGE = 1e-3
#: How far outside its normal cone a direction may point (round-off of file coordinates).
_CONE = 1e-4


@dataclass(frozen=True)
class PointContacts:
    """Contacts without area."""

    block_m: IntArray
    """Master block, (n,)."""
    block_s: IntArray
    """Opposing block, larger than m; (n,)."""
    points: FloatArray
    """(n, 3) [mm]."""
    normals: FloatArray
    """Unit normal from m to s, (n, 3)."""
    within: BoolArray
    """Whether a corner or an edge lies in the interior of the other block's face, (n,)."""


@dataclass(frozen=True)
class _Edges:
    """Sharp convex edges of all blocks in world coordinates."""

    block: IntArray
    start: FloatArray
    end: FloatArray
    normals: FloatArray
    """Normals of the two faces, (n, 2, 3)."""
    faces: IntArray
    """Numbers of the two faces, (n, 2)."""


def _world_edges(world: PlacedShapes) -> _Edges:
    def corners(end: int) -> FloatArray:
        def placed(shape: Polyhedron, block: int) -> FloatArray:
            return world.placed(shape.points, block)[shape.sharp_edges[0][:, end]]

        return world.of_blocks(placed)

    return _Edges(
        world.of_blocks(lambda shape, block: np.full(len(shape.sharp_edges[0]), block)),
        corners(0),
        corners(1),
        world.of_blocks(lambda shape, block: world.turned(shape.sharp_edges[1], block)),
        world.of_blocks(lambda shape, block: world.first_face[block] + shape.sharp_edges[2]),
    )


def _in_cone(direction: FloatArray, normals: FloatArray) -> BoolArray:
    """Whether directions across an edge are non-negative sums of its two face normals, (n,)."""
    a, b = normals[:, 0], normals[:, 1]
    dot = np.einsum("ni,ni->n", a, b)
    along_a = np.einsum("ni,ni->n", direction, a)
    along_b = np.einsum("ni,ni->n", direction, b)
    scale = 1.0 - dot**2
    alpha, beta = (along_a - dot * along_b) / scale, (along_b - dot * along_a) / scale
    return np.minimum(alpha, beta) >= -_CONE


def crossing_edges(world: PlacedShapes) -> PointContacts:
    """Points where sharp convex edges of two blocks cross and touch, within the tolerance."""
    edges, tolerance = _world_edges(world), world.tolerance
    low = np.minimum(edges.start, edges.end) - 0.5 * tolerance
    high = np.maximum(edges.start, edges.end) + 0.5 * tolerance
    pairs = overlapping_boxes(low, high, low, high, (edges.block, edges.block))
    m, s = pairs[edges.block[pairs[:, 0]] < edges.block[pairs[:, 1]]].T
    d_m, d_s = edges.end[m] - edges.start[m], edges.end[s] - edges.start[s]
    normal = np.cross(d_m, d_s)
    size = np.linalg.norm(normal, axis=1)
    apart = size > _PARALLEL * np.linalg.norm(d_m, axis=1) * np.linalg.norm(d_s, axis=1)
    m, s, d_m, d_s = m[apart], s[apart], d_m[apart], d_s[apart]
    normal, size = normal[apart], size[apart]
    arm = edges.start[s] - edges.start[m]
    on_m = np.einsum("ni,ni->n", np.cross(arm, d_s), normal) / size**2
    on_s = np.einsum("ni,ni->n", np.cross(arm, d_m), normal) / size**2
    normal = normal / size[:, None]
    gap = np.einsum("ni,ni->n", arm, normal)
    end_m = tolerance / np.linalg.norm(d_m, axis=1)
    end_s = tolerance / np.linalg.norm(d_s, axis=1)
    # The ends are corners: another kind of contact.
    touching = (np.abs(gap) <= tolerance) & (np.abs(on_m - 0.5) < 0.5 - end_m)
    touching &= np.abs(on_s - 0.5) < 0.5 - end_s
    forward = _in_cone(normal, edges.normals[m]) & _in_cone(-normal, edges.normals[s])
    backward = _in_cone(-normal, edges.normals[m]) & _in_cone(normal, edges.normals[s])
    kept = touching & (forward | backward)
    points = edges.start[m] + on_m[:, None] * d_m + 0.5 * gap[:, None] * normal
    normal = np.where(forward[:, None], normal, -normal)[kept]
    m, s, points = m[kept], s[kept], points[kept]
    within = _enters(world, edges, (m, s), points, normal)
    within |= _enters(world, edges, (s, m), points, normal)
    return PointContacts(edges.block[m], edges.block[s], points, normal, within)


def _enters(
    world: PlacedShapes,
    edges: _Edges,
    pair: tuple[IntArray, IntArray],
    points: FloatArray,
    normals: FloatArray,
) -> BoolArray:
    """Whether the first edge of pairs that cross lies in a face of the second block, (n,).

    The second edge is the border of that face; what crosses it in the plane of the face goes on
    inside, if it is long enough.
    """
    one, other = pair
    result = np.zeros(len(points), dtype=np.bool_)
    way, border = edges.end[one] - edges.start[one], edges.end[other] - edges.start[other]
    length = np.linalg.norm(way, axis=1)
    way = way / length[:, None]
    for side in (0, 1):
        flat = np.linalg.norm(np.cross(edges.normals[other, side], normals), axis=1) <= _CONE
        faces = edges.faces[other, side]
        # Edges run round the first of their faces to the left, round the second to the right.
        inward = np.cross(edges.normals[other, side], border) * (1.0, -1.0)[side]
        into = np.einsum("ni,ni->n", way, inward) / np.linalg.norm(border, axis=1)
        into = np.where(np.abs(into) > _PARALLEL, into, _PARALLEL)
        reach = 2.0 * world.least_widths[faces] / np.abs(into)
        end = np.where((into > 0.0)[:, None], edges.end[one], edges.start[one])
        inside = points + (np.sign(into) * reach)[:, None] * way
        long = np.linalg.norm(end - points, axis=1) >= reach
        result |= flat & long & world.within(inside, faces)
    return result


@dataclass(frozen=True)
class _Rays:
    """Unit vectors along edges between planes, from their corners, shape after shape."""

    unit: FloatArray
    first: IntArray
    """First ray of each corner, and the total."""
    base: dict[int, int]
    """Number of the first corner of each shape."""


def _rays(shapes: Sequence[Polyhedron], used: Sequence[int]) -> _Rays:
    units, corners, base, total = [], [], {}, 0
    for k in used:
        shape = shapes[k]
        ends = shape.ridges[0]
        start, end = np.concatenate([ends, ends[:, ::-1]]).T
        ray = shape.points[end] - shape.points[start]
        units.append(ray / np.linalg.norm(ray, axis=1, keepdims=True))
        corners.append(total + start)
        base[k], total = total, total + len(shape.points)
    corner = np.concatenate(corners)
    first = np.concatenate([[0], np.cumsum(np.bincount(corner, minlength=total))])
    return _Rays(np.concatenate(units)[np.argsort(corner, kind="stable")], first, base)


def standing_corners(world: PlacedShapes) -> PointContacts:
    """Corners of one block that stand inside a face of another, alone or as ends of an edge.

    Only pointed ones: every edge and face of the corner leaves the face at an angle, but for one
    edge that may lie in it.
    """
    tolerance, tri, n, t_block = world.tolerance, world.corners, world.normals, world.block
    shapes, shape_of = world.blocks.shapes, world.blocks.shape_of
    used = np.unique(shape_of).tolist()
    rays = _rays(shapes, used)
    pointed = {k: np.unique(shapes[k].sharp_edges[0]) for k in used}
    count = [len(pointed[k]) for k in shape_of]
    p_block = np.repeat(np.arange(len(count)), count)
    p_corner = np.concatenate([rays.base[k] + pointed[k] for k in shape_of])
    p = np.concatenate(
        [world.placed(shapes[k].points, block)[pointed[k]] for block, k in enumerate(shape_of)]
    )
    i, j = world.tree.pairs(p - tolerance, p + tolerance, p_block).T
    height = np.einsum("ni,ni->n", p[i] - tri[j, 0], n[j])
    near = np.abs(height) <= tolerance
    i, j, inside = i[near], j[near], np.ones(np.count_nonzero(near), dtype=bool)
    for edge in range(3):
        along = tri[j, (edge + 1) % 3] - tri[j, edge]
        along = along / np.linalg.norm(along, axis=1, keepdims=True)
        inward = np.einsum("ni,ni->n", np.cross(n[j], along), p[i] - tri[j, edge])
        inside &= inward > -_ON_EDGE * tolerance
    i, j = i[inside], j[inside]
    local = np.einsum("nji,nj->ni", world.blocks.rotations[p_block[i]], n[j])
    stands = _stand(rays, p_corner[i], local)
    i, j = i[stands], j[stands]
    swap, outward = p_block[i] > t_block[j], world.on_exact_faces(p[i], j)[1]
    # The face's normal points to the corner's block.
    return PointContacts(
        np.where(swap, t_block[j], p_block[i]),
        np.where(swap, p_block[i], t_block[j]),
        p[i],
        np.where(swap[:, None], outward, -outward),
        world.within(p[i], world.faces[j]),
    )


def _stand(rays: _Rays, corners: IntArray, normals: FloatArray) -> BoolArray:
    """Whether all rays of corners leave a plane towards its normal, but one edge in it at most.

    Where two rays lie in the plane a face does, whose corners are those of its patch.
    """
    if not len(corners):
        return np.zeros(0, dtype=bool)
    count = rays.first[corners + 1] - rays.first[corners]
    start = np.cumsum(count) - count
    mine = np.arange(count.sum()) + np.repeat(rays.first[corners] - start, count)
    rising = np.einsum("ni,ni->n", rays.unit[mine], np.repeat(normals, count, axis=0))
    flat = np.abs(rising) <= _CONE
    lowest = np.minimum.reduceat(np.where(flat, np.inf, rising), start)
    return (np.add.reduceat(flat.astype(np.int64), start) <= 1) & (lowest > _PARALLEL)
