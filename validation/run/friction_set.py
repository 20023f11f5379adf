"""The answer with friction is a set: which member a run has found, and how wide the set is.

Forces and displacements under the same load depend on the way to it. One end is the state that
the load reaches straight up; the other one is sought by loading past by half and coming back,
which turns the slips at all joints that slide around. Both are solved by the static solver on the
coarsest of the meshes that also judge the error of discretisation; their ratio counts.

Reference: Barber, Klarbring, Ciavarella, Shakedown in frictional contact problems for the
continuum, C. R. Mecanique 336 (2008), on the dependence on the initial state.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from fem.measures import load_step_change
from fem.static.linear_step.flexibility import FlexibilityStore
from geometry.errors import RefusedError
from validation.run.deformable import DeformableRun
from validation.run.friction_path import PAST_AND_BACK, monotonic, seeks_static_state
from validation.run.measures import FrictionSet
from validation.run.solve import run_static
from validation.scene.deformable import Method
from validation.scene.read import DeformableScene

#: Elements along an edge of the meshes on which the width is sought, over those of the run.
_SHARES = (0.5, 2.0 / 3.0)


def friction_set(
    run: DeformableRun, solve: Callable[..., DeformableRun] | None = None
) -> FrictionSet | None:
    """Say which member of the set a run has found and how wide the set is.

    None for a run without friction or without a static state. ``solve`` solves a scene for that
    along a ``load_path``: by default the static solver, which condenses both ways' blocks once.
    """
    if not seeks_static_state(run.scene):
        return None
    solve = partial(run_static, store=FlexibilityStore()) if solve is None else solve
    change, member = load_step_change(run.solution), _member(run)
    result, reason = None, ""
    for scene in _meshes(run.scene):
        try:
            result = scene, solve(run.name, scene).answer.measures
            break
        except RefusedError as error:
            reason = str(error)
    if result is None:
        return FrictionSet(member, change, {}, f"no static state: {reason}")
    scene, direct = result
    try:
        back = solve(run.name, scene, load_path=PAST_AND_BACK)
    except RefusedError as error:
        return FrictionSet(member, change, {}, f"150 % of the load are not carried: {error}")
    width = {
        name: measure.value / direct[name].value - 1.0
        for name, measure in back.answer.measures.items()
        if direct[name].value
    }
    return FrictionSet(
        member, change, width, f"on {back.solution.deformable.model.n_elements} elements"
    )


def _meshes(scene: DeformableScene) -> Iterator[DeformableScene]:
    """The scene for the static solver, on coarser meshes first; some are too coarse for blocks."""
    static: dict[str, Any] = {"method": Method.STATIC, "frames": 0}
    if scene.fem.symmetry == "sector":
        static["symmetry"] = "auto"
    for given in (*(scene.coarser(share) for share in _SHARES), scene):
        if given is not None:
            yield given.changed({"fem": static})


def _member(run: DeformableRun) -> str:
    """How the load was applied."""
    if run.solution.static is not None:
        return monotonic(run.solution.static.load_steps)
    stated = run.solution.statement
    assert stated is not None
    return f"smooth ramp of {1e3 * stated.ramp_time:.3g} ms, damped"
