"""Planar walls: of Sine Blocks before their cylinder map, of osteomorphic blocks, of bricks."""

from __future__ import annotations

from typing import Any

from validation.scene.family import WallScene, family
from validation.scene.keys.quantities import SIZE


def _as_built_in(block: Any) -> dict[str, Any]:
    """As many elements along each wave as in the built-in wall."""
    return {"divisions": (14 * max(1, round(2.0 * block.frequency)), 6, 10)}


family(
    WallScene,
    "planar-sine",
    "geometry.families.planar_wall:PlanarSineWall",
    assembly="columns layers",
    mesh="divisions",
    default=_as_built_in,
)
family(
    WallScene,
    "osteomorphic",
    "geometry.families.planar_wall:OsteomorphicWall",
    assembly="columns layers",
    mesh="divisions",
    default={"divisions": (24, 12, 8)},
)
family(
    WallScene,
    "brick",
    "geometry.families.boxes:BrickStack",
    assembly="columns layers",
    mesh="divisions",
    default={"divisions": (8, 4, 4)},
    about={"size": SIZE},
)
