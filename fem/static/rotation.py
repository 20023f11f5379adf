"""Static states with finite rotation of the blocks: rounds of small-rotation solutions.

Equilibrium with finite rotation is K u = f + Δf(u), with Δf what a turned block takes for strain
(`fem.static.rotation`). Each round solves with the Δf of the last solution; what Δf still
changes is the residual that is left. It contracts while blocks turn by some thousandths of a
radian.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fem.assembly.deformable import DeformableAssembly
from fem.assembly.symmetry import local_forces
from fem.explicit.solve import initial_state, prepare
from fem.explicit.state import world_vectors
from fem.explicit.step import placed_internal_force
from fem.problem.effects import Effects
from fem.problem.model import Model, NodalLoad, nodal_load
from fem.problem.recovery import block_displacements
from fem.static.linear_step.condensed import FlexibilityStore
from fem.static.result import StaticError, StaticResult
from fem.static.solve import StaticOptions, solve_static
from geometry.mesh import FloatArray

#: Each round is solved to this share of the tolerance: what is left of it turns blocks, and the
#: forces of soft motions' turns change by tenfold and more.
_ROUND = 1e-2
#: Rounds after which there is no hope.
_MAX_ROUNDS = 40
#: Two rounds must bring the residual below this share of what it was.
_PROGRESS = 0.7


def solve_static_with_rotation(
    deformable: DeformableAssembly,
    options: StaticOptions | None = None,
    *,
    store: FlexibilityStore | None = None,
) -> StaticResult:
    """Find the static state of an assembly whose blocks may turn.

    Arguments are those of `fem.static.solve.solve_static`.

    Returns
    -------
    StaticResult
        Its residual counts what rotation still changes; its energies are those of the blocks'
        own frames.

    Raises
    ------
    StaticError
        Blocks that turn too far for these rounds; and as there.
    SymmetryError, SparseSolverError
        As there.
    """
    if not deformable.meets:
        raise StaticError(
            'effects.finite_rotation: got fem.method = "static", which is linear for single '
            'bodies; expected fem.method = "explicit", or finite_rotation off'
        )
    options = StaticOptions() if options is None else options
    store = FlexibilityStore() if store is None else store
    model = deformable.model
    size = float(np.sqrt(sum((forces**2).sum() for forces in local_forces(deformable))))
    exact = replace(options, tolerance=_ROUND * options.tolerance)
    result = solve_static(deformable, exact, store=store)
    residuals = list(result.residuals)
    before: FloatArray | None = None
    added: tuple[NodalLoad, ...] = ()
    history: list[float] = []
    while result.converged:
        found = finite_rotation_loads(model, result.displacements)
        forces = np.concatenate([load.forces.ravel() for load in found])
        change = float(np.linalg.norm(forces if before is None else forces - before))
        history.append(change / size if size > 0.0 else change)
        if history[-1] <= options.tolerance:
            break
        stuck = len(history) > 4 and history[-1] > _PROGRESS * history[-3]
        if stuck or len(history) > _MAX_ROUNDS:
            raise StaticError(
                "effects.finite_rotation: blocks turn too far for the static solver (the forces "
                f"of the rotation still change by {history[-1]:.2g} of the load after "
                f'{len(history)} rounds); expected fem.method = "explicit"'
            )
        before, added = forces, found
        turned = replace(deformable, model=replace(model, loads=(*model.loads, *added)))
        result = solve_static(turned, exact, start=result, store=store)
        residuals += result.residuals
    rounds = f"; finite rotation in {len(history)} rounds" if history else ""
    return replace(
        result,
        deformable=deformable,
        residual=result.residual + (history[-1] if history else 0.0),
        residuals=tuple(residuals),
        status=result.status + rounds,
        strain_energy=_strain_energy(deformable, result.displacements),
        external_work=result.external_work - _work(added, result.displacements),
    )


def _strain_energy(deformable: DeformableAssembly, displacements: tuple[FloatArray, ...]) -> float:
    """Of all blocks, rigid rotation removed [N mm]."""
    energy = 0.0
    for group, moved in zip(deformable.model.groups, displacements, strict=True):
        local, _ = block_displacements(group, moved, finite_rotation=True)
        flat = local.reshape(len(local), -1)
        energy += 0.5 * float(np.vdot(flat, (group.stiffness @ flat.T).T))
    return energy


def _work(loads: tuple[NodalLoad, ...], displacements: tuple[FloatArray, ...]) -> float:
    """Of loads along displacements [N mm]."""
    return sum(
        float(np.vdot(load.forces, displacements[load.group][load.copies, load.nodes]))
        for load in loads
    )


def finite_rotation_loads(
    model: Model, displacements: tuple[FloatArray, ...]
) -> tuple[NodalLoad, ...]:
    """Δf = K u - f_frame(u) of every block: what finite rotations change.

    A stiffness that does not turn with its block takes a rotation for strain: K u differs from the
    force in the block's best-fitting frame (`fem.explicit.block_frame`) by Δf, of second order in
    the rotation. Equilibrium with finite rotation, f_frame(u) = f, is K u = f + Δf(u): with Δf of a
    solution u as further loads, the next solution has finite rotation to first order in the change.
    Displacements are those of each group in world axes, (n_copies, n_nodes, 3) [mm].
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
        world_vectors(body, placed_internal_force(body, now))
        for body, now in zip(system.bodies, state.bodies, strict=True)
    ]
