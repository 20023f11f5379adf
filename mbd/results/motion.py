"""Which blocks a load moves most, and how."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np

from geometry.assembly import Assembly
from geometry.mesh import FloatArray
from geometry.parts.placed import AnyBlocks
from geometry.parts.rows import Row
from mbd.system import RigidSystem, placed_motion

#: Blocks that move less than this part of the largest displacement are not among those that move
#: most; and how many are named.
_MOST, _NAMED = 0.5, 3
#: Mechanisms are exact to 1e-6: sizes that differ by less than these decimals are one.
_DIGITS = 4
#: Displacements and components of directions that are none in words.
_NONE = 0.1
_AXES = "xyz"


@dataclass(frozen=True)
class BlockMotion:
    """First-order motion of a block; of all blocks the largest displacement of a point is 1."""

    block: int
    displacement: FloatArray
    """Of its mass centroid, (3,) [-]."""
    turn: FloatArray
    """Rotation times the largest arm of its points, (3,) [-]."""
    weighs_down: bool = True
    """Whether weight acts along -z, which is called down then."""

    @property
    def words(self) -> str:
        """Displacement along axes, and axis about which it turns."""
        parts = []
        for axis, value in zip(_AXES, self.displacement.tolist(), strict=True):
            down = axis == "z" and self.weighs_down
            names = ("up", "down") if down else (f"+{axis}", f"-{axis}")
            if abs(value) >= _NONE:
                parts.append(f"{names[value < 0]} {abs(value):.2g}")
        angle = float(np.linalg.norm(self.turn))
        if angle >= _NONE:
            parts.append(f"turns about {_axis(self.turn / angle)}")
        return ", ".join(parts)


def _axis(direction: FloatArray) -> str:
    most = int(np.abs(direction).argmax())
    if np.abs(np.delete(direction, most)).max() < _NONE:
        return f"{'-' if direction[most] < 0 else ''}{_AXES[most]}"
    return f"({', '.join(f'{x:.2f}' for x in direction)})"


@dataclass(frozen=True)
class DrivenMotion:
    """How blocks move that a load drives."""

    blocks: tuple[BlockMotion, ...]
    """All that move most, the first one most."""
    proved: bool
    """Whether it is a mechanism that no contact forces hold; else where blocks went that did not
    come to rest."""
    named: Sequence[str] = field(repr=False)
    """Names of these blocks."""

    @property
    def first(self) -> str:
        """The block that moves most, and how."""
        return f"block {self.named[0]} moves most: {self.blocks[0].words}"

    @property
    def words(self) -> str:
        """The blocks that move most, and how."""
        each = [f"{n}: {b.words}" for n, b in zip(self.named, self.blocks, strict=True)]
        more = len(each) - _NAMED
        return "; ".join([*each[:_NAMED], *([f"{more} more"] if more > 0 else [])])

    @property
    def rows(self) -> list[Row]:
        """One row."""
        words = self.words + ("" if self.proved else " (not proved)")
        return [Row("blocks that move most", words, group="verdict")]

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        blocks = [
            {"block": b.block, "displacement": b.displacement.tolist(), "turn": b.turn.tolist()}
            for b in self.blocks
        ]
        return {"proved": self.proved, "blocks": blocks}


def driven_motion(system: RigidSystem, rows: FloatArray, *, proved: bool) -> DrivenMotion:
    """Name the blocks that move most, of a motion (n_rows,) to any scale.

    Their weight says which way is down.
    """
    assembly, weight = system.blocks, system.stated.rigid_weight
    moving = placed_motion(assembly, rows, ~system.load.fixed)
    total = np.zeros(3) if weight is None else weight[:, :3].sum(axis=0)
    down = bool(total[2] < 0.0 and np.abs(total[:2]).max() <= 1e-6 * -total[2])
    sizes, arms = np.zeros(len(moving)), np.zeros(len(moving))
    for block in np.flatnonzero(moving.any(axis=1)).tolist():
        points = assembly.place(block, _points(assembly, block)) - assembly.centroids[block]
        moved = moving[block, :3] + np.cross(moving[block, 3:], points)
        sizes[block] = np.linalg.norm(moved, axis=1).max()
        arms[block] = np.linalg.norm(points, axis=1).max()
    largest = float(sizes.max(initial=0.0)) or 1.0
    sizes = np.round(sizes / largest, _DIGITS)  # symmetric blocks: the same first one always
    order = np.argsort(-sizes, kind="stable")
    most = order[sizes[order] >= _MOST].tolist()
    blocks = tuple(
        BlockMotion(
            block,
            moving[block, :3] / largest,
            moving[block, 3:] * arms[block] / largest,
            down,
        )
        for block in most
    )
    return DrivenMotion(blocks, proved, [assembly.named(block) for block in most])


def _points(assembly: AnyBlocks, block: int) -> FloatArray:
    if isinstance(assembly, Assembly):
        return assembly.shape(block).mesh.nodes
    return cast("FloatArray", assembly.shape(block).points)
