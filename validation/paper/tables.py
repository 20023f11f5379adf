"""Tables sin-force-equilibrium, cosin-force-equilibrium and the hexagon table, beside ours."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

from rich.console import Console
from rich.progress import track
from rich.table import Table

from validation.paper.reference import reference
from validation.run.rigid import RigidRun, run_rigid
from validation.scene.builtin import builtin_names
from validation.scene.read import load_scene

QUANTITIES = ("mechanism", "effective", "p_eff", "p_max")
VARIANTS = ("as_printed", "physical")
NOT_BUILT = "not built yet"


@dataclass(frozen=True)
class TableRow:
    """One number of the paper and ours."""

    block: str
    """TSB1, TSB2 or THB0."""
    case: str
    """Load case."""
    quantity: str
    """``mechanism``, ``effective`` [%, a count of elements], ``p_eff`` or ``p_max`` [MPa]."""
    variant: str
    """``as_printed`` (the reading that reproduces the table) or ``physical``."""
    paper: str | float
    """The printed value."""
    ours: str | float | None
    """Ours; None where no equilibrium exists."""
    relative_difference: float | None
    """(ours - paper) / paper; None for words."""


def _ours(run: RigidRun) -> dict[str, str | float | None]:
    measures = run.result.measures
    return {
        "mechanism": str(run.result.mechanism),
        "effective": None if measures is None else measures.effective_count_percent,
        "p_eff": None if measures is None else measures.p_eff,
        "p_max": None if measures is None else measures.p_max,
    }


def _difference(paper: str | float, ours: str | float | None) -> float | None:
    if isinstance(ours, float) and not isinstance(paper, str):
        return (ours - paper) / paper
    return None


def compute_tables(
    console: Console, solve: Callable[[str, str], RigidRun] | None = None
) -> list[TableRow]:
    """Compute every printed row, in both variants, with a progress bar on ``console``.

    Parameters
    ----------
    console
        For the progress bar.
    solve
        Computes a scene with one override; by default anew.
    """
    rows = []
    tasks = [
        (block, case, variant)
        for block, cases in reference()["table"].items()
        for case in cases
        for variant in VARIANTS
    ]
    for block, case, variant in track(tasks, description="tables", console=console, transient=True):
        printed = reference()["table"][block][case]
        scene = f"{block.lower()}-{case}"
        if scene not in builtin_names():
            ours: dict[str, str | float | None] = dict.fromkeys(QUANTITIES, NOT_BUILT)
        else:
            setting = f"load.as_printed={str(variant == 'as_printed').lower()}"
            if solve is None:
                run = run_rigid(load_scene(scene, [setting]))
            else:
                run = solve(scene, setting)
            ours = _ours(run)
        rows += [
            TableRow(
                block=block,
                case=case,
                quantity=quantity,
                variant=variant,
                paper=printed[quantity],
                ours=ours[quantity],
                relative_difference=_difference(printed[quantity], ours[quantity]),
            )
            for quantity in QUANTITIES
            if quantity in printed
        ]
    return rows


def tables_json(rows: list[TableRow]) -> list[dict[str, Any]]:
    """Rows as plain data."""
    return [asdict(row) for row in rows]


def _cell(row: TableRow) -> str:
    if row.ours is None:
        return "no equilibrium"
    if isinstance(row.ours, str):
        return row.ours
    if row.relative_difference is None:
        return f"{row.ours:.4g}"
    return f"{row.ours:.4g} ({100 * row.relative_difference:+.1f} %)"


def print_tables(rows: list[TableRow], console: Console) -> None:
    """Print one table per block and variant, in the paper's columns."""
    heads = {
        "mechanism": "mechanism",
        "effective": "effective elements [%]",
        "p_eff": "p_eff [MPa]",
        "p_max": "p_max [MPa]",
    }
    for block in dict.fromkeys(row.block for row in rows):
        for variant in VARIANTS:
            words = "as printed" if variant == "as_printed" else "as physics says"
            table = Table(title=f"{block}, {words}: paper | ours", title_justify="left")
            table.add_column("load case")
            for head in heads.values():
                table.add_column(head)
            group = [row for row in rows if row.block == block and row.variant == variant]
            for case in dict.fromkeys(row.case for row in group):
                found = {row.quantity: row for row in group if row.case == case}
                cells = [
                    f"{found[q].paper} | {_cell(found[q])}" if q in found else "–" for q in heads
                ]
                table.add_row(case, *cells)
            console.print(table)
