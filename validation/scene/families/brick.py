"""Stacks of plain bricks, ``[block] type = "brick"``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field

from validation.scene.deformable import DivisionsSection
from validation.scene.family import AssemblyScene, BlockSection
from validation.scene.sections import BlockSize, Section, WallLoadSection

if TYPE_CHECKING:
    from geometry.assembly import Assembly


class BrickSection(BlockSection):
    """``[block] type = "brick"``: a plain brick for planar checks."""

    type: Literal["brick"]
    size: BlockSize
    """Length, depth (out of the wall), height [mm]."""


class StackAssemblySection(Section):
    """``[assembly]`` of a stack of bricks."""

    columns: Annotated[int, Field(ge=1)] = 1
    layers: Annotated[int, Field(ge=1)]


class BrickScene(AssemblyScene):
    """A stack of bricks between two fixed rows."""

    block: BrickSection
    assembly: StackAssemblySection
    mesh: DivisionsSection = DivisionsSection(divisions=(8, 4, 4))
    load: WallLoadSection

    def build(self) -> Assembly:
        """Build the stack."""
        from geometry.families.boxes import brick_stack

        counts = self.assembly
        return brick_stack(
            self.block.size, self.mesh.divisions, columns=counts.columns, layers=counts.layers
        )

    def coarse_mesh(self, wave: int, through: int, other: int) -> dict[str, Any]:
        """Limit the elements along, across and up."""
        return self.mesh.at_most(2 * wave, through, other)

    def fewer_elements(self, share: float) -> dict[str, Any]:
        """Keep an even number along the brick, whose neighbours stand on its halves."""
        return self.mesh.share(share, 2)
