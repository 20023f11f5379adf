"""The sparse linear problem on the nodes that contact or supports act on, blocks condensed there.

Which nodes these are is known from search to search; a node that comes new is retained from then
on, so blocks are condensed anew a few times only.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array

from fem.static.linear_step.condensation import CondensedBlock
from fem.static.linear_step.flexibility import FlexibilityStore
from fem.static.linear_step.linearisation import SparseSolver, SparseStep
from fem.system.body import Body
from fem.system.system import System, at_share
from geometry.machine.work import Operation, count
from geometry.mesh import FloatArray, IntArray


class ReducedStep(SparseStep):
    """Assembles condensed blocks into one sparse matrix."""

    def __init__(
        self, system: System, store: FlexibilityStore, solver: SparseSolver | None = None
    ) -> None:
        self._blocks = _condensed(system, store)
        starts = 3 * system.node_start
        self._dofs = [
            block.degrees_of_freedom + start
            for block, start in zip(self._blocks, starts, strict=False)
        ]
        super().__init__(system, solver)
        self._retained = np.concatenate(self._dofs)
        self._free = np.intersect1d(self._free, self._retained)
        self._loads = np.zeros((len(system.loads), 3 * system.n_nodes))
        self._inner = []
        for slot, (block, dofs) in enumerate(zip(self._blocks, self._dofs, strict=True)):
            loads, inner = block.condense_forces(system.loads[:, system.nodes_of(slot)])
            self._loads[:, dofs] = loads
            self._inner.append(inner.T)

    def _assembled(self) -> tuple[csr_array, csr_array]:
        size = 3 * self._system.n_nodes
        rows = np.concatenate([np.repeat(dofs, len(dofs)) for dofs in self._dofs])
        columns = np.concatenate([np.tile(dofs, len(dofs)) for dofs in self._dofs])

        def joined(matrices: list[FloatArray]) -> csr_array:
            values = np.concatenate([matrix.ravel() for matrix in matrices])
            return csr_array(coo_array((values, (rows, columns)), (size, size)))

        springs = joined([block.springs for block in self._blocks])
        return joined([block.stiffness for block in self._blocks]), springs

    def internal_force(self, displacement: FloatArray) -> FloatArray:
        """S u of the retained nodes, zero at inner nodes; (n_nodes, 3) [N]."""
        result, moved = np.zeros(displacement.size), displacement.ravel()
        for block, dofs in zip(self._blocks, self._dofs, strict=True):
            result[dofs] = block.stiffness @ moved[dofs]
            count(Operation.ENTRY, block.stiffness.size)
        return result.reshape(-1, 3)

    def load(self, share: float) -> FloatArray:
        """Loads condensed on the retained nodes, zero at inner nodes; (n_nodes, 3) [N]."""
        return at_share(self._loads, share).reshape(-1, 3)

    def kept(self, displacement: FloatArray) -> FloatArray:
        """Displacements, zero at inner nodes, (n_nodes, 3) [mm]."""
        result = np.zeros_like(displacement)
        result.ravel()[self._retained] = displacement.ravel()[self._retained]
        return result

    def complete(self, displacement: FloatArray, share: float) -> FloatArray:
        """Displacements of all nodes from those of the retained ones, (n_nodes, 3) [mm]."""
        parts = [
            block.recover(displacement.ravel()[dofs][None], at_share(inner, share)[:, None])[0]
            for block, dofs, inner in zip(self._blocks, self._dofs, self._inner, strict=True)
        ]
        return np.concatenate(parts)


def is_smaller(system: System) -> bool:
    """Whether blocks condensed on what is touched have fewer entries than those of all nodes."""
    entries = sum(
        slots * ((3.0 * len(nodes)) ** 2 - group.stiffness.nnz)
        for group, nodes, slots in _touched(system)
    )
    return entries < 0.0


def _touched(system: System) -> list[tuple[Body, IntArray, int]]:
    """Groups, nodes of points and supports of any of their blocks, and number of these."""
    touched = np.unique(np.append(system.points.rows, system.held.nodes))
    ends = np.searchsorted(touched, system.node_start)
    groups = {id(group): group for group in map(system.body, range(system.n_slots))}
    nodes: dict[int, list[IntArray]] = {key: [] for key in groups}
    for slot in range(system.n_slots):
        own = touched[ends[slot] : ends[slot + 1]] - system.node_start[slot]
        nodes[id(system.body(slot))].append(own)
    return [
        (group, np.unique(np.concatenate(nodes[key])).astype(np.int64), len(nodes[key]))
        for key, group in groups.items()
    ]


def _condensed(system: System, store: FlexibilityStore) -> list[CondensedBlock]:
    """Blocks of all slots on the nodes of points and supports of any congruent one."""
    done = {id(group): store.condensed(group, nodes) for group, nodes, _ in _touched(system)}
    return [done[id(system.body(slot))] for slot in range(system.n_slots)]
