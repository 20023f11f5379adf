"""Text for people: where it goes, and the tables it stands in."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextvars import ContextVar
from dataclasses import dataclass
from typing import IO, TYPE_CHECKING, Any, TypeVar

from rich.console import Console
from rich.table import Table

from geometry.machine.system import children_cpu_seconds, peak_memory_mb
from geometry.parts.rows import Row

if TYPE_CHECKING:
    from geometry.answer import Answer
    from validation.scene.sections import LimitsSection

T = TypeVar("T")

#: Columns of tables in a pipe or a log, which have no width of their own.
_WIDTH = 118

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
    return console if console.is_terminal else make(_WIDTH)


def error_console() -> Console:
    """Text beside the results, for what is said while they come."""
    return _console(stderr=True)


@dataclass(frozen=True)
class RowTable:
    """Rows under a title: a console prints it, JSON and pages have the same rows."""

    title: str
    groups: Sequence[Sequence[Row]]
    """With a line between one and the next."""

    @classmethod
    def of_words(cls, title: str, words: Mapping[str, str]) -> RowTable:
        """Table of words by their titles; those that are empty are left out."""
        return cls(title, [[Row(*row) for row in words.items() if row[1]]])

    @property
    def cells(self) -> list[list[tuple[str, str]]]:
        """Title and words of the rows of each group; a title that repeats is empty."""
        result = []
        for group in filter(None, self.groups):
            titles = ("", *(row.title for row in group))
            result.append(
                [
                    ("" if row.title == before else row.title, row.words)
                    for before, row in zip(titles, group, strict=False)
                ]
            )
        return result

    def as_json(self) -> list[dict[str, Any]]:
        """Return title, value, unit and words of each row."""
        return [row.as_json() for group in self.groups for row in group]

    def __rich__(self) -> Table:
        """Return what a console prints."""
        table = listing(self.title, "", "", show_header=False)
        for group in self.cells:
            table.add_section()
            for cells in group:
                table.add_row(*cells)
        return table


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


def part_rows(answer: Answer, *names: str) -> list[Row]:
    """Rows of some parts of an answer, as far as it has them."""
    return [row for name in names if name in answer.parts for row in answer.parts[name].rows]


def dimension_rows(found: Mapping[str, Any], limits: LimitsSection) -> list[Row]:
    """Volume, mass, contact area, least wall and steepest joint of blocks."""
    area = found["contact_area"]
    of = "closed at the end" if found.get("closed") else "each joint of a free block once"
    rows = [
        Row("volume", _volume_words(found), found["volume"], "mm³"),
        Row("contact area", f"{area:.5g} mm², {of}", area, "mm²"),
    ]
    wall, angle = found.get("least_wall"), found.get("steepest_joint")
    if wall is not None:
        words = f"{wall:.4g} mm"
        if limits.least_wall is not None and wall < limits.least_wall:
            words += f": TOO THIN, limits.least_wall is {limits.least_wall:g} mm"
        rows.append(Row("least wall of a block", words, wall, "mm"))
    if angle is None and limits.steepest_joint is not None:
        words = "not known of blocks without named faces: not checked"
        rows.append(Row("steepest joint", words))
    if angle is not None:
        words = f"{angle:.3g}° to its mean plane"
        if limits.steepest_joint is not None and angle > limits.steepest_joint:
            words += f": TOO STEEP, limits.steepest_joint is {limits.steepest_joint:g}°"
        rows.append(Row("steepest joint", words, angle, "degrees"))
    return rows


def _volume_words(found: Mapping[str, Any]) -> str:
    """Volume of a block and of all, with their mass where it is known."""
    of_block = found["block_volume"]
    least, largest = (f"{of_block[name]:.5g}" for name in ("smallest", "largest"))
    each = f"{least} mm³" if least == largest else f"{least} to {largest} mm³"
    words = f"{each} per block, {found['volume']:.5g} mm³ in all"
    return words if "mass" not in found else f"{words}, {1e3 * found['mass']:.4g} kg"


def cpu_row(seconds: Mapping[str, float]) -> Row:
    """CPU time of each stage."""
    words = ", ".join(f"{stage} {value:.3f}" for stage, value in seconds.items())
    return Row("CPU seconds", words)


def process_words() -> str:
    """CPU time and peak memory of this process so far: loading and pictures included."""
    words = f"{time.process_time():.2f} CPU s"
    started = children_cpu_seconds()
    if started >= _LEAST_CHILDREN:
        words += f", {started:.2f} in processes that it started"
    return f"{words}; peak memory {peak_memory_mb():.0f} MB"
