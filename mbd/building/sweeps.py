"""How far a block moves along a straight line before it meets another one.

Seen along the direction, the first meeting of two solids is a corner of one that reaches a face of
the other, or an edge that reaches an edge: each in closed form, so nothing thin is passed through.
The block that moves is thinned by a clearance all round: faces along which it slides do not stop
it.

Reference: Wilson and Latombe, "Geometric reasoning about mechanical assembly", Artificial
Intelligence 71 (1994).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from geometry.assembly import Assembly
from geometry.mesh import BoolArray, FloatArray, IntArray
from geometry.parts.placed import AnyBlocks
from geometry.polyhedra.polyhedron import Polyhedron, polyhedron_from_block
from mbd.building.sweep_kernels import first_meeting

#: Clearance in block lengths ∛V where no tolerance of contacts is larger.
_CLEARANCE = 2e-4
#: Corners move by this many clearances at most: a sharp one has its faces nearer.
_SHARPEST = 10.0
#: A point is inside of planes where it is this part of a clearance from each.
_INSIDE = 0.1
#: Where a corner cannot be moved inward, what happens within so many clearances does not count: it
#: slides past its neighbours there.
_BESIDE_CORNERS = 4.0


def _thinned(shape: Polyhedron, clearance: float) -> tuple[FloatArray, BoolArray]:
    """Points of a shape whose faces are moved inward by a clearance, (n_points, 3) [mm].

    And at which of them the faces leave no place for that, (n_points,): there they stay.
    """
    corners = shape.triangles.ravel()
    order = np.argsort(corners, kind="stable")
    start = np.searchsorted(corners[order], np.arange(len(shape.points) + 1))
    points, stuck = shape.points.copy(), np.zeros(len(shape.points), np.bool_)
    for corner in range(len(points)):
        around = order[start[corner] : start[corner + 1]] // 3
        normals = shape.plane_normals[np.unique(shape.plane_of[around])]
        inward = -np.linalg.lstsq(normals, np.ones(len(normals)), rcond=1e-6)[0]
        stuck[corner] = (normals @ inward > -_INSIDE).any()
        if not stuck[corner]:
            size = float(np.linalg.norm(inward))
            points[corner] += clearance * min(1.0, _SHARPEST / size) * inward
    return points, stuck


def frame_along(direction: FloatArray) -> FloatArray:
    """Axes whose third one is a unit vector, as rows (3, 3)."""
    first = np.cross(direction, np.eye(3)[np.abs(direction).argmin()])
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(direction, first), direction])


@dataclass(frozen=True)
class Sweeps:
    """Straight motions of single blocks among the others of an assembly."""

    blocks: AnyBlocks

    @cached_property
    def clearance(self) -> float:
        """By which a block that moves is thinned all round [mm]."""
        tolerance = 0.0 if isinstance(self.blocks, Assembly) else self.blocks.tolerance  # type: ignore[attr-defined]
        return max(_CLEARANCE * self.blocks.characteristic_length, 2.0 * tolerance)

    @cached_property
    def shapes(self) -> tuple[Polyhedron, ...]:
        """Surfaces of the shapes."""
        if isinstance(self.blocks, Assembly):
            return tuple(polyhedron_from_block(shape) for shape in self.blocks.shapes)
        return self.blocks.shapes

    @cached_property
    def _thin(self) -> tuple[tuple[FloatArray, BoolArray], ...]:
        return tuple(_thinned(shape, self.clearance) for shape in self.shapes)

    @cached_property
    def points(self) -> list[FloatArray]:
        """Corners of each block in world coordinates, (n, 3) each [mm]."""
        shapes = self.blocks.shape_of.tolist()
        return [self.blocks.place(k, self.shapes[s].points) for k, s in enumerate(shapes)]

    def _seen(self, direction: FloatArray) -> tuple[FloatArray, FloatArray, list[FloatArray]]:
        """Boxes of all blocks, (n_blocks, 3) each, and their corners, seen along a direction."""
        axes = frame_along(direction)
        points = [each @ axes.T for each in self.points]
        low = np.array([each.min(axis=0) for each in points])
        return low, np.array([each.max(axis=0) for each in points]), points

    def along(
        self,
        direction: FloatArray,
        moving: IntArray,
        others: IntArray,
        skip: BoolArray | None = None,
    ) -> FloatArray:
        """Distance at which each of some blocks meets each other one, (n_moving, n_blocks) [mm].

        Infinite where it passes.

        Parameters
        ----------
        direction
            Unit vector, (3,).
        moving
            Blocks that move, each alone, (n_moving,).
        others
            Blocks that may be met, (n_others,).
        skip
            Pairs that are not looked at, (n_moving, n_others); None: none.
        """
        low, high, points = self._seen(direction)
        axes, thin = frame_along(direction), self.clearance
        met = np.full((len(moving), self.blocks.n_blocks), np.inf)
        shape_of = self.blocks.shape_of
        for row, block in enumerate(moving.tolist()):
            near = np.zeros(self.blocks.n_blocks, np.bool_)
            near[others if skip is None else others[~skip[row]]] = True
            near &= high[:, 2] > low[block, 2] + thin
            near &= (low[:, :2] < high[block, :2] - thin).all(axis=1)
            near &= (high[:, :2] > low[block, :2] + thin).all(axis=1)
            near[block] = False
            if not near.any():
                continue
            thinned, stuck = self._thin[int(shape_of[block])]
            own = self.blocks.place(block, thinned) @ axes.T
            a = self.shapes[int(shape_of[block])]
            beside = own[stuck]
            beside[:, 2] = _BESIDE_CORNERS * thin
            own_low, own_high = own.min(axis=0)[:2], own.max(axis=0)[:2]
            for other in np.flatnonzero(near).tolist():
                b = self.shapes[int(shape_of[other])]
                window = np.stack(
                    [np.maximum(own_low, low[other, :2]), np.minimum(own_high, high[other, :2])]
                )
                met[row, other] = first_meeting(
                    (own, a.ridges[0], a.triangles),
                    (points[other], b.ridges[0], b.triangles),
                    window,
                    beside,
                )
        return met

    def clear_after(self, direction: FloatArray, block: int, others: IntArray) -> float:
        """Way after which a block has passed the ends of others along a direction [mm]."""
        ends = [float((self.points[k] @ direction).max()) for k in others.tolist()]
        return max(max(ends, default=-np.inf) - float((self.points[block] @ direction).min()), 0.0)
