"""A limit of CPU time that iterations ask for: what is not done by then is left undone."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_deadline: ContextVar[float] = ContextVar("deadline", default=float("inf"))


class OutOfTimeError(Exception):
    """The limit of CPU time is reached; nothing between a limit and an iteration handles it."""


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Limit what is solved within to so much CPU time of this process [s]."""
    token = _deadline.set(time.process_time() + seconds)
    try:
        yield
    finally:
        _deadline.reset(token)


def check_time() -> None:
    """Raise `OutOfTimeError` where a limit is reached; called once an iteration."""
    if time.process_time() > _deadline.get():
        raise OutOfTimeError
