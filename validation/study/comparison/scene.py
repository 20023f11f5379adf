"""`tubelock compare`: rigid, static and explicit answers to one case, on the same facets.

The static answer is the converged one, evaluated over the facets of the scene's mesh; an explicit
run has the elements of that mesh, and so has the static answer that it ends at.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

from fem.accuracy.statics import refines
from fem.method import Explicit, Static
from fem.problem import Problem
from fem.system.facing_blocks import facing_blocks
from geometry.answer import Answer
from mbd.options import Norm, Rigid
from validation.case import Case, Method, refuse_cell, repeatable, solve
from validation.errors import InputError


def compared_runs(
    case: Case, *, explicit: bool = False, progress: Callable[[Any], None] | None = None
) -> list[Answer]:
    """Answer a case by rigid blocks in both norms, and by static and ``explicit`` elements.

    ``progress`` is called with what a run is at.
    """
    refuse_cell(case, "compare")
    static = case.with_method("static")  # the method is not the scene's to choose here
    problem = static.check()
    if any(support.is_push for support in problem.load_case.held):
        raise InputError(
            f"{case.name}: load.push: got a block that is pushed; rigid blocks determine no "
            "contact forces on its way: `tubelock fem` draws force against displacement next to "
            "the rigid limit, `tubelock mbd` prints the limit"
        )
    rigid, stated = _rigid(problem), case.with_method("rigid").method
    assert isinstance(stated, Rigid)
    cases = [
        replace(
            case,
            method=Rigid(norm=norm, solver=stated.solver, max_memory=stated.max_memory),
            stated=rigid,
        )
        for norm in Norm  # and no answer further to them
    ]
    cases += [
        replace(static, method=method, stated=problem)
        for method in _methods(case, static.method, problem, explicit=explicit)
    ]
    return [_carried(repeatable(solve(one, progress))) for one in cases]


def _rigid(problem: Problem) -> Problem:
    """The problem for rigid blocks: the facets of the deformable ones, and no gaps to close."""
    blocks = problem.blocks
    if problem.searches:
        blocks = facing_blocks(problem.system.assembly)
    load = replace(problem.load_case, assembly=blocks)
    closed = replace(problem, clearance=0.0, spacing=0.0, finite_sliding=False, check_blocks=False)
    return replace(closed, blocks=blocks, load=load)


def _methods(
    case: Case, static: Method, problem: Problem, *, explicit: bool
) -> Iterator[Static | Explicit]:
    """How deformable blocks are solved: refined where they can be, and on the scene's mesh."""
    assert isinstance(static, Static)
    one_mesh = problem.searches or not refines(problem, static)
    if not one_mesh:
        yield static
    if one_mesh or explicit:
        yield replace(static, mesh="scene", accuracy=None, max_meshes=None, error_estimate=False)
    if explicit:
        dynamic = case.with_method("explicit").method
        assert isinstance(dynamic, Explicit)
        yield replace(dynamic, damping=dynamic.damping or "static")


def _carried(answer: Answer) -> Answer:
    """Reject rigid blocks that do not carry the load."""
    if answer.method != "rigid" or answer.details.holds:
        return answer
    case = answer.case
    if answer.details.verdict.holds is None:
        raise InputError(f"{case.name}: {answer.details.deciding.status}")
    if solve(replace(case, stated=None)).details.holds:
        raise InputError(
            f"{case.name}: rigid blocks carry the load with forces at the corners of their joints "
            "(`tubelock mbd`), not with forces at the middles of facets of deformable blocks, "
            "which are compared; expected thicker blocks"
        )
    raise InputError(
        f"{case.name}: rigid blocks do not carry the load, so that there are no forces to compare: "
        "`tubelock mbd` draws how they move; change the shape, fix more blocks or change the "
        "direction of the load"
    )
