"""How long work will still take, said as soon as its pace is known, where that is long."""

from __future__ import annotations

import time

#: Times over which the pace is measured and their number, least time left that is said [s].
WINDOW, WINDOWS, LONG = 2.0, 3, 600.0

_UNITS = ((365.0 * 86400.0, "years"), (86400.0, "days"), (3600.0, "h"), (60.0, "min"))


def duration_words(seconds: float) -> str:
    """A time in the largest unit of which there are at least two: ``5.6 h``."""
    size, unit = next(((s, u) for s, u in _UNITS if seconds >= 2.0 * s), (1.0, "s"))
    return f"{seconds / size:.2g} {unit}"


class Forecast:
    """Tells once how long the rest takes at the best pace of its first seconds.

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
