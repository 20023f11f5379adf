"""Write a deck to a file, in the words of the program it is for."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from fem.decks.abaqus import abaqus_lines
from fem.decks.calculix import calculix_lines
from fem.decks.deck import Deck


def deck_lines(deck: Deck) -> Iterator[str]:
    """Lines of a deck; the same deck gives the same lines.

    Parameters
    ----------
    deck
        The problem; its assembly must be canonical (`fem.decks.placement.canonical`).

    Raises
    ------
    DeckError
        What the program has no words for, by name; while the lines are made, not before.
    """
    return calculix_lines(deck) if deck.is_flat else abaqus_lines(deck)


def write_deck_file(path: Path, deck: Deck) -> dict[str, int]:
    """Write a deck; give a temporary path and rename it when whole.

    Returns
    -------
    dict[str, int]
        How often each keyword was written, in the order of first use.

    Raises
    ------
    DeckError
        As `deck_lines`; the file is then not whole.
    """
    keywords: dict[str, int] = {}
    with path.open("w", encoding="ascii", newline="\n") as file:
        for line in deck_lines(deck):
            file.write(line)
            file.write("\n")
            if line.startswith("*") and not line.startswith("**"):
                word = line.partition(",")[0]
                keywords[word] = keywords.get(word, 0) + 1
    return keywords
