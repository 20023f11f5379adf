"""Static equilibrium of deformable blocks in contact, by Newton in displacements and pressures.

Each point of contact keeps a *linearisation overclosure* x̂. One iteration solves the linear
problem in which the law is replaced by its tangent there,

    K u + Σ w (p(x̂) + p'(x̂) (x(u) - x̂)) ∂x/∂u = f,

and then moves x̂: where the linear pressure is positive, to the overclosure at which the law has
that *same pressure* (Newton on the inverse of the law, which is nearly straight where the law is
an exponential); elsewhere to the overclosure just found. Gap gradients follow the current
normals from iteration to iteration.

The residual is that of the law itself: f - K u - Σ w p(x(u)) ∂x/∂u.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.sparse import csr_array

from fem.local_system import LocalSystem, constraint_transform
from fem.sparse_solver import SparseSolver, factorize
from geometry.mesh import FloatArray


class StaticError(ValueError):
    """A static problem without a solution that could be found: what is wrong."""


@dataclass(frozen=True)
class Linearisation:
    """The law's tangent at every point, about a displacement."""

    gradient: FloatArray
    """∂x/∂u in block frames, (n_facets, 4, 8, 3)."""
    constant: FloatArray
    """x(u) = constant + gradient · u, (n_facets, 4) [mm]."""
    at: FloatArray
    """x̂, (n_facets, 4) [mm]."""
    pressure: FloatArray
    """p(x̂) [MPa]."""
    stiffness: FloatArray
    """p'(x̂) [MPa/mm]."""

    def linear_pressure(self, system: LocalSystem, displacement: FloatArray) -> FloatArray:
        """Pressure of the tangent at a displacement, (n_facets, 4) [MPa]."""
        overclosure = self.constant + system.gather(self.gradient, displacement)
        pressure: FloatArray = self.pressure + self.stiffness * (overclosure - self.at)
        return pressure


class LinearStep(Protocol):
    """Solves the linear problem of one iteration."""

    def __call__(self, linear: Linearisation) -> FloatArray:
        """Displacements (n_nodes, 3) [mm]."""


class SparseStep:
    """Assembles everything into one sparse matrix: the plain method, the oracle of the others."""

    def __init__(self, system: LocalSystem, solver: SparseSolver | None = None) -> None:
        self._system = system
        self._solver = solver
        self._transform, self._free, self._value = constraint_transform(system)
        self._stiffness = csr_array(self._transform.T @ system.stiffness @ self._transform)

    def __call__(self, linear: Linearisation) -> FloatArray:
        """Displacements (n_nodes, 3) [mm]."""
        system = self._system
        rows = gradient_matrix(system, linear.gradient) @ self._transform
        weight = system.surfaces.weights.ravel()
        stiff = (weight * linear.stiffness.ravel())[:, None]
        contact = rows.T @ rows.multiply(stiff).tocsr()
        matrix = csr_array(self._stiffness + contact)
        constant = linear.pressure + linear.stiffness * (linear.constant - linear.at)
        right = self._transform.T @ system.external_force.ravel()
        right -= rows.T @ (weight * constant.ravel())
        right -= matrix @ self._value
        solution = self._value.copy()
        kept = matrix[self._free][:, self._free]
        solution[self._free] = factorize(csr_array(kept), self._solver)(right[self._free])
        displacement: FloatArray = (self._transform @ solution).reshape(-1, 3)
        return displacement


def gradient_matrix(system: LocalSystem, gradient: FloatArray) -> csr_array:
    """Gradients of all points as a sparse matrix, (4 n_facets, 3 n_nodes)."""
    n = len(gradient)
    columns = (3 * system.corner_nodes[:, :, None] + np.arange(3)).reshape(n, 24)
    columns = np.where(columns < 3 * system.n_nodes, columns, 0)
    indices = np.repeat(columns, 4, axis=0).ravel()
    matrix = csr_array(
        (gradient.flatten(), indices, 24 * np.arange(4 * n + 1)), shape=(4 * n, 3 * system.n_nodes)
    )
    matrix.sum_duplicates()
    return matrix


@dataclass(frozen=True)
class StaticOptions:
    """How hard to try."""

    tolerance: float = 1e-8
    """Residual over load at which the iteration stops [-]."""
    max_iterations: int = 60
    """Linear problems solved at most."""
    start_pressure: float = 0.01
    """Pressure at which every point is linearised first [MPa]."""


def newton(
    system: LocalSystem, step: LinearStep, options: StaticOptions
) -> tuple[FloatArray, PointKinematics, list[float]]:
    """Iterate to the residual tolerance."""
    contact = system.deformable.contact
    law, weights = contact.law, system.surfaces.weights
    displacement = np.zeros((system.n_nodes, 3))
    found = system.kinematics(displacement, contact.normals)
    at = np.full_like(found.overclosure, float(law.overclosure(options.start_pressure)))
    scale = float(np.linalg.norm(system.external_force))
    history = []
    for _ in range(options.max_iterations):
        linear = Linearisation(
            gradient=found.gradient,
            constant=found.overclosure - system.gather(found.gradient, displacement),
            at=at,
            pressure=law.pressure(at),
            stiffness=law.stiffness(at),
        )
        displacement = step(linear)
        pressure = linear.linear_pressure(system, displacement)
        found = system.kinematics(displacement, contact.normals)
        residual = system.free_part(
            system.external_force
            - system.internal_force(displacement)
            + system.scatter(found.gradient, weights * law.pressure(found.overclosure))
        )
        history.append(float(np.linalg.norm(residual)) / scale)
        if history[-1] < options.tolerance:
            break
        at = np.where(pressure > 0.0, law.overclosure(pressure), found.overclosure)
    return displacement, found, history
