"""Static state of a tube of curved blocks of high degree, in the forces of its contact points.

One block of each layer stands for its layer: loads and supports are the same for all. A layer is
turned by whole waves against the one below, so points of joints meet point on point, the blocks
beside each other too. Where a turn by π about a radius through the middle of the tube maps the
tube onto itself, the lower half of the layers stands for the upper one. Between reference normals
the overclosure of a point is the sum of the outward displacements of its two sides,

    x = Σ ν · u = -A q + H + M α - clearance,      Mᵀ q = Rᵀ f,

with A, H and M summed from the blocks that meet (`fem.static.lagrange_block`). The law is
linearised in pressure as in `fem.static.newton`: after a solution each point that presses is
linearised where the law has that pressure. Points whose contact is soft against the block take the
force of the step before; the others are the unknowns, layer by layer a chain of dense blocks.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fem.contact.law import ContactLaw
from fem.element.lagrange_stress import MovedBodies
from fem.static.lagrange_block import (
    ContactPoints,
    FreeBlock,
    Lattice,
    contact_points,
    free_block,
)
from fem.static.linear_step.block_tridiagonal import (
    Level,
    UnresistedMotionError,
    factor_chain,
)
from fem.static.result import StaticError
from geometry.mesh import BoolArray, FloatArray, IntArray

#: Faces of a block that meet others.
CONTACT_FACES = ("bottom", "top", "left", "right")
#: Holding springs of the blocks at first, over the tangent stiffness of their contacts, …
_FIRST_HOLDING = 0.25
#: … how they fade, and when they are gone.
_FADING = 0.1
_LEAST_HOLDING = 1e-9
#: Contact is soft below this share of the stiffness of a block, Young's modulus over its size, …
_SOFT = 0.02
#: … as long as a joint has no more of its own stiffness in soft points: the rest holds the blocks.
_SOFT_SHARE = 0.05
#: Stiffness of open points over that at first touch below which they are left out.
_LEAST_STIFFNESS = 1e-12
#: Linear problems at most, from rest and from a start.
_MOST_ITERATIONS, _MOST_FROM_START = 80, 25


@dataclass(frozen=True)
class LayeredJoints:
    """Which points of which layers meet."""

    n_layers: int
    """Free layers L; below and above them is a rigid frame."""
    turned: tuple[int, ...]
    """Elements by which each layer from the second on is turned against the one below."""
    halved: bool = False
    """Whether the lower half stands for the upper one, turned by π; L is even then."""

    @property
    def n_blocks(self) -> int:
        """Blocks that are computed, one a layer."""
        return self.n_layers // 2 if self.halved else self.n_layers


@dataclass(frozen=True)
class Side:
    """One side of the points of a joint."""

    layer: int
    """Which block."""
    face: str
    """Which of its faces."""
    order: IntArray
    """Point of that face at each point of the joint, (n,)."""


@dataclass(frozen=True)
class Joint:
    """Points at which a block meets another one or the frame."""

    level: int
    """Lower of its blocks that are computed."""
    sides: tuple[Side, ...]
    """One against the frame, else two."""
    share: FloatArray
    """Part of the area of each point that counts, (n,): a point that is its own image is half."""


def joints_of(
    counts: tuple[int, int, int], layered: LayeredJoints, per_quad: int
) -> tuple[Joint, ...]:
    """Joints of one sector, level by level: frame, beside each other, above.

    ``counts`` are the elements of a block in each direction, ``per_quad`` the points of a quad.
    """
    n_1, n_2, n_3 = counts
    line = round(per_quad**0.5)
    flat = np.arange(n_1 * n_2 * per_quad, dtype=np.int64)
    grid = flat.reshape(n_1, n_2, line, line)
    # Turned by π about the middle of a block: last place around becomes first.
    image = grid[:, ::-1, :, ::-1].ravel()
    beside = np.arange(n_1 * n_3 * per_quad, dtype=np.int64)
    last = layered.n_blocks - 1
    found = [_joint(0, Side(0, "bottom", flat))]
    for layer in range(layered.n_blocks):
        found.append(_joint(layer, Side(layer, "right", beside), Side(layer, "left", beside)))
        if layer == last and not layered.halved:
            found.append(_joint(layer, Side(layer, "top", flat)))
            continue
        # A point at u of the block below lies at u - turn of the block above.
        above = np.roll(grid, layered.turned[layer], axis=1).ravel()
        if layer < last:
            found.append(_joint(layer, Side(layer, "top", flat), Side(layer + 1, "bottom", above)))
            continue
        opposite = image[above]
        kept = np.flatnonzero(flat <= opposite)
        sides = Side(layer, "top", flat[kept]), Side(layer, "top", opposite[kept])
        share = np.where(flat[kept] == opposite[kept], 0.5, 1.0)
        found.append(Joint(layer, sides, share))
    return tuple(found)


def _joint(level: int, *sides: Side) -> Joint:
    return Joint(level, sides, np.ones(len(sides[0].order)))


@dataclass(frozen=True)
class TubeState:
    """A static state of a layered tube."""

    lattice: Lattice
    """The block of every layer."""
    layered: LayeredJoints
    """How layers meet."""
    pressures: FloatArray
    """At the quadrature points of all joints, (n_points,) [MPa]."""
    weights: FloatArray
    """Areas of those points, (n_points,) [mm²]."""
    displacements: FloatArray
    """Of all nodes of the block of each layer that is computed, in its own frame,
    (n_blocks, n_nodes, 3) [mm]."""
    iterations: int
    """Linear problems solved."""
    residual: float
    """Norm of the contact forces that the law does not have, over that of all [-]."""

    @property
    def bodies(self) -> MovedBodies:
        """Those blocks, to sample their stresses."""
        lattice = self.lattice
        return MovedBodies(lattice.element, lattice.positions, lattice.elements, self.displacements)


@dataclass(frozen=True)
class _Part:
    """Points of joints on one block: which, and which of the block's own."""

    level: int
    """Of the joint."""
    points: IntArray
    """Each once, (n,)."""
    local: IntArray
    """(n,)"""


