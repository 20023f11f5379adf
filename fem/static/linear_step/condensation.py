"""Static condensation of a block on some of its nodes, and its flexibility there.

Both once for all congruent copies; solves keep them for those after them.

The elements are bisected again and again; each part is assembled densely, the nodes that belong
to it alone are eliminated, and the rest is added to the parent (substructuring, a multifrontal
elimination by nested dissection). What remains at the root is the Schur complement on the
retained nodes. Only dense LAPACK is needed, on lower triangles in Fortran order, and eliminated
displacements follow for all copies at once by products of dense matrices.

Reference: Przemieniecki (1963), doi:10.2514/3.1500, for substructures; George (1973),
doi:10.1137/0710032, for nested dissection.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
import scipy.linalg
import scipy.linalg.blas
from scipy.sparse import csr_array

from fem.system.body import Body, rigid_motions
from geometry.compilation import njit
from geometry.machine.work import Operation, count, count_elimination
from geometry.mesh import BoolArray, FloatArray, IntArray

#: Elements of a part that is not bisected further: smaller costs calls, larger costs products.
_LEAF_ELEMENTS = 48
#: Rows of a symmetric matrix that are mirrored at once.
_TILE = 128


@dataclass(frozen=True)
class Elimination:
    """Unknowns eliminated together, and how they follow from those around them."""

    inside: IntArray
    """Degrees of freedom eliminated here, (n_i,)."""
    around: IntArray
    """Degrees of freedom they are connected to, (n_b,)."""
    factor: FloatArray
    """Lower Cholesky factor L of A_ii, Fortran order."""
    coupling: FloatArray
    """L⁻¹ A_ib, (n_i, n_b)."""

    @property
    def entries(self) -> float:
        """Of both matrices that count."""
        return 0.5 * self.factor.size + self.coupling.size

    def forward(self, forces: FloatArray) -> None:
        """Move forces (n, n_cases) from inside to around; inside remains what `backward` needs."""
        right = forces[self.inside]
        if not right.any():  # such as inside a block that is loaded on its faces
            return
        inner = scipy.linalg.blas.dtrsm(1.0, self.factor, right, lower=1)
        count(Operation.ENTRY, self.entries * forces.shape[1])
        forces[self.inside] = inner
        forces[self.around] -= self.coupling.T @ inner

    def backward(self, found: FloatArray) -> None:
        """Turn what `forward` left inside into displacements, from those around."""
        right = found[self.inside] - self.coupling @ found[self.around]
        count(Operation.ENTRY, self.entries * found.shape[1])
        found[self.inside] = scipy.linalg.blas.dtrsm(1.0, self.factor, right, lower=1, trans_a=1)


@dataclass(frozen=True)
class CondensedBlock:
    """A block seen from its retained nodes."""

    retained: IntArray
    """Retained nodes, ascending, (n_c,)."""
    stiffness: FloatArray
    """Schur complement on 3 · position + component, (3 n_c, 3 n_c) [N/mm]."""
    n_nodes: int
    """Nodes of the block."""
    parts: tuple[Elimination, ...]
    """Eliminations in their order."""

    @property
    def degrees_of_freedom(self) -> IntArray:
        """Degrees of freedom of the block that are retained, (3 n_c,)."""
        return (3 * self.retained[:, None] + np.arange(3)).ravel()

    def condense_forces(self, forces: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Move nodal forces (n_copies, n_nodes, 3) [N] to the retained nodes.

        Returns
        -------
        tuple[FloatArray, FloatArray]
            Forces on the retained nodes (n_copies, 3 n_c) [N], and what `recover` needs,
            (3 n_nodes, n_copies).
        """
        work = np.array(forces.reshape(len(forces), -1).T, order="C")
        for part in self.parts:
            part.forward(work)
        return np.ascontiguousarray(work[self.degrees_of_freedom].T), work

    def recover(self, displacement: FloatArray, reduced: FloatArray) -> FloatArray:
        """Displacements of all nodes, (n_copies, n_nodes, 3) [mm], from those of the retained ones.

        Those are (n_copies, 3 n_c) [mm]; ``reduced`` is the second result of `condense_forces`.
        """
        full = reduced.copy()
        full[self.degrees_of_freedom] = displacement.T
        for part in reversed(self.parts):
            part.backward(full)
        return np.ascontiguousarray(full.T).reshape(len(displacement), self.n_nodes, 3)

    @cached_property
    def springs(self) -> FloatArray:
        """Springs of one on all nodes, of which the inner ones follow, (3 n_c, 3 n_c) [N/mm]."""
        size = len(self.degrees_of_freedom)
        nothing = np.zeros((3 * self.n_nodes, size))
        shapes = self.recover(np.eye(size), nothing).reshape(size, -1)
        count(Operation.DENSE, float(size) ** 2 * 3.0 * self.n_nodes)
        springs: FloatArray = shapes @ shapes.T / self.n_nodes
        return springs


