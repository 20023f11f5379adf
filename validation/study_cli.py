"""Commands of parameter studies and of the paper's figures, claims, errata and report."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from validation.cli_options import JsonOption, SetOption, text_console


def register(app: typer.Typer, reproduce: typer.Typer) -> None:
    """Add the commands to the command line and to its ``reproduce`` group."""
    app.command()(studies)
    app.command("sweep")(sweep_command)


def studies(
    name: Annotated[
        str | None, typer.Argument(metavar="[NAME]", help="Print this study, to copy and change.")
    ] = None,
) -> None:
    """List the built-in parameter studies, or print one as TOML."""
    from validation.study import builtin_studies, builtin_study_text

    if name is not None:
        sys.stdout.write(builtin_study_text(name))
        return
    console = text_console(None)
    for study in builtin_studies():
        first = builtin_study_text(study).splitlines()[0].lstrip("# ")
        console.print(f"{study:14} {first}")


def sweep_command(
    study: Annotated[
        str, typer.Argument(metavar="STUDY", help="A built-in study (see `studies`) or TOML file.")
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
    json: JsonOption = None,
) -> None:
    """Compute a parameter study; a run that was stopped goes on where it was."""
    from validation.study_command import run_sweep

    run_sweep(
        study,
        settings=settings or (),
        scheduler=scheduler,
        workers=workers,
        output=output,
        csv=csv,
        parquet=parquet,
        json=json,
        retry_failed=retry_failed,
        console=text_console(json),
    )
