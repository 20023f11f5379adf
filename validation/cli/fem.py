"""The command of deformable blocks: checks, progress, checkpoint and files around a run."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from validation.cli.options import (
    COST_STORE,
    AutoOption,
    CostStoreOption,
    JsonOption,
    KeepOption,
    SceneArgument,
    SetOption,
    default_folder,
    folder_option,
)
from validation.errors import InputError

if TYPE_CHECKING:
    from fem.explicit.solve import ExplicitResult
    from fem.problem.model import BlockGroup
    from validation.output.outputs import Outputs
    from validation.run.deformable import DeformableRun
    from validation.scene.read import DeformableScene

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
        str | None,
        typer.Option(metavar="1%", help="Cheapest setting that `cost` found for it (in p_max)."),
    ] = None,
    auto: AutoOption = None,
    keep: KeepOption = None,
    store: CostStoreOption = COST_STORE,
) -> None:
    """Deformable blocks: displacements, principal stresses, energies."""
    from validation.output.deformable import FILES
    from validation.output.outputs import Outputs
    from validation.scene.read import DeformableScene, load_scene, with_auto

    file = with_auto(load_scene(scene, settings or ()), auto, keep or ())
    folder = default_folder(output, json, f"{file.name}-fem")
    reads = (*_read(resume, folder), *(() if accuracy is None else (store,)))
    names = (*FILES, CHECKPOINT)
    with Outputs(json, folder, names, reads=reads, scene=file) as outputs:
        if accuracy is not None:
            from validation.cost.report import with_accuracy

            file = outputs.scene = with_accuracy(file, accuracy, store, outputs.console)
        if not isinstance(file.scene, DeformableScene):
            raise InputError(
                f"{file.name}: block.type {file.scene.block.type!r} has no hexahedral mesh for "
                "deformable blocks; `tubelock mbd` gives the rigid answer"
            )
        _answer(file.name, file.scene, outputs, resume)
        if folder is not None:
            (folder / CHECKPOINT).unlink(missing_ok=True)


def _read(resume: Path | None, folder: Path | None) -> tuple[Path, ...]:
    """Return the checkpoint that is read and must stay: not the one that this run goes on with."""
    if resume is None or (
        folder is not None and resume.resolve() == (folder / CHECKPOINT).resolve()
    ):
        return ()
    return (resume,)


def refuse_resume(resume: Path | None) -> None:
    """Refuse a checkpoint for a run that keeps none.

    Raises
    ------
    InputError
        When one is given.
    """
    if resume is not None:
        raise InputError(
            f"--resume {resume}: a static run keeps no checkpoint; leave --resume out, or set "
            'fem.method = "explicit" as in the run that was interrupted'
        )


def check_finished(result: ExplicitResult, outputs: Outputs) -> None:
    """Say how to go on with a run that was interrupted.

    Raises
    ------
    KeyboardInterrupt
        After having said it.
    """
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
    from validation.output.fields import FrameWriter

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


def _answer(name: str, scene: DeformableScene, outputs: Outputs, resume: Path | None) -> None:
    """Solve a scene and write what the command promises."""
    from validation.output.console import status
    from validation.output.deformable import print_curved, print_run, write_run_files
    from validation.run.deformable import peak_memory_mb, run_json
    from validation.scene.usage import recording

    if scene.fem is not None and scene.fem.degree > 1:
        from validation.run.curved import run_curved

        refuse_resume(resume)
        with recording(scene) as use, status(outputs.console, f"{name}: curved elements"):
            curved = run_curved(name, scene)
        print_curved(curved, outputs.console)
        outputs.tell_unused(use)
        outputs.write_json(curved.as_json() | {"peak_memory_mb": peak_memory_mb()})
        return
    with recording(scene) as use:
        run, added = _solved(name, scene, outputs, resume)
        data = run_json(run) | added
    print_run(run, outputs.console)
    outputs.tell_unused(use)
    write_run_files(run, outputs)
    outputs.write_json(data)


def _solved(
    name: str, scene: DeformableScene, outputs: Outputs, resume: Path | None
) -> tuple[DeformableRun, dict[str, Any]]:
    """Decide the effects, build, solve and estimate errors; what is told beside the run."""
    from validation.build.cell import is_cell
    from validation.build.deformable import build_deformable, fem_section
    from validation.effects.cell import cell_table, probed_cell_error
    from validation.effects.report import decided
    from validation.output.console import explicit_progress, status
    from validation.run.estimate import estimated_errors
    from validation.run.explicit import run_explicit, scene_statement
    from validation.run.static import run_static
    from validation.scene.deformable import Method

    scene, decision = decided(scene, name, outputs.console)
    fem = fem_section(scene, name)
    if fem.method is Method.STATIC:
        refuse_resume(resume)
    start = time.process_time()
    deformable = build_deformable(scene, name)
    statement = None
    if fem.method is Method.EXPLICIT:
        statement = scene_statement(scene, name, deformable)
    built = time.process_time() - start
    added = {}
    if decision is not None:
        added["effects_decision"] = decision.as_json()
    if is_cell(scene):
        error = probed_cell_error(scene, name)
        outputs.console.print(cell_table(name, error))
        added["periodic_cell"] = error.as_json()
    kept = _kept(outputs, scene, deformable.model.groups, resumed=resume is not None)
    if statement is None:
        with status(outputs.console, f"{name}: static"):
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
    spent = run.cpu_seconds
    spent |= {"build": spent["build"] + built, "total": spent["total"] + built}
    if fem.error_estimate:
        with status(outputs.console, f"{name}: two coarser meshes, for the errors"):
            run = replace(run, errors=estimated_errors(run))
    return run, added
