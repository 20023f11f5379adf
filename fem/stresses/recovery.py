"""Stresses of a state: at nodes, at integration points, and the largest and least of them.

Nodal stresses are recovered as `fem.element.kinds.nodal_stress` states. Under finite rotation the
displacement is taken in each block's best-fitting rigid frame, as in the solver.

Peaks are sampled at the integration points inside elements and never averaged across them: at the
acute edge of a block the limit depends on the direction from which it is approached, and a nodal
average of it means nothing.

No criterion of cracking lives at a point. `averaged` stresses are means over the part of a ball
that lies in the block, of the radius of a material length.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fem.element.functions import TensorPoints, tensor_points
from fem.element.hexahedron import at_corners, point_volumes
from fem.element.kinds import integration_points
from fem.element.material import (
    invariants,
    largest_tension,
    principal_stress,
    rotate_stress,
    von_mises,
)
from fem.state import State, once
from fem.stresses.ball_averages import (
    MovedBodies,
    averaged_tension,
    means_at_elements,
    moved_bodies,
)
from fem.system.body import Body
from fem.system.system import System
from geometry.mesh import HEX_FACES, FloatArray, IntArray, ReadOnlyArrays, cross_matrix
from geometry.parts.measures import first_largest


@dataclass(frozen=True)
class Recovered(ReadOnlyArrays):
    """Stresses of one body."""

    stress: FloatArray
    """At nodes, Voigt order of `fem.element.material`, world axes, (n_copies, n_nodes, 6) [MPa]."""
    principal: FloatArray
    """σ₁ >= σ₂ >= σ₃ at nodes, (n_copies, n_nodes, 3) [MPa]."""
    body: Body
    local: FloatArray
    """Displacements in block frames, (n_copies, n_nodes, 3) [mm]."""

    @cached_property
    def point_principal(self) -> FloatArray:
        """At integration points, (n_copies, n_points, 3) [MPa]."""
        return principal_stress(self.body.point_stress(self.local))


def best_turns(body: Body, displacement: FloatArray) -> FloatArray:
    """R - 1 of each copy, of the rotation that fits its displacement best, (n_copies, 3, 3).

    Kabsch's polar fit weighted by mass: R maximises Σ m (x - x̄) · R (X - X̄), from placed blocks to
    moved ones. A step of Newton's method from small numbers gives all digits of small rotations.
    Displacements are in world axes, (n_copies, n_nodes, 3) [mm].
    """
    from scipy.spatial.transform import Rotation

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
        body=body,
        local=local,
    )


@once
def recovered_of(state: State) -> tuple[Recovered, ...]:
    """Stresses of each body at its nodes and integration points."""
    bodies = zip(state.whole.bodies, state.displacements, strict=True)
    return tuple(recover(g, u, finite_rotation=state.finite_rotation) for g, u in bodies)


@once
def nodal_principal(state: State) -> FloatArray:
    """σ₁ >= σ₂ >= σ₃ at the nodes of the blocks that are computed, (n_nodes, 3) [MPa]."""
    system, whole = state.system, state.whole
    result = np.empty((system.n_nodes, 3))
    for number, (body, u) in enumerate(zip(whole.bodies, state.displacements, strict=True)):
        slots = np.flatnonzero(whole.body_number[system.blocks] == number)
        local, _ = block_displacements(body, u, finite_rotation=state.finite_rotation)
        stress = body.nodal_stress(local[whole.copy_of[system.blocks[slots]]])
        for slot, values in zip(slots.tolist(), principal_stress(stress), strict=True):
            result[system.nodes_of(slot)] = values
    return result


def principal_of(state: State, block: int) -> FloatArray:
    """Principal stresses at the nodes of a block that deforms, (n_nodes, 3) [MPa]."""
    rows = state.system.rows[block, : state.whole.body_of(block).n_nodes]
    return nodal_principal(state)[rows]


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


# ---------------------------------------------------------------------------------------------
# Largest and least stresses, with their place


@dataclass(frozen=True)
class Peak(ReadOnlyArrays):
    """A largest value and where it is."""

    value: float
    """[MPa], or [mm] of a displacement."""
    blocks: tuple[int, ...]
    """The block, or the two that press on each other."""
    position: FloatArray
    """World axes, before the load acts, (3,) [mm]."""
    face: str | None
    """Named face of the first block that the element or facet lies on; None inside."""
    resolved: bool = True
    """Whether the integration points resolve the value."""


@dataclass(frozen=True)
class StressPeaks:
    """Largest and least principal stresses of an assembly."""

    sigma_1: Peak
    """Largest first principal stress at an integration point."""
    sigma_3: Peak
    """Least third principal stress there."""
    mises: Peak
    """Largest von Mises stress there."""
    sigma_1_averaged: Peak
    """Largest first principal stress of the stress averaged over a ball; the ball's centre."""
    averaging_radius: float
    """Radius of that ball [mm]."""
    averaged_over: str
    """The ball in words; the element in its middle where that is larger and of degree 1."""
    sigma_1_at_corners: float
    """Largest first principal stress at a corner of an element, continued from its own integration
    points: what those may hide [MPa]."""
    sigma_3_at_corners: float
    """Least third principal stress there [MPa]."""
    mises_at_corners: float
    """Largest von Mises stress there [MPa]."""


