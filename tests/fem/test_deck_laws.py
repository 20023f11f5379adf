"""Laws of decks: their contact law, what they name, what they hold, how long their lines are."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fem import ExponentialLaw, LinearPenalty
from fem.contact.law import LawConstants
from fem.decks.deck import Deck, Flavour
from fem.decks.faces import contact_patches, facing_faces
from fem.decks.keywords import ENTRIES_PER_LINE, LINE_LENGTH, DeckError, entry_lines
from fem.decks.laws import law_heading, law_lines, law_notes, law_table
from fem.decks.problem import problem_deck
from fem.method import Explicit
from fem.system.time_step import characteristic_time_step
from tests.support.coarse_tubes import coarse
from validation import load_case

pytestmark = pytest.mark.quick


def static_notes(law) -> list[str]:  # type: ignore[no-untyped-def]
    return law_notes(law, static=True)


class Own(ExponentialLaw.__mro__[1]):  # type: ignore[misc]
    """A law as CONTRIBUTING describes it: a name and constants."""

    name = "own"

    @property
    def constants(self) -> LawConstants:
        return LawConstants(0.0, 1.0, 0.0, 0.0, 0.0, 5.0, 0.0)


@pytest.mark.parametrize(
    "written",
    [
        *(law_heading, static_notes, law_table),
        *(partial(law_lines, explicit=explicit) for explicit in (True, False)),
    ],
)
def test_a_law_without_deck_lines_is_rejected_by_name(written) -> None:  # type: ignore[no-untyped-def]
    assert float(Own().pressure(2.0)) == 10.0
    with pytest.raises(DeckError, match=r"contact.law: got 'own'.*expected 'exponential'"):
        written(Own())
    for known in (ExponentialLaw(), LinearPenalty(3.0)):
        written(known)


def tube_deck(flavour: Flavour, *keys: str) -> Deck:
    return problem_deck(load_case("tsb1-pipe", [*coarse(1, 2), *keys]).problem, flavour)


@given(lengths=st.lists(st.integers(1, 80), max_size=60))
@settings(max_examples=50, deadline=None)
def test_lists_keep_their_entries_on_lines_that_programs_read(lengths: list[int]) -> None:
    entries = ["x" * length for length in lengths]
    lines = list(entry_lines(entries))
    assert [word for line in lines for word in line.split(", ")] == entries
    assert all(len(line) <= LINE_LENGTH for line in lines)
    assert all(line.count(",") < ENTRIES_PER_LINE for line in lines)


def test_fixed_blocks_have_no_contact_with_each_other() -> None:
    """Whether facets match or whole faces are paired: 20 pairs, each with a block that deforms."""
    deck = tube_deck(Flavour.STANDARD)
    held = set(np.flatnonzero(~deck.problem.deforming).tolist())
    matched, whole = (
        {frozenset((pair.block_m, pair.block_s)) for pair in pairs}
        for pairs in (contact_patches(deck).pairs, facing_faces(deck))
    )
    assert matched == whole
    assert len(matched) == 20
    assert not any(pair <= held for pair in matched)


def test_the_time_step_of_elements_knows_bulk_viscosity_where_there_is_one() -> None:
    """Without it, the least over elements; with it, times √(1 + b²) − b."""
    viscous = tube_deck(Flavour.GENERAL)
    plain = replace(viscous, method=Explicit(end_time=1.0))
    least = min(
        characteristic_time_step(shape.mesh, plain.materials[0], linear_bulk_viscosity=0.0)
        for shape in plain.assembly.shapes
    )
    assert plain.element_time_step() == least
    assert viscous.effects.bulk_viscosity is not None
    b = viscous.effects.bulk_viscosity.linear_bulk_viscosity
    assert viscous.element_time_step() == pytest.approx(((1 + b**2) ** 0.5 - b) * least, rel=1e-12)
