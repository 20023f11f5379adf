"""Static answers are those of a slow plain solver that shares no code with theirs.

Residuals end below 1e-8 of the loads, `STOPS`, which bounds the difference of pressures; the last
step of Newton's method leaves a far smaller one, and displacements agree to `AGREES`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fem import CoulombFriction, ElementType, Problem, Static, concrete, solve_static
from geometry import HeldFace, LoadCase, PressureLoad, box_column, pipe
from geometry.families.boxes import ColumnBox
from tests.support.coarse_tubes import ring
from tests.support.plain_statics import (
    PlainState,
    displacements,
    plain_arrays,
    plain_path,
    plain_searched,
)

METHOD = Static(mesh="scene", error_estimate=False)
AGREES = 1e-9
STOPS = 1e-8
SEARCHED = 1e-6


def _tube(degree: int, friction: float | None, layers: int = 1) -> Problem:
    mesh = (12, 2, 2) if degree == 1 else (12, 1, 1)
    blocks = ring(layers, mesh)
    return Problem(
        blocks,
        pipe(0.01),
        concrete,
        element=ElementType.FULL if degree == 1 else ElementType.INCOMPATIBLE,
        degree=degree,
        friction=friction and CoulombFriction(friction, 50.0),
    )


def _agree(problem: Problem, plain: PlainState, method: Static) -> None:
    """Displacements of every node and mean pressures of facets are the same."""
    answer = solve_static(problem, method)
    expected = np.concatenate(displacements(problem, plain))
    away = np.abs(answer.fields["displacement"] - expected).max()
    assert away <= AGREES * np.abs(expected).max()
    area = plain_arrays(problem).points.area
    pressures = (area * plain.tractions[..., 0]).sum(axis=1) / area.sum(axis=1)
    there = answer.contacts["pressure"]
    np.testing.assert_allclose(there, pressures, rtol=0.0, atol=STOPS * pressures.max())


@pytest.mark.parametrize(
    ("degree", "friction", "layers"),
    [pytest.param(3, None, 1, marks=pytest.mark.thorough), (1, 0.3, 2), (2, 0.2, 1)],
)
def test_tubes(degree: int, friction: float | None, layers: int) -> None:
    """Computed whole, and one block of each orbit: of two layers a half turn takes one."""
    problem = _tube(degree, friction, layers)
    steps = None if friction is None else 2
    path = [((k / (steps or 1)) ** 2, 1.0) for k in range(1, 1 + (steps or 1))]
    plain = plain_path(problem, path)
    for symmetry in ("none", "auto"):
        _agree(problem, plain, replace(METHOD, symmetry=symmetry, load_steps=steps))


@pytest.mark.parametrize("friction", [None, 0.3])
def test_supports_that_move(friction: float | None) -> None:
    """A box that is pressed on another one is pushed to the side and, with friction, back."""
    below, above = (
        ColumnBox((60.0, 60.0, 40.0), (3, 3, 2)),
        ColumnBox((60.0, 60.0, 30.0), (3, 3, 2)),
    )
    blocks = box_column([below, above])
    way = np.array([0.02, 0.0, 0.0])
    there = ((0.0, 0.0), (1.0, 1.0), (2.0, 0.5))
    held = HeldFace(1, "x-", np.eye(3)[:2], way, there)
    load = LoadCase(
        blocks,
        "pushed",
        (PressureLoad(np.array([1]), "z+", 0.5),),
        np.array([True, False]),
        (held,),
    )
    problem = Problem(
        blocks,
        load,
        concrete,
        element=ElementType.FULL,
        friction=friction and CoulombFriction(friction, 50.0),
    )
    steps = 8
    times = np.linspace(0.0, 2.0, steps + 1)
    path = [(1.0, float(np.interp(t, *np.transpose(there)))) for t in times]
    method = replace(METHOD, load_steps=1, motion_steps=steps)
    _agree(problem, plain_path(problem, path), method)


@pytest.mark.parametrize("friction", [None, 0.2])
def test_points_of_a_search(friction: float | None) -> None:
    """Searches end at a share of the skin of contact, which bounds how far blocks still go."""
    problem = replace(_tube(1, friction), finite_sliding=True)
    plain = plain_searched(problem)
    answer = solve_static(problem, replace(METHOD, load_steps=None if friction is None else 1))
    expected = np.concatenate(displacements(problem, plain))
    away = np.abs(answer.fields["displacement"] - expected).max()
    assert away <= SEARCHED * np.abs(expected).max()
