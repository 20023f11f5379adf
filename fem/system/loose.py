"""Motions that nothing resists: of single blocks, and of a periodic cell as a whole."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fem.contact.surfaces import ContactPoints
from fem.system.body import ModelError, rigid_motions
from fem.system.contact_state import corner_displacements
from fem.system.system import NodalInverse, Sector, System
from geometry.mesh import FloatArray, IntArray

#: Least stiffness of a block's contacts against a motion, relative to the greatest, that counts
#: as holding the block.
_HELD = 1e-9
#: Resistance of supports to a motion, and loads along it, that are round-off [-].
_RESISTED = 1e-9
_MOTIONS = ("along x", "along y", "along z", "about x", "about y", "about z")


def loose_blocks(
    system: System,
    displacements: tuple[FloatArray, ...],
    point_pressures: FloatArray,
    surfaces: ContactPoints,
    representative: IntArray,
) -> IntArray:
    """Blocks that could move while all contacts that press keep pressing, (n,).

    Those with supports or springs are left out.

    Each block is judged with its neighbours at rest: what is named here is certainly not held
    (frictionless contacts on it have fewer than six independent directions); blocks that could
    only move together are not found. Displacements are those of each body in world axes,
    (n_copies, n_nodes, 3) [mm], pressures those of the points of the facets [MPa]. Of blocks that
    one stands for (n_blocks,) that one is judged.
    """
    assembly, length = system.assembly, system.assembly.characteristic_length
    pressing = np.flatnonzero((point_pressures > 0.0).any(axis=1))
    supported = np.unique(system.supports.block)
    loose = []
    moving = system.deformable_blocks
    for block in np.unique(representative[moving]):
        body = int(system.body_number[block])
        springs = system.bodies[body].springs
        if springs is not None or block in supported:
            continue
        arms = assembly.nodes(int(block)) - assembly.centroids[block]
        motions, rows = rigid_motions(arms / length), []
        for side in range(2):
            blocks = (surfaces.block_m, surfaces.block_s)[side]
            mine = pressing[assembly.originals[blocks[pressing]] == block]
            facets = surfaces.subset(mine)
            corners = corner_displacements(system, displacements, facets)
            gradient = facets.kinematics(corners).gradient
            force = np.split(gradient, 2, axis=2)[side]
            n_facets, n_points, n_nodes, _ = force.shape
            felt = motions[(facets.quads_m, facets.quads_s)[side]].reshape(-1, 3 * n_nodes, 6)
            wrench = force.reshape(n_facets, n_points, 3 * n_nodes) @ felt
            rows.append(wrench[point_pressures[mine] > 0.0])
        wrenches = np.concatenate(rows)
        stiffness = np.linalg.eigvalsh(wrenches.T @ wrenches)
        if stiffness[0] <= _HELD * stiffness[-1]:
            loose.append(int(block))
    return moving[np.isin(representative[moving], loose)]


def require_supported(system: Sector) -> None:
    """Reject supports and springs that leave a rigid motion of a block that meets no other.

    Raises
    ------
    ModelError
        Naming the block and the motion.
    """
    for slot in range(system.n_slots):
        _require_held(system, slot)


def _require_held(system: Sector, slot: int) -> None:
    body, copy = system.body(slot), int(system.whole.copy_of[system.blocks[slot]])
    positions = body.reference_positions()[copy]
    arm = positions - positions.mean(axis=0)
    # Motions about world axes, in those of the block.
    modes = rigid_motions(arm / max(float(np.abs(arm).max()), 1e-300))
    modes = np.einsum("ij,nik->knj", body.rotations[copy], modes)
    left = left_by(resisted(system, slot, modes))
    if len(left):
        motion = _MOTIONS[int(np.argmax(np.abs(left[-1])))]
        raise ModelError(
            f"{body.name}[{copy}]: the supports leave a rigid motion free (mainly {motion}); "
            "expected a static run to hold all six: fix a face, or solve by explicit dynamics"
        )


@dataclass(frozen=True)
class FreeMotions:
    """Motions of a periodic cell as a whole: nothing resists them, and they mean nothing.

    A shift of the cell, and a turn about its axis, change no contact and no stress. With small
    rotations inside the blocks and current normals between them, contact forces balance about the
    displaced positions and internal forces about the original ones, so a torque of second order
    about the axis is left that frames would take and a cell cannot. The static solver keeps both
    out: displacements have no part along these motions (a constraint of the linear problem), and
    the residual does not count the force of that constraint.
    """

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


def unresisted_motions(
    system: Sector, kept: Callable[[FloatArray], FloatArray] = lambda moved: moved
) -> FreeMotions | None:
    """Motions of a periodic cell as a whole that no support or spring resists; None: none.

    Parameters
    ----------
    system
        Blocks and their symmetry: a sector cannot shift across the axis.
    kept
        Takes displacements (n_nodes, 3) to those at the nodes that a linear step keeps.

    Raises
    ------
    ModelError
        Loads along such a motion, which nothing carries.
    """
    assembly = system.whole.assembly
    if assembly.image_of is None:
        return None
    shifts = assembly.axis[None, :] if system.orbits.order > 1 else np.eye(3)
    columns = np.zeros((len(shifts) + 1, system.n_nodes, 3))
    for slot, block in enumerate(system.blocks):
        mine, turn = system.nodes_of(slot), assembly.rotations[block]
        columns[:-1, mine] = (shifts @ turn)[:, None]
        arm = assembly.nodes(int(block)) - assembly.origin
        columns[-1, mine] = np.cross(assembly.axis, arm) @ turn
    columns = np.tensordot(_unresisted(system, columns), columns, axes=1)
    if not len(columns):
        return None
    _require_balance(system, columns)
    basis = np.linalg.qr(np.stack([kept(of).ravel() for of in columns], axis=1))[0]
    return FreeMotions(np.ascontiguousarray(basis.T).reshape(columns.shape))


def _unresisted(system: Sector, motions: FloatArray) -> FloatArray:
    """Combinations of motions (n, n_nodes, 3) that supports and springs leave, (m, n)."""
    size = np.abs(motions).max(axis=(1, 2))
    slots = range(system.n_slots)
    felt = [resisted(system, slot, motions[:, system.nodes_of(slot)]) for slot in slots]
    return left_by(np.concatenate(felt) / size) / size


def resisted(system: Sector, slot: int, motions: FloatArray) -> FloatArray:
    """What supports and springs of a slot feel of motions of it, (n, n_nodes, 3); (m, n)."""
    held, nodes, springs = system.held, system.nodes_of(slot), system.body(slot).springs
    mine = (held.nodes >= nodes.start) & (held.nodes < nodes.stop)
    at_nodes = motions[:, held.nodes[mine] - nodes.start]
    felt = np.einsum("nij,kni->njk", held.axes[mine], at_nodes) * held.held[mine][:, :, None]
    felt = felt.reshape(-1, len(motions))
    if springs is None:
        return felt
    pulled = springs.stiffness @ motions.reshape(len(motions), -1).T
    return np.concatenate([felt, pulled / np.abs(springs.matrices).max()])


def left_by(felt: FloatArray) -> FloatArray:
    """Combinations of motions of order one of which nothing is felt (m, n), (…, n)."""
    n = felt.shape[1]
    _, values, right = np.linalg.svd(np.vstack([felt, np.zeros((n, n))]), full_matrices=False)
    return right[values <= _RESISTED * max(values.max(), 1.0)]


def _require_balance(system: Sector, motions: FloatArray) -> None:
    """Reject loads that move a periodic cell as a whole, along motions (n, n_nodes, 3)."""
    forces = system.loads[-1]
    work = np.abs(np.einsum("kni,ni->k", motions, forces)) / np.abs(motions).max(axis=(1, 2))
    least = _RESISTED * float(np.linalg.norm(forces, axis=1).sum())
    if (work > least).any():
        raise ModelError(
            f"{system.whole.assembly.name}: got loads or a weight that move the periodic cell as a "
            f"whole, by {float(work.max()):.3g} N, and nothing holds it; expected loads that "
            "balance, or supports"
        )
