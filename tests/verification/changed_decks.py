"""Random changes of valid decks: none ends in a fault; CalculiX judges those that are accepted.

``python -m tests.verification changed-decks``: each deck has one to three
changes of its lines. A deck that is read and solved is run by CalculiX on the changed text.
Verdicts are
*same* (displacements of all nodes within `_SAME`), *other*, and *CalculiX rejects it*.
"""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from fem import Static, solve_static
from fem.decks.read.deck import deck_of_lines
from fem.decks.read.words import Dialect
from geometry import RefusedError
from tests.support.ccx import CalculixError
from tests.support.cubes_deck import CUBES, changed, changed_lines
from tests.support.decks import written_again
from tests.verification.deck_oracle import deck_nodes, difference, original, ours
from tests.verification.deck_press_fit import block

#: Relative difference of displacements that counts as none: CalculiX presses at nodes and has
#: tension at open springs.
_SAME = 0.02
#: Displacements that count as none [mm].
_NONE = 1e-12


def verdict(lines: list[str], folder: Path) -> str:
    """How CalculiX judges a deck that is accepted."""
    deck = deck_of_lines(lines, dialect=Dialect.CALCULIX)
    try:
        answer = solve_static(deck.problem(), Static(mesh="scene", error_estimate=False))
    except RefusedError:
        return "accepted, no equilibrium"
    path = folder / "changed.inp"
    path.write_text("\n".join([*lines, ""]), "utf-8")
    nodes = deck_nodes(deck)
    moved = ours(nodes, answer)
    try:
        theirs = original(nodes, path).displacements
    except (CalculixError, OSError, ValueError) as error:
        return f"CalculiX rejects it: {str(error).partition(': ')[2]}"
    both_none = max(np.abs(moved).max(), np.abs(theirs).max()) < _NONE
    return "same" if both_none or difference(moved, theirs) <= 100.0 * _SAME else "other"


def _decks() -> dict[str, list[str]]:
    """Cubes as they are, with friction, in two steps, pushed and written again."""
    second = "*End Step\n*Step\n*Static\n*Dload\nUPPER, P2, 1.\n*End Step"
    return {
        "cubes": CUBES,
        "with friction": changed("500.\n", "500.\n*Friction\n0.2, 5000.\n"),
        "two steps": changed("*End Step", second),
        "pushed with friction": block(6),
        "written again": written_again(deck_of_lines(CUBES)),
    }


def rows(
    decks: dict[str, list[str]] | None = None,
    *,
    count: int = 10_000,
    judged: int = 200,
    seed: int = 1,
) -> Iterator[Any]:
    """Number of each fate; the first deck of each that CalculiX answers otherwise is printed."""
    decks = _decks() if decks is None else decks
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
                if fate not in {"same", "accepted, no equilibrium"}:
                    print(f"{name}, {fate}", *_difference(decks[name], lines), sep="\n")
    for fate, number in fates.items():
        yield {"fate": fate, "decks": number}


def _difference(before: list[str], after: list[str]) -> Iterator[str]:
    import difflib

    yield "---"
    for line in difflib.ndiff(before, after):
        if line[0] in "+-":
            yield line
