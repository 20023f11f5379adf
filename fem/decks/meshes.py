"""Quadratic meshes of decks: hexahedra of twenty nodes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fem.element.lagrange import Lagrange
from fem.element.lagrange_mesh import lagrange_mesh
from geometry.block import Block
from geometry.mesh import CORNERS, HEX_EDGES, HexMesh, IntArray


@dataclass(frozen=True)
class SerendipityMesh(HexMesh):
    """Hexahedra of 20 nodes, corners and middles of edges: what decks name C3D20."""

    members: IntArray
    """Nodes of each hexahedron in the order of C3D20, (n_elements, 20)."""

    @property
    def connectivity(self) -> IntArray:
        """All nodes of each hexahedron."""
        return self.members

    def facet_nodes(self, quads: IntArray) -> IntArray:
        """Nodes of facets from their corners, (n, 4) to (n, 8): middles after corners."""
        ends = np.stack([quads, np.roll(quads, -1, axis=1)], axis=2).reshape(-1, 2)
        known, numbers = self._middles
        result = np.searchsorted(known, _edge_keys(ends, self.n_nodes))
        return np.concatenate([quads, numbers[result].reshape(-1, 4)], axis=1)

    @cached_property
    def _middles(self) -> tuple[IntArray, IntArray]:
        """Keys of the edges, sorted, and the numbers of their middles."""
        keys = _edge_keys(self.elements[:, HEX_EDGES].reshape(-1, 2), self.n_nodes)
        unique, first = np.unique(keys, return_index=True)
        return unique, self.members[:, 8:].ravel()[first]


def _edge_keys(ends: IntArray, n: int) -> IntArray:
    """One number for the two ends of edges in any order, (m, 2) to (m,)."""
    return ends.min(axis=1) * n + ends.max(axis=1)


def serendipity_block(block: Block) -> Block:
    """Block with hexahedra of 20 nodes on its exact shape, where it has one."""
    mesh = lagrange_mesh(block, 2)
    natural = np.concatenate([CORNERS, CORNERS[HEX_EDGES].mean(axis=1)])
    grid = Lagrange(2).nodes
    columns = [int(np.abs(grid - place).sum(axis=1).argmin()) for place in natural]
    # Middles of edges come before those of faces or after: numbers are given anew.
    kept, members = np.unique(mesh.members[:, columns], return_inverse=True)
    twenty = members.reshape(-1, 20).astype(np.int64)
    return replace(block, mesh=SerendipityMesh(mesh.nodes[kept], mesh.elements, twenty))
