"""Panels of truncated tetrahedra with friction: coarser meshes, joint forces."""

from __future__ import annotations

import numpy as np
import pytest

from fem import Problem, Static, solve_static
from fem.accuracy.ladder import coarser
from validation import load_case


def panel(divisions: int = 1) -> Problem:
    """Two by two free blocks, μ 0.6."""
    settings = {
        "block.thickness": 60,
        "assembly.columns": 2,
        "assembly.rows": 2,
        "mesh.divisions": divisions,
        "effects.friction.coefficient": 0.6,
    }
    return load_case("tetrahedra", settings).problem


def test_six_sided_solids_have_coarser_meshes() -> None:
    """Two thirds and half of three divisions are two and one: the solid itself does not change."""
    stated = panel(3)
    for share, divisions in ((2.0 / 3.0, 2), (0.5, 1)):
        result = coarser(stated, share)
        assert result is not None
        for new, old in zip(result.blocks.shapes, stated.blocks.shapes, strict=True):
            assert new.mesh.n_elements == divisions**3
            assert new.volume == pytest.approx(old.volume, rel=1e-12)
    assert coarser(panel(1), 0.5) is None


def test_the_largest_force_of_a_joint_is_the_sum_over_its_facets() -> None:
    answer = solve_static(panel(2), Static(mesh="scene", load_steps=1))
    force = answer.contacts["pressure"] * answer.contacts["area"]
    pairs = np.sort(answer.contacts["blocks"], axis=1)
    _, joint = np.unique(pairs, axis=0, return_inverse=True)
    measure = answer["largest_joint_force"]
    assert measure.value == pytest.approx(np.bincount(joint.ravel(), force).max(), rel=1e-12)
    # From one coarser mesh: half the elements along every edge.
    assert measure.error is not None
    assert 0.0 < measure.error < measure.value
