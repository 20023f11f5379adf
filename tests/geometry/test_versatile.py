"""Versatile Blocks: three arrangements of one shape that fill a plate, and lock."""

from __future__ import annotations

import numpy as np
import pytest

from geometry.families.versatile_panel import PanelArrangement, VersatilePanel, versatile_block
from geometry.polyhedra.overlap import check_assembly
from validation import load_case, solve

pytestmark = pytest.mark.quick

SIDE, HEIGHT = 300.0, 170.0


def test_a_block_is_as_large_as_its_part_of_the_plate() -> None:
    block = versatile_block(SIDE, HEIGHT)
    assert block.volume == pytest.approx(SIDE**2 * HEIGHT, rel=1e-12)
    horizontal = np.abs(block.normals[:, 2]) > 1.0 - 1e-12
    both = [block.areas[horizontal & (block.normals[:, 2] * way > 0)].sum() for way in (-1, 1)]
    np.testing.assert_allclose(both, SIDE**2, rtol=1e-12)


@pytest.mark.parametrize("arrangement", list(PanelArrangement))
def test_free_blocks_touch_with_all_of_their_sides(arrangement: PanelArrangement) -> None:
    panel = VersatilePanel(SIDE, HEIGHT, 3, 2, arrangement=arrangement).build()
    check_assembly(panel)
    block = versatile_block(SIDE, HEIGHT)
    sides = block.areas[np.abs(block.normals[:, 2]) < 1.0 - 1e-12].sum()
    faces = panel.with_faces_alone()
    np.testing.assert_allclose(faces.eligible_areas()[~panel.fixed], sides, rtol=1e-6)


@pytest.mark.parametrize("arrangement", ["p1", "pg", "p4"])
def test_the_scene_is_interlocked_by_its_faces_in_every_arrangement(arrangement: str) -> None:
    settings = (f"block.arrangement={arrangement}", "assembly.columns=2", "assembly.rows=2")
    answer = solve(load_case("versatile", settings).with_method("rigid"))
    assert answer.as_dict()["mechanism"] == "locked"
    assert answer.as_dict()["n_points_without_area"] > 0
