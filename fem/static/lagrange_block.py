"""A curved block of high degree seen from the points of its contact faces.

A block follows from the forces q on its contact points, pushed inwards along the normals ν, and
from its loads f up to a rigid motion,

    ν · u = -F q + h + b α      with  F = B G Bᵀ,  h = B G f,  b = B R,

where B takes nodes to points, G is a flexibility for forces in balance and R are its rigid motions.
All congruent blocks share F, h and b, and nothing else of a block appears in the contact problem.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array, vstack

from fem.element.lagrange import LagrangeElement, TensorPoints, gauss_line, tensor_points
from fem.problem.model import rigid_motions
from fem.static.linear_step.columns import ColumnBlock, FlexibleBlock, flexible_block
from geometry.mesh import BoolArray, FloatArray, IntArray

#: Direction across a face and the end of it, by name; the others span it in their order.
FACES = {
    "inner": (0, 0),
    "outer": (0, 1),
    "left": (1, 0),
    "right": (1, 1),
    "bottom": (2, 0),
    "top": (2, 1),
}


@dataclass(frozen=True)
class Lattice:
    """A block of curved hexahedra, structured in three directions."""

    element: LagrangeElement
    """Degree and material."""
    lines: tuple[FloatArray, FloatArray, FloatArray]
    """Ends of the elements in each direction, ascending, in the parameters of the shape."""
    shape: Callable[[FloatArray, FloatArray, FloatArray], FloatArray]
    """Points of parameters, three arrays to (..., 3) [mm]; right-handed in their order."""

    @property
    def counts(self) -> tuple[int, int, int]:
        """Elements in each direction."""
        n_1, n_2, n_3 = (len(line) - 1 for line in self.lines)
        return n_1, n_2, n_3

    @cached_property
    def nodes(self) -> FloatArray:
        """Grid of all nodes, (n_1, n_2, n_3, 3) [mm]."""
        places = (self.element.nodes_between(line) for line in self.lines)
        return self.shape(*np.meshgrid(*places, indexing="ij"))

    def at(
        self,
        values: FloatArray,
        places: tuple[FloatArray, FloatArray, FloatArray],
        *,
        slope: int | None = None,
    ) -> FloatArray:
        """Values (n_nodes, m) of nodes at a grid of parameters, (n_1, n_2, n_3, m).

        With ``slope`` derivatives by the parameter of that direction instead.
        """
        found = values.reshape(*self.nodes.shape[:3], -1)
        for axis, (line, place) in enumerate(zip(self.lines, places, strict=True)):
            matrix = self.element.interpolation(line, place, slopes=axis == slope)
            found = np.moveaxis(np.tensordot(matrix, found, (1, axis)), 0, axis)
        return found

    @property
    def positions(self) -> FloatArray:
        """Nodes one after the other, (n_nodes, 3) [mm]."""
        return self.nodes.reshape(-1, 3)

    @cached_property
    def numbers(self) -> IntArray:
        """Number of each node of the grid."""
        shape = self.nodes.shape[:3]
        return np.arange(int(np.prod(shape)), dtype=np.int64).reshape(shape)

    @cached_property
    def elements(self) -> IntArray:
        """Nodes of each element, (n_elements, (degree + 1)³)."""
        return windows(self.numbers, self.counts, self.element.degree)

    def face(self, name: str) -> IntArray:
        """Nodes of the elements' faces on a face of the block, (n, (degree + 1)²)."""
        direction, end = FACES[name]
        numbers = np.take(self.numbers, -end, axis=direction)
        counts = tuple(c for k, c in enumerate(self.counts) if k != direction)
        return windows(numbers, counts, self.element.degree)

    def face_points(self, name: str, at: TensorPoints) -> FacePoints:
        """Points on a face of the block, element by element."""
        quads = self.face(name)
        positions, normals, area = outward_points(self.positions[quads], name, at)
        return FacePoints(
            quads=quads,
            values=at.values,
            positions=positions,
            normals=normals,
            weights=area * at.weights,
        )


def windows(numbers: IntArray, counts: tuple[int, ...], degree: int) -> IntArray:
    """Nodes of structured elements of a grid of numbers, last direction fastest."""
    dimension = len(counts)
    found = np.lib.stride_tricks.sliding_window_view(numbers, (degree + 1,) * dimension)
    chosen = found[tuple(slice(None, None, degree) for _ in range(dimension))]
    return np.ascontiguousarray(chosen.reshape(int(np.prod(counts)), -1))


