"""Tubes of hexagon-based blocks, ``[block] type = "hexagon"``."""

from __future__ import annotations

from typing import Any, ClassVar

from validation.scene.family import RoundScene, family
from validation.scene.sections import fewer


class HexagonTubeScene(RoundScene):
    """A tube of hexagon-based blocks."""

    frames_may_lock: ClassVar[bool] = True

    @property
    def divisions(self) -> list[int]:
        """Three rhombs, with as many elements on each edge."""
        return [3 * self.mesh.edge, self.mesh.edge, self.mesh.radial]

    def fewer_elements(self, share: float) -> dict[str, Any]:
        """Keep an even number along an edge."""
        return {
            "edge": fewer(self.mesh.edge, share, 2),
            "radial": fewer(self.mesh.radial, share),
        }


family(
    HexagonTubeScene,
    "hexagon",
    "geometry.families.tube:HexagonTube",
    assembly="layers",
    default={"edge": 28, "radial": 8},
)
