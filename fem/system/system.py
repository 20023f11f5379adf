"""Unknowns of a static problem: displacements of the representative blocks in their own frames.

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
from fem.contact.law import ContactLaw
from fem.contact.surfaces import ContactPoints
from fem.system.build import DeformableAssembly
from fem.system.held import Held, held_of
from fem.system.model import BlockGroup
from fem.system.sector import NodeMap, Orbits, local_forces
from geometry.mesh import BoolArray, FloatArray, IntArray
from geometry.work import Operation, count


@dataclass(frozen=True)
class Gaps:
    """Overclosures of all contact points, with friction also their slips, and their derivatives."""

    x: FloatArray
    """Overclosure, then slips along `ContactPoints.sides`, (n_facets, n_points, 1 or 3) [mm]."""
    gradient: FloatArray
    """∂x/∂u in block frames, (n_facets, n_points, 1 or 3, nodes of both facets, 3)."""

    @property
    def overclosure(self) -> FloatArray:
        """Overclosures alone, (n_facets, n_points) [mm]."""
        return self.x[..., 0]


@dataclass(frozen=True)
class LocalSystem:
    """Representative blocks, the facets between them, their loads and supports."""

    deformable: DeformableAssembly
    """The whole model."""
    orbits: Orbits
    """Which blocks are represented by which."""
    blocks: IntArray
    """Representative deformable blocks, (n_slots,)."""
    slot_of: IntArray
    """Slot of the representative of every block, -1 for rigid ones, (n_blocks,)."""
    node_start: IntArray
    """First node of each slot, and the total; (n_slots + 1,)."""
    rows: NodeMap
    """Row of the state of each node of all blocks, `n_nodes` for rigid ones: a sector, a half turn
    or a periodic image is a map of rows."""
    surfaces: ContactPoints
    """Facets to integrate, one of each orbit, or points that a search found."""
    external_force: FloatArray
    """Loads in block frames, (n_nodes, 3) [N]."""
    held: Held
    """Supports."""

    @cached_property
    def law(self) -> ContactLaw:
        """Contact law of `surfaces`."""
        return self.deformable.contact.law.on(self.surfaces.block_m, self.surfaces.block_s)

    @cached_property
    def coulomb(self) -> Coulomb:
        """The same with friction."""
        surfaces, friction = self.surfaces, self.deformable.contact.friction
        return coulomb(self.law, friction, surfaces.block_m, surfaces.block_s)

    @property
    def n_nodes(self) -> int:
        """Nodes of all representatives."""
        return int(self.node_start[-1])

    @property
    def n_slots(self) -> int:
        """Number of representatives."""
        return len(self.blocks)

    def group(self, slot: int) -> BlockGroup:
        """Return the group of a slot."""
        return self.deformable.group(int(self.blocks[slot]))

    def nodes_of(self, slot: int) -> slice:
        """Nodes of a slot."""
        return slice(int(self.node_start[slot]), int(self.node_start[slot + 1]))

    @cached_property
    def corner_nodes(self) -> IntArray:
        """Rows of the nodes of both facets, m's first, (n_facets, 2 m)."""
        return self.rows.of_points(self.surfaces)

    @cached_property
    def rotations(self) -> FloatArray:
        """Rotations of master and opposing block of each facet, (n_facets, 2, 3, 3)."""
        turns = self.orbits.rotations(self.deformable)
        return np.stack([turns[self.surfaces.block_m], turns[self.surfaces.block_s]], axis=1)

    @cached_property
    def moves(self) -> FloatArray:
        """One at the nodes of deformable blocks, zero at those of rigid ones, (n, 2 m)."""
        return (self.corner_nodes < self.n_nodes).astype(np.float64)

    def corner_displacements(self, displacement: FloatArray) -> FloatArray:
        """World displacements of the nodes of facets, (n_facets, 2 m, 3) [mm]."""
        padded = np.concatenate([displacement, np.zeros((1, 3))])
        shape = (*self.corner_nodes.shape, 3)
        local = padded[self.corner_nodes].reshape(-1, 2, shape[1] // 2, 3)
        return np.einsum("fbij,fbaj->fbai", self.rotations, local).reshape(shape)

    def local_gradient(self, gradient: FloatArray) -> FloatArray:
        """World gradients (n, n_points, 2 m, 3) in block frames, zero at rigid blocks."""
        shape = gradient.shape
        split = gradient.reshape(*shape[:2], 2, shape[2] // 2, 3)
        local: FloatArray = (split @ self.rotations[:, None]).reshape(shape)
        local *= self.moves[:, None, :, None]
        return local

    @property
    def with_reference_normals(self) -> LocalSystem:
        """The same with normals that do not turn."""
        return replace(self, surfaces=self.surfaces.with_reference_normals)

    def gaps(self, displacement: FloatArray) -> Gaps:
        """Overclosures at a displacement, and slips where there is friction."""
        world = self.surfaces.kinematics(self.corner_displacements(displacement))
        count(Operation.POINT, world.gradient.size / 3.0)
        x, gradient = world.overclosure[..., None], self.local_gradient(world.gradient)[:, :, None]
        if self.deformable.contact.friction is None:
            return Gaps(x, gradient)
        return Gaps(
            np.concatenate([x, self.gather(self._by_slips, displacement)], axis=2),
            np.concatenate([gradient, self._by_slips], axis=2),
        )

    @cached_property
    def _by_slips(self) -> FloatArray:
        """∂(slip)/∂u, (n_facets, n_points, 2, nodes of both facets, 3)."""
        world = np.einsum("fpa,fpki->fpkai", self.surfaces.functions, self.surfaces.sides)
        n, p, _, a, _ = world.shape
        return self.local_gradient(world.reshape(n, 2 * p, a, 3)).reshape(world.shape)

    def gather(self, gradient: FloatArray, displacement: FloatArray) -> FloatArray:
        """Product of gradients (n_facets, …, 2 m, 3) with a displacement, (n_facets, …) [mm]."""
        padded = np.concatenate([displacement, np.zeros((1, 3))])
        rows = _flat(gradient)
        moved = np.einsum("fpai,fai->fp", rows, padded[self.corner_nodes], optimize=True)
        return moved.reshape(gradient.shape[:-2])

    def scatter(self, gradient: FloatArray, point_forces: FloatArray) -> FloatArray:
        """Nodal forces -Σ w t ∂x/∂u of forces w t (n_facets, …) [N], (n_nodes, 3) [N]."""
        rows = _flat(gradient)
        forces = point_forces.reshape(rows.shape[:2])
        return self._gathered(-np.einsum("fp,fpai->fai", forces, rows))

    def scatter_corners(self, corner_forces: FloatArray) -> FloatArray:
        """Nodal forces of forces on the nodes of facets in world axes, (n_nodes, 3) [N]."""
        shape = (*self.corner_nodes.shape, 3)
        split = corner_forces.reshape(-1, 2, shape[1] // 2, 3)
        local = np.einsum("fbij,fbai->fbaj", self.rotations, split)
        return self._gathered(local.reshape(shape))

    def _gathered(self, corner: FloatArray) -> FloatArray:
        """Sum forces on nodes of facets in block frames at the nodes."""
        forces = np.empty((self.n_nodes, 3))
        where = self.corner_nodes.ravel()
        for i in range(3):
            values = corner[:, :, i].ravel()
            forces[:, i] = np.bincount(where, values, minlength=self.n_nodes + 1)[:-1]
        return forces

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


def _flat(gradient: FloatArray) -> FloatArray:
    """All rows of each facet, (n_facets, …, 2 m, 3) to (n_facets, n_rows, 2 m, 3)."""
    n_rows = int(np.prod(gradient.shape[1:-2]))
    return gradient.reshape(len(gradient), n_rows, *gradient.shape[-2:])


def local_system(
    deformable: DeformableAssembly, orbits: Orbits, searched: ContactPoints | None = None
) -> LocalSystem:
    """Number the unknowns of a static problem, on matched facets or on points of a search.

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
    rows = replace(nodes, number=np.minimum(number, node_start[-1]))
    surfaces = searched
    if surfaces is None:
        surfaces = deformable.surfaces.subset(orbits.facets)
        surfaces = replace(surfaces, weights=orbits.share * surfaces.weights)
    forces = local_forces(deformable)
    external = [forces[deformable.group_of[b]][deformable.copy_of[b]] for b in blocks]
    return LocalSystem(
        deformable=deformable,
        orbits=orbits,
        blocks=blocks,
        slot_of=slot_of,
        node_start=node_start,
        rows=rows,
        surfaces=surfaces,
        external_force=np.concatenate(external),
        held=held_of(deformable, blocks, node_start),
    )


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
