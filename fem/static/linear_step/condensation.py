"""Static condensation of a block on some of its nodes, once for all congruent copies.

The elements are bisected again and again; each part is assembled densely, the nodes that belong
to it alone are eliminated, and the rest is added to the parent (substructuring, a multifrontal
elimination by nested dissection). What remains at the root is the Schur complement on the
retained nodes. Only dense LAPACK is needed, and eliminated displacements follow for all copies
at once by products of dense matrices.

Reference: Przemieniecki (1963), doi:10.2514/3.1500, for substructures; George (1973),
doi:10.1137/0710032, for nested dissection.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from fem.element.hexahedron import element_stiffness
from fem.problem.model import BlockGroup
from geometry.mesh import BoolArray, FloatArray, IntArray

#: Elements of a part that is not bisected further: smaller costs calls, larger costs products.
_LEAF_ELEMENTS = 48


@dataclass(frozen=True)
class _Part:
    """Nodes eliminated together, and how they follow from the nodes around them."""

    inside: IntArray
    """Degrees of freedom eliminated here, (n_i,)."""
    around: IntArray
    """Degrees of freedom they are connected to, (n_b,)."""
    factor: FloatArray
    """Lower Cholesky factor L of A_ii, (n_i, n_i)."""
    coupling: FloatArray
    """L⁻¹ A_ib, (n_i, n_b)."""


@dataclass(frozen=True)
class CondensedBlock:
    """A block seen from its retained nodes."""

    retained: IntArray
    """Retained nodes, ascending, (n_c,)."""
    stiffness: FloatArray
    """Schur complement on 3 · position + component, (3 n_c, 3 n_c) [N/mm]."""
    n_nodes: int
    """Nodes of the block."""
    parts: tuple[_Part, ...]
    """Eliminations in their order."""

    @property
    def degrees_of_freedom(self) -> IntArray:
        """Degrees of freedom of the block that are retained, (3 n_c,)."""
        dofs: IntArray = (3 * self.retained[:, None] + np.arange(3)).ravel()
        return dofs

    def condense_forces(self, forces: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Move nodal forces to the retained nodes.

        Parameters
        ----------
        forces
            (n_copies, n_nodes, 3) [N].

        Returns
        -------
        tuple[FloatArray, FloatArray]
            Forces on the retained nodes (n_copies, 3 n_c) [N], and what `recover` needs,
            (3 n_nodes, n_copies).
        """
        work = np.array(forces.reshape(len(forces), -1).T, order="C")
        for part in self.parts:
            inner = scipy.linalg.solve_triangular(
                part.factor, work[part.inside], lower=True, check_finite=False
            )
            work[part.inside] = inner
            work[part.around] -= part.coupling.T @ inner
        return np.ascontiguousarray(work[self.degrees_of_freedom].T), work

    def recover(self, displacement: FloatArray, reduced: FloatArray) -> FloatArray:
        """Displacements of all nodes from those of the retained ones.

        Parameters
        ----------
        displacement
            (n_copies, 3 n_c) [mm].
        reduced
            Second result of `condense_forces`, (3 n_nodes, n_copies).

        Returns
        -------
        FloatArray
            (n_copies, n_nodes, 3) [mm].
        """
        full = np.empty((3 * self.n_nodes, len(displacement)))
        full[self.degrees_of_freedom] = displacement.T
        for part in reversed(self.parts):
            right = reduced[part.inside] - part.coupling @ full[part.around]
            full[part.inside] = scipy.linalg.solve_triangular(
                part.factor, right, lower=True, trans="T", check_finite=False
            )
        return np.ascontiguousarray(full.T).reshape(len(displacement), self.n_nodes, 3)


def condense(group: BlockGroup, retained: IntArray) -> CondensedBlock:
    """Eliminate all nodes of a block but the retained ones.

    Parameters
    ----------
    group
        Mesh, material and element of the block.
    retained
        Nodes to keep, (n_c,), sorted and unique.
    """
    mesh = group.mesh

    def stiffness(some: IntArray) -> FloatArray:
        corners = mesh.nodes[mesh.elements[some]]
        return element_stiffness(corners, group.material, group.element)

    return condense_elements(mesh.elements, mesh.nodes, stiffness, retained)


