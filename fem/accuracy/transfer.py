"""Displacements of one mesh on another of the same blocks: a start to go on from, and facets.

Points of a block keep their chart and parameters on every mesh (`geometry.meshing.charts`), so
values there are those of the functions of the elements in which they lie.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from fem.assembly.deformable import DeformableAssembly
from fem.element.lagrange import line_basis, lobatto_points
from fem.element.lagrange_mesh import LagrangeMesh
from geometry.block import Block
from geometry.mesh import (
    CORNERS,
    FloatArray,
    HexMesh,
    IntArray,
    grid_points,
    row_keys,
    shape_values,
)
from geometry.meshing.charts import Places, located, places_in
from geometry.meshing.refinement import charts_of


def degree_of(mesh: HexMesh) -> int:
    """Degree of the functions of a mesh."""
    return mesh.degree if isinstance(mesh, LagrangeMesh) else 1


def node_places(block: Block) -> Places:
    """Places of all nodes of a block; of several elements that have a node, one counts."""
    mesh = block.mesh
    members, natural = mesh.elements, CORNERS
    if isinstance(mesh, LagrangeMesh):
        members, natural = mesh.members, grid_points(*[lobatto_points(mesh.degree)] * 3)
    known, first = np.unique(members.ravel(), return_index=True)
    element, local = np.divmod(first, members.shape[1])
    at = np.zeros((mesh.n_nodes, 3))
    of = np.zeros(mesh.n_nodes, dtype=np.int64)
    at[known], of[known] = natural[local], element
    return places_in(charts_of(block), of, at)


def interpolation(block: Block, places: Places) -> csr_array:
    """Values at places from those at the nodes of a block, (n, n_nodes)."""
    mesh = block.mesh
    element, natural = located(charts_of(block), places)
    if isinstance(mesh, LagrangeMesh):
        first, second, third = (line_basis(mesh.degree, natural[:, k])[0] for k in range(3))
        plane = (first[:, :, None] * second[:, None, :]).reshape(len(element), -1)
        values = (plane[:, :, None] * third[:, None, :]).reshape(len(element), -1)
        members = mesh.members[element]
    else:
        values, members = shape_values(natural), mesh.elements[element]
    pointer = values.shape[1] * np.arange(len(values) + 1)
    result = csr_array((values.ravel(), members.ravel(), pointer), (len(values), mesh.n_nodes))
    result.eliminate_zeros()  # on a face all but its own nodes
    return result


def interpolation_on_faces(block: Block, places: Places) -> csr_array:
    """`interpolation` at places on faces of elements, where only the nodes of the face count."""
    mesh = block.mesh
    if not isinstance(mesh, LagrangeMesh):
        return interpolation(block, places)
    element, natural = located(charts_of(block), places)
    line, every = mesh.degree + 1, np.arange(len(element))
    normal = np.abs(natural).argmax(axis=1)
    side = (natural[every, normal] > 0.0).astype(np.int64)
    along = np.array([[1, 2], [0, 2], [0, 1]])[normal]
    first, second = (line_basis(mesh.degree, natural[every, along[:, k]])[0] for k in range(2))
    values = first[:, :, None] * second[:, None, :]
    grid = np.arange(line**3).reshape(line, line, line)
    of_sides = np.stack([np.moveaxis(grid, k, 0)[[0, -1]].reshape(2, -1) for k in range(3)])
    members = mesh.members[element[:, None], of_sides[normal, side]]
    pointer = line**2 * np.arange(len(element) + 1)
    return csr_array((values.ravel(), members.ravel(), pointer), (len(element), mesh.n_nodes))


def transferred(
    displacements: tuple[FloatArray, ...], source: DeformableAssembly, target: DeformableAssembly
) -> tuple[FloatArray, ...]:
    """Displacements of each group at the nodes of another mesh of the same blocks.

    Parameters
    ----------
    displacements
        Of each group of the source, world axes, (n_copies, n_nodes, 3) [mm].
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


def _shape(deformable: DeformableAssembly, group: int) -> Block:
    block = int(np.flatnonzero(deformable.group_of == group)[0])
    return deformable.assembly.shape(block)


def unique_rows(rows: IntArray) -> tuple[IntArray, IntArray]:
    """Position of the first of the rows that differ, in their order, and which each row is."""
    _, first, number = np.unique(row_keys(rows), return_index=True, return_inverse=True)
    return first, np.asarray(number).ravel()
