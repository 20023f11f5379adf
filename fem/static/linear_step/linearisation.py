"""The linear problem of one static iteration, and its plain solution by a well-kept library.

PARDISO of the MKL through pypardiso where it is installed (x86 only), else SciPy's SuperLU,
which gives the same answers and takes several times longer on solids.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cache
from importlib import import_module, util
from typing import Any

import numpy as np
from scipy.sparse import block_diag, bsr_array, csc_array, csr_array, csr_matrix, diags_array, triu
from scipy.sparse.linalg import SuperLU, splu

from fem.static.linear_step.condensation import CondensedBlock, UnheldBlocksError
from fem.system.system import NodalInverse, Sector, at_share
from geometry.errors import RefusedError
from geometry.machine.work import Operation, count, hold_memory, memory_limit, require_memory
from geometry.mesh import FloatArray, IntArray

Solve = Callable[[FloatArray], FloatArray]


#: Bytes of an entry of a sparse matrix: its value and its row, and room that is left.
_ENTRY_BYTES = 16.0
#: Matrices that are in memory beside their factor: with and without supports, by rows and columns.
_COPIES = 4.0
#: Entries of the diagonal over the largest of their column that are pivots, at least.
_PIVOT = 0.01
#: Entries of the factor of a solid, both triangles, over n^(4/3), at most: 16 to 50 measured.
_MOST_FILL = 60.0


class SparseSolver(StrEnum):
    """Which library factors."""

    PARDISO = "pardiso"
    """Intel MKL through pypardiso."""
    SUPERLU = "superlu"
    """SciPy."""


class SparseSolverError(RefusedError):
    """A matrix that cannot be factored, or a library that is not there."""


def default_sparse_solver() -> SparseSolver:
    """PARDISO where pypardiso is installed, else SuperLU."""
    result = util.find_spec("pypardiso") is not None
    return SparseSolver.PARDISO if result else SparseSolver.SUPERLU


def factorize(matrix: csr_array, solver: SparseSolver | None = None) -> Solve:
    """Factor a symmetric positive definite matrix (n, n), both triangles stored; solves for (n,).

    By the best library that is installed, where none is named.

    Raises
    ------
    SparseSolverError
        A singular matrix, or a library that is not installed.
    """
    solver = default_sparse_solver() if solver is None else solver
    return _pardiso(matrix) if solver is SparseSolver.PARDISO else _superlu(matrix)


def fill_in(matrix: csr_array) -> float:
    """Entries of both triangular factors of a matrix of symmetric structure, before it is factored.

    Unknowns of one node, or of the inside of one element, have the same neighbours. The matrix of
    such groups is factored, in a tenth of the time. Measured: 1 to 1.5 times the entries.
    """
    pattern = csr_array((np.ones(matrix.nnz), matrix.indices, matrix.indptr), shape=matrix.shape)
    pattern.sort_indices()
    neighbours = pattern @ np.random.default_rng(0).random(matrix.shape[0])
    _, first, body, size = np.unique(
        neighbours, return_index=True, return_inverse=True, return_counts=True
    )
    joined = csr_array((np.ones(len(body)), (np.arange(len(body)), body)))
    small = csr_array(pattern[first] @ joined)
    small.data[:] = -1.0
    factor = _splu(small + diags_array(np.bincount(small.nonzero()[0]) + 1.0))
    lower, sizes = factor.L, np.empty(len(size))
    lower.data[:] = 1.0
    sizes[factor.perm_c] = size
    return float(2.0 * sizes @ (lower @ sizes) - sizes @ (sizes - 1.0))


def _splu(matrix: csr_array) -> SuperLU:
    """Factor a matrix of symmetric structure on its diagonal, unless its entries there are small.

    The largest entries of the columns, as by default, make up to four times the entries.
    """
    return splu(
        csc_array(matrix),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=_PIVOT,
        options={"SymmetricMode": True},
    )


def _check_memory(matrix: csr_array) -> None:
    """Reject a matrix whose factor is beyond the limit of memory, before any of it is made."""
    n = float(matrix.shape[0])
    if _bytes(matrix, min(_MOST_FILL * n ** (4.0 / 3.0), n**2)) > memory_limit():
        need = _bytes(matrix, fill_in(matrix))
        require_memory(f"factors of {n:.0f} unknowns", need, "a coarser mesh or fewer blocks")


def _bytes(matrix: csr_array, fill: float) -> float:
    """Memory of a matrix and its factor of so many entries [bytes]."""
    return _ENTRY_BYTES * (fill + _COPIES * matrix.nnz)


def _superlu(matrix: csr_array) -> Solve:
    _check_memory(matrix)
    try:
        factor = _splu(matrix)
    except RuntimeError as error:
        raise SparseSolverError(f"stiffness matrix: {error}; expected every block held") from None
    hold_memory(_bytes(matrix, factor.nnz))
    # Of both triangles: half of them squared over the order is what a factorisation multiplies.
    count(Operation.SPARSE, 0.25 * float(factor.nnz) ** 2 / max(matrix.shape[0], 1))

    def solve(right: FloatArray) -> FloatArray:
        count(Operation.ENTRY, 2.0 * factor.nnz)  # read in no order
        return np.asarray(factor.solve(right), dtype=np.float64)

    return solve


@cache
def _pardiso_library() -> Any:
    """PARDISO for symmetric positive definite matrices; finding the library takes its time."""
    try:
        return import_module("pypardiso").PyPardisoSolver(mtype=2)
    except ImportError as error:
        raise SparseSolverError(
            f"pardiso: {error}; install pypardiso (x86 only) or choose superlu"
        ) from None


def _pardiso(matrix: csr_array) -> Solve:
    solver = copy(_pardiso_library())
    solver.pt, solver.iparm = np.zeros_like(solver.pt), np.zeros_like(solver.iparm)
    upper = csr_matrix(triu(matrix, format="csr"))
    upper.sort_indices()

    class _Factor:
        """Owns PARDISO's memory and gives it back."""

        def __call__(self, right: FloatArray) -> FloatArray:
            solver.set_phase(33)
            return solver._call_pardiso(upper, np.ascontiguousarray(right))

        def __del__(self) -> None:
            solver.free_memory(everything=True)

    solver._check_A(upper)
    solver.set_phase(12)
    try:
        solver._call_pardiso(upper, np.zeros((upper.shape[0], 1)))
    except Exception as error:
        solver.free_memory(everything=True)
        raise SparseSolverError(
            f"stiffness matrix: {error}; expected a positive definite matrix: is every block held?"
        ) from None
    return _Factor()


