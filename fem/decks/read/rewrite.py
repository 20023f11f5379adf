"""A deck that was read, as one that this package writes."""

from __future__ import annotations

from dataclasses import replace

from fem.decks.problem import (
    canonical_deck,
    contact_notes,
    element_time_step,
    with_notes,
    with_time_step,
)
from fem.decks.read.deck import InputDeck
from fem.decks.read.model import effects_of
from fem.decks.read.words import Dialect
from fem.decks.statement import Deck, DeckStep, Flavour, Procedure
from fem.decks.tetrahedra import with_tetrahedra
from fem.system.effects import Effects

#: Share of the critical time step that an explicit step for CalculiX takes: its scheme is 10 % off
#: at 0.9 of it in a beam under a load at once, 0.2 % at a quarter.
_SHARE = 0.25


def rewritten(deck: InputDeck, flavour: Flavour | None = None) -> Deck:
    """State the problem of a deck for a program, by default the one that it is for.

    Raises
    ------
    RefusedError
        What is not covered, or what the program has no words for.
    """
    step, problem = deck.steps[-1], deck.problem()
    if flavour is None and deck.dialect is Dialect.CALCULIX:
        flavour = Flavour.CALCULIX
    flavour = flavour or (Flavour.GENERAL if step.explicit else Flavour.STANDARD)
    on_faces = flavour is Flavour.CALCULIX and deck.built.face_to_face
    procedure = Procedure.EXPLICIT if step.explicit else Procedure.STATIC
    result = canonical_deck(
        problem,
        flavour,
        DeckStep(
            procedure,
            step.end,
            deck.built.ramp_time or 0.0,
            large_rotations=step.large_rotations,
        ),
        effects_of(deck.model, deck.steps[0]) if step.explicit else Effects(),
        on_faces=on_faces,
    )
    reduced = any(one.part.kind == "C3D20R" for one in deck.places.instances)
    result = replace(result, reduced=reduced)
    if on_faces and result.joint is not None:
        result = replace(result, joint=replace(result.joint, face_to_face=True))
    result, notes = with_tetrahedra(result)
    if deck.built.mass_scaling is not None:
        scaled = deck.built.mass_scaling * element_time_step(result, moving=True)
        result = replace(result, step=replace(result.step, scaled_time_step=scaled))
    if flavour is Flavour.CALCULIX and step.explicit:
        result = with_time_step(result, _SHARE)
    notes += [*contact_notes(result, static=not step.explicit), *deck.model.notes]
    return with_notes(result, notes)
