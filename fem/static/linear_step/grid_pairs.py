"""One iteration of structured blocks of higher degree with friction, in pairs of their nodes.

As in `fem.static.linear_step.condensed` unknown are the relative displacements of pairs of nodes.
What forces on these do to a block comes from its columns (`fem.static.linear_step.columns`), with
the nodes of its sides as points, and all its nodes follow.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from functools import partial

import numpy as np

from fem.static.linear_step.condensation import FlexibilityStore, content_of
from fem.static.linear_step.dense_rows import DenseRows
from fem.static.linear_step.grid_block import GridBlock, GridBodies, NodeFlexibility, grids_of
from fem.static.linear_step.linearisation import Linearisation
from fem.system.system import Sector
from geometry.mesh import FloatArray, IntArray


class GridPairStep(DenseRows):
    """A `LinearStep` in pairs of nodes; it keeps the displacements of all nodes."""

    def __init__(self, system: Sector, grids: Sequence[GridBlock], store: FlexibilityStore) -> None:
        super().__init__(system, friction=True)
        of_slots = grids_of(system, grids)
        slots: dict[int, list[int]] = {}
        for slot, grid in enumerate(of_slots):
            slots.setdefault(id(grid), []).append(slot)
        nodes = {key: self._touched(alike) for key, alike in slots.items()}
        self._check_memory(list(nodes.values()))
        keys = {
            key: content_of(system.body(slots[key][0])) + hashlib.sha256(touched.tobytes()).digest()
            for key, touched in nodes.items()
        }
        store.keep(set(keys.values()))
        kinds = [
            store.get(keys[id(grid)], partial(NodeFlexibility, grid, nodes[id(grid)]))
            for grid in of_slots
        ]
        self._kinds = kinds
        self._variables = [
            kind.degrees_of_freedom + 3 * start
            for kind, start in zip(kinds, system.node_start.tolist(), strict=False)
        ]
        self._bodies = GridBodies(system, kinds)

    def _touched(self, slots: list[int]) -> IntArray:
        """Nodes of some congruent blocks that are in contact in any of them, (n,)."""
        rows = self._system.points.rows
        own = [
            rows[(rows >= begin) & (rows < end)] - begin for begin, end in map(self._ends, slots)
        ]
        return np.unique(np.concatenate(own))

    def _ends(self, slot: int) -> tuple[int, int]:
        begin, end = self._system.node_start[slot : slot + 2].tolist()
        return begin, end

    def __call__(
        self, linear: Linearisation, before: FloatArray, holding: float = 0.0
    ) -> tuple[FloatArray, None]:
        """Displacements (n_nodes, 3) [mm].

        Raises
        ------
        UnheldBlocksError
            Blocks that nothing holds.
        """
        factored, turned = self._factor(linear, before, holding)
        bodies, gradient = self._bodies, factored.law.gradient
        load = self.load(linear.load_factor) + turned
        loaded = bodies.displacements(load)
        balance = -bodies.in_motions(load) - holding * bodies.motions_in(before)
        felt = gradient @ loaded.ravel()
        forces, motions = self._solved(factored, felt, list(balance), loaded=True)
        pushed = (gradient.T @ forces).reshape(-1, 3)
        return loaded - bodies.displacements(pushed) + bodies.of_motions(motions), None
