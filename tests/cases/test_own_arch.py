"""An own arch of voussoirs, as blocks in memory, on ground that is tilted."""

from __future__ import annotations

import numpy as np

from fem import Material, Problem, solve_static
from geometry import Assembly
from mbd import analyse
from tests.support.answers import PLAIN

#: Corners of the six sides of a voussoir.
SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def voussoir(low: float, high: float) -> list[tuple[float, float, float]]:
    """Corners of a voussoir between two angles [mm]."""
    return [
        (radius * np.cos(angle), y, radius * np.sin(angle))
        for y in (0.0, 400.0)
        for radius in (1500.0, 1750.0)
        for angle in (high, low)
    ]


def test_an_arch_stands_on_tilted_ground() -> None:
    """Joints that only touch as built close where the weight presses them, and do not float apart.

    Rigid blocks carry it by friction (the thrust line stays within the ring), so elastic ones have
    a state, in which every block is in balance to what the iteration leaves, 1e-8 of the loads.
    """
    angles = np.radians(np.linspace(165.0, 15.0, 12))
    blocks = [(voussoir(*pair), SIDES) for pair in zip(angles[1:], angles[:-1], strict=True)]
    arch = Assembly.from_blocks(blocks, fixed=(0, 10))
    material = Material(young_modulus=33000.0, poisson_ratio=0.2, density=2.4e-9)
    problem = Problem(arch, None, material=material, friction=0.6, gravity=(500.0, 0.0, -9810.0))
    rigid = analyse(problem)
    assert rigid.details.holds, str(rigid)
    answer = solve_static(problem, PLAIN)
    assert answer.report["residual"] < 1e-8
    assert answer.report["imbalance"]["force"] < 1e-8
