"""Domes of voussoirs as files: rings of flat-sided blocks on fixed ones, meridians aligned."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np

_FACES = ("1 2 3 4", "8 7 6 5", "1 5 6 2", "2 6 7 3", "3 7 8 4", "4 8 5 1")


def _lines(name: str, points: list[list[float]], faces: list[list[int]], first: int) -> list[str]:
    rows = [f"g {name}", *("v " + " ".join(f"{x:.12g}" for x in point) for point in points)]
    return rows + ["f " + " ".join(str(first + corner) for corner in face) for face in faces]


def write_dome(
    folder: Path, thickness: float, *, sectors: int, angles: list[float], cap: bool, scene: str
) -> Path:
    """Write rings between angles from the crown [°] of a dome of radius 1 m, and its scene.

    ``scene`` is what follows the blocks in the scene. The last angle is 90°; ``cap`` closes the
    first ring by one block.
    """
    radii = 1000.0 + thickness * np.array([-0.5, 0.5])
    around = 2.0 * np.pi * np.arange(sectors + 1) / sectors

    def at(r: float, angle: float, turn: float) -> list[float]:
        ring = r * np.sin(angle)
        return [ring * np.cos(turn), ring * np.sin(turn), r * np.cos(angle)]

    lines, first = list[str](), 1
    down = np.radians(angles)
    for k, (a, b) in enumerate([*pairwise(down), (down[-1], None)]):
        for q, (start, end) in enumerate(pairwise(around)):
            points = [at(r, a, turn) for turn in (start, end) for r in radii]
            if b is None:  # blocks below the last ring
                points += [[x, y, z - 200.0] for x, y, z in points]
            else:
                points += [at(r, b, turn) for turn in (start, end) for r in radii]
            order = [0, 1, 3, 2, 4, 5, 7, 6]
            faces = [[int(c) - 1 for c in face.split()] for face in _FACES]
            name = f"base_{q}" if b is None else f"ring{k}_{q}"
            lines += _lines(name, [points[c] for c in order], faces, first)
            first += 8
    if cap:
        points = [at(r, down[0], turn) for r in radii for turn in around[:-1]]
        sides = [
            [q, sectors + q, sectors + (q + 1) % sectors, (q + 1) % sectors] for q in range(sectors)
        ]
        inner, outer = list(range(sectors)), list(range(2 * sectors - 1, sectors - 1, -1))
        lines += _lines("cap", points, [inner, outer, *sides], first)
    (folder / "dome.obj").write_text("\n".join(lines) + "\n")
    fixed = ", ".join(f'"base_{q}"' for q in range(sectors))
    path = folder / "dome.toml"
    path.write_text(
        f'[block]\ntype = "mesh"\nunits = "mm"\n[[parts]]\nfile = "dome.obj"\n[assembly]\n'
        f"fixed = [{fixed}]\n[effects]\ngravity = [0.0, 0.0, -9810.0]\n{scene}"
    )
    return path
