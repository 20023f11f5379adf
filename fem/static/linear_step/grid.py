"""One iteration of frictionless structured blocks of higher degree, in the forces of their points.

Every block is reduced to the flexibility between its contact points
(`fem.static.linear_step.grid_block`), whatever the degree of its elements. With reference normals
the overclosure of a point is the sum of the outward displacements of its two sides,

    x = Σ ν · u - gap = -A q + H + M α - gap,      Mᵀ q = Rᵀ f,

with A, H and M summed over the blocks in contact. Normals turn with the motions of the blocks
(`TurningNormals`). Elastic deformations turn them by a share of 1e-3 or less of that, as they
did at the displacement before.

Points whose contact is soft against the block may keep the force of the linearisation; the others
are the unknowns, level by level a chain of dense blocks.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.spatial import cKDTree

from fem.contact.surfaces import MatchedFacets, motion_derivatives
from fem.static.linear_step.block_tridiagonal import (
    Chain,
    ChainFactor,
    Level,
    LevelPoints,
    Rows,
    UnresistedMotionError,
    add_block,
    factor_chain,
)
from fem.static.linear_step.condensation import UnheldBlocksError
from fem.static.linear_step.grid_block import (
    GridBlock,
    GridBodies,
    PointFlexibility,
    grid_block,
    grids_of,
)
from fem.static.linear_step.linearisation import (
    Linearisation,
    LinearStep,
    StaticError,
)
from fem.system.system import Sector, System
from geometry.machine.work import hold_memory, require_memory
from geometry.mesh import BoolArray, FloatArray, IntArray

#: Contact is soft below this share of the stiffness of a block, Young's modulus over its size, …
_SOFT = 0.02
#: … as long as the contact between two blocks has no more of its stiffness in soft points.
_SOFT_SHARE = 0.05
#: Stiffness of open points over that at first touch below which they are left out.
_LEAST_STIFFNESS = 1e-12
#: Distance of a point of a facet from that of its block, over the size of the block.
_SAME_POINT = 1e-7
#: Largest memory over that of the matrices of all levels and of the gradients of all points, as
#: measured beside the factors of the blocks with tubes of 2 to 200 layers and planar walls.
_LEVEL_COPIES, _GRADIENT_COPIES = 2.0, 7.0
_NONE: IntArray = np.empty(0, dtype=np.int64)


def grid_blocks(system: System) -> tuple[GridBlock, ...] | None:
    """Structured blocks of all groups; None where this step does not take the problem.

    It takes contact of one law between matched facets, of blocks without supports of their own,
    with friction in `fem.static.linear_step.grid_pairs`.
    """
    contact = system.contact
    if contact.finite_sliding or len(system.supports.block):
        return None
    if len(contact.law.members) > 1:
        return None
    if not system.meets or system.assembly.image_of is not None:
        return None
    result = []
    for number, body in enumerate(system.bodies):
        block = int(np.flatnonzero(system.body_number == number)[0])
        quads = _touching_quads(system, number)
        shape = system.assembly.shape(block)
        grid = grid_block(shape.mesh, body.material, quads) if len(quads) else None
        if grid is None:
            return None
        result.append(grid)
    return tuple(result)


def _touching_quads(system: System, number: int) -> IntArray:
    """Nodes of the facets on which copies of a body are in contact, (n, n_nodes of a facet)."""
    surfaces, of = system.surfaces, system.body_number
    mine = [
        quads[of[blocks] == number]
        for blocks, quads in (
            (surfaces.block_m, surfaces.quads_m),
            (surfaces.block_s, surfaces.quads_s),
        )
    ]
    return np.unique(np.concatenate(mine), axis=0)


@dataclass(frozen=True)
class Turned:
    """What normals change at one displacement; joints are the block pairs of the surfaces."""

    by_motions: FloatArray
    """D by the motions of both blocks, (2, n, 6)."""
    stiffness: FloatArray
    """T by the motions of both blocks of each joint, (n_joints, 2, 6, 2, 6)."""

    @property
    def without_stiffness(self) -> Turned:
        """The same as if forces did not turn with the blocks."""
        return replace(self, stiffness=np.zeros_like(self.stiffness))


class TurningNormals:
    """What current normals change against reference ones where blocks turn, in six motions each.

    About a displacement with motions α₀ of the blocks, and with forces q of the points, the
    overclosure and the balance of the motions are those of reference normals and

        D (α - α₀),      Dᵀ q + T (α - α₀)      with  D = ∂x/∂α - ∂x_ref/∂α,  T = Σ q ∂²x/∂α².

    T is what holds blocks that slide in their gaps: no other stiffness resists such motions.
    """

    def __init__(self, system: Sector, motions: FloatArray) -> None:
        """Take displacements of all nodes by unit motions of their blocks, (6, n_nodes, 3)."""
        self._surfaces = system.points
        each = np.stack([self._surfaces.moved(moved) for moved in motions], axis=3)
        # By the six motions of the first block, then by those of the second.
        half = each.shape[1] // 2
        self._corners = np.zeros((*each.shape[:3], 12))
        self._corners[:, :half, :, :6] = each[:, :half]
        self._corners[:, half:, :, 6:] = each[:, half:]

    @cached_property
    def _straight(self) -> FloatArray:
        """∂x_ref/∂α, (n_facets, n_points, 12)."""
        straight = self._surfaces.with_reference_normals
        gradient = straight.kinematics(np.zeros(self._corners.shape[:3])).gradient
        return np.einsum("fpai,faim->fpm", gradient, self._corners, optimize=True)

    @property
    def none(self) -> Turned:
        """Of reference normals."""
        n_joints = len(self._surfaces.pair_start) - 1
        by_motions = np.zeros((2, self._surfaces.weights.size, 6))
        return Turned(by_motions, np.zeros((n_joints, 2, 6, 2, 6)))

    def turned(self, displacement: FloatArray, forces: FloatArray) -> Turned:
        """What normals change at a displacement in block frames, (n_nodes, 3) [mm].

        From the forces of the points, (n_facets, n_points) [N].
        """
        corners = self._surfaces.moved(displacement)
        first, second = motion_derivatives(self._surfaces, corners, self._corners)
        by_motions = (first - self._straight).reshape(-1, 2, 6)
        of_facets = np.einsum("fp,fpkl->fkl", forces, second)
        stiffness = np.add.reduceat(of_facets, self._surfaces.pair_start[:-1])
        return Turned(by_motions.transpose(1, 0, 2), stiffness.reshape(-1, 2, 6, 2, 6))


@dataclass(frozen=True)
class _Part:
    """Points of one level on one side of one block: which, and which of the block's own."""

    level: int
    points: IntArray
    """Each once, (n,)."""
    local: IntArray
    """(n,)"""
    side: int
    """Whether the block is the first or the second one of its facets."""


