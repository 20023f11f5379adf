"""The paper's linear programs in HiGHS: a check of `mbd.mechanism.classify`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.optimize import linprog

from geometry.mesh import FloatArray
from mbd.contacts.jacobian import ContactJacobian
from mbd.equilibrium import EQUILIBRIUM_TOLERANCE, load_size
from mbd.mechanism import RANK_TOLERANCE, MechanismClass, smallest_singular_pair


@dataclass(frozen=True)
class LinearPrograms:
    """Optimal values of the paper's three linear programs, the first one corrected."""

    opening: float
    """max Σ w, w = Gᵀδq, 0 <= w <= 1: zero if no motion opens a contact."""
    largest_work: float
    """γ_max = max fᵀδq / ‖f‖ over Gᵀδq >= 0, ‖δq‖₁ <= 1 (eq. kinematic-feasibility-mechanism)."""
    smallest_work: float
    """γ_min, the minimum (eq. kinematic-feasibility-mechanism-min)."""
    mechanism: MechanismClass
    """Class read off the three values (the rank from a singular value)."""


def solve_linear_programs(
    jacobian: ContactJacobian, load: FloatArray, *, tolerance: float = EQUILIBRIUM_TOLERANCE
) -> LinearPrograms:
    """Solve the three linear programs in HiGHS, an independent check of `classify`.

    Slow (seconds where the dual Newton method takes hundredths); meant for cross-checks.
    """
    transpose = sp.csr_array(jacobian.to_matrix().T)
    n_contacts, n_rows = transpose.shape
    size = load_size(load)
    unit_load = load / size if size > 0 else load
    unbounded = [(None, None)] * n_rows
    opening = _highs(
        cost=np.concatenate([np.zeros(n_rows), -np.ones(n_contacts)]),
        equal=(sp.hstack([transpose, -sp.eye_array(n_contacts)]), np.zeros(n_contacts)),
        bounds=[*unbounded, *[(0.0, 1.0)] * n_contacts],
    )
    # ‖δq‖₁ <= 1 with δq = p - n, p, n >= 0.
    above = sp.vstack([sp.hstack([-transpose, transpose]), sp.csr_array(np.ones((1, 2 * n_rows)))])
    limit = np.concatenate([np.zeros(n_contacts), [1.0]])
    both = np.concatenate([unit_load, -unit_load])
    bounds: list[tuple[float | None, float | None]] = [(0.0, None)] * (2 * n_rows)
    largest = -_highs(cost=-both, above=(above, limit), bounds=bounds)
    smallest = _highs(cost=both, above=(above, limit), bounds=bounds)
    ratio, _ = smallest_singular_pair(jacobian)
    if -opening <= tolerance and ratio > RANK_TOLERANCE:
        mechanism = MechanismClass.LOCKED
    elif largest > tolerance:
        mechanism = MechanismClass.ACTIVATED
    elif smallest < -tolerance:
        mechanism = MechanismClass.SUPPRESSED
    else:
        mechanism = MechanismClass.NEUTRAL
    return LinearPrograms(-opening, largest, smallest, mechanism)


def _highs(
    *,
    cost: FloatArray,
    bounds: list[tuple[float | None, float | None]],
    equal: tuple[sp.sparray, FloatArray] | None = None,
    above: tuple[sp.sparray, FloatArray] | None = None,
) -> float:
    constraints: dict[str, Any] = {}
    if equal is not None:
        constraints |= {"A_eq": sp.csc_array(equal[0]), "b_eq": equal[1]}
    if above is not None:
        constraints |= {"A_ub": sp.csc_array(above[0]), "b_ub": above[1]}
    result = linprog(cost, bounds=bounds, method="highs", **constraints)
    if not result.success:
        raise RuntimeError(f"HiGHS could not solve a linear program: {result.message}")
    return float(result.fun or 0.0)
