"""What finite rotations of blocks change, as loads on a model without them.

A stiffness that does not turn with its block takes a rotation for strain: K u differs from the
force in the block's best-fitting frame (`fem.explicit.block_frame`) by Δf, of second order in the
rotation. Equilibrium with finite rotation, f_frame(u) = f, is K u = f + Δf(u): with Δf of a
solution u as further loads, the next solution has finite rotation to first order in the change.
"""

from __future__ import annotations

from fem.explicit.solve import initial_state, prepare
from fem.explicit.state import world_vectors
from fem.problem.effects import Effects
from fem.problem.model import Model, NodalLoad, nodal_load
from geometry.mesh import FloatArray


def finite_rotation_loads(
    model: Model, displacements: tuple[FloatArray, ...]
) -> tuple[NodalLoad, ...]:
    """Δf = K u - f_frame(u) of every block.

    Parameters
    ----------
    model
        Groups of blocks.
    displacements
        Of each group in world axes, each (n_copies, n_nodes, 3) [mm].
    """
    turned = _internal_forces(model, displacements, finite_rotation=True)
    straight = _internal_forces(model, displacements, finite_rotation=False)
    return tuple(
        nodal_load(k, b - a, copies=range(len(a)))
        for k, (a, b) in enumerate(zip(turned, straight, strict=True))
    )


def _internal_forces(
    model: Model, displacements: tuple[FloatArray, ...], *, finite_rotation: bool
) -> list[FloatArray]:
    """Internal forces of the explicit solver, world axes, each (n_copies, n_nodes, 3) [N]."""
    plain = Model(groups=model.groups, effects=Effects(finite_rotation=finite_rotation))
    system = prepare(plain, time_step=1.0)
    state = initial_state(system, displacements=displacements)
    return [
        world_vectors(body, now.internal_force)
        for body, now in zip(system.bodies, state.bodies, strict=True)
    ]
