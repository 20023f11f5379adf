"""A block on a floor, and a plate that slides on one."""

from __future__ import annotations

import numpy as np

from fem import Material
from geometry import Assembly
from geometry.families.boxes import brick
from geometry.loads import LoadCase
from tests.support.fem_problems import deformable_assembly

CONCRETE = Material(density=2.4e-9, young_modulus=33e3, poisson_ratio=0.2)


GRAVITY = 9810.0


def block_on_floor(
    size=(40.0, 30.0, 20.0),
    divisions=(2, 2, 2),
    *,
    shape=None,
    blocks=1,
    lift=0.0,
    floor_first=True,
    **options,
):
    """One or more bricks on a rigid one, each in its own column; no loads.

    ``shape``: the brick with another mesh.

    The lower number of two blocks is the master.
    """
    n = 2 * blocks
    column = np.repeat(np.arange(blocks), 2)
    layer = np.tile([0, 1] if floor_first else [1, 0], blocks)
    place = np.column_stack([50.0 * column, np.zeros(n), size[2] * (layer - 1.0)])
    assembly = Assembly(
        name="blocks on a floor",
        shapes=(shape or brick(size, divisions),),
        shape_of=np.zeros(n, dtype=np.int64),
        rotations=np.tile(np.eye(3), (n, 1, 1)),
        translations=place,
        layer=layer,
        fixed=layer == 0,
        unmatched_allowed=True,
    )
    load = LoadCase(assembly, "none", (), assembly.fixed)
    return deformable_assembly(assembly, load, CONCRETE, clearance=lift, **options)
