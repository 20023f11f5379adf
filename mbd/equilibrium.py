"""Minimum-norm contact forces in equilibrium with a load (eq. QP), or proof that none exist.

min ½ ‖λ‖² s.t. G λ + f = 0, λ >= 0. The dual is unconstrained and smooth,

    min_y ½ ‖max(0, Gᵀy)‖² + fᵀy,  λ = max(0, Gᵀy),

with six unknowns per block however fine the mesh is. It is minimised by a semismooth Newton
method with an exact line search, inside proximal steps (ε/2)‖y - y_k‖² whose ε shrinks: each
subproblem has a positive definite Hessian, so rank-deficient G and infeasible loads need no
special case. Where the load is infeasible, y runs off to infinity along a ray; its direction
negated is d with Gᵀd >= 0 and fᵀd > 0, the load-activated mechanism.

References: eq. QP and eq. SCP-linear of the paper; Qi and Sun, "A nonsmooth version of Newton's
method", Math. Program. 58 (1993); Rockafellar, "Monotone operators and the proximal point
algorithm", SIAM J. Control Optim. 14 (1976).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from geometry.mesh import BoolArray, FloatArray, ReadOnlyArrays
from mbd.contacts.jacobian import ContactJacobian
from mbd.options import Norm, Solver

if TYPE_CHECKING:
    from mbd.contacts.friction import FrictionalContacts
    from mbd.programs import Solution, Work

#: Relative residual above which nothing is called equilibrium (the paper's tolerance).
EQUILIBRIUM_TOLERANCE = 1e-6

#: A mechanism certifies only if no admissible unit force does more negative work than this
#: fraction of the load's work.
CERTIFICATE_TOLERANCE = 1e-6
#: Relative residual at which the Newton iteration stops.
_TARGET = 1e-12
_EPS = float(np.finfo(np.float64).eps)
#: Residual at which an iteration that no longer improves has reached round-off.
_STALLED = 1e-9
#: ε, in mean eigenvalues of G Gᵀ, where nothing is known and where a multiplier is …
_COLD, _WARM = 1e-4, 1e-6
#: … shrinks by this from one proximal step to the next …
_SHRINK = 0.01
#: … and the imbalance with it, unless contacts cannot carry all of the load.
_LASTING = 0.3
#: A mechanism d is load-activated where fᵀd exceeds this (‖f‖ = ‖d‖ = 1) …
_SMALLEST_WORK = 1e-7
#: … and admissible where no gap closes faster than this fraction of fᵀd: forces that balanced
#: the load all the same would have to sum up to 1e10 times the load.
_RAY_TOLERANCE = 1e-10


@dataclass(frozen=True, kw_only=True)
class Equilibrium(ReadOnlyArrays):
    """Whether contact forces balance the load, with friction or without, and the proof."""

    holds: bool = False
    """Whether the relative residual is within `EQUILIBRIUM_TOLERANCE`."""
    forces: FloatArray
    """λ >= 0, (n_contacts,) [N]; with friction (λ_n, λ_1, λ_2) inside the cone, (n_contacts, 3).
    Where no equilibrium exists, the last iterate."""
    residual: float
    """‖G λ + f‖ / ‖f‖ (0 for a zero load)."""
    mechanism: FloatArray | None = None
    """Load-activated d, fᵀd > 0, ‖d‖ = 1, on which no admissible force does negative work,
    (n_rows,); without friction Gᵀd >= 0. None in equilibrium."""
    work: float = 0.0
    """With friction fᵀd / ‖f‖ of the mechanism …"""
    smallest_contact_work: float = 0.0
    """… and the least work of an admissible unit force on it; zero to round-off."""
    iterations: int = 0
    """Of Newton's method; 0 by an interior-point method, whose count is not told."""
    multiplier: FloatArray | None = None
    """Dual variable y of Newton's method, (n_rows,); a warm start."""
    motion: FloatArray | None = None
    """How blocks move that do not come to rest, where nothing is proved, (n_rows,)."""
    status: str
    """Verdict in words, with the remedy where there is no equilibrium."""

    @property
    def decided(self) -> bool:
        """Whether forces or a mechanism prove the verdict."""
        return self.holds or self.mechanism is not None

    @property
    def with_tangents(self) -> Equilibrium:
        """The same without shear, (λ_n, 0, 0): admissible whatever the friction."""
        forces = np.column_stack([self.forces, np.zeros((len(self.forces), 2))])
        return replace(self, forces=forces)