@once
def stress_peaks(state: State) -> StressPeaks:
    """Sample the stresses inside all elements; balls have the radius that each material states."""
    result = [_group_peaks(state.whole, *moved) for moved in _moved_blocks(state)]
    averaged = result[first_largest(np.array([f.sigma_1_averaged.value for f in result]))]
    return StressPeaks(
        sigma_1=_largest([f.sigma_1 for f in result]),
        sigma_3=_largest([f.sigma_3 for f in result], -1.0),
        mises=_largest([f.mises for f in result]),
        sigma_1_averaged=averaged.sigma_1_averaged,
        averaging_radius=averaged.averaging_radius,
        averaged_over=averaged.averaged_over,
        sigma_1_at_corners=max(f.sigma_1_at_corners for f in result),
        sigma_3_at_corners=min(f.sigma_3_at_corners for f in result),
        mises_at_corners=max(f.mises_at_corners for f in result),
    )


def nodal_stress_range(state: State) -> tuple[float, float]:
    """Least σ₃ and largest σ₁ at the nodes [MPa]."""
    found = [body.nodal_stress(u) for body, _, u in _moved_blocks(state)]
    least = min(-largest_tension(-stress).max() for stress in found)
    return least, max(largest_tension(stress).max() for stress in found)


def _moved_blocks(state: State) -> Iterator[tuple[Body, IntArray, FloatArray]]:
    """Bodies, those of their blocks that are judged (n,), and how these moved in their frames.

    Displacements are (n, n_nodes, 3) [mm]. Static states are searched in the blocks that are
    computed, explicit ones in all.
    """
    whole = state.whole
    chosen = whole.deformable_blocks
    if state.run is None:
        chosen = np.unique(state.system.orbits.representative[chosen])
    for number, (body, u) in enumerate(zip(whole.bodies, state.displacements, strict=True)):
        local, _ = block_displacements(body, u, finite_rotation=state.finite_rotation)
        blocks = chosen[whole.body_number[chosen] == number]
        yield body, blocks, local[whole.copy_of[blocks]]


def _largest(peaks: list[Peak], sign: float = 1.0) -> Peak:
    values = sign * np.array([peak.value for peak in peaks])
    return replace(peaks[first_largest(values)], value=sign * float(values.max()))