def condense_elements(
    elements_of: IntArray,
    positions: FloatArray,
    stiffness_of: Callable[[IntArray], FloatArray],
    retained: IntArray,
) -> CondensedBlock:
    """Eliminate all nodes of a mesh of any elements but the retained ones.

    Parameters
    ----------
    elements_of
        Nodes of each element, (n_elements, n).
    positions
        Of the nodes, (n_nodes, 3) [mm].
    stiffness_of
        Stiffness matrices of some elements, (m, 3 n, 3 n) [N/mm].
    retained
        Nodes to keep, (n_c,), sorted and unique.
    """
    n_nodes = len(positions)
    uses = np.bincount(elements_of.ravel(), minlength=n_nodes)
    uses[retained] += 1
    centres = positions[elements_of].mean(axis=1)
    # A brick of so many trilinear elements has about as many nodes as one of degree three.
    leaf = _LEAF_ELEMENTS if elements_of.shape[1] == 8 else 1
    parts: list[_Part] = []

    def visit(elements: IntArray) -> tuple[IntArray, IntArray, FloatArray]:
        """Boundary nodes of a set of elements, their uses in it, condensed stiffness."""
        if len(elements) <= leaf:
            nodes, count, matrix = _assemble(elements_of[elements], stiffness_of(elements))
        else:
            nodes, count, matrix = _merge(*(visit(half) for half in _halves(elements, centres)))
        inside = count == uses[nodes]
        if not inside.any():
            return nodes, count, matrix
        part, rest = _eliminate(matrix, nodes, inside)
        parts.append(part)
        return nodes[~inside], count[~inside], rest

    nodes, _, stiffness = visit(np.arange(len(elements_of)))
    if not np.array_equal(nodes, retained):
        raise AssertionError("condensation: retained nodes are not what remained")
    return CondensedBlock(retained, stiffness, n_nodes, tuple(parts))


def _halves(elements: IntArray, centres: FloatArray) -> tuple[IntArray, IntArray]:
    """Split elements across their longest extent at the middle element."""
    points = centres[elements]
    axis = int(np.argmax(np.ptp(points, axis=0)))
    order = elements[np.argsort(points[:, axis], kind="stable")]
    middle = len(order) // 2
    return order[:middle], order[middle:]


def _assemble(corners: IntArray, matrices: FloatArray) -> tuple[IntArray, IntArray, FloatArray]:
    nodes, local, count = np.unique(corners, return_inverse=True, return_counts=True)
    local = local.reshape(corners.shape)
    dofs = (3 * local[:, :, None] + np.arange(3)).reshape(len(corners), -1)
    stiffness = np.zeros((3 * len(nodes), 3 * len(nodes)))
    np.add.at(stiffness, (dofs[:, :, None], dofs[:, None, :]), matrices)
    return nodes, count, stiffness


def _merge(
    first: tuple[IntArray, IntArray, FloatArray], second: tuple[IntArray, IntArray, FloatArray]
) -> tuple[IntArray, IntArray, FloatArray]:
    nodes = np.union1d(first[0], second[0])
    count = np.zeros(len(nodes), dtype=np.int64)
    stiffness = np.zeros((3 * len(nodes), 3 * len(nodes)))
    for own, uses, matrix in (first, second):
        where = np.searchsorted(nodes, own)
        count[where] += uses
        dofs = (3 * where[:, None] + np.arange(3)).ravel()
        stiffness[np.ix_(dofs, dofs)] += matrix
    return nodes, count, stiffness


def _eliminate(matrix: FloatArray, nodes: IntArray, inside: BoolArray) -> tuple[_Part, FloatArray]:
    """Schur complement of a dense matrix on the nodes that are not inside."""
    inner = np.flatnonzero(np.repeat(inside, 3))
    outer = np.flatnonzero(np.repeat(~inside, 3))
    factor = scipy.linalg.cholesky(matrix[np.ix_(inner, inner)], lower=True, check_finite=False)
    coupling = scipy.linalg.solve_triangular(
        factor, matrix[np.ix_(inner, outer)], lower=True, check_finite=False
    )
    rest = matrix[np.ix_(outer, outer)]
    rest -= coupling.T @ coupling
    dofs = (3 * nodes[:, None] + np.arange(3)).ravel()
    return _Part(dofs[inner], dofs[outer], factor, coupling), rest
