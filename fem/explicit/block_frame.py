"""One co-rotated frame per block: finite rotations of blocks give no strain.

The frame Q of a copy is the mass-weighted best fit of its reference shape to its deformed
shape (polar decomposition). Displacements are seen from the frame, u' = Qᵀ(X + u - ū) - X,
where the shared stiffness acts. The strain energy E(u'(u)) depends on u through Q as well;
differentiating it in full gives

    f = Q (K u' - m ψ × X),   (tr S · 1 - S) ψ = Σ u' × K u',   S = Qᵀ Σ m (X + u - ū) Xᵀ.

The second term makes the forces of a block torque-free, so a free block keeps its angular
momentum, and it is the exact gradient, so energy is kept as well.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from fem.explicit.body import LaneBody
from fem.explicit.kernels import KernelSet, fit_frames, place_force
from fem.explicit.kernels.layout import LaneArray, aligned_zeros
from fem.explicit.state import BlockFrame


def block_frame(body: LaneBody, *, keep_increment: bool) -> BlockFrame:
    """Frames of undeformed blocks."""
    lanes, n_chunks = body.lanes, len(body.rows.chunks) - 1
    shape = (body.n_rows, 3, lanes)
    quaternion = np.zeros((lanes, 4))
    quaternion[:, 0] = 1.0
    return BlockFrame(
        quaternion=quaternion,
        placing=aligned_zeros((4, 3, lanes)),
        mean=aligned_zeros((3, lanes)),
        compliance=np.zeros((3, 3, lanes)),
        local=aligned_zeros(shape),
        increment=aligned_zeros(shape) if keep_increment else None,
        torque=aligned_zeros((n_chunks, 3, lanes)),
        moment=aligned_zeros((n_chunks, 12, lanes)),
    )


def fit(body: LaneBody, frame: BlockFrame, displacement: LaneArray, kernels: KernelSet) -> None:
    """Turn the frames to the deformed shape and see the displacement from them."""
    kernels.displacement_moments(
        body.rows.chunks,
        body.mass,
        body.reference,
        displacement.ravel(),
        frame.moment.ravel(),
        body.lanes,
    )
    fit_frames(
        frame.moment,
        body.second_moment,
        body.total_mass,
        body.n_copies,
        frame.quaternion,
        frame.turn,
        frame.mean,
        frame.compliance,
    )
    kernels.block_frame_displacement(
        body.rows.chunks,
        frame.turn.ravel(),
        frame.mean.ravel(),
        body.reference,
        displacement.ravel(),
        frame.local.ravel(),
        None if frame.increment is None else frame.increment.ravel(),
        body.lanes,
    )


def placed_force(body: LaneBody, frame: BlockFrame, force: LaneArray) -> LaneArray:
    """Forces of each block made torque-free and turned to the placement axes."""
    result = np.empty_like(force)
    place_force(
        frame.placing.ravel(),
        body.mass,
        body.reference,
        force.ravel(),
        result.ravel(),
        body.lanes,
    )
    return result


def start_frames(frame: BlockFrame, displacement: LaneArray, body: LaneBody) -> None:
    """Fit frames to a displacement that may be turned by any angle (start of a run).

    A singular value decomposition finds the best proper rotation from nowhere; the fit of
    every step starts from the frame before.
    """
    moment = np.einsum("n,nik,nj->kij", body.mass, displacement, body.reference)
    left, _, right = np.linalg.svd(moment + body.second_moment)
    sign = np.ones((len(left), 3))
    sign[:, 2] = np.linalg.det(left @ right)
    rotation = left * sign[:, None, :] @ right
    x, y, z, w = Rotation.from_matrix(rotation).as_quat().T
    frame.quaternion[:] = np.stack([w, x, y, z], axis=1)
