"""Block shapes of every family, and their meshes of any degree."""

from __future__ import annotations

import numpy as np

from geometry import HexagonBlock
from geometry.block import Block
from geometry.families.hexagon_block import (
    HexagonBlockDivisions,
    bottom_hexagon_frame,
    hexagon_block,
)
from geometry.families.planar_wall import OsteomorphicWall
from geometry.families.sine_block import SineBlockDivisions, sine_block
from geometry.mesh import FloatArray
from tests.support.blocks import tsb

HEXAGON = HexagonBlock(blocks_per_layer=4, inner_radius=120.0, thickness=40.0)


WALL = OsteomorphicWall(100.0, 40.0, 60.0, 8.0, divisions=(4, 2, 2), columns=1, layers=1).build()


def sine(divisions: tuple[int, int, int] = (12, 1, 2)) -> Block:
    return sine_block(tsb(), SineBlockDivisions(*divisions))


CURVED = {
    "sine": sine(),
    "hexagon": hexagon_block(HEXAGON, HexagonBlockDivisions(2, 1)),
    "half hexagon": bottom_hexagon_frame(HEXAGON, HexagonBlockDivisions(2, 1)),
    "osteomorphic": WALL.shapes[0],
}


def relative(value: FloatArray, expected: FloatArray) -> float:
    return float(np.abs(value - expected).max() / np.abs(expected).max())
