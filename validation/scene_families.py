"""Scenes of blocks other than the Sine Block: the hexagon-based block, families, own meshes."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from validation.scene_fem import ContactSection, EffectsSection, FemSection, MaterialSection
from validation.scene_sections import (
    Positive,
    RigidSection,
    Section,
    TubeAssemblySection,
    TubeLoadSection,
)


class HexagonBlockSection(Section):
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


class HexagonTubeScene(Section):
    """A tube of hexagon-based blocks."""

    block: HexagonBlockSection
    assembly: TubeAssemblySection
    mesh: HexagonMeshSection
    load: TubeLoadSection
    rigid: RigidSection = RigidSection()
    material: MaterialSection | None = None
    contact: ContactSection | None = None
    effects: EffectsSection = EffectsSection()
    fem: FemSection | None = None
