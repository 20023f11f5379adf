"""Blocks that a scene chooses by number or by name."""

from __future__ import annotations

import difflib
from collections.abc import Sequence

from geometry.assembly import AssemblyError


def numbers_of(key: str, one: int | str, names: Sequence[str]) -> list[int]:
    """Blocks of a number or a name, as ``assembly.fixed`` has them.

    Parameters
    ----------
    key
        Of the scene, for messages.
    one
        Number, counted from 0, or name.
    names
        Of all blocks, empty without one, (n_blocks,).

    Raises
    ------
    AssemblyError
        For a number or a name that no block has.
    """
    found = [one] if isinstance(one, int) else [k for k, name in enumerate(names) if name == one]
    if found and found[0] < len(names):
        return found
    if isinstance(one, int):
        there = f"there are {len(names)} blocks, numbered 0 to {len(names) - 1}"
    else:
        known = list(dict.fromkeys(name for name in names if name))
        close = difflib.get_close_matches(one, known, n=3, cutoff=0.0)
        there = f"names are {', '.join(close)}, …" if close else "the blocks have no names"
    raise AssemblyError(f"{key}: got block {one!r}, but {there}")
