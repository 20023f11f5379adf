"""Springs between the surface of a block and the ground: beds of stiffness per area, at nodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
from scipy.sparse import bsr_array, coo_array

from fem.element.facet import basis_of, facet_area_vectors
from geometry.mesh import FloatArray, HexMesh, IntArray, ReadOnlyArrays
from geometry.meshing.charts import facet_elements


@dataclass(frozen=True)
class Springs(ReadOnlyArrays):
    """Springs on facets of a block, as stiffness of the elements that have these facets.

    A spring at a node is one on a facet that has the node.
    """

    element: IntArray
    """Element of each facet, (n,)."""
    nodes: IntArray
    """Nodes of each facet, (n, m)."""
    places: IntArray
    """Which nodes of the element these are, (n, m)."""
    matrices: FloatArray
    """Block frame, (n, 3 m, 3 m) [N/mm]."""
    n_nodes: int
    """Nodes of the block."""
    names: tuple[str, ...] = ()
    """Name of the bed of each facet, (n,)."""

    def added(self, some: IntArray, matrices: FloatArray) -> FloatArray:
        """Stiffness matrices of some elements (k,) with their springs, (k, 3 n, 3 n) [N/mm]."""
        total = matrices.copy()
        for facet in np.flatnonzero(np.isin(self.element, some)).tolist():
            dofs = (3 * self.places[facet][:, None] + np.arange(3)).ravel()
            (number,) = np.flatnonzero(some == self.element[facet])
            total[number][np.ix_(dofs, dofs)] += self.matrices[facet]
        return total

    @cached_property
    def stiffness(self) -> bsr_array:
        """Of all springs, (3 n_nodes, 3 n_nodes) [N/mm]."""
        dofs = (3 * self.nodes[:, :, None] + np.arange(3)).reshape(len(self.nodes), -1)
        rows = np.repeat(dofs, dofs.shape[1], axis=1)
        columns = np.tile(dofs, (1, dofs.shape[1]))
        size = 3 * self.n_nodes
        entries = (self.matrices.ravel(), (rows.ravel(), columns.ravel()))
        return bsr_array(coo_array(entries, (size, size)).tocsr(), blocksize=(3, 3))

    def forces(self, displacement: FloatArray) -> FloatArray:
        """Forces on the nodes of each facet at displacements (n_nodes, 3) [mm], frame of the block.

        (n, m, 3) [N]
        """
        moved = displacement[self.nodes].reshape(len(self.nodes), -1)
        result = -np.einsum("fij,fj->fi", self.matrices, moved)
        return np.asarray(result.reshape(*self.nodes.shape, 3))


#: Name of the springs, corners of facets (n, 4), stiffness per area, directions (k, 3).
Bed: TypeAlias = tuple[str, IntArray, float, FloatArray]


def springs_on(mesh: HexMesh, beds: Sequence[Bed]) -> Springs | None:
    """Consistent stiffness of beds of springs, ∫ k N_a N_b d dᵀ dA.

    None without any.

    Parameters
    ----------
    mesh
        Of the block.
    beds
        Name, corners of facets (n, 4), stiffness per area [N/mm³] and unit directions in the
        block's frame (k, 3) of each.
    """
    if not beds:
        return None
    element, nodes, places, matrices = [], [], [], []
    names: list[str] = []
    for name, corners, stiffness, directions in beds:
        names += [name] * len(corners)
        quads = mesh.facet_nodes(corners)
        area = np.linalg.norm(facet_area_vectors(mesh.nodes, quads), axis=-1)
        values = basis_of(quads).values
        product = stiffness * np.einsum("fp,pa,pb->fab", area, values, values)
        blocks = np.einsum("fab,ij->faibj", product, directions.T @ directions)
        size = 3 * quads.shape[1]
        of, _ = facet_elements(mesh, corners)
        element.append(of)
        nodes.append(quads)
        places.append((mesh.connectivity[of][:, None, :] == quads[:, :, None]).argmax(axis=2))
        matrices.append(blocks.reshape(-1, size, size))
    return Springs(
        element=np.concatenate(element),
        nodes=np.concatenate(nodes),
        places=np.concatenate(places),
        matrices=np.concatenate(matrices),
        n_nodes=mesh.n_nodes,
        names=tuple(names),
    )
