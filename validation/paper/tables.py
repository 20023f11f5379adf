"""Tables sin-force-equilibrium, cosin-force-equilibrium and the hexagon table, beside tubelock's.

Two results for each: with the paper's assumptions (`validation.paper.reading`), and without.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from rich.console import Console
from rich.progress import track

from validation.output.console import listing
from validation.paper.reading import DECIMALS, Solve, as_read, solve_row, to_the_digit
from validation.paper.reference import reference
from validation.run.rigid.answer import RigidRun, SharedTubes
from validation.scene.read import load_scene

#: Words of the quantities.
HEADS = {
    "mechanism": "mechanism",
    "effective": "effective elements [%]",
    "p_eff": "p_eff [MPa]",
    "p_max": "p_max [MPa]",
}


@dataclass(frozen=True)
class TableRow:
    """One number of the paper and of tubelock."""

    block: str
    """TSB1, TSB2 or THB0."""
    case: str
    """Load case."""
    quantity: str
    """``effective`` [%, a count of elements], ``p_eff`` or ``p_max`` [MPa]."""
    paper: float
    """The printed value."""
    ours: float | None
    """Result with the paper's assumptions; None where no equilibrium exists."""
    relative_difference: float | None
    """(ours - paper) / paper."""
    to_the_digit: bool
    """Whether the result rounds to the printed value."""
    physical: float | None
    """Result without them: the full traction, p_eff by its formula."""


@dataclass(frozen=True)
class ClassRow:
    """One kinematic class of the paper and of tubelock."""

    block: str
    case: str
    paper: str
    ours: str


@dataclass(frozen=True)
class Tables:
    """The paper's three tables beside tubelock's."""

    rows: list[TableRow]
    """One a number."""
    classes: list[ClassRow]
    """One a load case."""

    @property
    def to_the_digit(self) -> int:
        """Numbers that round to what is printed."""
        return sum(row.to_the_digit for row in self.rows)

    @property
    def classes_met(self) -> int:
        """Mechanism classes that agree."""
        return sum(row.paper == row.ours for row in self.classes)


def compute_tables(console: Console, solve: Solve | None = None) -> Tables:
    """Compute every printed row, with a progress bar.

    By default every scene is solved anew, with the blocks of each table once.
    """
    if solve is None:
        tubes = SharedTubes()

        def solve(scene: str, *settings: str) -> RigidRun:
            return tubes.run(load_scene(scene, settings))

    tables = Tables([], [])
    tasks = [(block, case) for block, cases in reference()["table"].items() for case in cases]
    for block, case in track(tasks, description="tables", console=console, transient=True):
        printed = reference()["table"][block][case]
        run = solve_row(solve, block, case)
        mechanism = str(run.result.mechanism)
        tables.classes.append(ClassRow(block, case, printed["mechanism"], mechanism))
        if "p_max" in printed:
            # As physics says, only the shaft's load differs.
            physical = run
            if case == "shaft":
                physical = solve_row(solve, block, case, "load.as_printed=false")
            tables.rows.extend(_rows(block, case, run, physical))
    return tables


def _rows(block: str, case: str, run: RigidRun, physical: RigidRun) -> list[TableRow]:
    printed = reference()["table"][block][case]
    read, measures = as_read(run.result.measures), physical.result.measures
    true = as_read(measures) | {"p_eff": None if measures is None else measures.p_eff}
    found = []
    for quantity in DECIMALS:
        paper, ours = printed[quantity], read[quantity]
        off = None if ours is None else (ours - paper) / paper
        met = to_the_digit(quantity, paper, ours)
        found.append(TableRow(block, case, quantity, paper, ours, off, met, true[quantity]))
    return found


def tables_json(tables: Tables) -> dict[str, Any]:
    """Tables as plain data."""
    return {
        "to_the_digit": tables.to_the_digit,
        "of": len(tables.rows),
        "rows": [asdict(row) for row in tables.rows],
        "classes": [asdict(row) for row in tables.classes],
    }


def number(quantity: str, value: float | None, more: int = 0) -> str:
    """Write a number with as many decimals as the paper prints, or some more."""
    return "no equilibrium" if value is None else f"{value:.{DECIMALS[quantity] + more}f}"


def count_words(tables: Tables) -> str:
    """Say how many numbers and classes are met."""
    return (
        f"{tables.to_the_digit} of {len(tables.rows)} numbers to the last printed digit, "
        f"{tables.classes_met} of {len(tables.classes)} mechanism classes"
    )


@dataclass(frozen=True)
class TableLine:
    """One number or class in words."""

    case: str
    quantity: str
    paper: str
    ours: str
    difference: str
    same: bool
    physics: str


def lines_by_block(tables: Tables) -> dict[str, list[TableLine]]:
    """All numbers and classes of each block, load case by load case."""
    found: dict[str, list[TableLine]] = {}
    for c in tables.classes:
        lines = found.setdefault(c.block, [])
        same = c.paper == c.ours
        lines.append(TableLine(c.case, HEADS["mechanism"], c.paper, c.ours, "", same, ""))
        for row in tables.rows:
            if (row.block, row.case) == (c.block, c.case):
                off, q = row.relative_difference, row.quantity
                lines.append(
                    TableLine(
                        row.case,
                        HEADS[q],
                        number(q, row.paper),
                        number(q, row.ours, 2),
                        "" if off is None else f"{100 * off:+.1f} %",
                        row.to_the_digit,
                        number(q, row.physical, 2),
                    )
                )
    return found


def print_tables(tables: Tables, console: Console) -> None:
    """Print one table per block: every number on a line of its own, the count at the end."""
    numbers = ("paper", "tubelock", "difference", "printed digits", "consistent load")
    for block, lines in lines_by_block(tables).items():
        title = f"{block}, with the paper's assumptions"
        table = listing(title, "load case", "quantity", numbers=numbers)
        for line in lines:
            case = line.case if line.quantity == HEADS["mechanism"] else ""
            same = "yes" if line.same else "no"
            cells = (line.quantity, line.paper, line.ours, line.difference, same, line.physics)
            table.add_row(case, *cells)
        console.print(table)
    console.print(count_words(tables))
