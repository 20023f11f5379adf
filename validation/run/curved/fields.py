"""A state of curved blocks at the nodes of ``[mesh]``: what pictures and joints are made of.

Displacements and stresses are those of the curved elements at these places; contact pressures are
the law at points of the facets of ``[mesh]``, between whose corners displacements are bilinear.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fem.assembly.contact_state import ContactState, matched_pressures, matched_state
from fem.assembly.deformable import DeformableAssembly
from fem.assembly.peaks import joint_forces
from fem.static.lagrange_fields import GridFields
from geometry.assembly import Assembly
from geometry.measures import JointResultants
from geometry.mesh import FloatArray
from validation.build.deformable import build_deformable
from validation.run.curved.solve import CurvedRun, facet_lines
from validation.run.measures import Measure, drawing_scale


@dataclass(frozen=True)
class CurvedFields:
    """What a `DeformableRun` says of its nodes, of a run with curved elements."""

    run: CurvedRun

    @cached_property
    def deformable(self) -> DeformableAssembly:
        """All blocks with the mesh of ``[mesh]``."""
        return build_deformable(self.run.scene.changed({"fem.degree": 1}), self.run.name)

    @property
    def drawn(self) -> Assembly:
        """The same, for pictures."""
        return self.deformable.assembly

    @property
    def measures(self) -> dict[str, Measure]:
        """What the run answers."""
        return self.run.measures

    @cached_property
    def fields(self) -> GridFields:
        """At the nodes of the block of each layer."""
        return GridFields(self.run.state, facet_lines(self.run.scene))

    @property
    def meets(self) -> bool:
        """Blocks of a tube do."""
        return True

    @property
    def is_tube(self) -> bool:
        """It is one."""
        return True

    @property
    def title(self) -> str:
        """Scene, load, method and mesh, for pictures."""
        return self.run.title

    @property
    def drawing_scale(self) -> float:
        """Round factor that makes the displacement visible in a picture."""
        size = self.deformable.assembly.characteristic_length
        return drawing_scale(self.run.measures["max_displacement"].value, size)

    def positions(self, block: int) -> FloatArray:
        """Nodes of a block before the load acts, (n_nodes, 3) [mm]."""
        return self.deformable.assembly.nodes(block)

    def displacement(self, block: int) -> FloatArray:
        """Of the nodes of a free block, (n_nodes, 3) [mm]."""
        return self._displacements[int(self.deformable.copy_of[block])]

    def principal(self, block: int) -> FloatArray:
        """σ₁ ≥ σ₂ ≥ σ₃ at the nodes of a free block, (n_nodes, 3) [MPa]."""
        layer = int(self.deformable.assembly.layer[block]) - 1
        return self.fields.principal[layer]

    @cached_property
    def _displacements(self) -> FloatArray:
        """Of all copies of the one group of blocks in world axes, (n_copies, n_nodes, 3) [mm]."""
        blocks = self.deformable.deformable_blocks
        moved = np.empty((len(blocks), *self.fields.displacement.shape[1:]))
        copies = self.deformable.copy_of[blocks]
        layers = self.deformable.assembly.layer[blocks] - 1
        turns = self.deformable.model.groups[0].rotations[copies]
        moved[copies] = self.fields.displacement[layers] @ np.swapaxes(turns, 1, 2)
        return moved

    @cached_property
    def contact_state(self) -> ContactState:
        """Facets of ``[mesh]`` in contact."""
        moved = (self._displacements,)
        pressures, overclosures = matched_pressures(self.deformable, moved)
        return matched_state(self.deformable, moved, pressures, overclosures)

    @cached_property
    def joints(self) -> JointResultants:
        """Resultants of the contact forces between each two blocks."""
        return joint_forces(self.contact_state)
