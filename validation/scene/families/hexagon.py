"""Tubes of hexagon-based blocks, ``[block] type = "hexagon"``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field

from validation.scene.family import BlockSection, RoundScene
from validation.scene.sections import Positive, Section, TubeAssemblySection, TubeLoadSection, fewer

if TYPE_CHECKING:
    from geometry.assembly import Assembly
    from geometry.families.hexagon_block import HexagonBlockDivisions, HexagonBlockParameters


class HexagonBlockSection(BlockSection):
    """``[block] type = "hexagon"``: THB(n, r_i, t)."""

    type: Literal["hexagon"]
    blocks_per_layer: Annotated[int, Field(ge=2)]
    """n"""
    inner_radius: Positive
    """r_i [mm]"""
    thickness: Positive
    """t [mm]"""


class HexagonMeshSection(Section):
    """``[mesh]`` of a hexagon-based block."""

    edge: Annotated[int, Field(ge=2)]
    """Elements along each edge of the hexagon; even."""
    radial: Annotated[int, Field(ge=1)]

    @property
    def words(self) -> str:
        """Facets of a block in each direction."""
        return f"{self.edge} facets along an edge of a block, {self.radial} radial"


class HexagonTubeScene(RoundScene):
    """A tube of hexagon-based blocks."""

    frames_may_lock: ClassVar[bool] = True

    block: HexagonBlockSection
    assembly: TubeAssemblySection
    mesh: HexagonMeshSection = HexagonMeshSection(edge=28, radial=8)
    load: TubeLoadSection

    @property
    def _stated(self) -> tuple[HexagonBlockParameters, HexagonBlockDivisions]:
        from geometry.families.hexagon_block import HexagonBlockDivisions, HexagonBlockParameters

        shape = HexagonBlockParameters(**self.block.model_dump(exclude={"type"}))
        return shape, HexagonBlockDivisions(**self.mesh.model_dump())

    def build(self) -> Assembly:
        """Build the tube."""
        from geometry.families.tube import hexagon_tube

        return hexagon_tube(*self._stated, self.assembly.layers)

    def build_cell(self) -> Assembly:
        """Build two layers and their images."""
        from geometry.families.tube import hexagon_cell

        return hexagon_cell(*self._stated)

    def coarse_mesh(self, wave: int, through: int, other: int) -> dict[str, Any]:  # noqa: ARG002
        """Limit the elements along an edge and through the wall."""
        return {"edge": min(self.mesh.edge, wave), "radial": min(self.mesh.radial, through)}

    def fewer_elements(self, share: float) -> dict[str, Any]:
        """Keep an even number along an edge."""
        return {
            "edge": fewer(self.mesh.edge, share, 2),
            "radial": fewer(self.mesh.radial, share),
        }
