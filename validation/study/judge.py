"""Whether deformable blocks order the designs of a rigid study as rigid blocks do."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from rich.console import Console

from validation.errors import InputError
from validation.output.console import tabled
from validation.study.report import cell, lines_of_head, overlap
from validation.study.rowfile import StudyRows
from validation.study.run import Runner, computed
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
    found = ends(rows)
    if found is None:
        return ""
    name, best, worst = found
    if worst[name] >= TOLD[name] * best[name] > 0.0:
        return ""
    factor = worst[name] / best[name] if best[name] > 0.0 else 1.0
    return (
        f"{name} of these designs differs by a factor of {factor:.3g} at most: rigid blocks tell "
        f"no order below about {TOLD[name]:g}; --judge solves the best and the worst with "
        "deformable blocks"
    )


def judge(rows: StudyRows, runner: Callable[[Study], Runner], console: Console) -> None:
    """Solve the best and the worst design with deformable blocks; print them and their order.

    Their rows are kept in the same file.

    Raises
    ------
    InputError
        Rows that are not of rigid blocks, or fewer than two designs with pressures.
    """
    found = ends(rows)
    if found is None:
        raise InputError(
            f"{rows.study.name}: --judge: got {len(rows.status)} rows of a study with quantity = "
            f'"{rows.study.quantity}"; expected two designs or more of rigid blocks with p_max'
        )
    name, *chosen = found
    study = replace(rows.study, quantity="fem")
    numbers = [row["number"] for row in chosen]
    judged = computed(StudyRows(rows.path, study), runner(study), numbers)
    columns: dict[str, Any] = {"design": cell("number")}
    columns |= {lines_of_head(study, path): cell(path) for path in study.varied}
    of_rigid = dict(zip(numbers, (row[name] for row in chosen), strict=True))
    columns[f"{lines_of_head(study, name)}\nrigid"] = lambda row: f"{of_rigid[row['number']]:.5g}"
    columns[f"{lines_of_head(study, name)}\ndeformable"] = cell(name)
    if any(row["status"] == "failed" for row in judged):
        columns["message"] = cell("message")
    title = f"{study.name}: best and worst design of rigid blocks, solved with deformable ones"
    console.print(tabled(title, judged, columns))
    best, worst = judged
    if best[name] is None or worst[name] is None:
        return
    same = best[name] < worst[name]
    words = "the same order" if same else "the other order: choose no design by this study"
    if overlap(best, worst, name):
        words = "their error bars tell no order"
    console.print(f"deformable blocks: {words}")
