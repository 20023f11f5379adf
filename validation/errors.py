"""Errors that commands turn into one clear line and an exit status."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import NoReturn

from geometry.errors import RefusedError


class InputError(ValueError):
    """Bad input: what was got, what is expected, what to do."""


def _stop(words: str, status: int = 2) -> NoReturn:
    print(" ".join(words.split("\n")), file=sys.stderr)
    raise SystemExit(status)


def run_command(command: Callable[[], object]) -> None:
    """Run a command; the only place that turns errors into exit statuses."""
    try:
        command()
    except (InputError, RefusedError) as error:
        _stop(f"error: {error}")
    except MemoryError as error:
        _stop(
            f"error: this needs more memory than there is ({error}); "
            "take fewer elements ([mesh]) or fewer layers (assembly.layers)"
        )
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        _stop(
            f"error: {where}{error.strerror or error}; the output could not be written or a file "
            "not be read: make room, or choose another place"
        )
    except KeyboardInterrupt:
        _stop("interrupted", 130)
