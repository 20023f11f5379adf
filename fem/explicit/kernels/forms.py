"""One source for every width of the vectors, and one for one thread and several."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from geometry.compilation import Kernel, njit

#: Of every compiled loop: division as NumPy does it, and the interpreter lock released.
OPTIONS: dict[str, Any] = {"error_model": "numpy", "nogil": True}


class Forms(NamedTuple):
    """A loop over chunks compiled twice."""

    serial: Kernel
    """For one thread."""
    parallel: Kernel
    """Chunks shared among threads; the same bits, since each writes its own rows and sums."""

    def form(self, *, parallel: bool) -> Kernel:
        """One of the two."""
        return self.parallel if parallel else self.serial


def serial_and_parallel(loop: Callable[..., None]) -> Forms:
    """Compile a loop over ``prange``: one thread takes it for ``range``."""
    serial = njit(cache=True, **OPTIONS)(loop)
    return Forms(serial, njit(cache=True, parallel=True, **OPTIONS)(loop))


def over_lanes(make: Callable[[int], Callable[..., None]], width: int) -> Callable[..., None]:
    """Make a walk over the copies from the work on vectors of one width.

    Parameters
    ----------
    make
        ``make(w)`` is a compiled ``run(first, lanes, *arguments)`` for ``w`` copies from ``first``
        on.
    width
        Of the widest vectors, a power of two.

    Returns
    -------
    Callable[..., None]
        ``walk(first, lanes, *arguments)``: all copies from ``first`` on, with the widest vectors
        that fit, then each narrower one.
    """
    run = make(width)
    rest = over_lanes(make, width // 2) if width > 1 else None

    if rest is None:

        @njit(**OPTIONS, forceinline=True)
        def walk(first, lanes, *arguments):  # type: ignore[no-untyped-def]
            while first < lanes:
                run(first, lanes, *arguments)
                first += 1

    else:

        @njit(**OPTIONS, forceinline=True)
        def walk(first, lanes, *arguments):  # type: ignore[no-untyped-def]
            while first + width <= lanes:
                run(first, lanes, *arguments)
                first += width
            rest(first, lanes, *arguments)

    return walk
