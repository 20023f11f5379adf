"""What is built: volume, mass, contact area, least wall and steepest joint of the free blocks."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from geometry.assembly import AnyBlocks, Assembly
from geometry.block import Block
from geometry.files.vtu import as_surface
from geometry.mesh import FloatArray, IntArray
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


@dataclass(frozen=True)
class Dimensions:
    """Dimensions of the free blocks of an assembly."""

    block_volume: tuple[float, float]
    """Smallest and largest volume of a block [mm³]."""
    volume: float
    """Of all free blocks [mm³]."""
    contact_area: float
    """Of all joints, each once [mm²]."""
    least_wall: float | None
    """Smallest distance between two sides of a block, along the inward normal at the centroid of a
    facet [mm]. Sides are faces that share no edge, with outward normals that differ by more than
    120°; None where no block has such."""
    steepest_joint: float | None
    """Largest angle between a facet, or its edge, and the mean plane of its joint face [degrees].
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
    volumes = blocks.volumes[free]
    _, first = np.unique(blocks.shape_of[free], return_index=True)
    shapes = [blocks.shape(block) for block in free[first]]
    angles = []
    if isinstance(blocks, Assembly):
        angles = [
            steepest_joint(shape, blocks.rotations[block].T @ blocks.axis)
            for block, shape in zip(free[first], shapes, strict=True)
        ]
    wall, mass = min(map(least_wall, shapes)), None
    if density is not None:
        mass = float((blocks.volumes * density)[free].sum())
    return Dimensions(
        block_volume=(float(volumes.min()), float(volumes.max())),
        volume=float(volumes.sum()),
        contact_area=float(blocks.interfaces.areas.sum() if contact_area is None else contact_area),
        least_wall=wall if np.isfinite(wall) else None,
        steepest_joint=max((angle for angle in angles if angle is not None), default=None),
        mass=mass,
    )


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
    faces = (shape.faces[name] for name in shape.contact_faces)
    return max(_steepest(shape.mesh.nodes[quads], axis) for quads in faces)


def _steepest(corners: FloatArray, axis: FloatArray) -> float:
    """Largest angle of some facets (n, 4, 3) or their edges to their mean plane [degrees]."""
    vectors = 0.5 * np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    mean = _units(vectors.sum(axis=0))
    if abs(mean @ axis) > _NEARLY:
        mean = axis
    edges = (np.roll(corners, -1, axis=1) - corners).reshape(-1, 3)
    along = np.abs(_units(edges) @ mean).max()
    tilt = np.abs(_units(vectors) @ mean).min()
    return float(np.degrees(max(np.arcsin(min(along, 1.0)), np.arccos(min(tilt, 1.0)))))


def _units(vectors: FloatArray) -> FloatArray:
    """Vectors (…, 3) over their length; zero stays zero."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 0.0)
