"""Tables, statements, errata and the study of the paper as text."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from rich.console import Console
from rich.table import Table

from validation.output.console import listing, tabled
from validation.paper.reference import reference
from validation.paper.tables import HEADS, count_words, lines_by_block, printed_number
from validation.paper.verdict import Truth


def print_tables(tables: dict[str, Any], console: Console) -> None:
    """Print one table per block: every number on a line of its own, the count at the end."""
    columns: dict[str, str | Callable[[dict[str, Any]], str]] = {
        "load case": lambda row: row["case"] if row["quantity"] == HEADS["mechanism"] else "",
        "quantity": "{quantity}",
        "paper": "{paper}",
        "tubelock": "{ours}",
        "difference": "{difference}",
        "printed digits": lambda row: "yes" if row["same"] else "no",
        "consistent load": "{physics}",
    }
    for block, lines in lines_by_block(tables).items():
        console.print(tabled(f"{block}, with the paper's assumptions", lines, columns, words=2))
    console.print(count_words(tables))


def print_claims(claims: list[dict[str, Any]], console: Console) -> None:
    """Print one row per claim and a count."""
    columns = {
        "claim": "{name}",
        "the paper says": "{statement}",
        "verdict": "{verdict}",
        "number": "{number}",
    }
    console.print(tabled("The paper's claims", claims, columns, words=4, show_lines=True))
    counts = [f"{sum(row['verdict'] == t for row in claims)} {t}" for t in Truth]
    console.print(f"{len(claims)} claims: {', '.join(counts)}")


def print_errata(errata: list[dict[str, Any]], console: Console) -> None:
    """Print each erratum with what shows it."""
    for row in errata:
        table = listing(row["name"], "", "", show_header=False)
        for key in ("printed", "meant", "shown", "command"):
            if row[key]:
                table.add_row(key, row[key])
        console.print(table)
    without = [row for row in errata if "without" in row["values"]]
    if without:
        console.print(_sensitivity_table(without))


def _sensitivity_table(errata: list[dict[str, Any]]) -> Table:
    """One line a number: its error, and the error without each ingredient that moves it."""
    title = "Errors of the tables' numbers [%], and without an ingredient where that moves them"
    heads = ("printed", "error", *(row["name"].replace("-", " ") for row in errata))
    table = listing(title, "number", numbers=heads, padding=0)
    table.columns[0].no_wrap = True
    whole = errata[0]["values"]["with"]
    table.add_row("printed digits matched", "", *_counts(errata))
    for place, error in whole["differences"].items():
        block, case, quantity = place.split()
        moved = [row["values"]["moved"].get(place) for row in errata]
        table.add_row(
            place,
            printed_number(quantity, reference()["table"][block][case][quantity]),
            f"{100 * error:+.1f}",
            *("" if other is None else f"{100 * other:+.1f}" for other in moved),
        )
    return table


def _counts(errata: list[dict[str, Any]]) -> list[str]:
    values = [errata[0]["values"]["with"], *(row["values"]["without"] for row in errata)]
    return [f"{v['to_the_digit']}/{v['of']}" for v in values]


def print_deformable_study(data: Mapping[str, Any], console: Console) -> None:
    """Print verdicts, effects of parameters and rank correlations."""
    heads = list(dict.fromkeys(row["measure"] for row in data["claims"]))
    table = listing("The paper's geometric claims", "claim", *heads, show_lines=True)
    for name in dict.fromkeys(row["claim"] for row in data["claims"]):
        rows = [row for row in data["claims"] if row["claim"] == name]
        table.add_row(
            f"{name}: {rows[0]['statement']}", *(f"{r['verdict']}: {r['number']}" for r in rows)
        )
    console.print(table)
    columns = {head: f"{{{head}}}" for head in data["effects"][0]}
    columns["mean ratio"] = "{mean ratio:.3f}"
    title = "Change by one step of each parameter (deformable: beyond the error bars)"
    console.print(tabled(title, data["effects"], columns, words=2))
    ranks = data["rank_correlations"]
    columns = {"measure": "{measure}"} | {
        row["measure"]: f"{{{row['measure']}:.2f}}" for row in ranks
    }
    console.print(tabled("Spearman's rank correlation", ranks, columns))
    console.print(data["scope"])
    for *key, why in data["unresolved"]:
        console.print(f"not resolved: s, f, n, t, a = {key}: {why}")
