"""Quadratic meshes of decks: tetrahedra of ten nodes and hexahedra of twenty.

Splitting a tetrahedron gives four hexahedra, one at each corner. The middles of its edges are
nodes of theirs already; the middles of its sides and its own come last and belong to no element.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from fem.element.lagrange import Lagrange
from fem.element.lagrange_mesh import lagrange_mesh
from geometry.block import Block
from geometry.mesh import CORNERS, HEX_EDGES, FloatArray, HexMesh, IntArray, MeshError

#: Ends of the edges whose middles are nodes 5 to 10, and corners of sides S1 to S4, as C3D10.
_EDGES = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))
_SIDES = ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0))
_PARTS = 4


@dataclass(frozen=True)
class TetrahedralMesh(HexMesh):
    """Tetrahedra of ten nodes; `elements` are their hexahedra, four after four."""

    members: IntArray
    """Nodes of each tetrahedron in the order of C3D10, (n_elements, 10)."""
    centres: IntArray
    """Middles of its sides S1 to S4 and its own, (n_elements, 5)."""
    places: IntArray
    """Number that each node had among the hexahedra, (all nodes,)."""

    @property
    def n_nodes(self) -> int:
        """Number of nodes of the tetrahedra; the middles of sides follow."""
        return int(self.members.max()) + 1

    @property
    def n_elements(self) -> int:
        """Number of tetrahedra."""
        return len(self.members)

    @property
    def connectivity(self) -> IntArray:
        """All nodes of each tetrahedron."""
        return self.members

    def facet_nodes(self, quads: IntArray) -> IntArray:
        """Nodes of tetrahedra on facets, (n, 3): a facet has the middle of a side, too."""
        return quads[quads < self.n_nodes].reshape(-1, 3)

    def sides(self, hexahedra: IntArray, quads: IntArray) -> tuple[IntArray, IntArray]:
        """Tetrahedron and side (0 to 3) of facets of hexahedra, (n,) each."""
        tetrahedra = hexahedra // _PARTS
        middle = quads.max(axis=1)
        sides = (self.centres[tetrahedra, :_PARTS] == middle[:, None]).argmax(axis=1)
        return tetrahedra, sides.astype(np.int64)

    @cached_property
    def _shares(self) -> sp.csr_array:
        """Shape functions of ten nodes at all nodes of the hexahedra, (all, n_nodes)."""
        corners, edges = self.members[:, :4], self.members[:, 4:]
        own = np.arange(self.n_nodes)
        rows, columns, values = [own], [own], [np.ones(self.n_nodes)]
        ends = [*(tuple(side) for side in _SIDES), (0, 1, 2, 3)]
        for place, of in enumerate(ends):
            middle, first = np.unique(self.centres[:, place], return_index=True)
            mine = [k for k, pair in enumerate(_EDGES) if set(pair) <= set(of)]
            lows, highs = (-1.0 / 9.0, 4.0 / 9.0) if len(of) == 3 else (-1.0 / 8.0, 1.0 / 4.0)
            nodes = np.column_stack([corners[first][:, of], edges[first][:, mine]])
            weights = [lows] * len(of) + [highs] * len(mine)
            rows.append(np.repeat(middle, nodes.shape[1]))
            columns.append(nodes.ravel())
            values.append(np.tile(weights, len(middle)))
        row, column = np.concatenate(rows), np.concatenate(columns)
        shape = (len(self.nodes), self.n_nodes)
        result = sp.coo_array((np.concatenate(values), (row, column)), shape).tocsr()
        # Two tetrahedra share the middle of a side: either's functions, once.
        sums: FloatArray = result.sum(axis=1)
        return sp.csr_array(sp.diags_array(1.0 / sums) @ result)

    def on_tetrahedra(self, forces: FloatArray) -> FloatArray:
        """Equivalent forces on the nodes of tetrahedra, from those of the hexahedra, (n, 3)."""
        result: FloatArray = self._shares.T @ forces[self.places]
        return result

    def renumbered(self, nodes: IntArray) -> IntArray:
        """Nodes of tetrahedra among those of the hexahedra, by their new numbers."""
        number = np.argsort(self.places)[nodes]
        result: IntArray = number[number < self.n_nodes]
        return result


def tetrahedral_block(block: Block) -> Block:
    """Block with the tetrahedra that its hexahedra were split from.

    Raises
    ------
    MeshError
        Hexahedra of no tetrahedra.
    """
    parts = block.mesh.elements.reshape(-1, _PARTS, 8)
    shared = (parts[:, :, :, None, None] == parts[:, None, None, :, :]).any(axis=4)
    owners = shared @ (1 << np.arange(_PARTS))
    order = _right_handed(block, parts, owners)
    members = np.column_stack(
        [_node(parts, owners, order[:, of]) for of in ((0,), (1,), (2,), (3,), *_EDGES)]
    )
    centres = np.column_stack(
        [_node(parts, owners, order[:, of]) for of in (*_SIDES, (0, 1, 2, 3))]
    )
    kept = np.unique(members)
    rest = np.setdiff1d(np.arange(block.mesh.n_nodes), kept)
    places = np.concatenate([kept, rest])
    number = np.empty(len(places), dtype=np.int64)
    number[places] = np.arange(len(places))
    mesh = TetrahedralMesh(
        block.mesh.nodes[places],
        number[block.mesh.elements],
        number[members],
        number[centres],
        places,
    )
    faces = {name: number[quads] for name, quads in block.faces.items()}
    return replace(block, mesh=mesh, faces=faces, charts=None)


def _right_handed(block: Block, parts: IntArray, owners: IntArray) -> IntArray:
    """Order of the hexahedra of each tetrahedron in which its volume is positive, (n, 4)."""
    order = np.tile(np.arange(_PARTS), (len(parts), 1))
    corners = np.column_stack([_node(parts, owners, order[:, [k]]) for k in range(_PARTS)])
    x = block.mesh.nodes[corners]
    turned = np.linalg.det(x[:, 1:] - x[:, :1]) < 0.0
    order[np.ix_(turned, [1, 2])] = [2, 1]
    return order


def _node(parts: IntArray, owners: IntArray, of: IntArray) -> IntArray:
    """The one node of each tetrahedron that these of its hexahedra share alone, (n,)."""
    every = np.arange(len(parts))
    wanted = (1 << of).sum(axis=1)
    mine = owners[every, of[:, 0]] == wanted[:, None]
    if (mine.sum(axis=1) != 1).any():
        raise MeshError("hexahedra: got some that are no quarters of tetrahedra, expected such")
    result: IntArray = parts[every, of[:, 0]][mine]
    return result


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
