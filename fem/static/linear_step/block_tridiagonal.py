"""Direct solution of a chain of dense saddle-point blocks.

Level k has unknowns q (forces) and α (motions):

    A q - C α + (couplings) = d,    -Cᵀ q - τ α + (couplings) = e

Only the last forces of a level, those shared with the next one, couple with it. A is positive
definite, so each level is a Cholesky factorisation, and a small one for its motions. Forces
between blocks of the first level and rigid ones, which couple with those of the same block alone,
are eliminated before the others.

Where points slide, the friction that follows a contact force turns its direction: A, and the
couplings, are not symmetric then (`Leaning`), and each level is an LU factorisation.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import scipy.linalg
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from fem.system.system import Sector
from geometry.machine.work import count_elimination
from geometry.mesh import BoolArray, FloatArray, IntArray

#: Forces and motions of a level, or their right-hand sides.
Side = tuple[FloatArray, FloatArray]

#: Smallest accepted ratio of the pivots of a level's motions: less is a motion nothing resists.
_SMALLEST_PIVOT = 1e-10


class UnresistedMotionError(ValueError):
    """A level with a motion that nothing resists."""

    def __init__(self, level: int, motion: FloatArray) -> None:
        super().__init__(f"level {level}: a motion meets no resistance")
        self.level = level
        """Number of the level."""
        self.motion = motion
        """The motion, (n_motions,)."""


@dataclass(frozen=True)
class Level:
    """One level and its coupling with the next; arrays are overwritten by `factor_chain`."""

    flexibility: FloatArray
    """A, (n, n), Fortran order."""
    motions: FloatArray
    """C, (n, n_motions)."""
    holding: FloatArray
    """τ, (n_motions, n_motions)."""
    first_shared: int
    """First force that couples with the next level."""
    next_flexibility: FloatArray
    """Coupling of the shared forces with the next level's forces, (n - first_shared, n_next)."""
    next_motions: FloatArray
    """Minus their coupling with its motions, like C; (n - first_shared, n_motions_next)."""
    next_holding: FloatArray
    """τ between its motions and those of the next level, (n_motions, n_motions_next)."""
    leaning: Leaning | None = None
    """What the forces do where that is not what they feel; None: the system is symmetric."""
    apart: Sequence[int] = ()
    """Ends of runs of the first forces between which A is zero."""

    @property
    def pushed(self) -> Leaning:
        """What the forces do."""
        if self.leaning is not None:
            return self.leaning
        return Leaning(self.motions, self.next_flexibility.T, self.next_motions)


@dataclass(frozen=True)
class Leaning:
    """What the forces of a level do to motions and to the next level, when they lean."""

    motions: FloatArray
    """C of the balance of motions, (n, n_motions)."""
    next_flexibility: FloatArray
    """Coupling of the next level's forces with the shared ones, (n_next, n - first_shared)."""
    next_motions: FloatArray
    """Like C in the balance of the next motions, (n - first_shared, n_motions_next)."""


@dataclass(frozen=True)
class _Eliminated:
    """Factors of one symmetric level."""

    factor: FloatArray
    motions: FloatArray
    pivot: FloatArray

    def solve(self, force_side: FloatArray, motion_side: FloatArray) -> Side:
        """(q, α) for given right-hand sides."""
        right = _lower_solve(self.factor, force_side)
        alpha = np.zeros(len(motion_side))
        if len(alpha):
            alpha = -scipy.linalg.cho_solve(
                (self.pivot, True), motion_side + self.motions.T @ right
            )
        forces = scipy.linalg.solve_triangular(
            self.factor, right + self.motions @ alpha, lower=True, trans="T", check_finite=False
        )
        return forces, alpha

    def update(self, level: Level, after: Level) -> None:
        """Subtract what the level does to the next one."""
        first = level.first_shared
        n = level.next_flexibility.shape[1]
        # As LAPACK has it from the start: to turn a large matrix costs as much as to eliminate it.
        coupling = np.empty(
            (len(level.next_flexibility), n + level.next_motions.shape[1]), order="F"
        )
        coupling[:, :n] = level.next_flexibility
        np.negative(level.next_motions, out=coupling[:, n:])
        response = _lower_solve(self.factor[first:, first:], coupling, overwrite=True)
        update = response.T @ response
        if len(self.pivot):
            push = self.motions[first:].T @ response
            push[:, n:] -= level.next_holding
            through = _lower_solve(self.pivot, push)
            update -= through.T @ through
        after.flexibility[...] -= update[:n, :n]
        after.motions[...] += update[:n, n:]
        after.holding[...] += update[n:, n:]


