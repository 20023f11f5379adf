"""Least propping of convex blocks by a linear program of its own: nothing of the packages is used.

Faces of two blocks that lie on one plane, back to back, meet where their polygons overlap. A
corner of the overlap has forces along the edges of a pyramid of friction: with edges on the cone
what is carried is less than with the cone, with faces tangent to it more. Props push along z, or
along the normals of faces that look down and are not covered, at the corners of these faces.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.spatial import ConvexHull

Array = NDArray[np.float64]
#: Shares of lengths and areas, and sines, that are none; least cosine of a face that looks down.
_NONE, _DOWN = 1e-6, 0.05


def _area(polygon: Array) -> float:
    """Area to the left of a polygon (n, 2)."""
    x, y = polygon.T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def _cut(polygon: Array, by: Array) -> Array:
    """Part of a convex polygon that another one covers, both (n, 2) and counter-clockwise."""
    for start, end in zip(by, np.roll(by, -1, axis=0), strict=True):
        if not len(polygon):
            break
        along = (end - start) / np.linalg.norm(end - start)
        inside = (polygon - start) @ np.array([-along[1], along[0]])
        kept = []
        for k in range(len(polygon)):
            a, b = inside[k], inside[(k + 1) % len(polygon)]
            if a >= 0.0:
                kept.append(polygon[k])
            if (a > 0.0 > b) or (a < 0.0 < b):
                kept.append(
                    polygon[k] + a / (a - b) * (polygon[(k + 1) % len(polygon)] - polygon[k])
                )
        polygon = np.array(kept).reshape(-1, 2)
    return polygon


def _weight(points: Array) -> tuple[float, Array]:
    """Volume of the hull of points, and its centroid."""
    middle, triangles = points.mean(axis=0), points[ConvexHull(points).simplices]
    volumes = np.abs(np.linalg.det(triangles - middle)) / 6.0
    return volumes.sum(), volumes @ (3.0 * triangles.mean(axis=1) + middle) / (4.0 * volumes.sum())


def _faces(points: Array) -> tuple[list[Array], Array]:
    """Polygons of the hull of points, counter-clockwise seen from outside, and their normals."""
    hull, size = ConvexHull(points), float(np.ptp(points, axis=0).max())
    faces, normals = [], []
    for equation in np.unique((hull.equations / [1.0, 1.0, 1.0, size]).round(6), axis=0):
        normal = equation[:3] / np.linalg.norm(equation[:3])
        on = points[np.abs(points @ normal + size * equation[3]) < 1e-5 * size]
        arms, axes = on - on.mean(axis=0), _across(normal)
        faces.append(on[np.argsort(np.arctan2(arms @ axes[1], arms @ axes[0]))])
        normals.append(normal)
    return faces, np.array(normals)


def _across(normal: Array) -> Array:
    """Two axes across a normal, which is their product; (2, 3)."""
    first = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(normal, first)])


class Spatial:
    """Convex blocks by their corners, of weight one over their volume, and where they meet."""

    def __init__(self, blocks: Mapping[str, Array], fixed: Sequence[str]) -> None:
        self.names, self.fixed = list(blocks), {list(blocks).index(name) for name in fixed}
        solids = list(blocks.values())
        self.volumes, self.middles = zip(*map(_weight, solids), strict=True)
        self.faces, self.normals = zip(*map(_faces, solids), strict=True)
        self.covered = [dict[int, list[tuple[int, float]]]() for _ in solids]
        self.joints: list[tuple[int, int, Array, Array]] = []
        low = np.array([points.min(axis=0) for points in solids]) - _NONE
        high = np.array([points.max(axis=0) for points in solids]) + _NONE
        for one in range(len(solids)):
            near = (low[one] <= high).all(axis=1) & (high[one] >= low).all(axis=1)
            for other in np.flatnonzero(near).tolist():
                if other > one:
                    self._meet(one, other)

    def _meet(self, one: int, other: int) -> None:
        """Note where two blocks meet."""
        opposite = self.normals[one] @ self.normals[other].T < _NONE - 1.0
        for k, j in zip(*map(np.ndarray.tolist, np.nonzero(opposite)), strict=True):
            normal, mine, theirs = self.normals[one][k], self.faces[one][k], self.faces[other][j]
            axes, size = _across(normal), float(np.ptp(mine, axis=0).max())
            if np.abs((theirs - mine[0]) @ normal).max() > 1e-4 * size:
                continue
            shared = _cut((mine - mine[0]) @ axes.T, ((theirs - mine[0]) @ axes.T)[::-1])
            if len(shared) < 3 or _area(shared) <= _NONE * size**2:
                continue
            self.joints.append((one, other, mine[0] + shared @ axes, normal))
            for block, face, by in ((one, k, other), (other, j, one)):
                self.covered[block].setdefault(face, []).append((by, _area(shared)))

    def _props(self, there: set[int], along: str) -> list[tuple[int, Array, Array]]:
        """Block, point and direction of each prop."""
        result = {}
        for block in sorted(there - self.fixed):
            for k, (face, normal) in enumerate(
                zip(self.faces[block], self.normals[block], strict=True)
            ):
                others = [area for by, area in self.covered[block].get(k, ()) if by in there]
                whole = np.linalg.norm(np.cross(face, np.roll(face, -1, axis=0)).sum(axis=0)) / 2.0
                if normal[2] >= -_DOWN or sum(others) >= 0.99 * whole:
                    continue
                way = np.array([0.0, 0.0, 1.0]) if along == "up" else -normal
                for point in face:
                    result[block, tuple(point.round(6)), tuple(way.round(9))] = block, point, way
        return list(result.values())

    def least_propping(
        self,
        there: Sequence[str],
        friction: float,
        *,
        along: str = "up",
        sides: int = 16,
        outer: bool,
    ) -> float:
        """Least sum of the vertical parts of props, over the density; infinite where none is."""
        placed = {self.names.index(name) for name in there} | self.fixed
        free = sorted(placed - self.fixed)
        row = {block: 6 * k for k, block in enumerate(free)}
        scale = max(np.linalg.norm(np.ptp(face, axis=0)) for face in self.faces[free[0]])
        entries: list[tuple[int, int, Array]] = []
        cost: list[float] = []

        def add(block: int, point: Array, force: Array) -> None:
            if block in row:
                moment = np.cross(point - self.middles[block], force) / scale
                entries.append((row[block], len(cost), np.concatenate([force, moment])))

        turns = 2.0 * np.pi * np.arange(sides) / sides
        reach = friction / (np.cos(np.pi / sides) if outer else 1.0)
        for one, other, points, normal in self.joints:
            if not {one, other} <= placed or {one, other} <= self.fixed:
                continue
            around = np.column_stack([np.cos(turns), np.sin(turns)]) @ _across(normal)
            for point in points:
                for edge in normal + reach * around:
                    add(other, point, edge)
                    add(one, point, -edge)
                    cost.append(0.0)
        for block, point, way in self._props(placed, along):
            add(block, point, way)
            cost.append(float(way[2]))
        rows = np.concatenate([at + np.arange(6) for at, _, _ in entries])
        columns = np.repeat([column for _, column, _ in entries], 6)
        values = np.concatenate([value for _, _, value in entries])
        matrix = sp.coo_array((values, (rows, columns)), (6 * len(free), len(cost))).tocsc()
        load = np.zeros(6 * len(free))
        load[2::6] = [self.volumes[block] for block in free]
        total = load.sum()
        found = linprog(cost, A_eq=matrix, b_eq=load / total, method="highs")
        return float(found.fun * total) if found.status == 0 else np.inf