class StaticError(RefusedError):
    """A static problem that has no solution, or none that was found: what to do."""


@dataclass(frozen=True)
class Linearisation:
    """The law's tangent at every point, about a displacement.

    A facet has the points of its basis, or one when it is `coarsened`.
    """

    weights: FloatArray
    """Area of each point, (n_facets, n_points) [mm²]."""
    gradient: FloatArray
    """∂x/∂u in block frames, (n_facets, n_points, 1 or 3, nodes of both facets, 3)."""
    constant: FloatArray
    """x(u) = constant + gradient · u, (n_facets, n_points, 1 or 3) [mm]."""
    at: FloatArray
    """Overclosure and slips x̂ of the linearisation, alike [mm]."""
    traction: FloatArray
    """t(x̂), alike [MPa]."""
    slope: FloatArray
    """∂t/∂x there, (n_facets, n_points, 1 or 3, 1 or 3) [MPa/mm]."""
    load_factor: float = 1.0
    """Share of the path of the loads [-]."""
    time: float | None = None
    """At which supports that move are where they are prescribed [s]; None: all their way."""

    def tractions(self, x: FloatArray) -> FloatArray:
        """Tractions of the tangent at overclosures and slips, like ``at`` [MPa]."""
        more = np.einsum("fpkl,fpl->fpk", self.slope, x - self.at)
        return np.asarray(self.traction + more)

    @property
    def symmetric(self) -> bool:
        """Whether no point slides: then friction does not follow pressures."""
        return bool(np.array_equal(self.slope, np.swapaxes(self.slope, 2, 3)))


