"""Frictionless equilibrium of structured blocks of higher degree, in the forces of contact points.

The same discrete problem as that of `fem.static.newton`, solved in other unknowns: every block is
reduced to the flexibility between its contact points (`fem.static.linear_step.grid_block`),
whatever the degree of its elements. With reference normals the overclosure of a point is the sum
of the outward displacements of its two sides,

    x = Σ ν · u - gap + δ = -A q + H + M α - gap + δ,      Mᵀ q = Rᵀ f,

with A, H and M summed over the blocks in contact. Current normals turn by the rotations of the
blocks, a share of 1e-3 or less: what they change of x (δ) and of the forces is taken from the
iteration before, so that the converged state is that of the current normals.

The law is linearised in pressure as in `fem.static.newton`: after a solution each point that
presses is linearised where the law has that pressure. From a start, points whose contact is soft
against the block keep the force of the step before; the others are the unknowns, level by level a
chain of dense blocks.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.spatial import cKDTree

from fem.assembly.deformable import DeformableAssembly
from fem.assembly.local_system import LocalSystem
from fem.contact.surfaces import ContactNormals, ContactSurfaces, PointKinematics
from fem.static.linear_step.block_tridiagonal import Level, UnresistedMotionError, factor_chain
from fem.static.linear_step.condensed import levels_of
from fem.static.linear_step.grid_block import GridBlock, PointFlexibility, grid_block
from fem.static.newton import FARTHEST, relative_residual
from fem.static.result import StaticError
from fem.static.time_limit import check_time
from geometry.mesh import BoolArray, FloatArray, IntArray

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


class _Points:
    """Contact points of all representative blocks, and which of each block they are."""

    def __init__(self, system: LocalSystem, grids: tuple[GridBlock, ...]) -> None:
        self.system = system
        surfaces = system.surfaces
        assert isinstance(surfaces, ContactSurfaces)
        self.surfaces = surfaces
        share = system.orbits.share
        weights = surfaces.weights if share is None else share[:, None] * surfaces.weights
        self.weights: FloatArray = weights.ravel()
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
        self.parts: list[list[_Part]] = [[] for _ in self.grids]
        quads = np.split(system.corner_nodes, 2, axis=1)
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
                    self.parts[slot].append(_Part(int(level), points, local[rows]))

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

    def pushed(self, forces: FloatArray) -> list[FloatArray]:
        """Forces on the nodes of each grid from those of the points, (n_grid_nodes, 3) [N]."""
        result = []
        for grid, parts in zip(self.grids, self.parts, strict=True):
            local = np.zeros(len(grid.positions))
            for part in parts:
                local[part.local] += forces[part.points]
            result.append(-(grid.outward.T @ local).reshape(-1, 3))
        return result

    def approach(self, on_grids: list[FloatArray]) -> FloatArray:
        """Σ ν · u of all points, (n,) [mm], from displacements of the nodes of each grid."""
        result = np.zeros(self.n)
        for grid, parts, u in zip(self.grids, self.parts, on_grids, strict=True):
            outward = grid.outward @ u.ravel()
            for part in parts:
                result[part.points] += outward[part.local]
        return result

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


@dataclass(frozen=True)
class _Turning:
    """What current normals change against reference ones, at one displacement."""

    overclosure: FloatArray
    """δ of every point, (n,) [mm]."""
    forces: FloatArray
    """Of the nodes, (n_nodes, 3) [N]."""


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

    def linear(
        self,
        stiff: IntArray,
        right: FloatArray,
        softness: FloatArray,
        *,
        given: FloatArray,
        turning: _Turning,
        before: FloatArray,
        holding: float,
    ) -> tuple[FloatArray, FloatArray, list[FloatArray]]:
        """Forces of all points (n,) [N], motions (n_slots, 6), displacements of all grids [mm].

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
        turning
            Of the iteration before.
        before, holding
            Motions that springs hold, and their stiffness.
        """
        points = self.points
        row = np.full(points.n, -1, dtype=np.int64)
        row[stiff] = np.arange(len(stiff))
        mine = [[_among(part, row) for part in parts] for parts in points.parts]
        nodal = self.load + turning.forces
        loads = [points.on_grid(s, nodal) + f for s, f in enumerate(points.pushed(given))]
        loaded = self._displacements(loads)
        approach = points.approach(loaded) - points.gaps + turning.overclosure
        side, motions = right + approach[stiff], np.zeros_like(before)
        for slot, (grid, load) in enumerate(zip(points.grids, loads, strict=True)):
            motions[slot] = -grid.rigid.T @ load.ravel() - holding * before[slot]
        levels, members = self._chain(stiff, mine, softness, holding)
        sides = [(side[m], motions[self.members[k]].ravel()) for k, m in enumerate(members)]
        forces = given.copy()
        for k, (result, alpha) in enumerate(factor_chain(levels).solve(sides)):
            forces[stiff[members[k]]] = result
            motions[self.members[k]] = alpha.reshape(-1, 6)
        displaced = self._displacements(points.pushed(forces - given))
        for slot, grid in enumerate(points.grids):
            displaced[slot] += loaded[slot] + (grid.rigid @ motions[slot]).reshape(-1, 3)
        return forces, motions, displaced

    def _displacements(self, forces: list[FloatArray]) -> list[FloatArray]:
        """G of the forces on each grid, those of congruent blocks at once."""
        result = forces.copy()
        for block in set(self.blocks):
            slots = [slot for slot, other in enumerate(self.blocks) if other is block]
            moved = block.displacements(np.stack([forces[slot] for slot in slots]))
            for slot, own in zip(slots, moved, strict=True):
                result[slot] = own
        return result

    def _chain(
        self, stiff: IntArray, mine: list[list[_Part]], softness: FloatArray, holding: float
    ) -> tuple[list[Level], list[IntArray]]:
        """The chain, and its points: of each level those of its blocks alone, then those shared."""
        points = self.points
        level, shared = points.level[stiff], points.shared[stiff]
        order = np.lexsort((shared, level))
        starts = np.searchsorted(level[order], np.arange(len(self.members) + 1))
        members = [order[a:b] for a, b in pairwise(starts)]
        place = np.empty(len(stiff), dtype=np.int64)
        place[order] = np.arange(len(stiff)) - starts[level[order]]
        levels = []
        for k, m in enumerate(members):
            first, after = int((~shared[m]).sum()), k + 1 < len(members)
            width = 6 * len(self.members[k])
            n_after = len(members[k + 1]) if after else 0
            levels.append(
                Level(
                    flexibility=np.asfortranarray(np.diag(softness[m])),
                    motions=np.zeros((len(m), width)),
                    holding=holding * np.eye(width),
                    first_shared=first,
                    next_flexibility=np.zeros((len(m) - first, n_after)),
                    next_motions=np.zeros(
                        (len(m) - first, 6 * len(self.members[k + 1]) if after else 0)
                    ),
                )
            )
        for slot, parts in enumerate(mine):
            for part in parts:
                self.blocks[slot].include(part.local)
        for k, slots in enumerate(self.members):
            for column, slot in enumerate(slots):
                span = slice(6 * column, 6 * column + 6)
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


def _among(part: _Part, row: IntArray) -> _Part:
    """Points of a part that have a row, and those rows."""
    rows = row[part.points]
    return _Part(part.level, rows[rows >= 0], part.local[rows >= 0])


def solve_in_contact_forces(
    system: LocalSystem,
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
        at = system.kinematics(start, system.deformable.contact.normals).overclosure.ravel()
        soft = points.soft(law.stiffness(at), _SOFT * _stiffness_of_block(points))
        try:
            return _Iteration(points, ~soft, load_factor, tolerance, start).run()
        except StaticError:  # a start that is too far
            pass
    everywhere = np.ones(points.n, dtype=np.bool_)
    return _Iteration(points, everywhere, load_factor, tolerance, None).run()


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
        self.motions = np.zeros((n_blocks, 6))
        self.residuals: list[float] = []
        self.turning = _Turning(np.zeros(points.n), np.zeros((self.system.n_nodes, 3)))
        self.reference = self._reference_gradient()
        self.at = np.full(points.n, rest)
        self.holding, self.bound, self.most = first, 0.0, _MOST_ITERATIONS
        if start is not None:
            kinematics = self.system.kinematics(start, self.contact.normals)
            self.at = kinematics.overclosure.ravel()
            on_grids = [points.on_grid(s, start) for s in range(n_blocks)]
            pressing = points.weights * law.pressure(self.at)
            self.turning = self._turning(kinematics, on_grids, pressing)
            self.holding, self.most = self.least, _MOST_FROM_START
            self.bound = _SOFT * _stiffness_of_block(points)

    def _reference_gradient(self) -> FloatArray | None:
        if self.contact.normals is ContactNormals.REFERENCE:
            return None
        rest = np.zeros((self.system.n_nodes, 3))
        return self.system.kinematics(rest, ContactNormals.REFERENCE).gradient

    def _turning(
        self, kinematics: PointKinematics, on_grids: list[FloatArray], forces: FloatArray
    ) -> _Turning:
        """What current normals change at a displacement, under forces (n,) [N] of the points."""
        if self.reference is None:
            return self.turning
        straight = self.points.approach(on_grids) - self.points.gaps
        change = kinematics.gradient - self.reference
        nodal = self.system.scatter(change, forces.reshape(change.shape[:2]))
        return _Turning(kinematics.overclosure.ravel() - straight, nodal)

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

    def _step(self) -> ForceState | None:
        """One linear problem; the state where it is the last one."""
        check_time()
        points, law, weights = self.points, self.contact.law, self.points.weights
        stiffness = law.stiffness(self.at)
        counts = ~points.soft(stiffness, self.bound)
        stiff = np.flatnonzero(counts & (stiffness > _LEAST_STIFFNESS * law.touching_stiffness))
        given, slope = weights * law.pressure(self.at), stiffness[stiff]
        given[stiff] = 0.0
        try:
            forces, self.motions, on_grids = self.problem.linear(
                stiff,
                law.pressure(self.at[stiff]) / slope - self.at[stiff],
                1.0 / (weights[stiff] * slope),
                given=given,
                turning=self.turning,
                before=self.motions,
                holding=self.holding,
            )
        except (UnresistedMotionError, np.linalg.LinAlgError) as error:
            raise StaticError(f"contact forces: {error}") from None
        result = self._state(forces, on_grids)
        if result is None:
            self._linearise(stiff, forces)
        return result

    def _state(self, forces: FloatArray, on_grids: list[FloatArray]) -> ForceState | None:
        """Judge a linear solution; None: it is not the last one."""
        points, system, weights = self.points, self.system, self.points.weights
        displacement = points.to_nodes(on_grids)
        if np.abs(displacement).max() > self.farthest:
            raise StaticError("blocks move away without end")
        kinematics = system.kinematics(displacement, self.contact.normals)
        self.overclosure = kinematics.overclosure.ravel()
        pressing = weights * self.contact.law.pressure(self.overclosure)
        taken = points.to_nodes(points.pushed(forces)) + self.turning.forces
        of_law = system.scatter(
            kinematics.gradient, pressing.reshape(system.surfaces.weights.shape)
        )
        residual = relative_residual(system, of_law - taken, pressing)
        size = max(float(np.linalg.norm(forces)), 1e-300)
        wrong = float(np.linalg.norm(pressing - forces)) / size
        self.residuals.append(max(residual, wrong))
        if self.residuals[-1] <= self.tolerance and self.holding <= self.least:
            internal = self.problem.load + taken
            return ForceState(displacement, internal, tuple(self.residuals))
        self.turning = self._turning(kinematics, on_grids, forces)
        return None

    def _linearise(self, stiff: IntArray, forces: FloatArray) -> None:
        """Overclosures at which the law is linearised next."""
        law, weights = self.contact.law, self.points.weights
        # An exponential overshoots: nowhere is it linearised beyond the largest force so far.
        largest = float(np.max(forces[stiff] / weights[stiff], initial=self.mean))
        self.at = np.minimum(self.overclosure, law.overclosure(largest))
        pressing = stiff[forces[stiff] > 0.0]
        self.at[pressing] = law.overclosure(forces[pressing] / weights[pressing])


def _stiffness_of_block(points: _Points) -> float:
    """Young's modulus over the size of a block, the softest one [MPa/mm]."""
    return min(
        grid.element.material.young_modulus / float(np.ptp(grid.nodes, axis=0).max())
        for grid in points.grids
    )
