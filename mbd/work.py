"""Limit of work of rigid analyses that solve one program after another.

Linear programs count the iterations of the simplex method times the entries of their matrix,
cone programs those of the interior-point method: see `geometry.work`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

from geometry.work import SECONDS, LimitError, Operation, allowance, count

#: Solvers count no further.
_MOST_ITERATIONS = 2**31 - 1


def count_program(kind: Operation, operations: float) -> None:
    """Count a program that is solved: what is left is asked before the next one (`Work.spent`)."""
    with suppress(LimitError):
        count(kind, operations)


@dataclass
class Work:
    """What an analysis may spend beside the limits of the whole run, and has."""

    limit: float = math.inf
    """Reference seconds."""
    done: float = 0.0
    """Likewise."""
    programs: int = 0
    """Programs solved."""
    progress: Callable[[int], None] | None = None
    """Called with the number of programs solved, after each."""

    @property
    def left(self) -> float:
        """Reference seconds of this analysis and of the run."""
        return min(self.limit - self.done, allowance().work)

    @property
    def spent(self) -> bool:
        """Whether nothing is left, by work or by the clock."""
        return self.left <= 0.0 or allowance().seconds <= 0.0

    def simplex_iterations(self, entries: int) -> int:
        """Most iterations that are left for a linear program with so many entries."""
        each = max(entries, 1) * SECONDS[Operation.SIMPLEX]
        return int(min(max(self.left / each, 0.0), _MOST_ITERATIONS))

    def simplex(self, iterations: int, entries: int, *, ended: bool = True) -> None:
        """Count a linear program; one that did not end used up what was left."""
        if not ended:
            iterations = max(iterations, self.simplex_iterations(entries) + 1)
        operations = float(max(iterations, 1) * entries)
        count_program(Operation.SIMPLEX, operations)
        self._add(Operation.SIMPLEX, operations)

    def conic(self, iterations: int, entries: int) -> None:
        """Count a cone program, which counts for the run itself."""
        self._add(Operation.CONIC, float(max(iterations, 1) * entries))

    def newton(self, iterations: int, entries: int) -> None:
        """Count an equilibrium by the dual Newton method."""
        operations = float(max(iterations, 1) * entries)
        count_program(Operation.CONIC, operations)
        self._add(Operation.CONIC, operations)

    def _add(self, kind: Operation, operations: float) -> None:
        self.programs += 1
        self.done += operations * SECONDS[kind]
        if self.progress is not None:
            self.progress(self.programs)
