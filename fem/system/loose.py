"""Blocks that nothing holds: by their contacts at a solution, or by supports and springs alone."""

from __future__ import annotations

import numpy as np

from fem.contact.surfaces import ContactPoints
from fem.system.body import ModelError, rigid_motions
from fem.system.contact_state import corner_displacements
from fem.system.system import System, left_by, resisted
from geometry.mesh import FloatArray, IntArray

#: Least stiffness of a block's contacts against a motion, relative to the greatest, that counts
#: as holding the block.
_HELD = 1e-9
_MOTIONS = ("along x", "along y", "along z", "about x", "about y", "about z")


def loose_blocks(
    deformable: System,
    displacements: tuple[FloatArray, ...],
    point_pressures: FloatArray,
    surfaces: ContactPoints,
    representative: IntArray,
) -> IntArray:
    """Blocks that could move while all contacts that press keep pressing, (n,).

    Those with supports or springs are left out.

    Each block is judged with its neighbours at rest: what is named here is certainly not held
    (frictionless contacts on it have fewer than six independent directions); blocks that could
    only move together are not found. Displacements are those of each group in world axes,
    (n_copies, n_nodes, 3) [mm], pressures those of the points of the facets [MPa]. Of blocks that
    one stands for (n_blocks,) that one is judged.
    """
    assembly = deformable.assembly
    pressing = np.flatnonzero((point_pressures > 0.0).any(axis=1))
    surfaces, point_pressures = surfaces.subset(pressing), point_pressures[pressing]
    supported = np.unique(deformable.supports.block)
    loose = []
    moving = deformable.deformable_blocks
    for block in np.unique(representative[moving]):
        group = int(deformable.group_of[block])
        springs = deformable.bodies[group].springs
        if springs is not None or block in supported:
            continue
        arms = assembly.nodes(int(block)) - assembly.centroids[block]
        rows = []
        for side in range(2):
            blocks = (surfaces.block_m, surfaces.block_s)[side]
            mine = np.flatnonzero(assembly.originals[blocks] == block)
            facets = surfaces.subset(mine)
            corners = corner_displacements(deformable, displacements, facets)
            gradient = facets.kinematics(corners).gradient
            force = np.split(gradient, 2, axis=2)[side]
            quads = (facets.quads_m, facets.quads_s)[side]
            moment = np.cross(arms[quads][:, None], force).sum(axis=2)
            wrench = np.concatenate(
                [force.sum(axis=2), moment / assembly.characteristic_length], axis=2
            )
            rows.append(wrench[point_pressures[mine] > 0.0])
        wrenches = np.concatenate(rows)
        stiffness = np.linalg.eigvalsh(wrenches.T @ wrenches)
        if stiffness[0] <= _HELD * stiffness[-1]:
            loose.append(int(block))
    return moving[np.isin(representative[moving], loose)]


def require_supported(system: System) -> None:
    """Reject supports and springs that leave a rigid motion of a block that meets no other.

    Raises
    ------
    ModelError
        Naming the block and the motion.
    """
    for slot in range(system.n_slots):
        _require_held(system, slot)


def _require_held(system: System, slot: int) -> None:
    group, copy = system.body(slot), int(system.copy_of[system.blocks[slot]])
    positions = group.reference_positions()[copy]
    arm = positions - positions.mean(axis=0)
    # Motions about world axes, in those of the block.
    modes = rigid_motions(arm / max(float(np.abs(arm).max()), 1e-300))
    modes = np.einsum("ij,nik->knj", group.rotations[copy], modes)
    left = left_by(resisted(system, slot, modes))
    if len(left):
        motion = _MOTIONS[int(np.argmax(np.abs(left[-1])))]
        raise ModelError(
            f"{group.name}[{copy}]: the supports leave a rigid motion free (mainly {motion}); "
            "expected a static run to hold all six: fix a face, or solve by explicit dynamics"
        )
