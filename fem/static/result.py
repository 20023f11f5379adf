"""What a static solution is, and how much of it is due to the parts in which its load was applied.

Without friction the state does not depend on the load path, and the load is applied at once. With
friction it does: where a point slips first, and under which pressure, is history. Most of that
history lies under small loads, where contact by an exponential law is soft and blocks make most of
their motion: load factors are squares of equal parts, (k/n)², so that four of them do what
sixteen equal ones did. Twice as many parts show the error of the first half (step doubling).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fem.state import State
from geometry.errors import RefusedError
from geometry.machine.work import LimitError


class StaticError(RefusedError):
    """A static problem that has no solution, or none that was found: what to do."""


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


def path_change(coarse: State, fine: State) -> float:
    """Relative change of an answer: displacement, pressure at a point, pressures in the mean [-].

    Both are states of the same facets; of a search only what does not name facets is compared.
    """

    def numbers(state: State) -> tuple[float, float, float]:
        pressures, areas = state.contact_state.pressures, state.contact_state.areas
        mean = float(np.sqrt(areas @ pressures**2 / max(float(areas.sum()), 1e-300)))
        return state.largest_displacement, float(state.pressures.max(initial=0.0)), mean

    pairs = zip(numbers(coarse), numbers(fine), strict=True)
    return max(abs(a - b) / abs(b) if b else float(a != b) for a, b in pairs)


def doubled(solve: Callable[[int], State], parts: int, tolerance: float) -> State:
    """Double the parts of the load until that changes the answer by less than a tolerance.

    Returns
    -------
    State
        The last one that was reached; the one before it, in fewer parts, is in its evidence.

    Raises
    ------
    LimitError
        A limit is reached before any state.
    """
    known: State | None = None
    while True:
        try:
            fine = solve(parts)
        except LimitError:
            if known is None:
                raise
            return known
        # More than asked for where so few had no equilibrium.
        parts = max(parts, fine.evidence.load_steps)
        enough = known is not None and fine.converged and path_change(known, fine) <= tolerance
        if enough or 2 * parts > MOST_PARTS:
            break
        known = fine if fine.converged else known
        parts *= 2
    if known is None:
        return fine
    if not fine.converged:
        return known
    fine.evidence.coarser = known
    return fine
