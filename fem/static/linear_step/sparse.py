"""Direct solution of sparse symmetric systems by a well-kept library.

PARDISO of the MKL through pypardiso where it is installed (x86 only), else SciPy's SuperLU,
which gives the same answers and takes several times longer on solids.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from enum import StrEnum
from functools import cache
from importlib import import_module, util
from typing import Any

import numpy as np
from scipy.sparse import csc_array, csr_array, csr_matrix, triu
from scipy.sparse.linalg import splu

from geometry.errors import RefusedError
from geometry.mesh import FloatArray

Solve = Callable[[FloatArray], FloatArray]


class SparseSolver(StrEnum):
    """Which library factors."""

    PARDISO = "pardiso"
    """Intel MKL through pypardiso."""
    SUPERLU = "superlu"
    """SciPy."""


class SparseSolverError(RefusedError):
    """A matrix that cannot be factored, or a library that is not there."""


def default_sparse_solver() -> SparseSolver:
    """PARDISO where pypardiso is installed, else SuperLU."""
    found = util.find_spec("pypardiso") is not None
    return SparseSolver.PARDISO if found else SparseSolver.SUPERLU


def factorize(matrix: csr_array, solver: SparseSolver | None = None) -> Solve:
    """Factor a symmetric positive definite matrix.

    Parameters
    ----------
    matrix
        (n, n), both triangles stored.
    solver
        Library; by default the best that is installed.

    Returns
    -------
    Solve
        From a right-hand side (n,) to the solution (n,).

    Raises
    ------
    SparseSolverError
        A singular matrix, or a library that is not installed.
    """
    solver = default_sparse_solver() if solver is None else solver
    return _pardiso(matrix) if solver is SparseSolver.PARDISO else _superlu(matrix)


def _superlu(matrix: csr_array) -> Solve:
    try:
        factor = splu(
            csc_array(matrix), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}
        )
    except RuntimeError as error:
        raise SparseSolverError(f"stiffness matrix: {error}; expected every block held") from None
    return lambda right: np.asarray(factor.solve(right), dtype=np.float64)


@cache
def _pardiso_library() -> Any:
    """PARDISO for symmetric positive definite matrices; finding the library takes its time."""
    try:
        return import_module("pypardiso").PyPardisoSolver(mtype=2)
    except ImportError as error:
        raise SparseSolverError(
            f"pardiso: {error}; install pypardiso (x86 only) or choose superlu"
        ) from None


def _pardiso(matrix: csr_array) -> Solve:
    solver = copy(_pardiso_library())
    solver.pt, solver.iparm = np.zeros_like(solver.pt), np.zeros_like(solver.iparm)
    upper = csr_matrix(triu(matrix, format="csr"))
    upper.sort_indices()

    class _Factor:
        """Owns PARDISO's memory and gives it back."""

        def __call__(self, right: FloatArray) -> FloatArray:
            solver.set_phase(33)
            return solver._call_pardiso(upper, np.ascontiguousarray(right))

        def __del__(self) -> None:
            solver.free_memory(everything=True)

    solver._check_A(upper)
    solver.set_phase(12)
    try:
        solver._call_pardiso(upper, np.zeros((upper.shape[0], 1)))
    except Exception as error:
        solver.free_memory(everything=True)
        raise SparseSolverError(
            f"stiffness matrix: {error}; expected a positive definite matrix: is every block held?"
        ) from None
    return _Factor()
