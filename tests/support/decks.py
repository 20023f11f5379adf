"""Input decks as a person writes them, and their answers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from fem import Explicit, solve_explicit, solve_static
from fem.decks.deck import Flavour
from fem.decks.problem import deck_lines, problem_deck
from fem.decks.read.deck import InputDeck
from geometry import Answer
from tests.support.commands import command, set_words


def exported(
    path: Path, scene: str | Path, settings: Sequence[str] = (), *, flavour: str | None = None
) -> Path:
    """The deck that ``tubelock export`` writes."""
    words = ["export", str(scene), "-o", str(path)]
    words += set_words(settings)
    words += [] if flavour is None else ["--flavour", flavour]
    status, _, said = command(*words)
    assert status == 0, said
    return path


def solved(deck: InputDeck) -> Answer:
    """Answer of a deck on its own mesh, by the method of its step."""
    problem, method = deck.problem(), deck.method
    if isinstance(method, Explicit):
        return solve_explicit(problem, method)
    return solve_static(problem, method)


def written_again(deck: InputDeck, flavour: Flavour | None = None) -> list[str]:
    """Lines of the problem of a deck, by default for its program."""
    return list(deck_lines(problem_deck(deck.problem(), flavour or deck.flavour, deck.method)))
