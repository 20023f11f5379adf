"""Input decks in a folder: which are read and solved, which are rejected and why: ``--decks``.

Decks are read in this process; those that are read are solved by `tubelock deck --run` in one of
their own, which is stopped after ten CPU minutes. Beside the answer stands the largest displacement
that a reference file of CalculiX (``NAME.dat.ref``) prints at its end.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from fem import read_deck
from geometry.errors import RefusedError
from tests.verification.folder import ran

_TITLE = re.compile(r"displacements .*\n\n((?:\s*\d+(?:\s+\S+){3}\s*\n)+)")


def rows(folder: Path) -> Iterator[dict[str, Any]]:
    """One row for each deck in a folder and its folders."""
    for path in sorted(folder.rglob("*.inp")):
        yield {"deck": str(path.relative_to(folder)), **fate(path)}


def fate(path: Path) -> dict[str, Any]:
    """What becomes of a deck: rejected and why, read, or solved."""
    try:
        deck = read_deck(path)
        deck.validate()
    except RefusedError as error:
        why = str(error).removeprefix(f"{path}: ")
        return {"fate": "rejected", "why": why.partition("; expected")[0][:110]}
    found = ran("deck", str(path), "--run")
    moved = found.answer.get("measures", {}).get("max_displacement")
    return {
        "fate": "read, not solved" if moved is None else "solved",
        "why": found.error if moved is None else "; ".join(deck.model.notes)[:110],
        "u [mm]": None if moved is None else moved["value"],
        "±": None if moved is None else moved.get("error"),
        "CalculiX": largest_printed(path.with_name(f"{path.stem}.dat.ref")),
        "CPU s": found.cpu,
    }


def largest_printed(path: Path) -> float | None:
    """Largest displacement in the last table of a reference file [mm]; None: there is none."""
    tables = _TITLE.findall(path.read_text("latin-1")) if path.exists() else []
    if not tables:
        return None
    values = np.array([line.split()[1:4] for line in tables[-1].splitlines() if line.strip()])
    return float(np.linalg.norm(values.astype(np.float64), axis=1).max())