def coarsened(linear: Linearisation) -> Linearisation:
    """Take one pressure for each facet, the mean of its points: cheaper first iterations."""
    weights = linear.weights.sum(axis=1, keepdims=True)

    names = ("gradient", "constant", "at", "traction", "slope")
    means: dict[str, Any] = {
        name: np.einsum("fp,fp...->f...", linear.weights / weights, getattr(linear, name))[:, None]
        for name in names
    }
    return replace(linear, weights=weights, **means)


class LinearStep(ABC):
    """Solves the linear problem of one iteration, in the displacements of all nodes."""

    def __init__(self, system: Sector) -> None:
        self._system = system

    @abstractmethod
    def __call__(
        self, linear: Linearisation, before: FloatArray, holding: float = 0.0
    ) -> tuple[FloatArray, NodalInverse | None]:
        """Displacements (n_nodes, 3) [mm], which may leave inner nodes out, and what gave them.

        That is the inverse of K + Σ w k ∂x/∂u ∂x/∂uᵀ, zero on prescribed components; None of a step
        that takes no periodic cell. ``holding`` [N/mm] holds each block to where it was ``before``.

        Raises
        ------
        UnheldBlocksError
            Blocks that nothing holds.
        """

    @property
    def exact(self) -> bool:
        """Whether every force follows the law's tangent, and none is kept as it was."""
        return True

    def internal_force(self, displacement: FloatArray) -> FloatArray:
        """K u, condensed where inner nodes are left out, (n_nodes, 3) [N]."""
        return self._system.internal_force(displacement)

    def load(self, share: float) -> FloatArray:
        """Loads at a share of a path, condensed if inner nodes are left out, (n_nodes, 3) [N]."""
        return at_share(self._system.loads, share)

    def kept(self, displacement: FloatArray) -> FloatArray:
        """Displacements, zero where inner nodes are left out, (n_nodes, 3) [mm]."""
        return displacement

    def complete(self, displacement: FloatArray, share: float) -> FloatArray:  # noqa: ARG002
        """Displacements of all nodes under the loads at a share of a path, (n_nodes, 3) [mm]."""
        return displacement


class RetainedNodes(LinearStep):
    """A step in the displacements of some nodes; those inside of blocks follow from them."""

    def __init__(self, system: Sector, blocks: Sequence[CondensedBlock]) -> None:
        """Take the condensed block of each slot."""
        self._system, self._blocks = system, blocks
        self._dofs = [
            block.degrees_of_freedom + 3 * start
            for block, start in zip(blocks, system.node_start.tolist(), strict=False)
        ]
        self._loads = np.zeros((len(system.loads), 3 * system.n_nodes))
        self._inner = []
        for slot, (block, dofs) in enumerate(zip(blocks, self._dofs, strict=True)):
            self._loads[:, dofs], inner = block.condense_forces(
                system.loads[:, system.nodes_of(slot)]
            )
            self._inner.append(inner.T)

    def internal_force(self, displacement: FloatArray) -> FloatArray:
        """S u of the retained nodes, zero at inner nodes; (n_nodes, 3) [N]."""
        result, moved = np.zeros(displacement.size), displacement.ravel()
        for block, dofs in zip(self._blocks, self._dofs, strict=True):
            result[dofs] = block.stiffness @ moved[dofs]
            count(Operation.ENTRY, block.stiffness.size)
        return result.reshape(-1, 3)

    def load(self, share: float) -> FloatArray:
        """Loads condensed on the retained nodes, zero at inner nodes; (n_nodes, 3) [N]."""
        return at_share(self._loads, share).reshape(-1, 3)

    def kept(self, displacement: FloatArray) -> FloatArray:
        """Displacements, zero at inner nodes, (n_nodes, 3) [mm]."""
        result, flat = np.zeros(displacement.size), displacement.ravel()
        for dofs in self._dofs:
            result[dofs] = flat[dofs]
        return result.reshape(-1, 3)

    def complete(self, displacement: FloatArray, share: float) -> FloatArray:
        """Displacements of all nodes from those of the retained ones, (n_nodes, 3) [mm]."""
        parts = [
            block.recover(displacement.ravel()[dofs][None], at_share(inner, share)[:, None])[0]
            for block, dofs, inner in zip(self._blocks, self._dofs, self._inner, strict=True)
        ]
        return np.concatenate(parts)


