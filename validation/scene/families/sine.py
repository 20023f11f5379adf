"""Tubes of Sine Blocks, ``[block] type = "sine"``."""

from __future__ import annotations

from math import atan, degrees
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, ValidationError, ValidatorFunctionWrapHandler, field_validator

from geometry.families.sine_block import LayerTurn, SineBlockDivisions, SineBlockParameters
from validation.scene.family import BlockSection, RoundScene
from validation.scene.sections import (
    Finite,
    NonNegative,
    Positive,
    Section,
    TubeAssemblySection,
    TubeLoadSection,
    fewer,
)

if TYPE_CHECKING:
    from geometry.assembly import Assembly


#: Slope beyond which the joints of a wave are almost upright [°]; the paper's are at most 76°.
_STEEP = 76.0


class SineBlockSection(BlockSection):
    """``[block] type = "sine"``: TSB(h, a, f, s, n, r_i, t)."""

    type: Literal["sine"]
    height: Positive
    """h [mm]"""
    amplitude: NonNegative
    """a [mm]"""
    frequency: Positive
    """f, number of sine waves over half of the block; 2f is a whole number."""
    shift: Finite = 0.0
    """s, in units of π."""
    blocks_per_layer: Annotated[int, Field(ge=2)]
    """n"""
    inner_radius: Positive
    """r_i [mm]"""
    thickness: Positive
    """t [mm]"""


class SineTubeAssemblySection(TubeAssemblySection):
    """``[assembly]`` of a tube of Sine Blocks."""

    turn: LayerTurn | float = LayerTurn.HALF_BLOCK
    """Offset (stagger) of every second layer: ``half block`` (⌊f⌋ waves, the whole number nearest
    to half a block), ``one wave`` (the paper's parameter study) or a number of waves. At f = 2 the
    default more than halves the pressures; at f = 1 and 1.5 both are the same."""

    @field_validator("turn", mode="wrap")
    @classmethod
    def _words_or_waves(cls, value: Any, handler: ValidatorFunctionWrapHandler) -> Any:
        try:
            return handler(value)
        except ValidationError:
            words = ", ".join(f'"{turn}"' for turn in LayerTurn)
            raise ValueError(f"expected {words} or a whole number of waves") from None


class TubeMeshSection(Section):
    """``[mesh]`` of a tube: elements of one block in each direction."""

    around: Annotated[int, Field(ge=1)]
    radial: Annotated[int, Field(ge=1)]
    axial: Annotated[int, Field(ge=1)]
    radial_grading: Annotated[float, Field(ge=1e-3, le=1e3)] = 1.0
    """Mesh bias: element length at the inner over that at the outer face; 1: uniform."""

    @property
    def words(self) -> str:
        """Facets of a block in each direction."""
        return f"{self.around} facets around a block, {self.radial} radial, {self.axial} axial"


def _paper_mesh(block: SineBlockSection) -> TubeMeshSection:
    """Facets of the paper's means: as many along each wave, through the wall and along the axis."""
    return TubeMeshSection(around=28 * max(1, round(2.0 * block.frequency)), radial=8, axial=20)


class TubeScene(RoundScene):
    """A tube of Sine Blocks."""

    block: SineBlockSection
    assembly: SineTubeAssemblySection
    mesh: TubeMeshSection = Field(default_factory=lambda scene: _paper_mesh(scene["block"]))
    load: TubeLoadSection

    @property
    def shape(self) -> SineBlockParameters:
        """Of the free block."""
        return SineBlockParameters(**self.block.model_dump(exclude={"type"}))

    @property
    def caution(self) -> str | None:
        """Steep waves: their joints are almost upright, and thin where they turn."""
        angle = degrees(atan(self.shape.steepest_slope))
        if angle <= _STEEP:
            return None
        return (
            f"block.amplitude = {self.block.amplitude:g} mm makes joints as steep as {angle:.0f}° "
            f"at the outer radius; usual are at most {_STEEP:g}°: is it meant?"
        )

    @property
    def _divisions(self) -> SineBlockDivisions:
        return SineBlockDivisions(**self.mesh.model_dump())

    def build(self) -> Assembly:
        """Build the tube."""
        from geometry.families.tube import sine_tube

        return sine_tube(self.shape, self._divisions, self.assembly.layers, self.assembly.turn)

    def build_cell(self) -> Assembly:
        """Build two layers and their images."""
        from geometry.families.tube import sine_cell

        return sine_cell(self.shape, self._divisions, self.assembly.turn)

    def coarse_mesh(self, wave: int, through: int, other: int) -> dict[str, Any]:
        """Limit the elements along a wave, through the wall and along the axis."""
        return {
            "around": min(self.mesh.around, wave * round(2 * self.block.frequency)),
            "radial": min(self.mesh.radial, through),
            "axial": min(self.mesh.axial, other),
        }

    def fewer_elements(self, share: float) -> dict[str, Any]:
        """Keep at least two elements a wave."""
        mesh, waves = self.mesh, round(2 * self.block.frequency)
        return {
            "around": max(fewer(mesh.around, share, waves), min(mesh.around, 2 * waves)),
            "radial": fewer(mesh.radial, share),
            "axial": fewer(mesh.axial, share),
        }
