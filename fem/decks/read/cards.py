"""Grammar of input decks: keyword lines with parameters and data lines. It knows no keywords.

Reference: Abaqus Analysis User's Guide, "Input syntax rules"; CalculiX reads the same grammar.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fem.decks.keywords import DeckError
from geometry.errors import unreadable
from geometry.mesh import FloatArray

#: Files may include files to this depth.
_DEPTH = 10
#: Size of a deck with all that it includes, at most [bytes].
_LARGEST = 1 << 30
#: Words between commas; a comma inside quotes is part of the word.
_WORD = re.compile(r'(?:[^,"]|"[^"]*")*')


@dataclass(frozen=True)
class Card:
    """A keyword line with its data lines; comments and empty lines are left out."""

    line: int
    """Number of the keyword line in its file, from 1."""
    keyword: str
    """Upper case, without the asterisk."""
    parameters: dict[str, str]
    """Names in upper case; the value is empty where none was given."""
    data: list[str] = field(default_factory=list)
    """Data lines as they stand."""
    data_line: list[int] = field(default_factory=list)
    """Their numbers in the file."""
    file: str = ""
    """Name of an included file that it stands in; empty: the deck itself."""

    def at(self, line: int | None = None) -> str:
        """Place of the keyword line, or of one of its data lines, for messages."""
        return f"{self.file and f'{self.file}, '}line {line or self.line}"

    @property
    def title(self) -> str:
        """Keyword as people write it."""
        return f"*{self.keyword.title()}"

    def wrong(self, got: str, expected: str, line: int | None = None) -> DeckError:
        """Refusal of an entry that its keyword cannot have."""
        return DeckError(f"{self.at(line)}: {self.title}: got {got}; expected {expected}")

    def unread(self, what: str = "", line: int | None = None) -> DeckError:
        """Refusal of what the subset does not have, in one wording."""
        return DeckError(
            f"{self.at(line)}: {self.title}{what and f', {what}'} is not read; expected words of "
            "the table in docs/tutorials/decks.md"
        )

    def parameter(self, name: str) -> str:
        """Value of a parameter, upper case, without quotes.

        Raises
        ------
        DeckError
            When it is missing.
        """
        value = self.option(name)
        if not value:
            raise self.wrong("no value", f"{name.lower()}=…")
        return value

    def option(self, name: str) -> str:
        """Value of a parameter, upper case, without quotes; empty where it is missing."""
        return " ".join(self.parameters.get(name, "").strip('"').upper().split())

    def rows(self) -> Iterator[tuple[int, list[str]]]:
        """Line number and fields of each data line."""
        for number, text in zip(self.data_line, self.data, strict=True):
            yield number, fields(text)

    def number(self, line: int, text: str) -> float:
        """A finite number of a data line.

        Raises
        ------
        DeckError
            Naming the line.
        """
        try:
            value = float(text.upper().replace("D", "E"))
        except ValueError:
            value = np.nan
        if not np.isfinite(value):
            raise self.wrong(repr(text[:40]), "a finite number", line)
        return value

    def whole(self, line: int, text: str) -> int:
        """A whole number of a data line.

        Raises
        ------
        DeckError
            Naming the line.
        """
        if not re.fullmatch(r"[+-]?\d{1,15}", text):
            raise self.wrong(repr(text[:40]), "a whole number", line)
        return int(text)

    def numbers(self) -> FloatArray:
        """All numbers of its data lines, empty fields left out, (n,).

        Raises
        ------
        DeckError
            Naming the line of a field that is no finite number.
        """
        return np.array([self.number(n, text) for n, row in self.rows() for text in row if text])


def fields(text: str) -> list[str]:
    """Entries of a data line, without the comma that may end it."""
    entries = [entry.strip() for entry in text.split(",")]
    if len(entries) > 1 and not entries[-1]:
        entries.pop()
    return entries


def read_cards(lines: Iterable[str], folder: Path | None = None) -> list[Card]:
    """Split a deck into cards; files that it includes are read in their place.

    Parameters
    ----------
    lines
        Of the deck.
    folder
        Folder of the deck: included files are in it or below; None: there are none.

    Raises
    ------
    DeckError
        A data line before the first keyword, a keyword line that is none, an included file that
        cannot be read.
    """
    files = _Files(folder)
    files.read(lines)
    return files.cards


@dataclass
class _Files:
    """A deck with the files that it includes, as cards."""

    folder: Path | None
    cards: list[Card] = field(default_factory=list)
    size: int = 0
    """Of the files that were included [bytes]."""

    def read(self, lines: Iterable[str], file: str = "", depth: int = 0) -> None:
        """Read the lines of a file."""
        begun: tuple[int, str] | None = None
        for number, raw in enumerate(lines, start=1):
            text, first = raw.strip(), number
            if not text or text.startswith(("**", ">**")):  # CalculiX skips the second, too
                continue
            if begun is not None:
                if text.startswith("*"):
                    break
                first, text = begun[0], begun[1] + text
            begun = (first, text) if text.startswith("*") and text.endswith(",") else None
            if begun is not None:
                continue
            if text.startswith("*"):
                card = _keyword_card(first, text, file)
                if card.keyword == "INCLUDE":
                    self._include(card, depth + 1)
                else:
                    self.cards.append(card)
            elif not self.cards:
                raise DeckError(
                    f"line {number}: got {text[:40]!r}; expected a keyword such as *Heading"
                )
            else:
                self.cards[-1].data.append(text)
                self.cards[-1].data_line.append(number)
        if begun is not None:
            raise DeckError(f"line {begun[0]}: the keyword line ends with a comma; expected more")

    def _include(self, card: Card, depth: int) -> None:
        name = card.parameters.get("INPUT", "").strip('"')
        path = (self.folder or Path()) / name
        try:
            lines = deck_text(path)
            below = path.resolve().is_relative_to((self.folder or Path()).resolve())
            self.size += path.stat().st_size
        except DeckError as error:
            raise DeckError(f"{card.at()}: *Include: {error}") from None
        if not below or self.folder is None or depth > _DEPTH or self.size > _LARGEST:
            raise card.wrong(
                repr(name),
                f"a file in the folder of the deck or below, {_DEPTH} files deep and 1 GiB in all "
                "at most: copy it there",
            )
        self.read(lines, name, depth)


def deck_text(path: Path) -> list[str]:
    """Lines of a file of any encoding: names keep all bytes.

    Raises
    ------
    DeckError
        No file, a device, a file larger than a deck.
    """
    why = unreadable(path)
    if why is None and path.stat().st_size > _LARGEST:
        why = f"has {path.stat().st_size / 2**30:.3g} GiB"
    if why is not None:
        raise DeckError(f"{path}: {why}; expected a deck of 1 GiB at most")
    return path.read_text("latin-1").splitlines()


def _keyword_card(number: int, text: str, file: str) -> Card:
    words = [word.strip() for word in _WORD.findall(text[1:])]
    name = " ".join(words[0].upper().split())
    parameters = {}
    for word in words[1:]:
        if word:
            key, _, value = word.partition("=")
            parameters[" ".join(key.upper().replace("_", " ").split())] = value.strip()
    card = Card(number, name, parameters, file=file)
    if not re.fullmatch(r"[A-Z][A-Z -]*", name):
        raise DeckError(f"{card.at()}: got {text[:40]!r}; expected a keyword such as *Node")
    return card
