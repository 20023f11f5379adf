"""Numbers of docs/trust/other-codes.md: ``python -m tests.verification [NAME ...] [--json FILE]``.

Without names all tables but the long ones, four CPU minutes; CalculiX and compas_cra where they
are installed. ``error-bars`` takes an hour, goes on where it was stopped, gives up a problem after
ten CPU minutes, and keeps what ``error-bars-problems`` lists and ``error-bars-summary`` sums up.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from tests.verification import (
    calculix,
    deck_dialects,
    error_bars,
    friction_pairs,
    macneal_harder,
    test_friction,
    test_masonry,
    test_optimiser,
)

Row = Mapping[str, Any]
TABLES: dict[str, tuple[str, Callable[[], Iterable[Row]]]] = {
    "closed-forms": ("Limit analysis beside closed forms", test_masonry.closed_forms),
    "printed": ("Rigid blocks with friction: numbers of others", test_masonry.printed),
    "compas": ("Walls and arches under their weight, one core", test_masonry.peers),
    "calculix": ("CalculiX against tubelock", calculix.rows),
    "friction-pairs": ("More friction never carries less", friction_pairs.rows),
    "friction": ("Friction: static against explicit", test_friction.rows),
    "deck-dialects": ("Decks in fifty ways, beside CalculiX", deck_dialects.rows),
    "macneal-harder": ("Beams of MacNeal and Harder over theory", macneal_harder.beams),
    "le10": ("NAFEMS LE10 from a deck of C3D20", macneal_harder.plate),
    "optimiser": ("Searches of 48 among 480 designs", test_optimiser.rows),
    "error-bars": ("Error bars of drawn problems", error_bars.rows),
    "error-bars-problems": ("Each problem with its reference", error_bars.problems),
    "error-bars-summary": ("Error bars: how many hold, how wide they are", error_bars.summary),
}
#: Tables that are made where they are named.
LONG = ("error-bars", "error-bars-problems", "error-bars-summary")


def word(value: Any) -> str:
    """A cell."""
    return "" if value is None else f"{value:.6g}" if isinstance(value, float) else str(value)


def table(title: str, rows: list[Row]) -> Table:
    """All rows under the union of their heads, in the order in which these appear."""
    found = Table(title=title, title_justify="left")
    heads = list(dict.fromkeys(head for row in rows for head in row))
    for head in heads:
        found.add_column(head)
    for row in rows:
        found.add_row(*(word(row.get(head)) for head in heads))
    return found


def main() -> None:
    """Print tables as they are made."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(TABLES))
    parser.add_argument("--json", type=Path, metavar="FILE")
    asked = parser.parse_args()
    unknown = [name for name in asked.names if name not in TABLES]
    if unknown:
        parser.error(f"{unknown[0]}: expected {', '.join(TABLES)}")
    console, found = Console(width=180, markup=False), {}
    for name in asked.names or [name for name in TABLES if name not in LONG]:
        title, make = TABLES[name]
        found[name] = list(make())
        console.print(table(title, found[name]) if found[name] else f"{title}: not installed")
    if asked.json is not None:
        asked.json.write_text(json.dumps(found, indent=1, default=float), "utf-8")


if __name__ == "__main__":
    main()
