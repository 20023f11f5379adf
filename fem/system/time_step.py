"""The critical time step of central differences, and bounds on it.

Central differences with forces K u_n + C v_{n-½} are stable while every mode x keeps
4 - Δt² xᵀKx - 2 Δt xᵀCx ≥ 0 (xᵀMx = 1): the alternating solution is the first to grow. For
one mode with damping ratio ξ this is Belytschko's Δt = (2/ω)(√(1 + ξ²) - ξ). Damping
proportional to mass does not appear: it acts at the mean of the two half-step velocities,
which leaves the limit as it is.

Single elements say what Abaqus quotes: `characteristic_time_step` is L / c_d, the estimate that
Abaqus/Explicit documents. It is not a bound (a cube of nu = 0.4 rings faster than that).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import bsr_array, csr_array, diags_array
from scipy.sparse.linalg import LinearOperator, eigsh

from fem.element.hexahedron import (
    gauss_gradients,
    mean_gradients,
    point_volumes,
)
from fem.element.material import Material
from fem.system.body import Body, refuse_turning_springs
from fem.system.effects import Effects
from geometry.errors import RefusedError
from geometry.mesh import HEX_FACES, FloatArray, HexMesh


def characteristic_length(coordinates: FloatArray) -> FloatArray:
    """Volume over the largest face: the smallest height of a parallelepiped; (n_elements,) [mm].

    Abaqus calls its L_e the smallest dimension of the element and does not publish more; this
    is the definition LS-DYNA documents for its bricks.
    """
    corners = coordinates[:, HEX_FACES]
    vectors = 0.5 * np.cross(
        corners[:, :, 2] - corners[:, :, 0], corners[:, :, 3] - corners[:, :, 1]
    )
    largest = np.linalg.norm(vectors, axis=2).max(axis=1)
    return point_volumes(coordinates).sum(axis=1) / largest


def damped_factor(damping_ratio: float) -> float:
    """Factor sqrt(1 + xi²) - xi by which a damping ratio of the highest mode cuts the step."""
    return math.sqrt(1.0 + damping_ratio**2) - damping_ratio


def characteristic_time_step(
    mesh: HexMesh, material: Material, *, linear_bulk_viscosity: float = 0.0
) -> float:
    """Element estimate of Abaqus/Explicit, min L_e / c_d · (sqrt(1 + b1²) - b1) [s].

    b1 is Abaqus' damping ratio of the dilatational mode, the linear bulk viscosity (0.06 there by
    default).
    """
    length = characteristic_length(mesh.nodes[mesh.elements]).min()
    return float(length) / material.dilatational_wave_speed * damped_factor(linear_bulk_viscosity)


class TimeStepError(RefusedError):
    """A time step that would make the run unstable or endless."""


@dataclass(frozen=True)
class CriticalTimeStep:
    """The largest stable time step of a model and where it comes from."""

    critical_time_step: float
    """Sharp estimate with all damping [s]."""
    undamped: float
    """2/ω_max without stiffness-proportional damping and bulk viscosity [s]."""
    body: str
    """The block that governs."""
    max_frequency: float
    """ω_max of that block [rad/s]."""
    element_estimate: float
    """Smallest L/c of all blocks as Abaqus/Explicit computes it [s]; not a bound, for report."""


def scaled(matrix: bsr_array | csr_array, mass: FloatArray) -> csr_array:
    """M^-½ A M^-½ with the lumped mass of the nodes (n_nodes,)."""
    root = diags_array(1.0 / np.sqrt(np.repeat(mass, 3)))
    return csr_array(root @ csr_array(matrix) @ root)


def largest_mode(matrix: csr_array | LinearOperator) -> tuple[float, FloatArray]:
    """Largest eigenvalue of a symmetric matrix, from above, and its vector.

    Lanczos; the norm of the residual is added, so the value is an upper bound of the
    eigenvalue that was found. The starting vector is fixed: the same step every time.
    """
    start = np.random.default_rng(0).standard_normal(matrix.shape[0])
    value, vector = eigsh(matrix, k=1, which="LA", v0=start, tol=1e-6)
    x = vector[:, 0]
    residual = np.linalg.norm(matrix @ x - value[0] * x)
    return float(value[0] + residual), x


def viscosity_matrix(body: Body, linear_bulk_viscosity: float) -> csr_array:
    """Damping matrix of the linear bulk viscosity, Σ V b₁ ρ c L B Bᵀ; (3 n, 3 n) [N s/mm]."""
    mesh, material = body.mesh, body.material
    mean, volume = mean_gradients(*gauss_gradients(mesh.nodes[mesh.elements]))
    impedance = linear_bulk_viscosity * material.density * material.dilatational_wave_speed
    weight = impedance * volume * characteristic_length(mesh.nodes[mesh.elements])
    dofs = (3 * mesh.elements[:, :, None] + np.arange(3)).reshape(-1)
    pointer = 24 * np.arange(mesh.n_elements + 1)
    divergence = csr_array(
        (mean.reshape(-1), dofs, pointer), shape=(mesh.n_elements, 3 * mesh.n_nodes)
    )
    return csr_array(divergence.T @ diags_array(weight) @ divergence)


def damping_matrix(body: Body, effects: Effects) -> csr_array | None:
    """Damping that acts on the velocity half a step earlier, (3 n, 3 n) [N s/mm]; or None."""
    total: csr_array | None = None
    if effects.stiffness_damping is not None:
        total = csr_array(body.stiffness) * effects.stiffness_damping
    if effects.bulk_viscosity is not None:
        viscous = viscosity_matrix(body, effects.bulk_viscosity.linear_bulk_viscosity)
        total = viscous if total is None else total + viscous
    return total


def stable_step_of_mode(stiffness: float, damping: float) -> float:
    """Positive root of 4 - Δt² k - 2 Δt c = 0 for xᵀKx = k [1/s²], xᵀCx = c [1/s]; [s]."""
    return 4.0 / (damping + math.sqrt(damping * damping + 4.0 * stiffness))


def body_critical_time_step(
    body: Body, effects: Effects, *, extra_stiffness: FloatArray | None = None
) -> CriticalTimeStep:
    """Critical time step of one free reference block; supports only raise the limit.

    ``extra_stiffness`` is added on the diagonal, as contact does, (n_nodes,) [N/mm].
    """
    stiffness = scaled(body.stiffness, body.lumped_mass)
    if extra_stiffness is not None:
        stiffness = stiffness + diags_array(np.repeat(extra_stiffness / body.lumped_mass, 3))
    largest, mode = largest_mode(stiffness)
    undamped = 2.0 / math.sqrt(largest)
    matrix = damping_matrix(body, effects)
    step = undamped
    if matrix is not None:
        step = _damped_step(stiffness, scaled(matrix, body.lumped_mass), mode, undamped)
    if step < 1e-3 * undamped:
        raise TimeStepError(
            f"{body.name}: damping shrinks the critical time step from {undamped:.3g} s to "
            f"{step:.3g} s; expected rayleigh.stiffness_proportional well below "
            f"{undamped:.3g} s and linear_bulk_viscosity well below 1"
        )
    viscosity = effects.bulk_viscosity
    b1 = 0.0 if viscosity is None else viscosity.linear_bulk_viscosity
    estimate = characteristic_time_step(body.mesh, body.material, linear_bulk_viscosity=b1)
    return CriticalTimeStep(step, undamped, body.name, math.sqrt(largest), estimate)


def _damped_step(
    stiffness: csr_array, damping: csr_array, mode: FloatArray, undamped: float
) -> float:
    """Smallest Δt(x) over all x: the step of a mode, then the worst mode at that step, …."""
    step = undamped
    for _ in range(20):
        previous = step
        value = stable_step_of_mode(mode @ (stiffness @ mode), mode @ (damping @ mode))
        step = min(step, value)
        worst, mode = largest_mode(step * step * stiffness + 2.0 * step * damping)
        if step >= (1.0 - 1e-6) * previous and worst <= 4.0 * (1.0 + 1e-5):
            break
    # What is left above 4 is removed to first order: the bound is at least linear in Δt.
    return step * min(1.0, 4.0 / worst)


def critical_time_step(
    bodies: Sequence[Body], effects: Effects, contact: Sequence[FloatArray] = ()
) -> CriticalTimeStep:
    """Critical time step of the most demanding body.

    ``contact`` is the stiffness of contact to count on the nodes of each body, (n_nodes,) [N/mm].
    Springs to the ground are part of the stiffness of their body.

    Raises
    ------
    ModelError
        Springs of bodies that may turn by any angle.
    """
    if effects.finite_rotation:
        refuse_turning_springs(bodies)
    steps = []
    for number, body in enumerate(bodies):
        extra = contact[number] if contact else None
        steps.append(body_critical_time_step(body, effects, extra_stiffness=extra))
    governing = min(steps, key=lambda s: s.critical_time_step)
    return replace(governing, element_estimate=min(s.element_estimate for s in steps))
