"""What is built: volume, mass, contact area, least wall and steepest joint of the free blocks.

Of blocks that have an exact shape volume, contact area and slope are those of this shape, not of
the facets of a mesh. Walls are measured by rays inward from facets to the sides across.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from geometry.assembly import Assembly
from geometry.block import Block, facet_corners
from geometry.mesh import (
    BoolArray,
    FloatArray,
    IntArray,
    along_curve,
    cross,
    lengths,
    row_keys,
)
from geometry.parts.placed import AnyBlocks
from geometry.parts.rows import Row, grouped

#: Units of `Dimensions` as plain data.
UNITS = {
    "block_volume": "mm³",
    "volume": "mm³",
    "mass": "t",
    "contact_area": "mm²",
    "least_wall": "mm",
    "steepest_joint": "degrees",
}
#: Cosine of 10°.
_NEARLY = 0.985
#: Points of Gauss' rule along each side of a facet: of few facets, and of many, which are small.
_GAUSS, _GAUSS_OF_MANY = 6, 4
#: Facets of a face that are many.
_MANY = 300
#: Elements of each part of a block, such as a wave, over whose surface its volume is integrated.
_FEW = 4
#: Step of tangents as differences of fourth order, in units of half a facet.
_STEP = 1e-3
#: Sine of an angle that is round-off.
_FLAT = 1e-10
#: Natural coordinates of the corners of a facet.
_ALONG, _ACROSS = np.array([[-1.0, 1.0, 1.0, -1.0], [-1.0, -1.0, 1.0, 1.0]])
#: Points along each side of a facet where its slope is looked for, and how often the places round
#: the steepest are looked at closer.
_LOOKED, _CLOSER = 5, 12
#: Facets that are looked at so: those that are steepest at Gauss points.
_STEEP = 64


@dataclass(frozen=True)
class Dimensions:
    """Dimensions of the free blocks of an assembly."""

    block_volume: tuple[float, float]
    """Smallest and largest volume of a block [mm³]."""
    volume: float
    """Of all free blocks [mm³]."""
    contact_area: float
    """Of all joints of which one block at least is free, each once [mm²]."""
    least_wall: float | None
    """Smallest distance between two sides of a block, along the inward normal at a corner or the
    centroid of a facet [mm]. Sides are faces that share no edge, with outward normals that differ
    by more than 120°; None where no block has such."""
    steepest_joint: float | None
    """Largest angle between a joint face and its mean plane [degrees].
    The mean plane is normal to the axis of the assembly where it differs by less than 10°. None
    for blocks without named faces."""
    mass: float | None = None
    """Of all free blocks [t]; None where no density is given."""
    closed: bool = False
    """Whether the contact area is what touches in a state, not what faces another as built."""

    @property
    def volume_words(self) -> str:
        """Volume of a block and of all, with their mass where it is known."""
        least, largest = (f"{volume:.5g}" for volume in self.block_volume)
        each = f"{least} mm³" if least == largest else f"{least} to {largest} mm³"
        words = f"{each} per block, {self.volume:.5g} mm³ in all"
        return words if self.mass is None else f"{words}, {1e3 * self.mass:.4g} kg"

    def as_json(self) -> dict[str, Any]:
        """Plain data with units."""
        least, largest = self.block_volume
        volumes = {"smallest": least, "largest": largest}
        known = {name: getattr(self, name) for name in UNITS if getattr(self, name) is not None}
        units = {name: UNITS[name] for name in known}
        return known | {"closed": self.closed, "block_volume": volumes, "units": units}


@dataclass(frozen=True)
class Limits:
    """What can be built; None: any."""

    least_wall: float | None = None
    """Smallest wall that can be cast [mm]."""
    steepest_joint: float | None = None
    """Largest angle of a joint to its mean plane that can be cast [degrees]."""

    def rows(self, found: Dimensions) -> list[Row]:
        """Volume, mass, contact area, least wall and steepest joint, and which exceed a limit."""
        area, wall, angle = found.contact_area, found.least_wall, found.steepest_joint
        of = "closed at the end" if found.closed else "each joint of a free block once"
        rows = [
            Row("volume", found.volume_words, found.volume, "mm³"),
            Row("contact area", f"{area:.5g} mm², {of}", area, "mm²"),
        ]
        if wall is not None:
            words = f"{wall:.4g} mm"
            if self.least_wall is not None and wall < self.least_wall:
                words += f": TOO THIN, limits.least_wall is {self.least_wall:g} mm"
            rows.append(Row("least wall of a block", words, wall, "mm"))
        if angle is not None:
            words = f"{angle:.3g}° to its mean plane"
            if self.steepest_joint is not None and angle > self.steepest_joint:
                words += f": TOO STEEP, limits.steepest_joint is {self.steepest_joint:g}°"
            rows.append(Row("steepest joint", words, angle, "degrees"))
        elif self.steepest_joint is not None:
            words = "not known of blocks without named faces: not checked"
            rows.append(Row("steepest joint", words))
        return rows


@dataclass(frozen=True)
class Built:
    """Part of an answer: the dimensions of its blocks, measured when they are first read."""

    measure: Callable[[], Dimensions]
    limits: Limits = Limits()

    @cached_property
    def dimensions(self) -> Dimensions:
        """What is measured."""
        return self.measure()

    @property
    def rows(self) -> list[Row]:
        """Those of `Limits`."""
        return grouped(model=self.limits.rows(self.dimensions))

    def as_json(self) -> dict[str, Any]:
        """Return plain data with units."""
        return self.dimensions.as_json()


def dimensions(
    blocks: AnyBlocks,
    density: float | FloatArray | None = None,
    closed_area: float | None = None,
) -> Dimensions:
    """Measure the free blocks.

    Parameters
    ----------
    blocks
        All blocks.
    density
        Of all blocks, or of each one, (n_blocks,) [t/mm³].
    closed_area
        Of what touches in a state, where facets do not match [mm²]; None: of the facets that match.
    """
    free = blocks.free_blocks
    _, first, which = np.unique(blocks.shape_of[free], return_index=True, return_inverse=True)
    shapes = [blocks.shape(block) for block in free[first]]
    samples = _Samples()
    volumes = np.array(list(map(_volume, shapes)))[which]
    angles = []
    if isinstance(blocks, Assembly):
        angles = [
            _steepest_joint(shape, blocks.rotations[block].T @ blocks.axis, samples)
            for block, shape in zip(free[first], shapes, strict=True)
        ]
    wall, mass = min(map(least_wall, shapes)), None
    area = _contact_area(blocks, samples) if closed_area is None else closed_area
    if density is not None:
        each = np.broadcast_to(density, blocks.n_blocks)[free]
        mass = float(volumes @ each)
    return Dimensions(
        block_volume=(float(volumes.min()), float(volumes.max())),
        volume=float(volumes.sum()),
        contact_area=area,
        closed=closed_area is not None,
        least_wall=wall if np.isfinite(wall) else None,
        steepest_joint=max((angle for angle in angles if angle is not None), default=None),
        mass=mass,
    )


class _Samples:
    """Gauss points of the faces of blocks: contact area and slope are of the same."""

    def __init__(self) -> None:  # by the id of shapes: they outlive the samples
        self._known: dict[tuple[int, str], tuple[FloatArray, FloatArray]] = {}
        self._parameters: dict[int, FloatArray] = {}

    def of(self, shape: Block, face: str) -> tuple[FloatArray, FloatArray]:
        """Points and vectors of areas of a face, (n, q, 3) each; see `_gauss_points`."""
        key = id(shape), face
        if key not in self._known:
            self._known[key] = self.on(shape, shape.faces[face])
        return self._known[key]

    def on(self, shape: Block, quads: IntArray) -> tuple[FloatArray, FloatArray]:
        """Points of facets of the exact shape, and the vectors of their areas, (n, q, 3) each."""
        rule = np.polynomial.legendre.leggauss(_GAUSS if len(quads) < _MANY else _GAUSS_OF_MANY)
        places, weights = _square(rule[0], rule[0])[None], np.outer(rule[1], rule[1]).ravel()
        parts = []
        for first in range(0, len(quads), _MANY):
            points = self.exact(shape, quads[first : first + _MANY])
            parts.append((points(places), weights[:, None] * _vectors(points, places)))
        at, vectors = zip(*parts, strict=True)
        return np.concatenate(at), np.concatenate(vectors)

    def exact(self, shape: Block, quads: IntArray) -> Callable[[FloatArray], FloatArray]:
        """Map places (n, q, 2) of facets, -1 to 1, to points of the shape, (n, q, 3) [mm].

        Places (1, q, 2) are those of every facet.
        """
        curve, corners = shape.curve, shape.mesh.nodes[quads]
        if curve is not None:
            if id(shape) not in self._parameters:
                self._parameters[id(shape)] = curve.parameters()
            element, corner = facet_corners(shape.mesh, quads)
            corners = self._parameters[id(shape)][element[:, None], corner]

        def points(places: FloatArray) -> FloatArray:
            along, across = places[..., None, 0], places[..., None, 1]
            at = ((1.0 + along * _ALONG) * (1.0 + across * _ACROSS) / 4.0) @ corners
            if curve is None:
                return at
            return curve.shape(at.reshape(-1, at.shape[2])).reshape(*at.shape[:2], 3)

        return points


def _volume(shape: Any) -> float:
    """Volume of a solid [mm³]: a third of the flux of its points through its surface."""
    if not isinstance(shape, Block) or shape.curve is None:
        return float(shape.volume)
    if shape.charts is not None:  # few elements have the same volume: they have the exact shape
        parts, lines = shape.charts.parts, shape.charts.lines
        few = (min(len(line), _FEW * n + 1) for line, n in zip(lines, parts, strict=True))
        first, second, third = (np.linspace(0.0, 1.0, n) for n in few)
        shape = shape.charts.build((first, second, third))
    return float(np.einsum("nqi,nqi->", *_Samples().on(shape, shape.boundary))) / 3.0


def _contact_area(blocks: AnyBlocks, samples: _Samples) -> float:
    """Area of the joints of an assembly that are not between two fixed blocks [mm²]."""
    if not isinstance(blocks, Assembly):
        return float(blocks.interfaces.areas[_of_free_blocks(blocks)].sum())
    joints, counts = blocks.interfaces, _of_free_blocks(blocks)
    area, shape_of = 0.0, blocks.shape_of[joints.block_m]
    for number in np.unique(shape_of[counts]).tolist():
        shape = blocks.shapes[number]
        faces = [samples.of(shape, face)[1] for face in shape.contact_faces]
        each = np.concatenate([lengths(face).sum(axis=1) for face in faces])
        area += float(each[joints.facet_m[counts & (shape_of == number)]].sum())
    return area


def _of_free_blocks(blocks: AnyBlocks) -> BoolArray:
    """Whether one block at least of each contact is free, (n_contacts,)."""
    joints = blocks.interfaces
    return np.asarray(~(blocks.fixed[joints.block_m] & blocks.fixed[joints.block_s]))


def _vectors(points: Callable[[FloatArray], FloatArray], places: FloatArray) -> FloatArray:
    """Outward normals at places of facets, their length the area of a unit square, (n, q, 3)."""
    # All steps at once: each call of an exact shape has its own cost.
    steps = _STEP * np.array([1.0, -1.0, 2.0, -2.0])
    moved = places[:, None, None] + (np.eye(2)[:, None] * steps[:, None])[:, :, None]
    at = points(moved.reshape(len(places), -1, 2))
    at = at.reshape(len(at), 2, 4, -1, 3)
    near, far = at[:, :, 0] - at[:, :, 1], at[:, :, 2] - at[:, :, 3]
    tangents = (8.0 * near - far) / (12.0 * _STEP)
    return cross(tangents[:, 0], tangents[:, 1])


def _square(along: FloatArray, across: FloatArray) -> FloatArray:
    """All pairs of two lists of places, (n, 2)."""
    return np.stack(np.meshgrid(along, across, indexing="ij"), axis=2).reshape(-1, 2)


def _steepest_joint(shape: Any, axis: FloatArray, samples: _Samples) -> float | None:
    """Largest angle of a joint face of a block to its mean plane [degrees]; None without faces.

    ``axis`` is that of the assembly in the reference position of the block, (3,).
    """
    if not isinstance(shape, Block) or not has_faces(shape):
        return None
    return max(_steepest(shape, face, axis, samples) for face in shape.contact_faces)


def _steepest(shape: Block, face: str, axis: FloatArray, samples: _Samples) -> float:
    """Largest angle of a face to its mean plane [degrees]."""
    quads, vectors = shape.faces[face], samples.of(shape, face)[1]
    mean = unit_vectors(vectors.sum(axis=(0, 1)))
    if abs(mean @ axis) > _NEARLY:
        mean = axis

    def steepness(vectors: FloatArray) -> FloatArray:
        return lengths(cross(unit_vectors(vectors), mean))

    steepest = steepness(vectors).max(axis=1)
    if steepest.max() <= _FLAT:
        return 0.0
    steep = np.argsort(-steepest, kind="stable")[:_STEEP]
    looked = np.linspace(-1.0, 1.0, _LOOKED)
    places = _square(looked, looked)[None]
    sines = steepness(_vectors(samples.exact(shape, quads[steep]), places))
    facet, best = np.unravel_index(sines.argmax(), sines.shape)
    at, half = places[0, best], looked[1] - looked[0]
    one = samples.exact(shape, quads[steep[[facet]]])
    for _ in range(_CLOSER):
        near = np.clip(at + half * _square(looked, looked), -1.0, 1.0)[None]
        sines = steepness(_vectors(one, near))
        at, half = near[0, sines[0].argmax()], half * (looked[1] - looked[0])
    return float(np.degrees(np.arcsin(min(sines.max(), 1.0))))


# ---------------------------------------------------------------------------------------------
# Walls

#: Two surfaces are the sides of a wall where their outward normals differ by more than 120°.
_FACING = -0.5
#: Children of a node of the tree of boxes.
_CHILDREN = 8
#: So few faces, of so many facets, are taken one by one, each against what is across.
_FEW_FACES, _MANY_FACETS = 8, 300
#: Rays that are followed at once.
_RAYS = 1024
#: What a ray may miss a facet or a box by, over their size: round-off at edges between facets.
_MISSED = 1e-9
#: Directions along a plane, over the product of its edges: no ray meets it.
_PARALLEL = 1e-12


def least_wall(shape: Any) -> float:
    """Smallest distance between two sides of a solid (`Dimensions.least_wall`), or ∞ [mm].

    Between flat sides it is linear: rays from their corners find it, whatever the facets.
    """
    points, facets, face = _surface(shape)
    corners = points[facets]
    normals = unit_vectors(cross(corners[:, 2] - corners[:, 0], corners[:, -1] - corners[:, 1]))
    sides = _Sides(facets, face)
    # Corners of a face once, each with one of its facets.
    every = np.column_stack([np.repeat(face, facets.shape[1]), facets.ravel()])
    _, corner = np.unique(row_keys(every), return_index=True)
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
            first = np.arange(0, len(low), _CHILDREN)
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
                ray = np.repeat(ray, _CHILDREN)
                box = (_CHILDREN * box[:, None] + np.arange(_CHILDREN)).ravel()
                there = box < len(low)
                ray, box = ray[there], box[there]
            near = _reaches((start, direction), reach, (low, high), ray, box)
            ray, box = ray[near], box[near]
        result = [
            (ray[met], self.order[box[met]], length)
            for met, length in self._met(start[ray], direction[ray], box, reach)
        ]
        rays, facets, far = zip(*result, strict=True)
        return np.concatenate(rays), np.concatenate(facets), np.concatenate(far)

    def _met(
        self, start: FloatArray, direction: FloatArray, facets: IntArray, reach: float
    ) -> Iterator[tuple[IntArray, FloatArray]]:
        """Rays that meet their facet, and where, of each triangle that facets consist of."""
        corners = self.corners[facets]
        for k in range(2, corners.shape[1]):
            origin = corners[:, 0]
            one, other = corners[:, k - 1] - origin, corners[:, k] - origin
            across, arm = cross(direction, other), start - origin
            volume = np.einsum("ni,ni->n", one, across)
            size = lengths(one) * lengths(other)
            volume[np.abs(volume) <= _PARALLEL * size] = np.nan
            turned = cross(arm, one)
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
    size = lengths(vectors)[..., None]
    return np.divide(vectors, size, out=np.zeros_like(vectors), where=size > 0.0)
