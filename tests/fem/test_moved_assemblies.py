"""Answers of an assembly that stands elsewhere: the same digits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fem import Problem, Static, concrete, solve_static
from geometry import Assembly
from validation import load_case

pytestmark = pytest.mark.quick

COARSE = ["mesh.around=12", "mesh.radial=2", "mesh.axial=2", "assembly.layers=1"]


def moved(problem: Problem, by: float) -> Problem:
    """Blocks and their axis moved along (1, -1, 1), loads with them."""
    way = by * np.array([1.0, -1.0, 1.0])
    stood = problem.blocks
    elsewhere = replace(stood, translations=stood.translations + way, origin=stood.origin + way)
    return replace(problem, blocks=elsewhere, load=replace(problem.load_case, assembly=elsewhere))


def numbers(problem: Problem) -> list[float]:
    """Displacement and pressures, without error bars."""
    answer = solve_static(problem, Static(mesh="scene", error_estimate=False))
    return [answer.measures[name].value for name in ("max_displacement", "p_eff", "p_max_point")]


@pytest.mark.parametrize(
    ("scene", "changes"),
    [
        ("tsb1-pipe", COARSE),
        ("tsb1-pipe", [*COARSE, "effects.friction=0.3"]),
        ("column-nonmatching", []),
    ],
)
def test_answers_do_not_depend_on_the_place(scene: str, changes: list[str]) -> None:
    """Places at 1e5 mm have rounding of 1e-11 mm, gaps of 1e-3 mm: a part in 1e8 of a pressure
    that one point has, less of those that a joint shares."""
    problem = load_case(scene, changes).problem
    expected = numbers(problem)
    for by in (1e3, 1e5):
        assert numbers(moved(problem, by)) == pytest.approx(expected, rel=1e-9)


def test_gmsh_fills_a_solid_alike_wherever_it_stands() -> None:
    """Rounding of places decided which tetrahedra there were, and friction how many iterations."""
    turns = 0.3 + np.arange(5) * 2.0 * np.pi / 5.0
    ring = 40.0 * np.column_stack([np.cos(turns), np.sin(turns)])
    points = np.vstack([np.column_stack([ring, np.full(5, z)]) for z in (0.0, 30.0)])
    faces = [[4, 3, 2, 1, 0], [5, 6, 7, 8, 9]]
    faces += [[k, (k + 1) % 5, 5 + (k + 1) % 5, 5 + k] for k in range(5)]
    meshes = []
    for way in ([0.0, 0.0, 0.0], [1.0, -2.0, 3.0], [1000.1, -2000.2, 3000.3]):
        stack = [(points + way, faces), (points + way + [3.0, 2.0, 30.0], faces)]
        solids = Assembly.from_blocks(stack, fixed=[0])
        meshed = Problem(solids, None, concrete, gravity=(0.0, 0.0, -9810.0)).meshed.blocks
        meshes.append([(shape.mesh.elements, shape.mesh.nodes - way) for shape in meshed.shapes])
    for other in meshes[1:]:
        for (elements, nodes), (known, there) in zip(other, meshes[0], strict=True):
            assert np.array_equal(elements, known)
            # Rounding of places, of 1e-12 mm at most.
            assert np.abs(nodes - there).max() < 1e-11
