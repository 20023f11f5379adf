"""The explicit answer to a problem: a run."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from fem.answer.answer import answer_of
from fem.explicit.output.checkpoint import OtherProblemError
from fem.explicit.setup.timed_system import (
    blocks_in_time,
    check_timed,
    counting_more,
    timed_system,
)
from fem.explicit.solve import (
    Frame,
    Output,
    Progress,
    UnstableRun,
    choose_time_step,
    run_explicit,
)
from fem.explicit.timed import TimedSystem
from fem.method import Explicit, require_method
from fem.problem import Problem, ProblemError, require_problem
from fem.state import State
from fem.system.sector import check_system
from fem.system.system import Sector
from geometry.answer import Answer
from geometry.machine.system import one_thread_of_blas
from geometry.machine.work import budget, clock, memory_limit, require_memory, timed_stages

#: Frames are parts of this part of the longest run, where it may end early and has no ramp.
_FINE = 200.0
#: A limit of which nothing is left [s].
_NOTHING = 1e-9
#: Bytes of a node: its rows of the stiffness of a shape, as assembled and as the loop has it; and
#: what evolves, of each copy.
_CONSTANT, _STATE = 2.0 * 27 * 80, 8.0 * 24
_DEFAULT = Explicit()


@one_thread_of_blas()
def solve_explicit(
    problem: Problem,
    method: Explicit = _DEFAULT,
    *,
    progress: Callable[[Progress | str], None] | None = None,
    on_frame: Callable[[Frame], None] | None = None,
    checkpoint: Path | None = None,
    resume: Path | None = None,
) -> Answer:
    """Run explicit dynamics; again with a shorter step where contact grows too stiff for it.

    Parameters
    ----------
    problem
        The statement.
    method
        Damping, times, time step, threads.
    progress
        Called at every sample of the run (`fem.explicit.solve.Progress`), and with what comes next
        in words.
    on_frame
        Called with the displacements of all blocks, ``method.frames`` times or more often: a run to
        the static state may end at any time after the ramp.
    checkpoint
        File that is written on interruption (Ctrl-C), and every minute.
    resume
        Such a file, to go on from.

    Returns
    -------
    Answer
        Without error bars: other meshes are other runs, and `solve_static` gives the static state
        of a stated accuracy. A run that is cut short has the status ``interrupted`` or, by
        ``method.max_work`` or ``max_seconds``, ``stopped``.

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
    StateError, CheckpointError
        A checkpoint that cannot be written, or is not one of this run.
    """
    require_method(method, Explicit, "solve_explicit")
    with timed_stages() as watch:
        problem = check_explicit(problem, method)
        watch.lap("build")
        method = replace(method, damping=method.damped(moves=problem.motion is not None))
        output = Output(progress=progress, on_frame=on_frame, checkpoint=checkpoint)
        if progress is not None:
            progress("critical time step")
        with budget() as spent:
            state = explicit_state(problem, method, output, resume)
        spent.work, spent.memory = method.max_work, method.max_memory
        watch.lap("solve")
        run = state.run
        assert run is not None
        seconds = {**watch.seconds(), "loop": run.cost.cpu_seconds}
    parts, beside = {"work": spent}, {"cpu_seconds": seconds}
    return answer_of(state, {}, problem=problem, parts=parts, beside=beside)


def check_explicit(problem: Problem, method: Explicit) -> Problem:
    """Return a problem with hexahedra; reject what no explicit run answers.

    Errors are those of `solve_explicit` that are known before the run; `check_step` has those of
    its critical time step.
    """
    problem = require_problem(problem)
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
    check_timed(
        problem.system,
        finite_rotation=problem.finite_rotation,
        ramp_time=method.ramp_time,
        end_time=method.end_time,
    )
    check_system(problem.system, method.symmetry)
    with budget(memory=method.max_memory):
        # Blocks that are equal, which takes time to see, are looked for only where it matters.
        if _bytes_of_run(problem.system.computed) > memory_limit():
            _refuse_memory(blocks_in_time(problem.system, method.symmetry, problem.motion))
    return problem


def check_step(problem: Problem, method: Explicit) -> None:
    """Reject a time step and a stick stiffness that are stated beyond what the run can take.

    The run does so itself, before its first step.
    """
    stick = None if problem.coulomb is None else problem.coulomb.stick_stiffness
    if stick is not None or method.time_step is not None:
        stated = stated_run(problem, method)
        if method.time_step is not None:
            choose_time_step(stated.critical, method)


def stated_run(problem: Problem, method: Explicit) -> TimedSystem:
    """State the explicit problem and the times of its run: `timed_system`."""
    moves, turning = problem.motion is not None, problem.finite_rotation
    return timed_system(
        problem.system,
        effects=method.effects(moves=moves, finite_rotation=turning, gravity=problem.acceleration),
        symmetry=method.symmetry,
        ramp_time=method.ramp_time,
        end_time=method.end_time,
        motion=problem.motion,
    )


def explicit_state(
    problem: Problem,
    method: Explicit,
    output: Output | None = None,
    resume: Path | None = None,
) -> State:
    """Run a problem on its mesh: see `solve_explicit`.

    Parameters
    ----------
    problem, method, resume
        As `solve_explicit`.
    output
        Frames have the displacements of all blocks, samples the energies of all.

    Raises
    ------
    UnstableRun, TimeStepError, StateError, CheckpointError
        As `fem.explicit.solve.run_explicit`.
    """
    with budget(memory=method.max_memory) as spent:
        ends, stated, restarts = clock(method.max_seconds), stated_run(problem, method), 0
        if output is not None:
            output = _spread(output, stated, method)
        while True:
            _ = stated.critical  # the limit of work counts it
            left = _left(method, spent.seconds, ends)
            try:
                return run_explicit(stated, left, output, resume=resume, restarts=restarts)
            except (UnstableRun, OtherProblemError) as error:
                # A checkpoint may be that of a run that had started again.
                shorter = None if method.time_step is not None else counting_more(stated)
                if shorter is None:
                    raise
                if isinstance(error, UnstableRun):
                    resume, restarts = None, restarts + 1
                stated = shorter


def _spread(output: Output, stated: TimedSystem, method: Explicit) -> Output:
    """Output whose frames are spread over the run."""
    if method.frames == 0:
        return replace(output, on_frame=None)
    times = stated.times
    spread = times.end
    if stated.effects.adaptive_mass_damping is not None:
        # It may end any time after the ramp: all frames lie in it.
        spread = min(times.ramp or times.end / _FINE, times.end)
    return replace(output, frame_interval=spread / max(method.frames - 1, 1))


def _left(method: Explicit, worked: float, ends: float) -> Explicit:
    """Method with what is left of its limits after some work [s]."""
    work, seconds = method.max_work, method.max_seconds
    return replace(
        method,
        max_work=None if work is None else max(work - worked, _NOTHING),
        max_seconds=None if seconds is None else max(ends - time.process_time(), _NOTHING),
    )


def _bytes_of_run(system: Sector) -> float:
    """Memory that the blocks which are computed take."""
    copies = np.bincount(system.whole.body_number[system.blocks])
    bodies = zip(system.whole.bodies, copies.tolist(), strict=True)
    return sum(body.n_nodes * (_CONSTANT + _STATE * n) for body, n in bodies)


def _refuse_memory(system: Sector) -> None:
    """Reject a run that needs more memory than it may have, before it is tried."""
    require_memory(
        f"{system.n_nodes} nodes of {system.whole.assembly.n_blocks} blocks",
        _bytes_of_run(system),
        "fewer elements or fewer blocks",
    )
