"""What current normals change against reference ones where blocks turn.

About a displacement with motions α₀ of the blocks, and with forces q of the points, the overclosure
and the balance of the motions are those of reference normals and

    D (α - α₀),      Dᵀ q + T (α - α₀)      with  D = ∂x/∂α - ∂x_ref/∂α,  T = Σ q ∂²x/∂α².

T is what holds blocks that slide in their gaps: no other stiffness resists such motions.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fem.contact.surfaces import motion_derivatives
from fem.system.system import Sector
from geometry.mesh import FloatArray


@dataclass(frozen=True)
class Turned:
    """What normals change at one displacement; joints are the block pairs of the surfaces."""

    by_motions: FloatArray
    """D by the motions of both blocks, (2, n, 6)."""
    stiffness: FloatArray
    """T by the motions of both blocks of each joint, (n_joints, 2, 6, 2, 6)."""

    @property
    def without_stiffness(self) -> Turned:
        """The same as if forces did not turn with the blocks."""
        return replace(self, stiffness=np.zeros_like(self.stiffness))


class TurningNormals:
    """Normals between blocks of a system whose motions are combinations of six."""

    def __init__(self, system: Sector, motions: FloatArray) -> None:
        """Take displacements of all nodes by unit motions of their blocks, (6, n_nodes, 3)."""
        self._surfaces = system.points
        each = np.stack([self._surfaces.moved(moved) for moved in motions], axis=3)
        # By the six motions of the first block, then by those of the second.
        half = each.shape[1] // 2
        self._corners = np.zeros((*each.shape[:3], 12))
        self._corners[:, :half, :, :6] = each[:, :half]
        self._corners[:, half:, :, 6:] = each[:, half:]

    @cached_property
    def _straight(self) -> FloatArray:
        """∂x_ref/∂α, (n_facets, n_points, 12)."""
        straight = self._surfaces.with_reference_normals
        gradient = straight.kinematics(np.zeros(self._corners.shape[:3])).gradient
        return np.einsum("fpai,faim->fpm", gradient, self._corners, optimize=True)

    @property
    def none(self) -> Turned:
        """Of reference normals."""
        n_joints = len(self._surfaces.pair_start) - 1
        by_motions = np.zeros((2, self._surfaces.weights.size, 6))
        return Turned(by_motions, np.zeros((n_joints, 2, 6, 2, 6)))

    def turned(self, displacement: FloatArray, forces: FloatArray) -> Turned:
        """What normals change at a displacement in block frames, (n_nodes, 3) [mm].

        From the forces of the points, (n_facets, n_points) [N].
        """
        corners = self._surfaces.moved(displacement)
        first, second = motion_derivatives(self._surfaces, corners, self._corners)
        by_motions = (first - self._straight).reshape(-1, 2, 6)
        of_facets = np.einsum("fp,fpkl->fkl", forces, second)
        stiffness = np.add.reduceat(of_facets, self._surfaces.pair_start[:-1])
        return Turned(by_motions.transpose(1, 0, 2), stiffness.reshape(-1, 2, 6, 2, 6))
