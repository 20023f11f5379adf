"""Explicit runs of deformable tubes."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from fem.assembly.deformable import DeformableAssembly
from fem.assembly.symmetry import largest_cyclic_orbits
from fem.contact.surfaces import refuse_overlap
from fem.explicit.output.checkpoint import CheckpointError, OtherProblemError
from fem.explicit.setup.assembly import (
    COUNTED_PRESSURE,
    ExplicitAssembly,
    counted_stiffness,
    explicit_assembly,
)
from fem.explicit.setup.quasi_static import RecommendedTimes, quasi_static_report, recommended_times
from fem.explicit.solve import (
    ExplicitResult,
    Frame,
    Output,
    Progress,
    StopCriterion,
    UnstableRun,
    solve,
)
from fem.problem.loads import SmoothStepAmplitude
from fem.problem.mass_scaling import added_mass_share, scale_masses
from fem.problem.model import ModelError
from fem.problem.time_step import TimeStepError
from validation.build.effects import build_effects
from validation.errors import InputError
from validation.run.deformable import NO_SECTOR, TubeRun, build_deformable, fem_section
from validation.scene.deformable import Damping, FemSection, Method
from validation.scene.read import DeformableScene


@dataclass(frozen=True)
class ExplicitStatement:
    """The explicit problem of a scene and the times of its run."""

    assembly: ExplicitAssembly
    """Representative blocks with loads, effects and contact."""
    recommended: RecommendedTimes
    """What the lowest frequency that the load excites recommends."""
    ramp_time: float
    """Duration of the smooth step of the loads [s]."""
    end_time: float
    """Latest end of the run [s]."""
    counted_pressure: float
    """Pressure whose contact stiffness the critical time step counts in where no cap is
    below it [MPa]."""


#: Contact pressures that the critical time step counts in, one after the other [MPa]: a run whose
#: contact outgrows its time step starts again with the next.
_COUNTED_PRESSURES = tuple(COUNTED_PRESSURE * 4.0**k for k in range(6))


def explicit_statement(
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
    damped = fem.damping is Damping.STATIC
    try:
        if fem.mass_scaling is not None:
            model = scale_masses(deformable.model, fem.mass_scaling)
            deformable = replace(deformable, model=model)
        sliding = deformable.contact.finite_sliding
        # Blocks that may slide far may leave their sector: the whole tube is computed.
        whole = fem.symmetry == "none" or (sliding and fem.symmetry == "auto")
        orbits = None if whole else largest_cyclic_orbits(deformable)
        if fem.symmetry == "sector" and orbits is not None and orbits.order == 1:
            raise InputError(f"{name}: {NO_SECTOR}")
        effects = build_effects(scene.effects, fem)
        plain = explicit_assembly(deformable, orbits=orbits, effects=effects)
        if plain.sliding is not None:
            start = plain.sliding.at_start
            refuse_overlap(start.block_m, start.block_s, start.deepest, deformable.contact.law)
        times = recommended_times(plain.model, damped=damped)
        ramp = times.ramp_time if fem.ramp_time is None else fem.ramp_time
        stated = explicit_assembly(
            deformable,
            orbits=orbits,
            effects=effects,
            amplitude=SmoothStepAmplitude(ramp) if ramp > 0 else None,
            friction=deformable.contact.friction,
            counted_pressure=counted_pressure,
        )
    except InputError:
        raise
    except ValueError as error:
        raise InputError(f"{name}: {error}") from None
    hold = times.end_time - times.ramp_time
    end = ramp + hold if fem.end_time is None else fem.end_time
    return ExplicitStatement(stated, times, ramp, end, counted_pressure)


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
        Of that, already stated (`explicit_statement`); stated anew by default.
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
        statement = explicit_statement(scene, name, deformable)
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
            counted = None if fem.time_step is not None else _more_counted(deformable, statement)
            if counted is None:
                raise InputError(f"{name}: {error}") from None
            if isinstance(error, UnstableRun):
                resume, restarts = None, restarts + 1
            statement = explicit_statement(scene, name, deformable, counted_pressure=counted)
        except (ModelError, TimeStepError, CheckpointError) as error:
            raise InputError(f"{name}: {error}") from None
    whole = statement.assembly
    result = _of_all(result, whole.orbits.order)
    solved = time.process_time()
    displacements = whole.expand(result.displacements)
    contact_state = whole.contact_state(result.displacements)
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
        contact_state=contact_state,
        solver=explicit_numbers(result, statement) | {"restarts": restarts},
        cpu_seconds=seconds,
    )
    return run, result


def _more_counted(deformable: DeformableAssembly, statement: ExplicitStatement) -> float | None:
    """Next contact pressure to count in [MPa]; None where more of it counts no more stiffness."""
    law = deformable.contact.law
    now = counted_stiffness(law, statement.counted_pressure)
    more = (p for p in _COUNTED_PRESSURES if p > statement.counted_pressure)
    return next((p for p in more if counted_stiffness(law, p) > now), None)


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
            frame_interval=last / max(fem.frames - 1, 1),
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


def explicit_numbers(result: ExplicitResult, statement: ExplicitStatement) -> dict[str, Any]:
    """Numbers of an explicit run for its JSON."""
    energies = result.energies
    report = quasi_static_report(
        result, ramp_time=statement.ramp_time, frequency=statement.recommended.frequency
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
        "quasi_static": asdict(report),
        "recommended": asdict(statement.recommended),
        "element_updates_per_cpu_second": result.element_updates_per_cpu_second,
        "added_mass": added_mass_share(statement.assembly.model),
    }
