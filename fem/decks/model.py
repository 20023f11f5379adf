"""From a deck to a model of this package's solvers: what an imported deck is worth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fem.contact.friction import CoulombFriction
from fem.contact.surfaces import ContactNormals
from fem.decks.keywords import DeckError
from fem.decks.statement import (
    BodyForceLoad,
    Deck,
    DeckLoad,
    Joint,
    NodalForceLoad,
    Procedure,
    named_face,
)
from fem.element.kinds import block_lumped_mass
from fem.system.build import (
    ALL_THE_WAY,
    Contact,
    DeformableAssembly,
    DeformableAssemblyError,
    block_groups,
    touching_surfaces,
)
from fem.system.forces import (
    SmoothStepAmplitude,
    TabularAmplitude,
    pressure_forces,
    traction_forces,
)
from fem.system.model import Model, NodalLoad, Support, fixed_nodes, nodal_load
from geometry.loads import CircumferentialLoad, PressureLoad
from geometry.mesh import FloatArray, HexMesh, IntArray


def block_nodes(deck: Deck, block: int) -> FloatArray:
    """World coordinates of a block's nodes, spacing included, (n_nodes, 3) [mm]."""
    nodes: FloatArray = deck.assembly.nodes(block) + deck.offsets[block]
    return nodes


def nodal_forces(deck: Deck, load: DeckLoad, block: int) -> FloatArray:
    """Consistent nodal forces of one load on one of its blocks, world axes, (n_nodes, 3) [N]."""
    assembly = deck.assembly
    shape = assembly.shape(block)
    if isinstance(load, NodalForceLoad):
        mine = load.blocks == block
        forces = np.zeros((shape.mesh.n_nodes, 3))
        np.add.at(forces, load.nodes[mine], load.forces[mine])
        return forces
    if isinstance(load, BodyForceLoad):
        density = load.force_density[load.blocks == block][0]
        eight = HexMesh(shape.mesh.nodes, shape.mesh.elements)  # corners have all of it
        return np.outer(block_lumped_mass(eight, 1.0), density)
    nodes, corners = block_nodes(deck, block), shape.faces[named_face(load.face)]
    quads = shape.mesh.facet_nodes(corners)
    if isinstance(load, PressureLoad):
        return pressure_forces(nodes, quads, load.pressure)
    if isinstance(load, CircumferentialLoad):
        around = np.cross(assembly.axis, nodes[corners].mean(axis=1) - assembly.origin)
        around *= load.traction / np.linalg.norm(around, axis=1, keepdims=True)
        return traction_forces(nodes, quads, around)
    return traction_forces(nodes, quads, load.traction)


def as_nodal_forces(deck: Deck, load: DeckLoad) -> NodalForceLoad:
    """Return the same load as forces on nodes."""
    blocks, nodes, forces = [], [], []
    for block in np.unique(load.blocks).tolist():
        dense = nodal_forces(deck, load, block)
        where = np.flatnonzero(dense.any(axis=1))
        blocks.append(np.full(len(where), block))
        nodes.append(where)
        forces.append(dense[where])
    return NodalForceLoad(np.concatenate(blocks), np.concatenate(nodes), np.concatenate(forces))


def deck_model(deck: Deck) -> tuple[Model, IntArray, IntArray]:
    """Model of the blocks that are not held altogether, without contact.

    Returns
    -------
    tuple[Model, IntArray, IntArray]
        The model; group and copy of each block, -1 for held ones, (n_blocks,).
    """
    if deck.springs:
        raise DeckError("deck: got springs to the ground, which are written and not read")
    assembly = deck.assembly
    moving = np.ones(assembly.n_blocks, dtype=np.bool_)
    moving[deck.held_blocks] = False
    materials = tuple(deck.materials[k] for k in assembly.shape_of.tolist())
    groups, group_of, copy_of = block_groups(
        assembly, moving, deck.offsets, materials, deck.element
    )
    model = Model(
        groups=groups,
        supports=_supports(deck, group_of, copy_of),
        loads=_loads(deck, group_of, copy_of),
        effects=replace(deck.effects, finite_rotation=deck.step.large_rotations),
    )
    return model, group_of, copy_of


def _supports(deck: Deck, group_of: IntArray, copy_of: IntArray) -> tuple[Support, ...]:
    supports = []
    for hold in deck.holds:
        group = int(group_of[hold.block])
        if group < 0:
            continue
        shape = deck.assembly.shape(hold.block)
        every = np.arange(shape.mesh.n_nodes)
        nodes = every if hold.face is None else np.unique(shape.faces[hold.face])
        if hold.nodes is not None:
            nodes = np.array(hold.nodes)
        copies = [int(copy_of[hold.block])]
        moved = np.full(3, hold.displacement) if hold.displacement else None
        share = TabularAmplitude(*zip(*hold.path, strict=True)) if hold.path else ALL_THE_WAY
        if hold.axes is not None:
            pair = np.reshape(hold.axes, (2, 3))
            frame, n = np.vstack([pair, np.cross(*pair)]), len(nodes)
            supports.append(
                Support(
                    group,
                    np.repeat(copies, n),
                    nodes,
                    np.tile(frame[hold.components[0]], (n, 1)),
                    np.full(n, hold.displacement),
                    None if moved is None else share,
                )
            )
            continue
        supports.append(
            fixed_nodes(
                group,
                nodes,
                copies=copies,
                components=hold.components,
                displacement=moved,
                amplitude=None if moved is None else share,
            )
        )
    return tuple(supports)


def _loads(deck: Deck, group_of: IntArray, copy_of: IntArray) -> tuple[NodalLoad, ...]:
    step = deck.step
    smooth = step.procedure is Procedure.EXPLICIT and step.ramp_time > 0.0
    amplitude = SmoothStepAmplitude(step.ramp_time) if smooth else None
    loads = []
    for load in deck.loads:
        for block in np.unique(load.blocks).tolist():
            if group_of[block] < 0:
                continue
            forces, copies = nodal_forces(deck, load, block), copy_of[[block]]
            loads.append(
                nodal_load(int(group_of[block]), forces, copies=copies, amplitude=amplitude)
            )
    return tuple(loads)


def deck_assembly(
    deck: Deck, *, normals: ContactNormals = ContactNormals.CURRENT
) -> DeformableAssembly:
    """Deformable blocks in contact, for the static and the explicit solver.

    Raises
    ------
    DeformableAssemblyError
        A deck without contact.
    ContactError, AssemblyError
        Blocks that overlap or do not meet.
    """
    if deck.joint is None:
        raise DeformableAssemblyError(f"{deck.name}: the deck has no contact; use its model alone")
    model, group_of, copy_of = deck_model(deck)
    surfaces = touching_surfaces(
        deck.assembly, group_of >= 0, deck.offsets, deck.clearance, deck.joint.law
    )
    return DeformableAssembly(
        assembly=deck.assembly,
        model=model,
        group_of=group_of,
        copy_of=copy_of,
        offsets=deck.offsets,
        surfaces=surfaces,
        contact=Contact(
            deck.joint.law,
            normals,
            _friction(deck.joint),
            deck.joint.finite_sliding or deck.searched,
        ),
    )


def _friction(joint: Joint) -> CoulombFriction | None:
    if joint.friction is None:
        return None
    if joint.stick_stiffness is None:
        return CoulombFriction(joint.friction, of_pairs=joint.of_pairs)
    return CoulombFriction(joint.friction, joint.stick_stiffness, joint.of_pairs)
