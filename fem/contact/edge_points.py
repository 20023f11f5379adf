"""Compiled loops that place points of integration on the edges where a surface ends.

Points of a piece that lie inside it only leave a strip along its edges without pressure: a block
that tips would turn about the points next to the edge. Where an edge of a piece lies on one where
either surface ends, points lie on that edge too, and rules stay as exact as without.
Facets that match before any displacement keep their Gauss points, as without a search.

- Quadrilaterals have tensor rules. Across such an edge Radau's rule replaces Gauss', across two
  of them, and on quadrilaterals that are no parallelograms, Lobatto's with one point more.
- Other pieces have a sixteenth of their area at the ends of such edges, and three points that
  complete the moments (`fem.contact.pieces`). No convex figure has a corner farther than √8 from
  its centroid in units of its second moment, so 16 · 1/16 · ½ of that moment is always left.
"""

# mypy: disable-error-code="no-untyped-def, untyped-decorator"

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import roots_jacobi

from fem.contact.pieces import area_of, in_quadrilateral, moments, three_points
from fem.element.functions import lobatto_points
from geometry.compilation import njit
from geometry.mesh import BoolArray, FloatArray, IntArray

_OPTIONS = {"error_model": "numpy", "nogil": True}

#: Distance from an end of a surface, in widths of the narrower facet, below which an edge counts
#: as lying there: what is left between them is too narrow to carry a tipping block.
_NEAR = 0.2

#: Skewness of a quadrilateral, in facet sizes, below which it is a parallelogram.
_PARALLEL = 1e-6

#: Share of the area of a piece that lies at the ends of its marked edges.
_AT_ENDS = 1.0 / 16.0

#: Facets whose normals differ by more than this cosine meet in an edge at which each ends.
_SHARP = 0.9

#: Distance between corners of facets that match, over the shortest side: more is no round-off, and
#: the continued functions of one facet err on the other by its square.
_APART = 2e-3

_INSIDE, _LOW, _HIGH, _BOTH = 0, 1, 2, 3


def _rules(n: int) -> tuple[IntArray, FloatArray, FloatArray]:
    """Counts, points and weights on [-1, 1] by the ends that are marked: none, low, high, both."""
    low = _radau(n)
    rules = [
        np.polynomial.legendre.leggauss(n),
        low,
        (-low[0], low[1]),
        _weighted(lobatto_points(n)),
    ]
    counts = np.array([len(points) for points, _ in rules])
    table = np.zeros((2, 4, n + 1))
    for k, rule in enumerate(rules):
        table[:, k, : counts[k]] = rule
    return counts, table[0], table[1]


def _radau(n: int) -> tuple[FloatArray, FloatArray]:
    """Points and weights on [-1, 1] with one at -1, exact to degree 2n - 2."""
    # The others are the roots of P_(n-1) + P_n over 1 + x, a Jacobi polynomial (0, 1).
    return _weighted(np.concatenate([[-1.0], roots_jacobi(n - 1, 0, 1)[0]]))


