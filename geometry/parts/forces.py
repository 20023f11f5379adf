"""Forces on single nodes of blocks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geometry.mesh import FloatArray, IntArray, ReadOnlyArrays


@dataclass(frozen=True)
class NodeForces(ReadOnlyArrays):
    """Dead forces on nodes of some blocks, which are named by their places."""

    block: IntArray
    """Block of each force, (n,)."""
    centroids: FloatArray
    """Places of the nodes, world coordinates, (n, 3) [mm]."""
    forces: FloatArray
    """World axes, (n, 3) [N]."""

    @property
    def area_vectors(self) -> FloatArray:
        """A node has none, (n, 3)."""
        return np.zeros_like(self.forces)

    def on_nodes(self, block: int, nodes: FloatArray) -> FloatArray | None:
        """Force on each of the nodes (m, 3) [mm] of a block, world axes, (m, 3) [N]; None: none."""
        mine = np.flatnonzero(self.block == block)
        if not len(mine):
            return None
        forces = np.zeros_like(nodes)
        for row in mine.tolist():
            nearest = int(np.argmin(np.linalg.norm(nodes - self.centroids[row], axis=1)))
            forces[nearest] += self.forces[row]
        return forces
