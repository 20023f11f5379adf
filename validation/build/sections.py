"""Section forces that a scene asks for."""

from __future__ import annotations

import numpy as np

from geometry.assembly import AnyBlocks
from geometry.measures import Planes, planes
from geometry.parts.chosen import chosen_blocks
from validation.scene.sections import WholeScene


def scene_planes(scene: WholeScene, assembly: AnyBlocks) -> Planes | None:
    """Planes of a scene; None where it has none."""
    if not scene.sections:
        return None
    result = []
    for k, one in enumerate(scene.sections):
        blocks = None
        if one.blocks is not None:
            blocks = chosen_blocks(f"sections[{k}].blocks", one.blocks, assembly)
        result.append(planes(one.point, one.normal, blocks=blocks, names=[one.name or str(k + 1)]))
    return Planes(
        points=np.concatenate([one.points for one in result]),
        normals=np.concatenate([one.normals for one in result]),
        blocks=tuple(one.blocks[0] for one in result),
        names=tuple(one.names[0] for one in result),
    )
