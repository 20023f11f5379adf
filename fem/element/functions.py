"""Functions of elements and of their facets, their nodes and Gauss points.

Lagrange polynomials on Gauss-Lobatto points and their tensor products: nodes, points and functions
are numbered with the last direction fastest, in [-1, 1] each. Facets are quadrilaterals whose
corners are counter-clockwise seen from outside.

Reference: Karniadakis and Sherwin (2005), Spectral/hp Element Methods, chapter 2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache, cached_property, lru_cache

import numpy as np
from numpy.polynomial import legendre

from geometry.mesh import FloatArray, IntArray, ReadOnlyArrays, grid_points


@cache
def lobatto_points(degree: int) -> FloatArray:
    """Gauss-Lobatto points on [-1, 1], (degree + 1,), read-only."""
    # The inner ones are the roots of P'_n, which is a Jacobi polynomial (1, 1) of degree n - 1.
    from scipy.special import roots_jacobi

    inner = roots_jacobi(degree - 1, 1, 1)[0] if degree > 1 else np.empty(0)
    points = np.concatenate([[-1.0], inner, [1.0]])
    points.flags.writeable = False
    return points


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


def functions_at(degree: int, natural: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Functions at natural coordinates (n, dimension), (n, m), and slopes (n, m, dimension)."""
    values, slopes = zip(*(line_basis(degree, x) for x in natural.T), strict=True)
    factors = (
        [slopes[k] if k == d else values[k] for k in range(len(values))] for d in range(len(values))
    )
    return tensor_values(*values), np.stack([tensor_values(*chosen) for chosen in factors], axis=2)


@dataclass(frozen=True)
class TensorPoints:
    """Values of the functions of an element, or of its face, at points of a tensor grid."""

    line: tuple[FloatArray, FloatArray]
    """Values and slopes of the functions of each direction at its points, (n, degree + 1)."""
    values: FloatArray
    """(n_points, n_functions)"""
    slopes: FloatArray
    """By each natural coordinate, (n_points, n_functions, dimension)."""
    weights: FloatArray
    """Of the quadrature, (n_points,); zero where the points are no quadrature."""

    @cached_property
    def by_factors(self) -> tuple[FloatArray, FloatArray]:
        """Slopes in three directions as products: of the first direction, and of the others.

        By each natural coordinate, (3, n, degree + 1), and (functions of a plane, 3 n²).
        """
        values, slopes = self.line
        planes = np.kron(values, values), np.kron(slopes, values), np.kron(values, slopes)
        return np.stack([slopes, values, values]), np.concatenate(planes).T


def tensor_points(degree: int, x: FloatArray, *, dimension: int = 3) -> TensorPoints:
    """Functions of degree ``degree`` at the tensor grid of the points ``x`` of a line."""
    natural = grid_points(*[x] * dimension)
    at_points = *functions_at(degree, natural), np.zeros(len(natural))
    return TensorPoints(line_basis(degree, x), *at_points)


@cache
def gauss_functions(degree: int, n: int, dimension: int = 3) -> TensorPoints:
    """Functions at n Gauss points in each direction."""
    x, line = gauss_line(n)
    weights = grid_points(*[line] * dimension).prod(axis=1)
    return replace(tensor_points(degree, x, dimension=dimension), weights=weights)


def gauss_line(n: int) -> tuple[FloatArray, FloatArray]:
    """Gauss points and weights on [-1, 1]."""
    points, weights = legendre.leggauss(n)
    return points, weights


#: Natural coordinates of the four corners of a facet, (4, 2).
FACET_CORNERS: FloatArray = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=np.float64)

#: The 2 × 2 Gauss points of a facet, all of weight one, in the order of the corners; (4, 2).
FACET_POINTS: FloatArray = FACET_CORNERS / math.sqrt(3.0)


