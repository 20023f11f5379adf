"""The analyses: of rigid blocks, of deformable ones, and both beside each other."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
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
    with_auto,
)
from validation.errors import InputError

if TYPE_CHECKING:
    from geometry.answer import Answer
    from geometry.parts.rows import Part
    from validation.case import Case
    from validation.output.outputs import Outputs

#: Files of the stages of a construction, and of other numbers of layers.
STAGES, LAYERS = "stages.jsonl", "layers.jsonl"


@method_options("rigid", "take_out", "max_work", "max_seconds", "max_memory")
def mbd(
    scene: SceneArgument,
    *,
    settings: SetOption = None,
    json: JsonOption = None,
    output: Path | None = None,
    fields: FieldsOption = False,
    layers_to_unlock: bool = False,
    refine: bool = False,
    disassemble: bool = False,
    stages: bool = False,
    combinations: CombinationsOption = False,
) -> None:
    """Rigid-block analysis: locked or not, equilibrium, pressures.

    Prints the kinematic classification with its proof, the equilibrium residual and the contact
    pressures.

    Parameters
    ----------
    output : -o DIR
        Folder for pictures, JSON and joint forces; out/SCENE unless --json is given.
    layers_to_unlock
        Also determine the number of layers at which the tube ceases to be locked.
    refine
        h-refinement check: also solve with half the facet size.
    disassemble
        Also test of a tube how far all blocks can move outward, rings released.
    stages
        Whether each stage of the construction stands, and its least propping: in the order of
        [stages], or layer by layer.
    """
    from validation.case import load_case
    from validation.output.answer_files import FILES, write_command_files
    from validation.output.console import following

    case = load_case(scene, settings or (), method="rigid")
    if stages and "stages" not in case.keys:
        case = case.changed({"stages.order": "layers"})
    asked = {
        "--layers-to-unlock": layers_to_unlock,
        "--refine": refine,
        "--disassemble": disassemble,
    }
    if combinations:
        solve_combinations(case, json, output, {"--fields": fields, **asked})
        return
    if any(asked.values()):
        from validation.study.beside_rigid import check_asked

        check_asked(case, asked)
    asks = {STAGES: "stages" in case.keys, LAYERS: layers_to_unlock}
    kept = tuple(name for name, on in asks.items() if on)
    with scene_outputs(case, json, output, (*FILES, *kept), fields=fields) as outputs:
        with following(case.name) as show:
            answer = _rigid_answer(case, outputs, show)
        write_command_files(answer.beside(_beside(case, answer, asked, outputs)), outputs)


def _rigid_answer(case: Case, outputs: Outputs, show: Callable[[Any], None]) -> Answer:
    """Answer, with stages that a file of rows in the folder keeps."""
    from validation.case import solve

    if STAGES not in outputs.names:
        return solve(case, show)
    from validation.study.beside_rigid import solve_in_stages

    with _rows(outputs, STAGES) as store:
        return solve_in_stages(case, store, show)


@contextmanager
def _rows(outputs: Outputs, name: str) -> Iterator[Path]:
    """File of rows in the folder; without one it goes at the end."""
    from validation.study.rowfile import store_or_none

    with store_or_none(None if outputs.folder is None else outputs.path(name)) as store:
        yield store


def _beside(
    case: Case, answer: Answer, asked: Mapping[str, bool], outputs: Outputs
) -> dict[str, Part]:
    """Answers to other numbers of layers and to shorter facets, and the motion outwards."""
    from validation.output.console import following

    parts: dict[str, Part] = {}
    if asked["--disassemble"]:
        from validation.output.explosion import run_explosion

        with following(f"{case.name}: motion outwards"):
            parts["disassembly"] = run_explosion(case)
    if asked["--layers-to-unlock"]:
        from validation.study.beside_rigid import layers_to_unlock

        with following(f"{case.name}: layers to unlock"), _rows(outputs, LAYERS) as store:
            parts["layers_to_unlock"] = layers_to_unlock(case, store)
    if asked["--refine"]:
        from validation.study.beside_rigid import refined

        with following(f"{case.name}: half the facet size"):
            parts["refinement"] = refined(case, answer)
    return parts


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
    from validation.case import load_case
    from validation.output.answer_files import write_command_files

    case = with_auto(load_case(scene, settings or ()), auto, keep or ())
    if combinations:
        others = {"--resume": resume, "--fields": fields, "--auto": auto, "--keep": keep}
        solve_combinations(case, json, output, others)
        return
    with _deformable_outputs(case, json, output, resume, fields=fields) as outputs:
        case, decision = decided(case, outputs.console, keep)
        answer = _deformable_answer(case, outputs, resume).with_report(decision)
        write_command_files(answer, outputs)
        for line in _remedies(answer, outputs, ["tubelock", "fem", scene], settings or ()):
            outputs.console.print(line, soft_wrap=True)
    exit_by(answer, case.method)


def _deformable_outputs(
    case: Case, json: str | None, output: Path | None, resume: Path | None, *, fields: bool
) -> Outputs:
    """What the command writes; a checkpoint that it goes on from stays, unless it is its own."""
    from fem.method import Static
    from validation.output.answer_files import FILES

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


def _deformable_answer(case: Case, outputs: Outputs, resume: Path | None) -> Answer:
    """Answer with frames and a checkpoint in the folder; an interrupted run says how to go on."""
    from validation.case import solve
    from validation.output.console import solver_progress
    from validation.output.fields import FrameWriter

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
    from fem.answer.measures import large_motion

    # Of a value without bound a tighter bar is none to request.
    missed = [name for name in not_reached(answer) if not answer[name].remark]
    # No finer mesh describes motions that are not small.
    if missed and not answer.case.method.accuracy and large_motion(answer.details) is None:
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


def compare(
    scene: SceneArgument,
    *,
    settings: SetOption = None,
    json: JsonOption = None,
    output: Path | None = None,
    explicit: bool = False,
    why: bool = False,
    auto: AutoOption = None,
    keep: KeepOption = None,
) -> None:
    """Compare rigid and finite-element results on the same facets.

    Prints tables and a conclusion; with --why the influence of each modelling assumption.

    Parameters
    ----------
    output : -o DIR
        Folder for the figure; out/SCENE-compare unless --json is given.
    explicit : --explicit/--no-explicit
        Also run a quasi-static explicit analysis.
    why
        Also solve the steps from rigid to deformable blocks.
    """
    from geometry.machine.system import peak_memory_mb
    from validation.case import load_case, require_deformable
    from validation.output.console import solver_progress
    from validation.study.comparison import report
    from validation.study.comparison.scene import compared_runs

    case = with_auto(load_case(scene, settings or ()), auto, keep or ())
    with scene_outputs(case, json, output, report.FILES, ending="-compare") as outputs:
        require_deformable(case, "compare")
        case, decision = decided(case, outputs.console, keep)
        with solver_progress(case.name) as show:
            result = report.compare_answers(compared_runs(case, explicit=explicit, progress=show))
            result = result.why() if why else result
        result.print(outputs.console)
        outputs.tell_keys("explicit compare" if explicit else "compare")
        peak = {"peak_memory_mb": peak_memory_mb()}
        data = {"scene": case.name, **result.as_dict(), **peak, **decision}
        outputs.write("picture", report.PICTURE, result.draw)
        outputs.write_data("data", report.DATA, data)
        outputs.write("tables", report.TEXT, lambda path: path.write_text(f"{result}\n", "utf-8"))
        outputs.write_json(data)
