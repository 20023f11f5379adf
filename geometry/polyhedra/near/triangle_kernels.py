"""Compiled loops over triangles: sweeping boxes, growing planes, clipping, convex hulls.

Their plain callers in `geometry.polyhedra.near.triangle_search` and
`geometry.polyhedra.facet_contact` say what they mean.
"""

# mypy: disable-error-code="no-untyped-def, untyped-decorator"

from __future__ import annotations

import numpy as np

from geometry.compilation import njit

#: Two triangles overlap in at most six corners; two more cuts add one each.
MOST_CORNERS = 8
#: Nodes that wait at once in a walk down a binary tree: one a level.
DEEPEST = 64
#: Rays that pass an edge this near may be on either side of it, in sizes of the triangle.
_BESIDE = 1e-9
#: Part of a triangle's area beside an edge: what passes there passes through the edge.
_ON_EDGE = 1e-6


@njit(cache=True)
def _sort_second(pairs, first, last):
    """Sort the second numbers of a stretch of pairs: Shell's way, as most stretches are short."""
    gap = last - first
    while gap > 1:
        gap = 1 if gap < 5 else gap * 5 // 11
        for k in range(first + gap, last):
            value = pairs[k, 1]
            place = k
            while place >= first + gap and pairs[place - gap, 1] > value:
                pairs[place, 1] = pairs[place - gap, 1]
                place -= gap
            pairs[place, 1] = value


@njit(cache=True)
def _next_leaf(low, high, group, tree, tree_group, stack, top):
    """Next leaf of a walk down a tree whose box meets another, unless both are of one group.

    The first ``top`` nodes of the stack wait. Returns the number of the leaf, -1 at the end, and
    how many wait then. A box of group -1 is of none; one with a number that is none meets nothing.
    """
    first_leaf = len(tree) // 2
    while top > 0:
        top -= 1
        node = stack[top]
        if not (
            low[0] <= tree[node, 3]
            and low[1] <= tree[node, 4]
            and low[2] <= tree[node, 5]
            and high[0] >= tree[node, 0]
            and high[1] >= tree[node, 1]
            and high[2] >= tree[node, 2]
        ) or (group >= 0 and tree_group[node] == group):
            continue
        if node >= first_leaf:
            return node - first_leaf, top
        stack[top] = 2 * node + 2
        stack[top + 1] = 2 * node + 1
        top += 2
    return -1, 0


@njit(cache=True)
def boxes_in_tree(boxes, group, tree, tree_group, order, stack, pairs):
    """Count, and store as far as there is room, pairs of a box and one of a tree that overlap.

    Trees, groups and the order of pairs as in `geometry.polyhedra.near.triangle_search.BoxTree`;
    ``stack`` is room for `DEEPEST` nodes.
    """
    result = 0
    for i in range(len(boxes)):
        mine = result
        low, high = (boxes[i, 0], boxes[i, 1], boxes[i, 2]), (boxes[i, 3], boxes[i, 4], boxes[i, 5])
        stack[0] = 0
        leaf, top = _next_leaf(low, high, group[i], tree, tree_group, stack, 1)
        while leaf >= 0:
            if result < len(pairs):
                pairs[result, 0] = i
                pairs[result, 1] = order[leaf]
            result += 1
            leaf, top = _next_leaf(low, high, group[i], tree, tree_group, stack, top)
        if result <= len(pairs):
            _sort_second(pairs, mine, result)
    return result


@njit(cache=True)
def _above(point, corner, normal):
    """Height of a point above the plane through a corner, in lengths of the normal."""
    height = 0.0
    for axis in range(3):
        height += normal[axis] * (point[axis] - corner[axis])
    return height


@njit(cache=True)
def _between(point, start, end, normal):
    """Twice the area that a point spans with a side of a triangle, times the normal's length."""
    x, y, z = end[0] - start[0], end[1] - start[1], end[2] - start[2]
    u, v, w = point[0] - start[0], point[1] - start[1], point[2] - start[2]
    turned = normal[0] * (y * w - z * v) + normal[1] * (z * u - x * w)
    return turned + normal[2] * (x * v - y * u)


@njit(cache=True)
def _pierces(start, end, corners, normal, margin, point):
    """Where on a segment, in (0, 1), it passes through a triangle; -1 where it does not.

    Ends nearer than ``margin`` to the plane do not count, nor places on an edge.
    """
    low, high = _above(start, corners[0], normal), _above(end, corners[0], normal)
    square = normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]
    least = min(abs(low), abs(high))
    if low * high >= 0.0 or least <= margin * np.sqrt(square):
        return -1.0
    position = low / (low - high)
    for axis in range(3):
        point[axis] = start[axis] + position * (end[axis] - start[axis])
    for k in range(3):
        if _between(point, corners[k], corners[(k + 1) % 3], normal) <= _ON_EDGE * square:
            return -1.0
    return position


