"""Bricks that are pushed, with friction of each pair."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from fem import CoulombFriction, LinearPenalty, Material, Problem
from geometry import Assembly
from geometry.block import box_block
from geometry.loads import LoadCase, PressureLoad
from geometry.parts.regions import HeldFace
from tests.support.commands import command

STONE = Material(density=2.4e-9, young_modulus=30_000.0, poisson_ratio=0.0)


#: Two dice of 20 mm on a plate, and between them and the plate the coefficients and the pressure.
EDGE, ROUGH, SMOOTH, PRESSURE = 20.0, 0.3, 0.1, 0.5


def dice(gap: float = 30.0) -> Assembly:
    plate = box_block((100.0, EDGE, 10.0), (10, 2, 1), name="plate", contact_faces=("z+",))
    die = box_block((EDGE,) * 3, (2, 2, 2), name="die", contact_faces=("z-",))
    places = [[0.0, 0.0, 0.0], [10.0, 0.0, 10.0], [30.0 + gap, 0.0, 10.0]]
    return Assembly(
        name="dice",
        shapes=(plate, die),
        shape_of=np.array([0, 1, 1]),
        rotations=np.tile(np.eye(3), (3, 1, 1)),
        translations=np.array(places),
        layer=np.array([0, 1, 1]),
        fixed=np.array([True, False, False]),
        unmatched_allowed=True,
    )


def pushed(friction: CoulombFriction | float, *, sliding: bool = False) -> Problem:
    """Dice under a pressure on the plate that is held, pushed along x by 0.05 mm."""
    blocks, both = dice(), np.array([1, 2])
    along = np.array([[1.0, 0.0, 0.0]])
    held = tuple(HeldFace(b, "x-", along, np.array([0.05, 0.0, 0.0])) for b in (1, 2))
    load = LoadCase(
        blocks, "pressed", (PressureLoad(both, "z+", PRESSURE),), blocks.fixed.copy(), held=held
    )
    law = LinearPenalty(500.0)
    return Problem(blocks, load, STONE, law=law, friction=friction, finite_sliding=sliding)


SCENE = """
[block]
type = "boxes"
boxes = [
    {size = [100.0, 80.0, 50.0], divisions = [2, 2, 1]},
    {size = [100.0, 80.0, 50.0], divisions = [2, 2, 1]},
    {size = [100.0, 80.0, 50.0], divisions = [2, 2, 1]},
]
[load]
pressure = 0.5
[materials.steel]
blocks = [2]
[effects.friction]
coefficient = 0.4
[[contact.pairs]]
between = [0, 1]
friction = 0.2
[[contact.pairs]]
between = ["steel", "concrete"]
friction = 0.1
"""


def frictionless_answer(scene: Path) -> dict[str, Any]:
    """What ``tubelock fem`` writes where it finds that friction changes less than 99 %."""
    on_its_mesh = ("--set", "fem.method=static", "--set", "fem.mesh=scene")
    on_its_mesh += ("--set", "fem.error_estimate=false")
    path = scene.with_suffix(".json")
    status, said, wrong = command(
        "fem", str(scene), *on_its_mesh, "--auto", "99%", "--json", str(path)
    )
    assert status == 0, wrong
    assert "left out: friction" in said
    data: dict[str, Any] = json.loads(path.read_text("utf-8"))
    return data
