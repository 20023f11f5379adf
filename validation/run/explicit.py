"""Explicit runs of deformable blocks."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from fem.assembly.deformable import DeformableAssembly
from fem.assembly.symmetry import SymmetryError
from fem.explicit.setup.assembly import COUNTED_PRESSURE
from fem.explicit.setup.statement import ExplicitStatement, explicit_statement
from fem.explicit.solve import Frame, Output, Progress
from fem.solvers import explicit_answer
from validation.build.deformable import NO_SECTOR, build_deformable, fem_section
from validation.build.effects import build_effects
from validation.errors import InputError, named
from validation.run.deformable import DeformableRun
from validation.run.frames import frame_interval
from validation.run.stages import stages
from validation.scene.deformable import Damping, FemSection
from validation.scene.read import DeformableScene
from validation.scene.usage import count


def scene_statement(
    scene: DeformableScene,
    name: str,
    deformable: DeformableAssembly,
    *,
    counted_pressure: float = COUNTED_PRESSURE,
) -> ExplicitStatement:
    """State the explicit problem of a scene.

    Times that the scene does not give are those that its lowest excited frequency recommends.

    Raises
    ------
    InputError
        When its effects or its symmetry do not fit.
    """
    fem = fem_section(scene, name)
    assert scene.material is not None
    count(scene.material, "density")
    with named(name):
        try:
            return explicit_statement(
                deformable,
                effects=build_effects(scene.effects, fem),
                symmetry=fem.symmetry if scene.meets else "none",
                ramp_time=fem.ramp_time,
                end_time=fem.end_time,
                mass_scaling=fem.mass_scaling,
                counted_pressure=counted_pressure,
                formulation=fem.formulation,
                motion=scene.motion,
            )
        except SymmetryError:
            if fem.symmetry == "sector":
                raise InputError(f"{name}: {NO_SECTOR}") from None
            raise


def _time_step(fem: FemSection) -> dict[str, float]:
    """Either the time step that is given or the part of the critical one that is taken."""
    if fem.time_step is not None:
        return {"time_step": fem.time_step}
    return {"safety_factor": fem.safety_factor}


def _frames(
    fem: FemSection, stated: ExplicitStatement, on_frame: Callable[[Frame], None] | None
) -> dict[str, Any]:
    """Who is called with frames and how often; nothing where nobody asks for any."""
    if on_frame is None or fem.frames == 0:
        return {}
    interval = frame_interval(fem, stated.end_time, stated.ramp_time)
    return {"on_frame": on_frame, "frame_interval": interval}


def run_explicit(
    name: str,
    scene: DeformableScene,
    *,
    deformable: DeformableAssembly | None = None,
    statement: ExplicitStatement | None = None,
    progress: Callable[[Progress], None] | None = None,
    on_frame: Callable[[Frame], None] | None = None,
    checkpoint: Path | None = None,
    resume: Path | None = None,
) -> DeformableRun:
    """Run the blocks of a scene by explicit dynamics.

    Parameters
    ----------
    name, scene
        The scene.
    deformable
        Already built; built anew by default.
    statement
        Of that, already stated (`scene_statement`); stated anew by default.
    progress
        Called at every sample.
    on_frame
        Called with frames whose displacements are those of all blocks.
    checkpoint, resume
        As in `fem.explicit.solve.solve`.

    A run whose contact grows stiffer than its time step allows starts again with a shorter one.

    Raises
    ------
    InputError
        Input that cannot be run, or a run that went unstable (with the remedy).
    """
    with stages() as watch:
        fem = fem_section(scene, name)
        built = build_deformable(scene, name) if deformable is None else deformable
        stated = scene_statement(scene, name, built) if statement is None else statement
        watch.lap("build")
        with named(name):
            answer = explicit_answer(
                stated,
                lambda counted: scene_statement(scene, name, built, counted_pressure=counted),
                # A run that is not damped to the static state watches the residual and goes on.
                residual=fem.residual if fem.damping is Damping.STATIC else 0.0,
                **_time_step(fem),
                precision=fem.precision,
                threads=fem.threads,
                sample_interval=fem.sample_interval,
                output=Output(
                    progress=progress, checkpoint=checkpoint, **_frames(fem, stated, on_frame)
                ),
                resume=resume,
            )
        watch.lap("solve")
    result = answer.explicit
    assert result is not None
    seconds = {**watch.seconds(), "loop": result.cpu_seconds}
    return DeformableRun(name=name, scene=scene, answer=answer, cpu_seconds=seconds)