def bilinear(xi: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Shape functions (..., 4) and slopes (..., 4, 2) at natural coordinates (..., 2)."""
    factor = 1.0 + xi[..., None, :] * FACET_CORNERS
    slopes = 0.25 * FACET_CORNERS * factor[..., ::-1]
    return 0.25 * factor.prod(axis=-1), slopes


def facet_values(xi: FloatArray, n_nodes: int) -> FloatArray:
    """Functions of facets at coordinates (n, 2), (n, n_nodes).

    Four nodes are corners, in their order; more have the second direction fastest.
    """
    if n_nodes == 4:
        return bilinear(xi)[0]
    return tensor_values(*(line_basis(math.isqrt(n_nodes) - 1, x)[0] for x in xi.T))


def facet_functions(xi: FloatArray, n_nodes: int) -> tuple[FloatArray, FloatArray]:
    """`facet_values` and slopes (n, n_nodes, 2)."""
    if n_nodes == 4:
        return bilinear(xi)
    return functions_at(math.isqrt(n_nodes) - 1, xi)


#: Bilinear shape functions at the Gauss points, (4 points, 4 corners), and their derivatives,
#: (4, 4, 2).
FACET_VALUES, FACET_SLOPES = bilinear(FACET_POINTS)


@dataclass(frozen=True)
class FacetBasis(ReadOnlyArrays):
    """Functions of the nodes of a facet at its points of integration, and where else to look."""

    points: FloatArray
    """Natural coordinates, (n_points, 2)."""
    values: FloatArray
    """(n_points, n_nodes)"""
    slopes: FloatArray
    """(n_points, n_nodes, 2)"""
    weights: FloatArray
    """Of the quadrature, (n_points,)."""
    corners: IntArray
    """Which nodes the corners are, (4,)."""
    looks: FloatArray
    """Functions where peaks are looked for, edges and corners included, (n_looks, n_nodes)."""
    to_looks: FloatArray
    """Values there of the polynomials through those at the points, (n_looks, n_points)."""

    @property
    def n_points(self) -> int:
        """Points of integration."""
        return len(self.points)

    @cached_property
    def difference(self) -> FloatArray:
        """Weights of the nodes of two facets in what the second has more, (n_points, 2 n_nodes)."""
        return np.concatenate([-self.values, self.values], axis=1)

    @cached_property
    def mean_slopes(self) -> FloatArray:
        """Slopes of the mean of two facets, (n_points, 2 n_nodes, 2)."""
        return 0.5 * np.concatenate([self.slopes, self.slopes], axis=1)

    def tangents(self, nodes: FloatArray) -> FloatArray:
        """Tangents dx/dr, dx/ds at the points, (n, n_points, 2, 3), of nodes (n, n_nodes, 3)."""
        by_each = self.slopes.transpose(0, 2, 1).reshape(-1, self.slopes.shape[1]) @ nodes
        return by_each.reshape(len(nodes), self.n_points, 2, 3)

    def points_after(self, corners: IntArray) -> IntArray:
        """Point of a facet that lies at each point of another one, (n, n_points).

        Parameters
        ----------
        corners
            Which corner of the first lies at each corner of the second, (n, 4).
        """
        ways, way = np.unique(corners, axis=0, return_inverse=True)
        there = bilinear(self.points)[0] @ FACET_CORNERS[ways]
        away = np.abs(there[:, :, None] - self.points).max(axis=3)
        return np.asarray(away.argmin(axis=2), dtype=np.int64)[way.ravel()]


#: Points along an edge of a facet of higher degree at which its peak is looked for.
_LOOKS = 9


@cache
def bilinear_basis() -> FacetBasis:
    """Facets of eight-node hexahedra: 2 × 2 Gauss points in the order of corners, peaks there."""
    at, order = gauss_functions(1, 2, 2), [0, 2, 3, 1]
    values = at.values[np.ix_(order, order)]
    return FacetBasis(
        points=FACET_POINTS,
        values=values,
        slopes=at.slopes[np.ix_(order, order)],
        weights=np.ones(4),
        corners=np.arange(4),
        looks=np.eye(4),
        to_looks=np.linalg.inv(values).astype(np.float64),
    )


@cache
def lagrange_basis(degree: int) -> FacetBasis:
    """Facets of a degree: two Gauss points more than the degree in each direction.

    A steep law of a polynomial is no polynomial.
    """
    line, at = gauss_line(degree + 2)[0], gauss_functions(degree, degree + 2, 2)
    look = np.linspace(-1.0, 1.0, _LOOKS)
    through = legendre.legvander(look, degree + 1) @ np.linalg.inv(
        legendre.legvander(line, degree + 1)
    )
    return FacetBasis(
        points=grid_points(line, line),
        values=at.values,
        slopes=at.slopes,
        weights=at.weights,
        corners=np.array([0, degree * (degree + 1), (degree + 1) ** 2 - 1, degree]),
        looks=tensor_points(degree, look, dimension=2).values,
        to_looks=np.asarray(np.kron(through, through), dtype=np.float64),
    )


def basis_of(quads: IntArray) -> FacetBasis:
    """Functions of facets by their number of nodes, (degree + 1)²."""
    return facet_basis(math.isqrt(quads.shape[1]) - 1)


def facet_basis(degree: int) -> FacetBasis:
    """Functions of facets of a degree."""
    return bilinear_basis() if degree == 1 else lagrange_basis(degree)


def facet_area_vectors(nodes: FloatArray, quads: IntArray) -> FloatArray:
    """Vector area of the points of integration, dx/dr × dx/ds times their weights.

    Returns
    -------
    FloatArray
        (..., n_facets, n_points, 3) [mm²]; of bilinear facets their sum is the exact vector area,
        whatever the warp.
    """
    basis = basis_of(quads)
    tangents = np.einsum("pak,...fai->...fpki", basis.slopes, nodes[..., quads, :])
    return np.cross(tangents[..., 0, :], tangents[..., 1, :]) * basis.weights[:, None]


def facet_areas(nodes: FloatArray, quads: IntArray) -> FloatArray:
    """Areas by the points of integration, (..., n_facets) [mm²]."""
    return np.linalg.norm(facet_area_vectors(nodes, quads), axis=-1).sum(axis=-1)