@njit(cache=True)
def segments_in_tree(
    start, end, ends, group, corners, normals, triangles, tree, tree_group, order, margin, pairs, at
):
    """Count, and store as far as there is room, segments that pass through triangles, and where.

    The tree is that of the triangles, as in `boxes_in_tree`; normals may have any length. Segments
    and triangles that share a corner, by its number in ``ends`` and ``triangles``, are no pair.
    """
    stack, point = np.empty(DEEPEST, np.int64), np.empty(3)
    result = 0
    for i in range(len(start)):
        x, y, z = start[i, 0], start[i, 1], start[i, 2]
        u, v, w = end[i, 0], end[i, 1], end[i, 2]
        low, high = (min(x, u), min(y, v), min(z, w)), (max(x, u), max(y, v), max(z, w))
        stack[0] = 0
        leaf, top = _next_leaf(low, high, group[i], tree, tree_group, stack, 1)
        while leaf >= 0:
            j = order[leaf]
            leaf, top = _next_leaf(low, high, group[i], tree, tree_group, stack, top)
            shared = False
            for k in range(3):
                shared |= triangles[j, k] == ends[i, 0] or triangles[j, k] == ends[i, 1]
            if shared:
                continue
            position = _pierces(start[i], end[i], corners[j], normals[j], margin, point)
            if position < 0.0:
                continue
            if result < len(pairs):
                pairs[result, 0], pairs[result, 1], at[result] = i, j, position
            result += 1
    return result


@njit(cache=True)
def _turns(point, corners):
    """1 where the ray upward leaves through a triangle, -1 where it enters, 0 where it misses.

    2 where it passes so near an edge that nobody can tell.
    """
    total, height, size = 0.0, 0.0, 0.0
    least, most = np.inf, -np.inf
    for k in range(3):
        one, other = corners[(k + 1) % 3], corners[(k + 2) % 3]
        x, y = one[0] - point[0], one[1] - point[1]
        u, v = other[0] - point[0], other[1] - point[1]
        # Twice the area, seen from above, that the ray makes with the side opposite corner k.
        area = x * v - u * y
        total += area
        height += area * (corners[k, 2] - point[2])
        least, most = min(least, area), max(most, area)
        size = max(size, x * x + y * y)
    nearest = least if total > 0.0 else -most
    if abs(nearest) <= _BESIDE * size:
        return 2
    if nearest < 0.0 or (height > 0.0) != (total > 0.0):
        return 0
    return 1 if total > 0.0 else -1


@njit(cache=True)
def _wound_round(point, corners, tree, tree_group, order, stack):
    """Whether more triangles above a point face up than down, or nobody can tell."""
    low, high = (point[0], point[1], point[2]), (point[0], point[1], np.inf)
    stack[0] = 0
    turns = 0
    leaf, top = _next_leaf(low, high, -1, tree, tree_group, stack, 1)
    while leaf >= 0:
        result = _turns(point, corners[order[leaf]])
        if result == 2:
            return True
        turns += result
        leaf, top = _next_leaf(low, high, -1, tree, tree_group, stack, top)
    return turns > 0


@njit(cache=True)
def enclosed_points(points, ways, corners, tree, tree_group, order, stack, inside):
    """Determine for each point whether it is inside a closed surface wherever ``ways`` move it.

    The tree is that of the triangles, as in `boxes_in_tree`.
    """
    moved = np.empty(3)
    for i in range(len(points)):
        inside[i] = True
        for way in range(len(ways)):
            for axis in range(3):
                moved[axis] = points[i, axis] + ways[way, axis]
            if not _wound_round(moved, corners, tree, tree_group, order, stack):
                inside[i] = False
                break


@njit(cache=True)
def flood_planes(order, neighbours, normals, corners, cosine, distance):
    """Grow planes from the largest triangles; returns the group of each triangle."""
    n = len(order)
    group = np.full(n, -1)
    stack = np.empty(n, np.int64)
    count = 0
    for seed in order:
        if group[seed] >= 0:
            continue
        group[seed] = count
        stack[0] = seed
        top = 1
        while top > 0:
            top -= 1
            for t in neighbours[stack[top]]:
                if t < 0 or group[t] >= 0:
                    continue
                dot = 0.0
                for axis in range(3):
                    dot += normals[t, axis] * normals[seed, axis]
                if dot < cosine:
                    continue
                near = True
                for corner in range(3):
                    height = 0.0
                    for axis in range(3):
                        height += normals[seed, axis] * (
                            corners[t, corner, axis] - corners[seed, 0, axis]
                        )
                    near = near and abs(height) <= distance
                if near:
                    group[t] = count
                    stack[top] = t
                    top += 1
        count += 1
    return group


@njit(cache=True)
def _copy(point, to):
    """Number by number: for ``to[k] = point[j]`` numba compiles words of a refusal, seconds."""
    for axis in range(3):
        to[axis] = point[axis]


