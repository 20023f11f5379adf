"""Where the points of sliding contact lie on the facets of a surface.

A facet inside one facet of the other surface carries 2 × 2 Gauss points: the shape functions of
both are smooth there, so a uniform pressure gives exact nodal forces. A facet that crosses edges
of the other surface, or hangs over its rim, is cut along those edges into convex pieces with
points of their own: the patch test then holds for meshes that do not match. Cuts are those of the
surfaces at the start; a piece that has slid over another edge is integrated as a whole.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from fem.element.facet import bilinear
from geometry.mesh import FloatArray, IntArray

#: Pieces smaller than this share of their facet are rounding.
_SLIVER = 1e-8

#: Distance from an edge, in facet sizes, below which a corner lies on it.
_ON_EDGE = 1e-7

#: Barycentric coordinates of three points that integrate quadratic functions on a triangle.
_TRIANGLE: FloatArray = np.array([[4.0, 1.0, 1.0], [1.0, 4.0, 1.0], [1.0, 1.0, 4.0]]) / 6.0


@dataclass(frozen=True)
class FacetPoints:
    """Integration points of some facets, in the order of the facets."""

    facet: IntArray
    """Facet of each point, (n,)."""
    shapes: FloatArray
    """Shape functions of the facet's corners there, (n, 4)."""
    weights: FloatArray
    """Area that the point stands for, (n,) [mm²]."""
    cells: FloatArray
    """Box round that area in natural coordinates, lower then upper corner, (n, 2, 2)."""


def gauss_points(corners: FloatArray) -> FacetPoints:
    """2 × 2 Gauss points on facets (n, 4, 3)."""
    line = np.array([-1.0, 1.0]) / np.sqrt(3.0)
    xi = np.stack([g.ravel() for g in np.meshgrid(line, line, indexing="ij")], axis=1)
    values, slopes = bilinear(xi)
    tangents = np.einsum("pak,fai->fpki", slopes, corners)
    weights = np.linalg.norm(np.cross(tangents[:, :, 0], tangents[:, :, 1]), axis=2)
    n = len(corners)
    cells = np.stack([np.minimum(np.sign(xi), 0.0), np.maximum(np.sign(xi), 0.0)], axis=1)
    return FacetPoints(
        facet=np.repeat(np.arange(n), len(xi)),
        shapes=np.tile(values, (n, 1)),
        weights=weights.ravel(),
        cells=np.tile(cells, (n, 1, 1)),
    )


def cut_points(
    points: FacetPoints, corners: FloatArray, crossed: Mapping[int, FloatArray]
) -> FacetPoints:
    """Give the facets that cross others points of their own pieces.

    Parameters
    ----------
    points
        Points of all facets.
    corners
        Of all facets, (n_facets, 4, 3) [mm].
    crossed
        For each facet that is to be cut, the corners of the facets it may cross, (k, 4, 3) [mm].
    """
    area = np.bincount(points.facet, points.weights, minlength=len(corners))
    parts = []
    for facet, others in crossed.items():
        found = _cut_facet(facet, corners[facet], others)
        if found is not None:
            scale = area[facet] / found.weights.sum()
            parts.append(replace(found, weights=scale * found.weights))
    if not parts:
        return points
    whole = ~np.isin(points.facet, [int(part.facet[0]) for part in parts])
    parts.append(
        FacetPoints(
            points.facet[whole], points.shapes[whole], points.weights[whole], points.cells[whole]
        )
    )
    facets = np.concatenate([p.facet for p in parts])
    order = np.argsort(facets, kind="stable")
    return FacetPoints(
        facet=facets[order],
        shapes=np.concatenate([p.shapes for p in parts])[order],
        weights=np.concatenate([p.weights for p in parts])[order],
        cells=np.concatenate([p.cells for p in parts])[order],
    )


