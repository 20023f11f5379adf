"""Tubes of hexagon-based blocks, ``[block] type = "hexagon"``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

from geometry.families.hexagon_block import HexagonBlockDivisions, HexagonBlockParameters
from validation.scene.family import RoundScene, family
from validation.scene.sections import fewer

if TYPE_CHECKING:
    from geometry.assembly import Assembly


class HexagonTubeScene(RoundScene):
    """A tube of hexagon-based blocks."""

    frames_may_lock: ClassVar[bool] = True

    @property
    def divisions(self) -> HexagonBlockDivisions:
        """Elements of the free block."""
        return HexagonBlockDivisions(**self.mesh.model_dump())

    def build(self) -> Assembly:
        """Build the tube."""
        from geometry.families.tube import hexagon_tube

        return hexagon_tube(self.stated, self.divisions, self.assembly.layers)

    def build_cell(self) -> Assembly:
        """Build two layers and their images."""
        from geometry.families.tube import hexagon_cell

        return hexagon_cell(self.stated, self.divisions)

    def coarse_mesh(self, wave: int, through: int, other: int) -> dict[str, Any]:  # noqa: ARG002
        """Limit the elements along an edge and through the wall."""
        return {"edge": min(self.mesh.edge, wave), "radial": min(self.mesh.radial, through)}

    def fewer_elements(self, share: float) -> dict[str, Any]:
        """Keep an even number along an edge."""
        return {
            "edge": fewer(self.mesh.edge, share, 2),
            "radial": fewer(self.mesh.radial, share),
        }


family(
    HexagonTubeScene,
    "hexagon",
    HexagonBlockParameters,
    mesh=HexagonBlockDivisions,
    default={"edge": 28, "radial": 8},
)
