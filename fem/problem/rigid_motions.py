"""Six rigid motions of points."""

from __future__ import annotations

import numpy as np

from geometry.mesh import FloatArray


def rigid_motions(arms: FloatArray) -> FloatArray:
    """Unit translations and turns of points about an origin, (n, 3, 6).

    Parameters
    ----------
    arms
        Points from the origin, (n, 3), over a length that makes all six of order one.
    """
    motions = np.zeros((len(arms), 3, 6))
    for axis in range(3):
        motions[:, axis, axis] = 1.0
        motions[:, :, 3 + axis] = np.cross(np.eye(3)[axis], arms)
    return motions
