"""Laws of decks: their contact law, what they name, what they hold, how long their lines are."""

from __future__ import annotations

import re
from dataclasses import replace

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
from fem.decks.read.deck import deck_of_lines
from fem.decks.write import deck_lines
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


@pytest.mark.parametrize("flavour", [Flavour.STANDARD, Flavour.CALCULIX])
@pytest.mark.parametrize("sliding", ["false", "true"])
def test_decks_define_the_surfaces_that_they_name(flavour: Flavour, sliding: str) -> None:
    """Those of contact pairs and of pressures; no pair of two fixed blocks."""
    deck = tube_deck(flavour, f"effects.finite_sliding={sliding}")
    lines = list(deck_lines(deck))
    defined = {m[1] for line in lines if (m := re.match(r"\*Surface, .*name=([^,]+)", line))}
    part = {line.split("name=")[1].split(",")[0] for line in lines if line.startswith("*Instance")}
    named = set()
    for at, line in enumerate(lines):
        if line.startswith("*Contact Pair"):
            named |= set(lines[at + 1].split(", "))
        if line.startswith("*Dsload"):
            named |= {loaded.split(",")[0] for loaded in lines[at + 1 : at + 5]}
    # Surfaces of a part are named through its instances.
    assert {name.split(".")[-1] if part else name for name in named} <= defined
    held = set(np.flatnonzero(~deck.problem.deforming).tolist())
    found = []
    for pairs in (contact_patches(deck).pairs, facing_faces(deck)):  # that match, whole faces
        found.append({frozenset((pair.block_m, pair.block_s)) for pair in pairs})
        assert not any(pair <= held for pair in found[-1])
    assert found[0] == found[1]
    assert len(found[0]) == 20


def test_fixed_blocks_are_held_in_every_direction() -> None:
    for flavour in Flavour:
        lines = list(deck_lines(tube_deck(flavour)))
        at = lines.index("*Boundary")
        assert lines[at + 1] == "FRAME, 1, 3"
        read = deck_of_lines(lines).problem().load_case.fixed
        np.testing.assert_array_equal(read, tube_deck(flavour).assembly.fixed)


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
