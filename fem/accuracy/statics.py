"""The static answer to a problem: on its mesh, or on meshes as fine as its accuracy needs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Literal

from fem.accuracy.converge import (
    AccuracyError,
    Progress,
    checked_targets,
    converge,
    default_options,
    why_not_refined,
)
from fem.accuracy.one_mesh import static_errors, static_solution
from fem.accuracy.strength import strength_factors
from fem.answer import answer_of
from fem.assembly.statement import Problem, require_problem
from fem.element.hexahedron import ElementType
from fem.measures import measures_of
from fem.solution import Solution
from fem.static.solve import StaticOptions
from geometry.answer import Answer


def solve_static(
    problem: Problem,
    options: StaticOptions | None = None,
    *,
    mesh: Literal["converged", "scene"] | None = None,
    accuracy: Mapping[str, float] | None = None,
    error_bars: bool = True,
    max_seconds: float | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> Answer:
    """Solve for the static state, by Newton's method, on meshes as fine as its accuracy needs.

    Parameters
    ----------
    problem
        The statement.
    options
        Tolerance, symmetry, load steps. None: with friction as many load steps as it takes for
        the answer to change by less than 1 % when they are doubled.
    mesh
        ``converged``: finer and finer meshes until the requested error bars are reached; the mesh
        of the problem gives the facets of `p_eff`, `p_max` and `p_max_facet`. ``scene``: exactly
        the mesh of the problem. None: ``converged``, unless the problem states a degree or an
        element, or cannot be refined.
    accuracy
        Relative error bars [-] by measure, such as ``{"p_max_point": 0.03}``; None: 5 % of
        displacement, p_eff, pressure at a point and averaged tension.
    error_bars
        Whether measures on the mesh of the problem have error bars, from coarser meshes, or from a
        finer one where there is none. Problems ``after`` another have none.
    max_seconds
        CPU time that meshes beyond the first may take [s]; None: a fixed amount of work, about
        20 CPU s, so that a problem has one answer on every machine; no limit with an accuracy.
    progress
        Called before each mesh.

    Returns
    -------
    Answer
        Its report says under ``accuracy`` what was reached, and what ended the refinement.

    Raises
    ------
    ProblemError
        An initial motion, which needs an explicit run; or nothing acts.
    AccuracyError
        A requested accuracy of a problem that cannot be refined, or beside ``mesh = "scene"``.
    StaticError
        Without an equilibrium, or where Newton's method did not converge.
    ContactError
        Blocks overlap at the start by more than the contact law covers.
    DeformableAssemblyError
        Blocks are unrestrained, or fixed blocks have no outer face.
    SymmetryError
        The requested symmetry is not one of the load or the supports.
    """
    problem = require_problem(problem)
    problem.refuse_motion()
    if problem.check_blocks:
        problem.require_action()
    if refines(problem, mesh, accuracy):
        result = converge(
            problem,
            None if accuracy is None else checked_targets(accuracy),
            options=options,
            max_seconds=max_seconds,
            progress=progress,
        )
        return answer_of(
            result.solution,
            result.errors,
            facets=result.facets,
            remarks=result.remarks,
            factors=strength_factors(result.solution, result.measures, options),
            problem=problem,
            beside=lambda: result.report,
        )
    options = default_options() if options is None else options

    if problem.after is not None:
        stages = [stage.deformable for stage in problem.stages]
        solution = static_solution(stages[-1], options, before=stages[:-1])
        return answer_of(solution, problem=problem)

    def solve_on(stated: Problem) -> Solution:
        return static_solution(stated.deformable, options, finite_rotation=stated.finite_rotation)

    solution = solve_on(problem)
    errors = static_errors(problem, solution, solve_on) if error_bars else {}
    factors = strength_factors(solution, measures_of(solution, errors), options)
    return answer_of(solution, errors, factors=factors, problem=problem)


def refines(problem: Problem, mesh: str | None, accuracy: Mapping[str, float] | None) -> bool:
    """Whether a static problem is solved on finer and finer meshes."""
    if mesh == "scene" and accuracy is not None:
        raise AccuracyError(
            'accuracy: got one beside mesh = "scene", which is one mesh; expected one of the two'
        )
    if problem.after is not None and (mesh == "converged" or accuracy is not None):
        raise AccuracyError(
            "accuracy: a problem after another has no error bars of meshes; expected "
            'mesh = "scene" without one'
        )
    if mesh is not None or accuracy is not None:
        return mesh != "scene"
    if problem.after is not None:
        return False
    stated = problem.degree > 1 or problem.element is not ElementType.INCOMPATIBLE
    return not stated and why_not_refined(problem) is None
