"""Conforming interfaces: facets of two blocks that coincide, corner on corner.

Blocks are copies of few shapes, and tubes place the same two shapes beside each other in the same
way again and again: each way is searched once, and turned to wherever it occurs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import product

import numpy as np

from geometry.block import Block
from geometry.mesh import BoolArray, FloatArray, IntArray, ReadOnlyArrays
from geometry.parts.placed import AnyBlocks, PlacedBlocks

#: Coincidence tolerance relative to the smallest facet's size.
_RELATIVE_TOLERANCE = 1e-5
#: Relative placements that differ by less (of rotations; of translations in block sizes) are one …
SAME_PLACEMENT = 1e-9
#: … and, in sizes of the assembly, where blocks that should be apart are looked for.
ROUGHLY_SAME = 1e-7


@dataclass(frozen=True)
class Interfaces(ReadOnlyArrays):
    """Matched facet pairs as arrays, sorted by block pair (m, s), m < s."""

    block_m: IntArray
    """Master block, (n_contacts,)."""
    block_s: IntArray
    """Opposing block, (n_contacts,)."""
    quads_m: IntArray
    """Corner nodes in the mesh of block m, counter-clockwise seen from outside m; (n, 4)."""
    quads_s: IntArray
    """Nodes of block s that coincide with `quads_m`, corner by corner; (n, 4)."""
    facet_m: IntArray
    """Position of the facet in block m's `contact_quads`, (n_contacts,)."""
    facet_s: IntArray
    """Position of the facet in block s's `contact_quads`, (n_contacts,)."""
    centroids: FloatArray
    """Facet centroid in world coordinates, (n_contacts, 3) [mm]."""
    normals: FloatArray
    """Unit normal from block m to block s, (n_contacts, 3)."""
    areas: FloatArray
    """Facet area, (n_contacts,) [mm²]."""
    pair_start: IntArray
    """First contact of each block pair, and the total at the end; (n_pairs + 1,)."""
    pair_class: IntArray
    """Pairs of one number are congruent: their contacts, in the order of this list, are the same
    seen from block m; (n_pairs,)."""
    pair_rotations: FloatArray
    """Rotation of block m of each pair, (n_pairs, 3, 3)."""

    @property
    def n_contacts(self) -> int:
        """Number of matched facet pairs."""
        return len(self.block_m)

    @property
    def n_pairs(self) -> int:
        """Number of block pairs that touch."""
        return len(self.pair_start) - 1

    def some(self, pairs: BoolArray) -> Interfaces:
        """Those of some pairs of blocks, (n_pairs,), alone."""
        count = np.diff(self.pair_start)
        kept = np.repeat(pairs, count)
        of_pairs = ("pair_start", "pair_class", "pair_rotations")
        names = [field.name for field in fields(self) if field.name not in of_pairs]
        return Interfaces(
            **{name: getattr(self, name)[kept] for name in names},
            pair_start=np.concatenate([[0], np.cumsum(count[pairs])]),
            pair_class=self.pair_class[pairs],
            pair_rotations=self.pair_rotations[pairs],
        )


@dataclass(frozen=True)
class _Facets:
    """Contact facets of one shape in its own frame, and where they lie."""

    quads: IntArray
    corners: FloatArray
    centroids: FloatArray
    centre: FloatArray
    radius: float

    @property
    def smallest(self) -> float:
        """Shortest diagonal."""
        diagonal = self.corners[:, 2] - self.corners[:, 0]
        return float(np.linalg.norm(diagonal, axis=1).min(initial=np.inf))


def _facets(shape: Block) -> _Facets:
    quads = shape.contact_quads
    corners = shape.mesh.nodes[quads]
    centroids = corners.mean(axis=1)
    ends = corners.reshape(-1, 3) if len(quads) else np.zeros((1, 3))
    centre = 0.5 * (ends.min(axis=0) + ends.max(axis=0))
    radius = float(np.linalg.norm(ends - centre, axis=1).max())
    return _Facets(quads, corners, centroids, centre, radius)


@dataclass(frozen=True)
class Placement:
    """Two shapes beside each other: s placed in the frame of m, and the pairs where that occurs."""

    shape_m: int
    shape_s: int
    rotation: FloatArray
    translation: FloatArray
    pairs: IntArray


@dataclass(frozen=True)
class _Match:
    """Facets of one placement that coincide, in the order of m's facets."""

    facet_m: IntArray
    facet_s: IntArray
    order_s: IntArray
    """Order of s's corners that meets m's, (n, 4)."""


