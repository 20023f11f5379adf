"""Assemblies drawn by chance, of all families and of own blocks, and pairs of friction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from fem import Problem, concrete
from geometry import Assembly, convex_polyhedron
from mbd import analyse
from tests.support.dome import voussoirs
from validation import load_case

#: Small ones of each family: scene, keys with what they are drawn from.
FAMILIES: tuple[tuple[str, Mapping[str, Any]], ...] = (
    ("arch", {"assembly.voussoirs": (7, 15), "block.thickness": (105.0, 200.0)}),
    ("wall", {"assembly.columns": (2, 4), "assembly.rows": (2, 4)}),
    ("tetrahedra", {"assembly.columns": (2, 3), "assembly.rows": (2, 3)}),
    ("octahedra", {"assembly.rings": (0, 1)}),
    ("cubes", {"assembly.rings": (0, 1)}),
    ("versatile", {"assembly.columns": (2, 3), "assembly.rows": (2, 3)}),
    ("voxel-puzzle", {}),
    ("brick-stack", {"assembly.layers": (1, 2)}),
    ("planar-sine", {"assembly.columns": (2, 3), "assembly.layers": (2, 3)}),
    ("osteomorphic", {"assembly.columns": (2, 3), "assembly.layers": (2, 3)}),
    ("tsb1-pipe", {"assembly.layers": (1, 2)}),
    ("thb0-tunnel", {"assembly.layers": (1, 2)}),
    ("wall-with-roller", {}),
)
#: Meshes of these, coarse.
MESHES: Mapping[str, Mapping[str, Any]] = {
    "tsb1-pipe": {"mesh.around": 12, "mesh.radial": 1, "mesh.axial": 4},
    "thb0-tunnel": {"mesh.edge": 4, "mesh.radial": 1},
}


def _tetrahedra(rng: np.random.Generator) -> Assembly:
    """A panel of 3 × 3 tetrahedra in a fixed ring, one of them missing."""
    gone, blocks, height = tuple(rng.integers(0, 3, 2)), {}, 50.0 * np.sqrt(2.0)
    for i, j in np.ndindex(5, 5):
        edges = (i in (0, 4)) + (j in (0, 4))
        if edges == 2 or (i - 1, j - 1) == gone:
            continue
        ways = ((1, 0), (0, 1)) if (i + j) % 2 else ((0, 1), (1, 0))
        corners = [
            (100 * i + 100 * s * a, 100 * j + 100 * s * b, z)
            for (a, b), z in zip(ways, (height, -height), strict=True)
            for s in (-1, 1)
        ]
        blocks[f"{'F' if edges else 'T'} {i} {j}"] = convex_polyhedron("tetra", np.array(corners))
    fixed = [name for name in blocks if name[0] == "F"]
    return Assembly.from_blocks(blocks.values(), names=list(blocks), fixed=fixed)


def _heap(rng: np.random.Generator) -> Assembly:
    """Boxes, shifted and turned a little, one on the other on a fixed one."""
    blocks, height = [], 0.0
    for _ in range(int(rng.integers(3, 6))):
        size, shift = rng.uniform(60.0, 120.0, 3), rng.uniform(-25.0, 25.0, 2)
        corners = np.array(list(np.ndindex(2, 2, 2))) * size - [*(0.5 * size[:2]), 0.0]
        turn = rng.uniform(-0.5, 0.5)
        around = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        corners[:, :2] = corners[:, :2] @ around.T + shift
        blocks.append(convex_polyhedron("box", corners + np.array([0.0, 0.0, height])))
        height += size[2]
    return Assembly.from_blocks(blocks, fixed=0)


def _dome(rng: np.random.Generator) -> Assembly:
    blocks = voussoirs(rng.uniform(35.0, 90.0), 8, np.linspace(20.0, 90.0, 4))
    fixed = [name for name in blocks if name.startswith("base")]
    return Assembly.from_blocks(blocks.values(), names=list(blocks), fixed=fixed)


OWN = {"panel with a gap": _tetrahedra, "heap": _heap, "dome": _dome}
KINDS = (*(scene for scene, _ in FAMILIES), *OWN)


def drawn(kind: str, rng: np.random.Generator) -> Problem:
    """A problem of a kind without friction; half of them under a tilted weight."""
    tilt = rng.normal(size=3) * (0.0 if rng.random() < 0.5 else 0.1)
    gravity = 9810.0 * (tilt - [0.0, 0.0, 1.0])
    if kind in OWN:
        return Problem(OWN[kind](rng), None, concrete, gravity=tuple(gravity))
    keys = dict(FAMILIES)[kind]
    settings = {**MESHES.get(kind, {}), "rigid.margin": False, "rigid.collapse": False}
    for key, (low, high) in keys.items():
        whole = isinstance(low, int)
        settings[key] = int(rng.integers(low, high + 1)) if whole else float(rng.uniform(low, high))
    problem = load_case(kind, [f"{k}={str(v).lower()}" for k, v in settings.items()]).problem
    if problem.gravity is not None or not problem.rigid_load.wrenches.any():
        problem = replace(problem, gravity=tuple(gravity))
    return replace(problem, friction=None)


def balances(problem: Problem, friction: float) -> list[bool | None]:
    """Whether forces balance the load by faces, and with edges and corners; None: not decided."""
    result = analyse(replace(problem, friction=friction)).details
    return [each.verdict.holds for each in (result, result.with_edges or result)]


def less_with_more(
    verdicts: Sequence[Sequence[bool | None]], frictions: Sequence[float]
) -> list[str]:
    """Where `balances` finds less with more friction, in growing order: a line each."""
    return [
        f"{contacts}: carried at {frictions[k]:.4g}, {after[row]} at {frictions[k + 1]:.4g}"
        for k, (before, after) in enumerate(pairwise(verdicts))
        for row, contacts in enumerate(("faces", "faces, edges, corners"))
        if before[row] and not after[row]
    ]
