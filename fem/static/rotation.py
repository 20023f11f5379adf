"""Static states with finite rotation of the blocks: rounds of small-rotation solutions.

Equilibrium with finite rotation is K u = f + Δf(u), with Δf what a turned block takes for strain
(`fem.static.rotation`). Each round solves with the Δf of the last solution; what Δf still
changes is the residual that is left. It contracts while blocks turn by some hundredths of a
radian, if the first round starts from blocks whose linear rotation has become a finite one: the
stretch of the linear one alone makes Δf thousands of times the load.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fem.state import State
from fem.static.linear_step.flexibility import FlexibilityStore
from fem.static.result import StaticError
from fem.static.solve import StaticOptions, solve_static
from fem.stresses.recovery import internal_forces, turned_rigidly
from fem.system.body import Body
from fem.system.model import (
    NodalLoad,
    nodal_load,
    refuse_turning_springs,
)
from fem.system.system import System
from geometry.mesh import FloatArray

#: Each round is solved to this share of the tolerance: what is left of it turns blocks, and the
#: forces of soft motions' turns change by tenfold and more.
_ROUND = 1e-2
#: Rounds after which there is no hope.
_MAX_ROUNDS = 40
#: Two rounds must bring the residual below this share of what it was.
_PROGRESS = 0.7


def solve_static_with_rotation(
    deformable: System,
    options: StaticOptions | None = None,
    *,
    start: tuple[FloatArray, ...] | None = None,
    store: FlexibilityStore | None = None,
) -> State:
    """Find the static state of an assembly whose blocks may turn.

    Arguments are those of `fem.static.solve.solve_static`; ``start`` may be of the state without
    rotation.

    Returns
    -------
    State
        Its residual counts what rotation still changes.

    Raises
    ------
    StaticError
        Blocks that turn too far for these rounds, supports that move step by step; and as there.
    SymmetryError, SparseSolverError
        As there.
    """
    refuse_turning_springs(deformable.bodies)
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
    size = float(np.sqrt(sum((forces**2).sum() for forces in deformable.forces_in_frames())))
    exact = replace(options, tolerance=_ROUND * options.tolerance)
    state = solve_static(deformable, options, start=start, store=store)
    residuals = list(state.evidence.residuals)
    before: FloatArray | None = None
    history: list[float] = []
    moved = tuple(map(turned_rigidly, deformable.bodies, state.displacements))
    while residuals[-1] <= options.tolerance:
        added = finite_rotation_loads(deformable.bodies, moved)
        forces = np.concatenate([load.forces.ravel() for load in added])
        change = float(np.linalg.norm(forces if before is None else forces - before))
        history.append(change / size if size > 0.0 else change)
        if history[-1] <= options.tolerance:
            break
        stuck = len(history) > 4 and history[-1] > _PROGRESS * history[-3]
        if stuck or len(history) > _MAX_ROUNDS:
            raise _too_far(history)
        before = forces
        turned = replace(deformable, forces=(*deformable.forces, *added))
        try:
            state = solve_static(turned, exact, start=moved, slips_from_rest=True, store=store)
        except StaticError:
            raise _too_far(history) from None
        moved = state.displacements
        residuals += state.evidence.residuals
        if residuals[-1] > options.tolerance:
            raise _too_far(history)
    evidence, converged = state.evidence, residuals[-1] <= options.tolerance
    status = evidence.status
    if converged and not evidence.converged:
        status = f"equilibrium after {len(residuals)} iterations, residual {residuals[-1]:.1e}"
    if history:
        status += f"; finite rotation in {len(history)} rounds"
        residuals[-1] += history[-1]
    return replace(
        state,
        system=replace(state.system, forces=deformable.forces),
        finite_rotation=True,
        evidence=replace(evidence, converged=converged, residuals=tuple(residuals), status=status),
    )


def _too_far(changes: list[float]) -> StaticError:
    """Rounds that lead nowhere, with what the last one changed over the load."""
    return StaticError(
        "effects.finite_rotation: blocks turn too far for the static solver (the forces of the "
        f"rotation still change by {changes[-1]:.2g} of the load after {len(changes)} rounds); "
        'expected fem.method = "explicit"'
    )


def finite_rotation_loads(
    bodies: Sequence[Body], displacements: tuple[FloatArray, ...]
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
        for k, (group, u) in enumerate(zip(bodies, displacements, strict=True))
    )
