"""Conforming interfaces: facets of two blocks that coincide, corner on corner."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from geometry.block import Block
from geometry.mesh import FloatArray, IntArray

#: Coincidence tolerance relative to the smallest facet's size.
_RELATIVE_TOLERANCE = 1e-5


@dataclass(frozen=True)
class Interfaces:
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

    @property
    def n_contacts(self) -> int:
        """Number of matched facet pairs."""
        return len(self.block_m)

    @property
    def n_pairs(self) -> int:
        """Number of block pairs that touch."""
        return len(self.pair_start) - 1


@dataclass(frozen=True)
class _WorldFacets:
    """All contact facets of all blocks in world coordinates."""

    block: IntArray
    facet: IntArray
    quads: IntArray
    corners: FloatArray


def _world_facets(
    shapes: Sequence[Block],
    shape_of: IntArray,
    rotations: FloatArray,
    translations: FloatArray,
) -> _WorldFacets:
    blocks, facets, quads, corners = [], [], [], []
    for number, shape in enumerate(shapes):
        copies = np.flatnonzero(shape_of == number)
        local = shape.contact_quads
        placed = np.einsum("bij,fcj->bfci", rotations[copies], shape.mesh.nodes[local])
        placed += translations[copies, None, None, :]
        blocks.append(np.repeat(copies, len(local)))
        facets.append(np.tile(np.arange(len(local)), len(copies)))
        quads.append(np.tile(local, (len(copies), 1)))
        corners.append(placed.reshape(-1, 4, 3))
    return _WorldFacets(
        np.concatenate(blocks),
        np.concatenate(facets),
        np.concatenate(quads),
        np.concatenate(corners),
    )


def _align_corners(corners_m: FloatArray, corners_s: FloatArray) -> tuple[IntArray, FloatArray]:
    """Order of s's corners that meets m's, (n, 4), and the largest distance left, (n,)."""
    orders = np.array([[(k - i) % 4 for i in range(4)] for k in range(4)])
    distance = np.array(
        [np.linalg.norm(corners_s[:, order] - corners_m, axis=2).max(axis=1) for order in orders]
    )
    best = distance.argmin(axis=0)
    return orders[best], distance[best, np.arange(len(best))]


def match_facets(
    shapes: Sequence[Block],
    shape_of: IntArray,
    rotations: FloatArray,
    translations: FloatArray,
) -> Interfaces:
    """Find the facets of different blocks that coincide, corner on corner.

    Parameters
    ----------
    shapes, shape_of, rotations, translations
        As in `Assembly`.

    Returns
    -------
    Interfaces
        Facet pairs sorted by (m, s); within a pair in the order of m's facets, so the result
        does not depend on the search.
    """
    world = _world_facets(shapes, shape_of, rotations, translations)
    centroid = world.corners.mean(axis=1)
    diagonal = world.corners[:, 2] - world.corners[:, 0]
    tolerance = _RELATIVE_TOLERANCE * float(np.linalg.norm(diagonal, axis=1).min(initial=np.inf))
    pairs = (
        cKDTree(centroid).query_pairs(tolerance, output_type="ndarray").astype(np.int64)
        if len(centroid)
        else np.empty((0, 2), dtype=np.int64)
    )
    first, second = pairs[:, 0], pairs[:, 1]
    swap = world.block[first] > world.block[second]
    m, s = np.where(swap, second, first), np.where(swap, first, second)
    keep = world.block[m] != world.block[s]
    m, s = m[keep], s[keep]
    order_s, distance = _align_corners(world.corners[m], world.corners[s])
    keep = distance <= tolerance
    m, s, order_s = m[keep], s[keep], order_s[keep]
    order = np.lexsort((world.facet[m], world.block[s], world.block[m]))
    m, s, order_s = m[order], s[order], order_s[order]
    return _gather(world, m, s, order_s, centroid)


def _gather(
    world: _WorldFacets, m: IntArray, s: IntArray, order_s: IntArray, centroid: FloatArray
) -> Interfaces:
    block_m, block_s = world.block[m], world.block[s]
    corners = world.corners[m]
    vector = 0.5 * np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    area = np.linalg.norm(vector, axis=1)
    change = np.flatnonzero((np.diff(block_m) != 0) | (np.diff(block_s) != 0)) + 1
    start = np.concatenate([[0], change, [len(m)]]) if len(m) else np.zeros(1, dtype=np.int64)
    return Interfaces(
        block_m=block_m,
        block_s=block_s,
        quads_m=world.quads[m],
        quads_s=np.take_along_axis(world.quads[s], order_s, axis=1),
        facet_m=world.facet[m],
        facet_s=world.facet[s],
        centroids=centroid[m],
        normals=vector / area[:, None],
        areas=area,
        pair_start=start,
    )
