"""Text for people: where it goes, and the tables it stands in."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from contextvars import ContextVar
from typing import IO, Any, TypeVar

from rich.console import Console
from rich.table import Table

from geometry.machine.system import children_cpu_seconds, peak_memory_mb
from geometry.parts.rows import WIDTH

T = TypeVar("T")


#: CPU time of processes that were started that is worth a word [s].
_LEAST_CHILDREN = 0.1

_UNITS = ((365.0 * 86400.0, "years"), (86400.0, "days"), (3600.0, "h"), (60.0, "min"))

#: Whether a call prints errors only (``--quiet``).
quiet: ContextVar[bool] = ContextVar("quiet", default=False)


def text_console(json: str | None = None) -> Console:
    """Text for people; moves aside when JSON takes standard output (``-``).

    Nothing is read as markup: names of scenes and files may hold brackets and colons.
    """
    return _console(stderr=json == "-")


def plain_console(file: IO[str]) -> Console:
    """Text into an open file, as wide as a log."""
    return _console(file=file)


def _console(*, stderr: bool = False, file: IO[str] | None = None) -> Console:
    def make(width: int | None) -> Console:
        return Console(
            file=file,
            stderr=stderr,
            highlight=False,
            soft_wrap=True,
            markup=False,
            emoji=False,
            quiet=quiet.get() and file is None,
            width=width,
        )

    console = make(None)
    return console if console.is_terminal else make(WIDTH)


def error_console() -> Console:
    """Text beside the results, for what is said while they come."""
    return _console(stderr=True)


def listing(title: str, *words: str, numbers: Iterable[str] = (), **options: Any) -> Table:
    """Table under a title: heads of columns of words, then of numbers, which stand to the right."""
    table = Table(title=title, title_justify="left", **options)
    for head in words:
        table.add_column(head)
    for head in numbers:
        table.add_column(head, justify="right")
    return table


def tabled(
    title: str,
    rows: Iterable[T],
    columns: Mapping[str, str | Callable[[T], str]],
    *,
    words: int = 1,
    **options: Any,
) -> Table:
    """Table of rows: what each column says of one, by head; the first ``words`` are no numbers.

    A column of rows that are data by name may be a format of them: ``"{p_eff:.3g}"``.
    """
    heads = list(columns)
    table = listing(title, *heads[:words], numbers=heads[words:], **options)
    for row in rows:
        data = row if isinstance(row, Mapping) else {}
        cells = (c.format_map(data) if isinstance(c, str) else c(row) for c in columns.values())
        table.add_row(*cells)
    return table


def duration_words(seconds: float) -> str:
    """A time in the largest unit of which there are at least two: ``5.6 h``."""
    size, unit = next(((s, u) for s, u in _UNITS if seconds >= 2.0 * s), (1.0, "s"))
    number = seconds / size
    return f"{number:.0f} {unit}" if number >= 10.0 else f"{number:.2g} {unit}"


def process_words() -> str:
    """CPU time and peak memory of this process so far: loading and pictures included."""
    words = f"{time.process_time():.2f} CPU s"
    started = children_cpu_seconds()
    if started >= _LEAST_CHILDREN:
        words += f", {started:.2f} in processes that it started"
    return f"{words}; peak memory {peak_memory_mb():.0f} MB"
