"""What pictures of one call look like, where its scene asks for it, and matplotlib's settings."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Any

#: Points of letters of medium size.
_LETTERS = 10.8


@dataclass(frozen=True)
class Look:
    """What pictures are to look like."""

    footer: bool = True
    """Whether a line at the foot names the program and the day."""
    labels: str = "none"
    """What stands on the blocks of a drawn assembly: ``none``, ``numbers`` or ``names``."""


_LOOK: ContextVar[Look | None] = ContextVar("look of pictures", default=None)


def look() -> Look:
    """Return the look of the pictures of this call."""
    return _LOOK.get() or Look()


def settings() -> Any:
    """Settings of matplotlib. Text stays text: to be found, and to be set in another font."""
    return {"font.size": _LETTERS, "svg.fonttype": "none", "pdf.fonttype": 42}


@contextmanager
def looking(wanted: Look) -> Iterator[None]:
    """Draw all pictures in a look."""
    from matplotlib import rc_context

    _write_no_docstrings()
    token = _LOOK.set(wanted)
    try:
        with rc_context(settings()):
            yield
    finally:
        _LOOK.reset(token)


def _write_no_docstrings() -> None:
    """Spare matplotlib the docstrings of its setters: a third of the time that loading it takes.

    It writes them for every class of what can be drawn; a run that draws reads none.
    """
    from matplotlib.artist import Artist

    setters: Any = Artist
    setters._update_set_signature_and_docstring = classmethod(lambda _: None)
