"""Laws of work and precision: extrapolation, observed orders, Pareto fronts, what a target costs.

Nothing here knows how an answer was computed; all functions take plain numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.optimize import brentq

from geometry.mesh import FloatArray

#: Orders that an extrapolation may assume; outside, the levels do not follow h^q.
_LEAST_ORDER, _MOST_ORDER = 0.3, 6.0
#: An extrapolated value is never called better than this share of its last correction.
_LEAST_SHARE = 0.25


@dataclass(frozen=True)
class Extrapolated:
    """A value without its mesh, and how far to trust it."""

    value: FloatArray
    """(n,)"""
    error: float
    """Estimated error in the norm of the values."""
    order: float | None
    """Observed order of the finest three levels; None where they follow none."""


@dataclass(frozen=True)
class Point:
    """What one setting costs and how wrong it is."""

    cost: float
    """CPU time [s]."""
    error: float
    """Relative error [-]."""


def norm(values: FloatArray, weights: FloatArray) -> float:
    """√Σ w v²."""
    return float(np.sqrt(weights @ values**2))


def observed_order(
    levels: Sequence[float], values: Sequence[FloatArray], weights: FloatArray
) -> float | None:
    """Order q with which three levels converge, |v₁ - v₂| / |v₂ - v₃| as for v + C h^q.

    Parameters
    ----------
    levels
        Three refinement factors, ascending; h = 1/level.
    values
        At each level, (n,).
    weights
        Of the entries in the norm √Σ w v², (n,).

    Returns
    -------
    float | None
        None where the differences turn round or do not shrink as any order from 0.3 to 6 would.
    """
    first, second = values[0] - values[1], values[1] - values[2]
    before, after = norm(first, weights), norm(second, weights)
    if after == 0.0 or float(weights @ (first * second)) <= 0.0:
        return None
    wanted = before / after
    h = 1.0 / np.asarray(levels, dtype=np.float64)

    def ratio(q: float) -> float:
        return float((h[0] ** q - h[1] ** q) / (h[1] ** q - h[2] ** q))

    low, high = _LEAST_ORDER, _MOST_ORDER
    if not ratio(low) <= wanted <= ratio(high):
        return None
    return float(brentq(lambda q: ratio(q) - wanted, low, high, xtol=1e-12))


def _extrapolate(
    levels: Sequence[float], values: Sequence[FloatArray], weights: FloatArray
) -> tuple[FloatArray, float | None]:
    order = observed_order(levels, values, weights)
    if order is None:
        return values[2], None
    h = 1.0 / np.asarray(levels, dtype=np.float64)
    share = h[2] ** order / (h[1] ** order - h[2] ** order)
    return values[2] + share * (values[2] - values[1]), order


def richardson(
    levels: Sequence[float], values: Sequence[FloatArray], weights: FloatArray | None = None
) -> Extrapolated:
    """Extrapolate to vanishing mesh size with the order that the levels show.

    The error is the larger of a quarter of the last correction and, from four levels on, the
    difference of the extrapolations with and without the finest level; from three levels, the
    whole correction. Levels that follow no order are not extrapolated: then the finest value
    stands, and its error is the largest difference among the finest three.

    Parameters
    ----------
    levels
        At least three refinement factors, ascending; mesh size is 1/level.
    values
        At each level, (n,).
    weights
        Of the entries in the norm √Σ w v², (n,); ones by default.
    """
    if len(levels) < 3 or len(levels) != len(values):
        counts = f"{len(levels)} levels, {len(values)} values"
        raise ValueError(f"got {counts}; expected three or more")
    if any(b <= a for a, b in pairwise(levels)) or levels[0] <= 0:
        raise ValueError(f"got levels {list(levels)}, expected positive ascending ones")
    w = np.ones(len(values[0])) if weights is None else weights
    value, order = _extrapolate(levels[-3:], values[-3:], w)
    if order is None:
        spread = max(norm(v - values[-1], w) for v in values[-3:-1])
        return Extrapolated(values[-1], spread, None)
    correction = norm(value - values[-1], w)
    if len(levels) == 3:
        return Extrapolated(value, correction, order)
    before, earlier = _extrapolate(levels[-4:-1], values[-4:-1], w)
    change = correction if earlier is None else norm(value - before, w)
    return Extrapolated(value, max(change, _LEAST_SHARE * correction), order)


def fitted_order(levels: Sequence[float], errors: Sequence[float], *, floor: float) -> float | None:
    """Slope of log error over log h, least squares, where the error is above twice ``floor``.

    Returns
    -------
    float | None
        None with fewer than two such levels.
    """
    used = [
        (np.log(1.0 / k), np.log(e)) for k, e in zip(levels, errors, strict=True) if e > 2 * floor
    ]
    if len(used) < 2:
        return None
    x, y = np.array(used).T
    return float(np.polyfit(x, y, 1)[0])


def pareto_front(points: Sequence[Point]) -> list[int]:
    """Positions of the points that no other point beats, by ascending cost.

    A point is beaten by one that costs no more and errs no more and is better in one of the two;
    of equal points the first stays.
    """
    order = sorted(range(len(points)), key=lambda i: (points[i].cost, points[i].error, i))
    front: list[int] = []
    best = np.inf
    for i in order:
        if points[i].error < best:
            front.append(i)
            best = points[i].error
    return front


def cheapest(
    points: Sequence[Point],
    finer: Sequence[Sequence[int]],
    target: float,
    reference_error: float,
) -> int | None:
    """Cheapest point that keeps the error within a target, the reference's own error added.

    A mesh counts only if every finer mesh of its family keeps the target as well: an error that
    is small where it changes its sign is luck.

    Parameters
    ----------
    points
        All settings.
    finer
        Positions of the settings on finer meshes that must keep the target too, for each.
    target
        Relative error [-].
    reference_error
        Relative error of the reference [-].

    Returns
    -------
    int | None
        Position of the point; None if no setting is known to keep the target.
    """
    keeps = [point.error + reference_error <= target for point in points]
    known = [i for i, mine in enumerate(finer) if keeps[i] and all(keeps[j] for j in mine)]
    return min(known, key=lambda i: (points[i].cost, i), default=None)
