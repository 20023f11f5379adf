"""Why rigid and deformable answers differ: one assumption changed at a time.

rigid blocks (uniform foundation) → the same as stiff finite elements on linear springs → the
scene's contact law → the scene's elasticity → the scene's initial gaps. The first two agree
where the finite elements are right; each later row shows what its own step does.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fem.accuracy.facets import pressures_on_facets
from fem.accuracy.ladder import LADDER, on_rung
from fem.accuracy.one_mesh import static_solution
from fem.assembly.contact_state import ContactMeasures, contact_measures
from fem.assembly.deformable import DeformableAssembly
from fem.assembly.statement import Problem
from fem.contact.law import ContactLaw, LinearPenalty
from fem.measures import contact_on
from fem.problem.model import BlockGroup
from fem.static.linear_step.condensed import FlexibilityStore
from fem.static.solve import StaticOptions, solve_static
from geometry.errors import RefusedError
from validation.build.deformable import build_deformable
from validation.run.deformable import DeformableRun
from validation.scene.read import DeformableScene

#: Stiffer by this factor, blocks deform a thousandth of what the contact springs do.
STIFFENING = 1.0e4

#: Elements of stiff blocks, whose displacements are nearly rigid.
_STIFF_RUNG = LADDER.rungs[1]
_ELASTICITY = "with the scene's elasticity"


@dataclass(frozen=True)
class Step:
    """One assumption and what it leads to."""

    words: str
    """What was changed."""
    p_eff: float
    """[MPa]"""
    p_max: float
    """Mean of the block maxima [MPa]."""
    effective_count_percent: float
    """[%]"""


def stiffened(deformable: DeformableAssembly, factor: float) -> DeformableAssembly:
    """Return the same blocks, ``factor`` times as stiff."""

    def group(g: BlockGroup) -> BlockGroup:
        material = replace(g.material, young_modulus=factor * g.material.young_modulus)
        return replace(g, material=material, reference=replace(g.reference, material=material))

    model = replace(deformable.model, groups=tuple(group(g) for g in deformable.model.groups))
    return replace(deformable, model=model)


def decompose_converged(problem: Problem, static: DeformableRun) -> list[Step]:
    """Steps from rigid blocks to the converged static state, over the facets of the problem's mesh.

    Stiff blocks are solved with few elements of high degree.
    """
    opened = problem.clearance > 0.0 or problem.spacing > 0.0
    closed = replace(problem, clearance=0.0, spacing=0.0, friction=None)
    material = replace(problem.material, young_modulus=STIFFENING * problem.material.young_modulus)
    stiff = replace(closed, material=material)
    tasks = [
        (
            "rigid blocks with linear normal contact (penalty)",
            replace(stiff, law=_springs(static.deformable.contact.law, static)),
        ),
        ("with the scene's contact law", stiff),
        *([(_ELASTICITY, replace(closed, friction=problem.friction))] if opened else []),
    ]
    steps = []
    for words, task in tasks:
        try:
            deformable = on_rung(task, _STIFF_RUNG).deformable
            found = static_solution(deformable, StaticOptions(tolerance=1e-4))
            assert found.static is not None
            pressures = pressures_on_facets(
                task.blocks,
                deformable,
                found.group_displacements,
                symmetry=found.static.symmetry,
            )
        except RefusedError:
            continue
        steps.append(_measured(words, contact_on(found, (task.blocks, pressures))))
    last = f"with the initial gaps{static.scene.gap_words}" if opened else _ELASTICITY
    return [*steps, _measured(last, static.contact)]


def _springs(law: ContactLaw, static: DeformableRun) -> LinearPenalty:
    """Linear springs as stiff as a law at the mean overclosure."""
    mean = np.array([static.contact.mean_overclosure])
    return LinearPenalty(max(float(law.stiffness(mean)[0]), 1.0))


def _measured(words: str, found: ContactMeasures) -> Step:
    return Step(words, found.p_eff, found.p_max, found.effective_count_percent)


def decompose(name: str, scene: DeformableScene, static: DeformableRun) -> list[Step]:
    """Steps from rigid blocks to the scene, each a static solution.

    Steps that find no solution are left out (a clearance without elasticity may leave blocks that
    nothing places). The scene's own static answer is the last step.
    """
    opened = scene.contact.opened
    closed = static.deformable
    if opened:
        shut = scene.changed({"contact": {"clearance": 0.0, "spacing": 0.0}})
        closed = build_deformable(shut, name)
    springs = _springs(closed.contact.law, static)
    stiff = stiffened(closed, STIFFENING)
    tasks = [
        (
            "rigid blocks with linear normal contact (penalty)",
            replace(stiff, contact=replace(closed.contact, law=springs, friction=None)),
        ),
        ("with the scene's contact law", stiff),
    ]
    if opened:
        tasks.append((_ELASTICITY, closed))
    steps, store = [], FlexibilityStore()
    for words, problem in tasks:
        try:
            result = solve_static(problem, StaticOptions(tolerance=1e-4), store=store)
        except RefusedError:
            continue
        if result.converged:
            measured = contact_measures(result.deformable.assembly, result.contact_state)
            steps.append(_measured(words, measured))
    last = f"with the initial gaps{scene.gap_words}" if opened else _ELASTICITY
    return [*steps, _measured(last, static.contact)]
