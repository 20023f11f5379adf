"""`tubelock fem`: checks, progress bar, checkpoint, files and text around a deformable run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypedDict

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from fem.explicit import ExplicitResult, Status
from fem.explicit import Progress as Sample
from validation.box import BoxModel, build_box
from validation.errors import InputError
from validation.fem_box import BoxRun, box_json, check_end_time, run_box
from validation.files import output_folder, prepare_json, write_json
from validation.scene import DeformableScene, SceneFile
from validation.scene_fem import BoxScene, Method

CHECKPOINT = "checkpoint.npz"


class Options(TypedDict):
    """What the command line asks of every deformable run."""

    json: str | None
    output: Path | None
    resume: Path | None
    console: Console


@contextmanager
def progress_bar() -> Iterator[Callable[[Sample], None]]:
    """Live bar with time, step, energies and remaining time; yields the callback that feeds it."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(bar_width=24),
        TextColumn("{task.percentage:>3.0f} %"),
        TextColumn("{task.fields[state]}"),
        TimeRemainingColumn(),
    )
    console = Console(stderr=True)
    # A log file wants the result, not a thousand states of a bar.
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as bar:
        task = bar.add_task("explicit", total=None, state="")

        def show(sample: Sample) -> None:
            energies = sample.energies
            state = (
                f"t {1e3 * sample.time:.4g} ms  step {sample.step}  "
                f"kinetic {energies.kinetic_energy:.3g}  strain {energies.strain_energy:.3g} N mm"
            )
            if sample.residual is not None:
                state += f"  residual {sample.residual:.1e}"
            bar.update(task, total=sample.n_steps, completed=sample.step, state=state)

        yield show


def check_finished(result: ExplicitResult, checkpoint: Path | None, console: Console) -> None:
    """Say how to go on with a run that was interrupted.

    Raises
    ------
    KeyboardInterrupt
        After having said it.
    """
    if result.status is not Status.INTERRUPTED:
        return
    remedy = (
        f"continue with --resume {checkpoint}"
        if checkpoint is not None
        else "nothing was kept: give a folder with -o to keep a checkpoint"
    )
    console.print(f"stopped at step {result.n_steps}: {remedy}")
    raise KeyboardInterrupt


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


def run_fem(
    file: SceneFile,
    *,
    json: str | None,
    output: Path | None,
    resume: Path | None,
    console: Console,
) -> None:
    """Solve a scene with deformable blocks and write what the command promises.

    Raises
    ------
    InputError
        For a scene that cannot be solved, or an interrupted run (with how to go on).
    """
    scene, name = file.scene, file.name
    options: Options = {"json": json, "output": output, "resume": resume, "console": console}
    if isinstance(scene, BoxScene):
        run_fem_box(name, scene, **options)
    elif isinstance(scene, DeformableScene):
        from validation.tube_command import run_fem_tube

        run_fem_tube(name, scene, **options)
    else:
        raise InputError(
            f"{name}: block.type {scene.block.type!r} has no hexahedral mesh for deformable "
            "blocks; `tubelock mbd` gives the rigid answer"
        )


def run_fem_box(
    name: str,
    scene: BoxScene,
    *,
    json: str | None,
    output: Path | None,
    resume: Path | None,
    console: Console,
) -> None:
    """`tubelock fem` on a box scene."""
    if scene.fem.method is Method.EXPLICIT:
        check_end_time(scene)
    else:
        refuse_resume(resume)
    box = build_box(scene)
    prepare_json(json)
    folder = Path("out") / name if output is None and json is None else output
    with output_folder(folder):
        run = _solve_box(name, scene, box, folder=folder, resume=resume, console=console)
        print_box(run, console)
        if folder is not None:
            from validation.fem_files import write_box_files

            for words, path in write_box_files(run, folder):
                console.print(f"{words:9} {path}")
            (folder / CHECKPOINT).unlink(missing_ok=True)
        write_json(json, box_json(run))


def _solve_box(
    name: str,
    scene: BoxScene,
    box: BoxModel,
    *,
    folder: Path | None,
    resume: Path | None,
    console: Console,
) -> BoxRun:
    """Run with a progress bar, frames and checkpoint; an interrupted run says how to go on."""
    checkpoint = frames = None
    if folder is not None:
        from validation.fem_files import FrameWriter

        checkpoint = folder / CHECKPOINT
        finite = scene.effects.finite_rotation
        frames = FrameWriter(folder, box.model.groups, finite_rotation=finite)
    with progress_bar() as progress:
        run = run_box(
            name,
            scene,
            box=box,
            progress=progress,
            on_frame=frames,
            checkpoint=checkpoint,
            resume=resume,
        )
    if run.explicit is not None:
        check_finished(run.explicit, checkpoint, console)
    return run


def print_box(run: BoxRun, console: Console) -> None:
    """Print the numbers of a box run."""
    data = box_json(run)
    table = Table(title=f"{run.name}: deformable", show_header=False, title_justify="left")
    table.add_column()
    table.add_column()
    table.add_row("method, element", f"{run.scene.fem.method}, {run.scene.fem.element.value}")
    table.add_row("elements, nodes", f"{data['n_elements']}, {data['n_nodes']}")
    if run.explicit is not None:
        table.add_row(
            "steps, time step",
            f"{data['n_steps']}, {data['time_step']:.4g} s "
            f"(critical {data['critical_time_step']:.4g} s)",
        )
        rate = data["element_updates_per_cpu_second"] / 1e6
        table.add_row("element updates", f"{rate:.3g} million per CPU second")
    table.add_row("largest displacement", f"{data['max_displacement']:.6g} mm")
    stress = data["principal_stress"]
    table.add_row("principal stress", f"{stress['max']:.5g} … {stress['min']:.5g} MPa")
    if data["energies"] is not None:
        shown = [
            f"{key.replace('_', ' ')} {value:.5g}"
            for key, value in data["energies"].items()
            if value != 0.0
        ]
        table.add_row("energies [N mm]", ", ".join(shown) or "all zero")
    table.add_row("energy balance", f"{data['energy_balance']:.2e}")
    if data.get("residual") is not None:
        table.add_row("force residual", f"{data['residual']:.2e}")
    seconds = ", ".join(f"{k} {v:.3f}" for k, v in data["cpu_seconds"].items())
    table.add_row("CPU seconds", seconds)
    table.add_row("peak memory", f"{data['peak_memory_mb']:.0f} MB")
    console.print(table)
