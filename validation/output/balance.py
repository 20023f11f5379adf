"""Rows of reactions and of the balance of blocks, the same for all methods."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.table import Table

from geometry.balance import reaction_rows

#: Change of the joint forces by a search at the end above which it is printed [-].
_SEARCHED = 1e-3


def add_reactions(table: Table, report: Mapping[str, Any]) -> None:
    """Add force, point and horizontal part of each support, and what balances of blocks leave."""
    for k, row in enumerate(reaction_rows(report.get("reactions", {}))):
        table.add_row("" if k else "reactions", row)
    if "imbalance" in report:
        left = report["imbalance"]
        words = f"force {left['force']:.1e}, moment {left['moment']:.1e} of the largest joint force"
        table.add_row("largest imbalance of a block", words)


def add_search(table: Table, report: Mapping[str, Any], bar: float) -> None:
    """Add what a search at the end changes, where that is much, or more than a bar [-]."""
    change = report.get("search_change")
    if change is not None and change > min(_SEARCHED, bar):
        words = f"a search at the end changes joint forces by {100 * change:.2g} % of the largest"
        table.add_row("contact search, repeated", words)
