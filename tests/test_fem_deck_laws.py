"""A contact law that decks do not know is rejected by name, not exported as another one."""

from __future__ import annotations

import pytest

from fem.contact.law import ExponentialLaw, LawConstants, LinearPenalty
from fem.decks.keywords import DeckError
from fem.decks.laws import law_heading, law_lines, law_notes, law_table


def static_notes(law) -> list[str]:  # type: ignore[no-untyped-def]
    return law_notes(law, static=True)


class Own(ExponentialLaw.__mro__[1]):  # type: ignore[misc]
    """A law as CONTRIBUTING describes it: a name and constants."""

    name = "own"

    @property
    def constants(self) -> LawConstants:
        return LawConstants(0.0, 1.0, 0.0, 0.0, 0.0, 5.0, 0.0)


@pytest.mark.parametrize("written", [law_heading, static_notes, law_table])
def test_a_law_without_deck_lines_is_rejected_by_name(written) -> None:  # type: ignore[no-untyped-def]
    assert float(Own().pressure(2.0)) == 10.0
    with pytest.raises(DeckError, match=r"contact.law: got 'own'.*expected 'exponential'"):
        written(Own())
    for known in (ExponentialLaw(), LinearPenalty(3.0)):
        written(known)


def test_neither_flavour_takes_it_for_the_exponential_law() -> None:
    for explicit in (True, False):
        with pytest.raises(DeckError, match="'own'"):
            law_lines(Own(), explicit=explicit)  # type: ignore[arg-type]
