"""Scenes of triangulated blocks."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

from pydantic import Field

from geometry.polyhedra.options import DetectionOptions
from validation.scene.family import FamilyScene
from validation.scene.keys.quantities import ACCELERATION
from validation.scene.sections import Positive, Section, Vector, section_of, unset, vector_words
from validation.scene.supports import PushSection

#: Of blocks whose file has nodes between corners, in answers that have no use for them.
STRAIGHT_EDGES = "straight between corners; the file's other nodes count with fem.degree = 2"


class BodyLoadSection(Section):
    """``[load]`` of free-form assemblies: with ``[[loads]]`` the variable load."""

    acceleration: Annotated[Vector | None, ACCELERATION] = None
    """Acceleration of every block, which `rigid.collapse` lets grow [mm/s²]."""
    push: PushSection | None = None
    """A block that is pushed by displacement, after all other loads."""

    @property
    def words(self) -> str:
        """The load with its size; empty without a load."""
        parts = []
        if self.acceleration is not None:
            parts.append(f"acceleration {vector_words(self.acceleration)} mm/s²")
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