def _cut_facet(number: int, own: FloatArray, others: FloatArray) -> FacetPoints | None:
    """Points on the pieces of one facet, all projected on its plane; None where nothing is cut."""
    _, slopes = bilinear(np.zeros(2))
    centre = own.mean(axis=0)
    tangents = slopes.T @ own
    normal = np.cross(tangents[0], tangents[1])
    first = tangents[0] / np.linalg.norm(tangents[0])
    second = np.cross(normal / np.linalg.norm(normal), first)
    plane = np.stack([first, second], axis=1)
    facet = (own - centre) @ plane
    pieces = convex_pieces(facet, (others - centre) @ plane)
    if len(pieces) < 2:
        return None
    at, weights = zip(*(_piece_points(piece) for piece in pieces), strict=True)
    sizes = [len(points) for points in at]
    xi = natural_coordinates(facet, np.concatenate([*at, *pieces]))
    corner = sum(sizes) + np.cumsum([0, *(len(piece) for piece in pieces)])
    boxes = [
        np.stack([xi[a:b].min(axis=0), xi[a:b].max(axis=0)]) for a, b in pairwise(corner.tolist())
    ]
    return FacetPoints(
        facet=np.full(sum(sizes), number, dtype=np.int64),
        shapes=bilinear(xi[: sum(sizes)])[0],
        weights=np.concatenate(weights),
        cells=np.repeat(np.clip(boxes, -1.0, 1.0), sizes, axis=0),
    )


def _piece_points(piece: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points (n, 2) of a convex piece, three on each triangle of a fan, and their areas (n,)."""
    fan = np.stack([piece[[0, k, k + 1]] for k in range(1, len(piece) - 1)])
    area = 0.5 * _cross(fan[:, 1] - fan[:, 0], fan[:, 2] - fan[:, 0])
    points = np.einsum("pv,tvi->tpi", _TRIANGLE, fan).reshape(-1, 2)
    return points, np.repeat(area / 3.0, 3)


def convex_pieces(facet: FloatArray, others: FloatArray) -> list[FloatArray]:
    """Cut a convex polygon along the edges of others, which do not overlap each other.

    Parameters
    ----------
    facet
        (n, 2), counter-clockwise [mm].
    others
        Quadrilaterals of either sense, (k, 4, 2) [mm].

    Returns
    -------
    list[FloatArray]
        Convex polygons, each inside one of the others or outside all, that fill the facet.
    """
    size = float(np.sqrt(_area(facet)))
    rest, done = [facet], []
    low, high = facet.min(axis=0), facet.max(axis=0)
    near = ((others.max(axis=1) > low) & (others.min(axis=1) < high)).all(axis=1)
    for other in others[near]:
        quad = other if _area(other) > 0.0 else other[::-1]
        left = []
        for piece in rest:
            inside, outside = _divide(piece, quad, size)
            left += outside
            if inside is not None:
                done.append(inside)
        rest = left
    return [piece for piece in (*done, *rest) if _area(piece) > _SLIVER * size**2]


def _divide(
    piece: FloatArray, quad: FloatArray, size: float
) -> tuple[FloatArray | None, list[FloatArray]]:
    """Part of a convex piece inside a convex polygon, and convex parts outside."""
    inside, outside = piece, []
    for a, b in zip(quad, np.roll(quad, -1, axis=0), strict=True):
        along = (b - a) / np.linalg.norm(b - a)
        distance = _cross(along, inside - a)
        distance[np.abs(distance) < _ON_EDGE * size] = 0.0
        if (distance <= 0.0).all():
            return None, [piece]
        if (distance < 0.0).any():
            outside.append(_half(inside, -distance))
            inside = _half(inside, distance)
    return inside, outside


def _half(polygon: FloatArray, distance: FloatArray) -> FloatArray:
    """Part of a polygon where a linear function, given at its corners, is not negative."""
    kept = []
    following = np.roll(np.arange(len(polygon)), -1)
    for k, j in enumerate(following):
        if distance[k] >= 0.0:
            kept.append(polygon[k])
        if distance[k] * distance[j] < 0.0:
            share = distance[k] / (distance[k] - distance[j])
            kept.append(polygon[k] + share * (polygon[j] - polygon[k]))
    return np.array(kept)


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    product: FloatArray = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product


def _area(polygon: FloatArray) -> float:
    """Positive where the corners run counter-clockwise."""
    return 0.5 * float(_cross(polygon, np.roll(polygon, -1, axis=0)).sum())


def natural_coordinates(facet: FloatArray, points: FloatArray) -> FloatArray:
    """Natural coordinates (n, 2) of points (n, 2) of a plane facet (4, 2), by Newton."""
    xi = np.zeros_like(points)
    for _ in range(12):
        values, slopes = bilinear(xi)
        jacobian = np.einsum("pak,ai->pik", slopes, facet)
        way = np.linalg.solve(jacobian, (points - values @ facet)[..., None])[..., 0]
        xi += way
        if float(np.abs(way).max(initial=0.0)) < 1e-14:
            break
    return xi
