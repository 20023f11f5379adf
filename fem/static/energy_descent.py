"""Static equilibrium as a minimum of the energy: Newton-CG with the exact tangent.

With current normals the tangent is

    H = K + Σ w p' ∂x/∂u ∂x/∂uᵀ + Σ w p ∂²x/∂u².

`fem.static.newton` leaves the last term out. Its iteration then converges only where the term is
small against the others, and such a state is a minimum: a spectral radius below one means H is
positive definite. Blocks that turn much before they touch can come to rest where it is not small.
Here H acts as it is, inside conjugate gradients whose preconditioner is the inverse of the other
terms (the condensed one: no new factorisation, few iterations, because the spectrum is one but for
a few values). A direction of negative curvature is followed down, so a saddle is left, and what is
called equilibrium has been probed to be a minimum.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from fem.contact.law import ContactLaw
from fem.contact.surfaces import Gaps, curvature_tangent
from fem.static.linear_step.linearisation import (
    Linearisation,
    LinearStep,
    UnheldBlocksError,
)
from fem.system.system import NodalInverse, System
from geometry.machine.work import Operation, count
from geometry.mesh import FloatArray

#: Conjugate gradients stop at this share of the unbalanced force, or its root when it is small …
_FORCING = 0.1
#: … and after this many products.
_MAX_PRODUCTS = 80
#: Curvature below this share of that of the preconditioner counts as negative.
_LEAST_CURVATURE = 1e-7
#: Facets whose second derivatives are made at a time: bounds the memory.
_CHUNK = 2048
#: First length of a step along negative curvature, as a share of the largest displacement.
_FIRST_ESCAPE = 1e-3
#: Share of the first slope that a step must gain.
_ARMIJO = 1e-4
#: Rounding of an energy as a share of the sizes of its parts.
_ENERGY_ROUNDING = 1e-14
#: Halvings or doublings of a step.
_MAX_SCALINGS = 40


@dataclass(frozen=True)
class Descent:
    """Where a descent ended."""

    displacement: FloatArray
    """(n_nodes, 3) [mm], block frames; inner nodes as the linear step leaves them."""
    residuals: tuple[float, ...]
    """Residual before every step, and the last."""
    converged: bool
    """Whether the residual is below the tolerance at a minimum."""
    saddles: int
    """Stationary points left because the energy falls along some motion."""


class Residual(Protocol):
    """Measures an unbalanced force."""

    def __call__(self, unbalanced: FloatArray, contact_forces: FloatArray) -> float:
        """Relative size of (n_nodes, 3) [N], given w p of the points [N]."""


@dataclass(frozen=True)
class _State:
    displacement: FloatArray
    gaps: Gaps
    energy: float
    """[N mm]"""
    rounding: float
    """Below this, differences of the energy mean nothing [N mm]."""
    force: FloatArray
    """Unbalanced nodal force, minus the gradient of the energy, (n_nodes, 3) [N]."""


class _Energy:
    """Energy of the displacements under a load."""

    def __init__(self, system: System, step: LinearStep, load_factor: float) -> None:
        self.system = system
        self.step = step
        self.weights = system.points.weights[..., None]
        self.load = step.load(load_factor)

    @property
    def law(self) -> ContactLaw:
        return self.system.law.normal

    def __call__(self, displacement: FloatArray) -> _State:
        internal = self.step.internal_force(displacement)
        result = self.system.points.gaps(displacement)
        stored = float(np.vdot(self.weights, self.law.stored_energy(result.x)))
        strain = 0.5 * float(np.vdot(internal, displacement))
        work = float(np.vdot(self.load, displacement))
        force = self.load - internal
        force = force + self.system.points.scatter(
            result.gradient, self.weights * self.law.pressure(result.x)
        )
        return _State(
            displacement=displacement,
            gaps=result,
            energy=strain + stored - work,
            rounding=_ENERGY_ROUNDING * (abs(strain) + abs(stored) + abs(work)),
            force=force - self.system.held.part(force),
        )

    def hessian(self, state: _State) -> Callable[[FloatArray], FloatArray]:
        """H at a state, as a function of a free displacement."""
        points, held, result = self.system.points, self.system.held, state.gaps
        stiffness = self.weights * self.law.stiffness(result.x)
        bending = self._curvature(state)

        def apply(change: FloatArray) -> FloatArray:
            force = self.step.internal_force(change)
            force = force - points.scatter(
                result.gradient, stiffness * points.gather(result.gradient, change)
            )
            corners = points.moved(change)
            bent = bending @ corners.reshape(len(corners), -1, 1)
            force += points.scatter_nodes(bent.reshape(corners.shape))
            return force - held.part(force)

        return apply

    def _curvature(self, state: _State) -> FloatArray:
        """Σ w p ∂²x/∂u² of each facet, world axes, (n_facets, m, m) [N/mm]."""
        surfaces = self.system.points
        corners = surfaces.moved(state.displacement)
        forces = (self.weights * self.law.pressure(state.gaps.x))[..., 0]
        size = 3 * corners.shape[1]
        tangent = np.empty((surfaces.n_facets, size, size))
        for first in range(0, surfaces.n_facets, _CHUNK):
            some = np.arange(first, min(first + _CHUNK, surfaces.n_facets))
            tangent[some] = curvature_tangent(surfaces.subset(some), corners[some], forces[some])
        return tangent

    def linearisation(self, state: _State) -> Linearisation:
        """Tangent of the law at a state, for the preconditioner."""
        at = state.gaps.x
        return Linearisation(
            weights=self.weights[..., 0],
            gradient=state.gaps.gradient,
            constant=np.zeros_like(at),
            at=at,
            traction=self.law.pressure(at),
            slope=self.law.stiffness(at)[..., None],
        )


def minimise_energy(
    system: System,
    step: LinearStep,
    displacement: FloatArray,
    *,
    residual: Residual,
    load_factor: float = 1.0,
    holding: float = 0.0,
    tolerance: float = 1e-8,
    max_iterations: int = 120,
) -> Descent:
    """Follow the energy down to a minimum; current normals, no friction.

    Parameters
    ----------
    system, step
        The problem, and what inverts its tangent without the curvature of the gaps.
    displacement
        Where to start, (n_nodes, 3) [mm].
    residual
        Measures the unbalanced force.
    load_factor
        Share of the loads [-].
    holding
        Springs on every block in the preconditioner [N/mm]: no effect on the result.
    tolerance
        Residual at which to stop [-].
    max_iterations
        Steps at most.

    Raises
    ------
    UnheldBlocksError
        Blocks that nothing holds.
    """
    energy = _Energy(system, step, load_factor)
    state = energy(displacement)
    residuals: list[float] = []
    saddles = 0
    for _ in range(max_iterations):
        count(Operation.CALL, system.n_slots)
        pressure = energy.weights * energy.law.pressure(state.gaps.x)
        residuals.append(residual(state.force, pressure))
        precondition = _preconditioner(energy, state, holding)
        hessian = energy.hessian(state)
        settled = residuals[-1] <= tolerance
        right = _random_force(energy, state) if settled else state.force
        forcing = 1e-3 if settled else min(_FORCING, np.sqrt(residuals[-1]))
        result = _conjugate_gradients(hessian, precondition, right, forcing)
        if settled and not result.falls:
            return Descent(state.displacement, tuple(residuals), True, saddles)
        saddles += settled
        after = (
            _escape(energy, state, result.way) if result.falls else _search(energy, state, result)
        )
        if after is None:
            break
        state = after
    return Descent(state.displacement, tuple(residuals), False, saddles)


def _preconditioner(energy: _Energy, state: _State, holding: float) -> NodalInverse:
    """Inverse of the tangent without the curvature, with springs when nothing else holds."""
    linear = energy.linearisation(state)
    for _ in range(8):
        try:
            return energy.step.inverse(linear, holding)
        except UnheldBlocksError as error:
            unheld = error
            holding *= 10.0
    raise unheld


def _random_force(energy: _Energy, state: _State) -> FloatArray:
    """Forces of random contact pressures: no motion that contacts feel is orthogonal to them."""
    random = np.random.default_rng(0).standard_normal(energy.weights.shape)
    scattered = energy.system.points.scatter(state.gaps.gradient, energy.weights * random)
    return scattered - energy.system.held.part(scattered)


@dataclass(frozen=True)
class _Way:
    way: FloatArray
    """Newton's step, or a direction of negative curvature."""
    falls: bool
    """Whether it is the latter."""


