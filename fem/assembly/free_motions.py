"""Motions of a periodic cell as a whole: nothing resists them, and they mean nothing.

A shift of the cell, and a turn about its axis, change no contact and no stress. With small
rotations inside the blocks and current normals between them, contact forces balance about the
displaced positions and internal forces about the original ones, so a torque of second order
about the axis is left that frames would take and a cell cannot. The static solver keeps both out:
displacements have no part along these motions (a constraint of the linear problem), and the
residual does not count the force of that constraint.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fem.assembly.local_system import LocalSystem
from geometry.mesh import BoolArray, FloatArray

#: Displacements that nodal forces cause: (n_nodes, 3) [N] to (n_nodes, 3) [mm].
NodalInverse = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class FreeMotions:
    """Motions that are kept out of displacements and forces."""

    motions: FloatArray
    """Orthonormal, block frames, (n_motions, n_nodes, 3)."""

    def constrained(self, displacement: FloatArray, inverse: NodalInverse) -> FloatArray:
        """Solution of a linear problem without a part along the motions, (n_nodes, 3) [mm].

        Parameters
        ----------
        displacement
            Solution without the constraint, (n_nodes, 3) [mm].
        inverse
            Of the same problem: the motions themselves are the forces of the constraint.
        """
        answers = np.stack([inverse(motion) for motion in self.motions])
        work = np.einsum("kni,lni->kl", self.motions, answers)
        share = np.linalg.solve(work, self._share(displacement))
        return displacement - np.einsum("k,kni->ni", share, answers)

    def without(self, vector: FloatArray) -> FloatArray:
        """Nodal displacements, or forces without those of the constraint, (n_nodes, 3)."""
        return vector - np.einsum("k,kni->ni", self._share(vector), self.motions)

    def _share(self, vector: FloatArray) -> FloatArray:
        return np.einsum("kni,ni->k", self.motions, vector)


def free_motions(system: LocalSystem, nodes: BoolArray) -> FreeMotions | None:
    """Motions of a periodic cell as a whole; None for what is held.

    Parameters
    ----------
    system
        Blocks and their symmetry: a sector cannot shift across the axis.
    nodes
        Nodes that the linear step keeps, (n_nodes,).
    """
    assembly = system.deformable.assembly
    if assembly.image_of is None:
        return None
    shifts = assembly.axis[None, :] if system.orbits.order > 1 else np.eye(3)
    columns = np.zeros((len(shifts) + 1, system.n_nodes, 3))
    for slot, block in enumerate(system.blocks):
        mine, turn = system.nodes_of(slot), assembly.rotations[block]
        columns[:-1, mine] = (shifts @ turn)[:, None]
        arm = assembly.nodes(int(block)) - assembly.origin
        columns[-1, mine] = np.cross(assembly.axis, arm) @ turn
    columns[:, ~nodes] = 0.0
    basis = np.linalg.qr(columns.reshape(len(columns), -1).T)[0]
    return FreeMotions(np.ascontiguousarray(basis.T).reshape(columns.shape))
