"""Static and explicit answers to one statement (`fem.assembly.statement.Problem`)."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Literal

from fem.answer import Answer
from fem.assembly.statement import Problem, ProblemError
from fem.explicit.setup.statement import explicit_statement
from fem.explicit.solve import StopCriterion, UnstableRun, solve
from fem.problem.effects import AdaptiveMassDamping, Effects
from fem.static.rotation import solve_static_with_rotation
from fem.static.solve import StaticError, StaticOptions
from fem.static.solve import solve_static as solve_blocks

#: Relative force residual at which a run to the static state stops [-].
RESIDUAL = 1.0e-4


def solve_static(problem: Problem, options: StaticOptions | None = None) -> Answer:
    """Find the static state by Newton's method.

    Parameters
    ----------
    problem
        The statement.
    options
        Tolerance, symmetry, load steps.

    Raises
    ------
    ProblemError
        Finite sliding, which needs an explicit run.
    StaticError
        No equilibrium, or none that was found.
    ContactError, DeformableAssemblyError, SymmetryError
        What cannot be solved.
    """
    if problem.finite_sliding:
        raise ProblemError(
            "finite_sliding: static blocks stay on the facets that they meet; expected it off, or "
            "solve_explicit"
        )
    run = solve_static_with_rotation if problem.finite_rotation else solve_blocks
    result = run(problem.deformable, options)
    if not result.converged:
        raise StaticError(result.status)
    return Answer(
        deformable=problem.deformable,
        group_displacements=result.displacements,
        contact_state=result.contact_state,
        finite_rotation=problem.finite_rotation,
        solver=result,
    )


def solve_explicit(
    problem: Problem,
    *,
    damping: Effects | Literal["static"] | None = "static",
    residual: float = RESIDUAL,
    ramp_time: float | None = None,
    end_time: float | None = None,
    symmetry: Literal["auto", "none", "sector"] = "auto",
    threads: int = 1,
) -> Answer:
    """Run explicit dynamics; again with a shorter step where contact grows too stiff for it.

    Parameters
    ----------
    problem
        The statement.
    damping
        ``static``: adaptively to the static state, where the run stops; effects such as Rayleigh
        damping and bulk viscosity; None: none.
    residual
        Unbalanced over applied force at which a run to the static state stops [-].
    ramp_time, end_time
        Smooth step of the loads and latest end [s]; None: from the lowest excited frequency.
    symmetry
        Whether one block of each layer may stand for all.
    threads
        Of the loops; the bits of the answer do not depend on it.

    Raises
    ------
    ContactError, DeformableAssemblyError, SymmetryError, EffectError, TimeStepError
        What cannot be run.
    UnstableRun
        A run that gained energy.
    """
    static = damping == "static"
    given = damping if isinstance(damping, Effects) else Effects()
    effects = replace(
        given,
        finite_rotation=problem.finite_rotation or given.finite_rotation,
        adaptive_mass_damping=AdaptiveMassDamping() if static else given.adaptive_mass_damping,
    )
    state = partial(
        explicit_statement,
        problem.deformable,
        effects=effects,
        symmetry=symmetry,
        ramp_time=ramp_time,
        end_time=end_time,
    )
    stated = state()
    stop = StopCriterion(residual=residual if static else 0.0, not_before=stated.ramp_time)
    while True:
        try:
            model = stated.assembly.model
            result = solve(model, end_time=stated.end_time, threads=threads, stop=stop)
            break
        except UnstableRun:
            counted = stated.more_counted()
            if counted is None:
                raise
            stated = state(counted_pressure=counted)
    whole = stated.assembly
    return Answer(
        deformable=problem.deformable,
        group_displacements=whole.expand(result.displacements),
        contact_state=whole.contact_state(result.displacements),
        finite_rotation=effects.finite_rotation,
        solver=result,
    )
