"""The linear problem of one static iteration, and its plain solution."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.sparse import csr_array, diags_array

from fem.assembly.local_system import LocalSystem, NodalInverse, constraint_transform
from fem.static.linear_step.sparse import SparseSolver, SparseSolverError, factorize
from geometry.mesh import FloatArray, IntArray


class UnheldBlocksError(ValueError):
    """Blocks that nothing holds in the linear problem of one iteration."""

    def __init__(self, reason: str, blocks: tuple[int, ...]) -> None:
        super().__init__(reason)
        self.blocks = blocks
        """Their numbers, as far as they are known."""


@dataclass(frozen=True)
class Linearisation:
    """The law's tangent at every point, about a displacement.

    A facet has the points of its basis, or one when it is `coarsened`.
    """

    weights: FloatArray
    """Area of each point, (n_facets, n_points) [mm²]."""
    gradient: FloatArray
    """∂x/∂u in block frames, (n_facets, n_points, nodes of both facets, 3)."""
    constant: FloatArray
    """x(u) = constant + gradient · u, (n_facets, n_points) [mm]."""
    at: FloatArray
    """Linearisation overclosure x̂, (n_facets, n_points) [mm]."""
    pressure: FloatArray
    """p(x̂), (n_facets, n_points) [MPa]."""
    stiffness: FloatArray
    """p'(x̂), (n_facets, n_points) [MPa/mm]."""
    load_factor: float = 1.0
    """Share of the loads that acts [-]."""

    def linear_pressure(self, system: LocalSystem, displacement: FloatArray) -> FloatArray:
        """Pressure of the tangent at a displacement, (n_facets, n_points) [MPa]."""
        overclosure = self.constant + system.gather(self.gradient, displacement)
        pressure: FloatArray = self.pressure + self.stiffness * (overclosure - self.at)
        return pressure


def coarsened(linear: Linearisation) -> Linearisation:
    """Take one pressure for each facet, the mean of its points: cheaper first iterations."""
    weights = linear.weights.sum(axis=1, keepdims=True)

    def mean(values: FloatArray) -> FloatArray:
        return (linear.weights * values).sum(axis=1, keepdims=True) / weights

    gradient = np.einsum("fp,fpai->fai", linear.weights / weights, linear.gradient)
    return Linearisation(
        weights=weights,
        gradient=gradient[:, None],
        constant=mean(linear.constant),
        at=mean(linear.at),
        pressure=mean(linear.pressure),
        stiffness=mean(linear.stiffness),
        load_factor=linear.load_factor,
    )


class LinearStep(Protocol):
    """Solves the linear problem of one iteration."""

    def __call__(
        self, linear: Linearisation, before: FloatArray, holding: float = 0.0
    ) -> FloatArray:
        """Displacements (n_nodes, 3) [mm]; inner nodes may be left out.

        ``holding`` [N/mm] holds each block to where it was ``before``.
        """

    def inverse(self, linear: Linearisation, holding: float = 0.0) -> NodalInverse:
        """Inverse of K + Σ w k ∂x/∂u ∂x/∂uᵀ, zero on prescribed components."""

    def internal_force(self, displacement: FloatArray) -> FloatArray:
        """K u, condensed where inner nodes are left out, (n_nodes, 3) [N]."""

    @property
    def external_force(self) -> FloatArray:
        """Loads, condensed where inner nodes are left out, (n_nodes, 3) [N]."""

    def complete(self, displacement: FloatArray) -> FloatArray:
        """Displacements of all nodes, (n_nodes, 3) [mm]."""


