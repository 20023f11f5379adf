"""Compiled search for the first meeting of two solids of which one moves along z."""

# mypy: disable-error-code="no-untyped-def, untyped-decorator"

from __future__ import annotations

import numpy as np

from geometry.compilation import njit


@njit(cache=True)
def _above(point, corners, margin):
    """Height of a triangle (3, 3) over a point (3,), both seen along z; nan where it is beside."""
    ax, ay = corners[1, 0] - corners[0, 0], corners[1, 1] - corners[0, 1]
    bx, by = corners[2, 0] - corners[0, 0], corners[2, 1] - corners[0, 1]
    px, py = point[0] - corners[0, 0], point[1] - corners[0, 1]
    area = ax * by - ay * bx
    size = (abs(ax) + abs(ay)) * (abs(bx) + abs(by))
    if abs(area) <= 1e-12 * size or size == 0.0:
        return np.nan
    u, v = (px * by - py * bx) / area, (ax * py - ay * px) / area
    if u < -margin or v < -margin or u + v > 1.0 + margin:
        return np.nan
    rise = u * (corners[1, 2] - corners[0, 2]) + v * (corners[2, 2] - corners[0, 2])
    return corners[0, 2] + rise


@njit(cache=True)
def _crossing(a, b, c, d, margin):
    """Part of a to b where c to d crosses it, seen along z, and height of c to d above; or nan."""
    rx, ry, sx, sy = b[0] - a[0], b[1] - a[1], d[0] - c[0], d[1] - c[1]
    area = rx * sy - ry * sx
    if abs(area) <= 1e-12 * (abs(rx) + abs(ry)) * (abs(sx) + abs(sy)) or area == 0.0:
        return np.nan, np.nan
    qx, qy = c[0] - a[0], c[1] - a[1]
    u, v = (qx * sy - qy * sx) / area, (qx * ry - qy * rx) / area
    if u < -margin or u > 1.0 + margin or v < -margin or v > 1.0 + margin:
        return np.nan, np.nan
    return u, c[2] + v * (d[2] - c[2]) - a[2] - u * (b[2] - a[2])


@njit(cache=True)
def _beside(low, high, points, ends):
    """Whether the box of some points lies beside another one, seen along z."""
    for k in range(2):
        least = most = points[ends[0], k]
        for end in ends[1:]:
            least, most = min(least, points[end, k]), max(most, points[end, k])
        if most < low[k] or least > high[k]:
            return True
    return False


@njit(cache=True)
def _extent(points, ends, axis):
    """Least and largest coordinate of some points."""
    least = most = points[ends[0], axis]
    for end in ends[1:]:
        least, most = min(least, points[end, axis]), max(most, points[end, axis])
    return least, most


@njit(cache=True)
def _beside_stuck(x, y, stuck):
    """Whether a point lies beside one of the corners that are not thinned, seen along z."""
    for k in range(len(stuck)):
        if (x - stuck[k, 0]) ** 2 + (y - stuck[k, 1]) ** 2 < stuck[k, 2] ** 2:
            return True
    return False


@njit(cache=True)
def _corners_meet_faces(a, b, faces, window, stuck):
    """Least way of corners a (n, 3) to faces of b along z, and against z."""
    low, high, ahead, behind = window[0], window[1], np.inf, np.inf
    kept = np.empty(len(a), np.int64)
    n = 0
    for k in range(len(a)):
        inside = low[0] <= a[k, 0] <= high[0] and low[1] <= a[k, 1] <= high[1]
        if inside and not _beside_stuck(a[k, 0], a[k, 1], stuck):
            kept[n] = k
            n += 1
    order = np.argsort(a[kept[:n], 0])
    at = a[kept[:n], 0][order]
    for face in faces:
        if _beside(low, high, b, face):
            continue
        corners = b[face]
        least, most = _extent(b, face, 0)
        for k in range(np.searchsorted(at, least), np.searchsorted(at, most, side="right")):
            point = a[kept[order[k]]]
            way = _above(point, corners, 1e-9) - point[2]
            if 0.0 <= way < ahead:
                ahead = way
            if 0.0 <= -way < behind:
                behind = -way
    return ahead, behind


@njit(cache=True)
def first_meeting(one, other, window, stuck):
    """Least distance along z at which a solid meets another one; infinite where it passes.

    Solids are their points, edges and faces; ``window`` (2, 2): least and largest x and y of what
    both share; ``stuck`` (n, 3): x, y and radius of corners beside which no meeting counts.
    """
    a, edges_a, faces_a = one
    b, edges_b, faces_b = other
    low, high = window[0], window[1]
    best = min(
        _corners_meet_faces(a, b, faces_b, window, stuck)[0],
        _corners_meet_faces(b, a, faces_a, window, stuck)[1],
    )
    kept = np.empty(len(edges_b), np.int64)
    start = np.empty(len(edges_b))
    n, widest = 0, 0.0
    for k in range(len(edges_b)):
        if not _beside(low, high, b, edges_b[k]):
            least, most = _extent(b, edges_b[k], 0)
            kept[n], start[n], widest = k, least, max(widest, most - least)
            n += 1
    order = np.argsort(start[:n])
    start = start[:n][order]
    for edge in edges_a:
        if _beside(low, high, a, edge):
            continue
        left, right = _extent(a, edge, 0)
        first = np.searchsorted(start, left - widest)
        for k in range(first, np.searchsorted(start, right, side="right")):
            meets = edges_b[kept[order[k]]]
            part, way = _crossing(a[edge[0]], a[edge[1]], b[meets[0]], b[meets[1]], 1e-9)
            if 0.0 <= way < best:
                point = a[edge[0]] + part * (a[edge[1]] - a[edge[0]])
                if not _beside_stuck(point[0], point[1], stuck):
                    best = way
    return best