def by_block(motion: FloatArray | None) -> list[list[float]] | None:
    """Motion of each block as plain data, where there is one."""
    return None if motion is None else motion.reshape(-1, 6).tolist()


def column_weights(norm: Norm, areas: FloatArray) -> FloatArray:
    """Column scaling c so that min ‖μ‖² with λ = c μ minimises the chosen norm, (n_contacts,).

    Ones for ``force``, sqrt(A / mean A) of the facet areas A [mm²] for ``pressure``.
    """
    if norm is Norm.FORCE or not len(areas):
        return np.ones(len(areas))
    return np.sqrt(areas / areas.mean())


_NO_LOAD = "equilibrium: no load"


def _status(residual: float, mechanism: FloatArray | None) -> str:
    """Verdict in words, with the remedy where there is no equilibrium."""
    if mechanism is not None:
        return (
            "no equilibrium: the load sets blocks in motion (see the certificate); "
            "change the shape, fix more blocks or change the direction of the load"
        )
    if residual <= EQUILIBRIUM_TOLERANCE:
        return f"statically admissible, relative residual {residual:.1e}"
    return (
        f"undecided: relative residual {residual:.1e} exceeds {EQUILIBRIUM_TOLERANCE:.0e} and no "
        "motion under the load was certified; the load is at the limit of what the contacts carry"
    )


def load_size(load: FloatArray) -> float:
    """Return ‖f‖; the squares of the entries neither overflow nor vanish.

    Raises
    ------
    ValueError
        For a load with entries that are not finite.
    """
    return float(scipy.linalg.norm(load))


def _at_once(jacobian: ContactJacobian, load: FloatArray, size: float) -> Equilibrium | None:
    """Answer where there is no load, or no contact; else None."""
    n_rows, n_contacts = jacobian.shape
    answer = partial(Equilibrium, forces=np.zeros(n_contacts), multiplier=np.zeros(n_rows))
    if size == 0.0:
        return answer(holds=True, residual=0.0, status=_NO_LOAD)
    if n_contacts == 0:
        return answer(residual=1.0, mechanism=load / size, status=_status(1.0, load))
    return None


@dataclass
class _Dual:
    """The proximal dual objective for one ε and centre; f and G scaled to order one."""

    jacobian: ContactJacobian
    load: FloatArray
    column: FloatArray
    centre: FloatArray
    epsilon: float

    def gap(self, y: FloatArray) -> FloatArray:
        return self.column * self.jacobian.gap_rates(y)

    def imbalance(self, gap: FloatArray) -> FloatArray:
        """G λ + f for λ = c max(0, gap)."""
        return self.jacobian.resultant(self.column * np.maximum(gap, 0.0)) + self.load

    def step_length(
        self, y: FloatArray, gap: FloatArray, direction: FloatArray, gap_direction: FloatArray
    ) -> float:
        """Step that minimises the objective along ``direction``; 1 if a full step nearly does.

        The slope is a growing, piecewise linear function of the step: a bracketed Newton iteration
        finds its root in a few products.
        """
        curvature = self.epsilon * float(direction @ direction)
        straight = float((self.load + self.epsilon * (y - self.centre)) @ direction)
        after, moving = np.empty_like(gap), np.empty_like(gap)

        def slope(step: float) -> tuple[float, float]:
            np.multiply(gap_direction, step, out=after)
            np.add(after, gap, out=after)
            # A product with truths takes a fraction of the time of a choice of entries.
            np.multiply(gap_direction, after > 0.0, out=moving)
            value = float(after @ moving) + straight + step * curvature
            return value, float(gap_direction @ moving) + curvature

        first, _ = slope(0.0)
        value, rate = slope(1.0)
        low, high, step = 0.0, np.inf, 1.0
        for _ in range(40):
            # The second term accepts slopes that drown in round-off near the minimum.
            if abs(value) <= 0.1 * abs(first) + 16 * _EPS * abs(straight):
                break
            low, high = (step, high) if value < 0.0 else (low, step)
            step -= value / rate
            if not low < step < high:
                step = 0.5 * (low + high)
            value, rate = slope(step)
        return step


