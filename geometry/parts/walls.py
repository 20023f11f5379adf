"""Least wall of a solid: rays inward from its facets to the sides across."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from geometry.block import Block
from geometry.mesh import BoolArray, FloatArray, IntArray, along_curve

#: Two surfaces are the sides of a wall where their outward normals differ by more than 120°.
_FACING = -0.5
#: Children of a node of the tree of boxes.
_FEW = 8
#: So few faces, of so many facets, are taken one by one, each against what is across.
_FEW_FACES, _MANY_FACETS = 8, 300
#: Rays that are followed at once.
_RAYS = 1024
#: What a ray may miss a facet or a box by, over their size: round-off at edges between facets.
_MISSED = 1e-9
#: Directions along a plane, over the product of its edges: no ray meets it.
_ALONG = 1e-12


def least_wall(shape: Any) -> float:
    """Smallest distance between two sides of a solid (`Dimensions.least_wall`), or ∞ [mm].

    Between flat sides it is linear: rays from their corners find it, whatever the facets.
    """
    points, facets, face = _surface(shape)
    corners = points[facets]
    normals = unit_vectors(np.cross(corners[:, 2] - corners[:, 0], corners[:, -1] - corners[:, 1]))
    sides = _Sides(facets, face)
    # Corners of a face once, each with one of its facets.
    every = np.column_stack([np.repeat(face, facets.shape[1]), facets.ravel()])
    _, corner = np.unique(every, axis=0, return_index=True)
    start = np.concatenate([corners.mean(axis=1), corners.reshape(-1, 3)[corner]])
    own = np.concatenate([np.arange(len(facets)), corner // facets.shape[1]])
    reach, least = float(np.linalg.norm(np.ptp(points, axis=0))), np.inf
    for of, across in sides.pairs():
        tree, starts = _Boxes.of(corners[across]), np.flatnonzero(np.isin(face[own], of))
        steps = -(-len(starts) // _RAYS)
        for first in range(steps):  # rays from all over at once: the first shorten the others
            rays = starts[first::steps]
            ray, hit, length = tree.hits(start[rays], -normals[own[rays]], reach)
            hit = across[hit]
            facing = np.einsum("ni,ni->n", normals[own[rays[ray]]], normals[hit]) < _FACING
            for k in np.flatnonzero(facing)[np.argsort(length[facing])].tolist():
                if sides.apart(face[own[rays[ray[k]]]], face[hit[k]]):
                    least = min(least, float(length[k]))
                    break
            reach = min(reach, least)
    return least


def _surface(shape: Any) -> tuple[FloatArray, IntArray, IntArray]:
    """Points of a solid (n, 3) [mm], its facets (m, 4) or (m, 3) and the number of their face."""
    if not isinstance(shape, Block):
        return shape.points, shape.triangles, shape.plane_of
    if not has_faces(shape):
        from geometry.polyhedra.polyhedron import Polyhedron

        quads = shape.boundary
        triangles = np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])
        solid = Polyhedron(shape.name, shape.mesh.nodes, triangles)
        return solid.points, triangles, solid.plane_of
    counts = [len(quads) for quads in shape.faces.values()]
    faces = np.repeat(np.arange(len(counts)), counts)
    return shape.mesh.nodes, np.concatenate(list(shape.faces.values())), faces


def has_faces(shape: Block) -> bool:
    """Whether a block has faces by name; hexahedra of files have one surface all round."""
    return len(shape.contact_faces) > 1


class _Sides:
    """Faces of a solid by their points."""

    def __init__(self, facets: IntArray, face: IntArray) -> None:
        order = np.argsort(face, kind="stable")
        ends = np.cumsum(np.bincount(face))[:-1]
        self._face = face
        self._facets = [facets[members] for members in np.split(order, ends)]
        self._points: dict[int, frozenset[int]] = {}

    def pairs(self) -> Iterator[tuple[IntArray, IntArray]]:
        """Faces, and the facets that may be across."""
        faces = np.arange(len(self._facets))
        if len(faces) > _FEW_FACES or len(self._face) < _MANY_FACETS:
            yield faces, np.arange(len(self._face))
            return
        for one in faces.tolist():
            across = [other for other in faces.tolist() if self.apart(one, other)]
            if across:
                yield faces[[one]], np.flatnonzero(np.isin(self._face, across))

    def apart(self, one: int, other: int) -> bool:
        """Whether two faces share no point."""
        return self._of(int(one)).isdisjoint(self._of(int(other)))

    def _of(self, face: int) -> frozenset[int]:
        if face not in self._points:
            self._points[face] = frozenset(self._facets[face].ravel().tolist())
        return self._points[face]


@dataclass(frozen=True)
class _Boxes:
    """Facets in a tree of boxes along a space-filling curve."""

    corners: FloatArray
    """Of the facets in the order of the curve, (n, 4, 3) or (n, 3, 3) [mm]."""
    order: IntArray
    """Number of each of these facets, (n,)."""
    levels: tuple[tuple[FloatArray, FloatArray], ...]
    """Lower and upper corners of the boxes, (m, 3) each [mm], from the root to the facets. Box k
    has the children 8 k to 8 k + 7 of the next level, as far as there are so many."""

    @classmethod
    def of(cls, corners: FloatArray) -> _Boxes:
        """Make the tree of some facets."""
        low, high = corners.min(axis=1), corners.max(axis=1)
        order = along_curve(0.5 * (low + high))
        levels = [(low[order], high[order])]
        while len(levels[0][0]) > 1:
            low, high = levels[0]
            first = np.arange(0, len(low), _FEW)
            boxes = np.minimum.reduceat(low, first), np.maximum.reduceat(high, first)
            levels.insert(0, boxes)
        return cls(corners[order], order, tuple(levels))

    def hits(
        self, start: FloatArray, direction: FloatArray, reach: float
    ) -> tuple[IntArray, IntArray, FloatArray]:
        """Ray, facet and distance [mm] of each hit within reach [mm] of some rays (n, 3)."""
        ray, box = np.arange(len(start)), np.zeros(len(start), dtype=np.int64)
        for depth, (low, high) in enumerate(self.levels):
            if depth:
                ray = np.repeat(ray, _FEW)
                box = (_FEW * box[:, None] + np.arange(_FEW)).ravel()
                there = box < len(low)
                ray, box = ray[there], box[there]
            near = _reaches((start, direction), reach, (low, high), ray, box)
            ray, box = ray[near], box[near]
        result = [
            (ray[met], self.order[box[met]], length)
            for met, length in self._met(start[ray], direction[ray], box, reach)
        ]
        rays, facets, lengths = zip(*result, strict=True)
        return np.concatenate(rays), np.concatenate(facets), np.concatenate(lengths)

    def _met(
        self, start: FloatArray, direction: FloatArray, facets: IntArray, reach: float
    ) -> Iterator[tuple[IntArray, FloatArray]]:
        """Rays that meet their facet, and where, of each triangle that facets consist of."""
        corners = self.corners[facets]
        for k in range(2, corners.shape[1]):
            origin = corners[:, 0]
            one, other = corners[:, k - 1] - origin, corners[:, k] - origin
            across, arm = np.cross(direction, other), start - origin
            volume = np.einsum("ni,ni->n", one, across)
            size = np.linalg.norm(one, axis=1) * np.linalg.norm(other, axis=1)
            volume[np.abs(volume) <= _ALONG * size] = np.nan
            turned = np.cross(arm, one)
            u = np.einsum("ni,ni->n", arm, across) / volume
            v = np.einsum("ni,ni->n", direction, turned) / volume
            length = np.einsum("ni,ni->n", other, turned) / volume
            inside = (u >= -_MISSED) & (v >= -_MISSED) & (u + v <= 1.0 + _MISSED)
            met = np.flatnonzero(inside & (length >= 0.0) & (length <= reach))
            yield met, length[met]


def _reaches(
    rays: tuple[FloatArray, FloatArray],
    reach: float,
    boxes: tuple[FloatArray, FloatArray],
    ray: IntArray,
    box: IntArray,
) -> BoolArray:
    """Whether rays get to boxes within reach [mm], of pairs (n,) of a ray and a box."""
    (start, direction), (low, high), margin = rays, boxes, _MISSED * reach
    enters, leaves = np.zeros(len(ray)), np.full(len(ray), reach)
    with np.errstate(divide="ignore", invalid="ignore"):
        for axis in range(3):  # columns by themselves: three times as fast as rows of three
            at, along = start[:, axis][ray], (1.0 / direction[:, axis])[ray]
            one = ((low[:, axis] - margin)[box] - at) * along
            other = ((high[:, axis] + margin)[box] - at) * along
            # Along a plane of a box 0 · ∞ says nothing: the other planes decide.
            np.fmax(enters, np.fmin(one, other), out=enters)
            np.fmin(leaves, np.fmax(one, other), out=leaves)
    return np.asarray(enters <= leaves)


def unit_vectors(vectors: FloatArray) -> FloatArray:
    """Vectors (…, 3) over their length; zero stays zero."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 0.0)
