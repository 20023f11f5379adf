"""Compiled loops over facets that face each other: closest points, and cuts along edges.

A facet of the *slave* surface that lies inside one facet of the *master* surface carries 2 × 2
Gauss points: the shape functions of both are smooth there, so a uniform pressure gives exact nodal
forces. A facet that crosses edges of the other surface, or hangs over its rim, is cut along those
edges into convex pieces (`fem.contact.pieces`). Quadrilaterals have Gauss points of their own, so
points move little when a slide begins; other pieces have three points of equal weight that
integrate quadratic functions. So the patch test holds for meshes that do not match. Where a surface
ends, points lie on its edge as well (`fem.contact.edge_points`).
"""

# mypy: disable-error-code="no-untyped-def, untyped-decorator"

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from fem.contact.edge_points import edge_points, end_points, mark_edges
from fem.contact.pieces import (
    CLOSE_ENOUGH,
    CORNERS,
    SEARCH_STEPS,
    area_of,
    clip,
    fine_points,
    moment_points,
    natural_coordinates,
    quad_functions,
    quad_points,
    sliver_points,
    width,
)
from geometry.compilation import njit
from geometry.mesh import BoolArray, FloatArray, IntArray

_OPTIONS = {"error_model": "numpy", "nogil": True}

#: Points of a piece at most: those of the triangles from one corner.
_MOST = 7 * (CORNERS - 2)

#: Pieces smaller than this share of their facet are rounding.
_SLIVER = 1e-8

#: Share of a facet beyond the edges of the one that it faces that changes no pressure: what the
#: continued shape functions err by is its square.
_BEYOND = 2e-3

#: Share of a facet that faces nothing, below which it lies wholly on the other surface.
_UNCOVERED = 1e-6

#: A point whose closest point lies this far outside a facet, in natural coordinates, faces another.
_RIM = 0.1

#: First steps of the search for a closest point, that stay on the facet.
_STEPS_INSIDE = 4

#: Facets that look at each other: least cosine between one normal and the other's opposite. What
#: leans more touches along an edge or at a corner: where edges cross, depth does not follow from
#: area, and the pressure has no bound.
OPPOSITE = 0.7

#: So do facets that lean by more than this cosine and lie in each other by more than this share of
#: the width of their piece: behind a convex edge.
_LEANING, _SHARP = 0.9, 0.5


@njit(**_OPTIONS)
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(**_OPTIONS)
def _cross(a, b, out):
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@njit(**_OPTIONS)
def _frame(corners, xi, values, x, first, second):
    """Point of a facet (4, 3) and its tangents at natural coordinates."""
    quad_functions(xi, values)
    for i in range(3):
        x[i], first[i], second[i] = 0.0, 0.0, 0.0
        for a in range(4):
            x[i] += values[a, 0] * corners[a, i]
            first[i] += values[a, 1] * corners[a, i]
            second[i] += values[a, 2] * corners[a, i]


@njit(**_OPTIONS)
def closest_point(corners, point, xi, work):
    """Closest point of a facet or of its bilinear continuation, within twice its size.

    Newton from ``xi``, updated; returns the gap and leaves the normal in ``work[5]``. The first
    steps stay on the facet: the continuation of one that tapers folds, and Newton stops there.
    """
    values = work[:4]
    x, normal, first, second = work[4], work[5], work[6], work[7]
    d = work[8]
    for step in range(SEARCH_STEPS):
        most = 1.0 if step < _STEPS_INSIDE else 2.0
        _frame(corners, xi, values, x, first, second)
        _cross(first, second, normal)
        along, mixed = 0.0, 0.0
        for i in range(3):
            d[i] = point[i] - x[i]
            along += d[i] * normal[i]
            twist = corners[0, i] - corners[1, i] + corners[2, i] - corners[3, i]
            mixed += 0.25 * twist * normal[i]
        a, b, c = _dot(first, first), _dot(first, second), _dot(second, second)
        # Of the distance the part along the normal: the rest vanishes where the iteration ends, and
        # on its way leads away from points of skewed facets.
        b -= mixed * along / (a * c - b * b)
        p, q = _dot(d, first), _dot(d, second)
        scale = a * c - b * b
        r = min(max(xi[0] + (c * p - b * q) / scale, -most), most)
        s = min(max(xi[1] + (a * q - b * p) / scale, -most), most)
        way = abs(r - xi[0]) + abs(s - xi[1])
        xi[0], xi[1] = r, s
        if way < CLOSE_ENOUGH and (most > 1.0 or max(abs(r), abs(s)) < 1.0):
            break
    _frame(corners, xi, values, x, first, second)
    _cross(first, second, normal)
    size = math.sqrt(_dot(normal, normal))
    gap = 0.0
    for i in range(3):
        normal[i] /= size
        gap += (point[i] - x[i]) * normal[i]
    return gap


