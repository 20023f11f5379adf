"""Facets that pictures draw."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.answers import on_its_mesh
from tests.support.coarse_tubes import coarse
from tests.support.own_blocks import column
from validation.output.pictures.tubes import STRESSES, extreme, run_facets

PRESSURE = 0.5


@pytest.mark.parametrize("degree", [1, 2])
def test_joints_are_drawn_in_pieces_of_a_uniform_pressure(degree: int) -> None:
    """Joints of 100 × 80 mm²; of higher degree a facet is drawn in more than one piece."""
    run = on_its_mesh(column(PRESSURE).changed({"fem.degree": degree}), method="static")
    drawn = run_facets(run)
    np.testing.assert_allclose(drawn.pressures, PRESSURE, rtol=1e-7)
    corners = drawn.corners.reshape(-1, 4, 3)
    across = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    assert 0.5 * np.linalg.norm(across, axis=1).sum() == pytest.approx(2 * 8000.0, rel=1e-4)
    assert not drawn.scale.note
    assert (len(run.details.contact_state.pressures) < len(drawn.pressures)) == (degree > 1)


def test_stresses_below_a_picture_are_those_of_the_block_that_the_table_names() -> None:
    small = list(coarse(1, 4))
    run = on_its_mesh("tsb1-pipe", small, method="static")
    blocks = run.details.whole
    for stress in STRESSES:
        place = run[stress.measure].place
        assert place is not None
        at, words = extreme(run, stress)
        (block,) = place["blocks"]
        assert f"block {block}" in words
        node = np.linalg.norm(blocks.positions(block) - at, axis=1).argmin()
        values = stress.sign * stress.of(
            run.fields["principal_stress"][run.block_of_point == block]
        )
        assert values[node] == values.max()