class _Responses:
    """Flexibility of a block between the points that were asked for so far."""

    def __init__(self, block: FreeBlock) -> None:
        self.block = block
        self.asked = block.flexible.points
        self.row = np.full(len(block.motions), -1, dtype=np.int64)
        self.row[self.asked] = np.arange(len(self.asked))
        self.flexibility = block.flexible.flexibility

    def between(self, local: IntArray, other: IntArray) -> FloatArray:
        """F of points that `include` was given, (n, m) [mm/N]."""
        return self.flexibility[np.ix_(self.row[local], self.row[other])]

    def include(self, local: IntArray) -> None:
        """Find the response to forces on points."""
        new = np.unique(local[self.row[local] < 0])
        if not len(new):
            return
        outward = self.block.points.outward
        forces = outward[new].toarray().reshape(len(new), -1, 3)
        moved = self.block.flexible.displacements(forces).reshape(len(new), -1).T
        before, after = len(self.asked), len(self.asked) + len(new)
        self.asked = np.concatenate([self.asked, new])
        self.row[new] = np.arange(before, after)
        grown = np.empty((after, after))
        grown[:before, :before] = self.flexibility
        grown[:, before:] = outward[self.asked] @ moved
        grown[before:, :before] = grown[:before, before:].T
        self.flexibility = grown