# ---------------------------------------------------------------------------------------------
# Cuts


@njit(**_OPTIONS)
def _plane(corners, plane, flat):
    """Centre, two axes and normal of a facet (4, 3) in ``plane`` (4, 3), its corners in them."""
    for i in range(3):
        plane[0, i] = 0.25 * (corners[0, i] + corners[1, i] + corners[2, i] + corners[3, i])
        plane[1, i] = corners[1, i] + corners[2, i] - corners[0, i] - corners[3, i]
        plane[2, i] = corners[2, i] + corners[3, i] - corners[0, i] - corners[1, i]
    _cross(plane[1], plane[2], plane[3])
    for k in (1, 3):
        size = math.sqrt(_dot(plane[k], plane[k]))
        for i in range(3):
            plane[k, i] /= size
    _cross(plane[3], plane[1], plane[2])
    _project(corners, plane, flat)


@njit(**_OPTIONS)
def _project(corners, plane, flat):
    for a in range(4):
        flat[a, 0], flat[a, 1] = 0.0, 0.0
        for i in range(3):
            away = corners[a, i] - plane[0, i]
            flat[a, 0] += away * plane[1, i]
            flat[a, 1] += away * plane[2, i]


@njit(**_OPTIONS)
def _opposition(corners, plane, normal):
    """Cosine between the normal of a plane and the opposite of a facet's."""
    first, second = np.empty(3), np.empty(3)
    for i in range(3):
        first[i] = corners[2, i] - corners[0, i]
        second[i] = corners[3, i] - corners[1, i]
    _cross(first, second, normal)
    return -_dot(normal, plane[3]) / math.sqrt(_dot(normal, normal))


@njit(**_OPTIONS)
def _apart(flat, quad):
    """Whether the boxes round two quadrilaterals do not overlap."""
    for i in range(2):
        if max(flat[0, i], flat[1, i], flat[2, i], flat[3, i]) <= min(
            quad[0, i], quad[1, i], quad[2, i], quad[3, i]
        ):
            return True
        if min(flat[0, i], flat[1, i], flat[2, i], flat[3, i]) >= max(
            quad[0, i], quad[1, i], quad[2, i], quad[3, i]
        ):
            return True
    return False


@njit(**_OPTIONS)
def _box(flat, piece, n, box, xi):
    """Box round a piece in natural coordinates of its facet, lower then upper corner."""
    box[0], box[1] = 1.0, -1.0
    for a in range(n):
        natural_coordinates(flat, piece[a], xi)
        for i in range(2):
            box[0, i] = max(min(box[0, i], xi[i]), -1.0)
            box[1, i] = min(max(box[1, i], xi[i]), 1.0)


@njit(**_OPTIONS)
def _lift(values, own, point):
    """Point of a facet (4, 3) whose shape functions are the first column of ``values``."""
    for i in range(3):
        point[i] = 0.0
        for a in range(4):
            point[i] += values[a, 0] * own[a, i]


@njit(**_OPTIONS)
def _within(own, flat, other, at, many, bounds, xi, work):
    """Mean distance of points of a plane facet from another, infinite where that is not faced.

    And whether all of them lie behind it. ``xi``: out, natural coordinates on both, (many, 2, 2).
    """
    values, point = np.empty((4, 3)), np.empty(3)
    least, most, out, mean = np.inf, -np.inf, 0.0, 0.0
    for p in range(many):
        natural_coordinates(flat, at[p], xi[p, 0])
        quad_functions(xi[p, 0], values)
        _lift(values, own, point)
        xi[p, 1, 0], xi[p, 1, 1] = 0.0, 0.0
        gap = closest_point(other, point, xi[p, 1], work)
        least, most = min(least, gap), max(most, gap)
        mean += abs(gap) / many
        out = max(out, abs(xi[p, 1, 0]), abs(xi[p, 1, 1]))
    faced = least <= bounds[1] and most >= bounds[0] and out <= 1.0 + _RIM
    return mean if faced else np.inf, most < 0.0


