"""In which order blocks are placed, and which of them may be propped."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from geometry.assembly import Assembly
from geometry.errors import RefusedError
from geometry.mesh import BoolArray
from geometry.parts.block_selection import numbers_of
from geometry.parts.placed import AnyBlocks
from mbd.building.take_out import take_out
from mbd.options import Stages

#: Heights that differ by less than this part of a block's length are one layer.
_LEVEL = 1e-3


class StagesError(RefusedError):
    """An order that cannot be followed; the message names the block."""


@dataclass(frozen=True)
class Order:
    """What is stated, of some blocks."""

    stated: Stages
    blocks: AnyBlocks
    fixed: BoolArray

    def placed(self, tell: Callable[[str], None]) -> list[tuple[int, ...]]:
        """Blocks that each stage places."""
        if self.stated.order == "layers":
            return _layers(self.blocks, self.fixed)
        if self.stated.order == "found":
            out = take_out(self.blocks, tell)
            if out.left:
                raise StagesError(f"stages.order: 'found' finds none: {out.words}; state a list")
            return list(out.assembly_order)
        result: list[tuple[int, ...]] = []
        for one in self.stated.order:
            several = one if isinstance(one, tuple) else (one,)
            stage = [k for each in several for k in self._numbers("order", each)]
            again = [k for k in stage if any(k in other for other in result) or stage.count(k) > 1]
            if again:
                raise StagesError(
                    f"stages.order: got block {self.blocks.named(again[0])} twice; expected each "
                    "once"
                )
            if not stage:
                raise StagesError(
                    "stages.order: got a stage without blocks; expected a block, or a list of them"
                )
            result.append(tuple(stage))
        known = {k for stage in result for k in stage}
        missing = [k for k in np.flatnonzero(~self.fixed).tolist() if k not in known]
        if missing:
            raise StagesError(
                f"stages.order: block {self.blocks.named(missing[0])} is in no stage"
                + (f", nor are {len(missing) - 1} more" if len(missing) > 1 else "")
                + "; expected every free block once"
            )
        return result

    def may_be_propped(self) -> BoolArray:
        """Which blocks may be propped, (n_blocks,)."""
        result = np.full(self.blocks.n_blocks, self.stated.props is None)
        for one in self.stated.props or ():
            result[self._numbers("props", one)] = True
        return result

    def _numbers(self, key: str, one: int | str) -> list[int]:
        names = self.blocks.names or ("",) * self.blocks.n_blocks
        return numbers_of(f"stages.{key}", one, names)


def _layers(blocks: AnyBlocks, fixed: BoolArray) -> list[tuple[int, ...]]:
    """Blocks of each layer, or of each height, the lowest first; a last fixed layer last."""
    if isinstance(blocks, Assembly):
        level = blocks.layer
    else:
        height = blocks.centroids[:, 2]
        order = np.argsort(height, kind="stable")
        step = np.diff(height[order], prepend=height[order[0]])
        level = np.empty(len(order), np.int64)
        level[order] = np.cumsum(step > _LEVEL * blocks.characteristic_length)
    first = level[~fixed].min()
    stages = []
    for one in np.unique(level):
        here = np.flatnonzero(level == one)
        # Fixed blocks among free ones and below them are there before.
        late = here if one > level[~fixed].max() else here[~fixed[here]]
        if one >= first and len(late):
            stages.append(tuple(late.tolist()))
    return stages
