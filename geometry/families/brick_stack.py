"""A stack of bricks between two fixed rows: the simplest assembly, with known answers.

Flat faces only: bricks slide out of the wall, so nothing is locked; a pressure on one side
activates that mechanism; a pressure from above is carried with the same pressure in every joint.
"""

from __future__ import annotations

import numpy as np

from geometry.assembly import Assembly, require_counts, require_divisions, require_size
from geometry.block import Block, box_block

_FACES = {"y-": "inner", "y+": "outer", "x-": "left", "x+": "right", "z-": "bottom", "z+": "top"}


def brick(size: tuple[float, float, float], divisions: tuple[int, int, int]) -> Block:
    """Brick [0, size] whose faces are named like a tube block's, y pointing outward."""
    box = box_block(size, divisions, name="brick")
    faces = {name: box.faces[side] for side, name in _FACES.items()}
    return Block("brick", box.mesh, faces, ("bottom", "top", "left", "right"))


def brick_stack(
    size: tuple[float, float, float],
    divisions: tuple[int, int, int],
    *,
    columns: int,
    layers: int,
) -> Assembly:
    """Stack ``columns`` × ``layers`` bricks, with a fixed row below and one above.

    Parameters
    ----------
    size
        Length (x), depth (y, out of the wall) and height (z) of a brick [mm].
    divisions
        Elements of a brick along x, y, z.
    columns, layers
        Bricks side by side, and free rows.

    Raises
    ------
    AssemblyError
        For non-positive sizes or counts.
    """
    require_size(size)
    require_divisions(divisions)
    require_counts(columns=columns, layers=layers)
    column, layer = (i.ravel() for i in np.meshgrid(np.arange(columns), np.arange(layers + 2)))
    origin = np.column_stack([column * size[0], np.zeros(len(column)), (layer - 1.0) * size[2]])
    return Assembly(
        name="brick-stack",
        shapes=(brick(size, divisions),),
        shape_of=np.zeros(len(layer), dtype=np.int64),
        rotations=np.tile(np.eye(3), (len(layer), 1, 1)),
        translations=origin,
        layer=layer,
        fixed=(layer == 0) | (layer == layers + 1),
        unmatched_allowed=True,
    )
