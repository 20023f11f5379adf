"""Scenes of hexahedral blocks other than the Sine Block's tube."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from validation.scene.deformable import DeformableSections, DivisionsSection
from validation.scene.sections import (
    Finite,
    NonNegative,
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


class HexagonTubeScene(DeformableSections):
    """A tube of hexagon-based blocks."""

    block: HexagonBlockSection
    assembly: TubeAssemblySection
    mesh: HexagonMeshSection
    load: TubeLoadSection
    rigid: RigidSection = RigidSection()


class WallAssemblySection(Section):
    """``[assembly]`` of a planar wall: free blocks in a row, free rows; a frame all round."""

    columns: Annotated[int, Field(ge=1)]
    layers: Annotated[int, Field(ge=1)]


class PlanarSineSection(Section):
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


class PlanarSineScene(DeformableSections):
    """A planar wall of Sine Blocks."""

    block: PlanarSineSection
    assembly: WallAssemblySection
    mesh: DivisionsSection
    load: TubeLoadSection
    rigid: RigidSection = RigidSection()


class OsteomorphicSection(Section):
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


class OsteomorphicScene(DeformableSections):
    """A planar wall of osteomorphic blocks."""

    block: OsteomorphicSection
    assembly: WallAssemblySection
    mesh: DivisionsSection
    load: TubeLoadSection
    rigid: RigidSection = RigidSection()


class StackedBoxSection(Section):
    """One box of a column."""

    size: tuple[Positive, Positive, Positive]
    """Along x, y, z [mm]."""
    divisions: tuple[
        Annotated[int, Field(ge=1)], Annotated[int, Field(ge=1)], Annotated[int, Field(ge=1)]
    ]
    """Elements along x, y, z."""


class BoxesSection(Section):
    """``[block] type = "boxes"``: a column of boxes, from the bottom up."""

    type: Literal["boxes"]
    boxes: Annotated[tuple[StackedBoxSection, ...], Field(min_length=2)]
    """Centred on the z axis."""


class TopPressureSection(Section):
    """``[load]`` of a column of boxes."""

    pressure: Finite = 0.01
    """On the top face, pushing down [MPa]."""


class BoxesScene(DeformableSections):
    """A column of boxes: its bottom face is held, a pressure acts on its top."""

    block: BoxesSection
    load: TopPressureSection = TopPressureSection()
    rigid: RigidSection = RigidSection()
