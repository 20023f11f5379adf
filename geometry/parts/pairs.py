"""Numbers of pairs of blocks, such as coefficients of friction: a default, and those of some."""

from __future__ import annotations

import numpy as np

from geometry.errors import RefusedError
from geometry.mesh import FloatArray, IntArray

#: Blocks and their number, whichever of the two is named first.
OfPairs = tuple[tuple[int, int, float], ...]


class PairError(RefusedError):
    """Pairs of blocks that are none: which, and what to do."""


def pair_values(
    default: float, of_pairs: OfPairs, block_m: IntArray, block_s: IntArray
) -> float | FloatArray:
    """Number of each of some pairs of blocks, (n,); the default itself where no pair has another.

    Parameters
    ----------
    default
        Of pairs that are not named.
    of_pairs
        Of those that are.
    block_m, block_s
        Blocks of the pairs, (n,).
    """
    if not of_pairs:
        return default
    named = np.sort(np.array([pair[:2] for pair in of_pairs], dtype=np.int64), axis=1)
    values = np.array([pair[2] for pair in of_pairs])
    n = int(max(named.max(), block_m.max(initial=0), block_s.max(initial=0))) + 1
    keys = named[:, 0] * n + named[:, 1]
    order = np.argsort(keys)
    requested = np.minimum(block_m, block_s) * n + np.maximum(block_m, block_s)
    place = order[np.minimum(np.searchsorted(keys, requested, sorter=order), len(keys) - 1)]
    return np.where(keys[place] == requested, values[place], default)


def check_pairs(
    key: str,
    of_pairs: OfPairs,
    n_blocks: int,
    joints: tuple[IntArray, IntArray] | None = None,
) -> None:
    """Reject pairs of blocks that do not exist, are named twice, or do not touch.

    Parameters
    ----------
    key
        Of the statement, for messages.
    of_pairs
        The pairs.
    n_blocks
        Number of blocks.
    joints
        Blocks that touch, (n,) each; None: any two may come to touch.
    """
    known: set[tuple[int, int]] = set()
    for a, b, _ in of_pairs:
        if a == b or not (0 <= a < n_blocks and 0 <= b < n_blocks):
            raise PairError(
                f"{key}: got blocks {a} and {b}; expected two different ones of 0 to {n_blocks - 1}"
            )
        pair = min(a, b), max(a, b)
        if pair in known:
            raise PairError(f"{key}: blocks {a} and {b} are named twice; expected once")
        known.add(pair)
    if not known or joints is None:
        return
    touching = set(zip(np.minimum(*joints).tolist(), np.maximum(*joints).tolist(), strict=True))
    apart = sorted(known - touching)
    if apart:
        a, b = apart[0]
        raise PairError(f"{key}: blocks {a} and {b} do not touch; expected two that do")
