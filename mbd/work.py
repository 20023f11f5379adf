"""Limit of work of rigid analyses, counted in operations: the same answer on every machine.

Linear programs count the iterations of the simplex method times the entries of their matrix,
cone programs those of the interior-point method, each of which factors a matrix.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

#: Operations of an analysis that solves one program after another: minutes.
MOST_WORK = 5e10
#: Operations of an iteration of the interior-point method for each entry, measured.
_FACTORS = 50.0

#: Solvers count no further.
_MOST_ITERATIONS = 2**31 - 1


@dataclass
class Work:
    """Operations that an analysis may spend, and has."""

    limit: float = MOST_WORK
    done: float = 0.0
    programs: int = 0
    """Programs solved."""
    progress: Callable[[int], None] | None = None
    """Called with the number of programs solved, after each."""

    @property
    def spent(self) -> bool:
        """Whether nothing is left."""
        return self.done >= self.limit

    def simplex_iterations(self, entries: int) -> int:
        """Most iterations that are left for a linear program with so many entries."""
        left = int((self.limit - self.done) / max(entries, 1))
        return min(max(left, 0), _MOST_ITERATIONS)

    def simplex(self, iterations: int, entries: int, *, ended: bool = True) -> None:
        """Count a linear program; one that did not end used up what was left."""
        if not ended:
            iterations = max(iterations, self.simplex_iterations(entries) + 1)
        self._count(float(max(iterations, 1) * entries))

    def conic(self, iterations: int, entries: int) -> None:
        """Count a cone program."""
        self._count(_FACTORS * max(iterations, 1) * entries)

    def _count(self, operations: float) -> None:
        self.programs += 1
        self.done += operations
        if self.progress is not None:
            self.progress(self.programs)
