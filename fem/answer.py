"""The answer of deformable blocks as arrays and meshes that a notebook goes on with."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from fem.assembly.contact_state import ContactMeasures, ContactState, contact_measures
from fem.assembly.deformable import DeformableAssembly
from fem.explicit.setup.statement import ExplicitStatement
from fem.explicit.solve import ExplicitResult
from fem.problem.recovery import Recovered, recover
from fem.static.result import StaticResult
from geometry.errors import RefusedError
from geometry.mesh import FloatArray, IntArray

if TYPE_CHECKING:
    import pyvista as pv


class AnswerError(RefusedError):
    """What an answer does not have."""


@dataclass(frozen=True)
class Answer:
    """A state of deformable blocks; world axes, mm, N, MPa.

    Nodes are those of all blocks that deform, block after block (`block_of_node`); blocks share no
    nodes. Contacts are the facets on which blocks meet.
    """

    deformable: DeformableAssembly
    """What was solved."""
    group_displacements: tuple[FloatArray, ...]
    """Of each group of congruent blocks, (n_copies, n_nodes_of_a_block, 3) [mm]."""
    contact_state: ContactState
    """Contact point by point."""
    finite_rotation: bool
    """Whether the rigid rotation of each block is no strain."""
    solver: StaticResult | ExplicitResult
    """What the solver says of itself: residual, energies, steps."""
    statement: ExplicitStatement | None = None
    """What an explicit run solved, with its times; None for a static state."""
    restarts: int = 0
    """How often an explicit run began again because contact outgrew its time step."""

    @property
    def static(self) -> StaticResult | None:
        """What a static solver says; None for an explicit run."""
        return self.solver if isinstance(self.solver, StaticResult) else None

    @property
    def explicit(self) -> ExplicitResult | None:
        """What an explicit run says; None for a static state."""
        return self.solver if isinstance(self.solver, ExplicitResult) else None

    @cached_property
    def displacements(self) -> FloatArray:
        """Of all nodes, (n_nodes, 3) [mm]."""
        return np.concatenate([u.reshape(-1, 3) for u in self.group_displacements])

    @cached_property
    def positions(self) -> FloatArray:
        """Of all nodes before the load acts, (n_nodes, 3) [mm]."""
        groups = self.deformable.model.groups
        return np.concatenate([g.reference_positions().reshape(-1, 3) for g in groups])

    @cached_property
    def block_of_node(self) -> IntArray:
        """Number of the block of each node, (n_nodes,)."""
        whole = self.deformable
        parts = []
        for number, group in enumerate(whole.model.groups):
            mine = whole.deformable_blocks[whole.group_of[whole.deformable_blocks] == number]
            mine = mine[np.argsort(whole.copy_of[mine])]
            parts.append(np.repeat(mine, group.n_nodes))
        return np.concatenate(parts)

    @cached_property
    def recovered(self) -> tuple[Recovered, ...]:
        """Stresses of each group of congruent blocks at its nodes and integration points."""
        return tuple(
            recover(group, moved, finite_rotation=self.finite_rotation)
            for group, moved in zip(
                self.deformable.model.groups, self.group_displacements, strict=True
            )
        )

    @cached_property
    def stresses(self) -> FloatArray:
        """At all nodes in the order xx, yy, zz, xy, yz, xz, (n_nodes, 6) [MPa]."""
        return np.concatenate([r.stress.reshape(-1, 6) for r in self.recovered])

    @cached_property
    def principal_stresses(self) -> FloatArray:
        """σ₁ ≥ σ₂ ≥ σ₃ at all nodes, tension positive, (n_nodes, 3) [MPa]."""
        return np.concatenate([r.principal.reshape(-1, 3) for r in self.recovered])

    @property
    def contact_pressures(self) -> FloatArray:
        """Mean over each contact facet, compression positive, (n_contacts,) [MPa]."""
        return self.contact_state.pressures

    @property
    def contact_areas(self) -> FloatArray:
        """Of the contact facets, (n_contacts,) [mm²]."""
        return self.contact_state.areas

    @property
    def contact_blocks(self) -> IntArray:
        """The two blocks of each contact facet, (n_contacts, 2)."""
        return np.column_stack([self.contact_state.block_m, self.contact_state.block_s])

    @cached_property
    def measures(self) -> ContactMeasures:
        """p_max, p_eff and the other measures of the paper.

        Raises
        ------
        AnswerError
            For single bodies.
        """
        if not self.deformable.meets:
            raise AnswerError(
                "measures: got single bodies, which have no contact; expected blocks that meet"
            )
        return contact_measures(self.deformable.assembly, self.contact_state)

    @property
    def residual(self) -> float | None:
        """Unbalanced over applied force [-]; None where an explicit run did not watch it."""
        return self.solver.residual

    def mesh(self) -> pv.UnstructuredGrid:
        """Blocks before the load acts, with displacement [mm] and stresses [MPa] at the nodes.

        ``answer.mesh().warp_by_vector("displacement [mm]", factor=1000)`` is the deformed shape.
        """
        import pyvista as pv

        elements, first = [], 0
        for group in self.deformable.model.groups:
            starts = first + group.n_nodes * np.arange(group.n_copies)
            elements.append((group.mesh.elements[None] + starts[:, None, None]).reshape(-1, 8))
            first += group.n_nodes * group.n_copies
        grid = pv.UnstructuredGrid(
            {pv.CellType.HEXAHEDRON: np.concatenate(elements)}, self.positions
        )
        grid.point_data["block"] = self.block_of_node
        grid.point_data["displacement [mm]"] = self.displacements
        grid.point_data["stress [MPa]"] = self.stresses
        grid.point_data["principal stresses [MPa]"] = self.principal_stresses
        return grid

    def contacts(self) -> pv.PolyData:
        """Contact facets where they are now, with pressure [MPa] and the blocks that meet."""
        import pyvista as pv

        corners = self.contact_state.corners
        faces = np.arange(corners.shape[0] * 4).reshape(-1, 4)
        surface = pv.PolyData.from_regular_faces(corners.reshape(-1, 3), faces)
        surface.cell_data["contact pressure [MPa]"] = self.contact_pressures
        surface.cell_data["blocks"] = self.contact_blocks
        return surface
