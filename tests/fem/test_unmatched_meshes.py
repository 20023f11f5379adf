"""Meshes that do not match: every solver finds their contacts, and none asks for finite sliding."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fem import LinearPenalty, Material, Problem, solve_static
from geometry import Assembly, ColumnBox, LoadCase, box_block, box_column
from mbd import analyse
from tests.support.answers import PLAIN

STONE = Material(density=2.4e-9, young_modulus=33e3, poisson_ratio=0.2)
GRAVITY = 9810.0


def weighing(blocks: Assembly, **options: object) -> Problem:
    """Blocks under their weight alone."""
    load = LoadCase(blocks, "weight", (), blocks.fixed)
    down = (0.0, 0.0, -GRAVITY)
    return Problem(blocks, load, STONE, law=LinearPenalty(1e3), gravity=down, **options)  # type: ignore[arg-type]


def turned(angle: float) -> Assembly:
    """A box on a wider one, turned about the vertical, stated by hand."""
    faces = ("z-", "z+")
    low = box_block((100.0, 100.0, 50.0), (3, 3, 1), name="low", contact_faces=faces)
    high = box_block((60.0, 40.0, 50.0), (2, 2, 1), name="high", contact_faces=faces)
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    middle = np.array([50.0, 50.0, 50.0])
    return Assembly(
        name="hand",
        shapes=(low, high),
        shape_of=np.array([0, 1]),
        rotations=np.stack([np.eye(3), turn]),
        translations=np.stack([np.zeros(3), middle - turn @ np.array([30.0, 20.0, 0.0])]),
        layer=np.arange(2),
        fixed=np.array([True, False]),
        unmatched_allowed=True,
    )


@pytest.mark.parametrize("angle", [0.0, 0.3, 1.0])
def test_rigid_and_static_joints_carry_the_weight(angle: float) -> None:
    blocks = turned(angle)
    problem = weighing(blocks)
    weight = STONE.density * GRAVITY * float(blocks.volumes[1])
    rigid = analyse(problem)
    assert rigid["largest_joint_force"].value == pytest.approx(weight, rel=1e-9)
    # The search cuts the facets of the finer surface by those of the coarser one.
    assert rigid.contacts["area"].sum() == pytest.approx(60.0 * 40.0, rel=1e-9)
    static = solve_static(problem, PLAIN)
    assert static.details.whole.contact.finite_sliding
    # The residual is 1e-8 of the load.
    for answer in (rigid, static):
        # Forces are those on the second block of each contact.
        assert len(np.unique(answer.contacts["blocks"], axis=0)) == 1
        on_upper = 2 * int(answer.contacts["blocks"][0, 1]) - 1
        total = on_upper * answer.contacts["force"].sum(axis=0)
        np.testing.assert_allclose(total, [0, 0, weight], atol=1e-6 * weight)


def test_matching_meshes_stay_paired() -> None:
    boxes = [ColumnBox((100.0, 80.0, 50.0), (2, 2, 1))] * 2
    problem = weighing(box_column(boxes))
    assert problem.rigid_blocks is problem.blocks
    assert not problem.searches
    other = weighing(box_column([boxes[0], replace(boxes[1], divisions=(3, 2, 1))]))
    assert other.searches
    assert not other.finite_sliding
    for name in ("p_max_facet", "largest_joint_force"):
        assert analyse(other)[name].value == pytest.approx(analyse(problem)[name].value, rel=1e-9)
