"""Section forces that a scene asks for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geometry.assembly import AnyBlocks
from geometry.measures import Planes, planes
from validation.errors import InputError
from validation.scene.sections import CutSection, WholeScene


def scene_planes(scene: WholeScene, assembly: AnyBlocks) -> Planes | None:
    """Planes of a scene; None where it has none.

    Raises
    ------
    InputError, SectionError
        A block that is not there, or what is no plane.
    """
    if not scene.sections:
        return None
    found = [
        planes(
            one.point,
            one.normal,
            blocks=_numbers(one, k, assembly),
            names=[one.name or str(k + 1)],
        )
        for k, one in enumerate(scene.sections)
    ]
    return Planes(
        points=np.concatenate([one.points for one in found]),
        normals=np.concatenate([one.normals for one in found]),
        blocks=tuple(one.blocks[0] for one in found),
        names=tuple(one.names[0] for one in found),
    )


def _numbers(one: CutSection, row: int, assembly: AnyBlocks) -> Sequence[int] | None:
    """Numbers of the blocks of a section, those with names looked up."""
    if one.blocks is None:
        return None
    known: dict[int | str, int] = {k: k for k in range(assembly.n_blocks)}
    known |= {name: k for k, name in enumerate(assembly.names) if name}
    missing = [block for block in one.blocks if block not in known]
    if missing:
        names = " or a name" if assembly.names else ""
        raise InputError(
            f"sections.{row}.blocks: got {missing[0]!r}; expected numbers from 0 to "
            f"{assembly.n_blocks - 1}{names}"
        )
    return [known[block] for block in one.blocks]