def condense(body: Body, retained: IntArray) -> CondensedBlock:
    """Eliminate all nodes of a block but the retained ones, (n_c,), sorted and unique."""
    elements_of, n_nodes = body.mesh.connectivity, body.n_nodes
    uses = np.bincount(elements_of.ravel(), minlength=n_nodes)
    uses[retained] += 1
    centres = body.mesh.nodes[elements_of].mean(axis=1)
    # A brick of so many trilinear elements has about as many nodes as one of degree three.
    leaf = _LEAF_ELEMENTS if elements_of.shape[1] == 8 else 1
    parts: list[Elimination] = []

    def visit(elements: IntArray) -> tuple[IntArray, IntArray, FloatArray]:
        """Boundary nodes of a set of elements, their uses in it, condensed stiffness (lower)."""
        if len(elements) <= leaf:
            pieces = _element_pieces(elements_of[elements], body.element_stiffness(elements))
        else:
            pieces = [visit(half) for half in _halves(elements, elements_of, centres)]
        nodes = np.unique(np.concatenate([own for own, _, _ in pieces]))
        count = np.zeros(len(nodes), dtype=np.int64)
        for own, many, _ in pieces:
            count[np.searchsorted(nodes, own)] += many
        inside = count == uses[nodes]
        split = _assemble(nodes, inside, pieces)
        if not inside.any():
            return nodes, count, split.rest
        part, rest = _eliminate(split, nodes, inside)
        parts.append(part)
        return nodes[~inside], count[~inside], rest

    nodes, _, stiffness = visit(np.arange(len(elements_of)))
    if not np.array_equal(nodes, retained):
        raise AssertionError("condensation: retained nodes are not what remained")
    mirror(stiffness.T)
    return CondensedBlock(retained, stiffness, n_nodes, tuple(parts))


def mirror(matrix: FloatArray) -> None:
    """Copy the upper triangle of a matrix in C order to the lower one: it is symmetric."""
    n, below = len(matrix), np.tri(_TILE, k=-1, dtype=np.bool_)
    for a in range(0, n, _TILE):
        b = min(a + _TILE, n)
        matrix[b:, a:b] = matrix[a:b, b:].T
        corner = matrix[a:b, a:b]
        np.copyto(corner, corner.T.copy(), where=below[: b - a, : b - a])


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


@dataclass(frozen=True)
class _Split:
    """Stiffness on nodes to be eliminated (i) and those around (b); lower triangles, Fortran."""

    inner: FloatArray
    """A_ii, (n_i, n_i)."""
    coupling: FloatArray
    """A_bi, (n_b, n_i)."""
    rest: FloatArray
    """A_bb, (n_b, n_b)."""


