"""Plain NumPy twins of the compiled kernels: slow, short, and the ones to read first.

Same names, same arguments, same results up to rounding; the tests compare them on random
arrays, and the benchmark quotes them.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import bsr_array

from fem.layout import BlockRows, LaneArray
from geometry.mesh import FloatArray, IntArray


def sparse_stiffness(rows: BlockRows) -> bsr_array:
    """Return the packed stiffness as scipy's matrix, in the solver's node order."""
    blocks = rows.blocks.reshape(-1, 3, 3).transpose(0, 2, 1)
    size = 3 * rows.n_nodes
    return bsr_array((blocks, rows.column, rows.pointer), shape=(size, size))


def stiffness_product(rows: BlockRows, displacement: LaneArray) -> LaneArray:
    """K u of every copy, (n_rows, 3, lanes)."""
    flat = displacement.reshape(3 * rows.n_nodes, -1)
    product: LaneArray = (sparse_stiffness(rows) @ flat).reshape(displacement.shape)
    return product


def torque(displacement: LaneArray, force: LaneArray) -> FloatArray:
    """Sum of u × f over the nodes of every copy, (3, lanes)."""
    moment: FloatArray = np.cross(displacement, force, axis=1).sum(axis=0)
    return moment


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
