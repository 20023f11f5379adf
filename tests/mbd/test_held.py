"""Problems of deformable blocks that certainly move are rejected before they are solved."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from fem import Problem, concrete
from geometry.families.boxes import ColumnBox, box_column
from geometry.polyhedra.options import DetectionOptions
from mbd.held import UnheldError, require_held, why_unheld

pytestmark = pytest.mark.quick

DOWN, UP, ASIDE = (0.0, 0.0, -9810.0), (0.0, 0.0, 9810.0), (1.0, 0.0, -9810.0)


FACES = DetectionOptions()


def brick(
    gravity: tuple[float, float, float], detection: DetectionOptions | None = None, **stated: Any
) -> Problem:
    """A free brick on a fixed one, of hexahedra or of solids whose faces are detected."""
    blocks = box_column([ColumnBox((80.0, 60.0, 40.0), (4, 2, 2))] * 2)
    blocks = replace(blocks, detection=detection)
    return Problem(blocks, None, concrete, gravity=gravity, **stated)


@pytest.mark.parametrize("gravity", [UP, ASIDE])
def test_faces_of_solids_carry_the_load_or_the_motion_is_named(
    gravity: tuple[float, float, float],
) -> None:
    require_held(brick(DOWN, FACES))
    assert why_unheld(brick(DOWN, FACES)) is None
    with pytest.raises(UnheldError, match="the faces of the blocks do not carry the load: block 1"):
        require_held(brick(gravity, FACES))
    words = why_unheld(brick(gravity, FACES))
    assert words is not None
    assert "block 1" in words


@pytest.mark.parametrize(
    "stated", [{"clearance": 0.1}, {"spacing": 0.1}, {"finite_sliding": True}, {"friction": 0.3}]
)
def test_faces_that_may_move_before_they_press_are_not_judged(stated: dict[str, Any]) -> None:
    require_held(brick(ASIDE, FACES, **stated))


def test_friction_that_does_not_stop_a_motion_is_named() -> None:
    """A slope of 0.1 slides by friction of 0.09."""
    slope = (981.0, 0.0, -9810.0)
    require_held(brick(slope, friction=0.11))
    with pytest.raises(UnheldError, match=r"friction of 0\.09 does not stop it"):
        require_held(brick(slope, friction=0.09))
    require_held(brick(slope))  # without friction Newton's iterations say so
