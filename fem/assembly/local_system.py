"""Unknowns of a static problem: displacements of the representative blocks in their own frames.

In its own frame every copy of a block has the same stiffness, whatever its placement. The nodes
of all representatives are numbered one block after the other; displacements are (n_nodes, 3).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.sparse import block_diag, bsr_array, csr_array, eye_array

from fem.assembly.deformable import DeformableAssembly
from fem.assembly.symmetry import Orbits, local_forces
from fem.contact.friction import Coulomb, coulomb
from fem.contact.law import ContactLaw
from fem.contact.search import SearchedSurfaces
from fem.contact.surfaces import ContactNormals, ContactSurfaces
from fem.problem.model import Amplitude, BlockGroup, ModelError
from geometry.mesh import BoolArray, FloatArray, IntArray
from geometry.work import Operation, count

#: Prescribed displacements are met to this share of the largest displacement.
_ROUNDING = 1e-12


@dataclass(frozen=True)
class HeldNodes:
    """Prescribed displacement components, each node in axes of its own.

    With u = axes @ v, component k of v is prescribed where ``held[:, k]``.
    """

    nodes: IntArray
    """Nodes with at least one prescribed component, (n,)."""
    axes: FloatArray
    """Orthonormal axes in the block frame as columns, prescribed ones first; (n, 3, 3)."""
    held: FloatArray
    """One where component k of v is prescribed, else zero; (n, 3)."""
    values: FloatArray
    """Prescribed components of v where every support has moved all its way, (n, 3) [mm]."""
    moving: tuple[tuple[Amplitude, FloatArray], ...] = ()
    """Share of their way as a function of time [s] of supports that move, and its values."""

    def at(self, time: float | None) -> FloatArray:
        """Prescribed components of v at a time [s], (n, 3) [mm]; None: all the way."""
        values = self.values
        if time is None:
            return values
        left = [(1.0 - share(time)) * way for share, way in self.moving]
        return values - sum(left) if left else values


#: No support at all.
NOTHING_HELD = HeldNodes(
    np.zeros(0, dtype=np.int64), np.zeros((0, 3, 3)), np.zeros((0, 3)), np.zeros((0, 3))
)


@dataclass(frozen=True)
class Gaps:
    """Overclosures of all contact points, with friction also their slips, and their derivatives."""

    x: FloatArray
    """Overclosure, then slips along `ContactSurfaces.sides`, (n_facets, n_points, 1 or 3) [mm]."""
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
    surfaces: ContactSurfaces | SearchedSurfaces
    """Facets to integrate, one of each orbit, or points that a search found."""
    corner_nodes: IntArray
    """Nodes of both facets, m's first, `n_nodes` for rigid blocks, (n_facets, 2 m)."""
    external_force: FloatArray
    """Loads in block frames, (n_nodes, 3) [N]."""
    held: HeldNodes
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

    def gaps(self, displacement: FloatArray, normals: ContactNormals) -> Gaps:
        """Overclosures at a displacement, and slips where there is friction."""
        world = self.surfaces.kinematics(self.corner_displacements(displacement), normals)
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
        world = np.einsum("fpa,fpki->fpkai", self.surfaces.difference, self.surfaces.sides)
        n, p, _, a, _ = world.shape
        return self.local_gradient(world.reshape(n, 2 * p, a, 3)).reshape(world.shape)

    def gather(self, gradient: FloatArray, displacement: FloatArray) -> FloatArray:
        """Product of gradients (n_facets, …, 2 m, 3) with a displacement, (n_facets, …) [mm]."""
        padded = np.concatenate([displacement, np.zeros((1, 3))])
        rows = gradient.reshape(len(gradient), int(np.prod(gradient.shape[1:-2])), -1, 3)
        moved = np.einsum("fpai,fai->fp", rows, padded[self.corner_nodes], optimize=True)
        return moved.reshape(gradient.shape[:-2])

    def scatter(self, gradient: FloatArray, point_forces: FloatArray) -> FloatArray:
        """Nodal forces -Σ w t ∂x/∂u of forces w t (n_facets, …) [N], (n_nodes, 3) [N]."""
        rows = gradient.reshape(len(gradient), int(np.prod(gradient.shape[1:-2])), -1, 3)
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

    def free_part(self, force: FloatArray) -> FloatArray:
        """Force without its components along prescribed directions, (n_nodes, 3) [N]."""
        free = force.copy()
        held = self.held
        if len(held.nodes):
            along = np.einsum("nij,ni->nj", held.axes, free[held.nodes]) * (1.0 - held.held)
            free[held.nodes] = np.einsum("nij,nj->ni", held.axes, along)
        return free

    def held_part(self, force: FloatArray) -> FloatArray:
        """Components of a force along prescribed directions, (n_nodes, 3) [N]."""
        return force - self.free_part(force)

    def has_prescribed(self, displacement: FloatArray, time: float | None = None) -> bool:
        """Whether supports are where they are prescribed at a time [s], to rounding."""
        held = self.held
        values = held.at(time)
        along = np.einsum("nij,ni->nj", held.axes, displacement[held.nodes])
        away = np.abs((along - values) * held.held).max(initial=0.0)
        size = max(np.abs(a).max(initial=0.0) for a in (values, displacement))
        return bool(away <= _ROUNDING * size)

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
            local = displacement[self.nodes_of(int(self.slot_of[block]))]
            nodes = self.orbits.nodes(deformable, int(block))
            local = local if nodes is None else local[nodes]
            result[group][copy] = local @ rotations[block].T
        return result


