"""What is built: volume, mass, contact area, least wall and steepest joint of the free blocks.

Of blocks that have an exact shape volume, contact area and slope are those of this shape, not of
the facets of a mesh.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from geometry.assembly import AnyBlocks, Assembly
from geometry.block import Block
from geometry.files.vtu import as_surface
from geometry.mesh import BoolArray, FloatArray, IntArray
from geometry.meshing.charts import facet_corners
from geometry.polyhedra.polyhedron import Polyhedron

#: Units of `Dimensions` as plain data.
UNITS = {
    "block_volume": "mm³",
    "volume": "mm³",
    "mass": "t",
    "contact_area": "mm²",
    "least_wall": "mm",
    "steepest_joint": "degrees",
}
#: Two surfaces are the sides of a wall where their outward normals differ by more than 120°.
_FACING = -0.5
#: Cosine of 10°.
_NEARLY = 0.985
#: Points of Gauss' rule along each side of a facet.
_GAUSS = 6
#: Step of tangents as differences of fourth order, in units of half a facet.
_STEP = 1e-3
#: Sine of an angle that is round-off.
_FLAT = 1e-10
#: Points along each side of a facet where its slope is looked for, and how often the places round
#: the steepest are looked at closer.
_LOOKED, _CLOSER = 5, 12


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
    """Smallest distance between two sides of a block, along the inward normal at the centroid of a
    facet [mm]. Sides are faces that share no edge, with outward normals that differ by more than
    120°; None where no block has such."""
    steepest_joint: float | None
    """Largest angle between a joint face and its mean plane [degrees].
    The mean plane is normal to the axis of the assembly where it differs by less than 10°. None
    for blocks without named faces."""
    mass: float | None = None
    """Of all free blocks [t]; None where no density is given."""

    def as_json(self) -> dict[str, Any]:
        """Plain data with units."""
        least, largest = self.block_volume
        volumes = {"smallest": least, "largest": largest}
        known = {name: getattr(self, name) for name in UNITS if getattr(self, name) is not None}
        return known | {"block_volume": volumes, "units": {name: UNITS[name] for name in known}}


def dimensions(
    blocks: AnyBlocks,
    density: float | FloatArray | None = None,
    contact_area: float | None = None,
) -> Dimensions:
    """Measure the free blocks.

    Parameters
    ----------
    blocks
        All blocks.
    density
        Of all blocks, or of each one, (n_blocks,) [t/mm³].
    contact_area
        Of all joints, each once, where facets do not match [mm²]; None: of the facets that match.
    """
    free = blocks.free_blocks
    _, first, which = np.unique(blocks.shape_of[free], return_index=True, return_inverse=True)
    shapes = [blocks.shape(block) for block in free[first]]
    volumes = np.array([_volume(shape) for shape in shapes])[which]
    angles = []
    if isinstance(blocks, Assembly):
        angles = [
            steepest_joint(shape, blocks.rotations[block].T @ blocks.axis)
            for block, shape in zip(free[first], shapes, strict=True)
        ]
    wall, mass = min(map(least_wall, shapes)), None
    if density is not None:
        each = np.broadcast_to(density, blocks.n_blocks)[free]
        mass = float(volumes @ each)
    return Dimensions(
        block_volume=(float(volumes.min()), float(volumes.max())),
        volume=float(volumes.sum()),
        contact_area=_contact_area(blocks) if contact_area is None else contact_area,
        least_wall=wall if np.isfinite(wall) else None,
        steepest_joint=max((angle for angle in angles if angle is not None), default=None),
        mass=mass,
    )


def _volume(shape: Any) -> float:
    """Volume of a solid [mm³]: a third of the flux of its points through its surface."""
    if not isinstance(shape, Block) or shape.curve is None:
        return float(shape.volume)
    points, vectors = _gauss_points(_exact(shape, shape.boundary), len(shape.boundary))
    return float(np.einsum("nqi,nqi->", points, vectors)) / 3.0


def _contact_area(blocks: AnyBlocks) -> float:
    """Area of the joints of an assembly that are not between two fixed blocks [mm²]."""
    if not isinstance(blocks, Assembly):
        return float(blocks.interfaces.areas[_of_free_blocks(blocks)].sum())
    joints, counts = blocks.interfaces, _of_free_blocks(blocks)
    area, shape_of = 0.0, blocks.shape_of[joints.block_m]
    for number in np.unique(shape_of[counts]).tolist():
        shape = blocks.shapes[number]
        quads = shape.contact_quads
        _, vectors = _gauss_points(_exact(shape, quads), len(quads))
        each = np.linalg.norm(vectors, axis=2).sum(axis=1)
        area += float(each[joints.facet_m[counts & (shape_of == number)]].sum())
    return area


def _of_free_blocks(blocks: AnyBlocks) -> BoolArray:
    """Whether one block at least of each contact is free, (n_contacts,)."""
    joints = blocks.interfaces
    return np.asarray(~(blocks.fixed[joints.block_m] & blocks.fixed[joints.block_s]))


def _exact(shape: Block, quads: IntArray) -> Callable[[FloatArray], FloatArray]:
    """Map places (n, q, 2) of facets, -1 to 1, to points of the shape, (n, q, 3) [mm]."""
    corners = shape.mesh.nodes[quads]
    if shape.curve is not None:
        element, corner = facet_corners(shape.mesh, quads)
        corners = shape.curve.parameters()[element[:, None], corner]

    def points(places: FloatArray) -> FloatArray:
        signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        weights = (1.0 + places[..., None, :] * signs).prod(axis=3) / 4.0
        at = weights @ corners
        if shape.curve is None:
            return at
        return shape.curve.shape(at.reshape(-1, at.shape[2])).reshape(*at.shape[:2], 3)

    return points


def _vectors(points: Callable[[FloatArray], FloatArray], places: FloatArray) -> FloatArray:
    """Outward normals at places of facets, their length the area of a unit square, (n, q, 3)."""
    tangents = []
    for step in _STEP * np.eye(2):
        near, far = (points(places + k * step) - points(places - k * step) for k in (1, 2))
        tangents.append((8.0 * near - far) / (12.0 * _STEP))
    along, across = tangents
    return np.cross(along, across)


def _gauss_points(
    points: Callable[[FloatArray], FloatArray], n: int
) -> tuple[FloatArray, FloatArray]:
    """Points of n facets of the exact shape, and the vectors of their areas, (n, q, 3) each."""
    at, weights = np.polynomial.legendre.leggauss(_GAUSS)
    places = np.broadcast_to(_square(at, at), (n, _GAUSS**2, 2))
    return points(places), np.outer(weights, weights).ravel()[:, None] * _vectors(points, places)


def _square(along: FloatArray, across: FloatArray) -> FloatArray:
    """All pairs of two lists of places, (n, 2)."""
    return np.stack(np.meshgrid(along, across, indexing="ij"), axis=2).reshape(-1, 2)


def least_wall(shape: Any) -> float:
    """Smallest distance between two sides of a solid (`Dimensions.least_wall`), or ∞ [mm]."""
    from vtkmodules.vtkCommonCore import vtkIdList, vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkStaticCellLocator

    points, quads, face = _surface(shape)
    corners = points[quads]
    normals = _units(np.cross(corners[:, 2] - corners[:, 0], corners[:, -1] - corners[:, 1]))
    halves = [quads[:, :3], quads[:, [0, 2, 3]]] if quads.shape[1] == 4 else [quads]
    locator = vtkStaticCellLocator()
    locator.SetDataSet(as_surface(points, np.concatenate(halves)))
    locator.BuildLocator()
    touched, of_facet = _points_of_faces(quads, face), face.tolist()

    @cache
    def apart(one: int, other: int) -> bool:
        return touched[one].isdisjoint(touched[other])

    reach = size = float(np.linalg.norm(np.ptp(points, axis=0)))
    least, places, cells = np.inf, vtkPoints(), vtkIdList()
    for own, start, normal in zip(of_facet, corners.mean(axis=1), normals, strict=True):
        locator.IntersectWithLine(start, start - reach * normal, 1e-9 * size, places, cells)
        for i in range(cells.GetNumberOfIds()):
            hit = cells.GetId(i) % len(quads)
            if apart(own, of_facet[hit]) and normals[hit] @ normal < _FACING:
                least = min(least, float(np.linalg.norm(start - places.GetPoint(i))))
        reach = min(reach, least)
    return least


def _surface(shape: Any) -> tuple[FloatArray, IntArray, IntArray]:
    """Points of a solid (n, 3) [mm], its facets (m, 4) or (m, 3) and the number of their face."""
    if not isinstance(shape, Block):
        return shape.points, shape.triangles, shape.plane_of
    if not _has_faces(shape):
        quads = shape.boundary
        triangles = np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])
        whole = Polyhedron(shape.name, shape.mesh.nodes, triangles)
        return whole.points, triangles, whole.plane_of
    counts = [len(quads) for quads in shape.faces.values()]
    faces = np.repeat(np.arange(len(counts)), counts)
    return shape.mesh.nodes, np.concatenate(list(shape.faces.values())), faces


def _has_faces(shape: Block) -> bool:
    """Whether a block has faces by name; hexahedra of files have one surface all round."""
    return len(shape.contact_faces) > 1


def _points_of_faces(facets: IntArray, face: IntArray) -> list[set[int]]:
    """Points of each face."""
    points: list[set[int]] = [set() for _ in range(int(face.max()) + 1)]
    for number, corners in zip(face.tolist(), facets.tolist(), strict=True):
        points[number].update(corners)
    return points


def steepest_joint(shape: Any, axis: FloatArray) -> float | None:
    """Largest angle of a joint face of a block to its mean plane [degrees]; None without faces.

    ``axis`` is that of the assembly in the reference position of the block, (3,).
    """
    if not isinstance(shape, Block) or not _has_faces(shape):
        return None
    return max(_steepest(shape, shape.faces[name], axis) for name in shape.contact_faces)


def _steepest(shape: Block, quads: IntArray, axis: FloatArray) -> float:
    """Largest angle of a face to its mean plane [degrees]."""
    every = _exact(shape, quads)
    mean = _units(_gauss_points(every, len(quads))[1].sum(axis=(0, 1)))
    if abs(mean @ axis) > _NEARLY:
        mean = axis

    def steepness(points: Callable[[FloatArray], FloatArray], places: FloatArray) -> FloatArray:
        normals = _units(_vectors(points, places))
        return np.asarray(np.linalg.norm(np.cross(normals, mean), axis=2))

    looked = np.linspace(-1.0, 1.0, _LOOKED)
    places = np.broadcast_to(_square(looked, looked), (len(quads), _LOOKED**2, 2))
    sines = steepness(every, places)
    facet, best = np.unravel_index(sines.argmax(), sines.shape)
    at, half, one = places[facet, best], looked[1] - looked[0], _exact(shape, quads[[facet]])
    for _ in range(_CLOSER):
        near = np.clip(at + half * _square(looked, looked), -1.0, 1.0)[None]
        sines = steepness(one, near)
        at, half = near[0, sines[0].argmax()], half * (looked[1] - looked[0])
    largest = float(sines.max())
    return float(np.degrees(np.arcsin(min(largest, 1.0)))) if largest > _FLAT else 0.0


def _units(vectors: FloatArray) -> FloatArray:
    """Vectors (…, 3) over their length; zero stays zero."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 0.0)
