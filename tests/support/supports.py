"""A box with supports of every kind, as deformable blocks."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from geometry import Assembly
from geometry.families.boxes import ColumnBox, box_column
from geometry.loads import LoadCase, TractionLoad
from geometry.parts.regions import HeldFace, Plane

X, Y, Z = np.eye(3)


A = 40.0


def column(cubes: int) -> Assembly:
    """Cubes on each other; the first one is fixed, but a single cube is free."""
    whole = box_column([ColumnBox((A, A, A), (2, 2, 2))] * max(cubes, 2))
    if cubes > 1:
        return whole
    one = {name: getattr(whole, name)[1:] for name in ("shape_of", "rotations", "translations")}
    return replace(whole, layer=np.array([1]), fixed=np.array([False]), **one)


def side(blocks: Assembly, block: int, axis: np.ndarray) -> Plane:
    return Plane(blocks.centroids[block] + 0.5 * A * axis, axis)


def roller(blocks: Assembly, block: int, axis: np.ndarray, **stated: Any) -> HeldFace:
    return HeldFace(block, side(blocks, block, axis), np.abs(axis)[None], **stated)


def case(blocks: Assembly, faces=(), held=(), lines=()) -> LoadCase:
    return LoadCase(blocks, "case", tuple(faces), blocks.fixed, tuple(held), tuple(lines))


def pulled(blocks: Assembly, block: int, axis: np.ndarray, force: np.ndarray) -> TractionLoad:
    return TractionLoad(np.array([block]), side(blocks, block, axis), force)


ONE, TWO = column(1), column(2)
