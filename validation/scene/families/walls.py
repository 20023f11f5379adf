"""Planar walls: of Sine Blocks before their cylinder map, and of osteomorphic blocks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field

from validation.scene.deformable import DivisionsSection
from validation.scene.family import AssemblyScene, BlockSection
from validation.scene.sections import Finite, NonNegative, Positive, Section, WallLoadSection

if TYPE_CHECKING:
    from collections.abc import Callable

    from geometry.assembly import Assembly


class WallAssemblySection(Section):
    """``[assembly]`` of a planar wall: columns and rows of free blocks within a fixed ring."""

    columns: Annotated[int, Field(ge=1)]
    layers: Annotated[int, Field(ge=1)]


class _WallScene(AssemblyScene):
    """Keys and defaults that planar walls share."""

    assembly: WallAssemblySection
    mesh: DivisionsSection
    load: WallLoadSection

    def _wall(self, build: Callable[..., Assembly], *shape: float) -> Assembly:
        """Wall of the scene's blocks, whose further numbers are the shape."""
        from geometry.families.planar_wall import WallBlock

        block: Any = self.block
        return build(
            WallBlock(block.width, block.thickness, block.height, block.amplitude),
            *shape,
            self.mesh.divisions,
            columns=self.assembly.columns,
            layers=self.assembly.layers,
        )


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
    """f, number of sine waves over half of the block; 2f is a whole number."""
    shift: Finite = 0.0
    """s, in units of π."""


def _sine_mesh(block: PlanarSineSection) -> DivisionsSection:
    """As many facets along each wave as in the built-in wall."""
    return DivisionsSection(divisions=(14 * max(1, round(2.0 * block.frequency)), 6, 10))


class PlanarSineScene(_WallScene):
    """A planar wall of Sine Blocks."""

    block: PlanarSineSection
    mesh: DivisionsSection = Field(default_factory=lambda scene: _sine_mesh(scene["block"]))

    def build(self) -> Assembly:
        """Build the wall."""
        from geometry.families.planar_wall import planar_sine_wall

        return self._wall(planar_sine_wall, self.block.frequency, self.block.shift)

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


class OsteomorphicScene(_WallScene):
    """A planar wall of osteomorphic blocks."""

    block: OsteomorphicSection
    mesh: DivisionsSection = DivisionsSection(divisions=(24, 12, 8))

    def build(self) -> Assembly:
        """Build the wall."""
        from geometry.families.planar_wall import osteomorphic_wall

        return self._wall(osteomorphic_wall)

    def coarse_mesh(self, wave: int, through: int, other: int) -> dict[str, Any]:
        """Limit the elements along, across and up; one across would miss the joints' amplitude."""
        return self.mesh.at_most(2 * wave, max(2, through), other)

    def fewer_elements(self, share: float) -> dict[str, Any]:
        """Keep an even number along the block, whose neighbours stand on its halves."""
        return self.mesh.share(share, 2)
