"""Lines of tables, and the parts of an answer that give them: text, JSON, pages from the same."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from math import isfinite
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

if TYPE_CHECKING:
    from rich.table import Table

#: Groups of the rows of an answer, in the order of its table.
GROUPS = ("verdict", "measures", "evidence", "model", "time")
#: Title of the row of CPU times.
TIMES = "CPU seconds"
#: Columns of a table where there is no terminal.
WIDTH = 118


def number(value: float) -> str:
    """A value without an error bar in four digits, without an exponent below a million."""
    return f"{float(f'{value:.4g}'):.6g}"


def finite(value: float) -> float | None:
    """A number as plain data; None where it is none."""
    return float(value) if isfinite(value) else None


def plain(of: object, *names: str) -> dict[str, Any]:
    """Attributes by name as plain data: lists of arrays, None for a number that is not finite."""
    return {name: _plain(getattr(of, name)) for name in names}


def _plain(value: Any) -> Any:
    value = value.tolist() if hasattr(value, "tolist") else value
    return finite(value) if isinstance(value, float) else value


def first_of(words: Iterable[str], most: int) -> str:
    """The first of some words, and how many more there are."""
    every = list(words)
    more = len(every) - most
    named = ", ".join(every[:most])
    return f"{named} and {more} more" if more > 0 else named


class Row(NamedTuple):
    """A line of a table: text, JSON and pages are made from the same rows."""

    title: str
    words: str
    """The value with its unit, error bar and place, or words where there is no one value."""
    value: float | None = None
    """None where words alone say it."""
    unit: str = ""
    """Empty where it has none."""
    group: str = "measures"
    """One of `GROUPS`."""

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        return self._asdict()


def grouped(**groups: Iterable[Row]) -> list[Row]:
    """Rows of some groups by name, one group after another."""
    return [row._replace(group=name) for name, rows in groups.items() for row in rows]


@dataclass(frozen=True)
class RowTable:
    """Rows under a title: a console prints it, JSON and pages have the same rows."""

    title: str
    rows: Sequence[Row]

    @property
    def groups(self) -> dict[str, list[Row]]:
        """Rows of each group that has any, in the order of `GROUPS`."""
        groups = {name: [row for row in self.rows if row.group == name] for name in GROUPS}
        return {name: rows for name, rows in groups.items() if rows}

    @property
    def cells(self) -> list[list[tuple[str, str]]]:
        """Title and words of the rows of each group; a title that repeats is empty."""
        result = []
        for group in self.groups.values():
            titles = ("", *(row.title for row in group))
            result.append(
                [
                    ("" if row.title == before else row.title, row.words)
                    for before, row in zip(titles, group, strict=False)
                ]
            )
        return result

    def as_json(self) -> list[dict[str, Any]]:
        """Return title, value, unit, words and group of each row."""
        return [row.as_json() for group in self.groups.values() for row in group]

    def __rich__(self) -> Table:
        """Return what a console prints."""
        from rich.table import Table
        from rich.text import Text

        table = Table(title=Text(self.title), title_justify="left", show_header=False)
        for group in self.cells:
            table.add_section()
            for cells in group:
                table.add_row(*map(Text, cells))
        return table

    def __str__(self) -> str:
        """Text, as wide as the terminal; elsewhere as wide as a log."""
        from io import StringIO

        from rich.console import Console

        width = None if (terminal := Console()).is_terminal else WIDTH
        console = Console(file=StringIO(), width=width or terminal.width)
        with console.capture() as text:
            console.print(self, soft_wrap=True)
        return text.get().rstrip()

    def _repr_html_(self) -> str:
        """Return the table for a notebook."""
        bodies = (
            "".join(f"<tr><td>{escape(a)}</td><td>{escape(b)}</td></tr>" for a, b in group)
            for group in self.cells
        )
        body = "".join(f"<tbody>{rows}</tbody>" for rows in bodies).replace("\n", "<br>")
        return f"<table><caption>{escape(self.title)}</caption>{body}</table>"


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


def time_row(seconds: Mapping[str, float]) -> Row:
    """CPU time in all, and that of each stage of a hundredth of a second or more."""
    stages = {name: value for name, value in seconds.items() if name != "total"}
    total = seconds.get("total", sum(stages.values()))
    each = ", ".join(f"{name} {value:.2f}" for name, value in stages.items() if value >= 0.005)
    words = f"{total:.2f}" + (f": {each}" if each else "")
    return Row(TIMES, words, total, "s", "time")