def _near_pairs(facets: Sequence[_Facets], blocks: AnyBlocks) -> IntArray:
    """Pairs (m, s), m < s, of blocks whose bounding spheres meet, sorted; (n, 2)."""
    centre = blocks.place_each(np.array([f.centre for f in facets]))
    radius = np.array([f.radius for f in facets])[blocks.shape_of]
    reach = 2.0 * float(radius.max(initial=0.0)) * (1 + 1e-9)
    pairs = pairs_within(centre, reach)
    apart = np.linalg.norm(centre[pairs[:, 0]] - centre[pairs[:, 1]], axis=1)
    pairs = pairs[apart <= (radius[pairs[:, 0]] + radius[pairs[:, 1]]) * (1 + 1e-9)]
    return pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]


def placements(
    pairs: IntArray, blocks: AnyBlocks, *, size: float, same: float = SAME_PLACEMENT
) -> list[Placement]:
    """Distinct ways in which the blocks of pairs (m, s), (n, 2), lie beside each other.

    Placements are one where rotations, and translations over the size [mm], differ by less than
    ``same``.
    """
    if not len(pairs) or size == 0.0:  # no block has a face that can meet another one
        return []
    m, s = pairs.T
    shape_of, back = blocks.shape_of, blocks.rotations[m].transpose(0, 2, 1)
    turn = back @ blocks.rotations[s]
    move = np.einsum("pij,pj->pi", back, blocks.translations[s] - blocks.translations[m])
    rounded = np.column_stack([turn.reshape(-1, 9), move / size]) / same
    key = np.column_stack([shape_of[m], shape_of[s], np.rint(rounded).astype(np.int64)])
    _, first, member = np.unique(key, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(member.ravel(), kind="stable")
    groups = np.split(order, np.cumsum(np.bincount(member.ravel()))[:-1])
    return [
        Placement(int(shape_of[m[i]]), int(shape_of[s[i]]), turn[i], move[i], group)
        for i, group in zip(first.tolist(), groups, strict=True)
    ]


def _align_corners(corners_m: FloatArray, corners_s: FloatArray) -> tuple[IntArray, FloatArray]:
    """Order of s's corners that meets m's, (n, 4), and the largest distance left, (n,)."""
    orders = np.array([[(k - i) % 4 for i in range(4)] for k in range(4)])
    distance = np.array(
        [np.linalg.norm(corners_s[:, order] - corners_m, axis=2).max(axis=1) for order in orders]
    )
    best = distance.argmin(axis=0)
    return orders[best], distance[best, np.arange(len(best))]


def _match(m: _Facets, s: _Facets, placement: Placement, tolerance: float) -> _Match:
    """Find the facets of s, placed, that coincide with facets of m."""
    if not len(s.quads):
        none = np.zeros(0, dtype=np.int64)
        return _Match(none, none, np.zeros((0, 4), dtype=np.int64))
    # Facets of m in the frame of s; only those inside the box of s's can meet one.
    there = (m.centroids - placement.translation) @ placement.rotation
    low, high = s.centroids.min(axis=0) - tolerance, s.centroids.max(axis=0) + tolerance
    near = np.flatnonzero(((there >= low) & (there <= high)).all(axis=1))
    result = coincident(there[near], s.centroids, tolerance)
    met = result < len(s.quads)
    facet_m, facet_s = near[met], result[met]
    placed = s.corners[facet_s] @ placement.rotation.T + placement.translation
    order_s, distance = _align_corners(m.corners[facet_m], placed)
    same = distance <= tolerance
    return _Match(facet_m[same], facet_s[same], order_s[same])


def match_facets(blocks: PlacedBlocks[Block]) -> Interfaces:
    """Find the facets of different blocks that coincide, corner on corner.

    Facet pairs are sorted by (m, s), within a pair in the order of m's facets, so the result does
    not depend on the search.
    """
    facets = [_facets(shape) for shape in blocks.shapes]
    tolerance = _RELATIVE_TOLERANCE * min(f.smallest for f in facets)
    size = max(f.radius for f in facets)
    pairs = _near_pairs(facets, blocks)
    placed = placements(pairs, blocks, size=size)
    matches = [_match(facets[one.shape_m], facets[one.shape_s], one, tolerance) for one in placed]
    return _gather(facets, pairs, placed, matches, blocks)


def _gather(
    facets: Sequence[_Facets],
    pairs: IntArray,
    placed: Sequence[Placement],
    matches: Sequence[_Match],
    blocks: AnyBlocks,
) -> Interfaces:
    """Turn each match to the pairs where its placement occurs."""
    count = np.zeros(len(pairs), dtype=np.int64)
    for placement, match in zip(placed, matches, strict=True):
        count[placement.pairs] = len(match.facet_m)
    start = np.concatenate([[0], np.cumsum(count)])
    total = int(start[-1])
    whole = [np.empty((total, 4), dtype=np.int64) for _ in range(2)]
    facet = [np.empty(total, dtype=np.int64) for _ in range(2)]
    centroids, normals, areas = np.empty((total, 3)), np.empty((total, 3)), np.empty(total)
    number = np.zeros(len(pairs), dtype=np.int64)
    for n, (placement, match) in enumerate(zip(placed, matches, strict=True)):
        number[placement.pairs] = n
        if not len(match.facet_m):
            continue
        m, s = facets[placement.shape_m], facets[placement.shape_s]
        corners = m.corners[match.facet_m]
        vector = 0.5 * np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
        area = np.linalg.norm(vector, axis=1)
        quads_s = np.take_along_axis(s.quads[match.facet_s], match.order_s, axis=1)
        normal, centroid = vector / area[:, None], m.centroids[match.facet_m]
        for pair in placement.pairs.tolist():
            block, here = pairs[pair, 0], slice(start[pair], start[pair + 1])
            back = blocks.rotations[block].T
            whole[0][here], whole[1][here] = m.quads[match.facet_m], quads_s
            facet[0][here], facet[1][here] = match.facet_m, match.facet_s
            centroids[here] = centroid @ back + blocks.translations[block]
            normals[here], areas[here] = normal @ back, area
    touch = np.flatnonzero(count)
    return Interfaces(
        block_m=np.repeat(pairs[touch, 0], count[touch]),
        block_s=np.repeat(pairs[touch, 1], count[touch]),
        quads_m=whole[0],
        quads_s=whole[1],
        facet_m=facet[0],
        facet_s=facet[1],
        centroids=centroids,
        normals=normals,
        areas=areas,
        pair_start=np.concatenate([[0], np.cumsum(count[touch])]),
        pair_class=number[touch],
        pair_rotations=blocks.rotations[pairs[touch, 0]],
    )


# ---------------------------------------------------------------------------------------------
# Points near each other, by sorting: libraries of trees take longer to load than this to run

#: Along no edge and no face that anyone draws: few points have the same place along it.
_ASKEW = np.array([0.577, 0.643, 0.502])
#: Cells along an axis: their numbers stay small enough to be multiplied.
_MOST_CELLS = 1 << 20
#: Half of the cells round a cell, and the cell itself last: the others have it on their side.
_HALF = tuple(offset for offset in product((-1, 0, 1), repeat=3) if offset <= (0, 0, 0))


def coincident(points: FloatArray, others: FloatArray, tolerance: float) -> IntArray:
    """Number of the nearest of other points (m, 3) within a tolerance of each point, (n,).

    Where there is none, m.
    """
    result = np.full(len(points), len(others))
    at, along = points @ _ASKEW, others @ _ASKEW
    order = np.argsort(along, kind="stable")
    # Along a direction of length 1 at most, points are no farther apart than in space.
    margin = tolerance + np.finfo(np.float64).eps * float(np.abs(along).max(initial=1.0))
    first = np.searchsorted(along[order], at - margin, "left")
    end = np.searchsorted(along[order], at + margin, "right")
    point, place = _spread(first, end)
    other = order[place]
    apart = np.linalg.norm(points[point] - others[other], axis=1)
    near = apart < tolerance
    point, other, apart = point[near], other[near], apart[near]
    farthest_first = np.lexsort((-apart, point))
    result[point[farthest_first]] = other[farthest_first]
    return result


def pairs_within(points: FloatArray, reach: float) -> IntArray:
    """Pairs (i, j), i < j, of points (n, 3) that are a distance apart at most, (n_pairs, 2)."""
    low = points.min(axis=0, initial=np.inf)
    extent = float(np.ptp(points, axis=0).max(initial=0.0)) if len(points) else 0.0
    size = max(reach * (1.0 + 1e-9), extent / _MOST_CELLS)
    cells = np.floor((points - low) / size).astype(np.int64) + 1 if size > 0.0 else 0 * points
    wide = int(cells.max(initial=0)) + 2
    digits = np.array([wide * wide, wide, 1])
    keys = cells.astype(np.int64) @ digits
    order = np.argsort(keys, kind="stable")
    ordered, found = keys[order], []
    for offset in _HALF:
        beside = keys[order] + int(digits @ offset)
        first = np.searchsorted(ordered, beside, "left")
        itself = offset == (0, 0, 0)
        end = np.arange(len(order)) if itself else np.searchsorted(ordered, beside, "right")
        point, place = _spread(first, end)
        pairs = np.column_stack([order[point], order[place]])
        apart = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
        found.append(np.sort(pairs[apart <= reach], axis=1))
    return np.concatenate(found)


def _spread(first: IntArray, end: IntArray) -> tuple[IntArray, IntArray]:
    """Row and place of each number from first to end, without end, of each row; (n,) each."""
    count = end - first
    row = np.repeat(np.arange(len(count)), count)
    return row, np.arange(len(row)) + np.repeat(first - (np.cumsum(count) - count), count)
