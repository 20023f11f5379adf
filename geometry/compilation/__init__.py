"""Compiled functions: made or loaded when the first one is called, kept by their content.

The compiler takes a second to load; a program that calls no compiled function does not wait for it.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import geometry.compilation.started  # noqa: F401 - now, before any kernel


class Kernel:
    """A function that is compiled when it is called, or when a compiled function calls it."""

    def __init__(
        self, function: Callable[..., Any], options: dict[str, Any], *, cached: bool
    ) -> None:
        functools.update_wrapper(self, function)
        self._function, self._options, self._cached = function, options, cached

    @functools.cached_property
    def dispatcher(self) -> Any:
        """What numba makes of the function; in its place wherever numba meets it."""
        import numba

        from geometry.compilation.cache import KernelCache

        result = numba.njit(**self._options)(self._function)
        # Absent where compilation is disabled.
        if self._cached and hasattr(result, "targetoptions"):
            result._cache = KernelCache(self._function, result.targetoptions)
        return result

    def __call__(self, *arguments: Any) -> Any:
        """Call the compiled function."""
        return self.dispatcher(*arguments)

    def __getattr__(self, name: str) -> Any:
        """All else is the dispatcher's, the type that numba asks for too."""
        return getattr(self.dispatcher, name)

    def __reduce__(self) -> str:
        """By name, as functions are."""
        return str(self.__qualname__)


def njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """`numba.njit`; with ``cache=True`` the machine code is kept in a `KernelCache`."""
    cached = options.pop("cache", False)
    return lambda function: Kernel(function, options, cached=cached)


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
