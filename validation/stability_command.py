"""`tubelock stability`: the hard cases as a table and as data."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.progress import Progress
from rich.table import Table

from validation.files import prepare_json, write_json
from validation.stability.case import Outcome, Verdict
from validation.stability.suite import chosen, run_suite

_STYLES = {Verdict.GREEN: "green", Verdict.REFUSED: "cyan", Verdict.RED: "bold red"}


def list_cases(names: Sequence[str], console: Console) -> None:
    """Print names and laws of the cases."""
    for case in chosen(names):
        console.print(f"{case.subject:12} {case.name:26} {escape(case.law)}")


def run_stability(names: Sequence[str], *, json: str | None, console: Console) -> bool:
    """Run the chosen cases; whether none is red.

    Raises
    ------
    InputError
        For unknown names, or a JSON file that cannot be written.
    """
    cases = chosen(names)
    prepare_json(json)
    found: list[Outcome] = []
    with Progress(
        console=Console(stderr=True), transient=True, disable=not console.is_terminal
    ) as bar:
        task = bar.add_task("hard cases", total=len(cases))
        for outcome in run_suite(cases):
            found.append(outcome)
            bar.update(task, advance=1, description=outcome.case.name)
    console.print(_table(found))
    console.print(_summary(found))
    write_json(json, stability_json(found))
    return all(outcome.verdict is not Verdict.RED for outcome in found)


def _table(found: Sequence[Outcome]) -> Table:
    table = Table(title="hard cases", title_justify="left", show_lines=True)
    table.add_column("verdict", no_wrap=True)
    table.add_column("case", no_wrap=True)
    table.add_column("what must hold", ratio=2)
    table.add_column("proof", ratio=3)
    table.add_column("CPU s", justify="right", no_wrap=True)
    for outcome in found:
        style = _STYLES[outcome.verdict]
        table.add_row(
            f"[{style}]{outcome.verdict}[/]",
            f"{outcome.case.subject}\n{outcome.case.name}",
            escape(outcome.case.law),
            escape(outcome.proof),
            f"{outcome.cpu_seconds:.2f}",
        )
    return table


def _summary(found: Sequence[Outcome]) -> str:
    count = Counter(outcome.verdict for outcome in found)
    seconds = sum(outcome.cpu_seconds for outcome in found)
    parts = ", ".join(f"{count[verdict]} {verdict}" for verdict in Verdict)
    return f"{len(found)} cases: {parts}; {seconds:.1f} CPU s"


def stability_json(found: Sequence[Outcome]) -> dict[str, Any]:
    """Return the outcomes as plain data."""
    return {
        "cases": [
            {
                "name": outcome.case.name,
                "subject": outcome.case.subject,
                "law": outcome.case.law,
                "verdict": str(outcome.verdict),
                "proof": outcome.proof,
                "cpu_seconds": outcome.cpu_seconds,
            }
            for outcome in found
        ],
        "counts": {v: sum(o.verdict is v for o in found) for v in Verdict},
        "cpu_seconds": sum(outcome.cpu_seconds for outcome in found),
    }
