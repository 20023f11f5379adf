"""Scenes of triangulated blocks: families with known verdicts, and your own meshes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from geometry.assembly import Assembly
from geometry.polyhedra.options import DetectionOptions
from validation.scene.deformable import MATERIALS
from validation.scene.family import FAMILIES, FamilyScene, family
from validation.scene.keys.docstrings import ACCELERATION, SIZE
from validation.scene.sections import Finite, Positive, Section, Vector, section_of, vector_words
from validation.scene.supports import PushSection

#: Of blocks whose file has nodes between corners, in answers that have no use for them.
STRAIGHT_EDGES = "straight between corners; the file's other nodes count with fem.degree = 2"
#: Forces on single blocks that words of a load name.
_MOST_FORCES = 3


class PointForceSection(Section):
    """``[[load.forces]]``: a force on one block."""

    block: Annotated[int, Field(ge=0)]
    """Block number, counted from 0 in the order of the scene."""
    force: Vector
    """[N]"""
    point: Vector | None = None
    """Point of application in world coordinates [mm]; by default the centre of mass."""


class BodyLoadSection(Section):
    """``[load]`` of free-form assemblies: the variable load; the weight is `effects.gravity`."""

    acceleration: Annotated[Vector | None, ACCELERATION] = None
    """Acceleration of every block, which `rigid.collapse` lets grow [mm/s²]."""
    forces: tuple[PointForceSection, ...] = ()
    """Forces on single blocks, which `rigid.collapse` lets grow."""
    push: PushSection | None = None
    """A block that is pushed by displacement, after all other loads."""

    @property
    def words(self) -> str:
        """The load with its size; empty without a load."""
        parts = []
        if self.acceleration is not None:
            parts.append(f"acceleration {vector_words(self.acceleration)} mm/s²")
        named = self.forces[:_MOST_FORCES]
        parts += [f"force {vector_words(f.force)} N on block {f.block}" for f in named]
        if len(self.forces) > len(named):
            parts.append(f"{len(self.forces) - len(named)} more forces on single blocks")
        if self.push is not None:
            parts.append(self.push.words)
        return " + ".join(parts)


_DetectionKeys: Any = section_of(DetectionOptions)


class DetectionSection(_DetectionKeys):  # type: ignore[misc]
    """``[detection]``: contact detection of non-matching meshes."""

    @property
    def options(self) -> DetectionOptions:
        """The same, for `geometry`."""
        return DetectionOptions(**self.model_dump())


class SolidMeshSection(Section):
    """``[mesh]`` of deformable blocks that come without hexahedra."""

    divisions: Annotated[int, Field(ge=1)] = 4
    """Elements along each edge of a block with six flat sides of four corners."""
    size: Positive | None = None
    """Edge of the tetrahedra of any other block [mm], each of which is split into four hexahedra;
    by default ∛V of the block."""


class PolyhedralScene(FamilyScene):
    """A scene of triangulated blocks."""

    load: BodyLoadSection = BodyLoadSection()
    detection: DetectionSection = DetectionSection()
    mesh: SolidMeshSection = SolidMeshSection()


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
    places: Annotated[tuple[PlaceSection, ...], Field(min_length=1)] = (PlaceSection(),)


class FixedBlocksSection(Section):
    """``[assembly]`` of imported blocks."""

    fixed: tuple[Annotated[int, Field(ge=0)] | str, ...] = ()
    """Fixed blocks: numbers, counted from 0 in the order of parts, places and solids, or names
    of the files' objects."""


class MeshScene(PolyhedralScene):
    """Blocks from mesh or CAD files."""

    block: MeshBlockSection
    parts: Annotated[tuple[PartSection, ...], Field(min_length=1)]
    assembly: FixedBlocksSection = FixedBlocksSection()

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

    def straightened(self, assembly: Assembly) -> bool:
        """Whether files have nodes between corners that elements of degree 1 leave out."""
        return any(
            shape.curve is not None and shape.mesh.connectivity.shape[1] == 8
            for shape in assembly.shapes
        )

    def located(self, folder: Path) -> MeshScene:
        """Return the same scene with absolute file names, relative ones taken from a folder."""
        parts = [p.changed({"file": str((folder / p.file).absolute())}) for p in self.parts]
        return self.changed({"parts": parts})


for _kind, _shape, _assembly in (
    ("tetrahedra", "platonic_layers:TetrahedraLayer", "columns rows freed"),
    ("octahedra", "platonic_layers:OctahedraLayer", "rings"),
    ("cubes", "platonic_layers:CubesLayer", "rings"),
    ("versatile", "versatile_panel:VersatilePanel", "columns rows"),
    ("wall", "masonry:RunningBondWall", "columns rows"),
    ("arch", "masonry:CircularArch", "voussoirs embrace"),
    ("voxels", "voxels:VoxelPuzzle", "fixed"),
):
    _place = f"geometry.families.{_shape}"
    family(PolyhedralScene, _kind, _place, assembly=_assembly, about={"size": SIZE})
FAMILIES.add("mesh", MeshScene)
