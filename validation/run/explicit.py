"""Explicit runs of deformable tubes."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from fem.assembly.deformable import DeformableAssembly
from fem.assembly.symmetry import SymmetryError
from fem.explicit.output.checkpoint import OtherProblemError
from fem.explicit.output.history import History
from fem.explicit.setup.assembly import COUNTED_PRESSURE
from fem.explicit.setup.quasi_static import quasi_static_report
from fem.explicit.setup.statement import ExplicitStatement, explicit_statement
from fem.explicit.solve import (
    ExplicitResult,
    Frame,
    Output,
    Progress,
    StopCriterion,
    UnstableRun,
    solve,
)
from fem.problem.mass_scaling import added_mass_share
from geometry.errors import RefusedError
from validation.build.deformable import NO_SECTOR, build_deformable, fem_section
from validation.build.effects import build_effects
from validation.errors import InputError
from validation.run.deformable import TubeRun
from validation.run.frames import frame_interval
from validation.scene.deformable import Damping, FemSection, Method
from validation.scene.read import DeformableScene


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
    try:
        return explicit_statement(
            deformable,
            effects=build_effects(scene.effects, fem),
            symmetry=fem.symmetry,
            ramp_time=fem.ramp_time,
            end_time=fem.end_time,
            mass_scaling=fem.mass_scaling,
            counted_pressure=counted_pressure,
        )
    except InputError:
        raise
    except SymmetryError as error:
        raise InputError(f"{name}: {NO_SECTOR if fem.symmetry == 'sector' else error}") from None
    except ValueError as error:
        raise InputError(f"{name}: {error}") from None


def run_tube_explicit(
    name: str,
    scene: DeformableScene,
    *,
    deformable: DeformableAssembly | None = None,
    statement: ExplicitStatement | None = None,
    progress: Callable[[Progress], None] | None = None,
    on_frame: Callable[[Frame], None] | None = None,
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
    start = time.process_time()
    fem = fem_section(scene, name)
    deformable = build_deformable(scene, name) if deformable is None else deformable
    if statement is None:
        statement = scene_statement(scene, name, deformable)
    built = time.process_time()
    restarts = 0
    while True:
        try:
            result = _solved(
                fem,
                statement,
                progress=progress,
                on_frame=on_frame,
                checkpoint=checkpoint,
                resume=resume,
            )
            break
        except (UnstableRun, OtherProblemError) as error:
            # A checkpoint may be that of a run that had started again.
            counted = None if fem.time_step is not None else statement.more_counted()
            if counted is None:
                raise InputError(f"{name}: {error}") from None
            if isinstance(error, UnstableRun):
                resume, restarts = None, restarts + 1
            statement = scene_statement(scene, name, deformable, counted_pressure=counted)
        except RefusedError as error:
            raise InputError(f"{name}: {error}") from None
    whole = statement.assembly
    result = _of_all(result, whole.orbits.order)
    solved = time.process_time()
    displacements = whole.expand(result.displacements)
    contact_state = whole.contact_state(result.displacements)
    seconds = {
        "build": built - start,
        "solve": solved - built - result.compile_seconds,
        "loop": result.cpu_seconds,
        **({"compile": result.compile_seconds} if result.compile_seconds else {}),
        "total": time.process_time() - start,
    }
    run = TubeRun(
        name=name,
        scene=scene,
        method=Method.EXPLICIT,
        deformable=deformable,
        displacements=displacements,
        contact_state=contact_state,
        solver=explicit_numbers(result, statement, fem) | {"restarts": restarts},
        cpu_seconds=seconds,
    )
    return run, result


def _solved(
    fem: FemSection,
    statement: ExplicitStatement,
    *,
    progress: Callable[[Progress], None] | None,
    on_frame: Callable[[Frame], None] | None,
    checkpoint: Path | None,
    resume: Path | None,
) -> ExplicitResult:
    whole = statement.assembly
    copies = whole.orbits.order
    # A run that is not damped to the static state watches the residual and goes on.
    bound = fem.residual if fem.damping is Damping.STATIC else 0.0
    stop = StopCriterion(residual=bound, not_before=statement.ramp_time)

    def frame(found: Frame) -> None:
        if on_frame is not None:
            on_frame(replace(found, displacements=whole.expand(found.displacements)))

    def tell(found: Progress) -> None:
        if progress is not None:
            progress(replace(found, energies=found.energies.times(copies)))

    last = statement.end_time
    return solve(
        whole.model,
        end_time=last,
        time_step=fem.time_step,
        safety_factor=fem.safety_factor,
        precision=fem.precision,
        threads=fem.threads,
        sample_interval=fem.sample_interval,
        stop=stop,
        output=Output(
            progress=None if progress is None else tell,
            on_frame=frame if on_frame is not None and fem.frames > 0 else None,
            frame_interval=frame_interval(fem, last, statement.ramp_time),
            checkpoint=checkpoint,
        ),
        resume=resume,
    )


def _of_all(result: ExplicitResult, copies: int) -> ExplicitResult:
    """Result with the energies of the whole tube where one of so many sectors was computed."""
    energies = result.energies
    return replace(
        result,
        energies=None if energies is None else energies.times(copies),
        history=result.history.times(copies),
    )


def _released(history: History) -> float | None:
    """Energy that contact holds before any load acts, over the largest work of the loads [-].

    None where it is less than that work, as it is unless the law presses hard at zero clearance.
    """
    held, work = history.column("contact_energy")[:1], np.abs(history.column("external_work"))
    return float(held[0] / work.max()) if held.size and held[0] > work.max() > 0.0 else None


def explicit_numbers(
    result: ExplicitResult, statement: ExplicitStatement, fem: FemSection
) -> dict[str, Any]:
    """Numbers of an explicit run for its JSON."""
    energies = result.energies
    report = quasi_static_report(
        result,
        ramp_time=statement.ramp_time,
        frequency=statement.recommended.frequency,
        largest_residual=fem.residual,
    )
    return {
        "status": str(result.status),
        "n_steps": result.n_steps,
        "time": result.time,
        "time_step": result.time_step,
        "critical_time_step": result.critical.critical_time_step,
        "counted_pressure": statement.counted_pressure,
        "residual": result.residual,
        "newton_iterations": None,
        "energies": None
        if energies is None
        else asdict(energies) | {"viscous_dissipation": energies.viscous_dissipation},
        "energy_balance": result.energy_balance,
        "released_at_start": _released(result.history),
        "quasi_static": asdict(report),
        "recommended": asdict(statement.recommended),
        "element_updates_per_cpu_second": result.element_updates_per_cpu_second,
        "added_mass": added_mass_share(statement.assembly.model),
    }
