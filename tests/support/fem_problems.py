"""Tiny named finite element problems shared by the tests of fem."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.sparse.linalg import spsolve

from fem import ElementType, Material, Problem
from fem.element.kinds import block_hourglass_stiffness, block_stiffness
from fem.state import State
from fem.system.contact_state import contact_state, corner_displacements
from fem.system.system import System
from geometry.block import Block, box_block
from geometry.mesh import FloatArray, HexMesh, boundary_quads


def deformable_assembly(assembly, load, material, **stated) -> System:
    """Deformable blocks of a statement in any units; what is None is as a statement has it."""
    given = {name: value for name, value in stated.items() if value is not None}
    return Problem(assembly, load, material, **given, check_units=False).system


CONCRETE = Material(density=2.4e-9, young_modulus=30_000.0, poisson_ratio=0.2)


def distorted_box(
    divisions: tuple[int, int, int] = (3, 2, 2), *, seed: int = 3, amount: float = 0.2
) -> HexMesh:
    """Unit cells whose every node is moved at random by up to ``amount`` of an edge."""
    mesh = box_block(tuple(float(n) for n in divisions), divisions).mesh
    rng = np.random.default_rng(seed)
    return HexMesh(mesh.nodes + rng.uniform(-amount, amount, mesh.nodes.shape), mesh.elements)


def boundary_nodes(mesh: HexMesh) -> np.ndarray:
    return np.unique(boundary_quads(mesh))


def degrees_of_freedom(nodes: np.ndarray) -> np.ndarray:
    return (3 * nodes[:, None] + np.arange(3)).ravel()


def static_displacement(stiffness, force, prescribed, values=0.0) -> np.ndarray:
    """Solve K u = f with u[prescribed] = values; (3 n_nodes,)."""
    displacement = np.zeros(len(force))
    displacement[prescribed] = values
    free = np.setdiff1d(np.arange(len(force)), prescribed)
    matrix = stiffness.tocsr()
    right = force - matrix @ displacement
    displacement[free] = spsolve(matrix[free][:, free].tocsc(), right[free])
    return displacement


def in_contact(deformable: System, **stated) -> System:
    """The same blocks with another law, friction or sliding."""
    return replace(deformable, contact=replace(deformable.contact, **stated))


def tip_deflection(
    block: Block, material: Material, element: ElementType, force: float, hourglass: float = 1.0
) -> float:
    """Mean deflection along z of the face x+ under a uniform shear along z, x- clamped.

    ``hourglass`` scales the hourglass stiffness of the reduced element.
    """
    mesh = block.mesh
    weight = np.zeros(mesh.n_nodes)
    np.add.at(weight, block.faces["x+"], 0.25 / len(block.faces["x+"]))
    load = np.zeros((mesh.n_nodes, 3))
    load[:, 2] = force * weight
    stiffness = block_stiffness(mesh, material, element)
    if hourglass != 1.0:
        stiffness = stiffness - (1.0 - hourglass) * block_hourglass_stiffness(
            mesh, material, ElementType.REDUCED
        )
    clamped = degrees_of_freedom(np.unique(block.faces["x-"]))
    displacement = static_displacement(stiffness, load.ravel(), clamped)
    return float(weight @ displacement.reshape(-1, 3)[:, 2])


def pair_resultants(result: State) -> tuple[FloatArray, FloatArray]:
    """Normal force and its moment that each pair transmits, on block s, about the world origin.

    Returns
    -------
    tuple[FloatArray, FloatArray]
        (n_pairs, 3) [N] and (n_pairs, 3) [N mm], pairs as in the surfaces' `pair_start`. The
        moment takes forces at the reference positions of block s.
    """
    deformable, surfaces = result.whole, result.points
    corners = np.split(contact_corner_forces(result), 2, axis=1)[1]
    where = np.empty_like(corners)
    for block in np.unique(surfaces.block_s):
        mine = surfaces.block_s == block
        nodes = deformable.assembly.nodes(int(block)) + deformable.offsets[block]
        where[mine] = nodes[surfaces.quads_s[mine]]
    first = surfaces.pair_start[:-1]
    force = np.add.reduceat(corners.sum(axis=1), first, axis=0)
    moment = np.add.reduceat(np.cross(where, corners).sum(axis=1), first, axis=0)
    return force, moment


def contact_corner_forces(result: State) -> FloatArray:
    """Normal contact forces on the nodes of every facet pair, (n_facets, nodes of both, 3) [N].

    World axes; friction is not in them.
    """
    deformable, surfaces = result.whole, result.points
    displacement = corner_displacements(deformable, result.displacements, surfaces)
    return surfaces.nodal_forces(displacement, result.pressures)


def by_block(state: State) -> FloatArray:
    """Displacements of all nodes, block by block, (n, 3) [mm]."""
    system = state.whole
    places = zip(system.body_number.tolist(), system.copy_of.tolist(), strict=True)
    return np.concatenate([state.displacements[g][c] for g, c in places if g >= 0])


def matched_pressures(
    deformable: System, displacements: tuple[FloatArray, ...]
) -> tuple[FloatArray, FloatArray]:
    """Pressures [MPa] and overclosures [mm] of matched facets, (n_facets, n_points) each."""
    state, shape = contact_state(deformable, displacements), deformable.surfaces.weights.shape
    return state.point_pressures.reshape(shape), state.point_overclosures.reshape(shape)


def loaded_nodes(system: System) -> tuple[FloatArray, FloatArray]:
    """Nodes of all blocks that deform and the loads on them, without weight, world axes.

    (n_nodes, 3) [mm] and alike [N]
    """
    places = [body.reference_positions() for body in system.bodies]
    forces = system.computed.expand(system.computed.nodal_forces(weight=False))
    return tuple(np.concatenate([a.reshape(-1, 3) for a in of]) for of in (places, forces))


def still(system: System, displacements: Sequence[FloatArray]) -> None:
    """Set displacements of each body, (n_copies, n_nodes, 3), to zero at supported nodes."""
    rows = system.supports
    for block, node in zip(rows.block.tolist(), rows.node.tolist(), strict=True):
        displacements[int(system.body_number[block])][system.copy_of[block], node] = 0.0
