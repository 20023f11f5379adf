"""Blocks as a designer draws them: arches, vaults, and their files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from geometry.mesh import FloatArray, IntArray

#: Points (n, 3), and polygons between them, counter-clockwise seen from outside.
Drawn = tuple[FloatArray, list[tuple[int, ...]]]

#: Faces of a box whose corners go round its bottom, then round its top.
BOX = [(3, 2, 1, 0), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]


def hexahedron(corners: Sequence[Sequence[float]] | FloatArray) -> Drawn:
    """Six-sided block of eight corners, round the bottom and round the top; turned outward."""
    points = np.asarray(corners, dtype=np.float64)
    arms = points[[1, 3, 4]] - points[0]
    faces = BOX if np.linalg.det(arms) > 0.0 else [face[::-1] for face in BOX]
    return points, list(faces)


def cuboid(low: Sequence[float], high: Sequence[float]) -> Drawn:
    """Box between two corners."""
    (x, y, z), (u, v, w) = low, high
    return hexahedron([(a, b, c) for c in (z, w) for a, b in ((x, y), (u, y), (u, v), (x, v))])


def arch(n: int = 11, radius: float = 1000.0, thickness: float = 150.0) -> dict[str, Drawn]:
    """Semicircular arch of n voussoirs V01 … on two supports, in mm with z up, 300 mm deep."""
    r, s = radius - thickness / 2, radius + thickness / 2
    angles = np.linspace(np.pi, 0.0, n + 1)
    blocks = {}
    for k, (a, b) in enumerate(pairwise(angles)):
        ring = [(r, b), (s, b), (s, a), (r, a)]
        blocks[f"V{k + 1:02d}"] = hexahedron(
            [(q * np.cos(t), y, q * np.sin(t)) for y in (-150.0, 150.0) for q, t in ring]
        )
    blocks["S_left"] = cuboid((-s, -150.0, -200.0), (-r, 150.0, 0.0))
    blocks["S_right"] = cuboid((r, -150.0, -200.0), (s, 150.0, 0.0))
    return blocks


def abeille(n: int) -> tuple[dict[str, Drawn], list[str]]:
    """Abeille's flat vault of n x n blocks, and the names of the ring round them."""
    a, h, slope = 100.0, 60.0, 0.3
    blocks: dict[str, Drawn] = {}
    ring = []
    for i, j in np.ndindex(n + 2, n + 2):
        at_border = [k in (0, n + 1) for k in (i, j)]
        if all(at_border):
            continue
        turn = 1.0 if (i + j) % 2 == 0 else -1.0
        corners = []
        for z in (-h / 2, h / 2):
            x, y = a / 2 + turn * slope * z, a / 2 - turn * slope * z
            ends = [(-x, -y), (x, -y), (x, y), (-x, y)]
            corners += [(i * a + u, j * a + v, z) for u, v in ends]
        name = f"{'ring' if any(at_border) else 'block'} {i} {j}"
        blocks[name] = hexahedron(corners)
        if any(at_border):
            ring.append(name)
    return blocks, ring


def triangles_of(drawn: Drawn, rng: np.random.Generator | None = None) -> IntArray:
    """Triangles from one corner of each polygon, a random one with ``rng``; (n, 3)."""
    result = []
    for polygon in drawn[1]:
        first = 0 if rng is None else int(rng.integers(len(polygon)))
        face = polygon[first:] + polygon[:first]
        result += [(face[0], face[k], face[k + 1]) for k in range(1, len(face) - 1)]
    return np.array(result)


def write_obj(path: Path, blocks: Mapping[str, Drawn], scale: float = 1.0) -> None:
    """OBJ with an object for each block."""
    lines, first = [], 1
    for name, (points, faces) in blocks.items():
        lines.append(f"o {name}")
        lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in (scale * points).tolist()]
        lines += ["f " + " ".join(str(first + k) for k in face) for face in faces]
        first += len(points)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
