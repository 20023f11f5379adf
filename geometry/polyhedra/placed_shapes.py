"""Triangulated shapes where they stand, for all searches among them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np

from geometry.mesh import BoolArray, FloatArray, IntArray
from geometry.parts.placed import PlacedBlocks
from geometry.polyhedra.near.triangle_search import BoxTree, Surface, boxes_of_triangles
from geometry.polyhedra.polyhedron import Polyhedron

Values = TypeVar("Values", FloatArray, IntArray)

#: What is narrower than this part of a face, or nearer to its border, is at the border.
_NARROW = 1e-3


@dataclass(frozen=True)
class PlacedShapes:
    """Blocks, and all their triangles in world coordinates."""

    blocks: PlacedBlocks[Polyhedron]
    """Shapes, and where they are."""
    tolerance: float
    """Distance within which triangles are near each other [mm]."""

    def wider(self, more: float) -> PlacedShapes:
        """The same for searches within a distance that is larger by so much [mm]."""
        return PlacedShapes(self.blocks, self.tolerance + more)

    def of_blocks(self, one: Callable[[Polyhedron, int], Values]) -> Values:
        """What is found for each block's shape and number, one block after the other."""
        return np.concatenate([one(self.blocks.shape(b), b) for b in range(self.blocks.n_blocks)])

    def turned(self, vectors: FloatArray, block: int) -> FloatArray:
        """Vectors of a shape, (..., 3), as its block has them."""
        return vectors @ self.blocks.rotations[block].T

    def placed(self, points: FloatArray, block: int) -> FloatArray:
        """Points of a shape, (..., 3), where its block has them [mm]."""
        return self.blocks.place(block, points)

    @cached_property
    def corners(self) -> FloatArray:
        """Corners of triangles, (n_triangles, 3, 3) [mm]."""
        return self.of_blocks(lambda shape, block: self.placed(shape.corners, block))

    @cached_property
    def normals(self) -> FloatArray:
        """Unit outward normals of their planes, (n_triangles, 3)."""
        return self.of_blocks(
            lambda shape, block: self.turned(shape.plane_normals, block)[shape.plane_of]
        )

    @cached_property
    def areas(self) -> FloatArray:
        """Their areas, (n_triangles,) [mm²]."""
        return self.of_blocks(lambda shape, _: shape.areas)

    @cached_property
    def plane_areas(self) -> FloatArray:
        """Areas of their planes, (n_triangles,) [mm²]."""
        return self.of_blocks(lambda shape, _: shape.plane_areas[shape.plane_of])

    @cached_property
    def turns(self) -> FloatArray:
        """Angles by which they may be turned from curved faces, (n_triangles,) [rad]."""
        return self.of_blocks(
            lambda shape, _: np.maximum(shape.plane_turns[shape.plane_of], shape.facet_errors[1])
        )

    @cached_property
    def sizes(self) -> FloatArray:
        """Longest side of their boxes, (n_triangles,) [mm]."""
        return np.asarray(np.ptp(self.corners, axis=1).max(axis=1))

    @cached_property
    def offsets(self) -> FloatArray:
        """How far they lie off the curved faces of CAD models, (n_triangles,) [mm]."""
        return self.of_blocks(lambda shape, _: shape.facet_errors[0])

    @cached_property
    def planes(self) -> IntArray:
        """Plane that each belongs to, (n_triangles,)."""
        return self.of_blocks(lambda shape, _: shape.plane_of)

    @cached_property
    def first_face(self) -> IntArray:
        """First face of each block, where faces are numbered through all blocks, (n_blocks,)."""
        blocks = self.blocks
        count = [len(blocks.shape(b).face_widths) for b in range(blocks.n_blocks)]
        return np.cumsum([0, *count])[:-1]

    @cached_property
    def faces(self) -> IntArray:
        """Face that each triangle is of, numbered through all blocks, (n_triangles,)."""
        return self.of_blocks(lambda shape, block: self.first_face[block] + shape.face_of)

    @cached_property
    def least_widths(self) -> FloatArray:
        """Width of contact at which each face has an area in contact, (n_faces,) [mm]."""
        width = self.of_blocks(lambda shape, _: shape.face_widths)
        return np.maximum(self.tolerance, _NARROW * width)

    @cached_property
    def _borders(self) -> tuple[FloatArray, IntArray]:
        """Segments round each face, face after face, (n, 2, 3) [mm], and the first of each."""
        segments = self.of_blocks(
            lambda shape, block: self.placed(shape.points[shape.face_borders[0]], block)
        )
        count = self.of_blocks(lambda shape, _: np.diff(shape.face_borders[1]))
        return segments, np.concatenate([[0], np.cumsum(count)])

    def within(self, points: FloatArray, faces: IntArray) -> BoolArray:
        """Whether points (n, 3) on faces (n,) are farther from the border than `least_widths`."""
        segments, first = self._borders
        count = first[faces + 1] - first[faces]
        owner = np.repeat(np.arange(len(faces)), count)
        row = np.arange(len(owner)) + np.repeat(first[faces] - (np.cumsum(count) - count), count)
        start, end = segments[row, 0], segments[row, 1]
        along, arm = end - start, points[owner] - start
        square = np.einsum("ni,ni->n", along, along)
        part = np.clip(np.einsum("ni,ni->n", arm, along) / square, 0.0, 1.0)
        nearest = np.full(len(faces), np.inf)
        np.minimum.at(nearest, owner, np.linalg.norm(arm - part[:, None] * along, axis=1))
        return nearest > self.least_widths[faces]

    @cached_property
    def block(self) -> IntArray:
        """Block of each, (n_triangles,)."""
        return self.of_blocks(lambda shape, block: np.full(len(shape.triangles), block))

    def apart(
        self, points: FloatArray, m: IntArray, s: IntArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """What two exact faces are apart near some points.

        Parameters
        ----------
        points
            (n, 3) [mm]
        m, s
            Triangles of the two faces, (n,) each.

        Returns
        -------
        FloatArray
            Gap along the mean normal, ∞ beside a face, (n,) [mm].
        FloatArray
            Its slope: the sum of both normals, (n, 3).
        FloatArray
            Points half-way between the faces, (n, 3) [mm].
        """
        feet, normals, lost = [], [], np.zeros(len(points), dtype=np.bool_)
        for triangles in (m, s):
            foot, normal = self.on_exact_faces(points, triangles)
            curved = self.offsets[triangles] > 0.0
            lost |= curved & (normal == self.normals[triangles]).all(axis=1)
            flat = np.flatnonzero(~curved)
            arm = self.corners[triangles[flat], 0] - points[flat]
            height = np.einsum("ni,ni->n", arm, normal[flat])
            foot[flat] = points[flat] + height[:, None] * normal[flat]
            feet.append(foot)
            normals.append(normal)
        direction = normals[0] - normals[1]
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        gap = np.einsum("ni,ni->n", feet[1] - feet[0], direction)
        gap[lost] = np.inf
        middle = 0.5 * (feet[0] + feet[1]) - points
        along = np.einsum("ni,ni->n", middle, direction)
        return gap, normals[0] + normals[1], points + along[:, None] * direction

    def on_exact_faces(
        self, points: FloatArray, triangles: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Points (n, 3) near triangles (n,) on the curved CAD faces of these, and normals there.

        Points are where they were on other faces, and normals those of the planes.
        """
        start = np.searchsorted(self.block, np.arange(self.blocks.n_blocks))
        places, normals, block = points.copy(), self.normals[triangles], self.block[triangles]
        for one in np.unique(block).tolist():
            exact = self.blocks.shape(one).exact
            if exact is None:
                continue
            rows = np.flatnonzero(block == one)
            rows = rows[exact.curved(triangles[rows] - start[one])]
            placed = self.blocks
            local = (points[rows] - placed.translations[one]) @ placed.rotations[one]
            near, outward = exact.on(local, triangles[rows] - start[one])
            # Beyond the border of a face the kernel may answer with another side of it.
            beside = np.linalg.norm(near - local, axis=1) <= self.sizes[triangles[rows]]
            rows, near, outward = rows[beside], near[beside], outward[beside]
            places[rows], normals[rows] = self.placed(near, one), self.turned(outward, one)
        return places, normals

    @cached_property
    def boxes(self) -> tuple[FloatArray, FloatArray]:
        """Corners of the boxes round triangles, larger by half the tolerance, (n, 3) each [mm]."""
        low, high = boxes_of_triangles(self.corners)
        return low - 0.5 * self.tolerance, high + 0.5 * self.tolerance

    @cached_property
    def surface(self) -> Surface:
        """All triangles, ready to be searched."""
        numbers = np.arange(3 * len(self.corners)).reshape(-1, 3)
        vectors = self.areas[:, None] * self.normals
        tree = BoxTree.of(*boxes_of_triangles(self.corners))
        return Surface(numbers, self.corners, vectors, tree)

    @cached_property
    def tree(self) -> BoxTree:
        """Of these boxes, blocks as groups."""
        return BoxTree.of(*self.boxes, self.block)
