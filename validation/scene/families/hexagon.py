"""Tubes of hexagon-based blocks, ``[block] type = "hexagon"``."""

from __future__ import annotations

from typing import Any, ClassVar

from geometry.families.hexagon_block import HexagonBlockDivisions, HexagonBlockParameters
from geometry.families.tube import hexagon_cell, hexagon_tube
from validation.scene.family import LayeredScene, family
from validation.scene.sections import fewer


class HexagonTubeScene(LayeredScene):
    """A tube of hexagon-based blocks."""

    frames_may_lock: ClassVar[bool] = True

    tube = hexagon_tube
    cell = hexagon_cell

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
