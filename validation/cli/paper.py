"""Commands that reproduce the paper: tables, figures, claims, errata, a report."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from validation.cli.options import JsonOption, WorkersOption, output_option
from validation.errors import InputError

_DATA = Path("out/paper")

FemOption = Annotated[
    bool, typer.Option("--fem", help="Also run the finite-element analyses (some minutes).")
]
FullOption = Annotated[
    bool, typer.Option("--full", help="Use fine meshes, also in the parameter study.")
]
QuickOption = Annotated[
    bool, typer.Option("--quick", help="Rigid blocks only (three CPU minutes).")
]
NamesArgument = Annotated[
    list[str] | None, typer.Argument(metavar="[NAME]...", help="Names to evaluate; by default all.")
]


def tables(json: JsonOption = None) -> None:
    """Print the paper's tables with the values of tubelock.

    Marks the values that match to the printed precision.
    """
    from validation.output.console import following
    from validation.output.outputs import Outputs
    from validation.paper.shown.printing import print_tables
    from validation.paper.tables import compute_tables

    with Outputs(json) as outputs:
        with following("tables") as tell:
            result = compute_tables(tell=tell)
        print_tables(result, outputs.console)
        outputs.write_json(result)


def figures(
    output: Annotated[Path, output_option("DIR", "Folder for the figures.")] = _DATA,
    *,
    fem: FemOption = False,
    full: FullOption = False,
    workers: WorkersOption = None,
    json: JsonOption = None,
) -> None:
    """Draw the paper's figures and its cost table from results of tubelock."""
    from dataclasses import asdict

    from validation.output.console import following
    from validation.output.outputs import Outputs
    from validation.paper.evidence import PaperEvidence
    from validation.paper.shown.figures import cost_rows, draw_figures, print_costs

    with Outputs(json, output, ("*.png", "*.jsonl")) as outputs:
        with following("figures") as tell:
            evidence = PaperEvidence(output, tell, deformable=fem, full=full, workers=workers)
            result = draw_figures(evidence, output)
            costs = cost_rows(evidence)
        print_costs(costs, outputs.console)
        for figure in result:
            outputs.say("picture", figure.path)
        data = [{"name": f.name, "caption": f.caption, "path": str(f.path)} for f in result]
        outputs.write_json({"figures": data, "cost": [asdict(row) for row in costs]})


def claims(
    names: NamesArgument = None,
    *,
    fem: FemOption = False,
    full: FullOption = False,
    workers: WorkersOption = None,
    json: JsonOption = None,
) -> None:
    """Check the paper's statements: true, false or not decidable.

    Prints the number behind each verdict. Statements whose analysis was not requested are
    "not computed here".
    """
    from validation.output.console import following
    from validation.output.outputs import Outputs
    from validation.paper.claims import judge
    from validation.paper.evidence import PaperEvidence
    from validation.paper.shown.printing import print_claims
    from validation.statement import chosen_by_name

    chosen_by_name(judge.claims(), names, "claim")
    with Outputs(json, _DATA, ("*.jsonl",)) as outputs:
        with following("claims") as tell:
            evidence = PaperEvidence(_DATA, tell, deformable=fem, full=full, workers=workers)
            result = judge.judge_claims(evidence, names)
        print_claims(result, outputs.console)
        outputs.write_json(result)


def deformable(
    output: Annotated[Path, output_option("DIR", "Folder for the figures.")] = _DATA,
    *,
    rows: Annotated[
        Path | None,
        typer.Option(
            "--rows",
            metavar="FILE.csv",
            help="Rows of `tubelock sweep paper-480-fem --csv`; by default those in tubelock.",
        ),
    ] = None,
    json: JsonOption = None,
) -> None:
    """Judge the paper's geometric statements by rigid and by deformable blocks."""
    from validation.output.outputs import Outputs
    from validation.paper import deformable_study as study
    from validation.paper.shown.deformable_study import draw_deformable_study
    from validation.paper.shown.printing import print_deformable_study

    reads = () if rows is None else (rows,)
    with Outputs(json, output, ("deformable-study-*.png",), reads=reads) as outputs:
        compared = study.Compared(rows)
        data = study.as_json(compared)
        print_deformable_study(data, outputs.console)
        for name, draw in draw_deformable_study(compared):
            outputs.write("picture", name, draw)
        outputs.write_json(data)


def errata(names: NamesArgument = None, *, json: JsonOption = None) -> None:
    """List the errors in the paper, each with a computation."""
    from validation.output.console import following
    from validation.output.outputs import Outputs
    from validation.paper import errata
    from validation.paper.evidence import PaperEvidence
    from validation.paper.shown.printing import print_errata
    from validation.statement import chosen_by_name

    chosen_by_name(errata.errata(), names, "erratum")
    with Outputs(json, _DATA, ("*.jsonl",)) as outputs:
        with following("errata") as tell:
            result = errata.show_errata(PaperEvidence(_DATA, tell), names)
        print_errata(result, outputs.console)
        outputs.write_json(result)


def report(
    context: typer.Context,
    output: Annotated[Path, output_option("DIR", "Folder of the report.")] = Path("out/report"),
    *,
    quick: QuickOption = False,
    full: FullOption = False,
    workers: WorkersOption = None,
) -> None:
    """Write a report of all parts; index.html works offline."""
    if context.invoked_subcommand is not None:
        return  # it stands before every part, and is the whole where none is named
    from validation.output.console import text_console
    from validation.paper.shown.report import Extent, write_report

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
