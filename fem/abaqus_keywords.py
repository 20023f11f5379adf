"""Grammar of Abaqus input: numbers, keyword lines and data lines, written and read.

What the rules ask (Abaqus "Input syntax rules"; CalculiX reads the same grammar): lines of at
most 256 characters (CalculiX: 132), at most 16 entries on a line of labels, a number in at most
20 characters with a decimal point, labels of at most 80 characters that begin with a letter.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np

from geometry.mesh import FloatArray, IntArray

#: Longest line written: what CalculiX reads, half of what Abaqus does.
LINE_LENGTH = 132

#: Longest number: both programs read the first 20 characters of a field and no more.
NUMBER_LENGTH = 20

#: Entries on a line of node or element numbers.
ENTRIES_PER_LINE = 16

_LABEL = re.compile(r"[A-Z][A-Z0-9_-]{0,79}")


class DeckError(ValueError):
    """A deck that cannot be written or read: line, what was got, what was expected."""


# ---------------------------------------------------------------------------------------------
# Writing


def real(value: float) -> str:
    """Number as text that reads back as the same number, with a decimal point.

    The few numbers whose shortest text is longer than 20 characters (small ones with a sign)
    are rounded to the most digits that fit, a relative error below 1e-13.

    Raises
    ------
    DeckError
        A number that is not finite.
    """
    text = repr(value)
    if len(text) <= NUMBER_LENGTH and "e" not in text:
        if text in {"inf", "nan", "-inf"}:
            raise DeckError(f"deck: got the number {value}; expected finite numbers")
        return text if text != "-0.0" else "0.0"
    for digits in range(17, 0, -1):
        text = repr(float(f"{value:.{digits}g}"))
        if "e" in text and "." not in text:
            text = text.replace("e", ".e")
        if len(text) <= NUMBER_LENGTH:
            return text
    raise AssertionError("a number of one digit fits into 20 characters")


def label(name: str) -> str:
    """Label of a block, face or material in a deck: upper case, what Abaqus stores anyway.

    Raises
    ------
    DeckError
        A name that is no label.
    """
    text = _FACE_LABELS.get(name, name.upper())
    if not _LABEL.fullmatch(text) or (name not in _FACE_LABELS and name != name.lower()):
        raise DeckError(
            f"deck: got the name {name!r}; expected lower-case letters, digits, - and _, "
            "beginning with a letter, at most 80 characters"
        )
    return text


#: Faces of boxes: + is no character of a label.
_FACE_LABELS = {
    f"{axis}{sign}": f"{axis.upper()}-{side}"
    for axis in "xyz"
    for sign, side in (("-", "MIN"), ("+", "MAX"))
}
_FACE_NAMES = {text: name for name, text in _FACE_LABELS.items()}


def name_of(text: str) -> str:
    """Inverse of `label`."""
    return _FACE_NAMES.get(text.upper(), text.lower())


def keyword(name: str, /, **parameters: str | None) -> str:
    """Keyword line; underscores in parameters stand for spaces, None for no value."""
    parts = [f"*{name}"]
    for key, value in parameters.items():
        word = key.rstrip("_").replace("_", " ")
        parts.append(word if value is None else f"{word}={value}")
    line = ", ".join(parts)
    if len(line) > LINE_LENGTH:
        raise DeckError(
            f"deck: got a keyword line of {len(line)} characters ({line[:60]}…); expected at most "
            f"{LINE_LENGTH}: use shorter names"
        )
    return line


def reals(values: Iterable[float]) -> str:
    """One data line of numbers."""
    return ", ".join(real(float(value)) for value in values)


def node_lines(coordinates: FloatArray, first: int = 1) -> Iterator[str]:
    """Data lines of ``*Node``: number and coordinates [mm]."""
    rows = coordinates.tolist()
    for number, (x, y, z) in enumerate(rows, start=first):
        yield f"{number}, {real(x)}, {real(y)}, {real(z)}"


def element_lines(elements: IntArray, first: int = 1, first_node: int = 1) -> Iterator[str]:
    """Data lines of ``*Element``: number and eight nodes."""
    for number, corners in enumerate((elements + first_node).tolist(), start=first):
        yield f"{number}, {', '.join(map(str, corners))}"


def entry_lines(entries: Iterable[object]) -> Iterator[str]:
    """Data lines of a list of numbers or labels, 16 entries or less on each."""
    line: list[str] = []
    length = 0
    for entry in entries:
        text = str(entry)
        if len(line) == ENTRIES_PER_LINE or length + len(text) + 2 > LINE_LENGTH:
            yield ", ".join(line)
            line, length = [], 0
        line.append(text)
        length += len(text) + 2
    if line:
        yield ", ".join(line)


# ---------------------------------------------------------------------------------------------
# Reading


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
