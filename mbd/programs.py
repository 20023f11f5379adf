"""Linear and cone programs of rigid analyses, and the work that they may take.

Linear programs count the iterations of the simplex method times the entries of their matrix,
cone programs those of the interior-point method: see `geometry.machine.work`.

References: Huangfu and Hall, "Parallelizing the dual revised simplex method", Math. Program.
Comput. 10 (2018) (HiGHS); Goulart and Chen, "Clarabel: an interior-point solver for conic programs
with quadratic objectives", arXiv:2405.12762 (2024).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from geometry.machine.work import SECONDS, LimitError, Operation, allowance, count
from geometry.mesh import FloatArray

#: Imbalance over the load above which a linear program's answer is not believed.
_BALANCED = 1e-6
#: Forces whose range is narrower than this fraction of the load count as determined: linear
#: programs are solved to 1e-7 of a load of one.
DETERMINED = 1e-6
#: At which cone programs end, and beyond which an unknown has run off to infinity.
_CONIC_TOLERANCE, _FAR = 1e-11, 1e12
#: Solvers count no further.
_MOST_ITERATIONS = 2**31 - 1


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
        self._add(Operation.SIMPLEX, float(max(iterations, 1) * entries))

    def conic(self, iterations: int, entries: int) -> None:
        """Count a cone program, or an equilibrium by the dual Newton method."""
        self._add(Operation.CONIC, float(max(iterations, 1) * entries))

    def _add(self, kind: Operation, operations: float) -> None:
        # The run's own limit stops nothing here: `spent` is asked before the next program.
        with suppress(LimitError):
            count(kind, operations)
        self.programs += 1
        self.done += operations * SECONDS[kind]
        if self.progress is not None:
            self.progress(self.programs)


class Cones(NamedTuple):
    """Rows R and cones K: unknowns x are admissible where R x is in K."""

    rows: Any
    """(n_rows, n)."""
    kinds: list[Any]
    """Cones of clarabel, of these rows in turn."""


class Solution(NamedTuple):
    """Where a cone program ended; whether that solves it is for its equations to say."""

    x: FloatArray
    """Unknowns, (n,); 0 for what ran off to infinity, as where no solution exists."""
    multipliers: FloatArray
    """Of the equations, (n_equations,)."""


def least(
    equal: Any,
    target: FloatArray,
    cones: Cones,
    *,
    squares: Any = None,
    cost: FloatArray | None = None,
    work: Work | None = None,
) -> Solution:
    """Minimise ½ xᵀ squares x + cost · x subject to equal x = target, x admissible (clarabel)."""
    # Loaded here, as HiGHS: most answers need neither.
    import clarabel

    settings, n = clarabel.DefaultSettings(), equal.shape[1]
    settings.verbose, settings.max_iter = False, 300
    for name in ("gap_abs", "gap_rel", "feas", "infeas_abs", "infeas_rel"):
        setattr(settings, f"tol_{name}", _CONIC_TOLERANCE)
    constraint = sp.csc_matrix(sp.vstack([equal, -cones.rows]))
    result = clarabel.DefaultSolver(
        sp.csc_matrix((n, n) if squares is None else squares),
        np.zeros(n) if cost is None else cost,
        constraint,
        np.append(target, np.zeros(cones.rows.shape[0])),
        [clarabel.ZeroConeT(len(target)), *cones.kinds],
        settings,
    ).solve()
    (work or Work()).conic(result.iterations, constraint.nnz)
    x = np.asarray(result.x)
    return Solution(np.where(np.abs(x) < _FAR, x, 0.0), np.asarray(result.z)[: len(target)])


class LinearPrograms:
    """Least costs over rows of matrix x and x within bounds, each from the last basis (HiGHS).

    References: Huangfu and Hall, "Parallelizing the dual revised simplex method", Math. Program.
    Comput. 10 (2018).
    """

    def __init__(
        self,
        matrix: sp.csc_array,
        rows: tuple[FloatArray, FloatArray],
        bounds: tuple[FloatArray | float, FloatArray | float],
        work: Work,
    ) -> None:
        # Loaded here: most answers need no linear program.
        import highspy

        self._matrix, self._rows, self._work = matrix, rows, work
        self._status = highspy.HighsModelStatus
        n_rows, n = matrix.shape
        self._places = np.arange(n, dtype=np.int32)
        self.x, self.multipliers = np.zeros(n), np.zeros(n_rows)
        program = highspy.HighsLp()
        program.num_row_, program.num_col_ = n_rows, n
        program.col_cost_ = np.zeros(n)
        program.col_lower_, program.col_upper_ = (np.broadcast_to(b, n).copy() for b in bounds)
        program.row_lower_, program.row_upper_ = rows
        program.a_matrix_.format_ = highspy.MatrixFormat.kColwise
        program.a_matrix_.start_ = matrix.indptr
        program.a_matrix_.index_ = matrix.indices
        program.a_matrix_.value_ = matrix.data
        self._solver = highspy.Highs()
        self._solver.setOptionValue("output_flag", False)
        self._solver.setOptionValue("threads", 1)
        self._solver.passModel(program)

    def least(
        self, cost: FloatArray, bounds: tuple[FloatArray, FloatArray] | None = None
    ) -> float | None:
        """Least cost · x; None if there is none, if a limit came first, or if a row is missed.

        Sets `x`, (n,), and the `multipliers` of the rows, (n_rows,).
        """
        entries = int(self._matrix.nnz)
        self._solver.changeColsCost(len(cost), self._places, cost)
        if bounds is not None:
            self._solver.changeColsBounds(len(cost), self._places, *bounds)
        left = self._work.simplex_iterations(entries)
        self._solver.setOptionValue("simplex_iteration_limit", left)
        self._solver.run()
        iterations = self._solver.getInfo().simplex_iteration_count
        ended = self._solver.getModelStatus() != self._status.kIterationLimit
        self._work.simplex(iterations, entries, ended=ended)
        if self._solver.getModelStatus() != self._status.kOptimal or self._work.spent:
            return None
        if bounds is None:  # only costs change: the last x stays feasible
            self._solver.setOptionValue("simplex_strategy", 4)
        solution = self._solver.getSolution()
        self.x, self.multipliers = np.array(solution.col_value), np.array(solution.row_dual)
        (lower, upper), product = self._rows, self._matrix @ self.x
        missed = float(np.linalg.norm(product - np.clip(product, lower, upper)))
        if missed > _BALANCED * float(np.linalg.norm(upper[np.isfinite(upper)])):
            return None
        return float(cost @ self.x)