def _noise(dual: _Dual, y: FloatArray) -> FloatArray:
    """Gaps below this are round-off of Gᵀy, (n_contacts,)."""
    return 16 * _EPS * float(np.linalg.norm(y)) * dual.column


def _newton(dual: _Dual, y: FloatArray, tolerance: float, most: int) -> tuple[FloatArray, int]:
    """Minimise one proximal dual; returns y and the iterations used.

    The objective is piecewise quadratic: a full step that leaves the set of pressing contacts
    unchanged has reached the minimum, up to the round-off of one linear solve.
    """
    gap = dual.gap(y)
    for iteration in range(most):
        gradient = dual.imbalance(gap) + dual.epsilon * (y - dual.centre)
        if np.linalg.norm(gradient) <= tolerance:
            return y, iteration
        pressing = gap > 0.0
        solve = dual.jacobian.normal_solver(np.where(pressing, dual.column**2, 0.0), dual.epsilon)
        direction = -solve(gradient)
        gap_direction = dual.gap(direction)
        length = dual.step_length(y, gap, direction, gap_direction)
        y = y + length * direction
        gap = gap + length * gap_direction  # gaps are linear: no walk over the contacts
        changed = (pressing != (gap > 0.0)) & (np.abs(gap) > _noise(dual, y))
        if length == 1.0 and not changed.any():
            return y, iteration + 1
    return y, most


def _damped(dual: _Dual, rest: FloatArray, pressing: BoolArray) -> FloatArray | None:
    """Part of ``rest`` orthogonal to the pressing columns, normalised, to round-off."""
    weights = np.where(pressing, dual.column**2, 0.0)
    scale = float(weights.sum()) / len(rest)
    direction = rest / np.linalg.norm(rest)
    if scale == 0.0:
        return direction
    shift = 1e-9 * scale
    try:
        solve = dual.jacobian.normal_solver(weights, shift)
    except scipy.linalg.LinAlgError:
        return None
    for _ in range(6):
        direction = shift * solve(direction)
        size = float(np.linalg.norm(direction))
        if size < _SMALLEST_WORK:
            return None
        direction = direction / size
    return direction


def _ray(dual: _Dual, y: FloatArray) -> FloatArray | None:
    """Return the load-activated mechanism, if the proximal solution reveals one.

    At the projection of the load on the cone of contact wrenches the rest r = Gλ + f is
    orthogonal to the columns that press; repeated solves with those alone damp every other part
    of r. Which of the contacts with a gap of zero press is for round-off to say, so several
    readings are tried: whatever passes the check is a certificate, the cleanest is returned.
    """
    gap, noise = dual.gap(y), _noise(dual, y)
    rest = dual.imbalance(gap)
    best, cleanest = None, _RAY_TOLERANCE
    for pressing in (gap > noise, gap > 0.0, gap > -noise):
        direction = _damped(dual, rest, pressing)
        if direction is None:
            continue
        work = float(dual.load @ direction)
        closing = -float(dual.gap(direction).min(initial=0.0))
        if work > _SMALLEST_WORK and closing <= cleanest * work:
            best, cleanest = direction, closing / work
    return best