def _assemble(nodes: IntArray, inside: BoolArray, pieces: list[_Piece]) -> _Split:
    """Sum of pieces, split by nodes inside and around."""
    place = np.empty(len(nodes), dtype=np.int64)
    order = np.concatenate([np.flatnonzero(inside), np.flatnonzero(~inside)])
    place[order] = np.arange(len(nodes))
    n, m = 3 * int(inside.sum()), 3 * int((~inside).sum())
    split = _Split(
        np.zeros((n, n), order="F"), np.zeros((m, n), order="F"), np.zeros((m, m), order="F")
    )
    for own, _, matrix in pieces:
        places = place[np.searchsorted(nodes, own)]
        # Nodes that follow each other in both are added in one run, none over the border.
        breaks = np.flatnonzero((np.diff(places) != 1) | (places[1:] == n // 3)) + 1
        runs = 3 * np.concatenate([[0], breaks, [len(places)]])
        dofs = (3 * places[:, None] + np.arange(3)).ravel()
        _add_lower((split.inner, split.coupling, split.rest), dofs, runs, matrix)
    return split


@njit(cache=True, nogil=True)
def _add_lower(parts, places, runs, matrix):  # type: ignore[no-untyped-def]
    """Add a lower triangle at places (n,) to the parts of a `_Split`; all Fortran."""
    inner, coupling, rest = parts
    n = inner.shape[0]
    for column in range(len(places)):
        to = places[column]
        for run in range(len(runs) - 1):
            first = max(runs[run], column)
            if first >= runs[run + 1]:
                continue
            # A run lies below the column's place as a whole, or above it: then transposed.
            at = places[first]
            low, high = min(at, to), max(at, to)
            target = rest if low >= n else coupling if high >= n else inner
            i, j = high - n * (high >= n), low - n * (low >= n)
            if at >= to:
                for k in range(runs[run + 1] - first):
                    target[i + k, j] += matrix[first + k, column]
            else:
                for k in range(runs[run + 1] - first):
                    target[i, j + k] += matrix[first + k, column]


def _eliminate(split: _Split, nodes: IntArray, inside: BoolArray) -> tuple[Elimination, FloatArray]:
    """Schur complement (lower) on the nodes around; the parts are overwritten."""
    factor = scipy.linalg.cholesky(split.inner, lower=True, overwrite_a=True, check_finite=False)
    outward, rest = split.coupling, split.rest
    count_elimination(len(split.inner), len(rest))
    if outward.size:
        # A_bi L⁻ᵀ, from the right.
        outward = scipy.linalg.blas.dtrsm(
            1.0, factor, outward, side=1, lower=1, trans_a=1, overwrite_b=1
        )
        rest = scipy.linalg.blas.dsyrk(-1.0, outward, beta=1.0, c=rest, lower=1, overwrite_c=1)
    inner, outer = (
        (3 * some[:, None] + np.arange(3)).ravel() for some in (nodes[inside], nodes[~inside])
    )
    return Elimination(inner, outer, factor, outward.T), rest


# ---------------------------------------------------------------------------------------------
# Flexibility


class UnheldBlocksError(ValueError):
    """Blocks that nothing holds in the linear problem of one iteration."""

    def __init__(self, reason: str, blocks: tuple[int, ...]) -> None:
        super().__init__(reason)
        self.blocks = blocks
        """Their numbers, as far as they are known."""


#: Energy of a rigid motion of order one over that of a block strained as much, below which no
#: spring resists it: what rounding leaves.
_RESISTED = 1e-12


@dataclass(frozen=True)
class Flexibility:
    """Response of one kind of block (a shape and its supports) on its retained variables."""

    condensed: CondensedBlock
    """Schur complement on contact and held nodes."""
    stiffness: FloatArray
    """The same on the retained variables v, u = T v; (3 n_c, 3 n_c) [N/mm]."""
    free: IntArray
    """Retained variables that are not prescribed, (n_free,)."""
    inverse: FloatArray
    """G, pseudo-inverse of the stiffness on the free variables, (n_free, n_free) [mm/N]."""
    rigid: FloatArray
    """Rigid motions that the supports leave, rotations times ℓ; (n_free, 0 … 6)."""


def block_motions(body: Body, nodes: IntArray) -> FloatArray:
    """Translations, and rotations about the mean of all nodes times ℓ, at nodes; (3 n, 6).

    That mean, not the mass centroid: no bit of a static answer shall hang on the density. ℓ is the
    cube root of the volume of the block's bounding box, so all six are of order one.
    """
    points = body.mesh.nodes
    arm = (points[nodes] - points.mean(axis=0)) / np.cbrt(np.prod(np.ptp(points, axis=0)))
    return rigid_motions(arm).reshape(-1, 6)


def symmetric_pseudo_inverse(stiffness: FloatArray, rigid: FloatArray) -> FloatArray:
    """(S + s R̂ R̂ᵀ)⁻¹ - R̂ R̂ᵀ / s with R̂ an orthonormal basis of the rigid motions."""
    if not stiffness.size:  # supports prescribe every node
        return stiffness
    shifted = np.array(stiffness, order="F")
    count(Operation.DENSE, 0.5 * float(len(stiffness)) ** 3)
    scale = float(np.diag(stiffness).mean())
    basis = np.linalg.qr(rigid)[0] if rigid.shape[1] else rigid
    shifted += scale * basis @ basis.T
    factor, fail = scipy.linalg.lapack.dpotrf(shifted, lower=1, overwrite_a=1)
    if fail:
        raise UnheldBlocksError("a block's stiffness is not positive definite", ())
    inverse, _ = scipy.linalg.lapack.dpotri(factor, lower=1, overwrite_c=1)
    full: FloatArray = inverse.T
    mirror(full)
    full -= basis @ basis.T / scale
    return full


def _unresisted(stiffness: FloatArray, rigid: FloatArray) -> FloatArray:
    """Rigid motions (n, k) that no spring resists, (n, 0 … k)."""
    energy = rigid.T @ stiffness @ rigid
    values, vectors = np.linalg.eigh(energy)
    scale = float(np.abs(stiffness).max()) * len(rigid)
    return rigid @ vectors[:, values <= _RESISTED * scale]


def flexibility_of(
    body: Body, condensed: CondensedBlock, axes: csr_array | None, is_free: BoolArray
) -> Flexibility:
    """Return the flexibility of a block on its retained variables.

    ``axes`` are the T of its supports, (3 n_c, 3 n_c); None: it has none. ``is_free`` says which
    variables are not prescribed, (3 n_c,).
    """
    stiffness = condensed.stiffness
    rigid = block_motions(body, condensed.retained)
    if axes is not None:
        stiffness = axes.T @ (axes.T @ stiffness.T).T
        rigid = axes.T @ rigid
    free = np.flatnonzero(is_free)
    if len(free) < len(is_free):
        # Motions that no prescribed component feels.
        rigid = rigid @ scipy.linalg.null_space(rigid[~is_free], rcond=1e-9)
    rigid = rigid[free]
    if body.springs is not None:
        rigid = _unresisted(stiffness[np.ix_(free, free)], rigid)
    inverse = symmetric_pseudo_inverse(stiffness[np.ix_(free, free)], rigid)
    return Flexibility(condensed, stiffness, free, inverse, rigid)


Kind = TypeVar("Kind")


class FlexibilityStore:
    """Keeps the flexibilities of one problem for the next one on the same blocks.

    Loads, contact laws and gaps may differ; what the next problem does not need is let go before
    anything new is made.
    """

    def __init__(self) -> None:
        self._kept: dict[bytes, Any] = {}
        self._condensed: dict[bytes, CondensedBlock] = {}

    def keep(self, keys: set[bytes]) -> None:
        """Let go of all others."""
        self._kept = {key: result for key, result in self._kept.items() if key in keys}

    def get(self, key: bytes, make: Callable[[], Kind]) -> Kind:
        """Return the flexibility of a key, made if there is none."""
        if key not in self._kept:
            self._kept[key] = make()
        kept: Kind = self._kept[key]
        return kept

    def condensed(self, body: Body, nodes: IntArray) -> CondensedBlock:
        """Return a block condensed on nodes (n,), sorted, and on those it was before."""
        key = content_of(body)
        before = self._condensed.get(key)
        if before is None or not np.isin(nodes, before.retained).all():
            more = nodes if before is None else np.union1d(before.retained, nodes)
            self._condensed[key] = condense(body, more)
        return self._condensed[key]


def content_of(body: Body) -> bytes:
    """Digest of all of a block that its flexibility depends on."""
    digest = hashlib.sha256()
    for array in (body.mesh.nodes, body.mesh.connectivity):
        digest.update(np.ascontiguousarray(array).tobytes())
    material, springs = body.material, body.springs
    if springs is not None:
        digest.update(springs.element.tobytes() + springs.places.tobytes())
        digest.update(springs.matrices.tobytes())
    digest.update(repr((body.element, material.young_modulus, material.poisson_ratio)).encode())
    return digest.digest()
