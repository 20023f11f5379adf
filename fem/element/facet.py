"""Quadrilateral facets, bilinear and of higher degree: functions, Gauss rules, areas.

Corners are counter-clockwise seen from outside.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.polynomial import legendre

from fem.element.functions import (
    functions_at,
    gauss_functions,
    gauss_line,
    line_basis,
    tensor_points,
    tensor_values,
)
from geometry.mesh import FloatArray, IntArray, ReadOnlyArrays, grid_points

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
