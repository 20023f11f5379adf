"""Panels of Versatile Blocks: copies of one shape, a square below and another tile above.

Source: Goertzen, Niemeyer, Plesken, "Topological interlocking via symmetry", Proc. fib Congress
(2022), and the arrangements that its authors publish with their simulations (p1, pg, p4: wallpaper
groups).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from geometry.parts.options import Count, Length, Options
from geometry.polyhedra.assembly import PolyhedralAssembly, polyhedral_assembly
from geometry.polyhedra.options import DetectionOptions
from geometry.polyhedra.polyhedron import Polyhedron, polyhedron

#: Corners of the block on a square of 2 × 2, height 1; x and y from a corner of the square.
_CORNERS = [
    [0, 0, 0], [2, 0, 0], [2, -2, 0], [0, -2, 0],
    [1, 1, 1], [2, 0, 1], [1, -1, 1], [0, -2, 1], [-1, -1, 1],
]  # fmt: skip
#: Triangles seen from outside, corners counted from 1.
_TRIANGLES = "124 234 765 987 975 195 215 562 726 327 437 784 489 491"


class PanelArrangement(StrEnum):
    """How blocks of a panel are turned, column by column and row by row."""

    P1 = "p1"
    PG = "pg"
    P4 = "p4"


#: Quarter turns of the blocks, repeated over rows (from below) and columns (from the left).
_TURNS = {
    PanelArrangement.P1: ((0,),),
    PanelArrangement.PG: ((0, 1),),
    PanelArrangement.P4: ((0, 1), (3, 2)),
}


def versatile_block(side: float, height: float) -> Polyhedron:
    """Versatile Block on a square of this side [mm], its middle at the origin."""
    points = (np.array(_CORNERS, dtype=np.float64) - [1, -1, 0]) * [side / 2, side / 2, height]
    triangles = np.array([[int(c) - 1 for c in word] for word in _TRIANGLES.split()])
    return polyhedron("versatile", points, triangles)


@dataclass(frozen=True)
class VersatilePanel(Options):
    """Panel of Versatile Blocks in a fixed ring of the same blocks."""

    side: Length
    """Of the square below [mm]."""
    height: Length
    """[mm]"""
    columns: Count
    """Free blocks along x."""
    rows: Count
    """Free blocks along y."""
    arrangement: PanelArrangement = PanelArrangement.P1
    """``p1``: all blocks alike; ``pg``: every other column turned by 90°; ``p4``: four turns round
    a point."""

    def build(self, detection: DetectionOptions | None = None) -> PolyhedralAssembly:
        """Lay the blocks, row by row."""
        shape, turns = versatile_block(self.side, self.height), _TURNS[self.arrangement]
        quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        blocks, fixed = [], []
        for j in range(self.rows + 2):
            for i in range(self.columns + 2):
                row = turns[j % len(turns)]
                turn = np.linalg.matrix_power(quarter, row[i % len(row)])
                blocks.append((shape, turn, np.array([i * self.side, j * self.side, 0.0])))
                fixed.append(i in (0, self.columns + 1) or j in (0, self.rows + 1))
        return polyhedral_assembly("versatile-panel", blocks, np.array(fixed), detection)
