"""Commands that reproduce the paper: tables, figures, claims, errata, and all of it as a report."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from validation.cli.options import JsonOption
from validation.errors import InputError

_DATA = Path("out/paper")

FemOption = Annotated[
    bool, typer.Option("--fem", help="Compute the deformable blocks too: some minutes.")
]
FullOption = Annotated[
    bool, typer.Option("--full", help="Fine meshes, in the parameter study as well.")
]
QuickOption = Annotated[bool, typer.Option("--quick", help="Rigid blocks only: three CPU minutes.")]
WorkersOption = Annotated[
    int | None, typer.Option("--workers", metavar="N", help="Processes; by default one per core.")
]
NamesArgument = Annotated[
    list[str] | None, typer.Argument(metavar="[NAME]...", help="Only these; by default all.")
]
ReportFolder = Annotated[
    Path, typer.Option("-o", "--output", metavar="DIR", help="Folder of the report.")
]


def tables(json: JsonOption = None) -> None:
    """Every number of the paper's tables beside ours, and which rounds to the printed digits."""
    from validation.output.outputs import Outputs
    from validation.paper.tables import compute_tables, print_tables, tables_json

    with Outputs(json) as outputs:
        found = compute_tables(outputs.console)
        print_tables(found, outputs.console)
        outputs.write_json(tables_json(found))


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

    from validation.output.outputs import Outputs
    from validation.paper.evidence import Evidence
    from validation.paper.figures import cost_rows, draw_figures, print_costs

    with Outputs(json, output, ("*.png", "*.sqlite")) as outputs:
        evidence = Evidence(output, outputs.console, deformable=fem, full=full, workers=workers)
        found = draw_figures(evidence, output)
        costs = cost_rows(evidence)
        print_costs(costs, outputs.console)
        for figure in found:
            outputs.say("picture", figure.path)
        data = [{"name": f.name, "caption": f.caption, "path": str(f.path)} for f in found]
        outputs.write_json({"figures": data, "cost": [asdict(row) for row in costs]})


def claims(
    names: NamesArgument = None,
    *,
    fem: FemOption = False,
    full: FullOption = False,
    workers: WorkersOption = None,
    json: JsonOption = None,
) -> None:
    """Judge the paper's statements: true, false or not decidable, with the number.

    What was not run is "not computed here".
    """
    from validation.output.outputs import Outputs
    from validation.paper.claims import judge
    from validation.paper.evidence import Evidence
    from validation.paper.naming import chosen_by_name

    chosen_by_name(judge.claims(), names, "claim")
    with Outputs(json, _DATA, ("*.sqlite",)) as outputs:
        evidence = Evidence(_DATA, outputs.console, deformable=fem, full=full, workers=workers)
        found = judge.judge_claims(evidence, names)
        judge.print_claims(found, outputs.console)
        outputs.write_json(judge.claims_json(found))


def errata(names: NamesArgument = None, *, json: JsonOption = None) -> None:
    """Show what the paper prints and cannot mean, each with a computation."""
    from validation.output.outputs import Outputs
    from validation.paper import errata
    from validation.paper.evidence import Evidence
    from validation.paper.naming import chosen_by_name

    chosen_by_name(errata.errata(), names, "erratum")
    with Outputs(json, _DATA, ("*.sqlite",)) as outputs:
        found = errata.show_errata(Evidence(_DATA, outputs.console), names)
        errata.print_errata(found, outputs.console)
        outputs.write_json(errata.errata_json(found))


def report(
    context: typer.Context,
    output: ReportFolder = Path("out/report"),
    *,
    quick: QuickOption = False,
    full: FullOption = False,
    workers: WorkersOption = None,
) -> None:
    """Write one folder with everything: index.html needs no network."""
    if context.invoked_subcommand is not None:
        return  # it stands before every part, and is the whole where none is named
    from validation.output.console import text_console
    from validation.paper.report import Extent, write_report

    if quick and full:
        raise InputError("--quick and --full: choose one of the two, or none")
    extent = Extent.QUICK if quick else Extent.FULL if full else Extent.NORMAL
    console = text_console()
    try:
        page = write_report(output, console, extent=extent, workers=workers)
    except OSError as error:
        raise InputError(
            f"{output}: the report could not be written ({error.strerror or error}); make room and "
            "run the same command again: the parameter study in it is kept"
        ) from None
    console.print(f"{'report':9} {page}")
