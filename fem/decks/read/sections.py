"""Cards of a deck by where they stand, and what its heading says."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from fem.decks.keywords import DeckError
from fem.decks.read.cards import Card, numbers
from fem.decks.statement import Flavour
from geometry.mesh import FloatArray


@dataclass
class Heading:
    """What the heading says."""

    name: str
    values: dict[str, str] = field(default_factory=dict)
    places: list[FloatArray] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def read_heading(cards: list[Card]) -> Heading:
    """Read the heading of a deck that `export` wrote.

    Raises
    ------
    DeckError
        For another heading, or a deck for CalculiX.
    """
    first = cards[0] if cards else Card(1, "", {})
    match = re.match(r"tubelock \S+, scene (.*)", first.data[0]) if first.data else None
    if first.keyword != "HEADING" or match is None:
        raise DeckError(
            f"line {first.line}: this deck was not written by `export` (its heading would say "
            "so); import reads those decks, and files with a mesh alone"
        )
    heading = Heading(match.group(1))
    for number, text in zip(first.data_line[1:], first.data[1:], strict=True):
        key, colon, value = text.partition(": ")
        if not colon:
            raise DeckError(f"line {number}: got {text[:40]!r}, expected a line 'name: value'")
        if key == "note":
            heading.notes.append(value)
        elif key == "place without spacing":
            heading.places.append(numbers(number, value.partition(" ")[2], 3))
        else:
            heading.values[key] = value
    if heading.values.get("flavour") not in {Flavour.GENERAL, Flavour.PAIRS}:
        raise DeckError(
            f"line {first.line}: got a deck of flavour {heading.values.get('flavour')}; expected "
            "general or pairs: a CalculiX deck has lost instances and load definitions, import "
            "the general deck of the same scene"
        )
    return heading


def heading_value(heading: Heading, key: str, count: int, part: int = 0) -> FloatArray:
    """Numbers of a heading line, of the part before or after "through"."""
    if key not in heading.values:
        raise DeckError(f"line 1: the heading has no line '{key}: …'")
    return numbers(1, heading.values[key].split(" through ")[part], count)


@dataclass
class Sections:
    """Cards by where they stand."""

    parts: list[list[Card]] = field(default_factory=list)
    assembly: list[Card] = field(default_factory=list)
    model: list[Card] = field(default_factory=list)
    step: list[Card] = field(default_factory=list)

    def all(self, keyword: str) -> list[Card]:
        """Cards of the model and the step with a keyword."""
        return [card for card in self.model + self.step if card.keyword == keyword]

    def one(self, keyword: str) -> Card:
        """The only card with a keyword."""
        found = self.all(keyword)
        if len(found) != 1:
            where = f"line {found[1].line}: " if found else ""
            raise DeckError(f"{where}got {len(found)} cards *{keyword.title()}, expected one")
        return found[0]

    def maybe(self, keyword: str) -> Card | None:
        """The only card with a keyword, if there is one."""
        return self.one(keyword) if self.all(keyword) else None


def split_sections(cards: list[Card]) -> Sections:
    """Sort the cards after the heading by where they stand."""
    sections = Sections()
    current = sections.model
    for card in cards[1:]:
        if card.keyword == "PART":
            current = []
            sections.parts.append(current)
        elif card.keyword == "ASSEMBLY":
            current = sections.assembly
        elif card.keyword == "STEP":
            current = sections.step
        current.append(card)
        if card.keyword in {"END PART", "END ASSEMBLY"}:
            current = sections.model
    return sections


def block_entry(line: int, entry: str, blocks: dict[str, int]) -> tuple[int, str]:
    """Block and label of an entry ``INSTANCE.LABEL``."""
    instance, dot, rest = entry.upper().partition(".")
    if not dot or instance not in blocks:
        raise DeckError(
            f"line {line}: got {entry!r}, which names no instance; expected INSTANCE.SET"
        )
    return blocks[instance], rest
