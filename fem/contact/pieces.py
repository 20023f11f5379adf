"""Compiled loops over convex polygons in the plane of a facet: clipping, moments, points.

Quadrilaterals have Gauss points of their own; other pieces have three points of equal weight: with
centroid c, second moment M = L Lᵀ (over the area), and v_k the corners of an equilateral triangle
of radius √2,

    x_k = c + L v_k

integrate quadratic functions on *any* piece, and lie in it: a convex figure of unit second moment
holds the disc of radius √2 round its centroid (Kannan, Lovász and Simonovits, Discrete Comput.
Geom. 13 (1995), theorem 4.1).
"""

# mypy: disable-error-code="no-untyped-def, untyped-decorator"

from __future__ import annotations

import math

import numpy as np

from geometry.compilation import njit

_OPTIONS = {"error_model": "numpy", "nogil": True}

#: Newton iterations on the closest point of a facet, from its centre.
SEARCH_STEPS = 12

#: Newton on natural coordinates is quadratic: a step of this leaves an error of its square.
CLOSE_ENOUGH = 1e-8

#: Corners of a cut polygon at most: four, and one more for each edge that cuts.
CORNERS = 12

#: Distance from an edge, in facet sizes, below which a corner lies on it.
_ON_EDGE = 1e-9

#: Radon's points of a triangle, exact to degree 5: shares of the corners, and weights.
_NEAR, _FAR = (6.0 - math.sqrt(15.0)) / 21.0, (6.0 + math.sqrt(15.0)) / 21.0
_RADON = np.concatenate(
    [np.full((1, 3), 1.0 / 3.0), *(x + (1.0 - 3.0 * x) * np.eye(3) for x in (_NEAR, _FAR))]
)
_RADON_WEIGHTS = (
    np.repeat(np.array([270.0, 155.0 - 15.0**0.5, 155.0 + 15.0**0.5]), [1, 3, 3]) / 1200
)


@njit(**_OPTIONS)
def quad_functions(xi, values):
    """Bilinear shape functions and their two slopes at natural coordinates, (4, 3)."""
    for a in range(4):
        r = -1.0 if a in (0, 3) else 1.0
        s = -1.0 if a in (0, 1) else 1.0
        values[a, 0] = 0.25 * (1.0 + r * xi[0]) * (1.0 + s * xi[1])
        values[a, 1] = 0.25 * r * (1.0 + s * xi[1])
        values[a, 2] = 0.25 * s * (1.0 + r * xi[0])


@njit(**_OPTIONS)
def area_of(polygon, n):
    """Positive where the corners run counter-clockwise."""
    total = 0.0
    for k in range(n):
        j = k + 1 if k + 1 < n else 0
        total += polygon[k, 0] * polygon[j, 1] - polygon[k, 1] * polygon[j, 0]
    return 0.5 * total


@njit(**_OPTIONS)
def clip(polygon, n, quad, size, spare):
    """Part of a convex polygon inside a counter-clockwise quadrilateral: its corners' number.

    ``polygon`` (m, 2) is overwritten, ``spare`` alike is work.
    """
    for e in range(4):
        f = e + 1 if e < 3 else 0
        along_x, along_y = quad[f, 0] - quad[e, 0], quad[f, 1] - quad[e, 1]
        length = math.sqrt(along_x * along_x + along_y * along_y)
        if not length > 0.0:
            continue
        kept = 0
        for k in range(n):
            j = k + 1 if k + 1 < n else 0
            here = along_x * (polygon[k, 1] - quad[e, 1]) - along_y * (polygon[k, 0] - quad[e, 0])
            there = along_x * (polygon[j, 1] - quad[e, 1]) - along_y * (polygon[j, 0] - quad[e, 0])
            here /= length
            there /= length
            if abs(here) < _ON_EDGE * size:
                here = 0.0
            if abs(there) < _ON_EDGE * size:
                there = 0.0
            if here >= 0.0:
                spare[kept, 0], spare[kept, 1] = polygon[k, 0], polygon[k, 1]
                kept += 1
            if here * there < 0.0:
                share = here / (here - there)
                for i in range(2):
                    spare[kept, i] = polygon[k, i] + share * (polygon[j, i] - polygon[k, i])
                kept += 1
        n = kept
        for k in range(n):
            polygon[k, 0], polygon[k, 1] = spare[k, 0], spare[k, 1]
        if n < 3:
            return 0
    return n


@njit(**_OPTIONS)
def moments(polygon, n):
    """Area of a convex polygon, its centroid, and second moments about it over the area."""
    area, x, y, xx, xy, yy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    ox, oy = polygon[0, 0], polygon[0, 1]
    for k in range(1, n - 1):
        ax, ay = polygon[k, 0] - ox, polygon[k, 1] - oy
        bx, by = polygon[k + 1, 0] - ox, polygon[k + 1, 1] - oy
        part = 0.5 * (ax * by - ay * bx)
        area += part
        x += part * (ax + bx) / 3.0
        y += part * (ay + by) / 3.0
        xx += part * (ax * ax + ax * bx + bx * bx) / 6.0
        xy += part * (2.0 * ax * ay + ax * by + bx * ay + 2.0 * bx * by) / 12.0
        yy += part * (ay * ay + ay * by + by * by) / 6.0
    x, y = x / area, y / area
    return area, ox + x, oy + y, xx / area - x * x, xy / area - x * y, yy / area - y * y


@njit(**_OPTIONS)
def width(polygon, n):
    """Smaller side of the rectangle that has the moments of a convex polygon."""
    _, _, _, xx, xy, yy = moments(polygon, n)
    return math.sqrt(12.0 * max(0.5 * (xx + yy) - math.hypot(0.5 * (xx - yy), xy), 0.0))


