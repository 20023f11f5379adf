"""Displacements of one mesh on another of the same blocks: a start to go on from, and facets.

Points of a block keep their chart and parameters on every mesh (`geometry.block`), so
values there are those of the functions of the elements in which they lie.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from fem.element.functions import facet_values
from fem.element.kinds import element_of
from fem.system.system import System
from geometry.block import Block, Places, located, places_in
from geometry.mesh import CORNERS, HEX_FACES, FloatArray, HexMesh, IntArray, row_keys
from geometry.refinement import charts_of


def node_places(block: Block) -> Places:
    """Places of all nodes of a block; of several elements that have a node, one counts."""
    mesh = block.mesh
    known, first = np.unique(mesh.connectivity.ravel(), return_index=True)
    element, local = np.divmod(first, mesh.connectivity.shape[1])
    at = np.zeros((mesh.n_nodes, 3))
    of = np.zeros(mesh.n_nodes, dtype=np.int64)
    at[known], of[known] = element_of(mesh).nodes[local], element
    return places_in(charts_of(block), of, at)


def interpolation(block: Block, places: Places) -> csr_array:
    """Values at places from those at the nodes of a block, (n, n_nodes)."""
    mesh = block.mesh
    element, natural = located(charts_of(block), places)
    result = _sums(mesh, element_of(mesh).values(natural), mesh.connectivity[element])
    result.eliminate_zeros()  # on a face all but its own nodes
    return result


def interpolation_on_faces(block: Block, places: Places) -> csr_array:
    """`interpolation` at places on faces of elements, where only the nodes of the face count."""
    mesh, kind = block.mesh, element_of(block.mesh)
    element, natural = located(charts_of(block), places)
    corners = CORNERS[HEX_FACES]
    face = (natural @ corners.mean(axis=1).T).argmax(axis=1)
    along = 0.5 * (corners[:, [1, 3]] - corners[:, :1])
    xi = (along[face] @ natural[:, :, None])[:, :, 0]
    members = mesh.connectivity[element[:, None], kind.face_nodes(HEX_FACES)[face]]
    return _sums(mesh, facet_values(xi, members.shape[1]), members)


def _sums(mesh: HexMesh, values: FloatArray, members: IntArray) -> csr_array:
    """Sums of functions (n, m) times values at their nodes (n, m), (n, n_nodes)."""
    pointer = values.shape[1] * np.arange(len(values) + 1)
    return csr_array((values.ravel(), members.ravel(), pointer), (len(values), mesh.n_nodes))


def transferred(
    displacements: tuple[FloatArray, ...], source: System, target: System
) -> tuple[FloatArray, ...]:
    """Displacements of each body at the nodes of another mesh of the same blocks.

    Parameters
    ----------
    displacements
        Of each body of the source, world axes, (n_copies, n_nodes, 3) [mm].
    source, target
        The same blocks on two meshes.

    Returns
    -------
    tuple[FloatArray, ...]
        The same of the target.
    """
    result = []
    for number, u in enumerate(displacements):
        to = interpolation(_shape(source, number), node_places(_shape(target, number)))
        moved = to @ np.concatenate(u, axis=1)
        result.append(np.stack(np.split(moved, len(u), axis=1)))
    return tuple(result)


def _shape(system: System, body: int) -> Block:
    block = int(np.flatnonzero(system.body_number == body)[0])
    return system.assembly.shape(block)


def unique_rows(rows: IntArray) -> tuple[IntArray, IntArray]:
    """Position of the first of the rows that differ, in their order, and which each row is."""
    _, first, number = np.unique(row_keys(rows), return_index=True, return_inverse=True)
    return first, np.asarray(number).ravel()
