"""Blocks of hexahedra of degree two and more, made of a mesh of eight-node ones.

The corners keep their numbers and places; nodes on edges, on faces and inside come after them. A
block that has a `geometry.block.Curve` has them on the exact shape, any other on the straight
edges, ruled faces and trilinear insides of its mesh.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from fem.element.kinds import block_lumped_mass
from fem.element.lagrange import Lagrange
from geometry.block import Block, facet_corners
from geometry.mesh import (
    FloatArray,
    HexMesh,
    IntArray,
    shape_values,
    structured_hexahedra,
    structured_quads,
)

#: Shares of corners in a node are told apart to this, far above rounding.
_SHARE = 1e-6
#: Eight whole numbers as one that can be sorted.
_KEY = np.dtype((np.void, 64))


@dataclass(frozen=True)
class LagrangeMesh(HexMesh):
    """Hexahedra of one degree; `elements` names their corners."""

    members: IntArray
    """Nodes of each hexahedron, last natural direction fastest, (n_elements, (degree + 1)³)."""

    @property
    def degree(self) -> int:
        """Of the polynomials, at least two."""
        return round(self.members.shape[1] ** (1.0 / 3.0)) - 1

    @property
    def connectivity(self) -> IntArray:
        """All nodes of each hexahedron."""
        return self.members

    def extent(self) -> tuple[float, FloatArray]:
        """Volume [mm³] and centroid (3,) [mm] of the curved body."""
        shares = block_lumped_mass(self, 1.0)
        return float(shares.sum()), shares @ self.nodes / shares.sum()

    def facet_nodes(self, quads: IntArray) -> IntArray:
        """Nodes of facets from their corners, (n, 4) to (n, (degree + 1)²).

        The first direction, slow, runs from corner 0 to 1, the second from corner 0 to 3.
        """
        element, corners = facet_corners(self, quads)
        ways, way = np.unique(corners, axis=0, return_inverse=True)
        nodes = Lagrange(self.degree).face_nodes(ways)
        return self.members[element[:, None], nodes[way.ravel()]]


def _keys(corners: IntArray, share: FloatArray) -> npt.NDArray[np.void]:
    """What names a node of an edge or a face whatever element it is seen from, (n,).

    Its corners in ascending order with the share that each has in its place: from the corners of
    elements (n, 8) and the share of each corner in the node, (8,).
    """
    which = np.flatnonzero(share > _SHARE)
    names = corners[:, which]
    order = np.argsort(names, axis=1)
    rows = np.full((len(corners), 8), -1, dtype=np.int64)
    rows[:, : len(which)] = np.take_along_axis(names, order, axis=1)
    rows[:, 4 : 4 + len(which)] = np.rint(share[which] / _SHARE).astype(np.int64)[order]
    return rows.view(_KEY).ravel()


def lagrange_mesh(block: Block, degree: int) -> LagrangeMesh:
    """Give a block's eight-node hexahedra the nodes of a degree of two or more.

    On the exact shape where the block has one.
    """
    mesh, curve = block.mesh, block.curve
    shares = shape_values(Lagrange(degree).nodes)
    of = (shares > _SHARE).sum(axis=1)
    members = np.empty((mesh.n_elements, len(shares)), dtype=np.int64)
    between = np.flatnonzero((of > 1) & (of < 8))
    for node in np.flatnonzero(of == 1):
        members[:, node] = mesh.elements[:, shares[node].argmax()]
    keys = np.concatenate([_keys(mesh.elements, shares[node]) for node in between])
    unique, number = np.unique(keys, return_inverse=True)
    members[:, between] = mesh.n_nodes + number.reshape(len(between), -1).T
    inside, first = np.flatnonzero(of == 8), mesh.n_nodes + len(unique)
    own = np.arange(mesh.n_elements * len(inside)).reshape(mesh.n_elements, -1)
    members[:, inside] = first + own
    given = mesh.nodes[mesh.elements] if curve is None else curve.parameters()
    places: FloatArray = (shares @ given).reshape(members.size, -1)
    nodes = np.empty((first + own.size, 3))
    nodes[members.ravel()] = places if curve is None else curve.shape(places)
    nodes[: mesh.n_nodes] = mesh.nodes
    return LagrangeMesh(nodes, mesh.elements, members)


def with_degree(block: Block, degree: int) -> Block:
    """Block with hexahedra of a degree; one that has them is returned as it is."""
    if degree in (1, block.mesh.degree):
        return block
    return replace(block, mesh=lagrange_mesh(block, degree))


def in_pieces(block: Block) -> Block:
    """Block of eight-node hexahedra between the nodes of its elements: what pictures show."""
    mesh = block.mesh
    if mesh.degree == 1:
        return block
    k = mesh.degree
    cells = mesh.connectivity[:, structured_hexahedra(k, k, k)].reshape(-1, 8)
    faces = {
        name: mesh.facet_nodes(quads)[:, structured_quads(k)].reshape(-1, 4)
        for name, quads in block.faces.items()
    }
    return replace(block, mesh=HexMesh(mesh.nodes, cells), faces=faces, curve=None)
