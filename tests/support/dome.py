"""Domes of radius 1 m: rings of flat-sided voussoirs on fixed blocks, meridians aligned."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from geometry import PolyhedralAssembly, Polyhedron, convex_polyhedron
from geometry.polyhedra.assembly import polyhedral_assembly


def voussoirs(
    thickness: float, sectors: int, angles: Any, *, cap: bool = False
) -> dict[str, Polyhedron]:
    """Blocks by name between angles from the crown [°], the last of which is 90.

    Blocks whose names begin with "base" carry the last ring; ``cap`` closes the first one.
    """
    radii = 1000.0 + thickness * np.array([-0.5, 0.5])
    around = 2.0 * np.pi * np.arange(sectors + 1) / sectors
    down = np.radians(angles)

    def at(r: float, angle: float, turn: float) -> list[float]:
        ring = r * np.sin(angle)
        return [ring * np.cos(turn), ring * np.sin(turn), r * np.cos(angle)]

    points: dict[str, list[list[float]]] = {}
    for q, turns in enumerate(pairwise(around)):
        for k, rings in enumerate(pairwise(down)):
            points[f"ring{k}_{q}"] = [at(r, a, t) for r in radii for a in rings for t in turns]
        foot = [at(r, down[-1], t) for r in radii for t in turns]
        points[f"base_{q}"] = foot + [[x, y, z - 200.0] for x, y, z in foot]
    if cap:
        points["cap"] = [at(r, down[0], t) for r in radii for t in around[:-1]]
    # At the crown two corners are one.
    return {
        name: convex_polyhedron(name, np.unique(np.round(corners, 9), axis=0))
        for name, corners in points.items()
    }


def hemisphere(thickness: float, lunes: int, courses: int) -> PolyhedralAssembly:
    """A hemisphere of ``thickness`` times its radius, its base fixed."""
    blocks = voussoirs(1000.0 * thickness, lunes, np.linspace(0.0, 90.0, courses + 1))
    places = [(block, np.eye(3), np.zeros(3)) for block in blocks.values()]
    fixed = np.array([name.startswith("base") for name in blocks])
    return polyhedral_assembly("dome", places, fixed)


def write_dome(folder: Path, blocks: dict[str, Polyhedron], scene: str) -> Path:
    """Write blocks and their scene, of which ``scene`` is what follows the weight."""
    lines, first = list[str](), 1
    for name, block in blocks.items():
        lines += [f"g {name}", *("v " + " ".join(f"{x:.12g}" for x in p) for p in block.points)]
        lines += ["f " + " ".join(str(first + c) for c in t) for t in block.triangles]
        first += len(block.points)
    (folder / "dome.obj").write_text("\n".join(lines) + "\n")
    fixed = ", ".join(f'"{name}"' for name in blocks if name.startswith("base"))
    path = folder / "dome.toml"
    path.write_text(
        f'[block]\ntype = "mesh"\nunits = "mm"\n[[parts]]\nfile = "dome.obj"\n[assembly]\n'
        f"fixed = [{fixed}]\n[effects]\ngravity = [0.0, 0.0, -9810.0]\n{scene}"
    )
    return path
