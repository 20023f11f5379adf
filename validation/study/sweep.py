"""One sweep: rows that a store lacks are computed; then tables, and the verdict on the designs.

The verdict on rigid designs is whether deformable blocks order them alike.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from rich.console import Console
from rich.table import Table

from validation.errors import InputError
from validation.output.console import tabled
from validation.study.design import DesignRow
from validation.study.report import cell, lines_of_head, overlap, print_table, summary
from validation.study.rowfile import StudyRows
from validation.study.run import Runner, computed, sweep
from validation.study.study import Study

#: Factor by which values of rigid blocks must differ before deformable ones tell the same order: √2
#: standard deviations of the ratio of both, of 16 random Sine tubes of two layers, half of them
#: under internal and half under external pressure.
TOLD = {"p_max": 1.45, "p_eff": 1.22}


def ends(rows: StudyRows) -> tuple[str, dict[str, Any], dict[str, Any]] | None:
    """Measure that rigid blocks rank designs by, the best and the worst row; None without two."""
    name = rows.first_measure()
    if rows.study.quantity != "rigid" or name not in TOLD:
        return None
    known = [row for row in rows.rows() if row["status"] == "ok" and row[name] is not None]
    best, worst = (end(known, key=lambda row: row[name]) for end in (min, max))
    return (name, best, worst) if best["number"] != worst["number"] else None


def doubt(rows: StudyRows) -> str:
    """Say where values differ by less than rigid blocks can tell; empty otherwise."""
    by_rigid = ends(rows)
    if by_rigid is None:
        return ""
    name, best, worst = by_rigid
    if worst[name] >= TOLD[name] * best[name] > 0.0:
        return ""
    factor = worst[name] / best[name] if best[name] > 0.0 else 1.0
    return (
        f"{name} of these designs differs by a factor of {factor:.3g} at most: rigid blocks tell "
        f"no order below about {TOLD[name]:g}; --judge solves the best and the worst with "
        "deformable blocks"
    )


@dataclass(frozen=True)
class Judgement:
    """Best and worst design of rigid blocks, solved with deformable ones."""

    rows: tuple[dict[str, Any], ...]
    """Of deformable blocks: best and worst design by rigid ones."""
    table: Table
    verdict: str
    """Whether both kinds of blocks order them alike; empty where one has no answer."""

    def print(self, console: Console) -> None:
        """Print table and verdict."""
        console.print(self.table)
        if self.verdict:
            console.print(f"deformable blocks: {self.verdict}")


def judge(rows: StudyRows, runner: Callable[[Study], Runner]) -> Judgement:
    """Solve the best and the worst design with deformable blocks; rows are kept in the same file.

    Raises
    ------
    InputError
        Rows that are not of rigid blocks, or fewer than two designs with pressures.
    """
    by_rigid = ends(rows)
    if by_rigid is None:
        raise InputError(
            f"{rows.study.name}: --judge: got {len(rows.status)} rows of a study with quantity = "
            f'"{rows.study.quantity}"; expected two designs or more of rigid blocks with p_max'
        )
    name, *chosen = by_rigid
    study = rows.study.deformable()
    of_rigid = {row["number"]: row[name] for row in chosen}
    best, worst = judged = computed(StudyRows(rows.path, study), runner(study), list(of_rigid))
    columns: dict[str, Any] = {"design": cell("number")}
    columns |= {lines_of_head(study, path): cell(path) for path in study.varied}
    columns[f"{lines_of_head(study, name)}\nrigid"] = lambda row: f"{of_rigid[row['number']]:.5g}"
    columns[f"{lines_of_head(study, name)}\ndeformable"] = cell(name)
    if any(row["status"] == "failed" for row in judged):
        columns["message"] = cell("message")
    title = f"{study.name}: best and worst design of rigid blocks, solved with deformable ones"
    return Judgement(tuple(judged), tabled(title, judged, columns), _order(best, worst, name))


def _order(best: Mapping[str, Any], worst: Mapping[str, Any], name: str) -> str:
    """Whether the best of two designs is so by a measure; empty where one has no value."""
    if best[name] is None or worst[name] is None:
        return ""
    if overlap(best, worst, name):
        return "their error bars overlap: the order of the two is open"
    if best[name] < worst[name]:
        return "the same order"
    return "the other order: choose no design by this study"


@dataclass(frozen=True)
class Swept:
    """What a sweep did and found."""

    results: StudyRows
    summary: dict[str, Any]
    """How many designs were computed and failed, and their CPU time [s]."""
    judgement: Judgement | None
    """Best and worst design of rigid blocks with deformable ones, where that was requested."""

    def print(self, console: Console) -> None:
        """Print designs and measures, and the verdict on them."""
        print_table(self.results, console)
        if self.judgement is not None:
            self.judgement.print(console)
        elif words := doubt(self.results):
            console.print(words)


def run_sweep(
    results: StudyRows,
    runner: Callable[[Study], Runner],
    on_row: Callable[[DesignRow], None],
    *,
    retry_failed: bool = False,
    judged: bool = False,
) -> Swept:
    """Compute the designs that the result file lacks; ``on_row`` takes each of them."""
    start = time.perf_counter()
    tally = sweep(results, runner(results.study), retry_failed=retry_failed, on_row=on_row)
    did = summary(results, tally, time.perf_counter() - start)
    return Swept(results, did, judge(results, runner) if judged else None)
