"""Files that are whole or not there."""

from __future__ import annotations

import os
import secrets
from collections.abc import Callable
from pathlib import Path


def write_whole(path: Path, write: Callable[[Path], object]) -> None:
    """Let ``write`` fill a temporary sibling with the same suffix, then rename it to ``path``.

    Its name is new and nobody can foresee it: calls that write the same file at once each publish a
    whole one, and no link that lies there leads elsewhere.
    """
    partial = path.with_name(f".partial-{secrets.token_hex(8)}{path.suffix}")
    os.close(os.open(partial, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    try:
        write(partial)
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)
