"""Planes of section forces: accepted where something lies behind and ahead of them."""

from __future__ import annotations

import numpy as np
import pytest

from fem.stresses.sections import check_planes
from geometry import ColumnBox, box_column
from geometry.parts.measures import SectionError, planes

pytestmark = pytest.mark.quick

#: Two boxes, from z = 0 to 60 mm; the joint is at 40 mm.
COLUMN = box_column([ColumnBox((100.0, 80.0, h), (2, 2, 2)) for h in (40.0, 20.0)])
DEFORMABLE, RIGID_BASE = np.zeros(2, dtype=bool), np.array([True, False])


@pytest.mark.parametrize("normal", [1.0, -1.0])
def test_a_plane_at_the_end_of_a_body_has_it_behind(normal: float) -> None:
    """What is behind presses on what is ahead, which may be loads on the face alone."""
    behind, ahead = (60.0, 0.0) if normal > 0.0 else (0.0, 60.0)
    for z in (behind, 1.0, 59.0):
        check_planes(COLUMN, planes([0.0, 0.0, z], [0.0, 0.0, normal]), DEFORMABLE)
    for z in (ahead, ahead - normal, behind + normal):
        with pytest.raises(SectionError, match="blocks lie behind it"):
            check_planes(COLUMN, planes([0.0, 0.0, z], [0.0, 0.0, normal]), DEFORMABLE)


def test_a_rigid_block_is_not_cut_but_at_its_faces() -> None:
    check_planes(COLUMN, planes([[0.0, 0.0, 40.0], [0.0, 0.0, 50.0]], [0.0, 0.0, 1.0]), RIGID_BASE)
    with pytest.raises(SectionError, match="the plane cuts block 0, which is rigid"):
        check_planes(COLUMN, planes([0.0, 0.0, 39.0], [0.0, 0.0, 1.0]), RIGID_BASE)
    only_upper = planes([0.0, 0.0, 41.0], [0.0, 0.0, 1.0], blocks=[1])
    check_planes(COLUMN, only_upper, RIGID_BASE)
