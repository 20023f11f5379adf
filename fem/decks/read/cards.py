"""Split the text of a deck into cards, keyword lines with their data lines, by where they stand."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np

from fem.decks.keywords import DeckError
from fem.decks.statement import Flavour
from geometry.mesh import FloatArray


@dataclass(frozen=True)
class Card:
    """A keyword line with its data lines; comments and empty lines are left out."""

    line: int
    """Number of the keyword line in the file, from 1."""
    keyword: str
    """Upper case, without the asterisk."""
    parameters: dict[str, str]
    """Names in upper case; the value is empty where none was given."""
    data: list[str] = field(default_factory=list)
    """Data lines as they stand."""
    data_line: list[int] = field(default_factory=list)
    """Their numbers in the file."""

    def parameter(self, name: str) -> str:
        """Value of a parameter.

        Raises
        ------
        DeckError
            When it is missing.
        """
        if not self.parameters.get(name):
            raise DeckError(f"line {self.line}: *{self.keyword.title()} needs {name.lower()}=")
        return self.parameters[name]

    def rows(self) -> Iterator[tuple[int, list[str]]]:
        """Line number and fields of each data line."""
        for number, text in zip(self.data_line, self.data, strict=True):
            yield number, fields(text)

    def table(self, columns: int) -> FloatArray:
        """Data lines as numbers, (n_lines, columns).

        Raises
        ------
        DeckError
            Naming the first line that has not that many numbers.
        """
        entries = ",".join(self.data).split(",")
        if self.data and len(entries) == columns * len(self.data):
            try:
                return np.array(entries, dtype=np.float64).reshape(-1, columns)
            except ValueError:
                pass
        rows = [_row(number, text, columns, self.keyword) for number, text in self.rows()]
        return np.array(rows, dtype=np.float64).reshape(-1, columns)

    def numbers(self) -> FloatArray:
        """The numbers of the only data line."""
        if len(self.data) != 1:
            raise DeckError(
                f"line {self.line}: *{self.keyword.title()} has {len(self.data)} data lines; "
                "expected one"
            )
        entries = [e for e in fields(self.data[0]) if e]
        row = _row(self.data_line[0], entries, len(entries), self.keyword)
        return np.array(row, dtype=np.float64)


def fields(text: str) -> list[str]:
    """Entries of a data line, without the comma that may end it."""
    entries = [entry.strip() for entry in text.split(",")]
    if len(entries) > 1 and not entries[-1]:
        entries.pop()
    return entries


def _row(number: int, entries: list[str], columns: int, word: str) -> list[float]:
    """Numbers of one data line."""
    if len(entries) != columns:
        raise DeckError(
            f"line {number}: got {len(entries)} entries under *{word.title()}, expected {columns}"
        )
    row = []
    for entry in entries:
        try:
            value = float(entry)
        except ValueError:
            raise DeckError(f"line {number}: got {entry!r}, expected a number") from None
        if not np.isfinite(value):
            raise DeckError(f"line {number}: got {entry!r}, expected a finite number")
        row.append(value)
    return row


def read_cards(lines: Iterable[str]) -> list[Card]:
    """Split a deck into cards.

    Raises
    ------
    DeckError
        A data line before the first keyword, or a keyword line that is none.
    """
    cards: list[Card] = []
    for number, raw in enumerate(lines, start=1):
        text = raw.strip()
        if not text or text.startswith("**"):
            continue
        if text.startswith("*"):
            cards.append(_keyword_card(number, text))
        elif not cards:
            raise DeckError(
                f"line {number}: got {text[:40]!r}, expected a keyword such as *Heading"
            )
        else:
            cards[-1].data.append(text)
            cards[-1].data_line.append(number)
    return cards


def _keyword_card(number: int, text: str) -> Card:
    words = [word.strip() for word in text[1:].split(",")]
    name = " ".join(words[0].upper().split())
    if not re.fullmatch(r"[A-Z][A-Z ]*", name):
        raise DeckError(f"line {number}: got {text[:40]!r}, expected a keyword such as *Node")
    parameters = {}
    for word in words[1:]:
        if word:
            key, _, value = word.partition("=")
            parameters[" ".join(key.upper().split())] = value.strip()
    return Card(number, name, parameters)


def numbers(line: int, text: str, count: int) -> FloatArray:
    """Exactly ``count`` finite numbers of one line.

    Raises
    ------
    DeckError
        Naming the line.
    """
    try:
        values = np.array(text.split(","), dtype=np.float64)
    except ValueError:
        values = np.zeros(0)
    if values.shape != (count,) or not np.isfinite(values).all():
        raise DeckError(f"line {line}: got {text!r}, expected {count} numbers")
    return values


def floats(line: int, row: list[str]) -> list[float]:
    """Numbers of some fields of one line."""
    return [float(x) for x in numbers(line, ",".join(row), len(row))]


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
