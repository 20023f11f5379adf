"""Verdicts with friction are those of contacts with area; corners and edges have a second row."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.support.dome import voussoirs, write_dome
from validation import load_case, solve

FIVE_RINGS = [20.0, 34.0, 48.0, 62.0, 76.0, 90.0]


@pytest.mark.parametrize("tolerance", [0.004, 0.04])
@pytest.mark.parametrize(("thickness", "carried"), [(31.0, False), (32.5, True)])
def test_five_rings_stand_by_their_faces_alone(
    tmp_path: Path, thickness: float, carried: bool, tolerance: float
) -> None:
    """The axisymmetric limit is t/R = 0.0310. Corners where four voussoirs meet would tie the
    rings at any thickness, whatever the tolerance of contact."""
    scene = f"[effects.friction]\ncoefficient = 0.6\n[detection]\ntolerance = {tolerance}\n"
    path = write_dome(tmp_path, voussoirs(thickness, 16, FIVE_RINGS), scene)
    answer = solve(load_case(path, method="rigid")).as_dict()
    assert answer["carried"] is carried
    assert answer["edges_and_corners"]["carried"]
    assert answer["edges_and_corners"]["n_contacts"] == 256


def test_the_limit_load_of_a_dome_is_that_of_its_faces(tmp_path: Path) -> None:
    """An independent linear program in space puts it between 3.886 and 4.063; with corners that
    have no area 4.658 was printed."""
    scene = "[load]\nacceleration = [981.0, 0.0, 0.0]\n[effects.friction]\ncoefficient = 0.5\n"
    scene += "[rigid]\ncollapse = true\n"
    blocks = voussoirs(120.0, 8, np.linspace(10.0, 90.0, 7), cap=True)
    path = write_dome(tmp_path, blocks, scene)
    answer = solve(load_case(path, method="rigid")).as_dict()
    assert answer["collapse"]["certified"]
    assert 3.886 < answer["collapse"]["factor"] < 4.063
    assert answer["collapse"]["factor"] == pytest.approx(3.9855, abs=1e-4)
    assert answer["edges_and_corners"]["collapse_factor"] > 4.6
