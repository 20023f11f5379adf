"""Why rigid and deformable answers differ: one assumption changed at a time.

rigid blocks (uniform foundation) → the same as stiff finite elements on linear springs → the
scene's contact law → the scene's elasticity → the scene's initial gaps. The first two agree
where the finite elements are right; each later row shows what its own step does.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fem.assembly.contact_state import contact_measures
from fem.assembly.deformable import DeformableAssembly
from fem.contact.law import LinearPenalty
from fem.problem.model import BlockGroup
from fem.static.linear_step.condensed import FlexibilityStore
from fem.static.result import StaticResult
from fem.static.solve import StaticOptions, solve_static
from geometry.errors import RefusedError
from validation.build.deformable import build_deformable
from validation.run.deformable import DeformableRun
from validation.scene.read import DeformableScene

#: Stiffer by this factor, blocks deform a thousandth of what the contact springs do.
STIFFENING = 1.0e4

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


def _step(words: str, result: StaticResult) -> Step:
    found = contact_measures(result.deformable.assembly, result.contact_state)
    return Step(words, found.p_eff, found.p_max_face, found.effective_count_percent)


def decompose(name: str, scene: DeformableScene, static: DeformableRun) -> list[Step]:
    """Steps from rigid blocks to the scene, each a static solution.

    Steps that find no solution are left out (a clearance without elasticity may leave blocks that
    nothing places). The scene's own static answer is the last step.
    """
    assert scene.contact is not None
    opened = scene.contact.opened
    closed = static.deformable
    if opened:
        shut = scene.changed({"contact": {"clearance": 0.0, "spacing": 0.0}})
        closed = build_deformable(shut, name)
    law = closed.contact.law
    mean = np.array([static.contact.mean_overclosure])
    springs = LinearPenalty(max(float(law.stiffness(mean)[0]), 1.0))
    stiff = stiffened(closed, STIFFENING)
    tasks = [
        (
            "stiff blocks on linear springs",
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
            steps.append(_step(words, result))
    last = f"with the initial gaps{scene.gap_words}" if opened else _ELASTICITY
    found = static.contact
    return [*steps, Step(last, found.p_eff, found.p_max_face, found.effective_count_percent)]
