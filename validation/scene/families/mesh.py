"""Blocks of mesh and CAD files, ``[block] type = "mesh"``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from geometry.assembly import Assembly
from validation.scene.deformable import MATERIALS
from validation.scene.family import FAMILIES
from validation.scene.polyhedra import PolyhedralScene
from validation.scene.sections import Finite, Positive, Section, Vector, unset


class MeshBlockSection(Section):
    """``[block] type = "mesh"``: blocks from your own files."""

    type: Literal["mesh"]
    units: Literal["mm", "cm", "m", "inch"] = "mm"
    """Unit of the files; STEP, glTF, 3MF and 3DM files contain theirs."""
    up: Literal["y", "z"] = "z"
    """Axis of the files that points up; y becomes z. glTF files are read with y up already."""
    repair: bool = False
    """Drop triangles that are there twice, turn those that face the wrong way, close flat holes."""
    element_size: Positive | None = None
    """Largest triangle on curved STEP faces [mm]."""


class PlaceSection(Section):
    """Position of a copy: rotated about an axis through the origin, then translated."""

    at: Vector = (0.0, 0.0, 0.0)
    """[mm]"""
    axis: Vector = (0.0, 0.0, 1.0)
    angle: Finite = 0.0
    """[°]"""
    fixed: bool = False


class PartSection(Section):
    """``[[parts]]``: a mesh file and the positions of its copies."""

    file: str
    """STL, OBJ, PLY, OFF, VTU, INP, STEP, JSON (compas), glTF, 3MF, 3DM; relative to the scene's
    folder. Each closed object, group or surface in it is a block."""
    fixed: bool = False
    """Whether all its copies are fixed."""
    leave_out: tuple[Annotated[int, Field(ge=0)] | str, ...] = ()
    """Solids of the file that are no blocks: numbers as ``tubelock check`` prints them, or names of
    the file's objects."""
    material: str | None = None
    """Of its blocks: a section [materials.NAME], "concrete" or "steel"; by default [material]."""
    places: Annotated[tuple[PlaceSection, ...], Field(min_length=1)] = (unset(PlaceSection),)


class FixedBlocksSection(Section):
    """``[assembly]`` of imported blocks."""

    fixed: tuple[Annotated[int, Field(ge=0)] | str, ...] = ()
    """Fixed blocks: numbers, counted from 0 in the order of parts, places and solids, or names
    of the files' objects."""


class MeshScene(PolyhedralScene):
    """Blocks from mesh or CAD files."""

    block: MeshBlockSection
    parts: Annotated[tuple[PartSection, ...], Field(min_length=1)]
    assembly: FixedBlocksSection = unset(FixedBlocksSection)

    @model_validator(mode="after")
    def _materials_of_parts(self) -> MeshScene:
        for part in self.parts:
            if part.material is not None and part.material not in {*self.materials, *MATERIALS}:
                known = ", ".join(map(repr, {**self.materials, **MATERIALS}))
                raise ValueError(
                    f"parts.material: got {part.material!r}; expected one of {known}, or a section "
                    f"[materials.{part.material}]"
                )
        return self

    @property
    def files(self) -> tuple[PartSection, ...]:
        """Files of the blocks, each with its copies."""
        return self.parts

    def straightened(self, assembly: Assembly) -> bool:
        """Whether files have nodes between corners that elements of degree 1 leave out."""
        return any(
            shape.curve is not None and shape.mesh.connectivity.shape[1] == 8
            for shape in assembly.shapes
        )

    def located(self, folder: Path) -> Self:
        """Return the same scene with absolute file names, relative ones taken from a folder."""
        parts = [p.changed({"file": str((folder / p.file).absolute())}) for p in self.parts]
        return self.changed({"parts": parts})


FAMILIES.add("mesh", MeshScene)
