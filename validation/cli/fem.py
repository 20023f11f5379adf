"""The finite-element command: input checks, progress, checkpoint and output files."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from validation.cli.options import (
    AutoOption,
    JsonOption,
    KeepOption,
    SceneArgument,
    SetOption,
    folder_option,
    scene_outputs,
)
from validation.errors import InputError

if TYPE_CHECKING:
    from fem.explicit.solve import ExplicitResult
    from fem.problem.model import BlockGroup
    from fem.solution import Solution
    from validation.output.outputs import Outputs
    from validation.run.deformable import DeformableRun
    from validation.run.stages import Stages
    from validation.scene.read import DeformableScene

CHECKPOINT = "checkpoint.npz"
#: Exit status of an answer whose requested accuracy was not reached.
NOT_REACHED = 3


def fem(
    scene: SceneArgument,
    *,
    settings: SetOption = None,
    json: JsonOption = None,
    output: Annotated[
        Path | None, folder_option("fields, history, pictures", "out/SCENE-fem")
    ] = None,
    resume: Annotated[
        Path | None,
        typer.Option("--resume", metavar="CHECKPOINT", help="Continue an interrupted run."),
    ] = None,
    accuracy: Annotated[
        list[str] | None,
        typer.Option(
            metavar="QUANTITY=3%",
            help="Requested error bar; selects polynomial order, mesh density and mesh bias. "
            "Quantities: u, p_eff, p_max, p_max_point, sigma_1_max, sigma_1_averaged; repeatable.",
        ),
    ] = None,
    max_seconds: Annotated[
        float | None,
        typer.Option(
            metavar="S", min=0.0, help="CPU time limit of --accuracy after the first mesh [s]."
        ),
    ] = None,
    static_reference: Annotated[
        bool,
        typer.Option(help="Beside an explicit run to the static state, its converged value."),
    ] = True,
    auto: AutoOption = None,
    keep: KeepOption = None,
) -> None:
    """Finite-element analysis of deformable blocks.

    Static or explicit: displacements, principal stresses, contact pressures, energies.
    """
    from validation.case import load_case, with_auto
    from validation.output.deformable.answers import FILES

    file = with_auto(load_case(scene, settings or ()), auto, keep or ())
    targets = _targets(accuracy, max_seconds, resume)
    stated = scene_outputs(file, json, output, (*FILES, CHECKPOINT), ending="-fem")
    if resume is not None and not _goes_on(resume, stated):
        stated.reads = (resume,)
    with stated as outputs:
        run = _answer(
            file.name,
            file.scene,
            outputs,
            targets=targets,
            max_seconds=max_seconds,
            resume=resume,
            reference=static_reference,
        )
        missed: list[str] = run.refinement.get("accuracy", {}).get("not_reached", [])
        # No finer mesh describes motions that are not small.
        if missed and not targets and run.solution.large_motion is None:
            _print_tighter([scene, *_options(settings)], missed, outputs)
        if outputs.folder is not None:
            outputs.path(CHECKPOINT).unlink(missing_ok=True)
    if (targets and missed) or not run.solution.reached:
        raise typer.Exit(NOT_REACHED)


def _targets(
    accuracy: list[str] | None, max_seconds: float | None, resume: Path | None
) -> dict[str, float]:
    """Requested accuracies, none where there are none; what cannot be requested is rejected."""
    from validation.run.accuracy import parse_targets

    if not accuracy:
        if max_seconds is not None:
            raise InputError("--max-seconds: limits what --accuracy takes; give both or none")
        return {}
    if max_seconds == 0.0:
        raise InputError("--max-seconds: got 0, expected a positive CPU time in s")
    if resume is not None:
        raise InputError(f"--resume {resume}: a resumed run keeps its mesh; remove --accuracy")
    return parse_targets(accuracy)


def _goes_on(resume: Path, outputs: Outputs) -> bool:
    """Whether a checkpoint is the one that this run keeps, and need not stay as it is."""
    kept = outputs.folder
    return kept is not None and resume.resolve() == (kept / CHECKPOINT).resolve()


def refuse_resume(resume: Path | None) -> None:
    """Reject a checkpoint for a run that keeps none."""
    if resume is not None:
        raise InputError(
            f"--resume {resume}: a static run keeps no checkpoint; leave --resume out, or set "
            'fem.method = "explicit" as in the run that was interrupted'
        )


def check_finished(result: ExplicitResult, outputs: Outputs) -> None:
    """Print how to continue an interrupted run, and raise the interruption."""
    from fem.explicit.solve import Status

    if result.status is not Status.INTERRUPTED:
        return
    remedy = (
        f"continue with --resume {outputs.path(CHECKPOINT)}"
        if outputs.folder is not None
        else "no checkpoint was written: -o names a folder for one"
    )
    outputs.console.print(f"stopped at step {result.n_steps}: {remedy}")
    raise KeyboardInterrupt


def _kept(
    outputs: Outputs,
    scene: DeformableScene,
    groups: Sequence[BlockGroup],
    *,
    resumed: bool,
) -> dict[str, Any]:
    """Checkpoint and writer of frames of an explicit run; neither without a folder."""
    from validation.output.deformable.fields import FrameWriter

    if outputs.folder is None:
        return {}
    writer = FrameWriter(
        outputs.folder,
        groups,
        scene.fem.frames,
        finite_rotation=scene.effects.finite_rotation,
        resumed=resumed,
    )
    return {"checkpoint": outputs.path(CHECKPOINT), "on_frame": writer}


def _options(settings: list[str] | None) -> list[str]:
    """The settings as they are typed."""
    return [part for value in settings or () for part in ("--set", value)]


def _print_tighter(given: list[str], missed: list[str], outputs: Outputs) -> None:
    """Print the command for tighter error bars of what was not reached."""
    requested = [part for name in missed for part in ("--accuracy", f"{name}=5%")]
    words = shlex.join(["tubelock", "fem", *given, *requested])
    outputs.console.print(f"for tighter error bars: {words}", soft_wrap=True)


def _answer(
    name: str,
    scene: DeformableScene,
    outputs: Outputs,
    *,
    targets: dict[str, float],
    max_seconds: float | None,
    resume: Path | None,
    reference: bool,
) -> DeformableRun:
    """Solve a scene, print and write its answer."""
    from validation.output.deformable.answers import print_run, write_run_files
    from validation.run.accuracy import check_request
    from validation.run.solve import with_factors

    check_request(name, scene, targets)
    scene, added = _decided(name, scene, outputs)
    run = _converged(name, scene, outputs, targets=targets, max_seconds=max_seconds, resume=resume)
    if run is None:
        run, beside = _solved(name, scene, outputs, resume)
        added |= beside
        run = _with_errors(run, outputs, reference=reference)
    run = with_factors(run)
    answer = run.answer.with_report(added)
    print_run(run, outputs.console)
    outputs.tell_keys()
    if outputs.folder is not None:
        write_run_files(run, outputs)
    outputs.write_answer(answer)
    return run


def _decided(
    name: str, scene: DeformableScene, outputs: Outputs
) -> tuple[DeformableScene, dict[str, Any]]:
    """The scene with its effects decided where it leaves that to the program."""
    if scene.effects.auto is None:
        return scene, {}
    from validation.study.effects.report import decided

    result, decision = decided(scene, name, outputs.console)
    return result, {"effects_decision": decision.as_json()}


def _converged(
    name: str,
    scene: DeformableScene,
    outputs: Outputs,
    *,
    targets: dict[str, float],
    max_seconds: float | None,
    resume: Path | None,
) -> DeformableRun | None:
    """Solve a scene on finer and finer meshes; None where it is solved on its own."""
    from validation.output.console import status, told_of_compilation
    from validation.output.deformable.fields import FrameWriter
    from validation.run.accuracy import progress_words, refined
    from validation.run.solve import run_converged
    from validation.run.stages import stages, summed

    with stages() as watch:
        problem = refined(name, scene, targets)
        watch.lap("build")
    built = watch.seconds()
    if problem is None:
        return None
    refuse_resume(resume)

    def frames(found: Solution) -> FrameWriter | None:
        if outputs.folder is None:
            return None
        return FrameWriter(
            outputs.folder,
            found.deformable.model.groups,
            scene.fem.frames,
            finite_rotation=found.finite_rotation,
        )

    with status(outputs.console, f"{name}: first mesh") as tell, told_of_compilation():
        run = run_converged(
            name,
            scene,
            targets,
            max_seconds=max_seconds,
            progress=lambda now: tell(f"{name}: {progress_words(now)}"),
            frames=frames,
            problem=problem,
        )
    return replace(run, cpu_seconds=summed(run.cpu_seconds, built))


def _solved(
    name: str, scene: DeformableScene, outputs: Outputs, resume: Path | None
) -> tuple[DeformableRun, dict[str, Any]]:
    """Solve on the mesh of the scene; what is reported beside the run."""
    from validation.build.deformable import fem_section, scene_problem
    from validation.errors import named
    from validation.output.console import explicit_progress, status, told_of_compilation
    from validation.run.solve import run_explicit, run_static, scene_statement
    from validation.run.stages import stages, summed
    from validation.scene.deformable import Method

    added = {}
    fem = fem_section(scene, name)
    if fem.method is Method.STATIC:
        refuse_resume(resume)
    with stages() as watch, told_of_compilation():
        problem, statement = scene_problem(scene, name), None
        with named(name):
            deformable = problem.deformable
        if fem.method is Method.EXPLICIT:
            statement = scene_statement(scene, name, deformable)
        watch.lap("build")
    built = watch.seconds()
    if scene.is_cell:
        from validation.study.effects.cell import cell_table, probed_cell_error

        error = probed_cell_error(scene, name)
        outputs.console.print(cell_table(name, error))
        added["periodic_cell"] = error
    kept = _kept(outputs, scene, deformable.model.groups, resumed=resume is not None)
    if statement is None:
        with status(outputs.console, f"{name}: static"), told_of_compilation():
            frames = kept.get("on_frame")
            run = run_static(name, scene, problem=problem, on_frame=frames)
    else:
        with explicit_progress() as progress:
            run = run_explicit(
                name,
                scene,
                problem=problem,
                statement=statement,
                progress=progress,
                resume=resume,
                **kept,
            )
    if run.solution.explicit is not None:
        check_finished(run.solution.explicit, outputs)
    return replace(run, cpu_seconds=summed(run.cpu_seconds, built)), added


def _with_errors(run: DeformableRun, outputs: Outputs, *, reference: bool) -> DeformableRun:
    """Estimate the errors of a run on the mesh of its scene, and count the time that this takes.

    An explicit run to the static state is compared with the converged one if ``reference``.
    """
    from validation.run.stages import stages, summed

    with stages() as watch:
        run = _estimated(run, outputs, watch, reference=reference)
    return replace(run, cpu_seconds=summed(run.cpu_seconds, watch.seconds()))


def _estimated(
    run: DeformableRun, outputs: Outputs, watch: Stages, *, reference: bool
) -> DeformableRun:
    """The run with its error bars, with friction also with the width of the set of answers."""
    from validation.output.console import status
    from validation.run.accuracy import progress_words
    from validation.run.reference import static_reference
    from validation.run.solve import estimated_errors

    name, scene, fem = run.name, run.scene, run.scene.fem
    if reference:
        with status(outputs.console, f"{name}: converged static state") as tell:
            result = static_reference(run, lambda now: tell(f"{name}: {progress_words(now)}"))
        watch.lap("static reference")
        run = replace(run, reference=result)
        if result is not None and fem.error_estimate and not result.why_not:
            return replace(run, errors=result.bars(run.answer.measures))
    if not fem.error_estimate:
        return run
    with status(outputs.console, f"{name}: two coarser meshes, for the errors"):
        run = replace(run, errors=estimated_errors(run))
    watch.lap("error bars")
    if scene.effects.friction is not None:
        from validation.run.friction_set import friction_set

        with status(outputs.console, f"{name}: how wide the set of answers with friction is"):
            run = replace(run, friction=friction_set(run))
        watch.lap("range of friction")
    return run
