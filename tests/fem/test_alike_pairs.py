"""Pairs of blocks that share their reference geometry are those that are placed alike."""

from dataclasses import replace

import numpy as np
import pytest

from fem import Material
from fem.explicit.contact.alike_pairs import alike_pairs
from fem.explicit.setup.timed_system import timed_system
from geometry.families.boxes import BrickStack
from geometry.loads import named_load
from tests.support.fem_problems import deformable_assembly

pytestmark = pytest.mark.quick

CONCRETE = Material(density=2.4e-9, young_modulus=33e3, poisson_ratio=0.2)


def column():
    """Three equal bricks on one another between fixed ones: four joints."""
    stack = BrickStack((100.0, 60.0, 50.0), (2, 2, 1), columns=1, layers=3).build()
    return deformable_assembly(stack, named_load("pillar", 0.01).on(stack), CONCRETE)


def sizes(deformable) -> list[int]:
    stated = timed_system(deformable)
    pairs = alike_pairs(stated.system, stated.copy_of)
    return sorted(len(alike.blocks) for alike in pairs)


def test_joints_of_equal_bricks_in_a_row_are_alike() -> None:
    """The two joints between free bricks share one geometry; those at fixed bricks do not count."""
    joined = sizes(column())
    assert sum(joined) == 4
    assert max(joined) >= 2


@pytest.mark.parametrize("gap", [1.0, 1e-3])
def test_a_pair_that_is_placed_otherwise_is_not_alike(gap: float) -> None:
    """One brick farther from the others by any gap: its joint has a geometry of its own."""
    deformable = column()
    offsets = deformable.offsets.copy()
    highest = int(np.argmax(deformable.assembly.translations[:, 2]))
    above = deformable.assembly.layer >= deformable.assembly.layer[highest] - 1
    offsets[above] += [0.0, 0.0, gap]
    moved = replace(deformable, offsets=offsets)
    assert len(sizes(moved)) == len(sizes(deformable)) + 1