class GridStep(LinearStep):
    """A `LinearStep` in the forces of contact points; it keeps the displacements of all nodes.

    The points asked for at first are those that are stiff at a ``start``, displacements near the
    solution (n_nodes, 3) [mm]; without one all, and none is soft.
    """

    def __init__(
        self, system: Sector, grids: tuple[GridBlock, ...], start: FloatArray | None = None
    ) -> None:
        super().__init__(system)
        self._grids = grids_of(system, grids)
        self._place_points()
        self._softest, asked = 0.0, np.ones(self._n, dtype=np.bool_)
        if start is not None:
            self._softest = _SOFT * min(
                grid.material.young_modulus / float(np.ptp(grid.nodes, axis=0).max())
                for grid in self._grids
            )
            gaps = system.points.overclosures(system.points.moved(start))
            asked = ~self._soft(system.law.normal.stiffness(gaps).ravel())
        wanted: dict[int, IntArray] = {}
        for grid, parts in zip(self._grids, self._parts, strict=True):
            mine = [part.local[asked[part.points]] for part in parts]
            wanted[id(grid)] = np.unique(np.concatenate([wanted.get(id(grid), _NONE), *mine]))
        alike = {id(grid): grid for grid in self._grids}
        self._check_memory(asked, [alike[key].columns.memory(len(wanted[key])) for key in alike])
        kinds = {key: PointFlexibility(alike[key], wanted[key]) for key in alike}
        self._blocks = [kinds[id(grid)] for grid in self._grids]
        self._span = self._chain.spans([6] * len(self._grids))
        self._bodies = GridBodies(system, self._blocks)
        units = [self._bodies.of_motions(np.tile(one, (len(self._grids), 1))) for one in np.eye(6)]
        self._turning = TurningNormals(system, np.stack(units))

    @property
    def exact(self) -> bool:
        """Whether no soft point keeps its force."""
        return self._softest == 0.0

    def _check_memory(self, asked: BoolArray, blocks: list[tuple[float, float]]) -> None:
        """Reject what is beyond the memory, before factors of blocks or of levels are made."""
        rows = np.bincount(self._chain.low[self._facet[asked]]).astype(np.float64)
        levels = 8.0 * _LEVEL_COPIES * (rows**2).sum()
        kept = sum(of_kind for of_kind, _ in blocks)
        making = max(more for _, more in blocks)
        need = _GRADIENT_COPIES * self._reference.nbytes + kept + max(making, levels)
        what = f"{self._n} contact points between blocks of degree {self._grids[0].element.degree}"
        require_memory(what, need, "a coarser mesh (mesh), a lower degree or fewer blocks")
        hold_memory(need)

    def _place_points(self) -> None:
        """Find which points of each block those of the facets are, and levels of both."""
        system, surfaces = self._system, self._system.points
        assert isinstance(surfaces, MatchedFacets)
        self._weights: FloatArray = surfaces.weights.ravel()
        #: ∂x/∂u with reference normals.
        rest = np.zeros((system.n_nodes, 3))
        self._reference = surfaces.with_reference_normals.gaps(rest).gradient
        self._n = len(self._weights)
        self._chain = Chain(system)
        n_facets, per_facet = surfaces.weights.shape
        slots, low = self._chain.slots, self._chain.low
        self._facet: IntArray = np.repeat(np.arange(n_facets), per_facet)
        #: Slots of both blocks of each point, (2, n), and of each joint; -1: a rigid block.
        self._slots: IntArray = np.repeat(slots, per_facet, axis=1)
        self._joint_slots: list[list[int]] = slots[:, surfaces.pair_start[:-1]].T.tolist()
        blocks = np.stack([surfaces.block_m, surfaces.block_s])
        pair = np.unique(blocks, axis=1, return_inverse=True)[1]
        self._joint = np.repeat(np.asarray(pair).ravel(), per_facet)
        self._parts: list[list[_Part]] = [[] for _ in self._grids]
        quads = np.split(surfaces.rows, 2, axis=1)
        numbers = np.arange(self._n).reshape(n_facets, per_facet)
        for slot, grid in enumerate(self._grids):
            tree, parts = cKDTree(grid.positions), self._parts[slot]
            for side in range(2):
                mine = np.flatnonzero(slots[side] == slot)
                corners = grid.nodes[quads[side][mine] - system.node_start[slot]]
                places = np.einsum("pa,fai->fpi", surfaces.basis.values, corners)
                away, nearest = tree.query(places.reshape(-1, 3))
                away, local = np.asarray(away), np.asarray(nearest, dtype=np.int64)
                if away.max(initial=0.0) > _SAME_POINT * np.ptp(grid.positions, axis=0).max():
                    raise StaticError("contact points do not lie on the sides of the block")
                for level in np.unique(low[mine]):
                    rows = np.repeat(low[mine] == level, per_facet)
                    points = numbers[mine].ravel()[rows]
                    parts.append(_Part(int(level), points, local[rows], side))
            parts.sort(key=lambda part: part.level)

    # ---- the linear problem

    def __call__(
        self, linear: Linearisation, before: FloatArray, holding: float = 0.0
    ) -> tuple[FloatArray, None]:
        """Displacements (n_nodes, 3) [mm].

        Raises
        ------
        UnheldBlocksError
            Blocks that nothing holds.
        """
        facets, slope = self._system.points, linear.slope[..., 0, 0].ravel()
        forces = linear.weights * linear.traction[..., 0]
        closed = slope > _LEAST_STIFFNESS * self._system.whole.contact.law.touching_stiffness
        stiff = np.flatnonzero(closed & ~self._soft(slope))
        given = forces.ravel().copy()
        given[stiff] = 0.0
        change, motions = linear.gradient - self._reference, self._bodies.motions_in(before)
        turned = self._turning.turned(before, forces) if change.any() else self._turning.none
        # About the displacement before, normals turn with the motions alone.
        rest = (linear.constant - linear.at + facets.gather(change, before)).ravel()
        rest -= self._moved(turned.by_motions, motions)
        rest = rest[stiff] + linear.traction.ravel()[stiff] / slope[stiff]
        load = self.load(linear.load_factor) + facets.scatter(self._reference, given)
        bending, lever = facets.scatter(change, forces), self._on_motions(turned.by_motions, given)
        points = stiff, 1.0 / (self._weights[stiff] * slope[stiff])
        try:
            factor, rows, held = self._factored(points, turned, motions, holding)
        except UnheldBlocksError:
            # Far from rest turning normals may push: what resists without them leads there.
            turned = turned.without_stiffness
            factor, rows, held = self._factored(points, turned, motions, holding)
        loaded = self._bodies.displacements(load + bending)
        right = rest + facets.gather(self._reference, loaded).ravel()[stiff]
        balance = lever - self._bodies.in_motions(load) - held
        solved = factor.solve(self._chain.sides(rows.split(right), balance))
        forces, motions = np.zeros(self._n), np.empty_like(held)
        forces[stiff] = rows.joined([result for result, _ in solved])
        for (_, alpha), slots in zip(solved, self._chain.members, strict=True):
            motions[slots] = alpha.reshape(-1, 6)
        pushed = facets.scatter(self._reference, forces)
        return loaded + self._bodies.displacements(pushed) + self._bodies.of_motions(motions), None

    def _factored(
        self,
        points: tuple[IntArray, FloatArray],
        turned: Turned,
        before: FloatArray,
        holding: float,
    ) -> tuple[ChainFactor, Rows, FloatArray]:
        """Factor the chain of some points, each with its softness [mm/N], and their rows.

        Springs hold the motions ``before``, (n_slots, 6), by the forces that come last.
        """
        rows = self._chain.rows(self._facet[points[0]])
        levels = self._levels(rows, points, turned, holding)
        held = self._held(levels, before)
        try:
            return factor_chain(levels), rows, held
        except (UnresistedMotionError, np.linalg.LinAlgError) as error:
            raise UnheldBlocksError(f"contact forces: {error}", ()) from None

    def _soft(self, stiffness: FloatArray) -> BoolArray:
        """Points softer than a block that carry little of the stiffness of their joint, (n,)."""
        slope = self._weights * stiffness
        order = np.lexsort((slope, self._joint))
        sums = np.cumsum(slope[order])
        joint = self._joint[order]
        first = np.searchsorted(joint, np.arange(int(joint[-1]) + 1))
        before = np.concatenate([[0.0], sums])[first]
        total = np.diff([*before, sums[-1]])
        little = np.empty(self._n, dtype=np.bool_)
        little[order] = sums - before[joint] <= _SOFT_SHARE * total[joint]
        return little & (stiffness < self._softest)

    def _levels(
        self, rows: Rows, points: tuple[IntArray, FloatArray], turned: Turned, holding: float
    ) -> list[Level]:
        """Levels of the rows of some points, each with its softness [mm/N]."""
        stiff, softness = points
        levels = self._chain.zeros(rows, self._span)
        for level, soft in zip(levels, rows.split(softness), strict=True):
            np.fill_diagonal(level.flexibility, soft)
            np.fill_diagonal(level.holding, holding)
        number, within = np.full(self._n, -1), rows.within
        number[stiff] = np.arange(len(stiff))
        for kind in set(self._blocks):
            alike = [parts for k, parts in enumerate(self._parts) if self._blocks[k] is kind]
            kind.include(
                np.concatenate([p.local[number[p.points] >= 0] for parts in alike for p in parts])
            )
        for slot, block in enumerate(self._blocks):
            mine = []
            for part in self._parts[slot]:
                row = number[part.points]
                at, row = part.local[row >= 0], row[row >= 0]
                felt = block.motions[at] + turned.by_motions[part.side, stiff[row]]
                mine.append(LevelPoints(part.level, within[row], felt, at))
            place = int(self._chain.level_of[slot]), self._span[slot]
            add_block(levels, place, mine, block.between)
        for slots, stiffness in zip(self._joint_slots, turned.stiffness, strict=True):
            ends = [
                (k, int(self._chain.level_of[slot]), self._span[slot])
                for k, slot in enumerate(slots)
                if slot >= 0
            ]
            for a, low, lines in ends:
                for b, high, columns in ends:
                    if low == high:
                        levels[low].holding[lines, columns] += stiffness[a, :, b]
                    elif low < high:
                        levels[low].next_holding[lines, columns] += stiffness[a, :, b]
        return levels

    def _held(self, levels: list[Level], motions: FloatArray) -> FloatArray:
        """Product of `Level.holding` of all levels with motions, (n_slots, 6)."""
        result = np.zeros_like(motions)
        for level, slots in zip(levels, self._chain.members, strict=True):
            result[slots] += (level.holding @ motions[slots].ravel()).reshape(-1, 6)
        for level, (slots, after) in zip(levels, pairwise(self._chain.members), strict=False):
            result[slots] += (level.next_holding @ motions[after].ravel()).reshape(-1, 6)
            result[after] += (level.next_holding.T @ motions[slots].ravel()).reshape(-1, 6)
        return result

    def _moved(self, by_motions: FloatArray, motions: FloatArray) -> FloatArray:
        """Sum over both blocks of derivatives (2, n, 6) times their motions (n_slots, 6), (n,)."""
        padded = np.concatenate([motions, np.zeros((1, 6))])
        return np.asarray(np.einsum("bnm,bnm->n", by_motions, padded[self._slots]))

    def _on_motions(self, by_motions: FloatArray, forces: FloatArray) -> FloatArray:
        """Forces of the points (n,) on the motions of their blocks, (n_slots, 6)."""
        result = np.zeros((len(self._grids) + 1, 6))
        np.add.at(result, self._slots, by_motions * forces[:, None])
        return result[:-1]
