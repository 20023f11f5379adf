"""The one kind of error that the command line turns into one clear line and exit status 2."""

from __future__ import annotations


class InputError(ValueError):
    """Bad input: what was got, what is expected, what to do."""
