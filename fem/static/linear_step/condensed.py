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

import numpy as np
from scipy.sparse import csr_array

from fem.static.linear_step.condensation import (
    Flexibility,
    FlexibilityStore,
    condense,
    content_of,
    flexibility_of,
)
from fem.static.linear_step.dense_rows import DenseRows, Factored, OwnRows
from fem.static.linear_step.linearisation import Linearisation, RetainedNodes
from fem.system.system import NodalInverse, Sector, at_share
from geometry.mesh import FloatArray, IntArray


class CondensedStep(RetainedNodes, DenseRows):
    """Solves the linear problem in contact forces, with one flexibility per kind of block."""

    def __init__(
        self, system: Sector, store: FlexibilityStore | None = None, *, friction: bool = False
    ) -> None:
        DenseRows.__init__(self, system, friction=friction)
        store = FlexibilityStore() if store is None else store
        self._transform, free = system.held.transform(system.n_nodes)
        self._is_free = np.zeros(3 * system.n_nodes, dtype=np.bool_)
        self._is_free[free] = True
        self._kinds: list[Flexibility] = self._kinds_of(
            self._contents(), store, self._make_flexibility
        )
        RetainedNodes.__init__(self, system, [kind.condensed for kind in self._kinds])
        self._on_variables = [
            np.stack([self._to_variables(slot, of) for of in self._loads[:, dofs]])
            for slot, dofs in enumerate(self._dofs)
        ]
        self._variables = [
            dofs[kind.free] for dofs, kind in zip(self._dofs, self._kinds, strict=True)
        ]

    # -----------------------------------------------------------------------------------------
    # Once

    def _contents(self) -> list[bytes]:
        """Digest of each slot: its body, and how that is held."""
        system, contents, result = self._system, dict[int, bytes](), []
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
            result.append(key)
        return result

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

    def _free_forces(
        self, load_factor: float, value: FloatArray, turned: FloatArray
    ) -> list[FloatArray]:
        """Loads and forces of prescribed displacements on the free variables of every slot.

        ``turned`` are more loads on contact nodes, (n_nodes, 3) [N].
        """
        forces = []
        for slot in range(self._system.n_slots):
            kind = self._kinds[slot]
            given = value[self._dofs[slot]]
            force = at_share(self._on_variables[slot], load_factor)
            if self._pairs is not None:
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
            responses = [self._kinds[s].inverse @ f for s, f in enumerate(loads)]
            felt = self._felt(factored, responses, value)
            motions = [-self._kinds[s].rigid.T @ f for s, f in enumerate(loads)]
            if held.any():
                motions = [m - holding * self._motion(s, held) for s, m in enumerate(motions)]
            result = self._solved(factored, felt, motions, loaded=loaded)
            return self._displacements(factored.chain.of_slots, responses, *result, value)

        def inverse(force: FloatArray) -> FloatArray:
            on_retained = (self._to_variables(s, force.ravel()[self._dofs[s]]) for s in slots)
            loads = [of[self._kinds[s].free] for s, of in enumerate(on_retained)]
            return solved(loads, nothing, no_motion, loaded=False)

        value = self._system.held.variables(self._system.n_nodes, linear.time)
        nothing, no_motion = np.zeros_like(value), np.zeros_like(before)
        loads = self._free_forces(linear.load_factor, value, turned)
        return solved(loads, value, before if holding else no_motion, loaded=True), inverse

    def _on_variables_of(self, gradient: csr_array) -> csr_array:
        """Gradients by displacements as those by variables."""
        held = len(self._system.held.nodes)
        return csr_array(gradient @ self._transform) if held else gradient

    def _felt(
        self, factored: Factored, responses: list[FloatArray], value: FloatArray
    ) -> FloatArray:
        """What the rows feel of loads and of prescribed displacements, (n,) [mm]."""
        felt = np.zeros(len(factored.chain.rows.order))
        for row, response in zip(factored.chain.of_slots, responses, strict=True):
            felt[row.points] += row.gradient @ response
        if len(self._system.held.nodes):
            felt += factored.law.gradient @ (self._transform @ value)
        return felt

    def _motion(self, slot: int, displacement: FloatArray) -> FloatArray:
        """Rigid part α of a displacement of a slot."""
        kind = self._kinds[slot]
        vector = self._to_variables(slot, displacement.ravel()[self._dofs[slot]])
        return np.asarray(
            np.linalg.lstsq(kind.rigid, vector[kind.free], rcond=None)[0], dtype=np.float64
        )

    def _displacements(
        self,
        rows: list[OwnRows],
        responses: list[FloatArray],
        forces: FloatArray,
        motions: list[FloatArray],
        prescribed: FloatArray,
    ) -> FloatArray:
        """Displacements of the contact nodes from forces and motions."""
        variables = prescribed.copy()
        for slot, row in enumerate(rows):
            kind = self._kinds[slot]
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
            rigid = self._kinds[slot].rigid
            if len(rigid) == len(dofs):
                # A rigid motion costs no force; taking it out first keeps its rounding out too.
                flat[dofs] -= rigid @ np.linalg.lstsq(rigid, flat[dofs], rcond=None)[0]
        return super().internal_force(flat.reshape(-1, 3))
