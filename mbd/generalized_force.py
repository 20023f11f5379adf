"""Generalized external force: the wrench of the load on each free block."""

from __future__ import annotations

import numpy as np

from geometry.loads.case import LoadCase
from geometry.mesh import FloatArray, IntArray
from geometry.placed_blocks import AnyBlocks


def block_wrenches(assembly: AnyBlocks, load: LoadCase) -> FloatArray:
    """Force and moment of a load about each block's mass centroid.

    Facet forces act at facet centroids, as in Algorithm 1 of the paper, or where the load case
    says.

    Returns
    -------
    FloatArray
        (F, M) per block, (n_blocks, 6) [N, N mm].
    """
    force = load.facet_forces
    arm = load.centroids - assembly.centroids[load.block]
    wrench = np.zeros((assembly.n_blocks, 6))
    # Column by column: several times faster than `np.add.at`.
    for k, column in enumerate(np.hstack([force, np.cross(arm, force)]).T):
        wrench[:, k] = np.bincount(load.block, column, assembly.n_blocks)
    if load.body_wrenches is not None:
        wrench += load.body_wrenches
    return wrench


def generalized_force(
    assembly: AnyBlocks, load: LoadCase, free_blocks: IntArray, length: float
) -> FloatArray:
    """Stack (F, M/ℓ) of the free blocks, the order and scale of the contact Jacobian's rows.

    Returns
    -------
    FloatArray
        (6 n_free,) [N].
    """
    wrench = block_wrenches(assembly, load)[free_blocks]
    wrench[:, 3:] /= length
    return wrench.ravel()
