"""Damping towards the static state: adaptive mass damping and the force residual that stops it.

Constant Rayleigh damping is in the step itself (`fem.explicit.step`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fem.explicit.body import LaneBody, world_vectors
from fem.explicit.kernels.layout import LaneArray
from fem.explicit.step import (
    Loop,
    damped_internal_force,
    gravity_at,
)
from fem.system.effects import AdaptiveMassDamping
from geometry.mesh import FloatArray

#: Mass damping never exceeds this over Δt: beyond, damping is slow again.
CAP = 0.5


@dataclass(frozen=True)
class Residual:
    """Force imbalance of a state."""

    unbalanced: float
    """Norm of the forces that accelerate free degrees of freedom [N]."""
    reference: float
    """Norm of the loads, or of the internal forces when nothing is loaded [N]."""

    @property
    def relative(self) -> float:
        """Unbalanced over reference; 0 when there are no forces at all."""
        if self.reference == 0.0:
            return 0.0 if self.unbalanced == 0.0 else math.inf
        return self.unbalanced / self.reference


def applied_forces(body: LaneBody) -> FloatArray:
    """Loads and contact on all rows, (n_rows, 3, lanes) [N], without gravity."""
    force, applied = np.zeros((body.n_rows, 3, body.lanes)), body.now.applied_force
    if body.applied_row is not None and applied is not None:
        touched = body.applied_row >= 0
        force[touched] = applied[body.applied_row[touched]]
    return force


def load_forces(body: LaneBody) -> FloatArray:
    """Loads alone, (n_rows, 3, lanes) [N]."""
    force, loads = np.zeros((body.n_rows, 3, body.lanes)), body.now.loads
    if loads is not None:
        force[body.loaded[0]] = loads.force[body.loaded[1]]
    return force


def gravity_forces(loop: Loop, body: LaneBody, time: float) -> FloatArray | float:
    """Weight of the rows at a time, (n_rows, 3, lanes) [N]."""
    falling = None if body.acceleration is None else gravity_at(loop, body, time)
    if falling is None:
        return 0.0
    return body.mass[:, None, None] * falling


def free_part(body: LaneBody, force: FloatArray) -> FloatArray:
    """Forces without their components along supports, (n_rows, 3, lanes)."""
    held = body.held
    if held is None:
        return force
    free = force.copy()
    flat = free.ravel()
    flat[held.still.index] = 0.0
    for axis in range(3):
        # Orthonormal directions of one node may be removed together: each from the original.
        index = held.base + axis * body.lanes
        along = sum(
            held.direction[:, j] * force.ravel()[held.base + j * body.lanes] for j in range(3)
        )
        np.subtract.at(flat, index, held.direction[:, axis] * along)
    return free


def residual(loop: Loop) -> Residual:
    """Force residual at the time of the last forces (the beginning of the last step)."""
    time = (loop.step - 1) * loop.time_step
    unbalanced = loads = internal = 0.0
    for body in loop.bodies:
        weight = gravity_forces(loop, body, time)
        inner = damped_internal_force(loop, body)
        total = applied_forces(body) + weight - inner
        unbalanced += _square(free_part(body, total))
        loads += _square(load_forces(body) + weight)
        internal += _square(inner)
    return Residual(math.sqrt(unbalanced), math.sqrt(loads or internal))


def round_off(loop: Loop) -> float:
    """Estimate the force residual that round-off leaves, relative to the loads.

    Every product k_ij u_j of the internal force is off by the last digit of u_j, independently
    of the others: ε √Σ (k_ij u_j)², which is much where blocks have moved far against their
    strain. Displacements are taken from the placement, frames of turning blocks save some.
    """
    square = 0.0
    for body in loop.bodies:
        squares = body.body.stiffness.copy()
        squares.data **= 2
        local = np.einsum(
            "cni,cij->cnj", world_vectors(body, body.now.displacement), body.body.rotations
        )
        products = squares @ (local.reshape(len(local), -1) ** 2).T
        square += float(np.finfo(np.float64).eps) ** 2 * float(products.sum())
    return Residual(math.sqrt(square), residual(loop).reference).relative


def _square(array: FloatArray | LaneArray) -> float:
    return float(np.vdot(array, array))


def settling(loop: Loop) -> float | None:
    """Way still to go over the way gone, ‖v‖ / (ω ‖u‖) in the norm of the masses [-].

    A critically damped motion of frequency ω ends about v/ω from where it is. ω is half the
    adaptive mass damping; None without one, or while nothing has moved.
    """
    adaptive = loop.stated.effects.adaptive_mass_damping
    if adaptive is None or not loop.mass_damping:
        return None
    moved = speed = 0.0
    for body in loop.bodies:
        now = body.now
        moved += float(np.einsum("n,njk,njk->", body.mass, now.displacement, now.displacement))
        speed += float(np.einsum("n,njk,njk->", body.mass, now.velocity, now.velocity))
    if moved == 0.0:
        return None
    frequency = loop.mass_damping / (2.0 * adaptive.fraction(loop.time))
    return math.sqrt(speed / moved) / frequency


def forces_of_supports(loop: Loop, time: float) -> tuple[FloatArray, ...]:
    """Unbalanced forces at a time [s], world axes, (n_copies, n_nodes, 3) [N] of each body.

    Of the forces that the state holds. Along what a support holds they are those of the support,
    but for the inertia of the held nodes themselves.
    """
    result = []
    for body in loop.bodies:
        outer = applied_forces(body) + gravity_forces(loop, body, time)
        result.append(world_vectors(body, damped_internal_force(loop, body) - outer))
    return tuple(result)


def restoring_forces(loop: Loop, body: LaneBody) -> FloatArray:
    """Internal minus contact forces, free components, (n_rows, 3, lanes) [N]."""
    contact = applied_forces(body) - load_forces(body)
    return free_part(body, damped_internal_force(loop, body) - contact)


def remember(loop: Loop) -> None:
    """Keep displacements and restoring forces for the next estimate."""
    for body in loop.bodies:
        now = body.now
        assert now.remembered is not None
        now.remembered[0] = now.displacement - loop.time_step * now.velocity
        now.remembered[1] = restoring_forces(loop, body)


def active_frequency(loop: Loop) -> float | None:
    """Frequency of the present motion by the Rayleigh quotient [rad/s].

    ω² = Δu · Δf / Δu · M Δu with the changes of displacement and restoring force since
    `remember`; None while nothing moves or the quotient is not positive.
    """
    stiffness = inertia = 0.0
    for body in loop.bodies:
        now = body.now
        assert now.remembered is not None
        moved = now.displacement - loop.time_step * now.velocity - now.remembered[0]
        change = restoring_forces(loop, body) - now.remembered[1]
        stiffness += float(np.vdot(moved, change))
        inertia += float(np.einsum("n,njk,njk->", body.mass, moved, moved))
    if not (stiffness > 0.0 and inertia > 0.0):
        return None
    return math.sqrt(stiffness / inertia)


def adapt(loop: Loop, effect: AdaptiveMassDamping) -> None:
    """Set mass damping to critical damping of the active frequency, at most `CAP` / Δt."""
    frequency = active_frequency(loop)
    if frequency is not None:
        wanted = 2.0 * effect.fraction(loop.time) * frequency
        loop.mass_damping = min(wanted, CAP / loop.time_step)
    remember(loop)
