"""A roller or a ball on a plane body, ``[block] type = "roller"`` or ``"ball"``."""

from __future__ import annotations

from typing import Any

from validation.scene.family import AssemblyScene, family
from validation.scene.sections import Section, unset


class NoLoadSection(Section):
    """``[load]`` of bodies that ``[[supports]]`` and ``[[loads]]`` press together."""

    @property
    def words(self) -> str:
        """None of its own."""
        return ""


class IndenterScene(AssemblyScene):
    """A round body on a plane one, held, moved and loaded by ``[[supports]]`` and ``[[loads]]``."""

    load: NoLoadSection = unset(NoLoadSection)

    @property
    def divisions(self) -> list[int]:
        """None that is known beforehand."""
        return []

    def coarse_mesh(self, wave: int, through: int, other: int) -> dict[str, Any]:  # noqa: ARG002
        """None: elements are as large as the contact asks for."""
        return {}


family(IndenterScene, "roller ball", "geometry.families.indenter:Indenter", mesh="elements")
