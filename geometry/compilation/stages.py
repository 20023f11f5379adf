"""CPU time of the stages of a computation, without what is compiled, once a machine."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from geometry.compilation import compiling
from geometry.compilation.clocks import Compiling


class Stages:
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
def stages() -> Iterator[Stages]:
    """Time the stages of what runs inside."""
    with compiling() as compiled:
        yield Stages(compiled)


def summed(spent: dict[str, float], before: dict[str, float]) -> dict[str, float]:
    """Return the times of a run with those of work that was done for it before."""
    return spent | {name: spent.get(name, 0.0) + seconds for name, seconds in before.items()}
