"""Commands that reproduce the paper: tables, figures, claims, errata, a report."""

from __future__ import annotations

from pathlib import Path

import typer

from validation.cli.options import JsonOption, WorkersOption
from validation.errors import InputError

_DATA = Path("out/paper")


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
    *,
    output: Path = _DATA,
    fem: bool = False,
    full: bool = False,
    workers: WorkersOption = None,
    json: JsonOption = None,
) -> None:
    """Draw the paper's figures and its cost table from results of tubelock.

    Parameters
    ----------
    output : -o DIR
        Folder for the figures.
    fem
        Also run the finite-element analyses (some minutes).
    full
        Use fine meshes, also in the parameter study.
    """
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
    names: list[str] | None = None,
    *,
    fem: bool = False,
    full: bool = False,
    workers: WorkersOption = None,
    json: JsonOption = None,
) -> None:
    """Check the paper's statements: true, false or not decidable.

    Prints the number behind each verdict. Statements whose analysis was not requested are
    "not computed here".

    Parameters
    ----------
    names : [NAME]...
        Names to evaluate; by default all.
    fem
        Also run the finite-element analyses (some minutes).
    full
        Use fine meshes, also in the parameter study.
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


def deformable(*, output: Path = _DATA, rows: Path | None = None, json: JsonOption = None) -> None:
    """Judge the paper's geometric statements by rigid and by deformable blocks.

    Parameters
    ----------
    output : -o DIR
        Folder for the figures.
    rows : FILE.csv
        Rows of `tubelock sweep paper-480-fem --csv`; by default those in tubelock.
    """
    from validation.output.outputs import Outputs
    from validation.paper import deformable_study as study
    from validation.paper.shown.figures import draw_deformable_study
    from validation.paper.shown.printing import print_deformable_study

    reads = () if rows is None else (rows,)
    with Outputs(json, output, ("deformable-study-*.png",), reads=reads) as outputs:
        compared = study.Compared(rows)
        data = study.as_json(compared)
        print_deformable_study(data, outputs.console)
        for name, draw in draw_deformable_study(compared):
            outputs.write("picture", name, draw)
        outputs.write_json(data)


def errata(names: list[str] | None = None, *, json: JsonOption = None) -> None:
    """List the errors in the paper, each with a computation.

    Parameters
    ----------
    names : [NAME]...
        Names to evaluate; by default all.
    """
    from validation.output.console import following
    from validation.output.outputs import Outputs
    from validation.paper import errata
    from validation.paper.evidence import PaperEvidence
    from validation.paper.shown.printing import print_errata
    from validation.statement import chosen_by_name

    chosen_by_name(errata.ERRATA, names, "erratum")
    with Outputs(json, _DATA, ("*.jsonl",)) as outputs:
        with following("errata") as tell:
            result = errata.show_errata(PaperEvidence(_DATA, tell), names)
        print_errata(result, outputs.console)
        outputs.write_json(result)


def report(
    context: typer.Context,
    *,
    output: Path = Path("out/report"),
    quick: bool = False,
    full: bool = False,
    workers: WorkersOption = None,
) -> None:
    """Write a report of all parts; index.html works offline.

    Parameters
    ----------
    output : -o DIR
        Folder of the report.
    quick
        Rigid blocks only (three CPU minutes).
    full
        Use fine meshes, also in the parameter study.
    """
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
