"""Commands of parameter studies and of the paper's figures, claims, errata and report."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from validation.cli_options import JsonOption, SetOption, text_console
from validation.errors import InputError

if TYPE_CHECKING:
    from validation.paper.evidence import Evidence


def register(app: typer.Typer, reproduce: typer.Typer) -> None:
    """Add the commands to the command line and to its ``reproduce`` group."""
    app.command()(studies)
    app.command("sweep")(sweep_command)
    reproduce.command("figures")(figures)
    reproduce.command("claims")(claims)
    reproduce.command("errata")(errata)
    reproduce.command("report")(report)
    reproduce.callback(invoke_without_command=True)(reproduce_everything)


_DATA = Path("out/paper")

FemOption = Annotated[
    bool, typer.Option("--fem", help="Compute the deformable blocks too: some minutes.")
]
FullOption = Annotated[
    bool, typer.Option("--full", help="Fine meshes, in the parameter study as well.")
]
QuickOption = Annotated[bool, typer.Option("--quick", help="Rigid blocks only: about a minute.")]
WorkersOption = Annotated[
    int | None, typer.Option("--workers", metavar="N", help="Processes; by default one per core.")
]
NamesArgument = Annotated[
    list[str] | None, typer.Argument(metavar="[NAME]...", help="Only these; by default all.")
]
ReportFolder = Annotated[
    Path, typer.Option("-o", "--output", metavar="DIR", help="Folder of the report.")
]


def _evidence(
    folder: Path,
    json: str | None,
    *,
    fem: bool = False,
    full: bool = False,
    workers: int | None = None,
) -> Evidence:
    from validation.files import prepare_folder
    from validation.paper.evidence import Evidence

    console = text_console("-" if json == "-" else None)
    return Evidence(prepare_folder(folder), console, deformable=fem, full=full, workers=workers)


def figures(
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for the figures.")
    ] = _DATA,
    *,
    fem: FemOption = False,
    full: FullOption = False,
    workers: WorkersOption = None,
    json: JsonOption = None,
) -> None:
    """Draw the paper's figures from our own results, and the cost table beside the printed one."""
    from dataclasses import asdict

    from validation.files import prepare_json, write_json
    from validation.paper.figures import cost_rows, draw_figures, print_costs

    prepare_json(json)
    evidence = _evidence(output, json, fem=fem, full=full, workers=workers)
    found = draw_figures(evidence, output)
    costs = cost_rows(evidence)
    print_costs(costs, evidence.console)
    for figure in found:
        evidence.console.print(f"{'picture':9} {figure.path}")
    data = [{"name": f.name, "caption": f.caption, "path": str(f.path)} for f in found]
    write_json(json, {"figures": data, "cost": [asdict(row) for row in costs]})


def claims(
    names: NamesArgument = None,
    *,
    fem: FemOption = False,
    full: FullOption = False,
    workers: WorkersOption = None,
    json: JsonOption = None,
) -> None:
    """Judge the paper's statements: true, false or not decidable, with the number."""
    from validation.files import prepare_json, write_json
    from validation.paper.claims import check_claims, claims_json, judge_claims, print_claims

    check_claims(names)
    prepare_json(json)
    evidence = _evidence(_DATA, json, fem=fem, full=full, workers=workers)
    found = judge_claims(evidence, names)
    print_claims(found, evidence.console)
    write_json(json, claims_json(found))


def errata(names: NamesArgument = None, *, json: JsonOption = None) -> None:
    """Show what the paper prints and cannot mean, each with a computation."""
    from validation.files import prepare_json, write_json
    from validation.paper.errata import check_errata, errata_json, print_errata, show_errata

    check_errata(names)
    prepare_json(json)
    evidence = _evidence(_DATA, json)
    found = show_errata(evidence, names)
    print_errata(found, evidence.console)
    write_json(json, errata_json(found))


def report(
    output: ReportFolder = Path("out/report"),
    *,
    quick: QuickOption = False,
    full: FullOption = False,
    workers: WorkersOption = None,
) -> None:
    """Write one folder with everything: index.html needs no network."""
    from validation.report import Extent, write_report

    if quick and full:
        raise InputError("--quick and --full: choose one of the two, or none")
    extent = Extent.QUICK if quick else Extent.FULL if full else Extent.NORMAL
    console = text_console(None)
    try:
        page = write_report(output, console, extent=extent, workers=workers)
    except OSError as error:
        raise InputError(
            f"{output}: the report could not be written ({error.strerror or error}); make room and "
            "run the same command again: the parameter study in it is kept"
        ) from None
    console.print(f"{'report':9} {page}")


def reproduce_everything(
    context: typer.Context,
    output: ReportFolder = Path("out/report"),
    *,
    quick: QuickOption = False,
    full: FullOption = False,
    workers: WorkersOption = None,
) -> None:
    """Reproduce the paper: alone, this writes the whole report; the commands write parts of it."""
    if context.invoked_subcommand is None:
        report(output, quick=quick, full=full, workers=workers)


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