@njit(cache=True)
def _cut(polygon, n, inside, value):
    """Keep the part of a convex polygon where ``value`` >= 0 (Sutherland-Hodgman, one edge).

    Never more than `MOST_CORNERS`, whatever round-off makes of convex.
    """
    kept = 0
    for k in range(n):
        following = (k + 1) % n
        a, b = value[k], value[following]
        if a >= 0.0 and kept < MOST_CORNERS:
            _copy(polygon[k], inside[kept])
            kept += 1
        if ((a > 0.0 and b < 0.0) or (a < 0.0 and b > 0.0)) and kept < MOST_CORNERS:
            t = a / (a - b)
            for axis in range(3):
                inside[kept, axis] = polygon[k, axis] + t * (
                    polygon[following, axis] - polygon[k, axis]
                )
            kept += 1
    for k in range(kept):
        _copy(inside[k], polygon[k])
    return kept


@njit(cache=True)
def _triple(a, b, c):
    """Return a · (b × c)."""
    return (
        a[0] * (b[1] * c[2] - b[2] * c[1])
        + a[1] * (b[2] * c[0] - b[0] * c[2])
        + a[2] * (b[0] * c[1] - b[1] * c[0])
    )


@njit(cache=True)
def _height(point, corner, normal, direction):
    """Distance along ``direction`` from a point to the plane through ``corner``."""
    above, along = 0.0, 0.0
    for axis in range(3):
        above += normal[axis] * (corner[axis] - point[axis])
        along += normal[axis] * direction[axis]
    return above / along


@njit(cache=True)
def clip_pairs(corners, normals, pairs, tolerances, polygons, count, area):
    """Overlap of pairs of opposing triangles, seen along their mean normal, where they touch.

    The polygon lies half-way between the two triangles; parts further apart (or deeper in each
    other) than the tolerance of the pair are cut off.
    """
    buffer = np.empty((MOST_CORNERS + 1, 3))
    polygon = np.empty((MOST_CORNERS + 1, 3))
    value = np.empty(MOST_CORNERS + 1)
    for pair in range(len(pairs)):
        i, j = pairs[pair]
        direction = normals[i] - normals[j]
        direction /= np.sqrt(direction @ direction)
        n = 3
        for k in range(3):
            _copy(corners[i, k], polygon[k])
        for edge in range(3):
            # Corners of j run clockwise seen from outside i: its edges, reversed, keep the left.
            start, end = corners[j, (edge + 1) % 3], corners[j, edge]
            for k in range(n):
                value[k] = _triple(direction, end - start, polygon[k] - start)
            n = _cut(polygon, n, buffer, value)
            if n < 3:
                break
        for sign in (-1.0, 1.0):
            if n < 3:
                break
            for k in range(n):
                gap = _height(polygon[k], corners[j, 0], normals[j], direction)
                gap -= _height(polygon[k], corners[i, 0], normals[i], direction)
                value[k] = tolerances[pair] + sign * gap
            n = _cut(polygon, n, buffer, value)
        if n < 3:
            count[pair], area[pair] = 0, 0.0
            continue
        twice = 0.0
        for k in range(1, n - 1):
            twice += _triple(direction, polygon[k] - polygon[0], polygon[k + 1] - polygon[0])
        count[pair], area[pair] = n, 0.5 * twice
        for k in range(n):
            shift = _height(polygon[k], corners[j, 0], normals[j], direction)
            shift += _height(polygon[k], corners[i, 0], normals[i], direction)
            for axis in range(3):
                polygons[pair, k, axis] = polygon[k, axis] + 0.5 * shift * direction[axis]


@njit(cache=True)
def _turn(a, b, c):
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


@njit(cache=True)
def hulls(points, start, order, tolerance, chosen, chosen_start):
    """Corners of the convex hull of each group of plane points (monotone chain).

    Corners closer than ``tolerance`` to the line of their neighbours are left out. ``order``
    sorts each group by x, then y. Writes point numbers, returns how many.
    """
    total = 0
    chain = np.empty(2 * len(points) + 2, np.int64)
    for group in range(len(start) - 1):
        first, last = start[group], start[group + 1]
        chosen_start[group] = total
        size = 0
        for half in range(2):
            base = size
            for step in range(last - first):
                i = order[first + step] if half == 0 else order[last - 1 - step]
                while size - base >= 2:
                    a, b = points[chain[size - 2]], points[chain[size - 1]]
                    dx, dy = points[i, 0] - a[0], points[i, 1] - a[1]
                    if _turn(a, b, points[i]) <= tolerance * np.sqrt(dx * dx + dy * dy):
                        size -= 1
                    else:
                        break
                chain[size] = i
                size += 1
            size -= 1
        for k in range(size):
            a = points[chain[k]]
            b = points[chain[(k + 1) % size]]
            if abs(a[0] - b[0]) + abs(a[1] - b[1]) > tolerance:
                chosen[total] = chain[k]
                total += 1
    chosen_start[len(start) - 1] = total
    return total
