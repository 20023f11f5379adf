"""A roller or a ball on a plane body, ``[block] type = "roller"`` or ``"ball"``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal, Self

from pydantic import Field

from validation.scene.family import AssemblyScene, BlockSection
from validation.scene.sections import Positive, Section, fewer

if TYPE_CHECKING:
    from geometry.assembly import Assembly, UnmatchedJoint
    from geometry.loads import LoadCase


class IndenterSection(BlockSection):
    """``[block] type = "roller"`` or ``"ball"``: a round body (block 1) on a plane one (block 0).

    A slice of the roller, or a quarter of the ball. Faces of both are ``end``, where they touch,
    ``base``, on the far side, and the cuts: ``y-``, ``y+`` of a slice, ``x-``, ``y-`` of a quarter.
    """

    type: Literal["roller", "ball"]
    radius: Positive
    """[mm]"""
    contact: Positive
    """Half width or radius of the contact that is expected [mm]: elements are equal there."""
    thickness: Positive = 1.0
    """Of a slice of a roller, along y [mm]."""


class ContactMeshSection(Section):
    """``[mesh]`` of a round body on a plane one."""

    elements: Annotated[int, Field(ge=1)] = 6
    """Elements of the round body over the expected contact; those of the plane one are larger by a
    quarter."""


class NoLoadSection(Section):
    """``[load]`` of bodies that ``[[supports]]`` and ``[[loads]]`` press together."""

    @property
    def words(self) -> str:
        """None of its own."""
        return ""


class IndenterScene(AssemblyScene):
    """A round body on a plane one, held, moved and loaded by ``[[supports]]`` and ``[[loads]]``."""

    block: IndenterSection
    mesh: ContactMeshSection = ContactMeshSection()
    load: NoLoadSection = NoLoadSection()

    def build(self) -> Assembly:
        """Place both bodies."""
        from geometry.families.indenter import Indenter, indented

        block = self.block
        return indented(
            Indenter(block.type, block.radius, block.contact, self.mesh.elements, block.thickness)
        )

    def build_load(self, assembly: Assembly) -> LoadCase:
        """None but what is stated in lists."""
        from geometry.loads import LoadCase

        return LoadCase(assembly, "none", (), assembly.fixed.copy())

    def unmatched(self, assembly: Assembly) -> tuple[UnmatchedJoint, ...]:  # noqa: ARG002
        """The one joint, which touches in a line or a point."""
        import numpy as np

        from geometry.assembly import UnmatchedJoint

        return (UnmatchedJoint(0, 1, 0.0, 0.0, np.array([0.0, 0.0, 1.0])),)

    def coarser(self, share: float) -> Self | None:
        """Fewer elements over the contact."""
        less = fewer(self.mesh.elements, share)
        return None if less == self.mesh.elements else self.changed({"mesh.elements": less})
