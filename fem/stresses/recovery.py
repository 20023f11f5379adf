"""Stresses of a finished run at nodes and integration points, in world axes.

Nodal stresses are recovered as `fem.element.kinds.nodal_stress` states. Under finite
rotation the displacement is taken in each block's best-fitting rigid frame, as in the solver.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from fem.element.functions import TensorPoints, tensor_points
from fem.element.lagrange import Lagrange
from fem.element.material import Material, principal_stress, rotate_stress
from fem.state import State, once
from fem.system.body import Body
from geometry.mesh import FloatArray, IntArray, ReadOnlyArrays, cross_matrix


@dataclass(frozen=True)
class Recovered(ReadOnlyArrays):
    """Stresses of one body."""

    stress: FloatArray
    """At nodes, Voigt order of `fem.element.material`, world axes, (n_copies, n_nodes, 6) [MPa]."""
    principal: FloatArray
    """σ₁ >= σ₂ >= σ₃ at nodes, (n_copies, n_nodes, 3) [MPa]."""
    group: Body
    local: FloatArray
    """Displacements in block frames, (n_copies, n_nodes, 3) [mm]."""

    @cached_property
    def point_principal(self) -> FloatArray:
        """At integration points, (n_copies, n_points, 3) [MPa]."""
        return principal_stress(self.group.point_stress(self.local))


def best_turns(body: Body, displacement: FloatArray) -> FloatArray:
    """R - 1 of each copy, of the rotation that fits its displacement best, (n_copies, 3, 3).

    Kabsch's polar fit weighted by mass: R maximises Σ m (x - x̄) · R (X - X̄), from placed blocks to
    moved ones. A step of Newton's method from small numbers gives all digits of small rotations.
    Displacements are in world axes, (n_copies, n_nodes, 3) [mm].
    """
    share = body.lumped_mass / body.lumped_mass.sum()
    arms = _arms(body) @ body.rotations.transpose(0, 2, 1)
    of_shape = np.einsum("n,cni,cnj->cij", share, arms, arms)
    of_moves = np.einsum("n,cni,cnj->cij", share, displacement, arms)
    left, _, right = np.linalg.svd(of_shape + of_moves)
    left[:, :, 2] *= np.linalg.det(left @ right)[:, None]
    turn = _turn(Rotation.from_matrix(left @ right).as_rotvec())
    back = (turn + np.eye(3)).transpose(0, 2, 1)
    moved = turn.transpose(0, 2, 1) @ of_shape + back @ of_moves
    about = np.stack([moved[:, 2, 1], moved[:, 0, 2], moved[:, 1, 0]], axis=1)
    about -= np.stack([moved[:, 1, 2], moved[:, 2, 0], moved[:, 0, 1]], axis=1)
    fit = of_shape + moved
    inertia = np.trace(fit, axis1=1, axis2=2)[:, None, None] * np.eye(3) - fit
    further = _turn(np.linalg.solve(inertia, about[:, :, None])[:, :, 0])
    result: FloatArray = turn + further + turn @ further
    return result


def _arms(body: Body) -> FloatArray:
    """Nodes of the reference block from its centre of mass, (n_nodes, 3) [mm]."""
    mass, nodes = body.lumped_mass, body.mesh.nodes
    result: FloatArray = nodes - mass @ nodes / mass.sum()
    return result


def _turn(vectors: FloatArray) -> FloatArray:
    """R - 1 of rotation vectors (n, 3) by Rodrigues' formula, (n, 3, 3)."""
    angle = np.linalg.norm(vectors, axis=1)[:, None, None]
    cross = cross_matrix(vectors)
    half = np.sinc(angle / (2.0 * np.pi))
    result: FloatArray = np.sinc(angle / np.pi) * cross + 0.5 * half**2 * cross @ cross
    return result


