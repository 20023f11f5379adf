"""Curved hexahedra of any degree: Lagrange polynomials on Gauss-Lobatto points, tensor products.

Nodes, points and functions are numbered with the last direction fastest. Geometry and displacement
use the same functions (isoparametric elements); stiffness is integrated with one Gauss point more
than the degree in each direction.

Reference: Karniadakis and Sherwin (2005), Spectral/hp Element Methods, chapter 2.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property, lru_cache

import numpy as np
from numpy.polynomial import legendre
from scipy.special import roots_jacobi

from fem.element.hexahedron import chunks, symmetric
from fem.element.material import Material
from fem.element.stress import stress_of_gradient
from geometry.mesh import CORNERS, FloatArray, IntArray, MeshError, grid_points
from geometry.work import Operation, count

#: Pairs of functions whose stiffness is computed at a time: what a cache holds.
_AT_ONCE = 1 << 14


def lobatto_points(degree: int) -> FloatArray:
    """Gauss-Lobatto points on [-1, 1], (degree + 1,)."""
    # The inner ones are the roots of P'_n, which is a Jacobi polynomial (1, 1) of degree n - 1.
    inner = roots_jacobi(degree - 1, 1, 1)[0] if degree > 1 else np.empty(0)
    return np.concatenate([[-1.0], inner, [1.0]])


def line_basis(degree: int, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lagrange polynomials on the Gauss-Lobatto points and their slopes, (n, degree + 1) each."""
    return _line_basis(degree, np.ascontiguousarray(x, dtype=np.float64).tobytes())


@lru_cache(maxsize=1024)
def _line_basis(degree: int, x: bytes) -> tuple[FloatArray, FloatArray]:
    """The same of few lines, which come again and again: those of cells of alike elements."""
    to_nodal, derived = _to_nodal(degree)
    powers = legendre.legvander(np.frombuffer(x), degree)
    result = powers @ to_nodal, powers[:, :degree] @ derived
    for values in result:
        values.flags.writeable = False
    return result


@cache
def _to_nodal(degree: int) -> tuple[FloatArray, FloatArray]:
    """Legendre coefficients of the Lagrange polynomials and of their slopes."""
    powers = legendre.legvander(lobatto_points(degree), degree)
    to_nodal = np.linalg.inv(powers).astype(np.float64)
    return to_nodal, legendre.legder(to_nodal).astype(np.float64)


def tensor_values(first: FloatArray, *others: FloatArray) -> FloatArray:
    """Products of functions of each direction at n points, (n, all), the last one fastest."""
    for other in others:
        both = first[:, :, None] * other[:, None, :]
        first = both.reshape(len(both), both.shape[1] * both.shape[2])
    return first


@dataclass(frozen=True)
class TensorPoints:
    """Values of the functions of an element, or of its face, at points of a tensor grid."""

    values: FloatArray
    """(n_points, n_functions)"""
    slopes: FloatArray
    """By each natural coordinate, (n_points, n_functions, dimension)."""
    weights: FloatArray
    """Of the quadrature, (n_points,); zero where the points are no quadrature."""


def tensor_points(
    degree: int, x: FloatArray, weights: FloatArray | None = None, *, dimension: int = 3
) -> TensorPoints:
    """Functions of degree ``degree`` at the tensor grid of the points ``x`` of a line."""
    line = np.zeros(len(x)) if weights is None else weights
    return line_points(degree, [x] * dimension, [line] * dimension)


def line_points(degree: int, x: list[FloatArray], weights: list[FloatArray]) -> TensorPoints:
    """Functions at the tensor grid of points of one line, and their weights, for each direction."""
    dimension = len(x)
    values, slopes = zip(*(line_basis(degree, line) for line in x), strict=True)
    factors = [
        [slopes[k] if k == d else values[k] for k in range(dimension)] for d in range(dimension)
    ]
    products = [_product(chosen) for chosen in factors]
    return TensorPoints(_product(list(values)), np.stack(products, axis=-1), _product(weights))


def _product(factors: list[FloatArray]) -> FloatArray:
    """Tensor product, the last factor fastest."""
    product = factors[0]
    for factor in factors[1:]:
        product = np.asarray(np.kron(product, factor), dtype=np.float64)
    return product


def gauss_line(n: int) -> tuple[FloatArray, FloatArray]:
    """Gauss points and weights on [-1, 1]."""
    points, weights = legendre.leggauss(n)
    return points, weights


def slopes_of(values: FloatArray, at: TensorPoints) -> FloatArray:
    """Slopes of nodal values (n, n_functions, 3) at points: ∂vᵢ/∂ξₖ, (n, 3, 3, n_points)."""
    n_points, n_functions, _ = at.slopes.shape
    products = np.swapaxes(values, 1, 2).reshape(-1, n_functions) @ _by_direction(at)
    return products.reshape(len(values), 3, 3, n_points)


def _by_direction(at: TensorPoints) -> FloatArray:
    """Slopes of the functions, (n_functions, 3 n_points)."""
    return at.slopes.transpose(1, 2, 0).reshape(at.slopes.shape[1], -1)


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
        xi = grid_points(*[lobatto_points(self.degree)] * 2)
        begin, *ends = np.moveaxis(CORNERS[corners[:, [0, 1, 3]]], 1, 0)
        along = np.stack(ends, axis=1) - begin[:, None]
        places = begin[:, None] + 0.5 * (1.0 + xi) @ along
        away = np.abs(places[:, :, None] - self.nodes).sum(axis=3)
        return np.asarray(away.argmin(axis=2), dtype=np.int64)

    @property
    def hourglass(self) -> None:
        """No part of the stiffness controls hourglass modes."""
        return None

    def values(self, natural: FloatArray) -> FloatArray:
        """Functions at natural coordinates, (n_points, 3) to (n_points, n)."""
        return tensor_values(*(line_basis(self.degree, x)[0] for x in natural.T))

    @cached_property
    def quadrature(self) -> TensorPoints:
        """Points of the stiffness: degree + 1 in each direction."""
        return tensor_points(self.degree, *gauss_line(self.degree + 1))

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
        at = tensor_points(self.degree, gauss_line(self.degree + 2)[0])
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
        slopes = _by_direction(at).T
        result = np.empty_like(displacement)
        for force, moved in zip(result, displacement, strict=True):  # what a cache holds
            gradient = np.einsum("nikp,nkjp->nijp", slopes_of(moved, at), inverse)
            stress = material.shear_modulus * (gradient + np.swapaxes(gradient, 1, 2))
            stress[:, range(3), range(3)] += (
                material.lame_modulus * np.einsum("niip->np", gradient)[:, None]
            )
            flux = np.einsum("nijp,nkjp->nikp", stress, measure).reshape(-1, len(slopes))
            force[:] = np.swapaxes((flux @ slopes).reshape(len(moved), 3, -1), 1, 2)
        return result
