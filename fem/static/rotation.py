"""Static states with finite rotation of the blocks: rounds of small-rotation solutions.

Equilibrium with finite rotation is K u = f + Δf(u), with Δf what a turned block takes for strain
(`fem.static.rotation`). Each round solves with the Δf of the last solution; what Δf still
changes is the residual that is left. It contracts while blocks turn by some hundredths of a
radian, if the first round starts from blocks whose linear rotation has become a finite one: the
stretch of the linear one alone makes Δf thousands of times the load.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fem.static.linear_step.flexibility import FlexibilityStore
from fem.static.result import StaticError, StaticResult
from fem.static.solve import StaticOptions, solve_static
from fem.stresses.recovery import block_displacements, internal_forces, turned_rigidly
from fem.system.build import DeformableAssembly
from fem.system.model import (
    Model,
    NodalLoad,
    nodal_load,
    refuse_turning_springs,
)
from fem.system.sector import local_forces
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
    start: StaticResult | None = None,
    store: FlexibilityStore | None = None,
) -> StaticResult:
    """Find the static state of an assembly whose blocks may turn.

    Arguments are those of `fem.static.solve.solve_static`; ``start`` may be the state without
    rotation.

    Returns
    -------
    StaticResult
        Its residual counts what rotation still changes; its energies are those of the blocks'
        own frames.

    Raises
    ------
    StaticError
        Blocks that turn too far for these rounds, supports that move step by step; and as there.
    SymmetryError, SparseSolverError
        As there.
    """
    refuse_turning_springs(deformable.model.groups)
    if not deformable.meets:
        raise StaticError(
            'effects.finite_rotation: got fem.method = "static", which is linear for single '
            'bodies; expected fem.method = "explicit", or finite_rotation off'
        )
    options = StaticOptions() if options is None else options
    if options.motion_steps is not None and deformable.moves:
        # The forces of the rotation are those of the end: steps on the way would be no states.
        raise StaticError(
            "effects.finite_rotation: got supports that move step by step; expected "
            'finite_rotation off, or fem.method = "explicit"'
        )
    store = FlexibilityStore() if store is None else store
    model = deformable.model
    size = float(np.sqrt(sum((forces**2).sum() for forces in local_forces(deformable))))
    exact = replace(options, tolerance=_ROUND * options.tolerance)
    result = solve_static(deformable, options, start=start, store=store)
    residuals = list(result.residuals)
    before: FloatArray | None = None
    added: tuple[NodalLoad, ...] = ()
    history: list[float] = []
    moved = tuple(map(turned_rigidly, model.groups, result.displacements))
    while result.residual <= options.tolerance:
        found = finite_rotation_loads(model, moved)
        forces = np.concatenate([load.forces.ravel() for load in found])
        change = float(np.linalg.norm(forces if before is None else forces - before))
        history.append(change / size if size > 0.0 else change)
        if history[-1] <= options.tolerance:
            break
        stuck = len(history) > 4 and history[-1] > _PROGRESS * history[-3]
        if stuck or len(history) > _MAX_ROUNDS:
            raise _too_far(history)
        before, added = forces, found
        turned = replace(deformable, model=replace(model, loads=(*model.loads, *added)))
        result = replace(result, displacements=moved)
        try:
            result = solve_static(turned, exact, start=result, slips_from_rest=True, store=store)
        except StaticError:
            raise _too_far(history) from None
        moved = result.displacements
        residuals += result.residuals
        if result.residual > options.tolerance:
            raise _too_far(history)
    status, converged = result.status, result.residual <= options.tolerance
    if converged and not result.converged:
        status = f"equilibrium after {len(residuals)} iterations, residual {result.residual:.1e}"
    rounds = f"; finite rotation in {len(history)} rounds" if history else ""
    return replace(
        result,
        deformable=deformable,
        converged=converged,
        residual=result.residual + (history[-1] if history else 0.0),
        residuals=tuple(residuals),
        status=status + rounds,
        strain_energy=_strain_energy(deformable, result.displacements),
        external_work=result.external_work - _work(added, result.displacements),
    )


def _too_far(changes: list[float]) -> StaticError:
    """Rounds that lead nowhere, with what the last one changed over the load."""
    return StaticError(
        "effects.finite_rotation: blocks turn too far for the static solver (the forces of the "
        f"rotation still change by {changes[-1]:.2g} of the load after {len(changes)} rounds); "
        'expected fem.method = "explicit"'
    )


def _strain_energy(deformable: DeformableAssembly, displacements: tuple[FloatArray, ...]) -> float:
    """Of all blocks, rigid rotation removed [N mm]."""
    energy = 0.0
    for group, moved in zip(deformable.model.groups, displacements, strict=True):
        local, _ = block_displacements(group, moved, finite_rotation=True)
        energy += 0.5 * float(np.vdot(local, group.internal_force(local)))
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
    return tuple(
        nodal_load(
            k,
            internal_forces(group, u, finite_rotation=False)
            - internal_forces(group, u, finite_rotation=True),
            copies=range(len(u)),
        )
        for k, (group, u) in enumerate(zip(model.groups, displacements, strict=True))
    )
