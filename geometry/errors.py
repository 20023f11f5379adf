"""What a library of this house raises on input that it cannot take, and files it cannot read."""

from __future__ import annotations

import os
from math import isfinite
from numbers import Real
from pathlib import Path


class RefusedError(ValueError):
    """Base of all refusals: one line that says what was got, what is expected, what to do.

    The name of a subclass says which part of the statement is meant. Who wraps refusals into a
    message for people catches this one.
    """

    of_input = True
    """Whether the input is refused; else a run had begun, and failed."""


def is_number(value: object) -> bool:
    """Whether a value is a finite number: no text and no truth value."""
    return not isinstance(value, bool) and isinstance(value, Real) and isfinite(value)


def unreadable(path: Path) -> str | None:
    """Words for what stands in the place of a file that was to be read; None where one does.

    A pipe that nobody fills and a device without end would be read for ever.
    """
    try:
        os.fsencode(path)
        if path.is_file():
            return None
        if path.is_dir():
            return "is a folder"
        there = path.exists()
    except UnicodeEncodeError as error:
        return (
            f"file names of this locale ({error.encoding}) have no such characters; set "
            "PYTHONUTF8=1, or a UTF-8 locale"
        )
    except (OSError, ValueError, RuntimeError) as error:  # names too long, links to themselves
        return f"cannot be looked up ({getattr(error, 'strerror', None) or error})"
    return "is a pipe or a device: save it as a file first" if there else "no such file"