#: LU factors and pivots of a matrix.
_LU = tuple[FloatArray, npt.NDArray[np.signedinteger]]


@dataclass(frozen=True)
class _Leant:
    """Factors of one level whose forces lean; those shared with the next level are last."""

    own: _LU
    """Of A of the forces that are not shared."""
    through: FloatArray
    """A⁻¹ of those times the coupling with the shared ones, (n_own, n_shared)."""
    back: FloatArray
    """Coupling of the shared ones with those, (n_shared, n_own)."""
    shared: _LU
    """Of what remains of A on the shared forces."""
    motions: FloatArray
    """A⁻¹ C."""
    pushed: FloatArray
    """C of the balance of motions."""
    pivot: FloatArray

    def _forces(self, side: FloatArray) -> FloatArray:
        """A⁻¹ of one column or several."""
        n = len(self.back.T)
        first = scipy.linalg.lu_solve(self.own, side[:n], check_finite=False)
        rest = side[n:] - self.back @ first
        last = scipy.linalg.lu_solve(self.shared, rest, check_finite=False)
        return np.concatenate([first - self.through @ last, last])

    def _motions(self, balance: FloatArray) -> FloatArray:
        if not len(self.pivot):
            return np.zeros_like(balance)
        return np.asarray(-np.linalg.solve(self.pivot, balance), dtype=np.float64)

    def solve(self, force_side: FloatArray, motion_side: FloatArray) -> Side:
        """(q, α) for given right-hand sides, of one column or several."""
        forces = self._forces(force_side)
        alpha = self._motions(motion_side + self.pushed.T @ forces)
        return forces + self.motions @ alpha, alpha

    def update(self, level: Level, after: Level) -> None:
        """Subtract what the level does to the next one."""
        assert level.leaning is not None
        assert after.leaning is not None
        first, n = level.first_shared, level.next_flexibility.shape[1]
        coupling = np.hstack([level.next_flexibility, -level.next_motions])
        forces = scipy.linalg.lu_solve(self.shared, coupling, check_finite=False)
        pushed = self.pushed[first:] - self.through.T @ self.pushed[:first]
        balance = pushed.T @ forces
        balance[:, n:] -= level.next_holding
        motions = self._motions(balance)
        response = forces + self.motions[first:] @ motions
        done = level.leaning
        update = np.vstack([done.next_flexibility, -done.next_motions.T]) @ response
        update[n:] -= level.next_holding.T @ motions
        after.flexibility[...] -= update[:n, :n]
        after.motions[...] += update[:n, n:]
        after.leaning.motions[...] += update[n:, :n].T
        after.holding[...] += update[n:, n:]


@dataclass(frozen=True)
class ChainFactor:
    """A chain with all its levels eliminated: solves for any right-hand sides."""

    levels: Sequence[Level]
    eliminated: tuple[_Eliminated | _Leant, ...]

    def solve(self, sides: Sequence[Side]) -> list[Side]:
        """Solve for the forces and motions of all levels.

        Parameters
        ----------
        sides
            (d, e) of each level, (n,) and (n_motions,).

        Returns
        -------
        list[tuple[FloatArray, FloatArray]]
            (q, α) of each level.
        """
        done: list[Side] = []
        change: Side | None = None
        for level, eliminated, (force, motion) in zip(
            self.levels, self.eliminated, sides, strict=True
        ):
            side = (force, motion) if change is None else (force - change[0], motion - change[1])
            done.append(side)
            forces, alpha = eliminated.solve(*side)
            shared = forces[level.first_shared :]
            pushed = level.pushed
            change = (
                pushed.next_flexibility @ shared,
                -pushed.next_motions.T @ shared - level.next_holding.T @ alpha,
            )
        result: list[Side] = []
        for level, eliminated, side in zip(
            reversed(self.levels), reversed(self.eliminated), reversed(done), strict=True
        ):
            force, motion = side[0].copy(), side[1]
            if result:
                after = result[-1]
                shared = level.next_motions @ after[1] - level.next_flexibility @ after[0]
                force[level.first_shared :] += shared
                motion = motion + level.next_holding @ after[1]
            result.append(eliminated.solve(force, motion))
        return result[::-1]


