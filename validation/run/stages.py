"""What a run is at, and its CPU times, in words."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_TELL: ContextVar[Callable[[str], None] | None] = ContextVar(
    "what shows the progress", default=None
)


@contextmanager
def telling(show: Callable[[str], None]) -> Iterator[None]:
    """Show what a run inside is at."""
    token = _TELL.set(show)
    try:
        yield
    finally:
        _TELL.reset(token)


def tell(words: str) -> None:
    """State what the run is at now, where anything shows it."""
    show = _TELL.get()
    if show is not None:
        show(words)


def cpu_words(seconds: dict[str, float]) -> str:
    """CPU time of each stage, and of the process so far: what was loaded before the run too."""
    reported = ", ".join(f"{stage} {value:.3f}" for stage, value in seconds.items())
    return f"{reported}; this process so far {time.process_time():.3f}"