def newton_equilibrium(
    jacobian: ContactJacobian,
    load: FloatArray,
    *,
    weights: FloatArray | None = None,
    start: FloatArray | None = None,
    most_iterations: int = 400,
) -> Equilibrium:
    """Dual semismooth Newton method for eq. QP.

    Parameters
    ----------
    jacobian
        G, (n_rows, n_contacts).
    load
        f, (n_rows,) [N].
    weights
        Column scaling of `column_weights`, (n_contacts,); ones by default.
    start
        Initial dual variable, (n_rows,), in units of the load.
    most_iterations
        Newton iterations before giving up undecided.
    """
    n_rows, n_contacts = jacobian.shape
    size = load_size(load)
    known = _at_once(jacobian, load, size)
    if known is not None:
        return known
    column = np.ones(n_contacts) if weights is None else weights
    # G Gᵀ has trace Σ c² ‖g‖², of order n_contacts: ε is relative to its mean eigenvalue.
    scale = float(column @ column) / n_rows
    y = np.zeros(n_rows) if start is None else start / size
    dual = _Dual(jacobian, load / size, column, y, (_COLD if start is None else _WARM) * scale)
    used, best, last = 0, np.inf, 1.0
    direction: FloatArray | None = None
    final_y, final_forces = y, np.zeros(n_contacts)
    while used < most_iterations:
        try:
            y, spent = _newton(dual, y, 0.1 * _TARGET, most_iterations - used)
        except scipy.linalg.LinAlgError:
            dual.epsilon, used = 100.0 * dual.epsilon, used + 1
            continue
        used += max(spent, 1)
        gap = dual.gap(y)
        residual = float(np.linalg.norm(dual.imbalance(gap)))
        stalled = residual > 0.5 * best and residual < _STALLED
        if residual < best:
            best, final_y, final_forces = residual, y, column * np.maximum(gap, 0.0)
        if best <= _TARGET or stalled:
            break
        if best > _STALLED and residual > _LASTING * last:
            direction = _ray(dual, y)
            if direction is not None:
                break
        last = residual
        dual.centre = y
        dual.epsilon = max(_SHRINK * dual.epsilon, 1e-15 * scale)
        # Where the load is infeasible, the next solution lies this way, 1/ε times the rest away.
        rest = -dual.imbalance(gap) / dual.epsilon
        y = y + dual.step_length(y, gap, rest, dual.gap(rest)) * rest
    holds = direction is None and best <= EQUILIBRIUM_TOLERANCE
    return Equilibrium(
        holds=holds,
        forces=size * final_forces,
        residual=best,
        mechanism=direction,
        iterations=used,
        multiplier=size * final_y,
        status=_status(best, direction),
    )


def least_forces(
    contacts: FrictionalContacts,
    load: FloatArray,
    *,
    cost: FloatArray | None = None,
    weights: FloatArray | None = None,
    live: FloatArray | None = None,
    work: Work | None = None,
) -> Solution:
    """Solve for the admissible forces of least cost that balance a load of one (clarabel).

    Parameters
    ----------
    contacts
        What is admissible.
    load
        (n_rows,)
    cost
        Of each force, (3 n_contacts,); None: half the sum of their squares …
    weights
        … over those of these, (n_contacts,); None: ones.
    live
        A load (n_rows,) whose factor is one more unknown, the last one, with its own cost.
    work
        Counts the program.
    """
    # Loaded here: most answers need no cone program.
    from mbd.programs import Cones, least

    equal, (rows, kinds) = contacts.matrix, contacts.cones
    squares = None
    if cost is None:
        column = np.ones(contacts.n_contacts) if weights is None else weights
        squares = sp.diags_array(np.repeat(column**-2.0, 3))
    if live is not None:
        equal = sp.hstack([equal, sp.csc_array(live[:, None])])
        rows = sp.hstack([rows, sp.csc_array((rows.shape[0], 1))])
    return least(equal, -load, Cones(rows, kinds), squares=squares, cost=cost, work=work)


def least_normal(
    contacts: FrictionalContacts,
    unit: FloatArray,
    of: BoolArray,
    *,
    sign: float = 1.0,
    work: Work,
) -> float:
    """Least sum of the normal forces of some contacts, (n,), over all admissible states.

    Of a load of one. ``sign`` of -1: minus the largest one, -∞ where a self-stress presses them.
    nan where the program finds none.
    """
    cost = np.zeros((contacts.n_contacts, 3))
    cost[of, 0] = sign
    forces, _ = least_forces(contacts, unit, cost=cost.ravel(), work=work)
    balanced, value = contacts.matrix @ forces, float(cost.ravel() @ forces)
    if np.linalg.norm(balanced + unit) <= EQUILIBRIUM_TOLERANCE:
        return value
    # A ray of admissible forces that balance nothing.
    ray = np.linalg.norm(balanced) <= EQUILIBRIUM_TOLERANCE * np.linalg.norm(forces)
    return -np.inf if ray and value < 0.0 else np.nan


