"""Standard output that outlives its reader: text that cannot be printed ends no computation.

A pipe that closes or a full device would else end a command at its first line, and the answer that
was computed before, or would be written to files after, is lost.
"""

from __future__ import annotations

import io
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TextIO


class LastingOutput(io.FileIO):
    """A file descriptor that takes what cannot be written, and keeps the first error."""

    failure: OSError | None = None
    """Why text was lost; None as long as all of it could be written."""

    def write(self, data: object, /) -> int:
        """Write bytes; return how many there were, whether or not they could be written."""
        if self.failure is None:
            try:
                return super().write(data)  # type: ignore[arg-type]
            except OSError as error:
                self.failure = error
        return memoryview(data).nbytes  # type: ignore[arg-type]


@contextmanager
def lasting_output() -> Iterator[LastingOutput | None]:
    """Let standard output last; yields what keeps its error, or None where it is no file.

    Characters that the encoding of the terminal or pipe lacks are replaced.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace" if stream is sys.stdout else "backslashreplace")
    before = sys.stdout
    raw = _raw(before)
    if raw is None:
        yield None
        return
    sys.stdout = io.TextIOWrapper(
        io.BufferedWriter(raw),
        encoding=before.encoding,
        errors="replace",
        line_buffering=raw.isatty(),
    )
    try:
        yield raw
    finally:
        with suppress(ValueError):  # closed by the command
            sys.stdout.flush()
        sys.stdout = before


def _raw(stream: TextIO | None) -> LastingOutput | None:
    """The descriptor of a stream; None for a stream that has none."""
    try:
        if stream is None:
            return None
        stream.flush()
        return LastingOutput(stream.fileno(), "w", closefd=False)
    except (OSError, ValueError):
        return None