@njit(**_OPTIONS)
def sliver_points(polygon, n, least, points):
    """One or two points of equal weight that integrate what matters on a sliver; none elsewhere.

    A moment λ of area A on a facet of area W changes its nodal forces by a share of A λ / W². Where
    A λ is below ``least`` the moment is left out: two points lie at the root of the larger moment
    along its axis, one in the centroid.
    """
    area, x, y, xx, xy, yy = moments(polygon, n)
    mean, half = 0.5 * (xx + yy), math.hypot(0.5 * (xx - yy), xy)
    if area * (mean - half) >= least:
        return 0
    if area * (mean + half) < least:
        points[0, 0], points[0, 1] = x, y
        return 1
    angle, root = 0.5 * math.atan2(2.0 * xy, xx - yy), math.sqrt(mean + half)
    for k in range(2):
        way = root if k else -root
        points[k, 0], points[k, 1] = x + way * math.cos(angle), y + way * math.sin(angle)
    return 2


@njit(**_OPTIONS)
def moment_points(polygon, n, points):
    """Three points that integrate quadratic functions on a convex polygon; its area."""
    area, x, y, xx, xy, yy = moments(polygon, n)
    three_points(x, y, xx, xy, yy, points)
    return area


@njit(**_OPTIONS)
def three_points(x, y, xx, xy, yy, points):
    """Three points of equal weight with a centroid and second moments about it."""
    low_xx = math.sqrt(max(xx, 0.0))
    low_xy = xy / low_xx if low_xx > 0.0 else 0.0
    low_yy = math.sqrt(max(yy - low_xy * low_xy, 0.0))
    for k in range(3):
        angle = 0.5 * math.pi + 2.0 * math.pi * k / 3.0
        u, v = math.sqrt(2.0) * math.cos(angle), math.sqrt(2.0) * math.sin(angle)
        points[k, 0] = x + low_xx * u
        points[k, 1] = y + low_xy * u + low_yy * v


@njit(**_OPTIONS)
def quad_points(quad, points, weights):
    """2 × 2 Gauss points of a plane quadrilateral and their areas."""
    values, xi = np.empty((4, 3)), np.empty(2)
    for k in range(4):
        xi[0] = (-1.0 if k in (0, 3) else 1.0) / math.sqrt(3.0)
        xi[1] = (-1.0 if k in (0, 1) else 1.0) / math.sqrt(3.0)
        weights[k] = in_quadrilateral(quad, xi, values, points[k])


@njit(**_OPTIONS)
def in_quadrilateral(quad, xi, values, point):
    """Point of a plane quadrilateral at natural coordinates; its area over that in them."""
    quad_functions(xi, values)
    rx, ry, sx, sy = 0.0, 0.0, 0.0, 0.0
    point[0], point[1] = 0.0, 0.0
    for a in range(4):
        point[0] += values[a, 0] * quad[a, 0]
        point[1] += values[a, 0] * quad[a, 1]
        rx += values[a, 1] * quad[a, 0]
        ry += values[a, 1] * quad[a, 1]
        sx += values[a, 2] * quad[a, 0]
        sy += values[a, 2] * quad[a, 1]
    return rx * sy - ry * sx


@njit(**_OPTIONS)
def fine_points(piece, n, points, weights):
    """Points of a convex piece for functions of degree 4, and their areas; their number.

    Quadrilaterals have 3 × 3 Gauss points, other pieces Radon's in triangles from one corner.
    """
    count = 0
    if n == 4:
        values, xi = np.empty((4, 3)), np.empty(2)
        for i in range(3):
            for j in range(3):
                xi[0], xi[1] = (i - 1) * math.sqrt(0.6), (j - 1) * math.sqrt(0.6)
                weight = (5.0 if i != 1 else 8.0) * (5.0 if j != 1 else 8.0) / 81.0
                weights[count] = weight * in_quadrilateral(piece, xi, values, points[count])
                count += 1
        return count
    for k in range(1, n - 1):
        ax, ay = piece[k, 0] - piece[0, 0], piece[k, 1] - piece[0, 1]
        bx, by = piece[k + 1, 0] - piece[0, 0], piece[k + 1, 1] - piece[0, 1]
        area = 0.5 * (ax * by - ay * bx)
        for p in range(7):
            weights[count] = area * _RADON_WEIGHTS[p]
            points[count, 0] = piece[0, 0] + _RADON[p, 1] * ax + _RADON[p, 2] * bx
            points[count, 1] = piece[0, 1] + _RADON[p, 1] * ay + _RADON[p, 2] * by
            count += 1
    return count


@njit(**_OPTIONS)
def natural_coordinates(quad, point, xi):
    """Natural coordinates of a point of a plane quadrilateral (4, 2), by Newton."""
    values = np.empty((4, 3))
    xi[0], xi[1] = 0.0, 0.0
    for _ in range(SEARCH_STEPS):
        quad_functions(xi, values)
        px, py, rx, ry, sx, sy = point[0], point[1], 0.0, 0.0, 0.0, 0.0
        for a in range(4):
            px -= values[a, 0] * quad[a, 0]
            py -= values[a, 0] * quad[a, 1]
            rx += values[a, 1] * quad[a, 0]
            ry += values[a, 1] * quad[a, 1]
            sx += values[a, 2] * quad[a, 0]
            sy += values[a, 2] * quad[a, 1]
        scale = rx * sy - ry * sx
        dr, ds = (sy * px - sx * py) / scale, (rx * py - ry * px) / scale
        xi[0] += dr
        xi[1] += ds
        if abs(dr) + abs(ds) < CLOSE_ENOUGH:
            break
