"""The hard cases: run with a bar, as a table and as data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich.console import Console
from rich.progress import Progress
from rich.table import Table
from rich.text import Text

from validation.output.console import progress
from validation.stability.case import Case, Outcome, Verdict, run_case

_STYLES = {Verdict.GREEN: "green", Verdict.REFUSED: "cyan", Verdict.RED: "bold red"}


def list_cases(cases: Sequence[Case], console: Console) -> None:
    """Print names and laws of the cases."""
    for case in cases:
        console.print(f"{case.subject:12} {case.name:26} {case.law}")


def run_cases(cases: Sequence[Case]) -> list[Outcome]:
    """Run the cases one after another, with a bar."""
    found: list[Outcome] = []
    with progress(*Progress.get_default_columns()) as bar:
        task = bar.add_task("hard cases", total=len(cases))
        for case in cases:
            found.append(run_case(case))
            bar.update(task, advance=1, description=case.name)
    return found


def any_red(found: Sequence[Outcome]) -> bool:
    """Whether a case gave a wrong answer."""
    return any(outcome.verdict is Verdict.RED for outcome in found)


def print_cases(found: Sequence[Outcome], console: Console) -> None:
    """Print the outcomes as a table, and how many of each kind there are."""
    table = Table(title="hard cases", title_justify="left", show_lines=True)
    table.add_column("verdict", no_wrap=True)
    table.add_column("case", no_wrap=True)
    table.add_column("what must hold", ratio=2)
    table.add_column("proof", ratio=3)
    table.add_column("CPU s", justify="right", no_wrap=True)
    for outcome in found:
        style = _STYLES[outcome.verdict]
        table.add_row(
            Text(str(outcome.verdict), style),
            f"{outcome.case.subject}\n{outcome.case.name}",
            outcome.case.law,
            outcome.proof,
            f"{outcome.cpu_seconds:.2f}",
        )
    console.print(table)
    data = stability_json(found)
    parts = ", ".join(f"{count} {verdict}" for verdict, count in data["counts"].items())
    console.print(f"{len(found)} cases: {parts}; {data['cpu_seconds']:.1f} CPU s")


def case_json(case: Case) -> dict[str, Any]:
    """Return what a case claims as plain data."""
    return {"name": case.name, "subject": case.subject, "law": case.law}


def stability_json(found: Sequence[Outcome]) -> dict[str, Any]:
    """Return the outcomes as plain data."""
    return {
        "cases": [
            {
                **case_json(outcome.case),
                "verdict": str(outcome.verdict),
                "proof": outcome.proof,
                "cpu_seconds": outcome.cpu_seconds,
            }
            for outcome in found
        ],
        "counts": {v: sum(o.verdict is v for o in found) for v in Verdict},
        "cpu_seconds": sum(outcome.cpu_seconds for outcome in found),
    }
