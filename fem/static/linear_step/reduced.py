"""The sparse linear problem on the nodes that contact or supports act on, blocks condensed there.

Which nodes these are is known from search to search; a node that comes new is retained from then
on, so blocks are condensed anew a few times only.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array

from fem.static.linear_step.condensation import CondensedBlock, FlexibilityStore
from fem.static.linear_step.linearisation import RetainedNodes, SparseSolver, SparseStep
from fem.system.body import Body
from fem.system.system import Sector
from geometry.mesh import FloatArray, IntArray


class ReducedStep(RetainedNodes, SparseStep):
    """Assembles condensed blocks into one sparse matrix."""

    def __init__(
        self, system: Sector, store: FlexibilityStore, solver: SparseSolver | None = None
    ) -> None:
        RetainedNodes.__init__(self, system, _condensed(system, store))
        SparseStep.__init__(self, system, solver)
        self._free = np.intersect1d(self._free, np.concatenate(self._dofs))

    def _assembled(self) -> tuple[csr_array, csr_array]:
        size = 3 * self._system.n_nodes
        rows = np.concatenate([np.repeat(dofs, len(dofs)) for dofs in self._dofs])
        columns = np.concatenate([np.tile(dofs, len(dofs)) for dofs in self._dofs])

        def joined(matrices: list[FloatArray]) -> csr_array:
            values = np.concatenate([matrix.ravel() for matrix in matrices])
            return csr_array(coo_array((values, (rows, columns)), (size, size)))

        springs = joined([block.springs for block in self._blocks])
        return joined([block.stiffness for block in self._blocks]), springs


def is_smaller(system: Sector) -> bool:
    """Whether blocks condensed on what is touched have fewer entries than those of all nodes."""
    entries = sum(
        slots * ((3.0 * len(nodes)) ** 2 - body.stiffness.nnz)
        for body, nodes, slots in _touched(system)
    )
    return entries < 0.0


def _touched(system: Sector) -> list[tuple[Body, IntArray, int]]:
    """Groups, nodes of points and supports of any of their blocks, and number of these."""
    touched = np.unique(np.append(system.points.rows, system.held.nodes))
    ends = np.searchsorted(touched, system.node_start)
    bodies = {id(body): body for body in map(system.body, range(system.n_slots))}
    nodes: dict[int, list[IntArray]] = {key: [] for key in bodies}
    for slot in range(system.n_slots):
        own = touched[ends[slot] : ends[slot + 1]] - system.node_start[slot]
        nodes[id(system.body(slot))].append(own)
    return [
        (body, np.unique(np.concatenate(nodes[key])).astype(np.int64), len(nodes[key]))
        for key, body in bodies.items()
    ]


def _condensed(system: Sector, store: FlexibilityStore) -> list[CondensedBlock]:
    """Blocks of all slots on the nodes of points and supports of any congruent one."""
    done = {id(body): store.condensed(body, nodes) for body, nodes, _ in _touched(system)}
    return [done[id(system.body(slot))] for slot in range(system.n_slots)]
