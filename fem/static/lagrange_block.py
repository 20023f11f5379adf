"""A curved block of high degree seen from the points of its contact faces.

A block follows from the forces q on its contact points, pushed inwards along the normals ν, and
from its loads f up to a rigid motion,

    ν · u = -F q + h + b α      with  F = B G Bᵀ,  h = B G f,  b = B R,

where B takes nodes to points, G is the flexibility of the condensed block and R its rigid motions.
All congruent blocks share F, h and b, and nothing else of a block appears in the contact problem.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array, vstack

from fem.element.lagrange import LagrangeElement, TensorPoints, gauss_line, tensor_points
from fem.static.linear_step.condensation import CondensedBlock, condense_elements
from fem.static.linear_step.condensed import symmetric_pseudo_inverse
from geometry.mesh import FloatArray, IntArray

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
    nodes: FloatArray
    """Grid of all nodes, right-handed in its order, (n_1, n_2, n_3, 3) [mm]."""

    @property
    def counts(self) -> tuple[int, int, int]:
        """Elements in each direction."""
        k = self.element.degree
        n_1, n_2, n_3 = ((n - 1) // k for n in self.nodes.shape[:3])
        return n_1, n_2, n_3

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
        return _windows(self.numbers, self.counts, self.element.degree)

    def face(self, name: str) -> IntArray:
        """Nodes of the elements' faces on a face of the block, (n, (degree + 1)²)."""
        direction, end = FACES[name]
        numbers = np.take(self.numbers, -end, axis=direction)
        counts = tuple(c for k, c in enumerate(self.counts) if k != direction)
        return _windows(numbers, counts, self.element.degree)

    def face_points(self, name: str, at: TensorPoints) -> FacePoints:
        """Points on a face of the block, element by element."""
        direction, end = FACES[name]
        quads = self.face(name)
        corners = self.positions[quads]
        tangents = np.einsum("qai,pak->qpki", corners, at.slopes)
        outward = np.cross(tangents[:, :, 0], tangents[:, :, 1])
        # The two directions of a face in their order turn with the third, but for the middle one.
        outward *= (1.0 if end else -1.0) * (-1.0 if direction == 1 else 1.0)
        area = np.linalg.norm(outward, axis=2)
        return FacePoints(
            quads=quads,
            values=at.values,
            positions=np.einsum("pa,qai->qpi", at.values, corners),
            normals=outward / area[:, :, None],
            weights=area * at.weights,
        )


def _windows(numbers: IntArray, counts: tuple[int, ...], degree: int) -> IntArray:
    """Nodes of structured elements of a grid of numbers, last direction fastest."""
    dimension = len(counts)
    windows = np.lib.stride_tricks.sliding_window_view(numbers, (degree + 1,) * dimension)
    chosen = windows[tuple(slice(None, None, degree) for _ in range(dimension))]
    elements: IntArray = np.ascontiguousarray(chosen.reshape(int(np.prod(counts)), -1))
    return elements


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
class SeenBlock:
    """A block seen from its contact points."""

    lattice: Lattice
    """The block."""
    condensed: CondensedBlock
    """Seen from the nodes of its contact faces."""
    inverse: FloatArray
    """G on those nodes, (3 n_c, 3 n_c) [mm/N]."""
    rigid: FloatArray
    """R there, (3 n_c, 6)."""
    faces: dict[str, FacePoints]
    """Quadrature points of the contact faces."""
    start: dict[str, slice]
    """Where the points of each face are among all points."""
    outward: csr_array
    """B, (n_points, 3 n_c)."""
    flexibility: FloatArray
    """F, (n_points, n_points) [mm/N]."""
    motions: FloatArray
    """b, (n_points, 6)."""

    def on_contact_nodes(self, matrix: csr_array) -> csr_array:
        """Columns of the contact nodes of a matrix on all nodes."""
        return csr_array(matrix[:, self.condensed.degrees_of_freedom])


def rigid_motions_of(positions: FloatArray) -> FloatArray:
    """Translations, and rotations about the middle over the size, (3 n, 6)."""
    arm = (positions - positions.mean(axis=0)) / np.ptp(positions, axis=0).max()
    motions = np.zeros((len(positions), 3, 6))
    motions[:, [0, 1, 2], [0, 1, 2]] = 1.0
    for k in range(3):
        motions[:, :, 3 + k] = np.cross(np.eye(3)[k], arm)
    return motions.reshape(-1, 6)


def seen_block(lattice: Lattice, contact_faces: tuple[str, ...]) -> SeenBlock:
    """Condense a block and find its response at the points of its contact faces.

    Contact is integrated with two points more than the degree in each direction: a steep law of a
    polynomial is no polynomial.
    """
    element = lattice.element
    retained = np.unique(np.concatenate([lattice.face(f).ravel() for f in contact_faces]))
    positions = lattice.positions
    condensed = condense_elements(
        lattice.elements,
        positions,
        lambda some: element.stiffness(positions[lattice.elements[some]]),
        retained,
    )
    rigid = rigid_motions_of(positions)[condensed.degrees_of_freedom]
    inverse = symmetric_pseudo_inverse(condensed.stiffness, rigid)
    at = tensor_points(element.degree, *gauss_line(element.degree + 2), dimension=2)
    faces = {name: lattice.face_points(name, at) for name in contact_faces}
    sizes = [f.weights.size for f in faces.values()]
    ends = np.cumsum([0, *sizes])
    start = {
        name: slice(int(a), int(b)) for name, a, b in zip(faces, ends[:-1], ends[1:], strict=True)
    }
    matrix = csr_array(vstack([f.outward(len(positions)) for f in faces.values()]))
    outward = csr_array(matrix[:, condensed.degrees_of_freedom])
    flexibility = outward @ (outward @ inverse).T
    return SeenBlock(
        lattice=lattice,
        condensed=condensed,
        inverse=inverse,
        rigid=rigid,
        faces=faces,
        start=start,
        outward=outward,
        flexibility=0.5 * (flexibility + flexibility.T),
        motions=outward @ rigid,
    )


def face_pressure(lattice: Lattice, name: str, pressure: float) -> FloatArray:
    """Nodal forces of a pressure on a face, (n_nodes, 3) [N]."""
    at = tensor_points(lattice.element.degree, *gauss_line(lattice.element.degree + 2), dimension=2)
    points = lattice.face_points(name, at)
    forces = -pressure * points.weights[:, :, None] * points.normals
    result = np.zeros((len(lattice.positions), 3))
    np.add.at(result, points.quads, np.einsum("pa,qpi->qai", points.values, forces))
    return result
