"""Orders of the nodes of a hexahedron."""

from __future__ import annotations

import numpy as np

from geometry.mesh import (
    CUBE,
    IntArray,
)


def rotated_numberings() -> IntArray:
    """Orders of a hexahedron's corners that are one of its 24 rotations, (24, 8)."""
    centred = 2 * CUBE - 1
    orders = []
    for first in range(3):
        for second in {0, 1, 2} - {first}:
            for signs in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
                turn = np.zeros((3, 3))
                turn[0, first], turn[1, second] = signs
                turn[2] = np.cross(turn[0], turn[1])
                image = centred @ turn.T
                orders.append([int(np.flatnonzero((centred == p).all(axis=1))[0]) for p in image])
    return np.array(orders)
