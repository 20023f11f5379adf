"""What pictures of deformable blocks need to know of a state."""

from __future__ import annotations

from typing import Protocol

from fem.assembly.contact_state import ContactState
from fem.assembly.deformable import DeformableAssembly
from geometry.assembly import Assembly
from geometry.measures import JointResultants
from geometry.mesh import FloatArray
from validation.run.measures import Measure


class DrawnState(Protocol):
    """Fields at the nodes of blocks; blocks are numbered as in the assembly."""

    @property
    def deformable(self) -> DeformableAssembly:
        """Blocks and their meshes."""

    @property
    def drawn(self) -> Assembly:
        """The same blocks of straight pieces between the nodes at which fields are given."""

    @property
    def measures(self) -> dict[str, Measure]:
        """What the run answers: largest values at any point, which nodes and facets may miss."""

    @property
    def meets(self) -> bool:
        """Whether blocks meet; else they are single bodies."""

    @property
    def is_tube(self) -> bool:
        """Whether the blocks stand round an axis, with inner and outer faces."""

    @property
    def title(self) -> str:
        """Scene, load, method and mesh."""

    @property
    def drawing_scale(self) -> float:
        """Round factor that makes the displacement visible."""

    @property
    def contact_state(self) -> ContactState:
        """Facets in contact."""

    @property
    def joints(self) -> JointResultants:
        """Resultants of the contact forces between each two blocks."""

    def positions(self, block: int) -> FloatArray:
        """Nodes of a block before the load acts, (n_nodes, 3) [mm]."""

    def displacement(self, block: int) -> FloatArray:
        """Of the nodes of a deformable block, (n_nodes, 3) [mm]."""

    def principal(self, block: int) -> FloatArray:
        """σ₁ ≥ σ₂ ≥ σ₃ at the nodes of a deformable block, (n_nodes, 3) [MPa]."""
