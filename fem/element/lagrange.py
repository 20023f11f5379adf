"""Curved hexahedra of any degree: geometry and displacement by the same Lagrange polynomials.

Stiffness is integrated with one Gauss point more than the degree in each direction. In a mesh made
of eight-node hexahedra the corners keep their numbers and places; nodes on edges, on faces and
inside come after them. A block that has a `geometry.block.Curve` has them on the exact shape, any
other on the straight edges, ruled faces and trilinear insides of its mesh.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from fem.element.functions import (
    TensorPoints,
    gauss_functions,
    gauss_line,
    line_basis,
    lobatto_points,
    tensor_points,
    tensor_values,
)
from fem.element.hexahedron import chunks, in_cache, symmetric
from fem.element.material import Material, stress_of_gradient
from geometry.block import Block, facet_corners
from geometry.machine.work import Operation, count
from geometry.mesh import (
    CORNERS,
    FloatArray,
    HexMesh,
    IntArray,
    MeshError,
    grid_points,
    shape_values,
    structured_hexahedra,
    structured_quads,
)

#: Pairs of functions whose stiffness is computed at a time: what a cache holds.
_AT_ONCE = 1 << 14


def slopes_of(values: FloatArray, at: TensorPoints) -> FloatArray:
    """Slopes of nodal values (n, n_functions, 3) at points: ∂vᵢ/∂ξₖ, (n, 3, 3, n_points)."""
    first, plane = at.by_factors
    n = first.shape[2]
    along = np.swapaxes(values, 1, 2).reshape(-1, n * n) @ plane
    products = first @ np.swapaxes(along.reshape(len(values) * 3, n, 3, -1), 1, 2)
    return products.reshape(len(values), 3, 3, -1)


def sums_by_slopes(fluxes: FloatArray, at: TensorPoints) -> FloatArray:
    """Products with the slopes of each function, as `slopes_of` transposed.

    Fluxes (n, 3, 3, n_points) give Σ fᵢₖ ∂N/∂ξₖ, (n, n_functions, 3).
    """
    first, plane = at.by_factors
    n_points, n = first.shape[1:]
    along = np.swapaxes(first, 1, 2) @ fluxes.reshape(len(fluxes) * 3, 3, n_points, -1)
    sums = np.swapaxes(along, 1, 2).reshape(-1, plane.shape[1]) @ plane.T
    return np.swapaxes(sums.reshape(len(fluxes), 3, n**3), 1, 2)


def adjugates(matrices: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Adjugates (n, 3, 3, m) and determinants (n, m) of matrices (n, 3, 3, m).

    An inverse is an adjugate over its determinant: `numpy.linalg` takes seven times as long.
    """
    result = np.empty(matrices.shape)
    for i, (j, k) in enumerate(((1, 2), (2, 0), (0, 1))):
        for p, (q, r) in enumerate(((1, 2), (2, 0), (0, 1))):
            result[:, p, i] = matrices[:, j, q] * matrices[:, k, r]
            result[:, p, i] -= matrices[:, j, r] * matrices[:, k, q]
    return result, np.asarray((matrices[:, 0] * result[:, :, 0]).sum(axis=1))


def gradient_tensor(gradients: FloatArray, volume: FloatArray) -> FloatArray:
    """T[ai, bj] = Σ_p dv g[a, i] g[b, j] of gradients g at points, (n_elements, 3 n, 3 n) [mm]."""
    n_elements, n_points = volume.shape
    flat = gradients.reshape(n_elements, n_points, -1)
    return symmetric(np.swapaxes(flat * volume[:, :, None], 1, 2) @ flat)


