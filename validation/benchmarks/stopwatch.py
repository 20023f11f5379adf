"""Times that other processes on the machine disturb least."""

from __future__ import annotations

import time
from collections.abc import Callable


def best_cpu_seconds(work: Callable[[], object], *, repeats: int = 1, trials: int = 12) -> float:
    """Least CPU time of one call among ``trials`` batches of ``repeats`` calls [s].

    One call before the first batch compiles and warms the caches.
    """
    return _best(work, repeats, trials, time.process_time)


def best_wall_seconds(work: Callable[[], object], *, repeats: int = 1, trials: int = 300) -> float:
    """Least elapsed time of one call [s]; for threads, whose waiting counts as CPU time.

    Many short trials: both cores must be free for once.
    """
    return _best(work, repeats, trials, time.perf_counter)


def _best(
    work: Callable[[], object], repeats: int, trials: int, clock: Callable[[], float]
) -> float:
    work()
    best = float("inf")
    for _ in range(trials):
        start = clock()
        for _ in range(repeats):
            work()
        best = min(best, (clock() - start) / repeats)
    return best