def _weighted(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points with the weights that integrate polynomials through them."""
    order = np.arange(len(points))
    integrals = np.where(order % 2 == 0, 2.0 / (order + 1.0), 0.0)
    weights = np.linalg.solve(points[None, :] ** order[:, None], integrals)
    return points, weights.astype(np.float64)


_COARSE, _FINE = _rules(2), _rules(3)


def ending_edges(quads: IntArray, normals: FloatArray) -> BoolArray:
    """Edges at which the surface of a facet ends, (n_facets, 4).

    Edge k of a facet runs from its corner k to the next. A surface ends where no facet follows,
    or one whose normal turns by more than half a right angle.

    Parameters
    ----------
    quads
        Nodes of the facets, (n_facets, 4); those of different blocks are different.
    normals
        Of unit length, (n_facets, 3).
    """
    ends = np.sort(np.stack([quads, np.roll(quads, -1, axis=1)], axis=2), axis=2).reshape(-1, 2)
    _, edge = np.unique(ends, axis=0, return_inverse=True)
    total = np.zeros((int(edge.max(initial=-1)) + 1, 3))
    each = np.repeat(normals, 4, axis=0)
    np.add.at(total, edge.ravel(), each)
    beside = total[edge.ravel()] - each
    result: BoolArray = np.einsum("ni,ni->n", beside, each) < _SHARP
    return result.reshape(-1, 4)


def matching_facets(
    corners: FloatArray, normals: FloatArray, block: IntArray, reach: float
) -> BoolArray:
    """Facets that another of another block matches, corner on corner along its normal, (n,).

    Points of both lie at the same places, and there contact without a search has them.

    Parameters
    ----------
    corners, normals
        Of the facets before any displacement, (n, 4, 3) [mm] and (n, 3).
    block
        Of each facet, (n,).
    reach
        Distance up to which facets touch [mm].
    """
    result = np.zeros(len(corners), dtype=np.bool_)
    sides = corners - np.roll(corners, 1, axis=1)
    apart = _APART * np.linalg.norm(sides, axis=2).min(axis=1)
    centres = corners.mean(axis=1)
    near = reach + float(apart.max(initial=0.0))
    one, two = cKDTree(centres).query_pairs(near, output_type="ndarray").T
    facing = np.einsum("ni,ni->n", normals[one], normals[two]) < -_SHARP
    one, two = (pair[facing & (block[one] != block[two])] for pair in (one, two))
    for turn in range(4):
        away = corners[one] - np.roll(corners[two, ::-1], turn, axis=1)
        along = np.einsum("nai,ni->na", away, normals[one])
        away -= along[:, :, None] * normals[one, None]
        same = np.linalg.norm(away, axis=2).max(axis=1, initial=0.0) < apart[one]
        result[one[same]] = result[two[same]] = True
    return result


@njit(**_OPTIONS)
def _on_marked(one, two, quad, marked, size):
    """Whether two points lie next to one marked edge of a plane quadrilateral."""
    area = abs(area_of(quad, 4))
    for e in range(4):
        if not marked[e]:
            continue
        f = e + 1 if e < 3 else 0
        along_x, along_y = quad[f, 0] - quad[e, 0], quad[f, 1] - quad[e, 1]
        length = math.sqrt(along_x * along_x + along_y * along_y)
        bound = _NEAR * min(size * length, area)
        first = along_x * (one[1] - quad[e, 1]) - along_y * (one[0] - quad[e, 0])
        last = along_x * (two[1] - quad[e, 1]) - along_y * (two[0] - quad[e, 0])
        if abs(first) <= bound and abs(last) <= bound:
            return True
    return False


@njit(**_OPTIONS)
def mark_edges(piece, n, flat, own, quad, other, size, marked):
    """Mark the edges of a piece at marked edges of its facet or the one it faces: their number.

    ``flat``, ``quad`` are the corners of both in one plane, ``own``, ``other`` what marks theirs.
    """
    count = 0
    for k in range(n):
        j = k + 1 if k + 1 < n else 0
        marked[k] = _on_marked(piece[k], piece[j], flat, own, size)
        if not marked[k]:
            marked[k] = _on_marked(piece[k], piece[j], quad, other, size)
        count += marked[k]
    return count


@njit(**_OPTIONS)
def edge_points(piece, marked, size, fine, points, weights):
    """Points of a quadrilateral with some on its marked edges, and their areas; their number."""
    uneven = 0.0
    for i in range(2):
        twist = piece[0, i] - piece[1, i] + piece[2, i] - piece[3, i]
        uneven = max(uneven, abs(twist))
    slant = uneven > _PARALLEL * size
    along, across = _kind(marked[3], marked[1], slant), _kind(marked[0], marked[2], slant)
    counts, places, shares = _FINE if fine else _COARSE
    values, xi, count = np.empty((4, 3)), np.empty(2), 0
    for i in range(counts[along]):
        for j in range(counts[across]):
            xi[0], xi[1] = places[along, i], places[across, j]
            area = in_quadrilateral(piece, xi, values, points[count])
            weights[count] = shares[along, i] * shares[across, j] * area
            count += 1
    return count


@njit(**_OPTIONS)
def _kind(low, high, slant):
    if (low and high) or (slant and (low or high)):
        return _BOTH
    if low:
        return _LOW
    return _HIGH if high else _INSIDE


@njit(**_OPTIONS)
def end_points(piece, n, marked, points, weights):
    """Points of a convex piece, some at the ends of its marked edges, and areas; their number."""
    area, x, y, xx, xy, yy = moments(piece, n)
    count = 0
    for k in range(n):
        if marked[k] or marked[k - 1 if k else n - 1]:
            points[count, 0], points[count, 1] = piece[k, 0], piece[k, 1]
            count += 1
    each, left = _AT_ENDS / count, 1.0 - _AT_ENDS
    dx, dy = 0.0, 0.0
    for k in range(count):
        ax, ay = points[k, 0] - x, points[k, 1] - y
        dx, dy = dx - each * ax / left, dy - each * ay / left
        xx, xy, yy = xx - each * ax * ax, xy - each * ax * ay, yy - each * ay * ay
        weights[k] = each * area
    xx, xy, yy = xx / left - dx * dx, xy / left - dx * dy, yy / left - dy * dy
    three_points(x + dx, y + dy, xx, xy, yy, points[count:])
    weights[count : count + 3] = left * area / 3.0
    return count + 3
