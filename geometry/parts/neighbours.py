"""Points near each other, by sorting: libraries of trees take longer to load than this to run."""

from __future__ import annotations

from itertools import product

import numpy as np

from geometry.mesh import FloatArray, IntArray

#: Along no edge and no face that anyone draws: few points have the same place along it.
_ASKEW = np.array([0.577, 0.643, 0.502])
#: Cells along an axis: their numbers stay small enough to be multiplied.
_MOST_CELLS = 1 << 20
#: Half of the cells round a cell, and the cell itself last: the others have it on their side.
_HALF = tuple(offset for offset in product((-1, 0, 1), repeat=3) if offset <= (0, 0, 0))


def coincident(points: FloatArray, others: FloatArray, tolerance: float) -> IntArray:
    """Number of the nearest of other points (m, 3) within a tolerance of each point, (n,).

    Where there is none, m.
    """
    result = np.full(len(points), len(others))
    at, along = points @ _ASKEW, others @ _ASKEW
    order = np.argsort(along, kind="stable")
    # Along a direction of length 1 at most, points are no farther apart than in space.
    margin = tolerance + np.finfo(np.float64).eps * float(np.abs(along).max(initial=1.0))
    first = np.searchsorted(along[order], at - margin, "left")
    end = np.searchsorted(along[order], at + margin, "right")
    point, place = _spread(first, end)
    other = order[place]
    apart = np.linalg.norm(points[point] - others[other], axis=1)
    near = apart < tolerance
    point, other, apart = point[near], other[near], apart[near]
    farthest_first = np.lexsort((-apart, point))
    result[point[farthest_first]] = other[farthest_first]
    return result


def pairs_within(points: FloatArray, reach: float) -> IntArray:
    """Pairs (i, j), i < j, of points (n, 3) that are a distance apart at most, (n_pairs, 2)."""
    low = points.min(axis=0, initial=np.inf)
    extent = float(np.ptp(points, axis=0).max(initial=0.0)) if len(points) else 0.0
    size = max(reach * (1.0 + 1e-9), extent / _MOST_CELLS)
    cells = np.floor((points - low) / size).astype(np.int64) + 1 if size > 0.0 else 0 * points
    wide = int(cells.max(initial=0)) + 2
    digits = np.array([wide * wide, wide, 1])
    keys = cells.astype(np.int64) @ digits
    order = np.argsort(keys, kind="stable")
    ordered, found = keys[order], []
    for offset in _HALF:
        beside = keys[order] + int(digits @ offset)
        first = np.searchsorted(ordered, beside, "left")
        itself = offset == (0, 0, 0)
        end = np.arange(len(order)) if itself else np.searchsorted(ordered, beside, "right")
        point, place = _spread(first, end)
        pairs = np.column_stack([order[point], order[place]])
        apart = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
        found.append(np.sort(pairs[apart <= reach], axis=1))
    return np.concatenate(found)


def _spread(first: IntArray, end: IntArray) -> tuple[IntArray, IntArray]:
    """Row and place of each number from first to end, without end, of each row; (n,) each."""
    count = end - first
    row = np.repeat(np.arange(len(count)), count)
    return row, np.arange(len(row)) + np.repeat(first - (np.cumsum(count) - count), count)
