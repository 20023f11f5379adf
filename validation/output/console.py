"""Text for people: where it goes, the tables it stands in, the bars that say how far a run is."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from contextvars import ContextVar
from typing import IO, TYPE_CHECKING, Any, TypeVar

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from geometry.compilation.clocks import compiling
from validation.output.files import prepare_json

if TYPE_CHECKING:
    from fem.explicit.solve import Progress as Sample
    from validation.scene.sections import LimitsSection

T = TypeVar("T")

#: Columns of tables in a pipe or a log, which have no width of their own.
_WIDTH = 118

#: Times over which the pace is measured and their number, least time left that is said [s].
WINDOW, WINDOWS, LONG = 2.0, 3, 600.0

#: Least time between two lines of progress in a pipe or a log [s].
_PACE = 10.0

_UNITS = ((365.0 * 86400.0, "years"), (86400.0, "days"), (3600.0, "h"), (60.0, "min"))

#: Whether a call prints errors only (``--quiet``).
quiet: ContextVar[bool] = ContextVar("quiet", default=False)

_TOLD: ContextVar[bool] = ContextVar("compilation is announced", default=False)


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


def measuring(about: str | None, width: int, **flags: str) -> tuple[argparse.Namespace, Console]:
    """What a program that measures is asked, and its console: ``--json FILE|-`` and flags."""
    parser = argparse.ArgumentParser(description=about)
    parser.add_argument("--json", metavar="FILE|-")
    for flag, words in flags.items():
        parser.add_argument(f"--{flag}", action="store_true", help=words)
    requested = parser.parse_args()
    prepare_json(requested.json)
    return requested, Console(stderr=requested.json == "-", width=width, markup=False)


def error_console() -> Console:
    """Text beside the results, for what is said while they come."""
    return _console(stderr=True)


def two_columns(title: str) -> Table:
    """Table of words and values under a title."""
    return listing(title, "", "", show_header=False)


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


@contextmanager
def status(console: Console, words: str) -> Iterator[Callable[[str], None]]:
    """Spinner with words on a terminal; yields what changes the words.

    In a pipe or a file a line each `_PACE` seconds of what is done at that time, on standard error.
    """
    last, errors = time.monotonic(), error_console()

    def show(changed: str) -> None:
        nonlocal last
        spinner.update(Text(changed))
        if not (console.is_terminal or quiet.get()) and time.monotonic() - last >= _PACE:
            last = time.monotonic()
            errors.print(Text(f"{changed} …"))

    with console.status(Text(words)) as spinner:
        yield show


@contextmanager
def progress(*columns: ProgressColumn) -> Iterator[Progress]:
    """Live bar on a terminal; a log file wants the result, not a thousand states of a bar."""
    console = error_console()
    hidden = not console.is_terminal or quiet.get()
    with Progress(*columns, console=console, transient=True, disable=hidden) as bar:
        yield bar


@contextmanager
def told_of_compilation() -> Iterator[None]:
    """Print once that loops are compiled first: progress bars stand still meanwhile."""
    console = error_console()

    def tell() -> None:
        if not _TOLD.get():
            _TOLD.set(True)
            console.print("compiling machine code (only before the first run of this kind)")

    with compiling(tell):
        yield


def duration_words(seconds: float) -> str:
    """A time in the largest unit of which there are at least two: ``5.6 h``."""
    size, unit = next(((s, u) for s, u in _UNITS if seconds >= 2.0 * s), (1.0, "s"))
    number = seconds / size
    return f"{number:.0f} {unit}" if number >= 10.0 else f"{number:.2g} {unit}"


class Forecast:
    """Estimates once the remaining time, from the best pace of the first seconds.

    The best one: functions are compiled and processes started meanwhile, which comes once.
    """

    def __init__(self, window: float = WINDOW) -> None:
        self._window = window
        self._last: tuple[float, float] | None = None
        self._paces: list[float] = []

    def left(self, done: float, total: float) -> str | None:
        """Words for the time left, once, where it is long; None else. Work is in any unit."""
        now = time.perf_counter()
        if self._last is None:
            self._last = (now, done)
        start, before = self._last
        if len(self._paces) == WINDOWS or now - start < self._window or done <= before:
            return None
        self._paces.append((now - start) / (done - before))
        self._last = (now, done)
        if len(self._paces) < WINDOWS:
            return None
        seconds = min(self._paces) * (total - done)
        return duration_words(seconds) if seconds > LONG else None


@contextmanager
def solver_progress(console: Console, name: str) -> Iterator[Callable[[Any], None]]:
    """Yields what shows the progress of any solver: the bar of explicit runs, else words."""
    with told_of_compilation(), ExitStack() as shown:
        kind: str | None = None
        show: Callable[[Any], None]

        def follow(now: Any) -> None:
            nonlocal kind, show
            wanted = "bar" if hasattr(now, "n_steps") else "words"
            if kind != wanted:
                shown.close()
                kind = wanted
                if wanted == "bar":
                    show = shown.enter_context(explicit_progress())
                else:
                    show = shown.enter_context(status(console, f"{name}: {now}"))
            show(now if wanted == "bar" else f"{name}: {now}")

        yield follow


@contextmanager
def explicit_progress() -> Iterator[Callable[[Sample], None]]:
    """Live bar with time, step, energies and remaining time; yields the callback that feeds it.

    A run that will take long says so after some seconds, in a log file too.
    """
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=24),
        TextColumn("{task.percentage:>3.0f} %", markup=False),
        TextColumn("{task.fields[state]}", markup=False),
        TimeRemainingColumn(),
    )
    forecast, console = Forecast(), error_console()

    with progress(*columns) as bar, told_of_compilation():
        task = bar.add_task("explicit", total=None, state="")

        def show(sample: Sample) -> None:
            left = forecast.left(sample.step, sample.n_steps)
            if left is not None:
                console.print(
                    f"estimated run time: at most {left} ({sample.n_steps:.3g} steps), less if the "
                    "blocks come to rest; Ctrl-C stops the run; fem.end_time, fem.time_step, "
                    'fem.mass_scaling or fem.method = "static" make it shorter'
                )
            bar.update(task, total=sample.n_steps, completed=sample.step, state=str(sample))

        yield show


def add_dimensions(table: Table, found: Mapping[str, Any], limits: LimitsSection) -> None:
    """Add volume, mass, contact area, least wall and steepest joint of blocks."""
    table.add_row("volume", _volume_words(found))
    table.add_row("contact area", f"{found['contact_area']:.5g} mm², each joint once")
    wall, angle = found.get("least_wall"), found.get("steepest_joint")
    if wall is not None:
        words = f"{wall:.4g} mm"
        if limits.least_wall is not None and wall < limits.least_wall:
            words += f": TOO THIN, limits.least_wall is {limits.least_wall:g} mm"
        table.add_row("least wall of a block", words)
    if angle is None and limits.steepest_joint is not None:
        table.add_row("steepest joint", "not known of blocks without named faces: not checked")
    if angle is not None:
        words = f"{angle:.3g}° to its mean plane"
        if limits.steepest_joint is not None and angle > limits.steepest_joint:
            words += f": TOO STEEP, limits.steepest_joint is {limits.steepest_joint:g}°"
        table.add_row("steepest joint", words)


def _volume_words(found: Mapping[str, Any]) -> str:
    """Volume of a block and of all, with their mass where it is known."""
    of_block = found["block_volume"]
    least, largest = (f"{of_block[name]:.5g}" for name in ("smallest", "largest"))
    each = f"{least} mm³" if least == largest else f"{least} to {largest} mm³"
    words = f"{each} per block, {found['volume']:.5g} mm³ in all"
    return words if "mass" not in found else f"{words}, {1e3 * found['mass']:.4g} kg"


def cpu_words(seconds: dict[str, float]) -> str:
    """CPU time of each stage, and of the process so far: what was loaded before the run too."""
    reported = ", ".join(f"{stage} {value:.3f}" for stage, value in seconds.items())
    return f"{reported}; this process so far {time.process_time():.3f}"
