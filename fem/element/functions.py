"""Lagrange polynomials on Gauss-Lobatto points and their tensor products, and Gauss points.

Nodes, points and functions are numbered with the last direction fastest, in [-1, 1] each.

Reference: Karniadakis and Sherwin (2005), Spectral/hp Element Methods, chapter 2.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, lru_cache

import numpy as np
from numpy.polynomial import legendre

from geometry.mesh import FloatArray, grid_points


def lobatto_points(degree: int) -> FloatArray:
    """Gauss-Lobatto points on [-1, 1], (degree + 1,)."""
    # The inner ones are the roots of P'_n, which is a Jacobi polynomial (1, 1) of degree n - 1.
    from scipy.special import roots_jacobi

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

    values: FloatArray
    """(n_points, n_functions)"""
    slopes: FloatArray
    """By each natural coordinate, (n_points, n_functions, dimension)."""
    weights: FloatArray
    """Of the quadrature, (n_points,); zero where the points are no quadrature."""


def tensor_points(degree: int, x: FloatArray, *, dimension: int = 3) -> TensorPoints:
    """Functions of degree ``degree`` at the tensor grid of the points ``x`` of a line."""
    natural = grid_points(*[x] * dimension)
    return TensorPoints(*functions_at(degree, natural), np.zeros(len(natural)))


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
