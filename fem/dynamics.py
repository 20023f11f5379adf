"""Explicit answers to a problem (`fem.assembly.statement.Problem`)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Literal

from fem.answer import answer_of
from fem.assembly.statement import Problem, ProblemError, require_problem
from fem.assembly.symmetry import searched_in_all_sectors
from fem.explicit.output.checkpoint import OtherProblemError
from fem.explicit.setup.assembly import ExplicitAssembly
from fem.explicit.setup.statement import ExplicitStatement, explicit_statement
from fem.explicit.solve import (
    ExplicitResult,
    Frame,
    Output,
    Progress,
    StopCriterion,
    UnstableRun,
    solve,
)
from fem.problem.effects import SAFETY_FACTOR, AdaptiveMassDamping, Effects
from fem.solution import RESIDUAL, Solution
from geometry.answer import Answer


def solve_explicit(
    problem: Problem,
    *,
    damping: Effects | Literal["static"] | None = "static",
    residual: float = RESIDUAL,
    ramp_time: float | None = None,
    end_time: float | None = None,
    mass_scaling: float | None = None,
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
    mass_scaling
        Time step that every element is to allow, over the least one [-]; None: masses stay.
    symmetry
        Whether one block of each layer may stand for all.
    threads
        Of the loops; the bits of the answer do not depend on it.

    Raises
    ------
    ContactError
        Blocks overlap at the start by more than the contact law covers.
    DeformableAssemblyError
        Blocks are unrestrained, or fixed blocks have no outer face.
    SymmetryError
        The requested symmetry is not one of the load or the supports.
    EffectError, TimeStepError
        An effect or a time step has an invalid value.
    ProblemError
        Elements of a degree above 1, or nothing acts.
    UnstableRun
        A run that gained energy.
    """
    problem = require_problem(problem)
    if problem.check_blocks:
        problem.require_action()
    if problem.degree > 1:
        raise ProblemError(
            f"degree: got {problem.degree}; explicit runs have elements of degree 1: expected "
            "1, or solve_static"
        )
    if problem.after is not None:
        raise ProblemError(
            "after: explicit runs begin at rest, or with a motion; expected solve_static"
        )
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
        mass_scaling=mass_scaling,
        motion=problem.motion,
    )
    result = explicit_answer(
        state(),
        lambda counted: state(counted_pressure=counted),
        residual=residual if static else 0.0,
        threads=threads,
    )
    return answer_of(replace(result, static_below=residual), problem=problem)


def explicit_answer(
    stated: ExplicitStatement,
    again: Callable[[float], ExplicitStatement],
    *,
    residual: float = 0.0,
    time_step: float | None = None,
    safety_factor: float = SAFETY_FACTOR,
    precision: str = "float64",
    threads: int = 1,
    sample_interval: int = 50,
    output: Output | None = None,
    resume: Path | None = None,
) -> Solution:
    """Run what is stated: see `solve_explicit`.

    Parameters
    ----------
    stated
        The explicit problem and its times.
    again
        States it once more, with more contact stiffness counted in [MPa]: a run whose contact
        grows stiffer than its time step allows starts again with a shorter one.
    residual
        Unbalanced over applied force at which the run stops [-]; 0: it is watched, no more.
    time_step, safety_factor, precision, threads, sample_interval, resume
        As in `fem.explicit.solve.solve`.
    output
        Frames have the displacements of all blocks, samples the energies of all.

    Raises
    ------
    UnstableRun, TimeStepError, StateError, CheckpointError
        As `fem.explicit.solve.solve`.
    """
    restarts = 0
    watched = residual > 0.0 or stated.recommended is not None
    while True:
        whole = stated.assembly
        try:
            result = solve(
                whole.model,
                end_time=stated.end_time,
                time_step=time_step,
                safety_factor=safety_factor,
                precision=precision,
                threads=threads,
                sample_interval=sample_interval,
                velocities=stated.velocities,
                stop=StopCriterion(residual, stated.settled_after) if watched else None,
                output=None if output is None else _of_all_blocks(output, whole, restarts),
                resume=resume,
            )
            break
        except (UnstableRun, OtherProblemError) as error:
            # A checkpoint may be that of a run that had started again.
            counted = None if time_step is not None else stated.more_counted()
            if counted is None:
                raise
            if isinstance(error, UnstableRun):
                resume, restarts = None, restarts + 1
            stated = again(counted)
    return Solution(
        deformable=whole.deformable,
        group_displacements=whole.expand(result.displacements),
        contact_state=whole.contact_state(result.displacements, result.searched, result.slips),
        finite_rotation=whole.model.effects.finite_rotation,
        solver=_of_all_copies(result, whole),
        statement=stated,
        restarts=restarts,
    )


def _of_all_blocks(output: Output, whole: ExplicitAssembly, restarts: int) -> Output:
    """Callbacks that are told of all blocks where one of so many sectors is computed."""
    on_frame, progress = output.on_frame, output.progress

    def frame(found: Frame) -> None:
        assert on_frame is not None
        moved = whole.expand(found.displacements)
        on_frame(replace(found, displacements=moved, restart=restarts))

    def tell(found: Progress) -> None:
        assert progress is not None
        progress(replace(found, energies=found.energies.times(whole.orbits.order)))

    return replace(
        output,
        on_frame=None if on_frame is None else frame,
        progress=None if progress is None else tell,
    )


def _of_all_copies(result: ExplicitResult, whole: ExplicitAssembly) -> ExplicitResult:
    """Result with the energies and forces of the whole where one of some sectors was computed."""
    energies, copies = result.energies, whole.orbits.order
    held, searched = result.support_forces, result.searched
    if searched is not None:
        searched = searched_in_all_sectors(whole.deformable, whole.orbits, searched)
    return replace(
        result,
        energies=None if energies is None else energies.times(copies),
        history=result.history.times(copies),
        support_forces=whole.expand(held) if held else (),
        contact_forces=whole.expand(result.contact_forces),
        searched=searched,
    )
