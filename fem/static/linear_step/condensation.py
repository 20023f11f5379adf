"""Static condensation of a block on some of its nodes, once for all congruent copies.

The elements are bisected again and again; each part is assembled densely, the nodes that belong
to it alone are eliminated, and the rest is added to the parent (substructuring, a multifrontal
elimination by nested dissection). What remains at the root is the Schur complement on the
retained nodes. Only dense LAPACK is needed, on lower triangles in Fortran order, and eliminated
displacements follow for all copies at once by products of dense matrices.

Reference: Przemieniecki (1963), doi:10.2514/3.1500, for substructures; George (1973),
doi:10.1137/0710032, for nested dissection.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.linalg.blas

from fem.element.hexahedron import element_stiffness
from fem.problem.model import BlockGroup
from geometry.compilation import njit
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
            inner = scipy.linalg.blas.dtrsm(1.0, part.factor, work[part.inside], lower=1)
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
            full[part.inside] = scipy.linalg.blas.dtrsm(1.0, part.factor, right, lower=1, trans_a=1)
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
        """Boundary nodes of a set of elements, their uses in it, condensed stiffness (lower)."""
        if len(elements) <= leaf:
            pieces = _element_pieces(elements_of[elements], stiffness_of(elements))
        else:
            pieces = [visit(half) for half in _halves(elements, elements_of, centres)]
        nodes = np.unique(np.concatenate([own for own, _, _ in pieces]))
        count = np.zeros(len(nodes), dtype=np.int64)
        for own, many, _ in pieces:
            count[np.searchsorted(nodes, own)] += many
        inside = count == uses[nodes]
        matrix, n_inside = _assemble(nodes, inside, pieces)
        if n_inside:
            part, matrix = _eliminate(matrix, nodes, inside)
            parts.append(part)
        return nodes[~inside], count[~inside], matrix

    nodes, _, stiffness = visit(np.arange(len(elements_of)))
    if not np.array_equal(nodes, retained):
        raise AssertionError("condensation: retained nodes are not what remained")
    stiffness = np.tril(stiffness) + np.tril(stiffness, -1).T
    return CondensedBlock(retained, stiffness, n_nodes, tuple(parts))


def _halves(
    elements: IntArray, elements_of: IntArray, centres: FloatArray
) -> tuple[IntArray, IntArray]:
    """Split elements at the middle one along the axis where the halves share the fewest nodes."""
    middle = len(elements) // 2
    best: tuple[int, tuple[IntArray, IntArray]] | None = None
    for axis in np.argsort(-np.ptp(centres[elements], axis=0)):
        order = elements[np.argsort(centres[elements, axis], kind="stable")]
        halves = order[:middle], order[middle:]
        one, other = (np.unique(elements_of[half]) for half in halves)
        shared = len(np.intersect1d(one, other, assume_unique=True))
        if best is None or shared < best[0]:
            best = shared, halves
    assert best is not None
    return best[1]


#: Nodes, how many elements of a set use them, and the lower triangle of its stiffness on them.
_Piece = tuple[IntArray, IntArray, FloatArray]


def _element_pieces(corners: IntArray, matrices: FloatArray) -> list[_Piece]:
    return [
        # Symmetric: the transpose is the same matrix in Fortran order.
        (nodes, np.ones(len(nodes), dtype=np.int64), matrix.T)
        for nodes, matrix in zip(corners, matrices, strict=True)
    ]


def _assemble(nodes: IntArray, inside: BoolArray, pieces: list[_Piece]) -> tuple[FloatArray, int]:
    """Lower triangle with the nodes to be eliminated first, and how many these are."""
    place = np.empty(len(nodes), dtype=np.int64)
    order = np.concatenate([np.flatnonzero(inside), np.flatnonzero(~inside)])
    place[order] = np.arange(len(nodes))
    stiffness = np.zeros((3 * len(nodes), 3 * len(nodes)), order="F")
    for own, _, matrix in pieces:
        dofs = (3 * place[np.searchsorted(nodes, own)][:, None] + np.arange(3)).ravel()
        _add_lower(stiffness, dofs, matrix)
    return stiffness, int(inside.sum())


@njit(cache=True, nogil=True)
def _add_lower(total, places, matrix):  # type: ignore[no-untyped-def]
    """Add the lower triangle of a symmetric matrix to that of a larger one, both (n, n) Fortran."""
    for column in range(len(places)):
        to = places[column]
        for row in range(column, len(places)):
            at = places[row]
            if at >= to:
                total[at, to] += matrix[row, column]
            else:
                total[to, at] += matrix[row, column]


def _eliminate(matrix: FloatArray, nodes: IntArray, inside: BoolArray) -> tuple[_Part, FloatArray]:
    """Schur complement (lower) of a lower triangle, whose first rows are those of nodes inside."""
    n = 3 * int(inside.sum())
    factor = scipy.linalg.cholesky(matrix[:n, :n], lower=True, check_finite=False)
    rest = np.array(matrix[n:, n:], order="F")
    coupling = np.empty((n, len(rest)))
    if len(rest):
        # A_bi L⁻ᵀ, from the right: the lower triangle holds A_bi.
        outward = scipy.linalg.blas.dtrsm(1.0, factor, matrix[n:, :n], side=1, lower=1, trans_a=1)
        rest = scipy.linalg.blas.dsyrk(-1.0, outward, 1.0, rest, lower=1, overwrite_c=1)
        coupling = outward.T
    inner, outer = (
        (3 * some[:, None] + np.arange(3)).ravel() for some in (nodes[inside], nodes[~inside])
    )
    return _Part(inner, outer, factor, coupling), rest