def gradient_matrix(
    system: LocalSystem, gradient: FloatArray, points: IntArray | None = None
) -> csr_array:
    """Gradients of points as a sparse matrix.

    Parameters
    ----------
    system
        Numbers the corners.
    gradient
        (n_facets, n_points, nodes of both facets, 3).
    points
        Rows to keep, n_points · facet + point; None keeps all.

    Returns
    -------
    csr_array
        (n_rows, 3 n_nodes).
    """
    per_facet = gradient.shape[1]
    chosen = np.arange(per_facet * len(gradient)) if points is None else points
    width = 3 * gradient.shape[2]
    columns = (3 * system.corner_nodes[:, :, None] + np.arange(3)).reshape(-1, width)
    columns = np.where(columns < 3 * system.n_nodes, columns, 0)[chosen // per_facet]
    values = gradient.reshape(-1, width)[chosen]
    n = len(chosen)
    matrix = csr_array(
        (values.ravel(), columns.ravel(), width * np.arange(n + 1)), shape=(n, 3 * system.n_nodes)
    )
    matrix.sum_duplicates()
    matrix.eliminate_zeros()
    return matrix


class SparseStep:
    """Assembles everything into one sparse matrix: the plain method, the oracle of the others."""

    def __init__(self, system: LocalSystem, solver: SparseSolver | None = None) -> None:
        self._system = system
        self._solver = solver
        self._transform, self._free, self._value = constraint_transform(system)
        self._stiffness = csr_array(self._transform.T @ system.stiffness @ self._transform)

    def __call__(
        self, linear: Linearisation, before: FloatArray, holding: float = 0.0
    ) -> FloatArray:
        """Displacements (n_nodes, 3) [mm].

        Raises
        ------
        UnheldBlocksError
            A singular matrix.
        """
        system = self._system
        rows = gradient_matrix(system, linear.gradient) @ self._transform
        matrix = self._matrix(linear, rows, holding)
        constant = linear.pressure + linear.stiffness * (linear.constant - linear.at)
        right = linear.load_factor * (self._transform.T @ system.external_force.ravel())
        right -= rows.T @ (linear.weights * constant).ravel()
        if holding:
            right += holding * self._shares() * (self._transform.T @ before.ravel())
        right -= matrix @ self._value
        solution = self._value.copy()
        solution[self._free] = self._factor(matrix)(right[self._free])
        return (self._transform @ solution).reshape(-1, 3)

    def inverse(self, linear: Linearisation, holding: float = 0.0) -> NodalInverse:
        """Inverse of K + Σ w k ∂x/∂u ∂x/∂uᵀ, zero on prescribed components.

        Raises
        ------
        UnheldBlocksError
            A singular matrix.
        """
        rows = gradient_matrix(self._system, linear.gradient) @ self._transform
        solve = self._factor(self._matrix(linear, rows, holding))

        def apply(force: FloatArray) -> FloatArray:
            solution = np.zeros_like(self._value)
            solution[self._free] = solve((self._transform.T @ force.ravel())[self._free])
            return (self._transform @ solution).reshape(-1, 3)

        return apply

    def _matrix(self, linear: Linearisation, rows: csr_array, holding: float) -> csr_array:
        stiff = (linear.weights * linear.stiffness).ravel()[:, None]
        matrix = csr_array(self._stiffness + rows.T @ rows.multiply(stiff).tocsr())
        return csr_array(matrix + diags_array(holding * self._shares())) if holding else matrix

    def _factor(self, matrix: csr_array) -> Callable[[FloatArray], FloatArray]:
        kept = csr_array(matrix[self._free][:, self._free])
        try:
            return factorize(kept, self._solver)
        except SparseSolverError as error:
            raise UnheldBlocksError(str(error), ()) from None

    def _shares(self) -> FloatArray:
        """One over the number of nodes of its block, for every variable."""
        sizes = np.diff(self._system.node_start)
        return np.repeat(1.0 / sizes, 3 * sizes)

    def internal_force(self, displacement: FloatArray) -> FloatArray:
        """K u, (n_nodes, 3) [N]."""
        return self._system.internal_force(displacement)

    @property
    def external_force(self) -> FloatArray:
        """Loads, (n_nodes, 3) [N]."""
        return self._system.external_force

    def complete(self, displacement: FloatArray) -> FloatArray:
        """Displacements of all nodes: they are there already."""
        return displacement
