"""Forces of supports in an explicit run: what held nodes need beside loads, contact and weight."""

from __future__ import annotations

from fem.explicit.damping import applied_forces, gravity_forces
from fem.explicit.state import Loop, world_vectors
from fem.explicit.step import damped_internal_force
from geometry.mesh import FloatArray


def forces_of_supports(loop: Loop, time: float) -> tuple[FloatArray, ...]:
    """Unbalanced forces at a time [s], world axes, (n_copies, n_nodes, 3) [N] of each group.

    Of the forces that the state holds. Along what a support holds they are those of the support,
    but for the inertia of the held nodes themselves.
    """
    result = []
    for body in loop.bodies:
        inner = damped_internal_force(loop, body)
        outer = applied_forces(body) + gravity_forces(loop, body, time)
        result.append(world_vectors(body, inner - outer))
    return tuple(result)
