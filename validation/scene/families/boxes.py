"""Columns of boxes, ``[block] type = "boxes"``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

from pydantic import Field

from geometry.families.boxes import ColumnBox
from validation.scene.family import FAMILIES, AssemblyScene
from validation.scene.keys.quantities import PRESSURE, SIZE
from validation.scene.sections import Finite, Section, fewer, section_of, unset

if TYPE_CHECKING:
    from geometry.assembly import Assembly
    from geometry.loads import LoadCase


_BoxKeys: Any = section_of(ColumnBox, about={"size": SIZE})


class StackedBoxSection(_BoxKeys):  # type: ignore[misc]
    """One box of a column."""


class BoxesSection(Section):
    """``[block] type = "boxes"``: a column of boxes, from the bottom up."""

    type: Literal["boxes"]
    boxes: Annotated[tuple[StackedBoxSection, ...], Field(min_length=2)]
    """Centred on the z axis."""


class TopPressureSection(Section):
    """``[load]`` of a column of boxes."""

    pressure: Annotated[Finite, PRESSURE] | None = None
    """On the top face, pushing down [MPa]; by default none."""

    @property
    def words(self) -> str:
        """The load with its size; empty without a load."""
        return "" if self.pressure is None else f"pressure {self.pressure:g} MPa on top"


class BoxesScene(AssemblyScene):
    """A column of boxes with a fixed bottom face and a pressure on its top."""

    stands: ClassVar[bool] = True

    block: BoxesSection
    load: TopPressureSection = unset(TopPressureSection)

    def build(self) -> Assembly:
        """Build the column."""
        from geometry.families.boxes import box_column

        return box_column([ColumnBox(**box.model_dump()) for box in self.block.boxes])

    def build_load(self, assembly: Assembly) -> LoadCase:
        """Press on the top, where there is a pressure."""
        import numpy as np

        from geometry.loads import face_pressure

        if self.load.pressure is None:
            return super().build_load(assembly)
        return face_pressure(assembly, np.array([assembly.n_blocks - 1]), "z+", self.load.pressure)

    @property
    def divisions(self) -> list[int]:
        """Of the finest box in each direction."""
        return [max(box.divisions[axis] for box in self.block.boxes) for axis in range(3)]

    def coarser(self, share: float) -> Self | None:
        """Divide every box into fewer elements."""
        boxes = tuple(
            box.changed({"divisions": [fewer(n, share) for n in box.divisions]})
            for box in self.block.boxes
        )
        return None if boxes == self.block.boxes else self.changed({"block.boxes": boxes})


FAMILIES.add("boxes", BoxesScene)