def local_system(
    deformable: DeformableAssembly, orbits: Orbits, searched: SearchedSurfaces | None = None
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
    surfaces = searched or deformable.surfaces.subset(orbits.facets)
    corner = [
        _slot_nodes(orbits.on_representatives(deformable, of, quads), slot_of[of], node_start)
        for of, quads in (
            (surfaces.block_m, surfaces.quads_m),
            (surfaces.block_s, surfaces.quads_s),
        )
    ]
    forces = local_forces(deformable)
    external = [forces[deformable.group_of[b]][deformable.copy_of[b]] for b in blocks]
    return LocalSystem(
        deformable=deformable,
        orbits=orbits,
        blocks=blocks,
        slot_of=slot_of,
        node_start=node_start,
        surfaces=surfaces,
        corner_nodes=np.concatenate(corner, axis=1),
        external_force=np.concatenate(external),
        held=_held_nodes(deformable, blocks, node_start),
    )


def _slot_nodes(quads: IntArray, slots: IntArray, node_start: IntArray) -> IntArray:
    """Numbers of nodes of facets; the total number of nodes for rigid blocks."""
    first = node_start[np.maximum(slots, 0)][:, None]
    return np.where(slots[:, None] >= 0, quads + first, node_start[-1])


def _held_nodes(
    deformable: DeformableAssembly, blocks: IntArray, node_start: IntArray
) -> HeldNodes:
    """Collect the supports of the representatives, node by node."""
    nodes, directions, values = [], [], []
    supports = deformable.model.supports
    shares = list(dict.fromkeys(s.amplitude for s in supports if s.displacement.any()))
    for support in supports:
        rotations = deformable.model.groups[support.group].rotations[support.copies]
        local = np.einsum("nij,ni->nj", rotations, support.directions)
        for slot, block in enumerate(blocks):
            if int(deformable.group_of[block]) != support.group:
                continue
            mine = support.copies == deformable.copy_of[block]
            nodes.append(support.nodes[mine] + node_start[slot])
            directions.append(local[mine])
            part = np.zeros((int(mine.sum()), max(len(shares), 1)))
            if support.displacement.any():
                part[:, shares.index(support.amplitude)] = support.displacement[mine]
            values.append(part)
    if not nodes:
        return NOTHING_HELD
    result = by_node(np.concatenate(nodes), np.concatenate(directions), np.concatenate(values))
    ways = zip(shares, np.moveaxis(result[1], 2, 0), strict=False)
    return replace(result[0], moving=tuple((a, way) for a, way in ways if a is not None))


def by_node(
    nodes: IntArray, directions: FloatArray, values: FloatArray
) -> tuple[HeldNodes, FloatArray]:
    """Supports node by node, and the parts of their values, (n, 3, n_parts)."""
    order = np.argsort(nodes, kind="stable")
    unique, first, count = np.unique(nodes[order], return_index=True, return_counts=True)
    axes = np.zeros((len(unique), 3, 3))
    held = np.zeros((len(unique), 3))
    prescribed = np.zeros((len(unique), 3, values.shape[1]))
    for n in np.unique(count).tolist():
        mine = np.flatnonzero(count == n)
        rows = order[first[mine, None] + np.arange(n)]
        given = directions[rows]
        product = given @ given.transpose(0, 2, 1)
        wrong = np.abs(product - np.eye(n)).max(axis=(1, 2)) > 1e-9
        if n > 3 or wrong.any():
            node = mine[0] if n > 3 else mine[wrong][0]
            raise ModelError(
                f"supports: node {int(unique[node])} is fixed in {n} directions that are not "
                "orthonormal; expected each component to be prescribed once"
            )
        held[mine, :n] = 1.0
        if n == 3:
            # All components are prescribed: along the axes of the block, to the bit.
            axes[mine] = np.eye(3)
            prescribed[mine] = given.transpose(0, 2, 1) @ values[rows]
            continue
        basis = np.linalg.qr(given.transpose(0, 2, 1), mode="complete")[0]
        basis[:, :, :n] *= np.sign(np.einsum("mij,mji->mi", given, basis[:, :, :n]))[:, None]
        axes[mine] = basis
        prescribed[mine, :n] = values[rows]
    return HeldNodes(unique, axes, held, prescribed.sum(axis=2)), prescribed


def constraint_transform(held: HeldNodes, n_nodes: int) -> tuple[csr_array, IntArray, FloatArray]:
    """Change of variables u = T v that makes every prescribed component one variable.

    Returns
    -------
    tuple[csr_array, IntArray, FloatArray]
        T (3 n_nodes, 3 n_nodes), the free variables (n_free,) and v with the prescribed values
        and zeros (3 n_nodes,) [mm].
    """
    size = 3 * n_nodes
    value = prescribed_values(held, n_nodes)
    if not len(held.nodes):
        return csr_array(eye_array(size, format="csr")), np.arange(size), value
    turns = np.tile(np.eye(3), (n_nodes, 1, 1))
    turns[held.nodes] = held.axes
    is_held = np.zeros((n_nodes, 3), dtype=np.bool_)
    is_held[held.nodes] = held.held > 0.0
    node = np.arange(n_nodes + 1)
    transform = csr_array(bsr_array((turns, node[:-1], node), (size, size)))
    transform.eliminate_zeros()
    return transform, np.flatnonzero(~is_held.ravel()), value


def prescribed_values(held: HeldNodes, n_nodes: int, time: float | None = None) -> FloatArray:
    """Prescribed variables v at a time [s], zero at the others, (3 n_nodes,) [mm].

    Without a time where every support has moved all its way.
    """
    value = np.zeros((n_nodes, 3))
    value[held.nodes] = held.at(time)
    return value.ravel()


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