@njit(**_OPTIONS)
def _piece(own, flat, plane, other, bounds, size, piece, at, xi, work):
    """Corners' number of the piece of a facet over another, its area and distance."""
    quad, turned, spare = np.empty((4, 2)), np.empty((4, 2)), np.empty((CORNERS, 2))
    opposition = _opposition(other, plane, work[0])
    if not opposition > OPPOSITE:
        return 0, 0.0, np.inf
    _project(other, plane, turned)
    if _apart(flat, turned):
        return 0, 0.0, np.inf
    for a in range(4):
        for i in range(2):
            quad[a, i], piece[a, i] = turned[3 - a, i], flat[a, i]
    n = clip(piece, 4, quad, size, spare)
    if n == 0 or area_of(piece, n) <= _SLIVER * size * size:
        return 0, 0.0, np.inf
    area = moment_points(piece, n, at)
    distance, behind = _within(own, flat, other, at, 3, bounds, xi, work)
    if behind and opposition < _LEANING and distance > _SHARP * width(piece, n):
        return 0, 0.0, np.inf
    return n, area, distance


# Rows are copied number by number: numba compiles for ``a[k] = b[j]`` the words in which it would
# reject rows of other lengths, a quarter of what a first run compiles.
@njit(**_OPTIONS)
def _corners_of(quad, position, corners):
    """Corners of a facet, (4, 3)."""
    for a in range(4):
        for i in range(3):
            corners[a, i] = position[quad[a], i]


@njit(**_OPTIONS)
def _copy(plane, to):
    """Copy plane points (n, 2) to the first places of others."""
    for a in range(plane.shape[0]):
        for i in range(2):
            to[a, i] = plane[a, i]


class CutFacets(NamedTuple):
    """Facets of all blocks."""

    position: FloatArray
    """Surface nodes, (n_nodes, 3) [mm]."""
    quads: IntArray
    """Facets as surface nodes, (n_facets, 4)."""
    ending: BoolArray
    """Edges of the facets at which a surface ends, alike."""
    area: FloatArray
    """Of the facets before any displacement, (n_facets,) [mm²]."""


class Neighbours(NamedTuple):
    """Facets that each facet may face."""

    start: IntArray
    """Those of facet f are ``facet[start[f]:start[f + 1]]``, (n_facets + 1,)."""
    facet: IntArray
    """(n,)"""
    share: FloatArray
    """With which the points of a facet against each count, (n,)."""
    bounds: FloatArray
    """Least and largest gap at which a point faces a facet, (2,) [mm]."""


class PointsOnFacets(NamedTuple):
    """Points of a search and what they face."""

    slave: IntArray
    """Facet of each point, (n,)."""
    shapes: FloatArray
    """Functions of its nodes there, (n, n_nodes)."""
    weights: FloatArray
    """Area that each point stands for, of the undeformed surface, (n,) [mm²]."""
    cells: FloatArray
    """Box round that area in natural coordinates, lower then upper corner, (n, 2, 2)."""
    facet: IntArray
    """Facet that each point faces, (n,)."""
    xi: FloatArray
    """Natural coordinates of the closest point there, (n, 2)."""


