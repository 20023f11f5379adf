"""Blocks that a scene chooses by number or by name."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence

import numpy as np

from geometry.mesh import IntArray
from geometry.parts.placed import AnyBlocks, AssemblyError


def chosen_blocks(key: str, chosen: Iterable[int | str], assembly: AnyBlocks) -> IntArray:
    """Numbers of all blocks that are chosen; a name may be that of several.

    Arguments and errors as of `numbers_of`.
    """
    names = assembly.names or ("",) * assembly.n_blocks
    result = [number for one in chosen for number in numbers_of(key, one, names)]
    return np.array(list(dict.fromkeys(result)), dtype=np.int64)


def chosen_block(key: str, one: int | str, assembly: AnyBlocks) -> int:
    """Number of the only block that is meant; as `chosen_blocks`."""
    result = chosen_blocks(key, [one], assembly)
    if len(result) > 1:
        raise AssemblyError(
            f"{key}: got {one!r}, the name of {len(result)} blocks; expected a number, such as "
            f"{result[0]}"
        )
    return int(result[0])


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
    """
    result = [one] if isinstance(one, int) else [k for k, name in enumerate(names) if name == one]
    if result and 0 <= result[0] < len(names):
        return result
    if isinstance(one, int):
        there = f"there are {len(names)} blocks, numbered 0 to {len(names) - 1}"
    else:
        known = list(dict.fromkeys(name for name in names if name))
        close = difflib.get_close_matches(one, known, n=3, cutoff=0.0)
        there = f"names are {', '.join(close)}, …" if close else "the blocks have no names"
    raise AssemblyError(f"{key}: got block {one!r}, but {there}")