def factor_chain(levels: Sequence[Level]) -> ChainFactor:
    """Eliminate the levels one after the other.

    Raises
    ------
    UnresistedMotionError
        A motion without resistance.
    LinAlgError
        A flexibility that is not positive definite.
    """
    done: list[_Eliminated | _Leant] = []
    for k, level in enumerate(levels):
        eliminated = _eliminate(k, level) if level.leaning is None else _eliminate_leaning(k, level)
        done.append(eliminated)
        around = level.next_flexibility.shape[1] + level.motions.shape[1]
        n, shared = len(level.flexibility), len(level.next_flexibility)
        if level.leaning is None:
            count_elimination(n, around)  # forces that are apart included: a bound
        else:
            count_elimination(n - shared, shared, symmetric=False)
            count_elimination(shared, around, symmetric=False)
        if k + 1 < len(levels):
            eliminated.update(level, levels[k + 1])
    return ChainFactor(levels, tuple(done))


class Rows(NamedTuple):
    """Contact points, or components of pairs, level by level."""

    order: IntArray
    """Which of them is each row, (n,)."""
    start: IntArray
    """First row of each level, and the total; (n_levels + 1,)."""
    first_shared: IntArray
    """First row of each level that is shared with the next, (n_levels,)."""
    apart: tuple[int, ...]
    """Ends of the rows between each block of the first level and rigid ones."""

    @property
    def within(self) -> IntArray:
        """Row of each point within its level, (n,)."""
        within = np.empty(len(self.order), dtype=np.int64)
        within[self.order] = np.concatenate([np.arange(n) for n in np.diff(self.start)])
        return within

    def split(self, values: FloatArray) -> list[FloatArray]:
        """Values of all points as those of the rows of each level."""
        return np.split(values[self.order], self.start[1:-1])

    def joined(self, values: Sequence[FloatArray]) -> FloatArray:
        """Values of all points of those of the rows of each level, (n,)."""
        result = np.empty(len(self.order))
        result[self.order] = np.concatenate(values)
        return result


