"""Grammar of Abaqus input: numbers, labels, keyword lines and data lines, as they are written.

What the rules ask (Abaqus "Input syntax rules"; CalculiX reads the same grammar): lines of at
most 256 characters (CalculiX: 132), at most 16 entries on a line of labels, a number in at most
20 characters with a decimal point, labels of at most 80 characters that begin with a letter.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator

import numpy as np

from geometry.errors import RefusedError
from geometry.mesh import FloatArray, IntArray

#: Longest line written: what CalculiX reads, half of what Abaqus does.
LINE_LENGTH = 132

#: Longest number: both programs read the first 20 characters of a field and no more.
NUMBER_LENGTH = 20

#: Digits of coordinates, counted from the largest: rounding is below 1e-13 of the size.
_DIGITS = 14

#: Entries on a line of node or element numbers.
ENTRIES_PER_LINE = 16

#: Characters of a label at most.
_LONGEST = 80
_LABEL = re.compile(rf"[A-Z][A-Z0-9_-]{{0,{_LONGEST - 1}}}")


class DeckError(RefusedError):
    """A deck that cannot be written or read: line, what was got, what was expected."""


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


def safe_names(names: Iterable[str]) -> list[str]:
    """Names that `label` takes, no two alike, as close to the given ones as that allows."""
    result: dict[str, None] = {}
    for name in names:
        text = re.sub(r"[^a-z0-9_-]", "_", name.lower())
        text = text if re.match("[a-z]", text) else f"n{text}"
        ends = ("", *(f"-{k}" for k in range(2, len(result) + 2)))
        tries = (f"{text[: _LONGEST - len(end)]}{end}" for end in ends)
        result[next(one for one in tries if one not in result)] = None
    return list(result)


#: Faces of boxes: + is no character of a label.
_FACE_LABELS = {
    f"{axis}{sign}": f"{axis.upper()}-{side}"
    for axis in "xyz"
    for sign, side in (("-", "MIN"), ("+", "MAX"))
}


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


def table_lines(rows: Iterable[tuple[float, float]]) -> Iterator[str]:
    """Data lines of an amplitude, times and shares: four pairs on each."""
    numbers = [number for row in rows for number in row]
    for first in range(0, len(numbers), 8):
        yield reals(numbers[first : first + 8])


def node_lines(coordinates: FloatArray, first: int = 1) -> Iterator[str]:
    """Data lines of ``*Node``: number and coordinates [mm], rounded to what they are exact to."""
    size = float(np.abs(coordinates).max(initial=0.0)) or 1.0
    rows = (np.round(coordinates, _DIGITS - math.ceil(math.log10(size))) + 0.0).tolist()
    for number, (x, y, z) in enumerate(rows, start=first):
        yield f"{number}, {real(x)}, {real(y)}, {real(z)}"


def element_lines(elements: IntArray, first: int = 1, first_node: int = 1) -> Iterator[str]:
    """Data lines of ``*Element``: number and nodes."""
    for number, nodes in enumerate((elements + first_node).tolist(), start=first):
        yield ", ".join(map(str, [number, *nodes]))


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
