"""Least translation that separates two blocks that overlap: the depth of an overlap.

Along a direction, block b is free of block a once it begins on every line where a ends. Between one
facet of a and one of b the distance to go is linear, so it is largest at a corner of what the two
facets share, seen along the direction. Directions are normals of faces and products of edges that
pierce the other block, then those of the least translation that clears the faces in the way: a
least distance problem (C. L. Lawson and R. J. Hanson, Solving Least Squares Problems, 1974, chapter
23).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from geometry.mesh import FloatArray, IntArray
from geometry.polyhedra.near.triangle_kernels import MOST_CORNERS, clip_pairs
from geometry.polyhedra.near.triangle_search import (
    boxes_of_triangles,
    enclosed,
    overlapping_boxes,
    segment_piercings,
)
from geometry.polyhedra.polyhedron import Polyhedron

#: Facets steeper than this along a direction bound nothing (cosine of the angle to their normals).
_STEEP = 1e-6
#: Directions that are begun with, edges of each block for products, and rounds of better ones with
#: how many of the shortest each round goes on from.
_MOST_DIRECTIONS, _MOST_EDGES, _ROUNDS, _BETTERED = 48, 8, 3, 8
#: Points this near to a corner are it, over the facet's size.
_CORNER = 1e-6
#: Directions are one where their cosine exceeds this.
_SAME = 1.0 - 1e-9


@dataclass(frozen=True)
class Separation:
    """Translation of b that ends an overlap."""

    distance: float
    """[mm]"""
    direction: FloatArray
    """Unit, (3,)."""
    point: FloatArray
    """In the overlap where it is longest along the direction, (3,) [mm]."""


@dataclass(frozen=True)
class _Way:
    """How far b must move along a direction, and the facets that it must clear."""

    separation: Separation
    normals: FloatArray
    """Along which b must move: of facets at corners, of two edges where these cross, (n, 3)."""
    depths: FloatArray
    """How far, (n,) [mm]."""


def separations(
    a: Polyhedron,
    b: Polyhedron,
    motion: tuple[FloatArray, FloatArray],
    *,
    least: float,
    most: float,
) -> list[Separation]:
    """Translations of b, shortest first, that clear what is in the way along their direction.

    They may lead into other parts of a: whoever takes one looks.

    Parameters
    ----------
    a, b
        Shapes that overlap.
    motion
        Rotation and translation of b relative to a.
    least, most
        Shorter overlaps are a touch; longer translations are not sought [mm].
    """
    seen = _Seen(a, b, motion, (least, most))
    ways = newest = [way for d in seen.first_directions() if (way := seen.along(d)) is not None]
    for _ in range(_ROUNDS):
        newest = [
            way
            for known in sorted(newest, key=_distance)[:_BETTERED]
            if (v := _least_translation(known.normals, known.depths)) is not None
            and (way := seen.along(v)) is not None
        ]
        ways = ways + newest
    return [way.separation for way in sorted(ways, key=_distance)]


def _distance(way: _Way) -> float:
    return way.separation.distance


def _least_translation(normals: FloatArray, depths: FloatArray) -> FloatArray | None:
    """Direction of the least v with normals (n, 3) @ v ≥ depths (n,) > 0; None where there is none.

    Lawson and Hanson's LDP by non-negative least squares.
    """
    scale = depths.max()
    matrix = np.vstack([normals.T, depths / scale])
    try:
        u, _ = nnls(matrix, np.array([0.0, 0.0, 0.0, 1.0]))
    except RuntimeError:  # too many iterations
        return None
    rest = matrix @ u - [0.0, 0.0, 0.0, 1.0]
    size = float(np.linalg.norm(rest[:3]))
    return None if size <= 1e-9 else rest[:3] / size * -np.sign(rest[3])


def spread(directions: FloatArray, most: int) -> FloatArray:
    """Different ones of unit vectors (n, 3), each the farthest from those before it."""
    chosen, nearest = [0], directions @ directions[0]
    while len(chosen) < min(most, len(directions)) and nearest.min() < _SAME:
        chosen.append(int(nearest.argmin()))
        nearest = np.maximum(nearest, directions @ directions[chosen[-1]])
    return directions[chosen]


def _freeing_normals(
    direction: FloatArray,
    at: FloatArray,
    facets: tuple[FloatArray, FloatArray],
    normals: tuple[FloatArray, FloatArray],
) -> FloatArray:
    """Normals along which pairs of facets part at points that are corners of what they share.

    Parameters
    ----------
    direction
        They are seen along it, (3,).
    at
        The points, (n, 3).
    facets
        Corners of the facets of a and of b, (n, 3, 3) each.
    normals
        Of a outward, of b inward, (n, 3) each.
    """
    flat = np.eye(3) - np.outer(direction, direction)
    near, edges = [], []
    for corners in facets:
        seen, point = corners @ flat, (at @ flat)[:, None]
        along = np.roll(seen, -1, axis=1) - seen
        square = np.maximum(np.einsum("nki,nki->nk", along, along), 1e-300)
        part = np.einsum("nki,nki->nk", point - seen, along) / square
        beside = point - seen - np.clip(part, 0.0, 1.0)[:, :, None] * along
        side = np.linalg.norm(beside, axis=2).argmin(axis=1)
        row = np.arange(len(at))
        edges.append(corners[row, (side + 1) % 3] - corners[row, side])
        size = np.sqrt(square.max(axis=1))
        near.append(np.linalg.norm(point - seen, axis=2).min(axis=1) <= _CORNER * size)
    crossing = np.cross(*edges)
    size = np.linalg.norm(crossing, axis=1, keepdims=True)
    crossing *= np.sign(crossing @ direction)[:, None] / np.maximum(size, 1e-300)
    result = np.where((size > 0.0) & ~near[0][:, None] & ~near[1][:, None], crossing, normals[0])
    return np.where((near[0] & ~near[1])[:, None], normals[1], result)


class _Seen:
    """Facets of two blocks near what they share, as directions see them."""

    def __init__(
        self,
        a: Polyhedron,
        b: Polyhedron,
        motion: tuple[FloatArray, FloatArray],
        lengths: tuple[float, float],
    ) -> None:
        self._a, self._b, (self._turn, self._shift) = a, b, motion
        self._least, most = lengths
        corners_b = b.corners @ self._turn.T + self._shift
        low, high = boxes_of_triangles(a.corners)
        pairs = overlapping_boxes(low - most, high + most, *boxes_of_triangles(corners_b))
        near_a, of_a = np.unique(pairs[:, 0], return_inverse=True)
        near_b, of_b = np.unique(pairs[:, 1], return_inverse=True)
        self._pairs = np.column_stack([of_a, len(near_a) + of_b])
        """Facet of a and facet of b that are near each other, places in what follows, (n, 2)."""
        self._corners = np.concatenate([a.corners[near_a], corners_b[near_b]])
        normals_b = b.plane_normals[b.plane_of[near_b]] @ self._turn.T
        self._normals = np.concatenate([a.plane_normals[a.plane_of[near_a]], normals_b])
        self._signs = np.repeat([1.0, -1.0], [len(near_a), len(near_b)])

    def _local(self, points: FloatArray) -> FloatArray:
        return (points - self._shift) @ self._turn

    def first_directions(self) -> FloatArray:
        """The mean normal, those of facets, products of edges that pierce; (n, 3)."""
        edges_a = self._piercing(self._a, self._b, self._local)
        edges_b = self._piercing(self._b, self._a, lambda p: p @ self._turn.T + self._shift)
        edges_b = edges_b @ self._turn.T
        products = np.cross(edges_a[:, None], edges_b[None]).reshape(-1, 3)
        products = products[np.linalg.norm(products, axis=1) > 1e-3]
        facets = self._normals * self._signs[:, None]
        pairs = facets[self._pairs]
        opposite = np.einsum("ni,ni->n", pairs[:, 0], pairs[:, 1]) > 0.5
        mean = pairs[opposite].sum(axis=(0, 1))
        every = np.concatenate([mean[None], facets, products, -products])
        every = every[np.linalg.norm(every, axis=1) > 0.0]
        if not len(every):
            return every
        every /= np.linalg.norm(every, axis=1, keepdims=True)
        return spread(every, _MOST_DIRECTIONS)

    def _piercing(
        self, one: Polyhedron, other: Polyhedron, into: Callable[[FloatArray], FloatArray]
    ) -> FloatArray:
        """Directions of ridges of a shape that pierce another one, in the frame of the first."""
        ends = one.points[one.ridges[0]]
        start, end = into(ends[:, 0]), into(ends[:, 1])
        pairs, _ = segment_piercings(start, end, other.surface)
        along = ends[np.unique(pairs[:, 0])[:_MOST_EDGES]]
        along = along[:, 1] - along[:, 0]
        return np.asarray(along / np.linalg.norm(along, axis=1, keepdims=True))

    def along(self, direction: FloatArray) -> _Way | None:
        """Look along a unit vector (3,); None where nothing of a is in the way of b."""
        corners, normals = self._corners, self._normals
        ahead = normals @ direction * self._signs > _STEEP
        pairs = self._pairs[ahead[self._pairs].all(axis=1)]
        as_seen = self._signs[:, None] * direction
        shared = np.zeros((len(pairs), MOST_CORNERS, 3))
        count, area = np.zeros(len(pairs), dtype=np.int64), np.zeros(len(pairs))
        clip_pairs(corners, as_seen, pairs, np.full(len(pairs), np.inf), shared, count, area)
        kept = (count >= 3) & (area > 0.0)
        pairs, shared, count = pairs[kept], shared[kept], count[kept]
        used = np.arange(MOST_CORNERS) < count[:, None]

        def height(points: FloatArray, facets: IntArray) -> FloatArray:
            """Distance along the direction from points (n, k, 3) to planes of facets (n,)."""
            n = normals[facets][:, None]
            arm = corners[facets][:, :1] - points
            return np.einsum("nki,nki->nk", arm, np.broadcast_to(n, arm.shape)) / (n @ direction)

        a_ends, b_begins = height(shared, pairs[:, 0]), height(shared, pairs[:, 1])
        ways = np.where(used, a_ends - b_begins, -np.inf)
        row, best = np.arange(len(pairs)), ways.argmax(axis=1)
        longest = ways[row, best]
        # A point between both, in the interior of what the facets share.
        mean = np.where(used[:, :, None], shared, 0.0).sum(axis=1) / count[:, None]
        of_mean = np.where(used, ways, 0.0).sum(axis=1) / count
        part = 0.5 * np.minimum(1.0, longest / np.maximum(longest - of_mean, 1e-300))
        at = shared[row, best] + part[:, None] * (mean - shared[row, best])
        middle = 0.5 * (height(at[:, None], pairs[:, 0]) + height(at[:, None], pairs[:, 1]))
        points = at + middle * direction
        blocks = np.flatnonzero(longest > self._least)
        blocks = blocks[enclosed(points[blocks], self._a.surface, 0.0)]
        blocks = blocks[enclosed(self._local(points[blocks]), self._b.surface, 0.0)]
        if not blocks.size:
            return None
        first = blocks[int(longest[blocks].argmax())]
        separation = Separation(float(longest[first]), direction, points[first])
        facets = corners[pairs[blocks, 0]], corners[pairs[blocks, 1]]
        ends = normals[pairs[blocks, 0]], -normals[pairs[blocks, 1]]
        free = _freeing_normals(direction, shared[blocks, best[blocks]], facets, ends)
        return _Way(separation, free, longest[blocks] * (free @ direction))