def _unit_largest(direction: FloatArray) -> FloatArray:
    """Direction scaled to a largest entry of 1; zero where it is not finite."""
    largest = float(np.abs(direction).max(initial=0.0))
    if not (np.isfinite(largest) and largest > 0.0):
        return np.zeros_like(direction)
    return direction / largest


def certified(
    contacts: FrictionalContacts, dual: FloatArray, load: FloatArray, closing: float = 0.0
) -> tuple[FloatArray, float, float] | None:
    """Motion along a dual or against it, its work and the least contact work; None: no mechanism.

    No contact force may do more negative work than ``closing``, or than its part of the work.
    """
    direction = contacts.admissible(_unit_largest(dual))
    size = float(np.linalg.norm(direction))
    for unit in (direction / size, -direction / size) if size else ():
        work = float(load @ unit) / float(np.linalg.norm(load))
        least = float(contacts.smallest_work(unit).min(initial=0.0))
        if work > 0.0 and least >= -max(closing, CERTIFICATE_TOLERANCE * work):
            return unit, work, least
    return None


def _candidates(
    contacts: FrictionalContacts, unit: FloatArray, weights: FloatArray | None
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Forces (3 n_contacts,) that may balance a load of one, and a direction that may prove none.

    Those of least norm first; where they do not decide, those that miss least of the load.
    """
    from mbd.programs import Cones, least

    n_rows, n = contacts.matrix.shape
    if not n:
        yield np.zeros(0), unit
        return
    yield least_forces(contacts, unit, weights=weights)
    rest, (rows, kinds) = sp.eye_array(n_rows), contacts.cones
    cones = Cones(sp.hstack([rows, sp.csc_array((rows.shape[0], n_rows))]), kinds)
    squares = sp.block_diag([sp.csc_array((n, n)), rest])
    x, _ = least(sp.hstack([contacts.matrix, -rest]), -unit, cones, squares=squares)
    yield x[:n], x[n:]


def frictional_equilibrium(
    contacts: FrictionalContacts, load: FloatArray, *, weights: FloatArray | None = None
) -> Equilibrium:
    """Smallest admissible forces that balance a load (n_rows,) [N], or a certified mechanism.

    By clarabel's interior-point method; smallest by the column scaling of `column_weights`,
    (n_contacts,), ones by default. Undecided (neither holds nor a mechanism) at the edge of what
    can be carried.
    """
    size = load_size(load)
    if size == 0.0:
        none = np.zeros((contacts.n_contacts, 3))
        return Equilibrium(holds=True, forces=none, residual=0.0, status=_NO_LOAD)
    unit = load / size
    for x, direction in _candidates(contacts, unit, weights):
        forces = contacts.projected(x.reshape(-1, 3))
        residual = float(np.linalg.norm(contacts.matrix @ forces.ravel() + unit))
        holds = residual <= EQUILIBRIUM_TOLERANCE
        proof = None if holds else certified(contacts, direction, unit)
        mechanism, work, least = proof or (None, 0.0, 0.0)
        if holds or work > EQUILIBRIUM_TOLERANCE:
            break
    return Equilibrium(
        holds=holds,
        forces=size * forces,
        residual=residual,
        mechanism=mechanism,
        work=work,
        smallest_contact_work=least,
        status=_status(residual, mechanism),
    )


def equilibrium(
    jacobian: ContactJacobian,
    load: FloatArray,
    *,
    solver: Solver = Solver.NEWTON,
    weights: FloatArray | None = None,
) -> Equilibrium:
    """Contact forces of minimum norm without friction, or the mechanism that the load drives.

    On degenerate contacts Newton's method may end without either. The interior point method then
    decides, which is slower and seldom fails.
    """
    if solver is Solver.NEWTON:
        found = newton_equilibrium(jacobian, load, weights=weights)
        if found.decided:
            return found
    from mbd.contacts.friction import smooth_contacts

    found = frictional_equilibrium(smooth_contacts(jacobian), load, weights=weights)
    return replace(found, forces=found.forces[:, 0])