class Chain:
    """Blocks in levels: contacts lie within a level, or between neighbouring ones."""

    def __init__(self, system: Sector) -> None:
        self.level_of = levels_of(system)
        #: Slots of each level, and of both blocks of each facet, (2, n_facets); -1: rigid.
        self.members = [
            np.flatnonzero(self.level_of == k).tolist() for k in range(int(self.level_of.max()) + 1)
        ]
        points, far = system.points, np.iinfo(np.int64).max
        self.slots: IntArray = system.slot_of[np.stack([points.block_m, points.block_s])]
        #: Lower level of each facet, and whether its other block is in the next one, (n_facets,).
        self.low, high = np.sort(np.append(self.level_of, far)[self.slots], axis=0)
        self.shared: BoolArray = (high != far) & (high > self.low)
        beside_rigid = (self.low == 0) & (high == far)
        #: Block of the first level that such a facet has beside a rigid one, else a number beyond.
        self._block: IntArray = np.where(beside_rigid, self.slots.max(axis=0), system.n_slots)

    def rows(self, facet: IntArray) -> Rows:
        """Order points, ascending, of some facets (n,): those shared with the next level last."""
        low, shared, n = self.low[facet], self.shared[facet], len(self.members)
        order = np.lexsort((self._block[facet], shared, low))
        start = np.searchsorted(low[order], np.arange(n + 1))
        first_shared = start[1:] - np.bincount(low[shared], minlength=n)[:n]
        ends = np.cumsum(np.bincount(self._block[facet], minlength=len(self.level_of) + 1)[:-1])
        return Rows(order, start, first_shared, tuple(np.unique(ends[ends > 0]).tolist()))

    def spans(self, widths: Sequence[int]) -> list[slice]:
        """Columns of slots with so many motions among those of their level."""
        span = [slice(0)] * len(widths)
        for slots in self.members:
            for before, slot in zip([None, *slots], slots, strict=False):
                first = 0 if before is None else span[before].stop
                span[slot] = slice(first, first + widths[slot])
        return span

    def zeros(self, rows: Rows, span: Sequence[slice]) -> list[Level]:
        """Levels without any block."""
        size, first = np.diff(rows.start), rows.first_shared - rows.start[:-1]
        width = [span[slots[-1]].stop for slots in self.members]
        ends = zip([*size[1:], 0], [*width[1:], 0], strict=True)
        return [
            Level(
                flexibility=np.zeros((n, n), order="F"),
                motions=np.zeros((n, m)),
                holding=np.zeros((m, m)),
                first_shared=int(shared),
                next_flexibility=np.zeros((n - shared, n_next)),
                next_motions=np.zeros((n - shared, m_next)),
                next_holding=np.zeros((m, m_next)),
                apart=() if k else rows.apart,
            )
            for k, (n, m, shared, (n_next, m_next)) in enumerate(
                zip(size, width, first, ends, strict=True)
            )
        ]

    def sides(
        self, forces: list[FloatArray], motions: Sequence[FloatArray] | FloatArray
    ) -> list[Side]:
        """Right-hand sides of the levels, of forces of their rows and of motions of each slot."""
        pairs = zip(forces, self.members, strict=True)
        return [(force, np.concatenate([motions[s] for s in slots])) for force, slots in pairs]


class LevelPoints(NamedTuple):
    """Points of one level of a block."""

    level: int
    rows: IntArray
    """Their rows within the level, (n,)."""
    felt: FloatArray
    """What motions of the block do to them, (n, n_motions)."""
    at: Any
    """Which of the points of the block they are."""


def add_block(
    levels: Sequence[Level],
    place: tuple[int, slice],
    parts: Sequence[LevelPoints],
    between: Callable[[Any, Any], FloatArray],
) -> None:
    """Add a block to levels.

    Parameters
    ----------
    levels
        To which is added.
    place
        Level of the block, and the columns of its motions there.
    parts
        Its points, in the order of their levels.
    between
        Flexibility of the block between two parts, (n, m).
    """
    own, span = place
    for number, part in enumerate(parts):
        level, rows = levels[part.level], part.rows
        if part.level == own:
            level.motions[rows, span] += part.felt
        else:
            level.next_motions[rows - level.first_shared, span] += part.felt
        for other in parts[: number + 1]:
            flexible, below = between(other.at, part.at), levels[other.level]
            if below is not level:
                _add(below.next_flexibility, other.rows - below.first_shared, rows, flexible)
                continue
            _add(level.flexibility, other.rows, rows, flexible)
            if other is not part:
                _add(level.flexibility, rows, other.rows, flexible.T)


def _add(matrix: FloatArray, rows: IntArray, columns: IntArray, more: FloatArray) -> None:
    """Add a matrix at some rows and columns; where these follow each other at once."""
    if len(rows) and len(columns) and all((np.diff(at) == 1).all() for at in (rows, columns)):
        matrix[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1] += more
    else:
        matrix[np.ix_(rows, columns)] += more


def levels_of(system: Sector) -> IntArray:
    """Level of each slot: contacts lie within a level or between neighbouring ones.

    The layers of the assembly where they are such levels, else distances from an end of the
    graph of blocks (the farthest from an arbitrary one).
    """
    surfaces = system.points
    first = surfaces.pair_start[:-1]
    m = system.slot_of[surfaces.block_m[first]]
    s = system.slot_of[surfaces.block_s[first]]
    both = (m >= 0) & (s >= 0)
    m, s = m[both], s[both]
    layer = system.whole.assembly.layer[system.blocks]
    layer = np.unique(layer, return_inverse=True)[1]
    if not len(m) or np.abs(layer[m] - layer[s]).max() <= 1:
        return np.asarray(layer, dtype=np.int64)
    far = int(np.argmax(_distances(0, m, s, system.n_slots)))
    return _distances(far, m, s, system.n_slots)


