"""The explicit answer to a problem: a run, its error bars, and the converged static state."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Literal

from fem.accuracy.converge import Progress as Refinement
from fem.accuracy.converge import converge, usual_work, why_not_refined
from fem.accuracy.errors import SAFETY
from fem.accuracy.ladder import OF_FACETS, coarser
from fem.accuracy.one_mesh import SHARES, static_errors
from fem.accuracy.parts import NOT_AT_REST, StaticReference
from fem.accuracy.statics import static_options
from fem.answer import answer_of
from fem.explicit.output.checkpoint import OtherProblemError
from fem.explicit.setup.timed_system import counting_more, state_of, timed_system
from fem.explicit.solve import (
    CUT_SHORT,
    Frame,
    Output,
    Progress,
    Status,
    StopCriterion,
    UnstableRun,
    solve,
)
from fem.explicit.timed import TimedSystem
from fem.measures import measures_of
from fem.method import Explicit, Static, require_method
from fem.problem import Problem, ProblemError, require_problem
from fem.state import State
from fem.static.solve import StaticOptions
from geometry.answer import Answer, Measure
from geometry.compilation.clocks import Stages, stages
from geometry.errors import RefusedError
from geometry.machine.system import one_thread_of_blas
from geometry.machine.work import budget, clock, require_memory
from geometry.parts.rows import Notes, Part

#: Frames are parts of this part of the longest run, where it may end early and has no ramp.
_FINE = 200.0
#: Bytes of a node: its rows of the stiffness of a shape, as assembled and as the loop has it; and
#: what evolves, of each copy.
_CONSTANT, _STATE = 2.0 * 27 * 80, 8.0 * 24
_DEFAULT = Explicit()


@one_thread_of_blas()
def solve_explicit(
    problem: Problem,
    method: Explicit = _DEFAULT,
    *,
    progress: Callable[[Progress | Refinement | str], None] | None = None,
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
        Damping, times, time step, threads, and what stands beside the run: error bars, the
        converged static state of a run to the static state.
    progress
        Called at every sample of the run (`fem.explicit.solve.Progress`), before each mesh of the
        static state (`fem.accuracy.converge.Progress`), and with what comes next in words.
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
        Its parts are `fem.accuracy.parts`. A run that is cut short has the status ``interrupted``
        or, by ``method.max_work`` or ``max_seconds``, ``stopped``, and no error bars.

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
    KeyboardInterrupt
        An interruption while error bars are computed.
    """
    require_method(method, Explicit, "solve_explicit")
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
    method = replace(method, damping=method.damped(moves=problem.motion is not None))
    with stages() as watch:
        _ = problem.deformable
        watch.lap("build")
        output = Output(progress=progress, on_frame=on_frame, checkpoint=checkpoint)
        tell = (lambda _: None) if progress is None else progress
        tell("critical time step")
        with budget() as spent:
            state = explicit_state(problem, method, output, resume)
        spent.work, spent.memory = method.max_work, method.max_memory
        watch.lap("solve")
        run = state.run
        assert run is not None
        errors, parts = dict[str, float](), dict[str, Part](work=spent)
        if run.status not in CUT_SHORT:
            unlimited = replace(method, max_work=None, max_seconds=None)
            errors, beside = _beside(problem, unlimited, state, watch, tell)
            parts |= beside
        seconds = {**watch.seconds(), "loop": run.cpu_seconds}
    return answer_of(state, errors, problem=problem, parts=parts, beside={"cpu_seconds": seconds})