def _group_peaks(system: System, body: Body, blocks: IntArray, local: FloatArray) -> StressPeaks:
    """Of blocks of one body, from displacements in their frames (n_blocks, n_nodes, 3) [mm]."""
    radius = body.material.averaging_radius
    averaged_over = f"a sphere of radius {radius:g} mm"
    linear, stress = body.element.degree == 1, body.point_stress(local)
    points = integration_points(body.mesh, body.element)
    per_element = len(points) // body.mesh.n_elements

    def placed(value: float, copy: int, where: FloatArray, element: int | None = None) -> Peak:
        block, face = int(blocks[copy]), None
        if element is not None:
            face = _element_face(system, block, element, where)
        world = system.assembly.place(block, where[None])[0] + system.offsets[block]
        return Peak(value, (block,), world, face)

    def peak(values: FloatArray, at: FloatArray, sign: float = 1.0) -> Peak:
        copy, row = (int(k) for k in np.unravel_index(first_largest(values), values.shape))
        element = row // per_element if linear and at is points else None
        return placed(sign * float(values.max()), copy, at[row], element)

    first = peak(largest_tension(stress), points)
    third = peak(largest_tension(-stress), points, -1.0)
    mises = peak(np.sqrt(3.0 * invariants(stress)[1]), points)
    if linear:
        centres, means = means_at_elements(body, stress, radius)
        averaged = peak(largest_tension(means), centres)
        volumes = point_volumes(body.mesh.nodes[body.mesh.elements]).sum(axis=1)
        if volumes.min() > 4.0 / 3.0 * np.pi * radius**3:
            averaged_over = f"an element, larger than {averaged_over}"
        at_corners = _corner_extremes(body, stress)
    else:  # points hide nothing towards corners, where polynomials overshoot
        of_ball, at_cells = averaged_tension(moved_bodies(body, local), radius)
        averaged = placed(of_ball.value, of_ball.layer - 1, of_ball.position)
        if first.value < averaged.value:  # of a large element they are far from its ends
            first = placed(at_cells.value, at_cells.layer - 1, at_cells.position)
        at_corners = first.value, third.value, mises.value
    return StressPeaks(first, third, mises, averaged, radius, averaged_over, *at_corners)


def _corner_extremes(body: Body, stress: FloatArray) -> tuple[float, float, float]:
    """Largest σ₁, least σ₃ and largest von Mises stress at corners of elements.

    Of those elements that hold half of the extreme inside.
    """
    stress = stress.reshape(-1, len(body.element.points), 6)
    values = principal_stress(stress)
    first, third = values[:, :, 0].max(axis=1), values[:, :, 2].min(axis=1)
    mises = von_mises(values).max(axis=1)
    high = stress[first >= first.max() - 0.5 * abs(first.max())]
    low = stress[third <= third.min() + 0.5 * abs(third.min())]

    def corners(inside: FloatArray) -> FloatArray:
        return principal_stress(at_corners(inside))

    return (
        float(corners(high)[:, :, 0].max()),
        float(corners(low)[:, :, 2].min()),
        float(von_mises(corners(stress[mises >= 0.5 * mises.max()])).max()),
    )


# ---------------------------------------------------------------------------------------------
# Places


def _element_face(system: System, block: int, element: int, at: FloatArray) -> str | None:
    """Named face nearest to a point among those that its element lies on."""
    shape = system.assembly.shape(block)
    own = np.sort(shape.mesh.elements[element][HEX_FACES], axis=1)
    best: tuple[float, str | None] = (np.inf, None)
    for name, quads in shape.faces.items():
        sides = (np.sort(quads, axis=1)[:, None] == own[None]).all(axis=2)
        for quad in quads[sides.any(axis=1)]:
            distance = float(np.linalg.norm(shape.mesh.nodes[quad].mean(axis=0) - at))
            best = min(best, (distance, name), key=lambda pair: pair[0])
    return best[1]


def nearest_face(system: System, block: int, where: FloatArray) -> str | None:
    """Named face with the facet nearest to a point; contact faces first where two meet."""
    assembly = system.assembly
    shape = assembly.shape(block)
    nodes = assembly.nodes(block) + system.offsets[block]
    names = [*shape.contact_faces, *(n for n in shape.faces if n not in shape.contact_faces)]
    distances = {
        name: float(np.linalg.norm(nodes[np.unique(shape.faces[name])] - where, axis=1).min())
        for name in names
    }
    return min(distances, key=lambda name: distances[name], default=None)
