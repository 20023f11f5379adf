"""One iteration of structured blocks of higher degree with friction, in pairs of their nodes.

As in `fem.static.linear_step.condensed` unknown are the relative displacements of pairs of nodes.
What forces on these do to a block comes from its columns (`fem.static.linear_step.columns`), with
the nodes of its sides as points, and all its nodes follow.
"""

from __future__ import annotations

from collections.abc import Sequence

from fem.static.linear_step.condensation import FlexibilityStore, content_of
from fem.static.linear_step.dense_rows import DenseRows
from fem.static.linear_step.grid_block import GridBlock, GridBodies, NodeFlexibility, grids_of
from fem.static.linear_step.linearisation import Linearisation
from fem.system.system import Sector
from geometry.mesh import FloatArray


class GridPairStep(DenseRows):
    """A `LinearStep` in pairs of nodes; it keeps the displacements of all nodes."""

    def __init__(self, system: Sector, grids: Sequence[GridBlock], store: FlexibilityStore) -> None:
        super().__init__(system, friction=True)
        of_slots = grids_of(system, grids)
        contents = {id(body): content_of(body) for body in system.whole.bodies}
        kinds = self._kinds_of(
            [contents[id(system.body(slot))] for slot in range(system.n_slots)],
            store,
            lambda slot, nodes: NodeFlexibility(of_slots[slot], nodes),
        )
        self._kinds = kinds
        self._variables = [
            kind.degrees_of_freedom + 3 * start
            for kind, start in zip(kinds, system.node_start.tolist(), strict=False)
        ]
        self._bodies = GridBodies(system, kinds)

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
