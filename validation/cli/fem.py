"""The command of deformable blocks: checks, progress, checkpoint and files around a run."""

from __future__ import annotations

import shlex
import time
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
    from validation.output.outputs import Outputs
    from validation.run.curved.solve import CurvedRun
    from validation.run.deformable import DeformableRun
    from validation.run.measures import Measure
    from validation.scene.read import DeformableScene
    from validation.scene.usage import KeyUse

CHECKPOINT = "checkpoint.npz"


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
            help="Find degree, mesh and grading for an error bar of u, p_eff, p_max, p_max_point, "
            "sigma_1_max or sigma_1_averaged; repeatable.",
        ),
    ] = None,
    max_seconds: Annotated[
        float | None,
        typer.Option(metavar="S", min=0.0, help="CPU time that --accuracy may take."),
    ] = None,
    auto: AutoOption = None,
    keep: KeepOption = None,
) -> None:
    """Deformable blocks: displacements, principal stresses, energies."""
    from validation.output.deformable.answers import FILES
    from validation.scene.read import DeformableScene, load_scene, with_auto

    file = with_auto(load_scene(scene, settings or ()), auto, keep or ())
    targets = _targets(accuracy, max_seconds, resume)
    stated = scene_outputs(file, json, output, (*FILES, CHECKPOINT), ending="-fem")
    if resume is not None and not _goes_on(resume, stated):
        stated.reads = (resume,)
    with stated as outputs:
        if not isinstance(file.scene, DeformableScene):
            raise InputError(
                f"{file.name}: block.type {file.scene.block.type!r} has no hexahedral mesh for "
                "deformable blocks; `tubelock mbd` gives the rigid answer"
            )
        if targets:
            _answer_accurately(file.name, file.scene, outputs, targets, max_seconds)
        else:
            measures = _answer(file.name, file.scene, outputs, resume)
            if auto is None:
                _tell_closer([scene, *_options("--set", settings)], file.scene, measures, outputs)
        if outputs.folder is not None:
            outputs.path(CHECKPOINT).unlink(missing_ok=True)


def _targets(
    accuracy: list[str] | None, max_seconds: float | None, resume: Path | None
) -> dict[str, float]:
    """Accuracies that are asked, none where none is; what cannot be asked is refused."""
    from validation.run.curved.accuracy import parse_targets

    if not accuracy:
        if max_seconds is not None:
            raise InputError("--max-seconds: limits what --accuracy takes; give both or none")
        return {}
    if resume is not None:
        raise InputError(f"--resume {resume}: goes on with one mesh; leave out --accuracy")
    return parse_targets(accuracy)


def _goes_on(resume: Path, outputs: Outputs) -> bool:
    """Whether a checkpoint is the one that this run keeps, and need not stay as it is."""
    kept = outputs.folder
    return kept is not None and resume.resolve() == (kept / CHECKPOINT).resolve()


def refuse_resume(resume: Path | None) -> None:
    """Refuse a checkpoint for a run that keeps none."""
    if resume is not None:
        raise InputError(
            f"--resume {resume}: a static run keeps no checkpoint; leave --resume out, or set "
            'fem.method = "explicit" as in the run that was interrupted'
        )


