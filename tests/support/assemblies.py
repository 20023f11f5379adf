"""Small assemblies of solids that several tests share."""

from __future__ import annotations

import numpy as np

from geometry import PolyhedralAssembly, convex_polyhedron
from geometry.families.masonry import box
from geometry.polyhedra.assembly import polyhedral_assembly
from geometry.polyhedra.polyhedron import polyhedron


def boxes(
    *spans: tuple[tuple[float, float, float], tuple[float, float, float]], fixed: int
) -> PolyhedralAssembly:
    """Boxes from corner to corner, the first ones fixed."""
    blocks = [
        (box(tuple(np.subtract(high, low))), np.eye(3), np.array(low, np.float64))
        for low, high in spans
    ]
    return polyhedral_assembly("boxes", blocks, np.arange(len(blocks)) < fixed)


def dovetail() -> PolyhedralAssembly:
    """A tail in a fixed socket, 80 mm deep, with flanks of 10 to 25 that hold it from above."""
    socket = [(-60, 0), (60, 0), (60, 60), (15, 60), (25, 35), (-25, 35), (-15, 60), (-60, 60)]
    ears = [(0, 1, 4), (1, 2, 4), (2, 3, 4), (0, 4, 5), (0, 5, 7), (5, 6, 7)]
    points = np.array([(x, y, z) for y in (0.0, 80.0) for x, z in socket], dtype=np.float64)
    ends = [*ears, *((c + 8, b + 8, a + 8) for a, b, c in ears)]
    sides = [(i, i + 8, (i + 1) % 8 + 8) for i in range(8)]
    sides += [(i, (i + 1) % 8 + 8, (i + 1) % 8) for i in range(8)]
    tail = np.array([(x, y, z) for y in (0.0, 80.0) for x, z in socket[3:7]], dtype=np.float64)
    blocks = (
        polyhedron("socket", points, np.array([*ends, *sides])),
        convex_polyhedron("tail", tail),
    )
    placed = [(block, np.eye(3), np.zeros(3)) for block in blocks]
    return polyhedral_assembly("dovetail", placed, np.array([True, False]))
