"""Commands of parameter studies: list them, print one, compute one."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from validation.cli.completion import complete_studies
from validation.cli.options import JsonOption, SetOption, print_builtin
from validation.errors import InputError


def studies(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="[NAME]",
            help="Print this study, to copy and change.",
            autocompletion=complete_studies,
        ),
    ] = None,
) -> None:
    """List the built-in parameter studies, or print one as TOML."""
    print_builtin("study", name)


def sweep(
    study: Annotated[
        str,
        typer.Argument(
            metavar="STUDY",
            help="A built-in study (see `studies`) or TOML file.",
            autocompletion=complete_studies,
        ),
    ],
    *,
    settings: SetOption = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="FILE.sqlite", help="Results; by default out/STUDY.sqlite."
        ),
    ] = None,
    workers: Annotated[
        int | None, typer.Option(metavar="N", help="Processes; by default one per core.")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Run on this Dask cluster instead.")
    ] = None,
    csv: Annotated[
        Path | None, typer.Option("--csv", metavar="FILE", help="Export all rows as CSV.")
    ] = None,
    parquet: Annotated[
        Path | None, typer.Option("--parquet", metavar="FILE", help="Export all rows as Parquet.")
    ] = None,
    retry_failed: Annotated[
        bool, typer.Option("--retry-failed", help="Compute failed designs again.")
    ] = False,
    older: Annotated[
        str | None,
        typer.Option(
            "--older",
            metavar="keep|renew",
            help="Rows of another version of tubelock: they count as done, or are computed again.",
        ),
    ] = None,
    json: JsonOption = None,
) -> None:
    """Compute a parameter study; a run that was stopped goes on where it was."""
    import logging
    import time

    from validation.output.outputs import Outputs
    from validation.study import report
    from validation.study import run as runs
    from validation.study.store import Older, ResultFile, require_parquet
    from validation.study.study import load_study, refuse_idle_parameters

    stated = load_study(study, settings or ())
    path = Path("out") / f"{stated.name}.sqlite" if output is None else output
    if older is not None and older not in set(Older):
        raise InputError(f"--older {older}: expected one of {', '.join(Older)}")
    files = {"--csv": csv, "--parquet": parquet}
    with Outputs(json, files=files, stores={"-o": path}, reads=stated.reads) as outputs:
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
        with ResultFile(path, stated, None if older is None else Older(older)) as results:
            start = time.perf_counter()
            with (
                report.goes_on(results),
                report.sweep_progress(results, retry_failed=retry_failed) as show,
            ):
                tally = runs.sweep(results, runner, retry_failed=retry_failed, on_row=show)
            summary = report.summary(results, tally, time.perf_counter() - start)
            report.print_summary(results, summary, outputs.console)
            report.export(results, csv, parquet, outputs)
            if json is not None:
                outputs.write_json(summary | {"rows": list(results.rows())})
            if summary["n_failed"] == stated.n_designs:
                first = next(iter(results.rows()))["message"]
                raise InputError(
                    f"{stated.name}: every design failed; the first: {first}. All rows are in "
                    f"{path}; mend the study or the scene, and give -o another file"
                )


def rescue(
    damaged: Annotated[
        Path, typer.Argument(metavar="FILE.sqlite", help="A damaged file of results.")
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="NEW.sqlite", help="File to make.")
    ],
) -> None:
    """Copy the results that are whole in a damaged file into a new one, which goes on."""
    from validation.output.outputs import Outputs
    from validation.output.store import rescue as copy_whole_rows

    with Outputs(files={"-o": output}, reads=(damaged,)) as outputs:
        whole, lost = copy_whole_rows(damaged, output)
        outputs.console.print(f"{whole} results are whole, {lost} found damaged")
        outputs.say("results", output)