def check_finished(result: ExplicitResult, outputs: Outputs) -> None:
    """Say how to go on with a run that was interrupted, and raise that it was."""
    from fem.explicit.solve import Status

    if result.status is not Status.INTERRUPTED:
        return
    remedy = (
        f"continue with --resume {outputs.path(CHECKPOINT)}"
        if outputs.folder is not None
        else "nothing was kept: give a folder with -o to keep a checkpoint"
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
    fem = scene.fem
    assert fem is not None
    writer = FrameWriter(
        outputs.folder,
        groups,
        fem.frames,
        finite_rotation=scene.effects.finite_rotation,
        resumed=resumed,
    )
    return {"checkpoint": outputs.path(CHECKPOINT), "on_frame": writer}


def _options(name: str, values: list[str] | None) -> list[str]:
    """A repeated option as it is typed."""
    return [part for value in values or () for part in (name, value)]


def _tell_closer(
    given: list[str], scene: DeformableScene, measures: dict[str, Measure], outputs: Outputs
) -> None:
    """Name the command that gives narrower error bars, where they are wide and there is one."""
    from validation.run.curved.accuracy import closer

    asked = closer(scene, measures)
    if asked is not None:
        words = shlex.join(["tubelock", "fem", *given, "--accuracy", asked])
        outputs.console.print(f"{'closer':9} {words}", soft_wrap=True)


def _answer(
    name: str, scene: DeformableScene, outputs: Outputs, resume: Path | None
) -> dict[str, Measure]:
    """Solve a scene, write what the command promises, and return its measures."""
    from validation.output.console import status
    from validation.run.curved.accuracy import refused, run_curved
    from validation.scene.usage import recording

    if scene.fem is not None and scene.fem.degree > 1 and refused(scene) is None:
        refuse_resume(resume)
        with recording(scene) as use, status(outputs.console, f"{name}: curved elements"):
            curved = run_curved(name, scene)
        _write_curved(curved, outputs, use)
        return curved.measures
    from validation.run.deformable import run_json

    with recording(scene) as use:
        run, added = _solved(name, scene, outputs, resume)
        data = run_json(run) | added
    _write(run, data, outputs, use)
    return run.measures


def _write(run: DeformableRun, data: dict[str, Any], outputs: Outputs, use: KeyUse) -> None:
    """Print a run and write its files and data."""
    from validation.output.deformable.answers import print_run, write_run_files

    print_run(run, outputs.console)
    outputs.tell_unused(use)
    if outputs.folder is not None:
        write_run_files(run, outputs)
    outputs.write_json(data)


def _write_curved(run: CurvedRun, outputs: Outputs, use: KeyUse) -> None:
    """Print a run with curved elements and write its files and data."""
    from validation.output.deformable.curved import print_curved, write_curved_files
    from validation.run.curved.fields import CurvedFields
    from validation.run.stages import peak_memory_mb

    print_curved(run, outputs.console)
    outputs.tell_unused(use)
    fields = CurvedFields(run)
    if outputs.folder is not None:
        write_curved_files(run, fields, outputs)
    if outputs.json is None:
        return
    joints = {"joints": fields.joints.as_json()}
    outputs.write_json(run.as_json() | joints | {"peak_memory_mb": peak_memory_mb()})


def _answer_accurately(
    name: str,
    scene: DeformableScene,
    outputs: Outputs,
    targets: dict[str, float],
    max_seconds: float | None,
) -> None:
    """Solve from coarse to fine until the error bars are as narrow as asked, or refuse."""
    from validation.output.console import status
    from validation.run.curved.accuracy import curved_scene, refused, run_to_accuracy
    from validation.scene.usage import recording

    if refused(scene) is not None:
        _answer_by_shares(name, scene, outputs, targets, max_seconds)
        return
    with recording(scene) as use, status(outputs.console, name) as tell:
        tube = curved_scene(name, scene, "--accuracy")
        run = run_to_accuracy(name, tube, targets, seconds=max_seconds, tell=tell)
    _write_curved(run, outputs, use)


def _answer_by_shares(
    name: str,
    scene: DeformableScene,
    outputs: Outputs,
    targets: dict[str, float],
    max_seconds: float | None,
) -> None:
    """Solve shares of the scene's own mesh until the error bars are as narrow as asked.

    Refused where that mesh, or the time, is not enough, or the scene asks for no error bars.
    """
    from validation.run.curved.accuracy import FACET_MEANS, share_scenes, unmet, words_of
    from validation.run.deformable import run_json
    from validation.scene.usage import recording

    if scene.fem is not None and not scene.fem.error_estimate:
        raise InputError(f"{name}: --accuracy: needs error bars; remove fem.error_estimate = false")
    asked = ", ".join(f"{key}={100 * share:g}%" for key, share in targets.items())
    start, found = time.process_time(), "nothing yet"
    left_out: set[str] = set()
    for share, degree, given in share_scenes(scene, targets):
        with recording(given) as use:
            try:
                run, added = _solved(name, given, outputs, None)
            except InputError as error:
                if degree == 1 or scene.fem is None or scene.fem.degree == degree:
                    raise
                if str(error) not in left_out:
                    outputs.console.print(f"without elements of degree {degree}: {error}")
                left_out.add(str(error))
                continue
            if degree > 1 and share < 1.0:
                run = replace(run, left_out=FACET_MEANS)
            missing = [key for key in targets if key not in run.measures]
            if missing:
                raise InputError(f"{name}: --accuracy: this run has no {missing[0]}")
            data = run_json(run) | added
        if not unmet(run.measures, targets):
            _write(run, data, outputs, use)
            return
        found, spent = words_of(run.measures, list(targets)), time.process_time() - start
        elements = f"{run.deformable.model.n_elements} elements of degree {degree}"
        outputs.console.print(f"{elements}: {found}, {spent:.3g} CPU s so far")
        if max_seconds is not None and spent > max_seconds:
            raise InputError(
                f"{name}: --accuracy {asked}: reached {found} in {spent:.2g} CPU s, more than "
                f"--max-seconds {max_seconds:g}; ask for that, or allow more"
            )
    raise InputError(
        f"{name}: --accuracy {asked}: [mesh] of the scene reaches {found}; ask for that, or refine "
        "[mesh]"
    )


def _solved(
    name: str, scene: DeformableScene, outputs: Outputs, resume: Path | None
) -> tuple[DeformableRun, dict[str, Any]]:
    """Decide the effects, build, solve and estimate errors; what is told beside the run."""
    from validation.build.deformable import build_deformable, fem_section
    from validation.output.console import explicit_progress, status, told_of_compilation
    from validation.run.estimate import estimated_errors
    from validation.run.solve import run_explicit, run_static, scene_statement
    from validation.run.stages import stages, summed
    from validation.scene.deformable import Method

    added = {}
    if scene.effects.auto is not None:
        from validation.effects.report import decided

        scene, decision = decided(scene, name, outputs.console)
        added["effects_decision"] = decision.as_json()
    fem = fem_section(scene, name)
    if fem.method is Method.STATIC:
        refuse_resume(resume)
    with stages() as watch, told_of_compilation():
        deformable = build_deformable(scene, name)
        statement = None
        if fem.method is Method.EXPLICIT:
            statement = scene_statement(scene, name, deformable)
        watch.lap("build")
    built = watch.seconds()
    if scene.is_cell:
        from validation.effects.cell import cell_table, probed_cell_error

        error = probed_cell_error(scene, name)
        outputs.console.print(cell_table(name, error))
        added["periodic_cell"] = error.as_json()
    kept = _kept(outputs, scene, deformable.model.groups, resumed=resume is not None)
    if statement is None:
        with status(outputs.console, f"{name}: static"), told_of_compilation():
            frames = kept.get("on_frame")
            run = run_static(name, scene, deformable=deformable, on_frame=frames)
    else:
        with explicit_progress() as progress:
            run = run_explicit(
                name,
                scene,
                deformable=deformable,
                statement=statement,
                progress=progress,
                resume=resume,
                **kept,
            )
    if run.explicit is not None:
        check_finished(run.explicit, outputs)
    run = replace(run, cpu_seconds=summed(run.cpu_seconds, built))
    if fem.error_estimate:
        with status(outputs.console, f"{name}: two coarser meshes, for the errors"):
            run = replace(run, errors=estimated_errors(run))
    if fem.error_estimate and scene.effects.friction is not None:
        from validation.run.friction_set import friction_set

        with status(outputs.console, f"{name}: how wide the set of answers with friction is"):
            run = replace(run, friction=friction_set(run))
    return run, added