def _beside(
    problem: Problem,
    method: Explicit,
    state: State,
    watch: Stages,
    tell: Callable[[Refinement | str], None],
) -> tuple[dict[str, float], dict[str, Part]]:
    """Error bars of a run, and what is found beside its measures.

    Error bars are differences to the converged static state, or from coarser meshes: of a transient
    the error in time and mesh, as coarser meshes have longer time steps. Where friction keeps the
    drag of damping, what half the ramp changes is added. A run that is not yet at rest has none.
    """
    parts, static = dict[str, Part](), method.damping == "static"
    moving = static and _is_moving(state)
    if moving:
        parts["notes"] = Notes([NOT_AT_REST])
    if static and method.static_reference:
        tell("converged static state")
        reference = _static_reference(problem, method, state, tell)
        parts["static_reference"] = reference
        watch.lap("static reference")
        if method.error_estimate and not reference.why_not:
            return reference.bars, parts
    if not method.error_estimate:
        return {}, parts
    errors = dict[str, float]()
    if not moving:
        tell("two coarser meshes, for the errors")
        alike = _with_its_times(method, state)
        errors = static_errors(problem, state, lambda other: _uninterrupted(other, alike))
        dragged = ramp_change(problem, method) if errors else {}
        measures = measures_of(state)
        errors = {n: e + dragged.get(n, 0.0) * abs(measures[n].value) for n, e in errors.items()}
    watch.lap("error bars")
    return errors, parts


def _statically(problem: Problem, method: Explicit) -> StaticOptions:
    """Options of the static solver for the problem of a run."""
    symmetry: Literal["auto", "none"] = "none" if method.symmetry == "none" else "auto"
    return static_options(problem, Static(symmetry=symmetry))


def _is_moving(state: State) -> bool:
    """Whether a run to the static state ended before it; not by round-off."""
    report, run = state.quasi_static, state.run
    if report is None or run is None:
        return False
    return not report.is_static and run.round_off is None


def _static_reference(
    problem: Problem,
    method: Explicit,
    state: State,
    progress: Callable[[Refinement | str], None],
) -> StaticReference:
    """Solve for the converged static state of the problem of a run; or why there is none.

    Two errors of such a run differ in kind: its distance to the static state of its own mesh, which
    its residual and the remaining displacement bound, and the discretisation error of that mesh,
    which only finer meshes show. The static solver gives the second one.
    """
    why = "not at rest" if _is_moving(state) else _why_no_reference(problem)
    if why is not None:
        return StaticReference(why_not=why)
    with stages() as watch:
        try:
            options = _statically(problem, method)
            with budget(usual_work(problem)):
                result = converge(problem, options=options, progress=progress)
        except RefusedError as error:
            return StaticReference(why_not=str(error))
        if result.accuracy.stopped_by == "interrupt":
            raise KeyboardInterrupt
        watch.lap("solve")
        measures = result.measures
        if result.solved.facets is None:  # means over other facets than the run's
            measures = {name: m for name, m in measures.items() if name not in OF_FACETS}
        report = {name: part.as_json() for name, part in result.parts.items() if name != "facets"}
        report["degree"] = result.meshes.meshes[-1].rung.degree
        report["cpu_seconds"] = watch.seconds()
    return StaticReference(measures_of(state), measures, report)


def _why_no_reference(problem: Problem) -> str | None:
    """Why a problem has no converged static state to compare with; None where it has one."""
    if problem.coulomb is not None:
        return "blocks with friction have many static states"
    if problem.motion is not None:
        return "blocks that move at the start"
    if problem.finite_rotation:
        return "static states have small rotations, and blocks of this run turn by any angle"
    try:
        return why_not_refined(problem)
    except RefusedError as error:
        return str(error)


def ramp_change(problem: Problem, method: Explicit) -> dict[str, float]:
    """Relative error of each measure by the ramp, on a coarser mesh; empty without friction.

    Mass-proportional damping drags blocks back while the load grows, and friction keeps it. The
    error falls with the rate of loading: that of the ramp is what half of it changes.
    """
    moves = any(held.moves for held in problem.load_case.held)
    rubs = problem.coulomb is not None and problem.deformable.meets and not moves
    if method.damping != "static" or not rubs:
        return {}
    for stated in (coarser(problem, SHARES[-1]), problem):
        with suppress(RefusedError):
            if stated is not None:
                return _half_ramp_change(stated, method)
    return {}


def _half_ramp_change(problem: Problem, method: Explicit) -> dict[str, float]:
    """The same on the mesh of a problem."""
    slow = _uninterrupted(problem, method)
    assert slow.run is not None
    half = replace(method, ramp_time=0.5 * slow.run.stated.ramp_time)
    fast = measures_of(_uninterrupted(problem, half))
    measures: list[tuple[str, Measure]] = list(measures_of(slow).items())
    pairs = ((name, m.value, fast[name].value) for name, m in measures)
    return {name: SAFETY * abs(other / value - 1.0) for name, value, other in pairs if value}


