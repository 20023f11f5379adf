"""Commands that run parameter studies, and that choose designs by them."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from validation.cli.completion import complete_studies
from validation.cli.options import (
    JsonOption,
    SceneArgument,
    SchedulerOption,
    SetOption,
    WorkersOption,
    folder_option,
    output_option,
    scene_outputs,
)
from validation.errors import InputError

if TYPE_CHECKING:
    from validation.study.run import Runner
    from validation.study.study import Study


def sweep(
    study: Annotated[
        str,
        typer.Argument(
            metavar="STUDY",
            help="Built-in study (see `scenes --studies`) or TOML file.",
            autocompletion=complete_studies,
        ),
    ],
    *,
    settings: SetOption = None,
    output: Annotated[
        Path | None,
        output_option("FILE.sqlite", "Store of the results; by default out/STUDY.sqlite."),
    ] = None,
    workers: WorkersOption = None,
    scheduler: SchedulerOption = None,
    csv: Annotated[
        Path | None, typer.Option("--csv", metavar="FILE", help="Export all rows as CSV.")
    ] = None,
    parquet: Annotated[
        Path | None, typer.Option("--parquet", metavar="FILE", help="Export all rows as Parquet.")
    ] = None,
    digits: Annotated[
        int, typer.Option(metavar="N", min=1, max=17, help="Significant digits of --csv.")
    ] = 17,
    rows: Annotated[
        Path | None,
        typer.Option("--rows", metavar="FILE.csv", help="Rows computed already: what --csv wrote."),
    ] = None,
    plot: Annotated[
        tuple[str, str] | None,
        typer.Option(
            "--plot",
            metavar="X Y",
            help="Parameter and measure of the picture; by default the first ones.",
        ),
    ] = None,
    retry_failed: Annotated[
        bool, typer.Option("--retry-failed", help="Recompute failed designs.")
    ] = False,
    older: Annotated[
        str | None,
        typer.Option(
            "--older",
            metavar="keep|renew",
            help="Rows computed by another version of tubelock: keep or recompute.",
        ),
    ] = None,
    json: JsonOption = None,
) -> None:
    """Run a parameter study, or resume an interrupted one."""
    import logging
    import time

    from validation.output.outputs import Outputs
    from validation.study import report
    from validation.study import run as runs
    from validation.study.design import refuse_idle_parameters
    from validation.study.picture import check_axes
    from validation.study.store import Older, ResultFile, require_parquet
    from validation.study.study import load_study

    stated = load_study(study, settings or ())
    path = Path("out") / f"{stated.name}.sqlite" if output is None else output
    if older is not None and older not in set(Older):
        raise InputError(f"--older {older}: expected one of {', '.join(Older)}")
    if rows is not None and older == Older.RENEW:
        raise InputError("--rows keeps rows, --older renew recomputes them: give one of the two")
    kept = Older.KEEP if rows is not None else None if older is None else Older(older)
    if plot is not None:
        check_axes(stated, *plot)
    picture = _picture(path, asked=plot is not None)
    reads = stated.reads if rows is None else (*stated.reads, rows)
    files = {"--csv": csv, "--parquet": parquet, "--plot": picture}
    with Outputs(json, files=files, stores={"-o": path}, reads=reads) as outputs:
        if parquet is not None:
            require_parquet()
        if not path.exists():
            refuse_idle_parameters(stated)
        # A lost scheduler is told in one line of ours, not in a page of its client's.
        logging.getLogger("distributed").setLevel(logging.CRITICAL)
        runner: runs.Runner = (
            runs.LocalRunner(stated, workers)
            if scheduler is None
            else runs.DaskRunner(stated, scheduler)
        )
        with ResultFile(path, stated, kept) as results:
            if rows is not None:
                results.take(rows)
            start = time.perf_counter()
            with (
                report.goes_on(results),
                report.sweep_progress(results, retry_failed=retry_failed) as show,
            ):
                tally = runs.sweep(results, runner, retry_failed=retry_failed, on_row=show)
            summary = report.summary(results, tally, time.perf_counter() - start)
            report.print_table(results, outputs.console)
            if picture is not None:
                report.draw(results, plot, picture, outputs)
            report.print_summary(results, summary, outputs.console)
            report.export(results, csv, parquet, outputs, digits)
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


def rescue(
    damaged: Annotated[Path, typer.Argument(metavar="FILE.sqlite", help="Damaged results file.")],
    output: Annotated[Path, output_option("NEW.sqlite", "Results file to write.")],
) -> None:
    """Recover the intact results of a damaged results file.

    `sweep` can continue with the new file.
    """
    from validation.output.outputs import Outputs
    from validation.output.store import rescue as copy_whole_rows

    with Outputs(files={"-o": output}, reads=(damaged,)) as outputs:
        whole, lost = copy_whole_rows(damaged, output)
        outputs.console.print(f"{whole} results are whole, {lost} found damaged")
        outputs.say("results", output)


def sensitivity(
    scene: SceneArgument,
    *,
    method: Annotated[
        Literal["rigid", "fem"],
        typer.Option(help="rigid: as `mbd`; fem: deformable blocks on the meshes of `fem`."),
    ] = "rigid",
    of: Annotated[
        list[str] | None,
        typer.Option(
            "--of", metavar="SECTION.KEY", help="Parameter; repeatable. By default all numbers."
        ),
    ] = None,
    step: Annotated[
        float, typer.Option(metavar="SHARE", help="Relative step of real parameters.")
    ] = 0.01,
    settings: SetOption = None,
    json: JsonOption = None,
    output: Annotated[
        Path | None, folder_option("table and picture", "out/SCENE-sensitivity")
    ] = None,
) -> None:
    """Derivatives of the measures with respect to the parameters of a scene.

    Each comes with its elasticity and the error of the difference quotient.
    """
    from validation.case import load_case
    from validation.output.progress import following
    from validation.study.optimisation import sensitivity as study

    file = load_case(scene, settings or ())
    names = ("sensitivity.csv", "sensitivity.png")
    with scene_outputs(file, json, output, names, ending="-sensitivity") as outputs:
        with following(f"{file.name}: sensitivity") as tell:
            result = study.sensitivity_of(file, method, of, step, tell)
        result.print(outputs.console)
        outputs.write("table", names[0], result.write)
        outputs.write("picture", names[1], result.draw)
        outputs.write_json(result.as_json())


def optimise(
    file: Annotated[str, typer.Argument(metavar="FILE.toml", help="Measures, variables, limits.")],
    *,
    settings: SetOption = None,
    output: Annotated[
        Path | None,
        output_option(
            "FILE.sqlite",
            "Store of the rows; by default out/FILE.sqlite. The picture lies beside it.",
        ),
    ] = None,
    workers: Annotated[
        int,
        typer.Option(
            metavar="N", help="Number of processes; with one each answer guides the next."
        ),
    ] = 1,
    scheduler: SchedulerOption = None,
    json: JsonOption = None,
) -> None:
    """Find the best design: one measure, or two (Pareto front), under limits.

    An interrupted search continues with the same command.
    """
    from validation.output.outputs import Outputs
    from validation.output.progress import following
    from validation.study.optimisation import report
    from validation.study.optimisation.statement import load_optimisation
    from validation.study.run import runner_for

    stated = load_optimisation(file, settings or ())
    path = Path("out") / f"{stated.study.name}.sqlite" if output is None else output
    final_path = path.with_name(f"{path.stem}-judge.sqlite")
    picture = path.with_suffix(".png")
    stores = {"-o": path} | ({} if stated.judge is None else {"[judge]": final_path})

    def runner(study: Study) -> Runner:
        return runner_for(study, workers, scheduler)

    with Outputs(json, files={"picture": picture}, stores=stores, reads=stated.study.reads) as out:
        with following(stated.study.name) as follow:
            result = report.optimise(stated, path, final_path, runner, follow)
        result.print(out.console)
        result.draw(picture)
        out.say("picture", picture)
        out.say("results", path)
        out.write_json(result.as_json())
