"""How wide the set of answers with friction is: the load past its value by half and back.

See `validation.run.friction_set`.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from fem.accuracy.ladder import LADDER, on_rung
from fem.accuracy.one_mesh import static_solution
from fem.assembly.statement import Problem
from fem.measures import measures_of
from fem.static.linear_step.flexibility import FlexibilityStore
from fem.static.solve import StaticOptions
from geometry.errors import RefusedError
from validation.run.measures import FrictionSet
from validation.scene.deformable import Method
from validation.scene.read import DeformableScene

#: Load factors of the way past the load and back.
PAST_AND_BACK = (0.09, 0.38, 0.84, 1.5, 1.25, 1.0)


def seeks_static_state(scene: DeformableScene) -> bool:
    """Whether blocks with friction are asked for a static state, which then is a set."""
    fem = scene.fem
    if scene.effects.friction is None or not scene.meets or scene.moves:
        return False
    return fem.method is Method.STATIC or scene.damping == "static"


def friction_width(
    problem: Problem, load_steps: int, change: dict[str, float], options: StaticOptions
) -> FrictionSet:
    """The same of a problem that was solved on finer and finer meshes, on the first of these.

    ``load_steps`` and ``change`` are those of the answer (`fem.measures.load_step_change`).
    """
    member, reason = monotonic(load_steps), ""
    for rung in LADDER.rungs[:2]:
        stated, store = on_rung(problem, rung), FlexibilityStore()
        solve = partial(
            static_solution, stated.deformable, finite_rotation=stated.finite_rotation, store=store
        )
        try:
            direct = measures_of(solve(options))
            back = measures_of(solve(replace(options, load_path=PAST_AND_BACK)))
        except RefusedError as error:
            reason = str(error)
            continue
        width = {n: m.value / direct[n].value - 1.0 for n, m in back.items() if direct[n].value}
        elements = stated.deformable.model.n_elements
        return FrictionSet(member, change, width, f"on {elements} elements of degree {rung.degree}")
    return FrictionSet(member, change, {}, f"150 % of the load are not carried: {reason}")


def monotonic(steps: int) -> str:
    """How the load was applied, in words."""
    return f"monotonic loading in {steps} step{'s' if steps > 1 else ''}"
