"""One iteration of the static problem in the unknown contact forces.

Congruent blocks share one condensed stiffness, hence one dense flexibility G on their contact
nodes. A block follows from the forces on it up to a rigid motion,

    u = G (f - Nᵀ q) + R α,    Rᵀ (f - Nᵀ q) = τ (α - α_before),

with q the forces of the contact points and N the gradients of their overclosures. The tangent of
the law, q / w = p + k (N u + c - x̂), turns into

    [N G Nᵀ + 1/(w k)   -N R] [q]   [c - x̂ + p/k + N G f]
    [     -(N R)ᵀ          -τ] [α] = [-Rᵀ f - τ α_before  ]

whose unknowns are only the points that press, and six motions of each block. Points between the
same two layers come together, and layers follow each other: a block-tridiagonal system of dense
blocks (`fem.static.linear_step.block_tridiagonal`). τ holds blocks that too few points press on to
where they were; at convergence it does nothing. With friction q are the forces on pairs of nodes,
and unknown are the displacements between these (`fem.static.linear_step.pairs`).
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np
import numpy.typing as npt
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
from fem.static.linear_step.condensation import (
    Flexibility,
    FlexibilityStore,
    UnheldBlocksError,
    condense,
    content_of,
    flexibility_of,
)
from fem.static.linear_step.linearisation import Linearisation, RetainedNodes
from fem.static.linear_step.pairs import NodePairs
from fem.static.linear_step.row_laws import Bound, PairLaw, PointLaw, point_law
from fem.system.system import NodalInverse, Sector, at_share
from geometry.machine.work import Operation, count, hold_memory, require_memory
from geometry.mesh import FloatArray, IntArray

#: Points count as open when their stiffness is below this share of that at first touch: their
#: pressure is far below rounding of any other, while their flexibility would drown the rest.
_LEAST_STIFFNESS = 1e-12

#: A large prime: sums of a few multiples of it seldom agree.
_MIXED = 2_654_435_761
#: Matrices of the rows of each level, and of the nodes of each kind of block, that are in
#: memory at once; and of the kind that is made. Measured: 4.4 with friction, 2 and 4.
_FORCE_COPIES, _KEPT_COPIES, _NODE_COPIES = 4.5, 2.0, 4.0


class CondensedStep(RetainedNodes):
    """Solves the linear problem in contact forces, with one flexibility per kind of block."""

    def __init__(
        self, system: Sector, store: FlexibilityStore | None = None, *, friction: bool = False
    ) -> None:
        self._system = system
        self._chain = Chain(system)
        self._pairs = NodePairs(system) if friction else None
        self._store = FlexibilityStore() if store is None else store
        self._transform, free = system.held.transform(system.n_nodes)
        self._is_free = np.zeros(3 * system.n_nodes, dtype=np.bool_)
        self._is_free[free] = True
        self._kind_of, self._kinds = self._make_kinds()
        super().__init__(system, [self._kinds[k].condensed for k in self._kind_of])
        self._span = self._chain.spans([self._kinds[k].rigid.shape[1] for k in self._kind_of])
        self._on_variables = [
            np.stack([self._to_variables(slot, of) for of in self._loads[:, dofs]])
            for slot, dofs in enumerate(self._dofs)
        ]
        self._number_variables()
        self._last: _Assembled | None = None

    # -----------------------------------------------------------------------------------------
    # Once

    def _make_kinds(self) -> tuple[list[int], list[Flexibility]]:
        """One flexibility for each body and way of being held."""
        system = self._system
        contents: dict[int, bytes] = {}
        slots: dict[bytes, list[int]] = {}
        for slot in range(system.n_slots):
            body = system.body(slot)
            mine = self._held_rows(slot)
            key = contents.setdefault(id(body), content_of(body))
            for array in (
                system.held.nodes[mine] - system.node_start[slot],
                system.held.axes[mine],
                system.held.held[mine],
            ):
                key += hashlib.sha256(np.ascontiguousarray(array).tobytes()).digest()
            slots.setdefault(key, []).append(slot)
        nodes = [self._nodes_of_kind(alike) for alike in slots.values()]
        keys = [
            key + hashlib.sha256(retained.tobytes()).digest()
            for key, retained in zip(slots, nodes, strict=True)
        ]
        self._check_memory(nodes)
        self._store.keep(set(keys))
        kinds = [
            self._store.get(key, partial(self._make_flexibility, alike[0], retained))
            for key, alike, retained in zip(keys, slots.values(), nodes, strict=True)
        ]
        kind_of = {slot: k for k, alike in enumerate(slots.values()) for slot in alike}
        return [kind_of[slot] for slot in range(system.n_slots)], kinds

    def _check_memory(self, nodes: list[IntArray]) -> None:
        """Reject a problem whose dense matrices are beyond the memory, before any is made."""
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

    def _held_rows(self, slot: int) -> npt.NDArray[np.bool_]:
        """Which held nodes are of a slot, (n_held,)."""
        nodes, start = self._system.held.nodes, self._system.node_start
        return (nodes >= start[slot]) & (nodes < start[slot + 1])

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

    def _make_flexibility(self, slot: int, retained: IntArray) -> Flexibility:
        condensed = condense(self._system.body(slot), retained)
        rows = condensed.degrees_of_freedom + 3 * int(self._system.node_start[slot])
        held = self._held_rows(slot).any()
        axes = csr_array(self._transform[rows][:, rows]) if held else None
        return flexibility_of(self._system.body(slot), condensed, axes, self._is_free[rows])

    def _to_variables(self, slot: int, vector: FloatArray) -> FloatArray:
        """Tᵀ on the retained variables of a slot."""
        if not len(self._system.held.nodes):
            return vector
        dofs = self._dofs[slot]
        return self._transform[dofs][:, dofs].T @ vector

    def _number_variables(self) -> None:
        """Number the free retained variables of all slots one after the other."""
        sizes = [len(self._kinds[k].free) for k in self._kind_of]
        self._start = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
        columns = [
            self._dofs[slot][self._kinds[self._kind_of[slot]].free]
            for slot in range(self._system.n_slots)
        ]
        self._columns = np.concatenate(columns)

    def _free_forces(
        self, load_factor: float, value: FloatArray, turned: FloatArray | None
    ) -> list[FloatArray]:
        """Loads and forces of prescribed displacements on the free variables of every slot.

        ``turned`` are more loads on contact nodes, (n_nodes, 3) [N].
        """
        forces = []
        for slot in range(self._system.n_slots):
            kind = self._kind(slot)
            given = value[self._dofs[slot]]
            force = at_share(self._on_variables[slot], load_factor)
            if turned is not None:
                on_retained = turned.ravel()[self._dofs[slot]]
                force = force + self._to_variables(slot, on_retained)
            if given.any():
                force = force - kind.stiffness @ given
            forces.append(force[kind.free])
        return forces

    # -----------------------------------------------------------------------------------------
    # Every iteration

    def __call__(
        self, linear: Linearisation, before: FloatArray, holding: float = 0.0
    ) -> tuple[FloatArray, NodalInverse]:
        """Displacements of the contact nodes, zero at the others, (n_nodes, 3) [mm]; the inverse.

        Raises
        ------
        UnheldBlocksError
            Blocks on which too few points press, when nothing else holds them.
        """
        factored, turned = self._factor(linear, before, holding)
        slots = range(self._system.n_slots)

        def solved(
            loads: list[FloatArray], value: FloatArray, held: FloatArray, *, loaded: bool
        ) -> FloatArray:
            responses = [self._kind(s).inverse @ f for s, f in enumerate(loads)]
            felt = self._felt(factored, responses, value)
            motions = [-self._kind(s).rigid.T @ f for s, f in enumerate(loads)]
            if held.any():
                motions = [m - holding * self._motion(s, held) for s, m in enumerate(motions)]
            result = self._solved(factored, felt, motions, loaded=loaded)
            return self._displacements(factored.chain.of_slots, responses, *result, value)

        def inverse(force: FloatArray) -> FloatArray:
            on_retained = (self._to_variables(s, force.ravel()[self._dofs[s]]) for s in slots)
            loads = [of[self._kind(s).free] for s, of in enumerate(on_retained)]
            return solved(loads, nothing, no_motion, loaded=False)

        value = self._system.held.variables(self._system.n_nodes, linear.time)
        nothing, no_motion = np.zeros_like(value), np.zeros_like(before)
        loads = self._free_forces(linear.load_factor, value, turned)
        return solved(loads, value, before if holding else no_motion, loaded=True), inverse

    def _factor(
        self, linear: Linearisation, before: FloatArray, holding: float
    ) -> tuple[_Factored, FloatArray | None]:
        """Assemble and eliminate the chain of all levels; loads that normals turn, if any do."""
        least, turned = _LEAST_STIFFNESS * self._system.law.normal.touching_stiffness, None
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
        return _Factored(chain, law, bound, factor), turned

    def _assembled(self, law: PointLaw | PairLaw, facet: IntArray) -> _Assembled:
        """Flexibilities and motions of the rows of a law, which belong to some facets."""
        rows = self._chain.rows(facet)
        of_slots = self._rows(csr_array(law.gradient[rows.order]))
        levels = self._chain.zeros(rows, self._span)
        for slot, own in enumerate(of_slots):
            kind, k = self._kind(slot), int(self._chain.level_of[slot])
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

    def _rows(self, gradient: csr_array) -> list[_Rows]:
        """Rows of each slot on its free variables, of gradients (n, 3 n_nodes)."""
        if len(self._system.held.nodes):
            gradient = csr_array(gradient @ self._transform)
        columns = csc_array(gradient)[:, self._columns]
        result = []
        for a, b in pairwise(self._start):
            own = csr_array(columns[:, a:b])
            mine = np.flatnonzero(np.diff(own.indptr))
            result.append(_Rows(mine, own[mine]))
        return result

    def _kind(self, slot: int) -> Flexibility:
        return self._kinds[self._kind_of[slot]]

    def _felt(
        self, factored: _Factored, responses: list[FloatArray], value: FloatArray
    ) -> FloatArray:
        """What the rows feel of loads and of prescribed displacements, (n,) [mm]."""
        felt = np.zeros(len(factored.chain.rows.order))
        for row, response in zip(factored.chain.of_slots, responses, strict=True):
            felt[row.points] += row.gradient @ response
        if len(self._system.held.nodes):
            felt += factored.law.gradient @ (self._transform @ value)
        return felt

    def _solved(
        self, factored: _Factored, felt: FloatArray, motions: list[FloatArray], *, loaded: bool
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

    def _motion(self, slot: int, displacement: FloatArray) -> FloatArray:
        """Rigid part α of a displacement of a slot."""
        kind = self._kind(slot)
        vector = self._to_variables(slot, displacement.ravel()[self._dofs[slot]])
        return np.asarray(
            np.linalg.lstsq(kind.rigid, vector[kind.free], rcond=None)[0], dtype=np.float64
        )

    def _displacements(
        self,
        rows: list[_Rows],
        responses: list[FloatArray],
        forces: FloatArray,
        motions: list[FloatArray],
        prescribed: FloatArray,
    ) -> FloatArray:
        """Displacements of the contact nodes from forces and motions."""
        variables = prescribed.copy()
        for slot, row in enumerate(rows):
            kind = self._kind(slot)
            pushed = responses[slot] - kind.inverse @ (row.gradient.T @ forces[row.points])
            moved = pushed + kind.rigid @ motions[slot]
            variables[self._dofs[slot][kind.free]] = moved
        if len(self._system.held.nodes):
            variables = self._transform @ variables
        return variables.reshape(-1, 3)

    def internal_force(self, displacement: FloatArray) -> FloatArray:
        """S u of the contact nodes, zero at inner nodes; (n_nodes, 3) [N]."""
        flat = displacement.ravel().copy()
        for slot, dofs in enumerate(self._dofs):
            rigid = self._kind(slot).rigid
            if len(rigid) == len(dofs):
                # A rigid motion costs no force; taking it out first keeps its rounding out too.
                flat[dofs] -= rigid @ np.linalg.lstsq(rigid, flat[dofs], rcond=None)[0]
        return super().internal_force(flat.reshape(-1, 3))


@dataclass(frozen=True)
class _Rows:
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
    of_slots: list[_Rows]
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
class _Factored:
    """The chain of one linear problem, eliminated."""

    chain: _Assembled
    law: PointLaw | PairLaw
    bound: Bound
    factor: ChainFactor