def outward_points(
    corners: FloatArray, name: str, at: TensorPoints
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Positions, outward normals and areas of points of facets of a face.

    From the nodes of each facet, (n, n_functions, 3) [mm]: (n, n_points, 3) [mm], the same [-], and
    areas by the facet's own coordinates, (n, n_points) [mm²].
    """
    direction, end = FACES[name]
    tangents = np.einsum("qai,pak->qpki", corners, at.slopes, optimize=True)
    outward = np.cross(tangents[:, :, 0], tangents[:, :, 1])
    # The two directions of a face in their order turn with the third, but for the middle one.
    outward *= (1.0 if end else -1.0) * (-1.0 if direction == 1 else 1.0)
    area = np.linalg.norm(outward, axis=2)
    positions = np.einsum("pa,qai->qpi", at.values, corners, optimize=True)
    return positions, outward / area[:, :, None], area


@dataclass(frozen=True)
class FacePoints:
    """Points on one face of a block."""

    quads: IntArray
    """Nodes of the elements' faces, (n_quads, n_functions)."""
    values: FloatArray
    """Functions at the points of a quad, (n_points, n_functions)."""
    positions: FloatArray
    """(n_quads, n_points, 3) [mm]"""
    normals: FloatArray
    """Outward, (n_quads, n_points, 3)."""
    weights: FloatArray
    """Areas, (n_quads, n_points) [mm²]; zero where the points are no quadrature."""

    def outward(self, n_nodes: int) -> csr_array:
        """ν · u of all points as a matrix on nodal displacements, (n, 3 n_nodes)."""
        n_quads, n_functions = self.quads.shape
        n_points = len(self.values)
        entries = np.einsum("pa,qpi->qpai", self.values, self.normals)
        columns = 3 * self.quads[:, None, :, None] + np.arange(3)
        columns = np.broadcast_to(columns, (n_quads, n_points, n_functions, 3))
        pointer = 3 * n_functions * np.arange(n_quads * n_points + 1)
        return csr_array(
            (entries.ravel(), columns.ravel(), pointer), (n_quads * n_points, 3 * n_nodes)
        )


@dataclass(frozen=True)
class ContactPoints:
    """Quadrature points of the contact faces of a block, face by face."""

    lattice: Lattice
    """The block."""
    faces: dict[str, FacePoints]
    """Points of each face."""
    start: dict[str, int]
    """First point of each face among all points."""
    outward: csr_array
    """B on all nodes, (n_points, 3 n_nodes)."""

    @property
    def per_quad(self) -> int:
        """Points of a quad."""
        return len(next(iter(self.faces.values())).values)


def contact_points(lattice: Lattice, contact_faces: tuple[str, ...]) -> ContactPoints:
    """Points of the contact faces: two more than the degree in each direction of a quad.

    A steep law of a polynomial is no polynomial.
    """
    degree = lattice.element.degree
    at = tensor_points(degree, *gauss_line(degree + 2), dimension=2)
    faces = {name: lattice.face_points(name, at) for name in contact_faces}
    starts = np.cumsum([0, *(f.weights.size for f in faces.values())])[:-1].tolist()
    n_nodes = len(lattice.positions)
    outward = csr_array(vstack([f.outward(n_nodes) for f in faces.values()]))
    return ContactPoints(lattice, faces, dict(zip(faces, starts, strict=True)), outward)


def lattice_motions(positions: FloatArray) -> FloatArray:
    """Translations, and rotations about the middle over the size, (3 n, 6)."""
    arm = (positions - positions.mean(axis=0)) / np.ptp(positions, axis=0).max()
    return rigid_motions(arm).reshape(-1, 6)


@dataclass(frozen=True)
class FreeBlock:
    """A block in the forces on its contact points."""

    points: ContactPoints
    """All of them."""
    flexible: FlexibleBlock
    """G, and F between the points that were asked for."""
    rigid: FloatArray
    """R of all nodes, (3 n_nodes, 6)."""
    motions: FloatArray
    """b, (n_points, 6)."""


def free_block(points: ContactPoints, asked: BoolArray) -> FreeBlock:
    """Condense a block on some of its contact points.

    Parameters
    ----------
    points
        Of the contact faces, the lower and the upper one first.
    asked
        Points between which the flexibility is found, (n_points,).
    """
    rigid = lattice_motions(points.lattice.positions)
    flexible = flexible_block(columns_of(points), asked, rigid)
    return FreeBlock(points, flexible, rigid, points.outward @ rigid)


def columns_of(points: ContactPoints) -> ColumnBlock:
    """Elements and points as columns round the block."""
    lattice = points.lattice
    return ColumnBlock(
        lattice.nodes,
        lattice.element.degree,
        lattice.element.stiffness,
        points.outward,
        round(points.per_quad**0.5),
    )


def body_force(lattice: Lattice, acceleration: FloatArray) -> FloatArray:
    """Nodal forces of an acceleration (3,) [mm/s²] on the mass of a block, (n_nodes, 3) [N]."""
    element = lattice.element
    at = tensor_points(element.degree, *gauss_line(2 * element.degree))
    mass = np.zeros(len(lattice.positions))
    for nodes in lattice.elements:
        _, volumes = element.gradients(lattice.positions[nodes], at)
        mass[nodes] += element.material.density * volumes @ at.values
    return mass[:, None] * acceleration


def face_pressure(lattice: Lattice, name: str, pressure: float) -> FloatArray:
    """Nodal forces of a pressure on a face, (n_nodes, 3) [N]."""
    at = tensor_points(lattice.element.degree, *gauss_line(lattice.element.degree + 2), dimension=2)
    points = lattice.face_points(name, at)
    forces = -pressure * points.weights[:, :, None] * points.normals
    result = np.zeros((len(lattice.positions), 3))
    np.add.at(result, points.quads, np.einsum("pa,qpi->qai", points.values, forces))
    return result
