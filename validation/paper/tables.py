"""Tables sin-force-equilibrium, cosin-force-equilibrium and the hexagon table, beside tubelock's.

Two results for each: with the paper's assumptions (`validation.paper.reading`), and without.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from geometry import Answer
from validation.paper.evidence import Tell, nobody
from validation.paper.reading import DECIMALS, SharedTubes, Solve, as_read, solve_row, to_the_digit
from validation.paper.reference import reference

#: Words of the quantities.
HEADS = {
    "mechanism": "mechanism",
    "effective": "effective elements [%]",
    "p_eff": "p_eff [MPa]",
    "p_max": "p_max [MPa]",
}


def compute_tables(solve: Solve | None = None, tell: Tell = nobody) -> dict[str, Any]:
    """Compute every printed row.

    By default every scene is solved anew, with the blocks of each table once.

    Returns
    -------
    dict[str, Any]
        ``rows``: of each number the printed value, the result with the paper's assumptions (None
        where no equilibrium exists), their relative difference, whether the result rounds to what
        is printed, and the result without the assumptions; ``classes``: kinematic class of each
        load case; how many numbers round to what is printed, of how many.
    """
    if solve is None:
        solve = SharedTubes().solve

    rows, classes = [], []
    tasks = [(block, case) for block, cases in reference()["table"].items() for case in cases]
    for number, (block, case) in enumerate(tasks):
        tell(f"{block} {case}, {number + 1} of {len(tasks)}", number, len(tasks))
        printed = reference()["table"][block][case]
        run = solve_row(solve, block, case)
        mechanism = str(run.details.mechanism)
        place = {"block": block, "case": case}
        classes.append(place | {"paper": printed["mechanism"], "ours": mechanism})
        if "p_max" in printed:
            # As physics says, only the shaft's load differs.
            physical = run
            if case == "shaft":
                physical = solve_row(solve, block, case, "load.as_printed=false")
            rows += [place | row for row in _rows(printed, run, physical)]
    met = sum(row["to_the_digit"] for row in rows)
    return {"to_the_digit": met, "of": len(rows), "rows": rows, "classes": classes}


def _rows(printed: dict[str, Any], run: Answer, physical: Answer) -> Iterator[dict[str, Any]]:
    read, measures = as_read(run.details.measures), physical.details.measures
    true = as_read(measures) | {"p_eff": None if measures is None else measures.p_eff}
    for quantity in DECIMALS:
        paper, ours = printed[quantity], read[quantity]
        yield {
            "quantity": quantity,
            "paper": paper,
            "ours": ours,
            "relative_difference": None if ours is None else (ours - paper) / paper,
            "to_the_digit": to_the_digit(quantity, paper, ours),
            "physical": true[quantity],
        }


def printed_number(quantity: str, value: float | None, more: int = 0) -> str:
    """Write a number with as many decimals as the paper prints, or some more."""
    return "no equilibrium" if value is None else f"{value:.{DECIMALS[quantity] + more}f}"


def count_words(tables: dict[str, Any]) -> str:
    """Say how many numbers and classes are met."""
    classes = tables["classes"]
    met = sum(row["paper"] == row["ours"] for row in classes)
    return (
        f"{tables['to_the_digit']} of {tables['of']} numbers to the last printed digit, "
        f"{met} of {len(classes)} mechanism classes"
    )


def lines_by_block(tables: dict[str, Any]) -> dict[str, list[dict[str, Any]]]:
    """All numbers and classes of each block in words, load case by load case."""
    by_block: dict[str, list[dict[str, Any]]] = {}
    for c in tables["classes"]:
        lines = by_block.setdefault(c["block"], [])
        same = c["paper"] == c["ours"]
        head = {"quantity": HEADS["mechanism"], "same": same, "difference": "", "physics": ""}
        lines.append(c | head)
        for row in tables["rows"]:
            if (row["block"], row["case"]) == (c["block"], c["case"]):
                off, q = row["relative_difference"], row["quantity"]
                words = {
                    "quantity": HEADS[q],
                    "paper": printed_number(q, row["paper"]),
                    "ours": printed_number(q, row["ours"], 2),
                    "difference": "" if off is None else f"{100 * off:+.1f} %",
                    "same": row["to_the_digit"],
                    "physics": printed_number(q, row["physical"], 2),
                }
                lines.append({"case": c["case"]} | words)
    return by_block
