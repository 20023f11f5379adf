"""The finite-element command: input checks, progress, checkpoint and output files."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from validation.cli.options import (
    AutoOption,
    CombinationsOption,
    FieldsOption,
    JsonOption,
    KeepOption,
    SceneArgument,
    SetOption,
    decided,
    exit_by,
    method_options,
    not_reached,
    scene_outputs,
    solve_combinations,
)
from validation.errors import InputError

if TYPE_CHECKING:
    from geometry.answer import Answer
    from validation.case import Case
    from validation.output.outputs import Outputs

CHECKPOINT = "checkpoint.npz"


@method_options("fem", "accuracy", "max_work", "max_seconds", "max_memory")
def fem(
    scene: SceneArgument,
    *,
    settings: SetOption = None,
    json: JsonOption = None,
    output: Path | None = None,
    fields: FieldsOption = False,
    resume: Path | None = None,
    auto: AutoOption = None,
    keep: KeepOption = None,
    combinations: CombinationsOption = False,
) -> None:
    """Finite-element analysis of deformable blocks.

    Static or explicit: displacements, principal stresses, contact pressures, energies.

    Parameters
    ----------
    output : -o DIR
        Folder for pictures, JSON, history; out/SCENE-fem unless --json is given.
    resume : CHECKPOINT
        Continue an interrupted run.
    """
    from validation.case import load_case, with_auto
    from validation.output.command_files import write_command_files

    case = with_auto(load_case(scene, settings or ()), auto, keep or ())
    if combinations:
        others = {"--resume": resume, "--fields": fields, "--auto": auto, "--keep": keep}
        solve_combinations(case, json, output, others)
        return
    with _outputs(case, json, output, resume, fields=fields) as outputs:
        case, decision = decided(case, outputs.console, keep)
        answer = _solved(case, outputs, resume).with_report(decision)
        write_command_files(answer, outputs)
        for line in _remedies(answer, outputs, ["tubelock", "fem", scene], settings or ()):
            outputs.console.print(line, soft_wrap=True)
    exit_by(answer, case.method)


def _outputs(
    case: Case, json: str | None, output: Path | None, resume: Path | None, *, fields: bool
) -> Outputs:
    """What the command writes; a checkpoint that it goes on from stays, unless it is its own."""
    from fem.method import Static
    from validation.output.command_files import FILES

    if resume is not None and isinstance(case.method, Static):
        raise InputError(
            f"--resume {resume}: a static run keeps no checkpoint; leave --resume out, or set "
            'fem.method = "explicit" as in the run that was interrupted'
        )
    result = scene_outputs(case, json, output, (*FILES, CHECKPOINT), ending="-fem", fields=fields)
    kept = result.folder
    if resume is not None and (kept is None or resume.resolve() != (kept / CHECKPOINT).resolve()):
        result.reads = (resume,)
    return result


def _solved(case: Case, outputs: Outputs, resume: Path | None) -> Answer:
    """Answer with frames and a checkpoint in the folder; an interrupted run says how to go on."""
    from validation.output.console import solver_progress
    from validation.output.deformable.fields import FrameWriter
    from validation.solving import solve

    files: dict[str, Any] = {}
    if outputs.folder is not None:
        frames = FrameWriter(outputs.folder, case, resumed=resume is not None)
        files = {"checkpoint": outputs.path(CHECKPOINT), "on_frame": frames}
    with solver_progress(case.name) as show:
        answer = solve(case, show, resume=resume, **files)
        show.end(answer)
    if answer.report["status"] == "interrupted":
        raise KeyboardInterrupt(_resumption(answer, outputs))
    if answer.report["status"] != "stopped" and outputs.folder is not None:
        outputs.path(CHECKPOINT).unlink(missing_ok=True)
    return answer


def _remedies(
    answer: Answer, outputs: Outputs, words: list[str], settings: Sequence[str]
) -> Iterator[str]:
    """How to get tighter error bars, and how a run that was cut short continues."""
    # Of a value without bound a tighter bar is none to request.
    missed = [name for name in not_reached(answer) if not answer[name].remark]
    # No finer mesh describes motions that are not small.
    if missed and not answer.case.method.accuracy and answer.details.large_motion is None:
        words += [part for value in settings for part in ("--set", value)]
        words += [part for name in missed for part in ("--accuracy", f"{name}=5%")]
        yield f"for tighter error bars: {shlex.join(words)}"
    if answer.report["status"] == "stopped":
        yield _resumption(answer, outputs)


def _resumption(answer: Answer, outputs: Outputs) -> str:
    """How a run that was cut short continues."""
    how = "no checkpoint was written: -o names a folder for one"
    if outputs.folder is not None:
        how = f"continue with --resume {outputs.path(CHECKPOINT)}"
    return f"{answer.report['n_steps']} time steps are done; {how}"