def _with_its_times(method: Explicit, state: State) -> Explicit:
    """The method of a transient with the ramp and the end of its run, for coarser meshes.

    Those recommended for other meshes are of another load. The time step is the same share of the
    critical one.
    """
    run = state.run
    if run is None or method.damping == "static":
        return method
    method = replace(method, ramp_time=run.stated.ramp_time, end_time=run.stated.end_time)
    if method.time_step is None:
        return method
    share = min(1.0, run.time_step / run.critical.critical_time_step)
    return replace(method, time_step=None, safety_factor=share)


# ---------------------------------------------------------------------------------------------
# One run


def _uninterrupted(problem: Problem, method: Explicit) -> State:
    """The end of a run beside another one; an interruption is not its result."""
    state = explicit_state(problem, method)
    assert state.run is not None
    if state.run.status is Status.INTERRUPTED:
        raise KeyboardInterrupt
    return state


def stated_run(problem: Problem, method: Explicit) -> TimedSystem:
    """State the explicit problem and the times of its run: `timed_system`."""
    moves, turning = problem.motion is not None, problem.finite_rotation
    return timed_system(
        problem.deformable,
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
        As `fem.explicit.solve.solve`.
    """
    with budget(memory=method.max_memory) as spent:
        ends, stated, restarts = clock(method.max_seconds), stated_run(problem, method), 0
        _refuse_memory(stated)
        most = math.inf if method.max_work is None else method.max_work
        to_rest = method.damped(moves=problem.motion is not None) == "static"
        # A run that is not damped to the static state watches the residual and goes on.
        stop = StopCriterion(method.residual if to_rest else 0.0, stated.settled_after)
        watched = to_rest or stated.recommended is not None
        if output is not None and method.frames > 0:
            spread = stated.end_time
            if to_rest:  # which may end any time after the ramp: all frames lie in it
                spread = min(stated.ramp_time or stated.end_time / _FINE, stated.end_time)
            output = replace(output, frame_interval=spread / max(method.frames - 1, 1))
        elif output is not None:
            output = replace(output, on_frame=None)
        while True:
            try:
                result = solve(
                    stated,
                    end_time=stated.end_time,
                    time_step=method.time_step,
                    safety_factor=method.safety_factor,
                    threads=method.threads,
                    sample_interval=method.sample_interval,
                    velocities=stated.velocities,
                    stop=replace(stop, not_before=stated.settled_after) if watched else None,
                    max_work=most - spent.seconds,
                    max_seconds=ends - time.process_time(),
                    output=None if output is None else _of_all_blocks(output, stated, restarts),
                    resume=resume,
                )
                break
            except (UnstableRun, OtherProblemError) as error:
                # A checkpoint may be that of a run that had started again.
                shorter = None if method.time_step is not None else counting_more(stated)
                if shorter is None:
                    raise
                if isinstance(error, UnstableRun):
                    resume, restarts = None, restarts + 1
                stated = shorter
    return state_of(replace(result, restarts=restarts, static_below=method.residual))


def _refuse_memory(stated: TimedSystem) -> None:
    """Reject a run that needs more memory than it may have, before it is tried."""
    need = sum(body.n_nodes * (_CONSTANT + _STATE * body.n_copies) for body in stated.bodies)
    require_memory(
        f"{stated.system.n_nodes} nodes of {stated.system.assembly.n_blocks} blocks",
        need,
        "fewer elements or fewer blocks",
    )


def _of_all_blocks(output: Output, whole: TimedSystem, restarts: int) -> Output:
    """Callbacks that are told of all blocks where one of so many sectors is computed."""
    on_frame, progress = output.on_frame, output.progress

    def frame(found: Frame) -> None:
        assert on_frame is not None
        moved = whole.expand(found.displacements)
        groups = whole.system.bodies
        on_frame(replace(found, groups=groups, displacements=moved, restart=restarts))

    def tell(found: Progress) -> None:
        assert progress is not None
        progress(replace(found, energies=found.energies.times(whole.system.orbits.copies)))

    return replace(
        output,
        on_frame=None if on_frame is None else frame,
        progress=None if progress is None else tell,
    )