class _Joints:
    """Points of all joints of one sector, and which of each block they are."""

    def __init__(self, points: ContactPoints, layered: LayeredJoints, clearance: float) -> None:
        self.points, self.layered, self.clearance = points, layered, clearance
        joints = joints_of(points.lattice.counts, layered, points.per_quad)
        ends = np.cumsum([0, *(len(j.share) for j in joints)])
        self.n = int(ends[-1])
        self.number = np.repeat(np.arange(len(joints)), np.diff(ends))
        self.level = np.repeat([j.level for j in joints], np.diff(ends))
        #: Whether the block above is met as well.
        self.shared = np.repeat(
            [len({s.layer for s in j.sides}) > 1 for j in joints], np.diff(ends)
        )
        self.parts: list[list[_Part]] = [[] for _ in range(layered.n_blocks)]
        self.weights = np.zeros(self.n)
        for joint, first, last in zip(joints, ends[:-1], ends[1:], strict=True):
            where = np.arange(first, last)
            for side in joint.sides:
                local = points.start[side.face] + side.order
                self.parts[side.layer].append(_Part(joint.level, where, local))
                area = points.faces[side.face].weights.ravel()[side.order]
                self.weights[where] = joint.share * area

    def on_blocks(self, forces: FloatArray) -> FloatArray:
        """Forces on nodes from those of the points, (n_blocks, n_nodes, 3) [N]."""
        local = np.zeros((len(self.parts), self.points.outward.shape[0]))
        for mine, parts in zip(local, self.parts, strict=True):
            for part in parts:
                np.add.at(mine, part.local, forces[part.points])
        pushed: FloatArray = -(self.points.outward.T @ local.T).T
        return pushed.reshape(len(local), -1, 3)

    def overclosure(self, displacements: FloatArray) -> FloatArray:
        """Overclosures of all points, (n,) [mm], from displacements (n_blocks, n_nodes, 3) [mm]."""
        found = np.full(self.n, -self.clearance)
        for parts, u in zip(self.parts, displacements, strict=True):
            outward = self.points.outward @ u.ravel()
            for part in parts:
                found[part.points] += outward[part.local]
        return found

    def of_blocks(self, points: BoolArray) -> BoolArray:
        """Own points of a block at some points of joints, (n_local,)."""
        local = np.zeros(self.points.outward.shape[0], dtype=np.bool_)
        for part in (p for parts in self.parts for p in parts):
            local[part.local[points[part.points]]] = True
        return local

    def soft(self, stiffness: FloatArray, below: float) -> BoolArray:
        """Points softer than a bound that carry little of the stiffness of their joints, (n,)."""
        slope = self.weights * stiffness
        order = np.lexsort((slope, self.number))
        sums = np.cumsum(slope[order])
        first = np.searchsorted(self.number[order], np.arange(int(self.number[-1]) + 1))
        before = np.concatenate([[0.0], sums])[first]
        total = np.diff([*before, sums[-1]])
        number = self.number[order]
        little = np.empty(self.n, dtype=np.bool_)
        little[order] = sums - before[number] <= _SOFT_SHARE * total[number]
        return little & (stiffness < below)


