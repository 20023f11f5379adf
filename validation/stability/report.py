"""Robustness cases: run with progress, as a table and as data."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from validation.output.console import following
from validation.stability.case import CaseVerdict
from validation.statement import Statement

#: Word and colour of each kind of verdict.
_KINDS = {
    "green": ("passed", "green"),
    "refused": ("rejected", "cyan"),
    "red": ("failed", "bold red"),
}


def list_cases(cases: Sequence[Statement], console: Console) -> None:
    """Print names and laws of the cases."""
    for case in cases:
        console.print(f"{case.text['subject']:12} {case.name:26} {case.text['law']}")


def run_case(case: Statement) -> dict[str, Any]:
    """Run one case; an exception fails the case, never the suite: verdict, proof, CPU time."""
    start = time.process_time()
    try:
        verdict = case.judge()
    except Exception as error:
        verdict = CaseVerdict("red", f"{type(error).__name__}: {error}")
    seconds = time.process_time() - start
    result = {"verdict": verdict.kind, "proof": verdict.proof, "cpu_seconds": seconds}
    return case.as_json() | result


def run_cases(cases: Sequence[Statement]) -> dict[str, Any]:
    """Run the cases one after another; count the verdicts."""
    result: list[dict[str, Any]] = []
    with following("robustness cases") as follow:
        for number, case in enumerate(cases):
            follow(f"{case.name}, {number + 1} of {len(cases)}", number, len(cases))
            result.append(run_case(case))
    counts = {kind: sum(row["verdict"] == kind for row in result) for kind in _KINDS}
    seconds = sum(row["cpu_seconds"] for row in result)
    return {"cases": result, "counts": counts, "cpu_seconds": seconds}


def print_cases(found: dict[str, Any], console: Console) -> None:
    """Print the outcomes as a table, and how many of each kind there are."""
    table = Table(title="robustness cases", title_justify="left", show_lines=True)
    table.add_column("verdict", no_wrap=True)
    table.add_column("case", no_wrap=True)
    table.add_column("law", ratio=2)
    table.add_column("proof", ratio=3)
    table.add_column("CPU s", justify="right", no_wrap=True)
    for row in found["cases"]:
        verdict = Text(*_KINDS[row["verdict"]])
        name, seconds = f"{row['subject']}\n{row['name']}", f"{row['cpu_seconds']:.2f}"
        table.add_row(verdict, name, row["law"], row["proof"], seconds)
    console.print(table)
    parts = ", ".join(f"{count} {_KINDS[kind][0]}" for kind, count in found["counts"].items())
    console.print(f"of {len(found['cases'])}: {parts}; {found['cpu_seconds']:.1f} CPU s")