@njit(cache=True, **_OPTIONS)
def cut_facets(facets, neighbours, slight, fine, points):
    """Points of all facets on their pieces, each with the facet that it faces.

    Parameters
    ----------
    facets, neighbours
        `CutFacets` and `Neighbours`.
    slight
        Share of a facet's nodal forces by which the points of a sliver may err; 0: none.
    fine
        Whether points integrate functions of degree 4, of facets that are pieces of curved ones.
    points
        Out: `PointsOnFacets`, up to a capacity.

    Returns
    -------
    int
        Number of points; what exceeds the capacity is counted and not written.
    """
    position, quads, ending, area = facets
    start, near, share, bounds = neighbours
    slave, shapes, weights, cells, facet, xi = points
    most = 1
    for f in range(len(quads)):
        most = max(most, start[f + 1] - start[f])
    pieces, corners = np.empty((most, CORNERS, 2)), np.empty(most, np.int64)
    which, sizes, away = np.empty(most, np.int64), np.empty(most), np.empty(most)
    own, other, plane = np.empty((4, 3)), np.empty((4, 3)), np.empty((4, 3))
    flat, at = np.empty((4, 2)), np.empty((_MOST, 2))
    part, pair = np.empty(_MOST), np.empty((_MOST, 2, 2))
    values, work, box = np.empty((4, 3)), np.empty((9, 3)), np.empty((2, 2))
    turned, marked = np.empty((4, 2)), np.empty(CORNERS, np.bool_)
    count = 0
    for f in range(len(quads)):
        if start[f] == start[f + 1]:
            continue
        _corners_of(quads[f], position, own)
        _plane(own, plane, flat)
        whole = area_of(flat, 4)
        result, covered = 0, 0.0
        for k in range(start[f], start[f + 1]):
            _corners_of(quads[near[k]], position, other)
            n, size, distance = _piece(
                own, flat, plane, other, bounds, math.sqrt(whole), pieces[result], at, pair, work
            )
            if distance < np.inf:
                which[result], corners[result], sizes[result], away[result] = k, n, size, distance
                covered += size
                result += 1
        while covered > (1.0 + _UNCOVERED) * whole and result > 1:
            far = np.argmax(away[:result])
            if covered - whole < 0.5 * sizes[far]:
                break  # roughness
            # Something behind the other surface: what is nearest is faced.
            covered -= sizes[far]
            result -= 1
            which[far], corners[far] = which[result], corners[result]
            sizes[far], away[far] = sizes[result], away[result]
            _copy(pieces[result], pieces[far])
        largest = np.argmax(sizes[:result]) if result else 0
        inside = result > 0 and sizes[largest] > (1.0 - _BEYOND) * whole
        if inside and covered > (1.0 - _UNCOVERED) * whole:
            # It lies inside one facet: what sticks out changes nothing.
            which[0], corners[0], result = which[largest], 4, 1
            _copy(flat, pieces[0])
        for c in range(result):
            n = corners[c]
            _corners_of(quads[near[which[c]]], position, other)
            _project(other, plane, turned)
            mine, its, size = ending[f], ending[near[which[c]]], math.sqrt(whole)
            ends = mark_edges(pieces[c], n, flat, mine, turned, its, size, marked)
            many = sliver_points(pieces[c], n, slight * whole * whole, at)
            if many:
                part[:] = sizes[c] / many
            elif ends and n == 4:
                many = edge_points(pieces[c], marked, size, fine, at, part)
            elif ends and not fine:
                many = end_points(pieces[c], n, marked, at, part)
            elif fine:
                many = fine_points(pieces[c], n, at, part)
            elif n == 4:
                many = 4
                quad_points(pieces[c], at, part)
            else:
                many = 3
                part[:] = moment_points(pieces[c], n, at) / 3.0
            _within(own, flat, other, at, many, bounds, pair, work)
            _box(flat, pieces[c], n, box, work[0])
            for p in range(many):
                if count < len(slave):
                    quad_functions(pair[p, 0], values)
                    slave[count], facet[count] = f, near[which[c]]
                    for a in range(4):
                        shapes[count, a] = values[a, 0]
                    xi[count, 0], xi[count, 1] = pair[p, 1, 0], pair[p, 1, 1]
                    weights[count] = part[p] / whole * area[f] * share[which[c]]
                    _copy(box, cells[count])
                count += 1
    return count


@njit(cache=True, **_OPTIONS)
def carry_over(old_slave, old_shapes, old, slave, shapes, new):
    """Give new points what the nearest old point of the same facet had, zero where it had none.

    Parameters
    ----------
    old_slave, slave
        Facet of each point, ascending, (n,) and (m,).
    old_shapes, shapes
        Shape functions of its corners at each point, (n, 4) and (m, 4).
    old, new
        What points have, (n, k) and, out, (m, k).
    """
    first = 0
    for p in range(len(slave)):
        while first < len(old_slave) and old_slave[first] < slave[p]:
            first += 1
        nearest, least = -1, np.inf
        q = first
        while q < len(old_slave) and old_slave[q] == slave[p]:
            away = 0.0
            for a in range(4):
                away += (old_shapes[q, a] - shapes[p, a]) ** 2
            if away < least:
                nearest, least = q, away
            q += 1
        for i in range(old.shape[1]):
            new[p, i] = old[nearest, i] if nearest >= 0 else 0.0
