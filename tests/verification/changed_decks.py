"""Random changes of valid decks: none ends in a fault; CalculiX judges those that are accepted.

``python -m tests.verification changed-decks``: each deck has one to three
changes of its lines. A deck that is read and solved is run by CalculiX on the changed text.
Verdicts are
*same* (largest displacement within `_SAME`), *other*, and *CalculiX rejects it*.
"""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from fem import solve_static
from fem.decks.read.deck import deck_of_lines
from fem.decks.read.words import Dialect
from geometry.errors import RefusedError
from tests.test_decks_read import CUBES, changed_lines

#: Relative difference of the largest displacement that counts as none: CalculiX presses at nodes
#: and has tension at open springs.
_SAME = 0.02


def verdict(lines: list[str], folder: Path) -> str:
    """How CalculiX judges a deck that is accepted."""
    from validation.study.comparison.calculix import run_calculix

    try:
        solved = solve_static(
            deck_of_lines(lines, dialect=Dialect.CALCULIX).problem(), mesh="scene", error_bars=False
        )
    except RefusedError:
        return "accepted, no equilibrium"
    path = folder / "changed.inp"
    path.write_text("\n".join([*lines, ""]), "utf-8")
    try:
        theirs = run_calculix(path).displacements
    except (RefusedError, RuntimeError, OSError, ValueError):
        return "CalculiX rejects it"
    ours, largest = solved["max_displacement"].value, np.linalg.norm(theirs, axis=1).max()
    return "same" if abs(ours - largest) <= _SAME * max(ours, largest) else "other"


def rows(
    decks: dict[str, list[str]] | None = None, *, count: int = 1000, judged: int = 40, seed: int = 1
) -> Iterator[Any]:
    """Number of each fate; the first deck of each that CalculiX answers otherwise is printed."""
    decks = {"cubes": CUBES} if decks is None else decks
    source, fates = random.Random(seed), Counter[str]()
    with TemporaryDirectory() as folder:
        for _ in range(count):
            name = source.choice(list(decks))
            lines = changed_lines(decks[name], source)
            try:
                deck = deck_of_lines(lines)
                deck.validate()
            except RefusedError:
                fates["rejected"] += 1
                continue
            except Exception as error:
                fates[f"fault: {type(error).__name__}: {error}"] += 1
                continue
            fates["accepted"] += 1
            if fates["accepted"] <= judged and not deck.steps[-1].explicit:
                fate = verdict(lines, Path(folder))
                fates[fate] += 1
                if fate == "other":
                    print(*_difference(decks[name], lines), sep="\n")
    for fate, number in fates.items():
        yield {"fate": fate, "decks": number}


def _difference(before: list[str], after: list[str]) -> Iterator[str]:
    import difflib

    yield "---"
    for line in difflib.ndiff(before, after):
        if line[0] in "+-":
            yield line
