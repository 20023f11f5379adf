"""A roller or a ball on a plane body, ``[block] type = "roller"`` or ``"ball"``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from geometry.families.indenter import Indenter
from validation.scene.family import AssemblyScene, family
from validation.scene.sections import Section, fewer

if TYPE_CHECKING:
    from geometry.assembly import Assembly
    from geometry.loads import LoadCase


class NoLoadSection(Section):
    """``[load]`` of bodies that ``[[supports]]`` and ``[[loads]]`` press together."""

    @property
    def words(self) -> str:
        """None of its own."""
        return ""


class IndenterScene(AssemblyScene):
    """A round body on a plane one, held, moved and loaded by ``[[supports]]`` and ``[[loads]]``."""

    mesh: Any
    load: NoLoadSection = NoLoadSection()

    def build_load(self, assembly: Assembly) -> LoadCase:
        """None but what is stated in lists."""
        from geometry.loads import LoadCase

        return LoadCase(assembly, "none", (), assembly.fixed.copy())

    def coarse_mesh(self, wave: int, through: int, other: int) -> dict[str, Any]:  # noqa: ARG002
        """None: elements are as large as the contact asks for."""
        return {}

    def fewer_elements(self, share: float) -> dict[str, Any]:
        """Fewer elements over the contact."""
        return {"elements": fewer(self.mesh.elements, share)}


family(IndenterScene, "roller ball", Indenter, mesh="elements")
