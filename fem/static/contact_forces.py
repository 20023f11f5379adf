"""Frictionless equilibrium of structured blocks of higher degree, in the forces of contact points.

The same discrete problem as that of `fem.static.newton`, solved in other unknowns: every block is
reduced to the flexibility between its contact points (`fem.static.linear_step.grid_block`),
whatever the degree of its elements. With reference normals the overclosure of a point is the sum
of the outward displacements of its two sides,

    x = Σ ν · u - gap + δ = -A q + H + M α - gap + δ,      Mᵀ q = Rᵀ f,

with A, H and M summed over the blocks in contact. From rest normals are the reference ones until
the forces are nearly in balance: that energy is convex, and an overshoot is cut where it is least.
Then they turn with the blocks (`fem.static.turning`), and the converged state is that of the
current normals. Where turning would leave a motion without resistance, the forces of that iteration
do not turn, as in `fem.static.newton`.

The law is linearised in pressure as in `fem.static.newton`: after a solution each point that
presses is linearised where the law has that pressure. From a start, points whose contact is soft
against the block keep the force of the step before; the others are the unknowns, level by level a
chain of dense blocks.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from itertools import pairwise

import numpy as np
from scipy.spatial import cKDTree

from fem.contact.surfaces import ContactNormals, MatchedFacets
from fem.static.linear_step.block_tridiagonal import Level, UnresistedMotionError, factor_chain
from fem.static.linear_step.condensed import levels_of
from fem.static.linear_step.grid_block import GridBlock, PointFlexibility, grid_block
from fem.static.newton import FARTHEST, least_share, relative_residual
from fem.static.result import StaticError
from fem.static.turning import Turned, TurningNormals
from fem.system.build import DeformableAssembly
from fem.system.system import System
from geometry.mesh import BoolArray, FloatArray, IntArray
from geometry.work import Operation, count

#: Holding springs of the blocks at first, over the tangent stiffness of their contacts, …
_FIRST_HOLDING = 0.25
#: … how they fade, and when they are gone.
_FADING = 0.1
_LEAST_HOLDING = 1e-9
#: Contact is soft below this share of the stiffness of a block, Young's modulus over its size, …
_SOFT = 0.02
#: … as long as the contact between two blocks has no more of its stiffness in soft points.
_SOFT_SHARE = 0.05
#: Stiffness of open points over that at first touch below which they are left out.
_LEAST_STIFFNESS = 1e-12
#: Linear problems at most, from rest and from a start.
_MOST_ITERATIONS, _MOST_FROM_START = 80, 25
#: Residual with reference normals below which normals turn with the blocks.
_SETTLED = 1e-2
#: Distance of a point of a facet from that of its block, over the size of the block.
_SAME_POINT = 1e-7


@dataclass(frozen=True)
class ForceState:
    """A state of the representative blocks."""

    displacement: FloatArray
    """In block frames, (n_nodes, 3) [mm]."""
    internal_force: FloatArray
    """K u, (n_nodes, 3) [N]."""
    residuals: tuple[float, ...]
    """Unbalanced over applied force after each linear problem [-]."""


def grid_blocks(deformable: DeformableAssembly) -> tuple[GridBlock, ...] | None:
    """Structured blocks of all groups; None where this solver does not take the problem.

    It takes frictionless contact of one law between matched facets, of blocks without supports of
    their own.
    """
    contact, model = deformable.contact, deformable.model
    if contact.friction is not None or contact.finite_sliding or model.supports:
        return None
    if len(contact.law.members) > 1:
        return None
    if not deformable.meets or deformable.assembly.image_of is not None:
        return None
    result = []
    for number, group in enumerate(model.groups):
        block = int(np.flatnonzero(deformable.group_of == number)[0])
        quads = _touching_quads(deformable, number)
        shape = deformable.assembly.shape(block)
        grid = grid_block(shape.mesh, group.material, quads) if len(quads) else None
        if grid is None:
            return None
        result.append(grid)
    return tuple(result)


def _touching_quads(deformable: DeformableAssembly, number: int) -> IntArray:
    """Nodes of the facets on which copies of a group are in contact, (n, n_nodes of a facet)."""
    surfaces, of = deformable.surfaces, deformable.group_of
    mine = [
        quads[of[blocks] == number]
        for blocks, quads in (
            (surfaces.block_m, surfaces.quads_m),
            (surfaces.block_s, surfaces.quads_s),
        )
    ]
    return np.unique(np.concatenate(mine), axis=0)


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


class _Points:
    """Contact points of all representative blocks, and which of each block they are."""

    def __init__(self, system: System, grids: tuple[GridBlock, ...]) -> None:
        self.system = system
        surfaces = system.points
        assert isinstance(surfaces, MatchedFacets)
        self.surfaces = surfaces
        self.weights: FloatArray = surfaces.weights.ravel()
        self.n = len(self.weights)
        self.grids = [grids[int(system.deformable.group_of[block])] for block in system.blocks]
        self.slot_level = levels_of(system)
        n_facets, per_facet = surfaces.weights.shape
        slots = np.stack([system.slot_of[surfaces.block_m], system.slot_of[surfaces.block_s]])
        far = np.iinfo(np.int64).max
        of_side = np.where(slots >= 0, self.slot_level[slots], far)
        low, high = of_side.min(axis=0), of_side.max(axis=0)
        self.level = np.repeat(low, per_facet)
        self.shared = np.repeat((high != far) & (high > low), per_facet)
        pair = np.unique(
            np.stack([surfaces.block_m, surfaces.block_s]), axis=1, return_inverse=True
        )
        self.joint = np.repeat(np.asarray(pair[1]).ravel(), per_facet)
        #: Slots of both blocks of each point, (2, n), and of each joint; -1: a rigid block.
        self.slots: IntArray = np.repeat(slots, per_facet, axis=1)
        self.joint_slots: list[list[int]] = slots[:, surfaces.pair_start[:-1]].T.tolist()
        self.parts: list[list[_Part]] = [[] for _ in self.grids]
        quads = np.split(surfaces.rows, 2, axis=1)
        numbers = np.arange(self.n).reshape(n_facets, per_facet)
        for slot, grid in enumerate(self.grids):
            tree = cKDTree(grid.positions)
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
                    self.parts[slot].append(_Part(int(level), points, local[rows], side))

    @cached_property
    def motions(self) -> FloatArray:
        """Displacements by unit motions of the blocks, (6, n_nodes, 3)."""
        return np.stack([self.of_motions(np.tile(one, (len(self.grids), 1))) for one in np.eye(6)])

    @cached_property
    def gaps(self) -> FloatArray:
        """Before any displacement, (n,) [mm]."""
        gaps: FloatArray = self.surfaces.initial_gaps.ravel()
        return gaps

    def on_grid(self, slot: int, nodal: FloatArray) -> FloatArray:
        """Values of all nodes (n_nodes, 3) at those of the grid of a slot."""
        return nodal[self.system.nodes_of(slot)][self.grids[slot].numbers.ravel()]

    def to_nodes(self, on_grids: list[FloatArray]) -> FloatArray:
        """Values at the nodes of the grids of all slots as those of all nodes, (n_nodes, 3)."""
        nodal = np.empty((self.system.n_nodes, 3))
        for slot, (grid, values) in enumerate(zip(self.grids, on_grids, strict=True)):
            nodal[self.system.nodes_of(slot)][grid.numbers.ravel()] = values
        return nodal

    def pushed(self, forces: FloatArray) -> FloatArray:
        """Forces on the nodes from those of the points, (n_nodes, 3) [N]."""
        result = []
        for grid, parts in zip(self.grids, self.parts, strict=True):
            local = np.zeros(len(grid.positions))
            for part in parts:
                local[part.local] += forces[part.points]
            result.append(-(grid.outward.T @ local).reshape(-1, 3))
        return self.to_nodes(result)

    def in_motions(self, forces: FloatArray) -> FloatArray:
        """Rᵀ f of nodal forces (n_nodes, 3) [N], (n_slots, 6)."""
        each = enumerate(self.grids)
        return np.stack([grid.rigid.T @ self.on_grid(s, forces).ravel() for s, grid in each])

    def of_motions(self, motions: FloatArray) -> FloatArray:
        """R α of motions (n_slots, 6), (n_nodes, 3) [mm]."""
        each = zip(self.grids, motions, strict=True)
        return self.to_nodes([(grid.rigid @ motion).reshape(-1, 3) for grid, motion in each])

    def balanced(self, forces: FloatArray) -> FloatArray:
        """Nodal forces (n_nodes, 3) [N] without those on motions of the blocks."""
        shares = zip(self.grids, self.in_motions(forces), strict=True)
        on_motions = [np.linalg.solve(grid.rigid.T @ grid.rigid, share) for grid, share in shares]
        return forces - self.of_motions(np.stack(on_motions))

    def approach(self, displacement: FloatArray) -> FloatArray:
        """Σ ν · u of all points, (n,) [mm], from displacements (n_nodes, 3) [mm]."""
        result = np.zeros(self.n)
        for slot, (grid, parts) in enumerate(zip(self.grids, self.parts, strict=True)):
            outward = grid.outward @ self.on_grid(slot, displacement).ravel()
            for part in parts:
                result[part.points] += outward[part.local]
        return result

    def moved(self, by_motions: FloatArray, motions: FloatArray) -> FloatArray:
        """Sum over both blocks of derivatives (2, n, 6) times their motions (n_slots, 6), (n,)."""
        padded = np.concatenate([motions, np.zeros((1, 6))])
        return np.asarray(np.einsum("bnm,bnm->n", by_motions, padded[self.slots]))

    def on_motions(self, by_motions: FloatArray, forces: FloatArray) -> FloatArray:
        """Forces of the points (n,) on the motions of their blocks, (n_slots, 6)."""
        result = np.zeros((len(self.grids) + 1, 6))
        np.add.at(result, self.slots, by_motions * forces[:, None])
        return result[:-1]

    def soft(self, stiffness: FloatArray, below: float) -> BoolArray:
        """Points softer than a bound that carry little of the stiffness of their joint, (n,)."""
        slope = self.weights * stiffness
        order = np.lexsort((slope, self.joint))
        sums = np.cumsum(slope[order])
        joint = self.joint[order]
        first = np.searchsorted(joint, np.arange(int(joint[-1]) + 1))
        before = np.concatenate([[0.0], sums])[first]
        total = np.diff([*before, sums[-1]])
        little = np.empty(self.n, dtype=np.bool_)
        little[order] = sums - before[joint] <= _SOFT_SHARE * total[joint]
        return little & (stiffness < below)


class _ForceProblem:
    """The linear problems in contact forces."""

    def __init__(self, points: _Points, asked: BoolArray, load_factor: float) -> None:
        self.points = points
        system = points.system
        self.load = load_factor * system.external_force
        kinds: dict[int, PointFlexibility] = {}
        self.blocks = []
        for grid in points.grids:
            if id(grid) not in kinds:
                mine = [
                    part.local[asked[part.points]]
                    for other, parts in zip(points.grids, points.parts, strict=True)
                    for part in parts
                    if other is grid
                ]
                kinds[id(grid)] = PointFlexibility(grid, np.concatenate(mine))
            self.blocks.append(kinds[id(grid)])
        level = points.slot_level
        self.members = [np.flatnonzero(level == k).tolist() for k in range(int(level.max()) + 1)]
        #: Level of each slot, and its columns among the motions there.
        self.span = {
            slot: (k, slice(6 * column, 6 * column + 6))
            for k, slots in enumerate(self.members)
            for column, slot in enumerate(slots)
        }

    def motions_in(self, displacement: FloatArray) -> FloatArray:
        """Motions of the blocks in displacements (n_nodes, 3) [mm], (n_slots, 6)."""
        pairs = enumerate(self.blocks)
        on_grids = (block.motion_in(self.points.on_grid(s, displacement)) for s, block in pairs)
        return np.stack(list(on_grids))

    def linear(
        self,
        stiff: IntArray,
        right: FloatArray,
        softness: FloatArray,
        *,
        given: FloatArray,
        turned: Turned,
        before: FloatArray,
        holding: float,
    ) -> _State:
        """Solve for the state with the law linearised, in balance.

        Parameters
        ----------
        stiff
            Points whose forces are unknown, (n_s,), ascending.
        right
            Minus the overclosure at which the law's tangent has no pressure, (n_s,) [mm].
        softness
            One over the slope of their forces, (n_s,) [mm/N].
        given
            Forces of the soft points, zero elsewhere, (n,) [N].
        turned
            By the iteration before.
        before, holding
            Motions of the iteration before, and stiffness of springs that hold them.
        """
        points = self.points
        row = np.full(points.n, -1, dtype=np.int64)
        row[stiff] = np.arange(len(stiff))
        mine = [[_among(part, row) for part in parts] for parts in points.parts]
        levels, members = self._chain(stiff, mine, softness, holding)
        self._turn(levels, members, mine, turned, stiff)
        load = self.load + points.pushed(given)
        loaded = self._displacements(load + turned.forces)
        approach = points.approach(loaded) - points.gaps + turned.overclosure
        approach -= points.moved(turned.by_motions, before)
        side = right + approach[stiff]
        motions = points.on_motions(turned.by_motions, given)
        motions -= points.in_motions(load) + self._held(levels, before)
        sides = [(side[m], motions[self.members[k]].ravel()) for k, m in enumerate(members)]
        forces = given.copy()
        for k, (result, alpha) in enumerate(factor_chain(levels).solve(sides)):
            forces[stiff[members[k]]] = result
            motions[self.members[k]] = alpha.reshape(-1, 6)
        displaced = loaded + self._displacements(points.pushed(forces - given))
        taken = self.load + points.pushed(forces) + turned.forces
        return _State(
            displaced + points.of_motions(motions), motions, points.balanced(taken), forces
        )

    def _turn(
        self,
        levels: list[Level],
        members: list[IntArray],
        mine: list[list[_Part]],
        turned: Turned,
        stiff: IntArray,
    ) -> None:
        """Add to the levels what motions change by turning normals."""
        place = _places(members, len(stiff))
        for slot, parts in enumerate(mine):
            own, span = self.span[slot]
            for part in parts:
                level, rows = levels[part.level], place[part.points]
                change = turned.by_motions[part.side, stiff[part.points]]
                if part.level == own:
                    level.motions[rows, span] += change
                else:
                    level.next_motions[rows - level.first_shared, span] += change
        for slots, stiffness in zip(self.points.joint_slots, turned.stiffness, strict=True):
            ends = [(k, self.span[slot]) for k, slot in enumerate(slots) if slot >= 0]
            for a, (low, lines) in ends:
                for b, (high, columns) in ends:
                    if low == high:
                        levels[low].holding[lines, columns] += stiffness[a, :, b]
                    elif low < high:
                        levels[low].next_holding[lines, columns] += stiffness[a, :, b]

    def _held(self, levels: list[Level], motions: FloatArray) -> FloatArray:
        """Product of `Level.holding` of all levels with motions, (n_slots, 6)."""
        result = np.zeros_like(motions)
        for level, slots in zip(levels, self.members, strict=True):
            result[slots] += (level.holding @ motions[slots].ravel()).reshape(-1, 6)
        for level, (slots, after) in zip(levels, pairwise(self.members), strict=False):
            result[slots] += (level.next_holding @ motions[after].ravel()).reshape(-1, 6)
            result[after] += (level.next_holding.T @ motions[slots].ravel()).reshape(-1, 6)
        return result

    def _displacements(self, forces: FloatArray) -> FloatArray:
        """G of nodal forces, (n_nodes, 3) [mm], of congruent blocks at once."""
        points, on_grids = self.points, [np.empty(0)] * len(self.blocks)
        for block in set(self.blocks):
            slots = [slot for slot, other in enumerate(self.blocks) if other is block]
            moved = block.displacements(np.stack([points.on_grid(s, forces) for s in slots]))
            for slot, own in zip(slots, moved, strict=True):
                on_grids[slot] = own
        return points.to_nodes(on_grids)

    def _chain(
        self, stiff: IntArray, mine: list[list[_Part]], softness: FloatArray, holding: float
    ) -> tuple[list[Level], list[IntArray]]:
        """The chain, and its points: of each level those of its blocks alone, then those shared."""
        points = self.points
        level, shared = points.level[stiff], points.shared[stiff]
        order = np.lexsort((shared, level))
        starts = np.searchsorted(level[order], np.arange(len(self.members) + 1))
        members = [order[a:b] for a, b in pairwise(starts)]
        place = _places(members, len(stiff))
        levels = []
        for k, m in enumerate(members):
            first, after = int((~shared[m]).sum()), k + 1 < len(members)
            width = 6 * len(self.members[k])
            n_after = len(members[k + 1]) if after else 0
            width_after = 6 * len(self.members[k + 1]) if after else 0
            levels.append(
                Level(
                    flexibility=np.asfortranarray(np.diag(softness[m])),
                    motions=np.zeros((len(m), width)),
                    holding=holding * np.eye(width),
                    first_shared=first,
                    next_flexibility=np.zeros((len(m) - first, n_after)),
                    next_motions=np.zeros((len(m) - first, width_after)),
                    next_holding=np.zeros((width, width_after)),
                )
            )
        for slot, parts in enumerate(mine):
            for part in parts:
                self.blocks[slot].include(part.local)
        for k, slots in enumerate(self.members):
            for slot in slots:
                span = self.span[slot][1]
                _add_block(levels, k, self.blocks[slot], span, mine[slot], place)
        return levels, members


def _add_block(  # noqa: PLR0917
    levels: list[Level],
    own: int,
    block: PointFlexibility,
    span: slice,
    parts: list[_Part],
    place: IntArray,
) -> None:
    """Add the responses of a block of a level at its points to forces on them.

    ``span`` are the columns of its motions, ``place`` the row of each point in its level.
    """
    for number, part in enumerate(parts):
        rows, level = place[part.points], levels[part.level]
        if part.level == own:
            level.motions[rows, span] += block.motions[part.local]
        else:
            level.next_motions[rows - level.first_shared, span] += block.motions[part.local]
        for other in parts[: number + 1]:
            flexible = block.between(part.local, other.local)
            if part.level == other.level:
                columns = place[other.points]
                level.flexibility[np.ix_(rows, columns)] += flexible
                if other is not part:
                    level.flexibility[np.ix_(columns, rows)] += flexible.T
                continue
            lower, upper = sorted((part, other), key=lambda p: p.level)
            below = levels[lower.level]
            shared = place[lower.points] - below.first_shared
            response = flexible if lower is part else flexible.T
            below.next_flexibility[np.ix_(shared, place[upper.points])] += response


def _places(members: list[IntArray], n: int) -> IntArray:
    """Row of each of n points in its level, (n,)."""
    place = np.empty(n, dtype=np.int64)
    for rows in members:
        place[rows] = np.arange(len(rows))
    return place


def _among(part: _Part, row: IntArray) -> _Part:
    """Points of a part that have a row, and those rows."""
    rows = row[part.points]
    return replace(part, points=rows[rows >= 0], local=part.local[rows >= 0])


def solve_in_contact_forces(
    system: System,
    grids: tuple[GridBlock, ...],
    *,
    start: FloatArray | None = None,
    load_factor: float = 1.0,
    tolerance: float = 1e-8,
) -> ForceState:
    """Solve for the static state of frictionless structured blocks.

    Parameters
    ----------
    system
        Representative blocks, their facets and loads.
    grids
        Of each group (`grid_blocks`).
    start
        Displacements near the solution in block frames, (n_nodes, 3) [mm], such as those of a
        coarser mesh; None: blocks at rest.
    load_factor
        Share of the loads that acts [-].
    tolerance
        Residual at which the iteration stops [-].

    Raises
    ------
    StaticError
        When the iteration does not converge.
    """
    points = _Points(system, grids)
    if start is not None:
        law = system.deformable.contact.law
        at = system.points.gaps(start).x.ravel()
        soft = points.soft(law.stiffness(at), _SOFT * _stiffness_of_block(points))
        try:
            return _Iteration(points, ~soft, load_factor, tolerance, start).run()
        except StaticError:  # a start that is too far
            pass
    everywhere = np.ones(points.n, dtype=np.bool_)
    return _Iteration(points, everywhere, load_factor, tolerance, None).run()


@dataclass(frozen=True)
class _State:
    """Where an iteration is: a linear solution, or a share of the way there."""

    displacement: FloatArray
    """In block frames, (n_nodes, 3) [mm]."""
    motions: FloatArray
    """Of the blocks, (n_slots, 6)."""
    internal: FloatArray
    """K u, (n_nodes, 3) [N]; of a start unknown."""
    forces: FloatArray
    """Of the points, (n,) [N]."""

    def towards(self, other: _State, share: float) -> _State:
        """Take a share of the way to another state."""
        pairs = ((getattr(self, f.name), getattr(other, f.name)) for f in fields(self))
        return _State(*(one + share * (two - one) for one, two in pairs))


class _Iteration:
    """Newton's method with the stiff points as unknowns."""

    def __init__(
        self,
        points: _Points,
        asked: BoolArray,
        load_factor: float,
        tolerance: float,
        start: FloatArray | None,
    ) -> None:
        self.points, self.tolerance = points, tolerance
        self.system = points.system
        self.contact = self.system.deformable.contact
        self.problem = _ForceProblem(points, asked, load_factor)
        law, weights = self.contact.law, points.weights
        n_blocks, area = len(points.grids), float(weights.sum())
        load = float(np.linalg.norm(self.problem.load, axis=1).sum())
        self.mean = max(load / area, float(law.pressure(0.0)), 1e-9 * law.touching_stiffness)
        rest = float(law.overclosure(self.mean))
        first = _FIRST_HOLDING * float(law.stiffness(rest)) * area / n_blocks
        self.least = _LEAST_HOLDING * first
        self.farthest = FARTHEST * self.system.deformable.assembly.characteristic_length
        self.residuals: list[float] = []
        self.turning = TurningNormals(self.system, points.motions)
        self.turned = self.turning.none
        nothing, free = np.zeros((self.system.n_nodes, 3)), np.zeros(points.n)
        self.state = _State(nothing, np.zeros((n_blocks, 6)), nothing, free)
        self.cuts = start is None
        current = self.contact.normals is ContactNormals.CURRENT
        self.seen = self.system
        if start is None:
            # Normals turn later, if they do.
            self.seen = self.system.with_reference_normals if current else self.system
            self._look()
            self.at = np.full(points.n, rest)
            self.holding, self.bound, self.most = first, 0.0, _MOST_ITERATIONS
        else:
            self.state = replace(
                self.state, displacement=start, motions=self.problem.motions_in(start)
            )
            self._look()
            self.at = self.overclosure
            self._turn(weights * law.pressure(self.at))
            self.holding, self.most = self.least, _MOST_FROM_START
            self.bound = _SOFT * _stiffness_of_block(points)

    def run(self) -> ForceState:
        """Iterate until the forces are those of the law, in balance."""
        for _ in range(self.most):
            result = self._step()
            if result is not None:
                return result
            self.holding = max(_FADING * self.holding, self.least)
        raise StaticError(
            f"Newton did not converge in {self.most} iterations: residual "
            f"{self.residuals[-1]:.2g}, expected {self.tolerance:g}"
        )

    def _look(self) -> None:
        """Find the overclosures, (n,) [mm], and their gradients at the displacement."""
        self.gaps = self.seen.points.gaps(self.state.displacement)
        self.overclosure = self.gaps.x.ravel()

    @property
    def _turns(self) -> bool:
        """Whether normals turn now."""
        return self.seen is self.system and self.contact.normals is ContactNormals.CURRENT

    def _turn(self, forces: FloatArray) -> None:
        """Let normals turn with the displacement, under forces of the points (n,) [N]."""
        if self._turns:
            straight = self.points.approach(self.state.displacement) - self.points.gaps
            at = self.state.displacement, self.gaps
            self.turned = self.turning.turned(*at, straight, forces)

    def _step(self) -> ForceState | None:
        """One linear problem; the state where it is the last one."""
        points, law, weights = self.points, self.contact.law, self.points.weights
        count(Operation.CALL, points.system.n_slots)
        stiffness = law.stiffness(self.at)
        counts = ~points.soft(stiffness, self.bound)
        stiff = np.flatnonzero(counts & (stiffness > _LEAST_STIFFNESS * law.touching_stiffness))
        given, slope = weights * law.pressure(self.at), stiffness[stiff]
        given[stiff] = 0.0
        solve = partial(
            self.problem.linear,
            stiff,
            law.pressure(self.at[stiff]) / slope - self.at[stiff],
            1.0 / (weights[stiff] * slope),
            given=given,
            before=self.state.motions,
            holding=self.holding,
        )
        try:
            try:
                solution = solve(turned=self.turned)
            except UnresistedMotionError:
                # Far from rest turning normals may push: what resists without them leads there.
                solution = solve(turned=self.turned.without_stiffness)
        except (UnresistedMotionError, np.linalg.LinAlgError) as error:
            raise StaticError(f"contact forces: {error}") from None
        if np.abs(solution.displacement).max() > self.farthest:
            raise StaticError("blocks move away without end")
        cut = self._go(solution)
        if self._is_last():
            state = self.state
            return ForceState(state.displacement, state.internal, tuple(self.residuals))
        forces = self.state.forces
        if self.seen is not self.system and self.residuals[-1] < _SETTLED:
            self.seen = self.system
            self._look()
        self._turn(forces)
        self.at = self.overclosure if cut else self._linearised(stiff, forces)
        return None

    def _go(self, solution: _State) -> bool:
        """Go to a linear solution, or to the least energy on the way; whether it is cut.

        As `fem.static.newton`. The energy of turned normals is not convex, and there no way is cut.
        """
        law, weights, start, before = (
            self.contact.law,
            self.points.weights,
            self.state,
            self.overclosure,
        )
        self.state = solution
        self._look()
        if not self.cuts or self._turns:
            return False
        way, change = solution.displacement - start.displacement, self.overclosure - before
        first = float(np.vdot(start.internal - self.problem.load, way))
        growth = float(np.vdot(solution.internal - start.internal, way))

        def slope(share: float) -> float:
            pressure = law.pressure(before + share * change)
            return first + share * growth + float(np.vdot(weights * pressure, change))

        share = least_share(slope)
        if share < 1.0:
            self.state = start.towards(solution, share)
            self._look()
            pressing = weights * law.pressure(self.overclosure)
            self.state = replace(self.state, forces=pressing)
        return share < 1.0

    def _is_last(self) -> bool:
        """Judge the state: forces are those of the law, in balance, and nothing else holds it."""
        system, state = self.system, self.state
        pressing = self.points.weights * self.contact.law.pressure(self.overclosure)
        of_law = system.points.scatter(self.gaps.gradient, pressing)
        unbalanced = self.problem.load + of_law - state.internal
        residual = relative_residual(system, unbalanced, pressing)
        size = max(float(np.linalg.norm(state.forces)), 1e-300)
        wrong = float(np.linalg.norm(pressing - state.forces)) / size
        self.residuals.append(max(residual, wrong))
        free = self.holding <= self.least and self.seen is self.system
        return free and self.residuals[-1] <= self.tolerance

    def _linearised(self, stiff: IntArray, forces: FloatArray) -> FloatArray:
        """Overclosures at which the law is linearised after a linear solution, (n,) [mm]."""
        law, weights = self.contact.law, self.points.weights
        # An exponential overshoots: nowhere is it linearised beyond the largest force so far.
        largest = float(np.max(forces[stiff] / weights[stiff], initial=self.mean))
        at: FloatArray = np.minimum(self.overclosure, law.overclosure(largest))
        pressing = stiff[forces[stiff] > 0.0]
        at[pressing] = law.overclosure(forces[pressing] / weights[pressing])
        return at


def _stiffness_of_block(points: _Points) -> float:
    """Young's modulus over the size of a block, the softest one [MPa/mm]."""
    return min(
        grid.material.young_modulus / float(np.ptp(grid.nodes, axis=0).max())
        for grid in points.grids
    )
