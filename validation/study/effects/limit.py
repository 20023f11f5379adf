"""How much work may decide which effects matter: a third of that of the answer, by counts alone.

Work is counted in unknowns times linear problems, so that a scene has one decision on every
machine. The answer is sure to have two meshes, and a third one within the limit of work.
"""

from __future__ import annotations

import math
from dataclasses import replace

from fem.accuracy.converge import LEAST_MESHES, MOST_WORK, TARGETS, work
from fem.accuracy.ladder import ladder_for, on_rung
from fem.accuracy.statics import refines
from fem.assembly.statement import Problem
from fem.method import Static
from geometry.meshing.refinement import charts_of
from validation.build.problem import scene_problem
from validation.scene.deformable import Method
from validation.scene.read import DeformableScene

#: Part of the work of an answer that probes may take.
SHARE = 1.0 / 3.0
#: Linear problems of one mesh of an answer, in those of a probe of as many unknowns: each starts
#: from the state on the mesh before, and those of few unknowns cost more for each of them.
_OF_A_MESH = 3
#: Times as many with friction, which is loaded in parts.
_WITH_FRICTION = 14


def unknowns(problem: Problem) -> float:
    """Displacement components of the free blocks of a problem, without use of symmetry."""
    blocks, of_shape = problem.blocks, []
    for shape in blocks.shapes:
        charts = charts_of(shape)
        per_chart = math.prod(problem.degree * count + 1 for count in charts.counts)
        of_shape.append(3.0 * len(charts.elements) * per_chart)
    return sum(of_shape[number] for number in blocks.shape_of[~blocks.fixed].tolist())


def most_probing(scene: DeformableScene, name: str) -> float:
    """Unknowns times linear problems that the probes of a scene may take, its effects as written.

    Explicit runs take thousands of steps: there is no limit beside them.
    """
    if scene.fem.method is Method.EXPLICIT:
        return math.inf
    problem = scene_problem(scene, name)
    each = _OF_A_MESH * (_WITH_FRICTION if problem.friction is not None else 1)
    return SHARE * each * sum(unknowns(mesh) for mesh in _meshes(problem, scene))


def _without_accuracy(scene: DeformableScene) -> Static:
    method = scene.method
    assert isinstance(method, Static)
    return replace(method, accuracy=None, error_estimate=True)


def _meshes(problem: Problem, scene: DeformableScene) -> list[Problem]:
    """Meshes that the answer is sure to have."""
    if not refines(problem, _without_accuracy(scene)):
        return [problem]
    result = [on_rung(problem, rung) for rung in ladder_for(TARGETS, problem).rungs[:LEAST_MESHES]]
    return result[:-1] if work(result[-1], 1) > MOST_WORK else result
