"""Static runs of deformable blocks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from fem.assembly.deformable import DeformableAssembly
from fem.contact.law import LinearPenalty
from fem.explicit.solve import Frame
from fem.solvers import static_answer
from fem.static.linear_step.condensed import FlexibilityStore
from fem.static.result import LOAD_TOLERANCE
from fem.static.solve import StaticOptions, solve_static
from geometry.errors import RefusedError
from validation.build.deformable import NO_SECTOR, build_deformable, fem_section, gap_words
from validation.errors import InputError
from validation.run.deformable import DeformableRun
from validation.run.frames import static_frames
from validation.run.friction.held import require_held_by_friction
from validation.run.stages import stages
from validation.scene.deformable import FemSection
from validation.scene.read import DeformableScene

#: Springs in the joints by which blocks are known to float [MPa/mm], and blocks that are named.
_SPRINGS, _NAMED = 1000.0, 8
#: First load steps of blocks with friction that close a clearance: slip before touch is no stick.
_CLOSING_STEPS = 4


def load_steps(scene: DeformableScene, fem: FemSection) -> int:
    """Parts in which the load is applied; with friction the first number of them that is tried."""
    if fem.load_steps is not None:
        return fem.load_steps
    closing = scene.contact is not None and scene.contact.opened
    least = _CLOSING_STEPS if closing and scene.effects.friction is not None else 1
    return max(least, fem.frames - 1)  # each frame after the first is a load step


def static_options(scene: DeformableScene, fem: FemSection) -> StaticOptions:
    """Options of the static solver: the largest exact sector unless the scene forbids it."""
    return StaticOptions(
        symmetry=1 if not scene.meets or fem.symmetry == "none" else None,
        load_steps=load_steps(scene, fem),
        load_tolerance=LOAD_TOLERANCE if fem.load_steps is None else None,
    )


def floating_words(
    scene: DeformableScene, deformable: DeformableAssembly, options: StaticOptions
) -> str | None:
    """Say which blocks float in their gaps; None where there are no gaps, or all are held.

    For a search that found no equilibrium: springs in the joints find one where the exponential
    law, which is flat in a gap, wanders; blocks that none of them holds have no place of their own.
    """
    if scene.contact is None or not scene.contact.opened or scene.effects.friction is not None:
        return None
    springs = replace(deformable.contact, law=LinearPenalty(_SPRINGS))
    once = replace(options, load_steps=1, keep_steps=False)
    try:
        found = solve_static(replace(deformable, contact=springs), once)
    except RefusedError:
        return None
    loose = found.loose_blocks.tolist()
    if not found.converged or not loose:
        return None
    named = ", ".join(map(str, loose[:_NAMED])) + (", …" if len(loose) > _NAMED else "")
    return (
        f"blocks {named} float in their gaps ({gap_words(scene.contact).removeprefix(', ')}): the "
        "load closes some joints and leaves others open, so that nothing says where these blocks "
        "stand; expected a smaller gap, a load or a weight that closes all joints, or friction"
    )


def run_static(
    name: str,
    scene: DeformableScene,
    *,
    deformable: DeformableAssembly | None = None,
    store: FlexibilityStore | None = None,
    on_frame: Callable[[Frame], None] | None = None,
    load_path: tuple[float, ...] | None = None,
) -> DeformableRun:
    """Solve the blocks of a scene for their static state by Newton's method.

    Runs that share a ``store`` condense the same blocks once; ``on_frame`` is called with the
    states of the load steps; ``load_path`` are their load factors where the load shall not go
    straight up.

    Raises
    ------
    InputError
        Input that cannot be solved, or a run that found no equilibrium.
    """
    with stages() as watch:
        fem = fem_section(scene, name)
        require_held_by_friction(name, scene)
        if deformable is None:
            deformable = build_deformable(scene, name)
        keep = on_frame is not None and fem.frames > 0
        options = replace(static_options(scene, fem), keep_steps=keep, load_path=load_path)
        watch.lap("build")
        try:
            turning = scene.effects.finite_rotation is True
            answer = static_answer(deformable, options, finite_rotation=turning, store=store)
        except RefusedError as error:
            why = floating_words(scene, deformable, options)
            raise InputError(f"{name}: {why or error}") from None
        watch.lap("solve")
    result = answer.static
    assert result is not None
    if scene.meets and fem.symmetry == "sector" and result.symmetry == 1:
        raise InputError(f"{name}: {NO_SECTOR}")
    seconds = watch.seconds()
    if on_frame is not None and keep:
        for found in static_frames(fem.frames, [*result.steps[:-1], (1.0, result.displacements)]):
            on_frame(found)
    return DeformableRun(name=name, scene=scene, answer=answer, cpu_seconds=seconds)
