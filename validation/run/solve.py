"""Scenes of deformable blocks solved: by Newton's method, by explicit dynamics, or as they ask."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fem.accuracy.converge import MOST_WORK, TARGETS, Converged, converge
from fem.accuracy.converge import Progress as Refinement
from fem.accuracy.errors import SAFETY
from fem.accuracy.ladder import coarser
from fem.accuracy.one_mesh import SHARES, static_errors, static_solution
from fem.accuracy.strength import strength_factors
from fem.assembly.deformable import DeformableAssembly
from fem.assembly.statement import Problem
from fem.assembly.symmetry import SymmetryError, largest_cyclic_orbits
from fem.contact.law import LinearPenalty
from fem.measures import load_step_change
from fem.solution import Solution
from fem.static.linear_step.flexibility import FlexibilityStore
from fem.static.result import LOAD_TOLERANCE
from fem.static.solve import StaticOptions, solve_static
from geometry.errors import RefusedError
from geometry.mesh import FloatArray
from validation.build.deformable import build_effects, fem_section, scene_problem
from validation.errors import InputError, named
from validation.run.accuracy import refined
from validation.run.deformable import DeformableRun
from validation.run.friction_path import friction_width, seeks_static_state
from validation.run.held_by_faces import (
    faces_words,
    require_held_by_faces,
    squeeze_words,
)
from validation.run.held_by_friction import (
    inside_words,
    mechanism_words,
    require_held_by_friction,
)
from validation.run.measures import FrictionSet
from validation.run.stages import stages, summed
from validation.scene.deformable import FemSection, Method
from validation.scene.read import DeformableScene

if TYPE_CHECKING:
    from fem.explicit.setup.statement import ExplicitStatement
    from fem.explicit.solve import Frame, Progress

#: Why a sector asked for is refused.
_NO_SECTOR = (
    'fem.symmetry: got "sector", but the load or the supports are not the same on every block of a '
    'layer; expected "auto" or "none"'
)
#: Springs in the joints by which blocks are known to float [MPa/mm], and blocks that are named.
_SPRINGS, _NAMED = 1000.0, 8
#: First load steps of blocks with friction that close a clearance: slip before touch is no stick.
_CLOSING_STEPS = 4
#: Frames are parts of this part of the longest run, where it may end early and has no ramp.
_FINE = 200.0


def run_scene(name: str, scene: DeformableScene, problem: Problem | None = None) -> DeformableRun:
    """Solve a scene, or another statement of its problem, by its own method."""
    if fem_section(scene, name).method is Method.STATIC:
        return run_static(name, scene, problem=problem)
    from fem.explicit.solve import Status

    run = run_explicit(name, scene, problem=problem)
    if run.solution.explicit is not None and run.solution.explicit.status is Status.INTERRUPTED:
        raise InputError(f"{name}: interrupted")
    return run


def estimated_errors(run: DeformableRun) -> dict[str, float]:
    """Estimate the error of each measure, in its unit, from other meshes solved by its method.

    Of a transient it is the error in time and mesh: coarser meshes have longer time steps. Where
    friction keeps the drag of damping, what half the ramp changes is added. A run that is not yet
    at rest has no error bars.
    """
    if run.is_moving:
        return {}
    scene = _with_its_times(run)

    def solve(problem: Problem) -> Solution:
        return run_scene(run.name, scene, problem).solution

    errors = static_errors(run.problem, run.solution, solve)
    dragged = ramp_change(run) if errors else {}
    measures = run.answer.measures
    return {n: bar + dragged.get(n, 0.0) * abs(measures[n].value) for n, bar in errors.items()}


def ramp_change(run: DeformableRun) -> dict[str, float]:
    """Relative error of each measure by the ramp, on a coarser mesh; empty without friction.

    Mass-proportional damping drags blocks back while the load grows, and friction keeps it. The
    error falls with the rate of loading: that of the ramp is what half of it changes.
    """
    if run.solution.explicit is None or not seeks_static_state(run.scene):
        return {}
    for problem in (coarser(run.problem, SHARES[-1]), run.problem):
        with suppress(RefusedError):
            if problem is not None:
                return _half_ramp_change(run, problem)
    return {}


def _half_ramp_change(run: DeformableRun, problem: Problem) -> dict[str, float]:
    """The same on the mesh of a problem."""
    slow = run_explicit(run.name, run.scene, problem=problem)
    assert slow.solution.statement is not None
    half = run.scene.changed({"fem.ramp_time": 0.5 * slow.solution.statement.ramp_time})
    fast = run_explicit(run.name, half, problem=problem).answer.measures
    pairs = ((name, m.value, fast[name].value) for name, m in slow.answer.measures.items())
    return {name: SAFETY * abs(other / value - 1.0) for name, value, other in pairs if value}


def _with_its_times(run: DeformableRun) -> DeformableScene:
    """The scene of a transient with the ramp and the end of its run, for coarser meshes.

    Those recommended for other meshes are of another load. The time step is the same share of the
    critical one.
    """
    stated, result = run.solution.statement, run.solution.explicit
    if stated is None or result is None or run.scene.damping == "static":
        return run.scene
    times: dict[str, Any] = {"fem.ramp_time": stated.ramp_time, "fem.end_time": stated.end_time}
    if run.scene.fem.time_step is not None:
        share = min(1.0, result.time_step / result.critical.critical_time_step)
        times |= {"fem.time_step": None, "fem.safety_factor": share}
    return run.scene.changed(times)


def run_as_asked(
    name: str,
    scene: DeformableScene,
    requested: Mapping[str, float] | None = None,
    otherwise: Mapping[str, float] = TARGETS,
    progress: Callable[[Refinement], None] | None = None,
) -> DeformableRun:
    """Solve a scene on finer and finer meshes, or on its own with the error bars that it asks for.

    ``requested`` and ``otherwise`` are as in `fem.accuracy.converge.converge`.
    """
    problem = refined(name, scene, requested)
    if problem is not None:
        return run_converged(
            name, scene, requested, otherwise=otherwise, progress=progress, problem=problem
        )
    run = run_scene(name, scene)
    if scene.fem.error_estimate:
        run = replace(run, errors=estimated_errors(run))
    return run


def with_factors(run: DeformableRun) -> DeformableRun:
    """Return a run whose whole answer is shown: a static one has the load factors of strengths.

    The density counts as read: the answer has the mass.
    """
    if run.solution.static is None:
        return run
    with stages() as watch:
        options = static_options(run.scene, fem_section(run.scene, run.name))
        with named(run.name):
            result = strength_factors(run.solution, run.answer.measures, options)
        watch.lap("load factors")
    if not result:
        return run
    return replace(run, factors=result, cpu_seconds=summed(run.cpu_seconds, watch.seconds()))


# ---------------------------------------------------------------------------------------------
# Static runs


def load_steps(scene: DeformableScene, fem: FemSection) -> int:
    """Parts in which the load is applied; with friction the first number of them that is tried."""
    if fem.load_steps is not None:
        return fem.load_steps
    closing = scene.effects.friction is not None and scene.contact.opened
    return _CLOSING_STEPS if closing else 1


def static_options(scene: DeformableScene, fem: FemSection) -> StaticOptions:
    """Options of the static solver: the largest exact sector unless the scene forbids it."""
    once = fem.load_steps is not None or scene.moves
    return StaticOptions(
        symmetry=1 if not scene.meets or fem.symmetry == "none" else None,
        load_steps=load_steps(scene, fem),
        load_tolerance=None if once else LOAD_TOLERANCE,
        motion_steps=fem.motion_steps if scene.moves else None,
    )


def floating_words(
    scene: DeformableScene, deformable: DeformableAssembly, options: StaticOptions
) -> str | None:
    """Say which blocks float in their gaps; None where there are no gaps, or all are held.

    For a search that found no equilibrium: springs in the joints find one where the exponential
    law, which is flat in a gap, wanders; blocks that none of them holds have no place of their own.
    """
    if not scene.contact.opened or scene.effects.friction is not None:
        return None
    springs = replace(deformable.contact, law=LinearPenalty(_SPRINGS))
    once = replace(options, load_steps=1, keep_steps=False)
    try:
        result = solve_static(replace(deformable, contact=springs), once)
    except RefusedError:
        return None
    loose = result.loose_blocks.tolist()
    if not result.converged or not loose:
        return None
    named = ", ".join(map(str, loose[:_NAMED])) + (", …" if len(loose) > _NAMED else "")
    return (
        f"blocks {named} float in their gaps ({scene.gap_words.removeprefix(', ')}): the "
        "load closes some joints and leaves others open, so that nothing says where these blocks "
        "stand; expected a smaller gap, a load or a weight that closes all joints, or friction"
    )


def run_static(
    name: str,
    scene: DeformableScene,
    *,
    problem: Problem | None = None,
    store: FlexibilityStore | None = None,
    on_frame: Callable[[Frame], None] | None = None,
    load_path: tuple[float, ...] | None = None,
) -> DeformableRun:
    """Solve the blocks of a scene for their static state by Newton's method.

    Runs that share a ``store`` condense the same blocks once; ``on_frame`` is called with the
    states of the load steps; ``load_path`` are their load factors where the load shall not go
    straight up.
    """
    with stages() as watch:
        fem = fem_section(scene, name)
        if scene.effects.friction is not None and not scene.is_cell:
            require_held_by_friction(name, scene)
        problem = scene_problem(scene, name) if problem is None else problem
        with named(name):
            problem.require_action()
            deformable = problem.deformable
        require_held_by_faces(name, scene, deformable.assembly)
        _require_sector(name, scene, deformable)
        options = replace(static_options(scene, fem), load_path=load_path)
        turning = scene.effects.finite_rotation is True
        watch.lap("build")
        with _floating_named(name, scene, problem, options):
            solution = static_solution(deformable, options, finite_rotation=turning, store=store)
        watch.lap("solve")
        if on_frame is not None:
            write_static_frames(fem.frames, solution, options, on_frame)
            watch.lap("frames")
    return DeformableRun(
        name=name, scene=scene, problem=problem, solution=solution, cpu_seconds=watch.seconds()
    )


def run_converged(
    name: str,
    scene: DeformableScene,
    requested: Mapping[str, float] | None = None,
    *,
    otherwise: Mapping[str, float] = TARGETS,
    max_seconds: float | None = None,
    most_work: float = MOST_WORK,
    progress: Callable[[Refinement], None] | None = None,
    frames: Callable[[Solution], Callable[[Frame], None] | None] | None = None,
    problem: Problem | None = None,
) -> DeformableRun:
    """Solve the blocks of a scene on finer and finer meshes: see `fem.accuracy.converge`.

    ``problem``: that of the scene, where it has been built.
    """
    with stages() as watch:
        fem = fem_section(scene, name)
        if scene.effects.friction is not None:
            require_held_by_friction(name, scene)
        options = static_options(scene, fem)
        problem = scene_problem(scene, name) if problem is None else problem
        with named(name):
            problem.require_action()
        require_held_by_faces(name, scene, problem.blocks)
        _require_sector(name, scene, problem.deformable)
        watch.lap("build")
        with _floating_named(name, scene, problem, options):
            result = converge(
                problem,
                requested,
                otherwise=otherwise,
                options=options,
                max_seconds=max_seconds,
                most_work=most_work,
                progress=progress,
            )
        watch.lap("solve")
        on_frame = None if frames is None else frames(result.solution)
        if on_frame is not None:
            write_static_frames(fem.frames, result.solution, options, on_frame)
            watch.lap("frames")
        friction = _friction_of(problem, scene, result, options)
        if friction is not None:
            watch.lap("range of friction")
    return DeformableRun(
        name=name,
        scene=scene,
        problem=problem,
        solution=result.solution,
        cpu_seconds=watch.seconds(),
        errors=result.errors,
        facets=result.facets,
        remarks=result.remarks,
        refinement=result.report,
        friction=friction,
    )


def _friction_of(
    problem: Problem, scene: DeformableScene, found: Converged, options: StaticOptions
) -> FrictionSet | None:
    """How wide the set of answers with friction is, on the first of the meshes."""
    assert found.solution.static is not None
    if not seeks_static_state(scene):
        return None
    change = load_step_change(found.solution)
    return friction_width(problem, found.solution.static.load_steps, change, options)


@contextmanager
def _floating_named(
    name: str,
    scene: DeformableScene,
    problem: Problem,
    options: StaticOptions,
) -> Iterator[None]:
    """Name the scene where a static run ends without an answer, and blocks that float in gaps."""
    try:
        yield
    except RefusedError as error:
        why = floating_words(scene, problem.deformable, options) or str(error)
        stated = scene, problem.deformable.assembly
        faces = faces_words(*stated) or squeeze_words(*stated)
        faces = faces or mechanism_words(name, scene) or inside_words(name, scene)
        if faces:  # then the solver's own remedies do not help
            why = f"{why.partition('; ')[0]}: {faces}"
        raise InputError(f"{name}: {why}") from None


def _require_sector(name: str, scene: DeformableScene, deformable: DeformableAssembly) -> None:
    asked = scene.meets and fem_section(scene, name).symmetry == "sector"
    if asked and largest_cyclic_orbits(deformable).order == 1:
        raise InputError(f"{name}: {_NO_SECTOR}")


def write_static_frames(
    count: int, solution: Solution, options: StaticOptions, on_frame: Callable[[Frame], None]
) -> None:
    """Call back with so many states on the way to the load: the answer does not depend on them.

    With friction they are those of the load steps, of which there may be fewer.
    """
    if count == 0:
        return
    result = solution.static
    assert result is not None
    parts = max(1, count - 1)
    if solution.deformable.contact.friction is not None:
        parts = result.load_steps
    kept = replace(options, keep_steps=True, load_steps=parts, load_tolerance=None)
    turning = solution.finite_rotation
    if parts > 1:
        again = static_solution(solution.deformable, kept, finite_rotation=turning)
        assert again.static is not None
        steps = again.static.steps
    else:
        steps = ()
    for found in _static_frames(count, [*steps[:-1], (1.0, result.displacements)]):
        on_frame(found)


def _static_frames(
    count: int, steps: Sequence[tuple[float, tuple[FloatArray, ...]]]
) -> Iterator[Frame]:
    """Frames of a static run: the state without load, then those of the load steps.

    There are ``count`` of them, or as many as load steps, each with its part of the load and the
    displacements of each group, the whole load last.
    """
    from fem.explicit.solve import Frame

    rest = tuple(np.zeros_like(u) for u in steps[-1][1])
    states = [(0.0, rest), *steps]
    chosen = np.unique(np.round(np.linspace(len(states) - 1, 0, min(count, len(states)))))
    for place, k in enumerate(chosen.astype(int)):
        share, displacements = states[k]
        yield Frame(place, share, displacements, last=place == len(chosen) - 1)


# ---------------------------------------------------------------------------------------------
# Explicit runs


def scene_statement(
    scene: DeformableScene,
    name: str,
    deformable: DeformableAssembly,
    *,
    counted_pressure: float | None = None,
) -> ExplicitStatement:
    """State the explicit problem of a scene.

    Times that the scene does not give are those that its lowest excited frequency recommends.
    """
    from fem.explicit.setup.statement import explicit_statement

    fem = fem_section(scene, name)
    counted = {} if counted_pressure is None else {"counted_pressure": counted_pressure}
    with named(name):
        try:
            return explicit_statement(
                deformable,
                effects=build_effects(scene.effects, fem, scene.damping),
                symmetry=fem.symmetry if scene.meets else "none",
                ramp_time=fem.ramp_time,
                end_time=fem.end_time,
                mass_scaling=fem.mass_scaling,
                motion=scene.motion,
                **counted,
            )
        except SymmetryError:
            if fem.symmetry == "sector":
                raise InputError(f"{name}: {_NO_SECTOR}") from None
            raise


def _frames(
    fem: FemSection,
    damping: str,
    stated: ExplicitStatement,
    on_frame: Callable[[Frame], None] | None,
) -> dict[str, Any]:
    """Who is called with frames and how often; nothing where nobody asks for any.

    A run that is damped to the static state may end any time after the ramp: frames come so
    often that as many as were asked for lie in the ramp, and the writer thins them out.
    """
    if on_frame is None or fem.frames == 0:
        return {}
    spread = stated.end_time
    if damping == "static":
        spread = min(stated.ramp_time or stated.end_time / _FINE, stated.end_time)
    return {"on_frame": on_frame, "frame_interval": spread / max(fem.frames - 1, 1)}


def run_explicit(
    name: str,
    scene: DeformableScene,
    *,
    problem: Problem | None = None,
    statement: ExplicitStatement | None = None,
    progress: Callable[[Progress], None] | None = None,
    on_frame: Callable[[Frame], None] | None = None,
    checkpoint: Path | None = None,
    resume: Path | None = None,
) -> DeformableRun:
    """Run the blocks of a scene by explicit dynamics.

    The problem may be stated already, also as an explicit one (`scene_statement`); progress is told
    at every sample, frames have the displacements of all blocks, and a checkpoint is written and
    resumed as `fem.explicit.solve.solve` does.

    A run whose contact grows stiffer than its time step allows starts again with a shorter one.
    """
    from fem.dynamics import explicit_answer
    from fem.explicit.solve import Output

    with stages() as watch:
        fem = fem_section(scene, name)
        problem = scene_problem(scene, name) if problem is None else problem
        with named(name):
            problem.require_action()
            built = problem.deformable
        stated = scene_statement(scene, name, built) if statement is None else statement
        watch.lap("build")
        key = "safety_factor" if fem.time_step is None else "time_step"
        with named(name):
            solution = explicit_answer(
                stated,
                lambda counted: scene_statement(scene, name, built, counted_pressure=counted),
                # A run that is not damped to the static state watches the residual and goes on.
                residual=fem.residual if scene.damping == "static" else 0.0,
                **{key: getattr(fem, key)},
                precision=fem.precision,
                threads=fem.threads,
                sample_interval=fem.sample_interval,
                output=Output(
                    progress=progress,
                    checkpoint=checkpoint,
                    **_frames(fem, scene.damping, stated, on_frame),
                ),
                resume=resume,
            )
        watch.lap("solve")
    result = solution.explicit
    assert result is not None
    seconds = {**watch.seconds(), "loop": result.cpu_seconds}
    if stated.recommended is not None:  # else no static state is expected
        solution = replace(solution, static_below=fem.residual)
    return DeformableRun(
        name=name, scene=scene, problem=problem, solution=solution, cpu_seconds=seconds
    )
