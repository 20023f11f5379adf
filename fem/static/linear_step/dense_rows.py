"""Rows of contact on blocks with dense flexibilities, level by level a chain.

What `fem.static.linear_step.condensed` (blocks on their contact nodes, whatever their elements) and
`fem.static.linear_step.grid_pairs` (structured blocks of higher degree) have in common.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise
from typing import Protocol, TypeVar

import numpy as np
from scipy.sparse import csc_array, csr_array

from fem.contact.search import SearchedPoints
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
from fem.static.linear_step.condensation import FlexibilityStore, UnheldBlocksError
from fem.static.linear_step.linearisation import Linearisation, LinearStep
from fem.static.linear_step.pairs import NodePairs
from fem.static.linear_step.row_laws import Bound, PairLaw, PointLaw, point_law
from fem.system.system import Sector
from geometry.machine.work import Operation, count, hold_memory, require_memory
from geometry.mesh import BoolArray, FloatArray, IntArray

#: Points count as open when their stiffness is below this share of that at first touch: their
#: pressure is far below rounding of any other, while their flexibility would drown the rest.
_LEAST_STIFFNESS = 1e-12

#: A large prime: sums of a few multiples of it seldom agree.
_MIXED = 2_654_435_761
#: Matrices of the rows of each level, and of the nodes of each kind of block, that are in
#: memory at once; and of the kind that is made. Measured: 4.4 with friction, 2 and 4.
_FORCE_COPIES, _KEPT_COPIES, _NODE_COPIES = 4.5, 2.0, 4.0


class Flexible(Protocol):
    """A kind of block on its variables."""

    @property
    def inverse(self) -> FloatArray:
        """Displacements by unit forces in balance, (n, n) [mm/N]."""

    @property
    def rigid(self) -> FloatArray:
        """Rigid motions, (n, 0 … 6)."""


Kind = TypeVar("Kind", bound=Flexible)


class DenseRows(LinearStep):
    """A step in rows of contact; what a block does to them is dense."""

    _kinds: Sequence[Flexible]
    """Of each slot, given before any step."""
    _variables: Sequence[IntArray]
    """Degrees of freedom of the system that are those of each slot."""

    def __init__(self, system: Sector, *, friction: bool) -> None:
        super().__init__(system)
        self._chain = Chain(system)
        self._pairs = NodePairs(system) if friction else None
        self._last: _Assembled | None = None

    def _kinds_of(
        self,
        contents: Sequence[bytes],
        store: FlexibilityStore,
        make: Callable[[int, IntArray], Kind],
    ) -> list[Kind]:
        """Of each slot; those of one content share one on the nodes that any of them needs.

        ``make`` makes it of the first of them, on these nodes.
        """
        slots: dict[bytes, list[int]] = {}
        for slot, content in enumerate(contents):
            slots.setdefault(content, []).append(slot)
        nodes = {content: self._nodes_of_kind(alike) for content, alike in slots.items()}
        self._check_memory(list(nodes.values()))
        keys = {
            content: content + hashlib.sha256(needed.tobytes()).digest()
            for content, needed in nodes.items()
        }
        store.keep(set(keys.values()))
        kinds = {
            content: store.get(keys[content], partial(make, alike[0], nodes[content]))
            for content, alike in slots.items()
        }
        return [kinds[content] for content in contents]

    def _nodes_of_kind(self, slots: list[int]) -> IntArray:
        """Nodes of congruent blocks that contact may act on, and held ones, sorted.

        Facets that match press on each other alone; where they are searched, on any that may come.
        """
        system = self._system
        if isinstance(system.points, SearchedPoints):
            shape = system.whole.assembly.shape(int(system.blocks[slots[0]]))
            met = [system.body(slots[0]).mesh.facet_nodes(shape.contact_quads).ravel()]
        else:
            touched = np.unique(system.points.rows)
            ends = np.searchsorted(touched, system.node_start)
            met = [touched[ends[k] : ends[k + 1]] - system.node_start[k] for k in slots]
        first = slots[0]
        held = system.held.nodes[self._held_rows(first)] - system.node_start[first]
        return np.unique(np.concatenate([*met, held])).astype(np.int64)

    def _held_rows(self, slot: int) -> BoolArray:
        """Which held nodes are of a slot, (n_held,)."""
        nodes, start = self._system.held.nodes, self._system.node_start
        return (nodes >= start[slot]) & (nodes < start[slot + 1])

    def _check_memory(self, nodes: Sequence[IntArray]) -> None:
        """Reject a problem whose dense matrices are beyond the memory, before any is made.

        ``nodes`` are those in contact of each kind of block.
        """
        surfaces = self._system.points
        low = self._chain.low
        points = np.bincount(low) * surfaces.weights.shape[1]
        rows = points if self._pairs is None else 3 * np.bincount(low[self._pairs.facet])
        forces = _FORCE_COPIES * (rows.astype(np.float64) ** 2).sum()
        of_nodes = [9.0 * len(of_kind) ** 2 for of_kind in nodes]
        kept = _KEPT_COPIES * sum(of_nodes) + _NODE_COPIES * max(of_nodes, default=0.0)
        most = max(map(len, nodes), default=0)
        require_memory(
            f"{points.sum()} contact points, and blocks with up to {most} nodes there,",
            8.0 * (forces + kept),
            "a coarser mesh (mesh), elements of degree 1 or fewer blocks",
        )
        hold_memory(8.0 * (forces + kept))

    @cached_property
    def _span(self) -> list[slice]:
        """Columns of the motions of each slot among those of its level."""
        return self._chain.spans([kind.rigid.shape[1] for kind in self._kinds])

    def _on_variables_of(self, gradient: csr_array) -> csr_array:
        """Gradients by displacements as those by variables."""
        return gradient

    def _factor(
        self, linear: Linearisation, before: FloatArray, holding: float
    ) -> tuple[Factored, FloatArray]:
        """Assemble and eliminate the chain of all levels; loads that normals turn, (n_nodes, 3)."""
        least = _LEAST_STIFFNESS * self._system.law.normal.touching_stiffness
        turned = np.zeros_like(before)
        law: PointLaw | PairLaw
        if self._pairs is None:
            law = point_law(self._system.points, linear, least)
            chain = self._assembled(law, law.active // linear.weights.shape[1])
        else:
            # Rows of pairs do not turn: the same pairs have the same flexibilities.
            law, turned = self._pairs.law(linear, before, least)
            if self._last is None or not np.array_equal(self._last.active, law.active):
                self._last = self._assembled(law, self._pairs.facet[law.active // 3])
            chain = self._last
        law = law.ordered(chain.rows.order)
        bound = law.bind(chain.held(holding))
        try:
            factor = factor_chain(bound.levels)
        except UnresistedMotionError as error:
            slots = self._chain.members[error.level]
            blocks = self._system.blocks[slots].tolist()
            raise UnheldBlocksError("too few contacts press", tuple(blocks)) from None
        except np.linalg.LinAlgError:
            # Stiffness beyond all bounds leaves the points of a facet no compliance of their own.
            raise UnheldBlocksError("contact presses beyond all bounds", ()) from None
        return Factored(chain, law, bound, factor), turned

    def _assembled(self, law: PointLaw | PairLaw, facet: IntArray) -> _Assembled:
        """Flexibilities and motions of the rows of a law, which belong to some facets."""
        rows = self._chain.rows(facet)
        of_slots = self._rows(self._on_variables_of(csr_array(law.gradient[rows.order])))
        levels = self._chain.zeros(rows, self._span)
        for slot, own in enumerate(of_slots):
            kind, k = self._kinds[slot], int(self._chain.level_of[slot])
            flexible, felt = own.flexibility(kind.inverse), own.gradient @ kind.rigid
            # Rows shared with the level below come first.
            n = int(np.searchsorted(own.points, rows.start[k]))
            halves = [(k - 1, slice(None, n)), (k, slice(n, None))] if n else [(k, slice(None))]
            parts = [
                LevelPoints(level, own.points[half] - rows.start[level], felt[half], half)
                for level, half in halves
            ]
            add_block(levels, (k, self._span[slot]), parts, partial(_between, flexible))
        return _Assembled(law.active, rows, of_slots, levels)

    def _rows(self, gradient: csr_array) -> list[OwnRows]:
        """Rows of each slot on its free variables, of gradients (n, 3 n_nodes)."""
        columns = csc_array(gradient)[:, np.concatenate(self._variables)]
        result = []
        for a, b in pairwise(np.cumsum([0, *map(len, self._variables)])):
            own = csr_array(columns[:, a:b])
            mine = np.flatnonzero(np.diff(own.indptr))
            result.append(OwnRows(mine, own[mine]))
        return result

    def _solved(
        self, factored: Factored, felt: FloatArray, motions: list[FloatArray], *, loaded: bool
    ) -> tuple[FloatArray, list[FloatArray]]:
        """Forces of all rows, and motions of each slot.

        ``loaded`` says whether the law presses where nothing moves.
        """
        forces = np.split(
            felt + factored.bound.rest if loaded else felt, factored.chain.rows.start[1:-1]
        )
        sides = self._chain.sides(forces, motions)
        if loaded:
            pairs = zip(sides, factored.bound.motions, strict=True)
            sides = [(force, motion + more) for (force, motion), more in pairs]
        solved = factored.factor.solve(sides)
        level_of = self._chain.level_of.tolist()
        alpha = [solved[k][1][span] for k, span in zip(level_of, self._span, strict=True)]
        return factored.law.forces(np.concatenate([q for q, _ in solved]), loaded=loaded), alpha


@dataclass(frozen=True)
class OwnRows:
    """Active points of a slot on its free variables."""

    points: IntArray
    """Numbers among the active points, (n,)."""
    gradient: csr_array
    """∂x/∂u, (n, n_free)."""

    def flexibility(self, inverse: FloatArray) -> FloatArray:
        """Answer of each row to a unit force of each, (n, n)."""
        n, facets = len(self.points), list(_facets(self.gradient))
        half, flexible = np.zeros((n, len(inverse))), np.zeros((n, n))
        for rows, columns, values in facets:
            half[rows] = values @ inverse[columns]
        half = np.ascontiguousarray(half.T)
        for rows, columns, values in facets:
            flexible[rows] = values @ half[columns]
        used = len(np.unique(self.gradient.indices))
        count(Operation.ENTRY, self.gradient.nnz * (used + n))
        return flexible


def _facets(gradient: csr_array) -> Iterator[tuple[IntArray, IntArray, FloatArray]]:
    """Rows with the same columns, those of one facet: rows (k,), columns (m,), values (k, m).

    Products of facets are dense, three times as fast as those of the sparse matrix.
    """
    n_entries = np.diff(gradient.indptr)
    for m in np.unique(n_entries[n_entries > 0]).tolist():
        rows = np.flatnonzero(n_entries == m)
        at = gradient.indptr[rows][:, None] + np.arange(m)
        columns = gradient.indices[at]
        # Alike rows get one number, and so come together; others that share it are told apart.
        order = np.argsort(columns @ (_MIXED * np.arange(1, m + 1)), kind="stable")
        change = (columns[order[1:]] != columns[order[:-1]]).any(axis=1)
        for facet in np.split(order, np.flatnonzero(change) + 1):
            yield rows[facet], columns[facet[0]], gradient.data[at[facet]]


def _between(flexible: FloatArray, one: slice, other: slice) -> FloatArray:
    return flexible[one, other]


@dataclass(frozen=True)
class _Assembled:
    """The levels of some rows, without the law of these."""

    active: IntArray
    """Numbers of the rows, (n,)."""
    rows: Rows
    of_slots: list[OwnRows]
    levels: list[Level]
    """Without holding springs."""

    def held(self, holding: float) -> list[Level]:
        """Levels with holding springs [N/mm], to bind a law to; laws of pairs keep the others."""
        return [
            replace(
                level, motions=level.motions.copy(), holding=holding * np.eye(len(level.holding))
            )
            for level in self.levels
        ]


@dataclass(frozen=True)
class Factored:
    """The chain of one linear problem, eliminated."""

    chain: _Assembled
    law: PointLaw | PairLaw
    bound: Bound
    factor: ChainFactor
