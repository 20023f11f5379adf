"""Forces of supports in an explicit run: what held nodes need beside loads, contact and weight."""

from __future__ import annotations

from fem.explicit.damping import applied_forces, gravity_forces
from fem.explicit.state import Lanes, world_vectors
from fem.explicit.step import ExplicitSystem, damped_internal_force
from geometry.mesh import FloatArray


def forces_of_supports(system: ExplicitSystem, state: Lanes, time: float) -> tuple[FloatArray, ...]:
    """Unbalanced forces at a time [s], world axes, (n_copies, n_nodes, 3) [N] of each group.

    Of the forces that the state holds. Along what a support holds they are those of the support,
    but for the inertia of the held nodes themselves.
    """
    result = []
    for body, now in zip(system.bodies, state.bodies, strict=True):
        inner = damped_internal_force(system, body, now)
        outer = applied_forces(body, now) + gravity_forces(system, body, time)
        result.append(world_vectors(body, inner - outer))
    return tuple(result)
