"""Blocks that share space before the load acts are rejected, with both blocks and the depth."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from geometry.assembly import Assembly
from geometry.block import Block
from geometry.interface import ROUGHLY_SAME, coincident, placements
from geometry.mesh import HEX_TETRAHEDRA, BoolArray, FloatArray
from geometry.parts.placed import AssemblyError

if TYPE_CHECKING:
    from geometry.polyhedra.polyhedron import Polyhedron

#: Points of two meshes that lie closer than this share of a block are one.
_SAME = 1e-9


def check_mesh_overlaps(assembly: Assembly, tolerance: float) -> None:
    """Reject blocks that lie deeper in each other than a tolerance [mm].

    Corners and middles of facets and of elements are looked at. Pairs of equal shapes in equal
    relative positions are looked at once.
    """
    solids = [_Solid(shape) for shape in assembly.shapes]
    boxes = np.array([[corners.min(axis=0), corners.max(axis=0)] for corners in _ends(assembly)])
    low, high = boxes[:, 0] + 0.5 * tolerance, boxes[:, 1] - 0.5 * tolerance
    near = [np.zeros((0, 2), dtype=np.int64)]
    for a in range(assembly.n_blocks - 1):
        later = np.arange(a + 1, assembly.n_blocks)
        share = (low[a] < high[later]).all(axis=1) & (low[later] < high[a]).all(axis=1)
        later = later[share & ~(assembly.fixed[a] & assembly.fixed[later])]
        near.append(np.column_stack([np.full_like(later, a), later]))
    pairs = np.concatenate(near)
    size = float(np.ptp(boxes.reshape(-1, 3), axis=0).max())
    result: list[tuple[float, int, int]] = []
    for way in placements(pairs, assembly, size=size, same=ROUGHLY_SAME):
        one, other = solids[way.shape_m], solids[way.shape_s]
        of_b = other.points @ way.rotation.T + way.translation
        of_a = (one.points - way.translation) @ way.rotation
        depth = max(one.depth(of_b), other.depth(of_a))
        if depth > tolerance:
            depth = one.overlap(other, (way.rotation, way.translation), tolerance)
        result += [(depth, m, s) for m, s in pairs[way.pairs].tolist()]
    depth, a, b = max(result, default=(0.0, 0, 0))
    if depth > tolerance:
        n = sum(one[0] > tolerance for one in result)
        more = f" ({n} overlapping pairs)" if n > 1 else ""
        raise AssemblyError(
            f"{assembly.name}: blocks {assembly.named(a)} and {assembly.named(b)} overlap by "
            f"{depth:.3g} mm{more}; expected blocks that touch within {tolerance:.3g} mm: move "
            "them apart (to override: check_blocks=False)"
        )


def _ends(assembly: Assembly) -> Iterator[FloatArray]:
    """Nodes of each block on its surface, (n, 3) [mm]."""
    for block in range(assembly.n_blocks):
        shape = assembly.shape(block)
        yield assembly.place(block, shape.mesh.nodes[shape.surface_nodes])


class _Solid:
    """A shape as points, and as hexahedra that points may lie in."""

    def __init__(self, shape: Block) -> None:
        mesh, self._shape = shape.mesh, shape
        self._corners = mesh.nodes[mesh.elements[:, :8]]
        middles = mesh.nodes[shape.boundary].mean(axis=1)
        surface = np.concatenate([mesh.nodes[shape.surface_nodes], middles])
        centres = self._corners.mean(axis=1)
        self.points = np.concatenate([surface, centres])
        """On the boundary, and the middles of the elements, (n, 3) [mm]."""
        self._surface, self._centres = surface, centres
        self._low, self._high = self._corners.min(axis=1), self._corners.max(axis=1)
        self._box = self._low.min(axis=0), self._high.max(axis=0)
        self._radius = float(np.linalg.norm(self._corners - centres[:, None], axis=2).max())

    def depth(self, points: FloatArray) -> float:
        """How deep the deepest of some points (n, 3) lies inside [mm]."""
        low, high = self._box
        points = points[((points > low) & (points < high)).all(axis=1)]
        if len(points):
            same = coincident(points, self._surface, _SAME * float(np.ptp([low, high])))
            points = points[same == len(self._surface)]
        inside = self._inside(points)
        if not inside.any():
            return 0.0
        from geometry.polyhedra.overlap import SignedDistance

        return float(-SignedDistance(self._polyhedron)(points[inside]).min())

    def overlap(
        self, other: _Solid, motion: tuple[FloatArray, FloatArray], tolerance: float
    ) -> float:
        """Depth of the overlap with a solid that is placed by a motion [mm]."""
        from geometry.polyhedra.overlap import overlap_depth

        return overlap_depth(self._polyhedron, other._polyhedron, motion, tolerance)[0]

    @cached_property
    def _polyhedron(self) -> Polyhedron:
        from geometry.polyhedra.polyhedron import polyhedron_from_block

        return polyhedron_from_block(self._shape)

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self._centres)

    def _inside(self, points: FloatArray) -> BoolArray:
        """Whether points (n, 3) lie in a hexahedron, cut into tetrahedra; (n,)."""
        near = cKDTree(points).sparse_distance_matrix(
            self._tree, self._radius, output_type="ndarray"
        )
        point, element = near["i"], near["j"]
        in_box = (points[point] >= self._low[element]) & (points[point] <= self._high[element])
        may = in_box.all(axis=1)
        point, corners = point[may], self._corners[element[may]]
        inside = np.zeros(len(points), dtype=np.bool_)
        for tetrahedron in HEX_TETRAHEDRA:
            ends = corners[:, tetrahedron]
            edges = np.swapaxes(ends[:, 1:] - ends[:, :1], 1, 2)
            solid = np.linalg.det(edges) != 0.0  # flat ones of distorted hexahedra have no inside
            arms = (points[point] - ends[:, 0])[solid, :, None]
            shares = np.linalg.solve(edges[solid], arms)[:, :, 0]
            within = (shares >= 0.0).all(axis=1) & (shares.sum(axis=1) <= 1.0)
            inside[point[solid][within]] = True
        return inside