def isotropic_stiffness(tensor: FloatArray, lame: float, shear: float) -> FloatArray:
    """Isotropic stiffness, symmetric to the bit as the tensor T is.

    K[ai, bj] = λ T[ai, bj] + μ (T[aj, bi] + δ_ij Σ_k T[ak, bk]).
    """
    n = tensor.shape[1] // 3
    t = tensor.reshape(-1, n, 3, n, 3)
    stiffness = lame * t + shear * t.transpose(0, 1, 4, 3, 2)
    laplacian = shear * np.einsum("eakbk->eab", t)
    for i in range(3):
        stiffness[:, :, i, :, i] += laplacian
    return stiffness.reshape(-1, 3 * n, 3 * n)


@dataclass(frozen=True)
class Lagrange:
    """Hexahedra of one degree; n functions, the last natural direction fastest."""

    degree: int
    """Of the polynomials, at least one."""

    @property
    def words(self) -> str:
        """Name in tables."""
        return f"isoparametric hexahedra of degree {self.degree}"

    @property
    def nodes(self) -> FloatArray:
        """Natural coordinates of the nodes, Gauss-Lobatto points, (n, 3)."""
        return grid_points(*[lobatto_points(self.degree)] * 3)

    def face_nodes(self, corners: IntArray) -> IntArray:
        """Nodes of faces by their corners as `geometry.mesh.CORNERS`, (n, 4) to (n, m).

        The first direction, slow, runs from corner 0 to 1, the second from corner 0 to 3.
        """
        size = self.degree + 1
        begin, *ends = np.moveaxis(CORNERS[corners[:, [0, 1, 3]]].astype(np.int64), 1, 0)
        along = (np.stack(ends, axis=1) - begin[:, None]) // 2
        places = (
            self.degree * (begin[:, None] + 1) // 2
            + np.indices((size, size)).reshape(2, -1).T @ along
        )
        return np.asarray(places @ [size**2, size, 1], dtype=np.int64)

    @property
    def hourglass(self) -> None:
        """No part of the stiffness controls hourglass modes."""
        return None

    def values(self, natural: FloatArray) -> FloatArray:
        """Functions at natural coordinates, (n_points, 3) to (n_points, n)."""
        return tensor_values(*(line_basis(self.degree, x)[0] for x in natural.T))

    @property
    def quadrature(self) -> TensorPoints:
        """Points of the stiffness: degree + 1 in each direction."""
        return gauss_functions(self.degree, self.degree + 1)

    def gradients(self, coordinates: FloatArray, at: TensorPoints) -> tuple[FloatArray, FloatArray]:
        """Gradients of the functions and volumes of points of elements.

        Nodes, (m, n, 3) [mm], give (m, n_points, n, 3) [1/mm] and (m, n_points) [mm³].

        Raises
        ------
        MeshError
            An element that folds at one of the points.
        """
        inverse, volumes = self._inverses(coordinates, at)
        return at.slopes @ np.moveaxis(inverse, 3, 1), volumes

    def _inverses(self, coordinates: FloatArray, at: TensorPoints) -> tuple[FloatArray, FloatArray]:
        """Inverse Jacobians ∂ξₖ/∂xⱼ (m, 3, 3, n_points) and volumes of points (m, n_points)."""
        adjugate, determinant = adjugates(slopes_of(coordinates, at))
        if not (determinant > 0.0).all():
            raise MeshError(
                f"isoparametric element: Jacobian {determinant.min():.3g} mm³; expected positive "
                "Jacobians: use more elements, or less grading"
            )
        return adjugate / determinant[:, None, None], determinant * at.weights

    def mass(self, coordinates: FloatArray, density: float) -> FloatArray:
        """Row sums ρ ∫ N_a dV of nodes (m, n, 3) [mm], (m, n) [t]; MeshError as `gradients`."""
        at = self.quadrature
        return density * self._inverses(coordinates, at)[1] @ at.values

    def stiffness(self, coordinates: FloatArray, material: Material) -> FloatArray:
        """Stiffness of nodes (m, n, 3) [mm], (m, 3 n, 3 n) [N/mm]; MeshError as `gradients`."""
        n = coordinates.shape[1]
        count(Operation.ELEMENT, 9.0 * n**3 * len(coordinates))
        result = np.empty((len(coordinates), 3 * n, 3 * n))
        for part in chunks(len(coordinates), max(1, _AT_ONCE // n**2)):
            tensor = gradient_tensor(*self.gradients(coordinates[part], self.quadrature))
            result[part] = isotropic_stiffness(
                tensor, material.lame_modulus, material.shear_modulus
            )
        return result

    @property
    def points(self) -> FloatArray:
        """Where `stress` is sampled: two Gauss points more than the degree in each direction.

        Nearer to the corners of an element a polynomial of a high degree overshoots.
        """
        return grid_points(*[gauss_line(self.degree + 2)[0]] * 3)

    def stress(
        self, coordinates: FloatArray, material: Material, displacement: FloatArray
    ) -> FloatArray:
        """Stress at `points` of elements of some bodies, (n_bodies, m, n_points, 6) [MPa].

        Nodes are (m, n, 3) [mm], displacements (n_bodies, m, n, 3) [mm].
        """
        at = gauss_functions(self.degree, self.degree + 2)
        return self.stress_at(coordinates, material, displacement, at)

    def nodal_stress(
        self, coordinates: FloatArray, material: Material, displacement: FloatArray
    ) -> FloatArray:
        """`stress` at the nodes, (n_bodies, m, n, 6) [MPa]."""
        at = tensor_points(self.degree, lobatto_points(self.degree))
        return self.stress_at(coordinates, material, displacement, at)

    def stress_at(
        self,
        coordinates: FloatArray,
        material: Material,
        displacement: FloatArray,
        at: TensorPoints,
    ) -> FloatArray:
        """`stress` at any points."""
        adjugate, determinant = adjugates(slopes_of(coordinates, at))
        inverse = adjugate / determinant[:, None, None]
        stress = np.empty((len(displacement), *determinant.shape, 6))
        count(Operation.ELEMENT, 9.0 * stress.size * at.values.shape[1] / 6.0)
        for body, moved in zip(stress, displacement, strict=True):  # all are too many for a cache
            gradient = np.einsum("eikp,ekjp->eijp", slopes_of(moved, at), inverse)
            body[:] = stress_of_gradient(np.moveaxis(gradient, 3, 1), material)
        return stress

    def internal_force(
        self, coordinates: FloatArray, material: Material, displacement: FloatArray
    ) -> FloatArray:
        """∫ σ ∂N_a/∂x dV of elements of some bodies: K u without K [N].

        Nodes are (m, n, 3) [mm], displacements and forces (n_bodies, m, n, 3).

        Raises
        ------
        MeshError
            As `gradients`.
        """
        at = self.quadrature
        inverse, volumes = self._inverses(coordinates, at)
        measure = inverse * volumes[:, None, None]
        result = np.empty_like(displacement)
        for force, moved in zip(result, displacement, strict=True):  # what a cache holds
            gradient = np.einsum("nikp,nkjp->nijp", slopes_of(moved, at), inverse)
            stress = material.shear_modulus * (gradient + np.swapaxes(gradient, 1, 2))
            stress[:, range(3), range(3)] += (
                material.lame_modulus * np.einsum("niip->np", gradient)[:, None]
            )
            force[:] = sums_by_slopes(np.einsum("nijp,nkjp->nikp", stress, measure), at)
        return result


#: Shares of corners in a node are told apart to this, far above rounding.
_SHARE = 1e-6
#: Eight whole numbers as one that can be sorted.
_KEY = np.dtype((np.void, 64))


@dataclass(frozen=True)
class LagrangeMesh(HexMesh):
    """Hexahedra of one degree; `elements` names their corners."""

    members: IntArray
    """Nodes of each hexahedron, last natural direction fastest, (n_elements, (degree + 1)³)."""

    @property
    def degree(self) -> int:
        """Of the polynomials, at least two."""
        return round(self.members.shape[1] ** (1.0 / 3.0)) - 1

    @property
    def connectivity(self) -> IntArray:
        """All nodes of each hexahedron."""
        return self.members

    def extent(self) -> tuple[float, FloatArray]:
        """Volume [mm³] and centroid (3,) [mm] of the curved body."""
        element, shares = Lagrange(self.degree), np.zeros(self.n_nodes)
        for members in in_cache(self):
            np.add.at(shares, members, element.mass(self.nodes[members], 1.0))
        return float(shares.sum()), shares @ self.nodes / shares.sum()

    def facet_nodes(self, quads: IntArray) -> IntArray:
        """Nodes of facets from their corners, (n, 4) to (n, (degree + 1)²).

        The first direction, slow, runs from corner 0 to 1, the second from corner 0 to 3.
        """
        element, corners = facet_corners(self, quads)
        ways, way = np.unique(corners, axis=0, return_inverse=True)
        nodes = Lagrange(self.degree).face_nodes(ways)
        return self.members[element[:, None], nodes[way.ravel()]]


def _keys(corners: IntArray, share: FloatArray) -> npt.NDArray[np.void]:
    """What names a node of an edge or a face whatever element it is seen from, (n,).

    Its corners in ascending order with the share that each has in its place: from the corners of
    elements (n, 8) and the share of each corner in the node, (8,).
    """
    which = np.flatnonzero(share > _SHARE)
    names = corners[:, which]
    order = np.argsort(names, axis=1)
    rows = np.full((len(corners), 8), -1, dtype=np.int64)
    rows[:, : len(which)] = np.take_along_axis(names, order, axis=1)
    rows[:, 4 : 4 + len(which)] = np.rint(share[which] / _SHARE).astype(np.int64)[order]
    return rows.view(_KEY).ravel()


def lagrange_mesh(block: Block, degree: int) -> LagrangeMesh:
    """Give a block's eight-node hexahedra the nodes of a degree of two or more.

    On the exact shape where the block has one.
    """
    mesh, curve = block.mesh, block.curve
    shares = shape_values(Lagrange(degree).nodes)
    of = (shares > _SHARE).sum(axis=1)
    members = np.empty((mesh.n_elements, len(shares)), dtype=np.int64)
    between = np.flatnonzero((of > 1) & (of < 8))
    for node in np.flatnonzero(of == 1):
        members[:, node] = mesh.elements[:, shares[node].argmax()]
    keys = np.concatenate([_keys(mesh.elements, shares[node]) for node in between])
    unique, number = np.unique(keys, return_inverse=True)
    members[:, between] = mesh.n_nodes + number.reshape(len(between), -1).T
    inside, first = np.flatnonzero(of == 8), mesh.n_nodes + len(unique)
    own = np.arange(mesh.n_elements * len(inside)).reshape(mesh.n_elements, -1)
    members[:, inside] = first + own
    given = mesh.nodes[mesh.elements] if curve is None else curve.parameters()
    places: FloatArray = (shares @ given).reshape(members.size, -1)
    nodes = np.empty((first + own.size, 3))
    nodes[members.ravel()] = places if curve is None else curve.shape(places)
    nodes[: mesh.n_nodes] = mesh.nodes
    return LagrangeMesh(nodes, mesh.elements, members)


def with_degree(block: Block, degree: int) -> Block:
    """Block with hexahedra of a degree; one that has them is returned as it is."""
    if degree in (1, block.mesh.degree):
        return block
    return replace(block, mesh=lagrange_mesh(block, degree))


def in_pieces(block: Block) -> Block:
    """Block of eight-node hexahedra between the nodes of its elements: what pictures show."""
    mesh = block.mesh
    if mesh.degree == 1:
        return block
    k = mesh.degree
    cells = mesh.connectivity[:, structured_hexahedra(k, k, k)].reshape(-1, 8)
    faces = {
        name: mesh.facet_nodes(quads)[:, structured_quads(k)].reshape(-1, 4)
        for name, quads in block.faces.items()
    }
    return replace(block, mesh=HexMesh(mesh.nodes, cells), faces=faces, curve=None)
