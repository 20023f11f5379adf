"""Text for people: where it goes, tables, and the progress of runs on standard error."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from io import StringIO
from typing import IO, TYPE_CHECKING, Any, Protocol, TypeVar

from rich.console import Console
from rich.status import Status
from rich.table import Table
from rich.text import Text

from geometry.machine.system import children_cpu_seconds, peak_memory_mb
from geometry.machine.work import compiling
from geometry.parts.rows import WIDTH

if TYPE_CHECKING:
    from geometry.answer import Answer, Measure

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


class Printed:
    """What has tables and words: `print` prints them, and so does the repr."""

    def print(self, console: Console) -> None:
        """Print all."""
        raise NotImplementedError

    def __repr__(self) -> str:
        """Return what `print` prints."""
        self.print(plain_console(text := StringIO()))
        return text.getvalue().rstrip()


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


#: A run that is shorter prints nothing [s].
SHORT = 2.0
#: Least time between two lines of what a run is at: [s], and as a share of the time so far.
_PACE, _SHARE = 10.0, 0.1
#: Times over which the pace is measured [s], and their number.
WINDOW, WINDOWS = 0.5, 3
#: Least time of a run that is told how to make it shorter [s].
LONG = 600.0
#: Measures in the line of a mesh.
_OF_A_MESH = ("u", "p_eff", "p_max_point")

_TOLD: ContextVar[bool] = ContextVar("compilation is announced", default=False)


class Forecast:
    """Estimates the remaining time from the best pace of the last windows of time.

    The best one: functions are compiled and processes started in some.
    """

    def __init__(self) -> None:
        self._last: tuple[float, float] | None = None
        self._paces: deque[float] = deque(maxlen=WINDOWS)

    def left(self, done: float, total: float) -> float | None:
        """Time left [s]; None in the first windows. Work is in any unit."""
        now = time.perf_counter()
        if self._last is None:
            self._last = (now, done)
        start, before = self._last
        if now - start >= WINDOW and done > before:
            self._paces.append((now - start) / (done - before))
            self._last = (now, done)
        if len(self._paces) < WINDOWS:
            return None
        return min(self._paces) * (total - done)


class Following:
    """Who prints what a run is at: see `following`."""

    def __init__(self, name: str, console: Console, spinner: Status | None) -> None:
        self._name, self._console, self._spinner = name, console, spinner
        self.left: float | None = None
        """Time left [s]; None where it is not known."""
        self._state = name
        self._start = time.monotonic()
        self._kept: list[str] = []
        self._is_long = False
        self._lock, self._ended = threading.Lock(), threading.Event()
        self._forecast = Forecast()

    @contextmanager
    def renamed(self, name: str) -> Iterator[Following]:
        """Print another name, of a part of the run."""
        before, self._name, self._forecast = self._name, name, Forecast()
        self(name)
        try:
            yield self
        finally:
            self._name = before

    def __call__(self, words: object, done: float = 0.0, total: float | None = None) -> None:
        """Take what the run is at, and how much of how much is done."""
        self._state = self._name if words == self._name else f"{self._name}: {words}"
        self.left = None if total is None else self._forecast.left(done, total)
        if self.left is not None:
            self._state += f", about {duration_words(self.left)} left"
        if self._spinner is not None:
            self._spinner.update(Text(self._state))

    def line(self, words: str) -> None:
        """Print a line that stays, now or when the run turns out to be long."""
        words = f"{self._name}: {words}"
        with self._lock:
            if self._is_long:
                self._console.print(words)
            else:
                self._kept.append(words)

    def tell(self) -> None:
        """Print what was kept and, in a pipe, what the run is at; the run is long."""
        with self._lock:
            self._is_long = True
            for words in self._kept:
                self._console.print(words)
            self._kept.clear()
            if self._spinner is None:
                self._console.print(f"{self._state} … {duration_words(self._spent)}")

    @property
    def _spent(self) -> float:
        return time.monotonic() - self._start

    def watch(self) -> None:
        """Tell from another thread, until the run has ended."""
        wait = SHORT
        while not self._ended.wait(wait):
            self.tell()
            wait = max(_PACE, _SHARE * self._spent)

    def end(self) -> None:
        """Print no more."""
        self._ended.set()


_OUTER: ContextVar[Following | None] = ContextVar("run that is followed", default=None)


@contextmanager
def following(name: str) -> Iterator[Following]:
    """Print on standard error what a run is at, if it takes longer than `SHORT`.

    On a terminal a spinner has the words of the moment. In a pipe they are printed first after two
    seconds, then every ten, later at longer intervals. A part of a run that is followed already
    changes the name.
    """
    outer = _OUTER.get()
    if outer is not None:
        with outer.renamed(name):
            yield outer
        return
    console = error_console()
    spinner = console.status(Text(name)) if console.is_terminal and not quiet.get() else None
    follow = Following(name, console, spinner)

    def compile_line() -> None:
        if not _TOLD.get():
            _TOLD.set(True)
            follow.line("compiling machine code (only before the first run of this kind)")

    thread = threading.Thread(target=follow.watch, daemon=True)
    with compiling(compile_line):
        thread.start()
        if spinner is not None:
            spinner.start()
        token = _OUTER.set(follow)
        try:
            yield follow
        finally:
            _OUTER.reset(token)
            follow.end()
            thread.join()
            if spinner is not None:
                spinner.stop()


class _Sample(Protocol):
    """State of an explicit run (`fem.explicit.solve.Progress`)."""

    time: float
    step: int
    n_steps: int
    residual: float | None


class SolverProgress:
    """Takes what a solver is at, whatever its method: words, meshes, samples of explicit runs."""

    def __init__(self, follow: Following) -> None:
        self._follow = follow
        self._show_sample = explicit_progress(follow)
        self._meshes = 0
        """Meshes that have their lines."""

    def __call__(self, now: Any) -> None:
        """Show the state; the mesh before it has a line of its own."""
        if hasattr(now, "n_steps"):
            self._show_sample(now)
            return
        measures = getattr(now, "measures", None)
        if measures:
            self._tell_mesh(now.rung - 1, measures)
        self._follow(now)

    def end(self, answer: Answer) -> None:
        """Print the line of the last mesh of an answer, and what ended the refinement."""
        meshes, accuracy = answer.parts.get("meshes"), answer.parts.get("accuracy")
        if meshes is not None and accuracy is not None:
            self._tell_mesh(len(meshes.as_json()), answer.measures)
            self._follow.line(f"ended by: {accuracy.as_json()['ended_by']}")

    def _tell_mesh(self, number: int, measures: Mapping[str, Measure]) -> None:
        if number > self._meshes:
            self._meshes = number
            self._follow.line(f"mesh {number}: {_mesh_words(measures)}")


@contextmanager
def solver_progress(name: str) -> Iterator[SolverProgress]:
    """Follow a solver, as `following` does."""
    with following(name) as follow:
        yield SolverProgress(follow)


def _mesh_words(measures: Mapping[str, Measure]) -> str:
    """Numbers of a mesh in one line, with their error bars."""
    from geometry.answer import ALIASES

    pairs = ((name, measures.get(ALIASES.get(name, name))) for name in _OF_A_MESH)
    return ", ".join(f"{name} {m.value_words}" for name, m in pairs if m is not None)


def explicit_progress(follow: Following) -> Callable[[_Sample], None]:
    """Return what takes the samples of an explicit run: its steps and its forecast come first."""
    told = False

    def show(sample: _Sample) -> None:
        nonlocal told
        follow(sample, sample.step, sample.n_steps)
        left = follow.left
        if told or left is None or sample.step < 2:
            return
        told = True
        step = sample.time / (sample.step - 1)
        words = f"{sample.n_steps} steps of {step:.4g} s, about {duration_words(left)}"
        if sample.residual is not None:
            words += " at most: the run ends where the blocks are at rest"
        if left > LONG:
            words += (
                "; Ctrl-C stops it at a checkpoint; fem.end_time, fem.time_step or "
                'fem.method = "static" make it shorter'
            )
        follow.line(words)

    return show
