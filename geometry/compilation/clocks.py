"""Clocks of compilation, which the compiler starts and stops once it is loaded."""

from __future__ import annotations

import time
from collections.abc import Callable


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
