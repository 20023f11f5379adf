"""Scenes of triangulated blocks."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

from pydantic import Field

from geometry.polyhedra.options import DetectionOptions
from validation.scene.family import FamilyScene
from validation.scene.keys.docstrings import ACCELERATION
from validation.scene.sections import Positive, Section, Vector, section_of, unset, vector_words
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

    solid: ClassVar[bool] = True

    load: BodyLoadSection = unset(BodyLoadSection)
    detection: DetectionSection = unset(DetectionSection)
    mesh: SolidMeshSection = unset(SolidMeshSection)

    @property
    def divisions(self) -> list[int]:
        """Elements of a block with six flat sides."""
        return 3 * [self.mesh.divisions]