def _distances(start: int, m: IntArray, s: IntArray, n: int) -> IntArray:
    """Steps from a slot to every other; parts that are not connected begin anew at zero."""
    graph = csr_array((np.ones(len(m)), (m, s)), shape=(n, n))
    distance = np.full(n, np.inf)
    for seed in [start, *range(n)]:
        if np.isinf(distance[seed]):
            near = dijkstra(graph, directed=False, indices=seed, unweighted=True)
            distance = np.minimum(distance, near)
    return distance.astype(np.int64)


def _lower_solve(factor: FloatArray, right: FloatArray, *, overwrite: bool = False) -> FloatArray:
    return scipy.linalg.solve_triangular(
        factor, right, lower=True, overwrite_b=overwrite, check_finite=False
    )


def _eliminate(number: int, level: Level) -> _Eliminated:
    factor = _lower_factor(level)
    motions = _lower_solve(factor, level.motions)
    pivot = level.holding + motions.T @ motions
    _check_resistance(number, pivot)
    return _Eliminated(
        factor=factor,
        motions=motions,
        pivot=scipy.linalg.cholesky(pivot, lower=True) if len(pivot) else pivot,
    )


def _lower_factor(level: Level) -> FloatArray:
    """Cholesky factor of A, in its place; runs that are apart first, each with what it is next to.

    Its upper triangle means nothing.
    """
    a, rest = level.flexibility, max(level.apart, default=0)
    for begin, end in pairwise((0, *level.apart)):
        run = slice(begin, end)
        a[run, run] = own = scipy.linalg.cholesky(a[run, run], lower=True, check_finite=False)
        beside = rest + np.flatnonzero(a[rest:, run].any(axis=1))
        coupling = _lower_solve(own, a[beside, run].T)
        a[beside, run] = coupling.T
        a[np.ix_(beside, beside)] -= coupling.T @ coupling
    a[rest:, rest:] = scipy.linalg.cholesky(a[rest:, rest:], lower=True, check_finite=False)
    return a


def _eliminate_leaning(number: int, level: Level) -> _Leant:
    assert level.leaning is not None
    n, a = level.first_shared, level.flexibility
    own = scipy.linalg.lu_factor(np.asfortranarray(a[:n, :n]), overwrite_a=True, check_finite=False)
    through = scipy.linalg.lu_solve(own, a[:n, n:], check_finite=False)
    rest = np.asfortranarray(a[n:, n:] - a[n:, :n] @ through)
    shared = scipy.linalg.lu_factor(rest, overwrite_a=True, check_finite=False)
    none = np.zeros((0, 0))
    factors = _Leant(own, through, a[n:, :n], shared, none, level.leaning.motions, none)
    motions = factors._forces(level.motions)
    pivot = level.holding + factors.pushed.T @ motions
    _check_resistance(number, pivot, symmetric=False)
    return replace(factors, motions=motions, pivot=pivot)


def _check_resistance(number: int, pivot: FloatArray, *, symmetric: bool = True) -> None:
    """Reject a motion whose share of the resistance is below `_SMALLEST_PIVOT`."""
    if not len(pivot):
        return
    own = np.diag(pivot) if symmetric else np.abs(np.diag(pivot))
    if (own > 0.0).all():
        scale = np.sqrt(own)
        scaled = pivot / np.outer(scale, scale)
        if symmetric:
            values, vectors = np.linalg.eigh(scaled)
        else:
            _, values, rows = np.linalg.svd(scaled)
            values, vectors = values[::-1], rows[::-1].T
        if values[0] > _SMALLEST_PIVOT * values[-1]:
            return
        raise UnresistedMotionError(number, vectors[:, 0] / scale)
    raise UnresistedMotionError(number, (own <= 0.0).astype(np.float64))
