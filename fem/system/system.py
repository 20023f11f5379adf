"""An assembly as arrays: displacements of representative blocks in their own frames, and contact.

In its own frame every copy of a block has the same stiffness, whatever its placement. The nodes
of all representatives are numbered one block after the other; displacements are (n_nodes, 3).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.sparse import block_diag, csr_array

from fem.contact.friction import Coulomb, coulomb
from fem.contact.surfaces import ContactPoints
from fem.system.body import Body
from fem.system.build import DeformableAssembly
from fem.system.held import Held, held_of
from fem.system.sector import NodeMap, Orbits, local_forces
from geometry.mesh import FloatArray, IntArray


@dataclass(frozen=True)
class System:
    """Blocks of which each stands for those equal to it, their contact, loads and supports."""

    deformable: DeformableAssembly
    """All blocks."""
    orbits: Orbits
    """Which blocks are represented by which."""
    blocks: IntArray
    """Representative deformable blocks, (n_slots,)."""
    slot_of: IntArray
    """Slot of the representative of every block, -1 for rigid ones, (n_blocks,)."""
    node_start: IntArray
    """First node of each slot, and the total; (n_slots + 1,)."""
    rows: NodeMap
    """Row of the state of each node of all blocks, `n_nodes` for rigid ones."""
    points: ContactPoints
    """Facets to integrate, one of each orbit, or points that a search found."""
    law: Coulomb
    """Pressure and friction there."""
    loads: FloatArray
    """In block frames at the end of a path, (1, n_nodes, 3) [N]; of a path that does not begin
    without loads at its beginning and at its end, (2, n_nodes, 3)."""
    held: Held
    """Supports."""

    @property
    def external_force(self) -> FloatArray:
        """Loads at the end of a path, (n_nodes, 3) [N]."""
        return self.loads[-1]

    @property
    def n_nodes(self) -> int:
        """Nodes of all representatives."""
        return int(self.node_start[-1])

    @property
    def n_slots(self) -> int:
        """Number of representatives."""
        return len(self.blocks)

    @property
    def has_friction(self) -> bool:
        """Whether contact has friction."""
        return self.points.sides.shape[2] > 0

    def group(self, slot: int) -> Body:
        """Return the group of a slot."""
        return self.deformable.group(int(self.blocks[slot]))

    def nodes_of(self, slot: int) -> slice:
        """Nodes of a slot."""
        return slice(int(self.node_start[slot]), int(self.node_start[slot + 1]))

    def on(self, points: ContactPoints) -> System:
        """The same with other points of contact."""
        contact, turns = self.deformable.contact, self.orbits.rotations(self.deformable)
        pairs = points.block_m, points.block_s
        bound = replace(
            points,
            rows=self.rows.of_points(points),
            axes=np.stack([turns[of] for of in pairs], axis=1),
            n_rows=self.n_nodes,
            sides=points.sides if contact.friction else points.sides[:, :, :0],
        )
        return replace(self, points=bound, law=coulomb(contact.law, contact.friction, *pairs))

    @property
    def with_reference_normals(self) -> System:
        """The same with normals that do not turn."""
        return replace(self, points=self.points.with_reference_normals)

    @cached_property
    def stiffness(self) -> csr_array:
        """Stiffness of all representatives, (3 n_nodes, 3 n_nodes) [N/mm]."""
        blocks = [self.group(k).stiffness.tocsr() for k in range(self.n_slots)]
        return csr_array(block_diag(blocks, format="csr"))

    def internal_force(self, displacement: FloatArray) -> FloatArray:
        """K u, block by block, (n_nodes, 3) [N]."""
        force = np.empty_like(displacement)
        for slot in range(self.n_slots):
            nodes = self.nodes_of(slot)
            product = self.group(slot).stiffness @ displacement[nodes].ravel()
            force[nodes] = product.reshape(-1, 3)
        return force

    def localised(self, displacements: tuple[FloatArray, ...]) -> FloatArray:
        """Displacements of the representatives in block frames, (n_nodes, 3) [mm].

        Parameters
        ----------
        displacements
            Of each group in world axes, (n_copies, n_nodes, 3) [mm].
        """
        deformable = self.deformable
        parts = []
        for block in self.blocks:
            world = displacements[deformable.group_of[block]][deformable.copy_of[block]]
            parts.append(world @ deformable.assembly.rotations[block])
        return np.concatenate(parts)

    def expand(self, displacement: FloatArray) -> list[FloatArray]:
        """World displacements of every copy of each group, (n_copies, n_nodes, 3) [mm]."""
        deformable, rotations = self.deformable, self.orbits.rotations(self.deformable)
        result = [np.zeros((g.n_copies, g.n_nodes, 3)) for g in deformable.model.groups]
        for block in deformable.deformable_blocks:
            group, copy = int(deformable.group_of[block]), int(deformable.copy_of[block])
            local = displacement[self.rows.of_block(int(block))]
            result[group][copy] = local @ rotations[block].T
        return result


def system_of(deformable: DeformableAssembly, orbits: Orbits) -> System:
    """Number the unknowns of blocks; points are those of matched facets.

    Raises
    ------
    ModelError
        Supports of one node that contradict each other.
    """
    chosen = np.unique(orbits.representative)
    blocks = chosen[deformable.group_of[chosen] >= 0]
    slot = np.full(deformable.assembly.n_blocks, -1, dtype=np.int64)
    slot[blocks] = np.arange(len(blocks))
    slot_of = slot[orbits.representative]
    sizes = [deformable.group(int(b)).n_nodes for b in blocks]
    node_start = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    nodes = orbits.nodes(deformable)
    # A slot of -1 is that beyond the last.
    number = nodes.number + np.repeat(node_start[slot_of], np.diff(nodes.first))
    forces, points = local_forces(deformable), deformable.surfaces.subset(orbits.facets)
    loads = [forces[deformable.group_of[b]][deformable.copy_of[b]] for b in blocks]
    system = System(
        deformable=deformable,
        orbits=orbits,
        blocks=blocks,
        slot_of=slot_of,
        node_start=node_start,
        rows=replace(nodes, number=np.minimum(number, node_start[-1])),
        points=points,
        law=Coulomb(deformable.contact.law),
        loads=np.concatenate(loads)[None],
        held=held_of(deformable, blocks, node_start),
    )
    return system.on(replace(points, weights=orbits.share * points.weights))


def at_share(loads: FloatArray, share: float) -> FloatArray:
    """Loads at a share of a path; of those at its end, or at its beginning and end, (1 or 2, …)."""
    return share * loads[0] if len(loads) == 1 else (1.0 - share) * loads[0] + share * loads[1]


#: Displacements that nodal forces cause: (n_nodes, 3) [N] to (n_nodes, 3) [mm].
NodalInverse = Callable[[FloatArray], FloatArray]


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


def free_motions(
    system: System, kept: Callable[[FloatArray], FloatArray] = lambda moved: moved
) -> FreeMotions | None:
    """Motions of a periodic cell as a whole; None for what is held.

    Parameters
    ----------
    system
        Blocks and their symmetry: a sector cannot shift across the axis.
    kept
        Takes displacements (n_nodes, 3) to those at the nodes that a linear step keeps.
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
    basis = np.linalg.qr(np.stack([kept(of).ravel() for of in columns], axis=1))[0]
    return FreeMotions(np.ascontiguousarray(basis.T).reshape(columns.shape))
