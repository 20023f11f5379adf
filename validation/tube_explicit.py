"""Explicit runs of deformable tubes."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from fem.checkpoint import CheckpointError
from fem.contact_state import contact_state
from fem.deformable_assembly import DeformableAssembly
from fem.explicit import (
    ExplicitResult,
    Frame,
    Output,
    Progress,
    StopCriterion,
    UnstableRun,
    solve,
)
from fem.explicit_model import ExplicitAssembly, explicit_assembly
from fem.loads import SmoothStepAmplitude
from fem.model import ModelError
from fem.symmetry import SymmetryError, largest_cyclic_orbits
from fem.time_step import TimeStepError
from geometry.mesh import FloatArray
from validation.effects import build_effects
from validation.errors import InputError
from validation.scene_fem import Damping, FemSection, Method
from validation.tube_fem import (
    NO_SECTOR,
    DeformableScene,
    TubeRun,
    build_deformable,
    fem_section,
)

#: Smooth step of a run to the static state where the scene names none [s] …
DEFAULT_RAMP = 5.0e-3
#: … and the latest end of such a run [s].
DEFAULT_END = 0.2


def ramp_time(fem: FemSection) -> float:
    """Duration of the smooth step [s]."""
    return DEFAULT_RAMP if fem.ramp_time is None else fem.ramp_time


def end_time(fem: FemSection) -> float:
    """Latest end of the run [s].

    Raises
    ------
    InputError
        When the run has no natural end and the scene gives none.
    """
    if fem.end_time is not None:
        return fem.end_time
    if fem.damping is Damping.STATIC:
        return DEFAULT_END
    raise InputError(
        'fem.end_time is missing: an explicit run without damping = "static" needs its end [s]'
    )


def explicit_statement(
    scene: DeformableScene, name: str, deformable: DeformableAssembly
) -> ExplicitAssembly:
    """State the explicit problem of a scene.

    Raises
    ------
    InputError
        When its effects or its symmetry do not fit.
    """
    fem = fem_section(scene, name)
    duration = ramp_time(fem)
    try:
        orbits = None if fem.symmetry == "none" else largest_cyclic_orbits(deformable)
        if fem.symmetry == "sector" and orbits is not None and orbits.order == 1:
            raise InputError(f"{name}: {NO_SECTOR}")
        return explicit_assembly(
            deformable,
            orbits=orbits,
            effects=build_effects(scene.effects, fem),
            amplitude=SmoothStepAmplitude(duration) if duration > 0 else None,
        )
    except (SymmetryError, ModelError) as error:
        raise InputError(f"{name}: {error}") from None


def run_tube_explicit(
    name: str,
    scene: DeformableScene,
    *,
    deformable: DeformableAssembly | None = None,
    progress: Callable[[Progress], None] | None = None,
    on_frame: Callable[[float, int, tuple[FloatArray, ...]], None] | None = None,
    checkpoint: Path | None = None,
    resume: Path | None = None,
) -> tuple[TubeRun, ExplicitResult]:
    """Run a tube by explicit dynamics.

    Parameters
    ----------
    name, scene
        The scene.
    deformable
        Already built; built anew by default.
    progress
        Called at every sample.
    on_frame
        Called with time, number and the displacements of all blocks.
    checkpoint, resume
        As in `fem.explicit.solve`.

    Raises
    ------
    InputError
        Input that cannot be run, or a run that went unstable (with the remedy).
    """
    start = time.process_time()
    fem = fem_section(scene, name)
    deformable = build_deformable(scene, name) if deformable is None else deformable
    statement = explicit_statement(scene, name, deformable)
    built = time.process_time()
    stop = None
    if fem.damping is Damping.STATIC:
        stop = StopCriterion(residual=fem.residual, not_before=ramp_time(fem))

    def frame(found: Frame) -> None:
        if on_frame is not None:
            on_frame(found.time, found.number, statement.expand(found.displacements))

    last = end_time(fem)
    try:
        result = solve(
            statement.model,
            end_time=last,
            time_step=fem.time_step,
            safety_factor=fem.safety_factor,
            precision=fem.precision,
            threads=fem.threads,
            sample_interval=fem.sample_interval,
            stop=stop,
            output=Output(
                progress=progress,
                on_frame=frame if on_frame is not None and fem.frames > 0 else None,
                frame_interval=last / max(fem.frames - 1, 1),
                checkpoint=checkpoint,
            ),
            resume=resume,
        )
    except (ModelError, TimeStepError, CheckpointError, UnstableRun) as error:
        raise InputError(f"{name}: {error}") from None
    solved = time.process_time()
    displacements = statement.expand(result.displacements)
    pressures, overclosures = contact_state(deformable, displacements)
    seconds = {
        "build": built - start,
        "solve": solved - built,
        "loop": result.cpu_seconds,
        "total": time.process_time() - start,
    }
    run = TubeRun(
        name=name,
        scene=scene,
        method=Method.EXPLICIT,
        deformable=deformable,
        displacements=displacements,
        point_pressures=pressures,
        point_overclosures=overclosures,
        solver=explicit_numbers(result),
        cpu_seconds=seconds,
    )
    return run, result


def explicit_numbers(result: ExplicitResult) -> dict[str, Any]:
    """Numbers of an explicit run for its JSON."""
    energies = result.energies
    ratio = None
    if energies is not None:
        internal = energies.strain_energy + energies.contact_energy
        ratio = energies.kinetic_energy / internal if internal > 0 else None
    return {
        "status": str(result.status),
        "n_steps": result.n_steps,
        "time": result.time,
        "time_step": result.time_step,
        "critical_time_step": result.critical.critical_time_step,
        "residual": result.residual,
        "newton_iterations": None,
        "energies": None
        if energies is None
        else asdict(energies) | {"viscous_dissipation": energies.viscous_dissipation},
        "energy_balance": result.energy_balance,
        "kinetic_over_internal_energy": ratio,
        "element_updates_per_cpu_second": result.element_updates_per_cpu_second,
    }
