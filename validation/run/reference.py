"""The converged static state beside an explicit run that is damped to the static state.

Two errors of such a run differ in kind: its distance to the static state of its own mesh, which
its residual and the remaining displacement bound, and the discretisation error of that mesh, which
only finer meshes show. The static solver gives the second one.
"""

from __future__ import annotations

from collections.abc import Callable

from fem.accuracy.converge import Progress as Refinement
from fem.accuracy.ladder import OF_FACETS
from geometry.errors import RefusedError
from validation.run.accuracy import refinable
from validation.run.deformable import DeformableRun
from validation.run.measures import StaticReference
from validation.run.solve import run_converged
from validation.scene.deformable import Method
from validation.scene.read import DeformableScene


def converged_scene(scene: DeformableScene) -> DeformableScene:
    """Return the scene as one of the converged static state."""
    static = {"method": Method.STATIC, "mesh": "converged", "degree": 1, "frames": 0}
    return scene.changed({"fem": static})


def why_no_reference(name: str, scene: DeformableScene) -> str | None:
    """Why a scene has no converged static state to compare with; None where it has one."""
    if scene.effects.friction is not None:
        return "blocks with friction have many static states"
    if scene.motion is not None:
        return "blocks that move at the start"
    try:
        return refinable(name, converged_scene(scene))[1]
    except RefusedError as error:
        return str(error)


def static_reference(
    run: DeformableRun, progress: Callable[[Refinement], None] | None = None
) -> StaticReference | None:
    """Solve for the converged static state of an explicit run; None for any other run.

    Where there is none, the result says why.
    """
    if run.solution.explicit is None or run.scene.damping != "static":
        return None
    why = "not at rest" if run.is_moving else why_no_reference(run.name, run.scene)
    if why is not None:
        return StaticReference(why_not=why)
    try:
        result = run_converged(run.name, converged_scene(run.scene), progress=progress)
    except RefusedError as error:
        return StaticReference(why_not=str(error).removeprefix(f"{run.name}: "))
    measures = result.answer.measures
    if result.facets is None:  # means over other facets than the run's
        measures = {name: m for name, m in measures.items() if name not in OF_FACETS}
    return StaticReference(measures, result.refinement, result.cpu_seconds)
