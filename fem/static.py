"""Static equilibrium of deformable blocks in contact, by Newton in displacements and pressures.

Each point of contact keeps a *linearisation overclosure* x̂. One iteration solves the linear
problem in which the law is replaced by its tangent there,

    K u + Σ w (p(x̂) + p'(x̂) (x(u) - x̂)) ∂x/∂u = f,

and then moves x̂: where the linear pressure is positive, to the overclosure at which the law has
that *same pressure* (Newton on the inverse of the law, which is nearly straight where the law is
an exponential); elsewhere to the overclosure just found. Gap gradients follow the current
normals from iteration to iteration.

The residual is that of the law itself: f - K u - Σ w p(x(u)) ∂x/∂u.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fem.contact import PointKinematics
from fem.linearisation import Linearisation, LinearStep
from fem.local_system import LocalSystem
from geometry.mesh import FloatArray


class StaticError(ValueError):
    """A static problem without a solution that could be found: what is wrong."""


@dataclass(frozen=True)
class StaticOptions:
    """How hard to try."""

    tolerance: float = 1e-8
    """Residual over load at which the iteration stops [-]."""
    max_iterations: int = 60
    """Linear problems solved at most."""
    start_pressure: float = 0.01
    """Pressure at which every point is linearised first [MPa]."""


def newton(
    system: LocalSystem, step: LinearStep, options: StaticOptions, hold=0.0, fac=0.3
) -> tuple[FloatArray, PointKinematics, list[float]]:
    """Iterate to the residual tolerance."""
    contact = system.deformable.contact
    law, weights = contact.law, system.surfaces.weights
    displacement = np.zeros((system.n_nodes, 3))
    found = system.kinematics(displacement, contact.normals)
    at = np.full_like(found.overclosure, float(law.overclosure(options.start_pressure)))
    scale = float(np.linalg.norm(system.external_force))
    history: list[float] = []
    for _ in range(options.max_iterations):
        linear = Linearisation(
            gradient=found.gradient,
            constant=found.overclosure - system.gather(found.gradient, displacement),
            at=at,
            pressure=law.pressure(at),
            stiffness=law.stiffness(at),
        )
        displacement = step(linear, displacement, hold)
        hold *= fac
        if hold<1e-6: hold=0.
        pressure = linear.linear_pressure(system, displacement)
        found = system.kinematics(displacement, contact.normals)
        residual = system.free_part(
            step.unbalanced(displacement)
            + system.scatter(found.gradient, weights * law.pressure(found.overclosure))
        )
        history.append(float(np.linalg.norm(residual)) / scale)
        if history[-1] < options.tolerance:
            break
        at = np.where(pressure > 0.0, law.overclosure(pressure), found.overclosure)
    return displacement, found, history
