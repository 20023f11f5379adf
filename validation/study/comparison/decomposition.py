"""Why rigid and deformable answers differ: one assumption changed at a time.

rigid blocks, one contact point a facet → the same on linear springs with several points a facet →
the problem's contact law → its elasticity → its initial gaps. All steps have the friction of the
problem.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from fem.accuracy.ladder import LADDER, on_rung
from fem.accuracy.statics import static_options
from fem.accuracy.transfer import pressures_on_facets
from fem.answer.measures import contact_on
from fem.contact.friction import CoulombFriction
from fem.contact.law import LinearPenalty
from fem.method import Static
from fem.problem import Problem
from fem.static.linear_step.condensation import FlexibilityStore
from fem.static.solve import static_state
from geometry.answer import Answer
from geometry.errors import RefusedError
from validation.scene.sections import gap_words

#: Stiffer by this factor, blocks deform a thousandth of what the contact springs do.
STIFFENING = 1.0e4

_POINTS = "with several contact points on a facet, not one (stiff blocks on linear springs)"

#: Elements of stiff blocks, whose displacements are nearly rigid.
_STIFF_RUNG = LADDER[1]
_ELASTICITY = "with the scene's elasticity"


def decompose(static: Answer, *, refined: bool) -> list[dict[str, Any]]:
    """Steps from rigid blocks to a static answer, over the facets of the mesh of its problem.

    Of each in words what was changed, p_eff and p_max, the mean of the block maxima [MPa], and the
    effective elements [%].

    Where the answer is ``refined``, stiff blocks are solved with few elements of high degree. Steps
    that find no solution are left out (a clearance without elasticity may leave blocks that nothing
    places). The answer itself is the last step.
    """
    problem: Problem = static.problem
    opened = bool(problem.clearance or problem.spacing)
    closed = replace(problem, clearance=0.0, spacing=0.0)
    material = [replace(m, young_modulus=STIFFENING * m.young_modulus) for m in problem.materials]
    stiff = replace(closed, material=material, friction=_own_stick(problem), check_units=False)
    result = static.report["contact"]
    mean = np.array([result["mean_overclosure"]])
    springs = LinearPenalty(max(float(problem.contact_law.stiffness(mean)[0]), 1.0))
    tasks = [
        (_POINTS, replace(stiff, law=springs)),
        ("with the scene's contact law", stiff),
        *([(_ELASTICITY, closed)] if opened else []),
    ]
    steps, store = [], FlexibilityStore()
    for words, task in tasks:
        try:
            steps.append(_step(words, _solved(task, store, refined=refined)))
        except RefusedError:
            continue
    last = f"with the initial gaps{gap_words(problem)}" if opened else _ELASTICITY
    return [*steps, _step(last, result)]


def _own_stick(problem: Problem) -> CoulombFriction | None:
    """Friction with the stick stiffness of the problem, which stiffer blocks would raise."""
    friction = problem.coulomb
    if friction is None:
        return None
    return replace(friction, stick_stiffness=problem.system.stick())


def _solved(task: Problem, store: FlexibilityStore, *, refined: bool) -> Mapping[str, Any]:
    """The paper's measures of a static state, over the facets of the problem's mesh."""
    options = replace(static_options(task, Static()), tolerance=1e-4)
    if not refined:
        return vars(contact_on(static_state(task.system, options, store=store)))
    deformable = on_rung(task, _STIFF_RUNG).system
    result = static_state(deformable, options)
    pressures = pressures_on_facets(
        task.blocks, deformable, result.displacements, symmetry=result.system.orbits.order
    )
    return vars(contact_on(result, (task.blocks, pressures)))


def _step(words: str, contact: Mapping[str, Any]) -> dict[str, Any]:
    return {"words": words} | {n: contact[n] for n in ("p_eff", "p_max", "effective_count_percent")}
