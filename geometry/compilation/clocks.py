"""CPU time of what runs, without what is compiled, once a machine."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager


class Compiling:
    """Counts the CPU time that functions are compiled in, and tells when the first one is."""

    def __init__(self, tell: Callable[[], None] | None) -> None:
        self.cpu_seconds = 0.0
        self._tell = tell
        self._depth = 0  # a function is compiled with those it calls
        self._start = 0.0

    def start(self) -> None:
        """Start the clock at the outermost function."""
        if self._tell is not None:
            self._tell()
            self._tell = None
        if self._depth == 0:
            self._start = time.process_time()
        self._depth += 1

    def stop(self) -> None:
        """Stop it there."""
        self._depth -= 1
        if self._depth == 0:
            self.cpu_seconds += time.process_time() - self._start


#: Those that count now. The compiler, once it is loaded, starts and stops them.
CLOCKS: list[Compiling] = []


@contextmanager
def compiling(tell: Callable[[], None] | None = None) -> Iterator[Compiling]:
    """Watch over what is compiled inside: work is timed without it, and people are told once.

    Parameters
    ----------
    tell
        Called before the first function is compiled; never where all are loaded.
    """
    clock = Compiling(tell)
    CLOCKS.append(clock)
    try:
        yield clock
    finally:
        CLOCKS.remove(clock)


class Stopwatch:
    """A stopwatch that stands still while functions are compiled."""

    def __init__(self, compiled: Compiling) -> None:
        self._compiled = compiled
        self._start = time.process_time()
        self._last = self._work()
        self._seconds: dict[str, float] = {}

    def _work(self) -> float:
        return time.process_time() - self._compiled.cpu_seconds

    def lap(self, name: str) -> None:
        """End a stage: what was worked since the one before is its time."""
        now = self._work()
        self._seconds[name] = self._seconds.get(name, 0.0) + now - self._last
        self._last = now

    def seconds(self) -> dict[str, float]:
        """CPU time of each stage, of compilation if there was any, and of everything [s]."""
        compiled = self._compiled.cpu_seconds
        reported = {"compile": compiled} if compiled else {}
        return self._seconds | reported | {"total": time.process_time() - self._start}


@contextmanager
def timed_stages() -> Iterator[Stopwatch]:
    """Time the stages of what runs inside."""
    with compiling() as compiled:
        yield Stopwatch(compiled)


def summed(spent: dict[str, float], before: dict[str, float]) -> dict[str, float]:
    """Return the times of a run with those of work that was done for it before."""
    return spent | {name: spent.get(name, 0.0) + seconds for name, seconds in before.items()}
