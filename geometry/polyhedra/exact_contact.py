"""Where curved faces of CAD models touch: by their exact shape, whatever the facets.

Facets of curved faces share polygons where they are nearer to each other than they lie off their
faces. From the corners of these the place is sought where both faces are parallel: the gap is
least there. Faces that fit each other touch all over; others along lines and at points. Of what
they share a strip is kept within which the gap is at most the contact tolerance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geometry.mesh import FloatArray, IntArray
from geometry.polyhedra.placed_shapes import PlacedShapes

#: Sum of two opposing normals where faces are parallel, at their corners and where it was sought.
_PARALLEL, _SOUGHT = 1e-4, 1e-3
#: Farthest place of least gap from a corner, in sizes of the facets; the first step of a secant as
#: a part of it, and how many follow.
_FARTHEST, _NEAREST, _STEPS = 2.0, 0.02, 3


@dataclass(frozen=True)
class Touched:
    """Polygons of pairs of facets on exact faces."""

    corners: FloatArray
    """Of the strip within the tolerance, (n, most, 3) [mm]."""
    touch: FloatArray
    """Where the faces touch, for each corner, (n, most, 3) [mm]."""
    count: IntArray
    """Corners of each, 0 where the faces do not touch, (n,)."""
    gaps: FloatArray
    """Least gap, negative where the faces overlap, (n,) [mm]."""


def touched(world: PlacedShapes, pairs: IntArray, corners: FloatArray, count: IntArray) -> Touched:
    """Look at polygons (n, most, 3), with ``count`` (n,) corners, of pairs of triangles (n, 2)."""
    used = np.arange(corners.shape[1]) < count[:, None]
    row, place = np.nonzero(used)
    m, s = pairs[row].T
    start = corners[row, place]
    size = _FARTHEST * np.maximum(world.sizes[m], world.sizes[s])
    gap, middle, touch, least = _least_gaps(world, start, (m, s), size)
    tolerance = world.tolerance
    with np.errstate(invalid="ignore"):
        room = np.sqrt(np.maximum(tolerance - least, 0.0) / np.maximum(gap - least, 1e-300))
    room = np.where(np.isfinite(room), room, 0.0)
    strip = touch + np.minimum(room, 1.0)[:, None] * (middle - touch)
    kept = least <= tolerance
    result = Touched(
        corners.copy(), corners.copy(), np.zeros_like(count), np.full(len(count), np.inf)
    )
    np.minimum.at(result.gaps, row, least)
    # Corners that are kept move up to the first places.
    np.add.at(result.count, row[kept], 1)
    first = np.concatenate([[0], np.cumsum(result.count)])[row[kept]]
    slot = np.arange(len(first)) - first
    result.corners[row[kept], slot] = strip[kept]
    result.touch[row[kept], slot] = touch[kept]
    return result


def _least_gaps(
    world: PlacedShapes, start: FloatArray, facets: tuple[IntArray, IntArray], farthest: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Gaps at some points and the points between the faces; places of least gaps, and these."""
    m, s = facets
    gap, slope, middle = world.apart(start, m, s)
    steepness = np.linalg.norm(slope, axis=1)
    moves = steepness > _PARALLEL
    direction = -slope / np.maximum(steepness, 1e-300)[:, None]
    # Secants along the slope: it is linear in the distance on cylinders and spheres.
    before, at_before = np.zeros(len(start)), steepness
    moves &= np.isfinite(gap)
    guess = 2.0 * np.abs(np.where(moves, gap, 0.0)) / np.maximum(steepness, 1e-300)
    guess = np.clip(guess, _NEAREST * farthest, farthest)
    now = np.where(moves, guess, 0.0)
    for _ in range(_STEPS):
        _, slope, _ = world.apart(start + now[:, None] * direction, m, s)
        at_now = -np.einsum("ni,ni->n", slope, direction)
        change = at_before - at_now
        falls = moves & (np.abs(change) > 1e-12)
        step = np.where(falls, at_now * (now - before) / np.where(falls, change, 1.0), 0.0)
        before, at_before, now = now, at_now, now + step
    there = moves & np.isfinite(now) & (now > 0.0) & (now <= farthest)
    now = np.where(there, now, 0.0)
    least, slope, touch = world.apart(start + now[:, None] * direction, m, s)
    there &= np.linalg.norm(slope, axis=1) <= np.maximum(_SOUGHT * steepness, _PARALLEL)
    # A gap falls by its slope times the way: another side of the face is none of it.
    there &= (least <= gap) & (gap <= least + steepness * now)
    touch = np.where(there[:, None], touch, middle)
    return gap, middle, touch, np.where(there, least, gap)