class SparseStep(LinearStep):
    """Assembles everything into one sparse matrix: the plain method, the oracle of the others."""

    def __init__(self, system: Sector, solver: SparseSolver | None = None) -> None:
        self._system, self._solver = system, solver
        self._transform, self._free = system.held.transform(system.n_nodes)
        self._stiffness, self._springs = (
            csr_array(self._transform.T @ of @ self._transform) if len(system.held.nodes) else of
            for of in self._assembled()
        )

    def _assembled(self) -> tuple[csr_array, csr_array]:
        """Stiffness of all blocks [N/mm], and springs of one [N/mm] that hold each to its place."""
        sizes = np.diff(self._system.node_start)
        bodies = map(self._system.body, range(self._system.n_slots))
        stiffness = csr_array(block_diag([body.stiffness.tocsr() for body in bodies], format="csr"))
        return stiffness, csr_array(diags_array(np.repeat(1.0 / sizes, 3 * sizes)))

    def __call__(
        self, linear: Linearisation, before: FloatArray, holding: float = 0.0
    ) -> tuple[FloatArray, NodalInverse]:
        """Displacements (n_nodes, 3) [mm] and the inverse."""
        points, rows = self._pressing(linear)
        matrix = self._matrix(linear, points, rows, holding)
        forces = linear.weights[..., None] * linear.tractions(linear.constant)
        right = self._transform.T @ self.load(linear.load_factor).ravel()
        right -= rows.T @ forces.reshape(-1, forces.shape[2])[points].ravel()
        if holding:
            right += holding * (self._springs @ (self._transform.T @ before.ravel()))
        value = self._system.held.variables(self._system.n_nodes, linear.time)
        right -= matrix @ value
        solve = self._factor(matrix, symmetric=linear.symmetric)

        def solved(right: FloatArray, value: FloatArray) -> FloatArray:
            solution = value.copy()
            solution[self._free] = solve(right[self._free])
            return (self._transform @ solution).reshape(-1, 3)

        nothing = np.zeros_like(value)
        return solved(right, value), lambda f: solved(self._transform.T @ f.ravel(), nothing)

    def _pressing(self, linear: Linearisation) -> tuple[IntArray, csr_array]:
        """Points that press or resist, and their gradients: others fill the matrix with zeros."""
        acts = linear.slope.any(axis=(2, 3)) | linear.traction.any(axis=2)
        points, size = np.flatnonzero(acts), linear.slope.shape[-1]
        rows = (size * points[:, None] + np.arange(size)).ravel()
        gradient = self._system.points.gradient_matrix(linear.gradient, rows)
        return points, gradient @ self._transform

    def _matrix(
        self, linear: Linearisation, points: IntArray, rows: csr_array, holding: float
    ) -> csr_array:
        weighted = linear.weights[..., None, None] * linear.slope
        size = weighted.shape[-1]
        each, shape = np.arange(len(points) + 1), (size * len(points), size * len(points))
        pressed = weighted.reshape(-1, size, size)[points]
        stiff = bsr_array((pressed, each[:-1], each), shape).tocsr()
        matrix = csr_array(self._stiffness + rows.T @ csr_array(stiff @ rows))
        return csr_array(matrix + holding * self._springs if holding else matrix)

    def _factor(
        self, matrix: csr_array, *, symmetric: bool = True
    ) -> Callable[[FloatArray], FloatArray]:
        kept = csr_array(matrix[self._free][:, self._free])
        try:
            return factorize(kept, self._solver) if symmetric else _superlu(kept)
        except SparseSolverError as error:
            raise UnheldBlocksError(str(error), ()) from None
