"""Plain NumPy twins of the compiled kernels: slow, short, and the ones to read first.

The same mathematics in the same layout, results equal up to rounding; the tests compare them
on random arrays.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import bsr_array

from fem.explicit.body import ElementViscosity
from fem.explicit.kernels.layout import BlockRows, LaneArray
from geometry.mesh import FloatArray, IntArray


def sparse_stiffness(rows: BlockRows) -> bsr_array:
    """Return the packed stiffness as scipy's matrix, in the solver's node order."""
    blocks = rows.blocks.reshape(-1, 3, 3)
    if not rows.reach:
        blocks = blocks.transpose(0, 2, 1)
    size = 3 * rows.n_nodes
    stored = bsr_array((blocks, rows.column, rows.pointer), shape=(size, size))
    if rows.shared is None:
        return stored
    pair = np.zeros(len(rows.column), dtype=bool)
    for first, after in rows.shared:
        pair[first + 1 : after] = True
    mirrored = bsr_array((blocks * pair[:, None, None], rows.column, rows.pointer), stored.shape)
    return bsr_array(stored + mirrored.T, blocksize=(3, 3))


def stiffness_product(rows: BlockRows, displacement: LaneArray) -> LaneArray:
    """K u of every copy, (n_rows, 3, lanes)."""
    flat = displacement.reshape(3 * rows.n_nodes, -1)
    return (sparse_stiffness(rows) @ flat).reshape(displacement.shape)


def torque(displacement: LaneArray, force: LaneArray) -> FloatArray:
    """Sum of u × f over the nodes of every copy, (3, lanes)."""
    return np.cross(displacement, force, axis=1).sum(axis=0)


def torque_magnitude(displacement: LaneArray, force: LaneArray) -> FloatArray:
    """Sum of the magnitudes of all products in `torque`, (3, lanes)."""
    u, f = np.abs(displacement), np.abs(force)
    y, z = (1, 2, 0), (2, 0, 1)
    return (u[:, y] * f[:, z] + u[:, z] * f[:, y]).sum(axis=0)


def update(
    *,
    time_step: float,
    mass_damping: float,
    mass: FloatArray,
    force: LaneArray,
    acceleration: FloatArray,
    displacement: LaneArray,
    velocity: LaneArray,
) -> tuple[LaneArray, LaneArray]:
    """One central difference step as a textbook writes it.

    m (v₊ - v₋)/Δt + α m (v₊ + v₋)/2 = f + m g,  u₊ = u + Δt v₊.

    Returns
    -------
    tuple[LaneArray, LaneArray]
        Displacement and velocity after the step.
    """
    half = 0.5 * time_step * mass_damping
    inertia = force / mass[:, None, None] + acceleration
    after = ((1.0 - half) * velocity + time_step * inertia) / (1.0 + half)
    return displacement + time_step * after, after


def add_at(target: FloatArray, index: IntArray, values: FloatArray, scale: float) -> FloatArray:
    """``target`` with ``scale · values`` added at ``index``, repeated indices adding up."""
    result = target.copy()
    np.add.at(result, index, scale * values)
    return result


def viscous_pressure(
    data: ElementViscosity,
    *,
    per_step: float,
    displacement: LaneArray,
    strain: LaneArray,
    stress: LaneArray,
) -> tuple[LaneArray, LaneArray, FloatArray]:
    """Volumetric strain, V q of every element (`fem.explicit.body`), and the work done.

    Returns
    -------
    tuple[LaneArray, LaneArray, FloatArray]
        New strain and V q, (n_elements, lanes), and ½ (V q_old + V q) · Δstrain (lanes,).
    """
    fresh = np.einsum("eai,eaik->ek", data.gradient, displacement[data.element_rows])
    rate = (fresh - strain) * per_step
    q = data.linear[:, None] * rate - data.quadratic[:, None] * np.minimum(rate, 0.0) ** 2
    return fresh, q, 0.5 * ((stress + q) * (fresh - strain)).sum(axis=0)


def viscous_force(data: ElementViscosity, stress: LaneArray, n_rows: int) -> LaneArray:
    """Nodal forces Σ V q ∇N of all elements, (n_rows, 3, lanes)."""
    force = np.zeros((n_rows, 3, stress.shape[1]))
    np.add.at(force, data.element_rows, np.einsum("eai,ek->eaik", data.gradient, stress))
    return force


def stiffness_damping(
    ratio: float, force: LaneArray, elastic: LaneArray, viscous: LaneArray, increment: LaneArray
) -> tuple[LaneArray, FloatArray]:
    """β/Δt (K u - K u_old), and the work of the mean of old and new force (lanes,)."""
    new: LaneArray = ratio * (force - elastic)
    return new, 0.5 * ((viscous + new) * increment).sum(axis=(0, 1))


def displacement_moments(
    mass: FloatArray, reference: FloatArray, displacement: LaneArray
) -> FloatArray:
    """Σ m u_j (X_x, X_y, X_z, 1), (12, lanes)."""
    extended = np.column_stack([reference, np.ones(len(mass))])
    moments = np.einsum("n,njk,nx->jxk", mass, displacement, extended)
    return moments.reshape(12, -1)


def block_frame_displacement(
    rotation: FloatArray, mean: FloatArray, reference: FloatArray, displacement: LaneArray
) -> LaneArray:
    """Qᵀ (X + u - ū) - X with Q (3, 3, lanes) and ū (3, lanes)."""
    moved = reference[:, :, None] + displacement - mean
    return np.einsum("jik,njk->nik", rotation, moved) - reference[:, :, None]


def place_force(
    rotation: FloatArray,
    spin: FloatArray,
    mass: FloatArray,
    reference: FloatArray,
    force: LaneArray,
) -> LaneArray:
    """Q (f - m ψ × X) with Q (3, 3, lanes) and ψ (3, lanes)."""
    arm = (mass[:, None] * reference)[:, :, None]
    free = force - np.cross(spin[None], arm, axis=1)
    return np.einsum("ijk,njk->nik", rotation, free)
