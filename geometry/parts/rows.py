"""Lines of tables, and the parts of an answer that give them: text, JSON, pages from the same."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from typing import Any, NamedTuple, Protocol


def number(value: float) -> str:
    """A value without an error bar in four digits, without an exponent below a million."""
    return f"{float(f'{value:.4g}'):.6g}"


def finite(value: float) -> float | None:
    """A number as plain data; None where it is none."""
    return float(value) if isfinite(value) else None


class Row(NamedTuple):
    """A line of a table: text, JSON and pages are made from the same rows."""

    title: str
    words: str
    """The value with its unit, error bar and place, or words where there is no one value."""
    value: float | None = None
    """None where words alone say it."""
    unit: str = ""
    """Empty where it has none."""

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "title": self.title,
            "value": self.value,
            "unit": self.unit,
            "words": self.words,
        }


class Part(Protocol):
    """What was found beside the measures, such as a load factor at collapse."""

    @property
    def rows(self) -> list[Row]:
        """Its rows in the table of the answer."""

    def as_json(self) -> Any:
        """Return plain data: its entry in the report."""


@dataclass(frozen=True)
class Notes:
    """A part of words alone."""

    rows: list[Row]

    def as_json(self) -> dict[str, str]:
        """Words by title."""
        return {row.title: row.words for row in self.rows}
