"""The static answer to a problem: on its mesh, or on meshes as fine as its accuracy needs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fem.accuracy.converge import (
    MOST_SECONDS,
    AccuracyError,
    Converged,
    MeshProgress,
    bars_under,
    check_refinable,
    checked_targets,
    converge,
    own_elements,
    usual_degree,
    usual_work,
)
from fem.accuracy.one_mesh import OneMeshErrors, state_of, static_errors
from fem.accuracy.transfer import MeshFacets
from fem.answer.answer import answer_of
from fem.answer.measures import measures_of
from fem.element.hexahedron import ElementType
from fem.element.material import one_strength
from fem.method import Static, require_method
from fem.problem import Problem, require_problem
from fem.state import State
from fem.static.linear_step.condensation import FlexibilityStore
from fem.static.path import LOAD_TOLERANCE
from fem.static.solve import StaticOptions
from fem.system.sector import check_system
from geometry.answer import Answer, Measure
from geometry.errors import RefusedError
from geometry.machine.system import one_thread_of_blas
from geometry.machine.work import (
    Budget,
    LimitError,
    Stopwatch,
    budget,
    clock,
    timed_stages,
    unlimited,
)
from geometry.parts.rows import Notes, Part, Row

if TYPE_CHECKING:
    from fem.accuracy.strength import Bars
    from fem.explicit.solve import Frame

#: Part of the work that load factors keep.
_AFTER = 0.25
#: First load steps of blocks with friction that close a clearance: slip before touch is no stick.
_CLOSING_STEPS = 4
#: What bars include where facets of coarser meshes do not match.
_TWO_SEARCHES = "contact is searched on coarser meshes, which do not match: bars include the change"
#: Why a state has none.
_NOT_ASKED = "none: fem.error_estimate = false"
_NO_OTHER = "none: no other mesh of these blocks has a state, or its work is beyond the limit"
_DEFAULT = Static()


@one_thread_of_blas()
def solve_static(
    problem: Problem,
    method: Static = _DEFAULT,
    *,
    otherwise: Mapping[str, float] | None = None,
    store: FlexibilityStore | None = None,
    progress: Callable[[MeshProgress | str], None] | None = None,
    on_frame: Callable[[Frame], None] | None = None,
) -> Answer:
    """Solve for the static state, by Newton's method, on meshes as fine as its accuracy needs.

    Parameters
    ----------
    problem
        The statement.
    method
        Mesh, accuracy, symmetry, load steps. By default finer and finer meshes, and with friction
        as many load steps as it takes for the answer to change by less than 1 % when they are
        doubled. Problems ``after`` another have no error bars.
    otherwise
        Relative error bars [-] by measure that are sought, within a fixed amount of work, where
        the method has no accuracy.
    store
        Of one call for the next on the mesh of the problem: the same blocks are condensed once.
    progress
        Called with what comes next: a mesh (`MeshProgress`), or a stage in words.
    on_frame
        Called with ``method.frames`` states under parts of the load.

    Returns
    -------
    Answer
        Its parts are `Accuracy`, `Meshes` (`fem.accuracy.errors`) and `MeshFacets`.

    Raises
    ------
    ProblemError
        What needs an explicit run (an initial motion, blocks that turn by any angle, loads that
        turn with them), here or in a problem before; or nothing acts.
    AccuracyError
        A requested accuracy of a problem that cannot be refined.
    StaticError
        No equilibrium exists, or none was found. `validation.solve` says which blocks move, where
        rigid blocks tell.
    ContactError
        Blocks overlap at the start by more than the contact law covers.
    DeformableAssemblyError
        Blocks are unrestrained, or fixed blocks have no outer face.
    SymmetryError
        The requested symmetry is not one of the load or the supports.
    """
    require_method(method, Static, "solve_static")
    with timed_stages() as watch:
        problem = check_static(problem, method)
        finer = refines(problem, method)
        watch.lap("build")
        follower = _Follower(watch, progress or (lambda _: None), on_frame)
        work = most_work(problem, method, finer=finer)
        with budget(work, memory=method.max_memory) as spent:
            answer = _answer(
                problem, method, store, follower, sought=otherwise, work=work, finer=finer
            )
        return answer.beside({"work": spent})


def check_static(problem: Problem, method: Static) -> Problem:
    """Return a problem with the elements that it is solved with; reject what no static run answers.

    Errors are those of `solve_static` that are known before it solves.
    """
    problem = _of_usual_degree(problem, require_problem(problem))
    problem.require_static()
    problem.require_action()
    if method.accuracy is not None:
        checked_targets(method.accuracy)
    if _asks_to_refine(method) or not method.error_estimate:
        refines(problem, method)
    if problem.after is None:
        for name in ("tensile_strength", "compressive_strength"):
            one_strength(name, (getattr(material, name) for material in problem.materials))
    check_system(problem.system, method.symmetry)
    return problem


def _asks_to_refine(method: Static) -> str | None:
    """Name of the option that asks for finer meshes; None: none does."""
    stated = [name for name in ("accuracy", "max_meshes") if getattr(method, name) is not None]
    return stated[0] if stated else "mesh" if method.mesh == "converged" else None


def most_work(problem: Problem, method: Static, *, finer: bool) -> float | None:
    """Work that a method may do, on finer and finer meshes or not [reference s]; None: any."""
    if method.max_work is not None:
        return method.max_work
    if method.accuracy is not None or (method.mesh == "scene" and not finer):
        return None
    return usual_work(problem)


def _of_usual_degree(stated: Problem, meshed: Problem) -> Problem:
    """Solids that are tetrahedra have elements of degree 2, unless other ones are stated."""
    other = (meshed.degree, meshed.element) != (1, ElementType.INCOMPATIBLE)
    if other or not stated.is_solid:
        return meshed
    degree = usual_degree(meshed.blocks, friction=meshed.coulomb is not None)
    return meshed if degree == 1 else _of_degree(meshed, degree)


def _of_degree(problem: Problem, degree: int) -> Problem:
    """A problem with elements of a degree, and those before it."""
    after = None if problem.after is None else _of_degree(problem.after, degree)
    return replace(problem, degree=degree, after=after)


@dataclass(frozen=True)
class _Follower:
    """Who is told what a run is at."""

    watch: Stopwatch
    tell: Callable[[MeshProgress | str], None]
    on_frame: Callable[[Frame], None] | None


@dataclass(frozen=True)
class _Bars:
    """How good a state is, and what tells it."""

    errors: Mapping[str, float]
    """Of each measure, in its unit."""
    under: Bars
    """The same under a factor times the loads."""
    parts: dict[str, Part]
    """Of the answer."""
    facets: MeshFacets | None = None
    remarks: Mapping[str, str] = field(default_factory=dict)
    beside: Mapping[str, Any] = field(default_factory=dict)


def _answer(
    problem: Problem,
    method: Static,
    store: FlexibilityStore | None,
    follower: _Follower,
    *,
    sought: Mapping[str, float] | None,
    work: float | None,
    finer: bool,
) -> Answer:
    """Answer on finer and finer meshes, or on that of the problem with others for its errors."""
    options, watch, tell = static_options(problem, method), follower.watch, follower.tell
    ends, result = clock(method.max_seconds), None
    strengths = any(m.tensile_strength or m.compressive_strength for m in problem.materials)
    strong = problem.after is None and strengths
    share = work * (1.0 - _AFTER * strong) if finer and work is not None else None
    with budget(share) as spent:
        if finer:
            result = converge(
                problem,
                None if method.accuracy is None else checked_targets(method.accuracy),
                otherwise=sought,
                options=options,
                max_seconds=method.max_seconds,
                max_meshes=method.max_meshes,
                progress=tell,
            )
            solved, state = result.solved.problem, result.solved.state
        else:
            tell("static state")
            solved, state = problem, state_of(problem, options, store=store)
    watch.lap("solve")
    _write_frames(method.frames, solved, state, options, follower)
    if result is None:
        limit = budget(MOST_SECONDS if method.max_work is None else None, clock(method.max_seconds))
    else:
        limit = budget(ends=clock(0.0) if result.accuracy.stopped_by == "interrupt" else ends)
    with limit:
        if result is None:
            bars = _of_coarser(problem, method, options, state, follower, spent=spent)
        else:
            bars = _of_meshes(problem, options, result)
        parts, factors = bars.parts, dict[str, Measure]()
        if strong:
            from fem.accuracy.strength import strength_factors

            tell("load factors")
            with unlimited():
                shown = dict(
                    measures_of(state, bars.errors, facets=bars.facets, remarks=bars.remarks)
                )
            factors = strength_factors(solved, state, shown, options, bars.under)
            watch.lap("load factors")
    with unlimited():
        answer = answer_of(
            state,
            bars.errors,
            facets=bars.facets,
            remarks=bars.remarks,
            factors=factors,
            problem=problem,
            parts=parts,
            beside={**bars.beside, "cpu_seconds": watch.seconds()},
        )
    if result is not None:
        return replace(answer, title=result.meshes.qualified(answer.title))
    return answer


def _of_meshes(problem: Problem, options: StaticOptions, result: Converged) -> _Bars:
    """Bars of the last of finer and finer meshes."""
    rungs = [mesh.rung for mesh in result.meshes.meshes]
    return _Bars(
        errors=result.errors,
        under=lambda factor, there: bars_under(problem, rungs, options, factor, there),
        parts=result.parts,
        facets=result.solved.facets,
        remarks=result.remarks,
        beside={"degree": rungs[-1].degree},
    )


def _of_coarser(
    problem: Problem,
    method: Static,
    options: StaticOptions,
    state: State,
    follower: _Follower,
    *,
    spent: Budget,
) -> _Bars:
    """Bars of the mesh of the problem: none of a problem after another, nor where not asked for.

    ``spent`` is what the state took.
    """

    def under(factor: float, there: State) -> OneMeshErrors:
        return static_errors(problem, there, lambda p: state_of(p, options, factor), spent)

    errors, said = dict[str, float](), "" if method.error_estimate else _NOT_ASKED
    if method.error_estimate and problem.after is None:
        follower.tell("coarser meshes, for the errors")
        with suppress(LimitError):  # the table says which
            errors, searched = under(1.0, state)
            said = _TWO_SEARCHES if searched else "" if errors else _NO_OTHER
        follower.watch.lap("error bars")
    notes = Notes([Row("error bars", said, group="evidence")])
    parts: dict[str, Part] = {"notes": notes} if said else {}
    return _Bars(errors, lambda factor, there: under(factor, there).errors, parts)


def refines(problem: Problem, method: Static) -> bool:
    """Whether a static problem is solved on finer and finer meshes.

    Raises
    ------
    AccuracyError
        As `solve_static`; and error bars left out of a state that has them.
    """
    asked = _asks_to_refine(method)
    if method.mesh == "scene":
        return False
    if problem.after is not None:
        if asked:
            raise AccuracyError(
                f"{asked}: a problem after another has no error bars of meshes; expected "
                'mesh = "scene" alone'
            )
        return False
    if asked and (own := own_elements(problem)) is not None:
        name, got = own
        raise AccuracyError(
            f"{name}: got {got} for finer and finer meshes, which have elements of their own; "
            f'expected mesh = "scene" without an accuracy, or no {name}'
        )
    degree = usual_degree(problem.blocks, friction=problem.coulomb is not None)
    usual = problem.element is ElementType.INCOMPATIBLE and problem.degree == degree
    if not (usual or asked):
        return False
    try:
        check_refinable(problem, asked or "mesh")
    except RefusedError:  # of a mesh that is not refined, or the solver rejects it
        if asked:
            raise
        return False
    if not method.error_estimate:
        raise AccuracyError(
            'error_estimate: applies to mesh = "scene" alone; a run that refines always has error '
            "bars: remove it, or add mesh"
        )
    return True


def static_options(problem: Problem, method: Static) -> StaticOptions:
    """Options of the static solver: the largest exact sector unless the method forbids it."""
    moves = problem.after is None and any(held.moves for held in problem.load_case.held)
    opened = problem.clearance > 0.0 or problem.spacing > 0.0
    steps = _CLOSING_STEPS if opened and problem.coulomb is not None else 1
    once = method.load_steps is not None or moves
    return StaticOptions(
        symmetry=1 if method.symmetry == "none" else None,
        load_steps=steps if method.load_steps is None else method.load_steps,
        load_tolerance=None if once else LOAD_TOLERANCE,
        motion_steps=method.motion_steps,
    )


# ---------------------------------------------------------------------------------------------
# Frames


def _write_frames(
    count: int,
    problem: Problem,
    state: State,
    options: StaticOptions,
    follower: _Follower,
) -> None:
    """Call back with the beginning and so many states of the path, the whole load last.

    With friction, and where supports move, there may be fewer: the answer does not depend on them.
    Their times are those of supports that move, else shares of the load.
    """
    on_frame, path = follower.on_frame, [*state.evidence.path, state]
    if count == 0 or on_frame is None:
        return
    from fem.explicit.solve import Frame

    if len(path) < count - 1 and state.friction is None and state.time is None:
        in_parts = replace(options, load_steps=count - 1, load_tolerance=None)
        path = [*state_of(problem, in_parts).evidence.path, state]
    began = state.system.begin
    moved = np.zeros_like(state.displacement) if began is None else began[0]
    path = [replace(path[0], displacement=moved, load_factor=0.0, time=0.0), *path]
    moves = state.time is not None
    at = {(one.time or 0.0) if moves else one.load_factor: one for one in path}
    times, path = list(at), list(at.values())
    chosen = np.unique(np.round(np.linspace(len(path) - 1, 0, min(count, len(path)))).astype(int))
    for number, k in enumerate(chosen.tolist()):
        one, bodies, last = path[k], state.whole.bodies, k == len(path) - 1
        on_frame(Frame(number, times[k], bodies, one.displacements, last=last))
    follower.watch.lap("frames")