class _Problem:
    """The linear problems of one sector."""

    def __init__(self, joints: _Joints, block: FreeBlock, force: FloatArray) -> None:
        self.joints, self.block = joints, block
        self.force = np.tile(force, (joints.layered.n_blocks, 1, 1))
        self.responses = _Responses(block)

    def linear(
        self,
        stiff: IntArray,
        right: FloatArray,
        softness: FloatArray,
        *,
        given: FloatArray,
        before: FloatArray,
        holding: float,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Forces of all points (n,) [N], motions (n_blocks, 6) and displacements of all blocks.

        Parameters
        ----------
        stiff
            Those points, (n_s,), ascending.
        right
            Where the law's tangent has no pressure, with the other sign, (n_s,) [mm].
        softness
            One over the slope of their forces, (n_s,) [mm/N].
        given
            Forces of the soft points, zero elsewhere, (n,) [N].
        before, holding
            Motions that springs hold, and their stiffness.
        """
        block, joints = self.block, self.joints
        row = np.full(joints.n, -1, dtype=np.int64)
        row[stiff] = np.arange(len(stiff))
        mine = [[_among(part, row) for part in parts] for parts in joints.parts]
        loads = self.force + joints.on_blocks(given)
        loaded = block.flexible.displacements(loads)
        side, motions = right - joints.clearance, np.zeros_like(before)
        for layer, parts in enumerate(mine):
            response = block.points.outward @ loaded[layer].ravel()
            for part in parts:
                side[part.points] += response[part.local]
            motions[layer] = -block.rigid.T @ loads[layer].ravel() - holding * before[layer]
        levels, members = self._chain(stiff, mine, softness, holding)
        sides = [(side[m], motions[k]) for k, m in enumerate(members)]
        forces = given.copy()
        for k, found in enumerate(factor_chain(levels).solve(sides)):
            forces[stiff[members[k]]], motions[k] = found
        pushed = block.flexible.displacements(joints.on_blocks(forces - given))
        rigid = (motions @ block.rigid.T).reshape(pushed.shape)
        return forces, motions, loaded + pushed + rigid

    def _chain(
        self, stiff: IntArray, mine: list[list[_Part]], softness: FloatArray, holding: float
    ) -> tuple[list[Level], list[IntArray]]:
        """The chain, and its points: of each level those of its block alone, then those shared."""
        n_levels = self.joints.layered.n_blocks
        level, shared = self.joints.level[stiff], self.joints.shared[stiff]
        order = np.lexsort((shared, level))
        starts = np.searchsorted(level[order], np.arange(n_levels + 1))
        members = [order[a:b] for a, b in pairwise(starts)]
        place = np.empty(len(stiff), dtype=np.int64)
        place[order] = np.arange(len(stiff)) - starts[level[order]]
        levels = []
        for k, m in enumerate(members):
            first = int((~shared[m]).sum())
            after = len(members[k + 1]) if k + 1 < n_levels else 0
            levels.append(
                Level(
                    flexibility=np.asfortranarray(np.diag(softness[m])),
                    motions=np.zeros((len(m), 6)),
                    holding=holding * np.eye(6),
                    first_shared=first,
                    next_flexibility=np.zeros((len(m) - first, after)),
                    next_motions=np.zeros((len(m) - first, 6 if k + 1 < n_levels else 0)),
                )
            )
        self.responses.include(np.concatenate([p.local for parts in mine for p in parts]))
        for layer, parts in enumerate(mine):
            for part in parts:
                self._add(levels, layer, part, parts, place)
        return levels, members

    def _add(
        self, levels: list[Level], layer: int, part: _Part, others: list[_Part], place: IntArray
    ) -> None:
        """Add the response of one block at the points of a joint to forces on all its joints."""
        rows, level = place[part.points], levels[part.level]
        if part.level == layer:
            level.motions[rows] += self.block.motions[part.local]
        else:
            level.next_motions[rows - level.first_shared] += self.block.motions[part.local]
        for other in others:
            if other.level < part.level:
                continue  # the chain needs one of the two
            flexible = self.responses.between(part.local, other.local)
            columns = place[other.points]
            if other.level == part.level:
                level.flexibility[np.ix_(rows, columns)] += flexible
            else:
                level.next_flexibility[np.ix_(rows - level.first_shared, columns)] += flexible


def _among(part: _Part, row: IntArray) -> _Part:
    """Points of a part that have a row, and those rows."""
    rows = row[part.points]
    return _Part(part.level, rows[rows >= 0], part.local[rows >= 0])


def transferred(state: TubeState, lattice: Lattice) -> FloatArray:
    """Displacements of a state at the nodes of another mesh of its block.

    Returns
    -------
    FloatArray
        (n_blocks, n_nodes, 3) [mm]: what `solve_layered_tube` starts from.
    """
    first, second, third = (lattice.element.nodes_between(line) for line in lattice.lines)
    return np.stack(
        [state.lattice.at(u, (first, second, third)).reshape(-1, 3) for u in state.displacements]
    )


def solve_layered_tube(
    lattice: Lattice,
    layered: LayeredJoints,
    force: FloatArray,
    law: ContactLaw,
    *,
    clearance: float = 0.0,
    start: FloatArray | None = None,
    tolerance: float = 1e-9,
) -> TubeState:
    """Find the static state of a tube under the same load on every free block.

    Parameters
    ----------
    lattice
        The block of every layer.
    layered
        How layers meet.
    force
        Loads on the nodes of a block, in its own frame, (n_nodes, 3) [N].
    law
        Contact law.
    clearance
        Added to every gap [mm].
    start
        Displacements near the solution, (n_blocks, n_nodes, 3) [mm], such as those of a coarser
        block; None: blocks at rest.
    tolerance
        Residual at which the iteration stops [-].

    Raises
    ------
    StaticError
        When no equilibrium is found.
    """
    joints = _Joints(contact_points(lattice, CONTACT_FACES), layered, clearance)
    if start is not None:
        at = joints.overclosure(start)
        soft = joints.soft(law.stiffness(at), _SOFT * _stiffness_of_block(lattice))
        asked = joints.of_blocks(~soft)
        try:
            return _iterate(joints, asked, force, law, tolerance=tolerance, at=at)
        except StaticError:  # a start that is too far
            pass
    everywhere = np.ones(joints.points.outward.shape[0], dtype=np.bool_)
    return _iterate(joints, everywhere, force, law, tolerance=tolerance, at=None)


def _iterate(
    joints: _Joints,
    asked: BoolArray,
    force: FloatArray,
    law: ContactLaw,
    *,
    tolerance: float,
    at: FloatArray | None,
) -> TubeState:
    """Newton's method with the stiff points as unknowns, from overclosures."""
    problem = _Problem(joints, free_block(joints.points, asked), force)
    n_blocks, weights = joints.layered.n_blocks, joints.weights
    area = float(weights.sum())
    load = float(np.linalg.norm(force, axis=1).sum()) * n_blocks
    mean = max(load / area, float(law.pressure(0.0)), 1e-9 * law.touching_stiffness)
    rest = float(law.overclosure(mean))
    first = _FIRST_HOLDING * float(law.stiffness(rest)) * area / n_blocks
    least = _LEAST_HOLDING * first
    holding, most = (first, _MOST_ITERATIONS) if at is None else (least, _MOST_FROM_START)
    bound = 0.0 if at is None else _SOFT * _stiffness_of_block(joints.points.lattice)
    at = np.full(joints.n, rest) if at is None else at
    motion = np.zeros((n_blocks, 6))
    residual = float("inf")
    for iteration in range(1, most + 1):
        stiffness = law.stiffness(at)
        counts = ~joints.soft(stiffness, bound)
        stiff = np.flatnonzero(counts & (stiffness > _LEAST_STIFFNESS * law.touching_stiffness))
        given, slope = weights * law.pressure(at), stiffness[stiff]
        given[stiff] = 0.0
        try:
            forces, motion, displacements = problem.linear(
                stiff,
                law.pressure(at[stiff]) / slope - at[stiff],
                1.0 / (weights[stiff] * slope),
                given=given,
                before=motion,
                holding=holding,
            )
        except (UnresistedMotionError, np.linalg.LinAlgError) as error:
            raise StaticError(f"no equilibrium of curved elements: {error}") from None
        overclosure = joints.overclosure(displacements)
        pressures = law.pressure(overclosure)
        wrong = float(np.linalg.norm(weights * pressures - forces))
        residual = wrong / max(float(np.linalg.norm(forces)), 1e-300)
        if residual <= tolerance and holding <= least:
            return TubeState(
                joints.points.lattice,
                joints.layered,
                pressures,
                weights,
                displacements,
                iteration,
                residual,
            )
        # An exponential overshoots: nowhere is it linearised beyond the largest force so far.
        largest = float(np.max(forces[stiff] / weights[stiff], initial=mean))
        at = np.minimum(overclosure, law.overclosure(largest))
        pressing = stiff[forces[stiff] > 0.0]
        at[pressing] = law.overclosure(forces[pressing] / weights[pressing])
        holding = max(_FADING * holding, least)
    raise StaticError(
        f"no equilibrium after {most} iterations of curved elements (residual "
        f"{residual:.2g}); expected {tolerance:g}: take fem.degree = 1"
    )


def _stiffness_of_block(lattice: Lattice) -> float:
    """Young's modulus over the size of a block [MPa/mm]."""
    size = float(np.ptp(lattice.positions, axis=0).max())
    return lattice.element.material.young_modulus / size
