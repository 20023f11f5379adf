"""Stacks of plain bricks, ``[block] type = "brick"``."""

from __future__ import annotations

from validation.scene.family import WallScene, family
from validation.scene.keys.docstrings import SIZE

family(
    WallScene,
    "brick",
    "geometry.families.boxes:BrickStack",
    assembly="columns layers",
    mesh="divisions",
    default={"divisions": (8, 4, 4)},
    about={"size": SIZE},
)
