"""The finite-element command: input checks, progress, checkpoint and output files."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from validation.cli.options import (
    AccuracyOption,
    AutoOption,
    CombinationsOption,
    FieldsOption,
    JsonOption,
    KeepOption,
    MaxMemoryOption,
    MaxSecondsOption,
    MaxWorkOption,
    SceneArgument,
    SetOption,
    exit_by,
    folder_option,
    method_fields,
    not_reached,
    scene_outputs,
    solve_combinations,
    with_fields,
)
from validation.errors import InputError

if TYPE_CHECKING:
    from geometry.answer import Answer
    from validation.case import Case
    from validation.output.outputs import Outputs

CHECKPOINT = "checkpoint.npz"


def fem(
    scene: SceneArgument,
    *,
    settings: SetOption = None,
    json: JsonOption = None,
    output: Annotated[
        Path | None, folder_option("pictures, JSON, history", "out/SCENE-fem")
    ] = None,
    fields: FieldsOption = False,
    resume: Annotated[
        Path | None,
        typer.Option("--resume", metavar="CHECKPOINT", help="Continue an interrupted run."),
    ] = None,
    accuracy: AccuracyOption = None,
    max_work: MaxWorkOption = None,
    max_seconds: MaxSecondsOption = None,
    max_memory: MaxMemoryOption = None,
    auto: AutoOption = None,
    keep: KeepOption = None,
    combinations: CombinationsOption = False,
) -> None:
    """Finite-element analysis of deformable blocks.

    Static or explicit: displacements, principal stresses, contact pressures, energies.
    """
    from validation.case import load_case, with_auto
    from validation.output.deformable.answers import FILES, run_table, write_run_files

    case = load_case(scene, settings or ())
    stated = method_fields(
        accuracy, max_work=max_work, max_seconds=max_seconds, max_memory=max_memory
    )
    if "accuracy" in stated and resume is not None:
        raise InputError(f"--resume {resume}: a resumed run keeps its mesh; remove --accuracy")
    case = with_auto(with_fields(case, stated), auto, keep or ())
    if combinations:
        others = {"resume": resume, "fields": fields, "auto": auto, "keep": keep}
        solve_combinations(case, json, output, others)
        return
    if resume is not None and case.scene.fem.method == "static":
        raise InputError(
            f"--resume {resume}: a static run keeps no checkpoint; leave --resume out, or set "
            'fem.method = "explicit" as in the run that was interrupted'
        )
    written = scene_outputs(case, json, output, (*FILES, CHECKPOINT), ending="-fem", fields=fields)
    if resume is not None and not _goes_on(resume, written):
        written.reads = (resume,)
    with written as outputs:
        case, added = _decided(case, outputs, keep or ())
        answer = _solved(case, outputs, resume).with_report(added)
        outputs.show(run_table(answer))
        outputs.tell_keys()
        if outputs.folder is not None:
            write_run_files(answer, outputs)
        outputs.write_answer(answer)
        # Of a value without bound a tighter bar is none to request.
        missed = [name for name in not_reached(answer) if not answer[name].remark]
        # No finer mesh describes motions that are not small.
        if missed and "accuracy" not in stated and answer.details.large_motion is None:
            words = [part for value in settings or () for part in ("--set", value)]
            words += [part for name in missed for part in ("--accuracy", f"{name}=5%")]
            line = shlex.join(["tubelock", "fem", scene, *words])
            outputs.console.print(f"for tighter error bars: {line}", soft_wrap=True)
        if answer.report["status"] == "stopped":
            outputs.console.print(_resumption(answer, outputs))
        elif outputs.folder is not None:
            outputs.path(CHECKPOINT).unlink(missing_ok=True)
    exit_by(answer, case.method)


def _goes_on(resume: Path, outputs: Outputs) -> bool:
    """Whether a checkpoint is the one that this run keeps, and need not stay as it is."""
    kept = outputs.folder
    return kept is not None and resume.resolve() == (kept / CHECKPOINT).resolve()


def _decided(case: Case, outputs: Outputs, keep: Sequence[str]) -> tuple[Case, dict[str, Any]]:
    """The case with its effects decided where it leaves that to the program."""
    if case.scene.effects.auto is None:
        return case, {}
    from validation.study.effects.report import decided

    scene, decision = decided(case.scene, case.name, outputs.console, keep)
    return case.stating(scene), {"effects_decision": decision.as_json()}


def _solved(case: Case, outputs: Outputs, resume: Path | None) -> Answer:
    """Answer with frames and a checkpoint in the folder; an interrupted run says how to go on."""
    from validation.output.deformable.fields import FrameWriter
    from validation.output.progress import solver_progress
    from validation.solving import solve

    files: dict[str, Any] = {}
    if outputs.folder is not None:
        turning, resumed = case.scene.effects.finite_rotation, resume is not None
        frames = FrameWriter(
            outputs.folder, case.scene.fem.frames, finite_rotation=turning, resumed=resumed
        )
        files = {"checkpoint": outputs.path(CHECKPOINT), "on_frame": frames}
    with solver_progress(case.name) as show:
        answer = solve(case, show, resume=resume, **files)
        show.end(answer)
    if answer.report["status"] == "interrupted":
        raise KeyboardInterrupt(_resumption(answer, outputs))
    return answer


def _resumption(answer: Answer, outputs: Outputs) -> str:
    """How a run that was cut short continues."""
    how = "no checkpoint was written: -o names a folder for one"
    if outputs.folder is not None:
        how = f"continue with --resume {outputs.path(CHECKPOINT)}"
    return f"{answer.report['n_steps']} time steps are done; {how}"
