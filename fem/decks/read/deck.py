"""Read back what `fem.decks.abaqus` writes.

The reader takes from the cards what a `Deck` holds, then writes the deck anew and compares: a
card that would not come out again is refused by its line, so nothing is dropped silently.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import zip_longest

from fem.contact.law import ContactLawError
from fem.decks.abaqus import abaqus_lines
from fem.decks.keywords import DeckError
from fem.decks.read.cards import (
    Card,
    Heading,
    Sections,
    heading_value,
    read_cards,
    read_heading,
    split_sections,
)
from fem.decks.read.model import (
    read_effects,
    read_holds,
    read_joint,
    read_loads,
    read_materials,
    read_motion,
    read_step,
)
from fem.decks.read.parts import read_assembly, read_part
from fem.decks.statement import Deck, Flavour
from fem.element.material import Material, MaterialError
from fem.problem.effects import EffectError
from geometry.assembly import AssemblyError
from geometry.mesh import MeshError

#: Keywords that are read; everything else is refused by name.
SUPPORTED = (
    *("HEADING", "PART", "NODE", "ELEMENT", "NSET", "ELSET", "SURFACE", "SOLID SECTION"),
    *("END PART", "ASSEMBLY", "INSTANCE", "END INSTANCE", "ORIENTATION", "END ASSEMBLY"),
    *("SECTION CONTROLS", "MATERIAL", "DENSITY", "ELASTIC", "DAMPING", "SURFACE INTERACTION"),
    *("SURFACE BEHAVIOR", "FRICTION", "AMPLITUDE", "INITIAL CONDITIONS", "CONTACT"),
    *("CONTACT INCLUSIONS", "CONTACT PROPERTY ASSIGNMENT", "CONTACT PAIR", "CLEARANCE"),
    *("CONTACT CLEARANCE", "CONTACT CLEARANCE ASSIGNMENT", "FIXED MASS SCALING"),
    *("BOUNDARY", "STEP", "STATIC", "DYNAMIC", "BULK VISCOSITY", "DSLOAD", "DLOAD", "CLOAD"),
    *("OUTPUT", "NODE OUTPUT", "ELEMENT OUTPUT", "CONTACT OUTPUT", "ENERGY OUTPUT", "END STEP"),
)


def read_deck(lines: Iterable[str]) -> Deck:
    """Read a deck of flavour general or pairs.

    Parameters
    ----------
    lines
        Of the file, without or with line ends.

    Raises
    ------
    DeckError
        Naming the line: a keyword that is not read, a value that makes no sense, a file that
        ends early, or anything that would be lost.
    """
    cards = read_cards(lines)
    heading = read_heading(cards)
    _check_keywords(cards)
    _check_complete(cards)
    try:
        deck = _build(cards, heading)
        _check_nothing_lost(cards, deck)
    except (MeshError, MaterialError, EffectError, ContactLawError, AssemblyError) as error:
        raise DeckError(str(error)) from None
    return deck


def _check_keywords(cards: list[Card]) -> None:
    for card in cards:
        if card.keyword not in SUPPORTED:
            raise DeckError(
                f"line {card.line}: *{card.keyword.title()} is not supported; import reads the "
                "keywords that `export` writes"
            )


def _check_complete(cards: list[Card]) -> None:
    """Refuse a file that ends early."""
    open_at: list[Card] = []
    for card in cards:
        if card.keyword in {"PART", "ASSEMBLY", "INSTANCE", "STEP"}:
            open_at.append(card)
        elif card.keyword.startswith("END "):
            if not open_at or card.keyword != f"END {open_at[-1].keyword}":
                raise DeckError(f"line {card.line}: *{card.keyword.title()} ends nothing")
            open_at.pop()
    last = cards[-1].data_line[-1] if cards[-1].data_line else cards[-1].line
    if open_at:
        start = open_at[-1]
        name = start.parameters.get("NAME", "")
        raise DeckError(
            f"line {last}: the file ends inside *{start.keyword.title()} {name} (line "
            f"{start.line}); expected *End {start.keyword.title()}: the file is truncated"
        )
    if cards[-1].keyword != "END STEP":
        raise DeckError(f"line {last}: the file ends without a step: it is truncated")


def _build(cards: list[Card], heading: Heading) -> Deck:
    sections = split_sections(cards)
    parts = [read_part(part) for part in sections.parts]
    if not parts or not sections.assembly:
        raise DeckError(f"line {cards[-1].line}: the deck has no part or no assembly")
    shapes = {shape.name: shape for shape, _ in parts}
    elements = {element for _, element in parts}
    if len(elements) != 1:
        raise DeckError(f"line {sections.parts[-1][0].line}: parts have different elements")
    assembly, blocks = read_assembly(sections.assembly, shapes, heading)
    behavior = next(iter(sections.all("SURFACE BEHAVIOR")), None)  # of all joints the same
    return Deck(
        name=heading.name,
        flavour=Flavour(heading.values["flavour"]),
        assembly=assembly,
        material=_of_parts(sections),
        element=elements.pop(),
        step=read_step(sections),
        holds=tuple(read_holds(sections, blocks)),
        loads=tuple(read_loads(sections, blocks)),
        joint=None if behavior is None else read_joint(sections, behavior, heading, blocks),
        effects=read_effects(sections),
        motion=read_motion(sections),
        clearance=float(heading_value(heading, "clearance along every normal", 1)[0]),
        spacing=float(heading_value(heading, "spacing of the blocks", 1)[0]),
        searched="joints" in heading.values,
        notes=tuple(heading.notes),
    )


def _of_parts(sections: Sections) -> Material | tuple[Material, ...]:
    """Material of all parts, or of each one."""
    known = read_materials(sections)
    found = []
    for part in sections.parts:
        card = next((card for card in part if card.keyword == "SOLID SECTION"), part[0])
        name = card.parameter("MATERIAL").upper()
        if name not in known:
            raise DeckError(f"line {card.line}: got material {name}; expected {', '.join(known)}")
        found.append(known[name])
    return found[0] if len(known) == 1 else tuple(found)


def _check_nothing_lost(cards: list[Card], deck: Deck) -> None:
    """Write the deck anew and compare, card by card."""
    again = read_cards(abaqus_lines(deck))
    for card, other in zip_longest(cards, again):
        if card is None:
            missing = other.keyword.title()
            raise DeckError(f"line {cards[-1].line}: the deck has no *{missing} where one belongs")
        if other is None or card.keyword != other.keyword:
            expected = "nothing more" if other is None else f"*{other.keyword.title()}"
            raise DeckError(
                f"line {card.line}: *{card.keyword.title()} is not supported here, it would be "
                f"lost; expected {expected}, as `export` writes it"
            )
        _compare(card, other)


def _compare(card: Card, other: Card) -> None:
    if _parameters(card) != _parameters(other):
        raise DeckError(
            f"line {card.line}: *{card.keyword.title()} has the parameters {_parameters(card)}; "
            f"import would keep {_parameters(other)}"
        )
    first = 1 if card.keyword == "HEADING" else 0
    pairs = zip_longest(card.data[first:], other.data[first:], fillvalue="")
    for position, (text, kept) in enumerate(pairs, start=first):
        if text != kept and _normal(text) != _normal(kept):
            line = card.data_line[position] if position < len(card.data) else card.line
            raise DeckError(
                f"line {line}: got {text[:60]!r} under *{card.keyword.title()}; import would keep "
                f"{kept[:60]!r}"
            )


def _parameters(card: Card) -> dict[str, str]:
    return {name: " ".join(_normal(value)) for name, value in sorted(card.parameters.items())}


def _normal(text: str) -> list[str]:
    """Entries with numbers in one spelling and labels in upper case."""
    result = []
    for entry in text.split(","):
        word = entry.strip().upper()
        try:
            result.append(repr(float(word)))
        except ValueError:
            result.append(word)
    while result and not result[-1]:
        result.pop()
    return result
