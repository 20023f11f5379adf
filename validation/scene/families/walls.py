"""Planar walls: of Sine Blocks before their cylinder map, and of osteomorphic blocks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field

from validation.scene.deformable import DivisionsSection
from validation.scene.family import AssemblyScene, BlockSection
from validation.scene.sections import Finite, NonNegative, Positive, Section, TubeLoadSection

if TYPE_CHECKING:
    from geometry.assembly import Assembly


class WallAssemblySection(Section):
    """``[assembly]`` of a planar wall: free blocks in a row, free rows; a frame all round."""

    columns: Annotated[int, Field(ge=1)]
    layers: Annotated[int, Field(ge=1)]


class PlanarSineSection(BlockSection):
    """``[block] type = "planar-sine"``: PSB, the Sine Block before its cylinder map."""

    type: Literal["planar-sine"]
    width: Positive
    """[mm]"""
    thickness: Positive
    """t [mm]"""
    height: Positive
    """h [mm]"""
    amplitude: NonNegative
    """a, on the outer face [mm]"""
    frequency: Positive
    """f, waves per half block; 2f whole."""
    shift: Finite = 0.0
    """s, in units of π."""


class PlanarSineScene(AssemblyScene):
    """A planar wall of Sine Blocks."""

    block: PlanarSineSection
    assembly: WallAssemblySection
    mesh: DivisionsSection
    load: TubeLoadSection

    def build(self) -> Assembly:
        """Build the wall."""
        from geometry.families.planar_wall import WallBlock, planar_sine_wall

        block, counts = self.block, self.assembly
        return planar_sine_wall(
            WallBlock(block.width, block.thickness, block.height, block.amplitude),
            block.frequency,
            block.shift,
            self.mesh.divisions,
            columns=counts.columns,
            layers=counts.layers,
        )

    def coarse_mesh(self, wave: int, through: int, other: int) -> dict[str, Any]:
        """Limit the elements along the waves, across and up."""
        return self.mesh.at_most(round(2 * self.block.frequency) * wave, through, other)

    def fewer_elements(self, share: float) -> dict[str, Any]:
        """Keep whole numbers of elements along a wave."""
        return self.mesh.share(share, round(2 * self.block.frequency))


class OsteomorphicSection(BlockSection):
    """``[block] type = "osteomorphic"``: bricks whose bed joints are saddles."""

    type: Literal["osteomorphic"]
    width: Positive
    """[mm]"""
    thickness: Positive
    """Out of the wall [mm]."""
    height: Positive
    """[mm]"""
    amplitude: NonNegative
    """Of the joints [mm]."""


class OsteomorphicScene(AssemblyScene):
    """A planar wall of osteomorphic blocks."""

    block: OsteomorphicSection
    assembly: WallAssemblySection
    mesh: DivisionsSection
    load: TubeLoadSection

    def build(self) -> Assembly:
        """Build the wall."""
        from geometry.families.planar_wall import WallBlock, osteomorphic_wall

        block, counts = self.block, self.assembly
        return osteomorphic_wall(
            WallBlock(block.width, block.thickness, block.height, block.amplitude),
            self.mesh.divisions,
            columns=counts.columns,
            layers=counts.layers,
        )

    def coarse_mesh(self, wave: int, through: int, other: int) -> dict[str, Any]:
        """Limit the elements along, across and up; one across would miss the joints' amplitude."""
        return self.mesh.at_most(2 * wave, max(2, through), other)

    def fewer_elements(self, share: float) -> dict[str, Any]:
        """Keep an even number along the block, whose neighbours stand on its halves."""
        return self.mesh.share(share, 2)
