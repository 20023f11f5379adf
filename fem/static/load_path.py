"""The way to the load: in which parts it is applied, and how much finer parts change the answer.

Without friction the state does not depend on the way, and the load comes at once. With friction
it does: where a point slips first, and what pressed on it then, is history. Most of that history
lies under small loads, where contact by an exponential law is soft and blocks still move by much
of their way: load factors are squares of equal parts, (k/n)², so that four of them do what
sixteen equal ones did. Twice as many parts show the error of the first half (step doubling).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fem.static.result import StaticResult

#: Change of the measures by twice as many parts below which they are enough [-].
LOAD_TOLERANCE = 0.01
#: Parts that are not doubled any more.
MOST_PARTS = 16


def load_factors(parts: int, *, friction: bool) -> tuple[float, ...]:
    """Load factors at the ends of the load steps, the last one 1.

    Parameters
    ----------
    parts
        Number of load steps.
    friction
        Whether the way to the load matters; else the parts are equal.
    """
    power = 2 if friction else 1
    return tuple((k / parts) ** power for k in range(1, parts + 1))


def path_change(coarse: StaticResult, fine: StaticResult) -> float:
    """Relative change of an answer: displacement, pressure at a point, pressures in the mean [-].

    Parameters
    ----------
    coarse, fine
        States of the same facets; of a search only what does not name facets is compared.
    """

    def numbers(result: StaticResult) -> tuple[float, float, float]:
        pressures = result.facet_pressures
        areas = result.contact_state.areas
        mean = float(np.sqrt(areas @ pressures**2 / max(float(areas.sum()), 1e-300)))
        return result.max_displacement, float(result.pressures.max(initial=0.0)), mean

    pairs = zip(numbers(coarse), numbers(fine), strict=True)
    return max(abs(a - b) / abs(b) if b else float(a != b) for a, b in pairs)


def refined(
    solve: Callable[[int], StaticResult], parts: int, tolerance: float
) -> tuple[StaticResult, StaticResult | None]:
    """Double the parts of the load until that changes the answer by less than a tolerance.

    Parameters
    ----------
    solve
        Solves in so many parts.
    parts
        First number of them.
    tolerance
        See `path_change` [-].

    Returns
    -------
    tuple[StaticResult, StaticResult | None]
        The last state that was reached, and the one before it; None where there is but one.
    """
    known: StaticResult | None = None
    while True:
        fine = solve(parts)
        enough = known is not None and fine.converged and path_change(known, fine) <= tolerance
        if enough or 2 * parts > MOST_PARTS:
            break
        known = fine if fine.converged else known
        parts *= 2
    if known is None or fine.converged:
        return fine, known
    return known, None
