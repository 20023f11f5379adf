"""How long work will still take, said as soon as its pace is known, where that is long."""

from __future__ import annotations

import time

#: Time over which the pace is measured unless said otherwise, and least time left that is said [s].
MEASURED, LONG = 2.0, 600.0

_UNITS = ((365.0 * 86400.0, "years"), (86400.0, "days"), (3600.0, "h"), (60.0, "min"))


def duration_words(seconds: float) -> str:
    """A time in the largest unit of which there are at least two: ``5.6 h``."""
    size, unit = next(((s, u) for s, u in _UNITS if seconds >= 2.0 * s), (1.0, "s"))
    return f"{seconds / size:.2g} {unit}"


class Forecast:
    """Tells once how long the rest takes at the pace of some seconds."""

    def __init__(self, measured: float = MEASURED) -> None:
        self._measured = measured
        self._first: tuple[float, float] | None = None
        self._told = False

    def left(self, done: float, total: float) -> str | None:
        """Words for the time left, once, where it is long; None else.

        The pace counts from the first call: what came before, such as compilation, comes once.

        Parameters
        ----------
        done, total
            Parts of the work, in one unit.
        """
        now = time.perf_counter()
        if self._first is None:
            self._first = (now, done)
        start, before = self._first
        if self._told or now - start < self._measured or done <= before:
            return None
        self._told = True
        seconds = (now - start) * (total - done) / (done - before)
        return duration_words(seconds) if seconds > LONG else None
