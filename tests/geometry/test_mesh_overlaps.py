"""Blocks with hexahedra that share space are rejected with how deep they are in each other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geometry.assembly import Assembly, check_mesh_overlaps
from geometry.families.boxes import ColumnBox, box_column
from geometry.parts.placed import AssemblyError

pytestmark = pytest.mark.quick

_LARGE, _SMALL = ColumnBox((100.0, 80.0, 60.0), (3, 2, 2)), ColumnBox((30.0, 20.0, 40.0), (1, 1, 1))


def sunk(boxes: list[ColumnBox], depth: float, seed: int) -> Assembly:
    """Two boxes, the upper one lowered, all turned and moved at random."""
    column = box_column(boxes)
    places = column.translations - np.array([[0.0, 0.0, depth * k] for k in range(2)])
    turn = Rotation.random(rng=seed).as_matrix()
    return replace(
        column, rotations=turn @ column.rotations, translations=places @ turn.T + [3.0, 5.0, 7.0]
    )


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("boxes", [[_LARGE, _SMALL], [_SMALL, _LARGE], [_LARGE, _LARGE]])
def test_depth_is_how_far_a_block_was_lowered(boxes: list[ColumnBox], seed: int) -> None:
    """Corners of one or of the other lie inside, whichever is the smaller one; or of neither."""
    check_mesh_overlaps(sunk(boxes, 0.0, seed), 0.01)
    check_mesh_overlaps(sunk(boxes, 0.5, seed), 0.6)
    with pytest.raises(AssemblyError, match=r"blocks 0 and 1 overlap by 10 mm"):
        check_mesh_overlaps(sunk(boxes, 10.0, seed), 0.6)
