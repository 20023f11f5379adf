"""An assembly as arrays: congruent blocks, their contact, loads and supports; and a sector of it.

In its own frame every copy of a block has the same stiffness, whatever its placement. Blocks that
a symmetry makes equal have one representative, which a `Sector` computes. The nodes of all
representatives are numbered one block after the other; displacements are (n_nodes, 3), in the
frames of their blocks.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from fem.contact.friction import Coulomb, CoulombFriction, coulomb
from fem.contact.law import ContactLaw
from fem.contact.normals import ContactNormals
from fem.contact.search import SearchedPoints
from fem.contact.surfaces import ContactPoints, MatchedFacets
from fem.element.lagrange import in_pieces
from fem.system.body import Body, refuse_turning_springs
from fem.system.rows import NOT_HELD, ForceRows, Held, HeldRows
from geometry.assembly import Assembly
from geometry.mesh import BoolArray, FloatArray, IntArray

#: Displacements that nodal forces cause: (n_nodes, 3) [N] to (n_nodes, 3) [mm].
NodalInverse = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class Contact:
    """How surfaces that meet act on each other."""

    law: ContactLaw
    """Pressure as a function of overclosure."""
    normals: ContactNormals
    """Which normals measure the gap."""
    friction: CoulombFriction | None = None
    """Friction; None: absent."""
    finite_sliding: bool = False
    """Whether a search finds facets that face each other; matched facets otherwise stay matched."""


@dataclass(frozen=True)
class TurnedOver:
    """A half turn of every block onto itself, and the blocks that are turned over."""

    blocks: BoolArray
    """Which of all blocks are so against their representative, (n_blocks,)."""
    rotations: tuple[FloatArray, ...]
    """Of each shape in its own frame, (3, 3)."""
    nodes: tuple[IntArray, ...]
    """Node of each shape onto which it takes each node, (n_nodes,)."""
    facets: tuple[IntArray, ...]
    """The same of its contact facets."""


class BlockFrames(NamedTuple):
    """Frames of the representatives of all blocks, and their nodes."""

    axes: FloatArray
    """From each to the world, (n_blocks, 3, 3)."""
    origins: FloatArray
    """(n_blocks, 3) [mm]"""
    nodes: IntArray
    """Node of the representative for each node of a block, (n_blocks, most nodes of one)."""


@dataclass(frozen=True)
class Orbits:
    """Which blocks are equal, and one contact facet of each kind."""

    order: int
    """Number of copies of the sector; 1: no symmetry used."""
    representative: IntArray
    """Block that stands for each block, (n_blocks,)."""
    facets: IntArray
    """Positions in the surfaces of the system of the facets to integrate, (n,)."""
    point_of: IntArray
    """Which point of those facets (n_points · position + point) stands for each point of the
    surfaces, (n_facets, n_points)."""
    swapped: BoolArray | bool = False
    """Whether master and opposing block have changed places against those, (n_facets,)."""
    over: TurnedOver | None = None
    """Blocks that are turned over against their representatives; None: none."""
    share: FloatArray | float = 1.0
    """Part of each facet that counts, (n, 1): a half of those that a half turn takes onto
    themselves."""

    def times(self, points: ContactPoints) -> FloatArray | int:
        """How often each of the facets (n, 1) or points of a search comes in the whole."""
        if isinstance(points, SearchedPoints):
            return self.order
        facet = self.point_of[:, 0] // points.weights.shape[1]
        return np.bincount(facet, minlength=points.n_facets)[:, None] / self.share

    @property
    def copies(self) -> int:
        """How often the blocks that are computed make up the whole."""
        return self.order if self.over is None else 2 * self.order


@dataclass(frozen=True)
class System:
    """Deformable blocks with their contact, loads and supports."""

    assembly: Assembly
    """All blocks."""
    bodies: tuple[Body, ...]
    """Congruent blocks that deform."""
    body_number: IntArray
    """Body of each block, of its original for images, -1 for rigid ones, (n_blocks,)."""
    copy_of: IntArray
    """Which copy of that body it is, -1 for rigid ones, (n_blocks,)."""
    offsets: FloatArray
    """Translation of each block from its conforming place, (n_blocks, 3) [mm]: zero, or what
    moves the blocks apart (`geometry.assembly`)."""
    surfaces: MatchedFacets
    """Facet pairs of which at least one block deforms."""
    contact: Contact
    """Law and normals."""
    supports: HeldRows = NOT_HELD
    """Prescribed displacements of nodes of all blocks."""
    forces: tuple[ForceRows, ...] = ()
    """Nodal forces, weight left out."""
    gravity: FloatArray | None = None
    """Uniform acceleration of all that deforms, world axes, (3,) [mm/s²]; None: absent."""
    on_ground: FloatArray | None = None
    """Loads on blocks that do not deform, which what fixes them takes: force and moment about each
    centroid, (n_blocks, 6) [N, N mm]; None: absent."""

    def __post_init__(self) -> None:
        if any(load.follows_block for load in self.forces):
            refuse_turning_springs(self.bodies)

    @property
    def meets(self) -> bool:
        """Whether blocks meet; else each is a body by itself."""
        return self.contact.finite_sliding or self.surfaces.n_facets > 0

    @property
    def n_elements(self) -> int:
        """Elements of all copies."""
        return sum(body.mesh.n_elements * body.n_copies for body in self.bodies)

    @property
    def n_nodes(self) -> int:
        """Nodes of all copies."""
        return sum(body.n_nodes * body.n_copies for body in self.bodies)

    @property
    def deformable_blocks(self) -> IntArray:
        """Blocks that deform, images of others left out, (n,)."""
        original = self.assembly.originals == np.arange(self.assembly.n_blocks)
        return np.flatnonzero((self.body_number >= 0) & original)

    def positions(self, block: int) -> FloatArray:
        """Nodes of a block before the load acts, spacing included, (n_nodes, 3) [mm]."""
        return self.assembly.nodes(block) + self.offsets[block]

    @cached_property
    def drawn(self) -> Assembly:
        """Blocks of straight pieces between the nodes of their elements, for pictures."""
        shapes = tuple(in_pieces(shape) for shape in self.assembly.shapes)
        return replace(self.assembly, shapes=shapes)

    def body_of(self, block: int) -> Body:
        """Return the body of a deformable block."""
        return self.bodies[int(self.body_number[block])]

    @cached_property
    def first_nodes(self) -> IntArray:
        """First node of each block among those of all copies, body after body, -1 of rigid ones."""
        sizes = np.array([body.n_nodes for body in self.bodies])
        starts = np.cumsum([0, *(body.n_copies * body.n_nodes for body in self.bodies)])
        first = starts[self.body_number] + sizes[self.body_number] * self.copy_of
        return np.where(self.body_number < 0, -1, first)

    @cached_property
    def block_of_node(self) -> IntArray:
        """Block of each node of all copies, body after body, (n_nodes,)."""
        blocks = self.deformable_blocks[np.argsort(self.first_nodes[self.deformable_blocks])]
        return np.repeat(blocks, [self.body_of(block).n_nodes for block in blocks.tolist()])

    def under(self, factor: float) -> System:
        """The same under a factor times the loads and the weight."""
        forces = tuple(replace(load, force=factor * load.force) for load in self.forces)
        gravity, ground = (
            None if of is None else factor * of for of in (self.gravity, self.on_ground)
        )
        return replace(self, forces=forces, gravity=gravity, on_ground=ground)

    @property
    def computed(self) -> Sector:
        """All blocks, from rest."""
        n, per_facet = self.surfaces.weights.shape
        points = np.arange(n * per_facet).reshape(n, per_facet)
        return Sector(self, Orbits(1, self.assembly.originals, np.arange(n), points))

    def stick(self, most: float = math.inf) -> float:
        """Stiffness of points that stick, of a system with friction; by default at most ``most``.

        In MPa/mm.
        """
        assert self.contact.friction is not None
        modulus = max(body.material.young_modulus for body in self.bodies)
        return self.contact.friction.stick(modulus, self.assembly.characteristic_length, most)


@dataclass(frozen=True)
class Sector:
    """The blocks of a system that are computed, which stand for all, and where their path begins.

    Without a symmetry it has all of them.
    """

    whole: System
    """All blocks."""
    orbits: Orbits
    """Which blocks are represented by which."""
    chosen: ContactPoints | None = None
    """Points of contact, such as a search found; None: facets of the surfaces."""
    begin: tuple[FloatArray, FloatArray] | None = None
    """Displacements [mm] and loads [N] at the beginning of a path, (n_nodes, 3) each; None: the
    blocks are at rest, without loads."""

    @cached_property
    def blocks(self) -> IntArray:
        """Representative deformable blocks, (n_slots,)."""
        chosen = np.unique(self.orbits.representative)
        return chosen[self.whole.body_number[chosen] >= 0]

    @cached_property
    def slot_of(self) -> IntArray:
        """Slot of the representative of every block, -1 for rigid ones, (n_blocks,)."""
        slot = np.full(self.whole.assembly.n_blocks, -1, dtype=np.int64)
        slot[self.blocks] = np.arange(self.n_slots)
        return slot[self.orbits.representative]

    @cached_property
    def node_start(self) -> IntArray:
        """First node of each slot, and the total; (n_slots + 1,)."""
        sizes = [self.body(slot).n_nodes for slot in range(self.n_slots)]
        return np.cumsum([0, *sizes], dtype=np.int64)

    @cached_property
    def frames(self) -> BlockFrames:
        """Of the representative of each block, in the place of the block."""
        assembly, over = self.whole.assembly, self.orbits.over
        axes, origins = assembly.rotations.copy(), assembly.translations + self.whole.offsets
        every = np.arange(max(shape.mesh.n_nodes for shape in assembly.shapes))
        nodes = np.tile(every, (assembly.n_blocks, 1))
        if over is not None:
            for block in np.flatnonzero(over.blocks).tolist():
                shape, own = int(assembly.shape_of[block]), assembly.shape(block).mesh.nodes
                turn, onto = over.rotations[shape], over.nodes[shape]
                axes[block] = axes[block] @ turn
                origins[block] -= axes[block] @ (own[onto[0]] - turn @ own[0])
                nodes[block, : len(onto)] = onto
        return BlockFrames(axes, origins, nodes)

    @cached_property
    def rows(self) -> IntArray:
        """Row of the state of each node of a block, `n_nodes` of rigid ones, alike."""
        # A slot of -1 is that beyond the last.
        first = self.node_start[self.slot_of]
        return np.minimum(self.frames.nodes + first[:, None], self.n_nodes)

    @cached_property
    def points(self) -> ContactPoints:
        """Facets to integrate, one of each orbit, or points that a search found."""
        points = self.chosen
        if points is None:
            points = self.whole.surfaces.subset(self.orbits.facets)
            points = replace(points, weights=self.orbits.share * points.weights)
        sides = (points.block_m, points.quads_m), (points.block_s, points.quads_s)
        return replace(
            points,
            rows=np.concatenate([self.rows[of[:, None], quads] for of, quads in sides], axis=1),
            axes=np.stack([self.frames.axes[of] for of, _ in sides], axis=1),
            n_rows=self.n_nodes,
            sides=points.sides if self.whole.contact.friction else points.sides[:, :, :0],
        )

    @cached_property
    def law(self) -> Coulomb:
        """Pressure and friction there."""
        points = self.points
        law, friction = self.whole.contact.law, self.whole.contact.friction
        stick = 0.0 if friction is None else self.whole.stick()
        return coulomb(law, friction, stick, points.block_m, points.block_s)

    @cached_property
    def starts(self) -> IntArray:
        """First node of each block that is computed, -1 of all others, (n_blocks,)."""
        starts = np.full(self.whole.assembly.n_blocks, -1)
        starts[self.blocks] = self.node_start[:-1]
        return starts

    def nodal_forces(self, *, weight: bool = True) -> FloatArray:
        """Forces at their full size, block frames, (n_nodes, 3) [N]."""
        total = np.zeros((self.n_nodes, 3))
        for load in self.whole.forces:
            np.add.at(total, *load.on(self.starts))
        if weight and self.whole.gravity is not None:
            for slot, block in enumerate(self.blocks.tolist()):
                local = self.whole.gravity @ self.whole.assembly.rotations[block]
                total[self.nodes_of(slot)] += self.body(slot).lumped_mass[:, None] * local
        return total

    @cached_property
    def loads(self) -> FloatArray:
        """In block frames at the end of a path, (1, n_nodes, 3) [N].

        Of a path that does not begin at rest at its beginning and at its end, (2, n_nodes, 3).
        """
        end = self.nodal_forces()
        return end[None] if self.begin is None else np.stack([self.begin[1], end])

    @cached_property
    def held(self) -> Held:
        """Supports.

        Raises
        ------
        ModelError
            Supports of one node that contradict each other.
        """
        held = self.whole.supports.on(self.starts)
        return held if self.begin is None else held.beginning_at(self.begin[0])

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

    def body(self, slot: int) -> Body:
        """Return the body of a slot."""
        return self.whole.body_of(int(self.blocks[slot]))

    def nodes_of(self, slot: int) -> slice:
        """Nodes of a slot."""
        return slice(int(self.node_start[slot]), int(self.node_start[slot + 1]))

    def on(self, points: ContactPoints) -> Sector:
        """The same with other points of contact."""
        return replace(self, chosen=points)

    def internal_force(self, displacement: FloatArray) -> FloatArray:
        """K u, congruent blocks at once, (n_nodes, 3) [N]."""
        force, body_of = np.empty_like(displacement), self.whole.body_number[self.blocks]
        for number in np.unique(body_of):
            slots = np.flatnonzero(body_of == number).tolist()
            moved = np.stack([displacement[self.nodes_of(slot)] for slot in slots])
            for slot, own in zip(
                slots, self.whole.bodies[number].internal_force(moved), strict=True
            ):
                force[self.nodes_of(slot)] = own
        return force

    def localised(self, displacements: tuple[FloatArray, ...]) -> FloatArray:
        """Displacements of the representatives in block frames, (n_nodes, 3) [mm].

        Parameters
        ----------
        displacements
            Of each body in world axes, (n_copies, n_nodes, 3) [mm].
        """
        parts = []
        for block in self.blocks:
            world = displacements[self.whole.body_number[block]][self.whole.copy_of[block]]
            parts.append(world @ self.whole.assembly.rotations[block])
        return np.concatenate(parts)

    def expand(self, displacement: FloatArray) -> list[FloatArray]:
        """World displacements of every copy of each body, (n_copies, n_nodes, 3) [mm]."""
        result = [np.zeros((body.n_copies, body.n_nodes, 3)) for body in self.whole.bodies]
        for block in self.whole.deformable_blocks.tolist():
            local = displacement[self.rows[block, : self.whole.body_of(block).n_nodes]]
            result[self.whole.body_number[block]][self.whole.copy_of[block]] = (
                local @ self.frames.axes[block].T
            )
        return result


def at_share(loads: FloatArray, share: float) -> FloatArray:
    """Loads at a share of a path; of those at its end, or at its beginning and end, (1 or 2, …)."""
    return share * loads[0] if len(loads) == 1 else (1.0 - share) * loads[0] + share * loads[1]
