"""`tubelock compare`: rigid, static and explicit answers to one scene, on the same facets.

The static answer is the converged one, evaluated over the facets of the scene's mesh; an explicit
run has the elements of that mesh, and so has the static answer that it ends at.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from fem.accuracy.statics import refines
from fem.method import Static
from fem.problem import Problem
from fem.system.facing_blocks import facing_blocks
from geometry.answer import Answer
from geometry.assembly import Assembly
from mbd.options import Norm, Rigid
from validation.build.problem import fem_section, rigid_problem, scene_problem
from validation.case import Case, scene_case
from validation.errors import InputError
from validation.run.deformable import Follower, deformable_answer, on_its_mesh
from validation.run.held_by_faces import require_held_by_faces
from validation.scene.deformable import Method
from validation.scene.read import DeformableScene
from validation.solving import repeatable, solve_rigid


def compared_runs(
    name: str,
    scene: DeformableScene,
    *,
    explicit: bool = False,
    progress: Callable[[Any], None] = lambda _: None,
) -> tuple[list[Answer], list[Answer]]:
    """Answer a scene by rigid blocks in both norms, and by static and ``explicit`` elements.

    ``progress`` is called with what a run is at.
    """
    if scene.push is not None:
        raise InputError(
            f"{name}: load.push: got a block that is pushed; rigid blocks determine no contact "
            "forces on its way: `tubelock fem` draws force against displacement next to the rigid "
            "limit, `tubelock mbd` prints the limit"
        )
    problem = comparable_problem(scene, name)
    require_held_by_faces(name, scene, problem.blocks)
    rigid = list(_rigid_runs(name, scene, problem))
    static = scene_case(scene.changed({"fem.method": Method.STATIC}), name)
    assert isinstance(static.method, Static)
    one_mesh = problem.searches or not refines(problem, static.method)
    asked = [] if one_mesh else [static]
    if one_mesh or explicit:
        asked.append(on_its_mesh(static))
    if explicit:
        damping = scene.fem.damping or "static"
        dynamic = scene.changed({"fem": {"method": Method.EXPLICIT, "damping": damping}})
        asked.append(on_its_mesh(scene_case(dynamic, name)))
    follower = Follower(progress=progress)
    answers = (deformable_answer(case, follower, problem=problem) for case in asked)
    return rigid, [repeatable(answer) for answer in answers]


def _rigid_runs(name: str, scene: DeformableScene, problem: Problem) -> Iterator[Answer]:
    """Answers of rigid blocks in both norms."""
    assembly: Assembly = problem.blocks
    if problem.searches:
        assembly = facing_blocks(problem.deformable.assembly)
    stated = replace(rigid_problem(scene, name, Path(), assembly), finite_sliding=False)
    for norm in Norm:
        # Both norms are compared, and no answer further to them.
        method = Rigid(norm=norm, solver=scene.rigid.solver)
        case = Case(name=name, stated=scene, method=method)
        answer = solve_rigid(case, lambda _: None, stated)
        if not answer.details.holds:
            friction = answer.details.friction
            balance = (answer.details if friction is None else friction).equilibrium
            raise InputError(f"{name}: {balance.status}")
        yield answer


def comparable_problem(scene: DeformableScene, name: str) -> Problem:
    """State the problem that all answers share."""
    fem_section(scene, name)
    # The method is not the scene's to choose here.
    return scene_problem(scene.changed({"fem.method": Method.STATIC}), name)