def block_displacements(
    body: Body, displacement: FloatArray, *, finite_rotation: bool
) -> tuple[FloatArray, FloatArray]:
    """Displacements in each block's own frame, and the frames.

    Returns
    -------
    FloatArray
        In the axes of the reference block, rigid rotation removed, (n_copies, n_nodes, 3) [mm].
    FloatArray
        From the reference block's axes to the world's, (n_copies, 3, 3).
    """
    frames = body.rotations
    if not finite_rotation:
        return displacement @ frames, frames
    turn = best_turns(body, displacement)
    mean = body.lumped_mass @ displacement / body.lumped_mass.sum()
    moved = displacement - mean[:, None]
    back = moved + moved @ turn + _arms(body) @ frames.transpose(0, 2, 1) @ turn
    return back @ frames, frames + turn @ frames


@dataclass(frozen=True)
class MovedBodies:
    """Congruent bodies of curved elements, each in its own frame."""

    element: Lagrange
    material: Material
    positions: FloatArray
    """Nodes, (n_nodes, 3) [mm]."""
    elements: IntArray
    """Nodes of each element, (n_elements, (degree + 1)³)."""
    displacements: FloatArray
    """Of the nodes of every body, (n_bodies, n_nodes, 3) [mm]."""


def moved_bodies(body: Body, local: FloatArray) -> MovedBodies:
    """Copies of a body with elements of a degree above 1.

    Displacements are those in block frames, (n_copies, n_nodes, 3) [mm].
    """
    mesh, element = body.mesh, Lagrange(body.mesh.degree)
    return MovedBodies(element, body.material, mesh.nodes, mesh.connectivity, local)


def recover(body: Body, displacement: FloatArray, *, finite_rotation: bool = False) -> Recovered:
    """Stresses of all copies of a body.

    From displacements in world axes, (n_copies, n_nodes, 3) [mm]; with finite rotation the rigid
    rotation of each block is removed first.
    """
    local, frames = block_displacements(body, displacement, finite_rotation=finite_rotation)
    at_nodes = body.nodal_stress(local)
    return Recovered(
        stress=rotate_stress(at_nodes, frames),
        principal=principal_stress(at_nodes),
        group=body,
        local=local,
    )


@once
def recovered_of(state: State) -> tuple[Recovered, ...]:
    """Stresses of each body at its nodes and integration points."""
    bodies = zip(state.whole.bodies, state.displacements, strict=True)
    return tuple(recover(g, u, finite_rotation=state.finite_rotation) for g, u in bodies)


def principal_of(state: State, block: int) -> FloatArray:
    """Principal stresses at the nodes of a block that deforms, (n_nodes, 3) [MPa]."""
    whole = state.whole
    return recovered_of(state)[int(whole.body_number[block])].principal[int(whole.copy_of[block])]


@dataclass(frozen=True)
class LagrangeCells:
    """All elements of bodies, each with equidistant nodes of its own."""

    degree: int
    positions: FloatArray
    """In the body's own frame, (n_elements, n_points, 3) [mm]; last direction fastest."""
    displacement: FloatArray
    """The same, (n_bodies, n_elements, n_points, 3) [mm]."""
    stress: FloatArray
    """xx, yy, zz, xy, yz, xz in that frame, (n_bodies, n_elements, n_points, 6) [MPa]."""

    @cached_property
    def principal(self) -> FloatArray:
        """σ₁ ≥ σ₂ ≥ σ₃, (n_bodies, n_elements, n_points, 3) [MPa]."""
        return principal_stress(self.stress)


def cells_of(bodies: MovedBodies) -> LagrangeCells:
    """Evaluate every element at equidistant nodes: what was computed, jumps included."""
    degree = bodies.element.degree
    at = equidistant(degree)
    nodes, moved = bodies.positions[bodies.elements], bodies.displacements[:, bodies.elements]
    stress = bodies.element.stress_at(nodes, bodies.material, moved, at)
    return LagrangeCells(degree, at.values @ nodes, at.values @ moved, stress)


def equidistant(degree: int) -> TensorPoints:
    """Functions at the nodes of Lagrange cells."""
    return tensor_points(degree, np.linspace(-1.0, 1.0, degree + 1))


def grid_places(degree: int) -> IntArray:
    """Place in each direction of each point of `LagrangeCells`, (n_points, 3)."""
    return np.indices((degree + 1,) * 3, dtype=np.int64).reshape(3, -1).T
