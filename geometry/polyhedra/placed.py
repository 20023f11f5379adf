"""Triangulated shapes where they stand, for all searches among them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np

from geometry.mesh import FloatArray, IntArray
from geometry.polyhedra.box_tree import BoxTree, boxes_of_triangles
from geometry.polyhedra.polyhedron import Polyhedron

Values = TypeVar("Values", FloatArray, IntArray)


@dataclass(frozen=True)
class PlacedShapes:
    """Shapes and places of blocks, and all their triangles in world coordinates."""

    shapes: Sequence[Polyhedron]
    """Different shapes."""
    shape_of: IntArray
    """Shape of each block, (n_blocks,)."""
    rotations: FloatArray
    """(n_blocks, 3, 3)."""
    translations: FloatArray
    """(n_blocks, 3) [mm]."""
    tolerance: float
    """Distance within which triangles are near each other [mm]."""

    def of_blocks(self, one: Callable[[Polyhedron, int], Values]) -> Values:
        """What is found for each block's shape and number, one block after the other."""
        return np.concatenate([one(self.shapes[k], b) for b, k in enumerate(self.shape_of)])

    def turned(self, vectors: FloatArray, block: int) -> FloatArray:
        """Vectors of a shape, (..., 3), as its block has them."""
        return vectors @ self.rotations[block].T

    def placed(self, points: FloatArray, block: int) -> FloatArray:
        """Points of a shape, (..., 3), where its block has them [mm]."""
        return self.turned(points, block) + self.translations[block]

    @cached_property
    def corners(self) -> FloatArray:
        """Corners of triangles, (n_triangles, 3, 3) [mm]."""
        return self.of_blocks(lambda shape, block: self.placed(shape.corners, block))

    @cached_property
    def normals(self) -> FloatArray:
        """Their unit outward normals, (n_triangles, 3)."""
        return self.of_blocks(lambda shape, block: self.turned(shape.normals, block))

    @cached_property
    def areas(self) -> FloatArray:
        """Their areas, (n_triangles,) [mm²]."""
        return self.of_blocks(lambda shape, _: shape.areas)

    @cached_property
    def planes(self) -> IntArray:
        """Plane that each belongs to, (n_triangles,)."""
        return self.of_blocks(lambda shape, _: shape.plane_of)

    @cached_property
    def block(self) -> IntArray:
        """Block of each, (n_triangles,)."""
        return self.of_blocks(lambda shape, block: np.full(len(shape.triangles), block))

    @cached_property
    def boxes(self) -> tuple[FloatArray, FloatArray]:
        """Corners of the boxes round triangles, larger by half the tolerance, (n, 3) each [mm]."""
        low, high = boxes_of_triangles(self.corners)
        return low - 0.5 * self.tolerance, high + 0.5 * self.tolerance

    @cached_property
    def tree(self) -> BoxTree:
        """Of these boxes, blocks as groups."""
        return BoxTree.of(*self.boxes, self.block)
