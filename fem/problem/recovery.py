"""Stresses of a finished run at nodes and integration points, in world axes.

Nodal stresses are recovered as `fem.element.stress.nodal_stress_operator` states: extrapolated
from the integration points, averaged by volume over the elements of the same block. Under finite
rotation the displacement is taken in each block's best-fitting rigid frame, as in the solver.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fem.element.lagrange import LagrangeElement
from fem.element.lagrange_mesh import LagrangeMesh
from fem.element.lagrange_stress import MovedBodies, everywhere, nodal_stress_of
from fem.element.stress import (
    integration_point_stress,
    nodal_stress,
    nodal_stress_operator,
    principal_stress,
    rotate_stress,
)
from fem.problem.model import BlockGroup
from geometry.mesh import FloatArray


@dataclass(frozen=True)
class Recovered:
    """Stresses of one group."""

    stress: FloatArray
    """At nodes, Voigt order of `fem.element.material`, world axes, (n_copies, n_nodes, 6) [MPa]."""
    principal: FloatArray
    """σ₁ >= σ₂ >= σ₃ at nodes, (n_copies, n_nodes, 3) [MPa]."""
    point_principal: FloatArray
    """At integration points, (n_copies, n_points, 3) [MPa]."""


def best_rotations(group: BlockGroup, displacement: FloatArray) -> FloatArray:
    """Rotation of each copy that fits its displacement best, weighted by mass, (n_copies, 3, 3).

    Kabsch's polar fit: R maximises Σ m (x - x̄) · R (X - X̄), from placed blocks to moved ones.
    Displacements are in world axes, (n_copies, n_nodes, 3) [mm].
    """
    mass = group.lumped_mass / group.lumped_mass.sum()
    before = group.reference_positions()
    after = before + displacement
    before = before - np.einsum("n,cni->ci", mass, before)[:, None]
    after = after - np.einsum("n,cni->ci", mass, after)[:, None]
    covariance = np.einsum("n,cni,cnj->cij", mass, after, before)
    left, _, right = np.linalg.svd(covariance)
    sign = np.linalg.det(left @ right)
    left[:, :, 2] *= sign[:, None]
    return left @ right


def block_displacements(
    group: BlockGroup, displacement: FloatArray, *, finite_rotation: bool
) -> tuple[FloatArray, FloatArray]:
    """Displacements in each block's own frame, and the frames.

    Returns
    -------
    FloatArray
        In the axes of the reference block, rigid rotation removed, (n_copies, n_nodes, 3) [mm].
    FloatArray
        From the reference block's axes to the world's, (n_copies, 3, 3).
    """
    frames = group.rotations
    if not finite_rotation:
        return displacement @ frames, frames
    turn = best_rotations(group, displacement)
    placed = group.reference_positions()
    middle = np.einsum("n,cni->ci", group.lumped_mass, placed) / group.lumped_mass.sum()
    moved = placed + displacement
    shift = np.einsum("n,cni->ci", group.lumped_mass, displacement) / group.lumped_mass.sum()
    back = (moved - (middle + shift)[:, None]) @ turn + middle[:, None]
    return (back - placed) @ frames, turn @ frames


def moved_bodies(group: BlockGroup, local: FloatArray) -> MovedBodies:
    """Copies of a group with elements of a higher degree, whose mesh is a `LagrangeMesh`.

    Displacements are those in block frames, (n_copies, n_nodes, 3) [mm].
    """
    mesh = group.mesh
    assert isinstance(mesh, LagrangeMesh)
    element = LagrangeElement(mesh.degree, group.material)
    return MovedBodies(element, mesh.nodes, mesh.members, local)


def recover(
    group: BlockGroup, displacement: FloatArray, *, finite_rotation: bool = False
) -> Recovered:
    """Stresses of all copies of a group.

    From displacements in world axes, (n_copies, n_nodes, 3) [mm]; with finite rotation the rigid
    rotation of each block is removed first.
    """
    local, frames = block_displacements(group, displacement, finite_rotation=finite_rotation)
    if isinstance(group.mesh, LagrangeMesh):
        bodies = moved_bodies(group, local)
        at_nodes, inside = nodal_stress_of(bodies), everywhere(bodies).stress
        return _recovered(at_nodes, inside.reshape(len(local), -1, 6), frames)
    operator = nodal_stress_operator(group.mesh, group.material, group.element)
    at_nodes = nodal_stress(operator, local)
    at_points = integration_point_stress(group.mesh, group.material, group.element, local)
    return _recovered(at_nodes, at_points, frames)


def _recovered(at_nodes: FloatArray, at_points: FloatArray, frames: FloatArray) -> Recovered:
    """Stresses from those in block frames, (n_copies, n, 6) [MPa]."""
    return Recovered(
        stress=rotate_stress(at_nodes, frames),
        principal=principal_stress(at_nodes),
        point_principal=principal_stress(at_points),
    )
