"""What a run is at, in words."""

from __future__ import annotations

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
