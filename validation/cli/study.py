"""Commands that run parameter studies, and that choose designs by them."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import typer

from validation.cli.options import (
    JsonOption,
    SceneArgument,
    SchedulerOption,
    SetOption,
    WorkersOption,
    complete_studies,
    scene_outputs,
)
from validation.errors import InputError


def sweep(
    study: Annotated[str, typer.Argument(autocompletion=complete_studies)],
    *,
    settings: SetOption = None,
    output: Path | None = None,
    workers: WorkersOption = None,
    scheduler: SchedulerOption = None,
    csv: Path | None = None,
    digits: Annotated[int, typer.Option(min=1, max=17)] = 17,
    rows: Path | None = None,
    plot: tuple[str, str] | None = None,
    retry_failed: bool = False,
    judge: bool = False,
    json: JsonOption = None,
) -> None:
    """Run a parameter study, or resume an interrupted one.

    Parameters
    ----------
    study : STUDY
        Built-in study (see `scenes --studies`) or TOML file.
    output : -o FILE.jsonl
        Store of the results; by default out/STUDY.jsonl.
    csv : FILE
        Export all rows as CSV.
    digits : N
        Significant digits of --csv.
    rows : FILE.jsonl
        Results computed already, also by another version of tubelock.
    plot : X Y
        Parameter and measure of the picture; by default the first ones.
    retry_failed
        Recompute failed designs.
    judge
        Solve the best and the worst design of rigid blocks with deformable ones.
    """
    import logging

    from validation.output.outputs import Outputs
    from validation.study import sweep as report
    from validation.study.picture import check_axes
    from validation.study.rowfile import StudyRows
    from validation.study.run import runner_for
    from validation.study.scene_study import load_study
    from validation.study.sweep import run_sweep

    stated = load_study(study, settings or ())
    path = Path("out") / f"{stated.name}.jsonl" if output is None else output
    if plot is not None:
        check_axes(stated, *plot)
    picture = _picture(path, asked=plot is not None)
    reads = stated.reads if rows is None else (*stated.reads, rows)
    files = {"--csv": csv, "--plot": picture}
    with Outputs(json, files=files, stores={"-o": path}, reads=reads) as outputs:
        if not path.exists():
            stated.refuse_idle_parameters()
        # A lost scheduler is told in one line of ours, not in a page of its client's.
        logging.getLogger("distributed").setLevel(logging.CRITICAL)

        runner = partial(runner_for, workers=workers, scheduler=scheduler)
        results = StudyRows(path, stated)
        if rows is not None:
            results.take(rows)
        again = {"retry_failed": retry_failed}
        with report.goes_on(results), report.sweep_progress(results, **again) as show:
            swept = run_sweep(results, runner, show, judged=judge, **again)
        swept.print(outputs.console)
        summary = swept.summary
        if picture is not None:
            report.draw(results, plot, picture, outputs)
        report.print_summary(results, summary, outputs.console)
        if csv is not None:
            report.export(results, csv, outputs, digits)
        if json is not None:
            outputs.write_json(summary | {"rows": list(results.rows())})
        if summary["n_failed"] == stated.n_designs:
            first = next(iter(results.rows()))["message"]
            raise InputError(
                f"{stated.name}: every design failed; the first: {first}. All rows are in "
                f"{path}; mend the study or the scene, and give -o another file"
            )


def _picture(store: Path, *, asked: bool) -> Path | None:
    """Place of the picture, beside the store; none where nothing can be written and none is asked.

    Results on a disk that cannot be written are read.
    """
    read_only = store.exists() and not os.access(store.parent, os.W_OK)
    return None if read_only and not asked else store.with_suffix(".png")


def sensitivity(
    scene: SceneArgument,
    *,
    method: Literal["rigid", "fem"] = "rigid",
    of: list[str] | None = None,
    step: float = 0.01,
    settings: SetOption = None,
    workers: int = 1,
    json: JsonOption = None,
    output: Path | None = None,
) -> None:
    """Derivatives of the results by the parameters of a scene.

    Each comes with its elasticity and the error of the difference quotient.

    An interrupted call goes on from its rows, in the folder of -o, with the same command.

    Parameters
    ----------
    method
        rigid: as `mbd`; fem: deformable blocks on the meshes of `fem`.
    of : SECTION.KEY
        Parameter; repeatable. By default all numbers.
    step : SHARE
        Relative step of real parameters.
    workers : N
        Number of processes.
    output : -o DIR
        Folder for table, picture and rows; out/SCENE-sensitivity unless --json is given.
    """
    from validation.case import load_case, require_deformable
    from validation.output.console import following
    from validation.study.optimisation import sensitivity as study
    from validation.study.rowfile import store_or_none

    file = load_case(scene, settings or ())
    if method == "fem":
        require_deformable(file, "sensitivity --method fem")
    else:
        file.with_method("rigid").check()
    names = ("sensitivity.csv", "sensitivity.png", "sensitivity.jsonl")
    with scene_outputs(file, json, output, names, ending="-sensitivity") as outputs:
        rows = None if outputs.folder is None else outputs.path(names[2])
        with following(f"{file.name}: sensitivity") as tell, store_or_none(rows) as path:
            slopes = study.sensitivity_of(file, path, method, of, step, workers=workers, tell=tell)
        slopes.print(outputs.console)
        outputs.write("table", names[0], slopes.write)
        outputs.write("picture", names[1], slopes.draw)
        outputs.write_json(slopes.as_json())


def optimise(
    file: str,
    *,
    settings: SetOption = None,
    output: Path | None = None,
    workers: int = 1,
    scheduler: SchedulerOption = None,
    json: JsonOption = None,
) -> None:
    """Find the best design under limits.

    It minimises one measure, or two (Pareto front).

    An interrupted search continues with the same command.

    Parameters
    ----------
    file : FILE.toml
        Measures, variables, limits.
    output : -o FILE.jsonl
        Store of the rows; by default out/FILE.jsonl. The picture lies beside it.
    workers : N
        Number of processes; with one each answer guides the next.
    """
    from validation.output.console import following
    from validation.output.outputs import Outputs
    from validation.study.optimisation import report
    from validation.study.optimisation.statement import load_optimisation
    from validation.study.run import runner_for

    stated = load_optimisation(file, settings or ())
    path = Path("out") / f"{stated.study.name}.jsonl" if output is None else output
    picture = path.with_suffix(".png")
    stores = {"-o": path}
    runner = partial(runner_for, workers=workers, scheduler=scheduler)
    with Outputs(json, files={"picture": picture}, stores=stores, reads=stated.study.reads) as out:
        with following(stated.study.name) as follow:
            result = report.optimise(stated, path, runner, follow)
        result.print(out.console)
        result.draw(picture)
        out.say("picture", picture)
        out.say("results", path)
        out.write_json(result.as_json())
