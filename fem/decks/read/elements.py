"""Elements of decks as hexahedra: sides, nodes between corners, tetrahedra split into four."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fem.element.hexahedron import ElementType
from geometry.mesh import FloatArray, IntArray

#: Number of nodes of elements with volume. Those of 20 and 27 nodes are solved as of degree 2.
VOLUMES = {
    "C3D8": 8,
    "C3D8R": 8,
    "C3D8I": 8,
    "C3D20": 20,
    "C3D20R": 20,
    "C3D27": 27,
    "C3D4": 4,
    "C3D10": 10,
    "C3D10M": 10,
    "C3D10T": 10,
}
#: Hexahedra of eight nodes by their integration: C3D8 in CalculiX, which integrates it fully; in
#: Abaqus it averages the dilatation (its manual: selectively reduced integration).
KINDS = {
    "C3D8": ElementType.FULL,
    "C3D8R": ElementType.REDUCED,
    "C3D8I": ElementType.INCOMPATIBLE,
}
#: Corners of the sides of a hexahedron, S1 to S6, and of a tetrahedron, S1 to S4.
HEX_SIDES: IntArray = np.array(
    [[0, 1, 2, 3], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
)
TET_SIDES: IntArray = np.array([[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]])
#: Numbers of nodes of tetrahedra.
TETRAHEDRA = (4, 10)
#: Edges of a tetrahedron in the order of the nodes on them.
_EDGES: IntArray = np.array([[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]])
#: Each corner and the other three, the same way round.
_ROUND = ((0, 1, 2, 3), (1, 0, 3, 2), (2, 0, 1, 3), (3, 0, 2, 1))


@dataclass(frozen=True)
class Hexahedra:
    """Hexahedra of the elements of a part."""

    nodes: FloatArray
    """The part's nodes, then those that splitting adds, (n, 3) [mm]."""
    elements: IntArray
    """Nodes of each hexahedron, corners first, (n_hexahedra, 8, 20 or 27)."""
    owner: IntArray
    """Element of each hexahedron, (n_hexahedra,)."""
    sides: IntArray
    """Corners of the facets of each side of each element, (n_elements, n_sides, n_facets, 4)."""


def as_hexahedra(nodes: FloatArray, elements: IntArray) -> Hexahedra:
    """Hexahedra of elements of 8, 20 or 27 nodes as they are; of 4 or 10 nodes split into four.

    Parameters
    ----------
    nodes
        (n, 3) [mm].
    elements
        (n_elements, n_nodes).
    """
    if elements.shape[1] not in TETRAHEDRA:
        owner = np.arange(len(elements))
        return Hexahedra(nodes, elements, owner, elements[:, HEX_SIDES][:, :, None, :])
    return _split(nodes, elements)


def _split(nodes: FloatArray, elements: IntArray) -> Hexahedra:
    corners = elements[:, :4]
    ends = np.sort(corners[:, _EDGES], axis=2)
    nodes, edges = middles(nodes, ends, elements[:, 4:] if elements.shape[1] == 10 else None)
    nodes, faces = middles(nodes, np.sort(corners[:, TET_SIDES], axis=2), None)
    centre = len(nodes) + np.arange(len(elements))
    nodes = np.concatenate([nodes, nodes[corners].mean(axis=1)])
    edge = {frozenset(pair): k for k, pair in enumerate(_EDGES.tolist())}
    face = {frozenset(side): k for k, side in enumerate(TET_SIDES.tolist())}

    def mid(*ends: int) -> IntArray:
        where = (
            edges[:, edge[frozenset(ends)]] if len(ends) == 2 else faces[:, face[frozenset(ends)]]
        )
        return np.asarray(where)

    result = []
    for a, b, c, d in _ROUND:
        result.append(
            [
                *(corners[:, a], mid(a, b), mid(a, b, c), mid(a, c)),
                *(mid(a, d), mid(a, b, d), centre, mid(a, c, d)),
            ]
        )
    hexes = np.array(result).transpose(2, 0, 1).reshape(-1, 8)
    sides = [
        [
            [corners[:, one], mid(one, two), mid(*side), mid(one, three)]
            for one, two, three in (np.roll(side, -k).tolist() for k in range(3))
        ]
        for side in TET_SIDES.tolist()
    ]
    return Hexahedra(
        nodes,
        hexes,
        np.repeat(np.arange(len(elements)), 4),
        np.array(sides).transpose(3, 0, 1, 2),
    )


def middles(
    nodes: FloatArray, bodies: IntArray, there: IntArray | None
) -> tuple[FloatArray, IntArray]:
    """Nodes in the middle of groups of nodes (n, m, k), added once each, or those that are there.

    Returns
    -------
    tuple[FloatArray, IntArray]
        All nodes; the middle of each body, (n, m).
    """
    if there is not None:
        return nodes, there
    unique, number = np.unique(bodies.reshape(-1, bodies.shape[2]), axis=0, return_inverse=True)
    added = nodes[unique].mean(axis=1)
    return np.concatenate([nodes, added]), len(nodes) + number.reshape(bodies.shape[:2])
