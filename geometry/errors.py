"""What a library of this house raises on input that it cannot take, and files it cannot read."""

from __future__ import annotations

from pathlib import Path


class RefusedError(ValueError):
    """Base of all refusals: one line that says what was got, what is expected, what to do.

    The name of a subclass says which part of the statement is meant. Who wraps refusals into a
    message for people catches this one.
    """


def unreadable(path: Path) -> str | None:
    """Words for what stands in the place of a file that was to be read; None where one does.

    A pipe that nobody fills and a device without end would be read for ever.
    """
    try:
        if path.is_file():
            return None
        if path.is_dir():
            return "is a folder"
        there = path.exists()
    except (OSError, ValueError, RuntimeError) as error:  # names too long, links to themselves
        return f"cannot be looked up ({getattr(error, 'strerror', None) or error})"
    return "is a pipe or a device: save it as a file first" if there else "no such file"
