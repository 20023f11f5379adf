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

    def parameter(self, name: str) -> str:
        """Value of a parameter, upper case, without quotes.

        Raises
        ------
        DeckError
            When it is missing.
        """
        value = self.option(name)
        if not value:
            raise DeckError(f"{self.at()}: {self.title} has no {name.lower()}; expected one")
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
            raise DeckError(
                f"{self.at(line)}: got {text[:40]!r} under {self.title}; expected a finite number"
            )
        return value

    def whole(self, line: int, text: str) -> int:
        """A whole number of a data line.

        Raises
        ------
        DeckError
            Naming the line.
        """
        if not re.fullmatch(r"[+-]?\d{1,15}", text):
            raise DeckError(
                f"{self.at(line)}: got {text[:40]!r} under {self.title}; expected a whole number"
            )
        return int(text)

    def numbers(self) -> FloatArray:
        """All numbers of its data lines, empty fields left out, (n,).

        Raises
        ------
        DeckError
            Naming the line of a field that is no finite number.
        """
        try:
            values = np.array(",".join(self.data).split(","), dtype=np.float64)
            if np.isfinite(values).all():
                return values
        except ValueError:
            pass
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
        Where included files are; None: there are none.

    Raises
    ------
    DeckError
        A data line before the first keyword, a keyword line that is none, an included file that
        cannot be read.
    """
    cards: list[Card] = []
    _read(lines, folder, "", cards, 0)
    return cards


def _read(
    lines: Iterable[str], folder: Path | None, file: str, cards: list[Card], depth: int
) -> None:
    begun: tuple[int, str] | None = None
    for number, raw in enumerate(lines, start=1):
        text = raw.strip()
        if not text or text.startswith(("**", ">**")):  # CalculiX skips the second, too
            continue
        if begun is not None and not text.startswith("*"):
            first, head = begun
            number, text = first, head + text  # noqa: PLW2901 - a keyword line goes on
        elif begun is not None:
            raise DeckError(f"line {begun[0]}: the keyword line ends with a comma; expected more")
        begun = (number, text) if text.startswith("*") and text.endswith(",") else None
        if begun is not None:
            continue
        if text.startswith("*"):
            card = _keyword_card(number, text, file)
            if card.keyword == "INCLUDE":
                _include(card, folder, cards, depth)
            else:
                cards.append(card)
        elif not cards:
            raise DeckError(
                f"line {number}: got {text[:40]!r}; expected a keyword such as *Heading"
            )
        else:
            cards[-1].data.append(text)
            cards[-1].data_line.append(number)
    if begun is not None:
        raise DeckError(f"line {begun[0]}: the keyword line ends with a comma; expected more")


def _include(card: Card, folder: Path | None, cards: list[Card], depth: int) -> None:
    name = card.parameters.get("INPUT", "").strip('"')
    if not name or depth >= _DEPTH or folder is None:
        raise DeckError(
            f"{card.at()}: *Include of {name!r} cannot be read here; expected input=FILE, at most "
            f"{_DEPTH} files deep"
        )
    path = folder / name
    why = unreadable(path)
    if why is not None:
        raise DeckError(f"{card.at()}: *Include: {path}: {why}; expected a file of the deck")
    _read(deck_text(path), folder, name, cards, depth + 1)


def deck_text(path: Path) -> list[str]:
    """Lines of a file of any encoding: names keep all bytes."""
    return path.read_text("latin-1").splitlines()


def _keyword_card(number: int, text: str, file: str) -> Card:
    words = [word.strip() for word in _WORD.findall(text[1:])]
    name = " ".join(words[0].upper().split())
    if not re.fullmatch(r"[A-Z][A-Z -]*", name):
        raise DeckError(
            f"{file and f'{file}, '}line {number}: got {text[:40]!r}; expected a keyword such as "
            "*Node"
        )
    parameters = {}
    for word in words[1:]:
        if word:
            key, _, value = word.partition("=")
            parameters[" ".join(key.upper().replace("_", " ").split())] = value.strip()
    return Card(number, name, parameters, file=file)