def _conjugate_gradients(
    hessian: Callable[[FloatArray], FloatArray],
    precondition: NodalInverse,
    right: FloatArray,
    forcing: float,
) -> _Way:
    """Solve H x = right, or meet a direction along which H is not positive."""
    x = np.zeros_like(right)
    rest = right
    z = precondition(rest)
    way, size = z, float(np.vdot(rest, z))
    by_preconditioner = size
    for _ in range(_MAX_PRODUCTS):
        product = hessian(way)
        curvature = float(np.vdot(way, product))
        if curvature <= _LEAST_CURVATURE * by_preconditioner:
            return _Way(way if np.vdot(way, right) >= 0.0 else -way, True)
        length = size / curvature
        x = x + length * way
        rest = rest - length * product
        if np.linalg.norm(rest) <= forcing * np.linalg.norm(right):
            break
        z = precondition(rest)
        size, before = float(np.vdot(rest, z)), size
        way = z + size / before * way
        # z is orthogonal to the way before it in the metric of the preconditioner's inverse.
        by_preconditioner = size + (size / before) ** 2 * by_preconditioner
    return _Way(x, False)


def _search(energy: _Energy, state: _State, found: _Way) -> _State | None:
    """Go along Newton's step until the energy has fallen enough."""
    slope = -float(np.vdot(state.force, found.way))
    share = 1.0
    for _ in range(_MAX_SCALINGS):
        after = energy(state.displacement + share * found.way)
        gained = after.energy - state.energy
        end_slope = -float(np.vdot(after.force, found.way))
        # Where differences of energies are rounding, slopes decide (approximate Wolfe).
        flat = gained <= state.rounding and end_slope <= (2.0 * _ARMIJO - 1.0) * slope
        if gained <= _ARMIJO * share * slope or flat:
            return after
        share *= 0.5
    return None


def _escape(energy: _Energy, state: _State, way: FloatArray) -> _State | None:
    """Go along a direction of negative curvature for as long as the energy falls."""
    largest = float(np.abs(state.displacement).max())
    length = _FIRST_ESCAPE * largest / float(np.abs(way).max())
    best: _State | None = None
    for k in range(_MAX_SCALINGS):
        after = energy(state.displacement + 2.0**k * length * way)
        if after.energy >= (state if best is None else best).energy:
            break
        best = after
    return best
