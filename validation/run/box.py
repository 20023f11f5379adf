"""`tubelock fem` on a box scene: solve, and the result as plain data."""

from __future__ import annotations

import resource
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fem.explicit.solve import (
    ExplicitResult,
    Frame,
    Output,
    Progress,
    Status,
    StopCriterion,
    solve,
)
from fem.problem.mass_scaling import added_mass_share
from fem.problem.recovery import Recovered, recover
from fem.static.linear import LinearStaticResult, solve_linear_static
from geometry.errors import RefusedError
from geometry.mesh import FloatArray
from validation.build.box import BoxModel, build_box
from validation.errors import InputError
from validation.run.frames import frame_interval, static_frames
from validation.scene.deformable import BoxScene, Damping, Method


@dataclass(frozen=True)
class BoxRun:
    """A box scene and its solution."""

    name: str
    scene: BoxScene
    box: BoxModel
    displacements: FloatArray
    """(n_copies, n_nodes, 3) [mm], world axes."""
    recovered: Recovered
    explicit: ExplicitResult | None
    static: LinearStaticResult | None
    cpu_seconds: dict[str, float]
    """CPU time of each stage [s]."""

    @property
    def status(self) -> Status:
        """How the run ended."""
        return Status.FINISHED if self.explicit is None else self.explicit.status


def check_end_time(scene: BoxScene) -> float:
    """End of an explicit run [s].

    Raises
    ------
    InputError
        When the scene does not give it.
    """
    if scene.fem.end_time is None:
        raise InputError("fem.end_time is missing: an explicit run needs its end in seconds")
    return scene.fem.end_time


def run_box(
    name: str,
    scene: BoxScene,
    *,
    box: BoxModel | None = None,
    progress: Callable[[Progress], None] | None = None,
    on_frame: Callable[[Frame], None] | None = None,
    checkpoint: Path | None = None,
    resume: Path | None = None,
) -> BoxRun:
    """Solve a box scene.

    Raises
    ------
    InputError
        Input that cannot be solved, or a run that went unstable (with the remedy).
    """
    box = build_box(scene) if box is None else box
    start = time.process_time()
    explicit = static = None
    try:
        if scene.fem.method is Method.STATIC:
            static = solve_linear_static(box.model)
            displacements = static.displacements[0]
            _static_frames(scene.fem.frames, displacements, on_frame)
        else:
            output = _output(scene, box, progress, on_frame, checkpoint)
            explicit = _explicit(scene, box, output, resume)
            displacements = explicit.displacements[0]
    except RefusedError as error:
        raise InputError(str(error)) from None
    solved = time.process_time()
    recovered = recover(
        box.model.groups[0], displacements, finite_rotation=scene.effects.finite_rotation
    )
    done = time.process_time()
    seconds = {
        "build": box.cpu_seconds,
        "solve": solved - start,
        "stress": done - solved,
        "total": box.cpu_seconds + done - start,
    }
    if explicit is not None:
        seconds["loop"] = explicit.cpu_seconds
        if explicit.compile_seconds:
            seconds["solve"] -= explicit.compile_seconds
            seconds["compile"] = explicit.compile_seconds
    return BoxRun(name, scene, box, displacements, recovered, explicit, static, seconds)


def _static_frames(
    count: int, displacements: FloatArray, on_frame: Callable[[Frame], None] | None
) -> None:
    """Frames of a linear static run: parts of the load, and as much of the displacements."""
    if on_frame is None or count == 0:
        return
    parts = max(count - 1, 1)
    steps = [(k / parts, (k / parts * displacements,)) for k in range(1, parts + 1)]
    for found in static_frames(count, steps):
        on_frame(found)


def _output(
    scene: BoxScene,
    box: BoxModel,
    progress: Callable[[Progress], None] | None,
    on_frame: Callable[[Frame], None] | None,
    checkpoint: Path | None,
) -> Output:
    return Output(
        progress=progress,
        on_frame=on_frame if scene.fem.frames > 0 else None,
        frame_interval=frame_interval(scene.fem, check_end_time(scene), box.ramp_time),
        checkpoint=checkpoint,
    )


def _explicit(
    scene: BoxScene, box: BoxModel, output: Output, resume: Path | None
) -> ExplicitResult:
    end_time = check_end_time(scene)
    fem = scene.fem
    stop = None
    if fem.damping is Damping.STATIC:
        stop = StopCriterion(residual=fem.residual, not_before=box.ramp_time)
    return solve(
        box.model,
        end_time=end_time,
        time_step=fem.time_step,
        safety_factor=fem.safety_factor,
        precision=fem.precision,
        threads=fem.threads,
        sample_interval=fem.sample_interval,
        velocities=box.velocities,
        stop=stop,
        output=output,
        resume=resume,
    )


def peak_memory_mb() -> float:
    """Peak resident memory of this process so far [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def face_displacements(run: BoxRun) -> dict[str, dict[str, list[float]]]:
    """Mean displacement of each named face of the first copy, weighted by facet area."""
    found = {}
    for name in run.box.block.faces:
        surface = run.box.block.surface(name)
        facet = run.displacements[0][surface.quads].mean(axis=1)
        mean = surface.areas @ facet / surface.areas.sum()
        found[name] = {"mean_displacement": mean.tolist()}
    return found


def box_json(run: BoxRun) -> dict[str, Any]:
    """Return the result as plain data, numbers in full precision."""
    model, explicit, static = run.box.model, run.explicit, run.static
    data: dict[str, Any] = {
        "scene": run.name,
        "method": str(run.scene.fem.method),
        "status": str(run.status),
        "n_elements": model.n_elements,
        "n_nodes": model.n_nodes,
        "faces": face_displacements(run),
        "max_displacement": float(np.linalg.norm(run.displacements, axis=2).max()),
        "principal_stress": {
            "max": float(run.recovered.principal[..., 0].max()),
            "min": float(run.recovered.principal[..., 2].min()),
        },
    }
    if explicit is not None:
        data |= {
            "n_steps": explicit.n_steps,
            "time": explicit.time,
            "time_step": explicit.time_step,
            "critical_time_step": explicit.critical.critical_time_step,
            "energies": None if explicit.energies is None else _energies(explicit),
            "energy_balance": explicit.energy_balance,
            "residual": explicit.residual,
            "element_updates_per_cpu_second": explicit.element_updates_per_cpu_second,
            "added_mass": added_mass_share(model),
            "bytes_per_node": (explicit.state_bytes + explicit.constant_bytes) / model.n_nodes,
        }
    if static is not None:
        data |= {
            "n_steps": 0,
            "energies": {
                "strain_energy": static.strain_energy,
                "external_work": static.external_work,
            },
            "energy_balance": abs(static.external_work - static.strain_energy)
            / max(static.strain_energy, 1e-300),
            "residual": static.residual,
        }
    return data | {"cpu_seconds": run.cpu_seconds, "peak_memory_mb": peak_memory_mb()}


def _energies(result: ExplicitResult) -> dict[str, float]:
    assert result.energies is not None
    return asdict(result.energies) | {
        "viscous_dissipation": result.energies.viscous_dissipation,
        "total": result.energies.total,
    }
