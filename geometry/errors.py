"""What a library of this house raises on input that it cannot take."""

from __future__ import annotations


class RefusedError(ValueError):
    """Base of all refusals: one line that says what was got, what is expected, what to do.

    The name of a subclass says which part of the statement is meant. Who wraps refusals into a
    message for people catches this one.
    """
